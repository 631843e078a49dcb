"""The negative directions of the potential energy's second variation, counted from the free tip to the entry point.

At an arc length the configuration varies by ``q = (phi_x, phi_y, psi_i + phi_z)``, where ``phi`` turns the backbone
frame (seen from it), and by the position if loads depend on it. Variations of a stationary shape obey the linearized
equations. Over each step these are a linear, symplectic map ``T`` of ``q`` and its momenta, the moments (and the
force).

The part behind a place answers a variation there with the momenta ``-W q``; ``W = 0`` behind the tip. A step held at
its beginning has the compliance ``F``. The number of negative directions at the step's end is then the number of
negative eigenvalues of ``1 + F W``, and ``T`` carries ``W`` to the step's beginning. The sum over all steps and the
transmissions counts the negative directions of the whole with multiplicity, because the inertia of a symmetric matrix
is that of its pivots (Sylvester, Haynsworth). No step is integrated against its growth.
"""

from __future__ import annotations

from typing import Any

import casadi as ca

from ..mechanics.kind import Kind, built_once, shared_by_kind
from ..mechanics.law import Stiffness
from ..mechanics.so3 import turn_of, turning
from ..mechanics.state import State
from .shooting import shooting_functions
from .small_matrices import Ldl, quarters, root_of, solved, symplectic_defect

_REGULAR = 0.3  # of its elastic part must remain of a step's compliance, or the step may hide a conjugate point


class SecondVariationFunctions:
    """The CasADi functions for a number of tubes, an integrator and a kind of loads, all of them with a potential.

    ``transfer (x, column) -> (T, H, flexibility, doubtful, defect)``: a step from a state, the Hessian ``H`` of the
    potential of the point load at its end, whether it may hide something, and how far ``T`` is from symplectic;
    ``eliminate (W behind, T, H, flexibility, shift) -> (W before, negative, lost)``, ``lost`` where it hides something;
    ``entry (W, compliance, shift) -> negative``. The elastic part is divided by ``1 + shift``.
    """

    def __init__(self, tubes: int, integrator: str, kind: Kind) -> None:
        self.tubes = tubes
        self.shooting = shooting_functions(tubes, integrator, kind)
        self.bent = 2 + tubes  # entries of q with an elastic stiffness; a position has none
        self.positions = 3 if kind.live else 0
        self.size = self.bent + self.positions
        self.directions, self.step_results = self._directions_at(), self._step_results()
        self.transfer = self._transfer()
        self.eliminate = self._eliminate()
        self.entry = self._entry()

    @built_once
    def count(self, steps: int) -> ca.Function:
        """The function ``(states, columns, compliance, least) -> (negative, not_positive, doubtful, margin)``.

        How many eigenvalues of (second variation, elastic part) are below ``-margin`` and below ``margin``, which is
        ``least`` or the largest defect of a step; ``doubtful (1, steps)`` is not zero where a step must be cut.
        """
        states = ca.MX.sym("states", State.size(self.tubes), steps)
        columns = ca.MX.sym("columns", self.shooting.columns.size, steps)
        compliance, least = ca.MX.sym("compliance", self.tubes), ca.MX.sym("least")
        *data, doubtful, defect = self.transfer.map(steps)(states, columns)
        margin = ca.fmax(least, ca.mmax(defect))
        data = [_backward(matrices, steps) for matrices in data]
        eliminate, counts = self.eliminate.mapaccum("eliminate_all", steps), []
        for shift in (-margin, margin):
            w, negative, lost = eliminate(ca.MX(self.size, self.size), *data, ca.repmat(shift, 1, steps))
            counts.append(ca.sum2(negative) + self.entry(w[:, -self.size :], compliance, shift))
            doubtful += _backward(lost, steps)
        inputs, names = [states, columns, compliance, least], ["states", "columns", "compliance", "least"]
        outputs = ["negative", "not_positive", "doubtful", "margin"]
        return ca.Function("second_variation", inputs, [*counts, doubtful, margin], names, outputs)

    # -- symplectic coordinates ------------------------------------------------------------------------------------

    def _directions(self, x: Any) -> Any:
        """The directions in state space ``(size, 2 N)`` of unit ``q`` and unit momenta; gauge: ``phi_z = 0``."""
        n, parts, state = self.tubes, State.parts(self.tubes), State.split(x, self.tubes)
        directions = ca.SX(State.size(n), 2 * self.size)
        directions[parts["orientation"], :2] = turning(state.orientation)[:, :2]
        directions[parts["bending"], :2] = -_half_axial(state)
        directions[parts["angles"], 2 : self.bent] = ca.SX.eye(n)
        momenta = self.size
        directions[parts["bending"], momenta : momenta + 2] = ca.SX.eye(2)
        directions[parts["torsion"], momenta + 2 : momenta + self.bent] = ca.SX.eye(n)
        if self.positions:
            directions[parts["position"], self.bent : self.size] = ca.SX.eye(3)
            directions[parts["force"], momenta + self.bent :] = ca.SX.eye(3)
        return directions

    def _coordinates(self, x: Any, directions: Any) -> Any:
        """The coordinates ``q`` and momenta of directions in state space at ``x``.

        ``m_xy`` is seen from the turning frame: its momentum is ``dm_xy + (phi x m)_xy``, except for half the part of
        ``m_z``, which makes the pair symmetric.
        """
        parts, state = State.parts(self.tubes), State.split(x, self.tubes)
        changes = State.split(directions, self.tubes)
        phi = turn_of(state.orientation) @ changes.orientation
        seen = ca.mtimes(ca.vertcat(-state.bending[1], state.bending[0]), phi[2, :])
        bending = changes.bending + seen + ca.mtimes(_half_axial(state), phi[:2, :])
        q = [phi[:2, :], changes.angles + ca.repmat(phi[2, :], self.tubes, 1)]
        momenta = [bending, changes.torsion]
        if self.positions:
            q.append(directions[parts["position"], :])
            momenta.append(directions[parts["force"], :])
        return ca.vertcat(*q, *momenta)

    # -- functions -------------------------------------------------------------------------------------------------

    def _transfer(self) -> ca.Function:
        """The function ``transfer``, in MX: calls of SX functions cost less than another copy of the step."""
        x, column = ca.MX.sym("x", State.size(self.tubes)), ca.MX.sym("column", self.shooting.columns.size)
        step = self.shooting.linear_step(2 * self.size)
        names = ["T", "H", "flexibility", "doubtful", "defect"]
        results = self.step_results.call([step(self.directions(x), column), column])
        return ca.Function("transfer", [x, column], results, ["x", "column"], names)

    def _directions_at(self) -> ca.Function:
        """A function from a state to the state and the directions to follow over a step."""
        state = ca.SX.sym("x", State.size(self.tubes))
        return ca.Function("directions", [state], [ca.densify(ca.horzcat(state, self._directions(state)))])

    def _step_results(self) -> ca.Function:
        """A function from the state and directions at the end of a step, and its column, to the step's results."""
        n, layout, size = self.size, self.shooting.columns, State.size(self.tubes)
        state, data, moved = ca.SX.sym("x", size), ca.SX.sym("column", layout.size), ca.SX.sym("moved", size, 2 * n)
        transfer = self._coordinates(state, moved)
        hessian = ca.SX(self.positions, self.positions)
        if self.positions:
            force, _ = layout.point_load(data, State.split(state, self.tubes))
            hessian = -ca.jacobian(force, state[State.parts(self.tubes)["position"]])
            transfer[n + self.bent :, :] -= hessian @ transfer[self.bent : n, :]  # up to the load
        flexible = self._flexibility(data)
        unit = ca.sqrt(ca.if_else(data[0] == 0, 1, flexible))
        dimensionless = _sized(transfer, unit)
        _, b, _, d = (block[: self.bent, : self.bent] for block in quarters(dimensionless))
        bends = Stiffness.of(lambda name: data[layout.parts[name]]).bends()  # where not, only its torsion resists
        counts = ca.vertcat(ca.SX.ones(2), ca.if_else(bends, 1, 0))
        doubtful = ca.if_else(data[0] == 0, 0, _irregular(b, counts) + _irregular(d, counts))
        results = [ca.densify(transfer), ca.densify(hessian), flexible, doubtful, symplectic_defect(dimensionless)]
        return ca.Function("step_results", [ca.horzcat(state, moved), data], results)

    def _flexibility(self, column: Any) -> Any:
        """Motion of the step's end under unit momenta there: ``h / K``, and ``h^3 / K`` for a position."""
        parts, length = self.shooting.columns.parts, column[0]
        stiffness = ca.vertcat(*Stiffness.of(lambda name: column[parts[name]]).resistance())
        return ca.vertcat(length / stiffness, ca.repmat(length**3 / stiffness[0], self.positions, 1))

    def _eliminate(self) -> ca.Function:
        n, bent = self.size, self.bent
        behind, transfer = ca.SX.sym("W", n, n), ca.SX.sym("T", 2 * n, 2 * n)
        hessian, shift = ca.SX.sym("H", self.positions, self.positions), ca.SX.sym("shift")
        flexible = ca.SX.sym("flexibility", n)
        w = behind + 0.0
        w[bent:, bent:] += hessian
        softness = ca.vertcat(shift / 2 * flexible[:bent], ca.SX.zeros(self.positions))
        a, b, c, d = quarters(_between(softness, transfer))
        compliance = solved(d.T, b.T)  # F = b d^-1, symmetric
        root, lost = root_of(0.5 * (compliance + compliance.T), flexible)
        answer = Ldl.of(ca.SX.eye(n) + root.T @ w @ root)
        moved = c + w @ a
        before = solved(d, moved - w @ root @ answer.solve(root.T @ moved))  # d^-1 (1 + W F)^-1 (c + W a)
        inputs = [behind, transfer, hessian, flexible, shift]
        results = [0.5 * (before + before.T), answer.negative, lost]
        names = ["W", "T", "H", "flexibility", "shift"]
        return ca.Function("eliminate", inputs, results, names, ["before", "negative", "lost"], {"cse": True})

    def _entry(self) -> ca.Function:
        w, compliance = ca.SX.sym("W", self.size, self.size), ca.SX.sym("compliance", self.tubes)
        shift = ca.SX.sym("shift")
        root = ca.diag(ca.sqrt(compliance * (1 + shift)))
        negative = Ldl.of(ca.SX.eye(self.tubes) + root @ w[2 : self.bent, 2 : self.bent] @ root).negative
        return ca.Function("entry", [w, compliance, shift], [negative], ["W", "compliance", "shift"], ["negative"])


second_variation_functions = shared_by_kind(SecondVariationFunctions, most=24)
"""The functions for ``(tubes, integrator, kind)``, shared by all problems."""


def _backward(beside: Any, steps: int) -> Any:
    """The matrices of the steps, side by side, in reverse order."""
    width = beside.shape[1] // steps
    return ca.horzcat(*ca.horzsplit(beside, width)[::-1]) if width else beside


def _half_axial(state: State[Any]) -> Any:
    """The product ``(phi x m_z / 2)_xy`` as a matrix on ``phi_xy``."""
    return 0.5 * ca.sum1(state.torsion) * ca.DM([[0, 1], [-1, 0]])


def _between(softness: Any, transfer: Any) -> Any:
    """The step with compliances before and behind it."""
    n = softness.shape[0]
    shear = ca.SX.eye(2 * n)
    shear[:n, n:] = ca.diag(softness)
    return shear @ transfer @ shear


def _sized(transfer: Any, unit: Any) -> Any:
    """The transfer matrix of coordinates over their ``unit`` and momenta over its inverse."""
    units = ca.vertcat(unit, 1 / unit)
    return transfer * ((1 / units) @ units.T)


def _irregular(block: Any, counts: Any) -> Any:
    """Number of counted directions in which the symmetric part of a dimensionless block is too small."""
    symmetric = 0.5 * (block + block.T) * (counts @ counts.T) + ca.diag(1 - counts)
    return Ldl.of(symmetric - _REGULAR * ca.SX.eye(block.shape[0])).negative
