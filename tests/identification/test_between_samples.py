"""Means around samples are exact for what they are made for, against a simulation and a sine in closed form."""

import numpy as np
from bench import J, rms

from gms_mujoco.identification.between_samples import held_mean, read_mean, second_difference, smooth_mean
from gms_mujoco.plant import Plant
from gms_mujoco.simulate import simulate

BARE = Plant.axis(J)
H = 1e-3


def test_a_held_torque_on_a_bare_inertia_is_exact() -> None:
    """Sample by sample, for a torque with no smoothness at all: there is no half sample of delay."""
    u = np.random.default_rng(1).normal(0, 2e-3, 400)
    q = simulate(BARE, u, H).position
    np.testing.assert_allclose(J * second_difference(q, H)[1:-1], held_mean(u)[1:-1], atol=1e-8)


def test_a_torque_that_was_read_is_a_sample_of_a_smooth_course() -> None:
    """Of a sine of a tenth of the sampling rate, Numerov's mean errs by 1 in 1000."""
    w = 2 * np.pi * 0.1 / H
    t = H * np.arange(200)
    u, q = np.sin(w * t), -np.sin(w * t) / w**2  # of inertia 1
    np.testing.assert_allclose(second_difference(q, H)[1:-1], read_mean(u)[1:-1], atol=1.2e-3)
    assert rms(second_difference(q, H)[1:-1] - held_mean(u)[1:-1]) > 100e-3, "read as a held one it comes late"


def test_a_torque_that_runs_straight_between_samples_is_integrated_exactly() -> None:
    """Of a kink at a sample, the position by hand: J q is the second integral of |t|, |t|^3 / 6."""
    t = H * np.arange(-50, 51)
    np.testing.assert_allclose(second_difference(np.abs(t) ** 3 / 6, H)[1:-1], smooth_mean(np.abs(t))[1:-1], atol=1e-12)
