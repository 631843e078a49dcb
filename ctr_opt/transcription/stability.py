"""Is a shape stable? The second variation of the potential energy at its states, in numbers."""

from __future__ import annotations

import attrs
import numpy as np
from numpy.typing import NDArray

from ..mechanics.sections import Configuration
from ..robot.checks import Array
from .nlp import padded
from .second_variation import second_variation_functions
from .shooting import Shooting, cut

MARGIN = 1e-7
"""The least margin; coarse steps need a wider one: what their linear maps lack to be symplectic is an error."""

_CUTS = 12  # times a step is cut in two before nothing is said


@attrs.frozen
class SecondVariation:
    """How many directions lower the energy, and whether all others raise it (it is ``positive``).

    ``margin``: an eigenvalue of (second variation, elastic part) nearer to zero is not told from zero.
    """

    negative: int
    positive: bool
    margin: float


def second_variation(
    configuration: Configuration, mesh: Array, states: Array, integrator: str
) -> SecondVariation | None:
    """The second variation at dimensionless states ``(size, k)`` where the steps of a mesh begin.

    Loads must have a potential. None where steps cut ever shorter still may hide something.
    """
    shooting = Shooting(configuration, mesh, integrator)
    for _ in range(_CUTS):
        steps = _Steps(shooting, states)
        doubtful, margin = steps.doubtful, max(MARGIN, steps.defect)
        for shift in (margin, -margin):
            if not doubtful.any():
                negative, doubtful = steps.count(shift)
            if not (doubtful.any() or (negative and shift > 0.0)):
                return SecondVariation(negative, shift > 0.0, margin)
        if not np.isfinite(margin):
            break
        shooting, states = _halved(shooting, states, doubtful)
    return None


class _Steps:
    """The linearized steps of a mesh: which are ``doubtful``, and their largest ``defect``."""

    def __init__(self, shooting: Shooting, states: Array) -> None:
        columns, entry = shooting.functions.columns, shooting.functions.entry
        self.functions = second_variation_functions(columns.tubes, shooting.integrator, shooting.kind)
        self._steps, self._padded = len(shooting.mesh), padded(len(shooting.mesh))
        self._compliance = shooting.entry[entry.parts["compliance"]]
        idle = self._padded - self._steps
        transfer, self._eliminate = self.functions.maps(self._padded)
        found = transfer(np.pad(states, ((0, 0), (0, idle)), mode="edge"), columns.pad(shooting.columns, self._padded))
        *self._data, doubtful, defect = (self._backward(each.full()) for each in found)
        self.doubtful = self._forward(doubtful)
        self.defect = float(np.max(defect))

    def count(self, shift: float) -> tuple[int, NDArray[np.bool_]]:
        """How many directions are negative, the elastic part divided by ``1 + shift``; which steps leave doubt."""
        size = self.functions.size
        w, negative, lost = (each.full() for each in self._eliminate(np.zeros((size, size)), *self._data, shift))
        at_entry = self.functions.entry(w[:, -size:], self._compliance, shift)
        return int(negative.sum() + float(at_entry)), self._forward(lost)

    def _backward(self, beside: Array) -> Array:
        """The steps' matrices side by side, the last one first."""
        return np.hstack(np.split(beside, self._padded, axis=1)[::-1])

    def _forward(self, flags: Array) -> NDArray[np.bool_]:
        """Which steps of the mesh are flagged, the first one first."""
        return np.asarray(flags[0, ::-1][: self._steps] != 0.0)


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
