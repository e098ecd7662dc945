"""Measured data for tests that want it: outside the project, found through the environment."""

import os
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent


def _folder(variable: str, default: str) -> Path:
    path = Path(os.environ.get(variable, ROOT / default)).resolve()
    if not path.is_dir():
        pytest.skip(f"no measured data at {path}; set {variable} to the folder that holds it")
    return path


@pytest.fixture(scope="session")
def data() -> Path:
    """Folder of data that others measured; skips where it is absent."""
    return _folder("GMS_MUJOCO_DATA", "../shared/data")


@pytest.fixture(scope="session")
def practice() -> Path:
    """Folder of practice sets with known hidden effects; skips where it is absent."""
    return _folder("GMS_MUJOCO_PRACTICE", "../shared/practice")


@pytest.fixture
def emps(data: Path, tmp_path: Path) -> Path:
    """The EMPS benchmark as a measurement set: fit on DATA_EMPS, validate on DATA_EMPS_PULSES."""
    record = (
        '[[record]]\nfile = "{}"\nuse = "{}"\n'
        'columns = {{ time = "t", torque = "vir", position = "qm" }}\nscale = {{ torque = 35.1507 }}\n'
    )
    files = {"fit": data / "emps/DATA_EMPS.mat", "validate": data / "emps/DATA_EMPS_PULSES.mat"}
    for file in files.values():
        if not file.exists():
            pytest.skip(f"no {file}")
    text = '[axis]\nkind = "slide"\n' + "".join(record.format(f.as_posix(), use) for use, f in files.items())
    (tmp_path / "dataset.toml").write_text(text)
    return tmp_path
