"""The symbolic building blocks, each against an answer computed another way."""

import casadi as ca
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import ctr_opt as ctr
from ctr_opt.mechanics import law as constitutive
from ctr_opt.mechanics.so3 import quaternion_rate, rotation_matrix
from ctr_opt.robot.tube import STIFFNESSES
from ctr_opt.transcription.integrators import runge_kutta
from ctr_opt.transcription.schemes import tableau
from tests.support.physics import held, random_robot, rod


def test_the_moment_is_the_derivative_of_the_energy():
    strain, bending, torsional = ca.SX.sym("strain", 3), ca.SX.sym("EI"), ca.SX.sym("GJ")
    stiffness = constitutive.Stiffness(bending, torsional)
    gradient = ca.gradient(constitutive.energy_density(strain, stiffness), strain)
    moment = constitutive.moment(strain, stiffness)
    difference = ca.Function("d", [strain, bending, torsional], [gradient - moment])
    assert float(ca.norm_inf(difference([0.3, -0.2, 0.7], 2.0, 3.0))) < 1e-15


def test_the_curvature_is_that_at_which_the_tubes_carry_the_moment():
    rng = np.random.default_rng(7)
    bending, x, y, moment = rng.uniform(1, 3, 4), rng.normal(size=4), rng.normal(size=4), rng.normal(size=2)
    stiffness = constitutive.Stiffness(ca.DM(bending), ca.DM(bending))
    u = constitutive.backbone_curvature(ca.DM(moment), stiffness, ca.DM(x), ca.DM(y)).full()[:, 0]
    carried = [np.sum(bending * (u[0] - x)), np.sum(bending * (u[1] - y))]
    np.testing.assert_allclose(carried, moment, atol=1e-14)  # rounding of sums of size 10


def test_a_tube_held_straight_has_the_energy_of_its_strain():
    """``H = tau u_z - W``, its derivative by the torque is the twist, and by the length the compliance is a rate."""
    stiffness, preset, torque = constitutive.Stiffness(0.02, 0.015), ca.DM([3.0, -4.0, 0.5]), ca.SX.sym("torque")
    twist = constitutive.twist_rate(torque, stiffness, preset[2])
    value = constitutive.straight_hamiltonian(torque, preset, stiffness)
    gap = ca.Function("gap", [torque], [ca.gradient(value, torque) - twist, value])
    slope, at = gap(0.003)
    assert abs(float(slope)) < 1e-15
    straight = 0.5 * 0.02 * 25.0  # half EI times the squared preset curvature
    assert float(constitutive.straight_energy_density(preset, stiffness)) == pytest.approx(straight, rel=1e-15)
    assert float(at) == pytest.approx(0.003 * (0.5 + 0.5 * 0.003 / 0.015) - straight, rel=1e-14)
    compliance = constitutive.transmission_compliance(0.06, stiffness)
    assert constitutive.transmission_twist(0.003, compliance) == pytest.approx(0.06 * 0.003 / 0.015, rel=1e-15)
    assert constitutive.transmission_energy(0.003, compliance) == pytest.approx(
        0.5 * 0.06 * 0.003**2 / 0.015, rel=1e-15
    )


def test_stiffnesses_past_the_end_of_a_tube():
    """The first tube has ended: it does not resist bending, but its torsion is kept."""
    given = constitutive.Stiffness(np.array([0.0, 2.0, 3.0]), np.array([4.0, 5.0, 6.0]))
    assert given.resistance() == [5.0, 5.0, 4.0, 5.0, 6.0]
    assert given.bends().tolist() == [False, True, True]
    assert [given.everywhere(name) for name in given.names()] == [False, True]
    assert set(given.names()) == set(STIFFNESSES)


def test_quaternions_are_rotations_of_any_length():
    rotation = Rotation.from_rotvec([0.4, -1.1, 2.0])
    q = ca.DM(1.7 * np.roll(rotation.as_quat(), 1))
    np.testing.assert_allclose(rotation_matrix(q).full(), rotation.as_matrix(), atol=1e-15)
    u, step = np.array([0.5, -0.3, 1.2]), 1e-6
    rate = quaternion_rate(q, ca.DM(u))
    moved = [rotation_matrix(q + sign * step * rate).full() for sign in (1, -1)]
    hat = np.cross(np.eye(3), u)
    # central differences: rounding 1e-16 / 1e-6, truncation 1e-12
    np.testing.assert_allclose((moved[0] - moved[1]) / (2 * step), rotation.as_matrix() @ hat, atol=1e-9)


@pytest.mark.parametrize("name", ["RK4", "RK5", "RK8"])
def test_runge_kutta_is_of_its_order(name):
    method, errors = runge_kutta(name), []
    for steps in (4, 8):
        y = ca.DM([1.0, 0.0])
        for k in range(steps):

            def rate(y, j, k=k, steps=steps):
                return ca.vertcat(y[1], -y[0]) * 2 * (1.0 + (k + method.nodes[j]) / steps)

            y = method.step(rate, y, ca.DM(1 / steps))
        angle = 3.0  # the integral of 2 (1 + s) over [0, 1]
        errors.append(np.hypot(float(y[0]) - np.cos(angle), float(y[1]) + np.sin(angle)))
    assert np.log2(errors[0] / errors[1]) == pytest.approx(method.order, abs=0.8)  # steps of a radian, not yet small


@pytest.mark.parametrize("degree", [1, 2, 4, 6])
@pytest.mark.parametrize("scheme", ["legendre", "radau"])
def test_collocation_integrates_its_polynomials(degree, scheme):
    points = tableau(degree, scheme)
    for power in range(2 * degree - (scheme == "radau")):
        assert points.weights @ points.nodes**power == pytest.approx(1 / (power + 1), abs=1e-14)
    for power in range(degree):
        integral = points.nodes ** (power + 1) / (power + 1)
        np.testing.assert_allclose(points.matrix @ points.nodes**power, integral, atol=1e-13)
    assert (points.nodes[-1] == 1.0) == (scheme == "radau")


def test_nothing_symbolic_is_built_between_solves(monkeypatch):
    """Other actuations, other loads, other precurvature, as many tubes: the same functions, other numbers."""
    robots = [random_robot(np.random.default_rng(seed), 2) for seed in (1, 2)]
    actuation = ctr.Actuation([0.3, -0.4], [-0.05, -0.02])
    loads = [ctr.PointWrench(force=[0.1, 0, 0]), ctr.DistributedLoad(force=[0, 0.5, 0], end=0.05)]
    for made in robots:
        ctr.ForwardProblem(made).solve(actuation)
        ctr.ForwardProblem(made).solve(actuation, loads)

    def refuse(*_, **__):
        raise AssertionError("a symbol was made")

    monkeypatch.setattr(ca.SX, "sym", refuse)
    monkeypatch.setattr(ca.MX, "sym", refuse)
    for made in robots:
        ctr.ForwardProblem(made).solve(ctr.Actuation([0.5, -0.2], [-0.04, -0.03]), [loads[0]])


def test_the_arc_length_grid_holds_every_break_point():
    made = random_robot(np.random.default_rng(5), 3)
    result = ctr.ForwardProblem(made).solve(ctr.Actuation([0, 1, 2], [-0.1, -0.05, -0.02]))
    grid = result.arc_length
    assert grid[0] == 0.0
    assert grid[-1] == result.length
    assert np.all(np.diff(grid) > 0.0)
    assert np.diff(grid).max() <= result.length / 100 * (1 + 1e-9)
    assert set(result.configuration.break_points) <= set(grid)


def test_a_straight_rod_needs_no_iteration():
    assert ctr.ForwardProblem(rod()).solve(held()).iterations == 0
