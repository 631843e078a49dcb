"""Loads on a robot, one file per kind: frozen, validated values in plain numpy."""

from __future__ import annotations

from .distributed import DistributedLoad as DistributedLoad
from .expression import ExpressionLoad as ExpressionLoad
from .gravity import Gravity as Gravity
from .kind import Load as Load
from .masses import DistributedMass as DistributedMass
from .masses import PointMass as PointMass
from .point import PointWrench as PointWrench
from .potential import PotentialLoad as PotentialLoad
from .spring import Spring as Spring

LOADS = (PointWrench, DistributedLoad, Gravity, PointMass, DistributedMass, Spring, PotentialLoad, ExpressionLoad)
