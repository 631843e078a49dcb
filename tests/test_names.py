"""Names inside the package: a reader who searches for a class finds one."""

import ast
from collections import defaultdict
from pathlib import Path

import ctr_opt


def test_no_class_is_defined_twice():
    places = defaultdict(list)
    for path in Path(ctr_opt.__file__).parent.rglob("*.py"):
        for statement in ast.parse(path.read_text("utf-8")).body:
            if isinstance(statement, ast.ClassDef) and not statement.name.startswith("_"):
                places[statement.name].append(path)
    assert len(places) > 100
    assert {name: paths for name, paths in places.items() if len(paths) > 1} == {}
