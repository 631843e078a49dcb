"""The solved forward problem as a differentiable CasADi function, for user-defined programs.

Break points are sorted inside, so that tubes may pass each other. Newton's method is CasADi's ``rootfinder``, whose
derivatives follow from the implicit-function theorem. A rootfinder may end without a root, and may even report success
at a residual of NaN. So everything it returns is checked, and outputs are NaN unless the equations hold.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import casadi as ca
import numpy as np

from ..checks import Array, array, names_of, whole
from ..errors import DefinitionError
from ..mechanics.fields import material_frame
from ..mechanics.state import State, slices
from ..robot.names import NamedNumber, chosen, identifier, parameters
from ..robot.robot import Robot
from ..transcription.parametric_problem import Discretized, ParametricProblem, Swept
from .equilibrium import Equilibrium
from .sensitivity import Solved

_NEWTON = {"abstol": 1e-10, "max_iter": 30, "error_on_fail": False, "show_eval_warnings": False}
_ACCEPTED = 1e-8  # scaled residual: for flexible robots, rounding errors alone leave more than ``abstol``
_MOST_STEPS = 1000  # of a section: more would be built for minutes
_SLACK = 1e-6  # of the length: optimizers overstep their bounds a little


def forward_function(robot: Robot, initial: Any, wrt: Any, along: Any, steps: Any) -> ca.Function:
    """Build the function that ``ForwardProblem.function`` describes."""
    if not isinstance(initial, Equilibrium) or initial.robot != robot:
        raise DefinitionError(f"initial = {initial!r} must be an Equilibrium of this problem's robot")
    if isinstance(wrt, str):
        raise DefinitionError(f"wrt = {wrt!r} must be a list of names, like wrt=[{wrt!r}]")
    wrt, count = names_of(wrt, "wrt"), None if steps is None else whole(steps, "steps", 1, _MOST_STEPS)
    empty = isinstance(along, (list, tuple)) and not along
    places = np.zeros(0) if empty else array(along, "along", (None,), unit="m")
    return _forward_map(initial.solved(), wrt, places, count)


def _forward_map(solved: Solved, wrt: Sequence[str], along: Array, steps: int | None) -> ca.Function:
    configuration = solved.configuration
    selected = chosen(parameters(configuration.robot, configuration.actuation, configuration.loads), wrt)
    probes = [(s, None) for s in along.tolist()]
    problem = ParametricProblem(configuration, selected, solved.integrator, probes, clip=True)
    order = problem.sorted()
    cuts = np.linspace(0.0, 1.0, (solved.steps if steps is None else steps) + 1)
    model = _Model(Discretized(problem, order, [cuts] * order.sections), len(solved.z))
    inputs = [ca.MX.sym(identifier(parameter.name), *_size(parameter)) for parameter in selected]
    start = ca.MX.sym("initial", model.unknowns)
    unit = configuration.scales.unknowns(configuration.tube_count, configuration.kind.live)
    values, norm = model.solved()(ca.vertcat(*(ca.vec(symbol.T) for symbol in inputs)), start / unit)
    sizes = {"tip_position": (3, 1), "tip_rotation": (3, 3), "positions": (3, len(along))}
    rows = slices({name: rows * columns for name, (rows, columns) in sizes.items()} | {"unknowns": model.unknowns})
    outputs = {name: ca.reshape(values[rows[name]], size) for name, size in sizes.items() if size[1]}
    outputs |= {"unknowns": values[rows["unknowns"]] * unit, "residual_norm": norm}
    names = [*(symbol.name() for symbol in inputs), "initial"]
    return ca.Function("forward", [*inputs, start], list(outputs.values()), names, list(outputs))


class _Model:
    """The outputs and the residual as functions of unknowns and parameters, and the root with its derivatives."""

    def __init__(self, discretized: Discretized, unknowns: int) -> None:
        self.discretized = discretized
        self.problem = discretized.problem
        self.unknowns = unknowns
        self.count = int(self.problem.theta.shape[0])
        z, theta = ca.MX.sym("z", unknowns), ca.MX.sym("theta", self.count)
        swept = discretized.swept(z, theta)
        margin = ca.Function("margin", [self.problem.theta], [self.problem.parametric.margin])(theta)
        self.all = ca.Function("all", [z, theta], [_outputs(self.problem, swept), swept.residual, margin])

    def solved(self) -> ca.Function:
        """The function ``(theta, initial) -> (outputs and unknowns, or NaN; norm of the residual)``."""
        theta, start = ca.MX.sym("theta", self.count), ca.MX.sym("initial", self.unknowns)
        z = self._root()(start, theta)
        values, residual, margin = self.all(z, theta)
        norm = ca.norm_2(residual)  # not norm_inf, which ignores NaN
        good = ca.logic_and(norm <= _ACCEPTED, margin >= -_SLACK * self.problem.configuration.length)
        outputs: list[Any] = [ca.if_else(good, ca.vertcat(values, z), np.nan), norm]
        options: dict[str, Any] = {
            "custom_jacobian": self._jacobian(int(outputs[0].shape[0])),
            "enable_forward": False,
            "enable_reverse": False,
            "never_inline": True,
        }
        return ca.Function("solved", [theta, start], outputs, ["theta", "initial"], ["values", "norm"], options)

    def _jacobian(self, size: int) -> ca.Function:
        """The derivatives of ``solved`` by the implicit-function theorem, at the unknowns among its values.

        The rootfinder's own derivatives would solve again, and its second derivatives take a hundred times as long.
        """
        theta, start = ca.MX.sym("theta", self.count), ca.MX.sym("initial", self.unknowns)
        values, norm = ca.MX.sym("values", size), ca.MX.sym("norm")
        both = ca.MX.sym("both", self.unknowns + self.count)
        outputs, residual, _ = self.all(both[: self.unknowns], both[self.unknowns :])
        slopes = ca.Function("slopes", [both], [ca.jacobian(ca.vertcat(outputs, residual), both)])
        jacobian = slopes(ca.vertcat(values[-self.unknowns :], theta))
        rows = size - self.unknowns
        moved = -ca.solve(jacobian[rows:, : self.unknowns], jacobian[rows:, self.unknowns :])
        first = ca.vertcat(jacobian[:rows, self.unknowns :] + jacobian[:rows, : self.unknowns] @ moved, moved)
        return ca.Function(
            "jac_solved",
            [theta, start, values, norm],
            [first, ca.MX(size, self.unknowns), ca.MX(1, self.count), ca.MX(1, self.unknowns)],
            ["theta", "initial", "out_values", "out_norm"],
            ["jac_values_theta", "jac_values_initial", "jac_norm_theta", "jac_norm_initial"],
        )

    def _root(self) -> ca.Function:
        """The function ``(initial, theta) -> z``; the data are computed once and not in every iteration."""
        z, start, theta = (ca.MX.sym("z", size) for size in (self.unknowns, self.unknowns, self.count))
        columns, entry, *_ = self.discretized.data(theta)
        data = ca.MX.sym("data", columns.numel() + entry.numel())
        _, after, _ = self.discretized.sweep(
            z, data[columns.numel() :], ca.reshape(data[: columns.numel()], columns.shape)
        )
        residual = after[self.problem.functions.tip_rows, -1]
        finder = ca.rootfinder("equilibrium", "newton", {"x": z, "p": data, "g": residual}, _NEWTON)
        return ca.Function("root", [start, theta], [finder(start, ca.vertcat(ca.vec(columns), entry))])


def _size(parameter: NamedNumber) -> tuple[int, int]:
    rows, *columns = parameter.value.shape or (1,)
    return int(rows), int(columns[0]) if columns else 1


def _outputs(problem: ParametricProblem, swept: Swept) -> Any:
    """Position and rotation of the tip and positions along the robot, in one column."""
    configuration = problem.configuration
    tubes, length = configuration.tube_count, configuration.scales.length
    tip = State.split(swept.left[:, -1], tubes)
    at_tip = ca.Function("at_tip", [problem.theta], [problem.parametric.tube_at_tip])(swept.theta)
    angle = ca.dot(at_tip, tip.angles)
    outputs = [tip.position * length, ca.vec(material_frame(tip.orientation, angle))]
    if swept.weights.shape[1]:
        outputs.append(ca.vec((swept.right @ swept.weights)[State.parts(tubes)["position"], :]) * length)
    return ca.vertcat(*outputs)
