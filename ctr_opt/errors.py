"""The exceptions and warnings of the package."""

from __future__ import annotations

from typing import Any


class CtrOptError(Exception):
    """Base class of every error this package raises on purpose."""


class DefinitionError(CtrOptError, ValueError):
    """An input is wrong: the message names the field, the tube, the value and the allowed range.

    It is one line: line breaks and control characters of what was given are shown escaped.
    """

    def __init__(self, message: str) -> None:
        super().__init__(
            "".join(c if c.isprintable() else c.encode("unicode_escape").decode("ascii") for c in str(message))
        )


class SolveError(CtrOptError, RuntimeError):
    """A solve did not reach an equilibrium.

    Attributes
    ----------
    result
        The failed :class:`~ctr_opt.Equilibrium`: its status, diagnostics and last iterate.
    """

    def __init__(self, message: str, result: Any = None) -> None:
        super().__init__(message)
        self.result = result


class EstimationError(CtrOptError, RuntimeError):
    """An estimation found no answer, or the data do not determine what is asked for."""


class CompilationError(CtrOptError, RuntimeError):
    """C code was not compiled or not loaded: the message ends with the compiler's last lines."""


class MissingExtraError(CtrOptError, ImportError):
    """An optional dependency is not installed: the message names the extra that brings it."""


class EstimationWarning(UserWarning):
    """An estimation left something out of its answer: the message says what, and why."""


class NestingWarning(UserWarning):
    """An inner tube is wider than the bore of the tube around it."""
