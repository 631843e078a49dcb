"""Systematic errors of the model, to first order: the forces that they mimic, and the sizes that are detected.

The loads absorb a systematic error of the shape as far as they can; the rest appears in the residuals.
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
from .search import BLIND, Search, SearchState

CONSISTENT = 0.05  # p-value below which residuals are not consistent with model and noise
DETECTED = 0.95  # probability of detection at the reported size of a systematic error
_ABSORBED = 1e-14  # of the squared effect on the measurements: less is left if the loads absorb the error
_IDLE = 1e-2  # standard deviations: an error of size 1 with a smaller effect on the measurements is ignored
_TELLING = 1.0  # m, rad, or relative: first order does not hold for larger errors
_SHOWN = {"m": (1e3, "mm"), "rad": (np.degrees(1.0), "deg"), "1": (1e2, "%")}


@attrs.frozen(eq=False)
class Imperfection:
    """A model error of unit size that all measurements of a shape share.

    Attributes
    ----------
    kind
        ``"shift"`` and ``"tilt"`` of the base, ``"curvature"`` or ``"stiffness"`` of a tube.
    description
        The error in words.
    unit
        Unit of the size: ``"m"``, ``"rad"``, or ``"1"``, relative.
    changes
        Changes of the robot's parameters, by name, for an error of size 1.
    """

    kind: str
    description: str
    unit: str
    changes: Mapping[str, Array]


@attrs.frozen(eq=False)
class Systematic(Imperfection):
    """An :class:`Imperfection` with its detectable size and the force that it mimics, to first order.

    Attributes
    ----------
    degrees_of_freedom
        Degrees of freedom of the residuals.
    noncentrality
        Increase of the expected sum of squared residuals by an error of size 1; zero if the loads absorb it.
    rates
        Changes of the estimates by an error of size 1, SI.
    force_rate
        Change of the force ``(3,)``, or of several forces ``(k, 3)``, by an error of size 1, N over the unit. For a
        distributed force this is the total.
    """

    degrees_of_freedom: int
    noncentrality: float
    rates: Array
    force_rate: Array

    @property
    def size(self) -> float:
        """The smallest error that is detected with 95 % probability; infinite if none is."""
        return self.size_at(DETECTED)

    @property
    def force(self) -> Array:
        """The force, N, that an error of :attr:`size` adds to the estimate; the opposite error adds the opposite."""
        return np.multiply(self.size, self.force_rate, where=self.force_rate != 0.0, out=np.zeros_like(self.force_rate))

    @property
    def mimicked(self) -> float:
        """The length of :attr:`force`, N."""
        return float(np.linalg.norm(self.force))

    @property
    def _threshold(self) -> Any:
        """The largest consistent sum of squared residuals."""
        return quantile(1.0 - CONSISTENT, self.degrees_of_freedom)

    def power(self, size: float) -> float:
        """Probability that an error of this size makes the residuals inconsistent (at 5 %)."""
        from scipy.stats import ncx2

        if not self.degrees_of_freedom:
            return 0.0
        return float(ncx2.sf(self._threshold, self.degrees_of_freedom, self.noncentrality * size**2))

    def size_at(self, power: float) -> float:
        """The size that is detected with probability ``power``, from 0.05 (false alarms) to 0.999."""
        from scipy.special import chndtrinc

        power = number(power, "power", least=CONSISTENT, most=0.999)
        if not self.degrees_of_freedom or not self.noncentrality:
            return np.inf
        return float(np.sqrt(chndtrinc(self._threshold, self.degrees_of_freedom, 1.0 - power) / self.noncentrality))

    def __str__(self) -> str:
        factor, unit = _SHOWN[self.unit]
        if not self.noncentrality and not self.force_rate.any():
            return f"{self.description}: has no effect on the measurements"
        if self.size <= _TELLING:
            detected = f"detected from {factor * self.size:.2g} {unit}, which adds {self.mimicked:.2g} N"
            return f"{self.description}: {detected}"
        when = "hardly ever detected" if np.isfinite(self.size) else "never detected, as the loads absorb it"
        return f"{self.description}: {when}; adds {np.linalg.norm(self.force_rate) / factor:.2g} N per {unit}"


def systematic_errors(case: Case, state: SearchState, freedom: int, steps: Callable[[], int]) -> list[Systematic]:
    """Systematic errors at a solution with ``freedom`` degrees of freedom; ``steps`` as for ``loaded_model``.

    The list holds shifts along and tilts about the axes, then curvatures and stiffnesses of the tubes. For all shifts
    and all tilts it also holds the one hardest to detect, and the one with most added force when just detected.
    """
    errors = _errors(case.robot)
    effects = _effects(case, state, errors, steps)
    effects[:, np.linalg.norm(effects, axis=0) < _IDLE] = 0.0
    rates, left = _absorbed(case.search, state, effects, case.ways(state))
    resultants = case.numbered.resultants
    weights = list(np.eye(len(errors)))
    for axes in (slice(0, 3), slice(3, 6)):  # shifts and tilts
        first, forces = errors[axes.start], np.vstack([rows @ rates[:, axes] for rows in resultants])
        for which, direction in _worst(left[:, axes], forces).items():
            changes = dict.fromkeys(first.changes, direction)
            errors.append(Imperfection(first.kind, f"{first.kind} of the base, {which}", first.unit, changes))
            weights.append(direction @ weights[axes])
    return [
        _systematic(error, freedom, effects @ weight, rates @ weight, left @ weight, resultants)
        for error, weight in zip(errors, weights, strict=True)
    ]


def _systematic(
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
    """Unit directions with the least residual, and with the most added force for a given residual."""
    _, kept, ways = np.linalg.svd(left, full_matrices=False)
    worst = {"hardest to detect": ways[-1]}
    if kept[-1] ** 2 > _ABSORBED * kept[0] ** 2:
        most = (ways.T / kept) @ np.linalg.svd(forces @ (ways.T / kept))[2][0]
        worst["most like a force"] = most / np.linalg.norm(most)
    return worst


def _errors(robot: Robot) -> list[Imperfection]:
    """Unit errors: shifts along and tilts about the axes, curvatures and stiffnesses of the tubes."""
    errors = []
    for kind, unit, name, way in (("shift", "m", "translation", "along"), ("tilt", "rad", "rotation", "about")):
        for axis, direction in zip("xyz", np.eye(3), strict=True):
            errors.append(Imperfection(kind, f"{kind} of the base {way} {axis}", unit, {f"base.{name}": direction}))
    for i, tube in enumerate(robot.tubes):
        if curved := _precurvature(f"tubes[{i}]", tube):
            errors.append(Imperfection("curvature", f"curvature of tube {tube.name!r}", "1", curved))
    for i, tube in enumerate(robot.tubes):
        both = {f"tubes[{i}].{field}": np.array(getattr(tube, field)) for field in Stiffness.names()}
        errors.append(Imperfection("stiffness", f"stiffness of tube {tube.name!r}", "1", both))
    return errors


def _precurvature(name: str, tube: Tube) -> dict[str, Array]:
    """Numbers of a tube's curved pieces, by parameter name."""
    return {
        f"{name}.precurvature[{k}].{piece.rows}": np.array(getattr(piece, piece.rows))
        for k, piece in enumerate(tube.precurvature)
        if piece.rows and np.any(getattr(piece, piece.rows))
    }


def _effects(case: Case, state: SearchState, errors: list[Imperfection], steps: Callable[[], int]) -> Array:
    """Changes of whitened predictions by the errors, with the robot in equilibrium: ``(measured, errors)``."""
    names = list(dict.fromkeys(name for error in errors for name in error.changes))
    actuation, loads = case.experiment.actuation, case.loads_at(state.x)
    nothing = {name: np.zeros(one.value.shape) for name, one in parameters(case.robot, actuation, loads).items()}
    changes = np.array(
        [np.concatenate([np.ravel(error.changes.get(name, nothing[name])) for name in names]) for error in errors]
    ).T
    observables = case.experiment.observables
    model = loaded_model(case.robot, actuation, loads, (), names, observables, case.compiled, steps)
    return case.search.linearized(model, state.z, np.zeros(0), changes, state.places).reduced


def _absorbed(search: Search, state: SearchState, effects: Array, moving: Array) -> tuple[Array, Array]:
    """Changes of the estimates ``(numbers, errors)``, and of residuals and priors ``(rows, errors)``, by the errors.

    ``moving`` are the free directions of the estimates, in their scales.
    """
    from scipy.linalg import block_diag

    unknowns, k = search.unknowns, len(state.x) + search.errors
    weights = np.sqrt(state.weights)[:, None]
    ways = free(state.places, search.blocks.orders)
    whitened = across(weights * np.hstack((state.slopes, effects)), weights * (state.along @ ways))
    values, vectors = np.linalg.eigh(unknowns.prior_information)
    known = np.sqrt(np.maximum(values, 0.0))[:, None] * vectors.T
    scale = block_diag(unknowns.scale[:, None] * moving, np.eye(search.errors))
    rows = np.vstack((whitened[:, :k], block_diag(known, np.eye(search.errors)))) @ scale
    seen = np.pad(whitened[:, k:], ((0, k), (0, 0)))
    basis, stretches, turned = np.linalg.svd(rows, full_matrices=False)
    seen_along = stretches > 1.0 / BLIND
    parts = basis[:, seen_along].T @ seen
    moves = scale @ (turned[seen_along].T @ (parts / stretches[seen_along, None]))
    return moves[: len(state.x)], seen - basis[:, seen_along] @ parts
