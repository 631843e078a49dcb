"""What the transcribed formulations share: a program, a configuration as its numbers, and where to start."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import Any, ClassVar

import attrs
import casadi as ca
import numpy as np

from ..checks import Array
from ..layout.columns import EntryColumn, StepColumns
from ..layout.configuration import Configuration
from ..mechanics.kind import Kind
from ..mechanics.state import State, stacked, state_scales
from .integrators import runge_kutta
from .nlp import Nlp, NlpBuilder, padded
from .schemes import Collocation, Tableau, Transcription, tableau
from .shape import Shape


class TranscribedProgram:
    """A program for a number of tubes and steps and a kind of loads; its numbers come from columns of data.

    ``collocation``: the points of every step, unless it is integrated; ``points``: where guesses are wanted inside.
    """

    nlp: Nlp
    points: Tableau | None

    def __init__(self, tubes: int, transcription: Transcription, integrator: str, kind: Kind, steps: int) -> None:
        self.tubes, self.steps = tubes, steps
        self.integrator = runge_kutta(integrator)
        self.collocation: Tableau | None = None
        if isinstance(transcription, Collocation):
            self.collocation = tableau(transcription.degree, transcription.scheme)
        data = self.collocation or self.integrator
        self.data_nodes, self.data_weights = data.nodes, data.weights
        self.columns = StepColumns(tubes, len(data.nodes), kind)
        self.entry = EntryColumn(tubes, kind)

    def begun(self) -> tuple[NlpBuilder, ca.MX, ca.MX]:
        """The builder of the program, and the parameters that all have: the columns of the steps, and the entry's."""
        builder = NlpBuilder()
        columns = builder.parameter("columns", self.columns.size, self.steps)
        return builder, columns, builder.parameter("entry", self.entry.size)


class TranscribedProblem(ABC):
    """A program with the numbers of a configuration on a mesh; dimensionless."""

    programs: ClassVar[Callable[..., Any]]
    """The program for ``(tubes, transcription, integrator, kind, steps)``, shared by all problems of its size."""

    def __init__(
        self, configuration: Configuration, mesh: Array, transcription: Transcription, integrator: str = "RK8"
    ) -> None:
        if isinstance(transcription, Collocation):
            integrator = "RK8"  # not used
        steps = padded(len(mesh))
        program = type(self).programs(configuration.tube_count, transcription, integrator, configuration.kind, steps)
        self.configuration = configuration
        self.mesh = mesh
        self.program = program
        layout = program.columns
        self._columns = layout.pad(layout.pack(configuration, mesh, program.data_nodes), program.steps)
        total = layout.total_force(self._columns, program.data_weights)
        self._entry = program.entry.pack(configuration, total)

    @property
    def parameters(self) -> Array:
        """The program's parameters."""
        return np.concatenate((self._columns.ravel(order="F"), self._entry))

    def guess(self, shape: Shape | None = None) -> Array:
        """Variables to start from: those of the straight robot, its tubes free of torque, or of another shape."""
        points = np.zeros(0) if self.program.points is None else self.program.points.nodes
        given = self.configuration, self.mesh, points, self.program.steps
        blocks = self._blocks(_straight(*given) if shape is None else _like(*given, shape))
        return np.concatenate([blocks[name].ravel(order="F") for name in self.program.nlp.variables])

    @abstractmethod
    def _blocks(self, start: Guess) -> dict[str, Array]:
        """The program's variables by name, from a guess."""


@attrs.frozen(eq=False)
class Guess:
    """Dimensionless states at the ends and at inner points of ``steps``, and the curvatures at those points.

    ``nodes (size, steps + 1)``; ``inner (size, points, steps)``; ``curvatures (2 + tubes, points, steps)``. Steps past
    the mesh, which fill the program up, stay at the tip.
    """

    nodes: Array
    inner: Array
    curvatures: Array


def _straight(configuration: Configuration, mesh: Array, points: Array, steps: int) -> Guess:
    parts, pose = State.parts(configuration.tube_count), configuration.robot.base_pose
    ends, inner = _places(mesh / configuration.length, points, steps)

    def states(s: Array) -> Array:
        x = np.zeros((State.size(configuration.tube_count), s.size))
        x[parts["position"]] = pose[:3, 3:] / configuration.length + np.outer(pose[:3, 2], s.ravel(order="F"))
        x[parts["orientation"]] = configuration.robot.base_quaternion[:, None]
        x[parts["angles"]] = (configuration.actuation.rotations + configuration.transmission_twist)[:, None]
        return x.reshape((len(x), *s.shape), order="F")

    return Guess(states(ends), states(inner), np.zeros((2 + configuration.tube_count, *inner.shape)))


def _like(configuration: Configuration, mesh: Array, points: Array, steps: int, shape: Shape) -> Guess:
    """States and curvatures of another shape, its arc length stretched to this robot's."""
    scales, length = configuration.scales, shape.configuration.length
    unit = state_scales(configuration.tube_count, scales.length, scales.moment, scales.force)
    ends, inner = _places(mesh * (length / scales.length), points, steps)

    at = shape.at(np.minimum(np.append(ends, inner.ravel(order="F")), length))
    states = stacked(at.state) / unit[:, None]
    curvatures = np.vstack((at.bent, at.twisted)) * scales.length

    def inside(values: Array) -> Array:
        return values[:, steps + 1 :].reshape((len(values), *inner.shape), order="F")

    filled = inside(curvatures)
    filled[:, :, len(mesh) :] = 0.0
    return Guess(states[:, : steps + 1], inside(states), filled)


def _places(mesh: Array, points: Array, steps: int) -> tuple[Array, Array]:
    """Arc lengths of the nodes ``(steps + 1,)`` and of the points inside ``(points, steps)``, filled up at the tip."""
    idle = np.full((steps - len(mesh), 2), mesh[-1, 1])
    filled = np.vstack((mesh, idle))
    inner = filled[:, 0] + np.outer(points, filled[:, 1] - filled[:, 0])
    return np.append(filled[:, 0], mesh[-1, 1]), inner
