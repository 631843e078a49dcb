"""Curvature from the axial strains of an optical fibre's cores."""

from __future__ import annotations

from typing import Any

import attrs
import numpy as np

from ..checks import Array, array, flag, number
from ..errors import DefinitionError
from ..estimation.measurements import CurvatureMeasurement
from .noise import covariances_of, deviations_of, numbers, symmetric

_DEGENERATE = 1e-9  # ratio of singular values
_FEWEST = 5  # least number of redundant strains from which the noise is estimated


@attrs.frozen(eq=False)
class FibreCurvature:
    """Curvatures along a fibre, with their uncertainty.

    Attributes
    ----------
    curvature
        ``(k, 2)`` 1/m: ``u_x``, ``u_y`` in the fibre's frame.
    common_strain
        ``(k,)``: strain by temperature and tension, common to all cores; zeros if it was excluded.
    covariance
        Covariance of ``u_x``, ``u_y`` (and the common strain) at every place, ``(2, 2)`` or ``(3, 3)``; ``None`` if
        the noise of strains is unknown.
    residuals
        ``(k, cores)``: measured minus fitted strains.
    """

    curvature: Array
    common_strain: Array
    covariance: Array | None
    residuals: Array

    @property
    def standard_deviations(self) -> Array | None:
        """Standard deviations of ``u_x`` and ``u_y``, ``(2,)`` 1/m; None if the noise of strains is unknown."""
        return None if self.covariance is None else np.sqrt(np.diag(self.covariance)[:2])

    def measurement(self, arc_length: Any, tube: int = 0) -> CurvatureMeasurement:
        """The curvatures as a measurement of a tube, for a calibration or a force estimate.

        Parameters
        ----------
        arc_length
            Places of the rows on the robot, ``(k,)`` m from the entry point.
        tube
            Number of the tube that carries the fibre. Its material frame must be the fibre's.

        Raises
        ------
        DefinitionError
            There is not one place for each row.

        Examples
        --------
        >>> import numpy as np
        >>> cores = core_ring(35e-6, np.deg2rad([90.0, 210.0, 330.0]))
        >>> fibre = curvature_from_strains([[3.5e-4, -1.75e-4, -1.75e-4]], cores, sigma=1e-6)
        >>> fibre.measurement([0.05], tube=1).shape
        (1, 2)
        """
        sigma = None if self.covariance is None else self.covariance[:2, :2]
        return CurvatureMeasurement(arc_length, self.curvature, sigma, tube)

    def report(self) -> str:
        """Describe the ranges of curvature and common strain, and the curvatures' errors, as text."""
        known, low, high = self.standard_deviations, self.curvature.min(axis=0), self.curvature.max(axis=0)
        errors = "unknown: give sigma" if known is None else f"{numbers(known, '.4g')} 1/m in u_x, u_y"
        strain = 1e6 * self.common_strain
        return (
            f"Curvature at {len(self.curvature)} places from {self.residuals.shape[1]} cores\n"
            f"  u_x, u_y              from {numbers(low, '.4g')} to {numbers(high, '.4g')} 1/m\n"
            f"  common strain         from {strain.min():.4g} to {strain.max():.4g} millionths\n"
            f"  standard deviations   {errors}\n"
            f"  residuals             {1e6 * np.sqrt(np.mean(self.residuals**2)):.4g} millionths (rms)"
        )


def core_ring(radius: float, angles: Any) -> Array:
    """Positions of cores on a ring, ``(cores, 2)`` m.

    Parameters
    ----------
    radius
        Radius of the ring, m.
    angles
        Angles of the cores from x toward y, ``(cores,)`` rad.

    Examples
    --------
    >>> core_ring(35e-6, [0.0, 1.5707963267948966]).round(9).tolist()
    [[3.5e-05, 0.0], [0.0, 3.5e-05]]
    """
    turns = array(angles, "angles", (None,), unit="rad")
    return number(radius, "radius", above=0.0, unit="m") * np.column_stack((np.cos(turns), np.sin(turns)))


def curvature_from_strains(
    strains: Any,
    core_positions: Any,
    *,
    sigma: Any = None,
    covariance: Any = None,
    temperature: bool = True,
) -> FibreCurvature:
    """Compute curvatures along a fibre from the axial strains of its cores, by weighted least squares.

    A core at ``(x, y)`` of a cross-section bent by ``u`` has the strain ``e3 . (u x (x, y, 0))``, so
    ``strain = u_x y - u_y x + common``. Positive ``u_x`` bends toward -y and stretches the side of +y.

    Parameters
    ----------
    strains
        ``(k, cores)``, dimensionless, at ``k`` places along the fibre.
    core_positions
        ``(cores, 2)`` m, in the fibre's frame, from its neutral axis: see :func:`core_ring`.
    sigma
        Standard deviation of a strain: one number or one per core. ``None``: one number is estimated from the
        residuals, if there are enough redundant strains.
    covariance
        Covariance of the strains of a cross-section, ``(cores, cores)``, instead of ``sigma``.
    temperature
        Whether strains have a part common to all cores (temperature, tension), which is then estimated.

    Raises
    ------
    DefinitionError
        A shape is wrong, or the cores cannot distinguish both curvatures (and the common strain).

    Notes
    -----
    R. Duncan, M. Raum, Proc. SPIE 6167, 2006; J. Moore, M. Rogge, Optics Express 20(3), 2012. The relation is of first
    order in the strains and for cores parallel to the axis, which twist strains to second order only. Cores spun around
    the axis turn with arc length: call the function for each place with the positions there.

    Examples
    --------
    >>> import numpy as np
    >>> cores = core_ring(35e-6, np.deg2rad([90.0, 210.0, 330.0]))
    >>> found = curvature_from_strains([[3.5e-4, -1.75e-4, -1.75e-4]], cores, sigma=1e-6)
    >>> (found.curvature.round(6) + 0.0).tolist(), found.standard_deviations.round(4).tolist()
    ([[10.0, 0.0]], [0.0233, 0.0233])
    """
    places = array(core_positions, "core_positions", (None, 2), unit="m")
    measured = array(strains, "strains", (None, len(places)))
    if len(measured) == 0:
        raise DefinitionError("strains has no row, but must have at least one place along the fibre")
    design = np.column_stack((places[:, 1], -places[:, 0], np.ones(len(places))))
    design = design if flag(temperature, "temperature") else design[:, :2]
    scales = np.abs(design).max(axis=0, initial=0.0)
    _check_cores(design, scales)
    spread = covariances_of(sigma, covariance, "covariance", (len(places), len(places)))
    if spread is None and sigma is not None:
        spread = np.diag(deviations_of(sigma, len(places), unit="") ** 2)
    chol = np.linalg.cholesky(np.eye(len(places)) if spread is None else spread)
    solver = np.linalg.pinv(np.linalg.solve(chol, design / scales)) @ np.linalg.inv(chol) / scales[:, None]
    answers = measured @ solver.T
    residuals = measured - answers @ design.T
    if spread is None:
        over = residuals.size - answers.size
        spread = np.sum(residuals**2) / over * np.eye(len(places)) if over >= _FEWEST else None
    known = None if spread is None else symmetric(solver @ spread @ solver.T)
    common = answers[:, 2] if temperature else np.zeros(len(answers))
    return FibreCurvature(answers[:, :2], common, known, residuals)


def _check_cores(design: Array, scales: Array) -> None:
    cores, unknowns = design.shape
    if cores < unknowns:
        raise DefinitionError(f"core_positions has {cores} cores, but must have at least {unknowns}, one per unknown")
    sizes = np.linalg.svd(design / np.where(scales > 0.0, scales, 1.0), compute_uv=False)
    if sizes[-1] <= _DEGENERATE * sizes[0]:
        raise DefinitionError(
            "core_positions: the cores are on a line, so they cannot distinguish u_x, u_y and the common strain"
            if unknowns == 3
            else "core_positions: the cores are on a line through the axis, so they cannot distinguish u_x and u_y"
        )
