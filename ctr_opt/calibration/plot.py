"""Figures of fits: errors, residuals, correlations, confidence ellipses."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ..estimation.chi_square import quantile
from ..estimation.measurements.kind import POINTS
from ..robot.names import symbol
from .report import sizes_by_place
from .solution import CalibrationSolution

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_INSIDE = 0.95  # probability of the confidence ellipses
_MOST_LABELS = 24


def figure_fit(fit: CalibrationSolution) -> Figure:
    """Four panels."""
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(2, 2, figsize=(11.0, 8.5), constrained_layout=True)
    plot_histogram(fit, axes[0, 0])
    plot_residuals(fit, axes[0, 1])
    plot_correlation(fit, axes[1, 0])
    plot_ellipse(fit, axes[1, 1])
    return figure


def plot_histogram(fit: CalibrationSolution, ax: Axes | None = None, *, where: str | None = None) -> Axes:
    """Histogram of the distances of measured points, as the paper's Fig. 12; by default those at the tip."""
    ax = _axes(ax)
    errors = sizes_by_place(fit, POINTS)
    if not errors:
        ax.set_axis_off()
        return ax
    name = where if where is not None else "tip" if "tip" in errors else next(iter(errors))
    sizes = 1e3 * errors[name]
    ax.hist(sizes, bins="fd" if len(sizes) > 8 else len(sizes), color="tab:blue", edgecolor="white")
    ax.axvline(float(sizes.mean()), color="black", linewidth=1.0, linestyle="--", label=f"mean {sizes.mean():.2f} mm")
    ax.set_xlabel(f"error, {name} [mm]")
    ax.set_ylabel("points")
    ax.legend(frameon=False)
    return ax


def plot_residuals(fit: CalibrationSolution, ax: Axes | None = None) -> Axes:
    """Residuals of measured points against arc length, an axis each."""
    ax = _axes(ax)
    points = [one for one in fit.residuals if one.is_point]
    s = 1e3 * np.array([one.arc_length for one in points])
    for axis, name in enumerate("xyz"):
        ax.plot(s, [1e3 * one.value[axis] for one in points], ".", markersize=4, alpha=0.6, label=name)
    ax.axhline(0.0, color="black", linewidth=0.6)
    ax.set_xlabel("arc length [mm]")
    ax.set_ylabel("predicted - measured [mm]")
    ax.legend(frameon=False, ncols=3)
    return ax


def plot_correlation(fit: CalibrationSolution, ax: Axes | None = None) -> Axes:
    """The correlation matrix."""
    ax = _axes(ax)
    labels = [symbol(label) for label in fit.labels]
    image = ax.imshow(fit.correlation, vmin=-1.0, vmax=1.0, cmap="RdBu_r")
    if len(labels) <= _MOST_LABELS:
        ax.set_xticks(range(len(labels)), labels, rotation=90, fontsize=7)
        ax.set_yticks(range(len(labels)), labels, fontsize=7)
    ax.figure.colorbar(image, ax=ax, label="correlation", shrink=0.8)
    return ax


def plot_ellipse(fit: CalibrationSolution, ax: Axes | None = None, *, pair: tuple[str, str] | None = None) -> Axes:
    """95 % confidence ellipse of two numbers; by default of the pair that is correlated most."""
    ax = _axes(ax)
    pair_of = _pair(fit) if pair is None else tuple(fit.labels.index(label) for label in pair)
    if pair_of is None:
        ax.set_axis_off()
        return ax
    i, j = pair_of
    units = fit.estimation.unknowns.units
    (fi, ui), (fj, uj) = units[i], units[j]
    values = fit.estimates[[i, j]]
    block = fit.covariance[np.ix_([i, j], [i, j])]
    angle = np.linspace(0.0, 2.0 * np.pi, 200)
    circle = np.linalg.cholesky(block) @ np.vstack((np.cos(angle), np.sin(angle))) * np.sqrt(quantile(_INSIDE, 2))
    ax.plot(fi * (values[0] + circle[0]), fj * (values[1] + circle[1]), label="95 % confidence")
    ax.plot(fi * values[0], fj * values[1], "+", color="black", label="estimate")
    ax.locator_params(axis="x", nbins=5)
    ax.set_xlabel(f"{symbol(fit.labels[i])} [{ui}]")
    ax.set_ylabel(f"{symbol(fit.labels[j])} [{uj}]")
    ax.legend(frameon=False)
    return ax


def _pair(fit: CalibrationSolution) -> tuple[int, int] | None:
    size = np.abs(np.nan_to_num(np.tril(fit.correlation, -1)))
    if len(fit.labels) < 2 or size.max() == 0.0:
        return None
    i, j = np.unravel_index(int(size.argmax()), size.shape)
    return int(j), int(i)


def _axes(ax: Any) -> Any:
    import matplotlib.pyplot as plt

    return plt.subplots()[1] if ax is None else ax
