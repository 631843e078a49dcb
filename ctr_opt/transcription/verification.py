"""Verification of a shape by an independent integrator: SciPy's adaptive DOP853."""

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
_LONGEST = 1.0 / 32.0  # of a step of the mesh, under expressions: longer steps could miss their variations


def integrate(configuration: Configuration, mesh: Array, right: Array) -> tuple[Array, Array]:
    """Integrate every step of a mesh from the states ``right`` of its start to its middle and its end, dimensionless.

    All steps are integrated at once, as separate initial-value problems, with data at every ``s`` requested.
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
    solution = solve_ivp(
        rates, (0.0, 1.0), right.ravel(), "DOP853", (0.5, 1.0), rtol=_RELATIVE, atol=_ABSOLUTE, max_step=longest
    )
    if not solution.success:
        raise ArithmeticError(f"the integration of a step stopped: {solution.message}")
    return solution.y[:, 0].reshape(right.shape), solution.y[:, 1].reshape(right.shape)


def defect(shape: Shape, z: Array) -> float:
    """Largest distance between a shape and the exact one, at both ends and the middle of every step, m.

    For the exact shape every step is integrated again, and one Newton step closes the gaps. The distance is infinite if
    the integrator fails; ``z`` are the shape's unknowns at the entry point.
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
