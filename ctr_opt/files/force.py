"""Force files: a robot, its actuation, measurements on it, and the unknown loads."""

from __future__ import annotations

import os
from collections.abc import Iterator
from typing import Any

import attrs
import numpy as np

from ..estimation.measurements import MEASUREMENTS, Measurement
from ..force.estimate import ForceEstimate
from ..force.estimation import UNKNOWN_LOADS
from ..force.problem import ForceEstimationProblem
from ..loads import LOADS
from ..loads.kind import Load
from ..robot.actuation import Actuation
from .columns import read_columns
from .described import make
from .problem import About, about, opened
from .schemas import FORCE
from .text import at

_MOST = 4.0  # standard errors: largest allowed error of an estimate from synthetic data
_DENSITY = {"s": "m", "f_x": "N/m", "f_y": "N/m", "f_z": "N/m"}
_WITHIN, _SHARE = 2.0, 0.85  # standard errors of a density, and the share of it that must lie within them


@attrs.frozen(eq=False)
class ForceProblem(About):
    """A force problem read from a file.

    Attributes
    ----------
    problem, actuation, measurements, loads
        The problem and its data; ``loads`` are the known ones.
    truth, expected
        For synthetic data: the true values, and what the estimate should be.
    """

    problem: ForceEstimationProblem
    actuation: Actuation
    measurements: tuple[Measurement, ...]
    loads: tuple[Load, ...]
    truth: dict[str, Any]
    expected: dict[str, Any]

    def solve(self) -> ForceEstimate:
        """Estimate the unknown loads."""
        return self.problem.solve(self.actuation, self.measurements, self.loads)

    def verdicts(self, estimate: ForceEstimate) -> dict[str, bool]:
        """Check the estimate against the file: statements in words, each with whether it holds."""
        verdicts = dict(self._by_truth(estimate))
        if "standard_errors" in self.expected:
            ratios = estimate.deviations / np.array(self.expected["standard_errors"])
            share = self.expected.get("share", 0.2)
            statement = f"standard errors {ratios.min():.2f} to {ratios.max():.2f} times those expected"
            verdicts[statement] = bool((np.abs(ratios - 1.0) <= share).all())
        if "consistent" in self.expected:
            verdicts["consistent" if estimate.consistent else "not consistent"] = (
                estimate.consistent is self.expected["consistent"]
            )
        if "undetermined" in self.expected:
            words = [direction.split(":")[0] for direction in estimate.undetermined]
            verdicts[f"undetermined: {', '.join(words) or 'nothing'}"] = words == self.expected["undetermined"]
        return verdicts

    def _by_truth(self, estimate: ForceEstimate) -> Iterator[tuple[str, bool]]:
        """Compare the estimate with the true values of synthetic data."""
        if "contacts" in self.truth:
            count = len(estimate.case.contacts)
            yield f"{count} contacts", count == self.truth["contacts"]
        if "force" in self.truth:
            off = np.atleast_2d(estimate.force)[0] - self.truth["force"]
            covariance = np.reshape(estimate.force_covariance, (-1, 3, 3))[0]
            size = float(np.sqrt(off @ np.linalg.pinv(covariance, hermitian=True) @ off))
            statement = (
                f"force {np.linalg.norm(off):.2g} N off the truth, {size:.1f} standard errors ({_MOST:g} allowed)"
            )
            yield statement, size <= _MOST
        if "arc_length" in self.truth:
            (place, *_), (error, *_) = np.atleast_1d(estimate.arc_length), np.atleast_1d(estimate.arc_length_error)
            off = abs(place - self.truth["arc_length"])
            statement = f"place {1e3 * off:.2g} mm off the truth, {off / error:.1f} standard errors ({_MOST:g} allowed)"
            yield statement, off <= _MOST * error
        if "density" in self.truth:
            columns = read_columns(self.path.parent / self.truth["density"], _DENSITY)
            density, errors = estimate.density(columns["s"])
            off = np.abs(density - np.column_stack([columns[f"f_{axis}"] for axis in "xyz"])) / errors
            share = float((off < _WITHIN).mean())
            statement = f"density: {share:.0%} within {_WITHIN:g} standard errors of the truth ({_SHARE:.0%} at least)"
            yield statement, share >= _SHARE


def load_force_problem(path: str | os.PathLike[str], *, on_overlap: str = "warn") -> ForceProblem:
    """Read a force problem.

    Parameters
    ----------
    path
        A TOML file with a robot, ``[actuation]``, ``[[measurements]]``, ``[[unknown]]`` and, for known loads,
        ``[[loads]]``; see ``docs/reference/files.md``. CSV files that it names are expected beside it.
    on_overlap
        As in :func:`load_robot`.

    Raises
    ------
    DefinitionError
        One sentence that names the file, the place, the value and what is allowed.

    Examples
    --------
    >>> load_force_problem("problems/force_tip/problem.toml").problem.unknown
    (TipForce(prior=None, bounds=None),)
    """
    file, data, robot = opened(path, FORCE, on_overlap)
    joints = data["actuation"]
    sigmas = {name: joints.pop(name, None) for name in ("rotation_sigma", "translation_sigma")}
    actuation = at(file, "actuation", lambda: Actuation(**joints))
    unknown, measured, loads = (
        tuple(make(file, f"{name}[{k}]", table, kinds, robot) for k, table in enumerate(data.get(name, [])))
        for name, kinds in (("unknown", UNKNOWN_LOADS), ("measurements", MEASUREMENTS), ("loads", LOADS))
    )
    loss = data.get("loss", "squared")
    problem = at(file, "", lambda: ForceEstimationProblem(robot, unknown, loss=loss, **sigmas))
    at(file, "", lambda: problem.check(actuation, measured, loads))
    return ForceProblem(
        **about(file, data),
        problem=problem,
        actuation=actuation,
        measurements=measured,
        loads=loads,
        truth=data.get("truth", {}),
        expected=data.get("expected", {}),
    )
