"""Many forward solves at once: their tips as arrays, their shapes when asked for."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..checks import Array, array
from ..errors import DefinitionError
from ..loads.wrenches import LOADS, Load
from ..robot.actuation import Actuation
from .equilibrium import Equilibrium


class Batch(Sequence[Equilibrium]):
    """The results of :meth:`ForwardProblem.solve_many <ctr_opt.ForwardProblem.solve_many>`, in the order of the rows.

    A sequence of :class:`~ctr_opt.Equilibrium`: ``batch[k]`` is the result of row ``k``. Rows that failed say so there
    (``status``, ``message``), are False in ``converged`` and not a number in the arrays.

    Examples
    --------
    >>> import numpy as np, ctr_opt as ctr
    >>> tube = ctr.Tube("rod", 1e-3, 0.0, ctr.Arc(0.1, 10.0), youngs_modulus=60e9, poisson_ratio=0.3)
    >>> batch = ctr.ForwardProblem(ctr.Robot([tube])).solve_many((np.zeros((3, 1)), np.zeros((3, 1))))
    >>> batch.converged.all(), batch.tip_position.shape, round(batch[2].length, 3)
    (np.True_, (3, 3), 0.1)
    """

    def __init__(self, results: Sequence[Equilibrium]) -> None:
        self._results = results

    def __len__(self) -> int:
        return len(self._results)

    def __getitem__(self, k: Any) -> Any:
        return Batch(self._results[k]) if isinstance(k, slice) else self._results[k]

    def __iter__(self) -> Iterator[Equilibrium]:
        return iter(self._results)

    @property
    def converged(self) -> NDArray[np.bool_]:
        """Whether each row has an equilibrium, ``(k,)``."""
        return np.array([result.converged for result in self._results], dtype=bool)

    @property
    def tip_position(self) -> Array:
        """Tip positions ``(k, 3)``, m, world frame; not a number where a row failed."""
        return self._collected((3,), lambda result: result.tip_position)

    @property
    def tip_pose(self) -> Array:
        """Tip poses ``(k, 4, 4)``; not a number where a row failed."""
        return self._collected((4, 4), lambda result: result.tip_pose)

    @property
    def discretization_error(self) -> Array:
        """Estimated position errors ``(k,)``, m."""
        return self._collected((), lambda result: result.discretization_error)

    def _collected(self, shape: tuple[int, ...], of: Any) -> Array:
        values = np.full((len(self), *shape), np.nan)
        for k, result in enumerate(self._results):
            if result.converged:
                values[k] = of(result)
        return values

    def __repr__(self) -> str:
        return f"<Batch of {len(self)} equilibria, {int((~self.converged).sum())} failed>"


def rows_of_actuations(actuations: Any, tubes: int) -> tuple[Array, list[Actuation] | None]:
    """Rotations beside translations ``(k, 2 tubes)``, checked; the objects, if such were given."""
    if isinstance(actuations, tuple) and len(actuations) == 2 and not isinstance(actuations[0], Actuation):
        rotations = array(actuations[0], "rotations", (None, tubes), unit="rad")
        translations = array(actuations[1], "translations", (None, tubes), unit="m")
        if len(rotations) != len(translations):
            raise DefinitionError(f"rotations has {len(rotations)} rows and translations {len(translations)}")
        above = np.argwhere(translations > 0.0)
        if len(above):
            k, i = (int(each) for each in above[0])
            raise DefinitionError(
                f"translations[{k}, {i}] = {translations[k, i]:g} m puts the base of tube {i} in front of the entry "
                "point: it must be at most 0"
            )
        return np.hstack((rotations, translations)), None
    given = list(actuations)
    for k, actuation in enumerate(given):
        if not isinstance(actuation, Actuation) or len(actuation.rotations) != tubes:
            raise DefinitionError(f"actuations[{k}] = {actuation!r} must be an Actuation of {tubes} tubes")
    rows = np.array([np.concatenate((a.rotations, a.translations)) for a in given]).reshape(len(given), 2 * tubes)
    return rows, given


def rows_of_loads(loads: Any, count: int) -> list[tuple[Load, ...]]:
    """The loads of every row: the same for all, or a list for each."""
    given = list(loads)
    if all(isinstance(load, LOADS) for load in given):
        return [tuple(given)] * count
    if len(given) != count:
        raise DefinitionError(
            f"loads has {len(given)} entries, but there are {count} actuations: give one list of loads for all, "
            "or one for each"
        )
    for k, each in enumerate(given):
        if isinstance(each, LOADS):
            raise DefinitionError(f"loads[{k}] must be a list of loads, as others are")
    return [tuple(each) for each in given]
