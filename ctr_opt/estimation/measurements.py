"""What was measured on a robot in equilibrium, with covariances: points, poses, tangents, curvatures, actuators' loads.

A measurement says which predictions it needs and where (``requests``), and turns them into whitened residuals in
``blocks``: a point is a block of three numbers, whose norm a robust loss sees.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from functools import cached_property, lru_cache
from typing import Any, Protocol, TypeAlias, overload

import attrs
import numpy as np

from ..checks import ARRAY_EQ, Array, array, flag, index, number
from ..errors import DefinitionError


def _tube(value: Any) -> int:
    return index(value, "tube")


def _pose(value: Any) -> Array:
    return array(value, "pose", (4, 4))


def _direction(value: Any) -> Array:
    return array(value, "direction", (3,))


def _torque(value: Any) -> float:
    return number(value, "torque", unit="N m")


def _force(value: Any) -> float:
    return number(value, "force", unit="N")


def _as_given(value: Any) -> Any:
    return value


def _sensor(value: Any) -> str | None:
    if value is not None and not (isinstance(value, str) and re.fullmatch(r"[A-Za-z]\w*", value)):
        raise DefinitionError(f"sensor = {value!r} must be a name of letters, digits and underscores")
    return value


@attrs.frozen
class Distal:
    """The distal end of a tube, wherever it is: it moves with the tube's translation and length.

    >>> Distal(1)
    Distal(tube=1)
    """

    tube: int = attrs.field(converter=_tube)


Place: TypeAlias = "float | Distal | None"
"""An arc length from the entry point, m; the end of a tube; or None, the tip."""


@attrs.frozen
class Somewhere:
    """A place on the backbone that is estimated, with the rest."""


def arc_length_of(place: Place, ends: Array) -> float:
    """Where a place is, m, on a robot whose tubes end at ``ends``."""
    if isinstance(place, Distal):
        return float(ends[place.tube])
    return float(ends.max()) if place is None else place


@attrs.frozen
class Request:
    """A prediction of a tube that is needed, at a place: ``"pose"``, ``"curvature"``, ``"torque"`` or ``"force"``.

    With ``sensor``, the pose is that of a sensor which the tube carries there.
    """

    kind: str
    place: Place | Somewhere = None
    tube: int | None = None
    sensor: str | None = None


@attrs.frozen(eq=False)
class Predicted:
    """Predictions of E experiments and their derivatives: poses ``(E, 3, 4)`` with rates ``(E, 6, k)``, of position and
    world angular velocity; of others ``(E, n)`` and ``(E, n, k)``.
    """

    value: Array
    slopes: Array


@attrs.frozen(eq=False)
class Stacked:
    """Predictions of alike requests as they come from one array, in the place of a list of :class:`Predicted`.

    ``(E, requests, ...)`` and ``(E, requests, ..., k)``.
    """

    value: Array
    slopes: Array

    @classmethod
    def of(cls, found: Found) -> Stacked:
        """Of predictions that all have one shape."""
        if isinstance(found, Stacked):
            return found
        return cls(np.stack([each.value for each in found], axis=1), np.stack([each.slopes for each in found], axis=1))

    @overload
    def __getitem__(self, k: int) -> Predicted: ...

    @overload
    def __getitem__(self, k: slice) -> Stacked: ...

    def __getitem__(self, k: int | slice) -> Predicted | Stacked:
        """Of one request, or of some."""
        kind = Stacked if isinstance(k, slice) else Predicted
        return kind(self.value[:, k], self.slopes[:, k])


Found: TypeAlias = "Sequence[Predicted] | Stacked"
"""Predictions, one for each request."""


class Measurement(Protocol):
    """What all measurements can tell."""

    def check(self, tubes: int) -> None:
        """Raise ``DefinitionError`` where a tube is named that a robot with so many does not have."""

    @property
    def requests(self) -> tuple[Request, ...]:
        """The predictions that are needed."""

    @property
    def shape(self) -> tuple[int, int]:
        """How many blocks of residuals of which size."""

    @property
    def whitener(self) -> Array:
        """``(blocks, size, size)``: by what residuals are multiplied to have unit covariance."""

    @property
    def isotropic(self) -> Array:
        """The same of a standard deviation equal along all axes, where all numbers of a block have one unit."""

    @property
    def scaled(self) -> bool:
        """Whether a noise level was given."""

    @staticmethod
    def compare(measured: Sequence[Any], found: Found) -> tuple[Array, Array]:
        """Predicted minus measured ``(E, blocks, size)``, SI, and the derivatives ``(E, blocks, size, k)``.

        ``measured``: of one kind and shape, in E experiments; ``found``: the predictions that they request.
        """


def _places(value: Any) -> tuple[Place, ...]:
    """One place or several."""
    if value is None or isinstance(value, Distal):
        return (value,)
    if isinstance(value, (list, tuple)) and any(item is None or isinstance(item, Distal) for item in value):
        return tuple(item if item is None or isinstance(item, Distal) else _length(item) for item in value)
    if np.ndim(value) == 0:
        return (_length(value),)
    if len(value) == 0:
        raise DefinitionError("arc_length = [] must hold at least one place")
    given = array(value, "arc_length", (None,), unit="m")
    return tuple(_length(item) for item in given) if (given < 0.0).any() else tuple(given.tolist())


def _place(value: Any) -> tuple[Place, ...]:
    """One place."""
    found = _places(value)
    if len(found) != 1:
        raise DefinitionError(f"arc_length = {value!r} must be one place: give a measurement for each")
    return found


def _length(value: Any) -> float:
    return number(value, "arc_length", least=0.0, unit="m")


def whitening(sigma: Any, blocks: int, size: int, field: str = "sigma") -> Array:
    """``(blocks, size, size)`` from a standard deviation, one for each axis, or covariances of all or of each block.

    A number is a standard deviation of every component, ``(size,)`` are those of the axes, ``(size, size)`` is a
    covariance, ``(blocks, size, size)`` are covariances.
    """
    if np.ndim(sigma) == 0:
        return _of_one_deviation(number(sigma, field, above=0.0), blocks, size)
    given = array(sigma, field, (None,) * np.ndim(sigma))
    if given.shape == (size,):
        if not (given > 0.0).all():
            raise DefinitionError(f"{field} = {given.tolist()} must be positive, one for each axis")
        return np.broadcast_to(np.diag(1.0 / given), (blocks, size, size))
    if given.shape not in ((size, size), (blocks, size, size)):
        raise DefinitionError(
            f"{field} has shape {given.shape}, but must be a number, have shape ({size},), or hold covariances of "
            f"shape ({size}, {size}) or ({blocks}, {size}, {size})"
        )
    try:
        deviations = np.sqrt(np.abs(np.diagonal(given, axis1=-2, axis2=-1)))
        allowed = 1e-6 * deviations[..., :, None] * deviations[..., None, :]
        if np.any(np.abs(given - np.swapaxes(given, -1, -2)) > allowed):
            raise np.linalg.LinAlgError
        factor = np.linalg.cholesky(given)
    except np.linalg.LinAlgError:
        raise DefinitionError(f"{field}: a covariance must be symmetric and positive definite") from None
    return np.broadcast_to(np.linalg.inv(factor), (blocks, size, size))


@lru_cache
def _of_one_deviation(sigma: float, blocks: int, size: int) -> Array:
    """The same for each measurement of a stream, and not to be written to."""
    return np.broadcast_to(np.eye(size) / sigma, (blocks, size, size))


class _Measured:
    """What measurements share: ``whitener`` and whether a noise level was given."""

    @property
    def scaled(self) -> bool:
        """Whether a noise level was given."""
        return self.sigma is not None  # type: ignore[attr-defined]

    @cached_property
    def whitener(self) -> Array:
        """By what residuals are multiplied to have unit covariance; where no noise level is given, by one over one."""
        sigma = self.sigma if self.scaled else self._unit  # type: ignore[attr-defined]
        return whitening(sigma, *self.shape)  # type: ignore[attr-defined]

    @cached_property
    def isotropic(self) -> Array:
        """The same of a standard deviation equal along all axes, the root mean square of theirs."""
        size = self.shape[1]  # type: ignore[attr-defined]
        variances = (np.linalg.inv(self.whitener) ** 2).sum(axis=(1, 2)) / size
        return np.asarray(np.eye(size) / np.sqrt(variances)[:, None, None])

    _unit = 1e-3  # SI: residuals without a noise level are told in mm, mrad and so on

    def check(self, tubes: int) -> None:
        """Raise ``DefinitionError`` for a tube that a robot with so many does not have."""
        for request in self.requests:  # type: ignore[attr-defined]
            for tube in (request.tube, request.place.tube if isinstance(request.place, Distal) else None):
                if tube is not None:
                    index(tube, "tube", tubes)


def _distances(measured: Sequence[Any], found: Found) -> tuple[Array, Array]:
    """Of predicted from measured points, and derivatives."""
    poses = Stacked.of(found)
    return poses.value[..., 3] - np.array([each.position for each in measured]), poses.slopes[:, :, :3]


@lru_cache
def _poses(places: tuple[Place, ...], sensor: str | None) -> tuple[Request, ...]:
    """Requests of poses: the very same for all measurements at the same places."""
    return tuple(Request("pose", place, sensor=sensor) for place in places)


@attrs.frozen(eq=False, slots=False)
class PositionMeasurement(_Measured):
    """Measured positions of backbone points.

    Parameters
    ----------
    arc_length
        Where: an arc length from the entry point, m; ``None``, the tip; ``Distal(tube)``, that tube's end (both move
        when translations or offsets are unknown); or a list of such places.
    position
        ``(3,)``, m, world frame; ``(k, 3)`` for k places.
    sigma
        Standard deviation, m: a number, one for each axis ``(3,)``, or covariances ``(3, 3)`` or ``(k, 3, 3)``. None:
        the noise level is unknown and estimated from the residuals.
    sensor
        A name, if the point is a sensor's, fixed to the material frame of a tube at one place (of the innermost that
        is there, or of the one that ends there). Its pose in that frame: ``"sensors.<name>.translation"`` and
        ``"sensors.<name>.rotation"`` of :class:`Parameter`, zero where they are not estimated.

    Examples
    --------
    >>> PositionMeasurement(None, [0.01, 0.0, 0.12], sigma=0.5e-3).shape
    (1, 3)
    """

    arc_length: tuple[Place, ...] = attrs.field(converter=_places)
    position: Array = attrs.field(eq=ARRAY_EQ, converter=_as_given)
    sigma: Any = None
    sensor: str | None = attrs.field(default=None, converter=_sensor)

    def __attrs_post_init__(self) -> None:
        given = array(self.position, "position", (None,) * np.ndim(self.position), unit="m")
        if given.shape not in ((3,), (len(self.arc_length), 3)) or (given.ndim == 1 and len(self.arc_length) != 1):
            raise DefinitionError(
                f"position has shape {given.shape}, but must have shape ({len(self.arc_length)}, 3), a row for each "
                "arc length"
            )
        if self.sensor is not None and len(self.arc_length) != 1:
            raise DefinitionError(
                f"sensor = {self.sensor!r} must be at one place: give a measurement for each of {len(self.arc_length)}"
            )
        object.__setattr__(self, "position", given.reshape(-1, 3))
        _ = self.whitener

    @property
    def requests(self) -> tuple[Request, ...]:
        """Poses at the places."""
        return _poses(self.arc_length, self.sensor)

    @property
    def shape(self) -> tuple[int, int]:
        """Points, and three coordinates."""
        return len(self.arc_length), 3

    @staticmethod
    def compare(measured: Sequence[PositionMeasurement], found: Found) -> tuple[Array, Array]:
        """Distances to the points, and derivatives."""
        return _distances(measured, found)


@attrs.frozen(eq=False, slots=False)
class BackboneMeasurement(_Measured):
    """Measured positions of points somewhere on the backbone, as of a scan or of markers, at unknown arc lengths.

    Each point's arc length is estimated with the parameters, between the entry point and the tip, and
    :attr:`Fit.residuals <ctr_opt.Fit.residuals>` tell it.

    Parameters
    ----------
    position
        ``(k, 3)``, m, world frame.
    sigma
        As in :class:`PositionMeasurement`.
    ordered
        Whether the points are given from the entry point towards the tip, so that no arc length is below the one before
        it.

    Examples
    --------
    >>> BackboneMeasurement([[0.0, 0.0, 0.05], [0.01, 0.0, 0.08]], sigma=0.5e-3, ordered=True).shape
    (2, 3)
    """

    position: Array = attrs.field(eq=ARRAY_EQ, converter=_as_given)
    sigma: Any = None
    ordered: bool = False

    def __attrs_post_init__(self) -> None:
        given = array(self.position, "position", (None, 3), unit="m")
        if not len(given):
            raise DefinitionError("position = [] must hold at least one point, shape (k, 3)")
        object.__setattr__(self, "position", given)
        object.__setattr__(self, "ordered", flag(self.ordered, "ordered"))
        _ = self.whitener

    @property
    def requests(self) -> tuple[Request, ...]:
        """A pose for each point."""
        return (Request("pose", Somewhere()),) * len(self.position)

    @property
    def shape(self) -> tuple[int, int]:
        """Points, and three coordinates."""
        return len(self.position), 3

    @staticmethod
    def compare(measured: Sequence[BackboneMeasurement], found: Found) -> tuple[Array, Array]:
        """Distances to the points, and derivatives, places held."""
        return _distances(measured, found)


@attrs.frozen(eq=False, slots=False)
class PoseMeasurement(_Measured):
    """A measured pose, as of an electromagnetic sensor: position and orientation of a tube's material frame.

    Parameters
    ----------
    arc_length
        As in :class:`PositionMeasurement`, one place.
    pose
        ``(4, 4)``, world frame.
    sigma
        Standard deviations ``(6,)`` of position (m) and rotation (rad, about the world's axes), a covariance
        ``(6, 6)``, or None.
    tube
        Whose frame it is; None: the innermost tube's that is there.
    sensor
        As in :class:`PositionMeasurement`: the pose is that of a sensor on the tube.

    Examples
    --------
    >>> import numpy as np
    >>> PoseMeasurement(None, np.eye(4), sigma=[1e-3] * 3 + [0.01] * 3).shape
    (1, 6)
    """

    arc_length: tuple[Place, ...] = attrs.field(converter=_place)
    pose: Array = attrs.field(converter=_pose)
    sigma: Any = None
    tube: int | None = None
    sensor: str | None = attrs.field(default=None, converter=_sensor)

    def __attrs_post_init__(self) -> None:
        if self.tube is not None:
            object.__setattr__(self, "tube", index(self.tube, "tube"))
        if np.abs(self.pose[3] - [0.0, 0.0, 0.0, 1.0]).max() > 1e-6:
            raise DefinitionError(f"pose: the last row {self.pose[3].tolist()} must be [0, 0, 0, 1]")
        frame = self.pose[:3, :3]
        if np.abs(frame.T @ frame - np.eye(3)).max() > 1e-6 or np.linalg.det(frame) < 0.0:
            raise DefinitionError("pose: the upper left 3 x 3 block is no rotation (allowed: 1e-6)")
        _ = self.whitener

    @property
    def requests(self) -> tuple[Request, ...]:
        """The pose."""
        return (Request("pose", self.arc_length[0], self.tube, self.sensor),)

    @property
    def shape(self) -> tuple[int, int]:
        """Six numbers."""
        return 1, 6

    @property
    def isotropic(self) -> Array:
        """As given: metres and radians are not of one unit."""
        return self.whitener

    @staticmethod
    def compare(measured: Sequence[PoseMeasurement], found: Found) -> tuple[Array, Array]:
        """Difference of positions, and the rotation vector from the measured to the predicted frame."""
        from scipy.spatial.transform import Rotation

        value, slopes = found[0].value, found[0].slopes
        poses = np.array([each.pose for each in measured])
        turned = Rotation.from_matrix(value[:, :, :3] @ np.swapaxes(poses[:, :3, :3], 1, 2)).as_rotvec()
        rates = np.concatenate((slopes[:, :3], inverse_left_jacobian(turned) @ slopes[:, 3:]), axis=1)
        return np.hstack((value[:, :, 3] - poses[:, :3, 3], turned))[:, None], rates[:, None]


def inverse_left_jacobian(vectors: Array) -> Array:
    """Takes angular velocities to the rates of rotation vectors ``(E, 3)``: ``d log(R)`` of ``dR = hat(w) R``."""
    angle = np.linalg.norm(vectors, axis=1)
    small = angle < 1e-4  # the series' next term is below 1e-18
    safe = np.where(small, 1.0, angle)
    factor = np.where(small, 1.0 / 12.0 + angle**2 / 720.0, (1.0 - 0.5 * safe / np.tan(0.5 * safe)) / safe**2)
    hat = np.swapaxes(np.cross(vectors[:, None], np.eye(3)), 1, 2)
    return np.asarray(np.eye(3) - 0.5 * hat + factor[:, None, None] * hat @ hat)


@attrs.frozen(eq=False, slots=False)
class TangentMeasurement(_Measured):
    """A measured direction of the backbone's tangent, as of a sensor with five degrees of freedom.

    Parameters
    ----------
    arc_length
        As in :class:`PositionMeasurement`, one place.
    direction
        ``(3,)``, world frame, of any length.
    sigma
        Standard deviation of the angle, rad, about every axis across the tangent; or None.
    sensor
        As in :class:`PositionMeasurement`: the direction is that of the z axis of a sensor on the tube.

    Examples
    --------
    >>> TangentMeasurement(None, [0.0, 0.0, 2.0], sigma=0.01).direction.tolist()
    [0.0, 0.0, 1.0]
    """

    arc_length: tuple[Place, ...] = attrs.field(converter=_place)
    direction: Array = attrs.field(converter=_direction)
    sigma: float | None = None
    sensor: str | None = attrs.field(default=None, converter=_sensor)

    def __attrs_post_init__(self) -> None:
        size = float(np.linalg.norm(self.direction))
        if size == 0.0:
            raise DefinitionError("direction = [0, 0, 0] must not be zero")
        if self.sigma is not None and np.ndim(self.sigma):
            raise DefinitionError(f"sigma = {self.sigma!r} must be a number, of every axis across the tangent")
        object.__setattr__(self, "direction", self.direction / size)
        _ = self.whitener

    @cached_property
    def _across(self) -> Array:
        """Two axes across the measured direction, ``(2, 3)``."""
        return np.asarray(np.linalg.svd(self.direction[None])[2][1:])

    @property
    def requests(self) -> tuple[Request, ...]:
        """The pose."""
        return (Request("pose", self.arc_length[0], sensor=self.sensor),)

    @property
    def shape(self) -> tuple[int, int]:
        """Two angles."""
        return 1, 2

    @staticmethod
    def compare(measured: Sequence[TangentMeasurement], found: Found) -> tuple[Array, Array]:
        """The predicted tangent across the measured one, scaled to the angle between them, and derivatives."""
        tangent, slopes = found[0].value[:, :, 2], found[0].slopes[:, 3:]
        axes = np.array([each._across for each in measured])
        direction = np.array([each.direction for each in measured])[:, None]
        moved = np.cross(slopes, tangent[:, :, None], axis=1)
        across, of_across = (axes @ tangent[..., None])[..., 0], axes @ moved
        along = np.sum(direction[:, 0] * tangent, axis=1)
        sine = np.linalg.norm(across, axis=1)
        near = (sine < 1e-6) & (along > 0.0)  # the angle is the sine, up to its third power
        far = (sine < 1e-6) & ~near  # the opposite direction, half a turn about any axis
        angle, sine = np.arctan2(sine, along), np.maximum(sine, 1e-6)
        unit = np.where(far[:, None], [1.0, 0.0], across / sine[:, None])[:, None]
        of_sine = unit @ of_across
        of_angle = _of_each(along) * of_sine - _of_each(sine) * (direction @ moved)
        bend = np.swapaxes(unit, 1, 2)
        change = bend * of_angle + _of_each(angle / sine) * (of_across - bend * of_sine)
        values = np.where(near[:, None, None], across[:, None], angle[:, None, None] * unit)
        return values, np.where(near[:, None, None], of_across, change)[:, None]


def _of_each(numbers: Array) -> Array:
    """A number for each experiment, as a factor of its matrix."""
    return numbers[:, None, None]


@attrs.frozen(eq=False, slots=False)
class CurvatureMeasurement(_Measured):
    """Measured curvature of a tube, as of a fibre with Bragg gratings in it, in that tube's material frame.

    Parameters
    ----------
    arc_length
        Where: arc lengths, ends of tubes or None, the tip; one place or several.
    curvature
        ``(2,)`` or ``(k, 2)``, 1/m: ``u_x, u_y``; with a third column also the tube's ``u_z``.
    sigma
        As in :class:`PositionMeasurement`, 1/m.
    tube
        The tube that carries the fibre.

    Examples
    --------
    >>> CurvatureMeasurement([0.02, 0.04], [[5.0, 0.0], [5.5, 0.1]], sigma=0.1).shape
    (2, 2)
    """

    arc_length: tuple[Place, ...] = attrs.field(converter=_places)
    curvature: Array = attrs.field(eq=ARRAY_EQ, converter=_as_given)
    sigma: Any = None
    tube: int = attrs.field(default=0, converter=_tube)

    _unit = 1.0

    def __attrs_post_init__(self) -> None:
        given = np.atleast_2d(array(self.curvature, "curvature", (None,) * np.ndim(self.curvature), unit="1/m"))
        if given.shape not in ((len(self.arc_length), 2), (len(self.arc_length), 3)):
            raise DefinitionError(
                f"curvature has shape {given.shape}, but must have shape ({len(self.arc_length)}, 2) or "
                f"({len(self.arc_length)}, 3), a row for each arc length"
            )
        object.__setattr__(self, "curvature", given)
        _ = self.whitener

    @property
    def requests(self) -> tuple[Request, ...]:
        """Curvatures at the places."""
        return tuple(Request("curvature", place, self.tube) for place in self.arc_length)

    @property
    def shape(self) -> tuple[int, int]:
        """Places, and two or three numbers."""
        return self.curvature.shape[0], self.curvature.shape[1]

    @staticmethod
    def compare(measured: Sequence[CurvatureMeasurement], found: Found) -> tuple[Array, Array]:
        """Differences of the curvatures, and derivatives."""
        size = measured[0].shape[1]
        told = Stacked.of(found)
        return told.value[..., :size] - np.array([each.curvature for each in measured]), told.slopes[:, :, :size]


class _OfActuator(_Measured):
    """What an actuator exerts on a tube's base: one number, predicted under the name of the measurement's field."""

    _kind: str

    def __attrs_post_init__(self) -> None:
        _ = self.whitener

    @property
    def requests(self) -> tuple[Request, ...]:
        """Of the tube's actuator."""
        return (Request(self._kind, None, self.tube),)  # type: ignore[attr-defined]

    @property
    def shape(self) -> tuple[int, int]:
        """One number."""
        return 1, 1

    @staticmethod
    def compare(measured: Sequence[_OfActuator], found: Found) -> tuple[Array, Array]:
        """Differences of the numbers, and derivatives."""
        told = np.array([[[getattr(each, each._kind)]] for each in measured])
        return found[0].value[:, None] - told, found[0].slopes[:, None]


@attrs.frozen(eq=False, slots=False)
class TorqueMeasurement(_OfActuator):
    """A measured torque of an actuator on a tube's base, N m, about +z of the entry frame.

    Parameters
    ----------
    tube
        The tube.
    torque
        N m, as :meth:`Equilibrium.actuator_wrench <ctr_opt.Equilibrium.actuator_wrench>` gives it.
    sigma
        Standard deviation, N m, or None.

    Examples
    --------
    >>> TorqueMeasurement(0, 1.5e-3, sigma=1e-4).shape
    (1, 1)
    """

    tube: int = attrs.field(converter=_tube)
    torque: float = attrs.field(converter=_torque)
    sigma: float | None = None

    _kind = "torque"


@attrs.frozen(eq=False, slots=False)
class ForceMeasurement(_OfActuator):
    """A measured axial force of an actuator on a tube's base, N, along +z of the entry frame.

    Parameters
    ----------
    tube
        The tube.
    force
        N, as :meth:`Equilibrium.actuator_wrench <ctr_opt.Equilibrium.actuator_wrench>` gives it: without friction.
    sigma
        Standard deviation, N, or None.

    Examples
    --------
    >>> ForceMeasurement(0, -0.8, sigma=0.02).shape
    (1, 1)
    """

    tube: int = attrs.field(converter=_tube)
    force: float = attrs.field(converter=_force)
    sigma: float | None = None

    _kind = "force"


MEASUREMENTS = (
    PositionMeasurement,
    BackboneMeasurement,
    PoseMeasurement,
    TangentMeasurement,
    CurvatureMeasurement,
    TorqueMeasurement,
    ForceMeasurement,
)
