"""Gravity and masses: against the loads they stand for, and masses against the weight they approach."""

import numpy as np
import pytest

import ctr_opt as ctr
from tests.support.physics import held, robot, rod

G = np.array([-9.81, 0.0, 0.0])
RJW = ctr.load_robot("problems/rjw_s1/robot.toml")
NUTS = ctr.Actuation([0.0, 0.0], [-0.1227, -0.0307])  # the paper's distributed-load experiment
MASS = 0.05696  # kg, the paper's nuts


def heavy(density):
    return ctr.Tube(
        "rod", 2e-3, 1e-3, ctr.Arc(0.15, 4.0), density=density, bending_stiffness=0.002, torsional_stiffness=0.0015
    )


def test_gravity_is_the_weight_of_the_tubes_in_front_of_the_entry():
    made = ctr.Robot([heavy(8000.0)])
    actuation = ctr.Actuation([0.4], [-0.03])
    pulled = ctr.ForwardProblem(made).solve(actuation, [ctr.Gravity(G)])
    weight = 8000.0 * np.pi / 4 * (2e-3**2 - 1e-3**2) * G
    same = ctr.ForwardProblem(made).solve(actuation, [ctr.DistributedLoad(force=weight)])
    np.testing.assert_allclose(pulled.tip_position, same.tip_position, atol=1e-15)  # the same numbers
    np.testing.assert_allclose(pulled.internal_force(0.0), weight * 0.12, rtol=1e-12)
    assert pulled.load_work == pytest.approx(same.load_work, rel=1e-12)


def test_gravity_turns_the_robot_as_turning_the_robot_does():
    made, pose = heavy(8000.0), np.eye(4)
    pose[:3, :3] = [[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]
    upright = ctr.ForwardProblem(ctr.Robot([made])).solve(held(), [ctr.Gravity(pose[:3, :3].T @ G)])
    turned = ctr.ForwardProblem(ctr.Robot([made], pose)).solve(held(), [ctr.Gravity(G)])
    np.testing.assert_allclose(turned.tip_position, pose[:3, :3] @ upright.tip_position, atol=1e-14)  # rounding


def test_masses_act_only_under_gravity():
    loads = [ctr.PointMass(0.01), ctr.DistributedMass(0.2)]
    problem = ctr.ForwardProblem(rod())
    np.testing.assert_array_equal(problem.solve(held(), loads).tip_position, problem.solve(held()).tip_position)
    pulled = problem.solve(held(), [*loads, ctr.Gravity(G)])
    same = problem.solve(held(), [ctr.PointWrench(force=0.01 * G), ctr.DistributedLoad(force=0.2 * G)])
    np.testing.assert_allclose(pulled.tip_position, same.tip_position, atol=1e-15)
    halves = problem.solve(held(), [*loads, ctr.Gravity(0.5 * G), ctr.Gravity(0.5 * G)])
    np.testing.assert_allclose(pulled.tip_position, halves.tip_position, atol=1e-15)


def test_every_formulation_takes_weights():
    made = robot(heavy(8000.0))
    loads = [ctr.Gravity(G), ctr.PointMass(0.002, arc_length=0.1), ctr.DistributedMass(0.01, start=0.02, end=0.07)]
    shapes = [
        ctr.ForwardProblem(made, formulation=name, tolerance=1e-9).solve(held(), loads)
        for name in ("automatic", "equilibrium", "energy")
    ]
    for shape in shapes[1:]:
        np.testing.assert_allclose(shape.tip_position, shapes[0].tip_position, atol=1e-9 * 0.15)
    assert shapes[-1].stability_checked


def test_midpoint_masses_approach_the_distributed_weight_at_second_order():
    """N equal masses at the midpoints of N intervals: the midpoint rule, of order 2 in 1/N, on the paper's nuts."""
    problem = ctr.ForwardProblem(RJW, tolerance=1e-10)
    free = problem.solve(NUTS)
    length = free.length
    spread = problem.solve(NUTS, [ctr.Gravity(G), ctr.DistributedMass(MASS / length)])
    errors = []
    for count in (20, 40, 80):  # below, higher orders still show
        middles = (np.arange(count) + 0.5) * length / count
        masses = [ctr.PointMass(MASS / count, arc_length=float(s)) for s in middles]
        hung = problem.solve(NUTS, [ctr.Gravity(G), *masses])
        errors.append(np.linalg.norm(hung.tip_position - spread.tip_position))
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    np.testing.assert_allclose(orders, 2.0, atol=0.05)
    assert np.linalg.norm(spread.tip_position - free.tip_position) > 0.01  # the nuts bend it visibly


def test_loads_fade_and_grow_with_gravity_on_the_way_from_another_equilibrium():
    problem = ctr.ForwardProblem(RJW)
    start = problem.solve(ctr.Actuation([2.0, 0.0], [-0.15, -0.03]), [ctr.PointWrench(force=[0.3, 0, 0])])
    loads = [ctr.Gravity(G), ctr.DistributedMass(MASS / 0.2, end=0.19)]
    there = problem.solve(NUTS, loads, initial=start)
    np.testing.assert_allclose(there.tip_position, problem.solve(NUTS, loads).tip_position, atol=1e-8)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: ctr.Gravity([0, 0]), r"acceleration has shape \(2,\)"),
        (lambda: ctr.PointMass(-1.0), "mass = -1 kg must be .* at least 0"),
        (lambda: ctr.DistributedMass(0.1, start=0.2, end=0.1), "end = 0.1 m must be above start = 0.2 m"),
        (lambda: ctr.ForwardProblem(rod()).solve(held(), [ctr.PointMass(1.0, tube=1)]), r"loads\[0\]: tube = 1"),
        (lambda: ctr.ForwardProblem(rod()).solve(held(), [ctr.PointMass(1.0, 0.2)]), r"loads\[0\]: arc_length = 0.2"),
    ],
)
def test_wrong_weights_are_refused(make, words):
    with pytest.raises(ctr.DefinitionError, match=words):
        make()
