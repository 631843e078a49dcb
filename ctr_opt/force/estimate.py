"""What is known of the loads on a robot after it was measured: estimates, errors, consistency, and what they hide."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import TYPE_CHECKING, Any

import attrs
import numpy as np

from ..checks import Array, array
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
from .search import BLIND, Normal, State
from .spread import Spread
from .systematic import CONSISTENT, Systematic, systematic_errors

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from scipy.interpolate import BSpline

OPEN = 3.0  # characteristic forces: with a larger standard deviation a direction is undetermined
_SHOWN = 121  # places along a distributed force
_ROUNDING = 1e-15  # of a covariance's largest eigenvalue
_MANY = 8  # numbers: with more of them, the forces alone are told
_LIKELY = 8.0  # excess loss up to which another solution is told: e^-8 is 1 in 3,000


@attrs.frozen(eq=False)
class Axis:
    """A principal direction of a force's error, world frame, and the standard deviation along it, N (or infinite)."""

    direction: Array
    standard_deviation: float


def principal(covariance: Array) -> tuple[Array, Array]:
    """Standard deviations along principal axes, the least first, and the axes as columns; rounding is zero."""
    values, vectors = np.linalg.eigh(covariance)
    return np.sqrt(np.where(values > _ROUNDING * values[-1], values, 0.0)), vectors


class ForceEstimate:
    """The result of a :class:`~ctr_opt.ForceEstimationProblem`.

    Attributes
    ----------
    labels
        A name for each number: the rows and columns of :attr:`covariance`.
    states
        Solutions, that of least loss first.
    evidence
        Where the number of :class:`~ctr_opt.Contacts` was sought: loss and criterion by number.
    """

    def __init__(
        self, forward: ForwardProblem, case: Case, states: list[State], evidence: Sequence[Evidence] = ()
    ) -> None:
        self._forward = forward
        self.states = states
        self.evidence = list(evidence)
        self.case = case
        self.labels = case.numbered.labels
        self.state = states[0]

    # -- estimates -------------------------------------------------------------------------------------------------

    @property
    def estimates(self) -> Array:
        """All numbers, SI, in the order of :attr:`labels`."""
        return self.state.x

    @cached_property
    def values(self) -> dict[str, float]:
        """The same by name."""
        return dict(zip(self.labels, self.state.x.tolist(), strict=True))

    @property
    def force(self) -> Array:
        """The force ``(3,)``, N, world frame, of a distributed one the total; of several unknown loads ``(k, 3)``."""
        found = [rows @ self.state.x for rows in self.case.numbered.resultants]
        return np.array(found) if len(found) > 1 else found[0]

    def density(self, s: Any, number: int | None = None) -> tuple[Array, Array]:
        """The distributed force ``(..., 3)`` at arc lengths ``s``, N/m, and its standard deviations.

        Zero where it does not act. ``number``: of which unknown load; None: of the first distributed force.

        Raises
        ------
        DefinitionError
            None is sought.
        """
        if not self.distributed:
            raise DefinitionError("density: no DistributedForce is among the unknown loads")
        if number is not None and number not in self.distributed:
            raise DefinitionError(f"density: unknown[{number}] is no DistributedForce; these are {self.distributed}")
        number = self.distributed[0] if number is None else number
        part = self.case.numbered.parts[number]
        basis = np.nan_to_num(self._splines[number](np.asarray(s, dtype=np.float64)))
        count = basis.shape[-1]
        covariance = self.covariance[part, part].reshape(count, 3, count, 3)
        variances = np.einsum("...i,iaja,...j->...a", basis, covariance, basis)
        return basis @ self.state.x[part].reshape(count, 3), np.sqrt(variances)

    @property
    def distributed(self) -> list[int]:
        """Which unknown loads are distributed forces."""
        return list(self._splines)

    @property
    def _splines(self) -> dict[int, BSpline[np.float64]]:
        """The bases of distributed forces, by the number of the unknown load."""
        return {k: spline for k, each in enumerate(self.case.numbered.unknown) if (spline := each.spline) is not None}

    def stretch(self, number: int, count: int = _SHOWN) -> Array:
        """So many arc lengths along a distributed force, from its start to its end, m."""
        knots = self._splines[number].t
        return np.linspace(knots[0], knots[-1], count)

    @property
    def moment(self) -> Array | None:
        """The moment at the tip ``(3,)``, N m; None where none is sought."""
        found = [self.state.x[part] for part in self.case.numbered.where("moment")]
        return found[0] if found else None

    @property
    def arc_length(self) -> Any:
        """Where the force acts, m, as estimated or given; None: at the tip. Of several unknown loads a list."""
        found = []
        for part, unknown in zip(self.case.numbered.parts, self.case.numbered.unknown, strict=True):
            found.append(float(self.state.x[part.stop - 1]) if unknown.somewhere else unknown.place)
        return found if len(found) > 1 else found[0]

    @property
    def arc_length_error(self) -> Any:
        """Its standard deviation, m, where it is estimated; of several a list."""
        errors = [float(self.deviations[part.start]) for part in self.case.numbered.where("arc_length")]
        return errors if len(errors) > 1 else errors[0] if errors else None

    @cached_property
    def arc_length_set(self) -> Any:
        """Where the contact can be: a list of intervals ``(start, end)``, m, that hold its place with 95 % probability.

        By profile likelihood: at every place in them the loss, with forces estimated anew, is no more than 1.92 above
        the least, half the 95 % quantile of chi-square with one degree of freedom (which is meant for the squared
        loss). Several intervals where measurements do not tell places apart. Of several unknown places a list for each;
        None where none is unknown. It takes a walk along the tube, some 0.2 s with compiled code.
        """
        found = [profile.within(LEVEL) for profile in self._profiles]
        return found if len(found) > 1 else found[0] if found else None

    @cached_property
    def _profiles(self) -> list[Profile]:
        """Of the loss, by each unknown place."""
        resting = self.case.resting(self._forward.solve(self.case.experiment.actuation, self.case.experiment.loads))
        return [Profile.of(self.case, part, self.states, resting) for part in self.case.contacts]

    @cached_property
    def loads(self) -> list[Load]:
        """The known loads and those estimated, ready for a :class:`~ctr_opt.ForwardProblem`."""
        return self.case.loads_at(self.state.x)

    @cached_property
    def shape(self) -> Equilibrium:
        """The equilibrium under these loads."""
        actuation, z, tubes = self.case.experiment.actuation, self.state.z, len(self.case.robot.tubes)
        guess = self._forward.guess(actuation, self.loads, bending=z[:2], torsional=z[2 : 2 + tubes])
        return self._forward.solve(actuation, self.loads, initial=guess)

    @property
    def is_stable(self) -> bool | None:
        """Whether the shape is stable, where that is defined: a robot that was seen at rest is."""
        return self.shape.is_stable

    @cached_property
    def alternatives(self) -> list[ForceEstimate]:
        """Other solutions that are not much less likely, the likeliest first."""
        others = [state for state in self.states[1:] if state.cost - self.state.cost < _LIKELY]
        return [ForceEstimate(self._forward, self.case, [state]) for state in others]

    # -- errors ----------------------------------------------------------------------------------------------------

    @cached_property
    def _normal(self) -> Normal:
        return Normal.of(self.case.search, self.state)

    @cached_property
    def _scaled(self) -> tuple[Array, Array]:
        """Information on the loads and the loss's gradient, in their scales; errors of other numbers taken out."""
        k, scale = len(self.state.x), self.case.search.sought.scale
        matrix, gradient = self._normal.matrix, self._normal.gradient
        if len(matrix) > k:
            gain = np.linalg.solve(matrix[k:, k:], matrix[k:, :k]).T
            matrix, gradient = matrix[:k, :k] - gain @ matrix[k:, :k], gradient[:k] - gain @ gradient[k:]
        return 0.5 * (matrix + matrix.T) * np.outer(scale, scale), gradient * scale

    @cached_property
    def covariance(self) -> Array:
        """Covariance of the numbers of :attr:`labels`, SI; huge where the measurements say nothing.

        Of normal errors, with those of the calibration and the actuation, if they were given. Where bounds or a surface
        confine a force, mean squared deviations from the estimate of what is possible and as likely as measured: at an
        edge a force is not known better for it.
        """
        matrix, gradient = self._scaled
        values, vectors = np.linalg.eigh(matrix)
        found = np.asarray((vectors / np.maximum(values, BLIND**-2 * 1e-6)) @ vectors.T)
        scale = self.case.search.sought.scale
        if self.case.bounded:
            known = values > BLIND**-2
            along = vectors[:, known]
            free = Spread(-along @ ((along.T @ gradient) / values[known]), found)
            found = self.case.possible(free, self.state.x).about_zero
        return found * np.outer(scale, scale)

    def position(self, s: Any) -> tuple[Array, Array]:
        """Where the backbone is at arc lengths ``s``: positions ``(..., 3)``, m, and covariances ``(..., 3, 3)``, m^2.

        The errors of the loads move the robot, and those of the calibration and of the actuation, if they were given,
        to first order: the position is that of :attr:`shape`, which knows nothing of the latter, and what they add.

        Raises
        ------
        DefinitionError
            An arc length that is not on the robot.

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
        given = array(s, "s", (None,) * np.ndim(s), unit="m")
        places = self.shape.shape.inside(given.ravel(), self.shape.length, "the robot")
        seen = PositionMeasurement(places, np.zeros((len(places), 3)), sigma=1.0)
        slopes = self.case.slopes_of(seen, self.state, lambda: self.shape.solved().steps).reshape(len(places), 3, -1)
        k, matrix = len(self.state.x), self._normal.matrix
        gain = np.linalg.solve(matrix[k:, k:], matrix[k:, :k])
        by_loads, by_errors = slopes[:, :, :k] - slopes[:, :, k:] @ gain, slopes[:, :, k:]
        found = by_loads @ self.covariance @ by_loads.transpose(0, 2, 1)
        found += by_errors @ np.linalg.solve(matrix[k:, k:], by_errors.transpose(0, 2, 1))
        positions = self.shape.position(places) + slopes[:, :, k:] @ self.state.e
        return positions.reshape(*given.shape, 3), np.asarray(found.reshape(*given.shape, 3, 3))

    @cached_property
    def deviations(self) -> Array:
        """Standard deviations of the numbers of :attr:`labels`, SI."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def force_covariance(self) -> Array:
        """Covariance of :attr:`force`, N^2: ``(3, 3)``, of several ``(k, 3, 3)``."""
        found = [rows @ self.covariance @ rows.T for rows in self.case.numbered.resultants]
        return np.array(found) if len(found) > 1 else found[0]

    @cached_property
    def axes(self) -> Any:
        """Principal :class:`Axis` of the force's error, the best known first; of several forces a list for each.

        Standard deviations are zero across the normal of a surface without friction.
        """
        found = []
        for rows in self.case.numbered.resultants:
            deviations, vectors = principal(rows @ self.covariance @ rows.T)
            found.append([Axis(vectors[:, i], float(deviations[i])) for i in range(3)])
        return found if len(found) > 1 else found[0]

    @property
    def characteristic_force(self) -> float:
        """N: bending stiffness of the innermost tube over the robot's length squared."""
        return float(self.case.robot.tubes[0].bending_stiffness / self.case.search.length**2)

    @cached_property
    def undetermined(self) -> list[str]:
        """What the measurements cannot tell, in words: directions with a standard deviation of ``OPEN`` and more.

        Of a distributed force the places where its density along an axis has so large a one, over the length.
        """
        numbered, scale = self.case.numbered, self.case.search.sought.scale
        own = np.ones(len(self.labels), dtype=bool)
        for part in numbered.where("density"):
            own[part] = False
        within = self.covariance[np.ix_(own, own)] / np.outer(scale[own], scale[own])
        variances, vectors = np.linalg.eigh(within)
        found = []
        for variance, vector in zip(variances[::-1], vectors.T[::-1], strict=True):
            if variance > OPEN**2:
                whole = np.zeros(len(scale))
                whole[own] = vector
                found.append(self._described(whole, np.sqrt(variance) if variance < BLIND**2 else np.inf))
        return found + [told for number in self.distributed for told in self._open_stretches(number)]

    def _open_stretches(self, number: int) -> list[str]:
        """Where the density of an unknown load is not known, along each axis."""
        s = self.stretch(number)
        errors = self.density(s, number)[1] / self.characteristic_force * self.case.search.length
        found = []
        for axis, own in zip("xyz", errors.T, strict=True):
            edges = np.flatnonzero(np.diff(np.concatenate(([False], own > OPEN, [False])).astype(int)))
            every = [1e3 * s[[first, last - 1]] for first, last in zip(edges[::2], edges[1::2], strict=True)]
            if every:
                where = " and ".join(f"{start:.0f} to {end:.0f} mm" for start, end in every)
                size = float(own.max()) * self.characteristic_force / self.case.search.length
                told = f"sd up to {size:.2g} N/m" if own.max() < BLIND else "nothing is known in places"
                found.append(f"force per length along {axis}, {where}: undetermined, {told}")
        return found

    def _described(self, vector: Array, deviation: float) -> str:
        scale = self.case.search.sought.scale
        vector = vector * np.sign(vector[np.argmax(np.abs(vector))])
        parts = [(vector[k], label) for k, label in enumerate(self.labels) if abs(vector[k]) > 0.05]
        terms = " ".join(f"{'-' if part < 0.0 else '+'} {abs(part):.2g} {label}" for part, label in parts)
        what = terms.removeprefix("+ ") if len(parts) > 1 else parts[0][1]
        forces, unit = [k for k in range(len(vector)) if self.case.forces[k]], "SI"
        if len(self.case.numbered.where("force")) == 1 and np.linalg.norm(vector[forces]) > 0.99:
            along, unit = abs(float(vector[forces] @ self._tangent)), "N"
            what = "axial force" if along > 0.95 else f"force along ({', '.join(f'{x:.2f}' for x in vector[forces])})"
        size = float(np.linalg.norm(deviation * scale * vector)) if np.isfinite(deviation) else np.inf
        told = f"sd {size:.2g} {unit}" if np.isfinite(size) else "nothing is known"
        return f"{what}: undetermined, {told}"

    @cached_property
    def _tangent(self) -> Array:
        place = self.arc_length
        s = self.shape.length if place is None else place
        return np.asarray(self.shape.pose(s)[:3, 2])

    @cached_property
    def systematic(self) -> list[Systematic]:
        """The smallest :class:`Systematic` errors of each kind that :attr:`consistent` would show with 95 %.

        And the forces for which they would be mistaken: shifts and tilts of the base, curvatures and stiffnesses of
        the tubes, to first order and for the squared loss. Those of a calibration or actuation whose errors are
        counted are mistaken for less.

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
        """Sum of the squared residuals over their variances, and of deviations from priors over theirs."""
        d = self.state.x - self.case.search.sought.prior_mean
        known = d @ self.case.search.sought.prior_information @ d + self.state.e @ self.state.e
        return float(self.state.misfit @ self.state.misfit + known)

    @cached_property
    def degrees_of_freedom(self) -> int:
        """Numbers measured, and known by priors, less those estimated."""
        ways = free(self.state.places, self.case.search.blocks.orders)
        places = int((ways.any(axis=0)).sum())
        priors = int(np.linalg.matrix_rank(self.case.search.sought.prior_information))
        ways = self.case.ways(self.state)
        seen = int((np.linalg.eigvalsh(ways.T @ self._scaled[0] @ ways) > BLIND**-2).sum())
        return max(len(self.state.misfit) + priors - places - seen, 0)

    @property
    def p_value(self) -> float:
        """Probability of residuals so large; not a number where nothing is left over."""
        return p_value(self.chi_squared, self.degrees_of_freedom)

    @property
    def consistent(self) -> bool | None:
        """Whether the residuals are as small as model and noise say (at 5 %); None where nothing is left over."""
        return None if np.isnan(self.p_value) else bool(self.p_value >= CONSISTENT)

    # -- for people ------------------------------------------------------------------------------------------------

    def report(self) -> str:
        """Loads with their errors, consistency, and what may hide behind them, as text."""
        from .report import force_report

        return force_report(self)

    def plot(self) -> Figure:
        """The shape beside what was measured, and confidence ellipses of the force."""
        from .plot import figure_force

        return figure_force(self)

    def __repr__(self) -> str:
        if len(self.labels) > _MANY:
            return f"<ForceEstimate: {len(self.labels)} numbers, force = {np.round(self.force, 4).tolist()} N>"
        told = ", ".join(
            f"{label} = {x:.4g} +- {s:.2g}" for (label, x), s in zip(self.values.items(), self.deviations, strict=True)
        )
        return f"<ForceEstimate: {told}>"
