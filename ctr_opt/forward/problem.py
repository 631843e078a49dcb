"""The forward problem: from actuation and loads to the robot's shape."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import casadi as ca

from ..checks import flag
from ..errors import DefinitionError
from ..layout.configuration import Configuration
from ..loads.kind import Load
from ..robot.actuation import Actuation
from ..robot.robot import Robot
from ..transcription.schemes import Transcription
from .batch.result import Batch
from .batch.solve import solve_rows
from .equilibrium import Equilibrium
from .function import forward_function
from .record import BaseMoments, SolvedRecord
from .settings import Method, Settings
from .solver import ForwardSolver, as_loads


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
    compiled
        Whether to use compiled code for homotopy with ``"RK8"`` under loads that are constant or fixed to a tube:
        ``None``: as soon as it is there (see :meth:`compile`), ``True``: compiled now, ``False``: never. The answers
        are the same to the tolerance.

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
        compiled: bool | None = None,
    ) -> None:
        if not isinstance(robot, Robot):
            raise DefinitionError(f"robot = {robot!r} must be a Robot")
        self.robot = robot
        self.settings = Settings.of(formulation, method, tolerance, integrator, transcription)
        self.compiled = compiled if compiled is None else flag(compiled, "compiled")
        self.solver = ForwardSolver(robot, self.settings, self.compiled)
        if self.compiled:
            self.compile()

    def compile(self) -> None:
        """Compile the solver for robots with as many tubes, unless it was before; seconds the first time on a machine.

        Later solves of this problem by homotopy, or from an ``initial`` one, use it. Without a call a process starts
        this by itself in the background when it solves again and again; meanwhile, and where there is no compiler,
        everything works in CasADi's virtual machine.

        Raises
        ------
        CompilationError
            There is no compiler, or it failed.
        """
        self.solver.compile()

    @property
    def compiles(self) -> bool:
        """Whether there is compiled code for free robots, or for loads that it knows."""
        return self.solver.compiled_for(()) is not None

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
            there by Newton's method and, failing that or where tubes turn by more than half a turn in each other, by
            continuation of actuation and loads from there.
        throw
            Raise ``SolveError`` where no equilibrium is found; otherwise return the failed result.

        Raises
        ------
        DefinitionError
            A load beyond its tube, a tube drawn wholly behind the entry point, and the like.
        SolveError
            No equilibrium was found: what was tried, how far it got, what to do; ``.result`` is the failed result.
        """
        return self.solver.solve(actuation, as_loads(loads), initial, throw)

    def neighbour(self, actuation: Actuation, loads: tuple[Load, ...], initial: Equilibrium) -> Equilibrium | None:
        """The equilibrium next to ``initial`` on the same branch, or None where that is in doubt.

        As :meth:`solve`, but where compiled code knows the loads no slower way is tried: take a shorter step then.
        """
        return self.solver.neighbour(actuation, loads, initial)

    def solve_many(
        self,
        actuations: Sequence[Actuation] | tuple[Any, Any],
        loads: Sequence[Any] = (),
        initial: Equilibrium | None = None,
        *,
        chained: bool = True,
    ) -> Batch:
        """Solve many actuations in one call; what fails is marked and does not stop the others.

        Parameters
        ----------
        actuations
            The actuations, or a pair of arrays: rotations and translations, ``(k, tubes)`` each, rad and m.
        loads
            One list of loads for all rows, or a list of them for each row.
        initial
            An equilibrium to start the first row from; default: a cold start.
        chained
            Each row continues the branch of the one before, as along a path of the robot. Where the branch ends, the
            row is solved cold and marked in :attr:`Batch.snapped <ctr_opt.Batch.snapped>`. ``False``: every row starts
            from ``initial``, or from nothing, whatever the others are.

        Raises
        ------
        DefinitionError
            Arrays of wrong shapes, rows that are no actuations, a load beyond its tube in some row, and the like.

        Examples
        --------
        >>> import numpy as np, ctr_opt as ctr
        >>> tube = ctr.Tube("rod", 1e-3, 0.0, ctr.Arc(0.1, 10.0), youngs_modulus=60e9, poisson_ratio=0.3)
        >>> turned = (np.linspace(0.0, 1.0, 5)[:, None], np.zeros((5, 1)))
        >>> ctr.ForwardProblem(ctr.Robot([tube])).solve_many(turned)
        <Batch of 5 equilibria, 0 failed, 0 snapped>
        """
        return solve_rows(self.solver, actuations, loads, initial, chained)

    def check(self, actuation: Actuation, loads: Sequence[Load] = ()) -> Configuration:
        """Check actuation and loads without solving; returns them as numbers along the arc length.

        Raises
        ------
        DefinitionError
            As :meth:`solve`.
        """
        return self.solver.configuration(actuation, as_loads(loads))

    def function(
        self,
        initial: Equilibrium,
        wrt: Sequence[str] = ("rotations", "translations"),
        *,
        along: Any = (),
        steps: int | None = None,
    ) -> ca.Function:
        """The solved forward problem as a differentiable function, to use inside a CasADi program of one's own.

        Newton's method from ``initial`` (moments at the base), at whatever values its inputs have. Break points are
        sorted inside, so that tubes may pass each other. First and second derivatives are exact, by the
        implicit-function theorem; where break points coincide they are those of one of the orders next to it.

        Parameters
        ----------
        initial
            An equilibrium: its loads act, and what is no input keeps its value.
        wrt
            The names of parameters that become inputs, as in :meth:`Equilibrium.sensitivity`. Inputs are named with
            underscores for what is no letter or digit: ``loads[0].force`` is ``loads_0_force``. Name only what you
            need: second derivatives take the longer the more there are.
        along
            Arc lengths ``(k,)``, m, whose positions are wanted too; where the robot is shorter, that of its tip.
        steps
            Integration steps in each section between break points; default: the most that ``initial`` needed in one.

        Returns
        -------
        casadi.Function
            Inputs: the parameters in their order, and ``initial``: moments (N m), and force (N) under loads that depend
            on the shape, to start from, :attr:`Equilibrium.unknowns`. Outputs: ``tip_position (3,)``, m;
            ``tip_rotation (3, 3)``; ``positions (3, k)`` if any are wanted; ``unknowns``, to start the next solve from;
            ``residual_norm``. Where Newton's method finds no root, a load would be beyond its tube's end, or a tube
            drawn in or out too far, all but the last are NaN, so that IPOPT shortens its step. It can be pickled.

        Raises
        ------
        DefinitionError
            A name that is not there; a load given as a python function of ``s``, unless no break point moves.

        Examples
        --------
        >>> import numpy as np, ctr_opt as ctr
        >>> tube = ctr.Tube("rod", 1e-3, 0.0, ctr.Arc(0.1, 10.0), youngs_modulus=60e9, poisson_ratio=0.3)
        >>> problem = ctr.ForwardProblem(ctr.Robot([tube]))
        >>> shape = problem.solve(ctr.Actuation([0.0], [0.0]))
        >>> forward = problem.function(shape)
        >>> tip = forward(rotations=0.0, translations=0.0, initial=shape.unknowns)["tip_position"]
        >>> bool(abs(float(tip[2]) - np.sin(1.0) / 10.0) < 1e-9)
        True
        """
        return forward_function(self.robot, initial, wrt, along, steps)

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
        configuration = Configuration(self.robot, actuation, as_loads(loads))
        return Equilibrium(
            SolvedRecord.guess(configuration, BaseMoments.checked(bending, torsional, len(self.robot.tubes)))
        )
