"""All values of a shape at many places, in one call."""

from __future__ import annotations

from typing import Any

import attrs
import numpy as np

from ..checks import Array, frozen
from ..transcription.shape import Shape
from .values import moments, places_of, rotations


@attrs.frozen(eq=False)
class Sample:
    """All values of a shape at some arc lengths: what :meth:`Equilibrium.sample <ctr_opt.Equilibrium.sample>` gives.

    Arrays are read-only. A single arc length gives arrays without the leading axis ``k``. Tubes that have ended are not
    a number. Where a value jumps, it is the limit from the right; at a tube's end and at the tip, from the left.

    Attributes
    ----------
    arc_length
        ``(k,)``, m.
    position
        Backbone positions ``(k, 3)``, m, world frame.
    rotation
        Rotation-minimizing backbone frames ``(k, 3, 3)``, in columns, z along the backbone. The material frame of tube
        ``i`` is turned about z by ``tube_angle[:, i]``.
    curvature
        Backbone curvature ``(u_x, u_y, 0)``, ``(k, 3)``, 1/m, in the backbone frame.
    tube_angle, torsion
        Angles ``psi_i (k, n)``, rad, against the backbone frame, and torsions ``u_i,z (k, n)``, 1/m.
    tube_moment
        Moments ``K_i (u_i - u*_i)`` of the tubes in their material frames, ``(k, n, 3)``, N m (paper, (3)).
    internal_force, internal_moment
        ``(k, 3)``, N and N m, world frame: what ``[s, length]`` exerts on ``[0, s]``.
    """

    arc_length: Array
    position: Array
    rotation: Array
    curvature: Array
    tube_angle: Array
    torsion: Array
    tube_moment: Array
    internal_force: Array
    internal_moment: Array


def sample(shape: Shape, s: Any) -> Sample:
    """All values at ``s``; tubes' values at their ends are taken from the left, in the same call."""
    points = places_of(s)
    if not points.size:
        return Sample(*(part[:0] for part in attrs.astuple(sample(shape, [0.0]), recurse=False)))
    ends, length = shape.configuration.ends, shape.configuration.length
    flat = shape.inside(np.atleast_1d(points), length, "the robot")
    present = flat[:, None] <= ends.array
    ending = np.flatnonzero((flat[:, None] == ends.array).any(axis=1) & (flat < length))
    count = len(flat)
    values = shape.at(np.concatenate((flat, flat[ending])), np.arange(count + len(ending)) >= count)
    rows = np.tile(np.arange(count)[:, None], (1, len(ends.points)))  # where each tube's values stand
    for k, place in enumerate(ending):
        rows[place, flat[place] == ends.array] = count + k
    tubes = np.arange(len(ends.points))

    def of_tubes(numbers: Array) -> Array:
        taken = np.moveaxis(numbers, -1, 0)[rows, tubes]
        return np.where(present.reshape(present.shape + (1,) * (taken.ndim - 2)), taken, np.nan)

    state = values.state
    parts = (
        flat,
        state.position.T,
        rotations(state.orientation, np.zeros(state.orientation.shape[1])),
        np.pad(values.bent.T, ((0, 0), (0, 1))),
        *(of_tubes(numbers) for numbers in (state.angles, values.twisted, values.tube_moments)),
        state.force.T,
        moments(values),
    )
    single = points.ndim == 0
    return Sample(*(frozen(np.array(part[0] if single else part[:count])) for part in parts))
