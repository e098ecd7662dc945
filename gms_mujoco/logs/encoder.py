"""Positions that an encoder reads in whole counts: how large one is, and where the joint was between two of them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..record import Record

Array = NDArray[np.float64]

_WHOLE = 0.1  # of a count: steps that are off by less are one


def count_size(record: Record) -> float:
    """Position of one encoder count: declared, or read off as the common step of the positions; 0 if none."""
    return record.resolution or common_step(record.position)


def common_step(position: Array) -> float:
    """The step that positions (n,) are multiples of; 0 if none."""
    steps = np.abs(np.diff(np.unique(position)))
    steps = steps[steps > 1e-12 * max(np.ptp(position), 1e-300)]
    if not len(steps):
        return 0.0
    smallest = float(np.min(steps))
    smallest = float(steps.sum() / np.round(steps / smallest).sum())  # without what few digits do to one of them
    off = np.abs(position / smallest - np.round(position / smallest))
    return smallest if np.mean(off < 0.1) > 0.9 else 0.0


def between_counts(position: Array, count: float, steady: NDArray[np.bool_], period: int) -> Array:
    """(n,) where a joint was that an encoder read at `position` (n,), by the instants at which a reading changed.

    Then the joint passed the edge between two counts, which says more than a reading that may be off by half a count.
    From the edge that it came in by to the next one it goes straight; where it hovers about one edge, back and forth
    more than once and faster than anybody looks, it rests there. Readings have it jump by a count each time, and
    friction that follows every turn, as the bristle of LuGre does, lets go of a load that it would hold. Where it turns
    back once, or moves more than a count between samples, the readings stand.

    Args:
        count: position of one count; 0: readings are taken as they are.
        steady: (n,) where the torque is; elsewhere the joint may swing within a count, of which readings show a part.
        period: samples between two changes, above which it does not hover.
    """
    steps = np.diff(position)
    changes = np.flatnonzero(steps)
    if not count or len(changes) < 2:
        return position
    step, edge = steps[changes], (position[changes] + position[changes + 1]) / 2
    one = np.abs(np.abs(step) / count - 1) < _WHOLE
    onward, turns = (one[1:] & one[:-1] & (way * step[1:] * step[:-1] > 0) for way in (1, -1))
    beside = np.concatenate([[False], turns, [False]])
    hovers = turns & (beside[:-2] | beside[2:]) & (np.diff(changes) <= period)
    run = np.concatenate([[0], np.cumsum(steps != 0)])  # of equal readings, the first before any change
    straight = np.concatenate([[False], onward | hovers, [False]]) & (np.bincount(run, ~steady) == 0)
    inside = np.flatnonzero(straight[run])
    k = run[inside] - 1  # the change that it begins with
    passed = (inside - changes[k] - 0.5) / (changes[k + 1] - changes[k])
    out = position.copy()
    out[inside] = edge[k] + passed * (edge[k + 1] - edge[k])
    return out
