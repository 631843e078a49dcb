"""The check of a shape by an integrator that knows nothing of the mesh: SciPy's adaptive DOP853."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..mechanics.sections import Configuration
from ..mechanics.state import State
from ..robot.checks import Array
from .columns import StepColumns
from .linear import newton_correction
from .shape import Shape
from .shooting import Shooting, shooting_functions

_RELATIVE, _ABSOLUTE = 1e-11, 1e-13


def integrate(configuration: Configuration, start: Array, points: Array) -> tuple[Array, Array]:
    """From the dimensionless state behind ``s = 0`` to the tip: states from the left at ``points``, and behind the tip.

    ``points`` must contain every break point but 0.
    """
    from scipy.integrate import solve_ivp

    functions = shooting_functions(configuration.tube_count, kind=configuration.kind)
    layout = StepColumns(configuration.tube_count, 1, configuration.kind)
    length = configuration.length
    state, states = start, np.zeros((len(start), len(points)))
    for a, b in zip(configuration.break_points, configuration.break_points[1:], strict=False):
        inside = (points > a) & (points <= b)
        rates = _rates(configuration, layout, float(a), float(b))
        found = solve_ivp(
            rates, (a / length, b / length), state, "DOP853", points[inside] / length, rtol=_RELATIVE, atol=_ABSOLUTE
        )
        if not found.success:
            raise ArithmeticError(f"the integration stopped in [{a:g}, {b:g}] m: {found.message}")
        states[:, inside] = found.y
        end = layout.pack(configuration, np.array([[a, b]]), np.ones(1))
        state = functions.point_jump(found.y[:, -1], end).full()[:, 0]
    return states, state


def _rates(configuration: Configuration, layout: StepColumns, start: float, end: float) -> Any:
    """The right-hand side in one section, with its data taken at every ``s`` anew."""
    function = shooting_functions(configuration.tube_count, kind=configuration.kind).rates
    middle, length = np.array([0.5 * (start + end)]), configuration.length

    def rates(s: float, state: Array) -> Array:
        column = layout.pack(configuration, np.array([[start, s * length]]), np.ones(1), middle)
        return np.asarray(function(state, column).full()[:, 0])

    return rates


def defect(shooting: Shooting, z: Array, shape: Shape) -> float:
    """Largest dimensionless distance between a shape, at the middle and the end of every step, and the exact one.

    The exact shape: integrated from ``z``, corrected by one Newton step with the residual the integrator finds.
    """
    configuration, mesh = shooting.configuration, shooting.mesh
    points = np.column_stack((mesh.mean(axis=1), mesh[:, 1])).ravel()
    positions = shape.at(points, from_left=True).state.position / configuration.length
    parts = State.parts(configuration.tube_count)
    start = shooting.start(z)
    _, tip = integrate(configuration, start, points)
    missed = np.zeros(3) if configuration.kind.live else tip[parts["force"]]
    if np.abs(missed).max() > _ABSOLUTE:  # of dead loads as this integrator sees them nothing must be left at the tip
        start[parts["force"]] -= missed
        _, tip = integrate(configuration, start, points)
    correction = newton_correction(shooting.linearize(z)[1], tip[shooting.functions.tip_rows])
    corrected = shooting.start(z + correction)
    corrected[parts["force"]] -= missed
    states, _ = integrate(configuration, corrected, points)
    return float(np.linalg.norm(states[parts["position"]] - positions, axis=0).max())
