"""What the friction model of a ball-screw stage lacks: the EMPS benchmark, explained end to end.

    python examples/emps.py [FOLDER WITH DATA_EMPS.mat AND DATA_EMPS_PULSES.mat] [FOLDER FOR THE RESULTS]

The data are those of Janot, Gautier and Brunot (Data set and reference models of EMPS, 2019). The drive command is
logged in volts: force = gtau * vir. The plant is fitted on one trajectory; the other, with pulses of force on it,
decides nothing and is scored at the end.
"""

import os
import sys
import tempfile
from pathlib import Path

from gms_mujoco import cli

DATA = os.path.join(os.environ.get("GMS_MUJOCO_DATA", "../shared/data"), "emps")
LOGS = "DATA_EMPS.mat", "DATA_EMPS_PULSES.mat"
FORCE_PER_VOLT = 35.1507  # N/V, gtau

RECORD = """
[[record]]
file = "{file}"
use = "{use}"
columns = {{ time = "t", torque = "vir", position = "qm" }}
scale = {{ torque = {scale} }}
"""


def write(folder: Path, data: Path) -> Path:
    """A measurement set of the files where they lie."""
    text = '[axis]\nkind = "slide"\n'
    for name, use in zip(LOGS, ("fit", "validate"), strict=True):
        text += RECORD.format(file=(data / name).resolve().as_posix(), use=use, scale=FORCE_PER_VOLT)
    (folder / "dataset.toml").write_text(text)
    return folder


def main(data: str = DATA, results: str = "emps_diagnosis") -> int:
    if not (Path(data) / LOGS[0]).is_file():
        print(f"no {LOGS[0]} in {data}: give the folder, or set GMS_MUJOCO_DATA")
        return 2
    with tempfile.TemporaryDirectory() as folder:
        return cli.main(["diagnose", str(write(Path(folder), Path(data))), "-o", results])


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:3]))
