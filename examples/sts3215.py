"""What the model of a hobby servo lacks, from logs of its goal and its position alone.

    python examples/sts3215.py [FOLDER WITH sysid_sts3215_*.json] [MODEL TO WRITE.toml]

The logs are of a Feetech STS3215 that swings a pendulum: two masses, two arms, three loop gains, five trajectories,
each twice. The plant is fitted on the short arm; the long one decides nothing and is judged at the end. No torque was
measured: the position is simulated from the goal. Effects tied to the place on the revolution are not looked at: the
plant is to serve on another mount, and there they would act elsewhere.
"""

import os
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from gms_mujoco import Plant, position_servo
from gms_mujoco.effects import LeastDuty
from gms_mujoco.errors import DataError
from gms_mujoco.position_servo import TIED_TO_THE_PLACE, ServoRun, Step
from gms_mujoco.progress import Bar

SOURCE = "logs of a Feetech STS3215 at 12 V by K-Scale Labs, github.com/kscalelabs/sysid, commit ea99facd7bf9"


def load(folder: Path) -> tuple[list[ServoRun], list[ServoRun]]:
    """Runs on the short arm, each condition and its repetition side by side, and those on the long one."""
    runs = [position_servo.read_run(path) for path in sorted(folder.glob("sysid_sts3215_*.json"))]
    if not runs:
        raise DataError(f"{folder}: no sysid_sts3215_*.json in this folder")
    lengths = [r.inertia / r.weight for r in runs]  # the arm over the acceleration of gravity
    middle = (min(lengths) + max(lengths)) / 2
    pairs = list(zip(runs, lengths, strict=True))
    return [r for r, x in pairs if x < middle], [r for r, x in pairs if x > middle]


def begin() -> Plant:
    """What is known of the servo: its logged duty shows the limit of the goal speed, and that it never goes below 2 or
    3 % while there is an error."""
    return position_servo.servo() + LeastDuty(duty=0.02)


def table(steps: Sequence[Step], fitted: Sequence[ServoRun], other: Sequence[ServoRun]) -> str:
    """Mean absolute error of the position on both arms, step by step."""
    lines = [f"{'':28}fitted arm   other arm   mean absolute error of the position [rad]"]
    for s in steps:
        name = f"+ {s.effect}" if s.effect else "position loop and friction"
        errors = [position_servo.error(s.plant, runs) for runs in (fitted, other)]
        lines.append(f"{name:28}{errors[0]:10.4f}  {errors[1]:10.4f}" + (f"   p = {s.p_value:.1g}" if s.effect else ""))
    return "\n".join(lines)


def main() -> int:
    default = Path(os.environ.get("GMS_MUJOCO_DATA", "../shared/data")) / "sts3215"
    short, long = load(Path(sys.argv[1]) if len(sys.argv) > 1 else default)
    with Bar() as bar:
        steps = position_servo.explain(begin(), short[::2], without=TIED_TO_THE_PLACE, progress=bar)
    plant = position_servo.fit(steps[-1].plant, short)
    print(table(steps, short, long))
    print(f"{'refitted on all its runs':28}{position_servo.error(plant, short):10.4f}  "
          f"{position_servo.error(plant, long):10.4f}")
    tried = ", ".join(f"{name} (p = {p:.1g})" for name, p in steps[-1].rejected)
    print(f"tried and left out: {tried}")
    if len(sys.argv) > 2:
        provenance = {
            "source": SOURCE,
            "fitted": f"{len(short)} runs of 6 s on an arm of 0.10 m, judged on {len(long)} on one of 0.15 m",
            "position_error": round(position_servo.error(plant, short), 5),
            "position_error_other_arm": round(position_servo.error(plant, long), 5),
            "version": plant.provenance["version"],
        }
        replace(plant, provenance=provenance).save(sys.argv[2])
    return 0


if __name__ == "__main__":
    sys.exit(main())
