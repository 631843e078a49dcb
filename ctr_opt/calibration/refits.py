"""Fits made again, from where a fit ended: to other experiments, or with a number held."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from typing import Any, TypeVar

import attrs
import numpy as np

from ..checks import Array
from ..errors import DefinitionError, EstimationError, EstimationWarning
from ..estimation.experiment import Experiment
from .estimation import Estimation
from .reduced import Found, solve_reduced
from .solution import Residual, Solution

Fit = TypeVar("Fit", bound=Solution)

_FEW = 0.05  # the share of a bootstrap's repetitions that may be left out


def profile(fit: Solution, label: str, count: int, width: float) -> tuple[Array, Array]:
    """Values of a number, and the loss with all others estimated anew, over the least."""
    if label not in fit.labels:
        raise DefinitionError(f"label = {label!r} must be one of {', '.join(fit.labels)}")
    estimation, k = fit.estimation, fit.labels.index(label)
    error = float(fit.deviations[k])
    if not np.isfinite(error):
        raise EstimationError(f"{label} is not determined, so that it has no profile")
    lower, upper = (bound[k] for bound in estimation.unknowns.bounds)
    middle = fit.found.x[k]
    values = np.linspace(max(middle - width * error, lower), min(middle + width * error, upper), count)
    costs = []
    for value in values:
        x = fit.found.x.copy()
        x[k] = value
        point = _answer(f"the profile at {label} = {value:g}", estimation, fit.equilibria, start=x, fixed=[k])
        linearized = estimation.linearize(point.x, point.states)
        costs.append(estimation.cost(linearized) + estimation.prior_cost(point.x) - fit.objective)
    return values, np.array(costs)


def without(fit: Fit, experiments: Sequence[int] | int) -> Fit:
    """The fit to the other experiments."""
    _check_shared(fit)
    dropped = _numbered(fit, experiments)
    kept = [k for k in range(len(fit.estimation.experiments)) if k not in dropped]
    if not kept:
        raise DefinitionError("experiments: at least one must be left")
    return _refit(fit, kept, f"the fit without {_listed(dropped)}")


def errors_without(fit: Solution, experiments: Sequence[int] | int) -> list[Residual]:
    """The residuals of experiments that a fit to the others predicts."""
    numbers = _numbered(fit, experiments)
    other = without(fit, numbers)
    held = [fit.estimation.experiments[k] for k in numbers]
    shown = tested(other, held, f"the estimates without {_listed(numbers)}")
    return [attrs.evolve(one, experiment=numbers[one.experiment]) for one in shown.residuals]


def tested(fit: Fit, experiments: Sequence[Experiment], whose: str) -> Fit:
    """The same estimates beside other experiments."""
    _check_shared(fit)
    homes = fit.estimation.unknowns.homes_at(fit.found.x)
    for k, experiment in enumerate(experiments):
        if homes.within(experiment.actuation):
            raise DefinitionError(
                f"experiments[{k}]: its actuation already has the homes that the fit adds: give the joints as read"
            )
    others = fit.estimation.of(experiments).framed_at(fit.found.x)
    states = others.states(fit.found.x, others.equilibria_of(fit.found.x, whose))
    return type(fit)(others, attrs.evolve(fit.found, states=states), fit.method)


def bootstrap(fit: Solution, repetitions: int, seed: int) -> Array:
    """Estimates from experiments drawn again with replacement, a row for each repetition that has an answer."""
    _check_shared(fit)
    rng, count = np.random.default_rng(seed), len(fit.estimation.experiments)
    estimates, failures = [], []
    for repetition in range(repetitions):
        try:
            estimates.append(_redrawn(fit, rng.integers(count, size=count), f"repetition {repetition}"))
        except EstimationError as error:
            failures.append(str(error))
    if failures:
        message = f"bootstrap: {len(failures)} of {repetitions} repetitions have no answer; the first: {failures[0]}"
        if len(failures) > _FEW * repetitions:
            raise EstimationError(
                f"{message}. Without so many the others are no fair sample: add experiments or priors, or estimate "
                "fewer parameters"
            )
        warnings.warn(f"{message}. They are left out", EstimationWarning, stacklevel=3)
    return np.array(estimates)


def _redrawn(fit: Solution, chosen: Any, whose: str) -> Array:
    """Estimates from a choice of experiments, which must determine what all of them do."""
    estimates = _refit(fit, chosen, whose).estimates
    open_before = np.isnan(fit.estimates)
    lost = [label for label, those in zip(fit.labels, np.isnan(estimates) & ~open_before, strict=True) if those]
    if lost:
        raise EstimationError(f"{whose} does not determine {', '.join(lost)}")
    return np.where(open_before, np.nan, estimates)


def _refit(fit: Fit, chosen: Any, whose: str) -> Fit:
    """A fit to a choice of experiments, from here."""
    try:
        drawn = fit.estimation.of([fit.estimation.experiments[k] for k in chosen]).framed_at(fit.found.x)
    except DefinitionError as error:  # as where a density is left without gravity
        raise EstimationError(f"{whose} is none: {error}") from error
    return type(fit)(drawn, _answer(whose, drawn, [fit.equilibria[k] for k in chosen], start=fit.found.x), "reduced")


def _answer(whose: str, estimation: Estimation, *arguments: Any, **settings: Any) -> Found:
    """That of the reduced way, if it answer one."""
    answer = solve_reduced(estimation, *arguments, **settings)
    if not answer.converged:
        raise EstimationError(
            f"{whose} found no answer after {answer.iterations} iterations: {answer.message}. Try priors or bounds, "
            "fewer parameters, or more experiments"
        )
    return answer


def _check_shared(fit: Solution) -> None:
    for entry in fit.estimation.unknowns.entries:
        if entry.experiment is not None:
            message = f"{entry.name} belongs to one experiment, so that none can be left out or drawn again"
            raise EstimationError(message)


def _numbered(fit: Solution, experiments: Sequence[int] | int) -> list[int]:
    """The numbers of experiments that there are."""
    count = len(fit.estimation.experiments)
    given = [experiments] if np.ndim(experiments) == 0 else list(experiments)  # type: ignore[arg-type]
    for k in given:
        if isinstance(k, bool) or not isinstance(k, (int, np.integer)) or not 0 <= k < count:
            raise DefinitionError(f"experiments: {k!r} must be the number of an experiment from 0 to {count - 1}")
    return [int(k) for k in given]  # type: ignore[arg-type]


def _listed(numbers: Sequence[int]) -> str:
    return f"experiment{'s' if len(numbers) > 1 else ''} {', '.join(map(str, numbers))}"
