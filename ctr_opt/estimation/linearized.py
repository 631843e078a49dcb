"""An experiment to first order: what calibration and the estimation of forces both step by.

The base moments ``z`` of a robot at rest meet the boundary conditions ``r(z, x) = 0`` at its other end, with unknowns
``x`` (parameters of the robot, loads, errors of what is given). Measurements leave the whitened misfits ``m(z, x, s)``,
where ``s`` are the places of points that are somewhere on the backbone. To first order the moments go where

    r + r_z dz + r_x dx = 0,   that is   dz = -r_z^-1 (r, r_x) (1, dx) = follow (1, dx):

the first column of ``follow`` is Newton's step to the equilibrium, the others are how the equilibrium follows the
unknowns (implicit-function theorem). Put into the misfit ``m + m_z dz + m_x dx``, they leave ``settled + reduced dx``:
the misfit in equilibrium, and its slopes by the unknowns alone. Places then follow at their best (Schur complement):
``places.py``.
"""

from __future__ import annotations

from functools import cached_property

import attrs
import numpy as np

from ..checks import Array


@attrs.frozen(eq=False, slots=False)
class Linearized:
    """Boundary residual and whitened misfit at some values, and their slopes.

    ``*_z`` by the base moments (SI), ``*_x`` by the unknowns that act on the experiment, ``*_s`` by the ``places`` of
    points that are estimated. Of a group of experiments all have one axis more, the first.
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
        """From what a model says, by the chain rule.

        ``slopes``: the residual's, by base moments and the model's numbers; ``misfit``: with its slopes by these, and
        by poses of sensors behind them; ``along``: its slopes by arc lengths; ``mixing``: how the numbers follow the
        unknowns.
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
        """Newton's step of the base moments, and behind it how they follow the unknowns: ``(..., n, 1 + k)``."""
        pulls = np.concatenate((self.residual[..., None], self.residual_x), axis=-1)
        return np.asarray(-np.linalg.solve(self.residual_z, pulls))

    @cached_property
    def in_equilibrium(self) -> Array:
        """The misfit there, and behind it its slopes by the unknowns: ``(..., numbers, 1 + k)``."""
        there = self.misfit_z @ self.follow
        there[..., 0] += self.misfit
        there[..., 1:] += self.misfit_x
        return np.asarray(there)

    @property
    def step(self) -> Array:
        """Newton's step of the base moments to the equilibrium of the model's own mesh."""
        return self.follow[..., 0]

    @property
    def settled(self) -> Array:
        """The misfit there, to first order."""
        return self.in_equilibrium[..., 0]

    @property
    def reduced(self) -> Array:
        """Slopes of the misfit by the unknowns, the robot staying in equilibrium."""
        return self.in_equilibrium[..., 1:]

    def one(self, k: int) -> Linearized:
        """That of one experiment of a group."""
        return Linearized(*(getattr(self, field.name)[k] for field in attrs.fields(Linearized)))
