"""Solution of a force estimation: estimates, errors, consistency, and model errors that look like forces."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import TYPE_CHECKING, Any, Self

import attrs
import numpy as np

from ..calibration.uncertainty import OPEN, TAKES_PART, combination
from ..checks import Array, array, dimensions, frozen
from ..errors import DefinitionError
from ..estimation.chi_square import p_value
from ..estimation.measurements import PositionMeasurement
from ..estimation.places import free
from ..forward.equilibrium import Equilibrium
from ..forward.problem import ForwardProblem
from ..loads.kind import Load
from .case import Case
from .contact_number import Evidence
from .contact_profile import LEVEL, Profile
from .numbers import Estimated, one_or_all
from .search import BLIND, Normal, SearchState
from .spread import Spread
from .systematic import CONSISTENT, Systematic, systematic_errors

if TYPE_CHECKING:
    from scipy.interpolate import BSpline

_SHOWN = 121  # places along a distributed force
_ROUNDING = 1e-15  # of a covariance's largest eigenvalue
_LIKELY = 8.0  # excess loss up to which another solution is reported: e^-8 is 1 in 3,000


@attrs.frozen(eq=False)
class Axis:
    """A principal direction of a force's error, world frame, and the standard deviation along it, N."""

    direction: Array
    standard_deviation: float


def principal(covariance: Array) -> tuple[Array, Array]:
    """Standard deviations along principal axes in ascending order, and the axes as columns; rounding is zero."""
    values, vectors = np.linalg.eigh(covariance)
    return np.sqrt(np.where(values > _ROUNDING * values[-1], values, 0.0)), vectors


class ForceSolution(Estimated):
    """Loads that explain measurements: numbers with errors, consistency, and undetermined directions."""

    def __init__(
        self, forward: ForwardProblem, case: Case, states: list[SearchState], evidence: Sequence[Evidence] = ()
    ) -> None:
        self._forward = forward
        self.states = states
        self.evidence = list(evidence)
        self.case = case
        self.numbered, self.labels = case.numbered, case.numbered.labels
        self.state, self.estimates = states[0], frozen(states[0].x.copy())

    # -- estimates -------------------------------------------------------------------------------------------------

    def density(self, s: Any, number: int | None = None) -> tuple[Array, Array]:
        """The distributed force ``(..., 3)`` at arc lengths ``s``, N/m, and its standard deviations ``(..., 3)``, N/m.

        Parameters
        ----------
        s
            Arc lengths ``(...)``, m. The force is zero outside its interval.
        number
            Index of the unknown load. Default: the first distributed force.

        Raises
        ------
        DefinitionError
            The unknown load is not a :class:`~ctr_opt.DistributedForce`, or there is none.
        """
        if not self.distributed:
            raise DefinitionError("density: there is no DistributedForce among the unknown loads")
        if number is not None and number not in self.distributed:
            raise DefinitionError(f"density: unknown[{number}] is not a DistributedForce; those are {self.distributed}")
        number = self.distributed[0] if number is None else number
        part = self.numbered.parts[number]
        basis = np.nan_to_num(self._splines[number](np.asarray(s, dtype=np.float64)))
        count = basis.shape[-1]
        covariance = self.covariance[part, part].reshape(count, 3, count, 3)
        variances = np.einsum("...i,iaja,...j->...a", basis, covariance, basis)
        return basis @ self.estimates[part].reshape(count, 3), np.sqrt(variances)

    @property
    def distributed(self) -> list[int]:
        """Indices of the unknown loads that are distributed forces."""
        return list(self._splines)

    @property
    def _splines(self) -> dict[int, BSpline[np.float64]]:
        """The spline bases of distributed forces, by the index of the unknown load."""
        return {k: spline for k, one in enumerate(self.numbered.unknown) if (spline := one.spline) is not None}

    def stretch(self, number: int, count: int = _SHOWN) -> Array:
        """Equally spaced arc lengths ``(count,)`` along a distributed force, from its start to its end, m."""
        knots = self._splines[number].t
        return np.linspace(knots[0], knots[-1], count)

    @property
    def arc_length(self) -> Any:
        """Arc length of the force, m, estimated or given; None at the tip. A list for several unknown loads."""
        places = [unknown.place for unknown in self.numbered.unknown]
        for part in self.case.contacts:
            places[self.numbered.parts.index(part)] = float(self.estimates[part.stop - 1])
        return one_or_all(places)

    @property
    def arc_length_error(self) -> Any:
        """Standard deviation of an estimated :attr:`arc_length`, m; None if it is given. A list for several."""
        errors = [float(self.deviations[part.start]) for part in self.numbered.where("arc_length")]
        return one_or_all(errors or [None])

    @cached_property
    def arc_length_set(self) -> Any:
        """Confidence set of an unknown place: intervals ``(start, end)``, m, with 95 % probability.

        The intervals follow from the profile likelihood. Inside them the loss, with forces estimated again, is at most
        1.92 above its minimum. This is half the 95 % quantile of chi-square with one degree of freedom, which holds for
        the squared loss. There are several intervals if the measurements do not distinguish places. Several unknown
        places give a list for each; None if no place is unknown. The computation takes about 0.2 s with compiled code.
        """
        if not self.case.contacts:
            return None
        resting = self.case.resting(self._forward.solve(self.case.experiment.actuation, self.case.experiment.loads))
        profiles = [Profile.of(self.case, part, self.states, resting) for part in self.case.contacts]
        return one_or_all([profile.within(LEVEL) for profile in profiles])

    @cached_property
    def loads(self) -> list[Load]:
        """Known and estimated loads, ready for a :class:`~ctr_opt.ForwardProblem`."""
        return self.case.loads_at(self.estimates)

    @cached_property
    def shape(self) -> Equilibrium:
        """The robot's equilibrium under :attr:`loads`."""
        actuation, z, tubes = self.case.experiment.actuation, self.state.z, len(self.case.robot.tubes)
        guess = self._forward.guess(actuation, self.loads, bending=z[:2], torsional=z[2 : 2 + tubes])
        return self._forward.solve(actuation, self.loads, initial=guess)

    @property
    def is_stable(self) -> bool | None:
        """Whether :attr:`shape` is stable; None if that is not defined. A robot measured at rest should be stable."""
        return self.shape.is_stable

    @cached_property
    def alternatives(self) -> list[Self]:
        """Other solutions that are almost as likely, in order of their loss."""
        alternatives = [state for state in self.states[1:] if state.cost - self.state.cost < _LIKELY]
        return [type(self)(self._forward, self.case, [state]) for state in alternatives]

    # -- errors ----------------------------------------------------------------------------------------------------

    @cached_property
    def _normal(self) -> Normal:
        return Normal.of(self.case.search, self.state)

    @cached_property
    def _scaled(self) -> tuple[Array, Array]:
        """Information on the loads and gradient of the loss, scaled, with the model errors eliminated."""
        scale, (matrix, gradient) = self.case.search.unknowns.scale, self._normal.reduced(len(self.estimates))
        return 0.5 * (matrix + matrix.T) * np.outer(scale, scale), gradient * scale

    @cached_property
    def covariance(self) -> Array:
        """Covariance of the numbers of :attr:`labels`, SI; very large where the measurements determine nothing.

        It includes the errors of the calibration and the actuation, if they were given. If bounds or a surface confine
        a force, it holds mean squared deviations from the estimate, over the allowed forces weighted by their
        likelihood. An active bound does not make the estimate more precise.
        """
        matrix, gradient = self._scaled
        values, vectors = np.linalg.eigh(matrix)
        scaled = np.asarray((vectors / np.maximum(values, BLIND**-2 * 1e-6)) @ vectors.T)
        scale = self.case.search.unknowns.scale
        if self.case.bounded:
            known = values > BLIND**-2
            along = vectors[:, known]
            free = Spread(-along @ ((along.T @ gradient) / values[known]), scaled)
            scaled = self.case.possible(free, self.estimates).about_zero
        return frozen(scaled * np.outer(scale, scale))

    def position(self, s: Any) -> tuple[Array, Array]:
        """Backbone positions ``(..., 3)``, m, at arc lengths ``s``, and covariances ``(..., 3, 3)``, m^2.

        The covariance includes, to first order, the errors of the loads, and those of the calibration and the actuation
        if they were given. The position is that of :attr:`shape`, corrected for the estimated errors of calibration and
        actuation.

        Raises
        ------
        DefinitionError
            An arc length is not on the robot.

        Examples
        --------
        >>> import ctr_opt as ctr
        >>> rod = ctr.Robot([ctr.Tube("rod", 1e-3, 0.0, ctr.Arc(0.1, 10.0), youngs_modulus=60e9, poisson_ratio=0.3)])
        >>> held = ctr.Actuation([0.0], [0.0])
        >>> seen = ctr.ForwardProblem(rod).solve(held).position([0.05, 0.1])
        >>> problem = ctr.ForceEstimationProblem(rod, [ctr.TipForce()])
        >>> estimate = problem.solve(held, ctr.PositionMeasurement([0.05, 0.1], seen, sigma=1e-4))
        >>> position, covariance = estimate.position(0.1)
        >>> position.shape, bool(covariance[1, 1] < 1e-8)
        ((3,), True)
        """
        arc_lengths = array(s, "s", (None,) * dimensions(s), unit="m")
        places = self.shape.shape.inside(arc_lengths.ravel(), self.shape.length, "the robot")
        seen = PositionMeasurement(places, np.zeros((len(places), 3)), sigma=1.0)
        slopes = self.case.slopes_of(seen, self.state, lambda: self.shape.solved().steps).reshape(len(places), 3, -1)
        k, matrix = len(self.estimates), self._normal.matrix
        gain = np.linalg.solve(matrix[k:, k:], matrix[k:, :k])
        by_loads, by_errors = slopes[:, :, :k] - slopes[:, :, k:] @ gain, slopes[:, :, k:]
        covariances = by_loads @ self.covariance @ by_loads.transpose(0, 2, 1)
        covariances += by_errors @ np.linalg.solve(matrix[k:, k:], by_errors.transpose(0, 2, 1))
        positions = self.shape.position(places) + slopes[:, :, k:] @ self.state.e
        shape = arc_lengths.shape
        return positions.reshape(*shape, 3), np.asarray(covariances.reshape(*shape, 3, 3))

    @cached_property
    def axes(self) -> Any:
        """Principal axes (:class:`Axis`) of the force's error, the most precise first; a list of them for each force.

        Standard deviations are zero across the normal of a frictionless surface.
        """
        axes = []
        for covariance in self.force_covariance.reshape(-1, 3, 3):
            deviations, vectors = principal(covariance)
            axes.append([Axis(vectors[:, i], float(deviations[i])) for i in range(3)])
        return one_or_all(axes)

    @property
    def characteristic_force(self) -> float:
        """Characteristic force, N: bending stiffness of the innermost tube over the robot's length squared."""
        return float(self.case.robot.tubes[0].bending_stiffness / self.case.search.length**2)

    @cached_property
    def undetermined(self) -> list[str]:
        """Undetermined directions in words: those with a scaled standard deviation above 3.

        For a distributed force these are intervals in which its density along an axis is undetermined.
        """
        scale, whole = self.case.search.unknowns.scale, np.array(self.numbered.fields) != "density"
        variances, vectors = np.linalg.eigh((self.covariance / np.outer(scale, scale))[np.ix_(whole, whole)])
        directions = np.zeros((len(variances), len(scale)))
        directions[:, whole] = vectors.T
        described = [
            self._described(vector, np.sqrt(variance) if variance < BLIND**2 else np.inf)
            for variance, vector in zip(variances[::-1], directions[::-1], strict=True)
            if variance > OPEN**2
        ]
        return described + [stretch for number in self.distributed for stretch in self._open_stretches(number)]

    def _open_stretches(self, number: int) -> list[str]:
        """Intervals in which the density of an unknown load is undetermined, for each axis."""
        s, unit = self.stretch(number), self.characteristic_force / self.case.search.length
        stretches = []
        for axis, errors in zip("xyz", self.density(s, number)[1].T / unit, strict=True):
            edges = np.flatnonzero(np.diff(errors > OPEN, prepend=False, append=False)).reshape(-1, 2)
            if len(edges):
                where = " and ".join(f"{1e3 * s[first]:.0f} to {1e3 * s[last - 1]:.0f} mm" for first, last in edges)
                most = errors.max()
                size = f"sd up to {most * unit:.2g} N/m" if most < BLIND else "no information in places"
                stretches.append(f"force per length along {axis}, {where}: undetermined, {size}")
        return stretches

    def _described(self, vector: Array, deviation: float) -> str:
        scale = self.case.search.unknowns.scale
        vector = vector * np.sign(vector[np.argmax(np.abs(vector))])
        moving = np.flatnonzero(np.abs(vector) > TAKES_PART)
        names = [self.labels[k] for k in moving]
        what = combination(names, vector[moving]) if len(names) > 1 else names[0]
        forces, unit = [k for k in range(len(vector)) if self.case.forces[k]], "SI"
        if len(self.numbered.where("force")) == 1 and np.linalg.norm(vector[forces]) > 0.99:
            s = self.shape.length if self.arc_length is None else self.arc_length
            along, unit = abs(float(vector[forces] @ self.shape.pose(s)[:3, 2])), "N"
            what = "axial force" if along > 0.95 else f"force along ({', '.join(f'{x:.2f}' for x in vector[forces])})"
        size = float(np.linalg.norm(deviation * scale * vector)) if np.isfinite(deviation) else np.inf
        return f"{what}: undetermined, {f'sd {size:.2g} {unit}' if np.isfinite(size) else 'no information'}"

    @cached_property
    def systematic(self) -> list[Systematic]:
        """Systematic model errors (:class:`Systematic`): detectable sizes, and the forces that they mimic.

        The errors are shifts and tilts of the base, and curvatures and stiffnesses of the tubes. Each has the smallest
        size that :attr:`consistent` detects with 95 % probability, to first order and for the squared loss. Errors that
        a given calibration or actuation already includes mimic smaller forces.

        Examples
        --------
        >>> import ctr_opt as ctr
        >>> rod = ctr.Robot([ctr.Tube("rod", 1e-3, 0.0, ctr.Arc(0.1, 10.0), youngs_modulus=60e9, poisson_ratio=0.3)])
        >>> held = ctr.Actuation([0.0], [0.0])
        >>> seen = ctr.ForwardProblem(rod).solve(held).position([0.05, 0.1])
        >>> problem = ctr.ForceEstimationProblem(rod, [ctr.TipForce()])
        >>> estimate = problem.solve(held, ctr.PositionMeasurement([0.05, 0.1], seen, sigma=1e-4))
        >>> print(estimate.systematic[2])
        shift of the base along z: detected from 0.35 mm, which adds 0.065 N
        """
        return systematic_errors(self.case, self.state, self.degrees_of_freedom, lambda: self.shape.solved().steps)

    # -- consistency -----------------------------------------------------------------------------------------------

    @cached_property
    def chi_squared(self) -> float:
        """Sum of squared residuals and of squared deviations from priors, each over its variance."""
        d = self.estimates - self.case.search.unknowns.prior_mean
        known = d @ self.case.search.unknowns.prior_information @ d + self.state.e @ self.state.e
        return float(self.state.misfit @ self.state.misfit + known)

    @cached_property
    def degrees_of_freedom(self) -> int:
        """Number of measured values and priors, minus the number of estimated values."""
        places = int(free(self.state.places, self.case.search.blocks.orders).any(axis=0).sum())
        priors = int(np.linalg.matrix_rank(self.case.search.unknowns.prior_information))
        ways = self.case.ways(self.state)
        seen = int((np.linalg.eigvalsh(ways.T @ self._scaled[0] @ ways) > BLIND**-2).sum())
        return max(len(self.state.misfit) + priors - places - seen, 0)

    @property
    def p_value(self) -> float:
        """Probability of residuals at least this large; not a number without degrees of freedom."""
        return p_value(self.chi_squared, self.degrees_of_freedom)

    @property
    def consistent(self) -> bool | None:
        """Whether model and noise explain the residuals, at 5 %; None without degrees of freedom."""
        return None if np.isnan(self.p_value) else bool(self.p_value >= CONSISTENT)
