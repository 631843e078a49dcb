"""The robot: its tubes from inner to outer, and the pose of its entry point."""

from __future__ import annotations

import warnings
from itertools import pairwise
from typing import Any

import attrs
import numpy as np

from ..checks import ARRAY_EQ, Array, choice, rigid
from ..errors import DefinitionError, NestingWarning, PlausibilityWarning
from .plausible import doubts
from .tube import Tube

ON_OVERLAP = ("warn", "error", "ignore")


def _tubes(value: Any) -> tuple[Tube, ...]:
    tubes = (value,) if isinstance(value, Tube) else value
    if not isinstance(tubes, (list, tuple)) or not tubes:
        raise DefinitionError(f"tubes = {value!r} must be a non-empty list of Tube, the innermost first")
    for k, tube in enumerate(tubes):
        if not isinstance(tube, Tube):
            raise DefinitionError(f"tubes[{k}] = {tube!r} must be a Tube")
    names = [tube.name for tube in tubes]
    for k, name in enumerate(names):
        if name in names[:k]:
            raise DefinitionError(
                f"tubes[{k}]: name = {name!r} is also the name of tubes[{names.index(name)}]; names must differ"
            )
    return tuple(tubes)


def _pose(value: Any) -> Array:
    return rigid(np.eye(4) if value is None else value, "base_pose")


@attrs.frozen
class Robot:
    """A concentric-tube robot: its tubes and the pose of its entry point.

    Parameters
    ----------
    tubes
        The tubes, **tube 0 the innermost**. Their names must differ.
    base_pose
        Pose of the entry point in the world, 4 x 4 (m), z along the straight entry; default identity.
        Rotations are accepted up to rounding of 1e-6 and made exact.
    on_overlap
        What to do if a tube is wider than the bore of the next one: ``"warn"`` (published robots
        overlap), ``"error"`` or ``"ignore"``. With ``"ignore"`` there is no ``PlausibilityWarning``, either.

    Raises
    ------
    DefinitionError
        There is no tube, two names are the same, or ``base_pose`` is not rigid.

    Warns
    -----
    NestingWarning
        A tube is wider than the bore of the next one.
    PlausibilityWarning
        A modulus, a diameter or the order of the tubes is hardly meant, for example a diameter in mm. Tubes that are
        given by their stiffnesses are not judged.

    Examples
    --------
    >>> import ctr_opt as ctr
    >>> tube = ctr.Tube("wire", 1e-3, 0.0, ctr.Arc(0.1, 5.0), youngs_modulus=60e9, poisson_ratio=0.3)
    >>> len(ctr.Robot([tube]).tubes)
    1
    """

    tubes: tuple[Tube, ...] = attrs.field(converter=_tubes)
    base_pose: Array = attrs.field(default=None, converter=_pose, eq=ARRAY_EQ, hash=False)
    on_overlap: str = attrs.field(default="warn", eq=False, kw_only=True)

    def __attrs_post_init__(self) -> None:
        choice(self.on_overlap, "on_overlap", ON_OVERLAP)
        for sentence in doubts(self.tubes) if self.on_overlap != "ignore" else ():
            warnings.warn(sentence, PlausibilityWarning, stacklevel=3)
        report_overlaps(self, self.on_overlap, "")

    @property
    def base_quaternion(self) -> Array:
        """Orientation of the entry point, ``(w, x, y, z)``, with ``w >= 0``.

        It is the eigenvector of the largest eigenvalue of Bar-Itzhack's matrix (J. Guidance 23, 2000, 1085-1087). SciPy
        would do the same, but its import takes longer than a process's first solve.
        """
        r = self.base_pose[:3, :3]
        matrix = np.empty((4, 4))
        matrix[0, 0], matrix[1:, 1:] = np.trace(r), r + r.T - np.trace(r) * np.eye(3)
        matrix[0, 1:] = matrix[1:, 0] = r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]
        quaternion = np.linalg.eigh(matrix)[1][:, -1].copy()  # compiled code wants the numbers side by side
        return np.asarray(quaternion if quaternion[0] >= 0.0 else -quaternion)

    @property
    def overlaps(self) -> list[str]:
        """A sentence for each tube that is wider than the bore of the next one."""
        return [
            f"tubes[{k}] ({inner.name!r}): outer_diameter = {inner.outer_diameter:g} m does not fit into "
            f"tubes[{k + 1}] ({outer.name!r}): inner_diameter = {outer.inner_diameter:g} m"
            for k, (inner, outer) in enumerate(pairwise(self.tubes))
            if inner.outer_diameter > outer.inner_diameter
        ]


def report_overlaps(robot: Robot, on_overlap: str, where: str) -> None:
    """Warn of tubes that do not nest, or refuse them; ``where`` precedes the sentence."""
    for sentence in robot.overlaps if on_overlap != "ignore" else ():
        if on_overlap == "error":
            raise DefinitionError(where + sentence)
        warnings.warn(where + sentence, NestingWarning, stacklevel=4)
