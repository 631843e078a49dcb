"""Measurements of a robot in equilibrium, with covariances: a file for each kind, what all share in ``kind``."""

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
"""All kinds, in the order in which messages name them."""

TABLES = {table.kind: table for kind in MEASUREMENTS for table in kind.tables()}
"""What describes a measurement in a file, by its ``kind``."""

COLUMNS = {name: unit for kind in MEASUREMENTS for name, unit in kind.columns.items()}
"""SI units of vectors that kinds of measurements have in tables of experiments, by their names."""
