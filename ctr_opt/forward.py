"""The forward problem: from actuation and loads to the robot's shape."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from .equilibrium import BaseMoments, Equilibrium, Outcome
from .errors import DefinitionError, SolveError
from .mechanics.sections import Configuration
from .robot.actuation import Actuation
from .robot.checks import array, choice, number
from .robot.loads import LOADS, Load
from .robot.robot import Robot
from .settings import METHOD_NAMES, METHODS, Method, Settings
from .solvers.ipopt import Ipopt
from .solvers.status import SolveStatus
from .strategy import Run
from .transcription.integrators import INTEGRATORS
from .transcription.schemes import Collocation, MultipleShooting, Transcription


class ForwardProblem:
    """The shape of a robot under actuation and loads.

    Parameters
    ----------
    robot
        The robot.
    formulation
        ``"automatic"``: homotopy from the straight robot and, where its path ends or leads to an unstable equilibrium,
        minimum energy;
        ``"equilibrium"``: the Cosserat equations alone; ``"energy"``: minimum potential energy by IPOPT, which yields
        a stable shape and takes conservative loads only.
    method
        For ``"equilibrium"``: ``Homotopy(...)`` (default) or ``Newton(...)`` from zero, which shoot, or ``Ipopt(...)``,
        which solves a transcription (default where one is given); for ``"energy"``: ``Ipopt(...)``. Or its name,
        ``"homotopy"``, ``"newton"``, ``"ipopt"``. With ``"automatic"`` a method of another formulation chooses that
        one.
    tolerance
        Largest accepted estimated position error divided by the length, 1e-11 to 1e-2; everything else follows from it.
    integrator
        Runge-Kutta method of single and multiple shooting: ``"RK8"``, ``"RK5"``, ``"RK4"``.
    transcription
        What IPOPT solves: ``Collocation(degree, scheme)`` (default) or ``MultipleShooting()``, in either formulation.

    Notes
    -----
    Rucker, Jones and Webster, IEEE T-RO 2010, (2), (12)-(20) and II-G. Nothing is rebuilt between solves, but for
    loads by new expressions: one problem serves any actuation and any number of loads.

    Examples
    --------
    >>> import numpy as np, ctr_opt as ctr
    >>> tube = ctr.Tube("rod", 1e-3, 0.0, ctr.Arc(0.1, 10.0), youngs_modulus=60e9, poisson_ratio=0.3)
    >>> shape = ctr.ForwardProblem(ctr.Robot([tube])).solve(ctr.Actuation([0.0], [0.0]))
    >>> bool(abs(shape.tip_position[2] - np.sin(1.0) / 10.0) < 1e-9)
    True
    """

    def __init__(
        self,
        robot: Robot,
        *,
        formulation: str = "automatic",
        method: Method | str | None = None,
        tolerance: float = 1e-7,
        integrator: str = "RK8",
        transcription: Transcription | None = None,
    ) -> None:
        if not isinstance(robot, Robot):
            raise DefinitionError(f"robot = {robot!r} must be a Robot")
        self.robot = robot
        if not isinstance(transcription, (Collocation, MultipleShooting, type(None))):
            raise DefinitionError(f"transcription = {transcription!r} must be a Collocation or a MultipleShooting")
        formulation, method = _method(formulation, method, transcription)
        self.settings = Settings(
            formulation,
            method,
            number(tolerance, "tolerance", least=1e-11, most=1e-2),
            choice(integrator, "integrator", INTEGRATORS),
            transcription or Collocation(),
        )

    def solve(
        self,
        actuation: Actuation,
        loads: Sequence[Load] = (),
        initial: Equilibrium | None = None,
        throw: bool = True,
    ) -> Equilibrium:
        """Find an equilibrium.

        Parameters
        ----------
        actuation
            Rotations and translations of the tubes' bases.
        loads
            Any number of loads.
        initial
            An equilibrium (or a :meth:`guess`) of a robot with as many tubes, at any actuation and loads: solved from
            there by Newton's method and, failing that, by continuation of actuation and loads from there.
        throw
            Raise ``SolveError`` where no equilibrium is found; otherwise return the failed result.

        Raises
        ------
        DefinitionError
            A load beyond its tube, a tube drawn wholly behind the entry point, and the like.
        SolveError
            No equilibrium was found: what was tried, how far it got, what to do; ``.result`` is the failed result.
        """
        configuration = self.check(actuation, loads)
        if initial is not None:
            _check_initial(initial, configuration)
        result = Run(self.settings, configuration).solve(initial)
        if throw and not result.converged:
            raise SolveError(result.message, result)
        return result

    def check(self, actuation: Actuation, loads: Sequence[Load] = ()) -> Configuration:
        """Check actuation and loads without solving; returns them as numbers along the arc length.

        Raises
        ------
        DefinitionError
            As :meth:`solve`.
        """
        configuration = Configuration(self.robot, actuation, _as_loads(loads))
        if self.settings.formulation == "energy":
            _refuse_nonconservative(configuration)
        return configuration

    def guess(
        self,
        actuation: Actuation,
        loads: Sequence[Load] = (),
        *,
        bending: Any = (0.0, 0.0),
        torsional: Any = None,
    ) -> Equilibrium:
        """A start for :meth:`solve`: the moments that the robot is believed to exert on the entry point.

        Parameters
        ----------
        actuation, loads
            As in :meth:`solve`.
        bending
            ``(2,)``, N m: total bending moment at ``s = 0`` in the backbone frame.
        torsional
            ``(tubes,)``, N m: torsional moment ``GJ_i (u_i,z - u*_i,z)`` at each tube's base; default zero.
        """
        configuration = Configuration(self.robot, actuation, _as_loads(loads))
        tubes = configuration.tube_count
        base = BaseMoments(
            array(bending, "bending", (2,), unit="N m"),
            array(np.zeros(tubes) if torsional is None else torsional, "torsional", (tubes,), unit="N m"),
        )
        return Equilibrium(configuration, base, Outcome(SolveStatus.GUESS, "guess", "this is a guess, not a solution"))


def _method(formulation: Any, method: Any, transcription: Transcription | None) -> tuple[str, Method]:
    """Formulation and method, each given or following from the other."""
    allowed = METHODS[choice(formulation, "formulation", tuple(METHODS))]
    if isinstance(method, str):
        method = METHOD_NAMES[choice(method, "method", tuple(METHOD_NAMES))]()
    if method is None:
        by_default = Ipopt if formulation == "equilibrium" and transcription is not None else allowed[0]
        return formulation, by_default()
    if formulation == "automatic" and not isinstance(method, allowed):
        formulation = next((name for name, kinds in METHODS.items() if isinstance(method, kinds)), formulation)
        allowed = METHODS[formulation]
    if not isinstance(method, allowed):
        names = " or ".join(kind.__name__ for kind in allowed)
        raise DefinitionError(f"method = {method!r} must be {names} with formulation = {formulation!r}")
    if formulation == "equilibrium" and transcription is not None and not isinstance(method, Ipopt):
        raise DefinitionError(
            f"transcription = {transcription!r} needs method = Ipopt(...): {type(method).__name__} shoots"
        )
    return formulation, method


def _refuse_nonconservative(configuration: Configuration) -> None:
    """The energy formulation takes loads that have a potential."""
    if configuration.without_potential:
        raise DefinitionError(
            f"{configuration.without_potential}: formulation = 'energy' takes conservative loads only; "
            "use formulation = 'automatic' or 'equilibrium'"
        )


def _as_loads(loads: Any) -> tuple[Load, ...]:
    if isinstance(loads, LOADS):
        raise DefinitionError(f"loads = {loads!r} must be a list of loads, like loads=[...]")
    try:
        return tuple(loads)
    except TypeError:
        raise DefinitionError(f"loads = {loads!r} must be a list of loads") from None


def _check_initial(initial: Any, configuration: Configuration) -> None:
    if not isinstance(initial, Equilibrium):
        raise DefinitionError(f"initial = {initial!r} must be an Equilibrium")
    tubes = len(initial.robot.tubes)
    if tubes != configuration.tube_count:
        raise DefinitionError(f"initial is of a robot with {tubes} tubes, but this one has {configuration.tube_count}")
