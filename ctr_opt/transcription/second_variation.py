"""The second variation of the potential energy, counted from the free tip to the entry point.

At an arc length the configuration varies by ``q = (phi_x, phi_y, psi_i + phi_z)``, ``phi`` turning the backbone frame
(seen from it), and by the position where loads depend on it. Variations of the stationary shape obey the linearized
equations, a linear map ``T`` over each step of ``q`` and its momenta, the moments. Held at its beginning and bent by
momenta at its end, a step has the compliance ``F``, and what lies behind answers a variation ``q`` with ``-W q``. Then
the second variation has as many negative directions there as ``1 + F W`` has negative eigenvalues, ``W`` is carried over
the step, and the sum over all steps and the transmissions is the number of negative directions of the whole
(Haynsworth's additivity of inertia): every multiplicity is counted, and nothing is integrated against its growth.
"""

from __future__ import annotations

from typing import Any

import casadi as ca

from ..mechanics.loading import LoadKind
from ..mechanics.so3 import quaternion_rate
from ..mechanics.state import State
from .sharing import shared_by_kind
from .shooting import shooting_functions
from .small_matrices import Ldl, quarters, root_of, solved, symplectic_defect

_REGULAR = 0.3  # of its elastic part: what a step's compliance must keep, or it may hide a conjugate point of its own


class SecondVariationFunctions:
    """The CasADi functions for a number of tubes, an integrator and a kind of loads, all of them with a potential.

    ``transfer (state, column) -> (T, H, stiffness, length)`` of a step, with the potential's Hessian ``H`` at its end;
    ``eliminate (W behind, T, H, stiffness, length, shift) -> (W before, negative, doubtful, defect)``;
    ``entry (W, compliance, shift) -> negative``. The elastic part is multiplied by ``1 - shift``.
    """

    def __init__(self, tubes: int, integrator: str, kind: LoadKind) -> None:
        self.tubes = tubes
        self.shooting = shooting_functions(tubes, integrator, kind)
        self.bent = 2 + tubes  # entries of q with an elastic stiffness; a position has none
        self.positions = 3 if kind.live else 0
        self.size = self.bent + self.positions
        self.transfer = self._transfer()
        self.eliminate = self._eliminate()
        self.entry = self._entry()
        self._maps: dict[int, tuple[ca.Function, ca.Function]] = {}

    def maps(self, count: int) -> tuple[ca.Function, ca.Function]:
        """``transfer`` and ``eliminate`` over so many steps, the latter from the last one back."""
        if count not in self._maps:
            backward = self.eliminate.mapaccum("second_variation", count)
            self._maps[count] = self.transfer.map(count), backward
        return self._maps[count]

    # -- symplectic coordinates ------------------------------------------------------------------------------------

    def _directions(self, x: Any) -> Any:
        """The directions in state space ``(size, 2 N)`` of unit ``q`` and unit momenta; gauge: ``phi_z = 0``."""
        n, parts, state = self.tubes, State.parts(self.tubes), State.split(x, self.tubes)
        directions = ca.SX(State.size(n), 2 * self.size)
        directions[parts["orientation"], :2] = _turning(state.orientation)[:, :2]
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
        """``q`` and momenta of directions in state space at ``x``.

        ``m_xy`` is seen from the frame that turns: its momentum is ``dm_xy + (phi x m)_xy``, but for half the part of
        ``m_z``, which makes the pair symmetric.
        """
        parts, state = State.parts(self.tubes), State.split(x, self.tubes)
        own = State.split(directions, self.tubes)
        turning = _turning(state.orientation)
        phi = 4.0 / ca.sumsqr(state.orientation) * ca.mtimes(turning.T, own.orientation)
        seen = ca.mtimes(ca.vertcat(-state.bending[1], state.bending[0]), phi[2, :])
        bending = own.bending + seen + ca.mtimes(_half_axial(state), phi[:2, :])
        q = [phi[:2, :], own.angles + ca.repmat(phi[2, :], self.tubes, 1)]
        momenta = [bending, own.torsion]
        if self.positions:
            q.append(directions[parts["position"], :])
            momenta.append(directions[parts["force"], :])
        return ca.vertcat(*q, *momenta)

    # -- functions -------------------------------------------------------------------------------------------------

    def _transfer(self) -> ca.Function:
        layout, n = self.shooting.columns, self.size
        x, column = ca.SX.sym("x", State.size(self.tubes)), ca.SX.sym("column", layout.size)
        step = self.shooting._linear_step(2 * n)
        both = step(ca.horzcat(x, self._directions(x)), column)
        after = both[:, 0]
        transfer = self._coordinates(after, both[:, 1:])
        parts = layout.parts
        bending = ca.sum1(column[parts["bending_stiffness"]])
        stiffness = ca.vertcat(bending, bending, column[parts["torsional_stiffness"]])
        hessian = ca.SX(self.positions, self.positions)
        if self.positions:
            state = ca.SX.sym("state", State.size(self.tubes))
            force, _ = layout.point_load(column, State.split(state, self.tubes))
            hessian = -ca.jacobian(force, state[State.parts(self.tubes)["position"]])
            hessian = ca.densify(ca.substitute(hessian, state, after))
            transfer[n + self.bent :, :] -= ca.mtimes(hessian, transfer[self.bent : n, :])  # up to the load
        names = ["transfer", "hessian", "stiffness", "length"]
        results = [ca.densify(transfer), hessian, stiffness, column[0]]
        return ca.Function("transfer", [x, column], results, ["x", "column"], names, {"cse": True})

    def _eliminate(self) -> ca.Function:
        n, bent = self.size, self.bent
        behind, transfer = ca.SX.sym("W", n, n), ca.SX.sym("T", 2 * n, 2 * n)
        hessian = ca.SX.sym("H", self.positions, self.positions)
        stiffness, length, shift = ca.SX.sym("K", bent), ca.SX.sym("h"), ca.SX.sym("shift")
        idle = length == 0
        elastic = ca.if_else(idle, 1, length) / stiffness
        size = ca.vertcat(elastic, ca.repmat(elastic[0] * ca.if_else(idle, 1, length**2), self.positions, 1))
        w = behind + 0.0
        w[bent:, bent:] += hessian
        softness = ca.diag(ca.vertcat(shift / 2 * elastic, ca.SX.zeros(self.positions)))
        a, b, c, d = quarters(_between(softness, transfer))
        compliance = solved(d.T, b.T)  # F = b d^-1, symmetric
        root, doubtful = root_of(0.5 * (compliance + compliance.T), size)
        answer = Ldl.of(ca.SX.eye(n) + root.T @ w @ root)
        moved = c + w @ a
        before = solved(d, moved - w @ root @ answer.solve(root.T @ moved))  # d^-1 (1 + W F)^-1 (c + W a)
        unit = ca.sqrt(size)
        for block, rows in ((b, unit), (d, 1 / unit)):
            doubtful += _irregular((block / (rows @ unit.T))[:bent, :bent])
        scale = ca.vertcat(unit, 1 / unit)
        defect = symplectic_defect(transfer / (scale @ (1 / scale).T))
        given = [behind, transfer, hessian, stiffness, length, shift]
        results = [0.5 * (before + before.T), answer.negative, ca.if_else(idle, 0, doubtful), defect]
        names = ["W", "T", "H", "stiffness", "length", "shift"], ["before", "negative", "doubtful", "defect"]
        return ca.Function("eliminate", given, results, *names, {"cse": True})

    def _entry(self) -> ca.Function:
        w, compliance = ca.SX.sym("W", self.size, self.size), ca.SX.sym("compliance", self.tubes)
        shift = ca.SX.sym("shift")
        root = ca.diag(ca.sqrt(compliance * (1 + shift)))
        negative = Ldl.of(ca.SX.eye(self.tubes) + root @ w[2 : self.bent, 2 : self.bent] @ root).negative
        return ca.Function("entry", [w, compliance, shift], [negative], ["W", "compliance", "shift"], ["negative"])


_functions = shared_by_kind(SecondVariationFunctions, most=24)


def second_variation_functions(tubes: int, integrator: str, kind: LoadKind) -> SecondVariationFunctions:
    """The functions, shared by every problem with as many tubes and the same kind of loads."""
    return _functions(tubes, integrator, kind)



def _turning(orientation: Any) -> Any:
    """The change of a quaternion by unit turns about its own axes, 4 x 3."""
    return ca.horzcat(*(quaternion_rate(orientation, ca.SX(ca.DM.eye(3)[:, k])) for k in range(3)))


def _half_axial(state: State[Any]) -> Any:
    """``(phi x m_z / 2)_xy`` as a matrix on ``phi_xy``."""
    return 0.5 * ca.sum1(state.torsion) * ca.DM([[0, 1], [-1, 0]])


def _between(softness: Any, transfer: Any) -> Any:
    """The step with a compliance before and one behind it."""
    n = softness.shape[0]
    shear = ca.SX.eye(2 * n)
    shear[:n, n:] = softness
    return shear @ transfer @ shear


def _irregular(block: Any) -> Any:
    """In how many directions the symmetric part of a dimensionless block is less than it must be."""
    return Ldl.of(0.5 * (block + block.T) - _REGULAR * ca.SX.eye(block.shape[0])).negative
