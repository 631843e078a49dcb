"""What an estimate of loads says, as text and as a figure."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ..plotting import draw_backbone
from ..robot.checks import Array
from .fit_report import unit_of
from .measurements import BackboneMeasurement, PositionMeasurement

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from .force_errors import Systematic
    from .force_estimate import ForceEstimate

_MOST = 30.0  # characteristic sizes: a number with a larger standard deviation is not told
_INSIDE = 0.95  # probability of the confidence ellipses
_PLANES = ((0, 2), (1, 2), (0, 1))
_AXES = "xyz"


def force_report(estimate: ForceEstimate) -> str:
    """Loads with their errors, what is not known, consistency, other solutions, what would be mistaken for a force."""
    numbers = estimate.case.experiment.numbers
    lines = [f"Loads from {numbers} numbers measured", _row("residuals", _consistency(estimate))]
    stable = {True: "stable", False: "UNSTABLE: no robot stays so", None: "stability not defined under these loads"}
    shape = estimate.shape
    tip = ", ".join(f"{1e3 * x:.3f}" for x in shape.tip_position)
    lines.append(_row("shape", f"{stable[estimate.is_stable]}, tip at ({tip}) mm"))
    lines += ["", f"  {'':<22}{'estimate':>12}{'+-':>11}   unit"]
    every = zip(
        estimate.labels, estimate.estimates, estimate.deviations, estimate.case.search.sought.scale, strict=True
    )
    for label, value, error, scale in every:
        factor, unit = unit_of(label)
        told = f"{factor * value:>12.4g}{factor * error:>11.2g}"
        if error > _MOST * scale:
            told = f"{'not determined':>23}"
        lines.append(f"  {label:<22}{told}   {unit}")
    lines += _magnitudes(estimate)
    lines += _places(estimate)
    if estimate.undetermined:
        lines += ["", "  Not determined:", *(f"    {each}" for each in estimate.undetermined)]
    if estimate.alternatives:
        lines += ["", "  Other solutions:"]
        for other in estimate.alternatives:
            values = ", ".join(f"{label} = {value:.4g}" for label, value in other.values.items())
            lines.append(f"    {values} (loss {other.state.cost - estimate.state.cost:+.2f})")
    lines += ["", "  Errors of the model look like forces until they are noticed (with 95 %):"]
    lines += [f"    {each}" for each in _mistaken(estimate)]
    return "\n".join(lines)


def _row(name: str, value: str) -> str:
    return f"  {name:<22}{value}"


def _consistency(estimate: ForceEstimate) -> str:
    if estimate.consistent is None:
        return "nothing is left over to tell whether they are consistent"
    verdict = "consistent with model and noise" if estimate.consistent else "NOT CONSISTENT with model and noise"
    return (
        f"{verdict}: chi-square {estimate.chi_squared:.1f} at {estimate.degrees_of_freedom} degrees of freedom "
        f"(p = {estimate.p_value:.2g})"
    )


def _mistaken(estimate: ForceEstimate) -> list[Systematic]:
    """Of each kind of systematic error the one that adds most force before it is noticed."""
    worst: dict[str, Systematic] = {}
    for each in estimate.systematic:
        if each.kind not in worst or each.mimicked > worst[each.kind].mimicked:
            worst[each.kind] = each
    return list(worst.values())


def _magnitudes(estimate: ForceEstimate) -> list[str]:
    lines = []
    forces, covariances = np.atleast_2d(estimate.force), np.reshape(estimate.force_covariance, (-1, 3, 3))
    every = estimate.axes if len(forces) > 1 else [estimate.axes]
    for k, (force, covariance, axes) in enumerate(zip(forces, covariances, every, strict=True)):
        if axes[0].standard_deviation > _MOST * estimate.characteristic_force:
            continue
        size = float(np.linalg.norm(force))
        unit = force / size if size else np.zeros(3)
        name = "magnitude" if len(forces) == 1 else f"magnitude of {k}"
        lines += ["", _row(name, f"{size:.4g} +- {np.sqrt(unit @ covariance @ unit):.2g} N")]
        for axis in axes:
            told = ", ".join(f"{x:+.2f}" for x in axis.direction)
            lines.append(_row("", f"sd {axis.standard_deviation:.2g} N along ({told})"))
    return lines


def _places(estimate: ForceEstimate) -> list[str]:
    """Where contacts can be, and how likely other numbers of them are."""
    sets = estimate.arc_length_set
    if sets is None:
        return []
    every = sets if len(estimate.case.contacts) > 1 else [sets]
    lines = [""]
    for k, intervals in enumerate(every):
        told = " or ".join(f"{1e3 * a:.1f} to {1e3 * b:.1f} mm" for a, b in intervals)
        lines.append(_row("place, 95 %" if len(every) == 1 else f"place {k}, 95 %", told))
    for row in estimate.evidence:
        lines.append(_row(f"{row.contacts} contacts", f"loss {row.loss:.2f}, criterion (BIC) {row.criterion:.1f}"))
    return lines


# -- figure ------------------------------------------------------------------------------------------------------------


def figure_force(estimate: ForceEstimate) -> Figure:
    """The shape with what was measured in two planes, and the confidence ellipse of the force in three."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11.0, 7.0), layout="constrained")
    grid = figure.add_gridspec(2, 6, height_ratios=(1.3, 1.0))
    for column, plane in enumerate(((2, 0), (2, 1))):
        _draw_shape(estimate, figure.add_subplot(grid[0, 3 * column : 3 * column + 3]), plane)
    for column, plane in enumerate(_PLANES):
        _draw_ellipses(estimate, figure.add_subplot(grid[1, 2 * column : 2 * column + 2]), plane)
    return figure


def _draw_shape(estimate: ForceEstimate, ax: Any, plane: tuple[int, int]) -> None:
    shape = estimate.shape
    draw_backbone(shape, ax, plane)
    points = _measured(estimate)
    if len(points):
        ax.plot(*1e3 * points[:, plane].T, "o", ms=3.5, mfc="none", color="black", label="measured")
    forces, places = np.atleast_2d(estimate.force), np.atleast_1d(np.array(estimate.arc_length, dtype=object))
    longest = max(float(np.linalg.norm(force)) for force in forces)
    for force, place in zip(forces, places, strict=True):
        start = 1e3 * shape.position(shape.length if place is None else place)[list(plane)]
        arrow = 300.0 * shape.length * force[list(plane)] / longest if longest else np.zeros(2)
        ax.annotate("", start + arrow, start, arrowprops={"arrowstyle": "-|>", "color": "#B2182B", "lw": 1.8})
        ax.plot(*(start + arrow), ".", alpha=0.0)  # so that the axes hold it
    ax.set(xlabel=f"{_AXES[plane[0]]} [mm]", ylabel=f"{_AXES[plane[1]]} [mm]")
    ax.set_aspect("equal", adjustable="datalim")
    if plane == (2, 0):
        ax.legend(frameon=False, loc="best", fontsize=8)


def _measured(estimate: ForceEstimate) -> Array:
    kinds = PositionMeasurement, BackboneMeasurement
    found = [each.position for each in estimate.case.experiment.measurements if isinstance(each, kinds)]
    return np.vstack(found) if found else np.zeros((0, 3))


def _draw_ellipses(estimate: ForceEstimate, ax: Any, plane: tuple[int, int]) -> None:
    from scipy.stats import chi2

    angle = np.linspace(0.0, 2.0 * np.pi, 200)
    circle = np.sqrt(chi2.ppf(_INSIDE, 2)) * np.vstack((np.cos(angle), np.sin(angle)))
    forces, covariances = np.atleast_2d(estimate.force), np.reshape(estimate.force_covariance, (-1, 3, 3))
    for k, (force, covariance) in enumerate(zip(forces, covariances, strict=True)):
        values, vectors = np.linalg.eigh(covariance[np.ix_(plane, plane)])
        ring = (vectors * np.sqrt(values)) @ circle + force[list(plane), None]
        name = "95 % confidence" if len(forces) == 1 else f"force {k}, 95 %"
        (line,) = ax.plot(*ring, label=name)
        ax.plot(*force[list(plane)], "+", color=line.get_color())
    ax.axhline(0.0, color="0.8", lw=0.6, zorder=0)
    ax.axvline(0.0, color="0.8", lw=0.6, zorder=0)
    ax.set(xlabel=f"force {_AXES[plane[0]]} [N]", ylabel=f"force {_AXES[plane[1]]} [N]")
    ax.set_aspect("equal", adjustable="datalim")
    ax.locator_params(nbins=5)
    if plane == _PLANES[0]:
        ax.legend(frameon=False, fontsize=8)
