"""What the physics tests share: reference data, simple robots, and seeded random ones with random loads."""

from __future__ import annotations

import json
from itertools import pairwise
from pathlib import Path

import attrs
import numpy as np
from scipy.spatial.transform import Rotation

import ctr_opt as ctr
from ctr_opt.loads.density import LoadTable

DATA = Path(__file__).parents[1] / "data"


def data(name):
    return json.loads((DATA / name).read_text(encoding="utf-8"))


def tube(name, pieces, EI=0.02, GJ=0.015):
    return ctr.Tube(name, 2e-3, 1e-3, pieces, bending_stiffness=EI, torsional_stiffness=GJ)


def robot(*tubes, base_pose=None):
    return ctr.Robot(list(tubes), base_pose, on_overlap="ignore")


def rod(length=0.1, EI=0.02, GJ=0.015, curvature=None, base_pose=None):
    """One tube held at the entry point, straight or of constant precurvature."""
    piece = ctr.Straight(length) if curvature is None else ctr.Arc(length, curvature)
    return robot(tube("rod", piece, EI, GJ), base_pose=base_pose)


def held(n=1):
    """Every tube held at the entry point, unturned."""
    return ctr.Actuation(np.zeros(n), np.zeros(n))


def random_pose(rng):
    pose = np.eye(4)
    pose[:3, :3] = Rotation.random(random_state=rng).as_matrix()
    pose[:3, 3] = rng.uniform(-0.3, 0.3, 3)
    return pose


def random_robot(rng, n, pose=False):
    """``n`` tubes of every kind of precurvature; the inner ones reach further back."""
    tubes, diameter = [], rng.uniform(0.8e-3, 1.2e-3)
    for i in range(n):
        length, straight = rng.uniform(0.05, 0.15), rng.uniform(0.05, 0.15) * (n - i)
        kind, kappa = rng.integers(4), rng.uniform(2.0, 20.0)
        if kind == 0:
            piece = ctr.Arc(length, [kappa, 3.0 * rng.normal(), 2.0 * rng.normal()])
        elif kind == 1:
            piece = ctr.PolynomialCurvature(length, rng.normal(size=(3, 3)) * [5.0, 5.0, 1.0])
        elif kind == 2:
            s = np.linspace(0.0, length, 6)
            piece = ctr.SampledCurvature(s, rng.normal(size=(6, 3)) * [3.0, 3.0, 0.3] + [kappa / 2.0, 0.0, 0.0])
        else:
            piece = ctr.Arc(length, kappa)
        tubes.append(
            ctr.Tube(
                f"tube {i}",
                diameter,
                diameter * rng.uniform(0.8, 0.92),
                [ctr.Straight(straight), piece],
                youngs_modulus=rng.uniform(40e9, 75e9),
                poisson_ratio=0.3,
            )
        )
        diameter *= 1.2
    return robot(*tubes, base_pose=random_pose(rng) if pose else None)


def random_problem(rng, n, moments=True, load=1.0, most_loads=4, pose=False, functions=True):
    """Robot, actuation and loads: points and intervals on any tube, constant, tabulated or given as functions."""
    made = random_robot(rng, n, pose)
    lengths = np.array([t.length for t in made.tubes])
    beta = -rng.uniform(0.0, 0.9, n) * lengths
    ends = beta + lengths
    length = ends.max()
    force = load * max(t.bending_stiffness for t in made.tubes) / length**2
    couple = 0.3 * force * length * moments
    loads = []
    for _ in range(rng.integers(0, most_loads)):
        i = int(rng.integers(n))
        if rng.random() < 0.6:
            s = None if rng.random() < 0.5 else rng.uniform(0.0, ends[i])
            loads.append(ctr.PointWrench(rng.normal(size=3) * force, rng.normal(size=3) * couple, s, i))
            continue
        end = rng.uniform(0.3, 1.0) * ends[i]
        start = rng.uniform(0.0, 0.9) * end
        kind = rng.integers(3 if functions else 2)
        f, m = rng.normal(size=3) * force / length, rng.normal(size=3) * couple / length
        if kind == 0:
            loads.append(ctr.DistributedLoad(f, m, start, end, i))
        elif kind == 1:
            s = np.linspace(start, end, 4)
            table = (s, rng.normal(size=(4, 3)) * force / length)
            loads.append(ctr.DistributedLoad(table, m, start, end, i))
        else:
            loads.append(ctr.DistributedLoad(_wave(f, length), m, start, end, i))
    return made, ctr.Actuation(rng.uniform(-np.pi, np.pi, n), beta), loads


def _wave(f, length):
    return lambda s: f * np.cos(5.0 * s / length)


def mapped(loads, force, moment, tubes=None):
    """The loads with force and moment vectors multiplied by 3 x 3 matrices, and on other tubes."""

    def density(value, matrix):
        if callable(value):
            return lambda s: matrix @ np.asarray(value(s))
        if isinstance(value, LoadTable):
            return value.arc_length, value.values @ matrix.T
        return matrix @ value

    return [
        attrs.evolve(
            load,
            force=density(load.force, force),
            moment=density(load.moment, moment),
            tube=load.tube if tubes is None else tubes[load.tube],
        )
        for load in loads
    ]


def turned(loads, rotation):
    return mapped(loads, rotation, rotation)


# -- the loads once more, apart from what the package makes of them -----------------------------------------------


def tube_ends(made, actuation):
    return np.array([t.length for t in made.tubes]) + actuation.translations


def point_loads(result):
    """``(s, tube, force, moment)`` of every point wrench."""
    ends = tube_ends(result.robot, result.actuation)
    return [
        (ends[w.tube] if w.arc_length is None else w.arc_length, w.tube, np.array(w.force), np.array(w.moment))
        for w in result.loads
        if isinstance(w, ctr.PointWrench)
    ]


def intervals(result):
    """``(start, end, tube, force(s), moment(s), inner knots)`` of every distributed load."""
    ends = tube_ends(result.robot, result.actuation)
    found = []
    for load in result.loads:
        if isinstance(load, ctr.DistributedLoad):
            end = ends[load.tube] if load.end is None else load.end
            knots = [d.arc_length for d in (load.force, load.moment) if isinstance(d, LoadTable)]
            inner = [float(k) for k in np.concatenate(knots) if load.start < k < end] if knots else []
            found.append((load.start, end, load.tube, _value(load.force), _value(load.moment), inner))
    return found


def _value(density):
    if callable(density):
        return lambda s: np.asarray(density(s), dtype=float)
    if isinstance(density, LoadTable):
        s, rows = density.arc_length, density.values

        def interpolated(x):
            return np.array([np.interp(x, s, column, left=0.0, right=0.0) for column in rows.T])

        return interpolated
    return lambda s: density


def break_points(result):
    """Where anything jumps or kinks along ``[0, length]``, worked out here."""
    points = [0.0, result.length]
    for t, beta in zip(result.robot.tubes, result.actuation.translations, strict=True):
        s = beta
        for piece in t.precurvature:
            if isinstance(piece, ctr.SampledCurvature):
                points.extend(s + piece.arc_length)
            points.extend((s, s + piece.length))
            s += piece.length
    points.extend(s for s, *_ in point_loads(result))
    for start, end, *_, inner in intervals(result):
        points.extend((start, end, *inner))
    inside = np.unique([p for p in points if 0.0 <= p <= result.length * (1 + 1e-12)])
    return inside[np.diff(inside, prepend=-1.0) > 1e-12]


def gauss(function, start, end, cuts=(), points=12):
    """Integral of a vector function by Gauss quadrature, cut where it kinks."""
    x, w = np.polynomial.legendre.leggauss(points)
    edges = [start, *sorted(c for c in cuts if start < c < end), end]
    total = 0.0
    for a, b in pairwise(edges):
        s = 0.5 * (a + b) + 0.5 * (b - a) * x
        total = total + 0.5 * (b - a) * np.tensordot(w, np.array([function(value) for value in s]), axes=1)
    return total
