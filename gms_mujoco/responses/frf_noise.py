"""How noisy responses are that come without a deviation: how far points stand from a smooth curve through neighbours.

Averaging leaves a share of the response, the encoder an error of the position and the drive one of the torque, which
are the same at every point. The three are told from all points of an axis together, beside the response of a plant: its
resonances bend a curve between few points as noise would. Without a plant each response has a share of its own. A
coherence says which points are worse than others; over how many averages it was told nobody knows, so it says no more.

Sources: Bendat and Piersol, Random Data, 4th ed. (2010), table 9.6, for the coherence; Kotz and Nadarajah, Multivariate
t Distributions and Their Applications (2004), for what bends the curve nevertheless.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..frf import FRF
from ..identification.variances import likeliest

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

_FEWEST = 4  # points with neighbours, from which noise can be told
_QUANTILE = 0.3
_MOST = 0.3  # of a response: nobody keeps a point that is noisier, and a plant that makes one so lacks something
_COHERENT = 0.999  # coherence: files round what is closer to 1, and that it tells no more
_OF_NORMAL = 0.6100  # variance that the distribution with long tails gives to a complex normal one of variance 1


def beside(frfs: Sequence[FRF], models: Sequence[Complex]) -> list[Array] | None:
    """(n,) standard deviation of each response relative to its size; None where no plausible one is told.

    Args:
        frfs: torque to position of one axis, amplitudes known.
        models: (n,) response of a plant to each.
    """
    gaps = _gaps(frfs, models)
    if len(gaps.square) < _FEWEST:
        return None
    variance = _told(gaps)
    found = [np.sqrt(_sources(f) @ variance) for f in frfs]
    most = max(float((x / incoherence(f)).max()) for x, f in zip(found, frfs, strict=True))
    return found if most < _MOST else None


def incoherence(frf: FRF) -> Array:
    """(n,) by which a point is worse than the good ones of its response, by its coherence; 1 where nothing says that.

    The deviation of a response goes with sqrt((1 - c) / c) at a coherence c.
    """
    if frf.coherence is None or has_sigma(frf):
        return np.ones(len(frf))
    c = np.clip(frf.coherence, 1 - _COHERENT, _COHERENT)
    share = np.sqrt((1 - c) / c)
    return np.asarray(np.maximum(share / np.quantile(share, _QUANTILE), 1.0))


def has_sigma(frf: FRF) -> bool:
    """Whether the deviation of the response was measured."""
    return frf.sigma is not None and bool(np.any(frf.sigma > 0))


def roughness(frf: FRF) -> float:
    """How far a good point is from a smooth curve through its four neighbours, relative; nan with fewer than 8 points.

    Most of what bends the curve is kept out by a low quantile over the points.
    """
    if len(frf) < _FEWEST + 4:
        return math.nan
    gaps = _gaps([frf])
    off = np.sqrt(gaps.square / gaps.parts[:, 0])
    return float(np.quantile(off, _QUANTILE)) / math.sqrt(-math.log(1 - _QUANTILE))  # of a circular normal one


@dataclass(frozen=True)
class _Gaps:
    """Points against the curve through their four neighbours.

    Attributes:
        square: (m,) of the distance.
        parts: (m, 3) what a unit of each source's variance adds to it.
    """

    square: Array
    parts: Array


def _gaps(frfs: Sequence[FRF], models: Sequence[Complex] | None = None) -> _Gaps:
    """The curve is a parabola through 1 / G over w, which a resonance of one mass does not bend."""
    square, parts = [], []
    for k, frf in enumerate(frfs):
        x, y, sources = frf.omega, 1 / frf.response, _sources(frf)
        left = y if models is None else y - 1 / models[k]
        for i in range(2, len(frf) - 2):
            near = np.array([i - 2, i - 1, i + 1, i + 2])
            curve = np.linalg.pinv(np.vander((x[near] - x[i]) / np.ptp(x[near]), 3))[-1]
            at, by = np.append(i, near), np.append(1.0, -curve)
            square.append(abs(by @ left[at]) ** 2)
            parts.append((by * np.abs(y[at])) ** 2 @ sources[at])
    return _Gaps(np.array(square), np.reshape(parts, (-1, 3)))


def _sources(frf: FRF) -> Array:
    """(n, 3) relative variance that a unit of variance makes: of the response, of the position and of the torque."""
    one, worse = np.ones(len(frf)), incoherence(frf)[:, None] ** 2
    if frf.amplitude is None:
        return worse * np.column_stack([one, np.zeros((len(frf), 2))])
    return worse * np.column_stack([one, 1 / frf.amplitude**2, np.abs(frf.response / frf.amplitude) ** 2])


def _told(gaps: _Gaps) -> Array:
    """(3,) variances of the sources of which the gaps are most likely, those that are far off counting for little."""
    units = np.median(gaps.parts, axis=0)
    parts = gaps.parts / units
    square = np.maximum(gaps.square, np.finfo(float).tiny)
    begin = np.full(3, float(np.median(square / parts.sum(axis=1))))
    return np.asarray(likeliest(parts, square, begin, long_tails=True) / units / _OF_NORMAL)
