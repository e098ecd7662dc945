"""Harmonics that stand out over the place: what was put there is found, in any number, and noise is not."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gms_mujoco.identification.place_spectrum import standing_out, wave


def _series(seed: int, harmonics: tuple[int, ...], n: int = 4000) -> tuple[np.ndarray, np.ndarray]:
    """Places all over the revolution, and noise with a sine for each harmonic, half as high as the noise is loud."""
    rng = np.random.default_rng(seed)
    place = np.cumsum(rng.uniform(0, 0.02, n)) - 7.0
    waves = [0.5 * np.sin(k * place + rng.uniform(0, 2 * np.pi)) for k in harmonics]
    return place, rng.standard_normal(n) + sum(waves)


@given(st.integers(0, 10**6), st.sets(st.integers(50, 900), min_size=1, max_size=3))
def test_what_was_put_there_is_found(seed: int, harmonics: set[int]) -> None:
    assert set(standing_out(*_series(seed, tuple(harmonics)), 49, 1000)) >= harmonics


def test_noise_stands_out_once_in_many_thousand_harmonics() -> None:
    found = [standing_out(*_series(seed, ()), 49, 1000) for seed in range(100)]
    assert sum(map(len, found)) <= 12


@pytest.mark.parametrize("turn", [1.0, -40.0, 2 * np.pi])
def test_where_the_revolution_begins_does_not_matter(turn: float) -> None:
    place, values = _series(0, (200, 333))
    assert set(standing_out(place + turn, values, 49, 1000)) == {200, 333}


@pytest.mark.parametrize("length", [1.0, 0.37])
def test_of_any_other_length_too(length: float) -> None:
    place, values = _series(0, (200, 333))
    assert set(standing_out(place * length, values, 49, 1000, 2 * np.pi * length)) == {200, 333}


def test_nothing_is_looked_for_where_there_is_nothing() -> None:
    assert standing_out(np.empty(0), np.empty(0), 49, 1000) == []
    assert standing_out(*_series(0, (200,)), 49, 49) == []
    assert standing_out(np.zeros(10), np.zeros(10), 49, 1000) == []


@given(st.integers(0, 10**6), st.floats(0.05, 5.0), st.floats(0.3, 10.0))
def test_a_wave_is_found_with_its_period_and_share(seed: int, period: float, loud: float) -> None:
    rng = np.random.default_rng(seed)
    place = np.cumsum(rng.uniform(0, 0.02, 4000)) - 7.0
    sine, noise = np.sqrt(2) * np.sin(2 * np.pi / period * place + seed), rng.standard_normal(4000)
    found, share = wave(place, loud * sine + noise, np.ones_like(place))
    assert found == pytest.approx(period, rel=0.5 * period / np.ptp(place))
    assert share == pytest.approx(loud**2 / (loud**2 + 1), abs=0.1)


def test_noise_is_no_wave_and_nothing_is_none() -> None:
    place, noise = _series(0, ())
    assert wave(place, noise, np.ones_like(place))[1] < 0.01
    assert wave(place, 0 * noise, noise)[1] == 0 and wave(0 * place, noise, noise)[1] == 0
