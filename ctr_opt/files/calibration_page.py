"""The report of a calibration: a page in Markdown with its figures, in the order of the paper's section III."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..calibration.plot import figure_fit
from ..calibration.report import by_place, sizes_by_place, worst_point
from ..checks import Array
from ..errors import DefinitionError, EstimationError
from ..estimation.losses import LOSSES
from ..estimation.measurements.kind import DIRECTIONS, POINTS
from ..forward.problem import ForwardProblem
from ..robot.actuation import Actuation
from ..robot.names import symbol
from ..robot.robot import Robot
from .calibration import Calibration, Check
from .figures import save_figure
from .text import write_atomically

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ..calibration.fit import Fit

_LIMITS = (3.0, 4.0)  # mm: the paper reports the share of the tip's errors below these
_STATISTICS = ("mean", "median", "sd", "least", "largest")
_MOST_LEFT_OUT = 0.1  # of the experiments


def write_report(
    calibration: Calibration, nominal: Fit, fits: Mapping[str, Fit], held: Mapping[str, Fit], folder: Path
) -> Path:
    """Write ``report.md`` and its figures into a folder, which is created; return the page's path.

    ``fits`` are named by their losses. ``held`` holds the same estimates, evaluated on the held-out experiments.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise DefinitionError(f"report = {str(folder)!r} cannot be created: {error.strerror}") from None
    save_figure(_histograms(nominal, fits), folder / "errors.png")
    for loss, fit in fits.items():
        save_figure(figure_fit(fit), folder / f"fit_{loss}.png")
    page = folder / "report.md"
    text = "\n".join(_lines(calibration, nominal, fits, held)) + "\n"
    write_atomically(page, lambda part: part.write_text(text, "utf-8"))
    return page


def _lines(calibration: Calibration, nominal: Fit, fits: Mapping[str, Fit], held: Mapping[str, Fit]) -> list[str]:
    lines = [f"# {calibration.title}", "", calibration.description, "", _counted(calibration), ""]
    lines += [f"> {line}" for line in calibration.source.strip().splitlines()]
    if calibration.does_not_claim:
        lines += [">", f"> **{calibration.does_not_claim}**"]
    lines += ["", "## Errors with nominal parameters", "", *_errors(nominal)]
    lines += ["", "## Parameters", "", *_parameters(calibration, _named(fits))]
    for loss, fit in fits.items():
        lines += _undetermined(loss, fit)
    for loss, fit in fits.items():
        lines += ["", f"## Errors with calibrated parameters: {LOSSES[loss]}", "", *_errors(fit)]
    lines += ["", "![Errors of the tip](errors.png)"]
    for loss, fit in held.items():
        table = hold_out_table(fits[loss], fit)
        lines += ["", f"## Prediction of the held-out experiments: {LOSSES[loss]}", "", *table]
    lines += ["", "## Experiments that do not fit", "", *_outliers(fits)]
    if "squared" in fits and fits["squared"].outliers:
        lines += ["", *_without(calibration, fits["squared"])]
    if calibration.checks:
        lines += ["", "## Prediction of what was not fitted", "", *_checks(calibration, fits)]
    for loss, fit in fits.items():
        lines += ["", f"## The fit in full: {LOSSES[loss]}", "", "```", fit.report(), "```"]
        lines += ["", f"![Errors, residuals, correlations, confidence](fit_{loss}.png)"]
    return lines


def _named(fits: Mapping[str, Fit]) -> dict[str, Fit]:
    return {LOSSES[loss]: fit for loss, fit in fits.items()}


def _counted(calibration: Calibration) -> str:
    experiments = [*calibration.experiments, *calibration.held]
    loaded = sum(1 for experiment in experiments if experiment.loads)
    text = f"{len(experiments)} experiments, {loaded or 'none'} of them loaded, from `{calibration.table.name}`."
    if calibration.hold_out is None:
        return text
    return (
        f"{text} {len(calibration.held)}, drawn at random (seed {calibration.hold_out.seed}), are held out of the fit."
    )


def _table(header: list[str], rows: list[list[str]]) -> list[str]:
    line = "| " + " | ".join(header) + " |"
    rule = "| " + " | ".join(["---", *["---:"] * (len(header) - 1)]) + " |"
    return [line, rule, *("| " + " | ".join(row) + " |" for row in rows)]


# -- errors ------------------------------------------------------------------------------------------------------------


def tip_errors(fit: Fit) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Error (m), arc length (m) and presence of a load for each experiment whose tip was measured."""
    tips = [residual for residual in fit.residuals if residual.is_point and residual.observable.place is None]
    loaded = [bool(fit.estimation.experiments[residual.experiment].loads) for residual in tips]
    sizes, lengths = ([getattr(residual, field) for residual in tips] for field in ("distance", "arc_length"))
    return np.array(sizes), np.array(lengths), np.array(loaded, dtype=bool)


def _errors(fit: Fit) -> list[str]:
    groups = list(sizes_by_place(fit, POINTS).items())
    errors, lengths, loaded = tip_errors(fit)
    if len(errors) and loaded.any() and not loaded.all():
        groups += [("tip, unloaded", errors[~loaded]), ("tip, loaded", errors[loaded])]
    lines = _table(["error [mm]", "points", *_STATISTICS], [_statistics(name, 1e3 * e) for name, e in groups])
    angles = [_statistics(name, np.rad2deg(sizes)) for name, sizes in sizes_by_place(fit, DIRECTIONS).items()]
    if angles:
        lines += ["", *_table(["error [deg]", "directions", *_STATISTICS], angles)]
    if len(errors):
        shares = [f"{np.mean(1e3 * errors < limit):.0%} below {limit:g} mm" for limit in _LIMITS]
        share = errors / lengths
        worst = int(errors.argmax())
        lines += [
            "",
            f"Of the tip's errors {' and '.join(shares)}; in the mean {share.mean():.2%} of the arc length, at most "
            f"{share.max():.2%}. The largest, {1e3 * errors[worst]:.2f} mm, at an arc length of "
            f"{1e3 * lengths[worst]:.1f} mm "
            f"({share[worst]:.2%}).",
        ]
    return lines


def _statistics(name: str, e: Array) -> list[str]:
    return [name, str(len(e)), *(f"{x:.2f}" for x in (e.mean(), np.median(e), e.std(), e.min(), e.max()))]


def hold_out_table(fit: Fit, held: Fit) -> list[str]:
    """Compare errors of the fitted and the held-out experiments, both predicted by the same estimates.

    The table has distances and angles, and predicted minus measured along the world's axes, mean ± standard deviation.
    """
    rows = []
    for name in by_place(fit, POINTS):
        for title, part in (("fitted", fit), ("held out", held)):
            residuals = by_place(part, POINTS).get(name, [])
            errors = 1e3 * np.array([residual.value[:3] for residual in residuals]).reshape(-1, 3)
            axes = [f"{x.mean():+.3f} ± {x.std():.3f}" for x in errors.T]
            rows.append([f"{name}, {title} [mm]", *_spread(np.linalg.norm(errors, axis=1)), *axes])
    for name in by_place(fit, DIRECTIONS):
        for title, part in (("fitted", fit), ("held out", held)):
            rows.append(
                [f"{name}, {title} [deg]", *_spread(np.rad2deg(sizes_by_place(part, DIRECTIONS)[name])), "", "", ""]
            )
    return _table(["error", "count", "mean", "sd", "largest", "x", "y", "z"], rows)


def _spread(e: Array) -> list[str]:
    return [str(len(e)), *(f"{x:.3f}" for x in (e.mean(), e.std(), e.max()))]


def _outliers(fits: Mapping[str, Fit]) -> list[str]:
    lines = []
    for loss, fit in fits.items():
        if not fit.outliers:
            lines.append(f"- {LOSSES[loss]}: none.")
        for k in fit.outliers:
            experiment = fit.estimation.experiments[k]
            turned = ", ".join(f"{x:g}" for x in np.round(np.rad2deg(experiment.actuation.rotations), 2))
            pushed = ", ".join(f"{x:g}" for x in np.round(1e3 * experiment.actuation.translations, 3))
            lines.append(
                f"- {LOSSES[loss]}: {experiment.name or k} ({turned} deg; {pushed} mm; "
                f"{'loaded' if experiment.loads else 'unloaded'}): "
                f"{worst_point(fit, k)}influence (Cook's distance) {fit.influence[k]:.2g}. "
                "It was fitted with the others; look for a mistake in its record."
            )
    return lines


def _without(calibration: Calibration, fit: Fit) -> list[str]:
    """Repeat the least-squares fit without the worst experiment until no outlier remains: one may hide others."""
    rest = fit
    left: list[str] = []
    while rest.outliers and len(left) < _MOST_LEFT_OUT * len(fit.estimation.experiments):
        worst = max(rest.outliers, key=lambda k: float(rest.influence[k]))
        left.append(rest.estimation.experiments[worst].name or str(worst))
        rest = rest.without(worst)
    title = f"{LOSSES['squared']} without {', '.join(left)}"
    lines = [
        f"The most influential experiment left out, repeatedly until no outlier remains ({', '.join(left)}):",
        "",
        *_parameters(calibration, {LOSSES["squared"]: fit, title: rest}),
        "",
    ]
    if rest.estimation.scaled:
        verdict = "accepted" if rest.noise_accepted else "rejected"
        lines.append(f"The given noise level is then {verdict} (p = {rest.p_value:.2g}).")
    return lines


# -- parameters --------------------------------------------------------------------------------------------------------


def _parameters(calibration: Calibration, fits: Mapping[str, Fit]) -> list[str]:
    first = next(iter(fits.values()))
    truth = calibration.truth.get("values", {})
    header = ["parameter", "nominal", *fits]
    header += ["truth"] if truth else []
    sizes = [(entry.name, entry.size) for entry in first.estimation.unknowns.entries]
    true = np.concatenate([np.broadcast_to(np.ravel(truth.get(name, np.nan)), size) for name, size in sizes])
    rows = []
    for k, label in enumerate(first.labels):
        factor, unit = first.estimation.unknowns.units[k]
        row = [
            f"{symbol(label)} [{unit}]" if unit else symbol(label),
            f"{factor * first.estimation.unknowns.initial[k]:.6g}",
        ]
        for fit in fits.values():
            value, error = fit.estimates[k], fit.deviations[k]
            row.append(f"{factor * value:.5g} ± {factor * error:.2g}" if np.isfinite(error) else "not determined")
        if truth:
            row.append(f"{factor * true[k]:.5g}")
        rows.append(row)
    return _table(header, rows)


def _undetermined(loss: str, fit: Fit) -> list[str]:
    if not fit.undetermined:
        return []
    lines = ["", f"Not determined ({LOSSES[loss]}):", "", *(f"- {direction}" for direction in fit.undetermined)]
    return lines + [f"- but {name} = {ratio:.4g} ± {error:.2g}" for name, (ratio, error) in fit.ratios.items()]


# -- checks ------------------------------------------------------------------------------------------------------------


def check_error(robot: Robot, actuation: Actuation, check: Check) -> tuple[float, float]:
    """Distance of a predicted tip from the measured one, m, and relative to the arc length."""
    shape = ForwardProblem(robot).solve(actuation, check.problem.loads)
    error = float(np.linalg.norm(shape.tip_position - check.tip_position))
    return error, error / shape.length


def _cell(robot: Robot, actuation: Actuation, check: Check) -> str:
    error, share = check_error(robot, actuation, check)
    return f"{1e3 * error:.2f} ({share:.2%})"


def _checks(calibration: Calibration, fits: Mapping[str, Fit]) -> list[str]:
    rows = []
    for check in calibration.checks:
        joints = check.problem.actuation
        cells = [_cell(calibration.robot, joints, check)]
        for fit in fits.values():
            try:
                cells.append(_cell(fit.robot, fit.actuation(joints.rotations, joints.translations), check))
            except EstimationError:
                cells.append("not determined")
        rows.append([check.problem.title, *cells])
    return _table(["tip error [mm] (of the length)", "nominal", *(LOSSES[loss] for loss in fits)], rows)


def _histograms(nominal: Fit, fits: Mapping[str, Fit]) -> Figure:
    """Draw the paper's Fig. 12: errors of the tip, nominal and calibrated, on the same axes."""
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(
        1, 1 + len(fits), figsize=(4.0 * (1 + len(fits)), 3.4), sharex=True, constrained_layout=True
    )
    named = {"nominal": nominal, **_named(fits)}
    errors = {name: 1e3 * tip_errors(fit)[0] for name, fit in named.items()}
    largest = max((float(sizes.max()) for sizes in errors.values() if len(sizes)), default=1.0)
    bins = np.linspace(0.0, largest, 25)
    for ax, (name, sizes) in zip(np.atleast_1d(axes), errors.items(), strict=True):
        ax.hist(sizes, bins, color="tab:blue", edgecolor="white")
        if len(sizes):
            ax.axvline(sizes.mean(), color="black", linestyle="--", linewidth=1.0, label=f"mean {sizes.mean():.2f} mm")
            ax.legend(frameon=False)
        ax.set_title(name)
        ax.set_xlabel("error of the tip [mm]")
    np.atleast_1d(axes)[0].set_ylabel("experiments")
    return figure
