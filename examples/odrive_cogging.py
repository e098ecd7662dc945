"""Cogging of a brushless motor, found in a slow revolution of a hobby servo: its harmonics, beside a map of it.

    python examples/odrive_cogging.py [FOLDER WITH slow_comp_0.npy ...]

The logs are those of G. Chen (github.com/gchenfc/ODrive): a motor that a position loop turns once in 33 s, at 440
uneven samples a second, with an encoder of 8192 counts; three rows of time, counts and current. The torque constant is
not known, torque stays in ampere. The plant is fitted on a run in which the drive compensated cogging (its current is
logged all the same); a run without compensation decides nothing and is scored at the end. The maps that the drive
measured of its own cogging, one value per count in a scale of its own, had no part in it either: they say which
harmonics there should be.
"""

import os
import sys
import tempfile
from pathlib import Path

import numpy as np

import gms_mujoco as gms

LOGS = "slow_comp_0.npy", "slow_nocomp_0.npy"
COUNTS = 8192
AXIS = f"""
[axis]
torque_constant = "unknown"
encoder_counts_per_rev = {COUNTS}
"""
RECORD = """
[[record]]
file = "{file}"
use = "{use}"
columns = {{ time = 0, position = 1, current = 2 }}
units = {{ position = "counts" }}
"""
BANDWIDTH = 15.0  # Hz, above which there are only the jumps from one cogging well into the next


def load(data: Path) -> gms.Dataset:
    """One run with compensation to fit, one without to validate."""
    text = AXIS
    for name, use in zip(LOGS, ("fit", "validate"), strict=True):
        text += RECORD.format(file=(data / name).resolve().as_posix(), use=use)
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "dataset.toml").write_text(text)
        return gms.load(folder)


def held_out(plant: gms.Plant, runs: gms.Dataset, bandwidth: float | None = BANDWIDTH) -> float:
    """Root mean square of the current error on the held-out run [A]."""
    residual = gms.compare(plant, runs.validate, bandwidth=bandwidth).records[0].residual
    return float(np.sqrt(np.mean(residual**2)))


def map_harmonics(file: Path, most: int) -> list[int]:
    """The strongest harmonics per revolution of a map of the drive, up to 48 (the counts themselves repeat faster)."""
    size = np.abs(np.fft.rfft(np.load(file, allow_pickle=False).ravel()))[:49]
    return [int(n) for n in 1 + np.argsort(-size[1:])[:most]]


def main() -> int:
    default = Path(os.environ.get("GMS_MUJOCO_DATA", "../shared/data")) / "odrive_cogging"
    data = Path(sys.argv[1]) if len(sys.argv) > 1 else default
    if not (data / LOGS[0]).is_file():
        print(f"no {LOGS[0]} in {data}: give the folder, or set GMS_MUJOCO_DATA")
        return 2
    runs = load(data)
    found = gms.diagnose(runs)
    print(f"{'held-out current error up to':36}{BANDWIDTH:.0f} Hz")
    for step in found.steps:
        name = "inertia, GMS friction, viscous drag" if step.effect is None else f"+ {step.effect}"
        print(f"{name:36}{held_out(step.result.plant, runs):.3f} A")
    if "cogging" not in found.plant:
        return 1
    cogging = found.plant["cogging"]
    harmonics, sizes = (np.atleast_1d(cogging.values[k]) for k in ("harmonics", "amplitude"))
    order = np.argsort(-sizes)
    print("harmonics found:     " + ", ".join(f"{harmonics[k]:.0f} ({sizes[k]:.2f} A)" for k in order))
    named = map_harmonics(data / "cogging_measure_final_a_16.npy", len(order))
    print("strongest in the map: " + ", ".join(map(str, named)))
    return 0


if __name__ == "__main__":
    sys.exit(main())
