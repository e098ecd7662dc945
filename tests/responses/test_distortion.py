"""Distortion against static nonlinearities, whose even and odd parts and whose best linear approximation are known."""

import numpy as np
import pytest

from gms_mujoco import effects
from gms_mujoco.bench import measure
from gms_mujoco.errors import DataError
from gms_mujoco.excitation import Excitation
from gms_mujoco.frf import estimate_frf
from gms_mujoco.plant import Plant
from gms_mujoco.record import Record
from gms_mujoco.responses.distortion import find_distortion

H = 5e-4
ODD = Excitation.multisine(H, 0.5, 2, 300, 1.0, 0, "odd_random")


def static(wave: Excitation, cubic: float = 0.0, square: float = 0.0, noise: float = 0.0, seed: int = 0) -> Record:
    u = wave.repeat(5)
    y = u + cubic * u**3 + square * u**2 + noise * np.random.default_rng(seed).standard_normal(len(u))
    return Record("static", H * np.arange(len(u)), {"torque": u, "position": y})


def test_a_linear_axis_has_noise_alone() -> None:
    found = find_distortion(static(ODD, noise=0.01), ODD.lines, ODD.period)
    expected = 0.01 * np.sqrt(2 / 1000 / 4 * 2)  # complex amplitude of a mean of 4 periods of 1000 samples
    assert np.sqrt(np.mean(found.noise**2)) == pytest.approx(expected, rel=0.15)
    assert max(found.even_share, found.odd_share) < found.noise_share
    z = np.concatenate([found.even / found.even_noise, found.odd / found.odd_noise])
    assert np.median(z) == pytest.approx(np.sqrt(np.log(2)), abs=0.15)


def test_a_cubic_spring_distorts_odd_lines_and_a_square_one_even_lines() -> None:
    cubic = find_distortion(static(ODD, cubic=0.1, noise=1e-4), ODD.lines, ODD.period)
    square = find_distortion(static(ODD, square=0.1, noise=1e-4), ODD.lines, ODD.period)
    assert cubic.odd_share > 0.03 and cubic.even_share < 1e-4
    assert square.even_share > 0.03 and square.odd_share < 1e-4
    assert "odd" in str(cubic) and "even" in str(square)


def test_an_axis_tells_even_from_odd() -> None:
    """A pendulum about its lowest point is odd in position, about the horizontal even."""
    base = Plant.axis(2.4e-5) + effects.find("spring")(stiffness=0.5) + effects.find("viscous")(coefficient=2e-3)
    wave = Excitation.multisine(H, 1.0, 2, 60, 0.15, 0, "odd_random")
    gravity = effects.find("gravity")
    shares = []
    for phase in (0.0, np.pi / 2):
        found = measure(base + gravity(amplitude=0.1, phase=phase), wave, transient=3).distortion()
        shares.append((found.even_share, found.odd_share))
    assert max(shares[0]) > 20 * min(shares[0]) and max(shares[1]) > 3 * min(shares[1])
    assert np.argmax(shares[0]) != np.argmax(shares[1])


def test_what_the_input_carries_is_no_distortion_of_the_axis() -> None:
    clean = static(ODD)
    u = clean.torque + 0.1 * clean.torque**3
    dirty = Record("drive", clean.time, {"torque": u, "position": 2 * u})
    assert find_distortion(dirty, ODD.lines, ODD.period).odd_share < 1e-6


def test_the_best_linear_approximation_of_a_cube_and_its_uncertainty() -> None:
    """u + a u^3 under Gaussian u of variance s^2 is 1 + 3 a s^2 on average (Bussgang)."""
    wave = Excitation.multisine(H, 0.5, 2, 400, 0.5, 0)
    z, gains = [], []
    for i in range(40):
        runs = [static(w, cubic=0.4, noise=1e-3, seed=i) for w in wave.realisations(6, i)]
        frf = estimate_frf(runs, period=wave.period, hold=False)
        assert frf.sigma is not None and frf.sigma_noise is not None
        gains.append(frf.response.mean())
        z.append(np.abs(frf.response - (1 + 3 * 0.4 * 0.25)) / frf.sigma)
        assert np.median(frf.sigma / frf.sigma_noise) > 5
    assert np.mean(gains) == pytest.approx(1 + 3 * 0.4 * 0.25, rel=0.01)
    # |error|^2 / sigma^2 with 5 complex degrees of freedom in sigma: F(2, 10), whose median is 0.743.
    assert np.median(np.square(z)) == pytest.approx(0.743, abs=0.08)


def test_lines_that_cannot_be_are_refused() -> None:
    full = Excitation.multisine(H, 0.5, 2, 300, 1.0, 0)
    for wave, change, words in (
        (full, {}, "every line is excited"),
        (ODD, {"transient": 4}, "periods of 1000 are needed"),
        (ODD, {"signal": "velocity"}, "no signal 'velocity'"),
        (ODD, {"lines": np.array([0, 3])}, "must lie between 1 and 499"),
    ):
        with pytest.raises(DataError, match=words):
            find_distortion(static(wave), **{"lines": wave.lines, "period": wave.period, **change})
