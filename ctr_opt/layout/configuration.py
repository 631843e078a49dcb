"""Numbers along the arc length for a robot, its actuation and its loads.

The equations are the same in every section between break points. Which tubes exist there, their precurvature
and the loads are *data*. Curvature steps, tube ends, load points and knots are break points, which always fall on
integration nodes.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from itertools import pairwise
from typing import Any

import attrs
import numpy as np
from numpy.typing import NDArray

from ..checks import Array
from ..errors import DefinitionError
from ..loads import LOADS
from ..loads.density import knots, largest, values_at
from ..loads.field import Field
from ..loads.kind import Load, Push, lowered
from ..loads.resolution import resolve
from ..mechanics import law
from ..mechanics.kind import kind_of
from ..mechanics.law import Stiffness
from ..robot.actuation import Actuation
from ..robot.robot import Robot
from .ends import Ends

LARGEST_TURN = 1.0  # rad, of a step
MOST_STEPS = 200  # beyond what sections need: absurd loads must fail soon and not fill the memory
_FUNCTION_PARTS = 8  # least number of steps in a section under a load given as a function


@attrs.frozen(eq=False)
class LoadValues:
    """Loads at points ``(..)``: world-fixed ones, those in the tubes' frames, and the factors of expressions.

    ``force (.., 3)`` is the total, ``moment (.., tubes, 3)`` acts on the tubes. ``body_force, body_moment
    (.., tubes, 3)`` are in the tubes' material frames. ``field (.., fields)`` holds the expressions' factors, and
    ``numbers`` all their parameters, one behind the other.
    """

    force: Array
    moment: Array
    body_force: Array
    body_moment: Array
    field: Array
    numbers: Array

    def add(self, where: Any, push: Push, fields: Sequence[Field], force: Array, moment: Array) -> None:
        """Add what ``push`` applies at the points ``where``; ``fields`` are the expressions to include."""
        if push.field is not None:
            if push.field in fields:
                self.field[*where, fields.index(push.field)] += push.factor
            return
        forces, moments = (self.body_force, self.body_moment) if push.body else (self.force[..., None, :], self.moment)
        forces[*where, push.tube if push.body else 0, :] += force
        moments[*where, push.tube, :] += moment


@attrs.frozen(eq=False)
class Placed:
    """A push with its place: the point ``start``, or the span up to ``end``; ``name`` is for messages."""

    name: str
    push: Push
    start: float
    end: float

    @property
    def densities(self) -> list[tuple[str, Any]]:
        """Force and moment per arc length, each with its name."""
        return [(f"{self.name}.force", self.push.force), (f"{self.name}.moment", self.push.moment)]

    @property
    def varies(self) -> bool:
        """Whether the load varies along the span in a way known only from its values."""
        return self.push.field is not None or any(callable(density) for _, density in self.densities)


@attrs.frozen(eq=False)
class Scales:
    """Units that make the equations dimensionless: the robot's length and its largest bending stiffness.

    Moments are measured in ``max(EI) / length``, forces in ``max(EI) / length^2``.
    """

    length: float
    stiffness: float

    @property
    def moment(self) -> float:
        """Unit of moments, N m."""
        return self.stiffness / self.length

    @property
    def force(self) -> float:
        """Unit of forces, N."""
        return self.stiffness / self.length**2

    def unknowns(self, tubes: int, live: bool) -> Array:
        """Units of the unknowns: moments at the entry point and, under ``live`` loads, the force there."""
        return np.concatenate((np.full(2 + tubes, self.moment), np.full(3 if live else 0, self.force)))


class Configuration:
    """A robot in one actuation under one set of loads, checked and sorted along the arc length."""

    def __init__(self, robot: Robot, actuation: Actuation, loads: Sequence[Load] = ()) -> None:
        self.robot = robot
        self.actuation = actuation
        self.loads = tuple(loads)
        _check_actuation(robot, actuation)
        tubes = robot.tubes
        self.tube_count = len(tubes)
        self.translations = np.asarray(actuation.translations)
        _check_reach(robot, self.translations)
        self.ends = Ends.of_robot(robot, self.translations)
        self.tube_ends, self.length = self.ends.array, self.ends.length
        self.stiffness = Stiffness.of(lambda name: np.array([getattr(tube, name) for tube in tubes]))
        self.scales = Scales(self.length, float(self.stiffness.bending_stiffness.max()))
        self.points: list[Placed] = []
        self.spans: list[Placed] = []
        self._place()
        self.break_points = self._break_points()
        self.points = [attrs.evolve(placed, start=self._nearest_break(placed.start)) for placed in self.points]
        pushes = [placed.push for placed in (*self.points, *self.spans)]
        self.kind = kind_of(self.loads, [push.field for push in pushes if push.field is not None])
        self.transmission_twist, self.straightening_energy = self._transmission()

    def _place(self) -> None:
        """Lower the loads to pushes and place each on its tube."""
        for k, load in enumerate(self.loads):
            if not isinstance(load, Load):
                names = ", ".join(kind.__name__ for kind in LOADS)
                raise DefinitionError(f"loads[{k}] = {load!r} must be one of {names}")
            tube = getattr(load, "tube", 0)
            if tube >= self.tube_count:
                raise DefinitionError(
                    f"loads[{k}]: tube = {tube} does not exist: the robot has tubes 0 to {self.tube_count - 1}"
                )
        for k, push in lowered(self.robot, self.loads):
            start, *end = (self._inside(k, field, push.tube) for field in push.places)
            if end and end[0] <= start:
                raise DefinitionError(f"loads[{k}]: end = {end[0]:g} m must be above start = {start:g} m")
            (self.spans if end else self.points).append(Placed(f"loads[{k}]", push, start, *(end or (start,))))

    def _inside(self, k: int, field: str, tube: int) -> float:
        """Arc length given by an argument of a load, checked to lie on its tube."""
        value, tube_end = self.loads[k].where(field), self.ends.of(tube)
        if value is None:
            return tube_end
        if not self.ends.reaches(tube, value):
            raise DefinitionError(
                f"loads[{k}]: {field} = {value:g} m is beyond the end of tube {tube} "
                f"({self.robot.tubes[tube].name!r}): allowed are 0 to {tube_end:g} m at this actuation"
            )
        return min(value, tube_end)

    def _break_points(self) -> Array:
        points = [0.0, *self.ends.points]
        for tube, translation in zip(self.robot.tubes, self.translations, strict=True):
            points.extend(translation + tube.shape.breaks[:-1])
        points.extend(placed.start for placed in self.points)
        for placed in self.spans:
            points.extend((placed.start, placed.end))
            if placed.push.field is not None and placed.push.field.varies_along:
                points.extend(self._resolved(placed.push.field, placed.start, placed.end))
            for name, density in placed.densities:
                points.extend(knots(density, placed.start, placed.end, name))
        inside = np.unique(self.ends.snap(np.clip(points, 0.0, self.length)))
        return np.asarray(inside[np.diff(inside, prepend=-np.inf) > self.ends.slack])

    def _resolved(self, field: Field, start: float, end: float) -> list[float]:
        """Break points that an expression needs because it depends on ``s``, evaluated on the straight robot."""
        pose = self.robot.base_pose

        def along(s: float, part: int) -> Array:
            wrench = field.wrench(s, pose[:3, 3] + s * pose[:3, 2], pose[:3, :3], ())
            return np.asarray(wrench[part].full()[:, 0])

        try:
            return [s for part in (0, 1) for s in resolve(partial(along, part=part), start, end, "function")]
        except DefinitionError:  # it has no value on the straight robot, which the solve need not meet
            return []

    def _nearest_break(self, s: float) -> float:
        return float(self.break_points[np.argmin(np.abs(self.break_points - s))])

    def _transmission(self) -> tuple[Array, float]:
        """Twist, ``integral of u*_z`` over ``[beta_i, 0]``, and the energy that holds curved parts straight there."""
        twist, energy = np.zeros(self.tube_count), 0.0
        for i, tube in enumerate(self.robot.tubes):
            inside = -float(self.translations[i])
            twist[i] = tube.shape.integrate(0.0, inside)[2]
            energy += float(tube.shape.integrate(0.0, inside, partial(_held_straight, self.stiffness.of_tube(i))))
        return twist, energy

    @property
    def transmission_compliance(self) -> Array:
        """Twist of tube ``i`` behind the entry point per unit torque, ``-beta_i / GJ_i``, rad/(N m)."""
        return np.asarray(law.transmission_compliance(-self.translations, self.stiffness))

    def present(self, s: Array) -> NDArray[np.bool_]:
        """Whether each tube exists at ``s (k,)`` (not a tube's end): ``(k, tubes)``."""
        return np.asarray(np.asarray(s)[:, None] < self.tube_ends)

    def mesh(self, largest_turn: float = LARGEST_TURN) -> Array:
        """Cut every section into steps that turn little: rows ``(start, end)`` from 0 to ``length``.

        A step's turn is estimated from the preset curvatures and loads.
        """
        turns = np.array([(b - a) * self._curvature_bound(float(a), float(b)) for a, b in pairwise(self.break_points)])
        largest_turn = max(largest_turn, float(turns.sum()) / MOST_STEPS)
        rows = []
        for start, end, turn in zip(self.break_points, self.break_points[1:], turns, strict=False):
            parts = max(1, int(np.ceil(turn / largest_turn)))
            if self._varies_between(start, end):
                parts = max(parts, _FUNCTION_PARTS)
            edges = np.linspace(start, end, parts + 1)
            rows.append(np.column_stack((edges[:-1], edges[1:])))
        return np.concatenate(rows)

    def _varies_between(self, start: float, end: float) -> bool:
        """Whether a load acts there that is known only from its values."""
        return any(span.start < end and start < span.end for span in self.spans if span.varies)

    def _curvature_bound(self, start: float, end: float) -> float:
        """Rough upper bound of the curvature in a section, 1/m."""
        middle = np.array([0.5 * (start + end)])
        stiffness = float((self.stiffness.bending_stiffness * self.present(middle)[0]).sum())
        precurvature, _ = self.nodes(np.array([[start, end]]), np.linspace(0.0, 1.0, 5))
        couple, force, lever = 0.0, 0.0, 0.0
        for point in self.points:
            if point.start > start:
                size = float(np.linalg.norm(point.push.force))
                couple += float(np.linalg.norm(point.push.moment))
                force += size
                lever += (point.start - start) * size
        for span in self.spans:
            if span.end > start:
                extent = span.end - span.start
                density, turning = (largest(part, span.start, span.end) for _, part in span.densities)
                couple += extent * turning
                force += extent * density
                lever += extent * density * (span.end - start)
        preset = float(np.abs(precurvature).max())
        # A force bends an elastica to at most 2 sqrt(F / EI), however long the lever.
        return preset + couple / stiffness + min(lever / stiffness, 2.0 * float(np.sqrt(force / stiffness)))

    def nodes(
        self, steps: Array, fractions: Array, middle: Array | None = None, fields: Sequence[Field] = ()
    ) -> tuple[Array, LoadValues]:
        """Precurvature ``(steps, nodes, tubes, 3)`` and load densities at ``start + fraction (end - start)`` of steps.

        Each step lies inside the section that contains ``middle`` (default: the step's middle). Data are taken from
        that section's side even at its ends. The precurvature of a tube is zero beyond its end. ``fields`` are the
        expressions whose factors are returned.
        """
        start, end = steps[:, :1], steps[:, 1:]
        s = start + fractions * (end - start)
        middle = 0.5 * (start + end)[:, 0] if middle is None else middle
        present = self.present(middle)
        count, size = s.shape
        precurvature = np.zeros((count, size, self.tube_count, 3))
        for i, tube in enumerate(self.robot.tubes):
            sigma = s - self.translations[i]
            piece = np.broadcast_to(tube.shape.piece(middle - self.translations[i])[:, None], s.shape)
            precurvature[:, :, i] = tube.shape(sigma, piece) * present[:, i, None, None]
        loads = self._no_loads((count, size), fields)
        for span in self.spans:
            here = (middle > span.start) & (middle < span.end)
            if here.any():
                both = (values_at(density, s[here], middle[here], name) for name, density in span.densities)
                loads.add((here, slice(None)), span.push, fields, *both)
        return precurvature, loads

    def loads_on(self, tube_ends: Array, factor: float) -> list[Load]:
        """Multiply the loads by ``factor`` and keep them on tubes that end at ``tube_ends``; none if it is zero.

        A load at a tube's distal end stays there. A load whose interval lies beyond its tube is left out.
        """
        if factor == 0.0:
            return []
        moved = (load.times(factor).within(tube_ends) for load in self.loads)
        return [load for load in moved if load is not None]

    @property
    def without_potential(self) -> str:
        """Name the first load without a potential, and why; empty if all have one."""
        for k, load in enumerate(self.loads):
            if load.nonconservative:
                return f"loads[{k}] ({type(load).__name__}) {load.nonconservative}, which has no potential"
        return ""

    def conservative_part(self) -> Configuration:
        """Keep only the parts of the loads that have a potential; the same object if all have one."""
        if not self.without_potential:
            return self
        parts = [load.conservative_part() for load in self.loads]
        return Configuration(self.robot, self.actuation, [part for part in parts if part is not None])

    def _no_loads(self, points: tuple[int, ...], fields: Sequence[Field]) -> LoadValues:
        """Zero loads at points, ready to be added to."""
        force, moment, *body = (np.zeros((*points, *size, 3)) for size in ((), *[(self.tube_count,)] * 3))
        numbers_of_field = {placed.push.field: placed.push.numbers for placed in (*self.points, *self.spans)}
        numbers = [numbers_of_field.get(field, np.zeros(field.parameters)) for field in fields]
        factors = np.zeros((*points, len(fields)))
        return LoadValues(force, moment, body[0], body[1], factors, np.concatenate([np.zeros(0), *numbers]))

    def jumps(self, points: Array, fields: Sequence[Field] = ()) -> LoadValues:
        """Point loads that act at ``points (k,)``, nodes of a mesh."""
        loads = self._no_loads((len(points),), fields)
        for placed in self.points:
            loads.add((points == placed.start,), placed.push, fields, placed.push.force, placed.push.moment)
        return loads


def _held_straight(stiffness: Stiffness, preset: Array) -> Array:
    """Energy per length of a tube held straight, at preset curvatures ``(.., 3)``."""
    return np.asarray(law.straight_energy_density(np.moveaxis(preset, -1, 0), stiffness))


def _check_actuation(robot: Robot, actuation: Actuation) -> None:
    if not isinstance(actuation, Actuation):
        raise DefinitionError(f"actuation = {actuation!r} must be an Actuation")
    if len(actuation.rotations) != len(robot.tubes):
        raise DefinitionError(
            f"the actuation has {len(actuation.rotations)} rotations and translations, "
            f"but the robot has {len(robot.tubes)} tubes"
        )


def _check_reach(robot: Robot, translations: Array) -> None:
    for k, (tube, translation) in enumerate(zip(robot.tubes, translations, strict=True)):
        if tube.length + translation <= 0.0:
            raise DefinitionError(
                f"tube {k} ({tube.name!r}): translations[{k}] = {translation:g} m draws it wholly behind the entry "
                f"point: it must be above -{tube.length:g} m, the tube's length, and at most 0"
            )
