"""Measure speed and accuracy: print a table of times, their growth and memory, and draw error against time.

See docs/evidence/performance.md.
"""

import argparse
from itertools import product
from pathlib import Path

import attrs
import numpy as np

import ctr_opt as ctr

from . import cliffs, compilation, reference, scaling, transcriptions
from .memory import growth
from .methods import COLD, INTEGRATION, WARM, package, scipy
from .table import Measured, Row, table
from .timing import Effort, fastest
from .work import LOADS, ROOT, nested, three_tubes

REFERENCES = [
    scipy("SciPy, textbook", reference.printed, reuse=False),
    scipy("SciPy, tuned", reference.expanded, reuse=True),
]
MODES = [package("compiled", compiled=True), package("virtual machine", compiled=False)]
FIGURE = ROOT / "docs" / "figures" / "transcriptions.png"


@attrs.frozen
class Plan:
    """Plan of measurements: loads of robots A and B, tube counts of nested robots, steps of the figure."""

    effort: Effort
    three_tubes: tuple[tuple[str, str], ...]
    nested: tuple[int, ...]
    parts: tuple[int, ...]
    figure: Effort


FULL = Plan(
    Effort(3.0, 5, 20), tuple(product("AB", LOADS[:2])), (1, 2, 3, 4, 5, 6), transcriptions.PARTS, transcriptions.EFFORT
)
QUICK = Plan(Effort(0.0, 1, 1), (("A", LOADS[0]), ("B", LOADS[1])), (1, 2), (1,), Effort(0.0, 1, 0))
FEW = 5  # neighbours of nested robots at most


def measured(work, effort, methods=None):
    """Measure one row per kind of work that any mode does; for each neighbour all modes take turns."""
    modes = [*REFERENCES, *MODES]
    names = dict.fromkeys(name for mode in modes for name in mode.prepare if methods is None or name in methods)
    for name in names:
        prepared = {mode.name: mode.prepare[name](work) for mode in modes if name in mode.prepare}
        together = list(zip(*(prepared_mode.calls for prepared_mode in prepared.values()), strict=True))
        share = attrs.evolve(effort, seconds=effort.seconds / len(together))
        seconds = np.median([fastest(calls, share) for calls in together], axis=0)
        measured_modes = {
            mode: Measured(float(time) / prepared_mode.solves, prepared_mode.error)
            for (mode, prepared_mode), time in zip(prepared.items(), seconds, strict=True)
        }
        yield Row(f"{work.name} ({work.tubes})", work.load, name, measured_modes)


def rows(plan):
    """The rows of the table."""
    for robot, load in plan.three_tubes:
        yield from measured(three_tubes(robot, load, plan.effort.neighbours), plan.effort)
    for tubes, load in product(plan.nested, (LOADS[0], LOADS[2])):
        work = nested(tubes, load, min(FEW, plan.effort.neighbours))
        yield from measured(work, plan.effort, (INTEGRATION, WARM, COLD))


def main(arguments=None):
    """Measure and print; returns the rows of the table."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description=__doc__)
    parser.add_argument("part", nargs="?", choices=["cliffs"], help="cliffs: calls over the price of their neighbours")
    parser.add_argument("--quick", action="store_true", help="a little of everything, in less than a minute")
    parser.add_argument("--memory", type=int, metavar="SOLVES", help="warm solves for memory (100,000; quick: 100)")
    parser.add_argument("--figure", type=Path, metavar="PATH", help=f"of the figure ({FIGURE.relative_to(ROOT)})")
    options = parser.parse_args(arguments)
    if options.part == "cliffs":
        return cliffs.main(options.quick)
    plan = QUICK if options.quick else FULL
    print(compilation.line(1 if options.quick else 3), flush=True)
    measurements = list(rows(plan))
    print("\n".join(table(measurements, [mode.name for mode in REFERENCES], [mode.name for mode in MODES])))
    print("in brackets: largest error of the tip, mm\n", flush=True)
    for line in scaling.lines(plan.effort, plan.nested):
        print(line, flush=True)
    solves = options.memory or (100 if options.quick else 100_000)
    work = three_tubes("A", LOADS[0], plan.effort.neighbours)
    early, late = growth(ctr.ForwardProblem(work.robot, compiled=True), work, solves)
    print(f"resident after {solves // 10:,} warm solves: {early:.2f} MB, after {solves:,}: {late:.2f} MB", flush=True)
    if options.figure or not options.quick:
        transcriptions.draw(transcriptions.work(plan.figure, plan.parts), options.figure or FIGURE)
    return measurements


if __name__ == "__main__":
    main()
