"""The exceptions and warnings of the package."""

from __future__ import annotations

from typing import Any


class CtrOptError(Exception):
    """Base class of all errors that this package raises on purpose."""


class DefinitionError(CtrOptError, ValueError):
    """An input is wrong; the message names the field, the tube, the value and the allowed range.

    The message is one line: line breaks and control characters of the input are shown escaped.
    """

    def __init__(self, message: str) -> None:
        super().__init__(
            "".join(c if c.isprintable() else c.encode("unicode_escape").decode("ascii") for c in str(message))
        )


class SolveError(CtrOptError, RuntimeError):
    """A solve found no equilibrium; the message says what was tried and what to do.

    Attributes
    ----------
    result
        The failed :class:`~ctr_opt.Equilibrium`, with its status, diagnostics and last iterate.
    """

    def __init__(self, message: str, result: Any = None) -> None:
        super().__init__(message)
        self.result = result


class EstimationError(CtrOptError, RuntimeError):
    """An estimation found no answer, or the data do not determine the unknowns."""


class CompilationError(CtrOptError, RuntimeError):
    """C code could not be compiled or loaded; the message ends with the compiler's last lines."""


class MissingExtraError(CtrOptError, ImportError):
    """An optional dependency is not installed; the message names the extra to install."""


class EstimationWarning(UserWarning):
    """An estimation left something out of its answer; the message says what and why."""


class NestingWarning(UserWarning):
    """A tube is wider than the bore of the tube around it."""


class PlausibilityWarning(UserWarning):
    """A number is hardly meant: a unit or the order of tubes may have slipped. The message says which."""
