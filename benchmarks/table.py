"""One table of all measurements: times side by side, ratios, errors."""

import attrs
import numpy as np

from .methods import COLD, DERIVATIVES, INTEGRATION, LINEARIZATION, MANY, PYTHON, WARM

AGAINST = {
    WARM: WARM,
    COLD: COLD,
    DERIVATIVES: WARM,
    MANY: WARM,
    PYTHON: WARM,
    INTEGRATION: INTEGRATION,
    LINEARIZATION: LINEARIZATION,
}
"""What of the reference each kind of work is compared with."""


@attrs.frozen
class Measured:
    """Seconds, and the largest error of the tip, mm; NaN where there is no tip."""

    seconds: float
    error: float


@attrs.frozen
class Row:
    """A kind of work on a robot, and the measurements of those modes that did it."""

    robot: str
    load: str
    method: str
    measured: dict[str, Measured]


def table(rows, references, modes):
    """Lines of Markdown; ``references`` and ``modes`` are names, ratios are against the first reference."""
    head = ["robot", "load", "work", *references, *modes]
    head += [f"{references[0]} / {mode}" for mode in modes] + [f"{mode}, integrations" for mode in modes]
    seconds = {(row.robot, row.load, row.method, mode): m.seconds for row in rows for mode, m in row.measured.items()}
    lines = [head, ["---"] * 3 + ["---:"] * (len(head) - 3)]
    for row in rows:
        key = row.robot, row.load
        cells = [cell(row.measured.get(mode)) for mode in (*references, *modes)]
        unit = seconds.get((*key, AGAINST.get(row.method), references[0]), np.nan)
        values = [seconds.get((*key, row.method, mode), np.nan) for mode in modes]
        cells += [number(unit / value, "{:,.0f}" if unit / value >= 10 else "{:.1f}") for value in values]
        steps = [seconds.get((*key, INTEGRATION, mode), np.nan) for mode in modes]
        cells += [number(value / step, "{:.1f}") for value, step in zip(values, steps, strict=True)]
        lines.append([*key, row.method, *cells])
    widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
    return ["| " + " | ".join(c.ljust(w) for c, w in zip(line, widths, strict=True)) + " |" for line in lines]


def cell(measured):
    """Time and, in brackets, error in mm."""
    if measured is None:
        return ""
    error = "" if np.isnan(measured.error) else f" ({measured.error:.0e})"
    return time(measured.seconds) + error


def time(seconds):
    """With three digits and a unit."""
    unit, size = next(
        unit_and_size for unit_and_size in (("s", 1.0), ("ms", 1e-3), ("us", 0.0)) if seconds >= unit_and_size[1]
    )
    return f"{seconds / (size or 1e-6):.3g} {unit}"


def number(value, style):
    return "" if np.isnan(value) else style.format(value)
