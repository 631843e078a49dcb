"""An experiment linearized: the basis of the steps of calibration and force estimation.

The base moments ``z`` of a robot in equilibrium satisfy the boundary conditions ``r(z, x) = 0`` at its other end, with
unknowns ``x`` (parameters of the robot, loads, errors of known numbers). The whitened misfits of the measurements are
``m(z, x, s)``, where ``s`` are the unknown places of points on the backbone. To first order the moments follow

    r + r_z dz + r_x dx = 0,   that is   dz = -r_z^-1 (r, r_x) (1, dx) = follow (1, dx):

The first column of ``follow`` is Newton's step to the equilibrium. The other columns are the equilibrium's derivatives
by the unknowns (implicit-function theorem). Inserted into the misfit ``m + m_z dz + m_x dx``, they give ``settled +
reduced dx``: the misfit in equilibrium, and its slopes by the unknowns alone. Places are then eliminated by the Schur
complement: ``places.py``.
"""

from __future__ import annotations

from functools import cached_property

import attrs
import numpy as np

from ..checks import Array


@attrs.frozen(eq=False, slots=False)
class Linearized:
    """Boundary residual and whitened misfit of an experiment, and their slopes.

    Slopes ``*_z`` are by the base moments (SI), ``*_x`` by the unknowns that act on the experiment, ``*_s`` by the
    estimated ``places``. For a group of experiments, all arrays have a leading axis.
    """

    residual: Array
    residual_z: Array
    residual_x: Array
    misfit: Array
    misfit_z: Array
    misfit_x: Array
    misfit_s: Array
    places: Array

    @classmethod
    def of(
        cls,
        residual: Array,
        slopes: Array,
        misfit: tuple[Array, Array],
        along: Array,
        mixing: Array,
        places: Array,
        length: Array | float,
    ) -> Linearized:
        """Build the linearization from a model's output by the chain rule.

        ``slopes`` are the residual's slopes by base moments and the model's numbers. ``misfit`` holds the misfit and
        its slopes by these, followed by poses of sensors. ``along`` are its slopes by arc lengths. ``mixing`` maps the
        unknowns to the numbers.
        """
        n, numbers = residual.shape[-1], slopes.shape[-1]
        value, rates = misfit
        return cls(
            residual,
            slopes[..., :n],
            slopes[..., n:] @ mixing[..., : numbers - n, :],
            value,
            rates[..., :n],
            rates[..., n:] @ mixing,
            along * length,
            places,
        )

    @cached_property
    def follow(self) -> Array:
        """Newton's step of the base moments, then their derivatives by the unknowns: ``(..., n, 1 + k)``."""
        pulls = np.concatenate((self.residual[..., None], self.residual_x), axis=-1)
        return np.asarray(-np.linalg.solve(self.residual_z, pulls))

    @cached_property
    def in_equilibrium(self) -> Array:
        """The misfit in equilibrium, then its slopes by the unknowns: ``(..., numbers, 1 + k)``."""
        there = self.misfit_z @ self.follow
        there[..., 0] += self.misfit
        there[..., 1:] += self.misfit_x
        return np.asarray(there)

    @property
    def step(self) -> Array:
        """Newton's step of the base moments to the equilibrium on the model's mesh."""
        return self.follow[..., 0]

    @property
    def settled(self) -> Array:
        """The misfit there, to first order."""
        return self.in_equilibrium[..., 0]

    @property
    def reduced(self) -> Array:
        """Slopes of the misfit by the unknowns, with the robot kept in equilibrium."""
        return self.in_equilibrium[..., 1:]

    def one(self, k: int) -> Linearized:
        """The linearization of one experiment of a group."""
        return Linearized(*(getattr(self, field.name)[k] for field in attrs.fields(Linearized)))
