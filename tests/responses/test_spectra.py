"""The period of an excitation, and its lines, in the noise that a measured torque has."""

import numpy as np
import pytest

from gms_mujoco.excitation import multisine
from gms_mujoco.responses.spectra import find_noisy_period, find_period, periodic

H = 5e-4


@pytest.mark.parametrize("noise", [0.03, 0.1, 0.2])
@pytest.mark.parametrize("high", [10, 200, 990])
def test_a_period_is_found_in_white_noise(high: float, noise: float) -> None:
    for seed in range(4):
        rng = np.random.default_rng(seed)
        n = int(rng.integers(900, 2500))
        wave = multisine(n, H, 1, high, 1.0, np.random.default_rng(seed))
        noisy = np.tile(wave, 4) + noise * wave.std() * rng.standard_normal(4 * n)
        assert find_noisy_period(noisy) == n
        assert find_period(noisy) == (n if noise < 0.05 else None)


def test_what_does_not_repeat_has_no_period_in_noise_either() -> None:
    for seed in range(40):
        rng, n = np.random.default_rng(seed), 6000
        t = H * np.arange(n)
        for x in (
            rng.standard_normal(n), np.cumsum(rng.standard_normal(n)), np.repeat(rng.standard_normal(30), 200),
            np.convolve(rng.standard_normal(n), np.ones(50), "same"), np.sin(2 * np.pi * (3 * t + 20 * t**2)),
        ):  # fmt: skip
            assert find_noisy_period(x / x.std() + rng.uniform(0, 0.3) * rng.standard_normal(n)) is None


@pytest.mark.parametrize("count", [2, 3, 8])
def test_lines_of_noise_are_not_excited(count: int) -> None:
    rng = np.random.default_rng(count)
    wave = multisine(2000, H, 3, 200, 2e-4, np.random.default_rng(1), lines=75)
    truth = np.flatnonzero(np.abs(np.fft.rfft(wave)) > 0.1 * np.abs(np.fft.rfft(wave)).max())
    torque = np.tile(wave, count + 1) + 0.1 * wave.std() * rng.standard_normal(2000 * (count + 1))
    position = np.convolve(torque, [0.0, 1.0, 0.5])[: len(torque)]
    frequency, _, values, _ = periodic("a", [torque], [position], [torque], 2000, 1, H)
    assert np.allclose(frequency, truth / (2000 * H)) and values["coherence"].min() > 0.9
