"""Unknown loads as values: they are equal where their numbers are, in arrays too."""

import attrs
import numpy as np
import pytest

import ctr_opt as ctr


@pytest.mark.parametrize(
    "make",
    [
        lambda n: ctr.TipForce(prior=(np.zeros(n), np.eye(n)), bounds=(-np.ones(n), None)),
        lambda n: ctr.TipWrench(prior=(np.zeros(2 * n), np.eye(2 * n))),
        lambda n: ctr.PointForce(prior=(np.zeros(n), 0.5), between=np.array([0.01, 0.09]).tolist()),
        lambda n: ctr.PointForce(0.1, normal=np.ones(n), prior=[np.zeros(n), np.ones(n)]),
        lambda n: ctr.DistributedForce(bounds=(-np.ones(n), np.ones(n)), prior=(0.0, np.ones(n))),
        lambda n: ctr.Parameter("base.translation", prior=(np.zeros(n), np.ones(n)), initial=np.zeros(n)),
    ],
)
def test_equal_where_arrays_are(make):
    one, other = make(3), make(3)
    assert one == other
    assert hash(one) == hash(other)
    assert one != attrs.evolve(one, prior=None)
    assert attrs.evolve(one, prior=None) != one
    for field in ("prior", "bounds"):
        pair = getattr(one, field)
        if pair is not None:
            moved = (2.0 * np.array(pair[0]) - 1.0, pair[1])
            assert one != attrs.evolve(one, **{field: moved})


def test_starts_are_counted():
    rod = ctr.Tube("rod", 2e-3, 0.0, ctr.Straight(0.1), bending_stiffness=0.05, torsional_stiffness=0.04)
    with pytest.raises(ctr.DefinitionError, match="starts = 0 must be a whole number, at least 1"):
        ctr.ForceEstimationProblem(ctr.Robot([rod]), ctr.TipForce(), starts=0)
