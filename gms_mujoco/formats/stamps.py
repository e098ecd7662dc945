"""Time stamps that are dates or times of day, as seconds from the first of them.

Text: "2024-03-05T14:30:59.5Z", "05.03.2024 14:30:59,500", "3/5/2024 2:30:59 PM", "14:30:59.500", and "30:59.5", as a
spreadsheet shows it. A time of day that falls back has passed midnight, minutes that do the hour.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from datetime import datetime
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

Array = NDArray[np.float64]

_DATE = r"\d{1,4}[-./][A-Za-z\d]{1,3}[-./]\d{1,4}"
_STAMP = (
    rf"^(?:(?P<date>{_DATE})(?:T|\s+))?(?P<a>\d{{1,2}}):(?P<b>\d{{2}})(?::(?P<c>\d{{2}}))?(?:[.,:](?P<part>\d{{1,9}}))?"
    r"\s*(?P<half>[AaPp][Mm])?\s*(?P<zone>Z|UTC|[+-]\d{2}:?\d{2})?$"
)
_IS_STAMP = re.compile(rf"{_STAMP}|^{_DATE}$")
_DAYS = ("%Y-%m-%d", "%Y/%m/%d", "%Y.%m.%d", "%d.%m.%Y", "%d/%m/%Y", "%m/%d/%Y", "%d-%m-%Y", "%d-%b-%Y", "%d.%m.%y",
         "%m/%d/%y", "%d/%m/%y")
_DAY, _HOUR = 86400.0, 3600.0
_TICKS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}


def is_stamp(text: str) -> bool:
    """Whether a cell is a date, a time of day or both."""
    return _IS_STAMP.match(text) is not None


def from_text(texts: pa.ChunkedArray) -> Array | None:
    """(n,) [s] from the first, nan where a cell is empty; None where one is no time stamp."""
    texts = pc.utf8_trim_whitespace(texts)
    found = pc.extract_regex(texts, _STAMP)
    if not len(texts) or pc.any(pc.and_(pc.is_null(found), pc.not_equal(texts, ""))).as_py():
        return None
    there = pc.is_valid(found).to_numpy().astype(bool)
    if not there.any():
        return None
    parts = {k: pc.struct_field(found, k).filter(pa.array(there)) for k in _IS_STAMP.groupindex}
    a, b, c = (_numbers(parts[k]) for k in "abc")
    digits = pc.utf8_length(parts["part"]).to_numpy().astype(float)
    part = _numbers(parts["part"]) / 10**digits
    morning, evening = (pc.equal(pc.utf8_upper(parts["half"]), half).to_numpy() for half in ("AM", "PM"))
    hours = np.where(morning | evening, a % 12, a) + 12 * evening
    short = pc.equal(parts["c"], "").to_numpy() & (digits > 0)  # "30:59.5" has no hours
    time = np.where(short, 60 * a + b, _HOUR * hours + 60 * b + c)
    if pc.any(pc.not_equal(parts["date"], "")).as_py():
        days = _days(parts["date"])
        if days is None:
            return None
        time = time + _DAY * (days - days[0]) - _zones(parts["zone"])
    else:
        turn = _HOUR if short.all() else _DAY
        time = time + turn * np.concatenate([[0.0], np.cumsum(np.diff(time) < -turn / 2)])
    # The parts of a second are added last: beside a date they would lose digits.
    seconds = np.full(len(texts), np.nan)
    seconds[there] = (time - time[0]) + (part - part[0])
    return seconds


def from_strings(values: Sequence[object]) -> Array | None:
    """(n,) [s] from the first of texts, nan where there is none; None where one is no text, or no time stamp."""
    if not all(isinstance(v, str | None) for v in values):
        return None
    return from_text(pa.chunked_array([pa.array([v or "" for v in values], pa.string())]))


def from_arrow(column: pa.ChunkedArray) -> Array | None:
    """(n,) [s] of a column of time stamps or times of day, or of such as text, from the first, or of durations; None of
    any other type."""
    kind = column.type
    if pa.types.is_string(kind) or pa.types.is_large_string(kind):
        return from_text(pc.fill_null(pc.cast(column, pa.string()), ""))
    if not (pa.types.is_timestamp(kind) or pa.types.is_time(kind) or pa.types.is_duration(kind)):
        return None
    valid = pc.is_valid(column).to_numpy().astype(bool)
    whole = pa.int32() if pa.types.is_time32(kind) else pa.int64()
    ticks = pc.fill_null(pc.cast(column, whole), 0).to_numpy().astype(np.int64)
    if valid.any() and not pa.types.is_duration(kind):
        ticks = ticks - ticks[np.argmax(valid)]
    seconds = np.where(valid, ticks * _TICKS[kind.unit], np.nan)
    if pa.types.is_time(kind):
        seconds += _DAY * np.concatenate([[0.0], np.cumsum(np.diff(seconds) < -_DAY / 2)])
    return seconds


def from_numpy(values: NDArray[Any]) -> Array:
    """(n,) [s] of datetime64, from the first, or of timedelta64; nan where there is none."""
    there = ~np.isnat(values)
    seconds = np.full(len(values), np.nan)
    if there.any():
        spans = values[there] - values[there][0] if values.dtype.kind == "M" else values[there]
        seconds[there] = spans / np.timedelta64(1, "s")
    return seconds


def _numbers(texts: pa.ChunkedArray) -> Array:
    filled = pc.if_else(pc.equal(texts, ""), "0", texts)
    return np.asarray(pc.cast(filled, pa.float64()).to_numpy())


def _by_text(texts: pa.ChunkedArray, values: dict[str, float], otherwise: float) -> Array:
    coded = pc.dictionary_encode(pc.utf8_upper(texts)).combine_chunks()
    table = np.array([values.get(t, otherwise) for t in coded.dictionary.to_pylist()])
    return table[coded.indices.to_numpy()]


def _zones(texts: pa.ChunkedArray) -> Array:
    """Seconds that clocks there are ahead; 0 where no zone is given."""
    ahead = [t for t in pc.unique(texts).to_pylist() if t.startswith(("+", "-"))]
    return _by_text(texts, {t: int(t[:3]) * _HOUR + int(t[0] + t[-2:]) * 60 for t in ahead}, 0.0)


def _days(texts: pa.ChunkedArray) -> Array | None:
    """Days of dates. Of day and month in doubt the order in which the dates lie closer: a log lasts no months."""
    names = pc.unique(texts).to_pylist()
    readings = [r for form in _DAYS if (r := _read(names, form)) is not None]
    if not readings:
        return None
    best = min(readings, key=lambda r: max(r) - min(r))
    return _by_text(texts, {n.upper(): float(d) for n, d in zip(names, best, strict=True)}, np.nan)


def _read(names: Sequence[str], form: str) -> list[int] | None:
    try:
        return [datetime.strptime(n, form).toordinal() for n in names]
    except ValueError:
        return None
