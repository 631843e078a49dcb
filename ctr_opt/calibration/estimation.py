"""Calibration as an estimation: unknowns, experiments and a loss, with derivatives at any values and states.

The state of an experiment holds its base moments (SI), followed by the estimated places of its points. Two methods use
it. In ``simultaneous.py`` the states are unknowns beside the parameters. In ``reduced.py`` equilibria and places are
solved for at each step. Both reach the same answer.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from copy import copy
from functools import cached_property
from typing import Any

import attrs
import numpy as np
from numpy.typing import NDArray

from ..checks import Array, choice, listed
from ..errors import DefinitionError, EstimationError, SolveError
from ..estimation.blocks import Blocks, form
from ..estimation.comparison import Comparison
from ..estimation.experiment import Experiment
from ..estimation.linearized import Linearized
from ..estimation.losses import LOSSES
from ..estimation.models.compiled import CompiledModel, compilable
from ..estimation.models.symbolic import SymbolicModel, structure
from ..estimation.places import moved, nearest, pulls
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
"""Function called with the name of the work, the amount done and the total amount."""

_SETTLED = 1e-10  # of the robot's length: places that move less have converged
_MOST_MOVES = 60


@attrs.frozen(eq=False)
class Layout:
    """An experiment in the estimation: its group, acting parameters and unknowns, observables and misfit blocks."""

    group: int
    names: tuple[str, ...]
    acting: NDArray[np.intp]
    observables: tuple[Observable, ...]
    blocks: Blocks


@attrs.frozen(eq=False)
class Group:
    """Experiments that one model serves; ``mixing (E, numbers, j)`` maps the unknowns ``acting (E, j)`` to its numbers.

    Six numbers of the pose of each of the ``sensors`` follow the model's numbers; they act on predictions only.
    ``ends (E, tubes)`` are the tubes' ends at the initial values, ``ends_x (E, tubes, j)`` their constant slopes. In
    the virtual machine ``start (E, k)`` holds all numbers at the initial values, of which ``symbolic.active`` move.
    """

    members: list[int]
    acting: NDArray[np.intp]
    mixing: Array
    sensors: tuple[str, ...]
    ends: Array
    ends_x: Array
    unit: Array
    comparison: Comparison
    compiled: CompiledModel | None = None
    symbolic: SymbolicModel | None = None
    start: Array | None = None


class Estimation:
    """A calibration problem: checked input, models, and evaluation with derivatives."""

    def __init__(
        self,
        robot: Robot,
        experiments: Sequence[Experiment],
        wanted: Iterable[str | Parameter],
        loss: str,
        tolerance: float,
        compiled: bool | None = None,
    ) -> None:
        nominal = ForwardProblem(robot, tolerance=tolerance, compiled=compiled)
        self.robot, self.tolerance, self.compiled = robot, nominal.settings.tolerance, nominal.compiled
        self.experiments = _checked(robot, experiments)
        self.loss = choice(loss, "loss", LOSSES)
        self.unknowns = Unknowns(robot, [(one.actuation, one.loads) for one in self.experiments], wanted)
        for k, experiment in enumerate(self.experiments):
            experiment.check_places(self._ends[k], f"experiment {experiment.name or k}: ")
        scaled = {measurement.scaled for one in self.experiments for measurement in one.measurements}
        if scaled == {True, False}:
            raise DefinitionError("sigma must be given for all measurements, or for none")
        self.scaled = scaled == {True}
        if not self.scaled and loss in ("huber", "cauchy"):
            raise DefinitionError(f"loss = {loss!r} requires the sigma of every measurement to detect outliers")
        known = [entry.name for entry in self.unknowns.entries if np.isfinite(entry.prior_sigma).any()]
        if not self.scaled and known:
            raise DefinitionError(f"{known[0]}: a prior requires the sigma of every measurement to weigh them")
        self._lay_out(self._framed(self._ends))

    @cached_property
    def _ends(self) -> list[Ends]:
        """Tube ends in each experiment at the initial values."""
        return self._ends_at(self.unknowns.initial)

    def _ends_at(self, x: Array) -> list[Ends]:
        robot, count = self.unknowns.robot_at(x), len(self.experiments)
        return [Ends.of_robot(robot, self.unknowns.experiment_at(x, k)[0].translations) for k in range(count)]

    def of(self, experiments: Sequence[Experiment]) -> Estimation:
        """The estimation of the same parameters from other experiments."""
        return Estimation(self.robot, experiments, self.unknowns.wanted, self.loss, self.tolerance, self.compiled)

    def by_squares(self) -> Estimation:
        """A copy with the same models and residuals, but the squared loss."""
        squared = copy(self)
        blocks = [attrs.evolve(layout.blocks, loss="squared") for layout in self.layouts]
        squared.layouts = [attrs.evolve(old, blocks=new) for old, new in zip(self.layouts, blocks, strict=True)]
        return squared

    def framed_at(self, x: Array) -> Estimation:
        """The estimation with poses of the tubes that are meant at ``x``: itself, if they are those it has."""
        observables = self._framed(self._ends_at(x))
        if observables == [layout.observables for layout in self.layouts]:
            return self
        other = copy(self)
        other._lay_out(observables)
        return other

    @property
    def prepared(self) -> bool:
        """Whether the models have been built."""
        return bool(self.models)

    # -- structure -------------------------------------------------------------------------------------------------

    def _framed(self, ends: Sequence[Ends]) -> list[tuple[Observable, ...]]:
        """Each experiment's observables on robots with tubes that end there."""
        return [experiment.framed(those) for experiment, those in zip(self.experiments, ends, strict=True)]

    def _lay_out(self, framed: Sequence[tuple[Observable, ...]]) -> None:
        """Sort the experiments, with these observables, into groups that models will be built for."""
        self.layouts = self._layouts(framed)
        groups = range(1 + max(layout.group for layout in self.layouts))
        self.members = [[k for k, layout in enumerate(self.layouts) if layout.group == group] for group in groups]
        self.models: list[Group] = []

    def _layouts(self, framed: Sequence[tuple[Observable, ...]]) -> list[Layout]:
        groups: dict[Any, int] = {}
        layouts = []
        for k, (experiment, observables) in enumerate(zip(self.experiments, framed, strict=True)):
            acting = self.unknowns.acting(k)
            names = tuple(dict.fromkeys(name for name, _, _ in acting))
            blocks = Blocks.of(experiment.measurements, self.loss)
            alike = structure(self.robot, experiment.actuation, experiment.loads, observables)
            group = groups.setdefault((alike, names, form(experiment.measurements)), len(groups))
            rows = np.vstack([self.unknowns.of_sensors(names_of(observables)), *(part for _, _, part in acting)])
            layouts.append(Layout(group, names, np.flatnonzero(rows.any(axis=0)), observables, blocks))
        return layouts

    # -- equilibria ------------------------------------------------------------------------------------------------

    def equilibria(
        self, x: Array, before: Sequence[Equilibrium | None] | None = None, progress: Progress | None = None
    ) -> list[Equilibrium]:
        """The experiments' equilibria at values ``x``, each started from the one ``before`` if there is one."""
        problem = ForwardProblem(self.unknowns.robot_at(x), tolerance=self.tolerance, compiled=self._forward)
        equilibria: list[Equilibrium] = []
        for k, experiment in enumerate(self.experiments):
            start = None if before is None else before[k]
            try:
                equilibria.append(problem.solve(*self.unknowns.experiment_at(x, k), initial=start))
            except SolveError as error:
                raise SolveError(f"experiment {experiment.name or k}: {error}", error.result) from None
            if progress is not None:
                progress("equilibria", k + 1, len(self.experiments))
        return equilibria

    def equilibria_of(self, x: Array, whose: str, progress: Progress | None = None) -> list[Equilibrium]:
        """The equilibria without a start; an ``EstimationError`` names ``whose`` values have no equilibrium."""
        try:
            return self.equilibria(x, progress=progress)
        except SolveError as error:
            raise EstimationError(f"{whose} have no equilibrium in {error}") from error

    def states(self, x: Array, equilibria: Sequence[Equilibrium]) -> list[Array]:
        """States of equilibria at values ``x``, with the places optimized."""
        self.prepare(equilibria)
        return self.settled(x, self.first_states(equilibria))

    def first_states(self, equilibria: Sequence[Equilibrium]) -> list[Array]:
        """States of equilibria, with the best places of a grid."""
        return [
            np.concatenate((shape.unknowns, nearest(experiment, shape, self.loss)))
            for experiment, shape in zip(self.experiments, equilibria, strict=True)
        ]

    def settled(self, x: Array, states: Sequence[Array], *, solved: bool = True) -> list[Array]:
        """States with the places optimized, from nearby states; ``solved`` also brings the model to equilibrium.

        Base moments take Newton steps, and places Gauss-Newton steps. These are shortened if they oscillate, for
        example if a point is far from the backbone on the outer side of a bend.
        """
        states = [state.copy() for state in states]
        if not any(layout.blocks.places for layout in self.layouts):
            return states
        before = [np.zeros((len(group.members), self._of(group).blocks.places)) for group in self.models]
        gains = [np.ones(steps.shape) for steps in before]
        for _ in range(_MOST_MOVES):
            for g, (group, here) in enumerate(zip(self.models, self.linearize_groups(x, states), strict=True)):
                moments = here.step if solved else np.zeros_like(here.residual)
                blocks, misfit = self._of(group).blocks, here.settled if solved else here.misfit
                slopes, curvatures = pulls(misfit, here.misfit_s, blocks.weights(misfit)[1])
                step = moved(here.places, slopes, curvatures / gains[g], blocks.orders) - here.places
                gains[g][(step * before[g] < 0.0) & (np.abs(step) > 0.5 * np.abs(before[g]))] *= 0.5
                before[g] = step
                for k, change in zip(group.members, np.hstack((moments, step)), strict=True):
                    states[k] += change
            if max(np.abs(step).max(initial=0.0) for step in before) < _SETTLED:
                break
        return states

    def _of(self, group: Group) -> Layout:
        """The layout of a group's experiments."""
        return self.layouts[group.members[0]]

    @property
    def _forward(self) -> bool | None:
        """Whether forward solves are compiled: always, if a model is."""
        return True if any(group.compiled is not None for group in self.models) else self.compiled

    def prepare(self, equilibria: Sequence[Equilibrium]) -> None:
        """Build the groups' models, with the largest number of steps that an equilibrium needed."""
        if self.models:
            return
        for members in self.members:
            layout, experiment = self.layouts[members[0]], self.experiments[members[0]]
            configuration = Configuration(self.robot, equilibria[members[0]].actuation, experiment.loads)
            sizes, sensors = self.unknowns.sizes(layout.names, members[0]), names_of(layout.observables)
            acting, mounted = np.array([self.layouts[k].acting for k in members]), self.unknowns.of_sensors(sensors)
            whole = (np.vstack((_rows(self.unknowns.acting(k), sizes, self.unknowns.size), mounted)) for k in members)
            mixing = np.array([rows[:, columns] for rows, columns in zip(whole, acting, strict=True)])
            parts: dict[str, Any] = {"members": members, "acting": acting, "mixing": mixing, "sensors": sensors}
            parts["unit"] = configuration.scales.unknowns(configuration.tube_count, configuration.kind.live)
            parts["ends"] = np.array([self._ends[k].points for k in members])
            parts["ends_x"] = _ends_x(mixing, sizes, len(self.robot.tubes))
            parts["comparison"] = Comparison([self.experiments[k].measurements for k in members], self.loss)
            if compilable(self.robot, experiment.loads, layout.observables, layout.names, self.compiled):
                observables = [self.layouts[k].observables for k in members]
                self.models.append(Group(**parts, compiled=CompiledModel(observables, sizes)))
            else:
                steps = max(equilibria[k].solved().steps for k in members[:: max(1, len(members) // 100)])
                model = SymbolicModel(configuration, layout.observables, layout.names, steps)
                self.models.append(Group(**parts, symbolic=model, start=self._numbers(model, members)))

    def _numbers(self, model: SymbolicModel, members: list[int]) -> Array:
        initial = self.unknowns.initial
        values = {name: np.asarray(value) for name, value in self.unknowns.robot_numbers(initial).items()}
        at = [(self.unknowns.experiment_at(initial, k), self.layouts[k].observables) for k in members]
        return np.array([model.numbers(values, *experiment, observables) for experiment, observables in at])

    @property
    def units(self) -> list[Array]:
        """Scales of each experiment's base moments."""
        units = {k: group.unit for group in self.models for k in group.members}
        return [units[k] for k in range(len(self.experiments))]

    # -- evaluation ------------------------------------------------------------------------------------------------

    def linearize(self, x: Array, states: Sequence[Array]) -> list[Linearized]:
        """Linearize all experiments at values ``x`` and their states."""
        experiments: dict[int, Linearized] = {}
        for group, linearized in zip(self.models, self.linearize_groups(x, states), strict=True):
            experiments |= {k: linearized.one(e) for e, k in enumerate(group.members)}
        return [experiments[k] for k in range(len(self.experiments))]

    def linearize_groups(self, x: Array, states: Sequence[Array]) -> list[Linearized]:
        """Linearize the experiments of each group together."""
        return [self._linearized(group, x, np.array([states[k] for k in group.members])) for group in self.models]

    def _linearized(self, group: Group, x: Array, states: Array) -> Linearized:
        z, places = np.split(states, [len(group.unit)], axis=1)
        length, length_x = self._length(group, x)
        s, shares = places * length[:, None], places
        if group.symbolic is not None:  # infinite places stay at the moving tip
            s, shares = np.where(places < 1.0, s, np.inf), np.where(places < 1.0, places, 0.0)
        residual, predictions, slopes = self._evaluate(group, x, z, s)
        if group.sensors:
            mountings = {name: self.unknowns.mounting(name, x) for name in group.sensors}
            predictions = sensed(self._of(group).observables, predictions, mountings)
        misfit, along = group.comparison.compare(predictions), group.comparison.along(predictions)
        here = Linearized.of(residual, slopes, misfit, along, group.mixing, places, length[:, None, None])
        return attrs.evolve(here, misfit_x=here.misfit_x + (along @ shares[..., None]) * length_x[:, None])

    def _length(self, group: Group, x: Array) -> tuple[Array, Array]:
        """The robot's length in each experiment of a group, and its slopes by the unknowns that act on it."""
        moved = x[group.acting] - self.unknowns.initial[group.acting]
        ends = group.ends + np.einsum("etj,ej->et", group.ends_x, moved)
        rows, longest = np.arange(len(ends)), outermost_at_tip(chained(ends))  # as symbols are sorted
        return ends[rows, longest], group.ends_x[rows, longest]

    def _evaluate(self, group: Group, x: Array, z: Array, s: Array) -> tuple[Array, ObservedList, Array]:
        """Residuals, predictions and the residuals' slopes of a group; ``s`` are the estimated arc lengths."""
        if group.symbolic is not None and group.start is not None:
            theta = group.start.copy()
            moved = x[group.acting] - self.unknowns.initial[group.acting]
            active = group.symbolic.active
            theta[:, active] += np.einsum("ekj,ej->ek", group.mixing[:, : len(active)], moved)
            theta[:, group.symbolic.somewhere] = s
            return group.symbolic.evaluate(z, theta)
        assert group.compiled is not None
        numbers = self.unknowns.robot_numbers(x)
        experiments = [self.unknowns.experiment_at(x, k) for k in group.members]
        angles = np.asarray(numbers.get("base.rotation", np.zeros(3)))
        return group.compiled.evaluate(self.unknowns.robot_at(x), experiments, z, angles, s)

    def cost(self, linearized: Sequence[Linearized]) -> float:
        """Loss of all misfits, without priors."""
        pairs = zip(self.layouts, linearized, strict=True)
        return float(sum(layout.blocks.weights(here.misfit)[0] for layout, here in pairs))

    def prior_cost(self, x: Array) -> float:
        """Loss of the priors: half the squared deviations."""
        mean, sigma = self.unknowns.prior
        return 0.5 * float(np.sum(((x - mean) / sigma) ** 2))


def _checked(robot: Robot, experiments: Any) -> list[Experiment]:
    one = isinstance(experiments, Experiment)
    checked = [experiments] if one else listed(experiments, "experiments", "a list of experiments")
    if not checked:
        raise DefinitionError("experiments = [] must hold at least one experiment")
    for k, experiment in enumerate(checked):
        if not isinstance(experiment, Experiment):
            raise DefinitionError(f"experiments[{k}] = {experiment!r} must be an Experiment")
        experiment.check_robot(len(robot.tubes), f"experiments[{k}]: ")
    return checked


def _rows(acting: list[tuple[str, int, Array]], sizes: dict[str, int], unknowns: int) -> Array:
    """Derivatives ``d numbers / dx`` of the named parameters' numbers, stacked in order."""
    starts = dict(zip(sizes, np.cumsum([0, *sizes.values()]), strict=False))
    rows = np.zeros((sum(sizes.values()), unknowns))
    for name, first, part in acting:
        start = int(starts[name]) + first
        rows[start : start + len(part)] += part
    return rows


def _ends_x(mixing: Array, sizes: dict[str, int], tubes: int) -> Array:
    """Derivatives ``d ends / dx`` of the tubes' ends, by translations and by lengths of pieces."""
    ends, start = np.zeros((len(mixing), tubes, mixing.shape[2])), 0
    for name, size in sizes.items():
        match parsed(name):
            case ("translations",):
                ends += mixing[:, start : start + size]
            case ("tubes", int(i), "precurvature", _, "length"):
                ends[:, i] += mixing[:, start]
        start += size
    return ends
