"""The solved forward problem as a differentiable CasADi function, for programs of the user's own.

Break points are sorted inside, so that tubes may pass each other; Newton's method is CasADi's ``rootfinder``, whose
derivatives follow from the implicit-function theorem. A rootfinder may end without a root and even call a residual of
NaN a success, so that everything it returns is checked: outputs are the robot's, or NaN.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any

import casadi as ca
import numpy as np

from .mechanics.loading import material_frame
from .mechanics.state import State
from .robot.checks import Array
from .robot.parameters import Parameter, chosen, parameters
from .sensitivity import Solved
from .transcription.parametric_problem import Discretized, ParametricProblem, Swept

_NEWTON = {
    "abstol": 1e-10,
    "max_iter": 30,
    "error_on_fail": False,
    "show_eval_warnings": False,
}
_ACCEPTED = 1e-8  # scaled residual: of flexible robots rounding errors alone leave more than ``abstol``
_SLACK = 1e-6  # of the length: optimizers overstep their bounds a little


def identifier(name: str) -> str:
    """A parameter's name as that of a function's input: ``loads[0].force`` becomes ``loads_0_force``.

    >>> identifier("tubes[0].precurvature[1].length")
    'tubes_0_precurvature_1_length'
    """
    return re.sub(r"\W+", "_", name)


def forward_map(solved: Solved, wrt: Sequence[str], along: Array, steps: int | None) -> ca.Function:
    """The function that ``ForwardProblem.function`` describes."""
    own = solved.configuration
    selected = chosen(parameters(own.robot, own.actuation, own.loads), wrt)
    problem = ParametricProblem(own, selected, solved.integrator, along.tolist(), clip=True)
    order = problem.sorted()
    count = _steps(solved) if steps is None else steps
    discretized = Discretized(problem, order, [np.linspace(0.0, 1.0, count + 1)] * order.sections)
    inputs = [ca.MX.sym(identifier(each.name), *_size(each)) for each in selected]
    theta = ca.vertcat(*(ca.vec(symbol.T) for symbol in inputs))
    start = ca.MX.sym("initial", len(solved.z))
    z = _root(discretized, solved)(start, theta)
    swept = discretized.swept(z, theta)
    norm = ca.norm_inf(swept.residual)
    margin = ca.Function("margin", [problem.theta], [problem.parametric.margin])(theta)
    good = ca.logic_and(norm <= _ACCEPTED, margin >= -_SLACK * own.length)
    outputs = {**_outputs(problem, swept), "unknowns": z}
    told = {name: ca.if_else(good, value, np.nan) for name, value in outputs.items()} | {"residual_norm": norm}
    return ca.Function(
        "forward",
        [*inputs, start],
        list(told.values()),
        [*(symbol.name() for symbol in inputs), "initial"],
        list(told),
    )


def _size(parameter: Parameter) -> tuple[int, int]:
    rows, *columns = parameter.value.shape or (1,)
    return int(rows), int(columns[0]) if columns else 1


def _steps(solved: Solved) -> int:
    """As many steps a section as the solution needed in any."""
    starts = solved.mesh[:, 0]
    sections = np.searchsorted(solved.configuration.break_points, starts, side="right")
    return int(np.bincount(sections).max())


def _root(discretized: Discretized, solved: Solved) -> ca.Function:
    """``(initial, theta) -> z``; the data are made once and not in every iteration."""
    functions, z = discretized.problem.functions, ca.MX.sym("z", len(solved.z))
    theta, start = ca.MX.sym("theta", discretized.problem.theta.shape[0]), ca.MX.sym("start", len(solved.z))
    columns, entry, *_ = discretized.data(theta)
    data = ca.MX.sym("data", columns.numel() + entry.numel())
    given = ca.reshape(data[: columns.numel()], columns.shape), data[columns.numel() :]
    _, after, _ = discretized.sweep(z, given[1], given[0])
    residual = after[functions.tip_rows, -1]
    finder = ca.rootfinder("equilibrium", "newton", {"x": z, "p": data, "g": residual}, _NEWTON)
    return ca.Function("root", [start, theta], [finder(start, ca.vertcat(ca.vec(columns), entry))])


def _outputs(problem: ParametricProblem, swept: Swept) -> dict[str, Any]:
    configuration = problem.configuration
    tubes, length = configuration.tube_count, configuration.scales.length
    tip = State.split(swept.left[:, -1], tubes)
    tube = _tube_at_tip(problem, swept)
    angle = ca.dot(tube, tip.angles)
    rows = State.parts(tubes)["position"]
    found = {"tip_position": tip.position * length, "tip_rotation": material_frame(tip.orientation, angle)}
    if swept.weights.shape[1]:
        found["positions"] = (swept.right @ swept.weights)[rows, :] * length
    return found


def _tube_at_tip(problem: ParametricProblem, swept: Swept) -> Any:
    """One for the innermost tube that ends at the tip, zero for the others."""
    parametric = problem.parametric
    ends = [parametric.points[parametric.tube_end(i)] for i in range(parametric.tubes)]
    taken, weights = ca.SX(0), []
    for end in ends:
        weights.append(ca.if_else(taken, 0, end >= parametric.length))
        taken = ca.logic_or(taken, weights[-1])
    return ca.Function("at_tip", [problem.theta], [ca.vertcat(*weights)])(swept.theta)

