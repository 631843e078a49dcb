"""Slopes of estimations: against central differences, against equilibria found anew, and against sensitivities."""

from functools import cache

import attrs
import numpy as np
import pytest

import ctr_opt as ctr
from ctr_opt.estimation.losses import Loss
from tests.support.estimated import actuations, estimation, every_kind, experiments, points, small_robot, solve
from tests.support.slow import some_slow

OWN = [
    "base.translation",
    "base.rotation",
    "tubes[0].bending_stiffness",
    "tubes[0].torsional_stiffness",
    "tubes[0].precurvature[1].coefficients",
    "tubes[0].precurvature[1].length",
    "tubes[0].rotation_offset",
    "tubes[0].translation_offset",
    "experiments[1].loads[0].force",
    "experiments[0].rotations",
]
SETS = {
    "one tube": (1, [name for name in OWN if "coefficients" not in name]),
    "two tubes": (
        2,
        [*OWN, "tubes[1].precurvature[1].curvature", "tubes[1].youngs_modulus", "tubes[1].inner_diameter"],
    ),
    "three tubes": (
        3,
        [
            ctr.Parameter("soft", tied=["tubes[0].bending_stiffness", "tubes[2].torsional_stiffness"]),
            "tubes[1].shear_modulus",
            "tubes[1].outer_diameter",
            "tubes[2].precurvature[0].length",
            "tubes[2].translation_offset",
            "experiments[1].loads[0].arc_length",
            "experiments[1].rotations",
            "experiments[0].translations",
        ],
    ),
}


@cache
def case(name):
    """An estimation with every kind of measurement, and base moments of equilibria."""
    tubes, wanted = SETS[name]
    robot = small_robot(tubes)
    data = experiments(robot, 2, 5 + tubes, every_kind)
    if tubes == 3:
        data[1] = attrs.evolve(data[1], loads=[ctr.PointWrench([0.2, -0.1, 0.1], arc_length=0.03)])
    made, equilibria = estimation(robot, data, wanted)
    return made, [each.unknowns for each in equilibria]


def difference(of, step):
    """Fourth order: at steps of 1e-4 of the size its own error is some 1e-14, rounding leaves 1e-11."""
    a, b, c, d = (of(k * step) for k in (1, -1, 2, -2))
    return [(8.0 * (p - q) - (r - s)) / (12.0 * step) for p, q, r, s in zip(a, b, c, d, strict=True)]


@pytest.mark.parametrize("name", some_slow(list(SETS), ["one tube"]))
def test_slopes_are_differences(name):
    """By every unknown and base moment, away from equilibria: 1e-8 of the values' scale, as misfits are of some 100."""
    made, start = case(name)
    x0, scale, units = made.unknowns.initial, made.unknowns.scale, made.units
    moments = [z + 0.02 * unit for z, unit in zip(start, units, strict=True)]
    here = made.linearize(x0, moments)

    def reported(x, z):
        return [part for each in made.linearize(x, z) for part in (each.misfit, each.residual)]

    for k, label in enumerate(made.unknowns.labels):
        along = scale * (np.arange(len(x0)) == k)
        found = difference(lambda h, along=along: reported(x0 + h * along, moments), 1e-4)
        for e, each in enumerate(here):
            acting = made.layouts[e].acting
            (column,) = np.nonzero(acting == k)
            for mine, wanted in ((each.misfit_x, found[2 * e]), (each.residual_x, found[2 * e + 1])):
                expected = scale[k] * mine[:, column[0]] if len(column) else np.zeros(len(wanted))
                size = np.abs(mine * scale[acting]).max()
                np.testing.assert_allclose(expected, wanted, rtol=0.0, atol=1e-8 * size, err_msg=label)
    for k in range(len(units[0])):
        along = [unit * (np.arange(len(unit)) == k) for unit in units]
        found = difference(
            lambda h, along=along: reported(x0, [z + h * one for z, one in zip(moments, along, strict=True)]), 1e-4
        )
        for e, (each, unit) in enumerate(zip(here, units, strict=True)):
            for mine, wanted in ((each.misfit_z, found[2 * e]), (each.residual_z, found[2 * e + 1])):
                size = np.abs(mine * unit).max()
                np.testing.assert_allclose(unit[k] * mine[:, k], wanted, rtol=0.0, atol=1e-8 * size)


@pytest.mark.parametrize("name", SETS)
def test_reduced_slopes_are_those_of_equilibria(name):
    """Equilibria of the same mesh, by Newton's method, on both sides: 1e-8 as above."""
    made, start = case(name)
    x0, scale = made.unknowns.initial, made.unknowns.scale

    def misfits(x):
        moments = start
        for _ in range(4):
            moments = [z + each.step for z, each in zip(moments, made.linearize(x, moments), strict=True)]
        found = made.linearize(x, moments)
        assert max(np.abs(each.residual / unit).max() for each, unit in zip(found, made.units, strict=True)) < 1e-12
        return [each.misfit for each in found], found

    _, here = misfits(x0)
    rng = np.random.default_rng(1)
    for _ in range(2):
        along = 0.1 * rng.normal(size=len(x0))
        found = difference(lambda h, along=along: misfits(x0 + h * scale * along)[0], 1e-4)
        for layout, each, wanted in zip(made.layouts, here, found, strict=True):
            mine = each.reduced @ (scale * along)[layout.acting]
            np.testing.assert_allclose(mine, wanted, rtol=0.0, atol=1e-8 * np.abs(wanted).max())


@pytest.mark.parametrize("compiled", [False, True], ids=["virtual machine", "compiled"])
@pytest.mark.parametrize("tubes", some_slow([1, 2, 3], [1, 2]))
def test_reduced_slopes_are_sensitivities(tubes, compiled):
    """Of positions, poses and torques: each exact for its own mesh, whose errors are some 1e-9 of the largest."""
    robot, last, s = small_robot(tubes), tubes - 1, 0.031
    (actuation,) = actuations(np.random.default_rng(tubes), robot, 1)
    loads = [ctr.PointWrench([0.2, -0.1, 0.15], [1e-3, 2e-3, -1e-3])]
    shape = solve(robot, actuation, loads, 1e-11)
    of_robot = [
        "base.translation",
        "base.rotation",
        f"tubes[{last}].bending_stiffness",
        f"tubes[{last}].torsional_stiffness",
        "tubes[0].precurvature[1].coefficients",
    ]
    wrt = [*of_robot, "rotations", "translations", "loads[0].force"]
    measurements = [
        ctr.PositionMeasurement([s, None], [shape.position(s), shape.tip_position], sigma=1.0),
        ctr.PoseMeasurement(s, shape.pose(s, last), sigma=1.0, tube=last),
        ctr.TorqueMeasurement(last, 0.0, sigma=1.0),
    ]
    names = [name if name in of_robot else f"experiments[0].{name}" for name in wrt]
    data = [ctr.Experiment(actuation, loads, measurements)]
    made, equilibria = estimation(robot, data, names, tolerance=1e-11, compiled=compiled)
    assert (made.models[0].compiled is not None) == compiled
    found = made.linearize(made.unknowns.initial, [equilibria[0].unknowns])[0].reduced * made.unknowns.scale
    rows = [
        shape.sensitivity(("pose", s), wrt)[:3],
        shape.sensitivity("tip_pose", wrt)[:3],
        shape.sensitivity(("pose", s, last), wrt),
        shape.sensitivity(("actuator_wrench", last), wrt)[1:],
    ]
    wanted = np.vstack(rows) * made.unknowns.scale
    sizes = np.abs(wanted).max(axis=1, keepdims=True)
    np.testing.assert_allclose(found / sizes, wanted / sizes, rtol=0.0, atol=1e-8)


def test_slopes_of_curvatures_are_sensitivities():
    """By the chain rule from backbone curvature, angle and torsion; 1e-8 as above."""
    robot, tube, s = small_robot(2), 1, 0.034
    (actuation,) = actuations(np.random.default_rng(3), robot, 1)
    shape = solve(robot, actuation, [ctr.PointWrench([0.2, -0.1, 0.15])], 1e-11)
    wrt = ["tubes[1].bending_stiffness", "tubes[1].precurvature[1].curvature", "rotations"]
    measured = ctr.CurvatureMeasurement(s, [0.0, 0.0, 0.0], sigma=1.0, tube=tube)
    data = [ctr.Experiment(actuation, shape.loads, [measured])]
    made, equilibria = estimation(robot, data, [*wrt[:2], "experiments[0].rotations"], tolerance=1e-11)
    found = made.linearize(made.unknowns.initial, [equilibria[0].unknowns])[0].reduced * made.unknowns.scale
    bent, angle = shape.curvature(s)[:2], shape.tube_angle(tube, s)
    c, d = np.cos(angle), np.sin(angle)
    of_bent = np.array([[c, d], [-d, c]]) @ shape.sensitivity(("curvature", s), wrt)[:2]
    of_angle = np.outer(np.array([[-d, c], [-c, -d]]) @ bent, shape.sensitivity(("tube_angle", tube, s), wrt))
    wanted = np.vstack((of_bent + of_angle, shape.sensitivity(("torsion", tube, s), wrt))) * made.unknowns.scale
    np.testing.assert_allclose(found, wanted, rtol=0.0, atol=1e-8 * np.abs(wanted).max())


def test_compiled_and_interpreted_slopes_agree():
    """By parameters of every kind that compiled code knows; meshes differ, so 1e-7 of the largest slope."""
    robot = small_robot(2)
    data = experiments(robot, 3, 11, points)
    names = ["base.translation", "base.rotation", "tubes[0].youngs_modulus", "tubes[1].inner_diameter"]
    names += ["tubes[0].precurvature[1].coefficients", "tubes[1].rotation_offset", "tubes[0].translation_offset"]
    names += [ctr.Parameter("both", tied=["tubes[0].shear_modulus", "tubes[1].shear_modulus"])]
    found = []
    for compiled in (False, True):
        made, _ = estimation(robot, data, names, tolerance=1e-11, compiled=compiled)
        assert all((group.compiled is not None) == compiled for group in made.models)
        x = made.unknowns.initial + 0.02 * made.unknowns.scale * np.sin(np.arange(made.unknowns.size) + 1.0)
        moments = [each.unknowns for each in made.equilibria(x)]
        pairs = zip(made.layouts, made.linearize(x, moments), strict=True)
        found.append([each.reduced * made.unknowns.scale[layout.acting] for layout, each in pairs])
    for a, b in zip(*found, strict=True):
        np.testing.assert_allclose(a, b, rtol=0.0, atol=1e-7 * np.abs(a).max())


@pytest.mark.parametrize("size", [1, 3, 6])
@pytest.mark.parametrize("loss", ["squared", "distance", "huber", "cauchy"])
def test_losses_and_their_slopes(loss, size):
    """From misfits of 1e-12, where a difference of rounded numbers would be nothing, to outliers."""
    one = Loss(loss, size)
    s = np.logspace(-24, 6, 301)
    h = 1e-4 * s
    rho, first, second = one.evaluate(s)
    up, down = one.evaluate(s + h), one.evaluate(s - h)
    assert (rho > 0.0).all()
    np.testing.assert_allclose(rho[0], first[0] * s[0], rtol=1e-10)
    np.testing.assert_allclose((up[0] - down[0]) / (2.0 * h), first, rtol=1e-7)  # 1e-4 squared, and eps / 1e-4
    smooth = s > 1e-4 * (one.threshold**2 if np.isfinite(one.threshold) else 1.0)  # before, the slope is constant
    smooth &= np.abs(s - one.threshold**2) > 2.0 * h  # where the slope of Huber's has a corner
    np.testing.assert_allclose(((up[1] - down[1]) / (2.0 * h))[smooth], second[smooth], rtol=1e-6)
