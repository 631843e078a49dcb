"""The data of a robot as expressions of its parameters, against the numbers that the solver packs."""

import casadi as ca
import numpy as np
import pytest

import ctr_opt as ctr
from ctr_opt.layout.configuration import Configuration
from ctr_opt.robot.names import caption, chosen, parameters
from ctr_opt.transcription.parametric_problem import Discretized, ParametricProblem, at_nominal
from ctr_opt.transcription.shooting import Shooting
from tests.support.perturbed import loads_for_all
from tests.support.physics import random_problem, robot, tube
from tests.support.slow import some_slow


def expressed(configuration, names, mesh):
    """Columns, the entry's column and the straightening energy from the expressions, at the robot's own numbers."""
    known = parameters(configuration.robot, configuration.actuation, configuration.loads)
    problem = ParametricProblem(configuration, chosen(known, names), "RK8")
    keys = problem.keys(0, 1.0)
    order = problem.given(keys)
    data = Discretized(problem, order, at_nominal(problem, keys, mesh), integrals=True).data
    columns, entry, _, energy, *_ = data(problem.nominal)
    columns = columns.full()
    return columns[:, columns[0] > 1e-12], entry.full()[:, 0], float(energy)


@pytest.mark.parametrize("seed", some_slow(range(12), [0, 1, 2, 4, 6, 7, 8, 9, 10]))
def test_the_same_numbers(seed):
    """To rounding, on the solver's mesh, less the steps of no length between break points that coincide."""
    rng = np.random.default_rng(seed)
    n = 1 + seed % 4
    functions = seed % 3 == 0
    made, actuation, loads = random_problem(rng, n, pose=True, functions=functions)
    if seed % 2:
        pull = ctr.ExpressionLoad(lambda s, p, R: (s * R[:, 2], [0, 0, 0]))
        loads = [*loads, *loads_for_all(n), pull, ctr.PotentialLoad(lambda p: ca.sumsqr(p), start=0.0)]
    configuration = Configuration(made, actuation, loads)
    names = [p.name for p in parameters(made, actuation, loads).values() if not p.idle and "stiffness" not in p.name]
    mesh = configuration.mesh()
    shooting = Shooting(configuration, mesh)
    columns, entry, energy = expressed(configuration, ["rotations"] if functions else names, mesh)
    np.testing.assert_allclose(columns, shooting.columns, rtol=0.0, atol=1e-13 * np.abs(shooting.columns).max())
    np.testing.assert_allclose(entry, shooting.entry, rtol=0.0, atol=1e-13 * max(1.0, np.abs(shooting.entry).max()))
    np.testing.assert_allclose(energy, configuration.straightening_energy, rtol=1e-12, atol=1e-18)


def test_names_and_values():
    made = robot(tube("inner", [ctr.Straight(0.1), ctr.Arc(0.1, 6.0)]))
    loads = [ctr.Gravity([0.0, 0.0, -9.81]), ctr.PointWrench([1.0, 0.0, 0.0], arc_length=0.05)]
    known = parameters(made, ctr.Actuation([0.3], [-0.02]), loads)
    assert known["tubes[0].precurvature[1].curvature"].value.tolist() == [6.0, 0.0, 0.0]
    assert known["loads[1].arc_length"].value == 0.05
    assert known["loads[0].acceleration"].size == 3
    assert known["tubes[0].density"].idle == ""
    assert known["tubes[0].poisson_ratio"].idle == "poisson_ratio is not given"
    assert [p.name for p in chosen(known, ["translations", "rotations"])] == ["translations", "rotations"]


def test_captions_name_tubes():
    robot = ctr.load_robot("problems/three_tubes/robot_b.toml")
    captions = {
        "tubes[0].precurvature[1].curvature.x": "curvature.x of inner[1]",
        "tubes[1].youngs_modulus": "E of middle",
        "tubes[2].rotation_offset": "rotation offset of outer",
        "base.translation.x": "base.translation.x",
    }
    assert [caption(label, robot) for label in captions] == list(captions.values())
