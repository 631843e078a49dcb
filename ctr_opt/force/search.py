"""Search for loads: Gauss-Newton steps in loads, places of points and the robot's state together.

The equilibrium equations are linearized together with the measurements. The state then follows the loads to first
order, and both converge together. No equilibrium is solved for on the way.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property

import attrs
import numpy as np
from numpy.typing import NDArray

from ..checks import Array
from ..errors import DefinitionError, EstimationError
from ..estimation.blocks import Blocks
from ..estimation.comparison import Comparison
from ..estimation.linearized import Linearized
from ..estimation.places import Orders, eliminated, free, moved, pulls
from ..robot.actuation import Actuation
from .model import LoadedModel

_MOST_STEPS = 60
_ARRIVED = 1e-5  # standard deviations of the loads: shorter steps are omitted
_SHRINK = 1e-2  # of the step before: smallest shrinkage that the convergence test assumes
_BALANCED = 3e-5  # of the moments' size: error of the equilibrium before the last step, squared after it
_SETTLED = 1e-9  # of the moments' size: closer to equilibrium, the linearized loss is accurate
_NEAR = 0.3  # of the moments' size: farther off, the linearization does not predict the equilibrium
BLIND = 30.0  # scaled standard deviation above which steps leave out a direction: loads would diverge
_STALLED, _NOTHING = 8, 1e-7  # steps, and relative decrease of the loss over them, at which the search ends
_LITTLE = 1e-2  # decrease of the loss over the last steps that is accepted when steps run out
_BEYOND = 1e100  # misfits and slopes beyond this overflow when squared
_MISSED = 0.1  # share of a step's loss increase below which returning to equilibrium does not explain it
_CORRECTIONS = 3  # corrections of forces at new places of contacts, if a step of both goes too far
_CALM, _MOST_DAMPING = 1e-12, 1e8  # smallest effective damping, and damping at which the search fails


@attrs.frozen(eq=False)
class LoadUnknowns:
    """The unknowns ``x`` with scale, prior and bounds; the model reads ``numbers = mixing @ x``.

    ``at_places`` marks the places of contacts in ``x``.

    ``spread (others, q)`` is a factor of the covariance of the model's other, uncertain numbers: they change by
    ``spread @ e`` with standard normal ``e``. If given, ``together`` holds mean and inverse covariance of ``x`` and
    ``e`` and replaces the prior.
    """

    mixing: Array
    scale: Array
    prior_mean: Array
    prior_information: Array
    lower: Array
    upper: Array
    at_places: NDArray[np.bool_]
    spread: Array
    together: tuple[Array, Array] | None = None

    @cached_property
    def before(self) -> tuple[Array, Array]:
        """Prior mean and inverse covariance of ``x`` and ``e``."""
        if self.together is not None:
            return self.together
        count, errors = len(self.prior_mean), self.spread.shape[1]
        information = np.eye(count + errors)
        information[:count, :count] = self.prior_information
        return np.append(self.prior_mean, np.zeros(errors)), information

    @cached_property
    def turn(self) -> Array:
        """Matrix from ``x`` and ``e`` to the model's numbers, followed by its uncertain numbers."""
        rows, columns = self.mixing.shape
        turn = np.zeros(np.add(self.mixing.shape, self.spread.shape))
        turn[:rows, :columns], turn[rows:, columns:] = self.mixing, self.spread
        return turn

    @cached_property
    def whole_scale(self) -> Array:
        """Scales of ``x`` and ``e``."""
        return np.append(self.scale, np.ones(self.spread.shape[1]))

    @cached_property
    def whole_bounds(self) -> tuple[Array, Array]:
        """Bounds of ``x`` and ``e``."""
        infinite = np.full(self.spread.shape[1], np.inf)
        return np.append(self.lower, -infinite), np.append(self.upper, infinite)


@attrs.frozen(eq=False)
class SearchState:
    """A point of the search, linearized: base moments ``z``, loads ``x``, places, and errors ``e``.

    ``misfit`` has ``slopes`` by ``x`` and ``e``, with the robot in equilibrium, and slopes ``along`` by places.
    ``follow (n, 1 + k)`` is Newton's step of ``z`` and its derivatives by ``x``; the errors ``e`` act on the misfit
    only. ``tangent`` holds the free directions of ``x`` as columns; None if all are free.
    """

    z: Array
    x: Array
    places: Array
    e: Array
    misfit: Array
    slopes: Array
    along: Array
    follow: Array
    off: float
    cost: float
    weights: Array
    arrived: bool = False
    tangent: Array | None = None

    def better_than(self, other: SearchState) -> bool:
        """Whether the loss is at most that of the other state, up to rounding."""
        return self.cost <= other.cost + 1e-9 * (1.0 + abs(other.cost))

    def moved(self, x: Array, places: Array, e: Array) -> SearchState:
        """The converged state after a short step, to first order."""
        misfit = self.misfit + self.slopes @ np.concatenate((x - self.x, e - self.e))
        return attrs.evolve(
            self,
            z=self.z + self.follow @ np.concatenate(([1.0], x - self.x)),
            x=x,
            places=places,
            e=e,
            misfit=misfit + self.along @ (places - self.places),
            follow=np.column_stack((np.zeros(len(self.z)), self.follow[:, 1:])),
            arrived=True,
        )


@attrs.frozen(eq=False)
class Search:
    """The search for unknown loads from measurements of one robot; several searches may share the model.

    ``hopeless`` says whether the search should stop at a state.
    """

    model: LoadedModel
    actuation: Actuation
    unit: Array
    length: float
    unknowns: LoadUnknowns
    comparison: Comparison
    blocks: Blocks
    arrived: float = _ARRIVED
    hopeless: Callable[[SearchState], bool] | None = None

    # -- evaluation ------------------------------------------------------------------------------------------------

    def at(self, z: Array, x: Array, places: Array, e: Array) -> SearchState | None:
        """The state at these values; None if the model cannot be evaluated."""
        unknowns, e_first = self.unknowns, len(x)
        try:
            here = self.linearized(self.model, z, unknowns.mixing @ x, unknowns.turn, places)
            follow, there = here.follow, here.in_equilibrium
        except (
            EstimationError,
            DefinitionError,
            np.linalg.LinAlgError,
        ):  # steps that cannot be laid out, or no numbers
            return None
        if not np.abs(there).max(initial=0.0) < _BEYOND:  # also rejects NaN
            return None
        slopes = there[:, 1:]
        misfit = there[:, 0] + slopes[:, e_first:] @ e
        cost, weights = self.blocks.weights(misfit)
        off = float(np.abs(follow[:, 0] / self.unit).max())
        mean, information = unknowns.before
        d = np.concatenate((x, e)) - mean
        loss = float(cost) + 0.5 * float(d @ information @ d)
        return SearchState(z, x, places, e, misfit, slopes, here.misfit_s, follow[:, : 1 + len(x)], off, loss, weights)

    def linearized(self, model: LoadedModel, z: Array, values: Array, mixing: Array, places: Array) -> Linearized:
        """Linearize the measurements with a model whose numbers follow the unknowns by ``mixing``."""
        model.actuated(self.actuation)
        evaluation = model.at(z, values, places * self.length)
        misfit, rates = self.comparison.compare(evaluation.predictions)
        along = self.comparison.along(evaluation.predictions)[0] if len(places) else np.zeros((misfit.shape[1], 0))
        slopes = evaluation.slopes
        return Linearized.of(evaluation.residual, slopes, (misfit[0], rates[0]), along, mixing, places, self.length)

    # -- search ----------------------------------------------------------------------------------------------------

    def solve(self, z: Array, x: Array, places: Array) -> SearchState | None:
        """The state of least loss nearby; None if the search fails."""
        e = self.unknowns.before[0][len(x) :]
        state = self.at(z, np.clip(x, self.unknowns.lower, self.unknowns.upper), places, e)
        damping, before = 0.0, 0.0
        costs: list[float] = []
        for _ in range(_MOST_STEPS):
            if state is None or state.arrived:
                return state
            if self.hopeless is not None and self.hopeless(state):
                return None
            costs.append(state.cost)
            if len(costs) > _STALLED and np.ptp(costs[-_STALLED:]) < _NOTHING * (1.0 + state.cost):
                return self._at_rest(state)
            state, damping, before = self._stepped(state, damping, before)
        return self._at_rest(state) if state is not None and np.ptp(costs[-_STALLED:]) < _LITTLE else None

    def _at_rest(self, state: SearchState) -> SearchState | None:
        """The state with the same loads and the robot in equilibrium."""
        ahead: SearchState | None = state
        while ahead is not None and ahead.off >= _SETTLED:
            ahead = self._settled(ahead)
        return ahead

    @property
    def errors(self) -> int:
        """Count of standard normal errors of the uncertain numbers."""
        return int(self.unknowns.spread.shape[1])

    def _stepped(self, state: SearchState, damping: float, before: float) -> tuple[SearchState | None, float, float]:
        """The next state, not worse than this one; the next damping; and the length of an undamped step.

        The last step is taken without evaluation: as steps shrink, the one after it would be shorter than ``arrived``.
        """
        normal = Normal.of(self, state)
        while damping < _MOST_DAMPING:
            dx, de = normal.step(state, damping)
            whole = np.concatenate((dx, de))
            x, places, e = state.x + dx, normal.places(state, whole), state.e + de
            length = float(np.sqrt(whole @ normal.matrix @ whole))
            last = 0.0 if damping else before
            short = length * max(length, _SHRINK * last) < self.arrived * max(length, last)
            if short and state.off < _BALANCED:
                return state.moved(x, places, e), 0.0, length
            ahead = self._near(self.at(state.z + state.follow @ np.concatenate(([1.0], dx)), x, places, e))
            if ahead is not None and not ahead.better_than(state):
                ahead, length = self._corrected(ahead, state, damping), 0.0
            if ahead is not None and ahead.better_than(state):
                return ahead, 0.0 if damping < 1e-6 else 0.1 * damping, 0.0 if damping else length
            settled = self._settled(state) if state.off > _SETTLED else None
            if settled is not None:  # the loss came from a linearization: return to equilibrium first
                if ahead is None or settled.cost - state.cost < _MISSED * (ahead.cost - state.cost):
                    damping = max(10.0 * damping, 1e-3)
                return settled, damping, 0.0
            damping = max(10.0 * damping, 1e-3)
        return None, damping, 0.0

    def _corrected(self, ahead: SearchState, state: SearchState, damping: float) -> SearchState | None:
        """The state ``ahead`` with forces corrected for its new places of contacts, until it is better."""
        now: SearchState | None = ahead
        for _ in range(_CORRECTIONS if self.unknowns.at_places.any() else 0):
            if now is None or now.better_than(state):
                break
            normal = Normal.of(self, now)
            dx, de = normal.step(now, damping, self.unknowns.at_places)
            places = normal.places(now, np.concatenate((dx, de)))
            z = now.z + now.follow @ np.concatenate(([1.0], dx))
            now = self._near(self.at(z, now.x + dx, places, now.e + de))
        return now

    def _near(self, ahead: SearchState | None) -> SearchState | None:
        """The state if it is near an equilibrium, else None."""
        return ahead if ahead is not None and ahead.off < _NEAR else None

    def _settled(self, state: SearchState) -> SearchState | None:
        """The state after one Newton step to equilibrium with the same loads; None if it is not closer."""
        ahead = self.at(state.z + state.follow[:, 0], state.x, state.places, state.e)
        return ahead if ahead is not None and ahead.off < 0.5 * state.off else None


@attrs.frozen(eq=False)
class Normal:
    """The second-order model of the loss by ``x`` and ``e``, with places eliminated."""

    matrix: Array
    gradient: Array
    scale: Array
    lower: Array
    upper: Array
    at_places: tuple[Array, Array, Array]
    """Second derivatives by places and ``(x, e)``, then gradient and curvatures by places."""

    orders: Orders

    @classmethod
    def of(cls, search: Search, state: SearchState) -> Normal:
        """The model of the loss at a state."""
        unknowns = search.unknowns
        mean, information = unknowns.before
        weighted = state.weights[:, None] * state.slopes
        matrix = state.slopes.T @ weighted + information
        gradient = weighted.T @ state.misfit + information @ (np.concatenate((state.x, state.e)) - mean)
        at_places, orders = (np.zeros((0, len(gradient))), np.zeros(0), np.zeros(0)), search.blocks.orders
        if orders:
            at_places = cross, slopes, curvatures = (
                state.along.T @ weighted,
                *pulls(state.misfit, state.along, state.weights),
            )
            ways = free(state.places, orders).T
            matrix, (gradient,) = eliminated(
                matrix, gradient[None], ways @ cross, ways @ curvatures, (ways @ slopes)[None]
            )
        return cls(matrix, gradient, unknowns.whole_scale, *unknowns.whole_bounds, at_places, orders)

    def reduced(self, count: int) -> tuple[Array, Array]:
        """Matrix and gradient of the first ``count`` numbers, with the others eliminated."""
        gain = np.linalg.solve(self.matrix[count:, count:], self.matrix[count:, :count]).T
        matrix = self.matrix[:count, :count] - gain @ self.matrix[count:, :count]
        return matrix, self.gradient[:count] - gain @ self.gradient[count:]

    def step(self, state: SearchState, damping: float, hold: NDArray[np.bool_] | None = None) -> tuple[Array, Array]:
        """The step to the least loss within bounds, without undetermined directions and numbers on ``hold``."""
        at = np.concatenate((state.x, state.e))
        held = np.zeros(len(at), dtype=bool)
        step = np.zeros(len(at))
        if hold is None:
            step = self._free_step(slice(None), self.gradient, damping)
        else:
            held[: len(hold)] = hold
            step[~held] = self._free_step(~held, self.gradient, damping)
        for _ in range(len(at)):
            beyond = ~held & ((at + step < self.lower) | (at + step > self.upper))
            if not beyond.any():
                break
            step[beyond] = np.clip(at + step, self.lower, self.upper)[beyond] - at[beyond]
            held |= beyond
            step[~held] = self._free_step(~held, self.gradient + self.matrix[:, held] @ step[held], damping)
        return step[: len(state.x)], step[len(state.x) :]

    def _free_step(self, moving: NDArray[np.bool_] | slice, gradient: Array, damping: float) -> Array:
        scale = self.scale[moving]
        matrix = self.matrix[moving][:, moving] * (scale[:, None] * scale)
        if damping:
            matrix += damping * np.diag(np.diag(matrix) + _CALM)
        values, vectors = np.linalg.eigh(matrix)
        known = values > BLIND**-2
        along = vectors[:, known]
        return np.asarray(-scale * (along @ ((along.T @ (scale * gradient[moving])) / values[known])))

    def places(self, state: SearchState, step: Array) -> Array:
        """Places of the points after a step."""
        if not self.orders:
            return state.places
        cross, slopes, curvatures = self.at_places
        return moved(state.places, slopes + cross @ step, np.maximum(curvatures, 1e-300), self.orders)
