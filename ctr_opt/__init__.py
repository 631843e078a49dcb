"""ctr_opt: concentric-tube continuum robots under external load.

A geometrically exact model (Rucker, Jones and Webster, IEEE T-RO 2010) of nested precurved elastic tubes, written
symbolically in CasADi and solved with Newton's method and IPOPT. SI units throughout; tube 0 is the innermost.
"""

from __future__ import annotations

from .calibration.fit import Fit as Fit
from .calibration.problem import CalibrationProblem as CalibrationProblem
from .calibration.unknowns import Parameter as Parameter
from .errors import CompilationError as CompilationError
from .errors import CtrOptError as CtrOptError
from .errors import DefinitionError as DefinitionError
from .errors import EstimationError as EstimationError
from .errors import EstimationWarning as EstimationWarning
from .errors import NestingWarning as NestingWarning
from .errors import SolveError as SolveError
from .estimation.experiment import Experiment as Experiment
from .estimation.measurements import BackboneMeasurement as BackboneMeasurement
from .estimation.measurements import CurvatureMeasurement as CurvatureMeasurement
from .estimation.measurements import Distal as Distal
from .estimation.measurements import ForceMeasurement as ForceMeasurement
from .estimation.measurements import PoseMeasurement as PoseMeasurement
from .estimation.measurements import PositionMeasurement as PositionMeasurement
from .estimation.measurements import TangentMeasurement as TangentMeasurement
from .estimation.measurements import TorqueMeasurement as TorqueMeasurement
from .files.experiments import read_experiments as read_experiments
from .files.experiments import write_experiments as write_experiments
from .files.plans import Plan as Plan
from .files.plans import load_plan as load_plan
from .files.problem import Problem as Problem
from .files.problem import load_problem as load_problem
from .files.problem import load_robot as load_robot
from .files.problem import save_robot as save_robot
from .files.problem import save_shape as save_shape
from .force.contact_number import Contacts as Contacts
from .force.distributed import DistributedForce as DistributedForce
from .force.estimate import ForceEstimate as ForceEstimate
from .force.problem import ForceEstimationProblem as ForceEstimationProblem
from .force.stream import ForceEstimator as ForceEstimator
from .force.streamed import StreamedForce as StreamedForce
from .force.unknown import PointForce as PointForce
from .force.unknown import TipForce as TipForce
from .force.unknown import TipWrench as TipWrench
from .forward.batch import Batch as Batch
from .forward.equilibrium import BaseMoments as BaseMoments
from .forward.equilibrium import Equilibrium as Equilibrium
from .forward.problem import ForwardProblem as ForwardProblem
from .kinematics.limits import JointLimits as JointLimits
from .kinematics.problem import InverseKinematicsProblem as InverseKinematicsProblem
from .kinematics.result import InverseKinematicsPath as InverseKinematicsPath
from .kinematics.result import InverseKinematicsResult as InverseKinematicsResult
from .kinematics.result import InverseKinematicsStatus as InverseKinematicsStatus
from .loads.fields import ExpressionLoad as ExpressionLoad
from .loads.fields import PotentialLoad as PotentialLoad
from .loads.gravity import DistributedMass as DistributedMass
from .loads.gravity import Gravity as Gravity
from .loads.gravity import PointMass as PointMass
from .loads.wrenches import DistributedLoad as DistributedLoad
from .loads.wrenches import PointWrench as PointWrench
from .robot.actuation import Actuation as Actuation
from .robot.curves import precurvature_from_curve as precurvature_from_curve
from .robot.precurvature import Arc as Arc
from .robot.precurvature import PolynomialCurvature as PolynomialCurvature
from .robot.precurvature import SampledCurvature as SampledCurvature
from .robot.precurvature import Straight as Straight
from .robot.robot import Robot as Robot
from .robot.tube import Tube as Tube
from .solvers.homotopy import Homotopy as Homotopy
from .solvers.ipopt import Ipopt as Ipopt
from .solvers.newton import Newton as Newton
from .solvers.status import SolveStatus as SolveStatus
from .transcription.schemes import Collocation as Collocation
from .transcription.schemes import MultipleShooting as MultipleShooting
from .version import __version__ as __version__
