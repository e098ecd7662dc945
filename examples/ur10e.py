"""Friction of a UR10e from current against motion, torque constants unknown: what each joint lacks, and a trap.

    python examples/ur10e.py [FOLDER WITH ur-20_01_22-joint_1.csv ...]

The logs are those of S. Mamedov (github.com/shamilmamedov/dynamic_calibration): joints 1 to 3 moved one at a time, 63 s
at 100 Hz. Torque stays in ampere. The torque that the robot's own controller asks of the joint in its rigid-body model
is the load, the torque that the gear transmits. The first 60 % of a log fit, the last 40 % decide nothing: they are
scored at the end. There joint 2 stops from full speed within 60 ms, which 100 Hz hardly resolve, so errors are printed
up to 10 Hz, the most that the log carries, and up to 5 Hz.

On joint 1 nothing but inertia loads the gear, so on the sine that was driven the load is a function of speed. A load
term lowers the error of the fit there and raises the one on held-out data, whose stop loads the gear 14 times more. The
diagnosis refuses it, for a curve of friction over speed explains more, and says so.
"""

import os
import sys
import tempfile
from pathlib import Path

import numpy as np

import gms_mujoco as gms

AXIS = """
[axis]
torque_constant = "unknown"

[[record]]
file = "{file}"
columns = {{ time = 0, position = {q}, current = {i}, load = {tau} }}
"""


def load(data: Path, joint: int) -> gms.Dataset:
    """The log of one joint; columns are time, six positions, speeds, currents, commanded currents and torques."""
    file = (data / f"ur-20_01_22-joint_{joint}.csv").resolve().as_posix()
    with tempfile.TemporaryDirectory() as folder:
        text = AXIS.format(file=file, q=joint, i=12 + joint, tau=24 + joint)
        (Path(folder) / "dataset.toml").write_text(text)
        return gms.load(folder)


def errors(plant: gms.Plant, runs: gms.Dataset, bandwidth: float) -> tuple[float, float]:
    """Root mean square of the current error on the fitted and on the held-out part [A]."""
    records = gms.compare(plant, [*runs.fit, *runs.validate], bandwidth=bandwidth).records
    fit, held_out = (float(np.sqrt(np.mean(r.residual**2))) for r in records)
    return fit, held_out


def line(what: str, plant: gms.Plant, runs: gms.Dataset) -> str:
    figures = [f"{fit:9.3f} /{held_out:6.3f}" for fit, held_out in (errors(plant, runs, b) for b in (10.0, 5.0))]
    return f"{what:44}" + "".join(f"{f:>20}" for f in figures)


def main() -> int:
    default = Path(os.environ.get("GMS_MUJOCO_DATA", "../shared/data")) / "ur10e"
    data = Path(sys.argv[1]) if len(sys.argv) > 1 else default
    if not data.is_dir():
        print(f"no logs in {data}: give the folder, or set GMS_MUJOCO_DATA")
        return 2
    print(f"{'current error, fit / held out [A]':44}{'up to 10 Hz':>20}{'up to 5 Hz':>20}")
    for joint in (1, 2, 3):
        runs = load(data, joint)
        found = gms.diagnose(runs)
        for step in found.steps:
            name = "inertia, GMS friction, viscous drag" if step.effect is None else f"+ {step.effect}"
            print(line(f"joint {joint}: {name}", step.result.plant, runs))
        print(f"         {found.verdict.replace('_', ' ')}" + (f": {found.remainder}" if found.remainder else ""))
        if joint > 1 and "load_dependent_friction" in found.plant:
            table = found.plant.table("load_dependent_friction")["load_dependent_friction.coefficient"]
            print(f"         friction grows by {100 * float(str(table['value'])):.2f} % per N m transmitted")
    return 0


if __name__ == "__main__":
    sys.exit(main())
