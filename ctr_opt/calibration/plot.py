"""Figures of fits: errors, residuals, correlations, confidence ellipses."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ..checks import Array
from ..estimation.chi_square import quantile
from ..estimation.measurements.kind import POINTS
from ..robot.names import caption
from .report import sizes_by_place
from .solution import CalibrationSolution

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_INSIDE = 0.95  # probability of the confidence ellipses
_MOST_LABELS = 24
_CROWD = 4.0  # medians of the sizes: residuals beyond that are outliers, shown at the edge


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
    """Residuals of measured points against arc length, one colour for each axis.

    The panel spans what most residuals do. Those outside are triangles at its edge, and the legend counts them.
    """
    ax = _axes(ax)
    points = [one for one in fit.residuals if one.is_point]
    s = 1e3 * np.array([one.arc_length for one in points])
    values = 1e3 * np.array([one.value[:3] for one in points]).reshape(-1, 3)
    sizes = np.abs(values).max(axis=1, initial=0.0)
    edge = _edge(sizes)
    for axis, name in enumerate("xyz"):
        inside = np.abs(values[:, axis]) <= edge
        (dots,) = ax.plot(s[inside], values[inside, axis], ".", markersize=4, alpha=0.6, label=name)
        for sign, marker in ((1.0, "^"), (-1.0, "v")):
            beyond = ~inside & (sign * values[:, axis] > 0.0)
            ax.plot(s[beyond], np.full(beyond.sum(), sign * edge), marker, markersize=5, color=dots.get_color())
    if (sizes > edge).any():
        ax.plot([], [], "v", color="0.4", label=f"{(sizes > edge).sum()} points beyond")
    if len(points):
        ax.set_ylim(-1.08 * edge, 1.08 * edge)
    ax.axhline(0.0, color="black", linewidth=0.6)
    ax.set_xlabel("arc length [mm]")
    ax.set_ylabel("predicted - measured [mm]")
    ax.legend(frameon=False, ncols=4)
    return ax


def _edge(sizes: Array) -> float:
    """How far residuals of these sizes go, without outliers."""
    crowd = sizes[sizes <= _CROWD * np.median(sizes)] if len(sizes) else sizes
    return 1.05 * float(crowd.max(initial=0.0)) or 1.0


def plot_correlation(fit: CalibrationSolution, ax: Axes | None = None) -> Axes:
    """The correlation matrix."""
    ax = _axes(ax)
    labels = [caption(label, fit.estimation.robot) for label in fit.labels]
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
    names = (caption(fit.labels[k], fit.estimation.robot) for k in (i, j))
    texts = [f"{name} [{unit}]" if unit else name for name, unit in zip(names, (ui, uj), strict=True)]
    ax.set(xlabel=texts[0], ylabel=texts[1])
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
