"""ctr_opt: concentric-tube continuum robots under external load.

A geometrically exact model (Rucker, Jones and Webster, IEEE T-RO 2010) of nested precurved elastic tubes, written
symbolically in CasADi and solved with Newton's method and IPOPT. SI units throughout; tube 0 is the innermost.
"""

from __future__ import annotations

from .batch import Batch as Batch
from .equilibrium import BaseMoments as BaseMoments
from .equilibrium import Equilibrium as Equilibrium
from .errors import CompilationError as CompilationError
from .errors import CtrOptError as CtrOptError
from .errors import DefinitionError as DefinitionError
from .errors import EstimationError as EstimationError
from .errors import EstimationWarning as EstimationWarning
from .errors import NestingWarning as NestingWarning
from .errors import SolveError as SolveError
from .experiment_tables import read_experiments as read_experiments
from .experiment_tables import write_experiments as write_experiments
from .files import Problem as Problem
from .files import load_problem as load_problem
from .files import load_robot as load_robot
from .files import save_robot as save_robot
from .files import save_shape as save_shape
from .forward import ForwardProblem as ForwardProblem
from .inverse.calibration import CalibrationProblem as CalibrationProblem
from .inverse.contact_number import Contacts as Contacts
from .inverse.distributed_force import DistributedForce as DistributedForce
from .inverse.experiment import Experiment as Experiment
from .inverse.fit import Fit as Fit
from .inverse.force_estimate import ForceEstimate as ForceEstimate
from .inverse.force_estimation import ForceEstimationProblem as ForceEstimationProblem
from .inverse.force_stream import ForceEstimator as ForceEstimator
from .inverse.measurements import BackboneMeasurement as BackboneMeasurement
from .inverse.measurements import CurvatureMeasurement as CurvatureMeasurement
from .inverse.measurements import Distal as Distal
from .inverse.measurements import ForceMeasurement as ForceMeasurement
from .inverse.measurements import PoseMeasurement as PoseMeasurement
from .inverse.measurements import PositionMeasurement as PositionMeasurement
from .inverse.measurements import TangentMeasurement as TangentMeasurement
from .inverse.measurements import TorqueMeasurement as TorqueMeasurement
from .inverse.parameters import Parameter as Parameter
from .inverse.streamed_force import StreamedForce as StreamedForce
from .inverse.unknown_loads import PointForce as PointForce
from .inverse.unknown_loads import TipForce as TipForce
from .inverse.unknown_loads import TipWrench as TipWrench
from .kinematics.limits import JointLimits as JointLimits
from .kinematics.problem import InverseKinematicsProblem as InverseKinematicsProblem
from .kinematics.result import InverseKinematicsPath as InverseKinematicsPath
from .kinematics.result import InverseKinematicsResult as InverseKinematicsResult
from .kinematics.result import InverseKinematicsStatus as InverseKinematicsStatus
from .plans import Plan as Plan
from .plans import load_plan as load_plan
from .robot.actuation import Actuation as Actuation
from .robot.curves import precurvature_from_curve as precurvature_from_curve
from .robot.fields import ExpressionLoad as ExpressionLoad
from .robot.fields import PotentialLoad as PotentialLoad
from .robot.loads import DistributedLoad as DistributedLoad
from .robot.loads import PointWrench as PointWrench
from .robot.precurvature import Arc as Arc
from .robot.precurvature import PolynomialCurvature as PolynomialCurvature
from .robot.precurvature import SampledCurvature as SampledCurvature
from .robot.precurvature import Straight as Straight
from .robot.robot import Robot as Robot
from .robot.tube import Tube as Tube
from .robot.weights import DistributedMass as DistributedMass
from .robot.weights import Gravity as Gravity
from .robot.weights import PointMass as PointMass
from .solvers.homotopy import Homotopy as Homotopy
from .solvers.ipopt import Ipopt as Ipopt
from .solvers.newton import Newton as Newton
from .solvers.status import SolveStatus as SolveStatus
from .transcription.schemes import Collocation as Collocation
from .transcription.schemes import MultipleShooting as MultipleShooting
from .version import __version__ as __version__
