"""Moments at which friction goes another way than its law says."""

import re
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from bench import GMS, HEALTHY, HIDDEN, LEVEL, UNKNOWN, dataset, fitted_sticking, run

from gms_mujoco.dataset import Dataset
from gms_mujoco.diagnose import diagnose
from gms_mujoco.diagnosis.moments import between, refit_between, unbent
from gms_mujoco.identification.linear_model import cross_validated
from gms_mujoco.identification.refine import refine

STATIC = 6e-3  # N m, so far above the level of sliding that a few elements slip back
KNOCK = 1.7  # s


@pytest.fixture(scope="module")
def found():
    return fitted_sticking(HEALTHY.replace(GMS.replace(static=STATIC, slips_back=1.0)), 1)


def test_records_are_cut_where_friction_goes_another_way(found):
    parts = between(found.misfit, found.vector)
    whole = {o.name: o for o in found.misfit.observations}
    assert len(parts) > len(whole) == len({o.name for o in parts})
    for name, o in whole.items():  # no sample twice
        t = np.concatenate([p.record.time for p in parts if p.name == name])
        assert np.all(np.diff(t) > 0) and np.isin(t, o.record.time).all() and len(t) > 0.5 * len(o.record)


def test_between_moments_the_plant_is_that_of_the_axis(found):
    misfit, x = refit_between(found.misfit, found.vector)
    bent, straight = (float(np.asarray(p["gms"].static)) / STATIC - 1 for p in (found.plant, misfit.plant(x)))
    assert abs(straight) < 0.01 and abs(straight) < 0.5 * abs(bent)
    assert np.sqrt(np.mean(misfit.residual(x) ** 2)) < 0.1 * np.sqrt(np.mean(found.misfit.residual(found.vector) ** 2))


def test_a_fit_is_told_as_that_between_moments_and_when_they_begin(found):
    assert len(cross_validated(found.misfit, found.vector).moments())
    parts = between(found.misfit, found.vector)
    cut = next(a for a, b in pairwise(parts) if a.name == b.name)
    straight, said = unbent(found)
    assert f"{cut.record.time[-1]:.2g}" in said and cut.name in said
    assert straight.misfit.observations == found.misfit.observations
    low, high = straight.plant.uncertainty["gms.static"]
    assert low < STATIC < high < 1.02 * low
    healthy = fitted_sticking(HEALTHY.replace(GMS.replace(static=STATIC)), 1)
    assert not len(cross_validated(healthy.misfit, healthy.vector).moments())
    assert unbent(healthy)[1] == "", "nothing of it is loud"


def test_where_more_is_missing_the_fit_is_that_of_whole_records():
    dragged = fitted_sticking(HEALTHY + HIDDEN["quadratic_drag"], 1)
    bare = refine(*dragged.misfit.onto(HEALTHY, dragged.vector))
    whole, said = unbent(bare)
    assert said == "" and whole.error == pytest.approx(bare.error, rel=1e-3)


def knocked(use: str) -> Dataset:
    """Runs of a healthy axis, one of which somebody touches for a moment."""
    records = dataset(HEALTHY, 4.0).records
    at = next(i for i, r in enumerate(records) if r.name == f"{use}_1")
    time, torque = records[at].time, records[at].signals["torque"]
    touch = np.where((time > KNOCK) & (time < KNOCK + 0.04), 2 * LEVEL, 0.0)
    felt = run(HEALTHY, torque + touch, 3, name=f"{use}_1", use=use)
    felt = replace(felt, signals={**felt.signals, "torque": felt.signals["torque"] - touch})
    return Dataset(Path(), (*records[:at], felt, *records[at + 1 :]), inertia=HEALTHY.inertia)


@pytest.mark.slow
def test_a_knock_in_records_that_are_fitted_is_told_and_counts_for_nothing_on_others():
    found = diagnose(knocked("fit"), UNKNOWN)
    assert found.verdict == "adequate" and found.remainder == ""
    assert abs(float(re.search(r"at ([0-9.]+) s in fit_1", found.notes[-1])[1]) - KNOCK) < 0.15


@pytest.mark.slow
def test_a_knock_in_records_that_are_not_fitted_is_no_part_of_the_axis_and_counts():
    found = diagnose(knocked("validate"), UNKNOWN)
    assert found.verdict == "unexplained" and not found.found and "not fitted" in found.remainder
