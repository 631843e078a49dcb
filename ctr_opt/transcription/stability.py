"""Is a shape stable? The second variation of the potential energy at its states, in numbers."""

from __future__ import annotations

import attrs
import numpy as np
from numpy.typing import NDArray

from ..mechanics.sections import Configuration
from ..robot.checks import Array
from .nlp import padded
from .second_variation import SecondVariationFunctions, second_variation_functions
from .shooting import Shooting, cut

MARGIN = 1e-7
"""An eigenvalue of (second variation, elastic part) nearer to zero is not told from zero."""

_CUTS = 12  # times a step is cut in two before nothing is said


@attrs.frozen
class SecondVariation:
    """How many directions lower the energy, and whether all others raise it.

    ``defect``: how far from symplectic the worst step is; an error of the second variation against its elastic part.
    """

    negative: int
    positive: bool
    defect: float


def second_variation(configuration: Configuration, mesh: Array, states: Array, integrator: str) -> SecondVariation | None:
    """The second variation at dimensionless states ``(size, k)`` where the steps of a mesh begin.

    Loads must have a potential. None where steps cut ever shorter still may hide something.
    """
    shooting = Shooting(configuration, mesh, integrator)
    for _ in range(_CUTS):
        steps = _Steps(shooting, states)
        negative, doubtful = steps.count(MARGIN)
        if negative and not doubtful.any():
            negative, doubtful = steps.count(-MARGIN)
            if not doubtful.any():
                return SecondVariation(negative, False, steps.defect)
        elif not doubtful.any():
            return SecondVariation(0, True, steps.defect)
        shooting, states = _halved(shooting, states, doubtful)
    return None


class _Steps:
    """The linearized steps of a mesh."""

    def __init__(self, shooting: Shooting, states: Array) -> None:
        columns, entry = shooting.functions.columns, shooting.functions.entry
        self.functions = second_variation_functions(columns.tubes, shooting.integrator, shooting.kind)
        self._steps, self._padded = len(shooting.mesh), padded(len(shooting.mesh))
        self._compliance = shooting.entry[entry.parts["compliance"]]
        idle = self._padded - self._steps
        transfer, self._eliminate = self.functions.maps(self._padded)
        found = transfer(np.pad(states, ((0, 0), (0, idle)), mode="edge"), columns.pad(shooting.columns, self._padded))
        self._data = [np.hstack(np.split(each.full(), self._padded, axis=1)[::-1]) for each in found]
        self.defect = np.nan

    def count(self, shift: float) -> tuple[int, NDArray[np.bool_]]:
        """How many directions are negative, and which steps leave that in doubt."""
        size = self.functions.size
        found = self._eliminate(np.zeros((size, size)), *self._data, shift)
        w, negative, doubtful, defect = (each.full() for each in found)
        at_entry = self.functions.entry(w[:, -size:], self._compliance, shift)
        self.defect = float(defect.max())
        return int(negative.sum() + float(at_entry)), doubtful[0, ::-1][: self._steps] > 0


def _halved(shooting: Shooting, states: Array, which: NDArray[np.bool_]) -> tuple[Shooting, Array]:
    """The problem with some steps cut in two, and the states at its nodes."""
    parts = np.where(which, 2, 1)
    finer = Shooting(shooting.configuration, cut(shooting.mesh, parts), shooting.integrator, shooting.kind)
    starts = np.cumsum(parts) - parts
    inner = np.empty((len(states), parts.sum()))
    inner[:, starts] = states
    first = starts[which]
    inner[:, first + 1], _ = finer.functions.many(finer.functions.step, states[:, which], finer.columns[:, first])
    return finer, inner
