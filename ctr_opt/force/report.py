"""Text reports of force estimates."""

from __future__ import annotations

import numpy as np

from ..forward.report import row
from ..robot.names import unit_of
from .solution import ForceSolution
from .systematic import Systematic

_MOST = 30.0  # characteristic sizes: numbers with a larger standard deviation are not reported
_ROWS = 7  # places along a distributed force in a report


def force_report(estimate: ForceSolution) -> str:
    """The full report: loads with errors, undetermined directions, other solutions, and model errors."""
    numbers = estimate.case.experiment.numbers
    lines = [f"Loads from {numbers} numbers measured", row("residuals", _consistency(estimate))]
    stable = {
        True: "stable",
        False: "UNSTABLE: a robot cannot rest in this shape",
        None: "stability not defined under these loads",
    }
    shape = estimate.shape
    tip = ", ".join(f"{1e3 * x:.3f}" for x in shape.tip_position)
    lines.append(row("shape", f"{stable[estimate.is_stable]}, tip at ({tip}) mm"))
    lines += _numbers(estimate)
    for number in estimate.distributed:
        lines += _densities(estimate, number)
    lines += _magnitudes(estimate)
    lines += _places(estimate)
    if estimate.undetermined:
        lines += ["", "  Not determined:", *(f"    {direction}" for direction in estimate.undetermined)]
    if estimate.alternatives:
        lines += ["", "  Other solutions:"]
        for alternative in estimate.alternatives:
            values = ", ".join(f"{label} = {value:.4g}" for label, value in alternative.values.items())
            lines.append(f"    {values} (loss {alternative.state.cost - estimate.state.cost:+.2f})")
    lines += ["", "  Model errors that look like forces until they are detected (with 95 %):"]
    lines += [f"    {error}" for error in _mistaken(estimate)]
    return "\n".join(lines)


def _numbers(estimate: ForceSolution) -> list[str]:
    """Table lines for all numbers except those of distributed forces."""
    spline = {k for part in estimate.case.numbered.where("density") for k in range(part.start, part.stop)}
    lines = []
    scales = estimate.case.search.unknowns.scale
    numbers = zip(estimate.labels, estimate.estimates, estimate.deviations, scales, strict=True)
    for k, (label, value, error, scale) in enumerate(numbers):
        factor, unit = unit_of(label)
        text = f"{factor * value:>12.4g}{factor * error:>11.2g}"
        if error > _MOST * scale:
            text = f"{'not determined':>23}"
        if k not in spline:
            lines.append(f"  {label:<22}{text}   {unit}")
    return ["", f"  {'':<22}{'estimate':>12}{'+-':>11}   unit", *lines] if lines else []


def _densities(estimate: ForceSolution, number: int) -> list[str]:
    """Table lines of a distributed force at some places."""
    named = f"unknown[{number}], " if len(estimate.case.numbered.unknown) > 1 else ""
    lines = ["", f"  {named + 'force per length [N/m]':<24}" + "".join(f"{axis:>11}{'+-':>9}" for axis in "xyz")]
    shown = estimate.stretch(number, _ROWS)
    most = _MOST * estimate.characteristic_force / estimate.case.search.length
    for s, values, errors in zip(shown, *estimate.density(shown, number), strict=True):
        both = zip(values, errors, strict=True)
        columns = [f"{x:>11.3g}{e:>9.2g}" if e < most else f"{'not determined':>20}" for x, e in both]
        lines.append(f"    at {1e3 * s:6.1f} mm{'':<11}" + "".join(columns))
    return lines


def _consistency(estimate: ForceSolution) -> str:
    if estimate.consistent is None:
        return "no degrees of freedom are left to check consistency"
    verdict = "consistent with model and noise" if estimate.consistent else "NOT CONSISTENT with model and noise"
    return (
        f"{verdict}: chi-square {estimate.chi_squared:.1f} at {estimate.degrees_of_freedom} degrees of freedom "
        f"(p = {estimate.p_value:.2g})"
    )


def _mistaken(estimate: ForceSolution) -> list[Systematic]:
    """For each kind of systematic error, the one that adds most force before it is detected."""
    worst: dict[str, Systematic] = {}
    for error in estimate.systematic:
        if error.kind not in worst or error.mimicked > worst[error.kind].mimicked:
            worst[error.kind] = error
    return list(worst.values())


def _magnitudes(estimate: ForceSolution) -> list[str]:
    lines = []
    forces, covariances = np.atleast_2d(estimate.force), np.reshape(estimate.force_covariance, (-1, 3, 3))
    all_axes = estimate.axes if len(forces) > 1 else [estimate.axes]
    for k, (force, covariance, axes) in enumerate(zip(forces, covariances, all_axes, strict=True)):
        if axes[0].standard_deviation > _MOST * estimate.characteristic_force:
            continue
        size = float(np.linalg.norm(force))
        unit = force / size if size else np.zeros(3)
        name = "total" if k in estimate.distributed else "magnitude"
        name += f" of {k}" if len(forces) > 1 else ""
        lines += ["", row(name, f"{size:.4g} +- {np.sqrt(unit @ covariance @ unit):.2g} N")]
        for axis in (axis for axis in axes if axis.standard_deviation):
            direction = ", ".join(f"{x:+.2f}" for x in axis.direction)
            lines.append(row("", f"sd {axis.standard_deviation:.2g} N along ({direction})"))
    return lines


def _places(estimate: ForceSolution) -> list[str]:
    """Report lines of confidence sets of places, and of the evidence for numbers of contacts."""
    sets = estimate.arc_length_set
    if sets is None:
        return []
    all_sets = sets if len(estimate.case.contacts) > 1 else [sets]
    lines = [""]
    for k, intervals in enumerate(all_sets):
        text = " or ".join(f"{1e3 * a:.1f} to {1e3 * b:.1f} mm" for a, b in intervals)
        lines.append(row("place, 95 %" if len(all_sets) == 1 else f"place {k}, 95 %", text))
    for evidence in estimate.evidence:
        text = f"loss {evidence.loss:.2f}, criterion (BIC) {evidence.criterion:.1f}"
        lines.append(row(f"{evidence.contacts} contacts", text))
    return lines
