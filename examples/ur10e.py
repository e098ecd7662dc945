"""Friction of a UR10e from current against motion, torque constants unknown: what each joint lacks, and a trap.

    python examples/ur10e.py [FOLDER WITH ur-20_01_22-joint_1.csv ...]

The logs are those of S. Mamedov (github.com/shamilmamedov/dynamic_calibration): joints 1 to 3 moved one at a time, 63 s
at 100 Hz. Torque stays in ampere. The torque that the robot's own controller asks of the joint in its rigid-body model
is the load, the torque that the gear transmits. The first 60 % of a log fit, the last 40 % decide nothing: they are
scored at the end. There each joint stops from full speed within 60 ms, which 100 Hz hardly resolve, so what is counted
there depends on the filter: a Butterworth of 4th order at 10 Hz, forward and backward. Through the same filter stands a
plain least squares beside each joint, as it is often done: inertia, gravity, an offset, viscous drag and friction of
tanh(v / 0.01 rad/s), without and with |load|. It needs speeds that the robot logs, and the diagnosis does without them.

On joint 1 nothing but inertia loads the gear, so on the sine that was driven the load is a function of speed. A load
term lowers the error of the fit there and raises the one on held-out data, whose stop loads the gear 14 times more. The
diagnosis refuses it.
"""

import os
import sys
import tempfile
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import signal

import gms_mujoco as gms

LOG = "ur-20_01_22-joint_{}.csv"
CUTOFF = 10.0  # Hz, of the filter that errors are seen through
WHOLE = 40.0  # Hz, all that the log carries
FITTED = 0.6  # of a log
SLOW = 0.01  # rad/s, below which a joint rests: what holds it there no model knows
AXIS = """
[axis]
torque_constant = "unknown"

[[record]]
file = "{file}"
columns = {{ time = 0, position = {q}, current = {i}, load = {tau} }}
"""


def load(data: Path, joint: int) -> gms.Dataset:
    """The log of one joint; columns are time, six positions, speeds, currents, commanded currents and torques."""
    file = (data / LOG.format(joint)).resolve().as_posix()
    with tempfile.TemporaryDirectory() as folder:
        text = AXIS.format(file=file, q=joint, i=12 + joint, tau=24 + joint)
        (Path(folder) / "dataset.toml").write_text(text)
        return gms.load(folder)


def smooth(x: NDArray[np.float64], sample_time: float) -> NDArray[np.float64]:
    return np.asarray(signal.sosfiltfilt(signal.butter(4, CUTOFF, fs=1 / sample_time, output="sos"), x, axis=0))


def rms(x: NDArray[np.float64]) -> float:
    return float(np.sqrt(np.mean(x**2)))


class Errors(NamedTuple):
    """Root mean square of the current error [A]: on the fitted part, on the held-out part, and there while it moves."""

    fit: float
    held_out: float
    moving: float


def errors(plant: gms.Plant, runs: gms.Dataset) -> Errors:
    """What a plant leaves."""
    records = gms.compare(plant, [*runs.fit, *runs.validate], bandwidth=WHOLE).records
    fit, held_out = (smooth(r.residual, r.time[1] - r.time[0]) for r in records)
    return Errors(rms(fit), rms(held_out), rms(held_out[abs(records[1].velocity) > SLOW]))


def least_squares(data: Path, joint: int, load: bool) -> Errors:
    """The same of a plain least squares on positions, speeds and currents of the log."""
    columns = np.loadtxt(data / f"ur-20_01_22-joint_{joint}.csv", delimiter=",").T
    h = float(np.median(np.diff(columns[0])))
    q, v, i, torque = (smooth(columns[k + joint], h) for k in (0, 6, 12, 24))
    direction = np.tanh(v / SLOW)
    terms = [np.gradient(v, h), np.sin(q), np.cos(q), np.ones_like(q), v, direction, *load * [abs(torque) * direction]]
    table, n = np.stack(terms, axis=1), round(FITTED * len(q))
    left = i - table @ np.linalg.lstsq(table[:n], i[:n], rcond=None)[0]
    return Errors(rms(left[:n]), rms(left[n:]), rms(left[n:][abs(v[n:]) > SLOW]))


def line(what: str, left: Errors) -> str:
    return f"{what:50}{left.fit:7.3f} /{left.held_out:6.3f}{left.moving:10.3f}"


def main() -> int:
    default = Path(os.environ.get("GMS_MUJOCO_DATA", "../shared/data")) / "ur10e"
    data = Path(sys.argv[1]) if len(sys.argv) > 1 else default
    if not (data / LOG.format(1)).is_file():
        print(f"no {LOG.format(1)} in {data}: give the folder, or set GMS_MUJOCO_DATA")
        return 2
    print(f"{'current error [A]':53}fit / held out, while it moves")
    for joint in (1, 2, 3):
        runs = load(data, joint)
        found = gms.diagnose(runs)
        for step in found.steps:
            name = "inertia, GMS friction, viscous drag" if step.effect is None else f"+ {step.effect}"
            print(line(f"joint {joint}: {name}", errors(step.result.plant, runs)))
        for term in (False, True):
            name = f"plain least squares, {'with' if term else 'without'} |load|"
            print(line(f"         {name}", least_squares(data, joint, term)))
        print(f"         {found.verdict.replace('_', ' ')}" + (f": {found.remainder}" if found.remainder else ""))
        if "load_dependent_friction" in found.plant:
            table = found.plant.table("load_dependent_friction")["load_dependent_friction.coefficient"]
            print(f"         friction grows by {100 * float(str(table['value'])):.2f} % per N m transmitted")
    return 0


if __name__ == "__main__":
    sys.exit(main())
