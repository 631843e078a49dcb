"""Sensitivities by compiled predictions against those by symbols, where points coincide and where they do not."""

import pickle

import numpy as np
import pytest

import ctr_opt as ctr
from ctr_opt.native.compile import compiler
from tests.parity.test_coincidences import solved
from tests.support.slow import some_slow

pytestmark = pytest.mark.skipif(compiler() is None, reason="needs a C compiler")
WRT = (
    *("rotations", "translations", "tubes[0].bending_stiffness", "base.translation", "base.rotation"),
    *("tubes[0].precurvature[1].curvature", ["loads[0].force", "rotations"]),
)


@pytest.mark.parametrize("side", [1, -1])
@pytest.mark.parametrize("index", some_slow(range(30), [3, 5]))
def test_what_predictions_know_needs_no_symbols(index, side, monkeypatch):
    """To the errors of the solve, 1e-10 of positions, that derivatives amplify; a copy has left its library behind."""
    _, shape = solved(index, riding=True)
    s, copy = 0.4 * shape.length, pickle.loads(pickle.dumps(shape))
    outputs = ["tip_position", "tip_pose", "base_wrench", ("position", s), ("pose", s, 0), ("torsion", 0, s)]
    outputs += [] if shape.one_sided else [("actuator_wrench", 0)]
    questions, expected = [], []
    for of in outputs:
        for wrt in WRT:
            try:
                expected.append(copy.sensitivity(of, wrt, side=side))
            except ctr.DefinitionError:  # tube 0 does not reach s, or has no second piece
                continue
            questions.append((of, wrt))
    assert len(questions) > 20

    def symbols(*_, **__):
        raise AssertionError("derivatives by symbols")

    jumps = np.abs(shape.configuration.break_points - s).min() <= 1e-9
    if not (shape.one_sided or jumps):  # otherwise the tip may become that of another tube, or a torsion jumps
        monkeypatch.setattr("ctr_opt.forward.derivatives.derivatives", symbols)
    for (of, wrt), other in zip(questions, expected, strict=True):
        atol = 1e-5 * max(np.abs(other).max(), 1e-3)
        np.testing.assert_allclose(
            shape.sensitivity(of, wrt, side=side), other, rtol=0.0, atol=atol, err_msg=f"{of} by {wrt}"
        )
