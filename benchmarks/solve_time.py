"""How long a forward solve takes, as ratios to the same work done with SciPy alone.

The baseline shoots with SciPy: DOP853 at a relative tolerance of 1e-8 and ``scipy.optimize.root`` with differences, on
the same equations, from the same start (the solution of a neighbouring actuation), to the same tip within 1e-7 of the
length. Run: ``python benchmarks/solve_time.py``.
"""

from time import perf_counter

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import root

import ctr_opt as ctr
from ctr_opt.mechanics.boundary import tip_rows
from ctr_opt.mechanics.sections import Configuration
from ctr_opt.transcription.columns import StepColumns
from ctr_opt.transcription.shooting import Shooting

REPEATS = 10


def integrated(shooting, state):
    """The dimensionless state behind the tip, by SciPy section by section; every mesh step here is a section."""
    functions, length = shooting.functions, shooting.configuration.length
    layout = StepColumns(shooting.configuration.tube_count, 1)
    for k, (a, b) in enumerate(shooting.mesh):
        middle = np.array([0.5 * (a + b)])

        def rates(s, x, a=a, middle=middle):
            column = layout.pack(shooting.configuration, np.array([[a, s * length]]), np.ones(1), middle)
            return functions.rates(x, column).full()[:, 0]

        state = solve_ivp(rates, (a / length, b / length), state, "DOP853", rtol=1e-8, atol=1e-10).y[:, -1]
        state = functions.jumped(state, shooting.columns[:, k]).full()[:, 0]
    return state


def baseline(robot, actuation, loads, start):
    configuration = Configuration(robot, actuation, loads)
    breaks = configuration.break_points
    shooting = Shooting(configuration, np.column_stack((breaks[:-1], breaks[1:])))
    rows = tip_rows(configuration.tube_count)
    found = root(lambda z: integrated(shooting, shooting.start(z))[rows], start / configuration.scales.moment, tol=1e-9)
    return integrated(shooting, shooting.start(found.x))[:3]


def median_time(action):
    times = []
    for _ in range(REPEATS):
        begin = perf_counter()
        action()
        times.append(perf_counter() - begin)
    return float(np.median(times))


def main():
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
        if not any(load.nonconservative for load in given.loads):
            minimum = ctr.ForwardProblem(given.robot, formulation="energy")
            minimum.solve(given.actuation, given.loads)
            ways.append(lambda p=minimum, g=given: p.solve(g.actuation, g.loads))
        times = [median_time(way) for way in ways]
        scipy = median_time(lambda g=given, s=start: baseline(g.robot, g.actuation, g.loads, s.last_iterate.vector))
        shown = [f"{1e3 * t:7.1f}ms" for t in times] + ["        -"] * (3 - len(times))
        print(f"{name:<36}{''.join(shown)}{1e3 * scipy:7.1f}ms   " + ", ".join(f"{scipy / t:.0f}" for t in times))


if __name__ == "__main__":
    main()
