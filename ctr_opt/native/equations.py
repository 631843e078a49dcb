"""The symbolic model as routines to be written in C: rates, their derivatives by parts, point loads.

The derivative of a state's rate is applied in two sparse products, by way of the turn ``phi`` of the backbone frame and
the change of its curvature ``u_xy``: that takes a third of the operations of the plain Jacobian.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import Any

import casadi as ca

from ..layout.columns import StepColumns
from ..mechanics import boundary, law, rod
from ..mechanics.kind import Kind
from ..mechanics.law import Stiffness
from ..mechanics.so3 import rotation_matrix, turn_of
from ..mechanics.state import State, slices
from ..transcription.integrals import integral_functions
from ..transcription.second_variation import second_variation_functions
from ..transcription.shooting import shooting_functions
from .routines import Routine, product

TUBES = (*Stiffness.names(), "precurvature")  # data of the tubes alone
SHARED = (*Stiffness.names(), "unit")  # by all nodes of a step


def lanes(count: int) -> int:
    """The next multiple of what processors take side by side."""
    return 4 * ((count + 3) // 4)


class Equations:
    """The symbols of one place along the robot, and the routines made of them."""

    def __init__(self, tubes: int, kind: Kind) -> None:
        self.tubes, self.kind = tubes, kind
        self.layout = StepColumns(tubes, 1, kind)
        self.functions = shooting_functions(tubes, "RK8", kind)
        self.x = ca.SX.sym("x", State.size(tubes))
        self.state = State.split(self.x, tubes)
        self.turn, self.bent = ca.SX.sym("phi", 3), ca.SX.sym("u", 2)
        self.frame = ca.SX.sym("R", 3, 3)
        self.turned_frame = self.frame @ (ca.SX.eye(3) + ca.skew(self.turn))
        parts = {name: part.stop - part.start for name, part in self.layout.parts.items() if name != "length"}
        self.data = {name: ca.SX.sym(name, size) for name, size in parts.items() if not name.startswith("point_")}
        self.point = ca.SX.sym("point", sum(size for name, size in parts.items() if name.startswith("point_")))
        self.column = ca.vertcat(0, *self.data.values(), self.point)
        self.local = self.layout.local(self.column, 0, self.state)

    def routines(self) -> list[Routine]:
        """Rates, their derivatives, and the effect of a point load."""
        own = [self._rates(), self._slopes(), self._behind(), self._behind_slopes(), self._attitude()]
        own += [self._free(own[0]), self._free(own[1]), self._slopes_by_data("slopes_by_data", self._by_everything)]
        own += [self._free(self._slopes_by_data("slopes_by_data", self._by_tubes)), self._hamiltonian()]
        own += [_transmission(), _straightened()]
        return own if self.kind.live else [*own, *self._second_variation()]

    def products(self) -> str:
        """The sparse products that belong to the derivatives."""
        size = State.size(self.tubes)
        tubes, everything = (sum(self.data[name].numel() for name in names) for names in (TUBES, self.data))
        by_parts, by_tubes = self._by_tubes
        parts = [("along", size), ("part", 5)]
        return "".join(
            (
                product("apply_by_parts_and_data", by_parts, [("along", size), ("change", tubes)], "part"),
                product("apply_slopes_and_tubes", by_tubes, [*parts, ("change", tubes)], "out"),
                product("apply_slopes_and_data", self._by_everything[1], [*parts, ("change", everything)], "out"),
                product("apply_by_parts", self._by_parts, [("along", size)], "part"),
                product("apply_slopes", self._outer, [("along", size), ("part", 5)], "out"),
                product("apply_turn", self._turn_rows, [("along", size)], "part"),
                product("apply_behind", self._behind_outer, [("along", size), ("part", 3)], "out"),
            )
        )

    def _point_parts(self) -> dict[str, slice]:
        """Where the parts of a point load stand in its data."""
        parts = self.layout.parts.items()
        return slices({name: part.stop - part.start for name, part in parts if name.startswith("point_")})

    def _inputs(self) -> dict[str, Any]:
        return {"x": self.x} | {f"data[{i}]": symbol for i, symbol in enumerate(self.data.values())}

    @cached_property
    def _rate(self) -> ca.SX:
        rate: ca.SX = rod.rates(self.state, self.local).joined()
        return rate

    def _rates(self) -> Routine:
        return Routine("rates", self._inputs(), {"rate": self._rate})

    def _slopes(self) -> Routine:
        outputs = {"rate": self._rate}
        outputs |= {"inner": _nonzeros(self._by_parts), "outer": _nonzeros(self._outer)}
        return Routine("slopes", self._inputs(), outputs)

    def _free(self, routine: Routine) -> Routine:
        """The same where no load acts along the step."""
        loads = [self.data[name] for name in self.data if name not in TUBES]
        zeros = [ca.SX.zeros(*load.shape) for load in loads]
        values = ca.substitute(list(routine.outputs.values()), loads, zeros)
        outputs = dict(zip(routine.outputs, values, strict=True))
        return Routine(f"free_{routine.name}", routine.inputs, outputs)

    @cached_property
    def _turn_rows(self) -> ca.SX:
        rows = ca.SX(3, State.size(self.tubes))
        rows[:, State.parts(self.tubes)["orientation"]] = turn_of(self.state.orientation)
        return rows

    @cached_property
    def _by_parts(self) -> ca.SX:
        """``(phi, du)`` of a change of the state."""
        bent, _ = rod.curvature(self.state, self.local)
        return ca.vertcat(self._turn_rows, ca.jacobian(bent, self.x))

    @cached_property
    def _outer(self) -> ca.SX:
        """Change of the rate with the state itself, ``phi`` and ``u``."""
        rate = rod.rates_at(self.state, self.local, self.turned_frame, self.bent).joined()
        bent, _ = rod.curvature(self.state, self.local)
        matrix = ca.jacobian(rate, ca.vertcat(self.x, self.turn, self.bent))
        return self._there(ca.substitute(matrix, self.bent, bent))

    def _there(self, matrix: ca.SX) -> ca.SX:
        """A derivative by parts at the state itself."""
        frame = rotation_matrix(self.state.orientation)
        symbols = ca.vertcat(self.turn, ca.vec(self.frame))
        return ca.sparsify(ca.substitute(matrix, symbols, ca.vertcat(ca.SX.zeros(3), ca.vec(frame))))

    def _by_data(self, names: Sequence[str]) -> tuple[ca.SX, ca.SX]:
        """``_by_parts`` and ``_outer`` with columns behind them for changes of the data themselves."""
        data = ca.vertcat(*(self.data[name] for name in names))
        bent, _ = rod.curvature(self.state, self.local)
        rate = rod.rates_at(self.state, self.local, self.turned_frame, self.bent).joined()
        turned = ca.vertcat(ca.SX(3, data.numel()), ca.jacobian(bent, data))
        direct = self._there(ca.substitute(ca.jacobian(rate, data), self.bent, bent))
        return ca.horzcat(self._by_parts, turned), ca.horzcat(self._outer, direct)

    @cached_property
    def _by_tubes(self) -> tuple[ca.SX, ca.SX]:
        return self._by_data(TUBES)

    @cached_property
    def _by_everything(self) -> tuple[ca.SX, ca.SX]:
        """The columns of the loads come last: without them, the first nonzeros are those of ``_by_tubes``."""
        return self._by_data(list(self.data))

    def _slopes_by_data(self, name: str, matrices: tuple[ca.SX, ca.SX]) -> Routine:
        outputs = {"rate": self._rate, "inner": _nonzeros(self._by_tubes[0]), "outer": _nonzeros(matrices[1])}
        return Routine(name, self._inputs(), outputs)

    def _behind(self) -> Routine:
        load = self.layout.point_load(self.column, self.state)
        return Routine("behind", {"x": self.x, "point": self.point}, {"y": boundary.jump(self.state, *load).joined()})

    @cached_property
    def _behind_outer(self) -> ca.SX:
        load = self.layout.point_load(self.column, self.state)
        after = boundary.jump_at(self.state, *load, self.turned_frame).joined()
        return self._there(ca.jacobian(after, ca.vertcat(self.x, self.turn)))

    def _behind_slopes(self) -> Routine:
        outputs = {"inner": _nonzeros(self._turn_rows), "outer": _nonzeros(self._behind_outer)}
        return Routine("behind_slopes", {"x": self.x, "point": self.point}, outputs)

    def _attitude(self) -> Routine:
        """The backbone frame, row by row, and what makes a turn of a change of the state."""
        frame = rotation_matrix(self.state.orientation).T
        return Routine("attitude", {"x": self.x}, {"frame": frame, "inner": _nonzeros(self._turn_rows)})

    def _hamiltonian(self) -> Routine:
        """The Hamiltonian and its derivatives by state and data."""
        value = integral_functions(self.tubes, "RK8", self.kind).hamiltonian(self.x, self.column)
        outputs = {"value": value, "by_state": ca.gradient(value, self.x)}
        outputs["by_data"] = ca.gradient(value, ca.vertcat(*self.data.values()))
        return Routine("hamiltonian", self._inputs(), outputs)

    def _second_variation(self) -> list[Routine]:
        """The parts of the count of negative directions; directions stand row by row, other matrices by columns."""
        functions = second_variation_functions(self.tubes, "RK8", self.kind)
        count, width = 2 * functions.size, lanes(2 * functions.size)
        rows = functions.directions(self.x)[:, 1:].T
        along = ca.SX.sym("along", width, State.size(self.tubes))
        column = ca.SX.sym("column", self.functions.columns.size)
        transfer, _, flexibility, doubtful, defect = functions.told(ca.horzcat(self.x, along[:count, :].T), column)
        told = {"transfer": transfer, "flexibility": flexibility, "doubtful": doubtful, "defect": defect}
        n = functions.size
        w, t, f = ca.SX.sym("W", n, n), ca.SX.sym("T", 2 * n, 2 * n), ca.SX.sym("flexibility", n)
        shift, compliance = ca.SX.sym("shift"), ca.SX.sym("compliance", self.tubes)
        before, negative, lost = functions.eliminate(w, t, ca.SX(0, 0), f, shift)
        inputs = {"W": w, "transfer": t, "flexibility": f, "shift": shift}
        at_entry = functions.entry(w, compliance, shift)
        return [
            Routine(
                "directions", {"x": self.x}, {"along": ca.vertcat(rows, ca.SX.zeros(width - count, rows.shape[1]))}
            ),
            Routine("told", {"x": self.x, "along": along, "column": column}, told),
            Routine("eliminate", inputs, {"before": before, "negative": negative, "lost": lost}),
            Routine("entry", {"W": w, "compliance": compliance, "shift": shift}, {"negative": at_entry}),
        ]

    def sizes(self) -> dict[str, int]:
        """Sizes by their names in C, and where the parts of a state and of the data begin."""
        tubes, size = self.tubes, {name: symbol.numel() for name, symbol in self.data.items()}
        shared = sum(size[name] for name in SHARED if name in size)
        data = sum(size.values())
        names = {
            **{"TUBES": tubes, "NX": State.size(tubes), "NZ": len(boundary.tip_rows(tubes, self.kind.live))},
            **{"LANES": lanes(tubes), "MOST_UNKNOWNS": State.size(tubes)},
            **{
                "STIFFNESSES": len(Stiffness.names()),
                "DATA_STIFFNESS": 0,
                "PARTS": len(size),
                "DATA": data,
                "SHARED": shared,
                "AT_NODES": data - shared,
            },
            **{"POINT": self.point.numel(), "INNER": self._by_parts.nnz(), "OUTER": self._outer.nnz()},
            **{"INNER_BY_DATA": self._by_tubes[0].nnz(), "OUTER_BY_TUBES": self._by_tubes[1].nnz()},
            **{"OUTER_BY_DATA": self._by_everything[1].nnz()},
            **{"BEHIND_INNER": self._turn_rows.nnz(), "BEHIND_OUTER": self._behind_outer.nnz()},
        }
        names |= {f"AT_{name.upper()}": part.start for name, part in State.parts(tubes).items()}
        names |= {f"{name.upper()}": part.start for name, part in self._point_parts().items()}
        names |= {name.upper(): k for k, name in enumerate(Stiffness.names())}
        names |= {f"PART_{name.upper()}": k for k, name in enumerate(size)}
        return names | {f"DATA_{name.upper()}": part.start for name, part in slices(size).items()}


def _stiffness() -> tuple[ca.SX, Stiffness]:
    """The stiffnesses of one tube as symbols."""
    symbols = ca.SX.sym("stiffness", len(Stiffness.names()))
    return symbols, Stiffness(*ca.vertsplit(symbols))


def _transmission() -> Routine:
    """The compliance of a transmission, SI, and its derivatives."""
    length, (symbols, stiffness) = ca.SX.sym("length"), _stiffness()
    value = law.transmission_compliance(length, stiffness)
    outputs = {"value": value, "by_length": ca.gradient(value, length), "by_stiffness": ca.gradient(value, symbols)}
    return Routine("transmission", {"length": length, "stiffness": symbols}, outputs)


def _straightened() -> Routine:
    """The Hamiltonian of a tube alone that is held straight, SI, and its derivatives."""
    torque, preset, (symbols, stiffness) = ca.SX.sym("torque"), ca.SX.sym("preset", 3), _stiffness()
    value = law.straight_hamiltonian(torque, preset, stiffness)
    given = {"torque": torque, "preset": preset, "stiffness": symbols}
    slopes = {f"by_{name}": ca.gradient(value, symbol) for name, symbol in given.items()}
    return Routine("straightened", given, {"value": value, **slopes})


def _nonzeros(matrix: ca.SX) -> Any:
    return ca.densify(matrix.nz[:])
