"""A bad argument of any public call gives a declared error, soon: by reflection, with some sixty values for each."""

import signal

import pytest

from tests.support.bad_calls import METHODS, methods, undeclared, values

pytestmark = pytest.mark.skipif(not hasattr(signal, "setitimer"), reason="needs a timer")


@pytest.mark.parametrize("name", values())
def test_values(name):
    assert undeclared(*values()[name]) == []


@pytest.fixture(scope="module")
def calls():
    made = methods()
    assert list(made) == list(METHODS)
    return made


@pytest.mark.parametrize("name", METHODS)
def test_methods(calls, name):
    assert undeclared(*calls[name]) == []
