"""Text reports of fits."""

from __future__ import annotations

import numpy as np

from ..checks import Array
from ..estimation.losses import LOSSES
from ..estimation.measurements.kind import Part
from ..forward.report import row
from ..layout.observables import Distal, Observable, Somewhere
from ..robot.names import shown, symbol
from .solution import REJECTED, CalibrationSolution, Residual

_FEW = 6  # arc lengths that are listed one by one
_CORRELATED = 0.9  # correlation from which a pair of parameters is listed


def fit_report(fit: CalibrationSolution) -> str:
    """The full report of a fit."""
    return "\n".join(
        [*_heading(fit), "", *parameter_table(fit), *_open(fit), *_correlated(fit), "", *residual_lines(fit)]
    )


def _heading(fit: CalibrationSolution) -> list[str]:
    estimation = fit.estimation
    numbers = sum(one.numbers for one in estimation.experiments)
    places = sum(layout.blocks.places for layout in estimation.layouts)
    lines = [
        f"Fit of {len(fit.labels)} numbers to {len(estimation.experiments)} experiments ({numbers} numbers measured)",
        row("method", f"{fit.method}, {fit.iterations} iterations"),
        row("loss", _loss(fit)),
        row("condition", f"{fit.condition:.2g} (information matrix, in the parameters' scales)"),
    ]
    if places:
        lines.append(row("arc lengths", f"{places} of points on the backbone, estimated with the parameters"))
    if estimation.scaled:
        lines.append(
            row("chi-square", f"{fit.chi_squared:.1f} at {fit.degrees_of_freedom} degrees of freedom{_verdict(fit)}")
        )
    else:
        lines.append(row("noise level", f"{fit.noise:.3g} mm (mrad, 1/m, ...), from the residuals"))
    return lines


def _loss(fit: CalibrationSolution) -> str:
    return f"{LOSSES[fit.estimation.loss]}; {fit.objective:.6g} at the solution"


def _verdict(fit: CalibrationSolution) -> str:
    if np.isnan(fit.p_value):
        return ""
    if fit.estimation.loss != "squared":
        return f" (noise {fit.noise:.2f} times as given); errors from the sandwich"
    if fit.noise_accepted:
        return f" (p = {fit.p_value:.2g}): the given noise level is accepted and used"
    return f" (p < {REJECTED:g}): rejected; errors are for {fit.noise:.2f} times the given noise level"


def parameter_table(fit: CalibrationSolution) -> list[str]:
    """Table lines for all numbers: start, estimate, standard error and unit."""
    unknowns = fit.estimation.unknowns
    lines = [f"  {'parameter':<36}{'start':>12}{'estimate':>14}{'+-':>12}   {'unit':<6}"]
    rows = zip(fit.labels, unknowns.units, unknowns.initial, fit.estimates, fit.deviations, strict=True)
    for label, (factor, unit), start, value, error in rows:
        text = f"{factor * value:>14.6g}{factor * error:>12.2g}" if np.isfinite(error) else f"{'not determined':>26}"
        lines.append(f"  {label:<36}{factor * start:>12.6g}{text}   {unit:<6}")
    return lines


def _open(fit: CalibrationSolution) -> list[str]:
    lines = []
    if fit.vague:
        lines += ["", f"  Known only vaguely, with errors above their size: {', '.join(map(symbol, fit.vague))}"]
    if not fit.undetermined:
        return lines
    lines += ["", "  Not determined by these data:"]
    lines += [f"    {direction}" for direction in fit.undetermined]
    if fit.ratios:
        lines += ["  What they do determine:"]
        lines += [f"    {name} = {ratio:.4g} +- {error:.2g}" for name, (ratio, error) in fit.ratios.items()]
    return lines


def _correlated(fit: CalibrationSolution) -> list[str]:
    pairs = [
        (fit.correlation[i, j], i, j)
        for i in range(len(fit.labels))
        for j in range(i)
        if abs(fit.correlation[i, j]) >= _CORRELATED
    ]
    if not pairs:
        return []
    lines = ["", f"  Correlations of {_CORRELATED:g} and more:"]
    for value, i, j in sorted(pairs, key=lambda pair: -abs(pair[0])):
        lines.append(f"    {symbol(fit.labels[j])} and {symbol(fit.labels[i])}: {value:+.3f}")
    return lines


def residual_lines(fit: CalibrationSolution) -> list[str]:
    """Report lines of residual sizes by quantity and place, and of outlying experiments."""
    lines = []
    for part in dict.fromkeys(part for one in fit.residuals for part in one.measured.parts):
        factor, unit = shown(part.unit)
        for name, sizes in sizes_by_place(fit, part).items():
            mean, middle, most = factor * np.array((sizes.mean(), np.median(sizes), sizes.max()))
            text = f"mean {mean:.3f}, median {middle:.3f}, largest {most:.3f} {unit}"
            lines.append(row(name, f"{text} ({len(sizes)} {part.name})"))
    names = [fit.estimation.experiments[k].name or str(k) for k in fit.outliers]
    if names:
        lines += ["", "  Experiments that do not fit the others (look at them; none was left out):"]
        for name, k in zip(names, fit.outliers, strict=True):
            lines.append(f"    {name}: {worst_point(fit, k)}influence {fit.influence[k]:.2g}")
    return lines


def worst_point(fit: CalibrationSolution, experiment: int) -> str:
    """Words for the largest distance of an experiment's points; empty without points."""
    points = [residual for residual in fit.residuals if residual.experiment == experiment and residual.is_point]
    worst = max(points, key=lambda residual: residual.distance, default=None)
    return f"{1e3 * worst.distance:.2f} mm at s = {1e3 * worst.arc_length:.1f} mm, " if worst else ""


def sizes_by_place(fit: CalibrationSolution, part: Part) -> dict[str, Array]:
    """Sizes of a part of the residuals, SI, by place."""
    return {
        name: np.array([np.linalg.norm(one.value[part.of_block]) for one in residuals])
        for name, residuals in by_place(fit, part).items()
    }


def by_place(fit: CalibrationSolution, part: Part) -> dict[str, list[Residual]]:
    """Residuals with this part, by place: ends of tubes, the tip, sensors, arc lengths."""
    residuals = [residual for residual in fit.residuals if part in residual.measured.parts]
    observables = [residual.observable for residual in residuals]
    few = len({one.place for one in observables if isinstance(one.place, float)}) <= _FEW
    groups: dict[str, list[Residual]] = {}
    for residual, seen in zip(residuals, observables, strict=True):
        name = ", ".join(filter(None, (part.title, _where(seen, few))))
        groups.setdefault(name if seen.sensor is None else f"{name} ({seen.sensor})", []).append(residual)
    return groups


def _where(one: Observable, few: bool) -> str:
    """Words for the place of an observable; ``few`` lists arc lengths one by one."""
    place = one.place
    if one.quantity.at != "place":
        return "" if one.tube is None else f"tube {one.tube}"
    if place is None:
        return "tip"
    if isinstance(place, Distal):
        return f"end of tube {place.tube}"
    if isinstance(place, Somewhere):
        return "somewhere along it"
    return f"at s = {1e3 * place:.1f} mm" if few else "along the backbone"
