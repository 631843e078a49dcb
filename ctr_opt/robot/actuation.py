"""What the actuators do: a rotation and a translation of each tube's base."""

from __future__ import annotations

import attrs
import numpy as np

from ..checks import ARRAY_EQ, Array, Checked, Entry, array, described, given
from ..errors import DefinitionError


@attrs.frozen
class Actuation(Checked):
    """Where the tubes' bases are held.

    Parameters
    ----------
    rotations
        ``alpha_i``, rad, one for each tube.
    translations
        ``beta_i = -D_i``, m, one for each tube: the arc length at which the base of tube ``i`` is held;
        ``<= 0``, as the actuators grasp the tubes behind the entry point ``s = 0``.
    read
        Set by :meth:`Fit.actuation <ctr_opt.Fit.actuation>` alone: rotations and translations as they were read,
        ``(2, n)``, before the homes of the joints were added. Not compared.

    Examples
    --------
    >>> Actuation(rotations=[0.0, 1.0], translations=[-0.1, -0.05]).translations
    array([-0.1 , -0.05])
    """

    entries = described(rotations=Entry("rad", (None,)), translations=Entry("m", (None,)))
    rotations: Array = attrs.field(converter=given, eq=ARRAY_EQ, hash=False)
    translations: Array = attrs.field(converter=given, eq=ARRAY_EQ, hash=False)
    read: Array | None = attrs.field(default=None, eq=False, repr=False, kw_only=True)

    def __attrs_post_init__(self) -> None:
        super().__attrs_post_init__()
        if self.read is not None:
            object.__setattr__(self, "read", array(self.read, "read", (2, len(self.rotations))))
        if len(self.rotations) != len(self.translations):
            raise DefinitionError(
                f"rotations has {len(self.rotations)} entries and translations {len(self.translations)}: "
                "each needs one for each tube"
            )
        for k, translation in enumerate(self.translations):
            if translation > 0.0:
                raise DefinitionError(
                    f"translations[{k}] = {translation:g} m puts the base of tube {k} in front of the entry point: "
                    "it must be at most 0"
                )


def joints_of(actuation: Actuation) -> Array:
    """Rotations (rad), then translations (m), in one vector."""
    return np.concatenate((actuation.rotations, actuation.translations))


def actuation_of(joints: Array) -> Actuation:
    """The actuation of joints in one vector."""
    tubes = len(joints) // 2
    return Actuation(joints[:tubes], joints[tubes:])
