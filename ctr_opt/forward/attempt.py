"""Records of what a solve tried, and the text of ``Equilibrium.path`` made from them."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import groupby

import attrs

from ..checks import Array
from ..solvers.status import SolveStatus


@attrs.define(eq=False)
class Attempt:
    """One run of one solver: which way it took, how far it got, and how it ended.

    Attributes
    ----------
    way
        The name of the way, which says where it starts: ``"homotopy"`` starts from the straight robot.
    iterations
        Newton or IPOPT iterations, including those on finer meshes.
    reached, folds
        The fraction of its path at which it ended, and the number of folds passed.
    saddles
        Number of saddles of the energy that it met and left.
    outcome
        How it ended, in words: ``"failed"``, ``"neutral"``, ``"unstable: 1 direction"``; empty if it succeeded.
    """

    way: str
    iterations: int = 0
    reached: float = 1.0
    folds: int = 0
    saddles: int = 0
    outcome: str = ""

    def __str__(self) -> str:
        notes = [
            f"{self.folds} passed" if self.folds else "",
            f"ended at {self.reached:.3g}" if self.reached < 1.0 else "",
            f"{self.saddles} saddle{'s' if self.saddles > 1 else ''} left" if self.saddles else "",
            self.outcome,
        ]
        return self.way + "".join(f" ({note})" for note in notes if note)


def path_of(attempts: Iterable[Attempt]) -> str:
    """The attempts in their order as text; equal ones in succession are counted as finer meshes."""
    steps = [(text, len(list(same))) for text, same in groupby(map(str, attempts))]
    return " -> ".join(text if count == 1 else f"{text} ({count} meshes)" for text, count in steps)


class Failed(Exception):  # noqa: N818 - never leaves this package
    """A way ended without an equilibrium.

    It ended at the unknowns ``z``, at the fraction ``reached`` of its path. An ``exhausted`` way has used up its steps:
    more steps might have helped, another way hardly will.
    """

    def __init__(
        self, status: SolveStatus, message: str, z: Array, reached: float = 0.0, exhausted: bool = False
    ) -> None:
        super().__init__(message)
        self.status, self.message, self.z, self.reached, self.exhausted = status, message, z, reached, exhausted

    @classmethod
    def joined(cls, failures: list[Failed]) -> Failed:
        """One failure with all messages, and the status of the failure that got furthest."""
        furthest = max(failures, key=lambda failure: failure.reached)
        message = "; ".join(failure.message for failure in failures)
        return cls(furthest.status, message, furthest.z, furthest.reached)
