"""Readings: what an encoder's positions show of a motion, and how much of them is noise."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy
from numpy.typing import NDArray

from ..logs.encoder import count_size
from ..record import Record
from .between_samples import second_difference

Array = NDArray[np.float64]

_BINS = 25  # of a spectrum's frequencies, whose median is taken
_CLEAR = 4  # times the noise, above which a spectrum is the motion's
_RIPPLE = 100.0  # dB, of the filter that takes the noise off the position
_WHOLE = 0.45  # of the sampling rate: what is cut off above it is not worth a filter


@dataclass(frozen=True, eq=False)
class Readings:
    """The positions of a record as its encoder read them.

    Attributes:
        record: the run.
    """

    record: Record

    @cached_property
    def count(self) -> float:
        """Position of one count of the encoder; 0 if there is none [rad]."""
        return count_size(self.record)

    @cached_property
    def variance(self) -> float:
        """Of the readings, by the encoder's counts and by whatever else is white in them [rad^2]."""
        f, density, noise = self._spectrum
        high = (f > 0.25 / self.record.sample_time) & (density > 0)
        variance = 0.0
        if high.any():
            # White noise of the position, and two ways for an acceleration to fall: what the upper half is made of.
            shapes = np.stack([noise, np.ones_like(f), f**-2.0], 1)[high] / density[high, None]
            scale = shapes.max(0)
            variance = float(scipy.optimize.nnls(shapes / scale, np.ones(len(shapes)))[0][0] / scale[0])
        return max(variance, (self.record.resolution or 0.0) ** 2 / 12)

    @cached_property
    def clear_up_to(self) -> float:
        """Highest frequency at which they are more motion than noise; 0 if there is none [Hz]."""
        f, density, noise = self._spectrum
        said = np.flatnonzero(density > _CLEAR * self.variance * noise)
        return float(f[said[-1]]) if len(said) else 0.0

    @cached_property
    def _spectrum(self) -> tuple[Array, Array, Array]:
        """(k,) frequencies [Hz], spectral density there of the acceleration that the readings show, and that of white
        noise of the position per variance; nothing of a record that is too short."""
        h = self.record.sample_time
        a = second_difference(self.record.position, h)[1:-1]
        segment = min(1024, len(a) // 4)
        if segment < 8 * _BINS:
            return np.empty(0), np.empty(0), np.empty(0)
        f, density = scipy.signal.welch(a, 1 / h, nperseg=segment, average="median", detrend="linear")
        f, density = f[1:-1], scipy.signal.medfilt(density, _BINS)[1:-1]
        return f, density, 2 / h**3 * (2 * np.sin(np.pi * f * h)) ** 4

    def span(self, samples: int) -> Array:
        """(n,) by how much they differ over so many samples around each [rad]."""
        q, long = self.record.position, samples + 1
        return np.asarray(scipy.ndimage.maximum_filter1d(q, long) - scipy.ndimage.minimum_filter1d(q, long))


def smoothed(position: Array, sample_time: float, cutoff: float) -> Array:
    """(n,) positions without what is faster than a frequency [Hz]."""
    edge = 1.25 * cutoff * sample_time  # of the samples
    if edge > _WHOLE:
        return position
    # A ripple in the passband would shorten every stroke, and make springs look stiffer.
    length, beta = scipy.signal.kaiserord(_RIPPLE, 0.8 * edge)
    half = min(max(length // 2, 2), len(position) // 4)
    head, tail = 2 * position[0] - position[half:0:-1], 2 * position[-1] - position[-2 : -half - 2 : -1]
    kernel = scipy.signal.firwin(2 * half + 1, edge, window=("kaiser", beta), fs=1.0)
    return np.asarray(scipy.signal.oaconvolve(np.concatenate([head, position, tail]), kernel, "valid"))
