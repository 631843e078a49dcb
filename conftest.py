"""Tests run in parallel processes: let none of them start threads of its own for linear algebra.

Nor does any compile in the background, so that every run goes the same way: tests of compiled code ask for it.
Libraries are kept beside pytest's own cache.
"""

import os
from collections.abc import Iterator
from pathlib import Path

import pytest

for name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(name, "1")
os.environ["CTR_OPT_COMPILE"] = "request"
os.environ.setdefault("CTR_OPT_CACHE", str(Path(__file__).parent / ".pytest_cache" / "compiled"))


@pytest.fixture(scope="module")
def compiling() -> Iterator[None]:
    """Compiled code is used without asking for it, as where nothing forbids it: estimates are many times as fast."""
    with pytest.MonkeyPatch.context() as patch:
        patch.delenv("CTR_OPT_COMPILE")
        yield
