"""Values along a shape: of compiled code, of the virtual machine, and by the methods of each quantity."""

import pickle

import attrs
import numpy as np
import pytest

import ctr_opt as ctr
from ctr_opt.native.compile import compiler
from tests.parity.test_coincidences import metres, solved
from tests.support.slow import some_slow

pytestmark = pytest.mark.skipif(compiler() is None, reason="needs a C compiler")


def places(given, shape):
    """Places in any order: between nodes, and wherever something ends or begins."""
    s = np.append(np.linspace(0.0, shape.length, 23), [metres(place) for place in given.places])
    return np.random.default_rng(1).permutation(s[s <= shape.length])


@pytest.mark.parametrize("riding", [False, True])
@pytest.mark.parametrize("index", some_slow(range(100), range(8)))
def test_compiled_values_are_those_of_the_virtual_machine(index, riding):
    """From the same nodes by the same formulas: to rounding, which moments and curvatures amplify."""
    given, shape = solved(index, riding)
    copy, s = pickle.loads(pickle.dumps(shape)), places(given, shape)
    one, other = attrs.asdict(shape.sample(s)), attrs.asdict(copy.sample(s))
    for name, values in one.items():
        scale = max(np.nanmax(np.abs(other[name])), 1e-6)
        np.testing.assert_allclose(values, other[name], rtol=0.0, atol=1e-9 * scale, err_msg=name)
    assert shape.energy == pytest.approx(copy.energy, rel=1e-10)


@pytest.mark.parametrize("index", range(6))
def test_a_sample_has_the_answers_of_all_methods(index):
    given, shape = solved(index)
    s, tubes = places(given, shape), range(len(given.ends))
    values = shape.sample(s)
    for name in ("position", "curvature", "internal_force", "internal_moment"):
        np.testing.assert_array_equal(getattr(values, name), getattr(shape, name)(s))
    for i in tubes:
        there = s <= metres(given.ends[i]) + 1e-15
        assert np.isnan(values.torsion[~there, i]).all()
        for name in ("torsion", "tube_angle", "tube_moment"):
            np.testing.assert_array_equal(getattr(values, name)[there, i], getattr(shape, name)(i, s[there]))
    tip = shape.sample(shape.length)
    assert tip.position.shape == (3,)
    np.testing.assert_allclose(tip.position, shape.tip_position, rtol=0.0, atol=1e-15)
    longest = given.innermost(given.tip)
    c, d = np.cos(tip.tube_angle[longest]), np.sin(tip.tube_angle[longest])
    frame = tip.rotation @ [[c, -d, 0.0], [d, c, 0.0], [0.0, 0.0, 1.0]]
    np.testing.assert_allclose(frame, shape.tip_pose[:3, :3], rtol=0.0, atol=1e-14)


def test_values_need_no_virtual_machine(monkeypatch):
    _, shape = solved(3)

    def symbols(*_, **__):
        raise AssertionError("values by the virtual machine")

    monkeypatch.setattr("ctr_opt.transcription.shape.shooting_functions", symbols)
    shape.sample(np.linspace(0.0, shape.length, 61))
    shape.plot()
    with pytest.raises(ctr.DefinitionError, match=r"s = -1 m is outside the robot"):
        shape.sample([0.0, -1.0])
    assert shape.sample([]).position.shape == (0, 3)
