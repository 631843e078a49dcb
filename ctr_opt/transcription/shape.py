"""A shape between the nodes of a mesh: states, curvatures and energies at any arc length."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import attrs
import numpy as np
from numpy.typing import NDArray

from ..checks import Array
from ..errors import DefinitionError
from ..layout.columns import StepColumns
from ..layout.configuration import Configuration, LoadValues
from ..loads.field import Field, parted
from ..mechanics.state import State, state_scales
from .shooting import NodeStates, Shooting, ShootingFunctions, shooting_functions
from .stability import SecondVariation, second_variation, smallest_eigenvalue

_QUADRATURE = 6  # Gauss points per step for energies: as accurate as the steps themselves


@attrs.frozen(eq=False)
class Values:
    """All values at some arc lengths, SI, one column each.

    The state; ``u_xy (2, k)``; ``u_i,z (tubes, k)``; the tubes' moments in their own frames ``(tubes, 3, k)``; the
    elastic energy density ``(k,)``.
    """

    arc_length: Array
    state: State[Any]
    bent: Array
    twisted: Array
    tube_moments: Array
    energy: Array


class Shape:
    """States at the nodes; between them, one step of the integrator starts at the node to the left."""

    def __init__(self, configuration: Configuration, mesh: Array, nodes: NodeStates, integrator: str = "RK8") -> None:
        self.configuration = configuration
        self.mesh = mesh
        self.nodes = nodes
        self.integrator = integrator
        scales = configuration.scales
        self.unit = state_scales(configuration.tube_count, scales.length, scales.moment, scales.force)

    @property
    def functions(self) -> ShootingFunctions:
        """The symbolic functions, which are shared and never pickled."""
        return shooting_functions(self.configuration.tube_count, self.integrator, self.configuration.kind)

    @property
    def shooting(self) -> Shooting:
        """The boundary-value problem on the same mesh."""
        return Shooting(self.configuration, self.mesh, self.integrator)

    def inside(self, s: Array, most: float, what: str) -> Array:
        """Check that ``s`` is within ``[0, most]``; values within rounding of break points are moved onto them."""
        points = np.asarray(s, dtype=np.float64)
        slack = self.configuration.ends.slack
        wrong = ~((points >= -slack) & (points <= most + slack))
        if wrong.any():
            value = float(points[wrong].ravel()[0])
            raise DefinitionError(f"s = {value:g} m is outside {what}: allowed are 0 to {most:g} m")
        starts = self.mesh[:, 0]
        nearest = np.clip(np.searchsorted(starts, points - slack), 0, len(starts) - 1)
        points = np.where(np.abs(starts[nearest] - points) <= slack, starts[nearest], points)
        length = self.configuration.length
        return np.asarray(np.where(np.abs(points - length) <= slack, length, points))

    def _step(self, s: Array, from_left: NDArray[np.bool_] | bool) -> NDArray[np.intp]:
        left = np.broadcast_to(from_left, s.shape) | (s >= self.configuration.length)
        starts, ends = self.mesh[:, 0], self.mesh[:, 1]
        step = np.where(left, np.searchsorted(ends, s), np.searchsorted(starts, s, side="right") - 1)
        return np.clip(step, 0, len(starts) - 1)

    def at(self, s: Array, from_left: NDArray[np.bool_] | bool = False) -> Values:
        """Values at ``s (k,)``: limits from the right; from the left on request and at ``length``."""
        step = self._step(s, from_left)
        starts, ends = self.mesh[:, 0], self.mesh[:, 1]
        pieces, middle = np.column_stack((starts[step], s)), self.mesh.mean(axis=1)[step]
        columns = self.functions.columns.pack(self.configuration, pieces, self.functions.integrator.nodes, middle)
        _, before = self.functions.many("step", self.nodes.right[:, step], columns)
        states = np.where(s == starts[step], self.nodes.right[:, step], before)
        states = np.where(s == ends[step], self.nodes.left[:, step], states)
        layout = StepColumns(self.configuration.tube_count, 1, self.configuration.kind)
        local = layout.pack(self.configuration, pieces, np.ones(1), middle)
        bent, twisted, moments, energy = self.functions.many("local", states, local)
        return self.values(s, states, bent, twisted, moments, energy[0])

    def values(self, s: Array, states: Array, bent: Array, twisted: Array, moments: Array, energy: Array) -> Values:
        """Values in SI from dimensionless ones, a column for each arc length."""
        scales, tubes = self.configuration.scales, self.configuration.tube_count
        return Values(
            s,
            State.split(states * self.unit[:, None], tubes),
            bent / scales.length,
            twisted / scales.length,
            moments.reshape(tubes, 3, -1) * scales.moment,
            energy * scales.force,
        )

    @cached_property
    def second_variation(self) -> SecondVariation | None:
        """The second variation of the potential energy; None without a potential, or if undecided."""
        if self.configuration.without_potential:
            return None
        return second_variation(self.shooting, self.nodes.right)

    @cached_property
    def smallest_eigenvalue(self) -> float:
        """Smallest eigenvalue of a positive second variation relative to its elastic part."""
        return smallest_eigenvalue(self.shooting, self.nodes.right)

    @cached_property
    def _integrals(self) -> tuple[float, float]:
        """Elastic energy in ``[0, length]`` and work of the distributed loads, by Gauss quadrature over the steps."""
        points, weights = np.polynomial.legendre.leggauss(_QUADRATURE)
        half = 0.5 * np.diff(self.mesh)
        s = self.mesh.mean(axis=1)[:, None] + half * points
        values = self.at(s.ravel())
        measure = (half * weights).ravel()
        fields = self.configuration.kind.fields
        _, loads = self.configuration.nodes(self.mesh, 0.5 * (points + 1.0), fields=fields)
        positions = values.state.position
        work = np.einsum("ij,ji->i", loads.force.reshape(-1, 3), positions)
        work -= _potentials(fields, loads, positions)
        return float(measure @ values.energy), float(measure @ work)

    @property
    def elastic_energy(self) -> float:
        """Elastic energy of the tubes in ``[0, length]``, J."""
        return self._integrals[0]

    @property
    def load_work(self) -> float:
        """Work ``sum F . p + integral of f . p`` of the dead forces minus ``V(p)`` of loads by potential, J."""
        configuration = self.configuration
        points = np.array([placed.start for placed in configuration.points])
        if not len(points):
            return self._integrals[1]
        points, fields = np.unique(points), configuration.kind.fields
        loads, positions = configuration.jumps(points, fields), self.at(points).state.position
        work = np.einsum("ij,ji->i", loads.force, positions) - _potentials(fields, loads, positions)
        return self._integrals[1] + float(work.sum())


def _potentials(fields: tuple[Field, ...], loads: LoadValues, positions: Array) -> Array:
    """The sum of ``factor V(p)`` over the expressions that are potentials, at ``positions (3, k)``."""
    total = np.zeros(positions.shape[1])
    factors = loads.field.reshape(positions.shape[1], len(fields))
    for field, factor, numbers in zip(fields, factors.T, parted(fields, loads.numbers), strict=True):
        if field.conservative:
            active = np.flatnonzero(factor)
            total[active] += factor[active] * [float(field.energy(positions[:, k], numbers)) for k in active]
    return total
