"""Reports for people to read: plain text, SI units with the usual prefixes."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from ..checks import Array
    from ..robot.robot import Robot
    from .equilibrium import Equilibrium


def equilibrium_report(equilibrium: Equilibrium) -> str:
    """The report of an equilibrium: what was solved, by which methods, how accurately, and the results."""
    lines = _heading(equilibrium)
    if equilibrium.converged:
        lines += _quality(equilibrium) + _shape(equilibrium) + _tubes(equilibrium) + _energies(equilibrium)
    else:
        lines += ["", equilibrium.message]
    return "\n".join(lines)


def robot_report(robot: Robot) -> str:
    """The report of a robot: its tubes from the innermost to the outermost."""
    lines = [
        f"Robot of {_count(len(robot.tubes), 'tube')}",
        "  tube              outer, inner diameter [mm]   length [mm]   EI [N m^2]   GJ [N m^2]   precurvature",
    ]
    for i, tube in enumerate(robot.tubes):
        size = f"{1e3 * tube.outer_diameter:>12.4f}, {1e3 * tube.inner_diameter:<13.4f}  {1e3 * tube.length:>10.3f}"
        stiffness = f"{tube.bending_stiffness:>10.4g}   {tube.torsional_stiffness:>10.4g}"
        pieces = " + ".join(type(piece).__name__ for piece in tube.precurvature)
        lines.append(f"  {i} {tube.name[:14]:<14}  {size}   {stiffness}   {pieces}")
    return "\n".join(lines)


def _heading(equilibrium: Equilibrium) -> list[str]:
    tubes, loads = len(equilibrium.robot.tubes), len(equilibrium.loads)
    return [
        f"Equilibrium of {_count(tubes, 'tube')} under {_count(loads, 'load')}",
        row("status", equilibrium.status.description),
        *(row(f"loads[{k}]", str(load)) for k, load in enumerate(equilibrium.loads)),
        row("path", equilibrium.path),
        row("iterations", str(equilibrium.iterations)),
        row("time", f"set-up {1e3 * equilibrium.setup_time:.1f} ms, solve {1e3 * equilibrium.solve_time:.1f} ms"),
    ]


def _quality(equilibrium: Equilibrium) -> list[str]:
    error, length = equilibrium.discretization_error, equilibrium.length
    return [
        row("residual", f"{equilibrium.residual_norm:.1e} (moments over max(EI)/length)"),
        row("discretization error", f"{error:.1e} m, estimated ({error / length:.1e} of the length)"),
        row("stable", _stability(equilibrium)),
    ]


def _stability(equilibrium: Equilibrium) -> str:
    negative, reason = equilibrium.unstable_directions, equilibrium.configuration.without_potential
    if negative is None:
        return f"not defined: {reason}" if reason else "unknown: the steps are too coarse to decide"
    if negative:
        return f"no: {_count(negative, 'direction')} in which the potential energy falls"
    return "yes" if equilibrium.is_stable else "neutral: a fold, or one of a family of equilibria"


def _shape(equilibrium: Equilibrium) -> list[str]:
    pose = equilibrium.tip_pose
    return [
        "",
        row("length", f"{1e3 * equilibrium.length:.3f} mm"),
        row("tip position", f"{_vector(1e3 * pose[:3, 3], '.6f')} mm"),
        row("tip direction", _vector(pose[:3, 2], ".6f")),
        row("base force", f"{_vector(equilibrium.internal_force(0.0), '.6f')} N"),
        row("base moment", f"{_vector(1e3 * equilibrium.internal_moment(0.0), '.6f')} N mm"),
    ]


def _tubes(equilibrium: Equilibrium) -> list[str]:
    lines = ["", "  tube              end [mm]   angle at its tip [deg]   base torsion [1/m]   base moment z [N mm]"]
    torques = equilibrium.last_iterate.torsional
    for i, tube in enumerate(equilibrium.robot.tubes):
        end = float(equilibrium.configuration.tube_ends[i])
        angle = float(np.rad2deg(equilibrium.tube_angle(i, end)))
        torsion = equilibrium.torsion(i, 0.0)
        numbers = f"{1e3 * end:>8.3f}   {angle:>22.4f}   {torsion:>18.6f}   {1e3 * torques[i]:>20.6f}"
        lines.append(f"  {i} {tube.name[:14]:<14}  {numbers}")
    return lines


def _energies(equilibrium: Equilibrium) -> list[str]:
    lines = [
        "",
        row("elastic energy", f"{1e3 * equilibrium.energy:.6f} mJ"),
        row(
            "work of the loads",
            f"{1e3 * equilibrium.load_work:.6f} mJ (loads with a potential; forces measured from the world's origin)",
        ),
        row("potential energy", f"{1e3 * equilibrium.potential_energy:.6f} mJ"),
    ]
    if equilibrium.configuration.without_potential:
        lines.append("  Some loads have no potential; work and potential energy leave them out.")
    return lines


def row(name: str, value: str) -> str:
    """A line of a report: a name and its value."""
    return f"  {name:<21} {value}"


def _count(number: int, noun: str) -> str:
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"


def _vector(values: Array, style: str) -> str:
    return "(" + ", ".join(format(float(value) + 0.0, style) for value in values) + ")"
