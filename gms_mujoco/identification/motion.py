"""How a motion goes: where it turns round, how far and how long ago that was, and whether friction slides."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..plant import Plant
from .inverse import Observation

Array = NDArray[np.float64]

REGIMES = ("pre-sliding", "reversal", "sliding")
_SEEN = 4.0  # standard deviations of the encoder's noise: a smaller swing is not taken for a motion
_BROKEN_AWAY = 0.95  # of the level: friction within is taken to slide
_SLOWLY = 1e-6  # spans per second: slower than any Stribeck velocity


@dataclass(frozen=True)
class Swings:
    """A motion between its reversals, at m samples.

    Attributes:
        distance, time: since the last reversal [rad], [s]; NaN before the first.
        direction: of the swing, +1 or -1; 0 where nothing moves.
        length: of the whole swing, from reversal to reversal [rad].
    """

    distance: Array
    time: Array
    direction: Array
    length: Array

    @classmethod
    def of(cls, o: Observation) -> Swings:
        """Swings at the band-limited samples of an observation; those that encoder noise could make do not count."""
        return cls.between(o.record.time, o.position, _SEEN * float(np.std(o.record.position - o.position)), o.index)

    @classmethod
    def between(cls, time: Array, q: Array, least: float, index: NDArray[np.intp] | None = None) -> Swings:
        """Swings of a position (n,) at some of its samples, those shorter than `least` left out [s], [rad]."""
        index = np.arange(len(q)) if index is None else index
        turns = turning_points(q, least)
        marks = np.concatenate([[0], turns, [len(q) - 1]]).astype(int)
        k = np.searchsorted(turns, index, side="right")  # the mark before each sample
        begin, end = marks[k], marks[k + 1]
        known = k > 0
        distance = np.where(known, np.abs(q[index] - q[begin]), np.nan)
        time = np.where(known, time[index] - time[begin], np.nan)
        return cls(distance, time, np.sign(q[end] - q[begin]), np.abs(q[end] - q[begin]))

    def regime(self, break_away: float) -> NDArray[np.intp]:
        """(m,) number in `REGIMES` of each sample.

        Pre-sliding is a swing that ends before friction has turned round; what is left of the others within that
        distance of the reversal is "reversal", and the rest sliding.
        """
        turning = np.nan_to_num(self.distance, nan=np.inf) < break_away
        return np.where(self.length < break_away, 0, np.where(turning, 1, 2))


def turning_points(position: Array, least: float = 0.0) -> NDArray[np.intp]:
    """Samples at which a motion turns round, swings shorter than `least` left out."""
    step = np.sign(np.diff(position))
    moving = np.flatnonzero(step)
    turns = moving[1:][step[moving][1:] != step[moving][:-1]]
    out: list[int] = []
    direction, high, low, at_high, at_low = 0, position[0], position[0], 0, 0
    stops = np.append(turns, len(position) - 1)
    for i, q in zip(stops.tolist(), position[stops].tolist(), strict=True):
        if q > high:
            high, at_high = q, i
        if q < low:
            low, at_low = q, i
        if direction >= 0 and high - q > least:
            out += [at_high] if direction else []
            direction, low, at_low = -1, q, i
        elif direction <= 0 and q - low > least:
            out += [at_low] if direction else []
            direction, high, at_high = 1, q, i
    return np.array(out, int)


def virgin_curve(plant: Plant, span: float, points: int = 400) -> tuple[Array, Array]:
    """Friction torque against the distance moved slowly from rest, of a joint that never moved before.

    By Masing's rule the curve after a reversal is twice this one at half the distance.

    Args:
        span: to which distance [rad].

    Returns:
        (points,) distance, geometrically spaced [rad], and torque against the motion [N m].
    """
    distance = np.concatenate([[0.0], np.geomspace(1e-6 * span, span, points)])
    speed = _SLOWLY * span
    torque = plant.friction.joint().replay(distance / speed, distance, np.full(len(distance), speed)).torque
    return distance[1:], -torque[1:]


def break_away_distance(plant: Plant, span: float) -> float:
    """Distance after a reversal from sliding over which the friction of a plant turns round [rad].

    0 for a friction without memory.
    """
    distance, torque = virgin_curve(plant, span)
    if not torque[-1] > 0:
        return 0.0
    at = int(np.argmax(torque >= _BROKEN_AWAY * torque[-1]))
    return 2 * float(distance[at]) if at else 0.0
