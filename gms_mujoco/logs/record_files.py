"""The entries [[record]] of a measurement set: files that become Records in SI units."""

from __future__ import annotations

import functools
import os
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .. import formats
from ..errors import DataError, several
from ..record import Record
from . import columns, plausible, timing, turns, units
from .columns import subtable
from .encoder import common_step
from .measured_axis import Axis
from .slow_signal import Readings

Array = NDArray[np.float64]

_KEYS = ("file", "use", "joint", "episode", "where", "rate", "span", "sensed", "columns", "units", "scale")
_AS_DECLARED = 0.7  # of a declared count: positions with smaller steps come of a finer encoder
_APART = 0.5  # times the longest time from one of several axes to the next, that the shortest is at most
_FIGURE = re.compile(r"\d[\d.e+-]*")
_OTHERS = "position of "  # before the name of another joint of the robot, among the signals


class Read(NamedTuple):
    """A record as it was read.

    Attributes:
        record: in SI units.
        notes: what was done to it, a sentence each.
        strays: whether its stamps are not those of its rows; None where it does not tell.
    """

    record: Record
    notes: list[str]
    strays: bool | None

    @property
    def moves(self) -> bool:
        """Whether its position ever changes."""
        return bool(np.ptp(self.record.position))


def read_all(entries: Sequence[Mapping[str, Any]], folder: Path, axis: Axis) -> list[Read]:
    """The records of a set. Where one shows that its stamps stray from even rows those that do not tell are read so
    too: one logger wrote them all; see `read`."""
    found = [read(f"record {i}", e, folder, axis) for i, e in enumerate(entries, 1)]
    if not any(r.strays for r in found):
        return found
    return [r if r.strays is not None else read(f"record {i}", e, folder, axis, strays=True)
            for i, (r, e) in enumerate(zip(found, entries, strict=True), 1)]  # fmt: skip


def listed(found: Sequence[Read]) -> list[str]:
    """What was done to each record; what was done to several, but for its figures, in one line with those of the
    first."""
    alike: dict[str, dict[str, str]] = {}
    for record, notes, _ in found:
        for note in notes:
            alike.setdefault(_FIGURE.sub("", note), {}).setdefault(record.name, note)
    return [
        f"{several([*notes])}: {next(iter(notes.values()))}" + " (figures of the first)" * (len({*notes.values()}) > 1)
        for notes in alike.values()
    ]


def read(key: str, entry: Mapping[str, Any], folder: Path, axis: Axis, strays: bool | None = None) -> Read:
    """One record.

    Args:
        key: what the entry is called in messages, "record 1".
        entry: the table of `dataset.toml`.
        folder: of the file that it names.
        axis: whose record it is.
        strays: whether its stamps are not those of its rows, where it does not tell.

    Raises:
        DataError: the file cannot be read or understood, or holds what no joint does.
    """
    name, use = columns.file_and_use(entry, _KEYS, key)
    if not os.path.isfile(folder / name):
        raise DataError(f"{key}: no such file: {name}; {formats.beside(folder / name)}")
    table = formats.read(folder / name)
    try:
        episode, span, sensed = entry.get("episode"), entry.get("span"), entry.get("sensed")
        where = subtable(entry, "where")
        table = table.episode(episode).where(where)
        signals, counted_in, notes = _in_si(table, entry, axis)
        if sensed not in (None, True, False):
            raise DataError(f"sensed must be true (the torque was read as the position is) or false; {sensed!r} given")
        by_current = "current" in signals
        if by_current:
            asked = ("the record has current, not torque: axis.torque_constant [N m/A] is needed, "
                     'or torque_constant = "unknown" to stay in A')
            signals["torque"] = axis.constant(asked) * signals.pop("current")
        if span is not None:
            kept = timing.within(signals["time"], span)
            signals = {k: v[kept] if len(v) == len(kept) else v for k, v in signals.items()}
            table = table.rows(kept)
        together = functools.partial(columns.on_rows_of_position, sensed=bool(sensed) or by_current)
        for leave_out in (together, columns.trimmed, columns.without_repeats):
            rows, note = leave_out(signals)
            table = table.rows(rows)
            notes.append(note)
        _expect_one_axis(table, signals)
        columns.check(table, signals)
        if counted_in is None:
            timing.expect_clock(signals["time"])
            notes.append(timing.doubt(signals["time"]))
        else:
            notes.append(timing.clock(signals["time"], counted_in))
        if sensed:
            signals, table, note = _as_read("torque", signals, table)
            notes.append(note)
        if sensed is None:
            sensed = by_current and timing.by_another_clock(signals["time"])
        signals, table, note = _as_read("position", signals, table)
        notes.append(note)
        sensed = sensed and note is None  # else it is a mean
        timing.expect_whole(signals["time"])
        notes += _without_jumps(signals, table, axis)
        # Interpolated positions would not show it any more.
        seen = common_step(signals["position"])
        count = axis.joint.resolution or seen or None
        notes.append(_finer(axis.joint.resolution, seen, axis.joint.kind))
        time, signals, note, strays = timing.evenly(signals.pop("time"), signals, sensed, strays)
        notes.append(note)
    except DataError as error:
        raise DataError(f"{key} ({name}): {error}") from None
    others = {k.removeprefix(_OTHERS): signals.pop(k) for k in [*signals] if k.startswith(_OTHERS)}
    short = Path(name).name if Path(name).is_absolute() else name
    if episode is not None:
        short += f" episode {episode}"
    short += "".join(f" {k} {v}" for k, v in where.items())
    if span is not None:
        short += f" {span[0]:g} to {span[1]:g} s"
    return Read(Record(short, time, signals, use, count, sensed, others), [n for n in notes if n], strays)


def _expect_one_axis(table: formats.Table, signals: Mapping[str, Array]) -> None:
    """Raises DataError where the rows are of several axes in turns."""
    name, count = table.in_turns()
    stamps, position = signals["time"], signals["position"]
    if len(stamps) != len(position) or len(stamps) < 2:
        return
    step, shared = np.diff(stamps), False
    if count:
        turns = [float(np.mean(step[i::count])) for i in range(count)]
        shared = min(turns) < _APART * max(turns)
    back = plausible.back_and_forth(position)
    if not shared and not back:
        return
    several = count if shared else back
    if name:
        one = {**table.texts, **table.columns}[name][0]
        told = f'"{one}"' if isinstance(one, str) else f"{one:g}"
        raise DataError(f"rows of {several} axes in turns, by {name}: choose one, as in where = {{ {name} = {told} }}")
    raise DataError(f"position goes back and forth from row to row and continues every {several} rows, as where "
                    f"{several} axes stand in turns; write a file of each, or choose the rows of one with where = "
                    "{ column = value }")


def _as_read(
    what: str, signals: dict[str, Array], table: formats.Table
) -> tuple[dict[str, Array], formats.Table, str | None]:
    """Signals and table where one of them was read at a lower rate and held, and a sentence; as they are else."""
    readings, time = Readings.of(signals[what]), signals["time"]
    if readings is None:
        return signals, table, None
    return readings.kept(signals, what), table.rows(readings.seen(len(time))), readings.told(time, what)


def _finer(declared: float | None, seen: float, kind: str) -> str | None:
    """A sentence where positions have finer steps [rad or m] than an encoder as declared could make; else None."""
    if not declared or not 0 < seen < _AS_DECLARED * declared:
        return None
    si = "rad" if kind == "hinge" else "m"
    return f"positions have steps of {seen:.4g} {si}, finer than the count of {declared:.4g} {si} that was declared"


def _in_si(
    table: formats.Table, entry: Mapping[str, Any], axis: Axis
) -> tuple[dict[str, Array], float | None, list[str | None]]:
    """The signals of a record, with the positions of other joints; what its time is counted in [s] where anybody says
    it, 0 with a rate; and sentences on units that the file states, and on a load in one of its own."""
    chosen, elsewhere = columns.of_joint(subtable(entry, "columns"), "columns", axis.joint)
    _expect_a_column_for_each(chosen, entry, axis)
    unit, other_units = columns.of_joint(subtable(entry, "units"), "units", axis.joint)
    scale, other_scales = columns.of_joint(subtable(entry, "scale"), "scale", axis.joint)
    signals, stated = columns.pick(table, chosen, columns.rate(entry))
    stated = {key: said for key, said in stated.items() if key not in unit and key not in scale}
    raw = [key for key in ("position", "torque", "current") if key in signals]
    said = {**unit, **scale, **columns.are_units(stated)}
    columns.expect_unit(signals, said, axis.joint.kind, *raw)
    own = None
    if "load" in signals and "load" not in scale and not axis.load_acts:
        own = columns.as_it_is(axis.joint.kind, stated, unit)
    of_current = str({**stated, **unit}.get("current", ""))
    if kind := units.kind_of_current(of_current):
        axis.current_kinds.setdefault(kind, str(entry["file"]))
        of_current = f"current in {of_current}: taken as A, and axis.torque_constant as one of A {kind}"
    columns.convert(signals, unit, scale, axis.joint)
    joints = {_OTHERS + k: columns.Joint(k, axis.joint.others[k], axis.resolution(k, axis.joint.others[k]))
              for k in elsewhere}  # fmt: skip
    for_all = any(not isinstance(subtable(entry, word).get("position", {}), Mapping) for word in ("units", "scale"))
    for name, joint in joints.items():
        at = elsewhere[joint.name]
        signals[name] = columns.column(table, f"columns.position.{joint.name}", at)
        beside = columns.stated_unit(table, at, "position")
        if beside and not for_all and joint.name not in {**other_units, **other_scales}:
            stated[name] = beside
            continue
        signals[name] = columns.into_si(
            signals[name], "position", other_units.get(joint.name, unit.get("position")),
            other_scales.get(joint.name, scale.get("position")), joint.kind, joint.resolution,
        )  # fmt: skip
    note = columns.as_stated(signals, stated, axis.joint, dict.fromkeys(joints, "position"), joints)
    note = note or columns.remarked(table, {**unit, **scale, **stated}, axis.joint.kind)
    counted_in = 0.0 if "rate" in entry else said.get("time")
    if isinstance(counted_in, str):
        counted_in = units.into_si(counted_in, "time", axis.joint.kind, None)[0]
    return signals, counted_in, [note, own, of_current if kind else None]


def _expect_a_column_for_each(chosen: Mapping[str, Any], entry: Mapping[str, Any], axis: Axis) -> None:
    """Raises DataError where one column is given for several joints."""
    if len(axis.names) > 1 and entry.get("joint") is None:
        for what in ("torque", "current", "position"):
            if what in chosen and not isinstance(entry["columns"][what], Mapping):
                raise DataError(
                    f"columns.{what}: the set is of several joints; give a column for each, as in "
                    f"{what} = {{ {axis.names[0]} = ..., {axis.names[1]} = ... }}, or say joint = \"...\" here"
                )


def _without_jumps(signals: dict[str, Array], table: formats.Table, axis: Axis) -> list[str | None]:
    """Unwraps the positions, in place, and says so; raises DataError where one leaps as no joint does."""
    notes = []
    for what in [k for k in signals if k.startswith("position")]:
        other = what.removeprefix(_OTHERS)
        kind = axis.joint.kind_of(other)
        count = axis.joint.resolution if what == "position" else axis.resolution(other, kind)
        signals[what], note = turns.unwrapped(signals[what], kind, count, what)
        notes.append(note)
        if (at := plausible.leap(signals[what], count, stays=what == "position")) is not None:
            before, after = signals[what][at - 1 : at + 1]
            si = "rad" if kind == "hinge" else "m"
            raise DataError(f"{table.place(at)}: {what} leaps from {before:.6g} to {after:.6g} {si} in one sample, "
                            "as no joint does; leave out what was read wrong, or take what is whole with span")
    return notes
