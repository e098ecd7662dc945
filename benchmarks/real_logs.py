"""What a diagnosis makes of the logs of real machines to which a known torque was added.

    python benchmarks/real_logs.py [STRENGTH] [MACHINES] [DATA]

What is missing in a model of a real machine nobody knows; what was added to its log is known. Each machine is diagnosed
as it is, then with one torque after another added: `named` is what was found, with what cannot be told from it in
brackets, `validate` the error of the baseline and of the final plant on records that were not fitted. Strength: height
of the torque over half of what the drive gives more in one direction than in the other (default 0.3). Machines: some of
emps, ur10e_1, ur10e_2, ur10e_3, odrive, with commas between (default all). The logs are not part of this project: see
the examples of the same names; DATA is the folder of them (default GMS_MUJOCO_DATA).

The axis has moved as it did without the torque, so all of it stands in the log, and a controller has not answered it.
While an axis slides, friction that differs between the directions is the same as an offset; the last torque is no
effect of the catalogue, and the right answer to it names nothing more.
"""

import os
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
from arguments import arguments
from numpy.typing import NDArray
from scipy.signal import savgol_filter

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "examples"))

import emps
import odrive_cogging
import ur10e

import gms_mujoco as gms
from gms_mujoco.dataset import Dataset
from gms_mujoco.record import Record

Array = NDArray[np.float64]
Torque = Callable[[Record], Array]  # (n,) of a record, about one high

MOVING = 0.2  # of the highest speed
WAVES, LEAST_WAVES = 5, 7  # over the way that an axis has; to a revolution
SLOW, FAST = 0.11, 0.37  # Hz


def _stage(data: Path) -> Dataset:
    with tempfile.TemporaryDirectory() as folder:
        return gms.load(emps.write(Path(folder), data / "emps"))


MACHINES: dict[str, Callable[[Path], Dataset]] = {
    "emps": _stage,
    **{f"ur10e_{k}": partial(lambda k, data: ur10e.load(data / "ur10e", k), k) for k in (1, 2, 3)},
    "odrive": lambda data: odrive_cogging.load(data / "odrive_cogging"),
}


def speed(r: Record) -> Array:
    """(n,) slope of the position over some 30 ms."""
    width = max(5, 2 * round(0.015 / r.sample_time) + 1)
    return np.asarray(savgol_filter(r.position, width, 2, deriv=1, delta=r.sample_time))


def friction(runs: Dataset) -> float:
    """Half of what the drive gives more in one direction than in the other [N m, N or A]."""
    torque, v = (np.concatenate([f(r) for r in runs.records]) for f in (lambda r: r.torque, speed))
    moving = np.abs(v) > MOVING * np.abs(v).max()
    forward, backward = (np.median(torque[moving & (s * v > 0)]) for s in (1, -1))
    return float(abs(forward - backward) / 2)


def torques(runs: Dataset) -> dict[str, Torque]:
    """What is added to each record, at a height of one."""
    place = np.concatenate([r.position for r in runs.records])
    span, middle = float(np.ptp(place)), float(np.mean(place))
    waves = 2 * np.pi * WAVES / span
    if runs.kind == "hinge":
        waves = max(round(waves), LEAST_WAVES)
    fastest = max(float(np.quantile(np.abs(speed(r)), 0.95)) for r in runs.records)
    out: dict[str, Torque] = {
        "torque_offset": lambda r: np.ones(len(r)),
        "cogging": lambda r: np.sin(waves * r.position + 0.4),
        "spring": lambda r: 2 * (r.position - middle) / span,
        "quadratic_drag": lambda r: (speed(r) / fastest) * np.abs(speed(r) / fastest),
        "gravity": lambda r: np.sin(r.position + 1.0),
        "unknown": lambda r: np.sin(2 * np.pi * FAST * r.time) * np.sin(2 * np.pi * SLOW * r.time + 1.0),
    }
    if runs.kind == "slide":
        del out["gravity"]
    return out


def with_torque(runs: Dataset, added: Torque, height: float) -> Dataset:
    records = [replace(r, signals={**r.signals, "torque": r.torque + height * added(r)}) for r in runs.records]
    return replace(runs, records=tuple(records))


def line(machine: str, added: str, runs: Dataset) -> str:
    begin = time.process_time()
    found = gms.diagnose(runs)
    named = ", ".join(
        f"{s.effect} ({', '.join(s.confusable_with)})" if s.confusable_with else str(s.effect) for s in found.steps[1:]
    )
    before, after = (100 * (s.validate_error or 0.0) for s in (found.steps[0], found.steps[-1]))
    spent = time.process_time() - begin
    errors = f"{before:7.2f} -> {after:6.2f} {100 * found.noise_floor:6.2f}"
    return f"{machine:9}{added:16}{found.verdict:17}{errors} {spent:5.0f}  {named or 'nothing'}"


def main(strength: float, machines: str, data: str) -> int:
    chosen = machines.split(",")
    if unknown := sorted(set(chosen) - set(MACHINES)):
        print(f"no machine is called {', '.join(unknown)}; there are {', '.join(MACHINES)}")
        return 2
    if not Path(data).is_dir():
        print(f"no logs in {data}: give the folder, or set GMS_MUJOCO_DATA")
        return 2
    print(f"{'machine':9}{'added':16}{'verdict':17}{'validate [%]':17} {'floor':>6} {'s':>5}  named")
    for machine in chosen:
        runs = MACHINES[machine](Path(data))
        print(line(machine, "nothing", runs), flush=True)
        height = strength * friction(runs)
        for name, added in torques(runs).items():
            print(line(machine, name, with_torque(runs, added, height)), flush=True)
    return 0


if __name__ == "__main__":
    given = os.environ.get("GMS_MUJOCO_DATA", "../shared/data")
    sys.exit(main(**arguments(__doc__, strength=0.3, machines=",".join(MACHINES), data=given)))
