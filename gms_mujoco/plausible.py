"""Is a measurement what it says: ends without numbers, positions that wrap, units and signs that cannot be right."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from .errors import DataError
from .inverse import Observation
from .plant import Plant
from .record import Record

Array = NDArray[np.float64]

_SLOW = 0.2  # s; nobody controls a joint at longer samples
_OFF = 5.0  # times an inertia: more than a wrong guess
_FEW = 150  # samples, of which a friction model cannot be told from noise
_ENOUGH = 500  # samples, to say anything about signs
_CAUGHT_UP = 4.0  # counts, in one sample: less is no sign of anything
_JUMP = 0.6  # of one distance to another, that are taken to be the same
_OFTEN = 0.1  # of the samples of a record: an encoder that is held so often is slow, and not interrupted
_FACTORS = {180 / math.pi: "deg read as rad", 1000.0: "a factor of 1000", 2 * math.pi: "revolutions read as rad"}


def trimmed(columns: dict[str, Array]) -> tuple[slice, str | None]:
    """Leaves out rows at the start and the end that are not all numbers, in place; those left, and a sentence where
    there are others.

    A logger that stops in the middle of a row, or starts before all its sources do, writes such rows. Those in the
    middle stay: nobody knows what happened there.
    """
    lengths = {len(c) for c in columns.values()}
    everything = slice(None)
    if len(lengths) != 1:
        return everything, None
    whole = np.flatnonzero(np.all([np.isfinite(c) for c in columns.values()], axis=0))
    n = lengths.pop()
    if not len(whole) or len(whole) == n:
        return everything, None
    first, last = int(whole[0]), int(whole[-1]) + 1
    if (first, last) == (0, n) or first + n - last > n // 10:
        return everything, None
    for key, value in columns.items():
        columns[key] = value[first:last]
    return slice(first, last), f"{first} samples at the start and {n - last} at the end are not all numbers: left out"


def unwrapped(position: Array, what: str = "position") -> tuple[Array, str | None]:
    """Position of a hinge without jumps by whole revolutions, and a sentence where there were any."""
    step = np.diff(position)
    jumps = np.abs(step) > math.pi
    if not jumps.any() or jumps.mean() > 0.1:
        return position, None
    turns = -np.round(step / (2 * math.pi)) * jumps
    smooth = position + 2 * math.pi * np.concatenate([[0.0], np.cumsum(turns)])
    # Beside a true wrap the joint goes on as before; anything else is for the user to look at.
    if np.abs(np.diff(smooth)).max() > max(4 * np.quantile(np.abs(step[~jumps]), 0.99), 1e-3):
        return position, None
    return smooth, f"{what} jumps by a whole revolution at {int(jumps.sum())} samples: unwrapped"


def filled(record: Record) -> tuple[Record, int]:
    """The record with positions in the place of readings that were held, and how many were.

    A bus that loses a frame, or an encoder that drops out, repeats its last reading while the axis moves on, and then
    catches up in one sample what the axis has gone in several, which no mass can do. The motion before and after, a
    polynomial of third degree, says where the axis was. Where the axis rests nothing is changed, nor where every few
    readings are repeated.
    """
    q = record.position.copy()
    least = _CAUGHT_UP * (record.resolution or 0.0)
    still = np.concatenate([[False], np.diff(q) == 0, [False]])
    edges = np.flatnonzero(np.diff(still.astype(int)))
    held = 0
    for first, last in zip(edges[::2] + 1, edges[1::2] + 1, strict=True):  # repeat the one before; `last` is new
        n = int(last - first)
        wide = max(2 * n, 8)
        if first - 1 < wide or last + wide >= len(q):
            continue
        before, after = q[first - 1 - wide : first], q[last : last + wide + 1]
        caught_up = q[last] - q[first - 1]
        usual = (n + 1) * (before[-1] - before[0] + after[-1] - after[0]) / (2 * wide)
        pace = max(np.median(np.abs(np.diff(before))), np.median(np.abs(np.diff(after))))
        if abs(caught_up) > max(least, pace / _JUMP) and usual and _JUMP < caught_up / usual < 1 / _JUMP:
            t = (np.arange(first - 1 - wide, last + wide + 1) - first) / wide
            known = np.abs(t - (n - 1) / (2 * wide)) > n / (2 * wide)
            curve = np.polyfit(t[known], np.concatenate([before, after]), 3)
            q[first:last] = np.polyval(curve, t[~known])
            held += n
    if not held or held > _OFTEN * len(q):
        return record, 0
    return replace(record, signals={**record.signals, "position": q}), held


def doubts(records: Sequence[Record], inertia: float | None, kind: str) -> list[str]:
    """What a user may want to know before trusting a result, one sentence each.

    Args:
        records: of one axis.
        inertia: that was given, None where it is to be identified.
        kind: "hinge" or "slide".

    Raises:
        DataError: the torque works against the motion, which no mechanism does.
    """
    said = []
    unit = "kg m^2" if kind == "hinge" else "kg"
    longest = max(records, key=lambda r: r.sample_time)
    if longest.sample_time > _SLOW:
        said.append(f"{longest.name}: samples are {longest.sample_time:g} s apart; if its time is in milliseconds, say "
                    'units = { time = "ms" }')
    for r in records:
        if n := filled(r)[1]:
            said.append(f"{r.name}: the position repeats its last reading at {n} samples while the axis moves: "
                        "filled in")
    fitted = [r for r in records if r.use == "fit"]
    if fitted and sum(map(len, fitted)) < _FEW:
        said.append(f"only {sum(map(len, fitted))} samples to fit: too few to tell friction from noise, or one effect "
                    "from another")
    found = _rough(fitted or list(records))
    if found is None or sum(map(len, fitted or records)) < _ENOUGH:
        return said
    rough, dissipated, share = found
    if dissipated < 0 and (rough < 0 or share < 0.05):
        raise DataError(
            f"the torque works against the motion: the records show an inertia of {rough:.3g} {unit} and friction that "
            "drives the joint; torque or position has the wrong sign, try scale = { torque = -1 } (a negative "
            "torque_constant for current)"
        )
    if inertia is not None and share > 0.2 and rough > 0:
        ratio = max(rough / inertia, inertia / rough)
        if ratio > _OFF:
            hint = next((f", which is {text}" for f, text in _FACTORS.items() if abs(ratio / f - 1) < 0.3), "")
            said.append(f"the records look like an inertia of about {rough:.2g} {unit}, but {inertia:.3g} {unit} is "
                        f"given: {ratio:.3g} times off{hint}")
    return said


def _rough(records: Sequence[Record]) -> tuple[float, float, float] | None:
    """Rough inertia, rough power that friction takes [W], and the share of inertia in the torque (rms).

    By least squares of the torque on acceleration, direction, velocity and what a position alone determines.
    """
    tops, sides, speeds = [], [], []
    none = Plant.axis(1.0)
    for r in records:
        if len(r) < 64:
            continue
        o = Observation(r, 1 / (20 * r.sample_time))
        q, v = o.position[o.index], o.velocity[o.index]
        tops.append(np.stack([o.acceleration, np.sign(v), v, np.ones_like(v), q, np.sin(q), np.cos(q)], 1))
        sides.append(o.applied(none) + o.replay(none))  # without what a robot's rigid bodies take
        speeds.append(v)
    if not tops:
        return None
    a, y, v = np.concatenate(tops), np.concatenate(sides), np.concatenate(speeds)
    scale = np.maximum(np.sqrt(np.mean(a**2, 0)), 1e-300)
    x = np.linalg.lstsq(a / scale, y, rcond=1e-6)[0] / scale
    friction = x[1] * np.sign(v) + x[2] * v
    total = float(np.sqrt(np.mean(y**2)))
    if total == 0 or float(np.std(y - a @ x)) > 0.7 * total:  # this says too little about the torque
        return None
    power = float(np.mean(friction * v))
    if abs(power) < 0.1 * float(np.mean(np.abs(y * v))):
        power = 0.0
    return float(x[0]), power, abs(float(x[0])) * float(scale[0]) / total
