"""Equilibria from the paper's equations and SciPy alone: where the expected tips of ``problems/rjw_s1`` come from.

The equations of ``test_paper_equations.py`` are shot from straight tubes with SciPy's ``root``; the package's answer is
never looked at. ``python -m tests.support.paper_tips FILE`` writes the tips of a plan into its table again; of a
problem it prints tip, tip direction and base torsions.
"""

import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
from scipy.optimize import root

import ctr_opt as ctr
from ctr_opt.files.plans import is_plan
from tests.mechanics.test_paper_equations import Paper, Rz


def as_forces(loads):
    """Gravity and masses as the forces they are; tubes without density weigh nothing."""
    g = sum((load.acceleration for load in loads if isinstance(load, ctr.Gravity)), np.zeros(3))
    forces = []
    for load in loads:
        if isinstance(load, ctr.PointMass):
            forces.append(ctr.PointWrench(load.mass * g, arc_length=load.arc_length, tube=load.tube))
        elif isinstance(load, ctr.DistributedMass):
            forces.append(ctr.DistributedLoad(load.mass_per_length * g, start=load.start, end=load.end, tube=load.tube))
        elif not isinstance(load, ctr.Gravity):
            forces.append(load)
    return forces


def paper_equilibrium(robot, actuation, loads):
    """Tip, tip direction and base torsions; loads are forces, and no tube has a preset twist."""
    ends = np.array([t.length for t in robot.tubes]) + actuation.translations
    length = float(ends.max())
    paper = Paper(SimpleNamespace(robot=robot, actuation=actuation, loads=as_forces(loads), length=length))
    count, unit = len(robot.tubes), max(t.bending_stiffness for t in robot.tubes) / length
    n, base = paper.force_beyond(0.0, 1), robot.base_pose

    def start(x):
        """The state at the entry: behind it a straight tube keeps its torsion, so turns by ``-beta u_z``."""
        psi = actuation.rotations - actuation.translations * x[2:]
        u = Rz(psi[0]).T[:2, :2] @ x[:2]  # x: in the base frame, so that a turned tube is no harder to start
        return np.concatenate((base[:3, 3], (base[:3, :3] @ Rz(psi[0])).ravel(), u, x[2:], psi - psi[0], n))

    def left_over(x):
        _, torsional, bending = paper.integrate(start(x), np.zeros(0))
        return np.concatenate((bending, torsional)) / unit

    found = root(left_over, np.zeros(2 + count), tol=1e-13)
    assert np.abs(found.fun).max() < 1e-10, found.message
    rows, *_ = paper.integrate(start(found.x), np.array([length - 2e-9]))
    s, _, y = rows[-1]
    R, h = y[3:12].reshape(3, 3), length - s
    return y[:3] + h * R[:, 2], R[:, 2] + h * (y[13] * R[:, 0] - y[12] * R[:, 1]), found.x[2:]


def main(file):
    if not is_plan(file):
        problem = ctr.load_problem(file)
        for values in paper_equilibrium(problem.robot, problem.actuation, problem.loads):
            sys.stdout.write(f"{values.tolist()}\n")
        return
    plan = ctr.load_plan(file)
    table = file.parent / "plan.csv"
    header, *lines = table.read_text("utf-8").splitlines()
    written = [header]
    for line, problem in zip(lines, plan.problems, strict=True):
        tip, *_ = paper_equilibrium(problem.robot, problem.actuation, problem.loads)
        written.append(",".join([*line.split(",")[:-3], *(repr(float(x)) for x in tip)]))
    table.write_text("\n".join(written) + "\n", "utf-8")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
