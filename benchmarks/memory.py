"""Resident memory over many warm solves."""

import resource
from pathlib import Path


def resident():
    """Resident set size, MB."""
    status = Path("/proc/self/status")
    if status.exists():
        line = next(line for line in status.read_text().splitlines() if line.startswith("VmRSS"))
        return int(line.split()[1]) / 1024.0
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0  # the most so far, elsewhere


def growth(problem, work, solves):
    """Resident set sizes, MB, after a tenth of the solves and after all."""
    start = problem.solve(work.actuation, work.loads)
    sizes = []
    for count in (solves // 10, solves - solves // 10):
        for k in range(count):
            problem.solve(work.targets[k % len(work.targets)], work.loads, initial=start)
        sizes.append(resident())
    return sizes
