"""Measurements of a robot in equilibrium, with covariances: one file for each kind, and their base in ``kind``."""

from __future__ import annotations

from .actuators import ForceMeasurement as ForceMeasurement
from .actuators import TorqueMeasurement as TorqueMeasurement
from .backbone import BackboneMeasurement as BackboneMeasurement
from .base_wrench import BaseWrenchMeasurement as BaseWrenchMeasurement
from .curvature import CurvatureMeasurement as CurvatureMeasurement
from .kind import Measurement as Measurement
from .pose import PoseMeasurement as PoseMeasurement
from .position import PositionMeasurement as PositionMeasurement
from .tangent import TangentMeasurement as TangentMeasurement

MEASUREMENTS: tuple[type[Measurement], ...] = (
    PositionMeasurement,
    BackboneMeasurement,
    PoseMeasurement,
    TangentMeasurement,
    CurvatureMeasurement,
    TorqueMeasurement,
    ForceMeasurement,
    BaseWrenchMeasurement,
)
"""All kinds of measurements, in the order in which messages name them."""

TABLES = {table.kind: table for kind in MEASUREMENTS for table in kind.tables()}
"""Tables that describe measurements in files, by their ``kind``."""

COLUMNS = {name: unit for kind in MEASUREMENTS for name, unit in kind.columns.items()}
"""SI units of the vectors that measurements have in tables of experiments, by column name."""
