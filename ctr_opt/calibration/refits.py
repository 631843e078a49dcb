"""Refits from a finished fit: to other experiments, or with one number held."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from typing import Any, TypeVar

import attrs
import numpy as np

from ..checks import Array, choice, listed, number, whole
from ..errors import DefinitionError, EstimationError, EstimationWarning
from ..estimation.experiment import Experiment
from .estimation import Estimation
from .reduced import FitPoint, solve_reduced
from .solution import CalibrationSolution, Residual

Fit = TypeVar("Fit", bound=CalibrationSolution)

_MOST_VALUES, _MOST_REPETITIONS = 10_000, 1_000_000
_FEW = 0.05  # the share of a bootstrap's repetitions that may be left out


def profile(fit: CalibrationSolution, label: str, count: int, width: float) -> tuple[Array, Array]:
    """Values of one number, and the excess loss with all other numbers refitted."""
    count, width = whole(count, "count", 1, _MOST_VALUES), number(width, "width", above=0.0)
    choice(label, "label", fit.labels)
    estimation, k = fit.estimation, fit.labels.index(label)
    error = float(fit.deviations[k])
    if not np.isfinite(error):
        raise EstimationError(f"{label} has no profile: the data do not determine it")
    lower, upper = (bound[k] for bound in estimation.unknowns.bounds)
    middle = fit.outcome.x[k]
    values = np.linspace(max(middle - width * error, lower), min(middle + width * error, upper), count)
    costs = []
    for value in values:
        x = fit.outcome.x.copy()
        x[k] = value
        point = _answer(f"the profile at {label} = {value:g}", estimation, fit.equilibria, start=x, fixed=[k])
        linearized = estimation.linearize(point.x, point.states)
        costs.append(estimation.cost(linearized) + estimation.prior_cost(point.x) - fit.objective)
    return values, np.array(costs)


def without(fit: Fit, experiments: Sequence[int] | int) -> Fit:
    """Refit to all experiments except the given ones."""
    _check_shared(fit)
    dropped = _numbered(fit, experiments)
    kept = [k for k in range(len(fit.estimation.experiments)) if k not in dropped]
    if not kept:
        raise DefinitionError("experiments: at least one must be left")
    return _refit(fit, kept, f"the fit without {_listed(dropped)}")


def errors_without(fit: CalibrationSolution, experiments: Sequence[int] | int) -> list[Residual]:
    """Residuals of held-out experiments, predicted by a refit to all others."""
    numbers = _numbered(fit, experiments)
    held = [fit.estimation.experiments[k] for k in numbers]
    predicted = tested(without(fit, numbers), held, f"the estimates without {_listed(numbers)}")
    return [attrs.evolve(residual, experiment=numbers[residual.experiment]) for residual in predicted.residuals]


def tested(fit: Fit, experiments: Sequence[Experiment], whose: str) -> Fit:
    """The estimates of a fit, compared with other experiments."""
    _check_shared(fit)
    homes = fit.estimation.unknowns.homes_at(fit.outcome.x)
    experiments = listed(experiments, "experiments", "a list of experiments")
    for k, experiment in enumerate(experiments):
        if isinstance(experiment, Experiment) and homes.within(experiment.actuation):
            raise DefinitionError(
                f"experiments[{k}]: the actuation already has the homes that the fit adds: give the joint readings"
            )
    estimation = fit.estimation.of(experiments).framed_at(fit.outcome.x)
    states = estimation.states(fit.outcome.x, estimation.equilibria_of(fit.outcome.x, whose))
    return type(fit)(estimation, attrs.evolve(fit.outcome, states=states), fit.method)


def bootstrap(fit: CalibrationSolution, repetitions: int, seed: int) -> Array:
    """Estimates from resampled experiments, one row for each successful repetition."""
    _check_shared(fit)
    repetitions = whole(repetitions, "repetitions", 1, _MOST_REPETITIONS)
    rng, count = np.random.default_rng(whole(seed, "seed", 0)), len(fit.estimation.experiments)
    estimates, failures = [], []
    for repetition in range(repetitions):
        try:
            estimates.append(_redrawn(fit, rng.integers(count, size=count), f"repetition {repetition}"))
        except EstimationError as error:
            failures.append(str(error))
    if failures:
        message = f"bootstrap: {len(failures)} of {repetitions} repetitions failed; the first: {failures[0]}"
        if len(failures) > _FEW * repetitions:
            raise EstimationError(
                f"{message}. The remaining ones would be a biased sample: add experiments or priors, or estimate "
                "fewer parameters"
            )
        warnings.warn(f"{message}. They are left out", EstimationWarning, stacklevel=3)
    return np.array(estimates)


def _redrawn(fit: CalibrationSolution, chosen: Any, whose: str) -> Array:
    """Estimates from resampled experiments; numbers that the full data determine must stay determined."""
    estimates = _refit(fit, chosen, whose).estimates
    open_before = np.isnan(fit.estimates)
    lost = [label for label, is_lost in zip(fit.labels, np.isnan(estimates) & ~open_before, strict=True) if is_lost]
    if lost:
        raise EstimationError(f"{whose} does not determine {', '.join(lost)}")
    return np.where(open_before, np.nan, estimates)


def _refit(fit: Fit, chosen: Any, whose: str) -> Fit:
    """Refit to chosen experiments, started from this fit."""
    try:
        drawn = fit.estimation.of([fit.estimation.experiments[k] for k in chosen]).framed_at(fit.outcome.x)
    except DefinitionError as error:  # for example a density without gravity
        raise EstimationError(f"{whose} is not possible: {error}") from error
    return type(fit)(drawn, _answer(whose, drawn, [fit.equilibria[k] for k in chosen], start=fit.outcome.x), "reduced")


def _answer(whose: str, estimation: Estimation, *arguments: Any, **settings: Any) -> FitPoint:
    """The outcome of the reduced method; ``EstimationError`` if it does not converge."""
    answer = solve_reduced(estimation, *arguments, **settings)
    if not answer.converged:
        raise EstimationError(
            f"{whose} did not converge after {answer.iterations} iterations: {answer.message}. Try priors or bounds, "
            "fewer parameters, or more experiments"
        )
    return answer


def _check_shared(fit: CalibrationSolution) -> None:
    for entry in fit.estimation.unknowns.entries:
        if entry.experiment is not None:
            message = f"{entry.name} belongs to one experiment, so that experiments cannot be left out or resampled"
            raise EstimationError(message)


def _numbered(fit: CalibrationSolution, experiments: Sequence[int] | int) -> list[int]:
    """Checked numbers of existing experiments."""
    count = len(fit.estimation.experiments)
    single = isinstance(experiments, (int, np.integer))
    numbers = [experiments] if single else listed(experiments, "experiments", "a list of numbers of experiments")
    for k in numbers:
        if isinstance(k, bool) or not isinstance(k, (int, np.integer)) or not 0 <= k < count:
            raise DefinitionError(f"experiments: {k!r} must be the number of an experiment from 0 to {count - 1}")
    return [int(k) for k in numbers]  # type: ignore[arg-type]


def _listed(numbers: Sequence[int]) -> str:
    return f"experiment{'s' if len(numbers) > 1 else ''} {', '.join(map(str, numbers))}"
