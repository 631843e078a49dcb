"""Synthetic experiments: what a robot with known parameters would have shown, with noise."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ..errors import DefinitionError
from ..forward import ForwardProblem
from ..robot.actuation import Actuation
from ..robot.checks import array
from ..robot.loads import Load
from ..robot.robot import Robot
from .experiment import Experiment
from .measurements import Place, PositionMeasurement, arc_length_of


def synthetic_experiments(
    robot: Robot,
    cases: Sequence[tuple[Actuation, Sequence[Load]]],
    places: Sequence[Place] = (None,),
    *,
    sigma: Any = 0.5e-3,
    seed: Any = 0,
    recorded: Mapping[int, Actuation] | None = None,
) -> list[Experiment]:
    """Experiments on a robot with positions measured under normal noise.

    Parameters
    ----------
    robot
        The true one.
    cases
        Actuation and loads of each experiment.
    places
        Where positions are measured, as in :class:`~ctr_opt.PositionMeasurement`.
    sigma
        Standard deviation, m, or one for each axis.
    seed
        Of the noise.
    recorded
        Actuations that were written down instead of the true ones, by the number of the case: mistyped ones.

    Examples
    --------
    >>> import ctr_opt as ctr
    >>> rod = ctr.Tube("rod", 1e-3, 0.0, ctr.Arc(0.1, 10.0), youngs_modulus=60e9, poisson_ratio=0.3)
    >>> len(synthetic_experiments(ctr.Robot([rod]), [(ctr.Actuation([0.0], [0.0]), [])] * 3))
    3
    """
    noise = array(np.broadcast_to(sigma, (3,)), "sigma", (3,), unit="m")
    if not cases:
        raise DefinitionError("cases = [] must hold at least one case")
    rng, problem = np.random.default_rng(seed), ForwardProblem(robot)
    found = []
    for k, (actuation, loads) in enumerate(cases):
        shape = problem.solve(actuation, loads)
        ends = np.array([tube.length for tube in robot.tubes]) + actuation.translations
        points = np.array([shape.position(arc_length_of(place, ends)) for place in places])
        points = points + noise * rng.normal(size=points.shape)
        written = (recorded or {}).get(k, actuation)
        found.append(
            Experiment(written, loads, [PositionMeasurement(list(places), points, sigma=noise)], name=f"case {k + 1}")
        )
    return found
