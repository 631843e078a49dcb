"""Unknown distributed force: a spline along a tube, which the model takes as pieces of constant density."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar

import attrs
import numpy as np

from ..checks import ANY_EQ, Array, Entry, described, unchecked
from ..errors import DefinitionError
from ..layout.ends import Ends
from ..loads import place
from ..loads.distributed import DistributedLoad
from ..loads.kind import Load
from .unknown import Gaussian, UnknownLoad, UnknownNumbers, limits, vector

if TYPE_CHECKING:
    from scipy.interpolate import BSpline

_PIECES = 2  # of constant density, in every interval between knots
_DEGREES = 2, 5
_STIFFEST = 1e12  # information on a coefficient, in its scale, by its smoothness


@attrs.frozen(slots=False)
class DistributedForce(UnknownLoad):
    """An unknown force per length along a tube, N/m, world frame: a spline ``f(s)`` with equally spaced knots.

    A smoothness prior penalizes the second derivative: ``-log p(f) = w / 2 * integral |f''(s)|^2 ds + const``.
    Constant and linear ``f`` have no penalty.

    Parameters
    ----------
    coefficients
        Number of spline coefficients for each axis; larger than the degree.
    start, end
        Interval on which the force acts, m from the entry point. ``end=None``: up to the tube's distal end.
    tube
        Number of the tube that carries the force.
    degree
        Degree of the spline, 2 to 5; 3 is a cubic spline.
    smoothness
        The weight ``w``, m^5/N^2. None: the weight is chosen by the marginal likelihood (evidence) of the linearized
        problem. We take the smallest weight whose evidence is within a factor ``e^2`` of the maximum, and repeat with
        the Gauss-Newton steps until both agree.
    prior
        Mean and standard deviation of every coefficient, N/m, as for :class:`TipForce`. The spline stays between its
        least and largest coefficient. Default: only the smoothness prior. Axial forces hardly bend the backbone:
        without a prior the search may be long, and the axial estimate may be very large.
    bounds
        The least and the largest value of every coefficient, and so of the density, N/m, as for :class:`TipForce`.

    Notes
    -----
    The model replaces the spline by pieces of constant density, two between knots. Each piece has the spline's mean
    over it. The total force is therefore exact, and moments differ by the square of the piece's length.

    Examples
    --------
    >>> force = DistributedForce(coefficients=6, end=0.1)
    >>> len(force.loads()), force.mixing.shape
    (6, (18, 18))
    """

    kind = "distributed_force"
    entries = described(
        coefficients=Entry("whole", least=_DEGREES[0] + 1, most=1000),
        **place.SPAN,
        degree=Entry("whole", least=_DEGREES[0], most=_DEGREES[1]),
        smoothness=Entry("m^5/N^2", above=0.0, optional=True),
    )
    in_file: ClassVar[Mapping[str, Any]] = {
        "prior?": {name: Entry("N/m", (3,), scalar_too=True) for name in ("mean", "sigma")},
        "bounds?": Entry("N/m", (2,)),
    }
    force_prior = False
    steady = False
    coefficients: int = attrs.field(default=12, converter=unchecked)
    start: float = attrs.field(default=0.0, converter=unchecked)
    end: float | None = attrs.field(default=None, converter=unchecked)
    tube: int = attrs.field(default=0, converter=unchecked)
    degree: int = attrs.field(default=3, converter=unchecked)
    smoothness: float | None = attrs.field(default=None, converter=unchecked)
    prior: Any = attrs.field(default=None, eq=ANY_EQ, hash=False)
    bounds: Any = attrs.field(default=None, eq=ANY_EQ, hash=False)

    def __attrs_post_init__(self) -> None:
        super().__attrs_post_init__()
        place.check_interval(self.start, self.end)
        if self.coefficients <= self.degree:
            raise DefinitionError(f"coefficients = {self.coefficients} must be above the degree, {self.degree}")

    def placed(self, ends: Ends) -> DistributedForce:
        """The force on a robot with tube ends ``ends``; an open ``end`` becomes the tube's."""
        end = ends.of(self.tube)
        if self.start >= end or (self.end is not None and not ends.reaches(self.tube, self.end)):
            raise DefinitionError(
                f"a distributed force from {self.start:g} to {self.end or end:g} m is not on tube {self.tube}, which "
                f"ends at {end:g} m"
            )
        return self if self.end is not None and self.end <= end else attrs.evolve(self, end=end)

    @cached_property
    def spline(self) -> BSpline[np.float64]:
        """The basis splines, ``(coefficients,)`` at an arc length."""
        from scipy.interpolate import BSpline

        inner = np.linspace(self.start, self._end, self.coefficients - self.degree + 1)
        knots = np.concatenate(([self.start] * self.degree, inner, [self._end] * self.degree))
        return BSpline(knots, np.eye(self.coefficients), self.degree, extrapolate=False)

    @property
    def _end(self) -> float:
        if self.end is None:
            raise DefinitionError("end = None: the tube's end is unknown without the robot's actuation; give end")
        return self.end

    @cached_property
    def _edges(self) -> Array:
        return np.linspace(self.start, self._end, _PIECES * (self.coefficients - self.degree) + 1)

    def loads(self) -> list[Load]:
        """The pieces of constant density, all zero."""
        both = zip(self._edges[:-1].tolist(), self._edges[1:].tolist(), strict=True)
        return [DistributedLoad(np.zeros(3), start=start, end=end, tube=self.tube) for start, end in both]

    @property
    def unknown_numbers(self) -> tuple[UnknownNumbers, ...]:
        """The unknown coefficients, three numbers each."""
        return tuple(UnknownNumbers(0, "density", 3, vector(f"force_density[{k}]")) for k in range(self.coefficients))

    @property
    def taken(self) -> list[tuple[int, str]]:
        """The load fields that the model reads: the density of every piece."""
        return [(k, "force") for k in range(len(self._edges) - 1)]

    @cached_property
    def mixing(self) -> Array:
        """Means of the spline over the pieces, as a matrix on its coefficients."""
        integrals = np.diff(self.spline.antiderivative()(self._edges), axis=0)
        return np.asarray(np.kron(integrals / np.diff(self._edges)[:, None], np.eye(3)), dtype=np.float64)

    @cached_property
    def resultant(self) -> Array:
        """The total force, as a matrix ``(3, 3 coefficients)`` on the coefficients."""
        whole_spline = np.diff(self.spline.antiderivative()([self.start, self._end]), axis=0)
        return np.asarray(np.kron(whole_spline, np.eye(3)), dtype=np.float64)

    @cached_property
    def roughness(self) -> Array:
        """The integral of ``|f''|^2`` as a quadratic form of the coefficients."""
        nodes, weights = np.polynomial.legendre.leggauss(self.degree)
        knots = np.unique(self.spline.t)
        half = 0.5 * np.diff(knots)[:, None]
        s, weights = (knots[:-1, None] + half * (1.0 + nodes)).ravel(), (half * weights).ravel()
        second = self.spline.derivative(2)(s)
        return np.asarray(np.kron(second.T @ (weights[:, None] * second), np.eye(3)), dtype=np.float64)

    @property
    def known_before(self) -> Gaussian:
        """The prior of the coefficients, with the smoothness prior if its weight is given."""
        prior = Gaussian.of(self.prior, "prior", 3)
        mean, information = (np.zeros(3), np.zeros((3, 3))) if prior is None else (prior.mean, prior.information)
        count = self.coefficients
        information = np.asarray(np.kron(np.eye(count), information), dtype=np.float64)
        if self.smoothness is not None:
            information += self.smoothness * self.roughness
        return Gaussian(np.tile(mean, count), information)

    @property
    def limits(self) -> tuple[Array, Array]:
        """The bounds of all coefficients."""
        lower, upper = limits(self.bounds, "bounds", 3)
        return np.tile(lower, self.coefficients), np.tile(upper, self.coefficients)

    @property
    def roughly(self) -> bool:
        """Whether the weight of the smoothness prior must be estimated."""
        return self.smoothness is None

    def check_scale(self, scale: Array, field: str) -> None:
        """Raise ``DefinitionError`` for a weight whose rounding errors would swamp the measurements."""
        if self.smoothness is None:
            return
        most = _STIFFEST / float(np.linalg.eigvalsh(self.roughness)[-1] * scale.max() ** 2)
        if self.smoothness > most:
            raise DefinitionError(
                f"{field}.smoothness = {self.smoothness:g} m^5/N^2 must be at most {most:.1e}: a smaller weight "
                "already gives a straight line"
            )
