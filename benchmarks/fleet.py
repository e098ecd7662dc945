"""How a fleet scales on this machine, and what a million joints would take.

    python benchmarks/fleet.py [--sets 32] [--jobs 1 2 4] [--verb fit]

Simulated axes are fitted (or diagnosed) by one process, by several, and by as many workers of a Dask cluster on this
machine; each run in an empty folder. The numbers of all runs are compared to the last bit.
"""

import argparse
import json
import os
import resource
import tempfile
import time
from dataclasses import replace
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np

from gms_mujoco import Plant, dataset, effects, fleet, simulate
from gms_mujoco.excitation import multisine

J = 2.4e-5
GMS = effects.GMS(
    stiffness=[0.5, 0.12], fraction=[0.45, 0.55], coulomb=4.5e-3, static=5e-3, stribeck_velocity=0.5, attraction=0.5
)
PLANT = Plant.axis(J) + GMS + effects.Viscous(coefficient=2e-5)
MILLION = 1_000_000


def make_sets(folder: Path, n: int) -> None:
    """n axes of which friction differs, each with two records to fit and one to validate (3 s at 1 kHz)."""
    for i in range(n):
        rng = np.random.default_rng(i)
        level = rng.uniform(0.5, 2)
        plant = PLANT.replace(GMS.replace(coulomb=4.5e-3 * level, static=5e-3 * level))
        records = []
        for name, use in (("a", "fit"), ("b", "fit"), ("c", "validate")):
            torque = multisine(3000, 1e-3, 0.5, 40.0, 1.5 * 4.5e-3 * level, rng)
            bench = {"resolution": 2 * np.pi / 1e6, "torque_noise": 2e-5, "seed": i}
            records.append(replace(simulate(plant, torque, 1e-3, **bench), name=name, use=use))
        dataset.save(folder / f"joint_{i:04d}", records, inertia=J)


def numbers(done: fleet.Fleet) -> str:
    return json.dumps([{k: v for k, v in r.items() if k != "seconds"} for r in done.rows])


def processor_time() -> float:
    """Of this process and of those that it has waited for [s]."""
    used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(u.ru_utime + u.ru_stime for u in used)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--sets", type=int, default=32)
    parser.add_argument("--jobs", type=int, nargs="+", default=[1, 2])
    parser.add_argument("--verb", choices=fleet.VERBS, default="fit")
    options = parser.parse_args()
    from distributed import LocalCluster
    from joblib.externals.loky import get_reusable_executor

    with tempfile.TemporaryDirectory() as scratch:
        place = Path(scratch)
        make_sets(place / "sets", options.sets)
        start = Plant.axis(J) + effects.GMS(elements=2) + effects.Viscous()
        reference, alone, work, size = None, 0.0, 0.0, 0
        print(f"{options.sets} sets, {options.verb}, {os.cpu_count()} processors")
        print(f"{'workers':24} {'seconds':>8} {'sets/s':>8} {'speed-up':>9} {'processor s':>12} {'a set':>7}  numbers")
        for jobs in options.jobs:
            for kind in ("this process",) if jobs == 1 else ("processes", "Dask on this machine"):
                out = place / f"{kind}{jobs}"
                how = {"jobs": jobs}
                cluster = None
                if kind.startswith("Dask"):
                    cluster = LocalCluster(
                        n_workers=jobs, threads_per_worker=1, host="127.0.0.1", dashboard_address=None
                    )
                    how = {"cluster": cluster.scheduler_address}
                begin, spent = time.perf_counter(), processor_time()
                done = fleet.run_all(options.verb, place / "sets", out, start, **how)
                took = time.perf_counter() - begin
                if cluster:
                    cluster.close()
                get_reusable_executor().shutdown()
                spent = processor_time() - spent
                if reference is None:
                    reference, alone, work = numbers(done), took, spent / options.sets
                    size = sum(p.stat().st_size for p in out.rglob("*") if p.is_file()) // options.sets
                same = "the same" if numbers(done) == reference else "DIFFER"
                print(
                    f"{f'{jobs}, {kind}':24} {took:8.1f} {options.sets / took:8.2f} {alone / took:9.2f} "
                    f"{spent:12.1f} {spent / options.sets:7.2f}  {same}"
                )
    hours = MILLION * work / 3600
    print(f"\na million joints at {work:.2f} s each: {hours:.0f} processor hours, {MILLION * size / 1e9:.0f} GB")
    for cores in (64, 512, 4096):
        print(f"  {cores:5} cores: {hours / cores:7.1f} h")


if __name__ == "__main__":
    main()
