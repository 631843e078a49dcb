"""Time of the first compilation on a machine."""

import tempfile
from pathlib import Path
from time import perf_counter

from ctr_opt.mechanics.kind import DEAD
from ctr_opt.native.compiler import required
from ctr_opt.native.generate import library_source


def line(tubes):
    """Report the seconds for writing the code and for compiling it; nothing of it is kept."""
    begin = perf_counter()
    source = library_source(tubes, DEAD)
    written = perf_counter()
    with tempfile.TemporaryDirectory() as folder:
        required().build(source, Path(folder))
    built = perf_counter()
    return f"first compilation for {tubes} tubes: {written - begin:.1f} s to write, {built - written:.1f} s to compile"
