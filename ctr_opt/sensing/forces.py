"""Force of a wire: its direction from points along it, its magnitude from the hanging mass."""

from __future__ import annotations

from typing import Any

import attrs
import numpy as np

from ..checks import Array, number
from ..errors import DefinitionError
from ..loads.point import PointWrench
from .noise import numbers, points_of, spreads_of, symmetric

_STEPS = 50
_CONVERGED = 1e-12
_UNCERTAIN = 0.3  # rad: beyond this, a covariance no longer describes a direction


@attrs.frozen(eq=False)
class WireDirection:
    """The direction of a straight wire, with its uncertainty.

    Attributes
    ----------
    direction
        Unit vector ``(3,)`` from the first point to the last.
    covariance
        ``(3, 3)``, of rank two: there is no variance along the direction.
    residuals
        Distances ``(k,)``, m, of the points from the fitted line.
    sigma
        Standard deviation of a coordinate, m, if it was estimated from the residuals, else ``None``.
    """

    direction: Array
    covariance: Array
    residuals: Array
    sigma: float | None

    @property
    def angle_deviation(self) -> float:
        """Root-mean-square angle between the estimated and the true direction, rad."""
        return float(np.sqrt(np.trace(self.covariance)))

    def report(self) -> str:
        """Describe the direction and its error as text."""
        noise = "as given" if self.sigma is None else f"{1e3 * self.sigma:.3f} mm in a coordinate, estimated"
        return (
            f"Wire through {len(self.residuals)} points\n"
            f"  direction        ({numbers(self.direction, '.5f')})\n"
            f"  angle            known to {np.degrees(self.angle_deviation):.3f} deg (rms)\n"
            f"  noise            {noise}\n"
            f"  off the line by  {1e3 * self.residuals.max():.3f} mm at most"
        )


@attrs.frozen(eq=False)
class WireForce:
    """The force of a wire with a hanging mass, with its uncertainty.

    Attributes
    ----------
    force
        ``(3,)`` N.
    covariance
        ``(3, 3)`` N^2.
    wire
        The wire's direction.
    magnitude_deviation
        Standard deviation of the force's magnitude, N.
    """

    force: Array
    covariance: Array
    wire: WireDirection
    magnitude_deviation: float

    @property
    def magnitude(self) -> float:
        """Magnitude of the force, N."""
        return float(np.linalg.norm(self.force))

    def load(self, tube: int = 0, *, arc_length: float | None = None) -> PointWrench:
        """Make a load of the force, in the frame of the points.

        Parameters
        ----------
        tube
            Index of the tube that carries the load, 0 the innermost.
        arc_length
            ``s`` from the entry point, m; ``None``: the tube's distal end.
        """
        return PointWrench(force=self.force, tube=tube, arc_length=arc_length)

    def report(self) -> str:
        """Describe the force and its error as text."""
        pairs = zip(self.force, np.sqrt(np.diag(self.covariance)), strict=True)
        return (
            f"Force of {self.magnitude:.4f} +- {self.magnitude_deviation:.4f} N by a wire\n"
            f"  force            {', '.join(f'{value:.4f} +- {error:.4f}' for value, error in pairs)} N\n"
            f"{self.wire.report()}"
        )


def wire_direction(points: Any, *, sigma: Any = None, covariances: Any = None) -> WireDirection:
    """Fit the direction of a straight wire to points along it, by total least squares.

    It minimizes ``sum_i e_i^T C_i^-1 e_i`` over all lines, where ``e_i`` leads from a point to its most likely place on
    the line. For isotropic noise this is the principal axis of the points; otherwise Gauss-Newton steps start there.

    Parameters
    ----------
    points
        ``(k, 3)`` m, ordered along the wire in its direction; at least 2, or 3 to estimate the noise.
    sigma
        Standard deviation of a coordinate, m: one number or one per point. ``None``: one number is estimated from the
        residuals.
    covariances
        Covariances of the points, ``(k, 3, 3)`` m^2, instead of ``sigma``; a triangulation has them.

    Raises
    ------
    DefinitionError
        A shape is wrong, there are too few points, or they span no more than their noise.

    Notes
    -----
    S. Van Huffel, J. Vandewalle, The Total Least Squares Problem, SIAM, 1991. A wire that sags, or bends over the
    tube's edge, is not straight: mark points on its straight part only.

    Examples
    --------
    >>> wire = wire_direction([[0, 0, 0], [0.03, 0, 0.04], [0.06, 0, 0.08]], sigma=2e-4)
    >>> wire.direction.round(9).tolist(), round(wire.angle_deviation, 6)
    ([0.6, 0.0, 0.8], 0.004)
    """
    estimated = sigma is None and covariances is None
    points = points_of(points, "points", least=3 if estimated else 2)
    direction, centre, covariance = _line(points, spreads_of(sigma, covariances, len(points))[0])
    offsets = points - centre
    residuals, deviation = np.linalg.norm(offsets - np.outer(offsets @ direction, direction), axis=1), None
    if estimated:
        deviation = float(np.sqrt(np.sum(residuals**2) / (2 * len(points) - 4)))
        covariance = covariance * deviation**2
    wire = WireDirection(direction, covariance, residuals, deviation)
    if wire.angle_deviation > _UNCERTAIN:
        raise DefinitionError(
            f"points span little more than their noise, so the direction has a standard deviation of "
            f"{wire.angle_deviation:.2g} rad; at most {_UNCERTAIN:g} rad is allowed"
        )
    return wire


def hanging_mass(
    mass: float,
    points: Any,
    *,
    gravity: float = 9.80665,
    mass_sigma: float = 0.0,
    tension_sigma: float = 0.0,
    sigma: Any = None,
    covariances: Any = None,
) -> WireForce:
    """Compute the force of a mass on a wire over a pulley, from points along the wire.

    The force is ``F = m g d``, with the covariance ``(m g)^2 C_d + d d^T (g^2 sigma_m^2 + sigma_T^2)``.

    Parameters
    ----------
    mass
        The mass, kg.
    points, sigma, covariances
        As for :func:`wire_direction`, ordered from the robot to the pulley, the direction of the force.
    gravity
        Acceleration of gravity, m/s^2; default: the standard value.
    mass_sigma
        Standard deviation of the mass, kg.
    tension_sigma
        Standard deviation of the tension by the pulley's friction, N.

    Raises
    ------
    DefinitionError
        :func:`wire_direction` refuses the points, or the mass or the acceleration is not above 0.

    Examples
    --------
    >>> pull = hanging_mass(0.1, [[0, 0, 0], [0.03, 0, 0.04], [0.06, 0, 0.08]], gravity=9.81, sigma=2e-4)
    >>> pull.load().force.round(6).tolist()
    [0.5886, 0.0, 0.7848]
    """
    weight = number(mass, "mass", above=0.0, unit="kg") * number(gravity, "gravity", above=0.0, unit="m/s^2")
    by_mass = gravity * number(mass_sigma, "mass_sigma", least=0.0, unit="kg")
    deviation = float(np.hypot(by_mass, number(tension_sigma, "tension_sigma", least=0.0, unit="N")))
    wire = wire_direction(points, sigma=sigma, covariances=covariances)
    along = np.outer(wire.direction, wire.direction)
    covariance = weight**2 * wire.covariance + deviation**2 * along
    return WireForce(weight * wire.direction, symmetric(covariance), wire, deviation)


def _line(points: Array, spreads: Array) -> tuple[Array, Array, Array]:
    """Fit a line: its direction, a point on it, and the direction's covariance ``(3, 3)``."""
    centre = points.mean(axis=0)
    _, sizes, axes = np.linalg.svd(points - centre)
    ends = points[-1] - points[0]
    if sizes[0] == 0.0 or ends @ axes[0] == 0.0:
        raise DefinitionError("points: the first and the last must be apart along the wire")
    direction = axes[0] if ends @ axes[0] > 0.0 else -axes[0]
    inverse = np.linalg.inv(spreads)
    for _ in range(_STEPS):
        across = np.linalg.svd(direction[None, :])[2][1:]
        stiff = inverse @ direction
        place = np.einsum("ki,ki->k", points - centre, stiff) / (stiff @ direction)
        errors = (points - centre) @ across.T
        weights = np.linalg.inv(across @ spreads @ across.T)
        # Each point sees the line moved across by shift + place * tilt.
        basis = np.stack((np.ones_like(place), place))
        matrix = np.einsum("ak,bk,kij->aibj", basis, basis, weights).reshape(4, 4)
        right = np.einsum("ak,kij,kj->ai", basis, weights, errors).reshape(4)
        inverted = np.linalg.inv(matrix)
        shift, tilt = (inverted @ right).reshape(2, 2) @ across
        covariance = across.T @ inverted[2:, 2:] @ across
        centre, turned = centre + shift, direction + tilt
        direction = turned / np.linalg.norm(turned)
        if np.linalg.norm(tilt) < _CONVERGED and np.linalg.norm(shift) < _CONVERGED * sizes[0]:
            return direction, centre, symmetric(covariance)
    raise DefinitionError("points: no straight line fits; they span no more than their noise")
