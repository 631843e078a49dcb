"""Seeded random robots in whole centimetres, where ends, steps of curvature, loads and measurements meet.

What is expected where they meet is stated in whole picometres, apart from what the package does with floats: two points
are one if they are the same number of picometres. As floats they differ by rounding, and two thirds of the robots are
moved on purpose: by 1e-17 m, which is rounding, or by 1e-12 m, ten times what still counts as one point.
"""

import attrs
import numpy as np

import ctr_opt as ctr

PM = 10**10  # picometres in a centimetre
_DIAMETERS = [(1.0e-3, 0.6e-3), (1.6e-3, 1.2e-3), (2.2e-3, 1.8e-3)]
_FLUSH, _CURVED_AT_ENTRY, _AT_AN_END = 0.4, 0.3, 0.4  # probabilities


@attrs.frozen(eq=False)
class Case:
    """A robot with loads, and where its tubes end, pm; ``moved``: by how much translations differ from cm, m."""

    robot: ctr.Robot
    actuation: ctr.Actuation
    loads: tuple
    ends: tuple
    moved: float

    @property
    def tip(self):
        """Where the robot ends, pm."""
        return max(self.ends)

    def innermost(self, place):
        """The innermost tube at a place, pm: one that ends there is still there."""
        return min(i for i, end in enumerate(self.ends) if end >= place)

    @property
    def places(self):
        """Every whole centimetre of the robot, and where tubes end, pm."""
        return sorted({*range(0, self.tip + 1, PM), *self.ends})


def metres(place):
    """Of picometres, as a decimal number is read."""
    return float(f"{place // PM}e-2") + 1e-12 * (place % PM) if place % PM < PM // 2 else metres(place + 1) - 1e-12


def case(index, *, riding=False, apart=None):
    """The robot of an index; ``riding``: all loads are at tubes' ends and move along.

    ``apart``: m, the same robot with its points so far apart instead, whole picometres, in the same order.
    """
    rng = np.random.default_rng([2024, index])
    count, moved = (2, 3, 2, 3, 1)[index % 5], (0.0, 1e-17, 1e-12)[index % 3] if apart is None else apart
    tubes, translations, ends = [], [], []
    for i in range(count):
        tube, length, straight = _tube(rng, i)
        end = int(rng.integers(2, min(length, 9) + 1))
        if rng.random() < _CURVED_AT_ENTRY:
            end = length - straight
        if ends and rng.random() < _FLUSH and round(ends[0] / PM) <= length:
            end = round(ends[0] / PM)
        base = end - length
        shift = int(rng.integers(-1, 1 if base == 0 else 2))
        tubes.append(tube)
        translations.append(0.01 * base + shift * moved)
        ends.append(end * PM + shift * round(moved / 1e-12))
    actuation = ctr.Actuation(rng.uniform(-2.0, 2.0, count), translations)
    loads = tuple(_load(rng, ends, riding) for _ in range(rng.integers(1, 4)))
    return Case(ctr.Robot(tubes), actuation, loads, tuple(ends), moved)


def _tube(rng, i):
    """A tube of a straight and one or two curved parts, its length and that of its straight part, cm."""
    straight, curved, more = int(rng.integers(1, 7)), int(rng.integers(1, 6)), int(rng.integers(0, 4))
    pieces = [ctr.Straight(0.01 * straight), ctr.Arc(0.01 * curved, rng.uniform(2.0, 9.0))]
    pieces += [ctr.Arc(0.01 * more, rng.uniform(-6.0, 6.0))] if more else []
    tube = ctr.Tube(f"tube {i}", *_DIAMETERS[i], pieces, youngs_modulus=60e9, poisson_ratio=0.3)
    return tube, straight + curved + more, straight


def _load(rng, ends, riding):
    tube = int(rng.integers(len(ends)))
    force, moment = 0.15 * rng.normal(size=3), 2e-3 * rng.normal(size=3)
    whole = ends[tube] // PM
    if riding or rng.random() < _AT_AN_END or whole < 2:
        return ctr.PointWrench(force, moment, tube=tube)
    place = int(rng.integers(0, whole))
    if rng.random() < 0.5:
        return ctr.PointWrench(force, moment, 0.01 * (place + 1), tube)
    return ctr.DistributedLoad(force / 0.03, moment / 0.03, 0.01 * place, 0.01 * whole, tube=tube)
