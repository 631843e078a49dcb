"""The package against the paper's own equations, written once more here: in curvatures, with derivatives of u*.

The package integrates internal moments; Rucker, Jones and Webster (IEEE T-RO 2010) integrate curvatures: (2), (12),
(19), (20), and (9) for one tube, with the transition conditions of II-G. Read with three corrections: (12) is
theta_i' = u_i,z - u_1,z, the vector beside dR_theta/dtheta in (19) is u_1, and the unit vector in (20) is e_3. Below
"tube 1" is the innermost tube present; where it ends the next one takes its place.
"""

from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline

import ctr_opt as ctr
from tests.support.physics import (
    break_points,
    gauss,
    held,
    intervals,
    point_loads,
    random_problem,
    robot,
    tube,
    tube_ends,
)
from tests.support.slow import some_slow

E3 = np.array([0.0, 0.0, 1.0])


def hat(v):
    return np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])


def Rz(a):
    return np.array([[np.cos(a), -np.sin(a), 0.0], [np.sin(a), np.cos(a), 0.0], [0.0, 0.0, 1.0]])


def dRz(a):
    return np.array([[-np.sin(a), -np.cos(a), 0.0], [np.cos(a), -np.sin(a), 0.0], [0.0, 0.0, 0.0]])


# -- preset curvature and its derivative -------------------------------------------------------------------------------


def precurvature(t, sigma, side):
    """``u*`` and ``du*/dsigma`` of a tube; at a step from the right (``side = 1``) or the left (``-1``)."""
    begin = 0.0
    for k, piece in enumerate(t.precurvature):
        end = begin + piece.length
        inside = sigma < end - 1e-12 if side > 0 else sigma <= end + 1e-12
        if inside or k == len(t.precurvature) - 1:
            return _piece(piece, sigma - begin)
        begin = end
    raise AssertionError


def _piece(piece, x):
    if isinstance(piece, ctr.Straight):
        return np.zeros(3), np.zeros(3)
    if isinstance(piece, ctr.Arc):
        return np.array(piece.curvature), np.zeros(3)
    if isinstance(piece, ctr.PolynomialCurvature):
        polynomial = np.polynomial.Polynomial
        rows = [polynomial(column) for column in piece.coefficients.T]
        q = x / piece.length
        return np.array([p(q) for p in rows]), np.array([p.deriv()(q) for p in rows]) / piece.length
    spline = CubicSpline(piece.arc_length, piece.curvature)
    return spline(x), spline(x, 1)


# -- the equations -----------------------------------------------------------------------------------------------------


class Paper:
    """Equations (2), (12), (19), (20) of a solved robot's tubes and loads."""

    def __init__(self, result):
        self.tubes = result.robot.tubes
        self.beta = result.actuation.translations
        self.ends = tube_ends(result.robot, result.actuation)
        self.K = [np.diag([t.bending_stiffness, t.bending_stiffness, t.torsional_stiffness]) for t in self.tubes]
        self.points, self.intervals = point_loads(result), intervals(result)
        self.breaks = break_points(result)

    def star(self, i, s, side):
        return precurvature(self.tubes[i], s - self.beta[i], side)

    def present(self, s, side):
        return [i for i, end in enumerate(self.ends) if (s < end - 1e-12 if side > 0 else s <= end + 1e-12)]

    def force_beyond(self, s, side):
        """The force that acts on ``[s, l]``: the integral of f in (19), point forces included."""
        total = sum((F for at, _, F, _ in self.points if (at > s + 1e-12 if side > 0 else at > s - 1e-12)), np.zeros(3))
        for start, end, _, force, _, knots in self.intervals:
            if s < end:
                total = total + gauss(force, max(s, start), end, knots)
        return total

    def rates(self, s, y, tubes, middle):
        """Derivative of ``(r, R_1, u_1x, u_1y, u_z of the tubes present, theta_i, n)``; ``middle``: which section."""
        count = len(tubes)
        R = y[3:12].reshape(3, 3)
        u1 = np.array([y[12], y[13], y[14]])
        uz, theta, n = y[14 : 14 + count], y[14 + count : 14 + 2 * count], y[14 + 2 * count :]
        side = 1 if s < middle else -1
        f, couples = np.zeros(3), np.zeros((len(self.tubes), 3))
        for start, end, i, force, moment, _ in self.intervals:
            if start < middle < end:
                f, couples[i] = f + force(s), couples[i] + moment(s)
        dtheta = uz - uz[0]  # (12)
        total, right, duz = np.zeros((3, 3)), np.zeros(3), np.zeros(count)
        for k, i in enumerate(tubes):
            K, Rt = self.K[i], Rz(theta[k])
            star, dstar = self.star(i, s, side)
            u = Rt.T @ u1 + dtheta[k] * E3  # (11)
            total += K
            right += Rt @ (K @ (dtheta[k] * dRz(theta[k]).T @ u1 - dstar) + hat(u) @ K @ (u - star))  # (19)
            EI, GJ = K[0, 0], K[2, 2]
            duz[k] = dstar[2] + EI / GJ * (u[0] * star[1] - u[1] * star[0]) - E3 @ (R @ Rt).T @ couples[i] / GJ  # (20)
        right += hat(E3) @ R.T @ n + R.T @ couples.sum(axis=0)
        du = -right[:2] / total[0, 0]
        return np.concatenate((R @ E3, (R @ hat(u1)).ravel(), du, duz, dtheta, -f))  # (2)

    def bending(self, y, s, side, tubes):
        """Sum of the tubes' bending moments in the frame R_1."""
        count, total = len(tubes), np.zeros(2)
        for k, i in enumerate(tubes):
            Rt = Rz(y[14 + count + k])
            u = Rt.T @ np.array([y[12], y[13], 0.0])
            total += (Rt @ self.K[i] @ (u - self.star(i, s, side)[0]))[:2]
        return total

    def torsional(self, y, s, side, tubes):
        return {i: self.K[i][2, 2] * (y[14 + k] - self.star(i, s, side)[0][2]) for k, i in enumerate(tubes)}

    def cross(self, y, s, before):
        """From one section into the next (II-G): the new state, the new tubes, and what tubes ending here keep."""
        after, count = self.present(s, 1), len(before)
        R = y[3:12].reshape(3, 3)
        theta = dict(zip(before, y[14 + count : 14 + 2 * count], strict=True))
        here = [(i, F, M) for at, i, F, M in self.points if abs(at - s) <= 1e-12]
        moment = self.bending(y, s, -1, before) - sum(((R.T @ M)[:2] for _, _, M in here), np.zeros(2))
        torsional = self.torsional(y, s, -1, before)
        for i, _, M in here:
            torsional[i] -= (R.T @ M)[2]
        left = {i: torsional[i] for i in before if i not in after}
        n = y[14 + 2 * count :] - sum((F for _, F, _ in here), np.zeros(3))
        if not after:
            return None, after, left, moment
        turn = theta[after[0]]
        stiffness = sum(self.K[i][0, 0] for i in after)
        carried = sum((Rz(theta[i]) @ self.K[i] @ self.star(i, s, 1)[0])[:2] for i in after)
        u = Rz(turn).T[:2, :2] @ ((moment + carried) / stiffness)
        uz = [torsional[i] / self.K[i][2, 2] + self.star(i, s, 1)[0][2] for i in after]
        angles = [theta[i] - turn for i in after]
        return np.concatenate((y[:3], (R @ Rz(turn)).ravel(), u, uz, angles, n)), after, left, moment

    def integrate(self, y, points):
        """Rows ``(s, tubes, state)`` at the points, and what is left of the moments where tubes end."""
        tubes, rows, residuals = self.present(0.0, 1), [], []
        for a, b in pairwise(self.breaks):
            inside = points[(points > a + 1e-9) & (points < b - 1e-9)]
            middle = 0.5 * (a + b)
            found = solve_ivp(
                self.rates, (a, b), y, "DOP853", [*inside, b], args=(tubes, middle), rtol=1e-12, atol=1e-13
            )
            assert found.success
            rows += [(s, tubes, state) for s, state in zip(inside, found.y.T, strict=False)]
            y, tubes, left, moment = self.cross(found.y[:, -1], b, tubes)
            residuals += list(left.values())
        return rows, np.array(residuals), moment


def start_of(result):
    """The paper's state at ``s = 0`` out of the package's answer there."""
    tubes = [i for i, end in enumerate(tube_ends(result.robot, result.actuation)) if end > 0.0]
    psi = np.array([result.tube_angle(i, 0.0) for i in tubes])
    u = Rz(psi[0]).T @ result.curvature(0.0)
    uz = [result.torsion(i, 0.0) for i in tubes]
    base = result.robot.base_pose
    n = Paper(result).force_beyond(0.0, 1)
    return np.concatenate((base[:3, 3], (base[:3, :3] @ Rz(psi[0])).ravel(), u[:2], uz, psi - psi[0], n))


# -- robots ------------------------------------------------------------------------------------------------------------


def _helical():
    made = robot(
        tube("inner", [ctr.Straight(0.06), ctr.Arc(0.1, [14.0, 3.0, 6.0])], 0.012, 0.009),
        tube("outer", [ctr.Straight(0.02), ctr.Arc(0.07, [5.0, -4.0, -8.0])], 0.03, 0.022),
    )
    # Both drawn back into their curved, twisted parts.
    return made, ctr.Actuation([0.4, -1.1], [-0.08, -0.03]), []


def _named_moments():
    rows = [[4.0, 9.0, 1.0], [3.0, -8.0, 0.5], [-5.0, 6.0, 0.0]]
    s = np.linspace(0.0, 0.07, 5)
    samples = np.column_stack((6 + 40 * s, 3 * np.cos(30 * s), 2 * np.sin(20 * s)))
    made = robot(
        tube("inner", [ctr.Straight(0.12), ctr.PolynomialCurvature(0.08, rows)], 0.01, 0.008),
        tube("middle", [ctr.Straight(0.07), ctr.SampledCurvature(s, samples)], 0.018, 0.013),
        tube("outer", [ctr.Straight(0.03), ctr.Arc(0.05, [7.0, 0.0, 0.0])], 0.035, 0.03),
    )
    loads = [
        ctr.PointWrench([0.3, -0.2, 0.1], [0.004, 0.002, 0.01]),
        ctr.PointWrench([0.0, 0.5, 0.0], [0.003, -0.004, -0.012], arc_length=0.045, tube=1),
        ctr.PointWrench([-0.2, 0.0, 0.3], [0.0, 0.006, 0.015], tube=2),
        ctr.DistributedLoad([2.0, 1.0, -3.0], [0.03, 0.05, 0.12], start=0.01, end=0.05, tube=1),
        ctr.DistributedLoad(([0.0, 0.03, 0.06], [[0, 0, 1], [2, 4, 0], [1, 0, 0]]), [0.02, 0.0, -0.1], tube=2),
        ctr.DistributedLoad(lambda x: [np.sin(30 * x), 0.0, 2.0], lambda x: [0.0, 0.05 * x, 0.2], start=0.02),
    ]
    return made, ctr.Actuation([0.2, 1.3, -0.8], [-0.06, -0.04, -0.015]), loads


def _outer_reaches_furthest():
    made = robot(
        tube("inner", [ctr.Straight(0.04), ctr.Arc(0.03, [10.0, 2.0, 3.0])], 0.01, 0.008),
        tube("outer", [ctr.Straight(0.02), ctr.PolynomialCurvature(0.09, [[8, 1, 0], [-3, 5, 4]])], 0.02, 0.014),
    )
    loads = [
        ctr.PointWrench([0.2, 0.4, -0.1], [0.01, 0.0, 0.012], tube=0),
        ctr.PointWrench([-0.5, 0.3, 0.2], [0.0, 0.01, -0.015], tube=1),
    ]
    return made, ctr.Actuation([1.0, -0.7], [-0.03, -0.025]), loads


def _wrench_at_the_entry():
    made = robot(tube("only", [ctr.Straight(0.03), ctr.Arc(0.08, [9.0, 0.0, 5.0])]))
    loads = [ctr.PointWrench([1.0, 2.0, 3.0], [0.02, 0.01, 0.03], arc_length=0.0), ctr.PointWrench([0.5, 0.2, 0.1])]
    return made, ctr.Actuation([0.3], [-0.04]), loads


def _random(seed, n):
    return lambda: random_problem(np.random.default_rng(seed), n, load=1.5, most_loads=5, pose=True)


PROBLEMS = {
    "helical arcs, drawn back": _helical,
    "moments on named tubes": _named_moments,
    "outer tube reaches furthest": _outer_reaches_furthest,
    "wrench at the entry": _wrench_at_the_entry,
    "random, 1 tube": _random(1, 1),
    "random, 2 tubes": _random(2, 2),
    "random, 3 tubes": _random(3, 3),
    "random, 4 tubes": _random(4, 4),
    "random, 4 tubes, other loads": _random(9, 4),
}


@pytest.mark.parametrize("name", some_slow(list(PROBLEMS), set(PROBLEMS) - {"random, 4 tubes, other loads"}))
def test_curvature_form_gives_the_same_robot(name):
    made, actuation, loads = PROBLEMS[name]()
    result = ctr.ForwardProblem(made, tolerance=1e-11).solve(actuation, loads)
    paper = Paper(result)
    points = np.linspace(0.0, result.length, 17)[1:-1]
    rows, torsional, bending = paper.integrate(start_of(result), points)
    # Both integrate from the same start: 1e-11 of the length and 1e-12 relative, amplified along the robot by at most
    # ten or so. Curvatures and torsions (about 10/m) have no tolerance of their own and are asked for nine digits.
    assert len(rows) >= 10
    for s, tubes, y in rows:
        np.testing.assert_allclose(result.position(s), y[:3], atol=1e-10 * result.length)
        R = y[3:12].reshape(3, 3)
        for k, i in enumerate(tubes):
            theta = y[14 + len(tubes) + k]
            np.testing.assert_allclose(result.pose(s, i)[:3, :3], R @ Rz(theta), atol=1e-9)
            assert result.torsion(i, s) == pytest.approx(y[14 + k], abs=1e-8)
            assert result.tube_angle(i, s) - result.tube_angle(tubes[0], s) == pytest.approx(theta, abs=1e-9)
        bent = Rz(result.tube_angle(tubes[0], s)).T @ result.curvature(s)
        np.testing.assert_allclose(bent[:2], y[12:14], atol=1e-8)
    # The tip conditions: nothing is left of the moments, in units of EI / length.
    unit = max(t.bending_stiffness for t in made.tubes) / result.length
    assert len(torsional) == len(made.tubes)
    np.testing.assert_allclose(torsional / unit, 0.0, atol=1e-9)
    np.testing.assert_allclose(bending / unit, 0.0, atol=1e-9)


@pytest.mark.parametrize("name", PROBLEMS)
def test_tubes_twist_freely_behind_the_entry(name):
    """``psi_i(0)`` is the base rotation and the twist of the straight part, u*_z of the drawn-back part included."""
    made, actuation, loads = PROBLEMS[name]()
    result = ctr.ForwardProblem(made, tolerance=1e-11).solve(actuation, loads)
    for i, t in enumerate(made.tubes):
        here = sum(M @ made.base_pose[:3, 2] for s, j, _, M in point_loads(result) if s == 0.0 and j == i)
        star = precurvature(t, -actuation.translations[i], 1)[0][2]
        torque = t.torsional_stiffness * (result.torsion(i, 0.0) - star) + here
        pieces = np.cumsum([piece.length for piece in t.precurvature])
        knots = [
            p.arc_length + e - p.length for p, e in zip(t.precurvature, pieces, strict=True) if hasattr(p, "arc_length")
        ]
        cuts = [*pieces, *np.concatenate(knots)] if knots else pieces
        preset = gauss(lambda x, t=t: precurvature(t, x, 1)[0], 0.0, -actuation.translations[i], cuts)[2]
        expected = actuation.rotations[i] - actuation.translations[i] * torque / t.torsional_stiffness + preset
        # Exact but for rounding: both come from the same base torque.
        assert result.tube_angle(i, 0.0) == pytest.approx(expected, abs=1e-12)


def test_equation_9_for_one_tube():
    """II-D: one precurved rod, all three components of its curvature, force and moment along it."""
    EI, GJ, length = 0.02, 0.014, 0.12
    made = robot(tube("rod", ctr.PolynomialCurvature(length, [[6, 2, 3], [-4, 9, -5], [2, 0, 1]]), EI, GJ))
    loads = [ctr.DistributedLoad([3.0, -2.0, 4.0], [0.1, 0.05, 0.15]), ctr.PointWrench([0.2, 0.4, -0.3])]
    result = ctr.ForwardProblem(made, tolerance=1e-11).solve(held(), loads)
    K = np.diag([EI, EI, GJ])
    polynomials = [np.polynomial.Polynomial(c) for c in made.tubes[0].precurvature[0].coefficients.T]

    def rates(s, y):
        R, u = y[3:12].reshape(3, 3), y[12:15]
        star = np.array([p(s / length) for p in polynomials])
        slope = np.array([p.deriv()(s / length) for p in polynomials]) / length
        beyond = loads[1].force + loads[0].force * (length - s)
        du = slope - np.linalg.solve(K, hat(u) @ K @ (u - star) + hat(E3) @ R.T @ beyond + R.T @ loads[0].moment)
        return np.concatenate((R @ E3, (R @ hat(u)).ravel(), du))

    u0 = result.curvature(0.0) + np.array([0.0, 0.0, result.torsion(0, 0.0)])
    s = np.linspace(0.0, length, 9)
    start = np.concatenate((np.zeros(3), np.eye(3).ravel(), u0))
    found = solve_ivp(rates, (0.0, length), start, "DOP853", s, rtol=1e-12, atol=1e-13)
    # As above.
    np.testing.assert_allclose(result.position(s), found.y[:3].T, atol=1e-10 * length)
    np.testing.assert_allclose(result.pose(s, 0)[:, :3, :3].reshape(-1, 9), found.y[3:12].T, atol=1e-9)
    np.testing.assert_allclose(result.torsion(0, s), found.y[14], atol=1e-8)
    end = np.array([p(1.0) for p in polynomials])
    np.testing.assert_allclose(K @ (found.y[12:, -1] - end), 0.0, atol=1e-9 * EI / length)
