"""The rows of a batch: actuations and loads as the user gives them, checked."""

from __future__ import annotations

from typing import Any

import numpy as np

from ...checks import Array, array
from ...errors import DefinitionError
from ...loads.kind import Load
from ...robot.actuation import Actuation, joints_of


def rows_of_actuations(actuations: Any, tubes: int) -> tuple[Array, list[Actuation] | None]:
    """Rotations beside translations ``(k, 2 tubes)``, checked; the objects, if such were given."""
    if isinstance(actuations, tuple) and len(actuations) == 2 and not isinstance(actuations[0], Actuation):
        rotations = array(actuations[0], "rotations", (None, tubes), unit="rad")
        translations = array(actuations[1], "translations", (None, tubes), unit="m")
        if len(rotations) != len(translations):
            raise DefinitionError(f"rotations has {len(rotations)} rows and translations {len(translations)}")
        above = np.argwhere(translations > 0.0)
        if len(above):
            k, i = (int(each) for each in above[0])
            raise DefinitionError(
                f"translations[{k}, {i}] = {translations[k, i]:g} m puts the base of tube {i} in front of the entry "
                "point: it must be at most 0"
            )
        return np.hstack((rotations, translations)), None
    given = list(actuations)
    for k, actuation in enumerate(given):
        if not isinstance(actuation, Actuation) or len(actuation.rotations) != tubes:
            raise DefinitionError(f"actuations[{k}] = {actuation!r} must be an Actuation of {tubes} tubes")
    rows = np.array([joints_of(actuation) for actuation in given]).reshape(len(given), 2 * tubes)
    return rows, given


def rows_of_loads(loads: Any, count: int) -> list[tuple[Load, ...]]:
    """The loads of every row: the same for all, or a list for each."""
    given = list(loads)
    if all(isinstance(load, Load) for load in given):
        return [tuple(given)] * count
    if len(given) != count:
        raise DefinitionError(
            f"loads has {len(given)} entries, but there are {count} actuations: give one list of loads for all, "
            "or one for each"
        )
    for k, each in enumerate(given):
        if isinstance(each, Load):
            raise DefinitionError(f"loads[{k}] must be a list of loads, as others are")
    return [tuple(each) for each in given]
