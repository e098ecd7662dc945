"""What is in no catalogue and explains more than an effect that resembles it."""

import re
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from bench import GMS, HEALTHY, LEVEL, UNKNOWN, J, dataset, driven, runs, slow, worn

from gms_mujoco import effects
from gms_mujoco.bench import run_loop
from gms_mujoco.dataset import Dataset
from gms_mujoco.diagnose import diagnose
from gms_mujoco.diagnosis.beyond import beyond
from gms_mujoco.diagnosis.history import following
from gms_mujoco.diagnosis.judgement import Trial
from gms_mujoco.effect import Effect
from gms_mujoco.fit import fit_observations
from gms_mujoco.fit_result import FitResult
from gms_mujoco.identification.inverse import Observation
from gms_mujoco.identification.linear_model import cross_validated
from gms_mujoco.identification.observe import observe
from gms_mujoco.parameter import Parameter
from gms_mujoco.record import Record

COGGING = effects.Cogging(harmonics=[13], amplitude=[0.2 * LEVEL], phase=[0.4])
PLACED = effects.PositionDependentFriction(harmonics=[6], amplitude=[0.3], phase=[0.4])
DRIFT = effects.ThermalDrift(amplitude=0.3, time_constant=1.0)
ECCENTRIC = effects.EncoderEccentricity(amplitude=0.1, phase=0.7)
COUPLED = effects.FlexibleCoupling(inertia=0.3 * J, frequency=40.0, damping=0.1)
SATURATED = effects.TorqueSaturation(limit=6 * LEVEL)


def _uneven(r: Record, share: float = 0.2, harmonic: int = 1) -> Record:
    """The record of an axis whose inertia varies, which goes the same way under another torque."""
    o = Observation(r, 100.0)
    q, v = o.position, o.velocity
    wave, slope = np.cos(harmonic * q + 0.4), -harmonic * np.sin(harmonic * q + 0.4)
    return driven(r, r.torque + share * J * (wave * np.gradient(v, r.time) + slope * v**2 / 2))


def _weak(r: Record) -> Record:
    """The record of a drive that gives u / (1 + u / 50 L) where u is asked for, a fifth less at 12 levels L."""
    return driven(r, r.torque / (1 - np.abs(r.torque) / (50 * LEVEL)))


def _dead(r: Record) -> Record:
    """The record of a drive that leaves out the first third of L."""
    return driven(r, r.torque + np.sign(r.torque) * LEVEL / 3)


def _at_its_voltage(r: Record, most: float, fastest: float) -> Record:
    """The record of a drive that was asked for a torque, whose largest falls from one at rest to none at a velocity."""
    row = iter(r.torque)

    def drive(seen: np.ndarray) -> float:
        falls = most * seen[6] / fastest
        return float(np.clip(next(row), -most - falls, most - falls))

    rest = np.full(len(r), r.position[0])
    moved = run_loop(HEALTHY, drive, rest, r.sample_time, position=r.position[0], resolution=r.resolution)
    return replace(moved, name=r.name, signals={**moved.signals, "torque": r.torque})


def _sagging(r: Record) -> Record:
    """The record of a drive whose supply gives way, by a fifth at 1000 L W."""
    power = np.maximum(r.torque * Observation(r, 100.0).velocity, 0)
    return driven(r, r.torque / (1 - 0.2 * power / (1000 * LEVEL)))


def _rippling(r: Record) -> Record:
    """The record of a drive whose torque constant goes by a tenth to either side, six times in a revolution."""
    return driven(r, r.torque / (1 + 0.1 * np.sin(6 * Observation(r, 100.0).position + 0.3)))


def _growing(r: Record) -> Record:
    """The record of an axis with 13 waves to a revolution that grow with the speed."""
    o = Observation(r, 100.0)
    return driven(r, r.torque + 0.04 * LEVEL * np.abs(o.velocity) * np.sin(13 * o.position + 0.3))


def _cooling() -> list[Record]:
    """Records of an axis whose friction is a fifth less in the last."""
    less = GMS.replace(coulomb=0.8 * GMS.coulomb, static=0.8 * GMS.static, stiffness=0.8 * np.asarray(GMS.stiffness))
    return [*runs(HEALTHY)[:2], runs(HEALTHY.replace(less))[2]]


def _fading(r: Record, share: float) -> Record:
    """The record of a motor that gives so much less than is asked for."""
    return driven(r, r.torque / (1 - share))


def _heated(r: Record) -> Record:
    """The record of a motor whose torque constant falls by 30 %, over a heat of (4 L)^2 s."""
    heat = np.cumsum(r.torque**2) * r.sample_time / (4 * LEVEL) ** 2
    return driven(r, r.torque / (0.7 + 0.3 * np.exp(-heat)))


def _ringed(r: Record, share: float = 0.3, grip: float = 100.0) -> Record:
    """The record of an axis with a ring of 30 % of its inertia, that lets slip at 100 rad/s^2."""
    v = Observation(r, 100.0).velocity
    (ring,) = following([v], [r.sample_time], np.array([grip]))
    return driven(r, r.torque + share * J * np.gradient(ring[:, 0], r.time))


class Slew(Effect):
    """A drive whose torque changes by no more than a rate."""

    name = "slew"
    kind = "drive"
    doc = signature = experiment = "A slew limit."
    parameters = (Parameter("rate", "N m/s", lower=0.0),)

    def deliver(self, time: np.ndarray, command: np.ndarray) -> np.ndarray:
        (out,) = following([command], [time[1] - time[0]], np.array([float(self.values["rate"])]))  # type: ignore[arg-type]
        return np.asarray(out[:, 0])


def _trial(effect: Effect, records: list[Record]) -> tuple[FitResult, Trial]:
    """The fit of a plant that has everything but the effect, and the one with it."""
    now = fit_observations(UNKNOWN, observe(records, J))
    result = fit_observations(UNKNOWN + effect, now.misfit.observations)
    return now, Trial(effect.name, result, cross_validated(result.misfit, result.vector))


def _said(effect: Effect, records: list[Record]) -> str:
    now, trial = _trial(effect, records)
    hint = beyond(now, cross_validated(now.misfit, now.vector), trial)
    return hint.said if hint else ""


@pytest.mark.parametrize("harmonic", [1, 2])
def test_an_inertia_that_varies_is_no_eccentric_encoder(harmonic: int) -> None:
    said = _said(ECCENTRIC, [_uneven(r, harmonic=harmonic) for r in runs(HEALTHY)])
    assert said.startswith("an inertia that varies along the revolution, by 20 % to either side")
    assert f"most of it {harmonic} to a revolution" in said


def test_a_torque_constant_that_falls_is_no_saturation() -> None:
    said = _said(SATURATED, [_weak(r) for r in runs(HEALTHY)])
    assert said.startswith("a torque constant that falls with the torque")


@pytest.mark.parametrize("effect", [effects.CurrentLoopLag(time=1e-4), effects.AsymmetricFriction(level=0.1)])
def test_a_drive_with_a_dead_zone_is_told_with_its_width(effect: Effect) -> None:
    said = _said(effect, [_dead(r) for r in runs(HEALTHY)])
    told = re.match("a drive with a dead zone, that leaves out the first (.*) N m", said)
    assert told is not None and float(told[1]) == pytest.approx(LEVEL / 3, rel=0.2)


def test_a_largest_torque_that_falls_with_the_speed_is_told_with_its_line() -> None:
    fastest = max(float(np.abs(np.gradient(r.position, r.time)).max()) for r in runs(HEALTHY))
    said = _said(SATURATED, [_at_its_voltage(r, 8 * LEVEL, fastest) for r in runs(HEALTHY)])
    told = re.match("a drive whose largest torque falls with the speed, from about (.*) N m at rest to none at about "
                    "(.*) rad/s, as", said)  # fmt: skip
    assert told is not None
    assert [float(x) for x in told.groups()] == pytest.approx([8 * LEVEL, fastest], rel=0.2)


def test_a_largest_torque_that_is_the_same_at_all_speeds_is_a_saturation() -> None:
    limited = HEALTHY + effects.TorqueSaturation(limit=5 * LEVEL)
    assert _said(SATURATED, runs(limited)) == ""


@pytest.mark.parametrize("effect", [effects.TorqueOffset(torque=0.1 * LEVEL), effects.AsymmetricFriction(level=0.1)])
def test_a_drive_that_gives_more_to_one_side_is_neither_an_offset_nor_friction(effect: Effect) -> None:
    said = _said(effect, [driven(r, r.torque / (1 - 0.1 * np.sign(r.torque))) for r in runs(HEALTHY)])
    told = re.match("a torque constant that is (.*) % smaller for positive torques,", said)
    assert told is not None and float(told[1]) == pytest.approx(18, abs=1)


@pytest.mark.parametrize("effect", [effects.TorqueOffset(torque=0.1 * LEVEL), effects.AsymmetricFriction(level=0.1)])
def test_an_offset_and_friction_are_no_drive_that_gives_more_to_one_side(effect: Effect) -> None:
    assert _said(effect, runs(HEALTHY + effect)) == ""


def test_a_supply_that_sags_is_no_saturation() -> None:
    said = _said(SATURATED, [_sagging(r) for r in runs(HEALTHY)])
    assert said.startswith("a torque constant that falls with the power that is drawn")


def test_a_slew_limit_is_no_saturation() -> None:
    said = _said(SATURATED, runs(HEALTHY + Slew(rate=200 * LEVEL)))
    told = re.match("a drive whose torque changes by no more than about (.*) N m/s,", said)
    assert told is not None and float(told[1]) == pytest.approx(200 * LEVEL, rel=0.3)


DRIVES = [effects.CurrentLoopLag(time=1e-3), effects.Delay(time=1.5e-3), SATURATED]


@pytest.mark.slow
@pytest.mark.parametrize("first", range(3))
def test_two_effects_of_a_drive_are_no_slew_limit_that_leaves_less_than_the_first(first: int) -> None:
    hidden = [d for i, d in enumerate(DRIVES) if i != first]
    for effect in hidden:
        assert _said(effect, runs(HEALTHY + hidden[0] + hidden[1])) == ""


@pytest.mark.slow
def test_a_motor_that_fades_over_a_session_is_no_drift_in_each_record() -> None:
    records = [_fading(r, share) for r, share in zip(runs(HEALTHY), (0.0, 0.05, 0.1), strict=True)]
    said = _said(DRIFT, records)
    told = re.match(r"a torque constant that is another in each record, -(.*) % in (\S+) beside (\S+),", said)
    assert told is not None
    assert told.groups()[1:] == (records[2].name, records[0].name)
    assert float(told[1]) == pytest.approx(10, abs=1.5)


@pytest.mark.slow
def test_a_motor_that_heats_up_in_each_record_is_no_friction_that_drifts() -> None:
    said = _said(DRIFT, [_heated(r) for r in runs(HEALTHY)])
    told = re.match(r"a torque constant that falls as the torque heats the motor .* of a record, by (.*) %,", said)
    assert told is not None and float(told[1]) == pytest.approx(28, abs=3)


@pytest.mark.slow
def test_friction_that_runs_in_over_the_way_does_not_drift_in_time() -> None:
    said = _said(DRIFT, [worn(r) for r in runs(HEALTHY)])
    told = re.match(r"friction that falls over the way in the course of a record, by (.*) %,", said)
    assert told is not None and float(told[1]) == pytest.approx(33, abs=7)


@pytest.mark.slow
def test_a_body_that_friction_carries_along_is_no_coupling() -> None:
    said = _said(COUPLED, [_ringed(r) for r in runs(HEALTHY)])
    told = re.match(r"a body of (.*) % of the inertia, that friction carries along and lets slip,", said)
    assert told is not None and float(told[1]) == pytest.approx(30, abs=3)


@pytest.mark.slow
def test_friction_that_is_another_in_each_record_is_no_drift_within() -> None:
    records = _cooling()
    said = _said(DRIFT, records)
    told = re.match(r"friction that is another in each record, (\S+) % in (\S+) beside the others,", said)
    assert told is not None and told[2] == records[2].name
    assert float(told[1]) == pytest.approx(-20, abs=3)


def test_a_torque_that_is_logged_late_in_one_record_is_told_with_its_record() -> None:
    """It seems to stand in one direction, at an instant, or periodic in time: in whatever that motion does."""
    records = runs(HEALTHY)
    for k, rows in ((0, 1), (2, -2)):
        shifted = [driven(r, np.roll(r.torque, rows if i == k else 0)) for i, r in enumerate(records)]
        told = re.match(r"a torque that acts \S+ ms, or (\S+) of its rows, (\S+) in (\S+) than in (.*), by",
                        _said(COGGING, shifted))
        assert told is not None and float(told[1]) == pytest.approx(abs(rows), rel=0.15)
        assert told.groups()[1:] == ("earlier" if rows > 0 else "later", records[k].name, "the others")


@pytest.mark.slow
@pytest.mark.parametrize("effect", [DRIFT, COGGING], ids=lambda e: e.name)
def test_all_friction_taken_from_the_records_but_one_explains_nothing(effect: Effect) -> None:
    """Whatever is left of so little torque is little too."""
    lacking = effects.Gravity(amplitude=0.5 * LEVEL, phase=0.3)
    assert not _said(effect, runs(HEALTHY + lacking))


def test_a_torque_that_is_periodic_in_time_is_no_cogging() -> None:
    records = [driven(r, r.torque + 0.3 * LEVEL * np.sin(2 * np.pi * 50 * r.time + k))
               for k, r in enumerate(runs(HEALTHY))]  # fmt: skip
    said = _said(COGGING, records)
    told = re.match(r"a torque that is periodic in time, at 50 Hz, of up to (\S+) N m", said)
    assert told is not None and float(told[1]) == pytest.approx(0.3 * LEVEL, rel=0.1)


def test_friction_that_pulsates_is_no_wave_over_the_place() -> None:
    def pulsing(r: Record, k: int) -> Record:
        friction = r.torque - J * np.gradient(Observation(r, 100.0).velocity, r.time)
        return driven(r, r.torque + 0.25 * np.sin(2 * np.pi * 7 * r.time + k) * friction)

    said = _said(PLACED, [pulsing(r, k) for k, r in enumerate(runs(HEALTHY))])
    told = re.match(r"friction that pulsates in time, at (\S+) Hz, by up to (\S+) %", said)
    assert told is not None and float(told[1]) == pytest.approx(7, abs=0.1)
    assert float(told[2]) == pytest.approx(25, abs=4)


def test_waves_that_grow_with_the_speed_are_no_cogging() -> None:
    said = _said(COGGING, [_growing(r) for r in runs(HEALTHY)])
    assert said.startswith("a torque in waves over the place that grows with the speed, 13 to a revolution")


@pytest.mark.parametrize("effect", [COGGING, *slow(PLACED)], ids=lambda e: e.name)
def test_a_torque_constant_that_ripples_is_neither_cogging_nor_friction(effect: Effect) -> None:
    said = _said(effect, [_rippling(r) for r in runs(HEALTHY)])
    told = re.match(r"a torque constant that ripples over the place, 6 to a revolution, by (\S+) %", said)
    assert told is not None and float(told[1]) == pytest.approx(10, rel=0.1)


@pytest.mark.parametrize("effect", [COGGING, ECCENTRIC], ids=lambda e: e.name)
def test_a_reading_that_errs_in_waves_is_neither_an_eccentric_encoder_nor_cogging(effect: Effect) -> None:
    def misread(r: Record) -> Record:
        q = r.position
        return replace(r, signals={**r.signals, "position": q + 0.03 * np.sin(3 * q + 0.3)})

    said = _said(effect, list(map(misread, runs(HEALTHY))))
    told = re.match(r"a position that is read with an error in waves over .*, 3 to a revolution, of (\S+) rad", said)
    assert told is not None and float(told[1]) == pytest.approx(0.03, rel=0.1)


@pytest.mark.parametrize("effect", [COGGING, *slow(PLACED, DRIFT, ECCENTRIC, SATURATED)], ids=lambda e: e.name)
def test_the_effect_itself_is_not_beaten(effect: Effect) -> None:
    assert not _said(effect, runs(HEALTHY + effect))


def test_a_torque_constant_that_comes_to_nothing_explains_nothing() -> None:
    """A torque that does not move the axis would all be explained by a drive that delivers none of it."""
    rng = np.random.default_rng(0)

    def idle(r: Record) -> Record:
        return driven(r, 3 * LEVEL * np.sin(2 * np.pi * rng.uniform(3, 8) * r.time))

    assert not _said(SATURATED, [idle(r) for r in runs(HEALTHY)])


@pytest.mark.slow
@pytest.mark.parametrize(("change", "said"), [(_uneven, "an inertia that varies"), (_weak, "a torque constant that")])
def test_a_diagnosis_names_no_effect_for_what_is_in_no_catalogue(
    change: Callable[[Record], Record], said: str
) -> None:
    sets = dataset(HEALTHY)
    d = diagnose(Dataset(sets.path, tuple(map(change, sets.records)), sets.kind, sets.inertia), UNKNOWN)
    assert not d.found and d.verdict == "unexplained"
    assert said in d.remainder
