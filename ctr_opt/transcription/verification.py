"""The check of a shape by an integrator that knows nothing of its discretization: SciPy's adaptive DOP853."""

from __future__ import annotations

import numpy as np

from ..checks import Array
from ..layout.columns import StepColumns
from ..layout.configuration import Configuration
from ..mechanics.state import State
from .closure import close
from .shape import Shape
from .shooting import shooting_functions

_RELATIVE, _ABSOLUTE = 1e-12, 1e-14
_LONGEST = 1.0 / 32.0  # of a step of the mesh, under expressions: what they hide between longer steps would be missed


def integrate(configuration: Configuration, mesh: Array, right: Array) -> tuple[Array, Array]:
    """Dimensionless states in the middle and at the end of every step of a mesh, from those ``right`` of its start.

    All steps at once, each an initial-value problem of its own, with data taken at every ``s`` it asks for.
    """
    from scipy.integrate import solve_ivp

    functions = shooting_functions(configuration.tube_count, "RK8", configuration.kind)
    layout = StepColumns(configuration.tube_count, 1, configuration.kind)
    start, lengths, middle = mesh[:, 0], np.diff(mesh)[:, 0], mesh.mean(axis=1)

    def rates(t: float, states: Array) -> Array:
        pieces = np.column_stack((start, start + t * lengths))
        columns = layout.pack(configuration, pieces, np.ones(1), middle)
        (slopes,) = functions.many("rates", states.reshape(right.shape), columns)
        return np.asarray((slopes * (lengths / configuration.length)).ravel())

    longest = _LONGEST if configuration.kind.fields else np.inf
    found = solve_ivp(
        rates, (0.0, 1.0), right.ravel(), "DOP853", (0.5, 1.0), rtol=_RELATIVE, atol=_ABSOLUTE, max_step=longest
    )
    if not found.success:
        raise ArithmeticError(f"the integration of a step stopped: {found.message}")
    return found.y[:, 0].reshape(right.shape), found.y[:, 1].reshape(right.shape)


def defect(shape: Shape, z: Array) -> float:
    """Largest distance between a shape, at both ends and the middle of every step, and the exact one, m.

    The exact shape: every step integrated anew, the gaps that this leaves closed by one Newton step. Infinite where the
    integrator fails; ``z`` are the shape's unknowns at the entry point.
    """
    configuration, nodes, mesh = shape.configuration, shape.nodes, shape.mesh
    try:
        middles, ends = integrate(configuration, mesh, nodes.right)
    except ArithmeticError:
        return np.inf
    closure = close(shape.shooting, z, nodes, ends)
    position = State.parts(configuration.tube_count)["position"]
    moved, gaps = closure.states[position], closure.gaps[position]
    arrived = np.column_stack((nodes.right, nodes.tip))[position, 1:] + moved[:, 1:] - nodes.left[position]
    passed = shape.at(mesh.mean(axis=1)).state.position / configuration.length
    between = middles[position] + 0.5 * (moved[:, :-1] + moved[:, 1:] - gaps) - passed
    distance = max(np.linalg.norm(apart, axis=0).max() for apart in (moved, arrived, between))
    return float(configuration.length * distance)
