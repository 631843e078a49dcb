"""Closed forms and high-precision answers for rods and tube pairs; ``data/benchmarks.json`` names their sources."""

import numpy as np
import pytest
from scipy.interpolate import BarycentricInterpolator

import ctr_opt as ctr
from tests.support.physics import data, held, robot, rod, tube

REFERENCE = data("benchmarks.json")
L, EI, GJ = 0.1, 0.02, 0.015

# `tolerance=1e-10` bounds the estimated position error by 1e-10 of the length, so positions are good to nine digits
# after the point (in units of the length) with a factor of ten to spare; RK8 usually leaves 1e-12. Angles and
# curvatures have no bound of their own; they come from the same states, so the same nine digits are asked of them.
TIGHT = 1e-10
NINE = 1e-9
# The default promises 1e-7 of the length.
DEFAULT = 1e-7


def solve(made, loads=(), initial=None, actuation=None, **options):
    problem = ctr.ForwardProblem(made, **{"tolerance": TIGHT, **options})
    return problem.solve(actuation or held(len(made.tubes)), loads, initial)


def numbers(row):
    return {key: float(value) for key, value in row.items()}


# -- cantilevers -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("options", [{}, {"formulation": "energy"}, {"integrator": "RK5"}], ids=str)
@pytest.mark.parametrize("row", REFERENCE["cantilever_tip_dead_force"]["rows"], ids=lambda row: row["PL2_over_EI"])
def test_cantilever_under_a_dead_tip_force(row, options):
    row = numbers(row)
    result = solve(rod(L, EI, GJ), [ctr.PointWrench([row["PL2_over_EI"] * EI / L**2, 0, 0])], **options)
    x, y, z = result.tip_position / L
    assert x == pytest.approx(row["tip_transverse_w_over_L"], abs=NINE)
    assert 1.0 - z == pytest.approx(row["tip_shortening_u_over_L"], abs=NINE)
    assert abs(y) < NINE
    tangent = result.tip_pose[:3, 2]
    assert np.arctan2(tangent[0], tangent[2]) == pytest.approx(row["tip_angle_rad"], abs=NINE)
    assert result.curvature(0.0)[1] * L == pytest.approx(row["base_curvature_times_L"], rel=NINE)


@pytest.mark.parametrize("row", REFERENCE["cantilever_tip_dead_force"]["rows"], ids=lambda row: row["PL2_over_EI"])
def test_the_default_tolerance_keeps_its_promise_on_the_cantilever(row):
    row = numbers(row)
    result = solve(rod(L, EI, GJ), [ctr.PointWrench([row["PL2_over_EI"] * EI / L**2, 0, 0])], tolerance=DEFAULT)
    exact = np.array([row["tip_transverse_w_over_L"], 0.0, 1.0 - row["tip_shortening_u_over_L"]]) * L
    error = np.linalg.norm(result.tip_position - exact)
    assert error <= DEFAULT * L
    assert error <= result.discretization_error


def test_cantilever_under_a_uniform_dead_load():
    row = numbers(REFERENCE["cantilever_uniform_dead_load"]["rows"][0])
    result = solve(rod(L, EI, GJ), [ctr.DistributedLoad([0, row["qL3_over_EI"] * EI / L**3, 0])])
    tangent = result.tip_pose[:3, 2]
    assert result.tip_position[2] / L == pytest.approx(row["x_over_L"], abs=NINE)
    assert result.tip_position[1] / L == pytest.approx(row["y_over_L"], abs=NINE)
    assert np.arctan2(tangent[1], tangent[2]) == pytest.approx(row["tip_angle_rad"], abs=NINE)
    # A load toward +y bends toward +y: u_x < 0 by the convention of the precurvature.
    assert -result.curvature(0.0)[0] * L == pytest.approx(row["base_curvature_times_L"], rel=NINE)


@pytest.mark.parametrize("theta", [np.pi / 2, np.pi, 2 * np.pi, 4 * np.pi], ids=lambda t: f"{t / np.pi:g} pi")
def test_cantilever_rolled_up_by_an_end_moment(theta):
    # Simo and Vu-Quoc 1986, 7.1: EI = 2, L = 1, M = 8 pi is the double circle.
    result = solve(rod(1.0, 2.0, 1.5), [ctr.PointWrench(moment=[0, 2.0 * theta, 0])])
    expected = [(1.0 - np.cos(theta)) / theta, 0.0, np.sin(theta) / theta]
    np.testing.assert_allclose(result.tip_position, expected, atol=NINE)
    # A circle all along, not at the tip alone.
    s = np.linspace(0.0, 1.0, 23)
    arc = np.column_stack((1.0 - np.cos(theta * s), 0.0 * s, np.sin(theta * s))) / theta
    np.testing.assert_allclose(result.position(s), arc, atol=NINE)


def test_kirchhoff_helix_of_an_initially_straight_rod():
    given, expected = REFERENCE["kirchhoff_helix"]["inputs"], REFERENCE["kirchhoff_helix"]["expected"]
    bending, torsional = float(given["EI"]), float(given["GJ"])
    made = rod(float(given["L"]), bending, torsional)
    wrench = ctr.PointWrench([float(x) for x in given["tip_force"]], [float(x) for x in given["tip_moment"]])
    kappa, twist = float(given["curvature"]), float(given["material_twist"])
    # Such a wrench has several equilibria: start three percent off the base moments of the helix.
    problem = ctr.ForwardProblem(made, tolerance=TIGHT)
    start = problem.guess(held(), [wrench], bending=[0.0, 1.03 * bending * kappa], torsional=[0.97 * torsional * twist])
    result = problem.solve(held(), [wrench], start)
    # The reference has 16 digits; 1e-10 of the length is 2e-11 m, a tenth of what is asked here.
    np.testing.assert_allclose(result.tip_position, [float(x) for x in expected["tip"]], atol=2e-10)
    np.testing.assert_allclose(result.tip_pose[:3, 2], [float(x) for x in expected["tip_tangent"]], atol=NINE)
    np.testing.assert_allclose(
        result.internal_moment(0.0), [float(x) for x in expected["base_moment_world"]], atol=NINE * bending * kappa
    )
    s = np.linspace(0.0, result.length, 9)
    np.testing.assert_allclose(np.linalg.norm(result.curvature(s), axis=1), kappa, rtol=NINE)
    np.testing.assert_allclose(result.torsion(0, s), twist, rtol=NINE)


def test_compliance_of_a_straight_rod_under_small_loads():
    made = rod(L, EI, GJ)

    def tip(**wrench):
        return solve(made, [ctr.PointWrench(**wrench)])

    # Odd in the load: central differences have an error h^2, their Richardson combination h^4 = (1e-2)^4 times a
    # coefficient below one, where h is the load in units of EI/L^2; rounding adds 1e-12 / 1e-2.
    h = 1e-2 * EI / L**2

    def slope(of, load):
        coarse, fine = ((of(load(k)) - of(load(-k))) / (2 * k) for k in (h, h / 2))
        return (4 * fine - coarse) / 3

    def angle(result):
        tangent = result.tip_pose[:3, 2]
        return np.arctan2(tangent[0], tangent[2])

    assert slope(lambda r: r.tip_position[0], lambda k: tip(force=[k, 0, 0])) == pytest.approx(
        L**3 / (3 * EI), rel=1e-8
    )
    assert slope(angle, lambda k: tip(force=[k, 0, 0])) == pytest.approx(L**2 / (2 * EI), rel=1e-8)
    # Twisting is linear, so one load of any size will do; rounding of the solved moments remains.
    twisted = tip(moment=[0, 0, 3e-3])
    assert twisted.tube_angle(0, L) == pytest.approx(3e-3 * L / GJ, rel=1e-11)
    # A pull along a straight rod moves nothing at all.
    np.testing.assert_allclose(tip(force=[0, 0, 1.0]).tip_position, [0, 0, L], atol=1e-15)


# -- one precurved tube ------------------------------------------------------------------------------------------------


def test_unloaded_arc_is_its_circle():
    k = 12.0
    result = solve(rod(L, EI, GJ, [0, k, 0]))
    s = np.linspace(0.0, L, 11)
    circle = np.column_stack(((1 - np.cos(k * s)) / k, 0 * s, np.sin(k * s) / k))
    np.testing.assert_allclose(result.position(s), circle, atol=NINE * L)
    assert result.energy == pytest.approx(0.0, abs=1e-15)


def test_scalar_curvature_bends_toward_minus_y():
    k = 12.0
    result = solve(rod(L, EI, GJ, k))
    np.testing.assert_allclose(result.tip_position, [0, -(1 - np.cos(k * L)) / k, np.sin(k * L) / k], atol=NINE * L)


def test_tip_moment_straightens_an_arc():
    k = 12.0
    result = solve(rod(L, EI, GJ, [0, k, 0]), [ctr.PointWrench(moment=[0, -EI * k, 0])])
    np.testing.assert_allclose(result.tip_position, [0, 0, L], atol=NINE * L)
    np.testing.assert_allclose(result.curvature(np.linspace(0, L, 5)), 0.0, atol=NINE * k)
    assert result.energy == pytest.approx(0.5 * EI * k**2 * L, rel=NINE)


def test_unloaded_helix():
    k, t = 12.0, 8.0
    result = solve(rod(0.2, EI, GJ, [0, k, t]))
    # Curvature k, torsion t: R(s) = expm(s hat(0, k, t)) and p = integral of R e3, by Rodrigues' formula.
    w = np.hypot(k, t)
    axis = np.array([0.0, k, t]) / w
    e3 = np.array([0.0, 0.0, 1.0])
    s = np.linspace(0.0, 0.2, 9)[:, None]
    helix = (
        np.sin(w * s) / w * (e3 - axis * axis[2]) + s * axis * axis[2] + (1 - np.cos(w * s)) / w * np.cross(axis, e3)
    )
    np.testing.assert_allclose(result.position(s[:, 0]), helix, atol=NINE * 0.2)
    np.testing.assert_allclose(result.torsion(0, s[:, 0]), t, rtol=1e-12)


# -- two tubes ---------------------------------------------------------------------------------------------------------


def pair(K1, K2, k1, k2, g1, g2, length=L, l1=0.0, l2=0.0):
    """Two tubes of constant curvature up to the same tip, behind straight transmissions."""

    def pieces(straight, curvature):
        return [*([ctr.Straight(straight)] if straight else []), ctr.Arc(length, curvature)]

    return robot(tube("inner", pieces(l1, K1), k1, g1), tube("outer", pieces(l2, K2), k2, g2)), (l1, l2)


@pytest.mark.parametrize("sign", [1.0, -1.0], ids=["aligned", "opposed"])
def test_two_tubes_in_a_plane(sign):
    K1, K2, k1, k2 = 9.0, 5.0, 0.02, 0.03
    made, _ = pair(K1, K2, k1, k2, 0.015, 0.025)
    alpha = 0.0 if sign > 0 else np.pi
    result = solve(made, actuation=ctr.Actuation([0.0, alpha], [0.0, 0.0]))
    kappa = (k1 * K1 + sign * k2 * K2) / (k1 + k2)
    expected = [0, -(1 - np.cos(kappa * L)) / kappa, np.sin(kappa * L) / kappa]
    np.testing.assert_allclose(result.tip_position, expected, atol=NINE * L)
    s = np.linspace(0.0, L, 5)
    np.testing.assert_allclose(result.tube_angle(1, s) - result.tube_angle(0, s), alpha, atol=NINE)
    for i in (0, 1):
        np.testing.assert_allclose(result.torsion(i, s), 0.0, atol=NINE / L)


def torsion_pair(lam, transmission):
    """Two unequal tubes with ``lambda L^2`` and ``l / L`` as asked for, after the derivation in the data."""
    k1, k2, g1, g2, K1 = 0.02, 0.035, 0.015, 0.03, 8.0
    K2 = lam / L**2 / (K1 * k1 * k2 / (k1 + k2) * (1 / g1 + 1 / g2))
    l1 = 0.7 * transmission * L
    l2 = (transmission * L * (g1 + g2) - l1 * g2) / g1
    made, lengths = pair(K1, K2, k1, k2, g1, g2, l1=l1, l2=l2)
    return made, [-x for x in lengths]


@pytest.mark.parametrize(
    "row",
    REFERENCE["two_tube_torsion"]["stable"],
    ids=lambda row: f"{row['lambda_aL2']}-{row['l_over_L']}-{row['alpha_base_deg']}",
)
@pytest.mark.parametrize("formulation", ["automatic", "energy"])
def test_torsion_of_two_tubes(row, formulation):
    row = numbers(row)
    made, translations = torsion_pair(row["lambda_aL2"], row["l_over_L"])
    actuation = ctr.Actuation([0.0, np.deg2rad(row["alpha_base_deg"])], translations)
    result = solve(made, actuation=actuation, formulation=formulation)

    def angle(s):
        return result.tube_angle(1, s) - result.tube_angle(0, s)

    assert angle(0.0) == pytest.approx(row["alpha_0"], abs=NINE)
    assert angle(L) == pytest.approx(row["alpha_tip"], abs=NINE)
    assert (result.torsion(1, 0.0) - result.torsion(0, 0.0)) * L == pytest.approx(row["dalpha_ds_0_times_L"], rel=NINE)


@pytest.mark.parametrize("row", REFERENCE["two_tube_torsion"]["threshold"], ids=lambda row: row["l_over_L"])
def test_the_determinant_vanishes_where_opposed_tubes_snap(row):
    row = numbers(row)

    def determinant(lam):
        made, translations = torsion_pair(lam, row["l_over_L"])
        problem = ctr.ForwardProblem(made, tolerance=TIGHT)
        actuation = ctr.Actuation([0.0, np.pi], translations)
        # The planar shape carries no moment, so zero is the solution and not a guess.
        return problem.solve(actuation, initial=problem.guess(actuation)).determinant

    # Where the determinant is zero nothing can be solved accurately, so go around: the polynomial through six points
    # within 2.5 percent misses by the order of 0.025^6 = 2e-10. The tolerance says nothing about the Jacobian, which
    # is RK8's at the same steps: seven digits.
    beside = np.array([-0.025, -0.015, -0.005, 0.005, 0.015, 0.025])
    values = [determinant(row["lambda_crit"] * (1.0 + x)) for x in beside]
    found = BarycentricInterpolator(values, beside)(0.0)
    assert values[0] > 0.0 > values[-1]
    assert abs(found) < 1e-7


# -- buckling ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "row", REFERENCE["euler_postbuckling_cantilever"]["rows"], ids=lambda row: str(row["tip_angle_deg"])
)
def test_column_behind_its_critical_load(row):
    row = numbers(row)
    made, load = rod(L, EI, GJ), [ctr.PointWrench([0, 0, -row["PL2_over_EI"] * EI / L**2])]
    cold = solve(made, load)
    problem = ctr.ForwardProblem(made, tolerance=TIGHT)
    # m(0) = P y: a start ten percent off, in the plane x = 0.
    bending = [-1.1 * row["y_over_L"] * row["PL2_over_EI"] * EI / L, 0.0]
    near = problem.solve(held(), load, problem.guess(held(), load, bending=bending))
    for result in (cold, near):
        x, y, z = result.tip_position / L
        # The plane of buckling is arbitrary. Near the critical load the lateral distance reacts strongly to
        # everything (dy/dP grows like 1/y), which costs the row of 20 degrees less than one digit.
        assert z == pytest.approx(row["x_over_L"], abs=NINE)
        assert np.hypot(x, y) == pytest.approx(row["y_over_L"], abs=NINE)
        assert np.arccos(result.tip_pose[2, 2]) == pytest.approx(np.deg2rad(row["tip_angle_deg"]), abs=NINE)
    assert abs(near.tip_position[0]) < NINE * L


def test_column_below_its_critical_load_stays_straight():
    critical = float(REFERENCE["euler_postbuckling_cantilever"]["PcrL2_over_EI"]) * EI / L**2
    for factor, straight in ((0.999, True), (1.001, False)):
        load = [ctr.PointWrench([0, 0, -factor * critical])]
        # So close to the critical load IPOPT's own tolerance moves the shape by more than TIGHT.
        result = solve(rod(L, EI, GJ), load, formulation="energy", tolerance=DEFAULT)
        assert bool(np.hypot(*result.tip_position[:2]) < NINE * L) is straight
        assert result.stability_checked is straight  # a buckled column is neutral: it may lie in any plane


def test_greenhill_column_under_its_own_weight():
    critical = float(REFERENCE["greenhill_self_buckling"]["qL3_over_EI_critical"]) * EI / L**3
    tips = {}
    for factor in (0.99, 1.01):
        load = [ctr.DistributedLoad([0, 0, -factor * critical])]
        tips[factor] = solve(rod(L, EI, GJ), load, formulation="energy", tolerance=DEFAULT)
    assert tips[0.99].stability_checked
    np.testing.assert_allclose(tips[0.99].tip_position, [0, 0, L], atol=NINE * L)
    # One percent above, the amplitude is of the order of sqrt(0.01).
    assert np.hypot(*tips[1.01].tip_position[:2]) > 0.05 * L


# -- in space ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("formulation", ["automatic", "energy"])
def test_bathe_bolourchi_bend(formulation):
    expected = REFERENCE["bathe_bolourchi_45deg"]["cases"]["inext_300"]
    radius, stiffness = 100.0, 1e7 / 12
    pose = np.eye(4)
    pose[:3, :3] = [[1, 0, 0], [0, 0, 1], [0, -1, 0]]  # z along world y; curvature about the frame's y bends to +x
    made = rod(radius * np.pi / 4, stiffness, stiffness, [0, 1 / radius, 0], base_pose=pose)
    result = solve(made, [ctr.PointWrench([0, 0, 300.0])], formulation=formulation)
    # The reference's own integration has a relative tolerance of 1e-13; its lengths are about 80.
    np.testing.assert_allclose(result.tip_position, expected["tip"], atol=NINE * result.length)
    np.testing.assert_allclose(result.tip_pose[:3, 2], expected["tip_tangent"], atol=NINE)
    np.testing.assert_allclose(
        result.internal_moment(0.0), expected["base_moment"], atol=NINE * np.linalg.norm(expected["base_moment"])
    )
