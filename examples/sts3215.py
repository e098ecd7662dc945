"""What the model of a hobby servo lacks, from logs of its goal and its position alone.

    python examples/sts3215.py [FOLDER WITH sysid_sts3215_*.json] [MODEL TO WRITE.toml]

The logs are of a Feetech STS3215 that swings a pendulum: two masses, two arms, three loop gains, five trajectories,
each twice. The plant is fitted on the short arm; the long one decides nothing and is judged at the end. No torque was
measured: the position is simulated from the goal. Effects tied to the place on the revolution are not looked at: the
plant is to serve on another mount, and there they would act elsewhere.
"""

import os
import sys
from dataclasses import replace
from pathlib import Path

import gms_mujoco as gms
from gms_mujoco.dataset import Dataset
from gms_mujoco.identification.servo_observation import repeatability
from gms_mujoco.progress import Bar
from gms_mujoco.servo_run import read_run

LOGS = "sysid_sts3215_*.json"
SOURCE = "logs of a Feetech STS3215 at 12 V by K-Scale Labs, github.com/kscalelabs/sysid, commit ea99facd7bf9"
TIED_TO_THE_PLACE = ("cogging", "gravity", "position_dependent_friction", "spring")


def load(folder: Path) -> Dataset:
    """Runs on the short arm to fit, each condition and its repetition side by side, and those on the long one."""
    runs = [read_run(path) for path in sorted(folder.glob(LOGS))]
    lengths = [r.inertia / r.weight for r in runs]  # the arm over the acceleration of gravity
    middle = (min(lengths) + max(lengths)) / 2
    pairs = zip(runs, lengths, strict=True)
    return Dataset(folder, (), servos=tuple(replace(r, use="fit" if x < middle else "validate") for r, x in pairs))


def main() -> int:
    default = Path(os.environ.get("GMS_MUJOCO_DATA", "../shared/data")) / "sts3215"
    data = Path(sys.argv[1]) if len(sys.argv) > 1 else default
    if not any(data.glob(LOGS)):
        print(f"no {LOGS} in {data}: give the folder, or set GMS_MUJOCO_DATA")
        return 2
    runs = load(data)
    again = repeatability(runs.servos)
    if again is not None:
        print(f"a run differs from its repetition by {1e3 * again:.1f} mrad (mean absolute)")
    with Bar() as bar:
        found = gms.diagnose(runs, without=TIED_TO_THE_PLACE, progress=bar)
    print(found)
    plant = found.plant
    if len(sys.argv) > 2:
        errors = {use: gms.compare(plant, getattr(runs, use)).error for use in ("fit", "validate")}
        provenance = {
            "source": SOURCE,
            "fitted": f"{len(runs.fit)} runs of 6 s on an arm of 0.10 m, judged on {len(runs.validate)} on 0.15 m",
            "position_error": round(errors["fit"], 5),
            "position_error_other_arm": round(errors["validate"], 5),
            "version": plant.provenance["version"],
        }
        replace(plant, provenance=provenance).save(sys.argv[2])
    return 0


if __name__ == "__main__":
    sys.exit(main())
