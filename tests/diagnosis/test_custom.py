"""A function as a candidate: what it is of the residual it takes, and nothing else passes."""

from dataclasses import replace

import numpy as np
import pytest
from bench import HEALTHY, LEVEL, UNKNOWN, dataset, runs

from gms_mujoco import effects
from gms_mujoco.diagnose import diagnose
from gms_mujoco.diagnosis.custom import column, name_of
from gms_mujoco.errors import DataError
from gms_mujoco.fit import observe
from gms_mujoco.plant import Plant


def hum(time, position, velocity):
    return np.sin(2 * np.pi * 12 * time)


def placebo(time, position, velocity):
    return np.sin(2 * np.pi * 7.3 * time)


@pytest.fixture(scope="module")
def diagnosed():
    whole = dataset(HEALTHY)
    shaken = [
        replace(r, signals={**r.signals, "torque": r.torque - 0.15 * LEVEL * hum(r.time, 0, 0)}) for r in whole.records
    ]
    return diagnose(replace(whole, records=tuple(shaken)), UNKNOWN, candidates=[hum, placebo])


def test_the_right_function_takes_the_error_on_records_that_decided_nothing(diagnosed):
    by_name = {c.effect: c for c in diagnosed.candidates}
    before = diagnosed.steps[-1].validate_error
    assert by_name["hum"].p_value < 1e-6 and by_name["hum"].validate_error < 0.3 * before
    assert by_name["placebo"].p_value > 0.01 and by_name["placebo"].validate_error > 0.95 * before


def test_a_function_is_scored_and_not_added(diagnosed):
    assert not diagnosed.found and diagnosed.verdict == "unexplained"
    share = float(diagnosed.notes[0].split("hum: takes ")[1].split(" %")[0])
    assert share > 70 and diagnosed.notes[0] in str(diagnosed)
    assert {c["effect"] for c in diagnosed.to_dict()["candidates"]} >= {"hum", "placebo"}


def test_the_column_of_a_function_is_that_of_the_effect_it_imitates():
    observations = observe(runs(HEALTHY), HEALTHY.inertia, 100.0)
    cogging = Plant.axis(1.0) + effects.Cogging(harmonics=[6], amplitude=[1.0], phase=[0.4])

    def teeth(time, position, velocity):
        return np.sin(6 * position + 0.4)

    ours = np.concatenate([o.replay(cogging) for o in observations])
    theirs = column(teeth, observations, HEALTHY)
    sign = np.sign(ours @ theirs)
    assert np.sqrt(np.mean((ours - sign * theirs) ** 2)) < 0.02 * np.sqrt(np.mean(ours**2))


@pytest.mark.parametrize(
    "given, said",
    [
        (lambda t, q, v: t[:-1], "one torque per sample"),
        (lambda t, q, v: np.where(t > 1, np.nan, t), "not a finite number at sample"),
        (lambda t, q, v: "much", "must give numbers"),
    ],
)
def test_what_is_no_torque_is_refused(given, said):
    with pytest.raises(DataError, match=said):
        column(given, observe(runs(HEALTHY), HEALTHY.inertia, 100.0), HEALTHY)


def test_it_is_called_by_its_name():
    assert name_of(hum) == "hum"
