"""Linear smoothers of points along a curve: polynomials and penalized splines, chosen by cross-validation."""

from __future__ import annotations

from typing import Any

import attrs
import numpy as np

from ..checks import Array
from ..errors import DefinitionError

DEGREE = 5  # of splines: their curvature is smooth
_ROUGH = 4  # the derivative that is penalized: the third would hold the slope of the curvature down at the ends
_INTERVALS = 16  # of a spline, at most: the penalty smooths, not the knots
_LARGEST_ORDER = 12  # of polynomials tried
_PENALTIES = 10.0 ** np.arange(6.0, -6.01, -0.5)  # tried, relative to the data
_NEWTON_STEPS = 4
_FINE = 401
_BEYOND = 0.01  # distance beyond the ends up to which splines are followed
# Standard errors by which an error may exceed the least: measured, so that 95 percent bands cover the truth in 95.
_ALLOWANCES = {"polynomial": 1.0, "spline": 0.5}
LEAST_FREEDOM = 0.25  # of the residuals of a coordinate, to estimate noise from
_LEVERAGE = 1.0 - 1e-6  # a point that alone decides its own fit cannot be left out


@attrs.frozen(eq=False)
class Basis:
    """Basis functions of a parameter in ``[0, 1]``, with the penalty of their roughness.

    ``functions(t, n)`` returns their n-th derivatives ``(len(t), m)``.
    """

    functions: Any
    penalty: Array

    @property
    def size(self) -> int:
        """Number of functions."""
        return len(self.penalty)

    def clamped(self) -> Basis:
        """Basis of all combinations of the functions that have no slope at 0."""
        slopes = self.functions(np.zeros(1), 1)
        kept = np.linalg.svd(slopes)[2][1:].T
        return Basis(lambda t, n=0: self.functions(t, n) @ kept, kept.T @ self.penalty @ kept)


def polynomials(order: int) -> Basis:
    """Legendre polynomials up to an order, orthogonal on ``[0, 1]``."""
    from numpy.polynomial.legendre import legder, legval

    def functions(t: Array, derivative: int = 0) -> Array:
        return np.ascontiguousarray(legval(2.0 * t - 1.0, legder(np.eye(order + 1), derivative, scl=2.0)).T)

    return Basis(functions, np.zeros((order + 1, order + 1)))


def splines(points: int) -> Basis:
    """B-splines on uniform knots; the penalty is the integral of the squared fourth derivative."""
    from scipy.interpolate import BSpline

    intervals = int(np.clip(points // 2, 2, _INTERVALS))
    breaks = np.linspace(0.0, 1.0, intervals + 1)
    knots = np.concatenate((np.zeros(DEGREE), breaks, np.ones(DEGREE)))
    spline = BSpline(knots, np.eye(intervals + DEGREE), DEGREE)

    def functions(t: Array, derivative: int = 0) -> Array:
        return np.asarray(spline(t, nu=derivative))

    nodes, weights = np.polynomial.legendre.leggauss(DEGREE - _ROUGH + 1)
    inner = breaks[:-1, None] + (nodes + 1.0) / (2 * intervals)
    rough = functions(inner.ravel(), _ROUGH)
    return Basis(functions, rough.T @ (np.tile(weights, intervals)[:, None] * rough) / (2 * intervals))


@attrs.frozen(eq=False)
class Data:
    """Points ``(k, 3)``, m, at parameters in ``[0, 1]``, with relative weights ``(k,)``.

    ``slope`` is the derivative of the curve by the parameter at its base, ``(3,)`` m, if it is known.
    """

    points: Array
    parameters: Array
    weights: Array
    slope: Array | None = None


@attrs.frozen(eq=False)
class Smoother:
    """A linear smoother of data: coefficients are ``solver @ (points - parameters * slope)``.

    Attributes
    ----------
    slope
        ``(3,)`` m: the curve of the coefficients plus ``t slope``; zero if the slope at the base is free.
    solver
        ``(m, k)``.
    shrinkage
        ``(m, m)``: covariance of the coefficients by the penalty, per variance of unit weight; zero without penalty.
    leverages
        ``(k,)``, the diagonal of the hat matrix.
    """

    basis: Basis
    data: Data
    slope: Array
    solver: Array
    shrinkage: Array
    leverages: Array

    @classmethod
    def of(cls, basis: Basis, data: Data, factor: float = 0.0) -> Smoother:
        """Make the smoother of weighted least squares with ``factor`` times the penalty, relative to the data."""
        slope = np.zeros(3)
        if data.slope is not None:
            basis, slope = basis.clamped(), data.slope
        values = basis.functions(data.parameters)
        normal = values.T @ (data.weights[:, None] * values)
        scale = np.trace(normal) / np.trace(basis.penalty) if factor else 0.0
        inverse = np.linalg.inv(normal + factor * scale * basis.penalty)
        solver = inverse @ (values.T * data.weights)
        # The posterior of Wahba and Nychka less the spread by noise: on average over the curve, the square of the bias.
        shrinkage = inverse - inverse @ normal @ inverse if factor else np.zeros_like(inverse)
        return cls(basis, data, slope, solver, shrinkage, np.einsum("km,mk->k", values, solver))

    @property
    def freedom(self) -> float:
        """Degrees of freedom of each coordinate's residuals."""
        return float(np.sum(1.0 - self.leverages))

    @property
    def coefficients(self) -> Array:
        """Coefficients of the smooth curve, ``(m, 3)``."""
        return np.asarray(self.solver @ (self.data.points - self.data.parameters[:, None] * self.slope))

    @property
    def residuals(self) -> Array:
        """Points minus their smooth values, ``(k, 3)`` m."""
        return self.data.points - self.curve(self.data.parameters)

    def curve(self, t: Array, derivative: int = 0, coefficients: Array | None = None) -> Array:
        """Evaluate the curve or a derivative, ``(..., len(t), 3)``, smooth or of ``coefficients (..., m, 3)``."""
        weights = self.coefficients if coefficients is None else coefficients
        by_slope = (t[:, None] if derivative == 0 else float(derivative == 1)) * self.slope
        return np.asarray(self.basis.functions(t, derivative) @ weights + by_slope)

    def tangents(self, t: Array) -> Array:
        """Unit tangents ``(len(t), 3)`` of the smooth curve."""
        slopes = self.curve(t, 1)
        return np.asarray(slopes / np.linalg.norm(slopes, axis=-1, keepdims=True))

    def arc_lengths(self) -> tuple[Array, float]:
        """Normalized arc lengths ``(k,)`` of the smooth curve where it is nearest to the points, and its length, m."""
        from scipy.interpolate import CubicSpline

        t = self.data.parameters
        for _ in range(_NEWTON_STEPS):
            shape, slope, bend = (self.curve(t, n) for n in range(3))
            offset, square = shape - self.data.points, np.sum(slope**2, axis=1)
            # At least half of the square: far from the curve Newton's step would lead away from the nearest place.
            curvature = np.maximum(square + np.sum(offset * bend, axis=1), 0.5 * square)
            t = np.clip(t - np.sum(offset * slope, axis=1) / curvature, -_BEYOND, 1.0 + _BEYOND)
        fine = np.linspace(-_BEYOND, 1.0 + _BEYOND, _FINE)
        speed = np.linalg.norm(self.curve(fine, 1), axis=1)
        reached = CubicSpline(fine, speed).antiderivative()(t)
        length = float(reached[-1] - reached[0])
        return np.asarray((reached - reached[0]) / length), length

    def left_out(self) -> Array:
        """Weighted squared distances ``(k,)``, m^2, of points from the curve fitted without them; or infinite."""
        if self.leverages.max() > _LEVERAGE or self.freedom < LEAST_FREEDOM:
            return np.full(len(self.leverages), np.inf)
        distances = np.sum(self.residuals**2, axis=1) / (1.0 - self.leverages) ** 2
        return np.asarray(distances * self.data.weights / self.data.weights.mean())


def _smoothers(method: str, data: Data, parameter: float | None) -> dict[float, Smoother]:
    """Smoothers to try, the simplest first, by order, or by the penalty of splines."""
    if method == "spline":
        basis = splines(len(data.points))
        penalties = _PENALTIES.tolist() if parameter is None else (parameter,)
        return {penalty: Smoother.of(basis, data, penalty) for penalty in penalties}
    most = len(data.points) - 2
    if parameter is not None and parameter > most:
        raise DefinitionError(f"order = {parameter:g} must be at most {most}, with {len(data.points)} points")
    orders = range(2, min(_LARGEST_ORDER, most) + 1) if parameter is None else (int(parameter),)
    return {order: Smoother.of(polynomials(order), data) for order in orders}


def best(method: str, data: Data, parameter: float | None) -> tuple[float, Smoother, dict[float, float]]:
    """Choose an order or penalty: return it, its smoother, and the cross-validation error (rms), m, of each one tried.

    It is the simplest smoother whose error exceeds the least by at most one standard error of the difference (half of
    one for splines; L. Breiman et al., Classification and Regression Trees, 1984, 3.4.3). The smoother of least error
    sometimes has far too many degrees of freedom, which harm curvatures more than positions.
    """
    tried = _smoothers(method, data, parameter)
    errors = {key: smoother.left_out() for key, smoother in tried.items()}
    least = min(errors.values(), key=np.sum)
    chosen = next(key for key, value in errors.items() if _as_good(value, least, _ALLOWANCES[method]))
    return chosen, tried[chosen], {key: float(np.sqrt(value.mean())) for key, value in errors.items()}


def _as_good(errors: Array, least: Array, allowance: float) -> bool:
    if errors is least:
        return True
    worse = errors - least
    return bool(np.all(np.isfinite(worse)) and worse.mean() <= allowance * worse.std(ddof=1) / np.sqrt(len(worse)))
