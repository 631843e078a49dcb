"""Derivatives of a solved equilibrium by the implicit-function theorem: exact, from CasADi, in its virtual machine.

The equilibrium satisfies ``r(z, theta) = 0``, so an output ``o(z, theta)`` has the derivative
``o_theta - o_z r_z^-1 r_theta``. Its second derivatives along the solutions are those of ``o - lambda . r`` with
``lambda = o_z r_z^-1``.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import attrs
import casadi as ca
import numpy as np

from ..checks import Array
from ..errors import DefinitionError, SolveError
from ..layout.configuration import Configuration
from ..layout.observables import Observable, posed
from ..robot.names import NamedNumber
from ..transcription.closure import NEGLIGIBLE
from ..transcription.observing import Observer
from ..transcription.parametric_problem import ParametricProblem, at_nominal
from ..transcription.shooting import Shooting
from .outputs import from_left


@attrs.frozen(eq=False)
class Solved:
    """An equilibrium in numbers: configuration, dimensionless unknowns, mesh and integrator."""

    configuration: Configuration
    z: Array
    mesh: Array
    integrator: str

    @property
    def steps(self) -> int:
        """The largest number of steps in any section between break points."""
        sections = np.searchsorted(self.configuration.break_points, self.mesh[:, 0], side="right")
        return int(np.bincount(sections).max())

    @property
    def shooting(self) -> Shooting:
        """The boundary-value problem that the equilibrium solves."""
        return Shooting(self.configuration, self.mesh, self.integrator)

    def under(self, configuration: Configuration) -> Solved:
        """The equilibrium as one of a configuration that differs only by loads of zero."""
        return attrs.evolve(self, configuration=configuration)


@attrs.frozen(eq=False)
class Derivatives:
    """The value of an output, its first and second derivatives, and the first derivatives of the unknowns."""

    value: Array
    first: Array
    unknowns: Array
    second: Array | None = None


def derivatives(
    solved: Solved,
    wanted: Observable,
    chosen: Sequence[NamedNumber],
    *,
    side: int = 1,
    order: int = 1,
    at: int | None = None,
) -> Derivatives:
    """Derivatives of an output by the chosen parameters, from their ``side``.

    If the value itself is one-sided, it is taken from the side of the parameter ``at``.
    """
    problem = _problem(solved, chosen, wanted)
    count = len(problem.nominal)
    groups: dict[tuple[Any, ...], list[int]] = {}
    for k in range(count) if at is None else [at]:
        sign = _sign(problem, k, side)
        groups.setdefault((problem.keys(k, sign), _carrier(problem, wanted, k, sign)), []).append(k)
    if order == 2 and len(groups) > 1:
        raise DefinitionError(
            "order = 2: break points coincide and a parameter moves them apart; the first derivatives jump there and "
            "second derivatives do not exist: move an actuation or a load by a small amount"
        )
    regions = [
        (_Region(solved, problem, attrs.evolve(wanted, frame=tube), keys, order), columns)
        for (keys, tube), columns in groups.items()
    ]
    value = regions[0][0]
    first, unknowns = np.full((len(value.first), count), np.nan), np.full((len(solved.z), count), np.nan)
    for region, columns in regions:
        first[:, columns], unknowns[:, columns] = region.first[:, columns], region.unknowns[:, columns]
    return Derivatives(value.value, first, unknowns, value.second)


def kinked(solved: Solved, chosen: Sequence[NamedNumber]) -> list[int]:
    """Indices of the chosen parameters that can move coinciding break points apart in both directions."""
    problem = _problem(solved, chosen, Observable("pose"))
    return [k for k in range(len(problem.nominal)) if problem.kinked(k) and _sign(problem, k, 1) > 0.0]


def _problem(solved: Solved, chosen: Sequence[NamedNumber], wanted: Observable) -> ParametricProblem:
    configuration = solved.configuration
    left = from_left(wanted, configuration)
    probes = ((wanted.place, wanted.tube),) if isinstance(wanted.place, float) else ()
    retreating = wanted.name == "pose" and wanted.tube is None  # then the pose is that of a tube that stays
    return ParametricProblem(configuration, chosen, solved.integrator, probes, from_left=left, retreating=retreating)


def _carrier(problem: ParametricProblem, wanted: Observable, column: int, sign: float) -> int | None:
    """The tube whose frame is the pose when a parameter grows (``sign = 1``) or shrinks a little."""
    if wanted.name != "pose" or wanted.tube is not None:
        return wanted.tube
    return problem.innermost(wanted.place if isinstance(wanted.place, float) else None, column, sign)


def _sign(problem: ParametricProblem, column: int, side: int) -> float:
    """The side from which a derivative is taken; a base at the entry point can only be drawn back."""
    part = problem.parts.get("translations")
    at_bound = (
        part is not None
        and part.start <= column < part.stop
        and problem.nominal[column] >= -problem.configuration.ends.slack
    )
    return -1.0 if at_bound else float(side)


class _Region:
    """Derivatives for one order of the break points."""

    def __init__(
        self, solved: Solved, problem: ParametricProblem, wanted: Observable, keys: tuple[Any, ...], order: int
    ) -> None:
        observer = Observer([wanted], problem, problem.given(keys), at_nominal(problem, keys, solved.mesh))
        unknowns = len(solved.z)
        both = ca.MX.sym("both", unknowns + len(problem.nominal))
        swept = observer.discretized.swept(both[:unknowns], both[unknowns:])
        (out,) = observer.values(swept)
        everything = ca.vertcat(out, swept.residual)
        at = np.concatenate((solved.z, problem.nominal))
        count = out.shape[0]
        value, jacobian = (
            part.full() for part in ca.Function("first", [both], [out, ca.jacobian(everything, both)])(at)
        )
        value = value[:, 0]
        inverse = _inverse(jacobian[count:, :unknowns])
        self.unknowns = -inverse @ jacobian[count:, unknowns:]
        along = np.vstack((self.unknowns, np.eye(len(problem.nominal))))
        rates = np.eye(len(value))
        if wanted.name == "pose":
            rates = posed(value[None], rates[None]).slopes[0]
        self.value = value
        self.first = rates @ jacobian[:count] @ along
        self.second = None
        if order == 2:
            multipliers = rates @ jacobian[:count, :unknowns] @ inverse
            weights = ca.MX.sym("weights", everything.shape[0])
            hessian = ca.Function("second", [both, weights], [ca.hessian(ca.dot(weights, everything), both)[0]])
            rows = np.hstack((rates, -multipliers))
            self.second = np.array([along.T @ hessian(at, row).full() @ along for row in rows])


def _inverse(jacobian: Array) -> Array:
    """The inverse ``r_z^-1``; raises ``SolveError`` if the equilibrium is singular."""
    values = np.linalg.svd(jacobian, compute_uv=False)
    if values[-1] <= NEGLIGIBLE:
        raise SolveError(
            f"the equilibrium is singular (smallest singular value {values[-1]:.2g} of the shooting Jacobian): "
            "it is at a fold or belongs to a family of equilibria, and has no derivatives"
        )
    return np.asarray(np.linalg.inv(jacobian))
