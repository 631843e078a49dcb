"""The command line: ``ctr-opt solve``, ``estimate``, ``calibrate``, ``list`` and ``check``."""

from __future__ import annotations

import atexit
import logging
import math
import os
import signal
import sys
import textwrap
import warnings
from contextlib import suppress
from pathlib import Path
from typing import Any

import click

from . import __version__
from .errors import CtrOptError, DefinitionError, EstimationError, SolveError

_FILE = click.Path(path_type=Path)
_BAD_INPUT, _NOT_SOLVED = 2, 1
_STOPPED = 128  # plus the number of the signal, as shells report it
_GRACE = 2.0  # seconds for cleaning up after a signal
_KINDS = {"experiments": ("a calibration file", "calibrate"), "measurements": ("a force file", "estimate")}
"""Kinds of files with a command of their own, by the key that only they have."""


class _Group(click.Group):
    """A group of commands that prints the package's errors; exit code 2 for wrong input, 1 for a failed solve."""

    def invoke(self, ctx: click.Context) -> Any:
        try:
            return super().invoke(ctx)
        except CtrOptError as error:
            click.echo(f"ctr-opt: {error}", err=True)
            ctx.exit(_NOT_SOLVED if isinstance(error, (SolveError, EstimationError)) else _BAD_INPUT)
        except BrokenPipeError:
            raise
        except OSError as error:
            click.echo(f"ctr-opt: cannot write: {error}", err=True)
            ctx.exit(_BAD_INPUT)


@click.group(cls=_Group, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(__version__, prog_name="ctr-opt")
@click.option("-v", "--verbose", is_flag=True, help="Log what the solvers do.")
def cli(verbose: bool) -> None:
    """Shapes of concentric-tube continuum robots under external load."""
    logging.basicConfig(level=logging.INFO if verbose else logging.WARNING, format="%(name)s: %(message)s")
    warnings.showwarning = _show_warning


@cli.command()
@click.argument("problem", type=_FILE)
@click.option("--output", type=_FILE, help="Write the shape to this .csv, .npz or .json file.")
@click.option("--figure", type=_FILE, help="Draw the robot, unloaded and loaded, to this .png, .pdf or .svg file.")
@click.option(
    "--formulation",
    type=click.Choice(["automatic", "equilibrium", "energy"]),
    help="Use this formulation instead of the one in the file.",
)
@click.option(
    "--tolerance", type=float, help="Accept this position error, divided by the length, instead of the file's."
)
@click.option("--verify", is_flag=True, help="Check the shape with an independent adaptive integrator.")
def solve(
    problem: Path,
    output: Path | None,
    figure: Path | None,
    formulation: str | None,
    tolerance: float | None,
    verify: bool,
) -> None:
    """Solve a problem file and print a report, or solve every case of a plan and print one line for each."""
    from .files.figures import FIGURES, save_figure
    from .files.plans import is_plan
    from .files.problem import load_problem, save_shape
    from .files.shapes import WRITERS
    from .files.text import check_output
    from .forward.plot import figure_equilibrium

    for path, suffixes in ((output, tuple(WRITERS)), (figure, FIGURES)):
        if path is not None:
            check_output(path, suffixes)
    options = {"formulation": formulation, "tolerance": tolerance}
    arguments = {name: value for name, value in options.items() if value is not None}
    if is_plan(problem):
        if output is not None or figure is not None:
            raise DefinitionError(
                f"{problem} is a plan of many shapes, but --output and --figure write one shape: read the plan with "
                "load_plan in Python and write its shapes there"
            )
        _solve_plan(problem, arguments, verify)
        return
    _refuse_other_kinds(problem, "solve")
    loaded = load_problem(problem).with_solver(arguments)
    result = loaded.solve()
    click.echo(loaded.title)
    click.echo(result.report())
    if verify:
        click.echo(f"  {'verified':<22}{result.verify():.1e} m from the independent integrator's shape")
    deviations = loaded.deviations(result)
    for name, (deviation, allowed) in deviations.items():
        click.echo(
            f"  {name + ' ':<22}{_verdict(deviation <= allowed)}: {deviation:.1e} off, {allowed:.1e} allowed (SI)"
        )
    if output is not None:
        save_shape(result, output)
        click.echo(f"shape written to {output}")
    if figure is not None:
        unloaded = loaded.solve(loaded=False) if loaded.loads else None
        save_figure(figure_equilibrium(result, unloaded), figure)
        click.echo(f"figure written to {figure}")
    if not all(deviation <= allowed for deviation, allowed in deviations.values()):
        sys.exit(_NOT_SOLVED)


def _refuse_other_kinds(file: Path, command: str) -> None:
    """Raise ``DefinitionError`` if another command is meant for this kind of file, and name it."""
    from .files.text import keys_of

    keys = keys_of(file)
    for key, (kind, right) in _KINDS.items():
        if key in keys and right != command:
            raise DefinitionError(f"{file}: unknown key {key!r}; this is {kind}: run `ctr-opt {right} {file}`")


def _verdict(right: bool) -> str:
    return "as expected" if right else "NOT AS EXPECTED"


def _solve_plan(path: Path, arguments: dict[str, Any], verify: bool) -> None:
    """Solve every case of a plan, print one line for each, and a summary."""
    from .files.plans import load_plan

    plan = load_plan(path)
    count = len(plan.problems)
    click.echo(f"{plan.title}: {count} cases")
    click.echo("  case   length [mm]   force [N]   tip position [mm]")
    solved, as_expected, largest = 0, 0, 0.0
    for case, problem in enumerate(plan.problems, start=1):
        result = problem.with_solver(arguments).solve(throw=False)
        if not result.converged:
            click.echo(f"  {case:>4}   {result.status.description}")
            continue
        solved += 1
        force = math.hypot(*result.internal_force(0.0))
        line = (
            f"  {case:>4}   {1e3 * result.length:>11.3f}   {force:>9.3f}   ("
            + ", ".join(f"{1e3 * x:10.6f}" for x in result.tip_position)
            + ")"
        )
        if verify:
            line += f"   verified to {result.verify():.1e} m"
        for deviation, allowed in problem.deviations(result).values():
            as_expected += deviation <= allowed
            largest = max(largest, deviation)
            line += f"   {_verdict(deviation <= allowed)}: {deviation:.1e} m off"
        click.echo(line)
    click.echo(f"{solved} of {count} solved")
    if plan.expected:
        allowed = plan.expected["position_tolerance"]
        click.echo(f"{as_expected} of {count} as expected: largest deviation {largest:.1e} m, {allowed:.1e} m allowed")
    if solved < count or (plan.expected and as_expected < count):
        sys.exit(_NOT_SOLVED)


@cli.command()
@click.argument("calibration", type=_FILE)
@click.option("--report", type=_FILE, help="Write a Markdown page with figures into this folder.")
@click.option(
    "--method",
    type=click.Choice(["simultaneous", "reduced"]),
    default="simultaneous",
    help="Optimization method (default: simultaneous).",
)
def calibrate(calibration: Path, report: Path | None, method: str) -> None:
    """Estimate a robot's parameters from a table of measured shapes, and print their uncertainty."""
    from .estimation.losses import LOSSES
    from .files.calibration import load_calibration
    from .files.calibration_page import hold_out_table, write_report

    _refuse_other_kinds(calibration, "calibrate")
    loaded = load_calibration(calibration)
    held_out = f", {len(loaded.held)} others held out" if loaded.held else ""
    click.echo(f"{loaded.title}: {len(loaded.experiments)} experiments{held_out}")
    fits, held = {}, {}
    for loss in loaded.losses:
        with _Progress(LOSSES[loss]) as progress:
            fits[loss] = loaded.problem(loss).solve(method=method, progress=progress)
        click.echo(fits[loss].report() + "\n")
        if loaded.held:
            held[loss] = fits[loss].tested(loaded.held)
            click.echo("\n".join(hold_out_table(fits[loss], held[loss])) + "\n")
    if report is not None:
        nominal = loaded.problem(loaded.losses[0]).nominal()
        click.echo(f"report written to {write_report(loaded, nominal, fits, held, report)}")


@cli.command()
@click.argument("problem", type=_FILE)
@click.option(
    "--figure", type=_FILE, help="Draw shape, measurements and confidence regions to this .png, .pdf or .svg file."
)
def estimate(problem: Path, figure: Path | None) -> None:
    """Estimate the loads on a robot from its measured shape, and print their uncertainty."""
    from .files.figures import FIGURES, save_figure
    from .files.force import load_force_problem
    from .files.text import check_output

    if figure is not None:
        check_output(figure, FIGURES)
    _refuse_other_kinds(problem, "estimate")
    loaded = load_force_problem(problem)
    result = loaded.solve()
    click.echo(f"{loaded.title}\n{result.report()}")
    verdicts = loaded.verdicts(result)
    for statement, right in verdicts.items():
        click.echo(f"  {_verdict(right):<22}{statement}")
    if figure is not None:
        save_figure(result.plot(), figure)
        click.echo(f"figure written to {figure}")
    if not all(verdicts.values()):
        sys.exit(_NOT_SOLVED)


class _Progress:
    """A line on the terminal that shows the progress of an estimation; silent without a terminal."""

    def __init__(self, title: str) -> None:
        self._title = title
        self._shown = sys.stderr.isatty()

    def __enter__(self) -> _Progress:
        return self

    def __call__(self, what: str, done: int, count: int) -> None:
        if self._shown:
            of = f" of {count}" if count else ""
            click.echo(f"\r\x1b[K{self._title}: {what} {done}{of}", nl=False, err=True)

    def __exit__(self, *_: Any) -> None:
        if self._shown:
            click.echo("\r\x1b[K", nl=False, err=True)


@cli.command("list")
@click.argument("folder", type=_FILE, default=Path("problems"))
def list_problems(folder: Path) -> None:
    """List the problems and plans below FOLDER (default: ./problems) with their sources and expected answers."""
    from .files.plans import find_plans, is_plan, load_plan
    from .files.problem import find_problems, load_problem

    paths = sorted([*find_problems(folder), *find_plans(folder)])
    if not paths:
        click.echo(f"no problem files below {folder}")
    for path in paths:
        try:
            problem: Any = load_plan(path) if is_plan(path) else load_problem(path)
        except DefinitionError as error:
            click.echo(f"{path}\n  not readable: {error}")
            continue
        click.echo(f"{path}\n  {problem.title}")
        for name, text in (("source", problem.source), ("expected", problem.expected.get("text", "not given"))):
            line = " ".join(f"{name}: {text}".split())
            click.echo(textwrap.fill(line, 110, initial_indent="  ", subsequent_indent="    "))


@cli.command()
@click.argument("file", type=_FILE)
@click.option("--strict", is_flag=True, help="Fail if tubes do not nest, instead of printing a warning.")
def check(file: Path, strict: bool) -> None:
    """Check a robot, problem or plan file and print its contents."""
    from .files.plans import check_plan, is_plan
    from .files.problem import check_file

    _refuse_other_kinds(file, "check")
    check_one = check_plan if is_plan(file) else check_file
    click.echo(check_one(file, on_overlap="error" if strict else "warn"))


def _show_warning(message: Warning | str, *_: Any, **__: Any) -> None:
    click.echo(f"ctr-opt: warning: {message}", err=True)


class _Signals:
    """Handlers of SIGINT and SIGTERM, which decide the exit status of any running command.

    The first signal raises ``SystemExit``, so that ``finally`` clauses clean up. That exception can get lost:
    destructors and the ``except:`` of CasADi's conversions swallow it, and Python may replace it (for example by the
    ``RuntimeError`` of ``__set_name__``). The command would then end with status 0 or 1, so the status is kept here. A
    second signal, or the end of a grace period, ends the process at once.
    """

    def __init__(self) -> None:
        self._status: int | None = None
        self._leaving = False
        for number in (signal.SIGINT, signal.SIGTERM):
            if signal.getsignal(number) is not signal.SIG_IGN:  # as under nohup
                signal.signal(number, self._stop)

    def _stop(self, number: int, _: Any) -> None:
        if self._status is not None:
            self.leave(self._status)
        self._status = _STOPPED + number
        if self._leaving:
            return
        if hasattr(signal, "setitimer"):
            signal.signal(signal.SIGALRM, self._stop)
            signal.setitimer(signal.ITIMER_REAL, _GRACE)
        sys.exit(self._status)

    def run(self, command: click.Command) -> int:
        """Run a command and return its exit status."""
        try:
            command()
        except SystemExit as end:
            return end.code if isinstance(end.code, int) else int(end.code is not None)
        except BaseException:
            if self._status is None:
                sys.excepthook(*sys.exc_info())
        return _NOT_SOLVED

    def leave(self, status: int) -> None:
        """Clean up and end the process; the last part of Python's normal exit would ignore signals."""
        self._leaving = True
        atexit._run_exitfuncs()
        for stream in (sys.stdout, sys.stderr):
            with suppress(OSError, ValueError, RuntimeError):  # closed; or interrupted while it was written to
                stream.flush()
        os._exit(status if self._status is None else self._status)


def main() -> None:
    """Run the command line and end the process.

    After SIGINT or SIGTERM the exit status is 128 plus the signal's number, and no partial file is left behind. To
    profile a command, call ``cli`` instead.
    """
    signals = _Signals()
    signals.leave(signals.run(cli))
