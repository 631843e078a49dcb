"""Figures: what is drawn is what was computed."""

from __future__ import annotations

import subprocess
import sys

import matplotlib

matplotlib.use("Agg")

import numpy as np
import pytest
from matplotlib import pyplot
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d.art3d import Poly3DCollection

import ctr_opt as ctr
from ctr_opt.files.figures import save_figure
from ctr_opt.forward.plot import figure_equilibrium, plot_equilibrium
from tests.support.slow import some_slow

PUSH = ctr.PointWrench(force=[0.2, 0.3, -0.2])
OUTER_END = 0.1


@pytest.fixture(scope="module")
def problem():
    inner = [ctr.Straight(0.2), ctr.Arc(0.1, 12.0)]
    outer = [ctr.Straight(0.1), ctr.Arc(0.08, 8.0)]
    tubes = [
        ctr.Tube("wire", 1.2e-3, 0.9e-3, inner, youngs_modulus=58e9, poisson_ratio=0.3),
        ctr.Tube("sheath", 1.8e-3, 1.4e-3, outer, youngs_modulus=58e9, poisson_ratio=0.3),
    ]
    return ctr.ForwardProblem(ctr.Robot(tubes))


@pytest.fixture(scope="module")
def pose():
    return ctr.Actuation([0.0, 0.7], [-0.14, -0.08])


@pytest.fixture(scope="module")
def free(problem, pose):
    return problem.solve(pose)


@pytest.fixture(scope="module")
def pushed(problem, pose):
    return problem.solve(pose, [PUSH])


@pytest.fixture
def axes():
    return Figure().add_subplot(projection="3d")


@pytest.fixture
def draw(monkeypatch, axes):
    """Draw, and return the points of every surface: ``(3, along, around)``, mm."""
    surfaces = []
    plot_surface = axes.plot_surface

    def record(*points, **style):
        surfaces.append(np.array(points))
        return plot_surface(*points, **style)

    monkeypatch.setattr(axes, "plot_surface", record)

    def drawn(equilibrium, **style):
        plot_equilibrium(equilibrium, axes, **style)
        axes.figure.canvas.draw()
        return surfaces

    return drawn


def limits(axes):
    return np.array([axes.get_xlim(), axes.get_ylim(), axes.get_zlim()])


def names(axes):
    return [text.get_text() for text in axes.get_legend().get_texts()]


def texts(axes):
    return [text.get_text() for text in axes.texts if text.get_text()]


def assert_true_aspect(axes):
    ratio = np.ptp(limits(axes), axis=1) / axes._box_aspect  # the box in 3-D has no public getter
    np.testing.assert_allclose(ratio, ratio[0], rtol=1e-12)


def test_tubes_have_their_real_diameters_where_they_are_outermost(draw, free):
    """None is drawn inside another, where it would shine through."""
    surfaces = draw(free)
    assert len(surfaces) == 2
    inner, outer = free.configuration.tube_ends
    assert inner > outer
    for i, (start, end) in enumerate(((outer, inner), (0.0, outer))):
        s = np.concatenate(([start], free.arc_length[(free.arc_length > start) & (free.arc_length < end)], [end]))
        away = surfaces[i] - 1e3 * free.position(s).T[:, :, None]
        np.testing.assert_allclose(np.linalg.norm(away, axis=0), 500.0 * free.robot.tubes[i].outer_diameter, rtol=1e-9)
        tangents = free.pose(s)[:, :3, 2]
        np.testing.assert_allclose(np.einsum("cka,kc->ka", away, tangents), 0.0, atol=1e-9)


def test_a_tube_that_is_nowhere_seen_stands_in_the_legend(draw, axes, problem):
    flush = problem.solve(ctr.Actuation([0.0, 0.0], [-tube.length + 0.05 for tube in problem.robot.tubes]))
    assert len(draw(flush)) == 1


def test_legend_names_the_tubes_once_in_their_own_colors(axes, free, pushed):
    plot_equilibrium(free, axes)
    plot_equilibrium(pushed, axes)
    assert names(axes) == ["wire", "sheath"]
    assert len({handle.get_color() for handle in axes.get_legend().legend_handles}) == 2


def test_a_second_shape_grows_the_limits_and_keeps_the_aspect(axes, free, pushed):
    plot_equilibrium(free, axes)
    assert_true_aspect(axes)
    before = limits(axes)
    plot_equilibrium(pushed, axes, color="0.5", label="pushed", alpha=0.3)
    after = limits(axes)
    assert_true_aspect(axes)
    assert names(axes) == ["wire", "sheath", "pushed"]
    for equilibrium in (free, pushed):
        line = 1e3 * equilibrium.position(equilibrium.arc_length)
        assert np.all(line > after[:, 0])
        assert np.all(line < after[:, 1])
    assert np.all(after[:, 0] <= before[:, 0] + 1e-9)
    assert np.all(after[:, 1] >= before[:, 1] - 1e-9)
    assert np.ptp(after, axis=1).sum() > np.ptp(before, axis=1).sum() + 1.0


def test_the_users_own_data_stay_in_view(axes, free):
    axes.plot([150.0], [0.0], [10.0], "o")
    plot_equilibrium(free, axes)
    assert limits(axes)[0, 1] > 150.0


def test_a_force_is_an_arrow_from_its_point_along_it(draw, axes, pushed):
    *_, arrow = draw(pushed)
    rings = arrow[:, :, :-1].mean(axis=2).T
    np.testing.assert_allclose(rings[0], 1e3 * pushed.tip_position, atol=1e-9)
    direction = rings[-1] - rings[0]
    np.testing.assert_allclose(
        direction / np.linalg.norm(direction), PUSH.force / np.linalg.norm(PUSH.force), atol=1e-9
    )
    assert texts(axes) == ["0.412 N"]


def test_no_arrows_without_loads(draw, axes, free, pushed):
    assert len(draw(free)) == 2
    assert len(draw(pushed, loads=False)) == 4
    assert texts(axes) == []


@pytest.mark.parametrize(
    ("force", "label"),
    [
        ([0.0, -2.0, 0.0], "2 N/m"),
        (([0.02, 0.05, 0.09], [[0, 0, 0], [3, 0, 0], [0, 0, 0]]), "up to 3 N/m"),
        (lambda s: [4.0 * np.sin(np.pi * s / 0.1), 0.0, 0.0], "up to 4 N/m"),
    ],
    ids=["constant", "table", "function"],
)
def test_a_distributed_force_is_a_row_of_arrows(draw, axes, problem, pose, force, label):
    load = ctr.DistributedLoad(force=force, start=0.02, end=0.09)
    equilibrium = problem.solve(pose, [load, ctr.PointWrench(moment=[0.004, 0.0, 0.003])])
    surfaces = draw(equilibrium)
    assert len(surfaces) > 2 + 1 + 5
    assert sorted(texts(axes)) == sorted([label, "5 N mm"])


def test_backbone_alone(draw, axes, free):
    assert draw(free, tubes=False, frames=False, color="0.4", linestyle="--", label="free") == []
    (line,) = axes.lines
    np.testing.assert_allclose(np.array(line.get_data_3d()).T, 1e3 * free.position(free.arc_length))
    assert names(axes) == ["free"]


def test_a_straight_robot_has_a_box_too(axes):
    tube = ctr.Tube("needle", 1e-3, 0.0, ctr.Straight(0.1), youngs_modulus=60e9, poisson_ratio=0.3)
    plot_equilibrium(ctr.ForwardProblem(ctr.Robot([tube])).solve(ctr.Actuation([0.0], [0.0])), axes, frames=False)
    assert_true_aspect(axes)
    assert np.ptp(limits(axes), axis=1).min() > 20.0


def test_flat_axes_are_refused(free):
    with pytest.raises(ctr.DefinitionError, match="projection='3d'"):
        plot_equilibrium(free, Figure().add_subplot())


def test_a_new_figure_by_default(free):
    before = pyplot.get_fignums()
    ax = free.plot()
    assert len(pyplot.get_fignums()) == len(before) + 1
    assert ax.get_xlabel() == "x [mm]"
    assert any(isinstance(artist, Poly3DCollection) for artist in ax.collections)
    pyplot.close(ax.figure)


def test_panels_show_both_limits_at_a_tube_end(pushed, free):
    before = pyplot.get_fignums()
    figure = figure_equilibrium(pushed, free)
    assert pyplot.get_fignums() == before
    space, curvature, _, bending, *_ = figure.axes
    assert names(space) == ["unloaded", "wire", "sheath"]
    solid = [line for line in curvature.lines if line.get_linestyle() == "-" and len(line.get_xdata()) > 2]
    s, u = solid[0].get_data()
    left, right = u[np.isclose(s, 1e3 * OUTER_END)]
    assert right == pytest.approx(np.linalg.norm(pushed.curvature(OUTER_END)), rel=1e-12)
    assert left == pytest.approx(np.linalg.norm(pushed.curvature(OUTER_END * (1 - 1e-7))), rel=1e-4)
    assert abs(right - left) > 1.0
    ends = [
        line.get_xdata()[-1] for line in bending.lines if line.get_color() == "#E69F00" and len(line.get_xdata()) > 2
    ]
    np.testing.assert_allclose(ends, 1e3 * OUTER_END)


@pytest.mark.parametrize("suffix", some_slow([".png", ".pdf", ".svg"], [".png", ".svg"]))
def test_save(tmp_path, pushed, free, suffix):
    path = tmp_path / f"shape{suffix}"
    path.write_text("old")
    save_figure(figure_equilibrium(pushed, free), path)
    assert path.stat().st_size > 10_000
    assert list(tmp_path.iterdir()) == [path]


def test_save_refuses_what_it_cannot_write(tmp_path):
    with pytest.raises(ctr.DefinitionError, match=r"shape\.xyz.*\.png, \.pdf, \.svg"):
        save_figure(Figure(), tmp_path / "shape.xyz")
    with pytest.raises(ctr.DefinitionError, match="does not exist"):
        save_figure(Figure(), tmp_path / "nowhere" / "shape.png")
    assert list(tmp_path.iterdir()) == []


def test_a_failed_save_leaves_the_old_file(tmp_path, monkeypatch):
    path = tmp_path / "shape.png"
    path.write_text("old")
    figure = Figure()

    def fail(part, **_):
        part.write_text("half")
        raise OSError("disk full")

    monkeypatch.setattr(figure, "savefig", fail)
    with pytest.raises(ctr.DefinitionError, match=r"shape\.png cannot be written: disk full"):
        save_figure(figure, path)
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]


def test_importing_plotting_does_not_import_matplotlib():
    code = "import sys, ctr_opt.forward.plot; sys.exit('matplotlib' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_rounding_errors_of_zero_are_not_magnified():
    tube = ctr.Tube("wire", 1e-3, 0.0, ctr.Arc(0.1, 5.0), youngs_modulus=60e9, poisson_ratio=0.3)
    equilibrium = ctr.ForwardProblem(ctr.Robot([tube])).solve(ctr.Actuation([0.3], [0.0]))
    for panel in figure_equilibrium(equilibrium).axes[2:]:
        assert np.ptp(panel.get_ylim()) > 1e-4
