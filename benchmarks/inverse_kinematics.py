"""Are targets reached, and how fast? ``python -m benchmarks.inverse_kinematics``.

The results are in docs/how_to/inverse_kinematics.md.

Targets are tips of random allowed actuations whose cold solve is stable, seeded: rotations within a turn, translations
within the tubes' lengths, tubes in order. Each is solved from home. Then a second target, at most 1 mm from the answer
and reached by a random motion of the joints, is solved from there. A separate forward solve at a tolerance of 1e-10
gives every answer's error. Times are processor times.
"""

import argparse
from pathlib import Path
from time import thread_time

import attrs
import numpy as np
from scipy.optimize import least_squares

import ctr_opt as ctr
from ctr_opt.kinematics.limits import Allowed
from ctr_opt.kinematics.search import Point
from ctr_opt.kinematics.targets import LENGTH, Target
from ctr_opt.robot.actuation import joints_of

PROBLEMS = Path(__file__).resolve().parent.parent / "problems"
ROBOTS = {"A": "three_tubes/robot_a.toml", "B": "three_tubes/robot_b.toml", "RJW-S1": "rjw_s1/robot.toml"}
KINDS = ("position", "axis", "pose")
FORCE = np.array([0.6, -0.8, 0.5])  # over EI / length^2 of the innermost tube, at its tip
LARGEST_STEP = 1e-3  # m: of the tip, in tracking
TRACKING = 0.05  # rad, and of 20 mm: how far the joints move before the tip's step is measured
TIGHT = 1e-10  # tolerance of the forward solves that errors are computed anew with
BASELINE = 200  # targets that SciPy is given
PERCENTILES = (50, 90, 99, 99.9)


@attrs.frozen(eq=False)
class Bench:
    """A robot under loads: its problem, and forward solves that know nothing of it."""

    name: str
    loads: tuple
    problem: ctr.InverseKinematicsProblem
    exact: ctr.ForwardProblem

    @classmethod
    def of(cls, name, loaded, **settings):
        robot = ctr.load_robot(PROBLEMS / ROBOTS[name])
        inner = robot.tubes[0]
        loads = (ctr.PointWrench(FORCE * inner.bending_stiffness / inner.length**2),) if loaded else ()
        problem = ctr.InverseKinematicsProblem(robot, compiled=True, **settings)
        return cls(name, loads, problem, ctr.ForwardProblem(robot, tolerance=TIGHT, compiled=True))

    def shapes(self, count, seed):
        """Stable shapes of random allowed actuations."""
        rng, robot = np.random.default_rng(seed), self.problem.robot
        lengths = np.array([tube.length for tube in robot.tubes])
        allowed, shapes = Allowed.of(robot, self.problem.limits), []
        while len(shapes) < count:
            rotations = rng.uniform(-np.pi, np.pi, len(lengths))
            actuation = ctr.Actuation(rotations, -rng.uniform(0.0, 1.0, len(lengths)) * lengths)
            if allowed.exceeded(joints_of(actuation)):
                continue
            shape = self.exact.solve(actuation, self.loads, throw=False)
            if shape.converged and shape.is_stable:
                shapes.append(shape)
        return shapes

    def moved(self, shape, rng):
        """A stable shape nearby: its tip at most 1 mm away."""
        allowed, weights = Allowed.of(self.problem.robot, self.problem.limits), self.problem.weights
        joints = joints_of(shape.actuation)
        for _ in range(10):
            step = TRACKING * rng.uniform(-1.0, 1.0, len(joints)) / weights
            for _ in range(3):
                there = allowed.nearest(joints + step, weights)
                shape_there = self.exact.solve(ctr.Actuation(*np.split(there, 2)), self.loads, shape, throw=False)
                if not (shape_there.converged and shape_there.is_stable):
                    break
                size = np.linalg.norm(shape_there.tip_position - shape.tip_position)
                if size <= LARGEST_STEP:
                    return shape_there
                step *= rng.uniform(0.1, 0.9) * LARGEST_STEP / size
        return shape

    def errors(self, answer, target):
        """Distance and angle of the answer's tip from a target, by a separate solve."""
        return Point(self.exact.solve(answer.actuation, self.loads, answer.equilibrium), target).errors


@attrs.define(eq=False)
class Record:
    """Results for one robot, load and kind of target: seconds, starts, true errors of reached targets."""

    seconds: list = attrs.field(factory=list)
    starts: list = attrs.field(factory=list)
    errors: list = attrs.field(factory=list)

    def solve(self, bench, kind, pose, initial=None):
        """One more target, taken from a pose."""
        target = asked(kind, pose)
        answer, seconds = timed(lambda: bench.problem.solve(loads=bench.loads, initial=initial, **target))
        self.seconds.append(seconds)
        self.starts.append(answer.starts)
        if answer.converged:
            values = (target.get(name) for name in ("target_position", "target_axis", "target_pose"))
            self.errors.append(bench.errors(answer, Target.of(*values)))
        return answer

    @property
    def share(self):
        """Share of the targets that were reached."""
        return len(self.errors) / len(self.seconds)

    def row(self, warm):
        """Share, share with more than one start, percentiles in ms, ratio to a warm solve, largest true errors."""
        times = 1e3 * np.percentile(self.seconds, PERCENTILES)
        cells = [f"{self.share:.2%}", f"{np.mean(np.array(self.starts) > 1):.1%}", *(f"{x:.2f}" for x in times)]
        position, angle = np.max(self.errors, axis=0)
        return [*cells, f"{1e-3 * times[0] / warm:.0f}", f"{position:.1e} m" + (f", {angle:.1e} rad" if angle else "")]


def asked(kind, pose):
    """A target of a kind, as the arguments of ``solve``."""
    if kind == "pose":
        return {"target_pose": pose}
    return {"target_position": pose[:3, 3]} | ({"target_axis": pose[:3, 2]} if kind == "axis" else {})


def timed(action):
    """Result of a call, and its processor seconds, which other work on the machine does not increase."""
    begin = thread_time()
    answer = action()
    return answer, thread_time() - begin


def run(bench, kind, count, seed=1):
    """Solve all targets from home and in tracking."""
    home, tracking, rng = Record(), Record(), np.random.default_rng([seed, 1])
    for shape in bench.shapes(count, seed):
        answer = home.solve(bench, kind, shape.tip_pose)
        if answer.converged:
            tracking.solve(bench, kind, bench.moved(answer.equilibrium, rng).tip_pose, answer.equilibrium)
    return home, tracking


def warm(bench, repeats=2000):
    """Seconds of one warm forward solve to a neighbour, median."""
    shape = bench.problem.forward.solve(bench.problem.home, bench.loads)
    near = ctr.Actuation(shape.actuation.rotations + 0.02, shape.actuation.translations)
    return float(
        np.median([timed(lambda: bench.problem.forward.solve(near, bench.loads, shape))[1] for _ in range(repeats)])
    )


def baseline(bench, count, seed=1):
    """SciPy's trust region with differences on the same compiled solves; positions only, any order of tubes."""
    results = [by_scipy(bench, shape.tip_position) for shape in bench.shapes(count, seed)]
    seconds, reached = np.array(results).T
    return float(np.median(seconds)), float(reached.mean())


def by_scipy(bench, wanted):
    """Seconds for a position from home, and whether it was reached."""
    forward, start, scale = bench.problem.forward, joints_of(bench.problem.home), 1.0 / bench.problem.weights
    tubes = bench.problem.robot.tubes
    least, most = (
        [-np.inf] * len(tubes) + [1e-4 - tube.length for tube in tubes],
        [np.inf] * len(tubes) + [0.0] * len(tubes),
    )
    shapes = [forward.solve(bench.problem.home, bench.loads)]

    def misfit(joints):
        next_shape = forward.solve(ctr.Actuation(*np.split(joints, 2)), bench.loads, shapes[-1], throw=False)
        shapes.append(next_shape if next_shape.converged else shapes[-1])
        return (shapes[-1].tip_position - wanted) / LENGTH

    options = {"bounds": (least, most), "x_scale": scale, **dict.fromkeys(("xtol", "ftol", "gtol"), 1e-12)}
    solution, seconds = timed(lambda: least_squares(misfit, start, **options))
    return seconds, LENGTH * np.linalg.norm(solution.fun) <= bench.problem.tolerances[0]


def table(count, robots):
    """Lines in Markdown."""
    head = ["robot", "load", "target", "from", "targets", "reached", "more starts", *(f"{p} % ms" for p in PERCENTILES)]
    yield "| " + " | ".join([*head, "median / warm solve", "largest errors"]) + " |"
    yield "| --- | --- | --- | --- |" + " ---: |" * (len(head) - 2)
    for name in robots:
        for loaded in (False, True):
            bench = Bench.of(name, loaded)
            unit = warm(bench)
            for kind in KINDS[:2] if len(bench.problem.robot.tubes) < 3 else KINDS:
                if kind != "position" and loaded:
                    continue
                targets = count if kind == "position" else max(1, count // 5)
                for origin, record in zip(("home", "1 mm away"), run(bench, kind, targets), strict=True):
                    cells = [name, "force" if loaded else "none", kind, origin, str(len(record.seconds))]
                    yield "| " + " | ".join([*cells, *record.row(unit)]) + " |"


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--targets", type=int, default=10000)
    parser.add_argument("--robots", nargs="+", choices=ROBOTS, default=list(ROBOTS))
    options = parser.parse_args()
    for line in table(options.targets, options.robots):
        print(line, flush=True)
    for name in options.robots:
        bench = Bench.of(name, False)
        seconds, share = baseline(bench, min(BASELINE, options.targets))
        print(
            f"{name}: a warm solve {1e6 * warm(bench):.0f} us; SciPy {1e3 * seconds:.1f} ms median, {share:.1%} reached"
        )


if __name__ == "__main__":
    main()
