"""Is a measurement what it says: readings that failed or were held, units and signs that cannot be right."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence

import numpy as np
import scipy
from numpy.typing import NDArray

from ..errors import DataError
from ..frf import FRF
from ..record import Record
from .rough_inertia import RoughInertia, Rows, rough_inertia, rough_inertia_of, rough_inertia_of_responses, rows_of
from .slow_signal import Readings

Array = NDArray[np.float64]

_ALIKE = 0.8  # squared correlation of two signals that are one in two units
_OTHER_UNIT = 1.5  # times; by less a filter may weaken a velocity
_EXACTLY = 0.02  # of a factor between two units
_SPEEDS = {"hinge": {"rpm": 30 / math.pi, "deg/s": 180 / math.pi, "rps": 0.5 / math.pi},
           "slide": {"mm/s": 1e3, "cm/s": 1e2, "um/s": 1e6}}  # times rad/s or m/s
_PLACES = {"hinge": {"deg": 180 / math.pi, "rev": 0.5 / math.pi}, "slide": {"mm": 1e3, "cm": 1e2, "um": 1e6}}
_LEAP, _FAR = 20.0, 50.0  # times what an axis goes in nearly all samples, and in those around: no motion
_MOST = 0.9  # of the samples in which an axis moves
_LEAST_LEAP, _FEWEST_COUNTS = 10.0, 4.0
_OFF, _ABSURD = 5.0, 1e3  # times an inertia: more than a wrong guess, and more than there can be anything in
_APART = 10.0  # times, by which rough inertias differ: what friction hides of one makes it four times another
_ROUGHLY = 0.4  # of a ratio of rough inertias, by which it may be off
_ALIKE_ROUGHLY = 2.5  # times, by which they are those of one axis
_HARDLY_ANY = 0.05  # of the torque, that is an inertia's: its sign says nothing
_AS_FACTOR = 0.1  # of a factor between two units, by which a ratio may be off
# Of the rows, at which a torque stands at its largest, that say anything; one that switches between its ends stands
# there nearly always, and one of moves and rests has few levels between.
_AT_END, _MOST_AT_END = 0.003, 0.8
_FEW_ROWS, _SLOPE = 3, 4  # that a failed reading lasts at most, and that tell how fast an axis is beside it
_RARE, _FAR_TORQUE = 0.02, 8.0  # of the rows leap, and by so many times what the others do at most
_SPIKE = 10.0  # times what a motion is off a curve through the rows around, and bends there: a reading that failed
_NO_TORQUE = 10.0  # times the largest torque of a record: none that acted
_LATE = (8, 16, 32)  # rows within which a drive that lags or a log that is late has an axis answer
_NEARLY_BACK = 0.5  # of how far it leaps away, by which a torque that comes back may be off
_BEYOND = 2.0  # times the largest torque of the other rows
_SEEN, _HALF = 5.0, 0.5  # times what a velocity changes by anyway; of the change that is due
_STAYS = 10  # rows there after another
# Rows without a torque, of which one is that stays so small beside nearly the largest; and by how much of its largest
# speed an axis does not speed up there by itself.
_LONG, _IDLE, _GATHERS = 100, 0.01, 0.3
_MANY_LEVELS = 50  # of a torque: of fewer it is a command in steps
_FEW = 150  # samples, of which a friction model cannot be told from noise
_ENOUGH = 500  # samples, to say anything about signs
_CAUGHT_UP = 4.0  # counts, in one sample: less is no sign of anything
_FEWEST_BESIDE = 6  # samples that say how fast an axis was where its reading is held
_JUMP = 0.6  # of one distance to another, that are taken to be the same
_OFTEN = 0.1  # of the samples of a record: an encoder that is held so often is slow, and not interrupted
_MANY_PLACES = 20  # an axis that moves
_MOST_IN_TURNS, _IN_TURNS = 12, 3.0  # axes in one log; times what such an axis goes from one of its rows to the next
_FACTORS = {180 / math.pi: "deg read as rad", 1000.0: "a factor of 1000", 2 * math.pi: "revolutions read as rad"}


def back_and_forth(position: Array) -> int:
    """Every how many rows a position (n,) continues that goes back and forth between them; 0 where it does not.

    No axis does: its rows are those of several.
    """
    whole = position[np.isfinite(position)]
    if len(np.unique(whole)) < _MANY_PLACES:  # a count of an encoder, back and forth
        return 0
    step = [float(np.mean(np.abs(whole[k:] - whole[:-k]))) for k in range(1, min(_MOST_IN_TURNS, len(whole) - 1) + 1)]
    if len(step) < 2 or step[0] <= _IN_TURNS * min(step[1:]):
        return 0
    return int(np.argmin(step)) + 1


def leap(position: Array, count: float | None = None, stays: bool = False) -> int | None:
    """The first sample that no joint can have come to from the one before: a reading that failed, a counter that began
    anew; None where there is none.

    Between one sample and the next an axis goes little further than between those around them, and never many times as
    far as in nearly all others in which it moves: behind a coarse encoder a slow axis rests and steps by a count.

    Args:
        position: (n,) of a joint.
        count: position of one encoder count; None where unknown.
        stays: pass over what comes back a few samples later, see `without_spikes`.
    """
    step, leaps = np.diff(position), []
    size = np.abs(step)
    usual = max(float(np.quantile(size, 0.99)), float(np.quantile(size[size > 0], _MOST)) if size.any() else 0.0)
    for i in np.flatnonzero(size > max(_LEAP * usual, _LEAST_LEAP * (count or 0.0), 1e-9 * np.ptp(position))).tolist():
        near = np.arange(max(i - 3, 0), min(i + 4, len(step)))
        near = near[(near != i) & (step[near] * step[i] >= -(size[i] ** 2) / 2)]  # unless it leaps back
        if _FAR * size[near].max(initial=0.0) < size[i]:
            leaps.append(i + 1)
    if stays and leaps:
        spikes = _spikes(position, count)[0]
        leaps = np.setdiff1d(leaps, [spikes, spikes + 1]).tolist()  # there, and where it comes back
    return leaps[0] if leaps else None


def without_spikes(records: Sequence[Record], inertia: float | None) -> tuple[list[Record], list[str]]:
    """Records without positions of a few rows that leap away from the motion and come back, and a sentence on each that
    had some.

    A bit that flips reads anything. To go there and back within a few rows takes an axis many times the largest torque.

    Args:
        records: of one axis.
        inertia: [kg m^2] or [kg]; None: as the records roughly show it.

    Raises:
        DataError: a position leaps and comes back as no joint does, and nothing says what torque that takes.
    """
    spikes = [_spikes(r.position, r.resolution) for r in records]
    if inertia is None and any(len(rows) for rows, _ in spikes):
        inertia = rough_inertia_of([_put(r, *spike) for r, spike in zip(records, spikes, strict=True)])
    out, said = [], []
    for r, (rows, values) in zip(records, spikes, strict=True):
        takes = 2 * (inertia or 0.0) * np.abs(r.position[rows] - values) / ((_FEW_ROWS + 1) / 2 * r.sample_time) ** 2
        wrong = takes > _NO_TORQUE * np.abs(r.torque).max()
        mended = _put(r, rows[wrong], values[wrong])
        if (at := leap(mended.position, r.resolution)) is not None:
            raise DataError(f"{r.name}: position leaps from {mended.position[at - 1]:.6g} to {mended.position[at]:.6g} "
                            f"and back at {r.time[at]:.5g} s, as no joint does; leave out what was read wrong, or take "
                            "what is whole with span")
        out.append(mended)
        if wrong.any():
            said.append(f"{r.name}: the position leaps and comes back in {int(wrong.sum())} rows, first at "
                        f"{r.time[rows[wrong][0]]:.5g} s, as no torque in the log could move the axis: readings that "
                        "failed, filled in")
    return out, said


def _put(record: Record, rows: NDArray[np.intp], values: Array) -> Record:
    """A record with other positions (k,) in some rows."""
    if not len(rows):
        return record
    position = record.position.copy()
    position[rows] = values
    return record.with_signals({"position": position})


def _spikes(position: Array, count: float | None) -> tuple[NDArray[np.intp], Array]:
    """(k,) rows, a few at a time, in which a position is far from the curve that joins the motion before and after, and
    these curves there. Where the motion before is not that after, an axis has been hit."""
    values = np.full(len(position), np.nan)
    for m in range(1, _FEW_ROWS + 1):
        first = np.arange(2, len(position) - m - 1)
        if not len(first):
            break
        before, after = position[first - 1], position[first + m]
        arrives, leaves = before - position[first - 2], position[first + m + 1] - after
        curve = scipy.interpolate.CubicHermiteSpline([0, m + 1], [before, after], [arrives, leaves])
        across = curve(np.arange(1, m + 1))
        away = np.abs(position[first + np.arange(m)[:, None]] - across).min(0)
        goes = (after - before) / (m + 1)
        bends = np.maximum(np.abs(goes - arrives), np.abs(goes - leaves))
        least = max(_SPIKE * float(np.quantile(away, 1 - _RARE)), _LEAST_LEAP * (count or 0.0), 1e-9 * np.ptp(position))
        for i in np.flatnonzero((away > least) & (away > _SPIKE * bends)).tolist():
            values[first[i] : first[i] + m] = across[:, i]
    rows = np.flatnonzero(np.isfinite(values))
    return (rows, values[rows]) if len(rows) <= _RARE * len(position) else (rows[:0], values[:0])


def filled(record: Record) -> tuple[Record, int]:
    """The record with positions in the place of readings that were held, and how many were.

    A bus that loses a frame, or an encoder that drops out, repeats its last reading while the axis moves on, and then
    catches up in one sample what the axis has gone in several, which no mass can do. The motion before and after says
    how fast it was at either end; between them goes the curve that bends least. Where the axis rests nothing is
    changed, nor where every few readings are repeated.
    """
    q = record.position.copy()
    least = _CAUGHT_UP * (record.resolution or 0.0)
    held = 0
    for first, last in _joined(_stretches(np.diff(q) == 0) + 1, q, least):
        n = last - first
        near = max(n // 2, _FEWEST_BESIDE)
        if first < near or last + near > len(q):
            continue
        before, after = q[first - near : first], q[last : last + near]
        pace = max(np.abs(np.diff(before)).max(), np.abs(np.diff(after)).max())
        (a, v), (b, w) = _end(before[::-1]), _end(after)
        usual = (n + 1) * (w - v) / 2
        leaps = min(abs(b - a), abs(q[last] - q[first - 1])) > pace / _JUMP
        if leaps and usual and _JUMP < (b - a) / usual < 1 / _JUMP:
            q[first:last] = scipy.interpolate.CubicHermiteSpline([-1, n], [a, b], [-v, w])(np.arange(n))
            held += n
    if not held or held > _OFTEN * len(q):
        return record, 0
    return record.with_signals({"position": q}), held


def _stretches(there: NDArray[np.bool_]) -> NDArray[np.intp]:
    """(k, 2) where something is there (n,) for a while: the first sample of each time, and the one after the last."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], there, [False]]).astype(int)))
    return edges.reshape(-1, 2)


def _joined(stretches: NDArray[np.intp], position: Array, least: float) -> list[tuple[int, int]]:
    """Those stretches (k, 2) of samples that repeat the one before, the first and the one after the last of each, after
    which the axis goes by more than `least` at once; two with hardly a reading between them are one."""
    out: list[tuple[int, int]] = []
    for first, last in stretches.tolist():
        if last < len(position) and abs(position[last] - position[first - 1]) > least:
            joins = bool(out) and first - out[-1][1] < _FEWEST_BESIDE
            out.append((out.pop()[0] if joins else first, last))
    return out


def _end(position: Array) -> tuple[float, float]:
    """The first position (n,), smoothed by a parabola, and its slope per sample."""
    _, slope, value = np.polyfit(np.arange(len(position)), position, 2)
    return float(value), float(slope)


def answered(records: Sequence[Record], inertia: float | None) -> tuple[list[Record], list[str]]:
    """Records without torques of a few rows that the axis does not answer, and a sentence on each that had some.

    A frame that is lost reads zero, or anything. A torque that did act for so long moves the axis on at another speed,
    by its impulse over the inertia.

    Args:
        records: of one axis.
        inertia: [kg m^2] or [kg]; None: as the records roughly show it.
    """
    leaps = [_torque_leaps(r) for r in records]
    if inertia is None and any(map(len, leaps)):
        inertia = rough_inertia_of([_between(r, rows) for r, rows in zip(records, leaps, strict=True)])
    out, said = [], []
    for r, rows in zip(records, leaps, strict=True):
        failed = rows[~_answers(r, rows, inertia)] if inertia and len(rows) else rows[:0]
        if len(failed):
            out.append(_between(r, failed))
            said.append(f"{r.name}: the torque leaps and comes back in {len(failed)} rows, first at "
                        f"{r.time[failed[0]]:.5g} s, and the axis does not answer: readings that failed, filled in")
        else:
            out.append(r)
    return out, said


def _between(record: Record, rows: NDArray[np.intp]) -> Record:
    """A record whose torque in some rows runs straight between those beside them."""
    every = np.arange(len(record))
    kept = np.setdiff1d(every, rows)
    torque = np.interp(every, kept, record.torque[kept])
    return record.with_signals({"torque": torque})


def _torque_leaps(record: Record) -> NDArray[np.intp]:
    """(k,) rows in which the torque is far from that of the rows around for a few at a time, and zero or by far the
    largest, and after which it is back where it was."""
    u = record.torque
    away = np.abs(u - scipy.ndimage.median_filter(u, 2 * _FEW_ROWS + 1, mode="nearest"))
    usual = float(np.quantile(away, 1 - _RARE))
    leaps = away > _FAR_TORQUE * usual if usual else np.zeros(len(u), bool)
    most = _BEYOND * np.abs(u[~leaps]).max(initial=0.0)
    alone = leaps & ((u == 0) | (np.abs(u) > most))
    alone[: _FEW_ROWS + _SLOPE] = alone[len(u) - _FEW_ROWS - 1 - _SLOPE :] = False
    back = [np.arange(first, last) for first, last in _stretches(alone).tolist() if _comes_back(u, first, last)]
    return np.concatenate([np.empty(0, np.intp), *back])


def _comes_back(torque: Array, first: int, last: int) -> bool:
    """Whether a torque (n,) from `last` on is about where it was before `first`, a few rows earlier."""
    before, after = torque[first - 1], torque[last]
    away = np.abs(torque[first:last] - (before + after) / 2).min()
    return last - first <= _FEW_ROWS and bool(abs(after - before) <= _NEARLY_BACK * away)


def _answers(record: Record, rows: NDArray[np.intp], inertia: float) -> NDArray[np.bool_]:
    """(k,) whether the axis goes on faster, or slower, after torques of a few rows, as their impulse would have it, at
    once or as late as a drive may follow.

    What cannot be seen behind the encoder counts as an answer, as does an axis that rests where the torque is zero."""
    without = _between(record, rows).torque
    at_once, unseen = _answers_within(record, rows, without, inertia, _FEW_ROWS)
    late = [_answers_within(record, rows, without, inertia, n) for n in _LATE if 4 * n < len(record)]
    return np.any([at_once, unseen, *(answers & ~hidden for answers, hidden in late)], axis=0)


def _answers_within(
    record: Record, rows: NDArray[np.intp], without: Array, inertia: float, n: int
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """(k,) the same of one that is complete so many rows later, and where that would not be seen, given the torque (n,)
    without these rows."""
    u, q, h = record.torque, record.position, record.sample_time
    gap = _FEW_ROWS + 1 + n
    before = np.arange(len(u))[_SLOPE : -gap - _SLOPE]
    after = before + gap

    def speeds_up(position: Array) -> Array:
        """By what the mean velocity after some rows differs from that before."""
        return np.asarray((position[after + _SLOPE] - position[after] - position[before] + position[before - _SLOPE])
                          / (_SLOPE * h))  # fmt: skip

    def free(torque: Array) -> Array:
        """Where a torque alone would move the axis."""
        velocity = h / inertia * np.concatenate([[0.0], np.cumsum(torque)])
        return h * np.concatenate([[0.0], np.cumsum((velocity[1:] + velocity[:-1]) / 2)])

    speed = (q[after] - q[before]) / (gap * h)
    friction = np.stack([np.sign(speed), speed, np.ones_like(speed)], 1)
    change = speeds_up(q)
    beyond = change - speeds_up(free(without))
    beyond -= friction @ np.linalg.lstsq(friction, beyond)[0]
    # What friction does to an axis that rests now and then no line in the speed tells.
    change = min(change, beyond, key=lambda c: float(np.median(np.abs(c))))
    noise = float(np.median(np.abs(change)))
    at = np.minimum(rows - _FEW_ROWS - _SLOPE, len(before) - 1)
    due = speeds_up(free(u - without))[at]
    held = (speed == 0)[at] & (u[rows] == 0)
    return change[at] * due > _HALF * due**2, held | (np.abs(due) < _SEEN * noise)


def hint(ratio: float, within: float = _AS_FACTOR) -> str:
    """What two figures may have been mixed up that are so many times apart, within a share of that, for the end of a
    clause; "" if nothing."""
    ratio = max(ratio, 1 / ratio)
    return next((f", which is {text}" for f, text in _FACTORS.items() if abs(ratio / f - 1) < within), "")


def doubts(records: Sequence[Record], inertia: float | None, kind: str) -> list[str]:
    """What a user may want to know before trusting a result, one sentence each.

    Args:
        records: of one axis.
        inertia: that was given, None where it is to be identified.
        kind: "hinge" or "slide".

    Raises:
        DataError: the torque works against the motion, which no mechanism does.
    """
    said: list[str] = []
    unit = "kg m^2" if kind == "hinge" else "kg"
    for r in records:
        if (factor := _of_velocity(r)) is not None:
            said.append(f"{r.name}: the velocity is {factor:.3g} times the slope of the position{_why(factor, kind)}")
        if np.ptp(r.torque) == 0 and r.torque[0]:
            said.append(f"{r.name}: the torque is {r.torque[0]:.4g} throughout; is it the right column?")
        if r.resolution and np.ptp(r.position) < _FEWEST_COUNTS * r.resolution:
            said.append(f"{r.name}: the position changes by less than {_FEWEST_COUNTS:g} counts of the encoder in all: "
                        "no motion that could tell anything of friction")
        doubts_of_torque = (_twice(r), _at_its_end(r), _slow_torque(r), _moved_without(r))
        said += [f"{r.name}: {doubt}" for doubt in doubts_of_torque if doubt]
        if n := filled(r)[1]:
            said.append(f"{r.name}: the position repeats its last reading at {n} samples while the axis moves: "
                        "filled in")
    said += _seen_before(records)
    fitted = [r for r in records if r.use == "fit"]
    if fitted and sum(map(len, fitted)) < _FEW:
        said.append(f"only {sum(map(len, fitted))} samples to fit: too few to tell friction from noise, or one effect "
                    "from another")
    alone = [rows_of(r) for r in records]
    apart = _apart([r.name for r in records], alone, unit)
    said += apart.values()
    pooled = [
        rows for k, (r, rows) in enumerate(zip(records, alone, strict=True))
        if rows is not None and k not in apart and (not fitted or r.use == "fit")
    ]  # fmt: skip
    found = rough_inertia(pooled)
    if found is None or sum(map(len, fitted or records)) < _ENOUGH:
        return said
    if found.power < 0 and (found.inertia < 0 or found.share < _HARDLY_ANY):
        raise DataError(_against("the records show", found, unit))
    if inertia is not None and found.is_told and found.inertia > 0:
        said += _off(found.inertia, inertia, unit, "records")
    return said


def _apart(names: Sequence[str], alone: Sequence[Rows | None], unit: str) -> dict[int, str]:
    """A sentence on each record that by itself looks like another axis than all the others do, by its number; raises
    DataError where the torque of one works against the motion and that of the others does not.

    Of a motion that says little of an inertia nothing is said. A spring looks like a negative one, and behind a drive
    that is late like friction that drives the axis: a sign is wrong where it makes one like the others.
    """
    each = {k: rough_inertia([rows]) for k, rows in enumerate(alone) if rows is not None}
    told = {k: found for k, found in each.items() if found is not None and found.is_told}
    said = {}
    for k, found in told.items():
        others = [abs(other.inertia) for i, other in told.items() if i != k and other.power >= 0]
        if not others:
            continue
        usual = float(np.median(others))
        ratio = max(abs(found.inertia) / usual, usual / abs(found.inertia))
        if found.power < 0 and found.inertia < 0 and ratio < _ALIKE_ROUGHLY:
            raise DataError(f"{names[k]}: {_against('it shows, unlike the others,', found, unit)}")
        if found.inertia > 0 and len(others) > 1 and ratio > _APART and max(others) < _APART * min(others):
            said[k] = (f"{names[k]} by itself looks like an inertia of about {found.inertia:.2g} {unit}, the others "
                       f"like {usual:.2g} {unit}: {ratio:.2g} times apart{hint(ratio, _ROUGHLY)}; is one of its "
                       "columns in another unit?")  # fmt: skip
    return said


def _against(shows: str, found: RoughInertia, unit: str) -> str:
    return (
        f"the torque works against the motion: {shows} an inertia of {found.inertia:.3g} {unit} and friction that "
        "drives the joint; torque or position has the wrong sign, try scale = { torque = -1 } (a negative "
        "torque_constant for current)"
    )


def doubts_of_responses(frfs: Sequence[FRF], inertia: float | None, kind: str) -> list[str]:
    """The same of frequency responses from torque: what they say against the inertia that was given.

    Raises:
        DataError: it cannot be.
    """
    found = rough_inertia_of_responses(frfs) if inertia is not None else None
    if inertia is None or found is None:
        return []
    return _off(found, inertia, "kg m^2" if kind == "hinge" else "kg", "responses")


def _off(rough: float, inertia: float, unit: str, what: str) -> list[str]:
    """A sentence where a given inertia is not about that which the data roughly show; raises DataError where it cannot
    be."""
    ratio = max(rough / inertia, inertia / rough)
    if ratio <= _OFF:
        return []
    given = (f"the {what} look like an inertia of about {rough:.2g} {unit}, but {inertia:.3g} {unit} is given: "
             f"{ratio:.3g} times off{hint(ratio)}")  # fmt: skip
    if ratio > _ABSURD:
        raise DataError(f"{given}; leave axis.inertia out to have it identified")
    return [given]


def _twice(record: Record) -> str:
    """That two of its signals are one."""
    names = [k for k in ("position", "velocity", "torque", "load") if k in record.signals]
    for one, other in itertools.combinations(names, 2):
        if np.array_equal(record.signals[one], record.signals[other]):
            return f"{one} and {other} are the same numbers; is each the right column?"
    return ""


def _at_its_end(record: Record) -> str:
    """That the torque stands at its largest, as a reading at the end of its range does."""
    u = record.torque
    most = np.abs(u).max()
    there = np.abs(u) == most
    share = float(np.mean(there))
    stays = int(np.sum(there[1:] & there[:-1]))
    if stays < _STAYS or not _AT_END < share < _MOST_AT_END or len(np.unique(u)) < _MANY_LEVELS:
        return ""
    return (f"the torque stands at {most:.4g} in {100 * share:.2g} % of the rows; where that is the end of what is "
            "read, and not of what the drive gives, the rest is missing")  # fmt: skip


def _slow_torque(record: Record) -> str:
    """That the torque changes at some rows only, as one that is read at a lower rate."""
    readings = None if record.sensed else Readings.of(record.torque)
    if readings is None:
        return ""
    return (f"the torque changes at every {readings.every:.4g} rows only: taken as held between, as by a controller of "
            "that rate; where it was read at that rate, say sensed = true")  # fmt: skip


def _moved_without(record: Record) -> str:
    """That the axis gathers speed for a while without a torque."""
    if "rigid_torque" in record.signals or len(record) < 2 * _LONG:  # the weight of a robot's links is known
        return ""
    u, q = record.torque, record.position
    idle_for = _stretches(np.abs(u) <= _IDLE * np.quantile(np.abs(u), _MOST))
    speed = np.abs(q[2 * _SLOPE :] - q[: -2 * _SLOPE]) / (2 * _SLOPE * record.sample_time)  # about the row _SLOPE later
    gains = []
    for first, last in idle_for[np.diff(idle_for)[:, 0] >= _LONG].tolist():
        within = speed[first : last - 2 * _SLOPE]
        if np.max(within - np.minimum.accumulate(within)) > _GATHERS * speed.max():
            gains.append((first, last - 1))
    if not gains:
        return ""
    first, last = gains[0]
    more = f", and {len(gains) - 1} times more" if len(gains) > 1 else ""
    return (f"the axis gathers speed without a torque from {record.time[first]:.4g} to {record.time[last]:.4g} s{more}"
            ": what a weight or a spring does, or a hand while the drive was off; of a hand leave that part out, with "
            "span")  # fmt: skip


def _seen_before(records: Sequence[Record]) -> list[str]:
    """That what validates has the very samples of what is fitted or chooses."""
    said = []
    for r in (r for r in records if r.use == "validate"):
        for other in (o for o in records if o.use != "validate" and len(o) == len(r)):
            if np.array_equal(r.torque, other.torque) and np.array_equal(r.position, other.position):
                said.append(f"{r.name} has the same samples as {other.name}: errors on it prove nothing")
    return said


def _of_velocity(record: Record) -> float | None:
    """How many times the slope of the position a logged velocity is; None where it is that slope, or is not known."""
    v = record.get("velocity")
    if v is None:
        return None
    slope = np.gradient(record.position, record.sample_time)
    square, other = float(v @ v), float(slope @ slope)
    if not square * other or (v @ slope) ** 2 < _ALIKE * square * other:
        return None
    factor = square / float(v @ slope)
    return None if 1 / _OTHER_UNIT < factor < _OTHER_UNIT else factor


def _why(factor: float, kind: str) -> str:
    """What a velocity so many times the slope of the position may be, for the end of a sentence."""
    size = abs(factor)
    unit = next((u for u, times in _SPEEDS[kind].items() if abs(size / times - 1) < _EXACTLY), "")
    if unit:
        why = f'; is its unit {unit}? Say it with units = {{ velocity = "{unit}" }}'
    elif (where := next((u for u, times in _PLACES[kind].items() if abs(size * times - 1) < _EXACTLY), "")):
        why = f'; is the unit of the position {where}? Say it with units = {{ position = "{where}" }}'
    elif 1 / _OTHER_UNIT < size < _OTHER_UNIT:
        return "; one of them counts the other way: scale with a minus turns it round"
    else:
        why = f"; is it of the other side of a gear of {max(size, 1 / size):.3g} to 1, or in another unit?"
    return why + " And one of them counts the other way" * (factor < 0)
