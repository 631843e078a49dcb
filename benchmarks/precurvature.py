"""How often do the bands of an identified precurvature contain the truth? Makes the table of docs/how_to/sensing.md.

Run: ``python -m benchmarks.precurvature``, ``--count 20`` for fewer repetitions.
"""

import argparse

import numpy as np

import ctr_opt as ctr
from ctr_opt.sensing import identify_precurvature

LENGTH = 0.12
TUBES = {
    "arc": lambda q: (0.0 * q, 9.0 + 0.0 * q),
    "linear": lambda q: (5.0 + 0.0 * q, 15.0 - 9.6 * q),
    "wave": lambda q: (6.0 + 4.0 * np.sin(3.8 * q), 12.0 - 7.0 * q + 3.0 * np.cos(5.0 * q)),
    "bump": lambda q: (3.0 * np.tanh(8.0 * q - 4.0), 10.0 + 8.0 * np.exp(-(((q - 0.4) / 0.15) ** 2))),
}
METHODS = ("polynomial", "spline")


def points_of(u, count):
    """Points evenly along a tube of this precurvature, m."""
    s = np.linspace(0.0, LENGTH, 201)
    piece = ctr.SampledCurvature(s, np.column_stack((*u(s / LENGTH), 0.0 * s)))
    tube = ctr.Tube("tube", 1e-3, 0.0, piece, bending_stiffness=0.02, torsional_stiffness=0.015)
    shape = ctr.ForwardProblem(ctr.Robot([tube])).solve(ctr.Actuation([0.0], [0.0]))
    return shape.position(np.linspace(0.0, LENGTH, count))


def measure(u, method, *, points=40, sigma=2e-4, count=200):
    """Coverage of the bands of 95 percent, its least along the tube; errors (rms, median), standard errors (rms)."""
    truth, rng = points_of(u, points), np.random.default_rng(12)
    inside, squares, known = [], [], []
    for _ in range(count):
        fit = identify_precurvature(truth + sigma * rng.normal(size=truth.shape), method=method, samples=21)
        errors = fit.curvature[:, :2] - np.column_stack(u(fit.arc_length / LENGTH))
        inside.append(np.abs(errors) < 1.96 * fit.standard_errors)
        squares.append(np.mean(errors**2))
        known.append(np.mean(fit.standard_errors**2))
    inside = np.mean(inside, axis=0)
    return inside.mean(), inside.min(), np.sqrt([np.mean(squares), np.median(squares), np.mean(known)])


def main():
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=200)
    count = parser.parse_args().count
    print("| tube | method | covered | worst place | error, rms | error, median | standard error |")
    print("|---|---|---|---|---|---|---|")
    for name, u in TUBES.items():
        for method in METHODS:
            covered, least, sizes = measure(u, method, count=count)
            numbers = " | ".join(f"{size:.2f}" for size in sizes)
            print(f"| {name} | {method} | {100 * covered:.1f}% | {100 * least:.0f}% | {numbers} |")


if __name__ == "__main__":
    main()
