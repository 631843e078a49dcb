"""The results of many forward solves: tips as arrays, shapes on demand."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...checks import Array
from ...solvers.status import SolveStatus
from ..equilibrium import Equilibrium


class Batch(Sequence[Equilibrium]):
    """The results of :meth:`ForwardProblem.solve_many <ctr_opt.ForwardProblem.solve_many>`, in the order of the rows.

    A sequence of :class:`~ctr_opt.Equilibrium`: ``batch[k]`` is the result of row ``k``. A failed row is False in
    ``converged`` and NaN in the arrays. Its ``status`` and ``message`` say what happened.

    Attributes
    ----------
    snapped
        ``(k,)``, bool: rows of a chain that do not continue the branch of the row before. A fold or a bifurcation ends
        the branch, so the robot snaps. The shape is then that of a cold start, which need not be the one that the robot
        snaps to. Rotations count in full: if tubes turn against each other by more than half a turn between two rows,
        that turn is followed in smaller, slower steps. A slice keeps the marks of its rows.

    Examples
    --------
    >>> import numpy as np, ctr_opt as ctr
    >>> tube = ctr.Tube("rod", 1e-3, 0.0, ctr.Arc(0.1, 10.0), youngs_modulus=60e9, poisson_ratio=0.3)
    >>> batch = ctr.ForwardProblem(ctr.Robot([tube])).solve_many((np.zeros((3, 1)), np.zeros((3, 1))))
    >>> batch.converged.all(), batch.tip_position.shape, round(batch[2].length, 3)
    (np.True_, (3, 3), 0.1)
    """

    def __init__(self, results: Sequence[Equilibrium], snapped: NDArray[np.bool_] | None = None) -> None:
        self._results = results
        self.snapped = np.zeros(len(results), dtype=bool) if snapped is None else snapped
        self.snapped.setflags(write=False)

    def __len__(self) -> int:
        return len(self._results)

    def __getitem__(self, k: Any) -> Any:
        return Batch(self._results[k], self.snapped[k]) if isinstance(k, slice) else self._results[k]

    def __iter__(self) -> Iterator[Equilibrium]:
        return iter(self._results)

    @property
    def converged(self) -> NDArray[np.bool_]:
        """Whether each row has an equilibrium, ``(k,)``."""
        return np.array([result.converged for result in self._results], dtype=bool)

    @property
    def statuses(self) -> list[SolveStatus]:
        """The status of each row."""
        return [result.status for result in self._results]

    @property
    def tip_position(self) -> Array:
        """Tip positions ``(k, 3)``, m, world frame; NaN if a row failed."""
        return self._collected((3,), lambda result: result.tip_position)

    @property
    def tip_pose(self) -> Array:
        """Tip poses ``(k, 4, 4)``, world frame; NaN if a row failed."""
        return self._collected((4, 4), lambda result: result.tip_pose)

    @property
    def discretization_error(self) -> Array:
        """Estimated largest position errors ``(k,)``, m; NaN if a row failed."""
        return self._collected((), lambda result: result.discretization_error)

    def _collected(self, shape: tuple[int, ...], of: Any) -> Array:
        values = np.full((len(self), *shape), np.nan)
        for k, result in enumerate(self._results):
            if result.converged:
                values[k] = of(result)
        return values

    def __repr__(self) -> str:
        failed, snapped = (~self.converged).sum(), self.snapped.sum()
        return f"<Batch of {len(self)} equilibria, {failed} failed, {snapped} snapped>"
