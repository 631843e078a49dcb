"""Homes of the actuators: the offsets that a calibration adds to joint readings."""

from __future__ import annotations

from typing import Any

import attrs
import numpy as np

from ..checks import Array, array
from ..errors import DefinitionError
from ..robot.actuation import Actuation

_ROUNDING = 1e-9  # m: rounding may put an estimate at its bound, a base at the entry point, beyond it


@attrs.frozen(eq=False)
class Homes:
    """Offsets of all joints ``(2, n)``: rotations, rad, and translations, m; zero if not estimated."""

    names: tuple[str, ...]
    """Names of the estimated offsets. If empty, actuations are used as read."""

    offsets: Array

    def actuation(self, rotations: Any, translations: Any) -> Actuation:
        """The actuation of the calibrated robot at joint readings."""
        if not self.names:
            return Actuation(rotations, translations)
        shape = self.offsets[0].shape
        read = np.stack((array(rotations, "rotations", shape), array(translations, "translations", shape)))
        read.setflags(write=False)
        turned, shifted = self._added(read)
        if shifted.max() > 0.0:
            k = int(shifted.argmax())
            raise DefinitionError(
                f"translations[{k}] = {read[1, k]:g} m with its home of {self.offsets[1, k]:g} m puts the base of tube "
                f"{k} {shifted[k]:g} m in front of the entry point; the sum must be at most 0"
            )
        return Actuation(turned, shifted, read=read)

    def _added(self, read: Array) -> Array:
        added = read + self.offsets
        added[1, (added[1] > 0.0) & (added[1] < _ROUNDING)] = 0.0
        return added

    def within(self, actuation: Actuation) -> bool:
        """Whether an actuation consists of joint readings plus these offsets."""
        read = actuation.read
        if not self.names or read is None or read.shape != self.offsets.shape:
            return False
        return np.array_equal(self._added(read), (actuation.rotations, actuation.translations))

    def check(self, actuation: Actuation) -> None:
        """Raise ``DefinitionError`` for an actuation without these homes."""
        if self.names and not self.within(actuation):
            more = f" and {len(self.names) - 1} more" if len(self.names) > 1 else ""
            raise DefinitionError(
                f"the actuation does not have the homes that the fit estimated ({self.names[0]}{more}): use "
                "fit.actuation(rotations, translations) with the joint readings"
            )
