"""A position that is read at a lower rate than the torque, or a torque than the position, and held between.

A logger that asks a slow bus, or merges topics of two rates, repeats the last position until the next one comes. Taken
row by row such an axis stands and leaps; only where it was read is anything known of its motion. So these rows are
kept, and the torque between two of them is averaged, which moves the axis as much.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from .timing import HELD

Array = NDArray[np.float64]

_FEWEST = 20  # changes of a signal, to tell how often it is read
_SLOWEST_STEPS = 3.0  # times the smallest step of a signal: a coarse encoder changes by one at a time
_LONGEST = 1.5  # times the usual number of rows between two changes, that are no longer those of one reading
_JITTER = 0.25  # of a row, by which a reading may come early or late
_ROUNDING = 1e-9  # of a row
_SETTLED = 5  # rounds, in which readings are counted and their period fitted


@dataclass(frozen=True)
class Readings:
    """When a signal is read: at rows `first + k * every`, k = 0, 1, ...; neither need be a whole number.

    Attributes:
        first: row at which the first reading was made.
        every: rows from one reading to the next.
        shown: rows until each has shown.
    """

    first: float
    every: float
    shown: float = 0.0

    @classmethod
    def of(cls, signal: Array) -> Self | None:
        """Those of a signal (n,) by the rows at which it changes; None where it is read at every row, or hardly
        changes."""
        steps = np.diff(signal)
        changes = np.flatnonzero(steps) + 1
        size = np.abs(steps[changes - 1])
        if len(changes) <= _FEWEST or np.median(size) < _SLOWEST_STEPS * size.min():
            return None
        apart = np.diff(changes)
        every = float(np.gcd.reduce(apart))
        if every > 1:  # both by one clock
            return cls(float(changes[0] % every), every)
        every = float(np.mean(apart[apart <= _LONGEST * np.median(apart)]))
        if every < 2 - _JITTER:
            return None
        for _ in range(_SETTLED):
            count = np.concatenate([[0], np.cumsum(np.maximum(np.round(apart / every), 1))])
            every = float(np.polyfit(count, changes, 1)[0])
        # A reading shows in the first row after it.
        early, late = (float(end(changes - every * count)) for end in (np.min, np.max))
        if late - early > 1 + 2 * _JITTER:
            return None
        return cls((early + late - 1) / 2 % every, every, (late - early + 1) / 2)

    def at(self, rows: int) -> Array:
        """(k,) rows, whole or not, at which the signal was read among so many."""
        return np.arange(self.first, rows - max(self.every, self.shown), self.every)

    def seen(self, rows: int) -> NDArray[np.bool_]:
        """(n,) which rows these readings stand in, among so many."""
        seen = np.zeros(rows, bool)
        seen[np.floor(self.at(rows) + self.shown + _ROUNDING).astype(int)] = True
        return seen

    def kept(self, signals: Mapping[str, Array], read: str) -> dict[str, Array]:
        """Signals (k,) at the readings of one of them, of such (n,): that as it was read, with positions a torque or
        current as its mean to the next reading, time and the rest interpolated."""
        rows = len(signals["time"])
        at, seen, out = self.at(rows), self.seen(rows), {}
        for name, x in signals.items():
            if name in HELD and read not in HELD:
                total = np.concatenate([[0.0], np.cumsum(x)])
                ends = np.interp(np.append(at, at[-1] + self.every), np.arange(len(total)), total)
                out[name] = np.diff(ends) / self.every
            else:
                out[name] = x[seen] if name.startswith(read) else np.interp(at, np.arange(rows), x)
        return out

    def told(self, time: Array, read: str) -> str:
        """What was done to rows at times (n,) [s] by the readings of a signal, a sentence."""
        rate = (len(time) - 1) / (time[-1] - time[0]) / self.every
        beside = "" if read in HELD else ", torque averaged from each to the next"
        return (f"{read} changes at every {self.every:.4g} rows only, as one that is read at {rate:.4g} Hz and held: "
                f"these rows are kept{beside}")  # fmt: skip
