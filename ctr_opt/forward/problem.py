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
        ``"automatic"``: homotopy from the straight robot; energy minimization if that path ends or its end is unstable.
        ``"equilibrium"``: the Cosserat equations alone. ``"energy"``: energy minimization by IPOPT, which yields a
        stable shape and takes conservative loads only.
    method
        For ``"equilibrium"``: ``Homotopy(...)`` (default) or ``Newton(...)`` from zero, which shoot, or ``Ipopt(...)``,
        which solves a transcription (default if ``transcription`` is given). For ``"energy"``: ``Ipopt(...)``. Names
        are accepted too: ``"homotopy"``, ``"newton"``, ``"ipopt"``. With ``"automatic"``, ``Newton`` and ``Ipopt``
        select the formulation that they belong to.
    tolerance
        Largest accepted position error, estimated, divided by the length: 1e-11 to 1e-2. The other accuracies follow
        from it.
    integrator
        Runge-Kutta method of single and multiple shooting: ``"RK8"``, ``"RK5"``, ``"RK4"``.
    transcription
        What IPOPT solves: ``Collocation(degree, scheme)`` (default) or ``MultipleShooting()``, in either formulation.
    compiled
        Whether to use compiled code. ``None``: as soon as it is available (see :meth:`compile`). ``True``: compile now.
        ``False``: never. Compiled code covers homotopy with ``"RK8"`` under loads that are constant or fixed to a
        tube. The answers agree within the tolerance.

    Notes
    -----
    Rucker, Jones and Webster, IEEE T-RO 2010, (2), (12)-(20) and II-G. One problem serves any actuation and any number
    of loads. Only loads given by new expressions make it build functions again.

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
        """Compile the solver for this number of tubes if it is not cached; takes a few seconds once per machine.

        Later solves by homotopy, or from an ``initial`` equilibrium, use the compiled code. Loads in a tube's frame
        need a second library. It is compiled when such loads are first solved, which takes a few seconds more. Without
        this call, a process compiles in the background after ten solves. Until then, and without a compiler,
        everything runs in CasADi's virtual machine.

        Raises
        ------
        CompilationError
            There is no compiler, or it failed.
        """
        self.solver.compile()

    @property
    def compiles(self) -> bool:
        """Whether compiled code is available for robots without loads or with world-fixed loads."""
        return self.solver.compiled_for(()) is not None

    def solve(
        self,
        actuation: Actuation,
        loads: Sequence[Load] = (),
        initial: Equilibrium | None = None,
        throw: bool = True,
    ) -> Equilibrium:
        """Find the equilibrium under an actuation and loads.

        Parameters
        ----------
        actuation
            Rotations (rad) and translations (m) of the tubes' bases.
        loads
            Any number of loads.
        initial
            An equilibrium, or a :meth:`guess`, to start from. Its robot must have this number of tubes; its actuation
            and loads may differ. Newton's method starts there. If it fails, or if tubes turn against each other by
            more than half a turn, actuation and loads are continued from there.
        throw
            Whether to raise ``SolveError`` if no equilibrium is found, or to return the failed result.

        Returns
        -------
        Equilibrium
            The shape, its internal loads and derivatives.

        Raises
        ------
        DefinitionError
            For example a load beyond the end of its tube, or a tube drawn wholly behind the entry point.
        SolveError
            No equilibrium was found. The message says what was tried, how far it got and what to do; ``.result`` is
            the failed result.

        Examples
        --------
        >>> import ctr_opt as ctr
        >>> tube = ctr.Tube("rod", 1e-3, 0.0, ctr.Straight(0.1), youngs_modulus=60e9, poisson_ratio=0.3)
        >>> problem = ctr.ForwardProblem(ctr.Robot([tube]))
        >>> push = ctr.PointWrench(force=[0.01, 0.0, 0.0])
        >>> problem.solve(ctr.Actuation([0.0], [0.0]), [push]).converged
        True
        """
        return self.solver.solve(actuation, as_loads(loads), initial, throw if throw is True else flag(throw, "throw"))

    def neighbour(self, actuation: Actuation, loads: Sequence[Load], initial: Equilibrium) -> Equilibrium | None:
        """The equilibrium next to ``initial`` on the same branch, or None if that is in doubt.

        It works like :meth:`solve`, except that the general solver is not tried if compiled code supports the loads.
        After None, take a shorter step.
        """
        return self.solver.neighbour(actuation, as_loads(loads), initial)

    def solve_many(
        self,
        actuations: Sequence[Actuation] | tuple[Any, Any],
        loads: Sequence[Any] = (),
        initial: Equilibrium | None = None,
        *,
        chained: bool = True,
    ) -> Batch:
        """Solve many actuations in one call; rows that fail are marked and do not stop the others.

        Parameters
        ----------
        actuations
            The actuations, or a pair of arrays: rotations and translations, ``(k, tubes)`` each, rad and m.
        loads
            One list of loads for all rows, or one list for each row.
        initial
            An equilibrium to start the first row from; default: a cold start.
        chained
            ``True`` is for paths: each row continues the branch of the row before. Where the branch ends, the row is
            solved cold and marked in :attr:`Batch.snapped <ctr_opt.Batch.snapped>`. ``False`` is for random or
            unrelated rows: every row starts from ``initial``, or cold. Random rows in a chain are slow, as each must be
            followed from the row before, and the chain may end on another branch than a cold start.

        Returns
        -------
        Batch
            One result for each row, in their order.

        Raises
        ------
        DefinitionError
            For example arrays of wrong shapes, a row that is not an actuation, or a load beyond its tube.

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
        """Check actuation and loads without solving; return them as numbers along the arc length.

        Raises
        ------
        DefinitionError
            For the reasons given in :meth:`solve`.
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
        """The solved forward problem as a differentiable function for user-defined CasADi programs.

        It runs Newton's method from ``initial`` (moments at the base) at the values of its inputs. Break points are
        sorted inside, so tubes may pass each other. First and second derivatives are exact, by the implicit-function
        theorem. Where break points coincide, the derivatives hold for one of the two neighbouring orders.

        Parameters
        ----------
        initial
            An equilibrium. Its loads act, and parameters that are not inputs keep its values.
        wrt
            The names of the parameters that become inputs, as in :meth:`Equilibrium.sensitivity`. In the names of
            inputs, underscores replace other characters: ``loads[0].force`` becomes ``loads_0_force``. Name only the
            parameters you need: each one makes second derivatives slower.
        along
            Arc lengths ``(k,)``, m, of further positions to return. Beyond the tip, the tip's position is returned.
        steps
            Integration steps in each section between break points; default: the largest number in any section of
            ``initial``.

        Returns
        -------
        casadi.Function
            Inputs: the parameters in their order, and ``initial``, the values :attr:`Equilibrium.unknowns` to start
            from: moments (N m) and, under loads that depend on the shape, force (N). Outputs: ``tip_position (3,)``,
            m; ``tip_rotation (3, 3)``; ``positions (3, k)`` if ``along`` is given; ``unknowns``, to start the next
            solve from; ``residual_norm``. All but the last are NaN if Newton's method finds no root, a load is beyond
            its tube's end, or a tube is too far in or out. IPOPT then shortens its step. The function can be pickled.

        Raises
        ------
        DefinitionError
            An unknown name, or a load given as a Python function of ``s`` while break points move.

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
        """A starting point for :meth:`solve`, from guessed moments at the entry point.

        Parameters
        ----------
        actuation, loads
            As in :meth:`solve`.
        bending
            ``(2,)``, N m: total bending moment at ``s = 0`` in the backbone frame.
        torsional
            ``(tubes,)``, N m: torsional moment ``GJ_i (u_i,z - u*_i,z)`` at each tube's base; default zero.

        Examples
        --------
        >>> import ctr_opt as ctr
        >>> tube = ctr.Tube("rod", 1e-3, 0.0, ctr.Straight(0.1), youngs_modulus=60e9, poisson_ratio=0.3)
        >>> problem, held = ctr.ForwardProblem(ctr.Robot([tube])), ctr.Actuation([0.0], [0.0])
        >>> problem.solve(held, initial=problem.guess(held, bending=[0.0, 1e-3])).path
        'newton from initial'
        """
        configuration = Configuration(self.robot, actuation, as_loads(loads))
        return Equilibrium(
            SolvedRecord.guess(configuration, BaseMoments.checked(bending, torsional, len(self.robot.tubes)))
        )
