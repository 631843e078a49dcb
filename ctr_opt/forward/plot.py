"""Figures of an equilibrium: tubes and loads in space, curvatures and moments along the arc length.

Drawn in mm, with a true aspect. matplotlib is imported inside the functions, pyplot only where a window is wanted.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from ..checks import Array
from ..errors import DefinitionError
from ..layout.configuration import Placed
from ..loads.density import value_at
from ..loads.kind import Push

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from .equilibrium import Equilibrium

_MM = 1e3
_TUBE_COLORS = (
    "#0072B2",
    "#E69F00",
    "#009E73",
    "#CC79A7",
    "#56B4E9",
    "#7F6A3F",
)  # the colour-blind can distinguish them
_FRAME_COLORS = ("#D62728", "#2CA02C", "#1F4FD6")
_FORCE_COLOR, _MOMENT_COLOR = "#B2182B", "#6A3D9A"
_UNLOADED_COLOR, _SPRING_COLOR = "0.7", "0.35"
_COMPONENTS = ((None, "black", r"$\|u\|$"), (0, "#8C564B", "$u_x$"), (1, "#7F7F7F", "$u_y$"))
_ELEVATION = 20.0  # of the camera, degrees
_CLOSE = 1e-9  # of the robot's length: closer points are one in a picture
_NOTHING = 1e-4  # of a panel's natural unit: it spans at least so much, or would show rounding errors of zero
_SPRING, _CORNERS = 0.01, 12  # half a spring's width, in robot lengths, and its corners
_AROUND = 24  # facets around a tube
_NARROWEST = 0.35  # a flat robot still gets a box so wide, of the longest side, or its ticks would overlap
_ABOVE: dict[str, Any] = {"loc": "lower center", "bbox_to_anchor": (0.5, 1.0), "ncols": 5, "frameon": False}


def plot_equilibrium(
    equilibrium: Equilibrium,
    ax: Axes | None = None,
    *,
    color: Any = None,
    alpha: float = 1.0,
    label: str | None = None,
    linestyle: str = "-",
    tubes: bool = True,
    loads: bool = True,
    frames: bool = True,
) -> Axes:
    """Draw tubes, loads and frames of an equilibrium in space, in mm and with a true aspect.

    Parameters
    ----------
    equilibrium
        A converged equilibrium.
    ax
        Axes with ``projection="3d"``; a new figure by default. What is there stays, the limits grow.
    color, alpha
        One colour for all tubes instead of one each; opacity of the tubes.
    label
        Legend entry, with ``color`` or ``tubes=False``; otherwise put before each tube's name.
    linestyle
        Of the backbone, for ``tubes=False``.
    tubes
        Draw the tubes with their outer diameters; ``False``: the backbone as a line.
    loads
        Draw forces and moments as arrows with their magnitudes.
    frames
        Draw the frames of the innermost tube along the backbone (x red, y green, z blue), the tip's larger.

    Returns
    -------
    Axes
        The 3-D axes.

    Raises
    ------
    DefinitionError
        ``ax`` is not three-dimensional.
    SolveError
        The equilibrium did not converge.
    """
    axes: Any = _new_axes(equilibrium) if ax is None else ax
    if getattr(axes, "name", "") != "3d":
        raise DefinitionError(f"ax = {axes!r} must be three-dimensional: make it with projection='3d'")
    # Tubes, frames and arrows overlap: the order must come from us, not from their mean depths.
    axes.computed_zorder = False
    if tubes:
        _draw_tubes(axes, equilibrium, color, alpha, label)
    else:
        line = _MM * equilibrium.position(equilibrium.arc_length)
        axes.plot(*line.T, color=color or "black", alpha=alpha, ls=linestyle, lw=1.5, label=label or "backbone")
    if frames:
        _draw_frames(axes, equilibrium)
    if loads:
        _draw_loads(axes, equilibrium)
    _finish(axes)
    return axes  # type: ignore[no-any-return]


def figure_equilibrium(loaded: Equilibrium, unloaded: Equilibrium | None = None) -> Figure:
    """Shape, curvature, torsion and internal moments in one figure; the unloaded robot grey and dashed.

    Parameters
    ----------
    loaded
        The equilibrium to show.
    unloaded
        The same robot without loads, for comparison.

    Returns
    -------
    Figure
        Without pyplot, for ``save_figure``: 3-D axes and one panel each for the backbone's curvature (1/m, in
        the rotation-minimizing frame), the torsion ``u_i,z`` (1/m) and each component of the tubes' internal
        moments (N mm, in each tube's own frame).
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(12.0, 7.5), layout="constrained")
    grid = figure.add_gridspec(5, 2, width_ratios=(1.15, 1.0))
    space: Any = figure.add_subplot(grid[:, 0], projection="3d")
    _look_at(space, loaded)
    if unloaded is not None:
        plot_equilibrium(unloaded, space, color=_UNLOADED_COLOR, alpha=0.5, label="unloaded", loads=False, frames=False)
    plot_equilibrium(loaded, space)
    top = figure.add_subplot(grid[0, 1])
    panels = [top, *(figure.add_subplot(grid[row, 1], sharex=top) for row in range(1, 5))]
    if unloaded is not None:
        _draw_panels(panels, unloaded, "--")
    _draw_panels(panels, loaded, "-")
    _label_panels(panels, loaded, unloaded is not None)
    return figure


def draw_backbone(equilibrium: Equilibrium, ax: Axes, plane: tuple[int, int]) -> None:
    """The backbone seen in a plane of two world axes, mm, as thick and coloured as the outermost tube there."""
    ends = equilibrium.configuration.tube_ends
    start = 0.0
    for tube in range(len(ends) - 1, -1, -1):
        if ends[tube] <= start:
            continue
        points = _MM * equilibrium.position(np.linspace(start, ends[tube], 100))[:, list(plane)]
        width = 1.5 + 1.2 * tube
        name = equilibrium.robot.tubes[tube].name
        ax.plot(*points.T, color=_tube_color(tube), lw=width, solid_capstyle="butt", label=name)
        start = float(ends[tube])


# -- in space ----------------------------------------------------------------------------------------------------


def _new_axes(equilibrium: Equilibrium) -> Any:
    equilibrium.shape  # noqa: B018  a failed solve must raise before a window opens
    from matplotlib import pyplot

    axes: Any = pyplot.figure(figsize=(7.0, 7.0), layout="constrained").add_subplot(projection="3d")
    _look_at(axes, equilibrium)
    return axes


def _look_at(axes: Any, equilibrium: Equilibrium) -> None:
    """Turn the camera so that neither the robot's bend nor a point force is seen end-on, nor a side of the box."""
    bend = (equilibrium.tip_position - equilibrium.position(0.0)) * [1.0, 1.0, 0.0]
    shown = np.array([bend, *(force for _, (force, _) in _point_wrenches(equilibrium))])
    sizes = np.linalg.norm(shown, axis=1)
    shown = shown[sizes > 0.0] / sizes[sizes > 0.0, None]
    azimuths = np.array([-60.0, -30.0, 30.0, 60.0, 120.0, 150.0, 210.0, 240.0])
    around, up = np.radians(azimuths), np.full(8, np.radians(_ELEVATION))
    sight = np.column_stack((np.cos(up) * np.cos(around), np.cos(up) * np.sin(around), np.sin(up)))
    worst = np.abs(sight @ shown.T).max(axis=1, initial=0.0)
    axes.view_init(elev=_ELEVATION, azim=float(azimuths[np.argmin(worst)]))
    axes.set_proj_type("ortho")


def _tube_color(tube: int) -> str:
    return _TUBE_COLORS[tube % len(_TUBE_COLORS)]


def _draw_tubes(axes: Any, equilibrium: Equilibrium, color: Any, alpha: float, label: str | None) -> None:
    ends = equilibrium.configuration.tube_ends
    for i, tube in enumerate(equilibrium.robot.tubes):
        # A tube is drawn where no other is around it: one surface inside another would shine through between facets.
        start, end = max(0.0, *ends[i + 1 :], 0.0), float(ends[i])
        name = tube.name if label is None else label if color is not None else f"{label}: {tube.name}"
        style: dict[str, Any] = {"color": color or _tube_color(i), "alpha": alpha, "zorder": 2.0 + 0.01 * i}
        if end - start < _CLOSE * equilibrium.length:
            axes.plot([], [], [], label=name, **style)
            continue
        inside = (equilibrium.arc_length > start) & (equilibrium.arc_length < end)
        poses = equilibrium.pose(np.concatenate(([start], equilibrium.arc_length[inside], [end])), i)
        _draw_swept(axes, poses, np.full(len(poses), 0.5 * tube.outer_diameter), **style)
        # The line inside keeps a tube visible that is thinner than a pixel, and is the legend's entry.
        axes.plot(*_MM * poses[:, :3, 3].T, lw=1.0, label=name, **(style | {"zorder": style["zorder"] - 0.005}))


def _draw_swept(axes: Any, poses: Array, radii: Array, **style: Any) -> None:
    """Circles of ``radii (k,)`` around the z axes of ``poses (k, 4, 4)``, m, lit from beside the viewer."""
    from matplotlib.colors import LightSource

    style["lightsource"] = LightSource(azdeg=90.0 - axes.azim + 30.0, altdeg=30.0)  # counts from north, clockwise
    angles = np.linspace(0.0, 2.0 * np.pi, _AROUND + 1)
    ring = np.vstack((np.cos(angles), np.sin(angles)))
    points = _MM * (poses[:, :3, 3:] + radii[:, None, None] * (poses[:, :3, :2] @ ring))
    axes.plot_surface(*points.transpose(1, 0, 2), rstride=1, cstride=1, lw=0.0, antialiased=False, **style)


def _draw_frames(axes: Any, equilibrium: Equilibrium) -> None:
    for s in np.linspace(0.0, equilibrium.length, 6):
        size = (0.08 if s == equilibrium.length else 0.04) * equilibrium.length
        pose = equilibrium.pose(s)
        for axis, color in enumerate(_FRAME_COLORS):
            ends = _MM * np.vstack((pose[:3, 3], pose[:3, 3] + size * pose[:3, axis]))
            axes.plot(*ends.T, color=color, lw=1.2, zorder=4)


def _draw_loads(axes: Any, equilibrium: Equilibrium) -> None:
    """Arrows that start at the backbone; the longest of each kind has the same length in every figure."""
    points = _point_wrenches(equilibrium)
    for k, (kind, unit, color) in enumerate((("force", "N", _FORCE_COLOR), ("moment", "N mm", _MOMENT_COLOR))):
        values = np.array([wrench[k] for _, wrench in points]).reshape(-1, 3)
        at = np.array([equilibrium.position(s) for s, _ in points]).reshape(-1, 3)
        sizes = np.linalg.norm(values, axis=1) * (1.0 if kind == "force" else _MM)
        _draw_arrows(axes, equilibrium, at, values, 0.22, color, [f"{size:.3g} {unit}" for size in sizes])
        for span in equilibrium.configuration.spans:
            _draw_row(axes, equilibrium, span, k, color)
    for placed in equilibrium.configuration.points:
        if placed.push.anchor is not None:
            _draw_spring(axes, equilibrium, equilibrium.position(placed.start), placed.push.anchor)


def _draw_spring(axes: Any, equilibrium: Equilibrium, start: Array, anchor: Array) -> None:
    """A zigzag line from a point of the backbone to a fixed one."""
    across = np.linalg.svd((anchor - start)[None])[2][1]  # a unit vector at a right angle
    side = np.resize([_SPRING, -_SPRING], _CORNERS) * equilibrium.length
    zigzag = start + np.outer(np.linspace(0.1, 0.9, _CORNERS), anchor - start) + np.outer(side, across)
    style: dict[str, Any] = {"color": _SPRING_COLOR, "lw": 1.0, "zorder": 3}
    axes.plot(*_MM * np.vstack((start, zigzag, anchor)).T, **style)
    axes.plot(*_MM * anchor[:, None], "s", ms=5.0, **style)


def _point_wrenches(equilibrium: Equilibrium) -> list[tuple[float, tuple[Array, Array]]]:
    """Where loads act at points, and their forces and moments, world frame."""
    return [(each.start, _wrench(equilibrium, each.push, each.start)) for each in equilibrium.configuration.points]


def _wrench(equilibrium: Equilibrium, push: Push, s: float) -> tuple[Array, Array]:
    """Force and moment, world frame, of what acts at a place, or per arc length there."""
    force, moment = value_at(push.force, s), value_at(push.moment, s)
    if push.field is None and not push.body:
        return force, moment
    pose = equilibrium.pose(s, push.tube)
    frame = pose[:3, :3]
    if push.field is None:
        return frame @ force, frame @ moment
    force, moment = (part.full()[:, 0] for part in push.field.wrench(s, pose[:3, 3], frame, push.numbers))
    return push.factor * force, push.factor * moment


def _draw_row(axes: Any, equilibrium: Equilibrium, span: Placed, k: int, color: str) -> None:
    """Arrows of forces (``k = 0``) or moments along a span, and how large they become."""
    interval = span.start, span.end
    count = max(4, round(24 * (span.end - span.start) / equilibrium.length))
    s = np.linspace(*interval, count)
    breaks = np.clip(equilibrium.configuration.break_points, *interval)
    places = s, np.union1d(np.linspace(*interval, 201), breaks)
    values, dense = (np.array([_wrench(equilibrium, span.push, float(x))[k] for x in own]) for own in places)
    sizes = np.linalg.norm(dense, axis=1)
    varies, peak = bool(np.ptp(sizes) > _CLOSE * sizes.max()), sizes.max()
    labels = [""] * count
    where = int(np.argmax(np.linalg.norm(values, axis=1))) if varies else 0
    labels[where] = f"{'up to ' if varies else ''}{peak:.3g} {('N/m', 'N m/m')[k]}"
    _draw_arrows(axes, equilibrium, equilibrium.position(s), values, 0.09, color, labels)


def _draw_arrows(
    axes: Any, equilibrium: Equilibrium, at: Array, values: Array, longest: float, color: str, labels: list[str]
) -> None:
    """Arrows ``values (k, 3)`` from ``at (k, 3)``, the largest ``longest`` robot lengths long."""
    from matplotlib.patheffects import withStroke

    sizes = np.linalg.norm(values, axis=1)
    for position, value, size, label in zip(at, values, sizes, labels, strict=True):
        if size > 0.0:
            length = longest * equilibrium.length * size / sizes.max()
            _draw_arrow(axes, position, length * value / size, 0.02 * longest * equilibrium.length, color)
            place = _MM * (position + (length + 0.09 * equilibrium.length) * value / size)
            halo = [withStroke(linewidth=2.5, foreground="white")]
            axes.text(*place, label, color=color, ha="center", va="center", zorder=5, path_effects=halo)


def _draw_arrow(axes: Any, start: Array, arrow: Array, thickness: float, color: str) -> None:
    from scipy.spatial.transform import Rotation

    length = float(np.linalg.norm(arrow))
    head = min(0.35 * length, 12.0 * thickness)
    poses = np.tile(np.eye(4), (4, 1, 1))
    poses[:, :3, :3] = Rotation.align_vectors([arrow], [[0.0, 0.0, 1.0]])[0].as_matrix()
    poses[:, :3, 3] = start + np.outer([0.0, length - head, length - head, length], arrow / length)
    radii = np.array([thickness, thickness, 0.3 * head, 0.0])
    _draw_swept(axes, poses, radii, color=color, shade=False, zorder=3)


def _finish(axes: Any) -> None:
    """Limits around everything drawn so far, a box in their proportions, labels and legend."""
    from matplotlib.ticker import MaxNLocator

    data = np.array([axes.xy_dataLim.intervalx, axes.xy_dataLim.intervaly, axes.zz_dataLim.intervalx])
    sides = 1.04 * np.maximum(np.ptp(data, axis=1), _NARROWEST * np.ptp(data, axis=1).max())
    limits = data.mean(axis=1)[:, None] + 0.5 * sides[:, None] * np.array([-1.0, 1.0])
    axes.set(xlim=limits[0], ylim=limits[1], zlim=limits[2], xlabel="x [mm]", ylabel="y [mm]", zlabel="z [mm]")
    alone = len(axes.figure.axes) == 1  # then labels of axes need room within the figure
    axes.set_box_aspect(sides, zoom=0.82 if alone else 1.0)
    axes.zaxis.labelpad = 9.0
    for axis, side in zip((axes.xaxis, axes.yaxis, axes.zaxis), sides, strict=True):
        axis.set_major_locator(MaxNLocator(max(2, round(7 * side / sides.max())), steps=[1, 2, 5, 10]))
    handles, labels = axes.get_legend_handles_labels()
    unique = dict(zip(labels, handles, strict=True))
    legend = axes.legend(unique.values(), unique.keys(), **_ABOVE)
    for handle in legend.legend_handles:
        handle.set_linewidth(4.0 if handle.get_linestyle() == "-" else 1.5)


# -- along the arc length ----------------------------------------------------------------------------------------


def _sampled(equilibrium: Equilibrium, end: float, of: Callable[[Array], Any]) -> tuple[Array, Array]:
    """Arc lengths, mm, and values on ``[0, end]``: twice at each break point, the limits from the left and right."""
    breaks = equilibrium.configuration.break_points
    at, drawn = [], []
    for a, b in pairwise(breaks):
        if b <= end + _CLOSE * equilibrium.length:
            s = np.linspace(a, b, 2 + int(200.0 * (b - a) / equilibrium.length))
            drawn.append(s)
            at.append(np.append(s[:-1], b - 1e-6 * (b - a)))
    return _MM * np.concatenate(drawn), np.asarray(of(np.concatenate(at)))


def _draw_panels(panels: list[Axes], equilibrium: Equilibrium, linestyle: str) -> None:
    style: dict[str, Any] = {"ls": linestyle, "lw": 1.0 if linestyle == "--" else 1.6}
    s, curvature = _sampled(equilibrium, equilibrium.length, equilibrium.curvature)
    for component, color, _ in _COMPONENTS:
        values = np.linalg.norm(curvature, axis=1) if component is None else curvature[:, component]
        panels[0].plot(s, values, color=color, **style)
    for i, end in enumerate(equilibrium.configuration.tube_ends):
        s, torsion = _sampled(equilibrium, float(end), partial(equilibrium.torsion, i))
        panels[1].plot(s, torsion, color=_tube_color(i), **style)
        s, moment = _sampled(equilibrium, float(end), partial(equilibrium.tube_moment, i))
        for panel, values in zip(panels[2:], moment.T, strict=True):
            panel.plot(s, _MM * values, color=_tube_color(i), **style)


def _label_panels(panels: list[Axes], equilibrium: Equilibrium, compared: bool) -> None:
    from matplotlib.lines import Line2D

    names = ("curvature\n[1/m]", "torsion $u_{i,z}$\n[1/m]", *(f"moment $m_{{i,{c}}}$\n[N mm]" for c in "xyz"))
    scales = equilibrium.configuration.scales
    units = (1.0 / scales.length, 1.0 / scales.length, *3 * (_MM * scales.moment,))
    for panel, name, unit in zip(panels, names, units, strict=True):
        panel.set_ylabel(name)
        panel.margins(x=0.01, y=0.12)
        low, high = panel.get_ylim()
        if high - low < _NOTHING * unit:
            panel.set_ylim(0.5 * (low + high) - 0.5 * _NOTHING * unit, 0.5 * (low + high) + 0.5 * _NOTHING * unit)
        panel.tick_params(labelbottom=panel is panels[-1])
        _mark_sections(panel, equilibrium)
    panels[0].figure.align_ylabels(panels)
    panels[-1].set_xlabel("arc length s [mm]")
    entries = [Line2D([], [], color=color, label=label) for _, color, label in _COMPONENTS]
    if compared:
        entries += [Line2D([], [], color="0.3", ls=ls, label=of) for ls, of in (("-", "loaded"), ("--", "unloaded"))]
    panels[0].legend(handles=entries, **_ABOVE)


def _mark_sections(panel: Axes, equilibrium: Equilibrium) -> None:
    """Thin lines where a precurvature steps (grey) and where a tube ends (its colour)."""
    configuration = equilibrium.configuration
    for i, tube in enumerate(equilibrium.robot.tubes):
        ends = configuration.translations[i] + np.cumsum([piece.length for piece in tube.precurvature])
        for s in ends[:-1][ends[:-1] > 0.0]:
            panel.axvline(_MM * s, color="0.85", lw=0.8, zorder=0)
        panel.axvline(_MM * ends[-1], color=_tube_color(i), lw=0.9, ls=":", zorder=0)
