"""Seeded random robots under loads that are scaled to a stated effect: what the robustness runs and tests share.

The loads of a sample are drawn at random and multiplied by one factor, found by Newton's method from the unloaded robot
up, until the tip is displaced, or turned, as much as the sample wants. Where that walk meets a singular Jacobian the
factor behind it is kept, so the robots that snap stay in the sample. What a sample's loads really do is measured on the
answer.
"""

import attrs
import numpy as np
from scipy.spatial.transform import Rotation

import ctr_opt as ctr
from ctr_opt.layout.configuration import Configuration
from ctr_opt.mechanics.state import State
from ctr_opt.solvers.accuracy import NEARBY
from ctr_opt.solvers.homotopy import regular_between
from ctr_opt.solvers.newton import newton
from ctr_opt.transcription.shooting import Shooting
from tests.support.physics import random_robot, robot, tube

MASSES = (ctr.PointMass, ctr.DistributedMass)
FARTHEST = 0.5  # of the robot's length: the largest displacement of the tip wanted
WIDEST = np.pi / 2  # the largest turn of the tip wanted
_STRATA = 25  # displacements and turns wanted, evenly spaced
_CLOSE = 0.05  # of the effect wanted: near enough
_TRIALS = 40


@attrs.frozen(eq=False)
class Sample:
    """A robot, its actuation, and loads scaled to what was wanted of them.

    ``pose``: the tip's under the forces alone; ``snapped``: the walk to these loads met a singular Jacobian.
    """

    index: int
    robot: ctr.Robot
    actuation: ctr.Actuation
    loads: tuple
    unloaded: ctr.Equilibrium
    pose: np.ndarray
    snapped: bool

    @property
    def tubes(self):
        return len(self.robot.tubes)


def conservative(seed, index):
    """Point and distributed forces and weights, which displace the tip by 0 to half the robot's length."""
    rng, robot, actuation, ends = _robot(seed, index)
    forces = _forces(rng, robot, ends)
    unloaded = ctr.ForwardProblem(robot).solve(actuation, throw=False)
    walk = _Walk(robot, actuation, forces, unloaded)
    factor = walk.up(lambda x: (x, 0.0), _displaced, FARTHEST * _stratum(index) * ends.max())
    return Sample(index, robot, actuation, times(forces, factor), unloaded, walk.pose, walk.snapped)


def with_moments(seed, index):
    """The same with moments, which turn the tip by 0 to 90 degrees more."""
    rng, robot, actuation, ends = _robot(seed, index)
    forces, moments = _forces(rng, robot, ends), _moments(rng, robot, ends)
    unloaded = ctr.ForwardProblem(robot).solve(actuation, throw=False)
    walk = _Walk(robot, actuation, (*forces, *moments), unloaded)
    force = walk.up(lambda x: (x, 0.0), _displaced, rng.uniform(0.0, FARTHEST) * ends.max())
    forced = walk.pose
    moment = walk.up(lambda x: (force, x), _turned, WIDEST * _stratum(index))
    loads = (*times(forces, force), *times(moments, moment))
    return Sample(index, robot, actuation, loads, unloaded, forced, walk.snapped)


def displacement(shape, sample):
    """Of the tip by all loads, over the robot's length."""
    return _displaced(shape.tip_pose, sample.unloaded.tip_pose) / shape.length


def turn(shape, sample):
    """Of the tip's frame by the moments, rad."""
    return _turned(shape.tip_pose, sample.pose)


def times(loads, factor):
    """Loads multiplied; a mass stays, as its weight grows with gravity. A factor of zero leaves none."""
    if factor == 0.0:
        return ()
    return tuple(load if isinstance(load, MASSES) else load.times(factor) for load in loads)


def _displaced(pose, start):
    return float(np.linalg.norm(pose[:3, 3] - start[:3, 3]))


def _turned(pose, start):
    return float(np.linalg.norm(Rotation.from_matrix(start[:3, :3].T @ pose[:3, :3]).as_rotvec()))


def _stratum(index):
    """From 0 to 1; each holds robots of one to four tubes."""
    return index // 4 % _STRATA / (_STRATA - 1)


class _Walk:
    """Newton's method from equilibrium to equilibrium of one configuration, forces and moments multiplied."""

    def __init__(self, robot, actuation, loads, unloaded):
        self.configuration = Configuration(robot, actuation, loads)
        sections = self.configuration.break_points
        self.shooting = Shooting(self.configuration, np.column_stack((sections[:-1], sections[1:])))  # near enough
        self.here = unloaded.last_iterate.vector / self.configuration.scales.moment
        self.snapped = not unloaded.converged
        self.pose = self._tip((0.0, 0.0), self.here)

    def up(self, factors, measure, wanted):
        """The factor whose effect is wanted; where the walk snaps, the one behind."""
        if self.snapped or wanted == 0.0:
            return 0.0
        here = newton(self.shooting.scaled(*factors(0.0)), self.here, 1e-9, NEARBY)
        start, low, reached, step = self._tip(factors(0.0), here.z), 0.0, 0.0, 0.1
        for _ in range(_TRIALS):
            found = newton(self.shooting.scaled(*factors(low + step)), here.z, 1e-6, NEARBY)
            if not (found.converged and regular_between(here.jacobian, found.jacobian)):
                if step < _CLOSE * low:
                    self.snapped = True
                    return low + step
                step *= 0.4
                continue
            value = measure(self._tip(factors(low + step), found.z), start)
            ahead = (wanted - reached) / max(value - reached, 1e-9)
            if value <= (1.0 + _CLOSE) * wanted:
                low, reached, here = low + step, value, found
                ahead -= 1.0
            if reached >= (1.0 - _CLOSE) * wanted:
                break
            step *= float(np.clip(ahead, 0.1, 2.5))
        self.here, self.pose = here.z, self._tip(factors(low), here.z)
        return low

    def _tip(self, factors, z):
        nodes, _ = self.shooting.scaled(*factors).sweep(z)
        state = State.split(nodes.left[:, -1:], self.configuration.tube_count)
        innermost = int(np.argmax(self.configuration.tube_ends >= self.configuration.length))
        turned = Rotation.from_quat(np.roll(np.ravel(state.orientation), -1))
        pose = np.eye(4)
        pose[:3, :3] = (turned * Rotation.from_rotvec([0.0, 0.0, float(state.angles[innermost, 0])])).as_matrix()
        pose[:3, 3] = np.ravel(state.position) * self.configuration.length
        return pose


def _robot(seed, index):
    rng, tubes = np.random.default_rng([seed, index]), 1 + index % 4
    made = random_robot(rng, tubes, pose=bool(index % 3 == 0))
    heavy = [
        attrs.evolve(tube, density=rng.uniform(2000.0, 9000.0)) if rng.random() < 0.5 else tube for tube in made.tubes
    ]
    robot = ctr.Robot(heavy, made.base_pose, on_overlap="ignore")
    lengths = np.array([tube.length for tube in robot.tubes])
    actuation = ctr.Actuation(rng.uniform(-np.pi, np.pi, tubes), -rng.uniform(0.0, 0.9, tubes) * lengths)
    return rng, robot, actuation, lengths + actuation.translations


def _units(robot, ends):
    """A force and a moment that bend a rod of this length and the stiffness of all tubes noticeably."""
    stiffness = sum(tube.bending_stiffness for tube in robot.tubes)
    return stiffness / ends.max() ** 2, stiffness / ends.max()


def _kinds(rng, most):
    """Point loads, and densities that are constant, tables, or functions."""
    return rng.choice(4, size=rng.integers(1, most + 1), p=[0.5, 0.2, 0.2, 0.1])


def _forces(rng, robot, ends):
    unit, _ = _units(robot, ends)
    loads = [_load(rng, ends, unit, kind, "force") for kind in _kinds(rng, 4)]
    if rng.random() < 0.4:
        tube = int(rng.integers(len(ends)))
        down = rng.normal(size=3)
        mass = unit / 9.81
        loads += [ctr.Gravity(9.81 * down / np.linalg.norm(down)), ctr.PointMass(mass * rng.random(), tube=tube)]
        loads.append(ctr.DistributedMass(mass / ends[tube] * rng.random(), 0.1 * ends[tube], tube=tube))
    return loads


def _load(rng, ends, unit, kind, of):
    """A point load (kind 0) or a distributed one, of a ``force`` or a ``moment``."""
    tube = int(rng.integers(len(ends)))
    if kind == 0:
        where = None if rng.random() < 0.5 else rng.uniform(0.0, ends[tube])
        return ctr.PointWrench(**{of: unit * rng.normal(size=3)}, arc_length=where, tube=tube)
    start, end, density = _density(rng, ends, unit, tube, kind)
    return ctr.DistributedLoad(**{of: density}, start=start, end=end, tube=tube)


def _moments(rng, robot, ends):
    _, unit = _units(robot, ends)
    return [_load(rng, ends, unit, kind, "moment") for kind in _kinds(rng, 3)]


def _density(rng, ends, unit, tube, kind):
    """An interval, and a density on it: constant, a table, or a function."""
    end = rng.uniform(0.3, 1.0) * ends[tube]
    start = rng.uniform(0.0, 0.9) * end
    value = rng.normal(size=3) * unit / ends.max()
    if kind == 2:
        return start, end, (np.linspace(start, end, 4), rng.normal(size=(4, 3)) * unit / ends.max())
    if kind == 3:
        length = ends.max()
        return start, end, lambda s: value * np.cos(5.0 * s / length)
    return start, end, value


def light(seed, index, load=1.0):
    """A robot and loads that are quick to solve, for runs of very many solves."""
    rng = np.random.default_rng([seed, index])
    tubes = 1 + index % 4
    made = robot(*(tube(f"tube {i}", _piece(rng), 0.02 * 1.5**i, 0.015 * 1.5**i) for i in range(tubes)))
    actuation = ctr.Actuation(rng.uniform(-1.0, 1.0, tubes), -rng.uniform(0.0, 0.08, tubes))
    kinds = rng.integers(2, size=rng.integers(0, 3))
    loads = [
        ctr.PointWrench(
            0.2 * load * rng.normal(size=3), 5e-3 * load * rng.normal(size=3), tube=int(rng.integers(tubes))
        )
        if kind
        else ctr.DistributedLoad(force=load * rng.normal(size=3), tube=int(rng.integers(tubes)))
        for kind in kinds
    ]
    return made, actuation, loads


def _piece(rng):
    return ctr.Arc(rng.uniform(0.1, 0.2), rng.uniform(1.0, 8.0))
