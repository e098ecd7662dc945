"""What tests share: measured data outside the project, found through the environment, and a small simulated set."""

import os
from pathlib import Path

import numpy as np
import pytest
import servos
from hypothesis import settings

from gms_mujoco import effects, threads
from gms_mujoco.dataset import load, save
from gms_mujoco.diagnose import diagnose
from gms_mujoco.diagnosis.findings import Diagnosis
from gms_mujoco.excitation import multisine
from gms_mujoco.plant import Plant
from gms_mujoco.simulate import simulate

# Nothing is timed: a first example imports what others have at hand, and machines are noisy.
settings.register_profile("untimed", deadline=None)
settings.load_profile("untimed")

ROOT = Path(__file__).resolve().parent.parent

# Of tests side by side each worker has a core: threads of several would wait for each other.
if "PYTEST_XDIST_WORKER" in os.environ:
    os.environ.setdefault(threads.VARIABLE, "1")


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


@pytest.fixture(scope="session")
def small_set(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A measurement set of a simulated axis with dry and viscous friction: one record to fit, one to validate."""
    folder = tmp_path_factory.mktemp("small_set")
    plant = Plant.axis(2.4e-5) + effects.find("coulomb")(coulomb=4e-3) + effects.find("viscous")(coefficient=2e-5)
    records = []
    for i, use in enumerate(("fit", "validate")):
        rng = np.random.default_rng(i)
        command = multisine(3000, 1e-3, 1.0, 40.0, 2e-2, rng)
        bench = {"resolution": 2 * np.pi / 1e6, "torque_noise": 2e-5, "seed": i}
        records.append(simulate(plant, command, 1e-3, name=use, use=use, **bench))
    save(folder, records, inertia=2.4e-5)
    return folder


@pytest.fixture(scope="session")
def servo_set(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A measurement set of a servo that closes its own position loop with a hidden delay; see `servos.bench`."""
    folder = tmp_path_factory.mktemp("servo_set")
    save(folder, servos.bench())
    return folder


@pytest.fixture(scope="session")
def servo_diagnosis(servo_set: Path) -> Diagnosis:
    """What is found in it."""
    return diagnose(load(servo_set))
