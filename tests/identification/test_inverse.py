"""Inverse dynamics: exact for a held torque, flat in its band, and blind to nothing that the sensors did."""


import numpy as np
import pytest
from bench import COUNT, HEALTHY, J, rms, run, runs

from gms_mujoco import effects
from gms_mujoco.excitation import multisine
from gms_mujoco.identification.inverse import Observation
from gms_mujoco.plant import Plant
from gms_mujoco.record import Record
from gms_mujoco.simulate import simulate

BARE = Plant.axis(J)
H = 1e-3
BAND = 60.0
SMOOTH = (
    BARE
    + effects.Viscous(coefficient=2e-4)
    + effects.Gravity(amplitude=2e-3, phase=0.4)
    + effects.find("quadratic_drag")(coefficient=2e-6)
)


def _torque(n: int = 4000, h: float = H, rms: float = 2e-3) -> np.ndarray:
    return multisine(n, h, 1, 80, rms, np.random.default_rng(0))


def _record(torque: np.ndarray, position: np.ndarray, h: float = H) -> Record:
    return Record("made", h * np.arange(len(torque)), {"torque": torque, "position": position})


def test_a_healthy_axis_shows_no_delay() -> None:
    o = Observation(simulate(BARE, _torque(), H), BAND)
    error = o.applied(BARE) - o.needed(BARE)
    lag = -(error @ np.gradient(o.applied(BARE), o.time)) / rms(np.gradient(o.applied(BARE), o.time)) ** 2 / len(error)
    assert rms(error) < 1e-6 * rms(o.applied(BARE))
    assert abs(lag) < 1e-6 * H


def test_quantisation_leaves_what_theory_says() -> None:
    """White noise of variance count^2/12, differentiated twice and cut off at the bandwidth."""
    o = Observation(run(BARE, _torque(20000), torque_noise=0.0), BAND)
    left = rms(o.applied(BARE) - o.needed(BARE))
    density = 2 * H * COUNT**2 / 12
    expected = J * (2 * np.pi) ** 2 * np.sqrt(density * BAND**5 / 5)
    assert left == pytest.approx(expected, rel=0.15)  # the filter's slope around its -6 dB frequency stays


@pytest.mark.parametrize(("share", "gain", "tolerance"), [(0.0, 1, 1e-9), (0.3, 1, 0.01), (1.0, 0.5, 0.02)])
def test_the_band_passes_what_is_slow(share: float, gain: float, tolerance: float) -> None:
    t = H * np.arange(4000)
    o = Observation(_record(t, t), BAND)
    wave = np.exp(2j * np.pi * share * BAND * t)
    seen = o.band(wave.real) + 1j * o.band(wave.imag)
    np.testing.assert_allclose(seen, gain * wave[o.index], atol=tolerance)  # zero phase


def test_the_band_stops_what_is_fast() -> None:
    t = H * np.arange(4000)
    o = Observation(_record(t, t), BAND)
    for f in np.linspace(1.6 * BAND, 490, 40):
        assert np.abs(o.band(np.cos(2 * np.pi * f * t + 0.3))).max() < 0.005


def test_values_are_taken_often_enough_for_the_band() -> None:
    for bandwidth in (5.0, 20.0, 60.0, 200.0):
        o = Observation(_record(H * np.arange(4000), np.arange(4000.0)), bandwidth)
        assert o.stride * H * bandwidth <= 1 / 2.5
        assert len(o.index) == len(o.time) == len(o.band(o.record.torque))
        np.testing.assert_array_equal(np.diff(o.index), o.stride)


def test_the_torque_needed_is_the_torque_applied() -> None:
    """For effects that are smooth in time: the error falls with the sample time, to what the smoothing leaves."""
    errors = []
    for n in (2000, 4000, 8000):
        h = 4.0 / n
        u = 2e-3 * np.sin(2 * np.pi * 1.3 * h * np.arange(n)) + 1e-3 * np.sin(2 * np.pi * 11 * h * np.arange(n))
        o = Observation(simulate(SMOOTH, u, h, velocity=3.0, substeps=200), 50.0)
        errors.append(rms(o.applied(SMOOTH) - o.needed(SMOOTH)) / rms(o.applied(SMOOTH)))
    assert errors[0] < 1e-3 and errors[1] < errors[0] / 2 and errors[2] < 2e-4


def test_a_wrong_plant_needs_another_torque() -> None:
    o = Observation(simulate(SMOOTH, _torque(), H, velocity=3.0), BAND)
    for name in ("viscous", "gravity", "quadratic_drag"):
        without = SMOOTH.without(name)
        missing = o.applied(without) - o.needed(without)
        # What is missing is, up to its sign, the torque of that effect along the motion.
        alone = o.replay(Plant.axis(1.0) + SMOOTH[name])
        assert rms(missing + alone) < 0.01 * rms(alone) + 1e-3 * rms(o.applied(SMOOTH))


def test_skew_is_a_torque_clock_that_runs_ahead() -> None:
    t, s = H * np.arange(4000), 5e-5

    def o(shift: float) -> Observation:
        return Observation(_record(np.sin(2 * np.pi * 7 * (t - shift)), t), BAND)

    here, late = o(0.0).applied(BARE, skew=s), o(s).applied(BARE)
    assert rms(here - late) < 0.02 * rms(o(0.0).applied(BARE) - late)


@pytest.mark.parametrize("time", [2e-3, 2.125e-3, 2.3e-3, 2.8125e-3])
def test_drive_effects_act_on_the_command(time: float) -> None:
    """Exactly for a delay of eighths of a sample; for others to a small part of what the drive does in one."""
    late = BARE + effects.Delay(time=time)
    o = Observation(simulate(late, _torque(), H, substeps=40), BAND)
    left = rms(o.applied(late) - o.needed(late)) / rms(o.applied(late))
    assert left < (1e-6 if 8 * time / H % 1 == 0 else 3e-4)
    assert rms(o.applied(BARE) - o.needed(BARE)) > 0.1 * rms(o.applied(BARE))


def test_a_clock_that_runs_ahead_is_that_of_the_torque_that_acts() -> None:
    """Behind a lag it is a delay of what the lag has smoothed, however rough the command is."""
    u = np.random.default_rng(2).normal(0, 2e-3, 4000)
    o = Observation(_record(u, np.linspace(0, 1, 4000)), BAND)
    lag, s = BARE + effects.find("current_loop_lag")(time=2e-3), 1e-4
    ahead, late = o.applied(lag, skew=s), o.applied(lag + effects.Delay(time=s))
    assert rms(ahead - late) < 0.02 * rms(o.applied(lag) - late)


def test_a_lag_of_the_current_loop_is_followed_inside_the_sample() -> None:
    lag = BARE + effects.find("current_loop_lag")(time=0.5e-3)
    o = Observation(simulate(lag, _torque(), H, substeps=100), BAND)
    assert rms(o.applied(lag) - o.needed(lag)) < 1e-3 * rms(o.applied(lag))


def test_sensor_effects_are_taken_out_of_the_position() -> None:
    bent = BARE + effects.find("encoder_eccentricity")(amplitude=2e-3, phase=0.7)
    o = Observation(simulate(bent, _torque(), H, velocity=30.0), BAND)
    assert rms(o.applied(bent) - o.needed(bent)) < 1e-3 * rms(o.applied(bent))
    assert rms(o.applied(BARE) - o.needed(BARE)) > 20 * rms(o.applied(bent) - o.needed(bent))
    assert o.seen_by(BARE) is o and o.seen_by(bent) is o.seen_by(bent)


def test_the_smoothed_position_is_the_true_one() -> None:
    """Within the band; quantisation is mostly gone, and the ends are no worse than a few counts."""
    u = multisine(4000, H, 1, 15, 2e-4, np.random.default_rng(0))
    count = 1e-3
    true, read = (simulate(BARE, u, H, resolution=r).position for r in (None, count))
    o = Observation(_record(u, read), 20.0)
    middle = o.index
    assert rms(o.position[middle] - true[middle]) < 0.5 * rms(read - true)
    assert np.abs(o.position - true).max() < 3 * count
    v = np.gradient(true, H)
    assert rms(o.velocity[middle] - v[middle]) < 0.05 * rms(v)


def test_the_opening_is_the_first_part() -> None:
    o = Observation(simulate(BARE, _torque(), H), BAND)
    first = o.opening(2.0)
    assert len(first.record) == 2000 and first.bandwidth == o.bandwidth
    n = len(first.index)
    np.testing.assert_allclose(first.applied(BARE), o.applied(BARE)[:n])
    assert o.opening(100.0) is o


def test_a_sparse_look_is_that_of_every_sample_where_torques_change_slowly() -> None:
    o = Observation(runs(HEALTHY, seconds=3.0)[2], 40.0)
    every = len(o.sparse.instants) / len(o.record)
    assert every < 0.5
    exact, sparse = o.replay(HEALTHY), o.replay(HEALTHY, grid=o.sparse)
    assert rms(sparse - exact) < 0.02 * rms(exact)
    elements = o.elements(HEALTHY, HEALTHY.joint(), 0, grid=o.sparse)
    alone = o.replay(HEALTHY.part("gms"), grid=o.sparse)
    np.testing.assert_allclose(elements.sum(0), alone, atol=1e-12)
