"""How a motion goes: reversals, swings, regimes, and the distance over which friction turns round."""

import math

import numpy as np
import pytest
from bench import HEALTHY, LEVEL, run
from hypothesis import given
from hypothesis import strategies as st

from gms_mujoco import effects
from gms_mujoco.identification.inverse import Observation
from gms_mujoco.identification.motion import Swings, break_away_distance, turning_points, virgin_curve
from gms_mujoco.plant import Plant
from gms_mujoco.record import Record

BARE = Plant.axis(1.0)
TIME = 1e-3 * np.arange(4000)


def _swings(position: np.ndarray) -> Swings:
    return Swings.of(Observation(Record("r", TIME, {"torque": 0 * TIME, "position": position}), 100.0))


def test_a_sine_turns_at_its_peaks() -> None:
    turns = turning_points(np.sin(2 * np.pi * TIME))
    assert TIME[turns] == pytest.approx(np.arange(0.25, 4, 0.5), abs=1e-3)


def test_noise_below_the_threshold_turns_nothing() -> None:
    rough = np.sin(2 * np.pi * TIME) + 0.01 * np.random.default_rng(0).uniform(-1, 1, len(TIME))
    assert len(turning_points(rough)) > 50
    assert TIME[turning_points(rough, 0.05)] == pytest.approx(np.arange(0.25, 4, 0.5), abs=0.04)


@given(st.lists(st.floats(-10, 10), min_size=2, max_size=60), st.floats(0, 5))
def test_between_turning_points_there_is_no_longer_swing_back(position: list[float], least: float) -> None:
    q = np.array(position)
    turns = turning_points(q, least)
    assert (np.diff(turns) > 0).all()
    assert (np.abs(np.diff(q[turns])) > least).all()
    assert (np.diff(np.sign(np.diff(q[turns]))) != 0).all()  # peaks and valleys take turns


def test_distance_and_time_count_from_the_last_reversal() -> None:
    s = _swings(np.sin(2 * np.pi * TIME))
    t = Observation(Record("r", TIME, {"torque": 0 * TIME, "position": TIME}), 100.0).time
    first = t < 0.25
    assert np.isnan(s.distance[first]).all() and np.isfinite(s.distance[t > 0.251]).all()
    later = t > 0.26
    since = np.mod(t[later] - 0.25, 0.5)
    assert s.time[later] == pytest.approx(since, abs=2e-3)
    assert s.distance[later] == pytest.approx(1 - np.cos(2 * np.pi * since), abs=0.01)
    assert s.length[later][:-200] == pytest.approx(2.0, abs=1e-3)
    assert (s.direction[later] == np.where(np.floor((t[later] - 0.25) / 0.5) % 2, 1, -1)).mean() > 0.99


def test_regimes_follow_the_swing() -> None:
    small = np.where(TIME < 2, 0.01, 1.0) * np.sin(2 * np.pi * TIME)
    s = _swings(small)
    where = s.regime(0.1)
    t = Observation(Record("r", TIME, {"torque": 0 * TIME, "position": TIME}), 100.0).time
    inner = (t > 0.3) & (t < 1.7)
    assert (where[inner] == 0).all()
    begins = (t > 2.3) & (np.abs(s.distance) < 0.1)
    assert (where[begins] == 1).all() and (where[(t > 2.3) & ~begins] == 2).all()


def test_the_virgin_curve_is_that_of_the_springs() -> None:
    distance, torque = virgin_curve(HEALTHY, 1.0)
    gms = HEALTHY["gms"]
    share = np.outer(distance, gms.stiffness)
    expected = np.minimum(share, np.array(gms.fraction) * gms.static).sum(1)
    assert torque == pytest.approx(expected, rel=2e-3)


def test_the_break_away_distance_is_twice_that_of_the_virgin_curve() -> None:
    dahl = BARE + effects.Dahl(stiffness=100.0, coulomb=1.0)
    assert break_away_distance(dahl, 1.0) == pytest.approx(2 * math.log(20) / 100, rel=0.02)
    assert break_away_distance(BARE + effects.Coulomb(coulomb=1.0), 1.0) == 0
    assert break_away_distance(BARE + effects.Viscous(coefficient=1.0), 1.0) == 0
    assert break_away_distance(BARE, 1.0) == 0


def test_a_simulated_axis_below_break_away_is_in_pre_sliding() -> None:
    t = 1e-3 * np.arange(2000)
    records = [run(HEALTHY, size * LEVEL * np.sin(2 * np.pi * 2 * t)) for size in (0.3, 4.0)]
    gentle, strong = (Swings.of(Observation(r, 100.0)).regime(break_away_distance(HEALTHY, 5.0)) for r in records)
    assert (gentle == 0).all()
    assert (strong == 2).mean() > 0.7 and (strong == 1).any()
