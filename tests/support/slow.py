"""Parameters of which a few stay in the plain run."""

import pytest


def some_slow(values, keep):
    """What ``parametrize`` is given: all ``values``, those that are not in ``keep`` marked as slow."""
    keep = list(keep)
    assert all(each in values for each in keep)
    return [
        pytest.param(
            *(value if isinstance(value, tuple) else (value,)), marks=() if value in keep else pytest.mark.slow
        )
        for value in values
    ]
