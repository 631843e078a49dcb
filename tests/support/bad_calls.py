"""Calls of the public interface with one bad argument each: what they raise, and how long they take."""

import inspect
import signal
import time
import warnings
from contextlib import contextmanager

import numpy as np

import ctr_opt as ctr

LONGEST = 5.0  # s that a bad call may take
_RECURSIVE: list = []
_RECURSIVE.append(_RECURSIVE)


class Failing:
    """Something whose own conversions fail."""

    def __array__(self, *_, **__):
        raise RuntimeError("no array")

    def __float__(self):
        raise RuntimeError("no float")


def bad_values():
    """Some sixty values; each is wrong for nearly every argument, and may be right for a few."""
    masked = np.ma.array([1.0, 2.0, 3.0], mask=[0, 1, 0])
    numbers = [float("nan"), float("inf"), -float("inf"), 10**400, -(10**400), 1e-320, 1e308, 2**63, -1, 0, 3, 1.5]
    words = [None, True, False, "", "x", "\0", "nan", "1e400", b"", b"bytes", 1j, np.float32("nan"), slice(None), ...]
    lists = [[], [[]], (), {}, set(), {"a": 1}, [[1, 2], [3]], [[1, 2], [3, [4]]], [None] * 3, [1j, 0, 0], _RECURSIVE]
    lists += [[True, False, True], [1e-320] * 3, [Failing()], range(3), (k for k in [1])]
    arrays = [np.zeros((0, 3)), np.zeros((3, 0)), np.zeros((2, 2, 2)), masked, np.ma.masked, np.array(5), np.zeros(3)]
    arrays += [np.datetime64("2020"), np.array(["a", "b"]), np.array([None, 1]), np.array([object()]), -np.ones(3)]
    arrays += [np.full(3, np.nan), np.full(3, 1e200), np.array([[1.0, 2.0], [3.0, 4.0]])]
    return [*numbers, *words, *lists, *arrays, object(), Failing(), int, lambda: 1]


def values():
    """Public values with arguments that are right, by name."""
    arc, material = ctr.Arc(0.1, 5.0), {"youngs_modulus": 60e9, "poisson_ratio": 0.3}
    tube = {"name": "a", "outer_diameter": 1e-3, "inner_diameter": 5e-4, "precurvature": arc}
    point, span = {"arc_length": 0.05, "tube": 0}, {"start": 0.0, "end": 0.05, "tube": 0}
    pushed = {"force": [0.0, 0.0, 1.0], "moment": [0.0, 0.0, 0.0], "frame": "world"}
    held = ctr.Actuation([0.0], [0.0])
    return {
        "Tube": (ctr.Tube, tube | material),
        "Tube by stiffness": (
            ctr.Tube,
            tube | {"bending_stiffness": 0.01, "torsional_stiffness": 0.01, "density": 6e3},
        ),
        "Robot": (ctr.Robot, {"tubes": [ctr.Tube(**tube, **material)], "base_pose": np.eye(4)}),
        "Straight": (ctr.Straight, {"length": 0.1}),
        "Arc": (ctr.Arc, {"length": 0.1, "curvature": 5.0}),
        "PolynomialCurvature": (ctr.PolynomialCurvature, {"length": 0.1, "coefficients": [[0, 7, 0], [1, 2, 0]]}),
        "SampledCurvature": (ctr.SampledCurvature, {"arc_length": [0, 0.02], "curvature": [[0, 7, 0], [0, 8, 0]]}),
        "Actuation": (ctr.Actuation, {"rotations": [0.0, 1.0], "translations": [-0.1, -0.05]}),
        "PointWrench": (ctr.PointWrench, pushed | point),
        "DistributedLoad": (ctr.DistributedLoad, pushed | span),
        "Gravity": (ctr.Gravity, {"acceleration": [0.0, 0.0, -9.81]}),
        "PointMass": (ctr.PointMass, {"mass": 0.01} | point),
        "DistributedMass": (ctr.DistributedMass, {"mass_per_length": 0.01} | span),
        "Spring": (ctr.Spring, {"stiffness": 10.0, "anchor": [0.0, 0.0, 0.1]} | point),
        "Homotopy": (ctr.Homotopy, {"first_step": 0.25, "smallest_step": 1e-5, "max_steps": 400}),
        "Newton": (ctr.Newton, {"max_iterations": 30, "contraction": 1.0, "shortest_step": 1e-3, "negligible": 1e-9}),
        "Ipopt": (ctr.Ipopt, {"tolerance": 1e-10, "max_iterations": 100, "start": None}),
        "PositionMeasurement": (ctr.PositionMeasurement, {"arc_length": 0.02, "position": [0, 0, 0.02], "sigma": 1e-4}),
        "BackboneMeasurement": (
            ctr.BackboneMeasurement,
            {"position": [[0, 0, 0.02], [0, 0, 0.04]], "sigma": 1e-4, "ordered": True},
        ),
        "PoseMeasurement": (
            ctr.PoseMeasurement,
            {"arc_length": None, "pose": np.eye(4), "sigma": [1e-4] * 3 + [0.01] * 3, "tube": 0},
        ),
        "TangentMeasurement": (ctr.TangentMeasurement, {"arc_length": None, "direction": [0, 0, 1.0], "sigma": 0.01}),
        "CurvatureMeasurement": (
            ctr.CurvatureMeasurement,
            {"arc_length": [0.02], "curvature": [[1.0, 0.0]], "sigma": 0.1, "tube": 0},
        ),
        "TorqueMeasurement": (ctr.TorqueMeasurement, {"tube": 0, "torque": 1e-3, "sigma": 1e-4}),
        "ForceMeasurement": (ctr.ForceMeasurement, {"tube": 0, "force": 0.1, "sigma": 0.01}),
        "BaseWrenchMeasurement": (ctr.BaseWrenchMeasurement, {"wrench": np.zeros(6), "sigma": (0.01, 0.001)}),
        "Experiment": (
            ctr.Experiment,
            {"actuation": held, "loads": [], "measurements": [ctr.PositionMeasurement(None, [0, 0, 0.1], 1e-4)]},
        ),
        "Parameter": (
            ctr.Parameter,
            {"name": "tubes[0].bending_stiffness", "prior": (0.01, 0.001), "bounds": (0.001, 0.1), "tied": ()},
        ),
        "TipForce": (ctr.TipForce, {"prior": (0.0, 1.0), "bounds": (-1.0, 1.0)}),
        "PointForce": (
            ctr.PointForce,
            {"arc_length": 0.05, "tube": 0, "prior": (0.0, 1.0), "normal": [0, 1, 0], "friction": 0.3},
        ),
        "PointForce somewhere": (
            ctr.PointForce,
            {"between": (0.02, 0.05), "place_prior": (0.04, 0.01), "prior": (0.0, 1.0), "bounds": (-1.0, 1.0)},
        ),
        "Contacts": (ctr.Contacts, {"most": 2, "tube": 0, "prior": (0.0, 1.0), "bounds": None, "between": None}),
        "DistributedForce": (
            ctr.DistributedForce,
            {"coefficients": 12, "start": 0.0, "end": 0.05, "degree": 3, "prior": (0.0, 10.0), "smoothness": 1e-3},
        ),
        "JointLimits": (ctr.JointLimits, {"rotations": [[-3, 3]], "translations": [[-0.05, -0.01]], "base_gap": 1e-3}),
        "Distal": (ctr.Distal, {"tube": 0}),
    }


METHODS = (
    "ForwardProblem",
    "solve",
    "solve_many",
    "guess",
    "neighbour",
    "function",
    "sample",
    "position",
    "pose",
    "curvature",
    "torsion",
    "tube_moment",
    "jacobian",
    "compliance",
    "sensitivity",
    "actuator_wrench",
    "sensitivity at a place",
    "CalibrationProblem",
    "calibration",
    "Fit.actuation",
    "Fit.profile",
    "Fit.without",
    "Fit.errors_without",
    "Fit.tested",
    "ForceEstimationProblem",
    "force",
    "ForceEstimate.position",
    "ForceEstimator",
    "InverseKinematicsProblem",
    "inverse kinematics",
)


def methods():
    """Methods of problems and results with arguments that are right, by name."""
    material = {"youngs_modulus": 60e9, "poisson_ratio": 0.3}
    inner = ctr.Tube("inner", 1e-3, 6e-4, [ctr.Straight(0.06), ctr.Arc(0.05, 8.0)], **material)
    outer = ctr.Tube("outer", 1.6e-3, 1.2e-3, [ctr.Straight(0.05), ctr.Arc(0.03, 5.0)], **material)
    robot, loads = ctr.Robot([inner, outer]), [ctr.PointWrench([0.05, 0.0, 0.0])]
    held, turned = ctr.Actuation([0.0, 1.2], [-0.03, -0.02]), ctr.Actuation([1.0, 0.0], [-0.03, -0.02])
    problem = ctr.ForwardProblem(robot)
    shape, other = problem.solve(held, loads), problem.solve(turned, loads)
    seen = ctr.PositionMeasurement([0.02, 0.05, 0.08], shape.position([0.02, 0.05, 0.08]), 1e-4)
    experiments = [ctr.Experiment(held, loads, [seen])]
    experiments += [ctr.Experiment(turned, loads, [ctr.PositionMeasurement(None, other.tip_position, 1e-4)])]
    calibration = ctr.CalibrationProblem(robot, experiments, ["tubes[0].bending_stiffness"])
    fit, force = calibration.solve(), ctr.ForceEstimationProblem(robot, [ctr.TipForce()])
    estimate, kinematics = force.solve(held, seen), ctr.InverseKinematicsProblem(robot)
    solve = {"actuation": held, "loads": loads, "initial": shape}
    options = {"formulation": "automatic", "method": None, "integrator": "RK8", "tolerance": 1e-7, "compiled": None}
    at = {
        "sample": {},
        "position": {},
        "pose": {"tube": 0},
        "curvature": {},
        "torsion": {"tube": 0},
        "tube_moment": {"tube": 0},
    }
    rates = {"jacobian": {"s": 0.02, "side": 1}, "compliance": {"s": 0.02, "load_at": 0.03, "tube": 0}}
    rates |= {"sensitivity": {"of": "tip_position", "wrt": "rotations", "order": 1, "side": 1}}
    rates |= {"actuator_wrench": {"tube": 0, "side": 1}}
    return {
        "ForwardProblem": (ctr.ForwardProblem, {"robot": robot} | options),
        "solve": (problem.solve, solve | {"throw": True}),
        "solve_many": (problem.solve_many, {"actuations": [held], "loads": loads, "initial": shape, "chained": True}),
        "guess": (problem.guess, {"actuation": held, "loads": loads, "bending": [0, 0], "torsional": [0, 0]}),
        "neighbour": (problem.neighbour, solve),
        "function": (problem.function, {"initial": shape, "wrt": ["rotations"], "along": (), "steps": None}),
        **{name: (getattr(shape, name), {"s": 0.02} | more) for name, more in at.items()},
        **{name: (getattr(shape, name), arguments) for name, arguments in rates.items()},
        "sensitivity at a place": (shape.sensitivity, {"of": ("position", 0.02), "wrt": ["rotations", "translations"]}),
        "CalibrationProblem": (
            ctr.CalibrationProblem,
            {"robot": robot, "experiments": experiments, "parameters": calibration.parameters, "loss": "squared"},
        ),
        "calibration": (calibration.solve, {"method": "simultaneous"}),
        "Fit.actuation": (fit.actuation, {"rotations": [0, 1.0], "translations": [-0.03, -0.02]}),
        "Fit.profile": (fit.profile, {"label": fit.labels[0], "count": 3, "width": 2.0}),
        "Fit.without": (fit.without, {"experiments": 0}),
        "Fit.errors_without": (fit.errors_without, {"experiments": [0]}),
        "Fit.tested": (fit.tested, {"experiments": experiments}),
        "ForceEstimationProblem": (
            ctr.ForceEstimationProblem,
            {"robot": robot, "unknown": [ctr.TipForce()], "loss": "squared", "compiled": None},
        ),
        "force": (force.solve, {"actuation": held, "measurements": seen, "loads": [], "fit": None}),
        "ForceEstimate.position": (estimate.position, {"s": 0.02}),
        "ForceEstimator": (
            ctr.ForceEstimator,
            {"robot": robot, "unknown": ctr.TipForce(), "rate": 100.0, "drift": 0.3, "horizon": 5, "outlier": 30.0},
        ),
        "InverseKinematicsProblem": (ctr.InverseKinematicsProblem, {"robot": robot, "limits": None}),
        "inverse kinematics": (kinematics.solve, {"target_position": shape.tip_position, "initial": shape}),
    }


@contextmanager
def limited():
    """Raise TimeoutError in what takes longer than a bad call may."""

    def stop(*_):
        raise TimeoutError(f"over {LONGEST:g} s")

    before = signal.signal(signal.SIGALRM, stop)
    signal.setitimer(signal.ITIMER_REAL, LONGEST)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)


def undeclared(call, arguments):
    """What bad calls raise that is not declared, or how long they take if that is too long, as texts."""
    faults = []
    assert set(arguments) <= set(inspect.signature(call).parameters)
    call(**arguments)
    for name in arguments:
        for k, value in enumerate(bad_values()):
            begin = time.perf_counter()
            try:
                with limited(), warnings.catch_warnings():
                    warnings.simplefilter("error")
                    warnings.simplefilter("ignore", ctr.NestingWarning)
                    warnings.simplefilter("ignore", ctr.EstimationWarning)
                    call(**arguments | {name: value})
            except ctr.CtrOptError:
                pass
            except Exception as error:
                faults.append(f"{name} = value {k}: {type(error).__name__}: {str(error)[:80]}")
            if time.perf_counter() - begin > LONGEST:
                faults.append(f"{name} = value {k}: {time.perf_counter() - begin:.1f} s")
    return faults
