"""The command line: ``ctr-opt solve``, ``ctr-opt list``, ``ctr-opt check``."""

from __future__ import annotations

import logging
import signal
import sys
import textwrap
import warnings
from pathlib import Path
from typing import Any

import click

from . import __version__
from .errors import CtrOptError, DefinitionError, SolveError

_FILE = click.Path(path_type=Path)
_BAD_INPUT, _NOT_SOLVED = 2, 1
_TERMINATED = 128 + signal.SIGTERM  # as shells tell it


class _Group(click.Group):
    """Tells the package's errors in a sentence: exit code 2 for wrong input, 1 where no equilibrium was found."""

    def invoke(self, ctx: click.Context) -> Any:
        try:
            return super().invoke(ctx)
        except CtrOptError as error:
            click.echo(f"ctr-opt: {error}", err=True)
            ctx.exit(_NOT_SOLVED if isinstance(error, SolveError) else _BAD_INPUT)
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
@click.option("--output", type=_FILE, help="Write the shape: .csv, .npz or .json.")
@click.option("--figure", type=_FILE, help="Draw the robot, unloaded and loaded: .png, .pdf or .svg.")
@click.option(
    "--formulation", type=click.Choice(["automatic", "equilibrium", "energy"]), help="In place of the file's."
)
@click.option("--tolerance", type=float, help="Accepted position error over the length, in place of the file's.")
@click.option("--verify", is_flag=True, help="Check the shape with an independent adaptive integrator.")
def solve(
    problem: Path,
    output: Path | None,
    figure: Path | None,
    formulation: str | None,
    tolerance: float | None,
    verify: bool,
) -> None:
    """Solve a problem file and print a report."""
    from .files import load_problem, save_shape
    from .plotting import FIGURES, figure_equilibrium, save_figure
    from .shape_files import WRITERS
    from .writing import check_output

    for path, suffixes in ((output, tuple(WRITERS)), (figure, FIGURES)):
        if path is not None:
            check_output(path, suffixes)
    told = {"formulation": formulation, "tolerance": tolerance}
    given = load_problem(problem).with_solver({name: value for name, value in told.items() if value is not None})
    result = given.solve()
    click.echo(given.title)
    click.echo(result.report())
    if verify:
        click.echo(f"  {'verified':<22}{result.verify():.1e} m from the independent integrator's shape")
    as_expected = True
    for name, (deviation, allowed) in given.deviations(result).items():
        as_expected &= deviation <= allowed
        verdict = "as expected" if deviation <= allowed else "NOT AS EXPECTED"
        click.echo(f"  {name:<22}{verdict}: {deviation:.1e} off, {allowed:.1e} allowed (SI)")
    if output is not None:
        save_shape(result, output)
        click.echo(f"shape written to {output}")
    if figure is not None:
        unloaded = given.solve(loaded=False) if given.loads else None
        save_figure(figure_equilibrium(result, unloaded), figure)
        click.echo(f"figure written to {figure}")
    if not as_expected:
        sys.exit(_NOT_SOLVED)


@cli.command("list")
@click.argument("folder", type=_FILE, default=Path("problems"))
def list_problems(folder: Path) -> None:
    """List the problems below FOLDER (default: ./problems), with their source and expected answer."""
    from .files import find_problems, load_problem

    paths = find_problems(folder)
    if not paths:
        click.echo(f"no problem files below {folder}")
    for path in paths:
        try:
            problem = load_problem(path)
        except DefinitionError as error:
            click.echo(f"{path}\n  not readable: {error}")
            continue
        click.echo(f"{path}\n  {problem.title}")
        for name, text in (("source", problem.source), ("expected", problem.expected.get("text", "not given"))):
            line = " ".join(f"{name}: {text}".split())
            click.echo(textwrap.fill(line, 110, initial_indent="  ", subsequent_indent="    "))


@cli.command()
@click.argument("file", type=_FILE)
@click.option("--strict", is_flag=True, help="Refuse tubes that do not nest, instead of warning of them.")
def check(file: Path, strict: bool) -> None:
    """Check a robot file (or a problem file) and print what it says."""
    from .files import check_file

    click.echo(check_file(file, on_overlap="error" if strict else "warn"))


def _show_warning(message: Warning | str, *_: Any, **__: Any) -> None:
    click.echo(f"ctr-opt: warning: {message}", err=True)


def main() -> None:
    """Run the command line; told to terminate, it clears away what it was writing."""
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(_TERMINATED))
    sys.exit(cli())
