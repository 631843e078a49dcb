import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import ctr_opt as ctr

ROBOT = "problems/rjw_s1/robot.toml"
PROBLEM = "problems/rjw_s1/fig9_loaded.toml"


@pytest.fixture(scope="module")
def solved():
    return ctr.load_problem(PROBLEM).solve()


lengths = st.floats(1e-3, 0.5)
curvatures = st.floats(-30.0, 30.0)
vectors = st.lists(curvatures, min_size=3, max_size=3)
pieces = st.one_of(
    st.builds(ctr.Straight, lengths),
    st.builds(ctr.Arc, lengths, st.one_of(curvatures, vectors)),
    st.builds(ctr.PolynomialCurvature, lengths, st.lists(vectors, min_size=1, max_size=5)),
    st.integers(2, 6).flatmap(
        lambda k: st.builds(
            lambda steps, rows: ctr.SampledCurvature(np.concatenate(([0.0], np.cumsum(steps))), rows),
            st.lists(lengths, min_size=k - 1, max_size=k - 1),
            st.lists(vectors, min_size=k, max_size=k),
        )
    ),
)


@settings(max_examples=40, deadline=None, derandomize=True)
@given(st.lists(pieces, min_size=1, max_size=4), st.floats(0.1, 0.9), st.booleans())
def test_a_saved_robot_reads_back_the_same(tmp_path_factory, shape, bore, stiff):
    material = {"bending_stiffness": 0.02, "torsional_stiffness": 0.3} if stiff else {}
    if not stiff:
        material = {"youngs_modulus": 58.3e9, "poisson_ratio": 0.3, "density": 6450.0}
    tube = ctr.Tube("a", 1.7e-3, bore * 1.7e-3, shape, **material)
    robot = ctr.Robot([tube])
    path = tmp_path_factory.mktemp("robot") / "robot.toml"
    ctr.save_robot(robot, path)
    assert ctr.load_robot(path) == robot  # to the last bit: numbers are written in full precision


def test_units_in_files_are_converted(tmp_path):
    (tmp_path / "robot.toml").write_text(
        """[[tubes]]
name = "a"
outer_diameter = "1.75 mm"
inner_diameter = "0.125 cm"
youngs_modulus = "58 GPa"
shear_modulus = "21500 MPa"
density = "6.45 g/cm^3"
precurvature = [{ kind = "arc", length = "10 cm", curvature = ["7 1/m", 0, "0.01 rad/mm"] }]
"""
    )
    tube = ctr.load_robot(tmp_path / "robot.toml").tubes[0]
    assert tube.outer_diameter == pytest.approx(1.75e-3, rel=1e-15)  # one rounding of the conversion
    assert tube.inner_diameter == pytest.approx(1.25e-3, rel=1e-15)
    assert tube.youngs_modulus == pytest.approx(58e9, rel=1e-15)
    assert tube.shear_modulus == pytest.approx(21.5e9, rel=1e-15)
    assert tube.density == pytest.approx(6450.0, rel=1e-15)
    np.testing.assert_allclose(tube.precurvature[0].curvature, [7.0, 0.0, 10.0], rtol=1e-15)


def test_tables_come_from_csv(tmp_path):
    (tmp_path / "curvature.csv").write_text("# s, ux, uy, uz\n0, 1, 2, 0\n0.05, 2, 3, 0\n\n0.1, 4, 5, 1\n")
    (tmp_path / "load.csv").write_text("0, 1, 0, 0, 0, 0, 0\n0.1, 3, 0, 0, 0, 0, 0.5\n")
    (tmp_path / "robot.toml").write_text(
        """[[tubes]]
name = "a"
outer_diameter = 1e-3
inner_diameter = 0
bending_stiffness = 0.02
torsional_stiffness = 0.02
precurvature = [{ kind = "sampled", file = "curvature.csv" }]
"""
    )
    (tmp_path / "problem.toml").write_text(
        """title = "x"
robot = "robot.toml"
[source]
text = "made up"
[actuation]
rotations = [0]
translations = [0]
[[loads]]
kind = "distributed"
tube = "a"
file = "load.csv"
end = "90 mm"
"""
    )
    problem = ctr.load_problem(tmp_path / "problem.toml")
    assert problem.robot.tubes[0].precurvature[0] == ctr.SampledCurvature(
        [0, 0.05, 0.1], [[1, 2, 0], [2, 3, 0], [4, 5, 1]]
    )
    (load,) = problem.loads
    expected = ctr.DistributedLoad(
        force=([0, 0.1], [[1, 0, 0], [3, 0, 0]]), moment=([0, 0.1], [[0, 0, 0], [0, 0, 0.5]]), end=0.09
    )
    assert load == expected


@pytest.mark.parametrize("suffix", [".csv", ".npz", ".json"])
def test_a_saved_shape_holds_the_shape(tmp_path, solved, suffix):
    path = tmp_path / f"shape{suffix}"
    ctr.save_shape(solved, path)
    if suffix == ".csv":
        table = np.genfromtxt(path, delimiter=",", names=True)
    elif suffix == ".npz":
        table = np.load(path)
    else:
        table = json.loads(path.read_text())["columns"]
    s = np.asarray(table["s"], dtype=float)
    np.testing.assert_array_equal(s, solved.arc_length)
    for axis, column in zip("xyz", solved.position(s).T, strict=True):
        np.testing.assert_array_equal(np.asarray(table[f"position_{axis}"], dtype=float), column)
    outer = np.asarray([np.nan if value is None else value for value in table["torsion_1"]], dtype=float)
    end = solved.configuration.tube_ends[1]
    assert np.all(np.isnan(outer) == (s > end))
    np.testing.assert_array_equal(outer[s <= end], solved.torsion(1, s[s <= end]))


def test_nothing_half_written_is_left(tmp_path, solved, monkeypatch):
    path = tmp_path / "shape.csv"
    path.write_text("old")

    def broken(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr("ctr_opt.files.shapes.shape_columns", broken)
    with pytest.raises(KeyboardInterrupt):
        ctr.save_shape(solved, path)
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]


def test_a_byte_order_mark_does_no_harm(tmp_path):
    (tmp_path / "robot.toml").write_bytes(b"\xef\xbb\xbf" + Path(ROBOT).read_bytes())
    assert ctr.load_robot(tmp_path / "robot.toml") == ctr.load_robot(ROBOT)


def test_values_can_be_hashed_and_results_are_read_only(solved):
    problem = ctr.load_problem(PROBLEM)
    assert len({problem.robot, problem.actuation, *problem.loads, *problem.robot.tubes}) == 5
    for held in (solved.arc_length, solved.last_iterate.bending, solved.last_iterate.torsional):
        with pytest.raises(ValueError, match="read-only"):
            held[:] = 0.0
    assert solved.position([]).shape == (0, 3)
    assert solved.torsion(0, []).shape == (0,)


def test_file_contents_are_never_executed(tmp_path):
    mark = tmp_path / "executed"
    (tmp_path / "robot.toml").write_text(
        f"""[[tubes]]
name = "a"
outer_diameter = "__import__('pathlib').Path('{mark}').touch() or 1 mm"
inner_diameter = 0
precurvature = []
"""
    )
    with pytest.raises(ctr.DefinitionError, match="outer_diameter"):
        ctr.load_robot(tmp_path / "robot.toml")
    assert not mark.exists()
