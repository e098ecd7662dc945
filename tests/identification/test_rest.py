"""Where an axis rests nothing is asked of its friction, and only there."""

from dataclasses import replace

import numpy as np
import pytest
from bench import HEALTHY, J, rms, runs
from scipy import ndimage

from gms_mujoco.identification.inverse import Observation
from gms_mujoco.plant import Plant
from gms_mujoco.record import Record
from gms_mujoco.simulate import simulate

BARE = Plant.axis(J)
H = 1e-3
BAND = 60.0


def _record(torque: np.ndarray, position: np.ndarray) -> Record:
    return Record("made", H * np.arange(len(torque)), {"torque": torque, "position": position})


@pytest.mark.parametrize(("rest", "known"), [(40, False), (12, True)], ids=["long", "short"])
def test_a_rest_says_nothing_of_friction_wherever_the_low_pass_sees_it(rest: int, known: bool) -> None:
    """One of 1 / bandwidth, 20 samples here, or more; a shorter one is part of a motion."""
    count, n = 1e-4, 400
    speed = np.full(n, 5 * count)
    speed[200 : 200 + rest] = 0.0
    position = count * np.round(np.cumsum(speed) / count)
    signals = {"position": position, "torque": np.zeros(n)}
    o = Observation(Record("rests", 1e-3 * np.arange(n), signals, resolution=count), 50.0)
    near = (o.index > 200 - 8) & (o.index < 200 + rest + 8)
    far = (o.index < 200 - 15) | (o.index > 200 + rest + 15)
    assert o.determined[far].all() and bool(o.determined[near].all()) is known
    assert bool(o.determined[near].any()) is known


@pytest.mark.parametrize("count", [0.0, 1e-4], ids=["in any number", "in counts"])
def test_readings_with_noise_of_their_own_rest_too(count: float) -> None:
    """They wander over several counts, or never repeat, where the axis does not move."""
    n, noise = 4000, 6e-5
    speed = np.where(np.arange(n) < n // 2, 2e-3, 0.0)
    read = np.cumsum(speed) + noise * np.random.default_rng(0).standard_normal(n)
    position = count * np.round(read / count) if count else read
    o = Observation(Record("noisy", 1e-3 * np.arange(n), {"position": position, "torque": np.zeros(n)}), 50.0)
    moves, stays = o.index < n // 2 - 60, o.index > n // 2 + 60
    assert o.determined[moves].all() and not o.determined[stays].any()
    resting = o.without_rests().resting
    assert not resting[: n // 2 - 60].any() and resting[n // 2 + 60 : -1].mean() > 0.5


@pytest.mark.parametrize("digits", [None, 9])
def test_an_axis_that_stops_to_the_last_digit_is_asked_nothing_there(digits: int | None) -> None:
    n, rng = 2000, np.random.default_rng(0)
    speed = np.sin(2 * np.pi * 3 * H * np.arange(n))
    speed[np.abs(speed) < 0.4] = 0.0
    q = H * np.cumsum(speed)
    o = Observation(_record(rng.standard_normal(n), q if digits is None else np.round(q, digits)), BAND)
    assert o.rest.at_once.mean() == pytest.approx(np.mean(speed == 0), abs=0.01)
    inside = ndimage.binary_erosion(speed == 0, np.ones(5))
    torque = np.where(inside, 7.0, o.record.torque)
    again = Observation(_record(torque, o.record.position), BAND)
    np.testing.assert_allclose(again.applied(BARE), o.applied(BARE), atol=1e-12)
    away, half = ndimage.distance_transform_edt(speed != 0)[o.index], 0.5 / (BAND * H)  # [samples], of a period
    assert o.determined[away > half].all() and not o.determined[away < half / 2].any()


@pytest.mark.parametrize("count", [1e-5, 1e-6])
def test_leaving_out_rests_folds_no_noise_into_the_band(count: float) -> None:
    """Of what an encoder adds no more is left than where all is asked; cut off at once, 5 to 10 times as much."""
    h, n = H / 4, 8000
    t = h * np.arange(n)
    position = np.cumsum(np.maximum(np.sin(2 * np.pi * 3 * t), 0)) * h  # rests half the time

    def seen(position: np.ndarray) -> Observation:
        return Observation(Record("made", t, {"torque": 0 * t, "position": position}, resolution=count), BAND)

    exact, read = seen(position), seen(count * np.round(position / count))
    asked = read.without_rests()
    told = asked.determined
    assert 0.4 < told.mean() < 0.5
    noise = (asked.needed(BARE) - replace(exact, asked=asked.asked).needed(BARE))[told]
    assert rms(noise) < 1.2 * rms((read.needed(BARE) - exact.needed(BARE))[told])


@pytest.mark.parametrize(("stop", "unasked"), [(0.25, True), (0.02, False)])
@pytest.mark.parametrize("long", [True, False], ids=["in one that rests", "in one that does not"])
def test_records_are_asked_alike_of_short_stops_and_of_slow_motion(stop: float, unasked: bool, long: bool) -> None:
    """Whether a record has a long rest too or not; and motion by a count from sample to sample is none."""
    h, count = H / 4, 1e-3
    period = round(1 / (BAND * h))
    n, at, short = 60 * period, 40 * period, round(stop * period)
    speed = np.full(n, count / h)
    speed[at : at + short] = 0.0
    if long:
        speed[10 * period : 15 * period] = 0.0
    position = count * np.round(h * np.cumsum(speed) / count)
    record = Record("made", h * np.arange(n), {"torque": np.zeros(n), "position": position}, resolution=count)
    resting = Observation(record, BAND).without_rests().resting
    assert resting[at : at + short].any() == unasked
    assert resting[11 * period : 14 * period].all() == resting[11 * period : 14 * period].any() == long
    assert not resting[20 * period : 35 * period].any()


def test_an_axis_that_swings_out_is_asked_about_all_of_it() -> None:
    torque = np.zeros(4000)
    torque[500:540] = torque[2500:2540] = 0.02
    o = Observation(simulate(HEALTHY, torque, H, substeps=50), BAND)
    assert np.mean(np.diff(o.record.position) == 0) > 0.1 and not o.rest.at_once.any()


def test_a_slow_axis_behind_an_encoder_is_asked_about_its_friction() -> None:
    o = Observation(runs(HEALTHY, seconds=3.0)[0], 40.0)
    assert not o.rest.at_once.any() and np.any(np.diff(o.record.position) == 0)
