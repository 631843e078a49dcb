"""Wrong input of every kind: one clear sentence that names the file, the field, the tube, the value and the range."""

import math

import numpy as np
import pytest

import ctr_opt as ctr

ROD = ctr.Arc(0.1, 5.0)
STIFF = {"bending_stiffness": 0.02, "torsional_stiffness": 0.015}


def tube(**changes):
    given = {"name": "inner", "outer_diameter": 1e-3, "inner_diameter": 5e-4, "precurvature": ROD, **STIFF}
    return ctr.Tube(**{**given, **changes})


def robot():
    return ctr.Robot([tube(), tube(name="outer", outer_diameter=2e-3, inner_diameter=1.5e-3)])


def held(rotations=(0.0, 0.0), translations=(0.0, -0.02)):
    return ctr.Actuation(rotations, translations)


def solve(loads=(), actuation=None, **settings):
    return ctr.ForwardProblem(robot(), **settings).solve(actuation or held(), loads)


CALLS = {
    "negative diameter": (lambda: tube(outer_diameter=-1e-3), ["'inner'", "outer_diameter", "-0.001", "above 0"]),
    "swapped diameters": (lambda: tube(inner_diameter=2e-3), ["'inner'", "inner_diameter", "0.002", "below", "0.001"]),
    "equal diameters": (lambda: tube(inner_diameter=1e-3), ["inner_diameter", "below outer_diameter"]),
    "negative bore": (lambda: tube(inner_diameter=-1e-4), ["inner_diameter", "-0.0001", "at least 0"]),
    "diameter as text": (lambda: tube(outer_diameter="1 mm"), ["outer_diameter", "'1 mm'", "finite number in m"]),
    "diameter is a truth value": (lambda: tube(outer_diameter=True), ["outer_diameter", "True"]),
    "NaN diameter": (lambda: tube(outer_diameter=math.nan), ["outer_diameter", "nan", "finite"]),
    "infinite modulus": (lambda: tube(youngs_modulus=math.inf), ["youngs_modulus", "inf"]),
    "negative modulus": (lambda: tube(youngs_modulus=-5e9), ["youngs_modulus", "-5e+09", "above 0"]),
    "poisson ratio too large": (
        lambda: tube(poisson_ratio=0.7, torsional_stiffness=None, youngs_modulus=1e9),
        ["poisson_ratio", "0.7", "at most 0.5"],
    ),
    "two shear moduli": (
        lambda: tube(poisson_ratio=0.3, shear_modulus=1e9),
        ["shear_modulus", "poisson_ratio", "both"],
    ),
    "no modulus": (lambda: tube(bending_stiffness=None), ["'inner'", "youngs_modulus", "missing"]),
    "no shear modulus": (lambda: tube(torsional_stiffness=None), ["shear_modulus", "missing"]),
    "zero stiffness": (lambda: tube(bending_stiffness=0.0), ["bending_stiffness", "above 0"]),
    "negative density": (lambda: tube(density=-1.0), ["density", "-1", "at least 0"]),
    "no name": (lambda: tube(name=""), ["name", "non-empty"]),
    "no pieces": (lambda: tube(precurvature=[]), ["precurvature", "non-empty"]),
    "a number as piece": (lambda: tube(precurvature=[5.0]), ["precurvature[0]", "5.0", "Straight"]),
    "zero length": (lambda: ctr.Straight(0.0), ["length", "0 m", "above 0"]),
    "negative length": (lambda: ctr.Arc(-0.1, 1.0), ["length", "-0.1", "above 0"]),
    "NaN curvature": (lambda: ctr.Arc(0.1, [0.0, math.nan, 0.0]), ["curvature[1]", "nan"]),
    "curvature of two numbers": (lambda: ctr.Arc(0.1, [1.0, 2.0]), ["curvature", "(2,)", "(3,)"]),
    "coefficients of two columns": (lambda: ctr.PolynomialCurvature(0.1, [[1.0, 2.0]]), ["coefficients", "(1, 2)"]),
    "no coefficients": (lambda: ctr.PolynomialCurvature(0.1, np.zeros((0, 3))), ["coefficients", "at least one row"]),
    "samples not from zero": (lambda: ctr.SampledCurvature([0.1, 0.2], np.ones((2, 3))), ["arc_length[0]", "0.1", "0"]),
    "samples not increasing": (
        lambda: ctr.SampledCurvature([0.0, 0.2, 0.1], np.ones((3, 3))),
        ["arc_length[2]", "0.1", "above arc_length[1]"],
    ),
    "samples do not match": (lambda: ctr.SampledCurvature([0.0, 0.1], np.ones((3, 3))), ["curvature", "3 rows", "2"]),
    "one sample": (lambda: ctr.SampledCurvature([0.0], np.ones((1, 3))), ["arc_length", "1 entries", "at least 2"]),
    "no tubes": (lambda: ctr.Robot([]), ["tubes", "non-empty"]),
    "two tubes of one name": (
        lambda: ctr.Robot([tube(), tube()], on_overlap="ignore"),
        ["tubes[1]", "'inner'", "tubes[0]"],
    ),
    "overlap refused": (
        lambda: ctr.Robot([tube(), tube(name="outer", outer_diameter=2e-3, inner_diameter=0.0)], on_overlap="error"),
        ["tubes[0] ('inner')", "0.001", "tubes[1] ('outer')", "does not fit"],
    ),
    "pose is no rotation": (
        lambda: ctr.Robot([tube()], np.diag([1.0, 2.0, 1.0, 1.0])),
        ["base_pose", "not a rotation", "det R = 2"],
    ),
    "pose is a reflection": (lambda: ctr.Robot([tube()], np.diag([1.0, 1.0, -1.0, 1.0])), ["base_pose", "det R = -1"]),
    "pose of wrong shape": (lambda: ctr.Robot([tube()], np.eye(3)), ["base_pose", "(3, 3)", "(4, 4)"]),
    "pose with wrong last row": (lambda: ctr.Robot([tube()], np.ones((4, 4))), ["base_pose", "last row"]),
    "base in front of the entry": (lambda: held(translations=(0.01, 0.0)), ["translations[0]", "0.01", "at most 0"]),
    "actuation of unequal lists": (lambda: ctr.Actuation([0.0], [0.0, 0.0]), ["rotations has 1", "translations has 2"]),
    "NaN rotation": (lambda: held(rotations=(math.nan, 0.0)), ["rotations[0]", "nan"]),
    "actuation of three tubes": (lambda: solve(actuation=ctr.Actuation([0] * 3, [0] * 3)), ["3 rotations", "2 tubes"]),
    "drawn wholly back": (
        lambda: solve(actuation=held(translations=(0.0, -0.1))),
        ["tube 1 ('outer')", "-0.1", "wholly behind"],
    ),
    "millimetres for metres": (
        lambda: solve(actuation=held(translations=(-20.0, 0.0))),
        ["tube 0", "-20", "wholly behind"],
    ),
    "load beyond the tip": (
        lambda: solve([ctr.PointWrench(arc_length=0.2)]),
        ["loads[0]", "arc_length", "0.2", "tube 0 ('inner')", "0 to 0.1"],
    ),
    "load beyond its tube": (
        lambda: solve([ctr.PointWrench(), ctr.PointWrench(arc_length=0.09, tube=1)]),
        ["loads[1]", "0.09", "tube 1 ('outer')", "0 to 0.08"],
    ),
    "load on no tube": (lambda: solve([ctr.PointWrench(tube=2)]), ["loads[0]", "tube = 2", "0 to 1"]),
    "negative tube": (lambda: ctr.PointWrench(tube=-1), ["tube = -1", "innermost"]),
    "load at negative s": (lambda: ctr.PointWrench(arc_length=-0.01), ["arc_length", "-0.01", "at least 0"]),
    "force of two numbers": (lambda: ctr.PointWrench(force=[1.0, 2.0]), ["force", "(2,)", "(3,)"]),
    "infinite force": (lambda: ctr.PointWrench(force=[1.0, 2.0, math.inf]), ["force[2]", "inf"]),
    "unknown frame": (lambda: ctr.PointWrench(frame="wolrd"), ["frame", "'wolrd'", "'world'"]),
    "reversed interval": (lambda: ctr.DistributedLoad(start=0.05, end=0.02), ["end = 0.02", "start = 0.05"]),
    "interval beyond its tube": (lambda: solve([ctr.DistributedLoad(start=0.01, end=0.2)]), ["loads[0]", "end", "0.2"]),
    "load table of unequal lengths": (
        lambda: ctr.DistributedLoad(force=([0.0, 0.1], np.ones((3, 3)))),
        ["force", "2 arc lengths and 3 rows"],
    ),
    "load table not increasing": (
        lambda: ctr.DistributedLoad(force=([0.1, 0.0], np.ones((2, 3)))),
        ["force", "0", "above"],
    ),
    "load function of two numbers": (
        lambda: solve([ctr.DistributedLoad(force=lambda s: [1.0, s])]),
        ["loads[0].force", "three finite numbers"],
    ),
    "load function with NaN": (
        lambda: solve([ctr.DistributedLoad(moment=lambda s: [1.0, s, math.nan])]),
        ["loads[0].moment", "three finite numbers"],
    ),
    "a load, not a list": (lambda: solve(ctr.PointWrench()), ["loads", "list"]),
    "a number as load": (lambda: solve([3.0]), ["loads[0]", "3.0", "PointWrench"]),
    "load function that fails": (
        lambda: solve([ctr.DistributedLoad(force=lambda s: [1.0 / s, 0.0, 0.0])]),
        ["loads[0].force(0 m)", "ZeroDivisionError"],
    ),
    "a force that overflows": (lambda: ctr.PointWrench(force=[1e200, 0.0, 0.0]), ["force[0]", "1e+200", "finite"]),
    "a tube thinner than numbers": (
        lambda: tube(outer_diameter=1e-90, inner_diameter=0.0, bending_stiffness=None, youngs_modulus=1e9),
        ["'inner'", "bending_stiffness", "above 0"],
    ),
    "rotations as text": (lambda: ctr.Actuation(["1", "2"], [0.0, 0.0]), ["rotations", "numbers"]),
    "complex rotations": (lambda: ctr.Actuation([1 + 2j], [0.0]), ["rotations", "numbers"]),
    "collocation of degree zero": (lambda: ctr.Collocation(0), ["degree = 0", "1 to 9"]),
    "a negative step": (lambda: ctr.Homotopy(first_step=-1.0), ["Homotopy.first_step", "-1"]),
    "half an iteration": (lambda: ctr.Newton(max_iterations=2.5), ["Newton.max_iterations = 2.5", "whole number"]),
    "half a step": (lambda: ctr.Homotopy(max_steps=2.5), ["Homotopy.max_steps = 2.5", "whole number"]),
    "half of IPOPT's": (lambda: ctr.Ipopt(max_iterations=2.5), ["Ipopt.max_iterations = 2.5", "whole number"]),
    "no iterations": (lambda: ctr.Newton(max_iterations=-1), ["Newton.max_iterations", "-1"]),
    "integrator as list": (lambda: solve(integrator=[1]), ["integrator", "'RK8'"]),
    "transcription as number": (lambda: solve(transcription=3), ["transcription", "Collocation"]),
    "unknown formulation": (lambda: solve(formulation="enrgy"), ["formulation", "'enrgy'", "'energy'"]),
    "method of another formulation": (lambda: solve(formulation="energy", method=ctr.Newton()), ["method", "Ipopt"]),
    "tolerance zero": (lambda: solve(tolerance=0.0), ["tolerance", "at least 1e-11"]),
    "moments to energy": (
        lambda: solve([ctr.PointWrench(), ctr.PointWrench(moment=[0, 0, 1])], formulation="energy"),
        ["loads[1]", "moment", "energy"],
    ),
    "initial of another kind": (
        lambda: ctr.ForwardProblem(robot()).solve(held(), initial=3),
        ["initial", "Equilibrium"],
    ),
    "a dictionary as robot": (lambda: ctr.ForwardProblem({}), ["robot", "Robot"]),
    "s beyond the tip": (lambda: solve().position(0.2), ["0.2", "0 to 0.1"]),
    "s beyond the tube": (lambda: solve().torsion(1, [0.0, 0.09]), ["0.09", "tube 1 ('outer')", "0 to 0.08"]),
    "NaN s": (lambda: solve().position(math.nan), ["nan", "outside"]),
    "tube not there": (lambda: solve().torsion(2, 0.0), ["tube = 2", "0 to 1"]),
}


@pytest.mark.parametrize("case", CALLS)
def test_wrong_calls_are_reported_in_one_sentence(case):
    call, words = CALLS[case]
    with pytest.raises(ctr.DefinitionError) as caught:
        call()
    _one_clear_sentence(str(caught.value), words)


ROBOT = """[[tubes]]
name = "inner"
outer_diameter = "1 mm"
inner_diameter = "0.5 mm"
youngs_modulus = "58 GPa"
poisson_ratio = 0.3
precurvature = [{ kind = "arc", length = "100 mm", curvature = 5.0 }]
"""
PROBLEM = """title = "a problem"
robot = "robot.toml"
[source]
text = "made up"
[actuation]
rotations = ["10 deg"]
translations = ["-20 mm"]
[[loads]]
kind = "point"
force = ["1 N", 0, 0]
"""
FILES = {
    "unknown key": (
        "robot",
        "outer_diameter =",
        "outer_diamter =",
        ["tubes[0] ('inner')", "outer_diamter", "'outer_diameter'"],
    ),
    "missing key": ("robot", 'youngs_modulus = "58 GPa"\n', "", ["tubes[0]", "'inner'", "youngs_modulus", "missing"]),
    "required key missing": ("robot", 'outer_diameter = "1 mm"\n', "", ["tubes[0]", "outer_diameter", "missing"]),
    "no name": ("robot", 'name = "inner"\n', "", ["tubes[0]", "name", "missing"]),
    "negative diameter": ("robot", '"1 mm"', '"-1 mm"', ["tubes[0]", "'inner'", "outer_diameter", "-0.001", "above 0"]),
    "length as an angle": ("robot", '"100 mm"', '"100 deg"', ["precurvature[0]", "length", "'100 deg'", "a length"]),
    "unit typo": ("robot", '"58 GPa"', '"58 GPq"', ["youngs_modulus", "'58 GPq'", "did you mean 'GPa'"]),
    "unit of another kind": ("robot", '"58 GPa"', '"58 N"', ["youngs_modulus", "'N'", "a modulus"]),
    "no number": ("robot", '"1 mm"', '"one mm"', ["outer_diameter", "'one mm'", "a length"]),
    "a list for a number": ("robot", '"1 mm"', "[1, 2]", ["outer_diameter", "[1, 2]", "a length"]),
    "NaN": ("robot", '"1 mm"', "nan", ["outer_diameter", "nan", "finite"]),
    "infinity": ("robot", "= 5.0", "= inf", ["precurvature[0]", "curvature", "inf", "finite"]),
    "curvature of two": ("robot", "= 5.0", "= [5.0, 1.0]", ["curvature", "2 entries", "3"]),
    "unknown piece": ("robot", '"arc"', '"ark"', ["precurvature[0].kind", "'ark'", "'arc'"]),
    "a key with a line break": (
        "robot",
        "[[tubes]]",
        '"a\\n\\u001b[31mb" = 1\n[[tubes]]',
        ["a\\n\\x1b[31mb", "unknown key"],
    ),
    "a file name with a line break": (
        "robot",
        'kind = "arc", length = "100 mm", curvature = 5.0',
        'kind = "sampled", file = "a\\nb"',
        ["a\\nb", "cannot be read"],
    ),
    "piece is a number": ("robot", "[{ kind", "[5, { kind", ["precurvature[0]", "5", "table"]),
    "unknown key in a piece": (
        "robot",
        "curvature = 5.0",
        "curvture = 5.0",
        ["precurvature[0]", "curvture", "'curvature'"],
    ),
    "precurvature is a number": ("robot", "[{ kind", "5 # [{ kind", ["tubes[0]", "precurvature", "list"]),
    "tubes is a table": ("robot", "[[tubes]]", "[tubes]", ["tubes", "[[tubes]]"]),
    "text after the value": ("robot", '"1 mm"', '"1 mm" x', ["robot.toml", "TOML"]),
    "cut off": ("robot", "100 mm", "100 mm\x00", ["robot.toml", "TOML"]),
    "missing CSV": (
        "robot",
        'kind = "arc", length = "100 mm", curvature = 5.0',
        'kind = "sampled", file = "no.csv"',
        ["no.csv", "cannot be read"],
    ),
    "samples without curvature": (
        "robot",
        'kind = "arc", length = "100 mm", curvature = 5.0',
        'kind = "sampled", arc_length = [0, 1]',
        ["precurvature[0].curvature", "missing"],
    ),
    "poisson ratio of text": ("robot", "poisson_ratio = 0.3", 'poisson_ratio = "0.3"', ["poisson_ratio", "'0.3'"]),
    "a power of powers": ("robot", '"1 mm"', '"1 m^9^9^9^9"', ["outer_diameter", "unknown unit"]),
    "decimal comma": ("robot", '"1 mm"', '"1,5 mm"', ["outer_diameter", "comma"]),
    "pose of texts": (
        "robot",
        "[[tubes]]",
        '[base]\npose = [["1", 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]\n[[tubes]]',
        ["base.pose[0][0]", "'1'", "number"],
    ),
    "a number of 5000 digits": ("robot", '"1 mm"', "9" * 5000, ["robot.toml"]),
    "NUL in a file name": (
        "robot",
        'kind = "arc", length = "100 mm", curvature = 5.0',
        'kind = "sampled", file = "a\\u0000b"',
        ["cannot be read"],
    ),
    "unknown formulation": (
        "problem",
        "[actuation]",
        '[solver]\nformulation = "energi"\n[actuation]',
        ["problem.toml", "solver", "'energi'"],
    ),
    "tolerance as text": (
        "problem",
        "[actuation]",
        '[solver]\ntolerance = "1e-7"\n[actuation]',
        ["problem.toml", "solver.tolerance", "'1e-7'"],
    ),
    "load beyond its tube": (
        "problem",
        'kind = "point"',
        'kind = "point"\narc_length = "1 m"',
        ["problem.toml", "loads[0]", "1 m", "0.08 m"],
    ),
    "expected direction of two": (
        "problem",
        "[actuation]",
        '[expected]\ntext = "x"\ntip_direction = [0, 1]\n[actuation]',
        ["expected.tip_direction", "2 entries", "3"],
    ),
    "expected torsions of two tubes": (
        "problem",
        "[actuation]",
        '[expected]\ntext = "x"\nbase_torsions = [0, 1]\ntorsion_tolerance = 1\n[actuation]',
        ["expected.base_torsions", "1 entries"],
    ),
    "negative tolerance": (
        "problem",
        "[actuation]",
        '[expected]\ntext = "x"\ntip_position = [0, 1, 0]\nposition_tolerance = -1\n[actuation]',
        ["expected", "position_tolerance", "-1", "above 0"],
    ),
    "unknown section": ("problem", "[actuation]", "[actuaton]", ["actuaton", "'actuation'"]),
    "no robot": ("problem", 'robot = "robot.toml"\n', "", ["robot", "missing"]),
    "robot not there": ("problem", '"robot.toml"', '"robo.toml"', ["robo.toml", "cannot be read"]),
    "angle as a length": ("problem", '"10 deg"', '"10 mm"', ["actuation.rotations[0]", "'10 mm'", "an angle"]),
    "base in front": ("problem", '"-20 mm"', '"20 mm"', ["problem.toml", "translations[0]", "0.02", "at most 0"]),
    "two rotations": ("problem", '["10 deg"]', '["10 deg", 0]', ["rotations has 2", "translations has 1"]),
    "unknown load": ("problem", '"point"', '"piont"', ["loads[0].kind", "'piont'", "'point'"]),
    "force in millimetres": ("problem", '"1 N"', '"1 mm"', ["loads[0].force[0]", "'1 mm'", "a force"]),
    "force of two": ("problem", '["1 N", 0, 0]', '["1 N", 0]', ["loads[0].force", "2 entries", "3"]),
    "load on no tube": (
        "problem",
        'kind = "point"',
        'kind = "point"\ntube = "outer"',
        ["loads[0].tube", "'outer'", "inner"],
    ),
    "unknown key in a load": ("problem", "force =", "forse =", ["loads[0]", "forse", "'force'"]),
    "source without text": ("problem", '[source]\ntext = "made up"\n', "[source]\n", ["source.text", "missing"]),
    "expected without tolerance": (
        "problem",
        "[actuation]",
        '[expected]\ntext = "x"\ntip_position = [0, 0, 0]\n[actuation]',
        ["expected.tip_position", "position_tolerance"],
    ),
}


@pytest.mark.parametrize("case", FILES)
def test_wrong_files_are_reported_in_one_sentence(tmp_path, case):
    which, old, new, words = FILES[case]
    texts = {"robot": ROBOT, "problem": PROBLEM}
    assert old in texts[which], "the case must change the file"
    texts[which] = texts[which].replace(old, new, 1)
    for name, text in texts.items():
        (tmp_path / f"{name}.toml").write_text(text)
    with pytest.raises(ctr.DefinitionError) as caught:
        ctr.load_problem(tmp_path / "problem.toml")
    _one_clear_sentence(str(caught.value), [str(tmp_path), *words])


@pytest.mark.parametrize("cut", range(10, len(ROBOT) - 2, 23))
def test_truncated_files_never_pass_for_whole_ones(tmp_path, cut):
    (tmp_path / "robot.toml").write_text(ROBOT[:cut])
    with pytest.raises(ctr.DefinitionError, match=r"robot\.toml"):
        ctr.load_robot(tmp_path / "robot.toml")


def test_unreadable_files(tmp_path):
    (tmp_path / "binary.toml").write_bytes(b"\xff\xfe\x00robot")
    for name, words in (("none.toml", "cannot be read"), (".", "cannot be read"), ("binary.toml", "UTF-8")):
        with pytest.raises(ctr.DefinitionError, match=words):
            ctr.load_robot(tmp_path / name)


def test_tubes_that_do_not_nest_are_warned_of():
    with pytest.warns(ctr.NestingWarning, match=r"tubes\[0\] \('inner'\).*0\.001.*tubes\[1\] \('outer'\).*0\.0005"):
        ctr.Robot([tube(), tube(name="outer", outer_diameter=2e-3)])


def test_tubes_of_a_file_that_do_not_nest(tmp_path):
    second = ROBOT.replace('"inner"', '"outer"').replace('"1 mm"', '"2 mm"')
    (tmp_path / "robot.toml").write_text(ROBOT + second)
    with pytest.warns(ctr.NestingWarning, match=r"robot\.toml: tubes\[0\].*tubes\[1\]"):
        ctr.load_robot(tmp_path / "robot.toml")
    with pytest.raises(ctr.DefinitionError, match=r"robot\.toml: tubes\[0\].*tubes\[1\]"):
        ctr.load_robot(tmp_path / "robot.toml", on_overlap="error")


def test_an_inner_tube_inside_an_outer_one_is_no_error():
    result = solve(actuation=held(translations=(-0.05, 0.0)))
    assert result.length == pytest.approx(0.1, abs=1e-15)  # the outer tube carries the tip


def _one_clear_sentence(message, words):
    assert "\n" not in message
    assert len(message) < 400
    for word in words:
        assert word in message, message
