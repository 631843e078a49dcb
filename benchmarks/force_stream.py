"""Does a stream of forces stay fast and accurate? 10,000 samples at 100 Hz; results in docs/how_to/force_stream.md.

Robot B of problems/three_tubes moves under a varying tip force and is measured at 20 points. Samples are dropped, late,
or wild. Run: ``python -m benchmarks.force_stream``, or ``--samples 1000``. With ``--rough``, wild samples come in
bursts, of all points or of one, and force and actuation jump.
"""

import argparse
from collections import deque
from contextlib import suppress
from time import thread_time

import attrs
import numpy as np

import ctr_opt as ctr

from .memory import resident
from .work import SEED, three_tubes

RATE = 100.0  # Hz
SIGMA = 2e-4  # m, of a point along an axis
POINTS = 20
MEMORY = 3.0  # s: in which the force forgets where it was
DROPPED, LATE, WILD = 0.03, 0.02, 0.005  # of all samples
DELAY = 3  # samples at most
DISTANCE = 0.2  # m: error of a wild point along an axis
BURSTS, TOGETHER = 0.005, 10  # a sample, in a rough stream: how often wild ones begin, and how many at most
JUMPS, FORCE, TURN = 250, 10.0, 1.0  # samples between; characteristic forces, in turn with rad of each tube at most


class Record:
    """Processor times of updates and of warm forward solves, s; of the force squared errors, N^2, and these over their
    covariance; which updates were of wild samples, which were left out; MB after so many.
    """

    def __init__(self, samples):
        self.updates, self.solves, self.errors, self.nees = np.full((4, samples), np.nan)
        self.wild, self.out = np.zeros((2, samples), dtype=bool)
        self.memory = {}


@attrs.frozen
class Tick:
    """The robot at one time: actuation, tip force, N, and its points, m; None where they were dropped."""

    time: float
    actuation: ctr.Actuation
    force: np.ndarray
    points: np.ndarray | None
    wild: bool


class Wilds:
    """Errors of wild samples: each on its own, or rough, in bursts, half of them of all points and half of one."""

    def __init__(self, rough, rng):
        self.rough, self.rng, self.left, self.alone = rough, rng, 0, False

    def noise(self):
        """Errors of the points, m; None: the sample is not wild."""
        if self.left == 0:
            if self.rng.random() >= (BURSTS if self.rough else WILD):
                return None
            self.left = self.rng.integers(1, TOGETHER + 1) if self.rough else 1
            self.alone = self.rough and self.rng.random() < 0.5
        self.left -= 1
        noise = DISTANCE * self.rng.normal(size=(POINTS, 3))
        if self.alone:
            noise[np.arange(POINTS) != self.rng.integers(POINTS)] = 0.0
        return noise


def jumped(problem, actuation, force, far, shape, rng):
    """A force this far from another, in a direction that keeps an equilibrium on the same branch."""
    while True:
        direction = rng.normal(size=3)
        force_there = force + far * direction / np.linalg.norm(direction)
        with suppress(ctr.SolveError):
            problem.solve(actuation, [ctr.PointWrench(force_there)], initial=shape)
            return force_there


def followed(problem, actuation, force, shape):
    """The equilibrium on the same branch; where that ends, the robot snaps to another."""
    try:
        return problem.solve(actuation, [ctr.PointWrench(force)], initial=shape)
    except ctr.SolveError:
        return problem.solve(actuation, [ctr.PointWrench(force)])


def ticks(work, samples, size, rng, record, rough):
    """The robot's motion, and what is seen of it; the time of the forward solves is noted."""
    problem, shape = ctr.ForwardProblem(work.robot, compiled=True), work.start
    places = np.linspace(0.15, 0.9, POINTS) * shape.length
    force, drift = 0.5 * size * rng.normal(size=3), size * np.sqrt(2.0 / MEMORY)
    wilds, turned = Wilds(rough, rng), np.zeros(3)
    for k in range(samples):
        t = k / RATE
        force = force * (1.0 - 1.0 / (RATE * MEMORY)) + drift / np.sqrt(RATE) * rng.normal(size=3)
        turns = 0.5 * np.sin([1.0 * t, 0.7 * t + 1.0, 0.4 * t + 2.0])
        drawn = 0.004 * (np.sin([0.5 * t, 0.3 * t, 0.2 * t]) - 1.0)
        if rough and k and k % (2 * JUMPS) == 0:
            turned = rng.uniform(-TURN, TURN, 3)
        actuation = ctr.Actuation(work.actuation.rotations + turns + turned, work.actuation.translations + drawn)
        if rough and k % (2 * JUMPS) == JUMPS:
            force = jumped(problem, actuation, force, FORCE * size, shape, rng)
        begin = thread_time()
        shape = followed(problem, actuation, force, shape)
        record.solves[k] = thread_time() - begin
        dropped, wild = rng.random() < DROPPED, wilds.noise()
        points = shape.position(places) + SIGMA * rng.normal(size=(POINTS, 3)) + (0.0 if wild is None else wild)
        yield Tick(t, actuation, force, None if dropped else points, wild is not None and not dropped)


def arrivals(ticks, rng):
    """Ticks in the order in which they arrive."""
    waiting = deque()
    for tick in ticks:
        if tick.points is not None and rng.random() < LATE:
            waiting.append((tick, tick.time + rng.integers(1, DELAY + 1) / RATE))
        else:
            yield tick
        while waiting and waiting[0][1] <= tick.time:
            yield waiting.popleft()[0]


def run(samples, rough=False):
    """Run the estimator and collect the results."""
    record, rng = Record(samples), np.random.default_rng(SEED)
    work = three_tubes("B", "none", 0)
    size = work.robot.tubes[0].bending_stiffness / work.start.length**2
    places = np.linspace(0.15, 0.9, POINTS) * work.start.length
    estimator = ctr.ForceEstimator(
        work.robot, ctr.TipForce(), rate=RATE, drift=size * np.sqrt(2.0 / MEMORY), compiled=True
    )
    newest = None
    for k, tick in enumerate(arrivals(ticks(work, samples, size, rng, record, rough), rng)):
        begin = thread_time()
        seen = None if tick.points is None else ctr.PositionMeasurement(places, tick.points, SIGMA)
        estimate = estimator.update(tick.actuation, seen, tick.time)
        record.updates[k] = thread_time() - begin
        newest = tick if newest is None or tick.time >= newest.time else newest
        error = estimate.force - newest.force
        record.errors[k], record.nees[k] = error @ error, error @ np.linalg.solve(estimate.force_covariance, error)
        record.wild[k], record.out[k] = tick.wild, estimate.status == "left out"
        if k + 1 in (samples // 10, samples - DELAY):
            record.memory[k + 1] = resident()
    return estimator, record


def lines(samples, rough=False):
    """Summarize the results in words."""
    estimator, record = run(samples, rough)
    done = np.isfinite(record.updates)  # a late sample may still be waiting
    wild, out, updates = record.wild[done], record.out[done], 1e3 * record.updates[done]
    solve = 1e3 * np.median(record.solves)
    yield "samples: " + ", ".join(f"{count} {status}" for status, count in estimator.counts.most_common())
    yield f"wild: {wild.sum()}, of them left out: {(wild & out).sum()}; others left out: {(out & ~wild).sum()}"
    for name, sizes in (("an update", updates[~wild]), ("one with a wild sample", updates[wild])):
        median, most = np.median(sizes), np.quantile(sizes, 0.99)
        yield f"{name}: {median:.2f} ms (median), {most:.2f} ms (99 %), {sizes.max():.1f} ms (largest)"
    yield f"a warm forward solve: {1e3 * solve:.0f} us; an update is {np.median(updates) / solve:.0f} of them (medians)"
    yield f"error of the force: {np.sqrt(np.mean(record.errors[done])):.4f} N (root mean square)"
    yield f"squared error over covariance: {np.mean(record.nees[done]):.2f} (expected: 3)"
    yield "resident: " + ", ".join(f"{size:.1f} MB after {k:,}" for k, size in record.memory.items())


def main(arguments=None):
    """Run and print."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.force_stream", description=__doc__)
    parser.add_argument("--samples", type=int, default=10_000)
    parser.add_argument("--rough", action="store_true")
    options = parser.parse_args(arguments)
    for line in lines(options.samples, options.rough):
        print(line, flush=True)


if __name__ == "__main__":
    main()
