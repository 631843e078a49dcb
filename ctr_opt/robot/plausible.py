"""Numbers of a robot that suggest a slip of units or of order; judged from moduli and diameters alone."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise

import numpy as np

from .tube import Tube

_MODULI = 1e6, 2e12  # Pa: from soft rubber to above diamond
_DIAMETERS = 2e-5, 0.05  # m: thinner than a hair, thicker than a broom
_SLENDEREST = 2e4  # length over outer diameter
_MOST_POISSON = 1.0  # fitted moduli give ratios above 0.5, but hardly above 1


def doubts(tubes: Sequence[Tube]) -> Iterator[str]:
    """A sentence for each number that is hardly meant; tubes given by their stiffnesses are not judged."""
    for k, tube in enumerate(tubes):
        for sentence in _of_tube(tube):
            yield f"tubes[{k}] ({tube.name!r}): {sentence}"
    if len(tubes) > 1 and all(outer.outer_diameter <= inner.inner_diameter for inner, outer in pairwise(tubes)):
        yield "tubes: each fits into the one before; list them from the innermost to the outermost"


def _of_tube(tube: Tube) -> Iterator[str]:
    known = tube.given_stiffnesses
    for name, stiffness in (("youngs_modulus", "bending_stiffness"), ("shear_modulus", "torsional_stiffness")):
        modulus = getattr(tube, name)
        if modulus is None or stiffness in known:
            continue
        if modulus < _MODULI[0]:
            yield f"{name} = {modulus:g} Pa is below any metal's or polymer's: is it in GPa or MPa? 58 GPa is 58e9"
        elif modulus > _MODULI[1]:
            yield f"{name} = {modulus:g} Pa is above diamond's: was it multiplied twice? 58 GPa is 58e9"
    if len(known) == 2:
        return
    if not known and tube.youngs_modulus is not None and tube.shear_modulus is not None:
        ratio = tube.youngs_modulus / (2.0 * tube.shear_modulus) - 1.0
        if not -1.0 < ratio <= _MOST_POISSON:
            yield (
                f"youngs_modulus = {tube.youngs_modulus:g} Pa and shear_modulus = {tube.shear_modulus:g} Pa mean a "
                f"Poisson ratio of {ratio:.3g}, which is -1 to 0.5: check both"
            )
    if tube.outer_diameter > _DIAMETERS[1]:
        yield f"outer_diameter = {tube.outer_diameter:g} m is thick: is it in mm? 1.75 mm is 1.75e-3"
    elif tube.outer_diameter < _DIAMETERS[0]:
        yield f"outer_diameter = {tube.outer_diameter:g} m is thinner than a hair: was it divided twice?"
    elif tube.length > _SLENDEREST * tube.outer_diameter:
        yield f"its length of {tube.length:g} m is {tube.length / tube.outer_diameter:.0f} diameters: is it in mm?"
    elif (curvature := _largest_curvature(tube)) * tube.outer_diameter > 2.0:
        yield f"a precurvature of {curvature:g} 1/m bends it more tightly than its own radius: is it in 1/km?"


def _largest_curvature(tube: Tube) -> float:
    """The largest curvature where a piece begins, 1/m."""
    return float(np.linalg.norm(tube.shape.coefficients[0, :, :2], axis=1).max())
