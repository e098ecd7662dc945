"""Time stamps of real logs: an even grid where they have one, made even where they do not."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from ..errors import DataError

Array = NDArray[np.float64]

HELD = ("torque", "current")  # the drive holds these from one sample to the next
LONGEST_GAP = 20  # sample times; across more the motion cannot be guessed
_FEWEST, _FEW = 16, 3  # samples of a part of a file that is worth a span, and such parts
_SLOW, _FAST = 0.2, 5e-6  # s; nobody controls a joint at longer samples, or shorter ones
_CLOCKS = {"ms": 1e-3, "us": 1e-6, "100ns": 1e-7, "ns": 1e-9, "d": 86400.0}  # that may be meant, the likeliest first
_OTHER_RATE = 0.05  # of a rate, by which that of a clock is another
_SLOWISH, _LONG = 0.03, 1200.0  # s; a step and a whole that are rather milliseconds read as seconds
_EVEN = 0.02  # steps that differ by less than this part are even
_OWN, _NEARLY_ALL = 0.1, 0.95  # of a step, by which nearly all stamps of a drive's own loop stray at most
_ASTRAY = 2.0  # steps, over which stamps that belong to even rows are spread about them
_ROUGHER, _SMOOTHER = 1.3, 0.4  # times the square of a position's third differences, over its stamps and its rows


def within(time: Array, span: Any) -> NDArray[np.bool_]:
    """(n,) which samples lie in a span of time.

    Args:
        time: (n,) [s].
        span: [from, to] [s], both included.

    Raises:
        DataError: no two rising numbers, or nothing there.
    """
    numbers = isinstance(span, list) and all(isinstance(x, int | float) and not isinstance(x, bool) for x in span)
    if not numbers or len(span) != 2 or not span[0] < span[1]:
        raise DataError(f"span must be two rising times, as in span = [1.0, 9.5] [s]; {span!r} given")
    outside = (time < span[0]) | (time > span[1])
    if outside.all():
        whole = f"its time runs from {_told(time[0])} to {_told(time[-1])} s"
        raise DataError(f"span = {span}: the file has nothing there; {whole}")
    return np.asarray(~outside)


def clock(time: Array, counted_in: float = 1.0) -> str | None:
    """A doubt about times (n,) [s] that no log of a joint has.

    Args:
        counted_in: what the file counts its time in [s]; 0 where time is counted by a rate.
    """
    step = float(np.median(np.diff(time)))
    if _FAST < step <= _SLOW:
        return None
    raw = step / counted_in if counted_in else 0.0
    likely = [u for u, size in {"s": 1.0, **_CLOCKS}.items() if _FAST < size * raw <= _SLOW]
    each = ", or ".join(f'in {u} ({1 / (_CLOCKS.get(u, 1.0) * raw):.4g} rows a second)' for u in likely)
    asked = f'; if its time is {each}, say units = {{ time = "{likely[0]}" }}' if likely else ""
    counted = "; if it counts rows, say rate = ... [Hz] in the place of a column" if np.all(np.diff(time) == 1) else ""
    return f"samples are {step:g} s apart{asked}{counted}"


def doubt(time: Array) -> str | None:
    """A sentence on times (n,) [s], of which nobody says the unit, that are slow and long for a log of a joint."""
    step, whole = float(np.median(np.diff(time))), float(time[-1] - time[0])
    if step < _SLOWISH or whole < _LONG:
        return None
    return (f"{len(time)} samples are {step:g} s apart, {whole / 60:.3g} minutes in all; if its time is in ms, say "
            'units = { time = "ms" }')


def expect_clock(time: Array) -> None:
    """Raises DataError for a doubt about times (n,) [s] of which nobody says the unit."""
    if doubt := clock(time):
        raise DataError(f'{doubt}, or units = {{ time = "s" }} where that is right')


def expect_rate(time: Array, rate: float, named: bool) -> None:
    """Raises DataError where the clock of a file, times (n,), says that its rows came at another rate [Hz].

    A clock that is too coarse, or counts rows, says nothing.

    Args:
        named: whether the file says that its times are in s; elsewhere they may be in any unit.
    """
    step = np.diff(time)
    if not np.isfinite(time).all() or np.any(step <= 0) or np.all(step == 1):
        return
    own = 1 / float(np.median(step))
    if any(abs(own / size / rate - 1) < _OTHER_RATE for size in (1.0, *(() if named else _CLOCKS.values()))):
        return
    raise DataError(f"rate = {rate:g} [Hz], but the time of the file says {own:.4g} rows a second; leave rate out, "
                    "with scale = { time = ... } where that clock is wrong")


def parts(time: Array, whole: NDArray[np.bool_]) -> str:
    """How to take what is whole (n,) of a file, with its times (n,) [s]: the end of a message."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], whole & np.isfinite(time), [False]]).astype(int)))
    runs = [(a, b - 1) for a, b in zip(edges[::2], edges[1::2], strict=True) if b - a >= _FEWEST]
    if not runs or len(runs) > _FEW:
        return "every row needs a number in each of these columns"
    spans = " and ".join(f"span = [{_told(time[a])}, {_told(time[b])}]" for a, b in runs)
    return f"take what is whole, as in {spans}" + ", a record each" * (len(runs) > 1)


def _told(time: float) -> str:
    return f"{round(time, 6):.15g}"


def evenly(
    time: Array, signals: Mapping[str, Array], sensed: bool = False, strays: bool | None = None
) -> tuple[Array, dict[str, Array], str | None, bool | None]:
    """Signals on an even time grid.

    Steps that differ by less than 2 % are left as they are. Stamps that are an even grid rounded to fewer digits
    get the grid back. So do stamps of a logger that came by late now and then, where the position is smooth over the
    rows and rough over their stamps. Anything else (jitter, dropped samples) is resampled at the median step: of a
    torque that was commanded, and holds, the mean from step to step, as much as the drive gave; of a position a cubic
    spline, for a chord is off by more than a count where an axis gathers speed; the others are interpolated linearly.

    Args:
        time: (n,) [s], strictly increasing.
        signals: (n,) each.
        sensed: whether the torque was read from a sensor, which no drive holds.
        strays: whether the stamps are not those of the rows, where `strays_from_rows` does not tell by the record
            itself, but by others of the same logger.

    Returns:
        time, signals, a sentence about what was done, None where nothing was, and what `strays_from_rows` tells.

    Raises:
        DataError: a gap of more than 20 sample times.
    """
    step = np.diff(time)
    if (rounding := _even(time)) is not None:
        if not rounding:
            return time, dict(signals), None, False
        mean = (time[-1] - time[0]) / len(step)
        said = f"time stamps are rounded to {rounding:g} s; read as even steps of {mean:.6g} s"
        return time[0] + mean * np.arange(len(time)), dict(signals), said, False
    expect_whole(time)
    own = strays_from_rows(time, signals.get("position"))
    if own or (own is None and strays):
        rows = _rows(time)
        assert rows is not None
        far, mean = float(np.abs(time - rows).max()), float(rows[1] - rows[0])
        where = "" if own else ", in other records"
        said = (
            f"time stamps stray from even steps by up to {far:.2g} s, and the position is smooth over the rows and not "
            f"over the stamps{where}: read as even steps of {mean:.6g} s"
        )
        return rows, dict(signals), said, own
    h = float(np.median(step))
    worst = int(np.argmax(step))
    uneven = int((np.abs(step - h) > _EVEN * h).sum())
    even = time[0] + h * np.arange(int((time[-1] - time[0]) / h + 1e-6) + 1)
    held = () if sensed else HELD
    resampled = {k: _resampled(k, v, time, even, h, k in held) for k, v in signals.items()}
    note = (
        f"{uneven} of {len(step)} time steps differ from {h:.4g} s by more than 2 % (the longest is "
        f"{step[worst]:.4g} s): resampled evenly, {'all' if sensed else 'torque held, the rest'} interpolated"
    )
    return even, resampled, note, own


def _resampled(name: str, values: Array, time: Array, even: Array, step: float, held: bool) -> Array:
    """(m,) a signal (n,) that was read at uneven times (n,), at even ones (m,) [s]; see `evenly`."""
    if not held:
        smooth = name == "position" and len(time) > 3
        return scipy.interpolate.CubicSpline(time, values)(even) if smooth else np.interp(even, time, values)
    given = np.append(0.0, np.cumsum(values[:-1] * np.diff(time)))
    ends = np.append(even, even[-1] + step)
    last = np.searchsorted(time, ends, side="right") - 1
    return np.diff(given[last] + values[last] * (ends - time[last])) / step


def strays_from_rows(time: Array, position: Array | None) -> bool | None:
    """Whether rows were read at even times, whatever their stamps (n,) say; None where that may be, and the position
    does not tell.

    A position that was read evenly is rougher where it is put to uneven stamps, and one that was read when they say is
    smoother: many thousand samples tell a small difference. Where it hardly moves in a step both are the roughness of
    its counts.
    """
    if _even(time) is not None or (grid := _rows(time)) is None:
        return False
    if position is None:
        return None
    by_rows, by_stamps = (float(np.sum(np.diff(x, 3) ** 2)) for x in (position, np.interp(grid, time, position)))
    return True if by_stamps > _ROUGHER * by_rows else False if by_stamps < _SMOOTHER * by_rows else None


def _rows(time: Array) -> Array | None:
    """(n,) even times that are near stamps; None where the stamps are too far from any."""
    rows = np.arange(len(time))
    grid: Array = np.polynomial.Polynomial.fit(rows, time, 1)(rows)
    return grid if np.ptp(time - grid) <= _ASTRAY * (grid[1] - grid[0]) else None


def expect_whole(time: Array) -> None:
    """Raises DataError where times (n,) [s], strictly increasing, have a gap of more than 20 sample times."""
    step = np.diff(time)
    h, worst = float(np.median(step)), int(np.argmax(step))
    if step[worst] > LONGEST_GAP * h:
        raise DataError(
            f"a gap of {step[worst]:.4g} s after {time[worst]:.6g} s, where samples are {h:.4g} s apart; "
            "make it two records there, as in span = "
            f"[{_told(time[0])}, {_told(time[worst])}] and span = [{_told(time[worst + 1])}, {_told(time[-1])}]"
        )


def by_another_clock(time: Array) -> bool:
    """Whether rows came at uneven times (n,), and so not from sample to sample of the drive, whose own stamps stray by
    little."""
    step = np.diff(time)
    usual = float(np.median(step))
    return _even(time) is None and float(np.quantile(np.abs(step - usual), _NEARLY_ALL)) > _OWN * usual


def _even(time: Array) -> float | None:
    """What time stamps of even steps are rounded to [s], 0 where they are not; None where the steps are not even."""
    step = np.diff(time)
    mean = (time[-1] - time[0]) / len(step)
    if np.ptp(step) <= _EVEN * mean:
        return 0.0
    rounding = _rounding(time, mean)
    grid = time[0] + mean * np.arange(len(time))
    return rounding if rounding and np.abs(time - grid).max() <= 1.1 * rounding else None


def _rounding(time: Array, mean: float) -> float | None:
    """The digit to which all stamps are rounded [s], where it is coarse enough to matter, else None.

    Decimal, or binary, as a time in single precision is.
    """
    for digit in sorted((*(10.0**-k for k in range(10)), *(2.0**-k for k in range(34))), reverse=True):
        if digit <= 0.5 * mean:  # coarser ones would make stamps coincide
            ticks = time / digit
            if np.abs(ticks - np.round(ticks)).max() < 1e-3:
                return digit if digit > _EVEN / 2 * mean else None
    return None
