"""How long a forward solve takes, as ratios to the same work done with SciPy alone.

The baseline shoots with SciPy: DOP853 at a relative tolerance of 1e-8 and ``scipy.optimize.root`` with differences, on
the same equations, from the same start (the solution of a neighbouring actuation), to the same tip within 1e-7 of the
length. Run: ``python benchmarks/solve_time.py``.
"""

from time import perf_counter

import numpy as np
from scipy.optimize import root

import ctr_opt as ctr
from ctr_opt.mechanics.boundary import tip_rows
from ctr_opt.mechanics.sections import Configuration
from ctr_opt.transcription import verification
from ctr_opt.transcription.shooting import Shooting

REPEATS = 10


def baseline(robot, actuation, loads, start):
    configuration = Configuration(robot, actuation, loads)
    shooting = Shooting(configuration, configuration.mesh())

    def residual(z):
        _, tip = verification.integrate(configuration, shooting.start(z), configuration.break_points[1:])
        return tip[tip_rows(configuration.tube_count)]

    found = root(residual, start / configuration.scales.moment, tol=1e-9)
    return verification.integrate(configuration, shooting.start(found.x), configuration.break_points[1:])[0][:3, -1]


def median_time(action):
    times = []
    for _ in range(REPEATS):
        begin = perf_counter()
        action()
        times.append(perf_counter() - begin)
    return float(np.median(times))


def main():
    verification._RELATIVE, verification._ABSOLUTE = 1e-8, 1e-10
    print(f"{'problem':<36}{'cold':>9}{'initial':>9}{'energy':>9}{'SciPy':>9}   SciPy over cold, initial, energy")
    for name in ("rjw_s1/fig9_loaded", "three_tubes/a1", "single_rod/kirchhoff_helix"):
        given = ctr.load_problem(f"problems/{name}.toml")
        near = ctr.Actuation(given.actuation.rotations + 0.05, given.actuation.translations)
        default = ctr.ForwardProblem(given.robot)
        start = default.solve(near, given.loads)
        answer = default.solve(given.actuation, given.loads)
        tip = baseline(given.robot, given.actuation, given.loads, start.last_iterate.vector) * answer.length
        assert np.linalg.norm(tip - answer.tip_position) < 1e-7 * answer.length
        ways = [
            lambda p=default, g=given: p.solve(g.actuation, g.loads),
            lambda p=default, g=given, s=start: p.solve(g.actuation, g.loads, initial=s),
        ]
        if not any(load.has_moment for load in given.loads):
            minimum = ctr.ForwardProblem(given.robot, formulation="energy")
            minimum.solve(given.actuation, given.loads)
            ways.append(lambda p=minimum, g=given: p.solve(g.actuation, g.loads))
        times = [median_time(way) for way in ways]
        scipy = median_time(lambda g=given, s=start: baseline(g.robot, g.actuation, g.loads, s.last_iterate.vector))
        shown = [f"{1e3 * t:7.1f}ms" for t in times] + ["        -"] * (3 - len(times))
        print(f"{name:<36}{''.join(shown)}{1e3 * scipy:7.1f}ms   " + ", ".join(f"{scipy / t:.0f}" for t in times))


if __name__ == "__main__":
    main()
