"""The door: what ``ctr_opt`` shows, and what it leaves unloaded."""

import subprocess
import sys
from types import ModuleType

import pytest

import ctr_opt as ctr


def test_the_door_shows_public_names_alone():
    """No module is among them but ``sensing``, and every name is there."""
    assert dir(ctr) == sorted(ctr.__all__)
    modules = [name for name in ctr.__all__ if isinstance(getattr(ctr, name), ModuleType)]
    assert modules == ["sensing"]


def test_every_public_name_says_what_it_is():
    for name in set(ctr.__all__) - {"__version__"}:
        assert getattr(ctr, name).__doc__, name


def test_public_names_are_those_of_a_star_import():
    names: dict = {}
    exec("from ctr_opt import *", names)
    assert set(ctr.__all__) <= set(names)


def test_an_unknown_name_is_an_attribute_error():
    with pytest.raises(AttributeError, match="has no attribute 'Tubes'"):
        ctr.Tubes  # noqa: B018


def test_importing_leaves_what_a_solve_does_not_need_unloaded():
    heavy = ("matplotlib", "pint", "click", "ctr_opt.sensing", "cv2", "scipy.stats", "scipy.spatial")
    code = f"import sys, ctr_opt; print(sorted(set({heavy!r}) & set(sys.modules)))"
    assert (
        subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.strip() == "[]"
    )
