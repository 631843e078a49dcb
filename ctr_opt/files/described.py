"""Reading of tables by their entries: every key and value is checked before anything is built."""

from __future__ import annotations

import difflib
import reprlib
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from ..checks import Checked, Entry, Table
from ..robot.robot import Robot
from .columns import read_columns, read_csv
from .text import at
from .units import to_si

_WORDS: dict[str, tuple[type, str]] = {
    "text": (str, "a text"),
    "flag": (bool, "true or false"),
    "whole": (int, "a whole number"),
}


def read(spec: Any, value: Any, place: str = "") -> Any:
    """Check a value of a file and convert it to SI; ``ValueError`` names the place and the problem in one sentence.

    ``spec`` is an entry, a dictionary of entries for a table (names of optional ones end in ``?``), or a list with one
    such ``spec`` for a list.
    """
    if isinstance(spec, Entry):
        return _read_entry(spec, value, () if spec.scalar_too and not isinstance(value, list) else spec.shape, place)
    if isinstance(spec, list):
        if not isinstance(value, list) or not value:
            raise ValueError(f"{place} = {reprlib.repr(value)} must be tables [[{place.lstrip('.')}]], at least one")
        return [read(spec[0], table, f"{place}[{k}]{_named(table)}") for k, table in enumerate(value)]
    if not isinstance(value, dict):
        raise ValueError(f"{place} = {reprlib.repr(value)} must be a table of keys and values")
    known = [name.removesuffix("?") for name in spec]
    for key in value:
        if key not in known:
            hint = _nearest(key, known) or f"allowed are {', '.join(known)}"
            raise ValueError(f"{place}: unknown key {key!r}; {hint}")
    for key in spec:
        if key not in value and not key.endswith("?"):
            raise ValueError(f"{place}.{key} is missing")
    entries = dict(zip(known, spec.values(), strict=True))
    return {key: read(entries[key], inner, f"{place}.{key}") for key, inner in value.items()}


def _read_entry(entry: Entry, value: Any, shape: tuple[int | None, ...], place: str) -> Any:
    said = f"{place} = {reprlib.repr(value)}"
    if shape:
        if not isinstance(value, list):
            raise ValueError(f"{said} must be {entry.says}{'' if shape[0] is None else f' of {shape[0]}'}")
        if shape[0] not in (None, len(value)):
            raise ValueError(f"{place} has {len(value)} entries, but must have {shape[0]}")
        return [_read_entry(entry, item, shape[1:], f"{place}[{k}]") for k, item in enumerate(value)]
    kind, name = _WORDS.get(entry.unit, (object, ""))
    if not isinstance(value, kind) or (kind is int and isinstance(value, bool)):
        raise ValueError(f"{said} must be {name}")
    try:
        return to_si(value, entry.unit) if entry.numeric else value
    except ValueError as error:
        raise ValueError(f"{said} {error}") from None


def make(file: Path, place: str, data: Any, kinds: Iterable[type[Checked]], robot: Robot | None = None) -> Any:
    """Build the object that a table describes; its ``kind`` selects one of ``kinds``, ``robot`` resolves tube names."""
    tables = {table.kind: table for kind in kinds for table in kind.tables()}
    table, values = at(file, place, lambda: _values(tables, data))
    if "tube" in values and robot is not None:
        values["tube"] = at(file, place, lambda: tube_index(robot, values["tube"]))
    if table.needed:
        columns = read_columns(file.parent / values.pop("file"), table.needed, table.optional)
        return at(file, place, lambda: table.make(columns, **values))
    if "file" in values:
        count, columns_of = table.csv
        rows = read_csv(file.parent / values.pop("file"), count)
        for name, columns in columns_of.items():
            values[name] = tuple(rows[:, c] for c in columns) if isinstance(columns, tuple) else rows[:, columns]
    return at(file, place, lambda: table.make(**values))


def _values(tables: dict[str, Table], data: Any) -> tuple[Table, dict[str, Any]]:
    """Select the table of a kind, and read the values of its entries."""
    if not isinstance(data, dict):
        raise ValueError(f" = {reprlib.repr(data)} must be a table with a kind")
    kind = data.get("kind")
    if not isinstance(kind, str) or kind not in tables:
        near = _nearest(str(kind), list(tables))
        raise ValueError(f".kind = {kind!r} must be one of {', '.join(tables)}{f' ({near})' if near else ''}")
    table, values = tables[kind], {key: value for key, value in data.items() if key != "kind"}
    entries = dict(table.entries)
    replaced = table.csv[1] if table.csv is not None and "file" in values else {}
    if beside := [name for name in replaced if name in values]:
        raise ValueError(f".file and {' and '.join(beside)} are both given: give one of them")
    if table.needed or table.csv is not None:
        entries["file" if table.needed else "file?"] = Entry("text")
    return table, read({key: entry for key, entry in entries.items() if key.removesuffix("?") not in replaced}, values)


def _named(table: Any) -> str:
    name = table.get("name") if isinstance(table, dict) else None
    return f" ({name!r})" if isinstance(name, str) else ""


def _nearest(key: str, known: list[str]) -> str:
    near = difflib.get_close_matches(key, known, n=1, cutoff=0.5)
    return f"did you mean {near[0]!r}?" if near else ""


def tube_index(robot: Robot, tube: Any) -> int:
    """Resolve a tube's name or index to its index; ``ValueError`` if there is no such tube."""
    names = [candidate.name for candidate in robot.tubes]
    if isinstance(tube, str) and tube in names:
        return names.index(tube)
    if isinstance(tube, int) and not isinstance(tube, bool) and 0 <= tube < len(names):
        return tube
    raise ValueError(f".tube = {tube!r} must be a tube's name ({', '.join(names)}) or index (0 to {len(names) - 1})")
