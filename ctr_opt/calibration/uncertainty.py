"""How well data determine parameters: information, covariance and undetermined directions.

All quantities are in the unknowns' scales. An eigenvalue of the information matrix is then the inverse squared standard
deviation of a combination of parameters, relative to its size.
"""

from __future__ import annotations

from collections.abc import Sequence

import attrs
import numpy as np

from ..checks import Array
from ..estimation.linearized import Linearized
from ..estimation.places import across
from ..robot.names import symbol
from .estimation import Estimation

VAGUE = 1.0  # scaled standard deviation from which a number is known only vaguely: its error exceeds its size
OPEN = 3.0
"""Scaled standard deviation from which a direction is undetermined. This is half a turn of an angle; not even the order
of magnitude of a stiffness is known. Entirely undetermined directions reach infinity, or tens by rounding errors."""
_BLIND = 1e-11  # of the largest eigenvalue: smaller eigenvalues are rounding errors
TAKES_PART = 0.05  # share in an undetermined direction from which a parameter is undetermined itself
_EQUAL = 0.02  # relative difference allowed between the parts of a common factor


@attrs.frozen(eq=False)
class Direction:
    """A combination of parameters that the data do not determine.

    Attributes
    ----------
    parts
        Change of each parameter along the direction, SI, by label. For a common factor all relative changes are equal.
    standard_deviation
        Standard deviation along the direction, in the parameters' scales: 1 is their full size. Infinite if the data
        contain no information.
    description
        The direction in words.
    """

    parts: dict[str, float]
    standard_deviation: float
    description: str

    def __str__(self) -> str:
        return self.description


@attrs.frozen(eq=False)
class Information:
    """Information of the data at a solution, in scaled unknowns, with estimated places eliminated.

    ``matrix`` is the Gauss-Newton matrix of whitened misfits, ``curvature`` the Hessian of the loss. ``scatter`` is the
    sum of outer products of the blocks' gradients (for the sandwich), ``prior`` the priors' inverse variances.
    """

    matrix: Array
    curvature: Array
    scatter: Array
    prior: Array
    each: list[Array]
    gradients: list[Array]


def information(estimation: Estimation, linearized: Sequence[Linearized]) -> Information:
    """The information from a linearization of all experiments."""
    scale = estimation.unknowns.scale
    matrix, scatter = np.zeros((2, len(scale), len(scale)))
    curvatures, gradients = [], []
    for layout, here in zip(estimation.layouts, linearized, strict=True):
        slopes = np.zeros((len(here.misfit), len(scale)))
        slopes[:, layout.acting] = here.reduced * scale[layout.acting]
        along = layout.blocks.along(here.misfit_s, here.places)
        _, pulls, curvature = layout.blocks.expanded(here.misfit, slopes, along, positive=False)
        slopes = across(slopes, along)
        matrix += slopes.T @ slopes
        scatter += pulls.T @ pulls
        curvatures.append(curvature)
        gradients.append(pulls.sum(axis=0))
    prior = np.diag((scale / estimation.unknowns.prior[1]) ** 2)
    return Information(matrix, np.sum(curvatures, axis=0), scatter, prior, curvatures, gradients)


@attrs.frozen(eq=False)
class Determined:
    """Determined and undetermined subspaces of an information matrix, with its eigenvalues, scaled."""

    eigenvalues: Array
    known: Array
    unknown: Array
    deviations: Array

    @property
    def condition(self) -> float:
        """Condition number: largest over smallest eigenvalue."""
        least = self.eigenvalues[0]
        return float(self.eigenvalues[-1] / least) if least > 0.0 else np.inf


def determined(matrix: Array) -> Determined:
    """Split the parameter space into its determined and undetermined subspaces."""
    values, vectors = np.linalg.eigh(0.5 * (matrix + matrix.T))
    blind = values <= _BLIND * max(values[-1], 0.0)
    deviations = np.where(blind, np.inf, 1.0 / np.sqrt(np.where(blind, 1.0, values)))
    unknown = deviations > OPEN
    return Determined(values, vectors[:, ~unknown], vectors[:, unknown], deviations[unknown])


def covariance(matrix: Array, known: Array, middle: Array | None = None) -> Array:
    """Inverse information on the determined subspace; with ``middle``, the sandwich ``M^-1 middle M^-1``."""
    if known.shape[1] == 0:
        return np.zeros_like(matrix)
    inner = np.linalg.inv(known.T @ matrix @ known)
    if middle is not None:
        inner = inner @ (known.T @ middle @ known) @ inner
    return np.asarray(known @ inner @ known.T)


def taking_part(of: Determined) -> Array:
    """Boolean array of the parameters that take part in an undetermined direction."""
    if of.unknown.shape[1] == 0:
        return np.zeros(len(of.eigenvalues), dtype=bool)
    return np.asarray(np.sqrt((of.unknown**2).sum(axis=1)) > TAKES_PART)


def directions(of: Determined, labels: Sequence[str], x: Array, scale: Array) -> list[Direction]:
    """Undetermined directions, each with as few parameters as possible, and their descriptions."""
    described = []
    for row in _sparse(of.unknown):
        vector = row / row[np.abs(row).argmax()]
        moving = np.flatnonzero(np.abs(vector) > TAKES_PART)
        unit = vector / np.linalg.norm(vector)
        known = np.isfinite(of.deviations).all()
        spread = np.sqrt(np.sum((of.deviations * (of.unknown.T @ unit)) ** 2)) if known else np.inf
        relative = vector[moving] * scale[moving] / np.where(x[moving] == 0.0, np.inf, x[moving])
        names = [labels[int(k)] for k in moving]
        parts = dict(zip(names, vector[moving] * scale[moving], strict=True))
        described.append(Direction(parts, float(spread), _described(names, vector[moving], relative)))
    return described


def _sparse(basis: Array) -> list[Array]:
    """A sparse basis of the same space: echelon form with the largest entries as pivots."""
    rows = basis.T.copy()
    done = 0
    while done < len(rows):
        pivot = int(np.abs(rows[done:]).max(axis=0).argmax())
        best = done + int(np.abs(rows[done:, pivot]).argmax())
        rows[[done, best]] = rows[[best, done]]
        rows[done] /= rows[done, pivot]
        for k in range(len(rows)):
            if k != done:
                rows[k] -= rows[k, pivot] * rows[done]
        done += 1
    return list(rows)


def _described(names: list[str], moves: Array, relative: Array) -> str:
    if len(names) == 1:
        return f"{symbol(names[0])} is not determined"
    if is_factor(names, relative):
        return " : ".join(map(symbol, names)) + " may be scaled together"
    return f"{combination(list(map(symbol, names)), moves)} may change together"


def combination(names: Sequence[str], moves: Array) -> str:
    """Text of a linear combination: ``a - 0.5 b``."""
    pairs = zip(names, moves, strict=True)
    terms = " ".join(f"{'-' if move < 0.0 else '+'} {abs(move):.2g} {name}" for name, move in pairs)
    return terms.removeprefix("+ ")


def is_factor(names: Sequence[str], relative: Array) -> bool:
    """Whether a direction is a common factor of stiffnesses."""
    stiff = all(symbol(name) != name for name in names)
    return bool(stiff and np.ptp(relative) <= _EQUAL * np.abs(relative).max())
