"""One case of a force estimation: experiment, unknown numbers, model errors and search."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from itertools import compress

import attrs
import numpy as np
from numpy.typing import NDArray

from ..calibration.fit import Fit
from ..checks import Array
from ..errors import DefinitionError, EstimationError
from ..estimation.blocks import Blocks, form
from ..estimation.chi_square import p_value
from ..estimation.comparison import Comparison
from ..estimation.experiment import Experiment
from ..estimation.measurements import Measurement
from ..estimation.places import nearest
from ..forward.equilibrium import Equilibrium
from ..layout.configuration import Configuration
from ..layout.ends import Ends
from ..layout.observables import Observable
from ..loads.gravity import Gravity
from ..loads.kind import Load
from ..robot.actuation import Actuation
from ..robot.names import NamedNumber, euler_rates, parameters
from ..robot.robot import Robot
from .model import LoadedModel, loaded_model
from .numbers import Numbered
from .search import LoadUnknowns, Search, SearchState
from .spread import Spread, between, within_cone
from .unknown import UnknownLoad

_UNLIKELY = 1e-3  # p-value below which residuals are too large for the model


@attrs.frozen(eq=False)
class Errors:
    """Uncertain numbers of the model: their names and a factor of their covariance."""

    names: tuple[str, ...]
    spread: Array

    @property
    def count(self) -> int:
        """Count of standard normal errors."""
        return int(self.spread.shape[1])

    @classmethod
    def of(cls, robot: Robot, experiment: Experiment, fit: Fit | None, joints: Mapping[str, Array | None]) -> Errors:
        """Errors of calibration and actuation that act in an experiment."""
        if fit is None and all(sigma is None for sigma in joints.values()):
            return cls((), np.zeros((0, 0)))
        return cls._of(parameters(robot, experiment.actuation, experiment.loads), fit, joints)

    @classmethod
    def ever(cls, robot: Robot, fit: Fit | None, joints: Mapping[str, Array | None]) -> Errors:
        """Errors of calibration and actuation that act in any experiment of the robot."""
        held = Actuation(np.zeros(len(robot.tubes)), np.zeros(len(robot.tubes)))
        return cls._of(parameters(robot, held, [Gravity(np.zeros(3))]), fit, joints)

    @classmethod
    def _of(cls, known: Mapping[str, NamedNumber], fit: Fit | None, joints: Mapping[str, Array | None]) -> Errors:
        parts = [] if fit is None else _of_fit(fit, {name: one.size for name, one in known.items() if not one.idle})
        parts += [{name: np.diag(sigma)} for name, sigma in joints.items() if sigma is not None]
        names = tuple(dict.fromkeys(name for part in parts for name in part))
        columns = [np.vstack([_padded(part, name, known[name].size) for name in names]) for part in parts]
        return cls(names, np.hstack(columns) if columns else np.zeros((0, 0)))

    def acting(self, robot: Robot, experiment: Experiment) -> Errors:
        """These errors, restricted to the numbers that act in an experiment."""
        if not self.names:
            return self
        known = parameters(robot, experiment.actuation, experiment.loads)
        acts = [not known[name].idle for name in self.names]
        rows = np.repeat(acts, [known[name].size for name in self.names])
        return Errors(tuple(compress(self.names, acts)), self.spread[rows])


def _padded(part: Mapping[str, Array], name: str, size: int) -> Array:
    return part[name] if name in part else np.zeros((size, next(iter(part.values())).shape[1]))


def _of_fit(fit: Fit, sizes: Mapping[str, int]) -> list[dict[str, Array]]:
    """Matrices from standard normal errors of a fit's parameters to the model's numbers."""
    if not isinstance(fit, Fit):
        raise DefinitionError(f"fit = {fit!r} must be a Fit")
    unknowns = fit.estimation.unknowns
    rows: dict[str, Array] = {}
    for name, first, part in unknowns.acting(-1):
        if name in sizes:
            share = rows.setdefault(name, np.zeros((sizes[name], unknowns.size)))
            share[first : first + len(part)] += part
    if not rows:
        return []
    used = np.flatnonzero(np.any([share.any(axis=0) for share in rows.values()], axis=0))
    covariance = fit.covariance[np.ix_(used, used)]
    if not np.isfinite(covariance).all():
        raise EstimationError(
            f"fit does not determine all parameters of the robot: {'; '.join(map(str, fit.undetermined))}; the force's "
            "error cannot be computed"
        )
    if "base.rotation" in rows:
        rows["base.rotation"] = euler_rates(np.asarray(fit.values["base.rotation"])) @ rows["base.rotation"]
    values, vectors = np.linalg.eigh(covariance)
    factor = vectors * np.sqrt(np.maximum(values, 0.0))
    return [{name: share[:, used] @ factor for name, share in rows.items()}]


@attrs.frozen(eq=False)
class Case:
    """An experiment, its unknown loads, and the search for them.

    ``forces`` holds the scales of numbers that are forces, and zeros. ``roughness`` is the quadratic form of a
    distributed force with unknown smoothness. ``scans`` caches models of the search for contacts.
    """

    robot: Robot
    experiment: Experiment
    observables: tuple[Observable, ...]
    numbered: Numbered
    errors: Errors
    loss: str
    compiled: bool | None
    ends: Ends
    search: Search
    forces: Array
    roughness: Array | None
    scans: dict[bytes, LoadedModel] = attrs.field(factory=dict)

    @classmethod
    def of(
        cls,
        robot: Robot,
        experiment: Experiment,
        unknown: tuple[UnknownLoad, ...],
        errors: Errors,
        loss: str,
        compiled: bool | None,
        steps: Callable[[], int],
        kept: Sequence[Case],
    ) -> Case:
        """The case of an experiment; it reuses the model of a ``kept`` case if possible."""
        ends = Ends.of_robot(robot, experiment.actuation.translations)
        experiment.check_places(ends)
        unknown, observables = tuple(one.placed(ends) for one in unknown), experiment.framed(ends)
        before = next((case for case in kept if case.serves(experiment, observables, ends, errors, unknown)), None)
        if before is not None:
            return before.again(experiment, ends)
        numbered = Numbered.of(unknown, len(experiment.loads))
        loads = (*experiment.loads, *numbered.templates)
        configuration = Configuration(robot, experiment.actuation, loads)
        model = loaded_model(
            robot,
            experiment.actuation,
            loads,
            numbered.names,
            errors.names,
            observables,
            compiled,
            steps,
        )
        unit = configuration.scales.unknowns(configuration.tube_count, configuration.kind.live)
        unknowns, forces = _unknowns(robot, numbered, ends, errors)
        measured = Comparison([experiment.measurements], loss), Blocks.of(experiment.measurements, loss)
        search = Search(model, experiment.actuation, unit, ends.length, unknowns, *measured)
        rough = numbered.roughness()
        return cls(robot, experiment, observables, numbered, errors, loss, compiled, ends, search, forces, rough)

    def serves(
        self,
        experiment: Experiment,
        observables: tuple[Observable, ...],
        ends: Ends,
        errors: Errors,
        unknown: tuple[UnknownLoad, ...],
    ) -> bool:
        """Whether this case's model also serves another experiment with its placed unknown loads."""
        before = self.experiment
        return (
            self.observables == observables
            and form(before.measurements) == form(experiment.measurements)
            and before.loads == experiment.loads
            and self.ends.innermost() == ends.innermost()
            and self.numbered.serves(unknown)
            and self.errors.names == errors.names
            and np.array_equal(self.errors.spread, errors.spread)
        )

    def again(self, experiment: Experiment, ends: Ends) -> Case:
        """The case of another experiment that the same model serves."""
        search = self.search
        unknowns = search.unknowns
        if ends.points != self.ends.points:
            scale, lower, upper = extent(self.robot, self.numbered, ends)
            unknowns = attrs.evolve(unknowns, scale=scale, lower=lower, upper=upper)
        measured = Comparison([experiment.measurements], self.loss), search.blocks
        search = Search(search.model, experiment.actuation, search.unit, ends.length, unknowns, *measured)
        return attrs.evolve(self, experiment=experiment, ends=ends, search=search)

    @property
    def start(self) -> Array:
        """Start values: the prior's mean within bounds."""
        unknowns = self.search.unknowns
        return np.clip(unknowns.prior_mean, unknowns.lower, unknowns.upper)

    @property
    def contacts(self) -> list[slice]:
        """Slices of the numbers of unknown loads at unknown places."""
        return [part for part in self.numbered.parts if "arc_length" in self.numbered.fields[part]]

    def resting(self, shape: Equilibrium) -> SearchState:
        """The state without the unknown loads, with points at the nearest places."""
        state = self.search.at(shape.unknowns, self.start, self.places(shape), np.zeros(self.search.errors))
        if state is None:
            raise EstimationError("without the unknown loads the robot's shape cannot be compared with measurements")
        return state

    def places(self, shape: Equilibrium) -> Array:
        """Likely places of points at unknown arc lengths, from a shape."""
        return nearest(self.experiment, shape, self.loss)

    def likely(self, state: SearchState) -> bool:
        """Whether model and noise explain the residuals; if not, the search may have missed a better place."""
        return p_value(2.0 * state.cost, len(state.misfit)) > _UNLIKELY

    def ways(self, state: SearchState) -> Array:
        """Free directions of the numbers: an orthonormal basis in their scales, as columns ``(k, n)``.

        Active bounds fix directions: a force at a bound, a normal force of zero, a force on the friction cone.
        """
        tangent, unknowns = state.tangent, self.search.unknowns
        if tangent is None:
            moving = unknowns.at_places | ((state.x > unknowns.lower) & (state.x < unknowns.upper))
            tangent = np.eye(len(state.x))[:, moving]
        return np.linalg.qr(tangent / self.search.unknowns.scale[:, None])[0]

    def possible(self, free: Spread, x: Array) -> Spread:
        """Deviations from ``x``, scaled, that bounds and friction cones allow, applied one after the other."""
        unknowns = self.search.unknowns
        at, lower, upper = (one / unknowns.scale for one in (x, unknowns.lower, unknowns.upper))
        for part, one in zip(self.numbered.parts, self.numbered.unknown, strict=True):
            if one.cone is not None:
                free = free.given(part, within_cone(free.of(part), at[part], *one.cone))
        for k in np.flatnonzero(self.confined):
            part = slice(k, k + 1)
            free = free.given(part, between(free.of(part), lower[k] - at[k], upper[k] - at[k]))
        return free

    @property
    def confined(self) -> NDArray[np.bool_]:
        """Boolean array of the bounded numbers, places excluded."""
        unknowns = self.search.unknowns
        return ~unknowns.at_places & (np.isfinite(unknowns.lower) | np.isfinite(unknowns.upper))

    @property
    def bounded(self) -> bool:
        """Whether bounds or a friction cone confine any number, places excluded."""
        cones = any(one.cone is not None for one in self.numbered.unknown)
        return cones or bool(self.confined.any())

    def contact(self, part: slice) -> UnknownLoad:
        """The contact with the numbers at ``part``."""
        return self.numbered.unknown[self.numbered.parts.index(part)]

    def loads_at(self, x: Array) -> list[Load]:
        """Known loads and unknown loads with the numbers ``x``."""
        return self.numbered.loads_at(self.experiment.loads, self.search.unknowns.mixing @ x)

    def slopes_of(self, measurement: Measurement, state: SearchState, steps: Callable[[], int]) -> Array:
        """Slopes ``(numbers, k + q)`` of another measurement, at known places, by loads and errors at a state."""
        experiment = attrs.evolve(self.experiment, measurements=(measurement,))
        unknown, errors = self.numbered.unknown, self.errors
        case = Case.of(self.robot, experiment, unknown, errors, "squared", self.compiled, steps, ())
        there = case.search.at(state.z, state.x, np.zeros(0), state.e)
        if there is None:
            raise EstimationError("the model cannot be evaluated at the estimate")
        return there.slopes


def _unknowns(robot: Robot, numbered: Numbered, ends: Ends, errors: Errors) -> tuple[LoadUnknowns, Array]:
    from scipy.linalg import block_diag

    size = len(numbered.labels)
    mean = np.zeros(size)
    scale, lower, upper = extent(robot, numbered, ends)
    information = []
    for k, (part, one) in enumerate(zip(numbered.parts, numbered.unknown, strict=True)):
        one.check_scale(scale[part], f"unknown[{k}]")
        known = one.known_before
        information.append(np.zeros((part.stop - part.start,) * 2) if known is None else known.information)
        mean[part] = 0.0 if known is None else known.mean
    fields = np.array(numbered.fields)
    forces = np.where((fields == "force") | (fields == "normal_force"), scale, 0.0)
    mixing = np.asarray(block_diag(*(one.mixing for one in numbered.unknown)))
    at_places = fields == "arc_length"
    unknowns = LoadUnknowns(
        mixing, scale, mean, np.asarray(block_diag(*information)), lower, upper, at_places, errors.spread
    )
    return unknowns, forces


def extent(robot: Robot, numbered: Numbered, ends: Ends) -> tuple[Array, Array, Array]:
    """Scales, lower and upper bounds of the numbers; scales and bounds of places follow from the robot's length."""
    length, stiffness = ends.length, robot.tubes[0].bending_stiffness
    size = len(numbered.labels)
    lower, upper = np.full(size, -np.inf), np.full(size, np.inf)
    scales = {"force": stiffness / length**2, "moment": stiffness / length, "arc_length": length}
    scales["density"], scales["normal_force"] = scales["force"] / length, scales["force"]
    scale = np.array([scales[field] for field in numbered.fields])
    for part, one in zip(numbered.parts, numbered.unknown, strict=True):
        lower[part], upper[part] = one.limits_on(ends)
    return scale, lower, upper
