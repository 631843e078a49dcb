"""How fast, how exact: prints one table, how times grow, memory, and draws error against time.

Run ``python -m benchmarks`` for everything, ``--quick`` for a look at it. See docs/performance.md.
"""

import argparse
from pathlib import Path

from . import memory, reference, scaling, transcriptions
from .methods import COLD, INTEGRATION, WARM, package, scipy
from .table import Row, table
from .timing import Effort
from .work import LOADS, ROOT, nested, three_tubes

REFERENCES = [scipy("SciPy as printed", reference.printed), scipy("SciPy expanded", reference.expanded)]
MODES = [package("virtual machine")]
FULL, QUICK = Effort(0.2, 3, 20), Effort(0.0, 1, 2)
NESTED = 5  # neighbours of the robots of one to six tubes


def measured(work, effort, methods=None):
    """A row for each kind of work that any mode does."""
    modes = [*REFERENCES, *MODES]
    names = dict.fromkeys(name for mode in modes for name in mode.measures if methods is None or name in methods)
    for name in names:
        found = {mode.name: mode.measures[name](work, effort) for mode in modes if name in mode.measures}
        yield Row(f"{work.name} ({work.tubes})", work.load, name, found)


def rows(quick):
    """The rows of the table."""
    effort = QUICK if quick else FULL
    for robot in ("A", "B"):
        for load in LOADS[:2]:
            yield from measured(three_tubes(robot, load, effort.neighbours), effort)
    for tubes in range(1, 3 if quick else 7):
        for load in LOADS[::2]:
            yield from measured(nested(tubes, load, min(NESTED, effort.neighbours)), effort, (INTEGRATION, WARM, COLD))


def main():
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description=__doc__)
    parser.add_argument("--quick", action="store_true", help="a few measurements of each kind, in less than a minute")
    parser.add_argument("--memory", type=int, default=100_000, metavar="SOLVES", help="warm solves for memory; 0: none")
    parser.add_argument("--figure", type=Path, default=ROOT / "docs" / "figures" / "transcriptions.png")
    given = parser.parse_args()
    print("\n".join(table(list(rows(given.quick)), [m.name for m in REFERENCES], [m.name for m in MODES])), flush=True)
    for line in scaling.lines(QUICK if given.quick else FULL, 3 if given.quick else 6):
        print(line, flush=True)


if __name__ == "__main__":
    main()
