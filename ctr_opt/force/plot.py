"""An estimate of loads as a figure: the shape with its band, and how well the loads are known."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ..checks import Array
from ..estimation.chi_square import quantile
from ..estimation.measurements import BackboneMeasurement, PositionMeasurement
from ..forward.plot import draw_backbone
from .solution import ForceSolution, principal

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_INSIDE = 0.95  # probability of the bands and ellipses
_PLANES = ((0, 2), (1, 2), (0, 1))
_AXES = "xyz"
_FORCE, _BAND = "#B2182B", "#4D4D4D"
_PLACES = 41  # along the robot, of its band
_VISIBLE = 0.02  # of the robot's length: a narrower band is drawn wider, by a factor that the legend names


def figure_force(estimate: ForceSolution) -> Figure:
    """The shape with what was measured in two planes, the band of its positions, and how well the loads are known.

    Below the shape the confidence ellipses of forces in three planes, and densities of distributed forces with bands.
    """
    from matplotlib.figure import Figure
    from matplotlib.layout_engine import ConstrainedLayoutEngine

    points = [k for k in range(len(estimate.case.numbered.unknown)) if k not in estimate.distributed]
    rows = 1 + bool(points) + len(estimate.distributed)
    figure = Figure(figsize=(12.0, 0.6 + 3.4 * rows), layout=ConstrainedLayoutEngine(w_pad=0.1))
    grid = figure.add_gridspec(rows, 3, height_ratios=[1.2] + [1.0] * (rows - 1))
    s = np.linspace(0.0, estimate.shape.length, _PLACES)
    positions, covariances = estimate.position(s)
    widest = _factor(1) * np.sqrt(np.maximum(np.linalg.eigvalsh(covariances)[:, -1], 0.0))
    wider = widened(float(widest.max()), estimate.shape.length)
    for column, plane in enumerate(((2, 0), (2, 1))):
        ax = figure.add_subplot(grid[0, column])
        _draw_band(ax, 1e3 * positions[:, plane], 1e6 * covariances[:, plane][:, :, plane], wider)
        _draw_shape(estimate, ax, plane)
        if not column:
            ax.legend(frameon=False, loc="best", fontsize=8)
    ax = figure.add_subplot(grid[0, 2])
    ax.plot(1e3 * s, 1e3 * widest, color=_BAND)
    ax.set(xlabel="arc length [mm]", ylabel="position known to [mm], 95 %", ylim=(0.0, None))
    if points:
        half = _half_width(estimate, points)
        for column, plane in enumerate(_PLANES):
            _draw_ellipses(estimate, figure.add_subplot(grid[1, column]), plane, points, half)
    for row, number in enumerate(estimate.distributed, start=1 + bool(points)):
        for column in range(3):
            _draw_density(estimate, figure.add_subplot(grid[row, column]), number, column)
    return figure


def _factor(dimensions: int) -> float:
    """Standard deviations from the mean to the edge of a band or an ellipse."""
    return float(np.sqrt(quantile(_INSIDE, dimensions)))


def _draw_shape(estimate: ForceSolution, ax: Any, plane: tuple[int, int]) -> None:
    shape = estimate.shape
    draw_backbone(shape, ax, plane)
    points = _measured(estimate)
    if len(points):
        ax.plot(*1e3 * points[:, plane].T, "o", ms=3.5, mfc="none", color="black", label="measured")
    every = list(zip(np.atleast_2d(estimate.force), _where(estimate), strict=True))
    longest = max(float(np.linalg.norm(force)) for force, _ in every)
    for force, place in every:
        start = 1e3 * shape.position(place)[list(plane)]
        arrow = 300.0 * shape.length * force[list(plane)] / longest if longest else np.zeros(2)
        ax.annotate("", start + arrow, start, arrowprops={"arrowstyle": "-|>", "color": _FORCE, "lw": 1.8})
        ax.plot(*(start + arrow), ".", alpha=0.0)  # so that the axes hold it
    ax.set(xlabel=f"{_AXES[plane[0]]} [mm]", ylabel=f"{_AXES[plane[1]]} [mm]")
    ax.set_aspect("equal", adjustable="datalim")


def _where(estimate: ForceSolution) -> list[float]:
    """Where each force is drawn: a distributed one in the middle of what it does."""
    places = estimate.arc_length if len(estimate.case.numbered.unknown) > 1 else [estimate.arc_length]
    drawn_at = []
    for k, place in enumerate(places):
        at = estimate.shape.length if place is None else place
        if k in estimate.distributed:
            s = estimate.stretch(k)
            weights = np.linalg.norm(estimate.density(s, k)[0], axis=1)
            at = float(weights @ s / weights.sum()) if weights.any() else float(s.mean())
        drawn_at.append(at)
    return drawn_at


def widened(width: float, length: float) -> int:
    """By which of 1, 2, 5, 10, 20, ... a band of this half-width is drawn wider, to be seen."""
    steps = (step * 10**power for power in range(5) for step in (1, 2, 5))
    return next((step for step in steps if step * width >= _VISIBLE * length), 1)


def _draw_band(ax: Any, points: Array, covariances: Array, wider: int) -> None:
    """Across the backbone in a plane, mm."""
    along = np.gradient(points, axis=0)
    across = np.stack((-along[:, 1], along[:, 0]), axis=1)
    across /= np.maximum(np.linalg.norm(across, axis=1), 1e-12)[:, None]
    widths = wider * _factor(1) * np.sqrt(np.einsum("ki,kij,kj->k", across, covariances, across))
    edges = np.vstack((points + widths[:, None] * across, (points - widths[:, None] * across)[::-1]))
    name = "95 % band" if wider == 1 else f"95 % band, {wider} times as wide"
    ax.fill(*edges.T, color=_BAND, alpha=0.25, lw=0.0, label=name, zorder=0)


def _half_width(estimate: ForceSolution, numbers: list[int]) -> float:
    """Half the span, N, of panels that hold the ellipses of these forces: the same in all planes."""
    covariances = np.reshape(estimate.force_covariance, (-1, 3, 3))[numbers]
    forces = np.atleast_2d(estimate.force)[numbers]
    reach = _factor(2) * np.sqrt(np.einsum("kii->ki", covariances))
    low, high = np.minimum((forces - reach).min(axis=0), 0.0), np.maximum((forces + reach).max(axis=0), 0.0)
    return 0.55 * float((high - low).max()) or 1.0


def _draw_density(estimate: ForceSolution, ax: Any, number: int, axis: int) -> None:
    s = estimate.stretch(number)
    density, errors = (values[:, axis] for values in estimate.density(s, number))
    (line,) = ax.plot(1e3 * s, density, label="estimate")
    width = _factor(1) * errors
    ax.fill_between(1e3 * s, density - width, density + width, color=line.get_color(), alpha=0.2, lw=0.0, label="95 %")
    ax.axhline(0.0, color="0.8", lw=0.6, zorder=0)
    ax.set(xlabel="arc length [mm]", ylabel=f"force per length, {_AXES[axis]} [N/m]")
    if not axis:
        ax.legend(frameon=False, fontsize=8)


def _measured(estimate: ForceSolution) -> Array:
    kinds = PositionMeasurement, BackboneMeasurement
    positions = [
        measurement.position for measurement in estimate.case.experiment.measurements if isinstance(measurement, kinds)
    ]
    return np.vstack(positions) if positions else np.zeros((0, 3))


def _draw_ellipses(estimate: ForceSolution, ax: Any, plane: tuple[int, int], numbers: list[int], half: float) -> None:
    angle = np.linspace(0.0, 2.0 * np.pi, 200)
    circle = _factor(2) * np.vstack((np.cos(angle), np.sin(angle)))
    forces, covariances = np.atleast_2d(estimate.force), np.reshape(estimate.force_covariance, (-1, 3, 3))
    for k in numbers:
        force, covariance = forces[k], covariances[k]
        deviations, vectors = principal(covariance[np.ix_(plane, plane)])
        ring = (vectors * deviations) @ circle + force[list(plane), None]
        name = "95 % confidence" if len(forces) == 1 else f"force {k}, 95 %"
        (line,) = ax.plot(*ring, label=name)
        ax.plot(*force[list(plane)], "+", color=line.get_color())
    ax.axhline(0.0, color="0.8", lw=0.6, zorder=0)
    ax.axvline(0.0, color="0.8", lw=0.6, zorder=0)
    ax.set(xlabel=f"force {_AXES[plane[0]]} [N]", ylabel=f"force {_AXES[plane[1]]} [N]")
    middle = ax.dataLim.get_points().mean(axis=0)
    ax.set(xlim=middle[0] + [-half, half], ylim=middle[1] + [-half, half], aspect="equal")
    ax.locator_params(nbins=5)
    if plane == _PLANES[0]:
        ax.legend(frameon=False, fontsize=8)
