"""A function as a candidate: what it is of the residual it takes, and nothing else passes."""

from dataclasses import replace

import numpy as np
import pytest
from bench import HEALTHY, HIDDEN, LEVEL, UNKNOWN, dataset, runs

from gms_mujoco import effects
from gms_mujoco.diagnose import diagnose
from gms_mujoco.diagnosis.conclusion import _to_write
from gms_mujoco.diagnosis.custom import Scored, column, expect_torques, named, scored
from gms_mujoco.diagnosis.findings import Rejected
from gms_mujoco.errors import DataError
from gms_mujoco.fit import fit, observe
from gms_mujoco.plant import Plant
from gms_mujoco.sweep import stepped_sine


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
    theirs = column("teeth", teeth, observations, HEALTHY)
    sign = np.sign(ours @ theirs)
    assert np.sqrt(np.mean((ours - sign * theirs) ** 2)) < 0.02 * np.sqrt(np.mean(ours**2))


@pytest.mark.parametrize(
    "given, said",
    [
        (lambda t, q, v: t[:-1], "one torque per sample"),
        (lambda t, q, v: np.where(t > 1, np.nan, t), "not a finite number at sample"),
        (lambda t, q, v: "much", "must give numbers; 'much' given"),
        (lambda t, q, v: np.exp(1j * q), "must give real numbers; complex ones given"),
        (lambda t, q: q, "candidate mine ends in TypeError .*; expected is a function"),
        (lambda t, q, v: {}["x"], "candidate mine ends in KeyError"),
    ],
)
def test_what_is_no_torque_is_refused_by_its_name_before_the_search(given, said):
    with pytest.raises(DataError, match=said):
        expect_torques({"mine": given}, runs(HEALTHY))
    with pytest.raises(DataError, match=said):
        column("mine", given, observe(runs(HEALTHY), HEALTHY.inertia, 100.0), HEALTHY)


@pytest.mark.parametrize(
    "given, said",
    [
        (hum, r"as a list, as in \[function\]; hum given"),
        ("cogging", "as a list, .*; 'cogging' given"),
        ([3], "a candidate is a function .*; 3 among them"),
        ([effects.Cogging], "a candidate is a function .*; Cogging among them"),
        ([effects.Cogging()], "a candidate is a function .*; Cogging among them"),
        ([hum, hum], "candidate hum is called as another candidate is"),
        ({"cogging": hum}, "candidate cogging is called as an effect of the catalogue is"),
    ],
)
def test_what_is_no_list_of_functions_with_names_of_their_own_is_refused(given, said):
    with pytest.raises(DataError, match=said):
        diagnose(dataset(HEALTHY), UNKNOWN, candidates=given)


def test_a_candidate_is_called_by_its_function_or_as_it_was_named_and_lambdas_are_numbered():
    assert list(named([hum, lambda t, q, v: q, lambda t, q, v: v])) == ["hum", "lambda 2", "lambda 3"]
    assert named({"my hum": hum}) == {"my hum": hum}


@pytest.mark.parametrize("size", [1e-200, 1e160])
def test_the_strength_of_a_function_does_not_matter(size):
    found = fit(HEALTHY, runs(replace(HEALTHY, effects=(*HEALTHY.effects, HIDDEN["cogging"]))))
    given = {"teeth": lambda t, q, v: np.sin(6 * q + 0.4)}
    given["as strong"] = lambda t, q, v: size * given["teeth"](t, q, v)
    one, other = scored(given, found, [], None)
    assert one.gain > 0.5 and other.gain == pytest.approx(one.gain) and other.p_value == pytest.approx(one.p_value)


def test_a_function_is_scored_on_the_steady_motion_of_responses():
    frequency = np.geomspace(5, 100, 8)
    stiff = HEALTHY + effects.Spring(stiffness=0.3)
    frfs = [stepped_sine(stiff, frequency, u) for u in (3e-4, 3e-3)]
    seen = observe(frfs, HEALTHY.inertia)

    def spring(time, position, velocity):
        return position

    ours, theirs = column("spring", spring, seen, HEALTHY), np.concatenate(
        [o.replay(Plant.axis(1.0) + effects.Spring(stiffness=1.0)) for o in seen]
    )
    assert ours == pytest.approx(-theirs, rel=1e-9, abs=1e-12 * np.abs(theirs).max())
    assert not column("hum", hum, seen, HEALTHY).any()  # nobody knows its phase
    with pytest.raises(DataError, match=r"candidate hum gives no torque along .* time is NaN"):
        expect_torques({"hum": hum}, frfs)
    expect_torques({"spring": spring}, frfs)
    expect_torques({"hum": hum}, [*frfs, *runs(HEALTHY)])


def test_records_and_responses_are_scored_together():
    ill = HEALTHY + HIDDEN["cogging"]
    frfs = [stepped_sine(ill, np.geomspace(5, 100, 8), u) for u in (3e-4, 3e-3)]
    whole = replace(dataset(ill), frfs=(frfs[0], replace(frfs[1], use="validate")))
    teeth = {"mine": lambda t, q, v: np.sin(6 * q + 0.4)}
    found = diagnose(whole, HEALTHY, candidates=teeth, without=list(effects.CATALOGUE))
    before, [mine] = found.steps[-1].validate_error, [c for c in found.candidates if c.effect == "mine"]
    assert mine.p_value < 1e-6 and mine.validate_error < 0.5 * before
    assert "mine, a candidate of yours, came closest" in found.next_experiment


def test_a_candidate_that_comes_closer_than_anything_known_is_to_be_written():
    mine, chance = Scored("mine", 0.85, 1e-6, 0.3), Scored("chance", 0.01, 0.4, 0.99)
    said = _to_write([Rejected("delay", 0.01)], [chance, mine], 1.0)
    assert "mine, a candidate of yours, came closest, with 85 %" in said
    assert not _to_write([Rejected("delay", 1e-9)], [mine], 1.0)
    assert not _to_write([], [chance], 1.0)
