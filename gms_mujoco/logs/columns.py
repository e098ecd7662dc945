"""The columns of a record: found by name, place or joint in the table of a file, and brought into SI."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import formats
from ..errors import DataError, listing
from ..record import UNITS, USES
from . import timing, units

Array = NDArray[np.float64]

COLUMNS = (*UNITS, "current")
OPTIONAL = tuple(k for k in UNITS if k not in ("time", "torque", "position"))
ASKED_FOR = ("reference",)  # a column of that name may be anything
_IN_BRACKETS = re.compile(r"\s*/?\s*[\[({]([^\[\](){}]+)[\])}]\s*$")  # "Torque [mNm]", "v / (rad/s)"
_BEHIND_A_BAR = re.compile(r"(?:_|\s*[/,]\s*)([^\s_,/]+(?:/[a-z]+)?)\s*$")  # "torque_mNm", "M / mNm"
_PARTS = re.compile(r"(?<=[\W_])[^\W_]{2,}|(?<=[a-z])[A-Z][a-z]+$")  # "q_deg_filtered", "position in deg", "PosDeg"
_WORDS = ("in", "d", "h", "m", "N")  # behind a bar they are more often no units
_INSIDE = ("min", "rev", "turn", "inc", "count", "counts")  # inside a name they are
_OR_CURRENT = ", of a current current = ... in the place of torque"
_MANY = 20  # different whole numbers, which are no radians or metres
_COARSE = 0.02  # of the stamps of a clock repeat the one before
_SPARSE = 0.5  # of the rows of the position, that a column of the same source has at least


@dataclass(frozen=True)
class Joint:
    """What the conversion of a column needs to know of the axis.

    Attributes:
        name: of the joint in its MJCF model, "" for a bare axis.
        kind: "hinge" or "slide".
        resolution: position of one encoder count [rad or m], None where unknown.
        others: kind of every other hinge and slide joint of the model, by name.
    """

    name: str = ""
    kind: str = "hinge"
    resolution: float | None = None
    others: Mapping[str, str] = field(default_factory=dict)

    def kind_of(self, name: str) -> str:
        """Kind of a joint of the model by name; of this one for any other name."""
        return self.others.get(name, self.kind)


def of_joint(table: Mapping[str, Any], what: str, joint: Joint) -> tuple[dict[str, Any], dict[str, Any]]:
    """A table by column, with the columns that are tables by joint taken apart.

    Args:
        table: {column: value} or {column: {joint: value}}.
        what: how the table is called in messages, "columns".

    Returns:
        Values by column for `joint`, and the positions of other joints by their name.
    """
    own: dict[str, Any] = {}
    others: dict[str, Any] = {}
    for key, value in table.items():
        if not isinstance(value, Mapping):
            own[key] = value
            continue
        if not joint.name:
            raise DataError(f"{what}.{key}: a table by joint needs axis.model and axis.joint")
        for name, given in value.items():
            if name == joint.name:
                own[key] = given
            elif name not in joint.others:
                known = listing([joint.name, *joint.others])
                raise DataError(f"{what}.{key}: the model has no hinge or slide joint {name!r}; it has {known}")
            elif key == "position":
                others[name] = given
    return own, others


def pick(
    table: formats.Table, chosen: Mapping[str, Any], rate: float | None = None
) -> tuple[dict[str, Array], dict[str, str]]:
    """The columns of a record by their names in the contract, raw, and the units that the file states for them.

    Names are found to the letter, or else whatever their case and with a unit behind them: "Torque [mNm]" is "torque".

    Args:
        chosen: the user's columns.
        rate: samples per second, for time that is counted instead of read.
    """
    expect_known(chosen, COLUMNS, "columns.")
    if rate is not None and "time" in chosen:
        raise DataError("give columns.time or rate, not both: with a rate time is counted")
    if not table.named and not chosen:
        raise DataError(
            f"the file does not name its {len(table.columns)} columns; number them from 0, "
            "as in columns = { time = 0, torque = 1, position = 2 }"
        )
    available = by_name(table, dict(zip(COLUMNS, COLUMNS, strict=True)))
    wanted = {k: _meant(table, v, k) for k, v in chosen.items() if not (v is False and k in OPTIONAL)}
    if "torque" in chosen and "current" in chosen:
        raise DataError("columns: give torque or current, not both")
    drive = next((k for k in ("torque", "current") if k in chosen), None) or (
        "current" if "current" in available and "torque" not in available else "torque"
    )
    for key in (*(["time"] if rate is None else []), "position", drive):
        wanted.setdefault(key, available.get(key, key))
    for key in OPTIONAL:
        there = available.get(key) in table.columns and key not in chosen and key not in ASKED_FOR
        if there and np.isfinite(table.columns[available[key]]).any():
            wanted[key] = available[key]
    expect_found(table, {key: at for key, at in wanted.items() if key not in chosen})
    raw = {key: column(table, f"columns.{key}", at, None if key in chosen else key) for key, at in wanted.items()}
    stated = {key: stated_unit(table, at, key) for key, at in wanted.items()}
    if rate is not None:
        expect_rate(table, available.get("time"), rate)
        raw["time"] = np.arange(max(map(len, raw.values()))) / rate
    elif (rest := _nanoseconds_beside(table, wanted["time"])) is not None:
        raw["time"] = raw["time"] - raw["time"][0] + 1e-9 * rest
    return raw, {key: unit for key, unit in stated.items() if unit}


def expect_rate(table: formats.Table, at: Any, rate: float) -> None:
    """Raises DataError where the column of time contradicts a rate [Hz]."""
    if (time := table.columns.get(_called(table, at))) is not None and len(time) > 1:
        unit = stated_unit(table, at, "time")
        named = units.measures(unit, "time")
        timing.expect_rate(time * (units.into_si(unit, "time", "hinge", None)[0] if named else 1.0), rate, named)


def _nanoseconds_beside(table: formats.Table, at: Any) -> Array | None:
    """The nanoseconds of stamps of which a column has the whole seconds, as those of ROS are written; None where there
    are none."""
    name = _called(table, at)
    if not (match := re.search(r"secs?$", name)) or np.any(table.columns[name] % 1):
        return None
    beside = (name[: match.start()] + rest for rest in ("nsecs", "nsec", "nanosec", "nanosecs"))
    return next((table.columns[k] for k in beside if k in table.columns), None)


def by_name(table: formats.Table, words: Mapping[str, str]) -> dict[str, str]:
    """Columns of a file that are called by one of the words: to the letter, or else in another case or with a unit
    behind.

    Args:
        words: what each of them measures, a column of the contract.
    """
    names = [*table.columns, *table.unusable]
    alike = {k: [n for n in names if _parted(n, what)[0].lower() == k] for k, what in words.items()}
    return {k: k if k in names else found[0] for k, found in alike.items() if k in names or len(found) == 1}


def _meant(table: formats.Table, at: Any, what: str) -> Any:
    """The column that a user's name for it means."""
    if not isinstance(at, str) or at in table.columns:
        return at
    return by_name(table, {at.lower(): what}).get(at.lower(), at)


def _called(table: formats.Table, at: Any) -> Any:
    """The name of a column that is given by its name or its number."""
    return table.names[at] if isinstance(at, int) else at


def stated_unit(table: formats.Table, at: Any, what: str) -> str:
    """The unit of a column that the file states beside it or in its name, as it is written, or ""."""
    name = _called(table, at)
    unit = (table.units.get(name) or _parted(name, what)[1]).strip(" -")
    return "" if unit.isdecimal() else unit


def _parted(name: str, what: str) -> tuple[str, str]:
    """A column's name without its unit, and the unit: what stands in brackets, or a unit of `what` behind a bar."""
    if match := _IN_BRACKETS.search(name):
        return name[: match.start()].strip(), match[1].strip()
    match = _BEHIND_A_BAR.search(name)
    if match and match[1] not in _WORDS and units.measures(match[1], what):
        return name[: match.start()].strip(), match[1]
    found = [m for m in _PARTS.finditer(name) if m[0].lower() not in _WORDS and units.measures(m[0], what)]
    if len(found) == 1 and (unit := found[0]).end() == len(name):
        return re.sub(r"[\W_]+(in)?[\W_]*$", "", name[: unit.start()]), unit[0]
    if len(found) == 1 and unit[0].lower() not in _INSIDE:
        return name.strip(), unit[0]
    return name.strip(), ""


def expect_found(table: formats.Table, wanted: Mapping[str, str]) -> None:
    """Raises DataError naming all columns that nobody chose and that are not there, where they are several."""
    missing = [key for key, at in wanted.items() if at not in table.columns and at not in table.unusable]
    if len(missing) > 1:
        choice = ", ".join(f"{key} = ..." for key in missing)
        rate = "; a file without time takes rate = ... [Hz]" if "time" in missing else ""
        rate = _OR_CURRENT + rate if "torque" in missing else rate
        raise DataError(f"no columns called {', '.join(missing)}; the file has {listing(table.columns)}; name them "
                        f"with columns = {{ {choice} }}{rate}")


def column(table: formats.Table, label: str, at: Any, guessed: str | None = None) -> Array:
    """One raw column.

    Args:
        label: of the key that asks for it, for messages.
        at: its name, or its number counted from 0.
        guessed: the contract's name where nobody gave `at`.
    """
    if isinstance(at, bool) or not isinstance(at, int | str):
        raise DataError(f"{label} must be the name or the number of a column; {at!r} given")
    if isinstance(at, int):
        if not 0 <= at < len(table.names):
            raise DataError(f"{label}: no column {at}; there are {len(table.names)}, counted from 0")
        at = _called(table, at)
    if at in table.unusable:
        raise DataError(f"column {at!r}: {table.unusable[at]}")
    if at not in table.columns:
        hint = f"; name it with columns = {{ {guessed} = ... }}" if guessed else ""
        hint += _OR_CURRENT if guessed == "torque" else ""
        hint += ", or give rate = ... [Hz] where the file has none" if guessed == "time" else ""
        raise DataError(f"no column {at!r} for {label.removeprefix('columns.')}; "
                        f"the file has {listing(table.columns)}{hint}")
    return np.array(table.columns[at], float)


def convert(columns: dict[str, Array], unit: Mapping[str, Any], scale: Mapping[str, Any], joint: Joint) -> None:
    """Raw numbers into SI, in place."""
    for word, table in (("units", unit), ("scale", scale)):
        expect_known(table, COLUMNS, f"{word}.")
        for key in table:
            if key not in columns:
                raise DataError(f"{word}.{key}: the record has no {key}; it has {listing(columns)}")
    for key in {**scale, **unit}:
        columns[key] = into_si(columns[key], key, unit.get(key), scale.get(key), joint.kind, joint.resolution)


def as_it_is(kind: str, *said: dict[str, Any]) -> str | None:
    """Takes out the unit of a load that is neither a torque nor a force, and a sentence; None where there is none.

    Friction may grow with anything, and nobody asks how much a percent or a bar of it is.

    Args:
        kind: of the joint.
        said: units by column, changed in place.
    """
    for table in said:
        unit = table.get("load")
        if isinstance(unit, str) and units.in_column(unit, "load", kind) not in units.units_of("load", kind):
            del table["load"]
            return f"load in {unit}: taken as it is, in that unit"
    return None


def as_stated(
    columns: dict[str, Array], stated: Mapping[str, str], joint: Joint, like: Mapping[str, str] | None = None,
    others: Mapping[str, Joint] | None = None,
) -> str | None:  # fmt: skip
    """Raw numbers into SI, in place, by the units that a file states; a sentence where one is not SI already.

    Args:
        like: what a column measures where its name does not say it.
        others: the joint of a column that is not of this one.

    Raises:
        DataError: a unit that is not known, or of something else.
    """
    said, unknown = [], []
    for key, unit in stated.items():
        what, of = (like or {}).get(key, key), (others or {}).get(key, joint)
        if not units.may_be(unit, what):
            unknown.append(f"{unit!r} beside {key}")
            continue
        try:
            factor, offset = units.into_si(unit, what, of.kind, of.resolution)
        except DataError as error:
            si = next(iter(units.units_of(what, of.kind)))
            raise DataError(f"the file states a unit of {key}: {error}; say scale = {{ {key} = ... }} [{si} per raw "
                            f'number], or units = {{ {key} = "{si}" }} where it is that') from None
        if (factor, offset) != (1.0, 0.0):
            columns[key] = columns[key] * factor + offset
            meant = units.in_column(unit, what, of.kind)
            said.append(f"{key} in {unit}" + f" ({meant})" * (meant != unit and meant.lower() == unit.lower()))
    told = [f"units as the file states them: {', '.join(said)}"] if said else []
    told += [f"{', '.join(unknown)} in the file is no unit that is known: taken as SI"] if unknown else []
    return "; ".join(told) or None


def are_units(stated: Mapping[str, str], like: Mapping[str, str] | None = None) -> dict[str, str]:
    """Those that are units of what stands in brackets, as `as_stated` takes them."""
    return {key: unit for key, unit in stated.items() if units.may_be(unit, (like or {}).get(key, key))}


def remarked(table: formats.Table, said: Mapping[str, Any], kind: str) -> str | None:
    """A doubt where a line above the names speaks of a unit that is not SI, and nobody says the units."""
    asked = ("position", "torque", "current")
    if {*asked} & {*said}:
        return None
    for line in table.remarks:
        words = re.findall(r"[^\W\d_]+", line)
        words += [part for word in words for part in re.findall(r"[A-Z][a-z]+", word)]
        for word in (w for w in words if len(w) > 1 and w not in _WORDS):
            of = [what for what in asked if units.in_column(word, what, kind) in units.units_of(what, kind)]
            if of and not any(units.is_si(word, what, kind) for what in of):
                return (f"a line above the names speaks of {word} ({line.strip()[:60]!r}), and {of[0]} is taken as "
                        f'SI: say units = {{ {of[0]} = "{word}" }} where it is that')
    return None


def expect_unit(columns: Mapping[str, Array], said: Mapping[str, Any], kind: str, *keys: str) -> None:
    """Raises DataError where a column of which nobody says the unit has whole numbers: those of a converter."""
    for key in keys:
        values = columns[key][np.isfinite(columns[key])]
        if key in said or np.any(values % 1) or len(np.unique(values)) < _MANY:
            continue
        si = {"torque": ("N m", "N"), "current": ("A", "A")}.get(key, ("rad", "m"))[kind == "slide"]
        counted = f'units = {{ {key} = "counts" }}, ' if key not in ("torque", "current") else ""
        raise DataError(
            f"{key} has whole numbers only, from {values.min():g} to {values.max():g}, as a converter counts; say "
            f"{counted}scale = {{ {key} = ... }} [{si} per count] or units = {{ {key} = "
            f'"{si}" }} where that is right'
        )


def into_si(raw: Array, key: str, unit: Any, scale: Any, kind: str, resolution: float | None) -> Array:
    """One column in SI; `unit` and `scale` as in `dataset.toml`, None where not given."""
    if unit is not None and scale is not None:
        raise DataError(f"{key} has a unit and a scale: give one of them (scale turns the raw numbers into SI)")
    if scale is not None:
        return raw * number({key: scale}, key, "scale.", "SI per raw number")
    if unit is None:
        return raw
    if not isinstance(unit, str):
        raise DataError(f"units.{key} must be a unit in quotes; {unit!r} given")
    try:
        factor, offset = units.into_si(unit, key, kind, resolution)
    except DataError as error:
        raise DataError(f"units.{key}: {error}") from None
    return raw * factor + offset


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


def on_rows_of_position(columns: dict[str, Array], sensed: bool) -> tuple[NDArray[np.bool_] | slice, str | None]:
    """Takes torque, and other joints, at the rows of the position where theirs are others, in place; those rows, and a
    sentence where there are such.

    A log of several sources with clocks of their own has a number in one column and none in the next. A torque that a
    sensor read is interpolated, as positions are; one that was commanded stays until the next.
    """
    if len({len(c) for c in columns.values()}) != 1:
        return slice(None), None
    time, rows = columns["time"], np.isfinite(columns["position"])
    needed = [k for k in columns if k == "torque" or (k.startswith("position") and k != "position")]
    sparse = [k for k in needed if np.isfinite(columns[k][rows]).sum() < _SPARSE * rows.sum()]
    if not sparse:
        return slice(None), None
    there = {k: np.isfinite(columns[k]) & np.isfinite(time) for k in sparse}
    if any(t.sum() < 2 for t in there.values()):
        return slice(None), None
    rows &= np.isfinite(time) & (time >= max(time[t][0] for t in there.values()))
    rows &= time <= min(time[t][-1] for t in there.values())
    for key in sparse:
        at, values = time[there[key]], columns[key][there[key]]
        if key == "torque" and not sensed:
            columns[key] = np.append(values, values[-1:])[np.searchsorted(at, time, side="right") - 1]
        else:
            columns[key] = np.interp(time, at, values)
    for key, value in columns.items():
        columns[key] = value[rows]
    how = "as they were last" if sparse == ["torque"] and not sensed else "in between"
    return rows, f"{listing(sparse)} stands in other rows than position: taken {how}"


def without_repeats(columns: dict[str, Array]) -> tuple[NDArray[np.bool_] | slice, str | None]:
    """Leaves out rows that are the one before once more, as a bus delivers them, in place; those left, and a sentence
    where there are others.

    Where a time comes twice with other values, or often, the clock is to blame, and the rows stay.
    """
    if len({len(c) for c in columns.values()}) != 1:
        return slice(None), None
    still = np.diff(columns["time"]) == 0
    again = np.all([np.diff(c) == 0 for c in columns.values()], axis=0)
    n = int(again.sum())
    if not n or n > _COARSE * len(still) or (still & ~again).any():
        return slice(None), None
    kept = np.concatenate([[True], ~again])
    for key, value in columns.items():
        columns[key] = value[kept]
    return kept, f"{n} row{' repeats' if n == 1 else 's repeat'} the one before: left out"


def check(table: formats.Table, columns: Mapping[str, Array], fewest: int = 16) -> None:
    """What can be told with the line in the file; Record checks the rest.

    Args:
        fewest: samples that are needed.
    """
    lengths = {k: len(v) for k, v in columns.items()}
    if len(set(lengths.values())) > 1:
        raise DataError("columns differ in length: " + ", ".join(f"{k} has {n}" for k, n in lengths.items()))
    for key, value in columns.items():
        bad = np.flatnonzero(~(np.abs(value) < formats.LARGEST))
        if len(bad):
            whole = np.all([np.abs(v) < formats.LARGEST for v in columns.values()], axis=0)
            without = f", or leave it out with columns = {{ {key} = false }}" if key in OPTIONAL else ""
            why = formats.why_unusable(value[bad[0]])
            raise DataError(f"{table.place(bad[0])}: {key} is {value[bad[0]]}, {why} ({len(bad)} such); "
                            + timing.parts(columns["time"], whole) + without)
    if lengths["time"] < fewest:
        raise DataError(f"{lengths['time']} samples; at least {fewest} are needed")
    time = columns["time"]
    back = np.flatnonzero(np.diff(time) <= 0)
    if len(back):
        i, n = int(back[0]), len(back)
        if time[i] > time[i + 1]:
            hint = "where the clock begins anew make it two files, where rows are out of order sort them"
        elif n > _COARSE * len(time):
            hint = "where the clock is too coarse say rate = ... [Hz], and time is counted"
        else:
            hint = f"leave out the row{'s' * (n > 1)} ({n} such), or say rate = ... [Hz] where time shall be counted"
        where = f"{table.place(i + 1)}: time does not run forward"
        raise DataError(f"{where} ({time[i]:.9g} s, then {time[i + 1]:.9g} s); {hint}")


def expect_known(table: Mapping[str, Any], names: tuple[str, ...], where: str) -> None:
    """Raises DataError for a key that does not exist."""
    for key in table:
        if key not in names:
            raise DataError(f"unknown key {where}{key}; expected {listing(names)}")


def file_and_use(entry: Mapping[str, Any], keys: tuple[str, ...], where: str) -> tuple[str, str]:
    """The file that an entry of `dataset.toml` names, and what it is for: "fit" where it does not say.

    Raises:
        DataError: a key that is none of `keys`, no file, or a use that does not exist.
    """
    expect_known(entry, keys, f"{where}: ")
    name, use = entry.get("file"), entry.get("use", "fit")
    if not isinstance(name, str) or not name:
        raise DataError(f"{where}: file must be the name of a file; {name!r} given")
    expect_name(name, f"{where}: file")
    if use not in USES:
        raise DataError(f"{where} ({name}): use must be one of {listing(USES)}; {use!r} given")
    return name, use


def expect_name(name: str, key: str) -> None:
    """Raises DataError where the name of a file under a key has what a backslash between quotes makes in TOML."""
    if any(c < " " for c in name):
        raise DataError(f"{key} = {name!r} has a character that no name has, as a \\ in quotes makes one; write / in "
                        "its place")


def number(table: Mapping[str, Any], key: str, where: str, unit: str) -> Any:
    """A number other than 0, None where it is not given."""
    value = table.get(key)
    if value is None:
        return None
    if isinstance(value, bool) or not isinstance(value, int | float) or not 1e-30 < abs(value) < 1e30:
        raise DataError(f"{where}{key} must be a number other than 0 [{unit}]; {value!r} given")
    return float(value)


def rate(entry: Mapping[str, Any]) -> float | None:
    """Samples per second [Hz] that an entry of `dataset.toml` says, for a file whose time is counted."""
    value: float | None = number(entry, "rate", "", "Hz")
    if value is not None and value < 0:
        raise DataError(f"rate must be positive [Hz]; {value:g} given")
    return value


def subtable(table: Mapping[str, Any], key: str) -> Mapping[str, Any]:
    """A table inside a table, empty where it is not given."""
    value = table.get(key, {})
    if not isinstance(value, Mapping):
        raise DataError(f"{key} must be a table; {value!r} given")
    return value
