"""diagnose: the hidden effect by its name, nothing on a healthy axis, and no name for what nobody knows."""

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from bench import HEALTHY, HIDDEN, LEVEL, SAMPLE_TIME, TORQUE_NOISE, UNKNOWN, J, dataset, runs, slow

from gms_mujoco import effects
from gms_mujoco.bench import run_loop
from gms_mujoco.compare import Comparison
from gms_mujoco.control import PID
from gms_mujoco.dataset import Dataset, load
from gms_mujoco.diagnose import diagnose
from gms_mujoco.diagnosis.findings import Diagnosis
from gms_mujoco.diagnosis.joint_fits import FORMS
from gms_mujoco.errors import DataError
from gms_mujoco.excitation import multisine
from gms_mujoco.fit import fit
from gms_mujoco.plant import Plant
from gms_mujoco.record import Record

KEYS = {"schema", "verdict", "noise_floor", "steps", "candidates", "next_experiment"}


@pytest.fixture(scope="module")
def found() -> dict[str, Diagnosis]:
    """One diagnosis per hidden effect; "" is the healthy axis."""
    return {name: diagnose(dataset(HEALTHY + HIDDEN[name] if name else HEALTHY), UNKNOWN) for name in ("", *HIDDEN)}


def _with(runs: Dataset, torque: np.ndarray, uses: tuple[str, ...] = ("fit", "validate")) -> Dataset:
    """The set with something on the torque that nobody knows of."""

    def changed(r: Record) -> Record:
        return replace(r, signals={**r.signals, "torque": r.torque + torque}) if r.use in uses else r

    return replace(runs, records=tuple(map(changed, runs.records)))


T = SAMPLE_TIME * np.arange(3000)


@pytest.mark.parametrize("name", HIDDEN)
def test_the_hidden_effect_is_named_and_brings_the_error_to_the_floor(found: dict[str, Diagnosis], name: str) -> None:
    d = found[name]
    assert [e.name for e in d] == [name] and d.verdict == "explained"
    first, last = d.steps[0].validate_error, d.steps[-1].validate_error
    assert last <= 1.3 * d.noise_floor < 0.5 * first
    for p in type(HIDDEN[name]).parameters:
        got, true = np.ravel(d.found[0].values[p.name])[0], np.ravel(HIDDEN[name].values[p.name])[0]
        if p.name == "phase":
            assert math.remainder(got - true, 2 * math.pi) == pytest.approx(0, abs=0.05)
        else:
            assert got == pytest.approx(true, rel=0.05)


@pytest.mark.parametrize("name", HIDDEN)
def test_what_was_found_has_its_numbers_and_intervals(found: dict[str, Diagnosis], name: str) -> None:
    table = found[name].to_dict()["steps"][1]["parameters"]
    free = {f"{name}.{p.name}": p.free for p in type(HIDDEN[name]).parameters}
    assert set(table) == set(free)
    for label, entry in table.items():
        assert entry["unit"] and (entry["ci95"] is not None) == free[label]
        if free[label]:
            low, high = entry["ci95"]
            assert low < entry["value"] < high


def test_a_healthy_axis_is_adequate(found: dict[str, Diagnosis]) -> None:
    d = found[""]
    assert d.verdict == "adequate" and not d.found and len(d.steps) == 1
    assert d.steps[0].validate_error <= 1.3 * d.noise_floor
    assert d.plant is d.baseline and d.next_experiment is None and not d.remainder


def test_two_effects_are_both_found() -> None:
    d = diagnose(dataset(HEALTHY + HIDDEN["cogging"] + HIDDEN["gravity"]), UNKNOWN)
    assert {e.name for e in d} == {"cogging", "gravity"} and d.verdict == "explained"
    errors = [s.result.error for s in d.steps]
    assert errors == sorted(errors, reverse=True)


def test_a_second_harmonic_is_one_more_element_and_no_new_effect() -> None:
    hidden = effects.Cogging(harmonics=[6, 14], amplitude=[0.2 * LEVEL, 0.1 * LEVEL], phase=[0.4, 1.0])
    d = diagnose(dataset(HEALTHY + hidden), UNKNOWN)
    assert [s.effect for s in d.steps] == [None, "cogging"] and d.verdict == "explained"
    assert set(d.found[0].harmonics) == {6.0, 14.0}
    assert "cogging" not in {c.effect for c in d.candidates}
    np.testing.assert_allclose(sorted(d.found[0].amplitude), [0.1 * LEVEL, 0.2 * LEVEL], rtol=0.05)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "size"), [("cogging", 0.25 * LEVEL), ("position_dependent_friction", 0.3)], ids=["magnets", "screw"]
)
def test_waves_on_a_slide_joint_are_found_with_their_pitch(name: str, size: float) -> None:
    """No number of them is whole there: a fit finds it."""
    pitch = 0.83
    hidden = effects.find(name)(harmonics=[2 * math.pi / pitch], amplitude=[size], phase=[0.7])
    d = diagnose(dataset(replace(HEALTHY, kind="slide") + hidden))
    assert d.verdict == "explained" and [e.name for e in d] == [name]
    (low, high), found = d.plant.uncertainty[f"{name}.harmonics"], d.found[0].values
    assert high - low < 0.01 * low and found["harmonics"][0] == pytest.approx(2 * math.pi / pitch, rel=2e-3)
    assert found["amplitude"][0] == pytest.approx(size, rel=0.05)


@pytest.mark.slow
def test_a_disturbance_that_is_periodic_in_time_gets_no_name() -> None:
    d = diagnose(_with(dataset(HEALTHY), 0.15 * LEVEL * np.sin(2 * np.pi * 12 * T)), UNKNOWN)
    assert d.verdict == "unexplained" and not d.found and d.steps[-1].validate_error > 1.3 * d.noise_floor
    said = float(d.remainder.split("periodic in time at ")[1].split(" Hz")[0])
    assert said == pytest.approx(12, abs=0.5)
    assert "a torque that is periodic in time, at 12 Hz, of up to" in d.remainder
    assert d.next_experiment and d.next_experiment.startswith("The axis at rest with the drive on, and then off")


@pytest.mark.parametrize(
    ("told", "verdict"), [(0.1, "adequate"), (0.3, "unexplained")], ids=["where nothing is seen", "anywhere"]
)
def test_what_new_records_leave_below_a_count_speaks_against_no_plant(
    monkeypatch: pytest.MonkeyPatch, told: float, verdict: str
) -> None:
    error = 0.3
    monkeypatch.setattr(Comparison, "error", error)
    monkeypatch.setattr(Comparison, "noise_floor", 0.1, raising=False)
    monkeypatch.setattr(Comparison, "determined", (told, 0.1))
    d = diagnose(dataset(HEALTHY, 2.0), UNKNOWN)
    assert d.verdict == verdict
    assert any("less than its encoder resolves" in note for note in d.notes) == (verdict == "adequate")


@pytest.mark.slow
def test_one_impact_gets_no_name() -> None:
    runs = dataset(HEALTHY)
    hit = np.where(np.abs(T - 1.7) < 0.003, 2 * LEVEL, 0.0)
    first = replace(runs, records=runs.records[:1])
    d = diagnose(replace(runs, records=(*_with(first, hit).records, *runs.records[1:])), UNKNOWN)
    assert not d.found and d.verdict in ("adequate", "unexplained")
    if d.verdict == "unexplained":
        assert "at one instant, 1.7 s in fit_0" in d.remainder


@pytest.mark.slow
def test_what_remains_beside_a_known_effect_is_said() -> None:
    line = 0.05 * LEVEL * np.sin(2 * np.pi * 12 * T)
    d = diagnose(_with(dataset(HEALTHY + HIDDEN["cogging"]), line), UNKNOWN)
    assert [e.name for e in d] == ["cogging"] and d.verdict == "partly_explained"
    assert "periodic in time at 1" in d.remainder


def test_select_records_must_agree() -> None:
    """An effect that helps where it is fitted and not where it is chosen is not added."""
    hidden, healthy = dataset(HEALTHY + HIDDEN["gravity"], select=True), dataset(HEALTHY, select=True)
    assert [e.name for e in diagnose(hidden, UNKNOWN)] == ["gravity"]
    mixed = replace(hidden, records=(*hidden.fit, *healthy.select, *hidden.validate))
    d = diagnose(mixed, UNKNOWN)
    assert not d.found and d.verdict == "unexplained"


def test_what_holds_for_the_fit_records_alone_is_said() -> None:
    """A rig that was put the other way up before the validate records has no gravity that a plant could have."""
    gravity = HIDDEN["gravity"]
    other = dataset(HEALTHY + gravity.replace(phase=gravity.values["phase"] + math.pi))
    runs = dataset(HEALTHY + gravity)
    d = diagnose(replace(runs, records=(*runs.fit, *other.validate)), UNKNOWN)
    assert [e.name for e in d] == ["gravity"] and d.verdict == "partly_explained"
    (said,) = (n for n in d.notes if n.startswith("The validate records contradict gravity"))
    before, after = (d.score.told(s.validate_error) for s in d.steps)
    assert f"{after} of them would be left, {before} without" in said
    assert d.steps[-1].validate_error > d.steps[0].validate_error > 2 * d.noise_floor


@pytest.mark.slow
def test_what_new_records_show_nothing_of_is_said() -> None:
    """A rig that has lost a good half of its weight is as far from the gravity of the fit records as from none."""
    gravity = HIDDEN["gravity"]
    other = dataset(HEALTHY + gravity.replace(amplitude=0.47 * gravity.values["amplitude"]))
    runs = dataset(HEALTHY + gravity)
    d = diagnose(replace(runs, records=(*runs.fit, *other.validate)), UNKNOWN)
    assert [e.name for e in d] == ["gravity"] and d.verdict == "partly_explained"
    before, after = (d.score.told(s.validate_error) for s in d.steps)
    assert f"The validate records show nothing of gravity ({before} without it, {after} with it)." in d.notes


@pytest.mark.slow
def test_validate_records_choose_nothing(found: dict[str, Diagnosis]) -> None:
    runs = dataset(HEALTHY + HIDDEN["cogging"])
    noise = np.random.default_rng(0).normal(0, LEVEL, 3000)
    other = diagnose(_with(runs, noise, uses=("validate",)), UNKNOWN)
    alone = diagnose(replace(runs, records=runs.fit), UNKNOWN)
    told = found["cogging"]
    for d in (other, alone):
        assert d.plant == told.plant and d.plant.uncertainty == told.plant.uncertainty
        assert [(s.effect, s.result.error, s.p_value) for s in d.steps][1:] == [
            (s.effect, s.result.error, s.p_value) for s in told.steps
        ][1:]
        assert [(c.effect, c.p_value) for c in d.candidates] == [(c.effect, c.p_value) for c in told.candidates]
    assert alone.verdict == told.verdict == "explained"
    assert other.steps[-1].validate_error > 10 * told.steps[-1].validate_error
    assert other.verdict == "partly_explained" and "of the records that were not fitted" in other.remainder
    assert all(s.validate_error is None for s in alone.steps)
    assert all(c.validate_error is None for c in alone.candidates)


@pytest.mark.parametrize("name", ["", *HIDDEN])
def test_the_dictionary_is_that_of_the_contract(found: dict[str, Diagnosis], name: str) -> None:
    table = found[name].to_dict()
    assert set(table) >= KEYS and table["schema"] == 1
    assert table["verdict"] in ("adequate", "explained", "partly_explained", "unexplained")
    floors = next(line.split()[-2:] for line in str(found[name]).splitlines() if line.startswith("noise floor"))
    assert floors == [f"{100 * table[key]:.2f}" for key in ("fit_noise_floor", "noise_floor")]
    first, *added = table["steps"]
    assert first["effect"] is None and {"fit_error", "validate_error"} <= set(first)
    for step in added:
        assert set(step) >= {"effect", "fit_error", "validate_error", "confusable_with", "parameters", "evidence"}
        assert step["evidence"].startswith(step["effect"]) and "%" in step["evidence"]
    for c in table["candidates"]:
        assert set(c) == {"effect", "validate_error", "p_value"} and 0 <= c["p_value"] <= 1
    tried = [c["effect"] for c in table["candidates"]]
    assert len(set(tried)) == len(tried) and not set(tried) & {s["effect"] for s in added}


@pytest.mark.parametrize("name", ["", *HIDDEN])
def test_effects_left_out_are_told_by_the_error_of_a_fit(found: dict[str, Diagnosis], name: str) -> None:
    """At the noise floor one parameter more changes hardly anything."""
    d = found[name]
    for c in d.candidates:
        assert c.validate_error == pytest.approx(d.steps[-1].validate_error, rel=0.1), c.effect


def test_it_starts_from_the_plant_that_is_given(found: dict[str, Diagnosis]) -> None:
    """A model that has the effect already is found adequate; its effect is part of the baseline."""
    hidden = HEALTHY + HIDDEN["gravity"]
    fitted = fit(hidden, runs(hidden)).plant
    d = diagnose(dataset(hidden), fitted)
    assert d.verdict == "adequate" and "gravity" in d.baseline
    assert d.steps[0].result.error <= 1.05 * found["gravity"].steps[-1].result.error


def test_printed_it_is_the_table_of_falling_errors(found: dict[str, Diagnosis]) -> None:
    d = found["cogging"]
    text = str(d)
    assert text.startswith("verdict: explained") and "+ cogging" in text and "noise floor" in text
    assert f"{100 * d.steps[-1].validate_error:.2f}" in text and d.steps[1].evidence in text


def test_progress_runs_forward_to_its_end() -> None:
    told: list[float] = []
    drag = Plant.axis(J) + effects.Viscous(coefficient=2e-4)
    d = diagnose(dataset(drag), Plant.axis(J) + effects.Viscous(), progress=lambda done, text: told.append(done))
    assert told == sorted(told) and told[0] >= 0 and told[-1] == 1.0
    assert d.verdict == "adequate"


@pytest.mark.slow
def test_a_weak_torque_is_found_at_the_noise_floor() -> None:
    """A drag of an eighth of the friction at 30 rad/s beside twenty times the noise: a few percent of what is left."""
    loud = 20 * TORQUE_NOISE
    drag = HEALTHY + effects.QuadraticDrag(coefficient=0.12 * LEVEL / 30**2)
    found, healthy = (diagnose(dataset(plant, torque_noise=loud), UNKNOWN) for plant in (drag, HEALTHY))
    assert [s.effect for s in found.steps] == [None, "quadratic_drag"] and found.verdict == "explained"
    assert found.steps[0].result.error < 1.2 * found.steps[0].result.floor
    assert healthy.verdict == "adequate" and len(healthy.steps) == 1


@pytest.mark.parametrize("delay", [0.0, *slow(1.5e-3)])
def test_a_controller_that_answers_the_noise_of_its_encoder_is_no_delay(delay: float) -> None:
    """What it asks for seems to come late where that noise is what is left; a torque that does is still found."""
    truth, records = HEALTHY + effects.Delay(time=delay) if delay else HEALTHY, []
    for use in ("fit", "validate"):
        for i, (low, high, size) in enumerate(((0.3, 2.0, 1.0), (0.5, 4.0, 0.3), (1.0, 8.0, 0.1))):
            reference = multisine(4000, SAMPLE_TIME, low, high, size, np.random.default_rng([0, i, len(use)]))
            loop = run_loop(
                truth, PID(J, SAMPLE_TIME, bandwidth=15.0), reference, SAMPLE_TIME, position=float(reference[0]),
                resolution=2 * np.pi / 4096, position_noise=4 * np.pi / 4096, torque_noise=TORQUE_NOISE, seed=i,
                name=f"{use} {i}", use=use,
            )  # fmt: skip
            records.append(loop)
    found = diagnose(Dataset(Path(), tuple(records), inertia=J), UNKNOWN)
    first = found.steps[1] if len(found.steps) > 1 else None
    assert (first is None) == (not delay)
    assert first is None or "delay" in (first.effect, *first.confusable_with)


def test_there_must_be_something_to_fit() -> None:
    runs = dataset(HEALTHY)
    with pytest.raises(DataError, match=r"a measurement set is expected first, .*; list given"):
        diagnose(list(runs.all))  # type: ignore[arg-type]
    with pytest.raises(DataError, match="no fit records"):
        diagnose(replace(runs, records=runs.validate))


@pytest.mark.parametrize("name", ["null", *slow("cogging", "asymmetric_friction", "delay")])
def test_practice_sets(practice: Path, name: str) -> None:
    """Axes that others simulated, with all their regimes; the truth stands beside the records."""
    truth = json.loads((practice / name / "truth.json").read_text())["effects"]
    d = diagnose(load(practice / name))
    assert [e.name for e in d][:1] == truth
    if not truth:
        assert d.verdict == "adequate"
    else:
        first, last = d.steps[0].validate_error, d.steps[-1].validate_error
        assert d.verdict in ("explained", "partly_explained") and last < 0.2 * first


@pytest.mark.slow
def test_an_axis_whose_friction_weakens_with_the_square_of_speed_is_healthy() -> None:
    gauss = HEALTHY.replace(HEALTHY["gms"].replace(static=7e-3, stribeck_velocity=3.0, stribeck_exponent=2.0))
    d = diagnose(dataset(gauss), UNKNOWN)
    assert d.verdict == "adequate"
    assert d.plant["gms"].stribeck_exponent == pytest.approx(2.0, rel=0.01)


@pytest.mark.slow
def test_a_drag_that_fades_while_the_axis_warms_up_is_named() -> None:
    warming = effects.ThermalDrift(viscous=2 * HEALTHY["viscous"].coefficient, time_constant=1.5)
    d = diagnose(dataset(HEALTHY + warming), UNKNOWN)
    assert [e.name for e in d] == ["thermal_drift"] and d.verdict == "explained"


@pytest.mark.slow
@pytest.mark.parametrize("form", [{}, {"gap": 0.02}], ids=["flexible_coupling", "backlash"])
def test_a_load_with_dry_friction_of_its_own_is_named_and_comes_back(form: dict[str, float]) -> None:
    kind = effects.Backlash if form else effects.FlexibleCoupling
    load = kind(inertia=0.5 * J, frequency=40.0, damping=0.15, deceleration=0.3 * LEVEL / (0.5 * J), **form)
    d = diagnose(dataset(HEALTHY + load), UNKNOWN)
    assert [e.name for e in d] == [load.name] and d.verdict == "explained"
    for name in ("inertia", "frequency", "deceleration", *form):
        assert d.plant[load.name].values[name] == pytest.approx(load.values[name], rel=0.05)


MODULATING = {
    "asymmetric_friction": effects.AsymmetricFriction(level=0.25),
    "position_dependent_friction": effects.PositionDependentFriction(harmonics=[3], amplitude=[0.3], phase=[0.5]),
    "thermal_drift": effects.ThermalDrift(amplitude=0.5, time_constant=1.5),
}
SCALES = {"speed": 1.0, "temperature_scale": 15.0}


@pytest.mark.slow
@pytest.mark.parametrize("name, form", [(name, form) for name in MODULATING for form in FORMS[name]], ids=str)
def test_every_form_of_what_modulates_friction_is_named(name: str, form: dict[str, float]) -> None:
    """Beside a temperature that was logged, which friction follows or does not, and by records at once or by a clock
    that goes on between them."""
    form = {k: v * SCALES.get(k, 1.0) for k, v in form.items()}
    hidden = HEALTHY + MODULATING[name].replace(**form)
    temperature = 35 + 25 * np.sin(np.linspace(0, 9, round(3.0 / SAMPLE_TIME)))
    measured = dataset(hidden, temperature=temperature)
    if form.get("anew"):
        later = (replace(r, time=r.time + 3600.0 * i) for i, r in enumerate(measured.records))
        measured = replace(measured, records=tuple(later))
    d = diagnose(measured, UNKNOWN)
    assert [e.name for e in d] == [name]
    found = {k: d.plant[name].values[k] for k in form}
    for scale in SCALES.keys() & form.keys():  # is found, all else is chosen
        assert found.pop(scale) == pytest.approx(form[scale], rel=0.1)
    assert found == {k: form[k] for k in found}
    assert ("by the temperature that was measured" in str(d)) == bool(form.get("temperature_scale"))
