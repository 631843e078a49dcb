"""CSV tables of numbers. The first line of most names the columns, with units in brackets: ``tip_x [mm]``."""

from __future__ import annotations

import csv
import re
import reprlib
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np

from ..checks import Array
from ..errors import DefinitionError
from .text import read_text
from .units import to_si

_NUMBER = "a finite number, or empty"
_COLUMN = re.compile(r"\s*([A-Za-z]\w*?)\s*(?:\[([^\]]*)\])?\s*")


def read_csv(file: Path, columns: int) -> Array:
    """Read a table ``(rows, columns)`` of numbers in SI, comma-separated, with comments behind ``#``."""
    table = []
    for line, row in said_lines(file):
        try:
            entries = [float(entry) for entry in row.split(",")]
        except ValueError:
            entries = []
        if len(entries) != columns or not np.all(np.isfinite(entries)):
            raise DefinitionError(
                f"{file}: line {line}, {reprlib.repr(row)}, must be {columns} finite numbers separated by commas, "
                "or a comment behind #"
            )
        table.append(entries)
    if not table:
        raise DefinitionError(f"{file} contains no numbers, but must contain lines of {columns}")
    return np.array(table)


def read_rows(file: Path, names: str = "") -> tuple[list[str], list[tuple[int, list[str]]]]:
    """Read the header, and the rows below it with their line numbers; messages use the columns' ``names``."""
    rows = [(line, next(csv.reader([row]))) for line, row in said_lines(file)]
    if len(rows) < 2:
        raise DefinitionError(f"{file} must contain a line of column names{names} and lines of numbers")
    header = rows[0][1]
    for line, row in rows[1:]:
        if len(row) != len(header):
            raise DefinitionError(
                f"{file}: line {line} has {len(row)} entries, but must have {len(header)}, one per column"
            )
    return header, rows[1:]


def columns_of(
    file: Path, header: list[str], unit_of: Callable[[str], str | None], allowed: str
) -> dict[str, tuple[int, float]]:
    """Find the index of each column, and the factor that converts its numbers to SI.

    ``unit_of`` gives the SI unit of a column by name, None for an unknown name. Messages list the columns ``allowed``.
    """
    places: dict[str, tuple[int, float]] = {}
    for k, text in enumerate(header):
        match = _COLUMN.fullmatch(text)
        name = match[1] if match else text.strip()
        unit = unit_of(name) if match else None
        if unit is None or name in places:
            column = text.strip()
            problem = f"column {column!r} is given twice" if name in places else f"unknown column {column!r}"
            raise DefinitionError(f"{file}: {problem}; the columns are {allowed}")
        try:
            factor = to_si(f"1 {match[2]}", unit) if match and match[2] else 1.0
        except ValueError as error:
            raise DefinitionError(f"{file}: column {text.strip()!r} {error}") from None
        places[name] = k, factor
    return places


def value_of(file: Path, line: int, name: str, text: str, factor: float, wanted: str = _NUMBER) -> float:
    """Convert a field to a number in SI, NaN if it is empty; messages say that it must be ``wanted``."""
    text = text.strip()
    if not text:
        return float("nan")
    try:
        value = float(text)
    except ValueError:
        value = float("inf")
    if not np.isfinite(value):
        raise DefinitionError(f"{file}: line {line}, column {name!r}: {text!r} must be {wanted}")
    return value * factor


def read_columns(file: Path, needed: Mapping[str, str], others: Mapping[str, str] | None = None) -> dict[str, Array]:
    """Read columns ``(rows,)`` by name, in SI.

    ``needed`` and ``others`` give SI units of required and optional columns. No field may be empty. The key ``"line"``
    holds line numbers in the file.
    """
    units = {**needed, **(others or {})}
    header, rows = read_rows(file, f" ({', '.join(units)})")
    columns = columns_of(file, header, units.get, ", ".join(units))
    for name in needed:
        if name not in columns:
            raise DefinitionError(f"{file}: column {name!r} is missing")
    numbers = {name: np.empty(len(rows)) for name in columns}
    for k, (line, row) in enumerate(rows):
        for name, (place, factor) in columns.items():
            numbers[name][k] = value_of(file, line, name, row[place], factor, "a finite number")
            if np.isnan(numbers[name][k]):
                raise DefinitionError(f"{file}: line {line}, column {name!r} is empty")
    return numbers | {"line": np.array([line for line, _ in rows], dtype=np.float64)}


def said_lines(file: Path) -> list[tuple[int, str]]:
    """Read the lines that are neither empty nor comments, with their line numbers."""
    lines = read_text(file, "CSV").splitlines()
    rows = [(k, line.split("#")[0].strip()) for k, line in enumerate(lines, start=1)]
    return [(k, row) for k, row in rows if row]
