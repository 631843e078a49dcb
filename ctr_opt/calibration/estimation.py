"""Estimation: unknowns, experiments and a loss, evaluated with derivatives at any values and states.

The state of an experiment is what is its own: base moments (SI) and, behind them, the places of points that are
estimated. Two ways to the same answer stand on it: ``simultaneous.py``, where every experiment's state is unknown
beside the parameters, and ``reduced.py``, where equilibria and places are solved for at each step.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from copy import copy
from functools import cached_property
from typing import Any

import attrs
import numpy as np
from numpy.typing import NDArray

from ..checks import Array, choice
from ..errors import DefinitionError, EstimationError, SolveError
from ..estimation.comparison import Comparison
from ..estimation.experiment import Experiment
from ..estimation.losses import LOSSES, Loss
from ..estimation.measurements import Measurement
from ..estimation.models.compiled import CompiledModel, compilable
from ..estimation.models.symbolic import SymbolicModel, structure
from ..estimation.places import Orders, free, moved, nearest, orders
from ..estimation.sensors import names_of, sensed
from ..forward.equilibrium import Equilibrium
from ..forward.problem import ForwardProblem
from ..layout.configuration import Configuration
from ..layout.ends import Ends, chained, outermost_at_tip
from ..layout.observables import Observable, ObservedList
from ..robot.names import parsed
from ..robot.robot import Robot
from .unknowns import Parameter, Unknowns

Progress = Callable[[str, int, int], None]
"""Called with what is done, how far it is, and how much there is."""

_SETTLED = 1e-10  # of the robot's length: places that move less stand still
_MOST_MOVES = 60


@attrs.frozen(eq=False)
class Linearized:
    """An experiment at some values: boundary residual and whitened misfit, and their slopes.

    ``*_z`` by the base moments (SI), ``*_x`` by the unknowns ``own`` that act on the experiment, ``*_s`` by the places
    of points that are estimated. Of a group of experiments all have one axis more, the first.
    """

    residual: Array
    residual_z: Array
    residual_x: Array
    misfit: Array
    misfit_z: Array
    misfit_x: Array
    misfit_s: Array
    own: NDArray[np.intp]
    places: Array

    def reduced(self) -> Array:
        """Slopes of the misfit by the unknowns, the robot staying in equilibrium: implicit-function theorem."""
        return np.asarray(self.misfit_x - self.misfit_z @ np.linalg.solve(self.residual_z, self.residual_x))

    def step(self) -> Array:
        """Newton's step of the base moments to the equilibrium of the model's own mesh."""
        return np.asarray(-np.linalg.solve(self.residual_z, self.residual[..., None])[..., 0])

    def settled(self) -> Array:
        """The misfit there, to first order."""
        return np.asarray(self.misfit + (self.misfit_z @ self.step()[..., None])[..., 0])

    def of(self, k: int) -> Linearized:
        """That of one experiment of a group."""
        return Linearized(*(getattr(self, field.name)[k] for field in attrs.fields(Linearized)))


@attrs.frozen(eq=False, slots=False)
class Layout:
    """How an experiment enters: its group, the parameters acting on it, and the blocks of its misfit."""

    group: int
    names: tuple[str, ...]
    observables: tuple[Observable, ...]
    blocks: tuple[tuple[int, int, int], ...]
    """Where each block starts in the misfit, its size, and the measurement it belongs to."""
    orders: Orders

    @cached_property
    def places(self) -> int:
        """How many places are estimated."""
        return self.orders[-1][1] if self.orders else 0

    def along(self, each: Linearized) -> Array:
        """Slopes of the misfit by the places that may move, pooled ones together; zero by the others."""
        return np.asarray(each.misfit_s @ free(each.places, self.orders))

    @cached_property
    def starts(self) -> NDArray[np.intp]:
        """Where each block starts."""
        return np.array([start for start, _, _ in self.blocks])

    @cached_property
    def sizes(self) -> NDArray[np.intp]:
        """The blocks' sizes."""
        return np.array([size for _, size, _ in self.blocks])


@attrs.frozen(eq=False)
class Group:
    """Experiments that one model serves; ``mixing (E, numbers, own)``: what acts on each by unknowns ``own (E, j)``.

    ``mounting (E, 6 k, own)``: the same of the poses of the ``sensors`` on tubes, which act on predictions alone.
    ``ends (E, tubes)``: the tubes' at the initial values; ``ends_x (E, tubes, own)``: their slopes, which are constant.
    In the virtual machine ``start (E, k)`` are all numbers at the initial values; ``symbolic.active`` of them move.
    """

    members: list[int]
    own: NDArray[np.intp]
    mixing: Array
    mounting: Array
    sensors: tuple[str, ...]
    ends: Array
    ends_x: Array
    unit: Array
    comparison: Comparison
    compiled: CompiledModel | None = None
    symbolic: SymbolicModel | None = None
    start: Array | None = None


class Estimation:
    """An estimation problem, ready to be evaluated."""

    def __init__(
        self,
        robot: Robot,
        experiments: Sequence[Experiment],
        wanted: Iterable[str | Parameter],
        loss: str,
        tolerance: float,
        compiled: bool | None = None,
    ) -> None:
        self.robot = robot
        self.experiments = _checked(robot, experiments)
        self.loss = choice(loss, "loss", LOSSES)
        self.tolerance = tolerance
        self.compiled = compiled
        self.unknowns = Unknowns(robot, [(each.actuation, each.loads) for each in self.experiments], wanted)
        for k, each in enumerate(self.experiments):
            each.check_places(self._ends[k], f"experiment {each.name or k}: ")
        scaled = {measurement.scaled for each in self.experiments for measurement in each.measurements}
        if scaled == {True, False}:
            raise DefinitionError("sigma: give it for all measurements, or for none")
        self.scaled = scaled == {True}
        if not self.scaled and loss in ("huber", "cauchy"):
            raise DefinitionError(f"loss = {loss!r} needs the sigma of every measurement, to tell what is an outlier")
        known = [entry.name for entry in self.unknowns.entries if np.isfinite(entry.prior_sigma).any()]
        if not self.scaled and known:
            raise DefinitionError(f"{known[0]}: a prior needs the sigma of every measurement, to be weighed with them")
        self.layouts = self._layouts()
        self.losses = {size: Loss(self.loss, size) for size in {b[1] for each in self.layouts for b in each.blocks}}
        self.models: list[Group] = []

    @cached_property
    def _ends(self) -> list[Ends]:
        """Where the tubes end in each experiment, with the initial values."""
        initial = self.unknowns.initial
        robot, count = self.unknowns.robot_at(initial), len(self.experiments)
        return [Ends.of_robot(robot, self.unknowns.experiment_at(initial, k)[0].translations) for k in range(count)]

    def of(self, experiments: Sequence[Experiment]) -> Estimation:
        """The same parameters from other experiments."""
        return Estimation(self.robot, experiments, self.unknowns.given, self.loss, self.tolerance, self.compiled)

    def whitener(self, measurement: Measurement) -> Array:
        """By what the residuals of a measurement's blocks are multiplied: distances are the same along all axes."""
        return measurement.isotropic if self.loss == "distance" else measurement.whitener

    def by_squares(self) -> Estimation:
        """The same, models and all, with the squares of the same residuals as loss."""
        other = copy(self)
        other.losses = {size: Loss("squared", size) for size in self.losses}
        return other

    @property
    def prepared(self) -> bool:
        """Whether the models have been built."""
        return bool(self.models)

    # -- structure -------------------------------------------------------------------------------------------------

    def _layouts(self) -> list[Layout]:
        groups: dict[Any, int] = {}
        layouts = []
        for k, each in enumerate(self.experiments):
            names = tuple(dict.fromkeys(name for name, _, _ in self.unknowns.acting(k)))
            measured = tuple((type(m), m.shape) for m in each.measurements)
            observables = each.framed(self._ends[k])
            key = (structure(self.robot, each.actuation, each.loads, observables), names, measured, orders(each))
            group = groups.setdefault(key, len(groups))
            layouts.append(Layout(group, names, observables, _blocks(each), orders(each)))
        return layouts

    def members(self, group: int) -> list[int]:
        """The experiments of a group."""
        return [k for k, layout in enumerate(self.layouts) if layout.group == group]

    @property
    def groups(self) -> int:
        """How many groups of experiments there are."""
        return 1 + max(layout.group for layout in self.layouts)

    # -- equilibria ------------------------------------------------------------------------------------------------

    def equilibria(
        self, x: Array, before: Sequence[Equilibrium | None] | None = None, progress: Progress | None = None
    ) -> list[Equilibrium]:
        """The experiments' equilibria at some values, each from the one ``before`` or from nothing."""
        problem = ForwardProblem(self.unknowns.robot_at(x), tolerance=self.tolerance, compiled=self._forward)
        found: list[Equilibrium] = []
        for k, each in enumerate(self.experiments):
            start = None if before is None else before[k]
            try:
                found.append(problem.solve(*self.unknowns.experiment_at(x, k), initial=start))
            except SolveError as error:
                raise SolveError(f"experiment {each.name or k}: {error}", error.result) from None
            if progress is not None:
                progress("equilibria", k + 1, len(self.experiments))
        return found

    def equilibria_of(self, x: Array, whose: str, progress: Progress | None = None) -> list[Equilibrium]:
        """The same, each from nothing; where there is none, ``EstimationError`` says ``whose`` values these are."""
        try:
            return self.equilibria(x, progress=progress)
        except SolveError as error:
            raise EstimationError(f"{whose} have no equilibrium in {error}") from error

    def states(self, x: Array, equilibria: Sequence[Equilibrium]) -> list[Array]:
        """States of equilibria at some values, points where they fit best."""
        self.prepare(equilibria)
        return self.settled(x, self.first_states(equilibria))

    def first_states(self, equilibria: Sequence[Equilibrium]) -> list[Array]:
        """States of equilibria, points roughly where they fit best."""
        return [
            np.concatenate((shape.unknowns, nearest(each, shape, self.whitener, self._loss_of_points)))
            for each, shape in zip(self.experiments, equilibria, strict=True)
        ]

    def _loss_of_points(self, squared: Array) -> Array:
        return self.losses[3].evaluate(squared)[0]

    def settled(self, x: Array, states: Sequence[Array], *, solved: bool = True) -> list[Array]:
        """States near some others where the points fit best; ``solved``: and the model is in equilibrium.

        Newton's steps of the base moments and those of Gauss and Newton of the places, shortened where these go to and
        fro, as where a point is far from the backbone on the outer side of a bend.
        """
        found = [state.copy() for state in states]
        if not any(layout.places for layout in self.layouts):
            return found
        before = [np.zeros((len(group.members), self._of(group).places)) for group in self.models]
        gains = [np.ones(each.shape) for each in before]
        for _ in range(_MOST_MOVES):
            for g, each in enumerate(self.linearize_groups(x, found)):
                group = self.models[g]
                misfit, moments = each.misfit, np.zeros_like(each.residual)
                if solved:
                    misfit, moments = each.settled(), each.step()
                step = self._moved(self._of(group), each, misfit, gains[g]) - each.places
                gains[g][(step * before[g] < 0.0) & (np.abs(step) > 0.5 * np.abs(before[g]))] *= 0.5
                before[g] = step
                for k, change in zip(group.members, np.hstack((moments, step)), strict=True):
                    found[k] += change
            if max(np.abs(step).max(initial=0.0) for step in before) < _SETTLED:
                break
        return found

    def _moved(self, layout: Layout, each: Linearized, misfit: Array, gains: Array) -> Array:
        """Where the points of a group's experiments go by the slopes of a misfit; ``gains``: how far of the way."""
        weights = np.repeat(2.0 * self.losses_of(layout, misfit)[1], layout.sizes, axis=-1)
        slopes = np.einsum("en,enk->ek", weights * misfit, each.misfit_s)
        curvatures = np.einsum("en,enk->ek", weights, each.misfit_s**2) / gains
        return moved(each.places, slopes, curvatures, layout.orders)

    def _of(self, group: Group) -> Layout:
        """The layout of a group's experiments."""
        return self.layouts[group.members[0]]

    @property
    def _forward(self) -> bool | None:
        """Whether forward solves are compiled: as soon as the model is."""
        return True if any(group.compiled is not None for group in self.models) else self.compiled

    def prepare(self, equilibria: Sequence[Equilibrium]) -> None:
        """Build the groups' models, with as many steps in each section as any of the equilibria needed."""
        if self.models:
            return
        for group in range(self.groups):
            members = self.members(group)
            first, names = members[0], self.layouts[members[0]].names
            each, observables = self.experiments[first], self.layouts[first].observables
            configuration = Configuration(self.robot, equilibria[first].actuation, each.loads)
            sizes = self.unknowns.sizes(names, first)
            rows = [_rows(self.unknowns.acting(k), sizes, self.unknowns.size) for k in members]
            sensors = names_of(observables)
            mounted = self.unknowns.of_sensors(sensors)
            own = np.array([np.flatnonzero(row.any(axis=0) | mounted.any(axis=0)) for row in rows])
            mixing = np.array([row[:, those] for row, those in zip(rows, own, strict=True)])
            mounting = np.array([mounted[:, those] for those in own])
            unit = configuration.scales.unknowns(configuration.tube_count, configuration.kind.live)
            parts: dict[str, Any] = {"members": members, "own": own, "mixing": mixing, "unit": unit}
            parts |= {"mounting": mounting, "sensors": sensors}
            parts["ends"] = np.array([self._ends[k].points for k in members])
            parts["ends_x"] = _ends_x(mixing, sizes, len(self.robot.tubes))
            parts["comparison"] = Comparison([self.experiments[k].measurements for k in members], self.whitener)
            if compilable(self.robot, each.loads, observables, names, self.compiled):
                every = [self.layouts[k].observables for k in members]
                self.models.append(Group(**parts, compiled=CompiledModel(every, sizes)))
            else:
                steps = max(equilibria[k].solved().steps for k in members[:: max(1, len(members) // 100)])
                model = SymbolicModel(configuration, observables, names, steps)
                self.models.append(Group(**parts, symbolic=model, start=self._numbers(model, members)))

    def _numbers(self, model: SymbolicModel, members: list[int]) -> Array:
        initial = self.unknowns.initial
        values = {name: np.asarray(value) for name, value in self.unknowns.robot_numbers(initial).items()}
        at = [(self.unknowns.experiment_at(initial, k), self.layouts[k].observables) for k in members]
        return np.array([model.numbers(values, *experiment, observables) for experiment, observables in at])

    @property
    def units(self) -> list[Array]:
        """Sizes of each experiment's base moments."""
        found: list[Array] = [np.zeros(0)] * len(self.experiments)
        for group in self.models:
            for k in group.members:
                found[k] = group.unit
        return found

    # -- evaluation ------------------------------------------------------------------------------------------------

    def linearize(self, x: Array, states: Sequence[Array]) -> list[Linearized]:
        """All experiments at some values and states."""
        found: list[Linearized | None] = [None] * len(self.experiments)
        for group, linearized in zip(self.models, self.linearize_groups(x, states), strict=True):
            for e, k in enumerate(group.members):
                found[k] = linearized.of(e)
        return [each for each in found if each is not None]

    def linearize_groups(self, x: Array, states: Sequence[Array]) -> list[Linearized]:
        """The same, the experiments of each group together."""
        found = []
        for group in self.models:
            state, n = np.array([states[k] for k in group.members]), len(group.unit)
            places = state[:, n:]
            length, length_x = self._length(group, x)
            s, shares = places * length[:, None], places
            if group.symbolic is not None:  # what is beyond the tip it keeps at it, wherever that goes
                s, shares = (np.where(places < 1.0, each, beyond) for each, beyond in ((s, np.inf), (places, 0.0)))
            residuals, predictions, slopes = self._evaluate(group, x, state[:, :n], s)
            numbers = slopes.shape[-1]
            if group.sensors:
                mountings = {name: self.unknowns.mounting(name, x) for name in group.sensors}
                observables = self.layouts[group.members[0]].observables
                predictions = sensed(observables, predictions, mountings)
            misfit, rates = group.comparison.compare(predictions)
            along = group.comparison.along(predictions)
            misfit_x = rates[..., n:numbers] @ group.mixing + rates[..., numbers:] @ group.mounting
            misfit_x += (along @ shares[..., None]) * length_x[:, None]
            parts = (slopes[..., n:] @ group.mixing, misfit, rates[..., :n], misfit_x, along * length[:, None, None])
            found.append(Linearized(residuals, slopes[..., :n], *parts, group.own, places))
        return found

    def _length(self, group: Group, x: Array) -> tuple[Array, Array]:
        """The robot's length in each experiment of a group, and its slopes by the unknowns that act on it."""
        moved = x[group.own] - self.unknowns.initial[group.own]
        ends = group.ends + np.einsum("etj,ej->et", group.ends_x, moved)
        every, longest = np.arange(len(ends)), outermost_at_tip(chained(ends))  # as symbols are sorted
        return ends[every, longest], group.ends_x[every, longest]

    def _evaluate(self, group: Group, x: Array, z: Array, s: Array) -> tuple[Array, ObservedList, Array]:
        """Residuals, predictions, and the residuals' slopes of a group; ``s``: arc lengths that are estimated."""
        if group.symbolic is not None and group.start is not None:
            theta = group.start.copy()
            moved = x[group.own] - self.unknowns.initial[group.own]
            theta[:, group.symbolic.active] += np.einsum("ekj,ej->ek", group.mixing, moved)
            theta[:, group.symbolic.somewhere] = s
            return group.symbolic.evaluate(z, theta)
        assert group.compiled is not None
        numbers = self.unknowns.robot_numbers(x)
        experiments = [self.unknowns.experiment_at(x, k) for k in group.members]
        angles = np.asarray(numbers.get("base.rotation", np.zeros(3)))
        return group.compiled.evaluate(self.unknowns.robot_at(x), experiments, z, angles, s)

    def cost(self, linearized: Sequence[Linearized]) -> float:
        """The loss of the misfits, without priors."""
        return float(sum(self.block_losses(k, each.misfit)[0].sum() for k, each in enumerate(linearized)))

    def block_losses(self, k: int, misfit: Array) -> tuple[Array, Array, Array]:
        """``rho``, ``rho'`` and ``rho''`` of each block of an experiment."""
        return self.losses_of(self.layouts[k], misfit)

    def losses_of(self, layout: Layout, misfit: Array) -> tuple[Array, Array, Array]:
        """The same of misfits ``(..., numbers)`` with such a layout, ``(..., blocks)`` each."""
        squared = np.add.reduceat(misfit**2, layout.starts, axis=-1)
        if len(self.losses) == 1:
            return next(iter(self.losses.values())).evaluate(squared)
        parts = [self.losses[size].evaluate(squared[..., b]) for b, size in enumerate(layout.sizes)]
        rho, first, second = (np.stack([part[i] for part in parts], axis=-1) for i in range(3))
        return rho, first, second

    def expanded(self, layout: Layout, misfit: Array, rows: Array, *, positive: bool) -> tuple[Array, Array, Array]:
        """Losses of misfits ``(..., numbers)`` with slopes ``rows (..., numbers, k)`` to second order, block by block.

        Losses ``(..., blocks)``, gradients ``(..., blocks, k)`` and the Hessian of their sum ``(..., k, k)``, without
        the misfits' own second derivatives; ``positive``: its curvature along a residual is kept from being negative.
        """
        rho, first, second = self.losses_of(layout, misfit)
        along = np.add.reduceat(misfit[..., None] * rows, layout.starts, axis=-2)
        weights = np.repeat(2.0 * first, layout.sizes, axis=-1)
        hessian = np.matmul(np.swapaxes(rows, -1, -2), weights[..., None] * rows)
        if second.any():
            bend = 4.0 * second
            if positive:
                squared = np.maximum(np.add.reduceat(misfit**2, layout.starts, axis=-1), 1e-300)
                bend = np.maximum(bend, -2.0 * first / squared)
            hessian += np.matmul(np.swapaxes(along, -1, -2), bend[..., None] * along)
        return rho, 2.0 * first[..., None] * along, hessian

    def prior_cost(self, x: Array) -> float:
        """Half the squared deviations from the priors."""
        mean, sigma = self.unknowns.prior
        return 0.5 * float(np.sum(((x - mean) / sigma) ** 2))


def _checked(robot: Any, experiments: Any) -> list[Experiment]:
    if not isinstance(robot, Robot):
        raise DefinitionError(f"robot = {robot!r} must be a Robot")
    given = [experiments] if isinstance(experiments, Experiment) else list(experiments or ())
    if not given:
        raise DefinitionError("experiments = [] must hold at least one experiment")
    for k, each in enumerate(given):
        if not isinstance(each, Experiment):
            raise DefinitionError(f"experiments[{k}] = {each!r} must be an Experiment")
        if len(each.actuation.rotations) != len(robot.tubes):
            raise DefinitionError(
                f"experiments[{k}]: actuation is of {len(each.actuation.rotations)} tubes, but the robot has "
                f"{len(robot.tubes)}"
            )
        for measurement in each.measurements:
            measurement.check(len(robot.tubes))
    return given


def _blocks(experiment: Experiment) -> tuple[tuple[int, int, int], ...]:
    blocks, start = [], 0
    for j, each in enumerate(experiment.measurements):
        count, size = each.shape
        for _ in range(count):
            blocks.append((start, size, j))
            start += size
    return tuple(blocks)


def _rows(acting: list[tuple[str, int, Array]], sizes: dict[str, int], unknowns: int) -> Array:
    """``d numbers / dx`` of the numbers of these names, one behind the other."""
    starts = dict(zip(sizes, np.cumsum([0, *sizes.values()]), strict=False))
    rows = np.zeros((sum(sizes.values()), unknowns))
    for name, first, part in acting:
        start = int(starts[name]) + first
        rows[start : start + len(part)] += part
    return rows


def _ends_x(mixing: Array, sizes: dict[str, int], tubes: int) -> Array:
    """``d ends / dx`` of the tubes, from the numbers of these names: translations, and lengths of pieces."""
    ends, start = np.zeros((len(mixing), tubes, mixing.shape[2])), 0
    for name, size in sizes.items():
        match parsed(name):
            case ("translations",):
                ends += mixing[:, start : start + size]
            case ("tubes", int(i), "precurvature", _, "length"):
                ends[:, i] += mixing[:, start]
        start += size
    return ends
