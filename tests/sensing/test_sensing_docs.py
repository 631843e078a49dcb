"""The code of docs/how_to/sensing.md runs, and its benchmark measures what it says."""

import re
from pathlib import Path

import numpy as np

from benchmarks.precurvature import TUBES, measure, points_of

ROOT = Path(__file__).resolve().parents[2]


def test_the_code_runs(capsys):
    (code,) = re.findall(r"```python\n(.*?)```", (ROOT / "docs" / "how_to" / "sensing.md").read_text("utf-8"), re.S)
    scope = {}
    exec(code, scope)
    np.testing.assert_allclose(scope["seen"].points, scope["grid"], atol=1e-12)
    np.testing.assert_allclose(scope["registration"].pose, np.eye(4), atol=1e-10)
    assert "PointWrench" in capsys.readouterr().out


def test_the_benchmark_measures_bands():
    ends = points_of(TUBES["arc"], 3)
    # 1.08 rad of a circle of radius 1 / 9 m; positions are known to 1e-7 of the length
    np.testing.assert_allclose(ends[-1], [(1 - np.cos(1.08)) / 9, 0, np.sin(1.08) / 9], atol=2e-8)
    covered, least, (error, _, known) = measure(TUBES["linear"], "spline", count=6)
    assert 0.8 < covered <= 1.0
    assert least <= covered
    assert 0.2 < error / known < 2.0
