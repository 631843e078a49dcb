"""Generate the synthetic data of force problems from their ``[truth]``: ``python -m benchmarks.force_data``."""

import argparse
import tomllib

import numpy as np

import ctr_opt as ctr

from .work import ROOT

COUNTS = {"force_tip": 20, "force_contact": 30, "force_distributed": 30, "force_surface": 20}
FILES = [ROOT / "problems" / name / "problem.toml" for name in (*COUNTS, "force_ill_posed")]
SIGMA, TURNED = 2e-4, 0.01  # m, rad
COMMENT = "# Synthetic: see problem.toml. World frame.\n"
PRESSED = 15.0, 0.11, 0.035, (0.8, 0.6, 0.0)  # N/m, m, m, direction of the distributed force


def contents(file):
    """Read the contents of a problem's file."""
    from ctr_opt.files.described import read
    from ctr_opt.files.schemas import FORCE

    return read(FORCE, tomllib.loads(file.read_text("utf-8")))


def load_of(data, length):
    """True load of a problem; for a distributed one also arc lengths, m, and densities, N/m."""
    truth = data["truth"]
    if "density" not in truth:
        place = truth.get("arc_length", data["unknown"][0].get("arc_length"))
        return ctr.PointWrench(truth["force"], arc_length=None if place is None else to_m(place)), None
    most, middle, width, direction = PRESSED
    s = np.linspace(0.0, length, 200)
    density = np.outer(most * np.exp(-(((s - middle) / width) ** 2)), direction)
    return ctr.DistributedLoad(force=(s, density)), (s, density)


def to_m(value):
    """An arc length of a file, m."""
    from ctr_opt.files.units import to_si

    return to_si(value, "m")


def shape_of(file):
    """The equilibrium that a problem's data are of, its seed, and what presses along it, if anything."""
    data = contents(file)
    robot = ctr.load_robot(file.parent / data["robot"])
    actuation = ctr.Actuation(**data["actuation"])
    problem = ctr.ForwardProblem(robot, tolerance=1e-10)
    load, density = load_of(data, problem.solve(actuation).length)
    return problem.solve(actuation, [load]), data["truth"]["seed"], density


def points(file):
    """Arc lengths and measured points of a problem, m."""
    shape, seed, density = shape_of(file)
    count, sigma = COUNTS[file.parent.name], SIGMA if density is None else 0.5 * SIGMA
    s = np.linspace(0.1, 1.0, count) * shape.length
    return s, shape.position(s) + sigma * np.random.default_rng(seed).normal(size=(count, 3))


def tip(file):
    """The measured tip of a problem, m, and its direction."""
    shape, seed, _ = shape_of(file)
    rng = np.random.default_rng(seed)
    position = shape.tip_position + SIGMA * rng.normal(size=3)
    direction = shape.tip_pose[:3, 2] + TURNED * np.array([*rng.normal(size=2), 0.0])  # the tip points along z
    return position, direction / np.linalg.norm(direction)


def write(path, names, rows):
    """A table of numbers, to a tenth of a micrometre in mm."""
    lines = [",".join(f"{x:.4f}" for x in row) for row in rows]
    path.write_text(COMMENT + "\n".join([",".join(names), *lines]) + "\n", "utf-8")
    print(f"{path} written")


def main():
    argparse.ArgumentParser(description=__doc__).parse_args()
    for file in FILES:
        if file.parent.name not in COUNTS:
            position, direction = (np.round(vector, 7).tolist() for vector in tip(file))
            print(f"{file}: tip at {position} m, direction {direction}")
            continue
        s, measured = points(file)
        known = file.parent.name != "force_contact"
        names = (["s [mm]"] if known else []) + [f"{axis} [mm]" for axis in "xyz"]
        write(file.parent / "points.csv", names, 1e3 * (np.column_stack((s, measured)) if known else measured))
        density = shape_of(file)[2]
        if density is not None:
            names = ["s [mm]"] + [f"f_{axis} [N/m]" for axis in "xyz"]
            write(file.parent / "density.csv", names, np.column_stack((1e3 * density[0], density[1]))[::4])


if __name__ == "__main__":
    main()
