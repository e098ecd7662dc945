"""Signals: their spectrum is what they say, and they repeat without a jump."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gms_mujoco.errors import DataError
from gms_mujoco.excitation import KINDS, SWEEPS, Excitation

H = 5e-4


@settings(max_examples=40)
@given(
    n=st.integers(200, 3000), low=st.floats(2, 50), span=st.floats(60, 900), kind=st.sampled_from(KINDS),
    seed=st.integers(0, 99), lines=st.none() | st.integers(2, 60),
)  # fmt: skip
def test_a_multisine_has_its_lines_alone(
    n: int, low: float, span: float, kind: str, seed: int, lines: int | None
) -> None:
    try:
        x = Excitation.multisine(H, n * H, low, min(low + span, 990.0), 3e-3, seed, kind, lines)
    except DataError as error:
        assert "line of a period" in str(error)
        return
    level = np.abs(np.fft.rfft(x.wave)) * 2 / n
    assert np.allclose(level[x.lines], level[x.lines[0]]) and np.sqrt(np.mean(x.wave**2)) == pytest.approx(3e-3)
    level[x.lines] = 0
    assert level.max() < 1e-12
    assert x.frequency[0] >= low - 1e-9 and len(x.wave) == n and x.period == pytest.approx(n * H)
    if kind != "full":
        assert (x.lines % 2 == 1).all()
    again = x.realisations(2, seed)
    assert not np.allclose(again[0].wave, again[1].wave) and np.array_equal(again[0].lines, x.lines)


def test_of_four_odd_lines_one_is_left_out_at_random() -> None:
    x = Excitation.multisine(H, 1.0, 2, 400, 1.0, 0, "odd_random")
    left = x.unexcited[x.unexcited % 2 == 1]
    odd = np.arange(3, 400, 2)
    assert len(left) in (len(odd) // 4 - 1, len(odd) // 4) and len(np.unique(np.diff(left))) > 2
    assert not np.array_equal(left, Excitation.multisine(H, 1.0, 2, 400, 1.0, 1, "odd_random").unexcited)


@pytest.mark.parametrize("sweep", SWEEPS)
def test_a_chirp_stays_in_its_band_and_repeats_without_a_jump(sweep: str) -> None:
    x = Excitation.chirp(H, 2.0, 5.0, 200.0, 0.3, sweep)
    twice = x.repeat(2)
    jump = np.abs(np.diff(twice))[len(x.wave) - 1]
    assert jump <= np.abs(np.diff(x.wave)).max() and np.abs(x.wave).max() == pytest.approx(0.3, rel=1e-3)
    power = np.abs(np.fft.rfft(x.wave)) ** 2
    assert power[x.lines].sum() > 0.97 * power.sum()
    inside = x.lines[20:-40]  # of a logarithmic sweep the time spent at a frequency falls as 1 / f
    even = power[inside] * (inside if sweep == "logarithmic" else 1)
    assert even.min() > 0.4 * even.mean()


@settings(max_examples=40)
@given(frequency=st.floats(0.5, 480), cycles=st.integers(1, 20))
def test_a_sine_has_whole_cycles_in_its_period(frequency: float, cycles: int) -> None:
    x = Excitation.sine(H, frequency, 2.0, cycles)
    level = np.abs(np.fft.rfft(x.wave)) * 2 / len(x.wave)
    assert int(level.argmax()) == cycles == x.lines[0] and level[cycles] == pytest.approx(2.0)
    # The period is a whole number of samples, at most half a sample away.
    assert abs(x.frequency[0] / frequency - 1) <= 0.5 / (cycles / (frequency * H) - 0.5) * (1 + 1e-9)


def test_the_amplitude_rises_over_the_first_periods_and_scales() -> None:
    x = Excitation.sine(H, 10.0, 1.0, 2)
    signal = x.repeat(4, ramp=2)
    n = len(x.wave)
    assert len(signal) == 4 * n and signal[0] == 0 and np.array_equal(signal[2 * n :], x.repeat(2))
    assert np.all(np.abs(signal[:n]) <= 0.5) and np.array_equal((2 * x).wave, 2 * x.wave)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: Excitation.multisine(H, 1.0, 2, 300, 1.0, 0, "even"), "kind of a multisine must be one of full, odd"),
        (lambda: Excitation.multisine(H, 1.0003, 2, 300, 1.0, 0), "whole number of at least 4 samples"),
        (lambda: Excitation.multisine(H, 1.0, 2, 1000, 1.0, 0), "between 0 and 1000 Hz"),
        (lambda: Excitation.multisine(H, 0.1, 21, 29, 1.0, 0), "no full line"),
        (lambda: Excitation.chirp(H, 1.0, 2, 300, 1.0, "cubic"), "sweep must be one of linear"),
        (lambda: Excitation.chirp(H, 1.0, 300, 2, 1.0), "rise between"),
        (lambda: Excitation.sine(H, 0.0, 1.0), "between 0 and"),
        (lambda: Excitation.sine(0.0, 20.0, 1.0), "sample time must be positive .*; 0 given"),
        (lambda: Excitation.multisine(0.0, 1.0, 2, 300, 1.0, 0), "sample time must be positive"),
        (lambda: Excitation.multisine(H, 1.0, 2, 300, float("nan"), 0), "rms must be positive; nan given"),
        (lambda: Excitation.multisine(H, 1.0, 2, 300, 1.0, 0, lines=0), "lines must be 1 or more; 0 given"),
    ],
)
def test_a_signal_that_cannot_be_is_refused(make, words: str) -> None:
    with pytest.raises(DataError, match=words):
        make()
