"""Stability of a shape: the second variation of the potential energy at its states, in numbers."""

from __future__ import annotations

import attrs
import numpy as np
from numpy.typing import NDArray

from ..checks import Array
from .nlp import padded
from .second_variation import second_variation_functions
from .shooting import Shooting, extended

MARGIN = 1e-7
"""The least margin; coarse steps need a wider one, as their linear maps are only approximately symplectic."""

_CUTS = 12  # times that a step is cut in two before giving up ...
_PRECISION = 1e-3  # of the smallest eigenvalue
_MOST_STEPS = 3000  # ... or as soon as there are more


@attrs.frozen
class SecondVariation:
    """The number of directions that lower the energy, and whether all directions raise it (``positive``).

    Eigenvalues of (second variation, elastic part) within ``margin`` of zero are not distinguished from zero.
    """

    negative: int
    positive: bool
    margin: float


def second_variation(shooting: Shooting, states: Array) -> SecondVariation | None:
    """The second variation at dimensionless states ``(size, k)`` where the steps of a problem begin.

    Loads must have a potential. None if even very short steps may hide a negative direction.
    """
    for _ in range(_CUTS):
        variation, doubtful = count(shooting, states)
        if not doubtful.any():
            return variation
        if len(states.T) + doubtful.sum() > _MOST_STEPS:
            break
        shooting, states = _halved(shooting, states, doubtful)
    return None


def smallest_eigenvalue(shooting: Shooting, states: Array) -> float:
    """Smallest eigenvalue of (second variation, elastic part), 0 to 1, of a positive second variation.

    It is found by bisection of the margin, to ``_PRECISION``. Steps are cut in four, as the compliance taken from their
    elastic parts is put between them.
    """
    for _ in range(2):
        shooting, states = _halved(shooting, states, np.ones(len(shooting.mesh), dtype=bool))
    low, high = 0.0, 1.0
    while high - low > _PRECISION:
        middle = 0.5 * (low + high)  # the elastic part divided by 1 + s lacks s / (1 + s) of it
        if count(shooting, states, middle / (1.0 - middle))[0].positive:
            low = middle
        else:
            high = middle
    return 0.5 * (low + high)


def count(shooting: Shooting, states: Array, least: float = MARGIN) -> tuple[SecondVariation, NDArray[np.bool_]]:
    """The second variation with a margin of at least ``least``, and which steps leave it in doubt."""
    layout, steps = shooting.functions.columns, len(shooting.mesh)
    functions = second_variation_functions(layout.tubes, shooting.integrator, shooting.kind)
    size = padded(steps)
    compliance = shooting.entry[shooting.functions.entry.parts["compliance"]]
    filled = extended(states, size)
    results = functions.count(size)(filled, layout.pad(shooting.columns, size), compliance, least)
    negative, not_positive, margin = (float(results[k]) for k in (0, 1, 3))
    doubtful = results[2].full()[0, :steps] != 0.0
    return SecondVariation(int(negative), not_positive == 0.0, margin), doubtful


def _halved(shooting: Shooting, states: Array, which: NDArray[np.bool_]) -> tuple[Shooting, Array]:
    """Cut some steps in two; returns the problem and the states at its nodes."""
    parts = np.where(which, 2, 1)
    finer = shooting.refined(parts)
    starts = np.cumsum(parts) - parts
    inner = np.empty((len(states), parts.sum()))
    inner[:, starts] = states
    first = starts[which]
    inner[:, first + 1], _ = finer.functions.many("step", states[:, which], finer.columns[:, first])
    return finer, inner
