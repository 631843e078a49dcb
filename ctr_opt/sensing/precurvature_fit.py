"""Precurvature of a tube from noisy points along it (paper, III-A and Fig. 5)."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import attrs
import numpy as np

from ..checks import Array, array, choice, direction, number, whole
from ..errors import DefinitionError
from ..robot.curves import chord_lengths
from ..robot.precurvature import Piece, SampledCurvature, Straight
from .noise import numbers, points_of, spreads_of
from .propagation import Propagation
from .smoothing import LEAST_FREEDOM, Data, Smoother, best, polynomials

if TYPE_CHECKING:
    from matplotlib.axes import Axes

METHODS = ("polynomial", "spline")
_FEWEST = 6
# Squared noise by which the product of two chords may fall below zero, because dense points jitter; and the median of
# the squared second differences of normal noise.
_BACK, _SECOND_DIFFERENCES = 30.0, 6.0 * 2.366
_PARALLEL = 1e-3  # rad: a normal nearer to the tangent does not determine x
_COLORS = ("#0072B2", "#D55E00")
_NINETY_FIVE = 1.959964  # standard errors


@attrs.frozen(eq=False)
class PrecurvatureFit:
    """The identified precurvature of a tube, with its uncertainty.

    Attributes
    ----------
    arc_length
        ``(k,)`` m, from the first point.
    curvature
        ``(k, 3)`` 1/m: ``u*_x``, ``u*_y`` and 0, in Bishop's frame.
    standard_errors
        ``(k, 2)`` 1/m, of ``u*_x`` and ``u*_y`` at a fixed arc length.
    curve
        ``(k, 3)`` m: the smooth curve.
    order
        Order of the polynomial; ``None`` for a spline.
    smoothing
        Weight of the spline's penalty, relative to the data; ``None`` for a polynomial.
    degrees_of_freedom
        Degrees of freedom of the curve in each coordinate: trace of the hat matrix.
    scores
        Root-mean-square error of cross-validation, m, by the order or smoothing tried.
    residuals
        ``(points, 3)`` m: measured minus smooth.
    sigma
        Standard deviation of a coordinate, m (root mean square over the points), as given or as estimated.
    estimated
        Whether ``sigma`` was estimated from the residuals.
    straight
        Length of the straight part before the first point, m.
    """

    arc_length: Array
    curvature: Array
    standard_errors: Array
    curve: Array
    order: int | None
    smoothing: float | None
    degrees_of_freedom: float
    scores: dict[float, float]
    residuals: Array
    sigma: float
    estimated: bool
    straight: float

    @property
    def length(self) -> float:
        """Arc length of the measured part, m."""
        return float(self.arc_length[-1])

    @property
    def piece(self) -> SampledCurvature:
        """The measured part as a piece of a tube's precurvature."""
        return SampledCurvature(self.arc_length, self.curvature)

    @property
    def pieces(self) -> tuple[Piece, ...]:
        """The whole precurvature of the tube: the straight part, if there is one, and the measured part."""
        return (Straight(self.straight), self.piece) if self.straight else (self.piece,)

    def report(self) -> str:
        """Describe the fitted curve, its residuals and the curvatures' errors as text."""
        kind = f"polynomial of order {self.order}" if self.order else f"smoothing spline, penalty {self.smoothing:.3g}"
        how = "estimated" if self.estimated else "given"
        size, known = np.abs(self.curvature[:, :2]).max(axis=0), np.sqrt(np.mean(self.standard_errors**2, axis=0))
        chosen = [key in (self.order, self.smoothing) for key in self.scores].index(True)
        near = list(self.scores.items())[max(chosen - 2, 0) : chosen + 3]
        scores = ", ".join(f"{key:.3g}: {1e3 * value:.4f}" for key, value in near)
        return (
            f"Precurvature of {len(self.residuals)} points on {1e3 * self.length:.2f} mm\n"
            f"  curve                     {kind}, {self.degrees_of_freedom:.1f} degrees of freedom\n"
            f"  noise of a coordinate     {1e3 * self.sigma:.4f} mm, {how}\n"
            f"  residuals                 rms {1e3 * np.sqrt(np.mean(np.sum(self.residuals**2, axis=1))):.4f} mm\n"
            f"  largest |u*_x|, |u*_y|    {numbers(size)} 1/m\n"
            f"  standard errors (rms)     {numbers(known)} 1/m\n"
            f"  cross-validation, mm      {scores}"
        )

    def plot(self, ax: Axes | None = None) -> Axes:
        """Plot ``u*_x`` and ``u*_y`` over arc length with 95 percent bands, as in the paper's Fig. 5.

        Parameters
        ----------
        ax
            Axes to draw on; a new figure by default. Arc length is in mm from the tube's base.
        """
        import matplotlib.pyplot as plt

        axes = plt.subplots(layout="constrained")[1] if ax is None else ax
        s = 1e3 * (self.straight + self.arc_length)
        for c, (color, label) in enumerate(zip(_COLORS, ("$u^*_x$", "$u^*_y$"), strict=True)):
            u, band = self.curvature[:, c], _NINETY_FIVE * self.standard_errors[:, c]
            axes.fill_between(s, u - band, u + band, color=color, alpha=0.2, lw=0.0)
            axes.plot(s, u, color=color, lw=1.6, ls=("-", "--")[c], label=label)
        axes.axhline(0.0, color="0.8", lw=0.8, zorder=0)
        axes.set(xlabel="arc length from the tube's base [mm]", ylabel="precurvature [1/m]")
        axes.margins(x=0.01)
        axes.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=2, frameon=False)
        return axes


def identify_precurvature(
    points: Any,
    *,
    sigma: Any = None,
    covariances: Any = None,
    method: str = "polynomial",
    order: int | None = None,
    smoothing: float | None = None,
    straight: float = 0.0,
    tangent: Any = None,
    normal: Any = (1.0, 0.0, 0.0),
    samples: int = 101,
) -> PrecurvatureFit:
    """Identify the precurvature of a tube from points measured along it, with standard errors.

    A smooth curve is fitted by weighted least squares, first as a function of chord length, then of arc length. It is a
    polynomial, as in the paper, or a spline of degree five with a penalty on the fourth derivative. The order or
    penalty is the simplest whose leave-one-out cross-validation error is the least, to within about its standard error.
    The curvature of the curve in Bishop's frame is ``u* = (u*_x, u*_y, 0)``.

    Parameters
    ----------
    points
        ``(k, 3)`` m, ordered from base to tip along the curved part, at least 6.
    sigma
        Standard deviation of a coordinate, m: one number or one per point. ``None``: one number is estimated from the
        residuals.
    covariances
        Covariances of the points, ``(k, 3, 3)`` m^2, instead of ``sigma``; a triangulation has them.
    method
        ``"polynomial"`` or ``"spline"``.
    order
        Order of the polynomial, at least 2; by cross-validation if ``None``.
    smoothing
        Weight of the spline's penalty, above 0; by cross-validation if ``None``.
    straight
        Length of a straight part before the first point, m, which is not fitted.
    tangent
        Direction of the curve at its base ``(3,)``, if known: the direction of the straight part, which
        :func:`wire_direction` finds. Without it, the error of the fitted direction limits the accuracy of the tip.
    normal
        Direction of x at the base. Only its component normal to the curve counts.
    samples
        Number of points of the returned curvature, at least 5.

    Raises
    ------
    DefinitionError
        A shape is wrong, points are too few, coincide or turn back, or the normal is along the curve.

    Notes
    -----
    The standard errors are linearized: noise is propagated to the coefficients and, by differences, to the curvature at
    a given arc length. Noise along the curve does not count, because it leaves a point on the curve. Bias is included
    on average over the curve. For splines it is that of the penalty (G. Wahba, J. R. Stat. Soc. B 45, 1983). For
    polynomials of a chosen order, the next order is taken as free of bias: its variance and the squared difference from
    it are added. A given order is taken as free of bias.

    Examples
    --------
    >>> import numpy as np
    >>> t = np.linspace(0.0, 1.0, 30)
    >>> arc = 0.1 * np.column_stack((1.0 - np.cos(t), 0.0 * t, np.sin(t)))
    >>> noise = 1e-4 * np.random.default_rng(0).normal(size=(30, 3))
    >>> fit = identify_precurvature(arc + noise)
    >>> worst = np.abs(fit.curvature[:, :2] - [0.0, 10.0]) / fit.standard_errors
    >>> fit.order, bool(worst.max() < 3.0)
    (3, True)
    """
    from scipy.interpolate import CubicSpline

    measured = points_of(points, "points", least=_FEWEST)
    choice(method, "method", METHODS)
    places = whole(samples, "samples", 5)
    lead = number(straight, "straight", least=0.0, unit="m")
    spreads, estimated = spreads_of(sigma, covariances, len(measured))
    weights = 3.0 / np.trace(spreads, axis1=1, axis2=2)
    parameter = _fixed_parameter(method, order, smoothing)
    # Chords between noisy points jitter, which would distort the curve's parameter, so they only give a start.
    _, start, _ = best(method, Data(measured, _chord_lengths(measured), weights), parameter)
    parameters, length = start.arc_lengths()
    data = Data(measured, parameters, weights, None if tangent is None else length * direction(tangent, "tangent"))
    chosen, smoother, scores = best(method, data, parameter)
    residuals, unit = smoother.residuals, 1.0
    if estimated:
        # Each point has noise in the two directions across the curve; the fit absorbs the share given by its leverage.
        if smoother.freedom < LEAST_FREEDOM:
            raise DefinitionError(
                f"smoothing = {chosen:g} is so small that the curve goes through all points: give sigma"
            )
        unit = float(np.sum(residuals**2)) / (2.0 * smoother.freedom)
        spreads = unit * spreads
    propagation = Propagation(spreads, unit, places, _across(normal, smoother.tangents(np.zeros(1))[0]))
    s, curvature, errors = propagation.curvature(smoother)
    if method == "polynomial" and order is None and chosen + 1 <= len(measured) - 2:
        higher = propagation.curvature(Smoother.of(polynomials(int(chosen) + 1), data))
        # The two lengths differ by less than a step, and at the tip a curve is followed a little beyond its end.
        errors = np.hypot(higher[2], CubicSpline(higher[0], higher[1])(s) - curvature)
    return PrecurvatureFit(
        s,
        np.column_stack((curvature, np.zeros(len(s)))),
        errors,
        smoother.curve(np.linspace(0.0, 1.0, places)),
        int(chosen) if method == "polynomial" else None,
        chosen if method == "spline" else None,
        float(smoother.leverages.sum()),
        scores,
        residuals,
        float(np.sqrt(np.mean(np.trace(spreads, axis1=1, axis2=2)) / 3.0)),
        estimated,
        lead,
    )


def _fixed_parameter(method: str, order: int | None, smoothing: float | None) -> float | None:
    if method == "polynomial":
        if smoothing is not None:
            raise DefinitionError("smoothing requires method = 'spline': a polynomial has an order")
        return None if order is None else float(whole(order, "order", 2))
    if order is not None:
        raise DefinitionError("order requires method = 'polynomial': a spline has a smoothing")
    return None if smoothing is None else number(smoothing, "smoothing", above=0.0)


def _chord_lengths(points: Array) -> Array:
    """Normalized chord lengths ``(k,)``, from 0 to 1."""
    reached, chords = chord_lengths(points, "points"), np.diff(points, axis=0)
    ahead = np.einsum("ki,ki->k", chords[1:], chords[:-1])
    noise = np.median(np.sum(np.diff(chords, axis=0) ** 2, axis=1)) / _SECOND_DIFFERENCES
    if ahead.min() <= -_BACK * noise:
        k = int(np.argmin(ahead)) + 1
        raise DefinitionError(f"points[{k}]: the points turn back there; they must be ordered from base to tip")
    return np.asarray(reached / reached[-1])


def _across(normal: Any, tangent: Array) -> Array:
    """Check that the direction of x at the base is not along the tangent, and normalize it."""
    vector = array(normal, "normal", (3,))
    size = float(np.linalg.norm(vector))
    if size == 0.0 or np.linalg.norm(np.cross(vector, tangent)) <= _PARALLEL * size:
        raise DefinitionError(
            f"normal = {vector.tolist()} must point away from the tangent at the base, {tangent.round(4).tolist()}"
        )
    return vector / size
