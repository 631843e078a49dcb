"""Synthetic experiments: simulated measurements of a robot with known parameters, with noise."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from ctr_opt.checks import array
from ctr_opt.errors import DefinitionError
from ctr_opt.estimation.experiment import Experiment
from ctr_opt.estimation.measurements import Measurement, PositionMeasurement, TangentMeasurement
from ctr_opt.estimation.sensors import Mounting
from ctr_opt.forward.equilibrium import Equilibrium
from ctr_opt.forward.problem import ForwardProblem
from ctr_opt.layout.observables import Place, arc_length_of
from ctr_opt.loads.kind import Load
from ctr_opt.robot.actuation import Actuation
from ctr_opt.robot.robot import Robot


def synthetic_experiments(
    robot: Robot,
    cases: Sequence[tuple[Actuation, Sequence[Load]]],
    places: Sequence[Place] = (None,),
    *,
    sigma: Any = 0.5e-3,
    seed: Any = 0,
    recorded: Mapping[int, Actuation] | None = None,
) -> list[Experiment]:
    """Simulate experiments with positions measured under normal noise.

    Parameters
    ----------
    robot
        The true robot.
    cases
        Actuation and loads of each experiment.
    places
        Where positions are measured, as in :class:`~ctr_opt.PositionMeasurement`.
    sigma
        Standard deviation, m, or one for each axis.
    seed
        Seed of the noise.
    recorded
        Mistyped actuations that replace the true ones in the record, by the number of the case.

    Examples
    --------
    >>> import ctr_opt as ctr
    >>> rod = ctr.Tube("rod", 1e-3, 0.0, ctr.Arc(0.1, 10.0), youngs_modulus=60e9, poisson_ratio=0.3)
    >>> len(synthetic_experiments(ctr.Robot([rod]), [(ctr.Actuation([0.0], [0.0]), [])] * 3))
    3
    """
    noise = array(np.broadcast_to(sigma, (3,)), "sigma", (3,), unit="m")
    rng = np.random.default_rng(seed)

    def measured(shape: Equilibrium) -> list[Measurement]:
        ends = shape.configuration.ends
        points = np.array([shape.position(arc_length_of(place, ends)) for place in places])
        points = points + noise * rng.normal(size=points.shape)
        return [PositionMeasurement(list(places), points, sigma=noise)]

    return _experiments(robot, cases, recorded or {}, measured)


def synthetic_tip_poses(
    robot: Robot,
    cases: Sequence[tuple[Actuation, Sequence[Load]]],
    sensor: str,
    mounting: Mounting,
    *,
    sigma: float = 0.5e-3,
    direction_sigma: float = 0.01,
    seed: Any = 0,
    recorded: Mapping[int, Actuation] | None = None,
) -> list[Experiment]:
    """Simulate experiments with position and direction of a sensor at the tip, measured under normal noise.

    Parameters
    ----------
    robot, cases, seed, recorded
        As in :func:`synthetic_experiments`.
    sensor, mounting
        Name of the sensor, and its pose in the innermost tube's frame: translation ``(3,)``, m, and XYZ Euler angles
        ``(3,)``, rad.
    sigma, direction_sigma
        Standard deviations of each coordinate, m, and of the angle about each axis across the direction, rad.
    """
    from scipy.spatial.transform import Rotation

    rng = np.random.default_rng(seed)
    translation, angles = mounting
    axis = Rotation.from_euler("XYZ", angles).as_matrix()[:, 2]

    def measured(shape: Equilibrium) -> list[Measurement]:
        frame, tip = shape.tip_pose[:3, :3], shape.tip_position
        point = tip + frame @ translation + sigma * rng.normal(size=3)
        direction = frame @ axis + direction_sigma * rng.normal(size=3)
        return [
            PositionMeasurement(None, point, sigma, sensor),
            TangentMeasurement(None, direction, direction_sigma, sensor),
        ]

    return _experiments(robot, cases, recorded or {}, measured)


def _experiments(
    robot: Robot,
    cases: Sequence[tuple[Actuation, Sequence[Load]]],
    recorded: Mapping[int, Actuation],
    measured: Callable[[Equilibrium], list[Measurement]],
) -> list[Experiment]:
    if not cases:
        raise DefinitionError("cases = [] must hold at least one case")
    problem, experiments = ForwardProblem(robot), []
    for k, (actuation, loads) in enumerate(cases):
        measurements = measured(problem.solve(actuation, loads))
        experiments.append(Experiment(recorded.get(k, actuation), loads, measurements, name=f"case {k + 1}"))
    return experiments
