"""Is a shape stable? The second variation of the potential energy at its states, in numbers."""

from __future__ import annotations

import attrs
import numpy as np
from numpy.typing import NDArray

from ..checks import Array
from .nlp import padded
from .second_variation import second_variation_functions
from .shooting import Shooting

MARGIN = 1e-7
"""The least margin; coarse steps need a wider one: what their linear maps lack to be symplectic is an error."""

_CUTS = 12  # times a step is cut in two before nothing is said ...
_PRECISION = 1e-3  # of the smallest eigenvalue
_MOST_STEPS = 3000  # ... or as soon as there are more


@attrs.frozen
class SecondVariation:
    """How many directions lower the energy, and whether all others raise it (it is ``positive``).

    ``margin``: an eigenvalue of (second variation, elastic part) nearer to zero is not told from zero.
    """

    negative: int
    positive: bool
    margin: float


def second_variation(shooting: Shooting, states: Array) -> SecondVariation | None:
    """The second variation at dimensionless states ``(size, k)`` where the steps of a problem begin.

    Loads must have a potential. None where steps cut ever shorter still may hide something.
    """
    for _ in range(_CUTS):
        found, doubtful = count(shooting, states)
        if not doubtful.any():
            return found
        if len(states.T) + doubtful.sum() > _MOST_STEPS:
            break
        shooting, states = _halved(shooting, states, doubtful)
    return None


def smallest_eigenvalue(shooting: Shooting, states: Array) -> float:
    """Of (second variation, elastic part), from 0 to 1, at states where the second variation is positive.

    By bisection of the margin at which it still is, to ``_PRECISION``; steps are cut in four, as what is taken off
    their elastic parts is put between them.
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
    filled = np.pad(states, ((0, 0), (0, size - steps)), mode="edge")
    found = functions.count(size)(filled, layout.pad(shooting.columns, size), compliance, least)
    negative, not_positive, margin = (float(found[k]) for k in (0, 1, 3))
    doubtful = found[2].full()[0, :steps] != 0.0
    return SecondVariation(int(negative), not_positive == 0.0, margin), doubtful


def _halved(shooting: Shooting, states: Array, which: NDArray[np.bool_]) -> tuple[Shooting, Array]:
    """The problem with some steps cut in two, and the states at its nodes."""
    parts = np.where(which, 2, 1)
    finer = shooting.refined(parts)
    starts = np.cumsum(parts) - parts
    inner = np.empty((len(states), parts.sum()))
    inner[:, starts] = states
    first = starts[which]
    inner[:, first + 1], _ = finer.functions.many("step", states[:, which], finer.columns[:, first])
    return finer, inner
