"""Schemas of robot, problem, plan, calibration and force files; see :func:`ctr_opt.files.described.read`."""

from __future__ import annotations

from typing import Any

from ..checks import Entry
from ..estimation.measurements import COLUMNS
from ..robot.actuation import Actuation
from ..robot.tube import Tube

_TEXT, _WHOLE, _NUMBER, _ANY = Entry("text"), Entry("whole"), Entry("1"), Entry("any")
_LENGTH, _POINT, _ANGLE = Entry("m"), Entry("m", (3,)), Entry("rad")
_LOADS = Entry("any", (None,), says="tables [[loads]]")

_SOURCE = {"text": _TEXT, "does_not_claim?": _TEXT}
_SOLVER = {"formulation?": _TEXT, "tolerance?": _NUMBER, "integrator?": _TEXT}
_ABOUT: dict[str, Any] = {"title": _TEXT, "description?": _TEXT, "robot": _TEXT, "source?": _SOURCE}

_PIECES = Entry("any", (None,), says="a list of pieces")
ROBOT = {
    "name?": _TEXT,
    "source?": _SOURCE,
    "base?": {"pose": Entry("1", (4, 4))},
    "tubes": [{"name": _TEXT, **Tube.in_files(), "precurvature": _PIECES}],
}
PROBLEM = {
    **_ABOUT,
    "actuation": Actuation.in_files(),
    "loads?": _LOADS,
    "solver?": _SOLVER,
    "expected?": {
        "text": _TEXT,
        "tip_position?": _POINT,
        "tip_height_and_distance?": Entry("m", (2,)),
        "position_tolerance?": _LENGTH,
        "tip_direction?": Entry("1", (3,)),
        "direction_tolerance?": _NUMBER,
        "base_torsions?": Entry("1/m", (None,)),
        "torsion_tolerance?": Entry("1/m"),
    },
}
PLAN = {
    **_ABOUT,
    "cases": _TEXT,
    "solver?": _SOLVER,
    "expected?": {"text": _TEXT, "position_tolerance": _LENGTH},
}
PARAMETER = {"name": _TEXT, "prior?": _ANY, "bounds?": _ANY, "initial?": _ANY, "tied?": Entry("text", (None,))}
CALIBRATION = {
    **_ABOUT,
    "experiments": _TEXT,
    "sensor?": _TEXT,
    "parameters": Entry("any", (None,)),
    "losses?": Entry("text", (None,)),
    "sigma?": {
        **{"position?": Entry("m", (3,), scalar_too=True), "direction?": _ANGLE},
        **{f"{name}?": Entry(unit, (3,), scalar_too=True) for name, unit in COLUMNS.items()},
    },
    "hold_out?": {"share": _NUMBER, "seed": _WHOLE},
    "checks?": [{"problem": _TEXT, "tip_position": _POINT}],
    "truth?": {"values": _ANY, "seed": _WHOLE, "outlier?": _WHOLE, "rotation?": _ANGLE, "rows?": _WHOLE},
}
_ERRORS = {
    "rotation_sigma?": Entry("rad", (None,), scalar_too=True),
    "translation_sigma?": Entry("m", (None,), scalar_too=True),
}
FORCE = {
    **_ABOUT,
    "loss?": _TEXT,
    "actuation": {**Actuation.in_files(), **_ERRORS},
    "unknown": Entry("any", (None,), says="tables [[unknown]]"),
    "measurements": Entry("any", (None,), says="tables [[measurements]]"),
    "loads?": _LOADS,
    "truth?": {
        **{"force?": Entry("N", (3,)), "arc_length?": _LENGTH, "density?": _TEXT},
        **{"contacts?": _WHOLE, "seed?": _WHOLE},
    },
    "expected?": {
        "text": _TEXT,
        "standard_errors?": Entry("N", (None,)),
        "share?": _NUMBER,
        "consistent?": Entry("flag"),
        "undetermined?": Entry("text", (None,)),
    },
}
