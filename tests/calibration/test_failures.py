"""Wrong input of estimations: one sentence each; what cannot be solved; reports and figures."""

import attrs
import matplotlib as mpl
import numpy as np
import pytest

import ctr_opt as ctr
from ctr_opt.calibration.plot import plot_residuals
from tests.support.estimated import NOISE, every_kind, experiments, points, small_robot, solve, with_points
from tests.support.slow import some_slow

mpl.use("Agg")
Position, Pose, Tangent = ctr.PositionMeasurement, ctr.PoseMeasurement, ctr.TangentMeasurement
Curvature, Torque, Parameter = ctr.CurvatureMeasurement, ctr.TorqueMeasurement, ctr.Parameter
EI = "tubes[0].bending_stiffness"
ROBOT = small_robot(2)
DATA = experiments(ROBOT, 4, 1)
HELD = ctr.Actuation([0.0, 0.0], [-0.1, -0.1])


def problem(parameters=(EI,), data=DATA, **settings):
    return ctr.CalibrationProblem(ROBOT, data, parameters, **settings)


def measured(*measurements, loads=()):
    return [ctr.Experiment(HELD, loads, list(measurements))]


def mirrored():
    return np.diag([-1.0, 1.0, 1.0, 1.0])


MESSAGES = {
    "position of two": (lambda: Position(None, [0.0, 1.0]), ["position", "(2,)", "(1, 3)"]),
    "positions of other places": (lambda: Position([0.1, None], np.zeros((3, 3))), ["(3, 3)", "(2, 3)"]),
    "no place": (lambda: Position([], np.zeros((0, 3))), ["arc_length = []", "at least one place"]),
    "negative place": (lambda: Position(-0.1, np.zeros(3)), ["arc_length", "-0.1", "at least 0"]),
    "place as text": (lambda: Position("tip", np.zeros(3)), ["arc_length", "'tip'"]),
    "distal of no tube": (lambda: ctr.Distal(-1), ["tube", "-1"]),
    "negative sigma": (lambda: Position(None, np.zeros(3), -1e-3), ["sigma", "-0.001", "above 0"]),
    "zero sigma": (lambda: Torque(0, 0.0, 0.0), ["sigma", "0", "above 0"]),
    "negative axis": (lambda: Position(None, np.zeros(3), [1.0, -1.0, 1.0]), ["sigma", "positive", "each axis"]),
    "two axes": (lambda: Position(None, np.zeros(3), [1.0, 1.0]), ["sigma", "(2,)", "(3,)"]),
    "no covariance": (lambda: Position(None, np.zeros(3), -np.eye(3)), ["covariance", "positive definite"]),
    "asymmetric": (lambda: Position(None, np.zeros(3), np.eye(3) + np.eye(3, k=1) / 9), ["covariance", "symmetric"]),
    "two places of a pose": (lambda: Pose([0.1, 0.2], np.eye(4)), ["arc_length", "one place"]),
    "two places of a tangent": (lambda: Tangent([0.1, None], [0, 0, 1]), ["arc_length", "one place"]),
    "mirrored pose": (lambda: Pose(None, mirrored()), ["pose", "not a rotation matrix"]),
    "pose of another row": (lambda: Pose(None, np.eye(4)[::-1]), ["pose"]),
    "pose of a scale": (lambda: Pose(None, np.diag([1.0, 1.0, 1.0, 2.0])), ["pose", "last row"]),
    "sensor without a name": (lambda: Tangent(None, [0, 0, 1], sensor="my coil"), ["sensor = 'my coil'", "letters"]),
    "a sensor at two places": (lambda: Position([0.1, None], np.zeros((2, 3)), sensor="coil"), ["'coil'", "one place"]),
    "no such sensor": (lambda: problem(["sensors.coil.rotation"]), ["sensors.coil.rotation", "'coil'", "none"]),
    "pose of no tube": (lambda: Pose(None, np.eye(4), tube="inner"), ["tube", "'inner'"]),
    "axes of a tangent": (lambda: Tangent(None, [0, 0, 1], [0.1, 0.2]), ["sigma", "[0.1, 0.2]", "must be one number"]),
    "no direction": (lambda: Tangent(None, [0.0, 0.0, 0.0]), ["direction", "zero"]),
    "curvature of four": (lambda: Curvature(0.1, [1.0, 2.0, 3.0, 4.0]), ["curvature", "(1, 4)", "(1, 2)"]),
    "torque as text": (lambda: Torque(0, "much"), ["torque", "'much'", "N m"]),
    "no actuation": (lambda: ctr.Experiment([0.0], [], Torque(0, 0.0)), ["actuation", "Actuation"]),
    "no measurement": (lambda: ctr.Experiment(HELD), ["measurements", "at least one"]),
    "a number as measurement": (lambda: ctr.Experiment(HELD, [], 5.0), ["measurements", "5.0"]),
    "numbers as measurements": (lambda: ctr.Experiment(HELD, [], [5.0]), ["measurements[0]", "PositionMeasurement"]),
    "loads are none": (lambda: ctr.Experiment(HELD, None, Torque(0, 0.0)), ["loads = None"]),
    "wrong load": (lambda: ctr.Experiment(HELD, [1.0], Torque(0, 0.0)), ["loads[0]", "1.0"]),
    "no robot": (lambda: ctr.CalibrationProblem(None, DATA, [EI]), ["robot", "Robot"]),
    "no experiments": (lambda: problem(data=[]), ["experiments", "at least one"]),
    "no experiment": (lambda: problem(data=[1.0]), ["experiments[0]", "1.0", "Experiment"]),
    "another robot's": (lambda: problem(data=experiments(small_robot(1), 1, 1)), ["experiments[0]", "1 tubes", "2"]),
    "no parameters": (lambda: problem([]), ["parameters", "at least one"]),
    "parameters are none": (lambda: problem(None), ["parameters = None", "list"]),
    "a name": (lambda: problem(EI), ["parameters", EI, "list"]),
    "twice": (lambda: problem([EI, EI]), ["parameters", EI, "twice"]),
    "a number as parameter": (lambda: problem([1]), ["parameters", "1", "name"]),
    "misspelt": (lambda: problem(["tubes[0].bending"]), ["parameters = 'tubes[0].bending'", "did you mean", EI]),
    "another tube's": (lambda: problem(["tubes[2].bending_stiffness"]), ["tubes[2]", "did you mean"]),
    "another tube's offset": (lambda: problem(["tubes[2].rotation_offset"]), ["2 tubes", "counted from 0"]),
    "another experiment's": (lambda: problem(["experiments[4].rotations"]), ["4 experiments", "counted from 0"]),
    "no load": (lambda: problem(["experiments[0].loads[0].force"]), ["experiments[0].loads[0].force", "allowed are"]),
    "all rotations": (lambda: problem(["rotations"]), ["parameters = 'rotations'", "not a parameter"]),
    "stiffness and modulus": (lambda: problem([EI, "tubes[0].youngs_modulus"]), [EI, "youngs_modulus", "choose one"]),
    "tied twice": (lambda: problem([EI, Parameter("all", tied=EI)]), [EI, "'all'", "both"]),
    "tied to nothing": (lambda: problem([Parameter("all", tied=["EI"])]), ["all: tied = 'EI'", "not a parameter"]),
    "prior of one": (lambda: Parameter(EI, prior=0.1), ["prior", "pair"]),
    "prior without width": (lambda: problem([Parameter(EI, prior=(0.1, 0.0))]), [EI, "prior", "positive"]),
    "prior of two numbers": (lambda: problem([Parameter(EI, prior=([1.0, 2.0], 1.0))]), [EI, "prior", "(2,)"]),
    "bounds the wrong way": (lambda: problem([Parameter(EI, bounds=(0.1, 0.01))]), [EI, "initial", "bounds"]),
    "start outside": (lambda: problem([Parameter(EI, bounds=(0.01, 0.1))]), [EI, "initial", "0.01", "0.1"]),
    "infinite the wrong way": (lambda: problem([Parameter(EI, bounds=(np.inf, None))]), [EI, "bounds", "inf"]),
    "no scale": (lambda: problem([Parameter(EI, scale=0.0)]), [EI, "scale", "positive"]),
    "negative scale": (lambda: problem([Parameter(EI, scale=-1.0)]), [EI, "scale", "positive"]),
    "in front of the entry": (
        lambda: problem([Parameter("tubes[0].translation_offset", initial=0.5)]),
        ["tubes[0].translation_offset", "entry"],
    ),
    "density without gravity": (lambda: problem(["tubes[0].density"]), ["tubes[0].density", "there is no Gravity"]),
    "unknown loss": (lambda: problem(loss="l1"), ["loss", "'l1'", "'cauchy'"]),
    "tolerance": (lambda: problem(tolerance=0.0), ["tolerance", "0"]),
    "unknown method": (lambda: problem().solve(method="newton"), ["method", "'newton'", "'reduced'"]),
    "huber without sigma": (lambda: problem(data=with_points(DATA, sigma=None), loss="huber"), ["'huber'", "sigma"]),
    "prior without sigma": (
        lambda: problem(["base.translation", Parameter(EI, prior=(0.1, 0.01))], with_points(DATA, sigma=None)),
        [EI, "prior", "sigma of every measurement"],
    ),
    "some without sigma": (lambda: problem(data=[*DATA, *with_points(DATA, sigma=None)]), ["sigma", "all", "none"]),
    "torque of no tube": (lambda: problem(data=measured(Torque(2, 0.0, 1.0))), ["tube = 2", "0 to 1"]),
    "end of no tube": (lambda: problem(data=measured(Position(ctr.Distal(2), np.zeros(3)))), ["tube = 2", "0 to 1"]),
    "beyond the robot": (
        lambda: problem(data=[*DATA, *measured(Position([0.05, 0.2], np.zeros((2, 3)), 1e-3))]),
        ["experiment 4: measurements[0] is at s = 0.2 m", "the robot reaches from 0 to 0.14 m"],
    ),
    "beyond its tube": (
        lambda: problem(data=measured(Curvature([0.05, 0.07], np.zeros((2, 2)), 0.1, tube=1))),
        ["s = 0.07 m", "tube 1 reaches from 0 to 0.06 m"],
    ),
    "the tip of a tube that ends before": (
        lambda: problem(data=measured(Pose(None, np.eye(4), 1e-3, tube=1))),
        ["s = 0.14 m", "tube 1"],
    ),
}


@pytest.mark.parametrize("case", MESSAGES)
def test_messages(case):
    call, words = MESSAGES[case]
    with pytest.raises(ctr.DefinitionError) as error:
        call()
    for word in words:
        assert word in str(error.value)


@pytest.mark.parametrize("method", ["simultaneous", "reduced"])
def test_no_equilibrium_to_start_from(method):
    """A force by which an infinite spring pushes away: there is none; the experiment is named."""
    away = ctr.PotentialLoad(lambda p: -1e6 * (p[0] ** 2 + p[1] ** 2 + p[2] ** 4), arc_length=None)
    data = [*DATA, attrs.evolve(DATA[0], loads=[away], name="pushed away")]
    with pytest.raises(
        ctr.EstimationError, match="the initial parameters have no equilibrium in experiment pushed away"
    ):
        problem(data=data).solve(method=method)
    with pytest.raises(ctr.EstimationError, match="the initial parameters have no equilibrium in experiment pushed"):
        problem(data=data).nominal()


def test_experiments_that_are_not_there():
    fit = problem().solve()
    for call in (fit.without, fit.errors_without):
        with pytest.raises(ctr.DefinitionError, match="experiments: 4 must be the number of an experiment from 0 to 3"):
            call(4)
        with pytest.raises(ctr.DefinitionError, match="experiments: -1 must"):
            call([0, -1])
    with pytest.raises(ctr.DefinitionError, match="at least one must be left"):
        fit.without(range(4))
    with pytest.raises(ctr.DefinitionError, match=r"label = 'EI' must be 'tubes\[0\].bending_stiffness"):
        fit.profile("EI")


def test_labels():
    """Numbers of three are x, y, z where they are vectors, and counted where they belong to tubes."""
    robot = small_robot(3)
    names = ["base.translation", "experiments[0].rotations", "tubes[0].precurvature[1].coefficients"]
    fit = ctr.CalibrationProblem(robot, experiments(robot, 1, 1), names).nominal()
    assert fit.labels[:3] == ["base.translation.x", "base.translation.y", "base.translation.z"]
    assert fit.labels[3:6] == [f"experiments[0].rotations[{i}]" for i in range(3)]
    assert fit.labels[6:8] == [f"tubes[0].precurvature[1].coefficients[0, {i}]" for i in range(2)]


# -- reports and figures ----------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def mixed():
    """A fit to measurements of every kind, with a common factor and an experiment that does not fit."""
    data = experiments(ROBOT, 6, 3, every_kind, size=1.0)
    shape = solve(ROBOT, data[4].actuation, data[4].loads)
    wrong = Position(None, shape.tip_position + np.array([0.02, 0.0, 0.0]), sigma=NOISE["position"])
    data[4] = attrs.evolve(data[4], measurements=[wrong, *data[4].measurements], name="knocked")
    factor = Parameter("common_stiffness", tied=[EI, "tubes[1].bending_stiffness"])
    names = [factor, "base.translation", "base.rotation", "tubes[0].rotation_offset"]
    return ctr.CalibrationProblem(ROBOT, data, names, loss="huber").solve()


def test_reports_tell_everything(mixed):
    report = mixed.report()
    for text in (
        "Fit of 8 numbers to 6 experiments",
        "simultaneous",
        "Huber's loss",
        "chi-square",
        "errors from the sandwich",
        "base.translation.x",
        "mm",
        "deg",
        "tip",
        "end of tube 1",
        "at s = 20.0 mm",
        "knocked:",
    ):
        assert text in report
    (factor,) = [line for line in report.splitlines() if line.strip().startswith("common_stiffness")]
    assert factor.split()[1] == "1"
    assert not factor.rstrip().endswith("m^2")
    (knocked,) = [line for line in report.splitlines() if line.strip().startswith("knocked:")]
    reported = float(knocked.split()[1])
    worst = max(each.size for each in mixed.residuals if each.experiment == 4 and each.measurement == 0)
    assert reported == pytest.approx(1e3 * worst, abs=0.01)  # mm of a point, not 1/m of a curvature
    assert len(mixed.residuals) == 6 * (3 + 1 + 1 + 2 + 1) + 1


def test_units_of_reports():
    """The table's numbers are those of the fit, in its units."""
    fit = problem(["base.translation", "base.rotation", EI, "tubes[1].precurvature[1].length"]).nominal()
    lines = {
        line.split()[0]: line for line in fit.report().splitlines() if line.strip().startswith(("base.", "tubes["))
    }
    assert lines["base.translation.x"].rstrip().endswith("mm")
    assert lines["base.rotation.z"].rstrip().endswith("deg")
    assert lines[EI].rstrip().endswith("N m^2")
    assert float(lines[EI].split()[1]) == pytest.approx(ROBOT.tubes[0].bending_stiffness, rel=1e-5)
    assert float(lines["tubes[1].precurvature[1].length"].split()[1]) == 70.0


def test_figures(mixed):
    from matplotlib import pyplot as plt
    from matplotlib.figure import Figure

    figure = mixed.plot()
    assert isinstance(figure, Figure)
    assert len(figure.axes) == 5
    figure.canvas.draw()
    plt.close(figure)
    ax = plot_residuals(mixed)
    inside, above, below = (len(line.get_xdata()) for line in ax.lines[:3])  # along x
    assert inside + above + below == 6 * 4 + 1  # points and poses alone: a curvature of three numbers is none
    plt.close(ax.figure)


def test_an_outlier_does_not_squeeze_the_residuals():
    from matplotlib import pyplot as plt

    data = with_points(DATA, sigma=1e-4)
    last = data[-1]
    (points,) = last.measurements
    shifted = attrs.evolve(points, position=np.add(points.position, [0.0, 0.02, 0.0]))
    fit = ctr.CalibrationProblem(ROBOT, [*data[:-1], attrs.evolve(last, measurements=[shifted])], [EI]).solve()
    ax = plot_residuals(fit)
    assert ax.get_ylim()[1] < 2.0  # mm, where the outlier is 20
    markers = {line.get_marker(): len(line.get_xdata()) for line in ax.lines[3:6]}  # along y
    assert markers["v"] == len(points.position)
    assert f"{len(points.position)} points beyond" in [text.get_text() for text in ax.get_legend().get_texts()]
    plt.close(ax.figure)


@pytest.mark.parametrize("names", some_slow([[EI], ["base.translation"]], [[EI]]))
def test_figures_of_few_numbers(names):
    from matplotlib import pyplot as plt

    for data in (DATA, with_points(DATA, sigma=None), experiments(ROBOT, 3, 1, noise=False)):
        figure = ctr.CalibrationProblem(ROBOT, data, names).solve().plot()
        figure.canvas.draw()
        plt.close(figure)


def test_exact_data_without_a_noise_level():
    """No division by nothing: errors are next to zero, whatever is reported of outliers."""
    data = with_points(experiments(ROBOT, 4, 1, points, noise=False), sigma=None)
    fit = problem(data=data).solve()
    assert fit.standard_errors[EI] < 1e-6 * fit.values[EI]
    assert fit.report()
