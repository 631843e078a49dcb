"""Growth of times with sections, tubes and load points, as exponents of a power law."""

from itertools import product

import numpy as np

import ctr_opt as ctr

from .methods import INTEGRATION, LINEARIZATION, REPEATS, native
from .timing import fastest
from .work import nested

LOAD_POINTS = (0, 20, 60)  # on robots of every tube count: each is a section more
MANY_LOAD_POINTS = (50, 100, 200, 400)  # on three tubes
WAYS = {INTEGRATION: (False, 1), LINEARIZATION: (True, 2)}  # with the derivative; the exponent of tubes allowed


def pulled(work, points):
    """Forces at this number of points along the innermost tube; their sum is the load at the tip."""
    force, _ = work.wrench
    places = np.linspace(0.0, work.start.length, points + 2)[1:-1]
    return [ctr.PointWrench(force / points, arc_length=float(s)) for s in places]


def solved(work, points):
    """A problem and its solution by compiled code, a step in each section."""
    problem = ctr.ForwardProblem(work.robot, compiled=True)
    return problem, problem.solve(work.actuation, pulled(work, points))


def exponents(columns, times):
    """Exponent of each column in the power law that fits the times best."""
    design = np.log(np.column_stack((np.full(len(times), np.e), *columns)))
    return np.linalg.lstsq(design, np.log(times), rcond=None)[0][1:]


def lines(effort, tubes):
    """Report the growth for robots with these numbers of ``tubes``."""
    works = [nested(count, "force", 0) for count in tubes]
    grid = list(product(works, LOAD_POINTS))
    problems = [solved(*point) for point in grid]
    sections, counts = [len(shape.shape.mesh) for _, shape in problems], [work.tubes for work, _ in grid]
    yield f"time as sections^a tubes^b, {len(works)} tube counts, {min(sections)} to {max(sections)} sections:"
    for name, (derivative, most) in WAYS.items():
        a, b = exponents((sections, counts), times(derivative, problems, effort))
        yield f"  {name}: a = {a:.2f} (linear: 1), b = {b:.2f} (at most {most})"
    work = nested(min(3, max(tubes)), "force", 0)
    problems = [solved(work, points) for points in MANY_LOAD_POINTS]
    yield f"time as (load points)^c, {work.tubes} tubes, {MANY_LOAD_POINTS[0]} to {MANY_LOAD_POINTS[-1]} points:"
    for name, (derivative, _) in WAYS.items():
        (c,) = exponents((MANY_LOAD_POINTS,), times(derivative, problems, effort))
        yield f"  {name}: c = {c:.2f} (linear: 1)"


def times(derivative, problems, effort):
    """Seconds of each, taken in turns."""
    return fastest([native(*problem, REPEATS, derivative)[0] for problem in problems], effort) / REPEATS
