"""Makes the synthetic data of force problems anew from their ``[truth]``: ``python -m benchmarks.force_data``."""

import argparse
import tomllib

import numpy as np

import ctr_opt as ctr

from .work import ROOT

FILES = [ROOT / "problems" / name / "problem.toml" for name in ("force_tip", "force_contact", "force_ill_posed")]
COUNTS = {"force_tip": 20, "force_contact": 30}
SIGMA, TURNED = 2e-4, 0.01  # m, rad
COMMENT = "# Synthetic: see problem.toml. World frame.\n"


def shape_of(file):
    """The equilibrium that a problem's data are of."""
    from ctr_opt.schemas import ForceSchema, load_checked

    data = load_checked(ForceSchema, tomllib.loads(file.read_text("utf-8")))
    robot = ctr.load_robot(file.parent / data["robot"])
    truth, joints = data["truth"], data["actuation"]
    load = ctr.PointWrench(truth["force"], arc_length=truth.get("arc_length"))
    return ctr.ForwardProblem(robot, tolerance=1e-10).solve(ctr.Actuation(**joints), [load]), truth["seed"]


def points(file):
    """Arc lengths and measured points of a problem, m."""
    shape, seed = shape_of(file)
    count = COUNTS[file.parent.name]
    s = np.linspace(0.1, 1.0, count) * shape.length
    return s, shape.position(s) + SIGMA * np.random.default_rng(seed).normal(size=(count, 3))


def tip(file):
    """The measured tip of a problem, m, and its direction."""
    shape, seed = shape_of(file)
    rng = np.random.default_rng(seed)
    position = shape.tip_position + SIGMA * rng.normal(size=3)
    direction = shape.tip_pose[:3, 2] + TURNED * np.array([*rng.normal(size=2), 0.0])  # the tip points along z
    return position, direction / np.linalg.norm(direction)


def write(file, s, measured, known):
    """The table, arc lengths where they are told."""
    names = (["s [mm]"] if known else []) + [f"{axis} [mm]" for axis in "xyz"]
    rows = np.column_stack((s, measured)) if known else measured
    lines = [",".join(f"{1e3 * x:.4f}" for x in row) for row in rows]
    (file.parent / "points.csv").write_text(COMMENT + "\n".join([",".join(names), *lines]) + "\n", "utf-8")


def main():
    argparse.ArgumentParser(description=__doc__).parse_args()
    for file in FILES:
        if file.parent.name in COUNTS:
            write(file, *points(file), known=file.parent.name == "force_tip")
            print(f"{file.parent / 'points.csv'} written")
        else:
            position, direction = (np.round(each, 7).tolist() for each in tip(file))
            print(f"{file}: tip at {position} m, direction {direction}")


if __name__ == "__main__":
    main()
