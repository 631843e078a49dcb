"""Arrays that values and results hand out: read-only, or copies. Nobody changes the answer of a later question."""

import inspect

import numpy as np
import pytest

import ctr_opt as ctr
from tests.support.bad_calls import methods


@pytest.fixture(scope="module", params=[False, None], ids=["virtual machine", "default"])
def objects(request):
    calls = methods()
    held, loads = calls["force"][1]["actuation"], calls["solve"][1]["loads"]
    fit, estimate = calls["Fit.profile"][0].__self__, calls["ForceEstimate.position"][0].__self__
    calibration, kinematics = calls["calibration"][0].__self__, calls["inverse kinematics"][0].__self__
    problem = ctr.ForwardProblem(fit.robot, compiled=request.param)
    shape, stream = problem.solve(held, loads), ctr.ForceEstimator(fit.robot, ctr.TipForce(), rate=100.0, drift=0.3)
    shape.jacobian()
    experiment, start = calibration.experiments[0], kinematics.forward.solve(held, loads)
    return {
        "shape": shape,
        "batch": problem.solve_many([held, held], loads),
        "fit": fit,
        "residual": fit.residuals[0],
        "estimate": estimate,
        "problem": problem,
        "calibration": calibration,
        "kinematics": kinematics,
        "reached": kinematics.solve(shape.tip_position, loads, initial=start),
        "path": kinematics.solve_path([shape.tip_position] * 2, loads, initial=start),
        "stream": stream,
        "streamed": stream.update(held, experiment.measurements),
        "robot": fit.robot,
        "tube": fit.robot.tubes[0],
        "piece": fit.robot.tubes[0].precurvature[1],
        "polynomial": ctr.PolynomialCurvature(0.1, [[0, 7, 0], [1, 2, 0]]),
        "actuation": held,
        "load": loads[0],
        "experiment": experiment,
        "measurement": experiment.measurements[0],
        "limits": ctr.JointLimits(rotations=[[-3, 3]] * 2, translations=[[-0.05, -0.01]] * 2),
        "base": shape.last_iterate,
    }


def arrays(value, depth=0):
    """The arrays in a value, in lists and dictionaries of any depth up to three."""
    if isinstance(value, np.ndarray):
        yield value
    elif isinstance(value, (list, tuple, dict)) and depth < 3:
        for part in value.values() if isinstance(value, dict) else value:
            yield from arrays(part, depth + 1)


def answers(of):
    """Attributes, and the answers of methods that need no arguments, by name."""
    left_out = {"plot", "compile", "bootstrap", "update"}  # slow, or figures
    for name in sorted(set(dir(of)) - left_out):
        if name.startswith("_"):
            continue
        try:
            value = getattr(of, name)
            if inspect.ismethod(value):
                needed = [p for p in inspect.signature(value).parameters.values() if p.default is p.empty]
                value = None if needed else value()
        except (ctr.CtrOptError, NotImplementedError):  # nothing to hand out
            continue
        yield name, value


def test_no_array_changes_a_later_answer(objects):
    shared = []
    for kind, of in objects.items():
        for (name, one), (_, again) in zip(answers(of), answers(of), strict=True):
            for a, b in zip(arrays(one), arrays(again), strict=True):
                if a.size and a.flags.writeable and np.shares_memory(a, b):
                    shared.append(f"{kind}.{name}")
    assert shared == []
    assert len(objects) > 20
