"""Servos that close their own position loop, against MuJoCo's dcmotor and closed forms; and how well they repeat."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from servos import bench, in_mujoco, run

from gms_mujoco import effects
from gms_mujoco.effects import Coulomb, Delay, LeastDuty, LoadDependentFriction, PositionLoop, Viscous
from gms_mujoco.errors import DataError, ModelError
from gms_mujoco.identification.servo_observation import (
    encoder_noise,
    errors_of,
    observe_servos,
    repeatability,
    rows_of,
    simulate_run,
)  # fmt: skip
from gms_mujoco.plant import Plant

LOOP = PositionLoop(stall_torque=5.5, electrical_drag=1.1, goal_speed=4.9, duty_limit=0.8, duty_per_rad=0.1649)


@pytest.mark.parametrize(
    "friction",
    [(), (Coulomb(coulomb=0.12), Viscous(coefficient=0.04), LoadDependentFriction(coefficient=2.0))],
    ids=["bare", "with friction"],
)
def test_the_servo_in_mujoco_moves_as_the_one_that_is_fitted(friction) -> None:
    plant = Plant(0.024, (LOOP, *friction))
    t = 0.01 * np.arange(300)
    r = run(np.where(t < 1, 1.4, np.where(t < 2, -0.7, 0.3 * np.sin(9 * t))))
    here, there = simulate_run(plant, r), in_mujoco(plant, r)
    assert np.ptp(here) > 1.5
    assert np.abs(here - there).max() < 1e-6


def test_a_delay_acts_on_the_goal_in_mujoco_too() -> None:
    r = run(np.where(np.arange(200) < 100, 0.0, 1.0), start=0.0)  # MuJoCo takes the goal before the first as 0
    plant = Plant(0.024, (Delay(time=0.02), LOOP, Viscous(coefficient=0.04)))  # the order does not matter
    assert np.abs(simulate_run(plant, r) - in_mujoco(plant, r)).max() < 1e-6


@pytest.mark.parametrize("time", [0.02, 0.0234])
def test_a_delay_shifts_the_motion(time) -> None:
    plant = Plant(0.024, (LOOP.replace(duty_limit=1.0), Viscous(coefficient=0.04)))
    r = run(np.where(np.arange(300) < 100, 0.0, 0.6), start=0.0)
    prompt, late = simulate_run(plant, r), simulate_run(plant + Delay(time=time), r)
    assert np.abs(late - np.interp(r.time - time, r.time, prompt)).max() < 2e-3
    assert np.abs(late - prompt).max() > 0.05


def test_rests_where_the_duty_carries_the_payload() -> None:
    """T c K (g - q) = A sin q, in the closed form of a servo without friction."""
    r = run(np.full(600, 1.0), gain=4.0)
    q = simulate_run(Plant(0.024, (LOOP,)), r)[-1]
    assert 5.5 * 4.0 * 0.1649 * (1.0 - q) == pytest.approx(r.weight * np.sin(q), rel=1e-3)


def test_without_power_it_is_a_pendulum() -> None:
    """Neither torque nor back-EMF: energy is kept."""
    n = 200
    r = run(np.full(n, 3.0), np.zeros(n), start=0.5)
    q = simulate_run(Plant(0.024, (LOOP,)), r)
    assert q.max() == pytest.approx(0.5, abs=2e-3) and q.min() == pytest.approx(-0.5, abs=2e-3)


def test_the_goal_speed_limits_the_motion() -> None:
    r = run(np.full(100, 3.0), gain=32.0, start=0.0)
    r = replace(r, goal=np.where(np.arange(100) < 1, 0.0, 3.0), weight=0.0)
    q = simulate_run(Plant(0.005, (LOOP.replace(goal_speed=2.0, stall_torque=50.0, duty_limit=1.0),)), r)
    assert (q[60] - q[30]) / 0.3 == pytest.approx(2.0, rel=0.02)


def test_a_least_duty_removes_the_error_that_friction_leaves() -> None:
    """Friction stops the servo where T (c K e + u0) is its level."""
    plant = Plant(0.024, (LOOP, Coulomb(coulomb=0.15)))
    goal = np.minimum(np.linspace(0.0, 1.0, 400), 0.5)
    r = replace(run(goal, gain=4.0, start=0.0), weight=0.0)
    for duty in (0.0, 0.02):
        left = 0.5 - simulate_run(plant + LeastDuty(duty=duty), r)[-1]
        assert left == pytest.approx((0.15 / 5.5 - duty) / (4.0 * 0.1649), abs=2e-3)
    with pytest.warns(UserWarning, match="least_duty is left out"):
        in_mujoco(plant + LeastDuty(duty=0.027), r)


def test_what_a_goal_does_not_pass_is_refused() -> None:
    plant = Plant(0.02, (LOOP, effects.find("torque_saturation")(limit=1.0)))
    with pytest.raises(ModelError, match="torque_saturation does not act on a servo"):
        simulate_run(plant, run(np.zeros(20)))
    with pytest.raises(ModelError, match="has no 'position_loop'"):
        simulate_run(Plant(0.02, (Coulomb(coulomb=0.1),)), run(np.zeros(20)))


@given(st.floats(-3, 3))
def test_a_row_stands_for_one_error_and_large_ones_count_by_their_size(error: float) -> None:
    row = rows_of(np.array([error]))
    assert errors_of(row)[0] == pytest.approx(error, abs=1e-9)
    assert abs(row[0]) <= abs(error) + 1e-12
    if abs(error) < 1e-3:
        assert row[0] == pytest.approx(error, rel=1e-3)


def test_the_floor_is_how_far_a_motion_strays_from_its_repetition() -> None:
    """Of two readings that differ by white noise of deviation s each, the mean absolute error is s sqrt(2 / pi)."""
    runs = bench(delay=0.0)
    seen, rng = observe_servos(runs), np.random.default_rng(0)
    left = np.concatenate([errors_of(o.floor(rng)) for o in seen])
    assert np.mean(np.abs(left)) == pytest.approx(1e-3 * np.sqrt(2 / np.pi), rel=0.1)
    apart = repeatability(runs)
    assert apart == pytest.approx(1e-3 * 2 / np.sqrt(np.pi), rel=0.1)
    assert repeatability(runs[::2]) is None
    # Of a motion that was made once only, what is known of the others is taken.
    mixed = observe_servos(runs[:5])
    assert np.std(mixed[4].spread) == pytest.approx(1e-3, rel=0.5)


def test_a_run_that_is_given_twice_is_no_repetition() -> None:
    once, again = bench(delay=0.0)[:2]
    assert repeatability([once, once]) is None and repeatability([once, once, again]) == repeatability([once, again])
    both, alone = observe_servos([once, once]), observe_servos([once])
    assert np.std(both[0].spread) == pytest.approx(np.std(alone[0].spread), rel=0.3)
    thrice, twice = observe_servos([once, once, again]), observe_servos([once, again])
    assert np.array_equal(thrice[1].spread, twice[0].spread)


def test_without_repetitions_the_floor_is_that_of_the_encoder() -> None:
    r = bench(delay=0.0)[0]
    rng = np.random.default_rng(0)
    assert np.std(encoder_noise(r, rng)) == pytest.approx(1e-3, rel=0.3)
    count = 2 * np.pi / 4096
    smooth = simulate_run(Plant(0.024, (LOOP,)), r)
    read = replace(r, position=np.round(smooth / count) * count)
    assert np.std(encoder_noise(read, rng)) == pytest.approx(count / np.sqrt(12), rel=0.3)


def test_a_run_that_is_cut_is_simulated_from_its_beginning() -> None:
    plant = Plant(0.024, (LOOP, Coulomb(coulomb=0.1)))
    whole = run(np.where(np.arange(100) < 50, 0.3, -0.2))
    (o,) = observe_servos([replace(whole, judged=(60, 100))])
    assert len(o.applied(plant)) == len(o.time) == 40
    assert np.array_equal(o.simulated(plant), simulate_run(plant, whole)[60:])


def test_nothing_to_look_at_is_refused() -> None:
    with pytest.raises(DataError, match="no runs of a servo"):
        observe_servos([])
