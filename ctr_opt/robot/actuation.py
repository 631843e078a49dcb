"""Actuation: a rotation and a translation of each tube's base."""

from __future__ import annotations

import attrs
import numpy as np

from ..checks import ARRAY_EQ, Array, Checked, Entry, array, described, unchecked
from ..errors import DefinitionError


@attrs.frozen
class Actuation(Checked):
    """Rotation and translation of each tube's base.

    Parameters
    ----------
    rotations
        ``alpha_i``, rad, one per tube.
    translations
        ``beta_i = -D_i``, m, one per tube: the arc length at which the base of tube ``i`` is held. Each is ``<= 0``,
        because the actuators grasp the tubes behind the entry point ``s = 0``.
    read
        Rotations and translations as they were read, ``(2, n)``, before the homes of the joints were added. Only
        :meth:`Fit.actuation <ctr_opt.Fit.actuation>` sets it. Comparisons ignore it.

    Raises
    ------
    DefinitionError
        Rotations and translations differ in number, or a translation is above 0.

    Examples
    --------
    >>> Actuation(rotations=[0.0, 1.0], translations=[-0.1, -0.05]).translations
    array([-0.1 , -0.05])
    """

    entries = described(rotations=Entry("rad", (None,)), translations=Entry("m", (None,)))
    rotations: Array = attrs.field(converter=unchecked, eq=ARRAY_EQ, hash=False)
    translations: Array = attrs.field(converter=unchecked, eq=ARRAY_EQ, hash=False)
    read: Array | None = attrs.field(default=None, eq=False, repr=False, kw_only=True)

    def __attrs_post_init__(self) -> None:
        super().__attrs_post_init__()
        if self.read is not None:
            object.__setattr__(self, "read", array(self.read, "read", (2, len(self.rotations))))
        if len(self.rotations) != len(self.translations):
            raise DefinitionError(
                f"rotations has {len(self.rotations)} entries, but translations has {len(self.translations)}: "
                "each needs one per tube"
            )
        for k, translation in enumerate(self.translations):
            if translation > 0.0:
                raise DefinitionError(
                    f"translations[{k}] = {translation:g} m puts the base of tube {k} in front of the entry point: "
                    "it must be at most 0"
                )


def joints_of(actuation: Actuation) -> Array:
    """Join rotations (rad) and translations (m) into one vector of joints ``(2 tubes,)``."""
    return np.concatenate((actuation.rotations, actuation.translations))


def actuation_of(joints: Array) -> Actuation:
    """Split one vector of joints ``(2 tubes,)`` into an actuation."""
    tubes = len(joints) // 2
    return Actuation(joints[:tubes], joints[tubes:])
