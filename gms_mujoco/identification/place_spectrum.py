"""Waves over the place that stand out of a series, however many there are to a revolution or a metre.

Teeth, poles and rollers come in any number, behind a gear in hundreds: the wave generator of a strain wave gear turns a
hundred times to one turn of the joint. A replay for each would take too long. The sum of a residual times
exp(-i n q), q the place of each value, is a Fourier transform over the revolution, all n at once.
"""

from __future__ import annotations

import math

import numpy as np
import scipy
from numpy.typing import NDArray

Array = NDArray[np.float64]

_STANDS_OUT = 15.0  # times the median over the harmonics of the square, which noise passes once in 3e4
_MOST = 8  # harmonics
_SPIKE = 4.0  # times the median of what is left, that counts
_CELLS, _PADDED = 2**16, 4  # of the place, and times its span
_PERIODS = 3  # passed through at least
_BINS = 8  # of the revolution, to a period


def standing_out(place: Array, values: Array, least: int, most: int, turn: float = 2 * math.pi) -> list[int]:
    """The harmonics from `least` to `most` whose square stands out of that of the others, the strongest first.

    Args:
        place: (m,) [rad or m].
        values: (m,) that may depend on it.
        least, most: periods in a revolution.
        turn: length of one [rad or m].
    """
    if most <= least or not len(place):
        return []
    values = np.clip(values, *(_SPIKE * np.median(np.abs(values)) * np.array([-1, 1])))  # reversals have all harmonics
    n = 2 ** math.ceil(math.log2(_BINS * most))
    bins = np.floor(np.mod(place, turn) * (n / turn)).astype(np.intp) % n
    power = np.abs(np.fft.rfft(np.bincount(bins, values, n)))[least : most + 1] ** 2
    # On less than a revolution a line is as wide as that is less.
    width = math.floor(turn / max(float(np.ptp(place)), turn / (most + 1)))
    tops = power == scipy.ndimage.maximum_filter1d(power, 2 * width + 1)
    peaks = np.flatnonzero(tops & (power > _STANDS_OUT * np.median(power)))
    return [int(k) + least for k in peaks[np.argsort(power[peaks])[::-1][:_MOST]]]


def wave(place: Array, values: Array, factor: Array) -> tuple[float, float]:
    """The period [rad or m] of the sine over the place that carries most of the square of a series, and its share.

    Of periods that the motion passes through several times, beyond what chance gives.

    Args:
        place: (m,) [rad or m].
        values: (m,) that may depend on it.
        factor: (m,) by which the sine is multiplied.
    """
    span, total = float(np.ptp(place)), float(values @ values) * float(np.mean(factor**2))
    if not (span > 0 and total > 0):
        return math.inf, 0.0
    length = _PADDED * span  # finer in frequency than the lines are wide
    bins = np.minimum((place - place.min()) * (_CELLS / length), _CELLS - 1).astype(np.intp)
    power = np.abs(np.fft.rfft(np.bincount(bins, values * factor, _CELLS))) ** 2
    first = _PERIODS * _PADDED
    best = int(np.argmax(power[first : _CELLS // _BINS])) + first
    share = (2 * float(power[best]) / total - 2 * math.log(_CELLS)) / len(values)
    return length / best, min(max(share, 0.0), 1.0)
