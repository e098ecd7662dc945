"""Positions that wrap: angles that have gone round, and counters that ran over."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ..errors import DataError

Array = NDArray[np.float64]

_COUNTERS = range(10, 33)  # bits of a counter that runs over
_WRAPS = 8.0  # times the steps around, that a jump of a counter is at least
_WHOLE = 1.01  # of what a counter holds, with room for how its ends were written


def unwrapped(
    position: Array, kind: str = "hinge", count: float | None = None, what: str = "position"
) -> tuple[Array, str | None]:
    """Position without the jumps of a hinge that has gone round or of a counter that ran over; a sentence where there
    were any.

    Args:
        position: (n,) [rad or m].
        kind: of the joint.
        count: position of one encoder count [rad or m], None where unknown.
        what: how it is called in messages.

    Raises:
        DataError: it jumps by 360 rad, as degrees do.
    """
    step = np.diff(position)
    if not len(step):
        return position, None
    if kind == "hinge":
        if (jumps := _alone(step, 360.0)).any():
            raise DataError(f"{what} jumps by 360 rad at {int(jumps.sum())} samples, as degrees do: say units = "
                            f'{{ {what.split()[0]} = "deg" }}')
        smooth = _without(position, step, 2 * math.pi)
        if smooth is not None:
            jumps = np.abs(step) > math.pi
            return smooth, f"{what} jumps by a whole revolution at {int(jumps.sum())} samples: unwrapped"
    for bits in _COUNTERS if count else ():
        size = float(count or 0.0) * 2**bits
        if (jumps := _alone(step, size)).any() and (smooth := _without(position, step, size)) is not None:
            return smooth, (f"{what} jumps by {2**bits} counts at {int(jumps.sum())} samples, as a counter of {bits} "
                            "bits does: unwrapped")
    return position, None


def _alone(step: Array, size: float) -> NDArray[np.bool_]:
    """(n,) which steps are one of a size, or none less, between small ones."""
    small = size / _WRAPS
    near = np.abs(np.abs(step) - size) < small
    calm = np.concatenate([[True, True], np.abs(step) < small, [True, True]])
    return near & calm[1:-3] & calm[:-4] & calm[3:-1] & calm[4:]


def _without(position: Array, step: Array, size: float) -> Array | None:
    """Position without jumps by a size and its multiples; None where there are none, or where it still jumps.

    What runs over at a size reads no more than that: positions that lie further apart only moved as fast, or were held
    for several rows, as those are that come at a lower rate than the torque.
    """
    jumps = np.abs(step) > size / 2
    if not jumps.any() or jumps.mean() > 0.1 or np.ptp(position) > _WHOLE * size:
        return None
    turns = -np.round(step / size) * jumps
    smooth = position + size * np.concatenate([[0.0], np.cumsum(turns)])
    # Beside a true wrap the joint goes on as before; anything else is for the user to look at.
    if np.abs(np.diff(smooth)).max() > max(4 * np.quantile(np.abs(step[~jumps]), 0.99), 1e-3):
        return None
    return smooth


def turn(raw: Array, smooth: Array) -> float:
    """What `unwrapped` took a jump for that it has taken out of positions (n,) [rad or m]."""
    return float(np.abs(np.diff(smooth - raw)).max())


def beside(goal: Array, position: Array, size: float) -> Array:
    """Goals (n,) in the turns of positions (n,) that were unwrapped [rad].

    A goal that stays within a turn wraps as the positions did, though not at the same samples: between two of its jumps
    it is in the turn in which most of them are next to it. One that goes further counts its turns itself.

    Args:
        size: of a turn [rad].
    """
    jumps = (np.abs(np.diff(goal)) > size / 2) & (np.ptp(goal) <= _WHOLE * size)
    stretch = np.concatenate([[0], np.cumsum(jumps)])
    turns = [np.round(np.median((position - goal)[stretch == i]) / size) for i in range(stretch[-1] + 1)]
    return goal + size * np.array(turns)[stretch]
