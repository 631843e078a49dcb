"""Which transcription, and when? Error against work, and robustness from the straight guess.

``python -m benchmarks.transcriptions`` prints the tables of docs/explanation/transcriptions.md; its figure is drawn by
``python -m benchmarks``.
"""

from itertools import pairwise
from time import perf_counter

import numpy as np

import ctr_opt as ctr
from ctr_opt.layout.configuration import Configuration
from ctr_opt.solvers.ipopt import Ipopt, IpoptSolver
from ctr_opt.solvers.newton import newton
from ctr_opt.transcription.energy import EnergyProblem
from ctr_opt.transcription.equilibrium_program import EquilibriumProblem
from ctr_opt.transcription.shooting import Shooting
from tests.support import samples

from .timing import Effort, fastest
from .work import ROOT

STARTS, SEED = 100, 2026
PARTS = (1, 2, 4, 8)  # steps in each section
EFFORT = Effort(30.0, 5, 0)
COLLOCATIONS = [ctr.Collocation(2), ctr.Collocation(4), ctr.Collocation(3, "radau")]
NAMED = {
    "MultipleShooting, RK4": (ctr.MultipleShooting(), "RK4"),
    "MultipleShooting, RK8": (ctr.MultipleShooting(), "RK8"),
    **{f"Collocation({c.degree}, {c.scheme!r})": (c, "RK8") for c in COLLOCATIONS},
}


def mesh(configuration, parts):
    """Mesh with this number of equal steps in every section."""
    edges = [np.linspace(a, b, parts + 1) for a, b in pairwise(configuration.break_points)]
    return np.concatenate([np.column_stack((e[:-1], e[1:])) for e in edges])


def program(kind, configuration, steps, transcription, integrator, start):
    """A call that solves a transcription from a neighbouring shape, and the tip."""
    problem = kind(configuration, steps, transcription, integrator)
    solver = IpoptSolver(problem.program.nlp, Ipopt())

    def action():
        return solver.solve(problem.guess(start.shape), problem.parameters)

    point = action()
    assert point.converged
    iterate = (point.x, point.multipliers) if kind is EnergyProblem else (point.x,)
    return action, problem.recover(*iterate)[0].tip[:3]


def shooting(configuration, steps, integrator, start):
    """A call that solves by single shooting with Newton's method, and the tip."""
    problem = Shooting(configuration, steps, integrator)
    z = start.last_iterate.unknowns(configuration.scales, configuration.kind.live)
    return lambda: newton(problem, z, 1e-11), problem.sweep(newton(problem, z, 1e-11).z)[0].tip[:3]


def work(effort, parts=PARTS):
    """``{(formulation, name): [(steps, seconds, error), ...]}`` on RJW-S1 under a tip force; errors over the length."""
    problem = ctr.load_problem(ROOT / "problems" / "rjw_s1" / "fig9_loaded.toml")
    exact = ctr.ForwardProblem(problem.robot, tolerance=1e-11).solve(problem.actuation, problem.loads)
    near = ctr.Actuation(problem.actuation.rotations + 0.1, problem.actuation.translations)
    start = ctr.ForwardProblem(problem.robot).solve(near, problem.loads)
    configuration = Configuration(problem.robot, problem.actuation, problem.loads)
    runs = []
    for steps in (mesh(configuration, parts_of_step) for parts_of_step in parts):
        for i in ("RK4", "RK5", "RK8"):
            runs.append(("shooting", f"single shooting, {i}", len(steps), *shooting(configuration, steps, i, start)))
        for name, options in NAMED.items():
            for kind, title in ((EquilibriumProblem, "equilibrium"), (EnergyProblem, "energy")):
                runs.append((title, name, len(steps), *program(kind, configuration, steps, *options, start)))
    results = {}
    seconds = fastest([action for *_, action, _ in runs], effort)
    for (title, name, steps, _, tip), time in zip(runs, seconds, strict=True):
        error = np.linalg.norm(tip - exact.tip_position / exact.length)
        results.setdefault((title, name), []).append((steps, float(time), max(error, 1e-13)))
    return results


def unit(results):
    """Seconds that times are divided by: single shooting with RK8 and the fewest steps."""
    return results["shooting", "single shooting, RK8"][0][1]


def print_work(results):
    print(
        "| formulation | transcription | " + " | ".join(f"{n} steps" for n, *_ in next(iter(results.values()))) + " |"
    )
    for (title, name), rows in results.items():
        cells = [f"{error:.0e} ({seconds / unit(results):.1f})" for _, seconds, error in rows]
        print(f"| {title} | {name} | " + " | ".join(cells) + " |")
    print("in brackets: time over that of single shooting with RK8 and the fewest steps\n")


def starts():
    """Cold solves of random robots from the straight guess; how many converge, and how long they take."""
    ways = {"single shooting, Newton": {"formulation": "equilibrium", "method": "newton"}}
    ways["single shooting, homotopy"] = {"formulation": "equilibrium"}
    for formulation in ("equilibrium", "energy"):
        for name, (transcription, integrator) in NAMED.items():
            ways[f"{formulation}, {name}"] = {
                "formulation": formulation,
                "method": ctr.Ipopt(start="straight"),
                "transcription": transcription,
                "integrator": integrator,
            }
    drawn = [samples.conservative(SEED, 5 * index) for index in range(STARTS)]
    print("| from the straight robot | solved | median iterations | median time, s |")
    for name, options in ways.items():
        solved = []
        for sample in drawn:
            begin = perf_counter()
            problem = ctr.ForwardProblem(sample.robot, tolerance=1e-4, **options)
            shape = problem.solve(sample.actuation, sample.loads, throw=False)
            if shape.converged:
                solved.append((shape.iterations, perf_counter() - begin))
        middle = np.median(np.array(solved), axis=0)
        print(f"| {name} | {len(solved)} of {STARTS} | {middle[0]:.0f} | {middle[1]:.2f} |", flush=True)


def strong():
    """A straight cantilever under ever larger lateral forces."""
    robot = ctr.Robot([ctr.Tube("rod", 1e-3, 0.0, ctr.Straight(0.1), youngs_modulus=60e9, poisson_ratio=0.3)])
    unit = robot.tubes[0].bending_stiffness / 0.1**2
    straight = {"formulation": "equilibrium", "method": ctr.Ipopt(start="straight")}
    ways = {
        "homotopy": {"formulation": "equilibrium"},
        "equilibrium, Collocation(4)": {**straight, "transcription": ctr.Collocation()},
        "equilibrium, MultipleShooting": {**straight, "transcription": ctr.MultipleShooting()},
        "energy, Collocation(4)": {"formulation": "energy"},
        "automatic": {},
    }
    print("\n| P L^2 / EI | " + " | ".join(ways) + " |")
    for size in (10, 100, 300, 1000):
        cells = []
        for options in ways.values():
            begin = perf_counter()
            problem = ctr.ForwardProblem(robot, **options)
            shape = problem.solve(ctr.Actuation([0.0], [0.0]), [ctr.PointWrench([size * unit, 0, 0])], throw=False)
            assert not shape.converged or shape.verify() < 1e-7 * shape.length
            cells.append(f"{perf_counter() - begin:.1f} s" if shape.converged else "fails")
        print(f"| {size} | " + " | ".join(cells) + " |", flush=True)


def draw(results, path):
    """Error against time, a panel for each formulation; shooting is drawn in both."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.0, 4.6), layout="constrained")
    panels = figure.subplots(1, 2, sharey=True, sharex=True)
    colors = dict(zip(NAMED, ("C0", "C1", "C2", "C3", "C4"), strict=True))
    for axes, title in zip(panels, ("equilibrium", "energy"), strict=True):
        for (formulation, name), rows in results.items():
            _, seconds, errors = np.array(rows).T
            times = seconds / unit(results)
            if formulation == "shooting":
                style = {"RK4": ":", "RK5": "--", "RK8": "-"}[name[-3:]]
                axes.loglog(times, errors, style, color="0.3", marker="s", ms=3, label=name)
            elif formulation == title:
                axes.loglog(times, errors, color=colors[name], marker="o", ms=4, label=name)
        axes.set_title(f"{title} formulation")
        axes.set_xlabel("time of a warm solve; 1: single shooting, RK8, 4 steps")
        axes.grid(alpha=0.3)
    panels[0].set_ylabel("error of the tip over the length")
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside lower center", ncols=3, fontsize=8)
    figure.savefig(path, dpi=110)


def main():
    print_work(work(EFFORT))
    starts()
    strong()


if __name__ == "__main__":
    main()
