"""Search for a shape whose tip is at a target: damped Gauss-Newton steps within the limits, along one branch.

Every step is solved as a neighbour of the shape before it. A step is cut if the branch is in doubt. Break points are
sorted again between steps, as in any solve. Lengths of steps and distances are measured in ``weights * joints``.
"""

from __future__ import annotations

from enum import Enum
from functools import cached_property
from math import sqrt

import attrs
import numpy as np

from ..checks import Array
from ..forward.equilibrium import Equilibrium
from ..forward.problem import ForwardProblem
from ..loads.kind import Load
from ..robot.actuation import actuation_of, joints_of
from .least_distance import bounded_step, least_distance
from .limits import Allowed
from .targets import LENGTH, Target

_MOST_STEPS = 60
_LONGEST, _SHORTEST = 0.7, 1e-4  # of a step, per joint: below the shortest, the branch or the model of the misfit ends
_PART = 0.05  # of a step longer than trusted: it is not cut to less, but solved again within the trusted length
_DAMPING, _LEAST_DAMPING = 1e-2, 1e-8  # initial, relative to the squared misfit (at most one); and least of all
_GOOD, _POOR, _USELESS = 0.75, 0.25, 1e-3  # shares of the promised gain that a step achieves
_AIM, _ENOUGH = 0.5, 0.9  # of the tolerances: aimed at, and accepted; the rest is left to the errors of the solves
_NOTHING = 1e-6  # of the squared misfit: steps that promise less are useless
_SETTLED = 1e-2  # of the distance: a smaller gain is not worth a step
_SETTLING = 8  # largest number of such steps
_SINGULAR = 1e-6  # of the largest singular value


class Ending(Enum):
    """Why a search ended."""

    OPEN = "the search continues"
    REACHED = "the target is reached"
    STUCK = "no motion within the limits brings the tip nearer"
    SNAPS = "the robot would snap, or leave its branch in doubt, on the way nearer"
    SLOW = f"the tip was still moving nearer after {_MOST_STEPS} steps"


@attrs.frozen(eq=False, slots=False)
class Point:
    """A shape on the way to a target, and how the way there ended."""

    equilibrium: Equilibrium
    target: Target
    ending: Ending = Ending.OPEN

    @cached_property
    def joints(self) -> Array:
        """Rotations and translations of the shape, ``(2 tubes,)``."""
        return joints_of(self.equilibrium.actuation)

    @cached_property
    def misfit(self) -> Array:
        """Motion of the tip to the target; see :meth:`Target.misfit`."""
        return self.target.misfit(self.equilibrium)

    @cached_property
    def errors(self) -> tuple[float, float]:
        """Distance, m, and angle, rad, of the tip from the target."""
        missing, turn = self.misfit[:3], self.misfit[3:]
        return LENGTH * sqrt(missing @ missing), sqrt(turn @ turn)

    @cached_property
    def cost(self) -> float:
        """Squared norm of the misfit."""
        return float(self.misfit @ self.misfit)

    @property
    def stable(self) -> bool:
        """Whether the shape is not known to be unstable."""
        return self.equilibrium.is_stable is not False

    @property
    def answers(self) -> bool:
        """Whether the target is reached by a stable shape."""
        return self.ending is Ending.REACHED and self.stable


@attrs.define
class _Trust:
    """Trust in the linear model of the misfit: damping of steps, and the longest step of each joint."""

    damping: float = _DAMPING
    longest: float = _LONGEST

    def learn(self, gained: float, size: float) -> None:
        """Adapt to the share of the promised gain that a step of this size achieved."""
        if gained > _GOOD:
            self.damping, self.longest = 0.3 * self.damping, min(2.0 * self.longest, _LONGEST)
        elif gained < _POOR:
            self.damping, self.longest = 4.0 * self.damping, 0.25 * size


@attrs.frozen(eq=False)
class TipSearch:
    """Search for one target: the problem, its loads, allowed joints, weights, and tolerances of position and angle."""

    forward: ForwardProblem
    loads: tuple[Load, ...]
    allowed: Allowed
    weights: Array
    target: Target
    tolerances: tuple[float, float]

    def met(self, point: Point, part: float) -> bool:
        """Whether a point's errors are within a part of the tolerances."""
        position, angle = point.errors
        return position <= part * self.tolerances[0] and angle <= part * self.tolerances[1]

    def moved(self, point: Point, step: Array) -> Point | None:
        """Take a weighted step from a point; None if the result is not on the same branch."""
        joints = self.allowed.kept(point.joints + step / self.weights)
        shape = self._solved(joints, point.equilibrium)
        return None if shape is None else Point(shape, self.target)

    def reach(self, point: Point) -> Point:
        """Move from a point to the target, or as near as possible."""
        trust, ending = _Trust(), Ending.SLOW
        for _ in range(_MOST_STEPS):
            if self.met(point, _AIM):
                break
            step, promised = self._toward(point, trust)
            if promised <= _NOTHING * point.cost:
                ending = Ending.STUCK
                break
            trial = self.moved(point, step)
            gained = -np.inf if trial is None else (point.cost - trial.cost) / promised
            trust.learn(gained, float(np.abs(step).max()))
            if trial is not None and gained > _USELESS:
                point = trial
            elif trust.longest < _SHORTEST:
                ending = Ending.SNAPS if trial is None else Ending.STUCK
                break
        return attrs.evolve(point, ending=Ending.REACHED if self.met(point, _ENOUGH) else ending)

    def _toward(self, point: Point, trust: _Trust) -> tuple[Array, float]:
        """Step toward the target within limits and trust, and the decrease of the cost that it promises."""
        rates, misfit = self._rates(point), point.misfit
        damping = max(trust.damping * min(point.cost, 1.0), _LEAST_DAMPING)
        hessian = rates.T @ rates + damping * np.eye(len(self.weights))
        rows, room = self._room(point)
        step = bounded_step(hessian, -rates.T @ misfit, rows, room)
        part = trust.longest / max(float(np.abs(step).max()), trust.longest)
        if part >= _PART:
            step *= part
        else:  # one motion hardly moves the tip: a cut of the whole step would leave nothing of the other motions
            box = np.eye(len(self.weights))
            room = np.concatenate((room, np.full(2 * len(box), trust.longest)))
            step = bounded_step(hessian, -rates.T @ misfit, np.vstack((rows, box, -box)), room)
        return step, point.cost - float(((misfit - rates @ step) ** 2).sum())

    def limits_at(self, point: Point) -> str:
        """Name the limits at which a point is, as the end of a message."""
        met = self.allowed.active(point.joints)
        return f"; at its limits: {', '.join(met)}" if met else ""

    def distance(self, point: Point, joints: Array) -> float:
        """Weighted distance between a point's joints and ``joints``."""
        return float(np.linalg.norm(self.weights * (joints - point.joints)))

    def settle(self, point: Point, joints: Array) -> Point:
        """Move toward ``joints`` while the tip stays at the target, as far as steps lead."""
        longest = _LONGEST
        for _ in range(_SETTLING):
            wanted = self.weights * (joints - point.joints)
            step = self._within(point, wanted)
            before = float(np.linalg.norm(wanted))
            if step is None or before - np.linalg.norm(wanted - step) <= _SETTLED * before:
                break
            size = float(np.abs(step).max())
            trial = self.moved(point, step * min(1.0, longest / size))
            if trial is not None:
                trial = self.reach(trial)
                if trial.answers and self.distance(trial, joints) < before:
                    point = trial
                    continue
            longest = 0.25 * min(size, longest)
        return point

    def _within(self, point: Point, wanted: Array) -> Array | None:
        """Find the step nearest to a wanted one that keeps the tip at the target and the joints within limits."""
        left, values, right = np.linalg.svd(self._rates(point))
        rank = int((values > _SINGULAR * values[0]).sum())
        if rank == len(wanted):
            return None
        to_target = right[:rank].T @ ((left[:, :rank].T @ point.misfit) / values[:rank])
        free = right[rank:]
        step = to_target + free.T @ (free @ wanted)
        rows, room = self._room(point)
        change = least_distance(rows @ free.T, room - rows @ step)
        return None if change is None else step + free.T @ change

    def _rates(self, point: Point) -> Array:
        """Derivatives of the tip by the weighted joints; where break points coincide, for advancing tubes."""
        return self.target.rates(point.equilibrium) / self.weights

    def _solved(self, joints: Array, initial: Equilibrium) -> Equilibrium | None:
        return self.forward.neighbour(actuation_of(joints), self.loads, initial)

    def _room(self, point: Point) -> tuple[Array, Array]:
        return self.allowed.rows / self.weights, np.maximum(self.allowed.room(point.joints), 0.0)
