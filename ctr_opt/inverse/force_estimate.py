"""What is known of the loads on a robot after it was measured: estimates, errors, consistency, and what they hide."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import TYPE_CHECKING, Any

import attrs
import numpy as np

from ..equilibrium import Equilibrium
from ..errors import DefinitionError
from ..forward import ForwardProblem
from ..robot.checks import Array
from ..robot.loads import Load
from .contact_number import Evidence
from .contact_profile import LEVEL, Profile
from .distributed_force import DistributedForce
from .force_case import Case
from .force_errors import CONSISTENT, Systematic, systematic_errors
from .load_solver import BLIND, Normal, State
from .places import free

if TYPE_CHECKING:
    from matplotlib.figure import Figure

OPEN = 3.0  # characteristic forces: with a larger standard deviation a direction is undetermined
_MANY, _TERMS = 8, 4  # of so many numbers that a direction is made of the largest are told
_LIKELY = 8.0  # excess loss up to which another solution is told: e^-8 is 1 in 3,000


@attrs.frozen(eq=False)
class Axis:
    """A principal direction of a force's error, world frame, and the standard deviation along it, N (or infinite)."""

    direction: Array
    standard_deviation: float


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

    def density(self, s: Any) -> tuple[Array, Array]:
        """The distributed force ``(..., 3)`` at arc lengths ``s``, N/m, and its standard deviations.

        Zero where it does not act. Of the first one, if several are sought.

        Raises
        ------
        DefinitionError
            None is sought.
        """
        for part, unknown in zip(self.case.numbered.parts, self.case.numbered.unknown, strict=True):
            if isinstance(unknown, DistributedForce):
                basis = np.nan_to_num(unknown.spline(np.asarray(s, dtype=np.float64)))
                count = unknown.coefficients
                covariance = self.covariance[part, part].reshape(count, 3, count, 3)
                variances = np.einsum("...i,iaja,...j->...a", basis, covariance, basis)
                return basis @ self.state.x[part].reshape(count, 3), np.sqrt(variances)
        raise DefinitionError("density: no DistributedForce is among the unknown loads")

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
            sought = any(number.field == "arc_length" for number in unknown.sought)
            found.append(float(self.state.x[part.stop - 1]) if sought else unknown.place)
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
    def _split(self) -> tuple[Array, Array, Array]:
        """Eigenvalues and vectors of the information on the loads, scaled; errors of other numbers taken out."""
        k = len(self.state.x)
        matrix = self._normal.matrix
        if len(matrix) > k:
            matrix = matrix[:k, :k] - matrix[:k, k:] @ np.linalg.solve(matrix[k:, k:], matrix[k:, :k])
        scale, tangent = self.case.search.sought.scale, self.state.tangent
        if tangent is None:
            tangent = np.eye(k)[:, ~self.case.untouched(self.state)]
        ways = np.linalg.qr(tangent / scale[:, None])[0]
        values, vectors = np.linalg.eigh(ways.T @ (0.5 * (matrix + matrix.T) * np.outer(scale, scale)) @ ways)
        return values, ways @ vectors, scale

    @cached_property
    def covariance(self) -> Array:
        """Covariance of the numbers of :attr:`labels`, SI; huge where the measurements say nothing.

        Of normal errors, with those of the calibration and the actuation, if they were given.
        """
        values, vectors, scale = self._split
        variances = 1.0 / np.maximum(values, BLIND**-2 * 1e-6)
        return np.asarray((vectors * variances) @ vectors.T * np.outer(scale, scale))

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
        """Principal :class:`Axis` of the force's error, the best known first; of several forces a list for each."""
        found = []
        for rows in self.case.numbered.resultants:
            values, vectors = np.linalg.eigh(rows @ self.covariance @ rows.T)
            found.append([Axis(vectors[:, i], float(np.sqrt(values[i]))) for i in range(3)])
        return found if len(found) > 1 else found[0]

    @property
    def characteristic_force(self) -> float:
        """N: bending stiffness of the innermost tube over the robot's length squared."""
        return float(self.case.robot.tubes[0].bending_stiffness / self.case.search.length**2)

    @cached_property
    def undetermined(self) -> list[str]:
        """What the measurements cannot tell, in words: directions with a standard deviation of ``OPEN`` and more."""
        values, vectors, _ = self._split
        found = []
        for value, vector in zip(values, vectors.T, strict=True):
            if value < OPEN**-2:
                found.append(self._described(vector, np.sqrt(1.0 / value) if value > BLIND**-2 else np.inf))
        return found

    def _described(self, vector: Array, deviation: float) -> str:
        scale = self.case.search.sought.scale
        parts = [(vector[k], label) for k, label in enumerate(self.labels) if abs(vector[k]) > 0.05]
        largest = sorted(parts, key=lambda part: -abs(part[0]))[:_TERMS] if len(parts) > _MANY else parts
        terms = " ".join(f"{'-' if part < 0.0 else '+'} {abs(part):.2g} {label}" for part, label in largest)
        terms += " and others" if len(largest) < len(parts) else ""
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
        ways = free(self.state.places, self.case.search.seen.orders)
        places = int((ways.any(axis=0)).sum())
        priors = int(np.linalg.matrix_rank(self.case.search.sought.prior_information))
        seen = int((self._split[0] > BLIND**-2).sum())
        return max(len(self.state.misfit) + priors - places - seen, 0)

    @property
    def p_value(self) -> float:
        """Probability of residuals so large; not a number where nothing is left over."""
        from scipy.stats import chi2

        freedom = self.degrees_of_freedom
        return float(chi2.sf(self.chi_squared, freedom)) if freedom else np.nan

    @property
    def consistent(self) -> bool | None:
        """Whether the residuals are as small as model and noise say (at 5 %); None where nothing is left over."""
        return None if np.isnan(self.p_value) else bool(self.p_value >= CONSISTENT)

    # -- for people ------------------------------------------------------------------------------------------------

    def report(self) -> str:
        """Loads with their errors, consistency, and what may hide behind them, as text."""
        from .force_report import force_report

        return force_report(self)

    def plot(self) -> Figure:
        """The shape beside what was measured, and confidence ellipses of the force."""
        from .force_report import figure_force

        return figure_force(self)

    def __repr__(self) -> str:
        told = ", ".join(
            f"{label} = {x:.4g} +- {s:.2g}" for (label, x), s in zip(self.values.items(), self.deviations, strict=True)
        )
        return f"<ForceEstimate: {told}>"
