"""Noise: what was put into a record is read out of it, and the floor is what the true plant leaves."""

from dataclasses import replace

import numpy as np
import pytest
from bench import COUNT, HEALTHY, HIDDEN, LEVEL, SAMPLE_TIME, TORQUE_NOISE, J, dataset, rms, run, runs
from hypothesis import given
from hypothesis import strategies as st
from scipy import signal

from gms_mujoco.effect import Effect
from gms_mujoco.effects import AsymmetricFriction, Backlash, Cogging, LoadDependentFriction
from gms_mujoco.excitation import multisine
from gms_mujoco.fit import fit
from gms_mujoco.identification.inverse import Observation
from gms_mujoco.identification.noise import (
    Noise,
    _growth,
    _room,
    _within,
    believable,
    choose_bandwidth,
    estimate_noise,
    floor_residual,
    hidden_residual,
    keeps_turns,
    refine_noise,
    rough_inertia,
    sensor_residual,
    simulated,
)
from gms_mujoco.plant import Plant
from gms_mujoco.record import Record

BARE = Plant.axis(J)
TORQUE, POSITION = 2e-4, 3e-6  # each visible in a part of the spectrum at 1 kHz


@pytest.mark.parametrize(("torque", "position"), [(TORQUE, POSITION), (TORQUE, 1e-8), (5e-6, 10 * POSITION)])
def test_white_noise_comes_back(torque: float, position: float) -> None:
    """Within 15 %; where one drowns the other, that one is bounded by it."""
    noise = estimate_noise(runs(BARE, torque_noise=torque, position_noise=position, resolution=None), J)
    most = {"torque": J * position / SAMPLE_TIME**2, "position": torque * SAMPLE_TIME**2 / J}  # of what drowns it
    if torque > most["torque"]:
        assert noise.torque == pytest.approx(torque, rel=0.15)
    if position > 0.3 * most["position"]:
        assert noise.position == pytest.approx(position, rel=0.15)
    assert noise.torque < 1.15 * torque + 0.3 * most["torque"]
    assert noise.position < 1.15 * position + 0.3 * most["position"]


def test_friction_only_adds_to_the_noise_of_the_torque() -> None:
    noise = estimate_noise(runs(HEALTHY, torque_noise=TORQUE, position_noise=POSITION, resolution=None), J)
    assert 0.9 * TORQUE < noise.torque < 1.6 * TORQUE
    assert noise.position == pytest.approx(POSITION, rel=0.25)


def test_quantisation_is_the_least_position_noise() -> None:
    noise = estimate_noise(runs(HEALTHY), J)
    assert noise.resolution == COUNT
    assert COUNT / np.sqrt(12) <= noise.position < 1.5 * COUNT / np.sqrt(12)


def test_the_noise_is_much_the_same_whatever_the_motion() -> None:
    """With friction in the spectrum, neither kind of noise takes all of it."""
    found = [estimate_noise(runs(HEALTHY, "validate", seed=seed), J) for seed in range(10)]
    assert min(n.torque for n in found) > 0.85 * TORQUE_NOISE and max(n.torque for n in found) < 1.6 * TORQUE_NOISE
    assert max(n.torque for n in found) < 1.5 * min(n.torque for n in found)


def test_no_noise_is_found_in_nothing() -> None:
    still = [replace(r, signals={"torque": 0 * r.time, "position": 0 * r.time}) for r in runs(BARE, resolution=None)]
    assert estimate_noise(still, J) == Noise(0.0, 0.0, 0.0)


def test_the_quiet_records_say_what_the_noise_is() -> None:
    quiet, loud = runs(BARE, torque_noise=TORQUE), runs(BARE, torque_noise=10 * TORQUE, seed=1)[:1]
    assert estimate_noise([*quiet, *loud], J).torque == pytest.approx(TORQUE, rel=0.2)


def test_records_of_several_rates_say_together_what_the_noise_is() -> None:
    """In the fastest that of the position drowns that of the torque; the others alone tell it."""
    records = []
    for seed, sample_time in enumerate((2.5e-4, 1e-3, 2e-3)):
        torque = multisine(round(3 / sample_time), sample_time, 0.5, 20.0, LEVEL, np.random.default_rng(seed))
        records.append(run(HEALTHY, torque, seed, sample_time, position_noise=5e-6))
    alone, together = (estimate_noise(r, J).torque for r in (records[:1], records))
    assert not 0.7 * TORQUE_NOISE < alone < 1.4 * TORQUE_NOISE
    assert together == pytest.approx(TORQUE_NOISE, rel=0.15)
    assert estimate_noise(records[::-1], J).torque == pytest.approx(together, rel=1e-6)


def test_a_residual_lowers_the_torque_noise_and_never_raises_it() -> None:
    records = runs(BARE, torque_noise=TORQUE)
    observations = [Observation(r, 60.0) for r in records]
    residuals = [o.applied(BARE) - o.needed(BARE) for o in observations]
    high, low = Noise(5 * TORQUE, 1e-9, COUNT), Noise(TORQUE / 5, 1e-9, COUNT)
    found = refine_noise(high, observations, residuals)
    assert found.torque == pytest.approx(TORQUE, rel=0.15) and replace(found, torque=high.torque) == high
    assert refine_noise(low, observations, residuals) == low


def test_rests_that_say_nothing_do_not_quieten_the_noise() -> None:
    """Where counts hide what friction does a residual is 0: in half of one record, and in all of another."""
    some, loud = [Observation(r, 100.0) for r in runs(HEALTHY, seconds=8)[:3]], Noise(1.0, 0.0, 0.0)
    rng = np.random.default_rng(0)
    left = [TORQUE * rng.standard_normal(len(o.index)) for o in some]
    rests = [left[0], left[1] * (np.arange(len(left[1])) % 512 < 256), 0 * left[2]]
    heard, in_part = (refine_noise(loud, some[: len(r)], r, 0.0).torque for r in (left[:2], rests))
    assert in_part == pytest.approx(heard, rel=0.1)
    assert refine_noise(loud, some, [0 * r for r in left], 0.0).torque == loud.torque


def test_rough_inertia_is_roughly_right() -> None:
    assert rough_inertia(runs(BARE)) == pytest.approx(J, rel=0.01)
    assert rough_inertia(runs(HEALTHY)) == pytest.approx(J, rel=0.3)
    n = np.arange(500)
    assert rough_inertia([Record("made", SAMPLE_TIME * n, {"torque": np.ones(500), "position": np.sin(n / 30)})]) > 0


def test_the_band_closes_as_the_position_gets_noisier() -> None:
    wide = [choose_bandwidth(runs(HEALTHY, position_noise=s, resolution=None)) for s in (0, 1e-5, 1e-3, 1e-2)]
    assert np.all(np.diff(wide) <= 0) and wide[-1] < wide[0] / 5
    assert wide[0] == pytest.approx(0.1 / SAMPLE_TIME)  # ten samples per period, at best


def test_the_band_ends_where_the_position_adds_as_much_as_is_allowed() -> None:
    records = runs(HEALTHY, position_noise=1e-3, torque_noise=0.0, resolution=None)
    band = choose_bandwidth(records, J)
    added = [
        Observation(replace(r, signals={**r.signals, "position": p}), band).acceleration * J
        for r, p in zip(records, np.random.default_rng(0).normal(0, 1e-3, (3, 3000)), strict=True)
    ]
    torque = np.sqrt(np.mean([rms(r.torque) ** 2 for r in records]))
    assert np.sqrt(np.mean([rms(a) ** 2 for a in added])) == pytest.approx(0.01 * torque, rel=0.25)


@pytest.mark.parametrize(
    "bench",
    [{}, {"torque_noise": TORQUE}, {"torque_noise": 0.0, "position_noise": POSITION, "resolution": None}],
    ids=["encoder and torque", "torque", "position"],
)
def test_the_floor_is_what_a_perfect_model_leaves(bench: dict) -> None:
    """On an axis without friction, where nothing but the sensors is in the way: within 15 %."""
    count = bench.get("resolution", COUNT) or 0.0
    noise = Noise(bench.get("torque_noise", TORQUE_NOISE), bench.get("position_noise", count / np.sqrt(12)), count)
    observations = [Observation(r, 100.0) for r in runs(BARE, seconds=6, **bench)]
    rng = np.random.default_rng(0)
    left = np.sqrt(np.mean([rms(o.applied(BARE) - o.needed(BARE)) ** 2 for o in observations]))
    floor = np.sqrt(np.mean([rms(floor_residual(o, BARE, None, noise, rng)) ** 2 for o in observations]))
    assert floor == pytest.approx(left, rel=0.15)


def _noisy(record: Record, size: float, seed: int) -> Record:
    noise = size * np.random.default_rng(seed).standard_normal(len(record))
    return replace(record, signals={**record.signals, "torque": record.torque + noise})


SHARE = 10 ** (-35 / 20)  # 35 dB below the torque


def test_noise_that_is_the_same_share_of_the_torque_in_each_record_is_told() -> None:
    quiet = runs(HEALTHY, torque_noise=0.0)
    records = [_noisy(r, SHARE * rms(r.torque), k) for k, r in enumerate(quiet)]
    found = fit(HEALTHY, records)
    assert found.noise.share == pytest.approx(SHARE, rel=0.1)
    assert [found.noise.torque_in(r) for r in records] == pytest.approx([SHARE * rms(r.torque) for r in quiet], rel=0.1)
    assert found.error == pytest.approx(found.floor, rel=0.15)


def test_noise_that_is_a_share_of_the_torque_is_told_behind_counts_that_drown_it() -> None:
    """At high frequencies u - J q'' shows the counts alone then, and the torque its noise."""
    quiet = runs(HEALTHY, torque_noise=0.0, resolution=300 * COUNT)
    records = [_noisy(r, 2 * SHARE * rms(r.torque), k) for k, r in enumerate(quiet)]
    noise = fit(HEALTHY, records).noise
    assert [noise.torque_in(r) for r in records] == pytest.approx([2 * SHARE * rms(r.torque) for r in quiet], rel=0.25)


def test_noise_that_is_a_share_of_the_torque_is_told_beside_a_record_within_a_count() -> None:
    quiet = [r for seed in (0, 1) for r in runs(HEALTHY, seed=seed, torque_noise=0.0, resolution=100 * COUNT)]
    still = replace(quiet[0], signals={**quiet[0].signals, "position": np.full(len(quiet[0]), quiet[0].position[0])})
    records = [_noisy(r, 2 * SHARE * rms(r.torque), k) for k, r in enumerate([still, *quiet[1:]])]
    assert fit(HEALTHY, records).noise.share == pytest.approx(2 * SHARE, rel=0.15)


def test_noise_that_is_a_share_of_the_torque_is_told_beside_a_record_that_stands_out() -> None:
    """What is left of a record is its noise at most: one of which something else is left says nothing against it."""
    quiet = [r for seed in (0, 1) for r in runs(HEALTHY, seed=seed, torque_noise=0.0)]
    records = [_noisy(r, (4 if k == 1 else 1) * SHARE * rms(r.torque), k) for k, r in enumerate(quiet)]
    assert fit(HEALTHY, records).noise.share == pytest.approx(SHARE, rel=0.1)


def test_noise_that_is_the_same_in_each_record_is_no_share_of_the_torque() -> None:
    noise = fit(HEALTHY, runs(HEALTHY, torque_noise=TORQUE)).noise
    assert noise.share == 0 and noise.torque_in(runs(HEALTHY)[0]) == noise.torque == pytest.approx(TORQUE, rel=0.15)


def test_what_a_plant_lacks_is_no_share_of_the_torque() -> None:
    """Of delayed torques something is left in each record that grows with the torque, but no noise."""
    assert fit(HEALTHY, runs(HEALTHY + HIDDEN["delay"])).noise.share == 0


def test_an_encoder_leaves_little_at_low_frequencies() -> None:
    """Twice differentiated, it has the spectrum of the fourth power of frequency, and so has the floor."""
    noise, rng = Noise(0.0, COUNT / np.sqrt(12), COUNT), np.random.default_rng(0)
    power = np.zeros((2, 65))
    for seed in range(3):
        for r in runs(BARE, "validate", seed=seed, torque_noise=0.0):
            o = Observation(r, 100.0)
            for row, x in zip(power, (o.applied(BARE) - o.needed(BARE), sensor_residual(o, BARE, None, noise, rng)),
                              strict=True):  # fmt: skip
                f, p = signal.welch(x, 1 / (o.stride * SAMPLE_TIME), nperseg=128)
                row += p
    for low, high in ((5, 15), (15, 40), (40, 90)):
        left, floor = power[:, (f > low) & (f < high)].sum(1)
        assert floor == pytest.approx(left, rel=0.35), (low, high)


@pytest.mark.parametrize("sample_time", [2e-3, 1e-3, 2.5e-4])
def test_the_true_axis_is_at_the_floor_at_every_sampling_rate(sample_time: float) -> None:
    """With friction that slips and reverses between the samples: within 10 %."""
    records = runs(HEALTHY, seconds=4, sample_time=sample_time, substeps=round(sample_time / 2e-5))
    noise = estimate_noise(records, J)
    observations = [Observation(r, 0.1 / sample_time) for r in records]
    noise = replace(noise, torque=TORQUE_NOISE)
    rng = np.random.default_rng(0)
    left = np.sqrt(np.mean([rms(o.applied(HEALTHY) - o.needed(HEALTHY)) ** 2 for o in observations]))
    floor = np.sqrt(np.mean([rms(floor_residual(o, HEALTHY, None, noise, rng)) ** 2 for o in observations]))
    assert floor == pytest.approx(left, rel=0.1)


@pytest.mark.parametrize("count", [1e-2, 3e-3, 3e-4])
def test_the_true_axis_is_at_the_floor_of_a_coarse_encoder(count: float) -> None:
    """Down to contacts that never bend by a whole count (these break away after 4e-3 to 2e-2 rad): within 15 %."""
    left, floor = [], []
    for seed in range(2):
        records = runs(HEALTHY, seconds=4, seed=seed, resolution=count)
        band = choose_bandwidth(records, J)
        noise = replace(estimate_noise(records, J), torque=TORQUE_NOISE)
        rng = np.random.default_rng(0)
        for o in (Observation(r, band) for r in records):
            left.append(rms(o.applied(HEALTHY) - o.needed(HEALTHY)))
            floor.append(rms(floor_residual(o, HEALTHY, None, noise, rng)))
    assert rms(np.array(floor)) == pytest.approx(rms(np.array(left)), rel=0.15)
    assert np.prod(np.array(floor) / left) ** (1 / 6) == pytest.approx(1, abs=0.15)


TURNS = HEALTHY + AsymmetricFriction(level=0.3)  # drops where it turns back, however briefly


def test_what_an_axis_does_between_samples_is_in_the_floor() -> None:
    """Friction that drops where the axis turns back for less than a sample, and the very plant: what it leaves is known
    before any of it is seen (`left` is None) to a half, and beside what is left to a quarter."""
    without, blind, floor, left = [], [], [], []
    for seed in range(4):
        records = runs(TURNS, seconds=6, seed=seed, substeps=100)
        noise, rng = replace(estimate_noise(records, J), torque=TORQUE_NOISE), np.random.default_rng(0)
        for o in (Observation(r, 100.0) for r in records):
            rest = o.applied(TURNS) - o.needed(TURNS)
            without.append(rms(sensor_residual(o, TURNS, None, noise, rng)))
            blind.append(rms(floor_residual(o, TURNS, None, noise, rng)))
            floor.append(rms(floor_residual(o, TURNS, None, noise, rng, rest)))
            left.append(rms(rest))
    assert rms(np.array(without)) < 0.6 * rms(np.array(left))
    assert 1 / 1.5 < rms(np.array(blind)) / rms(np.array(left)) < 1.5
    assert 0.75 < rms(np.array(floor)) / rms(np.array(left)) < 1.05


@given(st.integers(0, 2**32 - 1), st.floats(-1, 1), st.floats(0.1, 10), st.floats(0.1, 10))
def test_what_samples_hide_and_noise_fill_what_is_left(seed: int, alike: float, size: float, room: float) -> None:
    """Also where noise undoes a part of what they hide."""
    drawn, other, left = np.random.default_rng(seed).standard_normal((3, 100))
    hidden, left = size * (alike * drawn + other), room * left
    share = _room(drawn, hidden, left)
    assert 0 <= share <= 1
    if rms(drawn) <= rms(left) <= rms(drawn + hidden):
        assert rms(drawn + share * hidden) == pytest.approx(rms(left))
    elif rms(drawn) <= rms(left):
        assert share == 1
    else:
        assert rms(drawn + share * hidden) <= rms(drawn) * (1 + 1e-12)


def test_what_samples_hide_has_no_share_where_they_hide_nothing() -> None:
    assert _room(np.ones(3), np.zeros(3), 2 * np.ones(3)) in (0, 1)


@pytest.mark.parametrize(
    "effect",
    [
        Cogging(harmonics=[5], amplitude=[2e-3], phase=[0.3]),
        LoadDependentFriction(coefficient=0.3),
        Backlash(inertia=0.3 * J, gap=0.02, frequency=200.0, damping=0.2),
        AsymmetricFriction(level=0.3, stiffening=0.0, dropping=0.0),  # two yield limits: a constant torque
    ],
)
def test_samples_hide_nothing_where_a_turn_for_next_to_no_way_changes_nothing(effect: Effect) -> None:
    assert keeps_turns(TURNS.joint()) and not keeps_turns((HEALTHY + effect).joint())
    noise = Noise(TORQUE_NOISE, COUNT / np.sqrt(12), COUNT)
    for o in (Observation(r, 100.0) for r in runs(HEALTHY, seconds=2)):
        assert not hidden_residual(o, HEALTHY, None, simulated(o, HEALTHY, None, noise)).any()


def test_what_a_plant_lacks_is_not_hidden_between_samples() -> None:
    """Not the cogging that is missing beside friction that drops where it turns."""
    noise, hidden = Noise(TORQUE_NOISE, COUNT / np.sqrt(12), COUNT), []
    for lacks in (0.0, 2e-3):
        records = runs(TURNS + Cogging(harmonics=[5], amplitude=[lacks], phase=[0.3]), seconds=6, substeps=100)
        seen = [Observation(r, 100.0) for r in records]
        motions = [simulated(o, TURNS, None, noise) for o in seen]
        parts = [hidden_residual(o, TURNS, None, x) for o, x in zip(seen, motions, strict=True)]
        hidden.append(rms(np.concatenate(parts)))
        left = rms(np.concatenate([o.applied(TURNS) - o.needed(TURNS) for o in seen]))
    assert hidden[1] < 0.4 * left
    assert hidden[1] < 2 * hidden[0]


def test_counts_coarser_than_the_motion_are_not_taken_for_noise_of_the_torque() -> None:
    for count in (1e-2, 1e-3):
        records = runs(HEALTHY, resolution=count)
        assert estimate_noise(records, J).torque < 1.15 * TORQUE_NOISE
        assert choose_bandwidth(records, J) < 60


def test_without_noise_the_floor_is_what_the_replay_may_be_off() -> None:
    command = multisine(3000, 1e-3, 1, 50, 5e-3, np.random.default_rng(0))
    o = Observation(run(HEALTHY, command), 100.0)
    left = floor_residual(o, HEALTHY, None, Noise(0, 0, 0), np.random.default_rng(0))
    assert 0 < rms(left) < 5e-4 * rms(o.applied(HEALTHY))


def test_the_bench_of_these_tests_is_a_measurement_set() -> None:
    sets = dataset(HEALTHY, select=True)
    assert [len(x) for x in (sets.fit, sets.select, sets.validate)] == [3, 3, 3]


def test_what_grows_with_the_noise_is_the_floor_and_what_does_not_is_left_out() -> None:
    rng = np.random.default_rng(0)
    loud, turned = rng.standard_normal(640), np.where(np.arange(640) < 320, 5.0, 0.0)
    np.testing.assert_allclose(_growth(loud, loud / 4), 1.0)
    both = _growth(loud + turned, loud / 4 + turned)
    assert (both[:320] < 0.4).all()
    np.testing.assert_allclose(both[320:], 1.0)
    assert (_growth(turned, turned)[:320] == 0).all()


def test_a_floor_is_never_louder_than_what_is_left() -> None:
    rng = np.random.default_rng(0)
    floor, left = rng.standard_normal((2, 2560))
    np.testing.assert_array_equal(believable(floor, left), floor)
    capped = believable(np.where(np.arange(2560) < 512, 30.0, floor), left)
    assert 1.0 < rms(capped[:512]) < 1.5
    np.testing.assert_array_equal(capped[512:], floor[512:])


@pytest.mark.parametrize("seed", range(5))
def test_a_motion_that_strays_far_once_and_hardly_ever_after_is_held_within_a_count(seed: int) -> None:
    rng = np.random.default_rng(seed)
    strayed = np.concatenate([1e-2 * rng.standard_normal(1000), 1e-13 * rng.standard_normal(3000)])
    held = _within(strayed, COUNT)
    assert rms(held[:800]) < 2 * COUNT
    np.testing.assert_array_equal(held[2500:], strayed[2500:])
