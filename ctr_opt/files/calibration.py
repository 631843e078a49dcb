"""Calibration files: a robot, a table of experiments, the parameters to estimate, and checks of the answer."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import attrs
import numpy as np

from ..calibration.problem import CalibrationProblem
from ..calibration.unknowns import Parameter
from ..checks import Array, choice, number
from ..errors import DefinitionError
from ..estimation.experiment import Experiment
from ..estimation.losses import LOSSES
from ..estimation.measurements import COLUMNS
from ..robot.robot import Robot
from .described import read
from .experiments import read_experiments
from .problem import About, Problem, about, load_problem, opened
from .schemas import CALIBRATION, PARAMETER
from .text import at


@attrs.frozen(eq=False)
class Check:
    """A problem with a measured tip, ``tip_position (3,)``, m, that is predicted and not fitted."""

    problem: Problem
    tip_position: Array


def _share(value: Any) -> float:
    return number(value, "hold_out.share", above=0.0, most=1.0)


@attrs.frozen
class HoldOut:
    """A share of the experiments, drawn at random with a seed, that is predicted but not fitted.

    >>> HoldOut(0.4, seed=1).of(5)
    [0, 4]
    """

    share: float = attrs.field(converter=_share)
    seed: int

    def of(self, count: int) -> list[int]:
        """Draw the indices of the held-out experiments among ``count``."""
        held = np.random.default_rng(self.seed).permutation(count)[: round(self.share * count)]
        if not 0 < len(held) < count:
            raise DefinitionError(
                f"hold_out.share = {self.share:g} of {count} experiments must hold out at least one and keep one"
            )
        return sorted(int(k) for k in held)


@attrs.frozen(eq=False)
class Calibration(About):
    """A calibration read from a file.

    Attributes
    ----------
    robot, experiments, parameters, losses
        The robot, the experiments to fit, the parameters to estimate, and the losses to minimize.
    hold_out, held
        The experiments of the table that are predicted but not fitted.
    sigma
        Standard deviations of ``position`` (m) and ``direction`` (rad), if given.
    sensor
        Name of the sensor that measured the tip's position and direction; None: the tip itself was measured.
    checks
        Problems that are predicted but not fitted.
    truth
        The true parameters of synthetic data.
    """

    robot: Robot
    table: Path
    experiments: tuple[Experiment, ...]
    parameters: tuple[str | Parameter, ...]
    losses: tuple[str, ...]
    sigma: dict[str, Any]
    sensor: str | None = None
    hold_out: HoldOut | None = None
    held: tuple[Experiment, ...] = ()
    checks: tuple[Check, ...] = ()
    truth: dict[str, Any] = attrs.field(factory=dict)

    def problem(self, loss: str) -> CalibrationProblem:
        """Make the calibration problem with one of the losses."""
        return CalibrationProblem(self.robot, self.experiments, self.parameters, loss=loss)


def load_calibration(path: str | os.PathLike[str], *, on_overlap: str = "warn", measured: bool = True) -> Calibration:
    """Read a calibration file and its table of experiments.

    Parameters
    ----------
    path
        A TOML file. ``experiments`` names a CSV file beside it as for
        :func:`~ctr_opt.files.experiments.read_experiments`. ``sensor`` is given if a sensor measured the tips.
        ``parameters`` are names, or tables with the arguments of :class:`~ctr_opt.Parameter`. ``losses``, ``[sigma]``
        and ``[hold_out]``, with ``share`` and ``seed`` of the experiments that are not fitted, are optional.
    on_overlap
        As in :func:`load_robot`.
    measured
        Whether to read the table.

    Raises
    ------
    DefinitionError
        One sentence that names the file, the place, the value and what is allowed.

    Examples
    --------
    >>> len(load_calibration("problems/rjw_s1/calibration.toml").experiments)
    80
    """
    file, data, robot = opened(path, CALIBRATION, on_overlap)
    table, sigma = file.parent / data["experiments"], data.get("sigma", {})
    tubes = len(robot.tubes)
    noise = {"sigma": sigma.get("position"), "direction_sigma": sigma.get("direction"), "sensor": data.get("sensor")}
    noise["sigmas"] = {name: sigma[name] for name in COLUMNS if name in sigma}
    rows = read_experiments(table, tubes, **noise) if measured else []
    hold_out = at(file, "", lambda: HoldOut(**data["hold_out"]) if "hold_out" in data else None)
    held = at(file, "", lambda: hold_out.of(len(rows)) if hold_out and rows else [])
    losses = tuple(data.get("losses", ["squared"]))
    for loss in losses:
        at(file, "", lambda loss=loss: choice(loss, "losses", LOSSES))  # type: ignore[misc]
    checks = tuple(
        Check(load_problem(file.parent / check["problem"]), np.array(check["tip_position"]))
        for check in data.get("checks", [])
    )
    calibration = Calibration(
        **about(file, data),
        robot=robot,
        table=table,
        experiments=tuple(row for k, row in enumerate(rows) if k not in held),
        parameters=tuple(_parameter(file, k, entry) for k, entry in enumerate(data["parameters"])),
        losses=losses,
        sigma=sigma,
        sensor=data.get("sensor"),
        hold_out=hold_out,
        held=tuple(rows[k] for k in held),
        checks=checks,
        truth=data.get("truth", {}),
    )
    if measured:
        at(file, "", lambda: calibration.problem(losses[0]))
    return calibration


def _parameter(file: Path, k: int, entry: Any) -> str | Parameter:
    """Read a parameter: a name, or a table with a name and further arguments."""
    if isinstance(entry, str):
        return entry
    return at(file, "", lambda: Parameter(**read(PARAMETER, entry, f"parameters[{k}]")))
