"""How well data determine parameters: information, covariance, and the directions about which they say nothing.

Everything is counted in the unknowns' scales, so that an eigenvalue of the information matrix tells by how much of its
size a combination of parameters is known.
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

VAGUE = 1.0  # scaled standard deviation from which a number counts as known vaguely: to no better than its size
OPEN = 3.0
"""Scaled standard deviation from which a direction counts as undetermined: half a turn of an angle, and of a stiffness
not even the order of magnitude. What data do not determine at all comes to infinity, or to tens by rounding errors."""
_BLIND = 1e-11  # of the largest eigenvalue: rounding errors alone leave more
TAKES_PART = 0.05  # the share of a parameter in an undetermined direction from which it is undetermined itself
_EQUAL = 0.02  # relative: by so much the parts of a common factor may differ


@attrs.frozen(eq=False)
class Direction:
    """A combination of parameters that the data do not determine.

    Attributes
    ----------
    parts
        The parameters that take part, by their labels, and how far each moves, in its own unit; of a common factor all
        by the same share.
    standard_deviation
        Along it, in the parameters' scales: 1 stands for their whole size. Infinite where nothing is known.
    description
        In words.
    """

    parts: dict[str, float]
    standard_deviation: float
    description: str

    def __str__(self) -> str:
        return self.description


@attrs.frozen(eq=False)
class Information:
    """Sums over the data at a solution, in scaled unknowns; places that are estimated follow at their best.

    ``matrix``: of Gauss and Newton for whitened misfits; ``curvature``: the loss's Hessian, outer product of the
    blocks' gradients in ``scatter`` (for the sandwich); ``prior``: the priors' inverse variances.
    """

    matrix: Array
    curvature: Array
    scatter: Array
    prior: Array
    each: list[Array]
    gradients: list[Array]


def information(estimation: Estimation, linearized: Sequence[Linearized]) -> Information:
    """The sums at some linearization."""
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
    """What a matrix of information determines: eigenvalues, and the basis of what it does not, scaled."""

    eigenvalues: Array
    known: Array
    unknown: Array
    deviations: Array

    @property
    def condition(self) -> float:
        """Largest over smallest eigenvalue."""
        least = self.eigenvalues[0]
        return float(self.eigenvalues[-1] / least) if least > 0.0 else np.inf


def determined(matrix: Array) -> Determined:
    """Split the space of the parameters into what is known and what is not."""
    values, vectors = np.linalg.eigh(0.5 * (matrix + matrix.T))
    blind = values <= _BLIND * max(values[-1], 0.0)
    deviations = np.where(blind, np.inf, 1.0 / np.sqrt(np.where(blind, 1.0, values)))
    unknown = deviations > OPEN
    return Determined(values, vectors[:, ~unknown], vectors[:, unknown], deviations[unknown])


def covariance(matrix: Array, known: Array, middle: Array | None = None) -> Array:
    """Inverse of the information on what is known; with ``middle``, the sandwich ``M^-1 middle M^-1``."""
    if known.shape[1] == 0:
        return np.zeros_like(matrix)
    inner = np.linalg.inv(known.T @ matrix @ known)
    if middle is not None:
        inner = inner @ (known.T @ middle @ known) @ inner
    return np.asarray(known @ inner @ known.T)


def taking_part(of: Determined) -> Array:
    """Which parameters take part in what is not determined, as booleans."""
    if of.unknown.shape[1] == 0:
        return np.zeros(len(of.eigenvalues), dtype=bool)
    return np.asarray(np.sqrt((of.unknown**2).sum(axis=1)) > TAKES_PART)


def directions(of: Determined, labels: Sequence[str], x: Array, scale: Array) -> list[Direction]:
    """The undetermined directions, each with as few parameters as possible, in words."""
    described = []
    for row in _sparse(of.unknown):
        vector = row / row[np.abs(row).argmax()]
        those = np.flatnonzero(np.abs(vector) > TAKES_PART)
        unit = vector / np.linalg.norm(vector)
        known = np.isfinite(of.deviations).all()
        spread = np.sqrt(np.sum((of.deviations * (of.unknown.T @ unit)) ** 2)) if known else np.inf
        relative = vector[those] * scale[those] / np.where(x[those] == 0.0, np.inf, x[those])
        names = [labels[int(k)] for k in those]
        parts = dict(zip(names, vector[those] * scale[those], strict=True))
        described.append(Direction(parts, float(spread), _described(names, vector[those], relative)))
    return described


def _sparse(basis: Array) -> list[Array]:
    """Vectors of the same space with many zeros: reduced to echelon form, pivots where the space is largest."""
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
    """A linear combination in words: ``a - 0.5 b``."""
    pairs = zip(names, moves, strict=True)
    terms = " ".join(f"{'-' if move < 0.0 else '+'} {abs(move):.2g} {name}" for name, move in pairs)
    return terms.removeprefix("+ ")


def is_factor(names: Sequence[str], relative: Array) -> bool:
    """Whether a direction multiplies stiffnesses by a common factor."""
    stiff = all(symbol(name) != name for name in names)
    return bool(stiff and np.ptp(relative) <= _EQUAL * np.abs(relative).max())
