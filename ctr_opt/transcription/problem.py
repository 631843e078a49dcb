"""Common parts of the transcribed formulations: programs, their numbers, and starting points."""

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
from .shooting import OnMesh


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
        self.data = self.collocation or self.integrator
        self.columns = StepColumns(tubes, len(self.data.nodes), kind)
        self.entry = EntryColumn(tubes, kind)

    def begun(self) -> tuple[NlpBuilder, ca.MX, ca.MX]:
        """A builder with the parameters of all programs: the columns of the steps and of the entry point."""
        builder = NlpBuilder()
        columns = builder.parameter("columns", self.columns.size, self.steps)
        return builder, columns, builder.parameter("entry", self.entry.size)


class TranscribedProblem(OnMesh, ABC):
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
        super().__init__(configuration, mesh, program, program.data, steps)
        self.program = program

    @property
    def parameters(self) -> Array:
        """The program's parameters."""
        return np.concatenate((self._columns.ravel(order="F"), self.entry))

    def guess(self, shape: Shape | None = None) -> Array:
        """Variables to start from, of the straight robot without torques or of another shape."""
        points = np.zeros(0) if self.program.points is None else self.program.points.nodes
        count, steps, configuration = len(self.mesh), self.program.steps, self.configuration
        length = configuration.length if shape is None else shape.configuration.length
        mesh = np.vstack((self.mesh, np.full((steps - count, 2), self.mesh[-1, 1]))) * (length / configuration.length)
        inner = mesh[:, 0] + np.outer(points, mesh[:, 1] - mesh[:, 0])
        s = np.minimum(np.concatenate((mesh[:, 0], mesh[-1:, 1], inner.ravel(order="F"))), length)
        states, curvatures = _straight(configuration, s) if shape is None else _like(configuration, s, shape)
        between, bent = (
            values[:, steps + 1 :].reshape((len(values), *inner.shape), order="F") for values in (states, curvatures)
        )
        bent[:, :, count:] = 0.0
        blocks = self._blocks(Guess(states[:, : steps + 1], between, bent))
        return np.concatenate([blocks[name].ravel(order="F") for name in self.program.nlp.variables])

    @abstractmethod
    def _blocks(self, start: Guess) -> dict[str, Array]:
        """The program's variables by name, from a guess."""


@attrs.frozen(eq=False)
class Guess:
    """A starting point: dimensionless states at the ends and at inner points of steps, and curvatures there.

    ``nodes (size, steps + 1)``; ``inner (size, points, steps)``; ``curvatures (2 + tubes, points, steps)``. Steps past
    the mesh, which fill the program up, stay at the tip.
    """

    nodes: Array
    inner: Array
    curvatures: Array


def _straight(configuration: Configuration, s: Array) -> tuple[Array, Array]:
    """States ``(size, k)`` and curvatures ``(2 + tubes, k)`` of the straight robot, dimensionless."""
    parts, pose, tubes = State.parts(configuration.tube_count), configuration.robot.base_pose, configuration.tube_count
    states = np.zeros((State.size(tubes), len(s)))
    states[parts["position"]] = (pose[:3, 3:] + np.outer(pose[:3, 2], s)) / configuration.length
    states[parts["orientation"]] = configuration.robot.base_quaternion[:, None]
    states[parts["angles"]] = (configuration.actuation.rotations + configuration.transmission_twist)[:, None]
    return states, np.zeros((2 + tubes, len(s)))


def _like(configuration: Configuration, s: Array, shape: Shape) -> tuple[Array, Array]:
    """States and curvatures of another shape, dimensionless."""
    scales, at = configuration.scales, shape.at(s)
    unit = state_scales(configuration.tube_count, scales.length, scales.moment, scales.force)
    return stacked(at.state) / unit[:, None], np.vstack((at.bent, at.twisted)) * scales.length
