"""A load that is logged and acts on the axis, and friction that grows with one that is not."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from bench import HEALTHY, LEVEL, SAMPLE_TIME, UNKNOWN, J, dataset, run

from gms_mujoco import effects
from gms_mujoco.compare import compare
from gms_mujoco.dataset import Dataset, load, save
from gms_mujoco.diagnose import diagnose
from gms_mujoco.diagnosis import given_load
from gms_mujoco.diagnosis.given_load import corrected_load
from gms_mujoco.errors import DataError
from gms_mujoco.excitation import multisine
from gms_mujoco.fit import fit
from gms_mujoco.identification.observe import loaded_by_drive
from gms_mujoco.record import Record


def _loaded(acts: float, uses: str = "fit fit validate") -> Dataset:
    """Runs beside a load of up to three levels, that acts on the axis so many times."""
    rng, n = np.random.default_rng(3), 3000

    def one(k: int, use: str) -> Record:
        torque = multisine(n, SAMPLE_TIME, 0.5, 20.0, (1.0 + 2 * k) * LEVEL, rng)
        weight = 1.5 * LEVEL * (1 + np.sin(2 * np.pi * 0.7 * SAMPLE_TIME * np.arange(n) + k))
        r = run(HEALTHY, torque + acts * weight, k, name=f"r{k}", use=use)
        return replace(r, signals={**r.signals, "torque": r.torque - acts * weight, "load": weight})

    records = [one(k, use) for k, use in enumerate(uses.split())]
    return Dataset(Path(), tuple(records), "hinge", J)


@pytest.mark.parametrize("sign", [1, -1])
def test_a_load_that_acts_is_counted_in_one_way_or_the_other(sign: int) -> None:
    runs = _loaded(sign)
    acting, said = corrected_load(runs, UNKNOWN)
    assert f"Add load_acts = {sign} to [axis]" in said
    for r, as_given in zip(acting.records, runs.records, strict=True):
        assert r.signals["rigid_torque"] == pytest.approx(-sign * as_given.signals["load"])


def test_a_load_that_only_presses_is_left_as_it_is() -> None:
    runs = _loaded(0)
    assert corrected_load(runs, UNKNOWN) == (runs, "")


def test_records_without_a_load_are_left_as_they_are() -> None:
    runs = _loaded(0)
    bare = [replace(r, signals={k: v for k, v in r.signals.items() if k != "load"}) for r in runs.records]
    runs = replace(runs, records=tuple(bare))
    assert corrected_load(runs, UNKNOWN) == (runs, "")


def test_a_set_says_that_its_load_acts(tmp_path: Path) -> None:
    save(tmp_path, _loaded(1).records, inertia=J)
    file = tmp_path / "dataset.toml"
    as_written = file.read_text()

    def with_key(value: str) -> Dataset:
        file.write_text(as_written.replace("[axis]", f"[axis]\nload_acts = {value}"))
        return load(tmp_path)

    for r in with_key("-1").records:
        assert r.signals["rigid_torque"] == pytest.approx(r.signals["load"])
    with pytest.raises(DataError, match=r"axis\.load_acts must be 1, .* or -1; 2 given"):
        with_key("2")


def test_a_load_that_acts_has_to_be_there(tmp_path: Path) -> None:
    save(tmp_path, [run(HEALTHY, np.full(200, 2 * LEVEL), name="r")])
    file = tmp_path / "dataset.toml"
    file.write_text(file.read_text().replace("[axis]", "[axis]\nload_acts = 1"))
    with pytest.raises(DataError, match=r"axis\.load_acts: no record has a load"):
        load(tmp_path)


GEARED = HEALTHY + effects.LoadDependentFriction(coefficient=0.15 / LEVEL)


@pytest.mark.slow
def test_friction_that_grows_with_the_torque_of_the_drive_needs_no_load_in_the_log() -> None:
    runs = dataset(GEARED)
    assert not any(r.get("load") is not None for r in runs.records)
    d = diagnose(runs, UNKNOWN)
    assert [e.name for e in d] == ["load_dependent_friction"] and d.verdict == "explained"
    assert "No load was logged" in d.steps[0].evidence and "torque of the drive" in d.steps[0].evidence
    assert float(np.asarray(d.found[0].coefficient)) == pytest.approx(0.15 / LEVEL, rel=0.1)
    assert compare(d.plant, runs.validate).torque_error == pytest.approx(d.steps[-1].validate_error, rel=0.02)


@pytest.mark.slow
def test_by_the_letter_of_its_law_friction_grows_with_the_torque_of_the_drive_too(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A level that falls as fast as the torque of the drive, where the usual reading of the law promises too little."""
    monkeypatch.setattr(given_load, "_PROMISES_MUCH", 1.0)
    d = diagnose(dataset(GEARED.replace(GEARED["gms"].replace(slips_back=1.0))), UNKNOWN)
    assert [e.name for e in d] == ["load_dependent_friction"] and d.plant["gms"].slips_back == 1
    before, after = d.steps
    assert after.result.error < 0.2 * before.result.error
    assert after.validate_error < 0.6 * before.validate_error  # by the letter noise decides when elements slip back


def test_a_fit_takes_the_torque_of_the_drive_where_no_load_was_logged() -> None:
    start = GEARED.replace(effects.LoadDependentFriction(coefficient=0.05 / LEVEL))
    found = fit(start, dataset(GEARED).fit)
    grows = found.plant["load_dependent_friction"].coefficient
    assert float(np.asarray(grows)) == pytest.approx(0.15 / LEVEL, rel=0.01)
    assert found.error < 1.2 * found.floor


def test_what_was_logged_as_a_load_is_kept() -> None:
    for r in _loaded(0).records:
        assert loaded_by_drive(r) is r
