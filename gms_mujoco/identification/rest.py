"""Rest: where an axis does not move, or by no more than its encoder resolves."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy
from numpy.typing import NDArray

from .readings import Readings

Mask = NDArray[np.bool_]

_STUCK = 1.5  # counts of the encoder
_WANDERS = 1.5  # times the mean square difference of neighbouring readings, that of those further apart
_STILL = 1e-5  # of the rms motion from sample to sample: an axis that moves less, and is seen to, rests
_AT_ONCE = 30.0  # times what it moved in the sample before: it stopped, and did not swing out
_SHORTEST = 0.125  # of a period: the shortest rest of an axis that comes to rest at once


@dataclass(frozen=True, eq=False)
class Rest:
    """Where the axis of a record rests.

    Attributes:
        readings: of its position.
        period: samples in a period of the highest frequency that is looked at.
    """

    readings: Readings
    period: int

    @cached_property
    def at_once(self) -> Mask:
        """(n,) whether the axis does not move at all until the next sample, in a log that would show it if it did.

        Where it comes to rest at once its contacts do not bend, as those of most simulations, and friction is whatever
        holds the axis. One that creeps, or swings out, tells of its friction as long as it moves.
        """
        moved = np.abs(np.diff(self.readings.record.position))
        least = _STILL * float(np.sqrt(np.mean(moved**2)))
        still = moved <= least
        stops = np.flatnonzero(still[1:] & ~still[:-1])
        fall = moved[stops] / np.maximum(moved[stops + 1], least / 10)
        rigid = still.all() or (len(fall) > 0 and np.median(fall) > _AT_ONCE)
        return np.append(still & (rigid and self.readings.count <= least), False)

    @cached_property
    def stuck(self) -> Mask:
        """(n,) where it moves by no more than its encoder resolves for as long as a period."""
        return self._held(self.period)

    @cached_property
    def briefly(self) -> Mask:
        """(n,) whether it does until the next sample, if only for a part of a period."""
        short = max(round(_SHORTEST * self.period), 1)
        still = scipy.ndimage.maximum_filter1d(self._held(short), short + 1)
        still[-1] = False
        return np.asarray(still)

    def beside(self, still: Mask) -> Mask:
        """(n,) samples around which it rests in part, with those around which it may, as it comes to rest, sets out or
        turns back, given the samples (n,) until the next of which it is still."""
        turns = np.zeros(len(still), bool)
        step = np.diff(self.readings.record.position)
        turns[1:-1] = step[1:] * step[:-1] < 0
        return np.asarray(
            scipy.ndimage.binary_dilation(still, [0, 1, 1, 1, 1])  # from one before a still interval to one after it
            | scipy.ndimage.binary_dilation(turns, [1, 1, 1])
        )

    def _held(self, samples: int) -> Mask:
        """(n,) where it moves by no more than its encoder resolves for so many samples around."""
        return np.asarray(self.readings.span(samples) <= self._within)

    @cached_property
    def _within(self) -> float:
        """By how much readings differ at rest [rad]: by counts of the encoder, or by as much noise, however it is made.

        Friction that bends within that noise is no rest: readings that lie apart differ by more than neighbours then.
        """
        counts, noise = _STUCK * self.readings.count, _STUCK * math.sqrt(12 * self.readings.variance)
        q, apart = self.readings.record.position, self.period
        if noise <= counts:
            return counts
        still = np.flatnonzero(self.readings.span(apart)[apart:-apart] <= noise) + apart
        before, after = q[still - apart // 2], q[still + apart // 2]
        rests = np.sum((after - before) ** 2) <= _WANDERS * np.sum((q[still + 1] - q[still]) ** 2)
        return noise if rests and len(still) > apart else counts
