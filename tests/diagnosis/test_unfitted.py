"""What the fit records do not show is named as what to look for, and never added."""

from dataclasses import replace

import numpy as np
import pytest
from bench import HEALTHY, LEVEL, UNKNOWN, dataset, driven

from gms_mujoco import effects
from gms_mujoco.dataset import Dataset
from gms_mujoco.diagnose import diagnose


def without_fast(runs: Dataset, regimes: tuple[str, ...] = ("0", "1")) -> Dataset:
    """The set whose fit records are slow, and those that validate of all regimes."""
    return replace(runs, records=tuple(r for r in runs.records if r.use == "validate" or r.name[-1] in regimes))


@pytest.mark.slow
def test_an_effect_that_only_new_records_show_is_said_and_not_added() -> None:
    d = diagnose(without_fast(dataset(HEALTHY + effects.TorqueSaturation(limit=6 * LEVEL))), UNKNOWN)
    assert not d.found and d.verdict == "unexplained"
    assert d.steps[-1].result.error < 1.2 * d.fit_noise_floor
    assert "the fit records show no torque_saturation, but" in d.remainder
    assert d.next_experiment is not None and "validate_2 shows what the fit records do not" in d.next_experiment


def test_a_plant_that_the_fit_records_do_not_determine_is_no_missing_effect() -> None:
    d = diagnose(without_fast(dataset(HEALTHY), ("0",)), UNKNOWN)
    assert not d.found and "those that were fitted do not tell all parameters" in d.remainder


@pytest.mark.slow
def test_what_is_no_effect_gets_no_name_in_new_records_either() -> None:
    runs = dataset(HEALTHY)
    wave = 0.3 * LEVEL * np.sin(2 * np.pi * 12 * runs.records[0].time)
    runs = replace(runs, records=tuple(driven(r, r.torque + wave) if r.use == "validate" else r for r in runs.records))
    d = diagnose(runs, UNKNOWN)
    assert not d.found and d.verdict == "unexplained" and "the fit records show no" not in d.remainder
