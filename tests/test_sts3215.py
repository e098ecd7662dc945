"""A real servo, from logs that others made of it: the figures of the preset, and the delay that comes first."""

import sys
import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import servos

from gms_mujoco.compare import compare
from gms_mujoco.dataset import Dataset
from gms_mujoco.diagnosis.search import Search
from gms_mujoco.fit import baseline
from gms_mujoco.identification.observe import observe
from gms_mujoco.identification.servo_observation import repeatability
from gms_mujoco.plant import Plant
from gms_mujoco.sampling import sample

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "examples"))
import sts3215


def test_the_preset_survives_its_file_and_mujoco(tmp_path: Path) -> None:
    plant = Plant.load("sts3215")
    assert plant.provenance["position_error_other_arm"] <= 0.019
    assert set(plant.covariance) == set(plant.uncertainty) and "source" in plant.provenance
    plant.save(tmp_path / "model.toml")
    assert Plant.load(tmp_path / "model.toml") == plant
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        settled = servos.in_mujoco(plant, servos.run(np.full(200, 0.6), gain=32.0))[-1]
    assert settled == pytest.approx(0.6, abs=0.05)


def test_servos_like_the_preset_go_together_as_its_fit_says() -> None:
    plant = Plant.load("sts3215")
    names = list(plant.covariance)
    scatter = np.array(list(plant.covariance.values()))
    said = scatter / np.sqrt(np.outer(np.diag(scatter), np.diag(scatter)))
    i, j = names.index("position_loop.stall_torque"), names.index("position_loop.electrical_drag")
    drawn = sample(plant, 300, 0, kinds=("controller", "mechanics"))
    pairs = np.log([[p["position_loop"].stall_torque, p["position_loop"].electrical_drag] for p in drawn])
    assert np.corrcoef(pairs.T)[0, 1] == pytest.approx(said[i, j], abs=0.15)


@pytest.fixture(scope="module")
def logs(data: Path) -> Dataset:
    if not (data / "sts3215").is_dir():
        pytest.skip(f"no {data / 'sts3215'}")
    return sts3215.load(data / "sts3215")


def test_the_measurement_repeats_as_well_as_its_readme_says(logs: Dataset) -> None:
    again = repeatability(logs.servos)
    assert again is not None and 0.005 < again <= 0.0118


def test_the_preset_simulates_the_arm_that_was_not_fitted(logs: Dataset) -> None:
    """0.019 rad; without delay the best friction laws leave 0.039, and the measurement repeats to 0.0118."""
    plant = Plant.load("sts3215")
    fitted, other = (compare(plant, runs).position_error for runs in (logs.fit, logs.validate))
    assert other <= 0.019
    assert other == pytest.approx(plant.provenance["position_error_other_arm"], rel=0.01)
    assert fitted == pytest.approx(plant.provenance["position_error"], rel=0.01)


@pytest.mark.slow
def test_delay_is_the_first_that_a_servo_lacks(logs: Dataset) -> None:
    """From the first 3 s of twelve runs; the error falls on the arm that was not fitted."""
    runs = [replace(r, **{k: getattr(r, k)[:300] for k in ("time", "goal", "powered", "position")})
            for r in logs.fit[::5]]  # fmt: skip
    search = Search(observe(runs), [], baseline(controller="position"), sts3215.TIED_TO_THE_PLACE)
    search.first(lambda done, message: None)
    assert search.add_one(lambda done, message: None)
    assert [s.effect for s in search.steps] == [None, "delay"]
    before, after = (compare(s.result.plant, logs.validate[::3]).error for s in search.steps)
    assert search.steps[1].p_value < 0.01 and after < before
