"""What a solve tried: a record of each attempt, and the text of ``Equilibrium.path`` made of them."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import groupby

import attrs

from ..checks import Array
from ..solvers.status import SolveStatus


@attrs.define(eq=False)
class Attempt:
    """One solver at work: by which way, how far along it, and how it ended.

    Attributes
    ----------
    way
        Its name, which also says where it starts: ``"homotopy"`` from the straight robot, ``"newton from initial"``.
    iterations
        Newton or IPOPT iterations, those on finer meshes included.
    reached, folds
        The part of a path at which it ended, and how many folds it passed.
    saddles
        How many saddles of the energy were left.
    outcome
        What the numbers do not say: ``"failed"``, ``"neutral"``, ``"unstable: 1 direction"``; empty if all went well.
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
    """Attempts in their order; those alike in succession are of the same way on finer and finer meshes."""
    steps = [(text, len(list(same))) for text, same in groupby(map(str, attempts))]
    return " -> ".join(text if count == 1 else f"{text} ({count} meshes)" for text, count in steps)


class Failed(Exception):  # noqa: N818 - never leaves this package
    """A way ended without an equilibrium.

    ``z`` are the unknowns where it ended, at the part ``reached`` of its path. An ``exhausted`` way has used up its
    steps: more of the same kind might have helped, another way hardly will.
    """

    def __init__(
        self, status: SolveStatus, message: str, z: Array, reached: float = 0.0, exhausted: bool = False
    ) -> None:
        super().__init__(message)
        self.status, self.message, self.z, self.reached, self.exhausted = status, message, z, reached, exhausted

    @classmethod
    def joined(cls, failures: list[Failed]) -> Failed:
        """All failures in one, with the status of the one that came furthest."""
        furthest = max(failures, key=lambda failure: failure.reached)
        message = "; ".join(failure.message for failure in failures)
        return cls(furthest.status, message, furthest.z, furthest.reached)
