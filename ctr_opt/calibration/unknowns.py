"""Unknowns of an estimation: named parameters with prior, bounds and scale, as a flat vector of numbers."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import cached_property
from itertools import pairwise
from typing import Any

import attrs
import numpy as np

from ..checks import ANY_EQ, Array, array, dimensions, number, short
from ..errors import DefinitionError
from ..estimation.sensors import Mounting
from ..loads.kind import Load
from ..robot.actuation import Actuation
from ..robot.names import NamedNumber, chosen, loads_with, parameters, parsed, robot_with, shown
from ..robot.robot import Robot
from .homes import Homes

_OFF_ROBOT = ("rotations", "translations", "loads", "sensors")  # act on experiments or sensors


def _pair(value: Any, field: str, parts: str) -> tuple[Any, Any] | None:
    if value is None:
        return None
    if not isinstance(value, (tuple, list)) or len(value) != 2:
        raise DefinitionError(f"{field} = {value!r} must be a pair ({parts})")
    return value[0], value[1]


def _prior(value: Any) -> tuple[Any, Any] | None:
    return _pair(value, "prior", "mean, standard deviation")


def _bounds(value: Any) -> tuple[Any, Any] | None:
    return _pair(value, "bounds", "least, most")


def _names(value: Any) -> tuple[str, ...]:
    names = (value,) if isinstance(value, str) else value
    if not isinstance(names, (list, tuple)) or not all(isinstance(name, str) for name in names):
        raise DefinitionError(f"tied = {value!r} must be a list of names of parameters")
    return tuple(names)


@attrs.frozen
class Parameter:
    """An unknown parameter of a calibration, with optional prior, bounds, start and scale.

    Parameters
    ----------
    name
        Name of one number or of an array:

        - a parameter of the robot, as in :meth:`Equilibrium.sensitivity <ctr_opt.Equilibrium.sensitivity>`:
          ``"tubes[0].bending_stiffness"``, ``"tubes[0].precurvature[1].coefficients"``, ``"base.translation"``;
        - ``"tubes[0].rotation_offset"`` (rad) or ``"tubes[0].translation_offset"`` (m), added to every actuation;
        - ``"sensors.coil.translation"`` ``(3,)``, m, or ``"sensors.coil.rotation"`` ``(3,)``, intrinsic XYZ Euler
          angles, rad: the pose of the sensor ``"coil"`` in the frame of its tube;
        - a number of a load that all experiments share, ``"loads[0].stiffness"``;
        - a number of one experiment, ``"experiments[3].loads[0].force"``, ``"experiments[3].rotations"``;
        - with ``tied``, any name for a common factor.
    prior
        ``(mean, standard deviation)``, numbers or arrays of the parameter's shape. Every measurement must then have a
        ``sigma``.
    bounds
        ``(least, most)``, numbers or arrays of the parameter's shape. Default: stiffnesses, moduli, diameters and
        lengths stay positive, within a factor of 100; angles stay within half a turn; other parameters are free. No
        translation may put a tube's base in front of the entry point.
    initial
        Start value. Default: the value of the robot or experiment, zero for offsets, one for factors.
    scale
        Expected size of the change. Default: from the value, or from the robot's length.
    tied
        Names of parameters that this factor multiplies. It is 1 at the robot's nominal values.

    Examples
    --------
    >>> Parameter("tubes[0].bending_stiffness", prior=(0.02, 0.004)).name
    'tubes[0].bending_stiffness'
    """

    name: str
    prior: Any = attrs.field(default=None, converter=_prior, eq=ANY_EQ, hash=False)
    bounds: Any = attrs.field(default=None, converter=_bounds, eq=ANY_EQ, hash=False)
    initial: Any = attrs.field(default=None, eq=ANY_EQ, hash=False)
    scale: Any = attrs.field(default=None, eq=ANY_EQ, hash=False)
    tied: tuple[str, ...] = attrs.field(default=(), converter=_names)


@attrs.frozen(eq=False)
class Unknown:
    """A parameter of an estimation with start, bounds, scale and prior as flat arrays."""

    name: str
    shape: tuple[int, ...]
    initial: Array
    scale: Array
    lower: Array
    upper: Array
    prior_mean: Array
    prior_sigma: Array
    labels: tuple[str, ...]
    acts_on: tuple[str, ...]
    """Names of the robot parameters or actuations (``rotations[i]``, ``translations[i]``) that it sets."""
    unit: str
    experiment: int | None = None
    factors: tuple[Array, ...] | None = None
    """Nominal values of tied parameters; None for others."""

    @property
    def size(self) -> int:
        """Count of numbers."""
        return len(self.initial)

    @property
    def of_robot(self) -> bool:
        """Whether it is a parameter of the robot, not of an experiment, an actuation or a sensor."""
        return self.experiment is None and self.holder not in _OFF_ROBOT

    @property
    def shared(self) -> bool:
        """Whether it is a number of a load that all experiments share."""
        return self.experiment is None and self.holder == "loads"

    @property
    def holder(self) -> str | int:
        """Holder of the numbers: ``"tubes"``, ``"base"``, ``"rotations"``, ``"translations"``, ``"loads"``, ..."""
        return parsed(self.acts_on[0])[0]


class Unknowns:
    """All unknowns of an estimation as a flat vector ``x``, and the robot, actuations and loads that ``x`` defines.

    For all numbers: start values ``initial``; sizes ``scale``; ``bounds``, least and largest; ``prior``, mean and
    standard deviation, infinite without a prior; ``labels``; ``units``, factor and unit in reports.
    """

    def __init__(
        self,
        robot: Robot,
        experiments: Sequence[tuple[Actuation, tuple[Load, ...]]],
        wanted: Iterable[str | Parameter],
    ) -> None:
        self.robot = robot
        self.experiments = list(experiments)
        listed = [one if isinstance(one, Parameter) else Parameter(one) for one in _listed(wanted)]
        if not listed:
            raise DefinitionError("parameters = [] must name at least one parameter")
        names = [parameter.name for parameter in listed]
        for k, name in enumerate(names):
            if not isinstance(name, str):
                raise DefinitionError(f"parameters[{k}] = {short(name)} must be the name of a parameter")
            if name in names[:k]:
                raise DefinitionError(f"parameters lists {name!r} twice")
        self.wanted = listed
        self.entries = [self._entry(parameter) for parameter in listed]
        self._check_doubled()
        ends = np.cumsum([0, *(entry.size for entry in self.entries)]).tolist()
        self.size = ends[-1]
        self.parts = {entry.name: slice(*part) for entry, part in zip(self.entries, pairwise(ends), strict=True)}
        self.labels = [label for entry in self.entries for label in entry.labels]
        self.units = [shown(entry.unit) for entry in self.entries for _ in entry.labels]
        fields = ("initial", "scale", "lower", "upper", "prior_mean", "prior_sigma")
        flat = [np.concatenate([getattr(entry, field) for entry in self.entries]) for field in fields]
        self.initial, self.scale, self.bounds, self.prior = flat[0], flat[1], (flat[2], flat[3]), (flat[4], flat[5])

    def values(self, x: Array) -> dict[str, Any]:
        """Values by parameter name, floats and arrays."""
        return {
            entry.name: x[part].reshape(entry.shape) if entry.shape else float(x[part][0])
            for entry, part in zip(self.entries, self.parts.values(), strict=True)
        }

    # -- robot and experiments ---------------------------------------------------------------------------------------

    def robot_numbers(self, x: Array) -> dict[str, Any]:
        """Values of the robot's unknown parameters by name."""
        return self._raw(x, None)

    def robot_at(self, x: Array) -> Robot:
        """The robot with the values ``x``."""
        return robot_with(self.robot, self.robot_numbers(x))

    @cached_property
    def moves_experiments(self) -> bool:
        """Whether any unknown acts on actuations or loads."""
        return not all(entry.of_robot for entry in self.entries)

    def experiment_at(self, x: Array, k: int) -> tuple[Actuation, tuple[Load, ...]]:
        """Actuation and loads of experiment ``k`` with the values ``x``."""
        actuation, loads = self.experiments[k]
        if not self.moves_experiments:
            return actuation, loads
        rotations, translations = np.array(actuation.rotations), np.array(actuation.translations)
        share, (turned, shifted) = self._raw(x, k), self.homes_at(x).offsets
        rotations = share.pop("rotations", rotations) + turned
        translations = share.pop("translations", translations) + shifted
        return Actuation(rotations, np.minimum(translations, 0.0)), loads_with(loads, share)

    def homes_at(self, x: Array) -> Homes:
        """Homes of the joints with the values ``x``."""
        names, numbers, where = self._homes
        offsets = np.zeros((2, len(self.robot.tubes)))
        offsets[where] = x[numbers]
        return Homes(names, offsets)

    @cached_property
    def _homes(self) -> tuple[tuple[str, ...], list[int], tuple[list[int], list[int]]]:
        """Names of joint offsets, their indices in ``x``, and the rotations (0) or translations (1) that they move."""
        offsets = [e for e in self.entries if e.experiment is None and e.holder in ("rotations", "translations")]
        kinds = [int(entry.holder == "translations") for entry in offsets]
        tubes = [_indexed(entry.acts_on[0])[1] for entry in offsets]
        names = tuple(entry.name for entry in offsets)
        return names, [self.parts[name].start for name in names], (kinds, tubes)

    def _raw(self, x: Array, experiment: int | None) -> dict[str, Any]:
        values: dict[str, Any] = {}
        for entry in self.entries:
            shared = experiment is not None and entry.shared
            if not shared and (entry.experiment != experiment or (experiment is None and not entry.of_robot)):
                continue
            part = x[self.parts[entry.name]]
            if entry.factors is not None:
                values |= {name: part[0] * factor for name, factor in zip(entry.acts_on, entry.factors, strict=True)}
            else:
                values[entry.acts_on[0]] = part.reshape(entry.shape) if entry.shape else float(part[0])
        return values

    def acting(self, experiment: int) -> list[tuple[str, int, Array]]:
        """Unknowns acting on an experiment: name, index of the first number, and ``d numbers / dx``.

        ``experiment = -1`` stands for a new experiment with other loads. The name is that of a robot's parameter,
        ``"rotations"``, ``"translations"`` or that of a load's number.
        """
        acting: list[tuple[str, int, Array]] = []
        for entry in self.entries:
            elsewhere = entry.experiment not in (None, experiment) or (entry.shared and experiment < 0)
            if elsewhere or entry.holder == "sensors":
                continue
            part = self.parts[entry.name]
            for j, name in enumerate(entry.acts_on):
                base, first = _indexed(name)
                rows = np.zeros((entry.size if entry.factors is None else entry.factors[j].size, self.size))
                rows[:, part] = np.eye(entry.size) if entry.factors is None else entry.factors[j].reshape(-1, 1)
                acting.append((base, first, rows))
        return acting

    def mounting(self, sensor: str, x: Array) -> Mounting:
        """Pose of a sensor in its tube's frame; zero where it is not an unknown."""
        kinds = (self.parts.get(f"sensors.{sensor}.{kind}") for kind in ("translation", "rotation"))
        translation, angles = (np.zeros(3) if part is None else x[part] for part in kinds)
        return translation, angles

    def of_sensors(self, sensors: Iterable[str]) -> Array:
        """Derivatives ``d numbers / dx`` of the six pose numbers of each sensor, ``(6 k, size)``."""
        parts = (self.parts.get(f"sensors.{name}.{kind}") for name in sensors for kind in ("translation", "rotation"))
        rows = [np.zeros((3, self.size)) if part is None else np.eye(self.size)[part] for part in parts]
        return np.vstack([np.zeros((0, self.size)), *rows])

    def sizes(self, names: Sequence[str], experiment: int) -> dict[str, int]:
        """Count of numbers of the named parameters in an experiment, by name."""
        known = parameters(self.robot, *self.experiments[experiment])
        return {name: known[name].size for name in names}

    # -- reading ---------------------------------------------------------------------------------------------------

    def _entry(self, wanted: Parameter) -> Unknown:
        if wanted.tied:
            return self._tied(wanted)
        match parsed(wanted.name):
            case ("tubes", int(i), "rotation_offset" | "translation_offset" as field):
                return self._offset(wanted, i, field)
            case ("sensors", str(), "translation" | "rotation"):
                return self._unknown(wanted, NamedNumber(wanted.name, np.zeros(3)), (wanted.name,))
            case ("loads", int(), str()):
                return self._of_loads(wanted)
            case ("experiments", int(k), "rotations" | "translations" | "loads", *_):
                return self._of_experiment(wanted, k)
        (parameter,) = chosen(self._known, [wanted.name], "parameters")
        return self._unknown(wanted, parameter, (wanted.name,))

    def _offset(self, wanted: Parameter, i: int, field: str) -> Unknown:
        if i >= len(self.robot.tubes):
            raise DefinitionError(f"{wanted.name!r}: the robot has {len(self.robot.tubes)} tubes, counted from 0")
        foremost = max(float(actuation.translations[i]) for actuation, _ in self.experiments)
        most = 0.0 - foremost if field == "translation_offset" else np.inf
        acts_on = (f"{field.removesuffix('_offset')}s[{i}]",)
        return self._unknown(wanted, NamedNumber(wanted.name, np.zeros(())), acts_on, most=most)

    def _of_experiment(self, wanted: Parameter, k: int) -> Unknown:
        if k >= len(self.experiments):
            raise DefinitionError(f"{wanted.name!r}: there are {len(self.experiments)} experiments, counted from 0")
        known = parameters(self.robot, *self.experiments[k]).values()
        inside = {f"experiments[{k}].{one.name}": one for one in known if parsed(one.name)[0] not in ("tubes", "base")}
        (parameter,) = chosen(inside, [wanted.name], "parameters")
        most = 0.0 if parameter.name == "translations" else np.inf
        named = attrs.evolve(parameter, name=wanted.name)
        return self._unknown(wanted, named, (parameter.name,), experiment=k, most=most)

    def _of_loads(self, wanted: Parameter) -> Unknown:
        """A number of a load that all experiments share."""
        there = []
        for k, experiment in enumerate(self.experiments):
            of_loads = {n: one for n, one in parameters(self.robot, *experiment).items() if parsed(n)[0] == "loads"}
            if not of_loads:
                raise DefinitionError(
                    f"parameters = {wanted.name!r} must be of a load in every experiment; experiments[{k}] has no loads"
                )
            there += chosen(of_loads, [wanted.name], f"parameters, in experiments[{k}],")
        if len({one.value.shape for one in there}) > 1:
            raise DefinitionError(f"{wanted.name!r}: the load must be of the same kind in all experiments")
        return self._unknown(wanted, there[0], (wanted.name,))

    def _tied(self, wanted: Parameter) -> Unknown:
        tied = chosen(self._known, wanted.tied, f"{wanted.name}: tied")
        factors = tuple(np.array(one.value) for one in tied)
        return self._unknown(wanted, NamedNumber(wanted.name, np.ones(()), unit=""), wanted.tied, factors=factors)

    def _unknown(
        self,
        wanted: Parameter,
        parameter: NamedNumber,
        acts_on: tuple[str, ...],
        *,
        experiment: int | None = None,
        factors: tuple[Array, ...] | None = None,
        most: float = np.inf,
    ) -> Unknown:
        shape, flat = parameter.value.shape, np.array(parameter.value, dtype=np.float64).ravel()

        def of_shape(what: Any, field: str) -> Array:
            if dimensions(what) == 0:
                return np.full(len(flat), number(what, f"{wanted.name}: {field}"))
            return np.array(array(what, f"{wanted.name}: {field}", shape)).ravel()

        initial = flat if wanted.initial is None else of_shape(wanted.initial, "initial")
        lower, upper = parameter.bounds(initial, positive=factors is not None)
        if wanted.bounds is not None:
            lower, upper = (_or_infinite(of_shape, wanted.bounds[k], sign) for k, sign in enumerate((-1, 1)))
        if np.any(lower >= most) or np.any(initial > most):
            raise DefinitionError(
                f"{wanted.name}: initial value and lower bound must allow less than {most:g} m, so that no tube's base "
                "is in front of the entry point"
            )
        upper = np.minimum(upper, most)
        if np.any(lower >= upper) or np.any(initial < lower) or np.any(initial > upper):
            raise DefinitionError(
                f"{wanted.name}: initial = {initial.tolist()} must lie between the bounds {lower.tolist()} and "
                f"{upper.tolist()}"
            )
        mean, sigma = initial, np.full(len(flat), np.inf)
        if wanted.prior is not None:
            mean, sigma = (of_shape(one, "prior") for one in wanted.prior)
            if not (sigma > 0.0).all():
                raise DefinitionError(
                    f"{wanted.name}: the standard deviation of the prior, {sigma.tolist()}, must be positive"
                )
        scale = parameter.scale(self._length) if wanted.scale is None else of_shape(wanted.scale, "scale")
        size = np.array(np.broadcast_to(scale, flat.shape))
        if not (size > 0.0).all():
            raise DefinitionError(f"{wanted.name}: scale = {size.tolist()} must be positive")
        return Unknown(
            wanted.name, shape, initial, size, lower, upper, mean, sigma, parameter.labels, acts_on, parameter.unit,
            experiment, factors,
        )  # fmt: skip

    @cached_property
    def _known(self) -> dict[str, NamedNumber]:
        """The robot's parameters by name; densities act if any experiment has gravity."""
        held = Actuation(np.zeros(len(self.robot.tubes)), np.zeros(len(self.robot.tubes)))
        pulls = [load for _, loads in self.experiments for load in loads if load.pulls][:1]
        known = parameters(self.robot, held, pulls)
        return {name: one for name, one in known.items() if parsed(name)[0] in ("tubes", "base")}

    @property
    def _length(self) -> float:
        return max(tube.length for tube in self.robot.tubes)

    def _check_doubled(self) -> None:
        seen: dict[tuple[int | None, str], str] = {}
        for entry in self.entries:
            for name in entry.acts_on:
                of_load = parsed(name)[0] == "loads"
                for (experiment, earlier), before in seen.items():
                    same = experiment == entry.experiment or (of_load and None in (experiment, entry.experiment))
                    if earlier == name and same:
                        raise DefinitionError(f"parameters: {before!r} and {entry.name!r} both set {name!r}")
                seen[entry.experiment, name] = entry.name
        robot_names = [name for k, name in seen if k is None and parsed(name)[0] not in _OFF_ROBOT]
        chosen(self._known, robot_names, "parameters")  # rejects a stiffness beside its modulus


def _listed(wanted: Any) -> list[Any]:
    if wanted is None or isinstance(wanted, (str, Parameter)):
        raise DefinitionError(f"parameters = {wanted!r} must be a list of names or Parameters")
    return list(wanted)


def _indexed(name: str) -> tuple[str, int]:
    """The parameter that an unknown acts on, and the index of its first number: 2 for ``rotations[2]``."""
    match parsed(name):
        case ("rotations" | "translations" as actuated, int(i)):
            return actuated, i
    return name, 0


def _or_infinite(of_shape: Any, value: Any, sign: int) -> Array:
    """A bound as an array, infinite where the value is None or infinite."""
    infinite = sign * np.inf
    if dimensions(value) == 0:
        none = value is None or value == infinite
        return np.full_like(of_shape(0.0, "bounds"), infinite) if none else of_shape(value, "bounds")
    bounds = np.asarray(value, dtype=object)
    free = np.array([bound is None or bound == infinite for bound in bounds.ravel()]).reshape(bounds.shape)
    return np.where(free.ravel(), infinite, of_shape(np.where(free, 0.0, bounds).tolist(), "bounds"))
