"""How long an identification and a diagnosis take, and what else the machine was doing.

Four tasks on simulated axes, each begun from the raw data:

- responses: `fit` of the default baseline (8 elements, inertia too) to 8 amplitudes x 60 frequencies with 1 % of error,
  made by harmonic balance as in `coverage_frf.py`.
- records: `fit` of the same to three records of 20 s at 2 kHz, encoder of 10^6 counts, as in `sysid.py`.
- healthy, cogging: `diagnose` of ten records of 8 s at 2 kHz, five to fit and five to validate, of the plant servo_axis
  and of the same with a cogging of 0.2 of its friction level; further measurement sets from the command line.

Wall is what a user waits; CPU is summed over threads (GMS_MUJOCO_THREADS, default: every core). A busy machine
stretches both, the first by its queue and the second by shared caches, so a reference (replays of an axis, sorting; one
thread) runs before and after each task: `ratio` is the CPU time of the task over that of the reference, `reference` is
what that took, and `queue` how much longer than its CPU time it waited. Medians over the repetitions.

Run: python benchmarks/speed.py [--repeat N] [--only responses,records,...] [DATASET ...]
"""

import argparse
import math
import os
import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
from coverage_frf import ERROR, axis, noisy

import gms_mujoco as gms
from gms_mujoco import effects, threads
from gms_mujoco.dataset import Dataset
from gms_mujoco.excitation import multisine
from gms_mujoco.frf import FRF
from gms_mujoco.identification.frf_observation import FrfObservation
from gms_mujoco.plant import Plant
from gms_mujoco.record import Record
from gms_mujoco.responses.harmonics import balance
from gms_mujoco.simulate import simulate

H, COUNT = 5e-4, 2 * math.pi / 1e6
BANDS = ((1.0, 60.0, 0.2), (1.0, 60.0, 0.4), (0.5, 40.0, 1.5), (0.3, 15.0, 4.0), (0.1, 3.0, 1.2))  # Hz, Hz, rms / level
Times = tuple[float, float]  # wall, CPU [s]


def responses(points: int = 60) -> list[FRF]:
    rng = np.random.default_rng([41, points])
    plant = axis(rng)
    law = plant["gms"]
    breakaway = np.array(law.fraction) * law.static / np.array(law.stiffness)
    out = []
    for size in np.geomspace(0.4 * breakaway.min(), 4 * breakaway.max(), 8):
        middle = math.sqrt(float(np.sum(np.array(law.stiffness) * np.minimum(1, breakaway / size)) / plant.inertia))
        omega, sizes = np.geomspace(0.4, 5, points) * middle, np.full(points, size)
        found = balance(plant.joint(), plant.driven_inertia, sizes, omega)
        frf = FRF(f"{size:.3g} rad", omega / (2 * np.pi), np.ones(points, complex), amplitude=sizes, sine=True)
        needed = FrfObservation(frf, np.ones(points), 1.0, found.extra).needed_torque(plant)
        exact = replace(frf, response=sizes / needed, excitation=np.abs(needed)).where(found.good)
        out.append(noisy(replace(exact, sigma=ERROR * np.abs(exact.response)), rng))
    return out


def records(plant: Plant, seconds: float, bands: tuple[tuple[float, float, float], ...], use: str) -> list[Record]:
    level, out = float(np.asarray(plant["gms"].static)), []
    for i, (low, high, rms) in enumerate(bands):
        rng = np.random.default_rng([42, i, len(use)])
        torque = multisine(round(seconds / H), H, low, high, rms * level, rng)
        noise = {"resolution": COUNT, "torque_noise": 2e-5, "seed": i + 10 * len(use), "substeps": 10}
        out.append(simulate(plant, torque, H, name=f"{use} {i}", use=use, **noise))  # type: ignore[arg-type]
    return out


def ten(plant: Plant) -> Dataset:
    runs = [r for use in ("fit", "validate") for r in records(plant, 8.0, BANDS, use)]
    return Dataset(Path(), tuple(runs), inertia=plant.inertia)


def tasks(sets: list[str]) -> dict[str, Callable[[], object]]:
    servo = Plant.load("servo_axis")
    cogging = effects.find("cogging")(harmonics=[7], amplitude=[0.2 * np.asarray(servo["gms"].static)], phase=[0.4])
    out: dict[str, Callable[[], object]] = {
        "responses": partial(gms.fit, gms.baseline(), responses()),
        "records": partial(gms.fit, gms.baseline(), records(servo, 20.0, BANDS[1:4], "fit")),
        "healthy": partial(gms.diagnose, ten(servo)),
        "cogging": partial(gms.diagnose, ten(servo + cogging)),
    }
    return out | {s: partial(gms.diagnose, gms.load(s)) for s in sets}


def reference() -> None:
    joint = Plant.load("servo_axis").joint()
    t = H * np.arange(200_000)
    position, velocity = 0.05 * np.sin(20 * t), np.cos(20 * t)
    for _ in range(40):
        joint.replay(t, position, velocity)
        np.sort(np.sin(1e9 * t))


def timed(task: Callable[[], object]) -> Times:
    wall, cpu = time.perf_counter(), time.process_time()
    task()
    return time.perf_counter() - wall, time.process_time() - cpu


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--repeat", type=int, default=3)
    parser.add_argument("--only", default="responses,records,healthy,cogging")
    parser.add_argument("sets", nargs="*")
    options = parser.parse_args()
    chosen = {k: v for k, v in tasks(options.sets).items() if k in (*options.only.split(","), *options.sets)}
    found: dict[str, list[tuple[float, ...]]] = {name: [] for name in chosen}
    before = timed(reference)
    for _ in range(options.repeat):
        for name, task in chosen.items():
            wall, cpu = timed(task)
            after = timed(reference)
            waited, own = (before[0] + after[0]) / (before[1] + after[1]), (before[1] + after[1]) / 2
            found[name].append((wall, cpu, cpu / own, own, waited, os.getloadavg()[0]))
            before = after
    print(f"medians of {options.repeat}, {threads.count()} threads on {os.cpu_count()} cores")
    print(f"{'':24} {'wall [s]':>9} {'CPU [s]':>9} {'ratio':>7} {'reference [s]':>14} {'queue':>6} {'load':>6}")
    for name, rows in found.items():
        wall, cpu, ratio, own, waited, load = np.median(rows, axis=0)
        print(f"{Path(name).name:24} {wall:9.2f} {cpu:9.2f} {ratio:7.1f} {own:14.2f} {waited:6.1f} {load:6.1f}")


if __name__ == "__main__":
    main()
