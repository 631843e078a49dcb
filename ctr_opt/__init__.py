"""ctr_opt: concentric-tube continuum robots under external load.

A geometrically exact model (Rucker, Jones and Webster, IEEE T-RO 2010) of nested precurved elastic tubes, written
symbolically in CasADi and solved with Newton's method and IPOPT. SI units throughout; tube 0 is the innermost.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any

from .calibration.fit import Fit
from .calibration.problem import CalibrationProblem
from .calibration.unknowns import Parameter
from .errors import (
    CompilationError,
    CtrOptError,
    DefinitionError,
    EstimationError,
    EstimationWarning,
    NestingWarning,
    PlausibilityWarning,
    SolveError,
)
from .estimation.experiment import Experiment
from .estimation.measurements import (
    BackboneMeasurement,
    BaseWrenchMeasurement,
    CurvatureMeasurement,
    ForceMeasurement,
    PoseMeasurement,
    PositionMeasurement,
    TangentMeasurement,
    TorqueMeasurement,
)
from .files.experiments import read_experiments, write_experiments
from .files.plans import Plan, load_plan
from .files.problem import Problem, load_problem, load_robot, save_robot, save_shape
from .force.contact_number import Contacts
from .force.distributed import DistributedForce
from .force.estimate import ForceEstimate
from .force.problem import ForceEstimationProblem
from .force.stream import ForceEstimator
from .force.streamed import StreamedForce
from .force.unknown import PointForce, TipForce, TipWrench
from .forward.batch.result import Batch
from .forward.equilibrium import Equilibrium
from .forward.problem import ForwardProblem
from .forward.record import BaseMoments
from .forward.sample import Sample
from .kinematics.limits import JointLimits
from .kinematics.problem import InverseKinematicsProblem
from .kinematics.result import InverseKinematicsPath, InverseKinematicsResult, InverseKinematicsStatus
from .layout.observables import Distal
from .loads.distributed import DistributedLoad
from .loads.expression import ExpressionLoad
from .loads.gravity import Gravity
from .loads.masses import DistributedMass, PointMass
from .loads.point import PointWrench
from .loads.potential import PotentialLoad
from .loads.spring import Spring
from .robot.actuation import Actuation
from .robot.curves import precurvature_from_curve
from .robot.precurvature import Arc, PolynomialCurvature, SampledCurvature, Straight
from .robot.robot import Robot
from .robot.tube import Tube
from .solvers.homotopy import Homotopy
from .solvers.ipopt import Ipopt
from .solvers.newton import Newton
from .solvers.status import SolveStatus
from .transcription.schemes import Collocation, MultipleShooting
from .version import __version__

# fmt: off
__all__ = [
    "Actuation", "Arc", "BackboneMeasurement", "BaseMoments", "BaseWrenchMeasurement", "Batch", "CalibrationProblem",
    "Collocation", "CompilationError", "Contacts", "CtrOptError", "CurvatureMeasurement", "DefinitionError", "Distal",
    "DistributedForce", "DistributedLoad", "DistributedMass", "Equilibrium", "EstimationError", "EstimationWarning",
    "Experiment", "ExpressionLoad", "Fit", "ForceEstimate", "ForceEstimationProblem", "ForceEstimator",
    "ForceMeasurement", "ForwardProblem", "Gravity", "Homotopy", "InverseKinematicsPath",
    "InverseKinematicsProblem", "InverseKinematicsResult", "InverseKinematicsStatus", "Ipopt", "JointLimits",
    "MultipleShooting", "NestingWarning", "Newton", "Parameter", "Plan", "PlausibilityWarning", "PointForce",
    "PointMass", "PointWrench", "PolynomialCurvature", "PoseMeasurement", "PositionMeasurement", "PotentialLoad",
    "Problem", "Robot", "Sample", "SampledCurvature", "SolveError", "SolveStatus", "Spring", "Straight",
    "StreamedForce", "TangentMeasurement", "TipForce", "TipWrench", "TorqueMeasurement", "Tube", "__version__",
    "load_plan", "load_problem", "load_robot",
    "precurvature_from_curve", "read_experiments", "save_robot", "save_shape", "sensing", "write_experiments",
]
# fmt: on


def __dir__() -> list[str]:
    return list(__all__)


def __getattr__(name: str) -> Any:
    if name == "sensing":
        return import_module(".sensing", __name__)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
