"""What errors of the model do to estimated loads, to first order: which forces they mimic, and when they are seen.

The loads explain a systematic error of the shape as far as they can; what is left is seen in the residuals.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import attrs
import numpy as np

from ..checks import Array, number
from ..estimation.chi_square import quantile
from ..estimation.places import across, free
from ..mechanics.law import Stiffness
from ..robot.names import parameters
from ..robot.robot import Robot
from ..robot.tube import Tube
from .case import Case
from .model import loaded_model
from .search import BLIND, Search, State

CONSISTENT = 0.05  # probability of residuals so large, below which they are not consistent with model and noise
DETECTED = 0.95  # probability with which a systematic error that is told would be detected
_ABSORBED = 1e-14  # of the squared effect on what is measured: so little is left of what the loads explain entirely
_IDLE = 1e-2  # standard deviations of all that is measured: an error of size 1 that does no more does nothing
_TELLING = 1.0  # m, rad, or relative: first order says nothing of larger errors
_SHOWN = {"m": (1e3, "mm"), "rad": (np.degrees(1.0), "deg"), "1": (1e2, "%")}


@attrs.frozen(eq=False)
class Imperfection:
    """An error of the model that all measurements of a shape share, to be multiplied by a size.

    Attributes
    ----------
    kind
        ``"shift"`` and ``"tilt"`` of the base, ``"curvature"`` or ``"stiffness"`` of a tube.
    description
        Which one, in words.
    unit
        Of its size: ``"m"``, ``"rad"``, or ``"1"``, relative.
    changes
        By what an error of size 1 changes the robot's parameters, by their names.
    """

    kind: str
    description: str
    unit: str
    changes: Mapping[str, Array]


@attrs.frozen(eq=False)
class Systematic(Imperfection):
    """An :class:`Imperfection`: when it would be noticed, and for which force it is mistaken, to first order.

    Attributes
    ----------
    degrees_of_freedom
        Of the residuals.
    noncentrality
        What an error of size 1 adds to the expected sum of the residuals' squares; zero where the loads absorb it.
    rates
        By what an error of size 1 changes the estimates, SI.
    force_rate
        The same of the force ``(3,)``, or of several forces ``(k, 3)``, N over the unit; of distributed ones the total.
    """

    degrees_of_freedom: int
    noncentrality: float
    rates: Array
    force_rate: Array

    @property
    def size(self) -> float:
        """The smallest error that the residuals would show with 95 %; infinite where they never would."""
        return self.size_at(DETECTED)

    @property
    def force(self) -> Array:
        """The force, N, that an error of this size adds to the estimate; of the opposite error the opposite one."""
        return np.multiply(self.size, self.force_rate, where=self.force_rate != 0.0, out=np.zeros_like(self.force_rate))

    @property
    def mimicked(self) -> float:
        """The length of :attr:`force`, N."""
        return float(np.linalg.norm(self.force))

    @property
    def _threshold(self) -> Any:
        """What consistent residuals' squares stay below."""
        return quantile(1.0 - CONSISTENT, self.degrees_of_freedom)

    def power(self, size: float) -> float:
        """The probability that residuals with an error of this size are not consistent (at 5 %)."""
        from scipy.stats import ncx2

        if not self.degrees_of_freedom:
            return 0.0
        return float(ncx2.sf(self._threshold, self.degrees_of_freedom, self.noncentrality * size**2))

    def size_at(self, power: float) -> float:
        """The size from which an error is detected with this probability, from 0.05, of false alarms, to 0.999."""
        from scipy.special import chndtrinc

        power = number(power, "power", least=CONSISTENT, most=0.999)
        if not self.degrees_of_freedom or not self.noncentrality:
            return np.inf
        return float(np.sqrt(chndtrinc(self._threshold, self.degrees_of_freedom, 1.0 - power) / self.noncentrality))

    def __str__(self) -> str:
        factor, unit = _SHOWN[self.unit]
        if not self.noncentrality and not self.force_rate.any():
            return f"{self.description}: does not act on what was measured"
        if self.size <= _TELLING:
            told = f"detected from {factor * self.size:.2g} {unit}, which adds {self.mimicked:.2g} N"
            return f"{self.description}: {told}"
        when = "hardly ever detected" if np.isfinite(self.size) else "never detected, as the loads absorb it"
        return f"{self.description}: {when}; adds {np.linalg.norm(self.force_rate) / factor:.2g} N per {unit}"


def systematic_errors(case: Case, state: State, freedom: int, steps: Callable[[], int]) -> list[Systematic]:
    """Of each kind, at a solution with so many degrees of freedom; ``steps`` as for ``loaded_model``.

    Shifts along and tilts about the axes, curvatures and stiffnesses of the tubes; then, of all shifts and of all
    tilts, the one that is hardest to detect, and the one that adds most force when it just is detected.
    """
    errors = _errors(case.robot)
    effects = _effects(case, state, errors, steps)
    effects[:, np.linalg.norm(effects, axis=0) < _IDLE] = 0.0
    rates, left = _absorbed(case.search, state, effects, case.ways(state))
    resultants = case.numbered.resultants
    weights = list(np.eye(len(errors)))
    for own in (slice(0, 3), slice(3, 6)):  # the axes of shifts and of tilts
        first, forces = errors[own.start], np.vstack([rows @ rates[:, own] for rows in resultants])
        for which, direction in _worst(left[:, own], forces).items():
            changes = dict.fromkeys(first.changes, direction)
            errors.append(Imperfection(first.kind, f"{first.kind} of the base, {which}", first.unit, changes))
            weights.append(direction @ weights[own])
    return [
        _told(error, freedom, effects @ own, rates @ own, left @ own, resultants)
        for error, own in zip(errors, weights, strict=True)
    ]


def _told(
    error: Imperfection, freedom: int, effect: Array, moves: Array, left: Array, resultants: Sequence[Array]
) -> Systematic:
    kept = float(left @ left)
    forces = np.array([rows @ moves for rows in resultants])
    return Systematic(
        **attrs.asdict(error, recurse=False),
        degrees_of_freedom=freedom,
        noncentrality=kept if kept > _ABSORBED * float(effect @ effect) else 0.0,
        rates=moves,
        force_rate=forces if len(resultants) > 1 else forces[0],
    )


def _worst(left: Array, forces: Array) -> dict[str, Array]:
    """Unit vectors along which least is left in the residuals, and along which most force is added for what is left."""
    _, kept, ways = np.linalg.svd(left, full_matrices=False)
    found = {"hardest to detect": ways[-1]}
    if kept[-1] ** 2 > _ABSORBED * kept[0] ** 2:
        most = (ways.T / kept) @ np.linalg.svd(forces @ (ways.T / kept))[2][0]
        found["most like a force"] = most / np.linalg.norm(most)
    return found


def _errors(robot: Robot) -> list[Imperfection]:
    """Shifts along and tilts about the axes, curvatures and stiffnesses of the tubes."""
    found = []
    for kind, unit, name, way in (("shift", "m", "translation", "along"), ("tilt", "rad", "rotation", "about")):
        for axis, direction in zip("xyz", np.eye(3), strict=True):
            found.append(Imperfection(kind, f"{kind} of the base {way} {axis}", unit, {f"base.{name}": direction}))
    for i, tube in enumerate(robot.tubes):
        if curved := _precurvature(f"tubes[{i}]", tube):
            found.append(Imperfection("curvature", f"curvature of tube {tube.name!r}", "1", curved))
    for i, tube in enumerate(robot.tubes):
        both = {f"tubes[{i}].{field}": np.array(getattr(tube, field)) for field in Stiffness.names()}
        found.append(Imperfection("stiffness", f"stiffness of tube {tube.name!r}", "1", both))
    return found


def _precurvature(name: str, tube: Tube) -> dict[str, Array]:
    """The numbers of its pieces that are curved."""
    return {
        f"{name}.precurvature[{k}].{piece.rows}": np.array(getattr(piece, piece.rows))
        for k, piece in enumerate(tube.precurvature)
        if piece.rows and np.any(getattr(piece, piece.rows))
    }


def _effects(case: Case, state: State, errors: list[Imperfection], steps: Callable[[], int]) -> Array:
    """How whitened predictions change with the errors, the robot staying in equilibrium: ``(measured, errors)``."""
    names = list(dict.fromkeys(name for each in errors for name in each.changes))
    actuation, loads = case.experiment.actuation, case.loads_at(state.x)
    nothing = {name: np.zeros(each.value.shape) for name, each in parameters(case.robot, actuation, loads).items()}
    changes = np.array(
        [np.concatenate([np.ravel(each.changes.get(name, nothing[name])) for name in names]) for each in errors]
    ).T
    observables = case.experiment.observables
    model = loaded_model(case.robot, actuation, loads, (), names, observables, case.compiled, steps)
    return case.search.linearized(model, state.z, np.zeros(0), changes, state.places).reduced


def _absorbed(search: Search, state: State, effects: Array, moving: Array) -> tuple[Array, Array]:
    """How the estimates follow, ``(numbers, errors)``, and what residuals and priors keep, ``(rows, errors)``.

    ``moving``: directions in which the estimates may, in their scales.
    """
    from scipy.linalg import block_diag

    sought, k = search.sought, len(state.x) + search.errors
    weights = np.sqrt(state.weights)[:, None]
    ways = free(state.places, search.blocks.orders)
    every = across(weights * np.hstack((state.slopes, effects)), weights * (state.along @ ways))
    values, vectors = np.linalg.eigh(sought.prior_information)
    known = np.sqrt(np.maximum(values, 0.0))[:, None] * vectors.T
    scale = block_diag(sought.scale[:, None] * moving, np.eye(search.errors))
    rows = np.vstack((every[:, :k], block_diag(known, np.eye(search.errors)))) @ scale
    seen = np.pad(every[:, k:], ((0, k), (0, 0)))
    basis, stretches, turned = np.linalg.svd(rows, full_matrices=False)
    told = stretches > 1.0 / BLIND
    parts = basis[:, told].T @ seen
    moves = scale @ (turned[told].T @ (parts / stretches[told, None]))
    return moves[: len(state.x)], seen - basis[:, told] @ parts
