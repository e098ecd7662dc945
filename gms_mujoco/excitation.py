"""Excitation of an axis: periodic signals that know their period and the lines they excite.

    wave = Excitation.multisine(5e-4, period=2.0, low=2.0, high=300.0, rms=2e-3, seed=1, kind="odd_random")
    torque = wave.repeat(6)

The kinds of multisine and what they are for: R. Pintelon and J. Schoukens, System Identification, 2nd ed. (2012),
chapters 2 to 4. A linear axis answers on the excited lines alone; a nonlinearity that is even in its input answers an
odd multisine on even lines, one that is odd on the odd lines that were left out.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from .errors import DataError, listing

Array = NDArray[np.float64]
Lines = NDArray[np.int64]

KINDS = ("full", "odd", "odd_random")
SWEEPS = ("linear", "logarithmic")
_GROUP = 4  # odd lines of which one, drawn at random, is left out


@dataclass(frozen=True)
class Excitation:
    """A periodic signal; a frozen value.

    Attributes:
        name: for messages and records.
        wave: (n,) one period, in the unit of what it excites [N m] or [rad].
        sample_time: [s].
        lines: (m,) those it excites, in multiples of 1 / period, rising.
    """

    name: str
    wave: Array
    sample_time: float
    lines: Lines

    @property
    def period(self) -> float:
        """[s], a whole number of samples."""
        return len(self.wave) * self.sample_time

    @property
    def frequency(self) -> Array:
        """(m,) of the excited lines [Hz]."""
        return self.lines / self.period

    @property
    def unexcited(self) -> Lines:
        """Lines between the first and the last excited one that are not excited."""
        return np.setdiff1d(np.arange(self.lines[0], self.lines[-1] + 1), self.lines)

    def repeat(self, periods: int, ramp: float = 0.0) -> Array:
        """(periods n,) the signal; its amplitude rises from 0 over the first `ramp` periods."""
        signal = np.tile(self.wave, periods)
        if ramp > 0:
            signal = signal * np.clip(np.arange(len(signal)) / (ramp * len(self.wave)), 0, 1)
        return signal

    def __mul__(self, factor: float) -> Excitation:
        return replace(self, wave=self.wave * factor)

    __rmul__ = __mul__

    @classmethod
    def sine(cls, sample_time: float, frequency: float, amplitude: float, cycles: int = 8) -> Excitation:
        """A sine whose period, as it is averaged, holds `cycles` whole cycles.

        The frequency is moved to the nearest one with a whole number of samples in it: at most by 1 / (2 n) of
        itself, n samples in the period.

        Args:
            sample_time: [s].
            frequency: [Hz].
            amplitude: [N m] or [rad].
            cycles: in a period.

        Raises:
            DataError: the frequency is not between 0 and half the sample rate, or a cycle has less than two samples.
        """
        _in_band(sample_time, frequency, frequency)
        n = round(cycles / (frequency * sample_time))
        if n <= 2 * cycles:
            raise DataError(f"{frequency:g} Hz is out of reach; expected less than {0.5 / sample_time:g} Hz")
        wave = amplitude * np.sin(2 * math.pi * cycles / n * np.arange(n))
        return cls(f"sine {cycles / (n * sample_time):.4g} Hz", wave, sample_time, np.array([cycles]))

    @classmethod
    def multisine(
        cls,
        sample_time: float,
        period: float,
        low: float,
        high: float,
        rms: float,
        seed: int | np.random.Generator,
        kind: str = "full",
        lines: int | None = None,
    ) -> Excitation:
        """A random-phase multisine with a flat amplitude spectrum.

        Args:
            sample_time: [s].
            period: [s], a whole number of samples.
            low, high: first and last frequency [Hz].
            rms: [N m] or [rad].
            seed: of the phases and of the lines left out; another seed is another realisation. The lines left out
                depend on the seed too: for realisations that share their lines, see `realisations`.
            kind: "full": every line; "odd": odd lines; "odd_random": odd lines, one of every four left out at random.
            lines: at most so many, spread evenly in logarithm; None: all in the band.

        Raises:
            DataError: an unknown kind, a period that is no whole number of samples, or no line in the band.
        """
        if kind not in KINDS:
            raise DataError(f"kind of a multisine must be one of {listing(KINDS)}; {kind!r} given")
        n = _samples(sample_time, period)
        _in_band(sample_time, low, high)
        if not 0 < rms < math.inf:
            raise DataError(f"rms must be positive; {rms:g} given")
        if lines is not None and lines < 1:
            raise DataError(f"lines must be 1 or more; {lines!r} given")
        rng = np.random.default_rng(seed)
        first, last = math.ceil(low * period - 1e-9), math.floor(high * period + 1e-9)
        every = np.arange(max(first, 1), min(last, (n - 1) // 2) + 1)
        if kind != "full":
            every = every[every % 2 == 1]
        if not len(every):
            raise DataError(f"no {kind} line of a period of {period:g} s lies between {low:g} and {high:g} Hz")
        if lines is not None:
            every = every[np.unique(np.searchsorted(every, np.geomspace(every[0], every[-1], lines)))]
        if kind == "odd_random" and len(every) >= _GROUP:
            left_out = _GROUP * np.arange(len(every) // _GROUP) + rng.integers(0, _GROUP, len(every) // _GROUP)
            every = np.delete(every, left_out)
        return cls(f"{kind} multisine", _random_phase(n, every, rms, rng), sample_time, every)

    def realisations(self, count: int, seed: int | np.random.Generator) -> list[Excitation]:
        """Multisines with the lines and the rms of this one, and phases of their own."""
        rng = np.random.default_rng(seed)
        rms = float(np.sqrt(np.mean(self.wave**2)))
        waves = [_random_phase(len(self.wave), self.lines, rms, rng) for _ in range(count)]
        return [replace(self, name=f"{self.name} {i}", wave=w) for i, w in enumerate(waves, 1)]

    @classmethod
    def chirp(
        cls, sample_time: float, period: float, low: float, high: float, amplitude: float, sweep: str = "linear"
    ) -> Excitation:
        """A sine whose frequency runs from `low` to `high` in each period, and starts again without a jump.

        Args:
            sample_time: [s].
            period: [s], a whole number of samples.
            low, high: [Hz]; they are scaled so that a period holds a whole number of cycles.
            amplitude: [N m] or [rad].
            sweep: "linear" in time, with a flat spectrum, or "logarithmic", with more at low frequencies.

        Raises:
            DataError: an unknown sweep, or frequencies or period that cannot be.
        """
        if sweep not in SWEEPS:
            raise DataError(f"sweep must be one of {listing(SWEEPS)}; {sweep!r} given")
        n = _samples(sample_time, period)
        _in_band(sample_time, low, high)
        share = np.arange(n) / n
        if sweep == "linear" or high == low:
            cycles = period * (low + (high - low) * share / 2) * share
            total = period * (low + high) / 2
        else:
            cycles = period * low * (np.exp(math.log(high / low) * share) - 1) / math.log(high / low)
            total = period * (high - low) / math.log(high / low)
        cycles *= max(round(total), 1) / total
        wave = amplitude * np.sin(2 * math.pi * cycles)
        first, last = max(math.ceil(low * period), 1), min(math.floor(high * period), (n - 1) // 2)
        return cls(f"{sweep} chirp", wave, sample_time, np.arange(first, last + 1))


def multisine(
    n: int, sample_time: float, low: float, high: float, rms: float, rng: np.random.Generator, lines: int = 120
) -> Array:
    """(n,) one period of a random-phase multisine with a flat spectrum [N m].

    Args:
        n: samples; the period is the whole of it.
        low, high: first and last frequency [Hz].
        rms: of the signal [N m].
        lines: at most so many frequencies, spread evenly in logarithm.
    """
    step = 1 / (n * sample_time)
    numbers = np.unique(np.geomspace(max(low / step, 1), high / step, lines).astype(int))
    return _random_phase(n, numbers, rms, rng)


def _random_phase(n: int, lines: Lines, rms: float, rng: np.random.Generator) -> Array:
    spectrum = np.zeros(n // 2 + 1, complex)
    spectrum[lines] = np.exp(2j * math.pi * rng.random(len(lines)))
    signal = np.fft.irfft(spectrum, n)
    return np.asarray(signal * rms / np.sqrt(np.mean(signal**2)))


def _samples(sample_time: float, period: float) -> int:
    _expect_rate(sample_time)
    n = round(period / sample_time)
    if n < 4 or abs(n - period / sample_time) > 1e-6 * n:
        raise DataError(f"a period must be a whole number of at least 4 samples of {sample_time:g} s; {period:g} given")
    return n


def _expect_rate(sample_time: float) -> None:
    if not 0 < sample_time < math.inf:
        raise DataError(f"the sample time must be positive [s]; {sample_time:g} given")


def _in_band(sample_time: float, low: float, high: float) -> None:
    _expect_rate(sample_time)
    if not 0 < low <= high < 0.5 / sample_time:
        raise DataError(
            f"frequencies must rise between 0 and {0.5 / sample_time:g} Hz, half the sample rate; "
            f"{low:g} to {high:g} Hz given"
        )
