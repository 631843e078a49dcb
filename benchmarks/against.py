"""Is this tree slower than another checkout? Both do the same work in turns, in one run, each in a separate process.

``python -m benchmarks.against PATH``: PATH is another checkout, for example one made by ``git worktree add``. The
output is the median of the paired ratios of times, this tree over the other, and the quartiles of the ratios. Rows
whose quartiles enclose 1 are equal within their spread.
"""

import argparse
import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parent.parent
SLICE = 0.25  # s for which a piece of work is repeated before it is the other tree's turn


def works():
    """Names of pieces of work, and what prepares the calls of each; imports are those of the tree under test."""
    import ctr_opt as ctr
    from benchmarks import methods
    from benchmarks.work import LOADS, nested, three_tubes

    def mode(compiled, method, work):
        return lambda: methods.package("", compiled).prepare[method](work()).calls

    kinds = (methods.WARM, methods.COLD, methods.DERIVATIVES, methods.MANY)
    for compiled, name in ((True, "compiled"), (False, "virtual machine")):
        for load in LOADS[:2]:
            for kind in kinds:
                yield f"B, {load}, {name}: {kind}", mode(compiled, kind, lambda load=load: three_tubes("B", load, 5))
    for kind in (methods.INTEGRATION, methods.LINEARIZATION, methods.PYTHON):
        yield f"B, force, compiled: {kind}", mode(True, kind, lambda: three_tubes("B", "force", 5))
    for tubes in (1, 6):
        yield f"{tubes} nested, compiled: warm solve", mode(True, methods.WARM, lambda n=tubes: nested(n, "force", 5))
    yield "tip force from 20 points, warm", _tip_force
    yield "calibration of 80 experiments", _calibration
    yield "inverse kinematics, tracking", _tracking
    yield "sample of a shape", _sample
    yield "problem file, loaded", lambda: [lambda: ctr.load_problem(ROOT / "problems" / "rjw_s1" / "fig9_loaded.toml")]


def _tip_force():
    import ctr_opt as ctr
    from benchmarks.work import three_tubes

    work = three_tubes("B", "force", 5)
    forward = ctr.ForwardProblem(work.robot, compiled=True)
    problem = ctr.ForceEstimationProblem(work.robot, ctr.TipForce(), compiled=True)
    places, rng = np.linspace(0.15, 0.95, 20) * work.start.length, np.random.default_rng(1)
    shapes = [forward.solve(target, work.loads, initial=work.start) for target in work.targets]
    seen = [ctr.PositionMeasurement(places, s.position(places) + 2e-4 * rng.normal(size=(20, 3)), 2e-4) for s in shapes]
    start = problem.solve(work.targets[0], seen[0])
    return [lambda k=k: problem.solve(work.targets[k], seen[k], initial=start) for k in range(1, len(seen))]


def _calibration():
    from ctr_opt import cli  # noqa: F401  where the file's reader is differs between trees

    try:
        from ctr_opt.files.calibration import load_calibration
    except ImportError:
        from ctr_opt.calibration_files import load_calibration
    problem = load_calibration(ROOT / "problems" / "rjw_s1" / "calibration.toml")
    return [problem.problem("squared").solve]


def _tracking():
    import ctr_opt as ctr
    from benchmarks.work import three_tubes

    work = three_tubes("B", "none", 5)
    problem = ctr.InverseKinematicsProblem(work.robot, compiled=True)
    start = ctr.ForwardProblem(work.robot, compiled=True).solve(work.actuation)
    return [lambda tip=tip: problem.solve(tip, initial=start) for tip in work.tips]


def _sample():
    from benchmarks.work import three_tubes

    start = three_tubes("B", "force", 1).start
    s = np.linspace(0.0, start.length, 61)
    return [lambda: (start.position(s), start.pose(s), start.torsion(0, s))]


def serve():
    """Answer, on standard output, each name on standard input with the seconds of its fastest call."""
    from benchmarks.timing import Effort, fastest

    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)  # what the work prints is not an answer
    prepared, all_works = {}, dict(works())
    print(json.dumps(list(all_works)), file=answers, flush=True)
    for line in sys.stdin:
        name = line.strip()
        if name not in prepared:
            prepared[name] = all_works[name]()
        calls = prepared[name]
        seconds = fastest(calls, Effort(SLICE, 1, 0))
        print(json.dumps(float(np.median(seconds))), file=answers, flush=True)


class Tree:
    """A checkout, and the process in which it works."""

    def __init__(self, root):
        self.root = root
        env = {**os.environ, "PYTHONPATH": str(root), "OPENBLAS_NUM_THREADS": "1"}
        command = [sys.executable, "-P", str(Path(__file__).resolve()), "--serve"]
        pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}
        self.process = subprocess.Popen(command, cwd=root, env=env, **pipes)
        self.names = json.loads(self.process.stdout.readline())

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.process.stdin.close()
        self.process.stdout.close()
        self.process.wait()

    def seconds(self, name):
        """Seconds of the fastest call of a piece of work."""
        print(name, file=self.process.stdin, flush=True)
        return json.loads(self.process.stdout.readline())

    def imported(self):
        """Seconds in which a new interpreter imports the package."""
        env = {**os.environ, "PYTHONPATH": str(self.root)}
        code = "from time import perf_counter as t; a = t(); import ctr_opt; print(t() - a)"
        return float(subprocess.run([sys.executable, "-c", code], env=env, capture_output=True, check=True).stdout)


def main(arguments=None):
    """Measure and print."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.against", description=__doc__)
    parser.add_argument("tree", type=Path, nargs="?", help="the other checkout")
    parser.add_argument("--turns", type=int, default=15, help="of each tree in each piece of work (15)")
    parser.add_argument("--only", default="", help="pieces of work with this text in their names")
    parser.add_argument("--serve", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args(arguments)
    if options.serve:
        serve()
        return
    with Tree(ROOT) as mine, Tree(options.tree.resolve()) as other:
        for name in [*mine.names, "import of the package"]:
            if options.only in name:
                print(_row(name, np.array([_turn(name, mine, other, k) for k in range(options.turns)])), flush=True)


def _row(name, times):
    """A line of the table, from the seconds of both trees ``(turns, 2)``."""
    low, middle, high = np.quantile(times[:, 0] / times[:, 1], [0.25, 0.5, 0.75])
    return f"{name:60} {middle:6.3f}  [{low:.3f}, {high:.3f}]  {1e6 * np.median(times[:, 0]):12.1f} us"


def _turn(name, mine, other, k):
    """Seconds of this tree and of the other one, first the one and then the other in turn."""
    trees = (mine, other) if k % 2 else (other, mine)
    measured = {tree: tree.imported() if name.startswith("import") else tree.seconds(name) for tree in trees}
    return measured[mine], measured[other]


if __name__ == "__main__":
    main()
