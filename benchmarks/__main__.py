"""How fast, how exact: prints one table, how times grow and memory, and draws error against time.

See docs/performance.md.
"""

import argparse
from pathlib import Path

import attrs

import ctr_opt as ctr

from . import reference, scaling, transcriptions
from .memory import growth
from .methods import COLD, INTEGRATION, WARM, package, scipy
from .table import Row, table
from .timing import Effort
from .work import LOADS, ROOT, nested, three_tubes

REFERENCES = [scipy("SciPy as printed", reference.printed), scipy("SciPy expanded", reference.expanded)]
MODES = [package("virtual machine")]
FIGURE = ROOT / "docs" / "figures" / "transcriptions.png"


@attrs.frozen
class Plan:
    """How much to measure: effort on robots A and B and on nested ones, the most tubes, and the figure's steps."""

    effort: Effort
    nested: Effort
    tubes: int
    parts: tuple


FULL = Plan(Effort(0.2, 3, 20), Effort(0.2, 3, 5), 6, transcriptions.PARTS)
QUICK = Plan(Effort(0.0, 1, 2), Effort(0.0, 1, 1), 2, (1, 2))


def measured(work, effort, methods=None):
    """A row for each kind of work that any mode does."""
    modes = [*REFERENCES, *MODES]
    names = dict.fromkeys(name for mode in modes for name in mode.measures if methods is None or name in methods)
    for name in names:
        found = {mode.name: mode.measures[name](work, effort) for mode in modes if name in mode.measures}
        yield Row(f"{work.name} ({work.tubes})", work.load, name, found)


def rows(plan):
    """The rows of the table."""
    for robot in ("A", "B"):
        for load in LOADS[:2]:
            yield from measured(three_tubes(robot, load, plan.effort.neighbours), plan.effort)
    for tubes in range(1, plan.tubes + 1):
        for load in (LOADS[0], LOADS[2]):
            work = nested(tubes, load, plan.nested.neighbours)
            yield from measured(work, plan.nested, (INTEGRATION, WARM, COLD))


def main(arguments=None):
    """Measure and print; returns the rows of the table."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description=__doc__)
    parser.add_argument("--quick", action="store_true", help="a little of everything, in less than a minute")
    parser.add_argument("--memory", type=int, metavar="SOLVES", help="warm solves for memory (100,000; quick: 100)")
    parser.add_argument("--figure", type=Path, metavar="PATH", help=f"of the figure ({FIGURE.relative_to(ROOT)})")
    given = parser.parse_args(arguments)
    plan = QUICK if given.quick else FULL
    measurements = list(rows(plan))
    print("\n".join(table(measurements, [mode.name for mode in REFERENCES], [mode.name for mode in MODES])))
    print("in brackets: largest error of the tip, mm\n", flush=True)
    for line in scaling.lines(plan.effort, plan.tubes):
        print(line, flush=True)
    solves = given.memory or (100 if given.quick else 100_000)
    work = three_tubes("A", LOADS[0], plan.effort.neighbours)
    early, late = growth(ctr.ForwardProblem(work.robot), work, solves)
    print(f"resident after {solves // 10:,} warm solves: {early:.2f} MB, after {solves:,}: {late:.2f} MB", flush=True)
    if given.figure or not given.quick:
        transcriptions.draw(transcriptions.work(plan.nested, plan.parts), given.figure or FIGURE)
    return measurements


if __name__ == "__main__":
    main()
