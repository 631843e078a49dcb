"""Timed problems: the three-tube robots A and B of problems/three_tubes and nested robots of one to six tubes.

Each robot is under a force and a moment at the tip, under the force alone (stability is then defined), or free. Warm
solves start from the robot's actuation and go to seeded neighbours: every rotation 0.01 to 0.03 rad and every
translation 0.2 mm away. Solves at a tolerance of 1e-11 give the true tip.
"""

from functools import cached_property
from pathlib import Path

import attrs
import numpy as np

import ctr_opt as ctr

from . import reference

ROOT = Path(__file__).resolve().parent.parent
SEED = 2026
ANGLES = (0.01, 0.03)  # rad: least and most that a rotation is changed by
DISTANCE = 2e-4  # m: that every translation is changed by
FORCE = np.array([0.6, -0.8, 0.5])  # over EI / length^2 of the innermost tube
MOMENT = np.array([0.3, 0.4, -0.2])  # over EI / length
LOADS = ("force and moment", "force", "none")


@attrs.frozen(eq=False)
class Work:
    """A robot, its actuation and load, and the neighbours that warm solves go to."""

    name: str
    robot: ctr.Robot
    actuation: ctr.Actuation
    load: str
    neighbours: int

    @property
    def tubes(self):
        return len(self.robot.tubes)

    @cached_property
    def wrench(self):
        """Force, N, and moment, N m, at the tip."""
        length = float((self.actuation.translations + [tube.length for tube in self.robot.tubes]).max())
        unit = self.robot.tubes[0].bending_stiffness / length
        return FORCE * unit / length * (self.load != "none"), MOMENT * unit * (self.load == "force and moment")

    @cached_property
    def loads(self):
        return [] if self.load == "none" else [ctr.PointWrench(*self.wrench)]

    @property
    def conservative(self):
        return self.load != "force and moment"

    @cached_property
    def targets(self):
        """Actuations of the neighbours."""
        rng = np.random.default_rng([SEED, self.tubes])
        signs = rng.choice([-1.0, 1.0], (self.neighbours, 2, self.tubes))
        turns = rng.uniform(*ANGLES, (self.neighbours, self.tubes))
        return [
            ctr.Actuation(self.actuation.rotations + a * turn, self.actuation.translations + DISTANCE * b)
            for (a, b), turn in zip(signs, turns, strict=True)
        ]

    @cached_property
    def start(self):
        """The equilibrium that warm solves start from, to ten digits."""
        return ctr.ForwardProblem(self.robot, tolerance=1e-11).solve(self.actuation, self.loads)

    @cached_property
    def tips(self):
        """Tip positions of the neighbours, m, to ten digits."""
        exact = ctr.ForwardProblem(self.robot, tolerance=1e-11)
        return [exact.solve(target, self.loads, initial=self.start).tip_position for target in self.targets]

    @cached_property
    def reference(self):
        """The robot and the load for the reference solver."""
        pieces = [tube.precurvature for tube in self.robot.tubes]
        tubes = reference.Tubes(
            tuple(tube.bending_stiffness for tube in self.robot.tubes),
            tuple(tube.torsional_stiffness for tube in self.robot.tubes),
            tuple(straight.length for straight, _ in pieces),
            tuple(arc.length for _, arc in pieces),
            tuple((float(arc.curvature[0]), float(arc.curvature[1])) for _, arc in pieces),
        )
        return tubes, tuple(values.tolist() for values in self.wrench)


def plain(actuation):
    """Rotations and translations, for the reference solver."""
    return actuation.rotations.tolist(), actuation.translations.tolist()


def three_tubes(name, load, neighbours):
    """Robot A or B in the actuation of A1 or B1."""
    problem = ctr.load_problem(ROOT / "problems" / "three_tubes" / f"{name.lower()}1.toml")
    return Work(name, problem.robot, problem.actuation, load, neighbours)


def nested(count, load, neighbours):
    """The innermost ``count`` of six tubes, each 25 mm shorter than the one inside, all curved over their last 40 mm.

    Twice as many sections as tubes: no two break points coincide.
    """
    tubes, rotations, translations = [], [], []
    for i in range(count):
        inner = 0.8e-3 + 0.4e-3 * i
        reach, held = 0.18 - 0.025 * i, 0.03 * (count - i)
        pieces = [ctr.Straight(reach + held - 0.04), ctr.Arc(0.04, 12.0 - 1.5 * i)]
        tubes.append(ctr.Tube(f"tube {i}", inner + 0.2e-3, inner, pieces, youngs_modulus=60e9, poisson_ratio=0.3))
        rotations.append(0.8 * i)
        translations.append(-held)
    return Work("nested", ctr.Robot(tubes), ctr.Actuation(rotations, translations), load, neighbours)
