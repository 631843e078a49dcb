"""Measurements of a robot in equilibrium, with covariances: a file for each kind, what all share in ``kind``."""

from __future__ import annotations

from .actuators import ForceMeasurement as ForceMeasurement
from .actuators import TorqueMeasurement as TorqueMeasurement
from .backbone import BackboneMeasurement as BackboneMeasurement
from .curvature import CurvatureMeasurement as CurvatureMeasurement
from .kind import Distal as Distal
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
)
"""All kinds, in the order in which messages name them."""
