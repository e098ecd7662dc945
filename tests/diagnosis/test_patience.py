"""A search ends within the work that it may take, with what it has found, and says so."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import scipy
from bench import HEALTHY, HIDDEN, LEVEL, SAMPLE_TIME, UNKNOWN, dataset

from gms_mujoco import effort
from gms_mujoco.diagnose import diagnose
from gms_mujoco.diagnosis import patience
from gms_mujoco.diagnosis.patience import Patience
from gms_mujoco.errors import ModelError
from gms_mujoco.fit import fit_observations
from gms_mujoco.identification.misfit import Misfit
from gms_mujoco.identification.observe import observe
from gms_mujoco.record import Record

TWO = HEALTHY + HIDDEN["cogging"] + HIDDEN["gravity"]


def test_it_is_counted_in_replays_of_the_first_plant(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(patience, "_LEAST", 0)
    first = fit_observations(UNKNOWN, observe(dataset(HEALTHY).fit, HEALTHY.inertia))
    with effort.counted() as spent:
        limit = Patience(0.01, spent)
        limit.begin(first)
        for n in range(65):
            # What tells the size of one is one more.
            assert (limit.is_short, limit.is_at_end) == (n >= 30, n >= 60), n
            assert limit.cut == (n >= 30)
            Misfit(first.plant, first.misfit.observations).cost(first.vector)


def test_what_is_little_is_counted_as_more() -> None:
    records = [r.slice(0, 300) for r in dataset(HEALTHY).fit]
    first = fit_observations(UNKNOWN, observe(records, HEALTHY.inertia))
    with effort.counted() as spent:
        limit = Patience(1.0, spent)
        limit.begin(first)
        spent.add(3000 * patience._LEAST - spent.spent)
        assert not limit.is_short
        spent.add(1)
        assert limit.is_short and not limit.is_at_end


def test_without_a_limit_nothing_is_left_out() -> None:
    first = fit_observations(UNKNOWN, observe(dataset(HEALTHY).fit, HEALTHY.inertia))
    with effort.counted() as spent:
        limit = Patience(math.inf, spent)
        limit.begin(first)
        spent.add(10**15)
        assert not (limit.is_short or limit.is_at_end or limit.cut)
    assert not Patience().is_at_end


@pytest.mark.slow
def test_one_look_is_taken_however_little_it_may_take_and_what_was_left_out_is_said() -> None:
    """A cogging beside a torque that nothing explains: it takes less than half of what is missing."""
    runs, rng = dataset(HEALTHY + HIDDEN["cogging"]), np.random.default_rng(1)
    band = scipy.signal.butter(2, [5, 40], "band", fs=1 / SAMPLE_TIME, output="sos")

    def disturbed(r: Record) -> Record:
        odd = scipy.signal.sosfiltfilt(band, rng.standard_normal(len(r)))
        return replace(r, signals={**r.signals, "torque": r.torque + 0.2 * LEVEL * odd / odd.std()})

    records = tuple(map(disturbed, runs.records))
    hasty = diagnose(replace(runs, records=records), UNKNOWN, effort=1e-6)
    assert [e.name for e in hasty] == ["cogging"]
    assert hasty.verdict == "partly_explained"
    assert "limit of its work" in hasty.notes[-1] and "effort = 4e-06" in hasty.notes[-1]


@pytest.mark.slow
def test_what_has_taken_most_of_what_was_left_is_gone_on_from_however_little_that_may_take() -> None:
    for given in (1.0, 1e-6):
        found = diagnose(dataset(TWO), UNKNOWN, effort=given)
        assert sorted(e.name for e in found) == ["cogging", "gravity"] and found.verdict == "explained"
        assert not any("limit" in note for note in found.notes)


@pytest.mark.parametrize("given", [0.0, -1.0, math.nan, "2"])
def test_an_effort_that_is_none_is_refused(given: Any) -> None:
    with pytest.raises(ModelError, match="effort must be positive"):
        diagnose(dataset(HEALTHY), UNKNOWN, effort=given)
