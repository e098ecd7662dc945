"""How much of an encoder's readings is noise, told from motions whose noise is known."""

import numpy as np
import pytest
from bench import J

from gms_mujoco.excitation import multisine
from gms_mujoco.identification.readings import Readings, smoothed
from gms_mujoco.plant import Plant
from gms_mujoco.record import Record
from gms_mujoco.simulate import simulate

H, HIGHEST = 1e-3, 30.0
TORQUE = multisine(8000, H, 1, HIGHEST, 2e-3, np.random.default_rng(0))
TRUE = simulate(Plant.axis(J), TORQUE, H).position


def read(position: np.ndarray) -> Readings:
    return Readings(Record("made", H * np.arange(len(position)), {"torque": TORQUE, "position": position}))


@pytest.mark.parametrize("noise", [1e-6, 1e-4])
def test_white_noise_of_the_readings_is_told_beside_the_motion(noise: float) -> None:
    readings = read(TRUE + noise * np.random.default_rng(1).standard_normal(len(TRUE)))
    assert np.sqrt(readings.variance) == pytest.approx(noise, rel=0.1)
    assert readings.count == 0


def test_counts_that_the_motion_passes_are_white_noise_of_their_width() -> None:
    count = 1e-5
    readings = read(count * np.round(TRUE / count))
    assert readings.count == pytest.approx(count, rel=1e-6)
    assert readings.variance == pytest.approx(count**2 / 12, rel=0.2)


def test_readings_are_clear_as_far_as_the_motion_reaches() -> None:
    """But for half of the frequencies whose median is taken, 12 Hz here."""
    noise = 1e-6 * np.random.default_rng(1).standard_normal(len(TRUE))
    assert 0.9 * HIGHEST < read(TRUE + noise).clear_up_to < HIGHEST + 13
    assert read(noise).clear_up_to < 13, "noise alone is no motion"


def test_a_record_too_short_for_a_spectrum_has_no_noise_that_is_known() -> None:
    readings = Readings(Record("short", H * np.arange(50), {"torque": np.zeros(50), "position": TRUE[:50]}))
    assert readings.variance == 0 and readings.clear_up_to == 0


def test_smoothing_leaves_what_is_slow_and_takes_what_is_fast() -> None:
    t = H * np.arange(2000)
    slow, fast = np.sin(2 * np.pi * 20 * t), np.sin(2 * np.pi * 100 * t)
    inside = slice(200, -200)
    np.testing.assert_allclose(smoothed(slow + fast, H, 40.0)[inside], slow[inside], atol=1e-4)
    assert smoothed(slow, H, 0.4 / H) is slow, "nothing is above it"
