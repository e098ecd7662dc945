"""Readings in whole counts: the size of a count, and where the joint was between two of them."""

import numpy as np
import pytest
from bench import HEALTHY, SAMPLE_TIME, J, rms, run
from hypothesis import given
from hypothesis import strategies as st

from gms_mujoco.effects import LuGre, Viscous
from gms_mujoco.identification import inverse
from gms_mujoco.identification.inverse import Observation
from gms_mujoco.logs.encoder import between_counts, common_step, count_size
from gms_mujoco.plant import Plant
from gms_mujoco.record import Record

COUNT = 3e-4  # rad
PERIOD = 16  # samples


def _position(values: np.ndarray, resolution: float | None = None) -> Record:
    n = len(values)
    return Record("made", SAMPLE_TIME * np.arange(n), {"torque": np.ones(n), "position": values}, "fit", resolution)


def read(position: np.ndarray) -> np.ndarray:
    return COUNT * np.round(position / COUNT)


def between(readings: np.ndarray, steady: bool = True) -> np.ndarray:
    return between_counts(readings, COUNT, np.full(len(readings), steady), PERIOD)


def test_the_count_is_found_in_quantised_positions_only() -> None:
    path = np.cumsum(np.random.default_rng(0).normal(0, 1, 2000))
    assert count_size(_position(0.7e-3 * np.round(path))) == pytest.approx(0.7e-3)
    assert count_size(_position(path)) == 0
    assert count_size(_position(path, resolution=0.01)) == 0.01
    assert count_size(_position(np.full(100, 0.3))) == 0


@given(st.lists(st.sampled_from([0, 0, 0, -2, -1, 1, 2]), min_size=2, max_size=60), st.booleans())
def test_no_position_is_further_from_its_reading_than_half_a_count(steps: list[int], steady: bool) -> None:
    readings = COUNT * np.cumsum(steps)
    found = between(readings, steady)
    assert np.abs(found - readings).max() <= COUNT / 2 * (1 + 1e-9)
    if not steady:
        np.testing.assert_array_equal(found, readings)


def test_no_counts_and_no_changes_are_taken_as_they_are() -> None:
    rest, ramp = np.zeros(9), np.linspace(0, 1, 9)
    assert between(rest) is rest
    assert between_counts(ramp, 0.0, np.ones(9, bool), PERIOD) is ramp


@pytest.mark.parametrize("samples_per_count", [2.3, 7.1, 40.0])
def test_a_joint_that_creeps_is_known_to_half_a_sample(samples_per_count: float) -> None:
    """Of its way, and no longer to half a count."""
    t = np.arange(600)
    true = COUNT * (0.3 + t / samples_per_count)
    found = between(read(true))
    inside = (t > samples_per_count) & (t < t[-1] - samples_per_count)
    assert np.abs(found - true)[inside].max() <= 0.5 * COUNT / samples_per_count * (1 + 1e-9)
    assert (np.diff(found[inside]) > 0).all()


def test_a_joint_that_hovers_about_an_edge_rests_there() -> None:
    t = np.arange(400)
    true = COUNT * (7.5 + 0.02 * np.sin(0.7 * t))
    readings = read(true)
    assert common_step(readings) == pytest.approx(COUNT)
    changes = np.flatnonzero(np.diff(readings))
    np.testing.assert_allclose(between(readings)[changes[0] + 1 : changes[-1] + 1], 7.5 * COUNT)


def test_where_a_swing_turns_back_its_readings_stand() -> None:
    """The edges that it passed would shorten every stroke by up to a count at either end."""
    readings = read(20 * COUNT * np.sin(2 * np.pi * np.arange(4000) / 1000))
    found = between(readings)
    assert (found.min(), found.max()) == (readings.min(), readings.max())


def test_a_bristle_holds_its_load_behind_a_coarse_encoder(monkeypatch: pytest.MonkeyPatch) -> None:
    """The very axis, pushed and held: LuGre lets go at each turn, and at those that toggling readings make up."""
    friction = LuGre(stiffness=0.3, damping=4e-4, coulomb=4.5e-3, static=5.4e-3, stribeck_velocity=0.3)
    plant = Plant.axis(J) + friction + Viscous(coefficient=2e-5)
    t = 1e-3 * np.arange(3000)
    record = run(plant, 0.7 * 4.5e-3 * np.clip((t - 0.1) / 0.2, 0, 1), resolution=COUNT)

    def left() -> float:
        o = Observation(record, 60.0)
        return float(rms(o.applied(plant) - o.needed(plant)) / rms(o.applied(plant)))

    found = left()
    monkeypatch.setattr(inverse, "between_counts", lambda position, *_: position)
    assert found < 0.02 < 0.06 < left()


def test_a_swing_within_a_count_is_left_to_the_readings(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where the torque is not steady they show a part of it."""
    record = run(HEALTHY, 1e-3 * np.sin(2 * np.pi * 20 * 1e-3 * np.arange(2000)), resolution=10 * COUNT)
    found = Observation(record, 60.0).position
    monkeypatch.setattr(inverse, "between_counts", lambda position, *_: position)
    np.testing.assert_array_equal(found, Observation(record, 60.0).position)
