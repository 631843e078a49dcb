"""Does every solve end in an equilibrium or a reported failure? Seeded; results in docs/evidence/robustness.md.

Parts: ``conservative`` (a), ``moments`` (b), ``shapes`` (c), ``memory`` (d), ``fuzz``.
Run: ``python -m benchmarks.robustness`` for all of them, ``--part moments --count 100 --seed 3`` for one.
"""

import argparse
import collections
import multiprocessing
import sys
import time
from functools import partial

import attrs
import casadi as ca
import numpy as np

import ctr_opt as ctr
from tests.support import fuzzing, samples

from .memory import resident

COUNTS = {"conservative": 500, "moments": 500, "shapes": 4000, "memory": 20000, "fuzz": 2000}
SETTINGS = (
    {},
    {"tolerance": 1e-9},
    {"tolerance": 1e-5},
    {"integrator": "RK5"},
    {"integrator": "RK4", "tolerance": 1e-6},
    {"formulation": "equilibrium"},
    {"formulation": "energy"},
    {"formulation": "energy", "tolerance": 1e-5},
    {"formulation": "equilibrium", "transcription": ctr.MultipleShooting()},
    {"formulation": "equilibrium", "transcription": ctr.Collocation()},
    {"formulation": "energy", "transcription": ctr.Collocation(3, "radau"), "tolerance": 1e-5},
)
SPRING = ctr.PotentialLoad(lambda p: 2.0 * ca.sumsqr(p - ca.DM([0.05, 0.0, 0.1])))


def solved(problem, actuation, loads, initial=None):
    """The result and its seconds."""
    begin = time.perf_counter()
    result = problem.solve(actuation, loads, initial=initial, throw=False)
    return result, time.perf_counter() - begin


def record_of(result, seconds, allowed, index, **more):
    """A record of a solve that can be sent from process to process."""
    record = {"index": index, "seconds": seconds, "status": result.status.name, "path": result.path, **more}
    record["tubes"], record["reached"] = len(result.robot.tubes), result.reached
    if result.converged:
        record["defect"], record["allowed"] = result.verify(), allowed * result.length
        record["wrong"] = not record["defect"] <= record["allowed"]
    return record


# -- a and b: cold starts ----------------------------------------------------------------------------------------------


def cold(sampler, seed, index):
    sample = getattr(samples, sampler)(seed, index)
    result, seconds = solved(ctr.ForwardProblem(sample.robot), sample.actuation, sample.loads)
    more = {"snapped": sample.snapped}
    if result.converged and sample.unloaded.converged:
        more["displacement"] = samples.displacement(result, sample)
        if sampler == "with_moments":
            more["turn"] = np.degrees(samples.turn(result, sample))
    return [record_of(result, seconds, 1e-7, index, **more)]


# -- c: every other way to a shape -------------------------------------------------------------------------------------


def warm(seed, index):
    """One cold solve with some settings, then warm ones of changed actuation and loads."""
    rng = np.random.default_rng([seed, index, 1])
    robot, actuation, loads = samples.light(seed, index, load=4.0)
    settings = SETTINGS[index // 4 % len(SETTINGS)]
    if settings.get("formulation") == "energy":
        loads = [load.conservative_part() for load in loads]
    elif index % 3 == 1:
        loads = [attrs.evolve(load, frame="body") if isinstance(load, ctr.PointWrench) else load for load in loads]
    if index % 5 == 2:
        loads = [*loads, SPRING]
    problem, shape, records = ctr.ForwardProblem(robot, **settings), None, []
    for _ in range(8):
        result, seconds = solved(problem, actuation, loads, shape)
        records.append(record_of(result, seconds, problem.settings.tolerance, index, settings=settings))
        shape = result if result.converged else None
        actuation = ctr.Actuation(
            actuation.rotations + rng.normal(scale=0.5, size=len(robot.tubes)),
            np.minimum(actuation.translations + rng.uniform(-0.01, 0.02, len(robot.tubes)), 0.0),
        )
        loads = [load.times(rng.uniform(0.7, 1.3)) for load in loads]
    return records


# -- d: memory ---------------------------------------------------------------------------------------------------------


def memory(seed, count, every):
    """Solve new robots of one to four tubes; return ``(solves, MB)`` at intervals."""
    series, seconds, done, index = [(0, resident())], [], 0, 0
    while done < count:
        robot, actuation, loads = samples.light(seed, index)
        problem, shape = ctr.ForwardProblem(robot, tolerance=1e-4, integrator="RK4"), None
        if index % 40 == 0:
            problem = ctr.ForwardProblem(robot)
        elif index % 40 == 1:
            problem = ctr.ForwardProblem(robot, formulation="energy", tolerance=1e-4)
            loads = [load.conservative_part() for load in loads]
        for _ in range(5):
            shape, spent = solved(problem, actuation, loads, shape)
            shape = shape if shape.converged else None
            seconds.append(spent)
            actuation = ctr.Actuation(actuation.rotations + 0.02, actuation.translations)
            done += 1
            if done % every == 0:
                series.append((done, resident()))
                progress("memory", done, count)
        index += 1
    return series, seconds


def slope(series):
    """KB a solve over the second half of the series, by least squares."""
    solves, size = np.array(series[len(series) // 2 :]).T
    return 1024.0 * float(np.polyfit(solves, size, 1)[0])


# -- running and telling -----------------------------------------------------------------------------------------------


def progress(name, done, count):
    print(f"\r{name}: {done} of {count}", end="\n" if done >= count else "", file=sys.stderr, flush=True)


def run(name, work, count, processes):
    """The records of ``work(0)``, ``work(1)``, ... in order."""
    records: list[dict] = []
    pool = multiprocessing.get_context("spawn").Pool(processes) if processes > 1 else None
    for done, records_of_one in enumerate(pool.imap(work, range(count)) if pool else map(work, range(count)), start=1):
        records.extend(records_of_one)
        if done % 10 == 0 or done == count:
            progress(name, done, count)
    return records


def tell(name, records):
    """Counts, times and failures of one part."""
    seconds = np.array([record["seconds"] for record in records])
    solved_ones = [record for record in records if record["status"] == "CONVERGED"]
    wrong = [record for record in solved_ones if record["wrong"]]
    ratio = max(record["defect"] / record["allowed"] for record in solved_ones)
    print(f"\n{name}: {len(records)} solves, {len(solved_ones)} solved ({len(solved_ones) / len(records):.2%})")
    print(f"  wrong shapes {len(wrong)}; largest defect {ratio:.2g} of the allowed")
    print(f"  seconds a solve: median {np.median(seconds):.3f}, worst {seconds.max():.2f}")
    for tubes in range(1, 5):
        mine = [r for r in records if r["tubes"] == tubes]
        if mine:
            good = sum(r["status"] == "CONVERGED" for r in mine)
            times = [r["seconds"] for r in mine]
            print(f"  {tubes} tubes: {good} of {len(mine)}; median {np.median(times):.3f} s, worst {max(times):.2f} s")
    for key, unit in (("displacement", "of the tip, over the length"), ("turn", "of the tip by the moments, degrees")):
        values = [record[key] for record in records if key in record]
        if values:
            shares = np.percentile(values, [0, 10, 25, 50, 75, 90, 100])
            print(f"  {key} ({unit}), 0, 10, 25, 50, 75, 90, 100 %: " + ", ".join(f"{x:.3g}" for x in shares))
    if any("snapped" in record for record in records):
        print(f"  loads behind a singular point of the walk to them: {sum(record['snapped'] for record in records)}")
    ways = collections.Counter(plain(record["path"]) for record in solved_ones)
    for path, number in ways.most_common():
        print(f"  {number:5d}  {path}")
    for record in records:
        if record["status"] != "CONVERGED" or record["wrong"] or plain(record["path"]) != record["path"]:
            print(
                f"  [{record['index']}] {record['status']}, {record['tubes']} tubes, {record['seconds']:.1f} s: "
                f"{record['path']} {record.get('settings', '')}"
            )


def plain(path):
    """A path without numbers."""
    return " -> ".join(part.split(" (")[0] for part in path.split(" -> "))


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--part", action="append", choices=list(COUNTS), help="may be repeated; default: all")
    parser.add_argument("--count", type=int, help="in place of the parts' own counts")
    parser.add_argument("--seed", type=int, default=2026)
    parser.add_argument("--processes", type=int, default=1)
    options = parser.parse_args()
    for part in options.part or COUNTS:
        count, begin = options.count or COUNTS[part], time.perf_counter()
        if part == "conservative":
            tell(part, run(part, partial(cold, "conservative", options.seed), count, options.processes))
        elif part == "moments":
            tell(part, run(part, partial(cold, "with_moments", options.seed), count, options.processes))
        elif part == "shapes":
            tell(part, run(part, partial(warm, options.seed + 1), count // 8, options.processes))
        elif part == "memory":
            series, seconds = memory(options.seed, count, max(1, count // 20))
            print("\nmemory, MB: " + ", ".join(f"{solves}: {size:.1f}" for solves, size in series))
            print(f"  slope over the second half {slope(series):.4f} KB a solve")
            print(f"  seconds a solve: median {np.median(seconds):.4f}, worst {max(seconds):.2f}")
        else:
            outcomes, seconds = fuzzing.fuzz(count, options.seed)
            print(f"\nfuzz: {len(seconds)} files; nothing but declared errors and warnings, no hang")
            print("  " + ", ".join(f"{outcome}: {number}" for outcome, number in outcomes.most_common()))
            print(f"  seconds a file: median {np.median(seconds):.3f}, worst {max(seconds):.2f}")
        print(f"  {part} took {time.perf_counter() - begin:.0f} s in {options.processes} process(es)", flush=True)


if __name__ == "__main__":
    main()
