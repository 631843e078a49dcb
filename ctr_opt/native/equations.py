"""The symbolic model as routines to be written in C: rates, their derivatives by parts, point loads.

The derivative of a state's rate is applied in two sparse products. The intermediate quantities are the turn ``phi`` of
the backbone frame and the change of its curvature ``u_xy``. That takes a third of the operations of the plain Jacobian.
"""

from __future__ import annotations

from collections.abc import Iterable
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
from .routines import Routine, product

TUBES = (*Stiffness.names(), "precurvature")  # data of the tubes alone


def lanes(count: int) -> int:
    """The count rounded up to a multiple of four, which processors handle side by side."""
    return 4 * ((count + 3) // 4)


class Equations:
    """The symbols of one place along the robot, and the routines made from them."""

    def __init__(self, tubes: int, kind: Kind) -> None:
        self.tubes, self.kind = tubes, kind
        self.layout = StepColumns(tubes, 1, kind)
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

    def at_nodes(self, name: str) -> bool:
        """Whether every node of a step has its own data of this name; otherwise all nodes share them."""
        return self.layout.table[name].at_nodes

    def routines(self) -> list[Routine]:
        """The routines for rates, their derivatives, and the effect of a point load."""
        x, point = {"x": self.x}, {"x": self.x, "point": self.point}
        rates = Routine("rates", self._inputs, {"rate": self._rate})
        slopes = self._slopes("slopes", self._plain, self._plain)
        turned, frame = _nonzeros(self._turn_rows), rotation_matrix(self.state.orientation).T  # row by row
        common = [
            *(rates, self._free(rates), slopes, self._free(slopes)),
            self._slopes("slopes_by_data", self._by_tubes, self._by_everything),
            self._free(self._slopes("slopes_by_data", self._by_tubes, self._by_tubes)),
            Routine("behind", point, {"y": boundary.jump(self.state, *self._load).joined()}),
            Routine("behind_slopes", point, {"inner": turned, "outer": _nonzeros(self._behind)}),
            Routine("attitude", x, {"frame": frame, "inner": turned}),
            *(self._at_place(), self._hamiltonian(), _transmission(), _straightened()),
        ]
        return common if self.kind.live else [*common, *self._second_variation()]

    def products(self) -> str:
        """C text of the sparse products for the derivatives."""
        return "".join(product(name, matrix, parts, to) for name, matrix, parts, to in self._products.values())

    @cached_property
    def _products(self) -> dict[str, tuple[str, ca.SX, list[tuple[str, int]], str]]:
        """Sparse products by the name of their count of nonzeros: name, matrix, what it is applied to, and result."""
        along, turn, part = ("along", State.size(self.tubes)), ("part", 3), ("part", 5)
        tubes, everything = (("change", sum(self.data[name].numel() for name in names)) for names in (TUBES, self.data))
        (inner, outer), (inner_by_data, outer_by_tubes) = self._plain, self._by_tubes
        outer_by_data = self._by_everything[1]
        return {
            "INNER": ("apply_by_parts", inner, [along], "part"),
            "OUTER": ("apply_slopes", outer, [along, part], "out"),
            "INNER_BY_DATA": ("apply_by_parts_and_data", inner_by_data, [along, tubes], "part"),
            "OUTER_BY_TUBES": ("apply_slopes_and_tubes", outer_by_tubes, [along, part, tubes], "out"),
            "OUTER_BY_DATA": ("apply_slopes_and_data", outer_by_data, [along, part, everything], "out"),
            "BEHIND_INNER": ("apply_turn", self._turn_rows, [along], "part"),
            "BEHIND_OUTER": ("apply_behind", self._behind, [along, turn], "out"),
        }

    @property
    def _point_parts(self) -> dict[str, slice]:
        """The slices of the parts of a point load in its data."""
        parts = self.layout.parts.items()
        return slices({name: part.stop - part.start for name, part in parts if name.startswith("point_")})

    @property
    def _inputs(self) -> dict[str, Any]:
        return {"x": self.x} | {f"data[{i}]": symbol for i, symbol in enumerate(self.data.values())}

    @cached_property
    def _rate(self) -> ca.SX:
        rate: ca.SX = rod.rates(self.state, self.local).joined()
        return rate

    def _slopes(self, name: str, inner: tuple[ca.SX, ca.SX], outer: tuple[ca.SX, ca.SX]) -> Routine:
        outputs = {"rate": self._rate, "inner": _nonzeros(inner[0]), "outer": _nonzeros(outer[1])}
        return Routine(name, self._inputs, outputs)

    def _free(self, routine: Routine) -> Routine:
        """A routine for steps without distributed loads."""
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

    def _by(self, names: Iterable[str]) -> tuple[ca.SX, ca.SX]:
        """Derivatives by state and data: of ``(phi, u)``; of the rate by the state itself, ``phi``, ``u`` and data."""
        data = ca.vertcat(ca.SX(0, 1), *(self.data[name] for name in names))
        bent, _ = rod.curvature(self.state, self.local)
        rate = rod.rates_at(self.state, self.local, self.turned_frame, self.bent).joined()
        inner = ca.vertcat(ca.horzcat(self._turn_rows, ca.SX(3, data.numel())), _jacobian(bent, self.x, data))
        outer = _jacobian(rate, ca.vertcat(self.x, self.turn, self.bent), data)
        return inner, self._there(ca.substitute(outer, self.bent, bent))

    @cached_property
    def _plain(self) -> tuple[ca.SX, ca.SX]:
        return self._by(())

    @cached_property
    def _by_tubes(self) -> tuple[ca.SX, ca.SX]:
        return self._by(TUBES)

    @cached_property
    def _by_everything(self) -> tuple[ca.SX, ca.SX]:
        """The columns of the loads come last: without them, the first nonzeros are those of ``_by_tubes``."""
        return self._by(self.data)

    def _there(self, matrix: ca.SX) -> ca.SX:
        """A derivative by parts, evaluated at the state itself."""
        frame = rotation_matrix(self.state.orientation)
        symbols = ca.vertcat(self.turn, ca.vec(self.frame))
        return ca.sparsify(ca.substitute(matrix, symbols, ca.vertcat(ca.SX.zeros(3), ca.vec(frame))))

    @property
    def _load(self) -> tuple[ca.SX, ca.SX]:
        return self.layout.point_load(self.column, self.state)

    @cached_property
    def _behind(self) -> ca.SX:
        """Derivative of the state behind a point load by the state in front of it and ``phi``."""
        after = boundary.jump_at(self.state, *self._load, self.turned_frame).joined()
        return self._there(ca.jacobian(after, ca.vertcat(self.x, self.turn)))

    def _at_place(self) -> Routine:
        """Curvatures, tubes' moments and the density of elastic energy at a place."""
        bent, twisted = rod.curvature(self.state, self.local)
        moments = ca.vertcat(*rod.tube_moments(self.state.angles, bent, twisted, self.local))
        energy = rod.elastic_density(self.state.angles, bent, twisted, self.local)
        outputs = {"bent": bent, "twisted": twisted, "moments": moments, "energy": energy}
        return Routine("at_place", self._inputs, outputs)

    def _hamiltonian(self) -> Routine:
        """The Hamiltonian and its derivatives by state and data."""
        value = integral_functions(self.tubes, "RK8", self.kind).hamiltonian(self.x, self.column)
        outputs = {"value": value, "by_state": ca.gradient(value, self.x)}
        outputs["by_data"] = ca.gradient(value, ca.vertcat(*self.data.values()))
        return Routine("hamiltonian", self._inputs, outputs)

    def _second_variation(self) -> list[Routine]:
        """Routines that count negative directions; directions are stored by rows, other matrices by columns."""
        functions = second_variation_functions(self.tubes, "RK8", self.kind)
        count, width = 2 * functions.size, lanes(2 * functions.size)
        rows = functions.directions(self.x)[:, 1:].T
        along = ca.SX.sym("along", width, State.size(self.tubes))
        column = ca.SX.sym("column", functions.shooting.columns.size)
        ahead = ca.horzcat(self.x, along[:count, :].T)
        transfer, _, flexibility, doubtful, defect = functions.step_results(ahead, column)
        results = {"transfer": transfer, "flexibility": flexibility, "doubtful": doubtful, "defect": defect}
        n = functions.size
        w, t, f = ca.SX.sym("W", n, n), ca.SX.sym("T", 2 * n, 2 * n), ca.SX.sym("flexibility", n)
        shift, compliance = ca.SX.sym("shift"), ca.SX.sym("compliance", self.tubes)
        before, negative, lost = functions.eliminate(w, t, ca.SX(0, 0), f, shift)
        inputs = {"W": w, "transfer": t, "flexibility": f, "shift": shift}
        at_entry = functions.entry(w, compliance, shift)
        start = ca.vertcat(rows, ca.SX.zeros(width - count, rows.shape[1]))
        return [
            Routine("directions", {"x": self.x}, {"along": start}),
            Routine("end_of_step", {"x": self.x, "along": along, "column": column}, results),
            Routine("eliminate", inputs, {"before": before, "negative": negative, "lost": lost}),
            Routine("entry", {"W": w, "compliance": compliance, "shift": shift}, {"negative": at_entry}),
        ]

    def sizes(self) -> dict[str, int]:
        """Sizes by their names in C, and the beginnings of the parts of a state and of the data."""
        tubes, size = self.tubes, {name: symbol.numel() for name, symbol in self.data.items()}
        data, shared = sum(size.values()), sum(size[name] for name in size if not self.at_nodes(name))
        names = {
            **{"TUBES": tubes, "NX": State.size(tubes), "NZ": len(boundary.tip_rows(tubes, self.kind.live))},
            **{"LANES": lanes(tubes), "MOST_UNKNOWNS": State.size(tubes), "STIFFNESSES": len(Stiffness.names())},
            **{"PARTS": len(size), "DATA": data, "DATA_STIFFNESS": 0, "SHARED": shared, "AT_NODES": data - shared},
            **{"POINT": self.point.numel()},
            **{name: matrix.nnz() for name, (_, matrix, *_) in self._products.items()},
        }
        names |= {f"AT_{name.upper()}": part.start for name, part in State.parts(tubes).items()}
        names |= {name.upper(): part.start for name, part in self._point_parts.items()}
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
    """The Hamiltonian of a tube alone held straight, SI, and its derivatives."""
    torque, preset, (symbols, stiffness) = ca.SX.sym("torque"), ca.SX.sym("preset", 3), _stiffness()
    value = law.straight_hamiltonian(torque, preset, stiffness)
    inputs = {"torque": torque, "preset": preset, "stiffness": symbols}
    slopes = {f"by_{name}": ca.gradient(value, symbol) for name, symbol in inputs.items()}
    return Routine("straightened", inputs, {"value": value, **slopes})


def _jacobian(of: ca.SX, first: ca.SX, then: ca.SX) -> ca.SX:
    """The derivatives by two vectors, side by side."""
    return ca.horzcat(ca.jacobian(of, first), ca.jacobian(of, then))


def _nonzeros(matrix: ca.SX) -> Any:
    return ca.densify(matrix.nz[:])
