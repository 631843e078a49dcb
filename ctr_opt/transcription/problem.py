"""What the transcribed formulations share: a configuration on a mesh as numbers for a program, and where to start."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any

import numpy as np

from ..checks import Array
from ..layout.configuration import Configuration
from . import guess
from .guess import Guess
from .shape import Shape


class TranscribedProblem(ABC):
    """A program with the numbers of a configuration on a mesh; dimensionless."""

    def __init__(self, configuration: Configuration, mesh: Array, program: Any) -> None:
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

    def straight(self) -> Array:
        """The guess that needs no thought."""
        return self._variables(guess.straight(self.configuration, self.mesh, self._points, self.program.steps))

    def like(self, shape: Shape) -> Array:
        """The guess that another shape gives."""
        return self._variables(guess.like(self.configuration, self.mesh, self._points, self.program.steps, shape))

    @property
    def _points(self) -> Array:
        """Where in a step a guess is wanted besides its ends."""
        return np.zeros(0) if self.program.points is None else np.asarray(self.program.points.nodes)

    def _variables(self, start: Guess) -> Array:
        blocks = self._blocks(start)
        return np.concatenate([blocks[name].ravel(order="F") for name in self.program.nlp.variables])

    @abstractmethod
    def _blocks(self, start: Guess) -> dict[str, Array]:
        """The program's variables by name, from a guess."""
