"""What robot and problem files may contain, checked key by key before anything is built."""

from __future__ import annotations

import difflib
import reprlib
from collections.abc import Mapping
from typing import Any

from marshmallow import EXCLUDE, Schema, ValidationError, fields, pre_load, validate

from ..estimation.measurements import COLUMNS
from .units import to_si


class Quantity(fields.Field[Any]):
    """A number in SI or a text with a unit; with ``shape``, nested lists of them (``None``: any size)."""

    def __init__(self, unit: str, *shape: int | None, scalar_too: bool = False, **options: Any) -> None:
        super().__init__(**options)
        self.unit, self.shape, self.scalar_too = unit, shape, scalar_too

    def _deserialize(self, value: Any, *_: Any, **__: Any) -> Any:
        if self.scalar_too and not isinstance(value, list):
            return self._convert(value, (), "")
        return self._convert(value, self.shape, "")

    def _convert(self, value: Any, shape: tuple[int | None, ...], where: str) -> Any:
        if not shape:
            try:
                return to_si(value, self.unit)
            except ValueError as error:
                raise ValidationError(f"{where} = {reprlib.repr(value)} {error}") from None
        if not isinstance(value, list):
            raise ValidationError(f"{where} = {reprlib.repr(value)} must be a list{_of(shape[0])}")
        if shape[0] is not None and len(value) != shape[0]:
            raise ValidationError(f"{where} has {len(value)} entries, but must have {shape[0]}")
        return [self._convert(entry, shape[1:], f"{where}[{k}]") for k, entry in enumerate(value)]


class Strict(Schema):
    """A table in which every key is known; an unknown one is answered with the nearest right one."""

    class Meta:
        """Unknown keys are refused by :meth:`refuse_unknown`."""

        unknown = EXCLUDE

    @pre_load
    def refuse_unknown(self, data: Any, **_: Any) -> Any:
        """Refuse what is no table, and keys that no field has."""
        if not isinstance(data, dict):
            raise ValidationError({"": [f" = {reprlib.repr(data)} must be a table of keys and values"]})
        known = [field.data_key or name for name, field in self.fields.items()]
        for key in data:
            if key not in known:
                near = difflib.get_close_matches(key, known, n=1, cutoff=0.5)
                hint = f"did you mean {near[0]!r}?" if near else f"allowed are {', '.join(known)}"
                raise ValidationError({key: [f" is no key here; {hint}"]})
        return data


def _of(size: int | None) -> str:
    return "" if size is None else f" of {size}"


def plain_text(**options: Any) -> fields.String:
    """A text."""
    return fields.String(error_messages={"invalid": " must be a text"}, **options)


class StraightSchema(Strict):
    """``kind = "straight"``."""

    kind = plain_text()
    length = Quantity("m", required=True)


class ArcSchema(Strict):
    """``kind = "arc"``."""

    kind = plain_text()
    length = Quantity("m", required=True)
    curvature = Quantity("1/m", 3, scalar_too=True, required=True)


class PolynomialSchema(Strict):
    """``kind = "polynomial"``."""

    kind = plain_text()
    length = Quantity("m", required=True)
    coefficients = Quantity("1/m", None, 3, required=True)


class SampledSchema(Strict):
    """``kind = "sampled"``: lists, or a CSV file of ``s, u_x, u_y, u_z`` in SI."""

    kind = plain_text()
    file = plain_text()
    arc_length = Quantity("m", None)
    curvature = Quantity("1/m", None, 3)


class TubeSchema(Strict):
    """``[[tubes]]``."""

    name = plain_text(required=True)
    outer_diameter = Quantity("m", required=True)
    inner_diameter = Quantity("m", required=True)
    youngs_modulus = Quantity("Pa")
    shear_modulus = Quantity("Pa")
    poisson_ratio = Quantity("1")
    density = Quantity("kg/m^3")
    bending_stiffness = Quantity("N*m^2")
    torsional_stiffness = Quantity("N*m^2")
    precurvature = fields.List(fields.Raw(), required=True, error_messages={"invalid": " must be a list of pieces"})


class BaseSchema(Strict):
    """``[base]``: the pose of the entry point."""

    pose = Quantity("1", 4, 4, required=True)


class SourceSchema(Strict):
    """``[source]``: where the numbers come from and what they do not claim."""

    text = plain_text(required=True)
    does_not_claim = plain_text()


class RobotSchema(Strict):
    """A robot file."""

    name = plain_text()
    source = fields.Nested(SourceSchema)
    base = fields.Nested(BaseSchema)
    tubes = fields.List(
        fields.Nested(TubeSchema),
        required=True,
        validate=validate.Length(min=1, error=" needs at least one tube"),
        error_messages={"invalid": " must be tables [[tubes]], the innermost first"},
    )


class ActuationSchema(Strict):
    """``[actuation]``."""

    rotations = Quantity("rad", None, required=True)
    translations = Quantity("m", None, required=True)


class PointSchema(Strict):
    """``kind = "point"``."""

    kind = plain_text()
    force = Quantity("N", 3)
    moment = Quantity("N*m", 3)
    arc_length = Quantity("m")
    tube = fields.Raw()
    frame = plain_text()


class DistributedSchema(Strict):
    """``kind = "distributed"``: constant values, or a CSV file of ``s, f_x, f_y, f_z, l_x, l_y, l_z`` in SI."""

    kind = plain_text()
    force = Quantity("N/m", 3)
    moment = Quantity("N*m/m", 3)
    file = plain_text()
    start = Quantity("m")
    end = Quantity("m")
    tube = fields.Raw()
    frame = plain_text()


class GravitySchema(Strict):
    """``kind = "gravity"``."""

    kind = plain_text()
    acceleration = Quantity("m/s^2", 3, required=True)


class PointMassSchema(Strict):
    """``kind = "point_mass"``."""

    kind = plain_text()
    mass = Quantity("kg", required=True)
    arc_length = Quantity("m")
    tube = fields.Raw()


class DistributedMassSchema(Strict):
    """``kind = "distributed_mass"``."""

    kind = plain_text()
    mass_per_length = Quantity("kg/m", required=True)
    start = Quantity("m")
    end = Quantity("m")
    tube = fields.Raw()


class SpringSchema(Strict):
    """``kind = "spring"``."""

    kind = plain_text()
    stiffness = Quantity("N/m", required=True)
    anchor = Quantity("m", 3, required=True)
    arc_length = Quantity("m")
    tube = fields.Raw()


class SolverSchema(Strict):
    """``[solver]``: arguments of ``ForwardProblem``."""

    formulation = plain_text()
    tolerance = Quantity("1")
    integrator = plain_text()


class ExpectedSchema(Strict):
    """``[expected]``: what a right answer is, and to which tolerance."""

    text = plain_text(required=True)
    tip_position = Quantity("m", 3)
    tip_height_and_distance = Quantity("m", 2)
    position_tolerance = Quantity("m")
    tip_direction = Quantity("1", 3)
    direction_tolerance = Quantity("1")
    base_torsions = Quantity("1/m", None)
    torsion_tolerance = Quantity("1/m")


class ProblemSchema(Strict):
    """A problem file."""

    title = plain_text(required=True)
    description = plain_text()
    robot = plain_text(required=True)
    source = fields.Nested(SourceSchema, required=True)
    actuation = fields.Nested(ActuationSchema, required=True)
    load_tables = fields.List(fields.Raw(), data_key="loads", error_messages={"invalid": " must be tables [[loads]]"})
    solver = fields.Nested(SolverSchema)
    expected = fields.Nested(ExpectedSchema)


class ExpectedTipsSchema(Strict):
    """``[expected]`` of a plan, whose table holds the tips."""

    text = plain_text(required=True)
    position_tolerance = Quantity("m", required=True)


class PlanSchema(Strict):
    """A plan of experiments: a problem file whose actuations and tip forces stand in a table."""

    title = plain_text(required=True)
    description = plain_text()
    robot = plain_text(required=True)
    cases = plain_text(required=True)
    source = fields.Nested(SourceSchema, required=True)
    solver = fields.Nested(SolverSchema)
    expected = fields.Nested(ExpectedTipsSchema)


class _SigmaSchema(Strict):
    """``[sigma]`` of a calibration: standard deviations of what its table holds."""

    position = Quantity("m", 3, scalar_too=True)
    direction = Quantity("rad")


SigmaSchema = _SigmaSchema.from_dict({name: Quantity(unit, 3, scalar_too=True) for name, unit in COLUMNS.items()})


class CheckSchema(Strict):
    """``[[checks]]`` of a calibration: a problem that was measured too, and is not fitted."""

    problem = plain_text(required=True)
    tip_position = Quantity("m", 3, required=True)


class ParameterSchema(Strict):
    """An entry of ``parameters`` of a calibration that is more than a name: arguments of ``Parameter``, SI."""

    name = plain_text(required=True)
    prior = fields.Raw()
    bounds = fields.Raw()
    initial = fields.Raw()
    tied = fields.List(fields.Str())


class Unknown(fields.Field[Any]):
    """A name, or a table with one."""

    def _deserialize(self, value: Any, *_: Any, **__: Any) -> Any:
        return value if isinstance(value, str) else ParameterSchema().load(value)


class HoldOutSchema(Strict):
    """``[hold_out]`` of a calibration: which share of the experiments, drawn at random, is predicted and not fitted."""

    share = Quantity("1", required=True)
    seed = fields.Int(required=True)


class TruthSchema(Strict):
    """``[truth]`` of a calibration with synthetic data: what the data were made with."""

    values = fields.Dict(keys=fields.Str(), values=fields.Raw(), required=True)
    seed = fields.Int(required=True)
    outlier = fields.Int()
    rotation = Quantity("rad")
    rows = fields.Int()


class CalibrationSchema(Strict):
    """A calibration: a robot, a table of experiments, and what is to be estimated."""

    title = plain_text(required=True)
    description = plain_text()
    robot = plain_text(required=True)
    experiments = plain_text(required=True)
    sensor = plain_text()
    parameters = fields.List(Unknown(), required=True)
    losses = fields.List(fields.Str(), load_default=["squared"])
    source = fields.Nested(SourceSchema, required=True)
    sigma = fields.Nested(SigmaSchema, load_default={})
    hold_out = fields.Nested(HoldOutSchema)
    checks = fields.List(fields.Nested(CheckSchema), load_default=[])
    truth = fields.Nested(TruthSchema)


PIECE_SCHEMAS = {
    "straight": StraightSchema,
    "arc": ArcSchema,
    "polynomial": PolynomialSchema,
    "sampled": SampledSchema,
}
LOAD_SCHEMAS = {
    "point": PointSchema,
    "distributed": DistributedSchema,
    "gravity": GravitySchema,
    "point_mass": PointMassSchema,
    "distributed_mass": DistributedMassSchema,
    "spring": SpringSchema,
}


def load_checked(schema: type[Schema], data: Any) -> dict[str, Any]:
    """The data of a table, in SI; ``ValueError`` with the place and what is wrong in one sentence."""
    try:
        return dict(schema().load(data))
    except ValidationError as error:
        raise ValueError(_first(error.messages, data)) from None


def load_kind(schemas: Mapping[str, type[Schema]], data: Any) -> tuple[str, dict[str, Any]]:
    """The same for a table whose ``kind`` names its schema."""
    if not isinstance(data, dict):
        raise ValueError(f" = {reprlib.repr(data)} must be a table with a kind")
    kind = data.get("kind")
    if not isinstance(kind, str) or kind not in schemas:
        near = difflib.get_close_matches(str(kind), schemas, n=1, cutoff=0.5)
        hint = f" (did you mean {near[0]!r}?)" if near else ""
        raise ValueError(f".kind = {kind!r} must be one of {', '.join(schemas)}{hint}")
    values = load_checked(schemas[kind], data)
    values.pop("kind", None)
    return kind, values


def _first(messages: Any, data: Any, place: str = "") -> str:
    """The first message in the tree, behind its place."""
    if isinstance(messages, str):
        return place + messages
    if isinstance(messages, list):
        text = str(messages[0])
        return f"{place} is missing" if text == "Missing data for required field." else place + _spaced(text)
    key, inner = next(iter(messages.items()))
    below = data.get(key) if isinstance(data, dict) else data[key] if isinstance(key, int) else None
    if isinstance(key, int):
        name = below.get("name") if isinstance(below, dict) else None
        step = f"[{key}]" + (f" ({name!r})" if isinstance(name, str) else "")
    else:
        step = f".{key}" if key and key != "_schema" else ""
    return _first(inner, below, place + step)


def _spaced(text: str) -> str:
    return text if text[:1] in (" ", "[", ".") else ": " + text
