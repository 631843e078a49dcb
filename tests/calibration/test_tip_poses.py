"""A robot's calibration from a thousand poses of a sensor at its tip: the table, the fit, the hold-out, the report."""

import re
from pathlib import Path
from time import perf_counter

import numpy as np
import pytest
from click.testing import CliRunner
from scipy.spatial.transform import Rotation

import ctr_opt as ctr
from benchmarks.calibration_data import TIP_POSES, tip_poses
from ctr_opt.cli import cli
from ctr_opt.files.calibration import load_calibration
from ctr_opt.files.calibration_page import hold_out_table

SIGMA = {"sigma": 0.5e-3, "direction_sigma": 0.01}


@pytest.fixture(scope="module")
def given():
    return load_calibration(TIP_POSES)


@pytest.fixture(scope="module", autouse=True)
def compiled(given):
    """Compiled code is used without asking for it, as outside of the tests, and is there from the start."""
    with pytest.MonkeyPatch.context() as patch:
        patch.delenv("CTR_OPT_COMPILE")
        ctr.ForwardProblem(given.robot).compile()
        yield


@pytest.fixture(scope="module")
def fit(given):
    begin = perf_counter()
    found = given.problem("squared").solve()
    assert perf_counter() - begin < 30.0
    return found


@pytest.fixture(scope="module")
def held(given, fit):
    return fit.tested(given.held)


def test_the_truth_is_recovered(given, fit):
    """Within four standard errors, each; a sensor that shows its axis alone may be turned about it."""
    assert [str(each) for each in fit.undetermined] == ["sensors.coil.rotation.z is not determined"]
    assert fit.noise_accepted
    truth = given.truth["values"]
    assert set(truth) == set(fit.values)
    for name, value in fit.values.items():
        apart = (value - np.array(truth[name])) / fit.standard_errors[name]
        assert np.nanmax(np.abs(apart)) < 4.0, name
    errors = fit.standard_errors
    assert max(errors[f"tubes[{i}].translation_offset"] for i in range(3)) < 0.2e-3
    assert max(errors[f"tubes[{i}].rotation_offset"] for i in range(3)) < np.deg2rad(0.3)


def by_hand(given, fit, experiments):
    """Predicted minus measured positions (n, 3) in mm and angles (n,) in degrees, from forward solves alone."""
    values, problem = fit.values, ctr.ForwardProblem(fit.robot)
    a, b, _ = values["sensors.coil.rotation"]
    axis = Rotation.from_euler("XY", [a, b]).apply([0.0, 0.0, 1.0])
    homes = [[values[f"tubes[{i}].{kind}_offset"] for i in range(3)] for kind in ("rotation", "translation")]
    errors, angles = [], []
    for each in experiments:
        point, direction = each.measurements
        joints = each.actuation.rotations + homes[0], each.actuation.translations + homes[1]
        frame = problem.solve(ctr.Actuation(*joints)).tip_pose
        tip = frame[:3, :3] @ values["sensors.coil.translation"] + frame[:3, 3]
        errors.append(1e3 * (tip - point.position[0]))
        angles.append(np.rad2deg(np.arccos(direction.direction @ frame[:3, :3] @ axis)))
    return np.array(errors), np.array(angles)


def test_what_is_held_out_is_predicted(given, fit, held):
    """Statistics of the table as computed by hand, to its digits; nothing of it was fitted; errors as of the noise."""
    assert len(given.held) == 200
    assert not {each.name for each in given.held} & {each.name for each in given.experiments}
    assert {each.name for each in given.held} == {each.name for each in load_calibration(TIP_POSES).held}
    lines = hold_out_table(fit, held)
    for experiments, title in ((given.experiments, "fitted"), (given.held, "held out")):
        errors, angles = by_hand(given, fit, experiments)
        sizes = np.linalg.norm(errors, axis=1)
        (point,) = [line for line in lines if line.startswith(f"| tip (coil), {title} [mm]")]
        reported = [float(x) for x in re.findall(r"[-+]?\d+\.\d+", point)]
        axes = [f(axis) for axis in errors.T for f in (np.mean, np.std)]
        np.testing.assert_allclose(reported, [sizes.mean(), sizes.std(), sizes.max(), *axes], rtol=0.0, atol=6e-4)
        (line,) = [line for line in lines if line.startswith(f"| direction, tip (coil), {title} [deg]")]
        reported = [float(x) for x in re.findall(r"\d+\.\d+", line)]
        np.testing.assert_allclose(reported, [angles.mean(), angles.std(), angles.max()], rtol=0.0, atol=6e-4)
        assert sizes.mean() == pytest.approx(
            2.0 * 0.5 * np.sqrt(2.0 / np.pi), rel=0.1
        )  # Maxwell's, of 200 to 7 percent


def test_the_data_are_what_their_truth_gives(given):
    """To the 1e-3 mm and 1e-3 that are written."""
    every = sorted([*given.experiments, *given.held], key=lambda each: int(each.name.split()[1]))
    for a, b in zip(tip_poses(given), every, strict=True):
        np.testing.assert_allclose(a.measurements[0].position, b.measurements[0].position, atol=0.51e-6)
        np.testing.assert_allclose(a.measurements[1].direction, b.measurements[1].direction, atol=1.1e-3)
        np.testing.assert_allclose(a.actuation.rotations, b.actuation.rotations, atol=1e-12)


@pytest.mark.slow
def test_command_and_report(tmp_path):
    done = CliRunner().invoke(cli, ["calibrate", str(TIP_POSES), "--report", str(tmp_path)], catch_exceptions=False)
    assert done.exit_code == 0
    page = (tmp_path / "report.md").read_text("utf-8")
    for text in ("800 experiments, 200 others held out", "| tip (coil), held out [mm] | 200 |"):
        assert text in done.output
    for text in (
        "1000 experiments, none of them loaded",
        "200, drawn at random (seed 1), are held out of the fit",
        "## Prediction of the held-out experiments: weighted least squares",
        "| sensors.coil.translation.z [mm] | 0 |",
        "- sensors.coil.rotation.z is not determined",
    ):
        assert text in page
    assert {path.name for path in tmp_path.iterdir()} == {"report.md", "errors.png", "fit_squared.png"}


# -- tables -----------------------------------------------------------------------------------------------------------


JOINTS = "rotation_0 [deg],translation_0 [mm]"
QUATERNION = "tip_qw,tip_qx,tip_qy,tip_qz"


def read(tmp_path, header, *rows, **settings):
    file = tmp_path / "table.csv"
    file.write_text("\n".join([f"{JOINTS},{header}", *rows]) + "\n", "utf-8")
    return ctr.read_experiments(file, 1, **(SIGMA | settings))


def test_orientations_as_quaternions(tmp_path):
    """A quarter turn about y takes the frame's z to the world's x; a row without orientation is a position."""
    half = np.sqrt(0.5)
    rows = [f"10,-20,1,2,3,{half:.5f},0,{half:.5f},0", "10,-20,1,2,3,,,,"]
    turned, point = read(tmp_path, f"tip_x [mm],tip_y [mm],tip_z [mm],{QUATERNION}", *rows, sensor="coil")
    (pose,) = turned.measurements
    np.testing.assert_allclose(pose.pose[:3, 2], [1.0, 0.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(pose.pose[:3, 3], [1e-3, 2e-3, 3e-3], rtol=1e-12)
    np.testing.assert_allclose(np.diagonal(pose.whitener[0]), [2e3] * 3 + [1e2] * 3, rtol=1e-12)
    assert isinstance(point.measurements[0], ctr.PositionMeasurement)
    assert [each.measurements[0].sensor for each in (turned, point)] == ["coil", "coil"]


def test_a_sensor_is_at_the_tip_alone(tmp_path):
    """The entry is measured by itself."""
    header = "base_x,base_y,base_z,tip_x [mm],tip_y [mm],tip_z [mm],direction_x,direction_y,direction_z"
    (each,) = read(tmp_path, header, "0,0,0,0,0,1,2,3,0,0,4", sensor="coil")
    kinds = [(type(m), m.sensor) for m in each.measurements]
    assert kinds == [
        (ctr.PositionMeasurement, None),
        (ctr.PositionMeasurement, "coil"),
        (ctr.TangentMeasurement, "coil"),
    ]


TIP = "tip_x,tip_y,tip_z"


@pytest.mark.parametrize(
    ("header", "row", "settings", "message"),
    [
        (f"{TIP},tip_qw", "0,0,0,0,0,1", {}, "column 'tip_qx' is missing"),
        (QUATERNION, "0,0,1,0,0,0", {}, "column 'tip_x' is missing"),
        (f"{TIP},{QUATERNION}", "0,0,,,,1,0,0,0", {}, "line 2: tip_qw needs tip_x, tip_y and tip_z"),
        (
            f"{TIP},{QUATERNION}",
            "0,0,0,0,1,1,1,0,0",
            {},
            r"line 2: tip_qw, ... = \[1.0, 1.0, 0.0, 0.0\] must have a norm",
        ),
        (
            f"{TIP},{QUATERNION}",
            "0,0,0,0,1,1,0,0,0",
            {"sigma": None},
            "sigma must be given for both positions and directions",
        ),
        (f"{TIP},{QUATERNION},direction_x,direction_y,direction_z", "0" + 11 * ",0", {}, "not by both"),
        (TIP, "0,0,0,0,1", {"sensor": "my coil"}, "line 2: sensor = 'my coil' must be a name"),
    ],
)
def test_wrong_tables(tmp_path, header, row, settings, message):
    with pytest.raises(ctr.DefinitionError, match=message):
        read(tmp_path, header, row, **settings)


def elsewhere(text, folder):
    """A calibration file with that text, which finds the robot and the table of the problem."""
    for name in ("robot_b.toml", "tip_poses.csv"):
        text = text.replace(f'"{name}"', f'"{(TIP_POSES.parent / name).as_posix()}"')
    (folder / "file.toml").write_text(text, "utf-8")
    return folder / "file.toml"


def test_the_file_in_the_docs_is_one(tmp_path):
    (text,) = re.findall(r"```toml\n(.*?)```", Path("docs/how_to/calibration.md").read_text("utf-8"), re.S)
    found = load_calibration(elsewhere(text.replace('"robot.toml"', '"robot_b.toml"'), tmp_path))
    assert len(found.held) == 200
    assert found.parameters[2] == ctr.Parameter("precurvature of tube 0", tied="tubes[0].precurvature[1].curvature")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (("share = 0.2", "share = 1.2"), r"hold_out.share = 1.2 must be"),
        (("share = 0.2", "share = 0.0001"), "must hold out at least one"),
        (("seed = 1\n", ""), r"hold_out.seed is missing"),
        (('sensor = "coil"', 'sensor = "ring"'), "no measurement has a sensor 'coil'; measured sensors: 'ring'"),
        (('tied = ["tubes[0]', 'prior = 1.0, tied = ["tubes[0]'), "file.toml: prior = 1.0 must be a pair"),
        (("{ name = ", "{ nme = "), r"parameters\[11\]: unknown key 'nme'; did you mean 'name'"),
    ],
)
def test_wrong_calibrations(tmp_path, change, message):
    file = elsewhere(TIP_POSES.read_text("utf-8").replace(*change, 1), tmp_path)
    with pytest.raises(ctr.DefinitionError, match=message):
        load_calibration(file)
