"""What files of force problems may contain."""

from __future__ import annotations

from functools import cache
from typing import Any, cast

from marshmallow import fields

from ..estimation.measurements import TABLES
from ..estimation.measurements.kind import Entry, Table
from .schemas import ActuationSchema, Quantity, SourceSchema, Strict, plain_text


class PriorSchema(Strict):
    """``prior`` of an unknown load: mean and standard deviation of its force."""

    mean = Quantity("N", 3, scalar_too=True, required=True)
    sigma = Quantity("N", 3, scalar_too=True, required=True)


class WrenchPriorSchema(Strict):
    """``prior`` of an unknown wrench: means, default zero, and standard deviations."""

    force_mean = Quantity("N", 3, scalar_too=True)
    force_sigma = Quantity("N", 3, scalar_too=True, required=True)
    moment_mean = Quantity("N*m", 3, scalar_too=True)
    moment_sigma = Quantity("N*m", 3, scalar_too=True, required=True)


class DensityPriorSchema(Strict):
    """``prior`` of a distributed force: mean and standard deviation of its coefficients."""

    mean = Quantity("N/m", 3, scalar_too=True, required=True)
    sigma = Quantity("N/m", 3, scalar_too=True, required=True)


class PlacePriorSchema(Strict):
    """``place_prior`` of a force at an unknown place: its mean and standard deviation."""

    mean = Quantity("m", required=True)
    sigma = Quantity("m", required=True)


class TipForceSchema(Strict):
    """``kind = "tip_force"``."""

    kind = plain_text()
    prior = fields.Nested(PriorSchema)
    bounds = Quantity("N", 2)


class TipWrenchSchema(Strict):
    """``kind = "tip_wrench"``."""

    kind = plain_text()
    prior = fields.Nested(WrenchPriorSchema)


class PointForceSchema(Strict):
    """``kind = "point_force"``, at an arc length or, without one, somewhere."""

    kind = plain_text()
    arc_length = Quantity("m")
    tube = fields.Raw()
    prior = fields.Nested(PriorSchema)
    normal = Quantity("1", 3)
    friction = Quantity("1")
    bounds = Quantity("N", 2)
    between = Quantity("m", 2)
    place_prior = fields.Nested(PlacePriorSchema)


class ContactsSchema(Strict):
    """``kind = "contacts"``: forces at unknown places, in unknown number."""

    kind = plain_text()
    most = fields.Int(strict=True)
    tube = fields.Raw()
    prior = fields.Nested(PriorSchema)
    bounds = Quantity("N", 2)
    between = Quantity("m", 2)


class DistributedForceSchema(Strict):
    """``kind = "distributed_force"``: a smooth force along a tube."""

    kind = plain_text()
    coefficients = fields.Int(strict=True)
    start = Quantity("m")
    end = Quantity("m")
    tube = fields.Raw()
    degree = fields.Int(strict=True)
    smoothness = Quantity("1")
    prior = fields.Nested(DensityPriorSchema)
    bounds = Quantity("N/m", 2)


class MeasuredActuationSchema(ActuationSchema):
    """``[actuation]`` of a force problem, which may be known with errors only."""

    rotation_sigma = Quantity("rad", None, scalar_too=True)
    translation_sigma = Quantity("m", None, scalar_too=True)


class ForceTruthSchema(Strict):
    """``[truth]`` of a force problem with synthetic data."""

    force = Quantity("N", 3)
    arc_length = Quantity("m")
    density = plain_text()
    contacts = fields.Int(strict=True)
    seed = fields.Int()


class ForceExpectedSchema(Strict):
    """``[expected]`` of a force problem: which standard deviations, and what is not determined."""

    text = plain_text(required=True)
    standard_errors = Quantity("N", None)
    share = Quantity("1")
    consistent = fields.Bool()
    undetermined = fields.List(fields.Str())


class ForceSchema(Strict):
    """A force problem: a robot's actuation, what was measured on it, known loads and unknown ones."""

    title = plain_text(required=True)
    description = plain_text()
    robot = plain_text(required=True)
    loss = plain_text()
    source = fields.Nested(SourceSchema, required=True)
    actuation = fields.Nested(MeasuredActuationSchema, required=True)
    unknown_loads = fields.List(
        fields.Raw(), required=True, data_key="unknown", error_messages={"invalid": " must be tables [[unknown]]"}
    )
    measurements = fields.List(
        fields.Raw(), required=True, error_messages={"invalid": " must be tables [[measurements]]"}
    )
    load_tables = fields.List(fields.Raw(), data_key="loads", error_messages={"invalid": " must be tables [[loads]]"})
    truth = fields.Nested(ForceTruthSchema)
    expected = fields.Nested(ForceExpectedSchema)


UNKNOWN_LOAD_SCHEMAS = {
    "tip_force": TipForceSchema,
    "tip_wrench": TipWrenchSchema,
    "point_force": PointForceSchema,
    "contacts": ContactsSchema,
    "distributed_force": DistributedForceSchema,
}


@cache
def measurement_schemas() -> dict[str, type[Strict]]:
    """The schemas of these tables."""
    return {kind: _schema(table) for kind, table in TABLES.items()}


def _schema(table: Table) -> type[Strict]:
    own: dict[str, fields.Field[Any]] = {"kind": plain_text()}
    if table.needed:
        own["file"] = plain_text(required=True)
    own |= {name: _field(entry) for name, entry in table.entries.items()}
    return cast("type[Strict]", Strict.from_dict(own, name=f"{table.kind}_table"))


def _field(entry: Entry) -> fields.Field[Any]:
    if entry.unit == "tube":
        return fields.Raw(required=entry.required)
    if entry.unit == "flag":
        return fields.Bool(required=entry.required)
    return Quantity(entry.unit, *entry.shape, scalar_too=entry.scalar_too, required=entry.required)
