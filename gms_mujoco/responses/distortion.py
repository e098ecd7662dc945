"""Nonlinear distortion of an axis, told from noise by the lines of a periodic signal that were not excited.

In a steady state noise differs from period to period, distortion does not. An odd multisine (see `excitation`) leaves
the even lines to nonlinearities that are even in the input, and those odd lines that were left out to the odd ones.
Across realisations of the phases distortion scatters like noise: `estimate_frf` of several records gives its variance
at the excited lines. Source: R. Pintelon and J. Schoukens, System Identification, 2nd ed. (2012), sections 4.2, 4.3.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..errors import DataError
from ..record import Record
from .spectra import period_spectra

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Distortion:
    """Amplitudes of one signal on each kind of line; a frozen value.

    Attributes:
        name: of the record.
        signal: whose amplitudes, such as "position".
        frequency, level: (m,) excited lines [Hz] and amplitudes there [unit of the signal].
        noise: (m,) standard deviation of a mean over the periods, there.
        even_frequency, even, even_noise: (a,) unexcited even lines, amplitudes, and their standard deviation.
        odd_frequency, odd, odd_noise: (b,) the same of odd ones.
    """

    name: str
    signal: str
    frequency: Array
    level: Array
    noise: Array
    even_frequency: Array
    even: Array
    even_noise: Array
    odd_frequency: Array
    odd: Array
    odd_noise: Array

    @property
    def even_share(self) -> float:
        """Rms of even distortion on a line, its noise taken off, over that of the signal on an excited line [1]."""
        return _share(self.even, self.even_noise, self.level)

    @property
    def odd_share(self) -> float:
        """The same of odd distortion."""
        return _share(self.odd, self.odd_noise, self.level)

    @property
    def noise_share(self) -> float:
        """Rms of the noise of the mean over that of the signal, on an excited line [1]."""
        return _rms(self.noise) / _rms(self.level)

    def __str__(self) -> str:
        parts = [f"even {100 * self.even_share:.2g} %"] if len(self.even) else []
        parts += [f"odd {100 * self.odd_share:.2g} %"] if len(self.odd) else []
        return (
            f"{self.name}: distortion of the {self.signal} per line, of an excited line: {', '.join(parts)}; "
            f"noise {100 * self.noise_share:.2g} %"
        )


def find_distortion(
    record: Record,
    lines: NDArray[np.int64],
    period: float,
    transient: int = 1,
    signal: str = "position",
    input: str = "torque",
) -> Distortion:
    """Tells noise, even and odd distortion apart in a record of a periodic excitation.

    What the input itself carries on the unexcited lines (a drive that distorts, a loop that answers) is passed through
    the response between the neighbouring excited lines and taken off the output: right to first order.

    Args:
        record: at least two periods after the transient.
        lines: (m,) excited, in multiples of 1 / period, as `Excitation.lines`; odd ones to tell even from odd.
        period: [s], a whole number of samples.
        transient: periods discarded at the start.
        signal, input: of the record.

    Raises:
        DataError: too few periods, no such signal, or every line is excited.
    """
    lines = np.unique(np.asarray(lines, int))
    n = round(period / record.sample_time)
    y, u = record.get(signal), record.get(input)
    if y is None or u is None:
        raise DataError(f"{record.name}: no signal {(signal if y is None else input)!r}")
    if len(record) < (transient + 2) * n:
        raise DataError(f"{record.name}: {len(record)} samples; {transient + 2} periods of {n} are needed")
    if not len(lines) or lines[0] < 1 or lines[-1] >= n / 2:
        raise DataError(f"{record.name}: excited lines must lie between 1 and {(n - 1) // 2}")
    others = np.setdiff1d(np.arange(lines[0], lines[-1] + 1), lines)
    if not len(others):
        raise DataError(f"{record.name}: every line is excited; distortion shows on others, as of an odd multisine")
    Y, U = (period_spectra(x, n, transient) for x in (y, u))
    response = Y[:, lines].mean(0) / U[:, lines].mean(0)
    size = np.exp(np.interp(others, lines, np.log(np.abs(response))))
    turn = np.interp(others, lines, np.unwrap(np.angle(response)))
    left = Y[:, others] - size * np.exp(1j * turn) * U[:, others]
    count = len(Y)
    scatter = np.sqrt(np.sum(np.abs(Y - Y.mean(0)) ** 2, 0) / (count - 1) / count)
    noise = np.sqrt(np.sum(np.abs(left - left.mean(0)) ** 2, 0) / (count - 1) / count)
    level, even = np.abs(left.mean(0)), others % 2 == 0
    return Distortion(
        record.name, signal, lines / period, np.abs(Y[:, lines].mean(0)), scatter[lines],
        others[even] / period, level[even], noise[even], others[~even] / period, level[~even], noise[~even],
    )  # fmt: skip


def _rms(x: Array) -> float:
    return float(np.sqrt(np.mean(x**2))) if len(x) else 0.0


def _share(level: Array, noise: Array, signal: Array) -> float:
    return math.sqrt(max(_rms(level) ** 2 - _rms(noise) ** 2, 0.0)) / _rms(signal)
