"""Lines in time that stand out of series: at one frequency in all of them, in each with a phase of its own.

What comes with a motion differs from record to record as the motion does, and what runs beside the axis does not.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from .inverse import Observation

Array = NDArray[np.float64]

_FINER = 8  # times finer than a record tells two frequencies apart
_HARMONICS = range(1, 6)  # of a motion, which what it takes has too


class Line(NamedTuple):
    """A sine in time.

    Attributes:
        frequency: [Hz].
        share: of the square of the series, that it carries.
        moved: (harmonics,) of that of the velocity, or the speed, in half of the records: what stands at the frequency,
            and at those that it is the second harmonic of, the third ...
    """

    frequency: float
    share: float
    moved: Array


def line(
    seen: Sequence[Observation], values: Sequence[Array], periods: int, sense: Callable[[Array], Array] = np.ones_like
) -> Line:
    """The sine that carries most of series (m,) along records, of a frequency of 0 where they are too short.

    Args:
        seen: the records.
        values: of each.
        periods: at least, in the shortest record.
        sense: a sign by the velocity (m,), that the series are taken with.
    """
    least, most = periods / min(o.duration for o in seen), min(o.bandwidth for o in seen)
    if least >= most:
        return Line(0.0, 0.0, np.zeros(len(_HARMONICS)))
    velocity = [o.velocity[o.index] for o in seen]
    frequency = np.arange(least, most, 1 / (_FINER * max(o.duration for o in seen)))
    share = _carried(seen, [x * sense(v) for x, v in zip(values, velocity, strict=True)], frequency)
    best = int(np.argmax(share))
    below = np.array([frequency[best] / k for k in _HARMONICS])
    moves = [
        np.max([_carried([o], [x - np.mean(x)], below) for x in (v, np.abs(v))], 0)
        for o, v in zip(seen, velocity, strict=True)
    ]
    return Line(float(frequency[best]), float(share[best]), np.asarray(np.median(moves, 0)))


def _carried(seen: Sequence[Observation], values: Sequence[Array], frequency: Array) -> Array:
    """(f,) share of the square of series, that sines carry."""
    found = np.zeros(len(frequency))
    for o, x in zip(seen, values, strict=True):
        n = scipy.fft.next_fast_len(_FINER * len(x), real=True)
        found += np.interp(frequency, np.fft.rfftfreq(n, o.step), 2 * np.abs(np.fft.rfft(x, n)) ** 2 / len(x))
    return np.asarray(found / max(sum(float(x @ x) for x in values), 1e-300))
