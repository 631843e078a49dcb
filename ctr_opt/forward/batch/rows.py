"""The rows of a batch: actuations and loads as the user gives them, checked."""

from __future__ import annotations

from typing import Any

import numpy as np

from ...checks import Array, array, listed
from ...errors import DefinitionError
from ...loads.kind import Load
from ...robot.actuation import Actuation, joints_of


def rows_of_actuations(actuations: Any, tubes: int) -> tuple[Array, list[Actuation] | None]:
    """Checked rotations and translations ``(k, 2 tubes)``, and the actuations if objects were given."""
    if isinstance(actuations, tuple) and len(actuations) == 2 and not isinstance(actuations[0], Actuation):
        rotations = array(actuations[0], "rotations", (None, tubes), unit="rad")
        translations = array(actuations[1], "translations", (None, tubes), unit="m")
        if len(rotations) != len(translations):
            raise DefinitionError(
                f"rotations has {len(rotations)} rows, but translations has {len(translations)}: give the same number"
            )
        above = np.argwhere(translations > 0.0)
        if len(above):
            k, i = above[0].tolist()
            raise DefinitionError(
                f"translations[{k}, {i}] = {translations[k, i]:g} m puts the base of tube {i} in front of the entry "
                "point: it must be at most 0"
            )
        return np.hstack((rotations, translations)), None
    objects = listed(actuations, "actuations", "a list of Actuations, or a pair of rotations and translations")
    for k, actuation in enumerate(objects):
        if not isinstance(actuation, Actuation) or len(actuation.rotations) != tubes:
            raise DefinitionError(f"actuations[{k}] = {actuation!r} must be an Actuation of {tubes} tubes")
    rows = np.array([joints_of(actuation) for actuation in objects]).reshape(len(objects), 2 * tubes)
    return rows, objects


def rows_of_loads(loads: Any, count: int, rows: str = "actuations") -> list[tuple[Load, ...]]:
    """The loads of every row, from one list for all rows or one list for each; messages call them ``rows``."""
    wanted = f"a list of loads for all {rows}, or a list of such lists, one for each"
    entries = listed(loads, "loads", wanted)
    if all(isinstance(load, Load) for load in entries):
        return [tuple(entries)] * count
    if len(entries) != count:
        raise DefinitionError(
            f"loads has {len(entries)} entries, but there are {count} {rows}: give one list of loads for all, "
            "or one for each"
        )
    for k, row in enumerate(entries):
        if isinstance(row, Load):
            raise DefinitionError(f"loads[{k}] must be a list of loads, like the other entries")
        for j, load in enumerate(listed(row, f"loads[{k}]", "a list of loads")):
            if not isinstance(load, Load):
                raise DefinitionError(f"loads[{k}][{j}] = {load!r} must be a load")
    return [tuple(row) for row in entries]
