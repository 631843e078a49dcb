"""Tables of experiments: what is given in part is refused, and nothing is lost on the way to a file and back."""

import numpy as np
import pytest

import ctr_opt as ctr

TIP = "rotation_0, translation_0, tip_x, tip_y, tip_z"
HELD = ctr.Actuation([0.1], [-0.01])


def table(path, text):
    file = path / "table.csv"
    file.write_text(text)
    return file


@pytest.mark.parametrize(
    ("header", "row", "missing"),
    [
        (", tip_x, tip_y", "0, 0.1", "tip_z"),
        (", base_force_x, base_force_y, base_force_z", "0.1, 0, 0", "base_moment_x"),
        (", base_moment_x, base_moment_y, base_moment_z", "0.1, 0, 0", "base_force_x"),
    ],
)
def test_a_missing_column_is_named(tmp_path, header, row, missing):
    file = table(tmp_path, f"rotation_0, translation_0, tube0_x, tube0_y, tube0_z{header}\n0, 0, 0, 0, 0.1, {row}\n")
    with pytest.raises(ctr.DefinitionError, match=f"column '{missing}' is missing"):
        ctr.read_experiments(file, 1)


FORCE = "force_x, force_y, force_z"
WRENCH = ", ".join(f"base_{kind}_{axis}" for kind in ("force", "moment") for axis in "xyz")


@pytest.mark.parametrize(
    ("header", "row", "empty"),
    [
        ("tube0_x, tube0_y, tube0_z", "0, , 0.1", "tube0_y"),
        ("base_x, base_y, base_z", ", 0, 0", "base_x"),
        ("direction_x, direction_y, direction_z", "0, 0, ", "direction_z"),
        ("tip_qw, tip_qx, tip_qy, tip_qz", "1, 0, , 0", "tip_qy"),
        (FORCE, "0.2, , ", "force_y"),
        (WRENCH, "0.1, , 0, 0, 0, 0", "base_force_y"),
        (WRENCH, "0.1, 0, 0, , , ", "base_moment_x"),
    ],
)
def test_a_vector_given_in_part_is_refused(tmp_path, header, row, empty):
    """With the line and the column; all of it may be empty, and was not measured."""
    whole = ", ".join([""] * len(header.split(",")))
    file = table(tmp_path, f"{TIP}, {header}\n0, 0, 0, 0, 0.1, {whole}\n0, 0, 0, 0, 0.1, {row}\n")
    with pytest.raises(ctr.DefinitionError, match=f"line 3, column '{empty}' is empty, but '.*' is given"):
        ctr.read_experiments(file, 1)
    (found,) = ctr.read_experiments(table(tmp_path, f"{TIP}, {header}\n0, 0, 0, 0, 0.1, {whole}\n"), 1)
    assert len(found.measurements) == 1
    assert not found.loads


def experiment(*measurements, loads=(), held=HELD, **own):
    return ctr.Experiment(held, loads, measurements or (ctr.PositionMeasurement(None, [0.01, 0.02, 0.1]),), **own)


TURNED = np.array([[0.0, -0.6, 0.8, 0.01], [1.0, 0.0, 0.0, 0.02], [0.0, 0.8, 0.6, 0.1], [0.0, 0.0, 0.0, 1.0]])
PLACES = [0.0, ctr.Distal(1), None]
POINTS = np.arange(9.0).reshape(3, 3) * 1e-3


def test_what_is_written_is_read(tmp_path):
    """All that a table can hold: names, joints, forces, points, directions and base wrenches, or nothing there."""
    held = ctr.Actuation([0.1, -2.0], [-0.01, -0.0123456])
    points = ctr.PositionMeasurement(PLACES, POINTS)
    direction = ctr.TangentMeasurement(None, [0.36, 0.48, 0.8])
    wrench = ctr.BaseWrenchMeasurement([0.1, -0.2, 0.3, 1e-3, -2e-3, 3e-3])
    made = [
        experiment(direction, points, wrench, held=held, name="all, of it"),
        experiment(points, held=held, loads=[ctr.PointWrench([0.1, 0.0, -0.25])]),
        experiment(direction, held=held, loads=[ctr.PointWrench([0.1, 0.0, 0.0]), ctr.PointWrench([0.0, 0.2, 0.0])]),
        experiment(wrench, held=held, name='"1"'),
    ]
    ctr.write_experiments(tmp_path / "table.csv", made, "made up\nfor a test")
    read = ctr.read_experiments(tmp_path / "table.csv", 2)
    assert [each.name for each in read] == [each.name for each in made]
    kinds = [[type(one).__name__[:2] for one in each.measurements] for each in read]
    assert kinds == [["Po", "Ta", "Ba"], ["Po"], ["Ta"], ["Ba"]]
    for each in read:
        np.testing.assert_allclose(each.actuation.rotations, held.rotations, rtol=1e-11)
        np.testing.assert_allclose(each.actuation.translations, held.translations, rtol=1e-11)
        for one in each.measurements:
            if isinstance(one, ctr.PositionMeasurement):
                assert list(one.arc_length) == PLACES
                np.testing.assert_allclose(one.position, POINTS, rtol=0.0, atol=1e-9)
            elif isinstance(one, ctr.TangentMeasurement):
                np.testing.assert_allclose(one.direction, direction.direction, rtol=0.0, atol=1e-9)
            else:
                np.testing.assert_allclose(one.wrench, wrench.wrench, rtol=0.0, atol=1e-9)
    assert [[load.force.tolist() for load in each.loads] for each in read] == [
        [], [[0.1, 0.0, -0.25]], [[0.1, 0.2, 0.0]], []
    ]  # fmt: skip


@pytest.mark.parametrize("sensor", [None, "coil"])
def test_poses_of_the_tip_are_read_as_they_are_written(tmp_path, sensor):
    made = [experiment(ctr.PoseMeasurement(None, TURNED, sensor=sensor), name="turned")]
    made.append(experiment(ctr.PositionMeasurement(None, POINTS[1], sensor=sensor), name="a point"))
    ctr.write_experiments(tmp_path / "table.csv", made, decimals=9)
    pose, point = (each.measurements[0] for each in ctr.read_experiments(tmp_path / "table.csv", 1, sensor=sensor))
    np.testing.assert_allclose(pose.pose, TURNED, rtol=0.0, atol=1e-8)
    np.testing.assert_allclose(point.position[0], POINTS[1], rtol=0.0, atol=1e-12)
    assert pose.sensor == point.sensor == sensor


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"loads": [ctr.PointWrench([1.0, 0.0, 0.0]), ctr.Gravity([0.0, 0.0, -9.81])]}, r"\.loads\[1\] = Gravity"),
        ({"loads": ctr.PointWrench(moment=[0.0, 0.0, 0.1])}, r"\.loads\[0\] = .* no moment"),
        ({"loads": ctr.PointWrench([1.0, 0.0, 0.0], arc_length=0.05)}, r"\.loads\[0\] = .* arc_length None"),
        ({"loads": ctr.PointWrench([1.0, 0.0, 0.0], tube=1)}, r"\.loads\[0\] = .* on tube 0"),
        ({"loads": ctr.PointWrench([1.0, 0.0, 0.0], frame="body")}, r"\.loads\[0\] = .* frame 'world'"),
        ({"held": ctr.Actuation([0.1] * 2, [-0.01] * 2)}, r"\.actuation: tubes = 2, but .* it was 1"),
        ({"name": "#1"}, r"\.name = '#1' must be"),
        ({"name": "one\ntwo"}, r"\.name = .* must be one line"),
        ([ctr.TorqueMeasurement(0, 0.1)], r"\.measurements\[0\]: TorqueMeasurement has no columns"),
        ([ctr.ForceMeasurement(0, 0.1)], r"\.measurements\[0\]: ForceMeasurement has no columns"),
        ([ctr.BackboneMeasurement(POINTS)], r"\.measurements\[0\]: BackboneMeasurement has no columns"),
        ([ctr.PositionMeasurement(0.05, POINTS[0])], r"\.measurements\[0\]: arc_length = 0.05 m has no column"),
        ([ctr.TangentMeasurement(ctr.Distal(0), POINTS[1])], r"\.measurements\[0\]: TangentMeasurement must be of the"),
        ([ctr.PoseMeasurement(0.05, TURNED)], r"\.measurements\[0\]: PoseMeasurement must be of the tip"),
        ([ctr.PoseMeasurement(None, TURNED, tube=1)], r"\.measurements\[0\]: PoseMeasurement must be .* of no tube"),
        (
            [ctr.PositionMeasurement(None, POINTS[0]), ctr.PositionMeasurement([0.0, None], POINTS[:2])],
            r"\.measurements\[1\]: 'tip_x \[mm\]' is measured more than once",
        ),
        (
            [ctr.PoseMeasurement(None, TURNED), ctr.PositionMeasurement(None, POINTS[0])],
            r"\.measurements\[0\]: 'tip_x \[mm\]' is measured more than once",
        ),
        ([ctr.PositionMeasurement(None, POINTS[0], sensor="coil")], r"\.measurements\[0\]: sensor = 'coil', but"),
        ([ctr.PositionMeasurement(0.0, POINTS[0], sensor="coil")], r"\.measurements\[0\]: sensor = 'coil' must be at"),
        (
            [ctr.TangentMeasurement(None, POINTS[1]), ctr.PoseMeasurement(None, TURNED)],
            r"\.measurements\[1\]: kind of the tip's orientation = 'PoseMeasurement', but",
        ),
    ],
)
def test_what_a_table_cannot_hold_is_not_written(tmp_path, wrong, message):
    """The experiment and the load or measurement are named, and no file is left."""
    other = experiment(*wrong) if isinstance(wrong, list) else experiment(**wrong)
    with pytest.raises(ctr.DefinitionError, match=rf"experiments\[1\]{message}"):
        ctr.write_experiments(tmp_path / "table.csv", [experiment(), other])
    assert not list(tmp_path.iterdir())


def test_a_table_holds_an_experiment(tmp_path):
    with pytest.raises(ctr.DefinitionError, match="at least one experiment"):
        ctr.write_experiments(tmp_path / "table.csv", [])
