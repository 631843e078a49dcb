"""The record of what was tried, and in which order."""

import numpy as np

import ctr_opt as ctr
from ctr_opt.forward.attempt import Attempt, Failed, path_of
from ctr_opt.forward.ways import COLD
from tests.support.physics import held, rod


def test_records_make_the_text_of_a_path():
    attempts = [
        Attempt("homotopy", iterations=80, reached=0.6761),
        Attempt("energy", saddles=1),
        Attempt("newton", outcome="failed"),
        Attempt("energy", outcome="neutral"),
        Attempt("energy", outcome="neutral"),
        Attempt("homotopy around folds", reached=0.5, folds=2),
    ]
    assert path_of(attempts) == (
        "homotopy (ended at 0.676) -> energy (1 saddle left) -> newton (failed) -> energy (neutral) (2 meshes) -> "
        "homotopy around folds (2 passed) (ended at 0.5)"
    )
    assert path_of([]) == ""


def test_failures_together_have_the_status_of_the_one_that_came_furthest():
    status = ctr.SolveStatus
    failures = [
        Failed(status.FOLD, "a fold", np.ones(3), reached=0.9),
        Failed(status.NEWTON_FAILED, "no convergence", np.zeros(3)),
        Failed(status.INACCURATE, "the tolerance was missed", np.ones(3), reached=1.0),
    ]
    both, all_three = Failed.joined(failures[:2]), Failed.joined(failures)
    assert (both.status, both.reached) == (status.FOLD, 0.9)
    assert (all_three.status, all_three.reached) == (status.INACCURATE, 1.0)
    assert str(both) == "a fold; no convergence"


def test_ways_are_tried_in_their_order_under_their_conditions(caplog):
    """A column past Euler's load: with a potential by energy right after the homotopy, else through all paths first."""
    critical = np.pi**2 / 4 * 0.02 / 0.1**2
    push = ctr.PointWrench([0.0, 0.0, -1.5 * critical])
    tilt = ctr.PointWrench([0.0, 0.0, 0.0], [1e-9, 0.0, 0.0])  # as good as nothing, but without a potential
    tried = {}
    for loads in ([push], [push, tilt]):
        with caplog.at_level("DEBUG", logger="ctr_opt.forward.ways"):
            caplog.clear()
            ctr.ForwardProblem(rod(), compiled=False).solve(held(), loads, throw=False)
        tried[len(loads)] = [record.args[0] for record in caplog.records if record.levelname == "DEBUG"]
    assert tried[1] == [way.name for way in COLD[:2]]
    tried[2].remove("newton from initial")  # the last equilibrium of the robot on the way, polished
    assert tried[2] == [COLD[k].name for k in (0, 2, 3, 4)]
