"""Wrong files of every kind: declared errors only, no hang, no undeclared warning; 2,000 more in benchmarks."""

import time

import pytest
from hypothesis import HealthCheck, given, settings

import ctr_opt as ctr
from tests.support import fuzzing

few = settings(
    max_examples=100, deadline=None, derandomize=True, database=None, suppress_health_check=list(HealthCheck)
)


def test_the_files_are_right_before_they_are_spoiled():
    files = {name: text.encode() for name, text in fuzzing.FILES.items()}
    assert fuzzing.check(files) == "solved"


@few
@given(fuzzing.damaged())
def test_damaged_texts(files):
    fuzzing.check(files)


@pytest.mark.slow
@few
@given(fuzzing.stretched())
def test_numbers_of_other_sizes(files):
    fuzzing.check(files)


@few
@given(fuzzing.rebuilt())
def test_rebuilt_tables(files):
    fuzzing.check(files)


def test_a_hang_is_reported(monkeypatch):
    monkeypatch.setattr(fuzzing, "LONGEST", 0.05)
    monkeypatch.setattr(ctr, "load_robot", lambda _: time.sleep(10.0))
    with pytest.raises(fuzzing.Hang):
        fuzzing.check({})
