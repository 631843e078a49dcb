"""Sensing: points, frames, forces and precurvatures of an experiment from raw data, each with its uncertainty."""

from __future__ import annotations

from .cameras import Camera as Camera
from .cameras import load_cameras as load_cameras
from .fibres import FibreCurvature as FibreCurvature
from .fibres import core_ring as core_ring
from .fibres import curvature_from_strains as curvature_from_strains
from .forces import WireDirection as WireDirection
from .forces import WireForce as WireForce
from .forces import hanging_mass as hanging_mass
from .forces import wire_direction as wire_direction
from .precurvature_fit import PrecurvatureFit as PrecurvatureFit
from .precurvature_fit import identify_precurvature as identify_precurvature
from .registration import Registration as Registration
from .registration import RegistrationErrors as RegistrationErrors
from .registration import register as register
from .triangulation import Triangulation as Triangulation
from .triangulation import triangulate as triangulate
