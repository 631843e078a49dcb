"""Tables of experiments: what is given in part is refused, and nothing is lost on the way to a file and back."""

import numpy as np
import pytest

import ctr_opt as ctr

TIP = "rotation_0, translation_0, tip_x, tip_y, tip_z"
HELD = ctr.Actuation([0.1], [-0.01])


def table(path, text):
    file = path / "table.csv"
    file.write_text(text)
    return file


@pytest.mark.parametrize(
    ("header", "row", "missing"),
    [
        (", tip_x, tip_y", "0, 0.1", "tip_z"),
        (", base_force_x, base_force_y, base_force_z", "0.1, 0, 0", "base_moment_x"),
        (", base_moment_x, base_moment_y, base_moment_z", "0.1, 0, 0", "base_force_x"),
    ],
)
def test_a_missing_column_is_named(tmp_path, header, row, missing):
    file = table(tmp_path, f"rotation_0, translation_0, tube0_x, tube0_y, tube0_z{header}\n0, 0, 0, 0, 0.1, {row}\n")
    with pytest.raises(ctr.DefinitionError, match=f"column '{missing}' is missing"):
        ctr.read_experiments(file, 1)


FORCE = "force_x, force_y, force_z"
WRENCH = ", ".join(f"base_{kind}_{axis}" for kind in ("force", "moment") for axis in "xyz")


@pytest.mark.parametrize(
    ("header", "row", "empty"),
    [
        ("tube0_x, tube0_y, tube0_z", "0, , 0.1", "tube0_y"),
        ("base_x, base_y, base_z", ", 0, 0", "base_x"),
        ("direction_x, direction_y, direction_z", "0, 0, ", "direction_z"),
        ("tip_qw, tip_qx, tip_qy, tip_qz", "1, 0, , 0", "tip_qy"),
        (FORCE, "0.2, , ", "force_y"),
        (WRENCH, "0.1, , 0, 0, 0, 0", "base_force_y"),
        (WRENCH, "0.1, 0, 0, , , ", "base_moment_x"),
    ],
)
def test_a_vector_given_in_part_is_refused(tmp_path, header, row, empty):
    """With the line and the column; all of it may be empty, and was not measured."""
    whole = ", ".join([""] * len(header.split(",")))
    file = table(tmp_path, f"{TIP}, {header}\n0, 0, 0, 0, 0.1, {whole}\n0, 0, 0, 0, 0.1, {row}\n")
    with pytest.raises(ctr.DefinitionError, match=f"line 3, column '{empty}' is empty, but '.*' is given"):
        ctr.read_experiments(file, 1)
    (found,) = ctr.read_experiments(table(tmp_path, f"{TIP}, {header}\n0, 0, 0, 0, 0.1, {whole}\n"), 1)
    assert len(found.measurements) == 1
    assert not found.loads
