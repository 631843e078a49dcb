"""Loads from measurements: the steps of Gauss and Newton in loads, places of points and the robot's state together.

The equations of the equilibrium are linearized with the measurements, so that the state follows the loads to first
order and both arrive together; no equilibrium is solved for on the way.
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
_ARRIVED = 1e-5  # standard deviations of the loads: how short a step may be left out
_SHRINK = 1e-2  # of the step before: a step is not taken to be shorter
_BALANCED = 3e-5  # of the moments' size: what the equilibrium may be off before the last step, and squared after it
_SETTLED = 1e-9  # of the moments' size: what is less off has the loss that it tells
_NEAR = 0.3  # of the moments' size: farther off, the equilibrium is not told by its linearization
BLIND = 30.0  # scaled standard deviation from which a direction is not moved along: loads would go anywhere
_STALLED, _NOTHING = 8, 1e-7  # steps in which the loss falls by less, relative, where it is flat: the last
_LITTLE = 1e-2  # of losses, half squared standard deviations: what it may still fall by where steps run out
_BEYOND = 1e100  # of misfits and slopes: their squares are no numbers
_MISSED = 0.1  # of what a step fell short by: a loss told so much too low does not excuse the step
_CORRECTIONS = 3  # of forces for new places of contacts, where a step of both goes too far
_CALM, _MOST_DAMPING = 1e-12, 1e8  # damping where it begins to count, and where there is no way on


@attrs.frozen(eq=False)
class Sought:
    """What is sought and how the model takes it: ``numbers = mixing @ x``, by their scale, prior and bounds.

    ``at_places``: which of ``x`` are places of contacts.

    ``spread (others, q)``: factor of the covariance of the model's other numbers, which are known with errors only:
    they change by ``spread @ e``, where ``e`` is standard normal. Where more is known of ``x`` and ``e`` together,
    ``together`` has their mean and inverse covariance, in the place of the prior.
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
        """Mean and inverse covariance of ``x`` and ``e`` before anything is seen."""
        if self.together is not None:
            return self.together
        count, errors = len(self.prior_mean), self.spread.shape[1]
        information = np.eye(count + errors)
        information[:count, :count] = self.prior_information
        return np.append(self.prior_mean, np.zeros(errors)), information

    @cached_property
    def turn(self) -> Array:
        """How the model's numbers, and the others behind them, follow ``x`` and ``e``."""
        rows, columns = self.mixing.shape
        turn = np.zeros(np.add(self.mixing.shape, self.spread.shape))
        turn[:rows, :columns], turn[rows:, columns:] = self.mixing, self.spread
        return turn

    @cached_property
    def whole_scale(self) -> Array:
        """Of ``x`` and ``e``."""
        return np.append(self.scale, np.ones(self.spread.shape[1]))

    @cached_property
    def whole_bounds(self) -> tuple[Array, Array]:
        """Of ``x`` and ``e``."""
        infinite = np.full(self.spread.shape[1], np.inf)
        return np.append(self.lower, -infinite), np.append(self.upper, infinite)


@attrs.frozen(eq=False)
class State:
    """Where a search is: base moments ``z``, loads ``x``, places, errors ``e``; and everything there to first order.

    ``misfit`` and its ``slopes`` by ``x`` and ``e`` with the robot kept in equilibrium, and ``along`` by places;
    ``follow (n, 1 + k)``: Newton's step of ``z``, and how it follows ``x``; the errors ``e`` are in the misfit alone.
    ``tangent``: directions in which ``x`` may move, as columns, where not in all.
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

    def better_than(self, other: State) -> bool:
        """Whether the loss is not greater, but for rounding."""
        return self.cost <= other.cost + 1e-9 * (1.0 + abs(other.cost))

    def moved(self, x: Array, places: Array, e: Array) -> State:
        """Arrived at where a short step leads, to first order."""
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
    """Measurements of one robot at rest, and the loads sought; the model may be shared with searches elsewhere.

    ``hopeless`` tells from which states a search is not worth going on.
    """

    model: LoadedModel
    actuation: Actuation
    unit: Array
    length: float
    sought: Sought
    comparison: Comparison
    blocks: Blocks
    arrived: float = _ARRIVED
    hopeless: Callable[[State], bool] | None = None

    # -- evaluation ------------------------------------------------------------------------------------------------

    def at(self, z: Array, x: Array, places: Array, e: Array) -> State | None:
        """The state there; None where the model cannot be evaluated."""
        sought, e_first = self.sought, len(x)
        try:
            here = self.linearized(self.model, z, sought.mixing @ x, sought.turn, places)
            follow, there = here.follow, here.in_equilibrium
        except (
            EstimationError,
            DefinitionError,
            np.linalg.LinAlgError,
        ):  # steps that cannot be laid out, or no numbers
            return None
        if not np.abs(there).max(initial=0.0) < _BEYOND:  # nor where it is no number
            return None
        slopes = there[:, 1:]
        misfit = there[:, 0] + slopes[:, e_first:] @ e
        cost, weights = self.blocks.weights(misfit)
        off = float(np.abs(follow[:, 0] / self.unit).max())
        mean, information = sought.before
        d = np.concatenate((x, e)) - mean
        loss = float(cost) + 0.5 * float(d @ information @ d)
        return State(z, x, places, e, misfit, slopes, here.misfit_s, follow[:, : 1 + len(x)], off, loss, weights)

    def linearized(self, model: LoadedModel, z: Array, values: Array, mixing: Array, places: Array) -> Linearized:
        """What a model says of what was measured, by unknowns that its numbers follow by ``mixing``."""
        model.actuated(self.actuation)
        told = model.at(z, values, places * self.length)
        misfit, rates = self.comparison.compare(told.predictions)
        along = self.comparison.along(told.predictions)[0] if len(places) else np.zeros((misfit.shape[1], 0))
        return Linearized.of(told.residual, told.slopes, (misfit[0], rates[0]), along, mixing, places, self.length)

    # -- search ----------------------------------------------------------------------------------------------------

    def solve(self, z: Array, x: Array, places: Array) -> State | None:
        """The least loss nearby; None where no way leads on."""
        e = self.sought.before[0][len(x) :]
        state = self.at(z, np.clip(x, self.sought.lower, self.sought.upper), places, e)
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

    def _at_rest(self, state: State) -> State | None:
        """The same loads with the robot in equilibrium."""
        ahead: State | None = state
        while ahead is not None and ahead.off >= _SETTLED:
            ahead = self._settled(ahead)
        return ahead

    @property
    def errors(self) -> int:
        """How many standard normal errors of other numbers there are."""
        return int(self.sought.spread.shape[1])

    def _stepped(self, state: State, damping: float, before: float) -> tuple[State | None, float, float]:
        """The next state, not worse than this one; the damping to go on with; the length of the step, if undamped.

        The last step is taken without looking again: the one after it, as steps shrink, would be shorter than
        ``arrived``.
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
            if settled is not None:  # the loss was told by a linearization: back into equilibrium first
                if ahead is None or settled.cost - state.cost < _MISSED * (ahead.cost - state.cost):
                    damping = max(10.0 * damping, 1e-3)
                return settled, damping, 0.0
            damping = max(10.0 * damping, 1e-3)
        return None, damping, 0.0

    def _corrected(self, found: State, state: State, damping: float) -> State | None:
        """A state with forces made anew for the places of contacts that it has moved to, until it is better."""
        now: State | None = found
        for _ in range(_CORRECTIONS if self.sought.at_places.any() else 0):
            if now is None or now.better_than(state):
                break
            normal = Normal.of(self, now)
            dx, de = normal.step(now, damping, self.sought.at_places)
            places = normal.places(now, np.concatenate((dx, de)))
            z = now.z + now.follow @ np.concatenate(([1.0], dx))
            now = self._near(self.at(z, now.x + dx, places, now.e + de))
        return now

    def _near(self, found: State | None) -> State | None:
        """A state, if it is anywhere near an equilibrium."""
        return found if found is not None and found.off < _NEAR else None

    def _settled(self, state: State) -> State | None:
        """The same loads closer to equilibrium, where the loss means what it says; None where it is not closer."""
        ahead = self.at(state.z + state.follow[:, 0], state.x, state.places, state.e)
        return ahead if ahead is not None and ahead.off < 0.5 * state.off else None


@attrs.frozen(eq=False)
class Normal:
    """The second-order model of the loss by ``x`` and ``e``, places following at their best."""

    matrix: Array
    gradient: Array
    scale: Array
    lower: Array
    upper: Array
    at_places: tuple[Array, Array, Array]
    """Second derivatives by places and all else, gradient and curvatures by places."""

    orders: Orders

    @classmethod
    def of(cls, search: Search, state: State) -> Normal:
        """At a state."""
        sought = search.sought
        mean, information = sought.before
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
        return cls(matrix, gradient, sought.whole_scale, *sought.whole_bounds, at_places, orders)

    def reduced(self, count: int) -> tuple[Array, Array]:
        """Matrix and gradient of the first numbers, the others following at their best."""
        gain = np.linalg.solve(self.matrix[count:, count:], self.matrix[count:, :count]).T
        matrix = self.matrix[:count, :count] - gain @ self.matrix[count:, :count]
        return matrix, self.gradient[:count] - gain @ self.gradient[count:]

    def step(self, state: State, damping: float, hold: NDArray[np.bool_] | None = None) -> tuple[Array, Array]:
        """Towards the least, within bounds; not along directions of which nothing is known, or that are to hold."""
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

    def _free_step(self, those: NDArray[np.bool_] | slice, gradient: Array, damping: float) -> Array:
        scale = self.scale[those]
        matrix = self.matrix[those][:, those] * (scale[:, None] * scale)
        if damping:
            matrix += damping * np.diag(np.diag(matrix) + _CALM)
        values, vectors = np.linalg.eigh(matrix)
        known = values > BLIND**-2
        along = vectors[:, known]
        return np.asarray(-scale * (along @ ((along.T @ (scale * gradient[those])) / values[known])))

    def places(self, state: State, step: Array) -> Array:
        """Where the points go with a step."""
        if not self.orders:
            return state.places
        cross, slopes, curvatures = self.at_places
        return moved(state.places, slopes + cross @ step, np.maximum(curvatures, 1e-300), self.orders)
