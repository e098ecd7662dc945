"""Measurement sets: a folder with `dataset.toml` becomes Records in SI units."""

from __future__ import annotations

import json
import math
import os
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from . import files, formats, frf_table, timing, units
from .errors import DataError, listing
from .frf import FRF, INPUTS, response_unit
from .record import UNITS, USES, Record

Array = NDArray[np.float64]

FILE = "dataset.toml"
KINDS = ("hinge", "slide")
COLUMNS = (*UNITS, "current")
OPTIONAL = ("velocity", "load", "temperature")
_LARGEST = 1e30  # in SI; no axis has more of anything, and squares still fit into a double
_FIT_SHARE = 0.6  # of a single record, in time
_KEYS = {
    "axis": ("kind", "inertia", "encoder_counts_per_rev", "encoder_resolution", "torque_constant", "model", "joint"),
    "record": ("file", "use", "columns", "units", "scale"),
    "frf": ("file", "input", "output", "amplitude", "use", "columns", "units", "scale"),
}


@dataclass(frozen=True)
class Dataset:
    """The measurements of one axis; a frozen value.

    Attributes:
        path: folder it was read from.
        records: each with its use.
        kind: "hinge" (rad, N m) or "slide" (m, N).
        inertia: [kg m^2] or [kg]; None: to be identified.
        torque_constant: [N m/A], None where not given.
        split: a sentence: which records fit, select and validate, and who decided it.
        notes: what was done to the data or left unread, one sentence each.
        frfs: frequency responses, each with its use.
    """

    path: Path
    records: tuple[Record, ...]
    kind: str = "hinge"
    inertia: float | None = None
    torque_constant: float | None = None
    split: str = ""
    notes: tuple[str, ...] = ()
    frfs: tuple[FRF, ...] = ()

    @property
    def fit(self) -> tuple[Record, ...]:
        """Records that identify parameters."""
        return tuple(r for r in self.records if r.use == "fit")

    @property
    def select(self) -> tuple[Record, ...]:
        """Records that choose between models; empty where none was set apart."""
        return tuple(r for r in self.records if r.use == "select")

    @property
    def validate(self) -> tuple[Record, ...]:
        """Records that are scored once, after every choice."""
        return tuple(r for r in self.records if r.use == "validate")


def load(path: str | Path) -> Dataset:
    """Reads a measurement set.

    Where no record says what it is for, they are split: of several, every third validates and the rest fit; one
    alone fits with its first 60 % and validates with the rest. Where only some say it, the others fit.

    Args:
        path: the folder with `dataset.toml`, or that file.

    Raises:
        DataError: anything that cannot be read or understood; one line that names file, line or key.
    """
    path = Path(path)
    file = path / FILE if path.is_dir() else path
    table = _toml(file)
    try:
        _known(table, ("axis", "record", "frf"), "")
        axis = _Axis(_sub(table, "axis"))
        entries = _list(table, "record")
        frfs = tuple(_frf(i, e, file.parent, axis) for i, e in enumerate(_list(table, "frf"), 1))
        if not entries and not frfs:
            raise DataError("no [[record]] and no [[frf]]; a measurement set needs at least one")
        notes = frf_table.listed(frfs)
        records = []
        for i, entry in enumerate(entries, 1):
            record, note = _record(f"record {i}", entry, file.parent, axis)
            records.append(record)
            notes += [f"{record.name}: {note}"] if note else []
        if entries and not any(r.torque.any() for r in records):
            raise DataError("torque is zero in every record; at least one must be driven")
        records, split = _split(records, [e.get("use") for e in entries]) if entries else ([], "")
        if frfs:
            split = "; ".join(filter(None, (split, f"frequency responses: {len(frfs)}")))
    except DataError as error:
        raise DataError(f"{file}: {error}") from None
    return Dataset(
        file.parent, tuple(records), axis.kind, axis.inertia, axis.torque_constant, split, tuple(notes), frfs
    )


def save(
    path: str | Path, records: Sequence[Record], kind: str = "hinge", inertia: float | None = None, suffix: str = ".csv"
) -> None:
    """Writes records as a measurement set that `load` reads back: a file each, named after it, and `dataset.toml`.

    Args:
        path: folder, made where it does not exist.
        records: of one axis; all have the resolution of the first.
        kind, inertia: of the axis; [kg m^2] or [kg].
        suffix: of a format in `formats`.

    Raises:
        GmsError: two records of one name, or a place that cannot be written.
    """
    folder = files.make_folder(path)
    names = [f"{r.name.removesuffix(suffix)}{suffix}" for r in records]
    for name in names:
        if names.count(name) > 1:
            raise DataError(f"{path}: two records are called {name!r}")
    lines = ["[axis]", f'kind = "{kind}"']
    if inertia is not None:
        lines.append(f"inertia = {float(inertia)!r}")
    if records and records[0].resolution:
        lines.append(f"encoder_resolution = {float(records[0].resolution)!r}")
    for name, r in zip(names, records, strict=True):
        formats.write(folder / name, {"time": r.time, **r.signals})
        lines += ["", "[[record]]", f"file = {json.dumps(name)}", f'use = "{r.use}"']
    files.write_text(folder / FILE, "\n".join(lines) + "\n")


class _Axis:
    """The table [axis], checked."""

    def __init__(self, table: Mapping[str, Any]) -> None:
        _known(table, _KEYS["axis"], "axis.")
        for key in ("model", "joint"):
            if key in table:
                raise DataError(f"axis.{key}: joints of a model are not supported yet; give kind and inertia")
        self.kind = table.get("kind", "hinge")
        if self.kind not in KINDS:
            raise DataError(f"axis.kind must be one of {listing(KINDS)}; {self.kind!r} given")
        self.inertia = _positive(table, "inertia", "kg m^2" if self.kind == "hinge" else "kg")
        self.torque_constant = _number(table, "torque_constant", "axis.", "N m/A" if self.kind == "hinge" else "N/A")
        counts = _positive(table, "encoder_counts_per_rev", "counts")
        self.resolution = _positive(table, "encoder_resolution", "rad" if self.kind == "hinge" else "m")
        if counts is not None:
            if self.kind == "slide":
                raise DataError("axis.encoder_counts_per_rev is for a hinge; a slide takes encoder_resolution [m]")
            if self.resolution is not None:
                raise DataError("axis: give encoder_counts_per_rev or encoder_resolution, not both")
            self.resolution = 2 * math.pi / counts


def _record(key: str, entry: Mapping[str, Any], folder: Path, axis: _Axis) -> tuple[Record, str | None]:
    _known(entry, _KEYS["record"], f"{key}: ")
    name = entry.get("file")
    if not isinstance(name, str) or not name:
        raise DataError(f"{key}: file must be the name of a file; {name!r} given")
    use = entry.get("use", "fit")
    if use not in USES:
        raise DataError(f"{key} ({name}): use must be one of {listing(USES)}; {use!r} given")
    if not os.path.isfile(folder / name):
        raise DataError(f"{key}: no such file: {name}")
    table = formats.read(folder / name)
    try:
        columns = _columns(table, _sub(entry, "columns"))
        _convert(columns, _sub(entry, "units"), _sub(entry, "scale"), axis)
        if "current" in columns:
            if axis.torque_constant is None:
                raise DataError("the record has current, not torque: axis.torque_constant [N m/A] is needed")
            columns["torque"] = axis.torque_constant * columns.pop("current")
        _check(table, columns)
        time, signals, note = timing.evenly(columns.pop("time"), columns)
    except DataError as error:
        raise DataError(f"{key} ({name}): {error}") from None
    short = Path(name).name if Path(name).is_absolute() else name
    return Record(short, time, signals, use, axis.resolution), note


def _columns(table: formats.Table, chosen: Mapping[str, Any]) -> dict[str, Array]:
    """The columns of a record by their names in the contract, raw."""
    _known(chosen, COLUMNS, "columns.")
    if not table.named and not chosen:
        raise DataError(
            f"the file does not name its {len(table.columns)} columns; number them from 0, "
            "as in columns = { time = 0, torque = 1, position = 2 }"
        )
    available = {**table.columns, **table.unusable}
    wanted = {k: v for k, v in chosen.items() if not (v is False and k in OPTIONAL)}
    if "torque" in chosen and "current" in chosen:
        raise DataError("columns: give torque or current, not both")
    drive = next((k for k in ("torque", "current") if k in chosen), None) or (
        "current" if "current" in available and "torque" not in available else "torque"
    )
    for key in ("time", "position", drive):
        wanted.setdefault(key, key)
    for key in OPTIONAL:
        if key in table.columns and key not in chosen:
            wanted[key] = key
    columns: dict[str, Array] = {}
    for key, at in wanted.items():
        if isinstance(at, bool) or not isinstance(at, int | str):
            raise DataError(f"columns.{key} must be the name or the number of a column; {at!r} given")
        if isinstance(at, int):
            if not 0 <= at < len(table.columns):
                raise DataError(f"columns.{key}: no column {at}; there are {len(table.columns)}, counted from 0")
            at = list(table.columns)[at]
        if at in table.unusable:
            raise DataError(f"column {at!r}: {table.unusable[at]}")
        if at not in table.columns:
            hint = "" if key in chosen else f"; name it with columns = {{ {key} = ... }}"
            raise DataError(f"no column {at!r} for {key}; the file has {listing(table.columns)}{hint}")
        columns[key] = np.array(table.columns[at], float)
    return columns


def _convert(columns: dict[str, Array], unit: Mapping[str, Any], scale: Mapping[str, Any], axis: _Axis) -> None:
    """Raw numbers into SI, in place."""
    for word, table in (("units", unit), ("scale", scale)):
        _known(table, COLUMNS, f"{word}.")
        for key in table:
            if key not in columns:
                raise DataError(f"{word}.{key}: the record has no {key}; it has {listing(columns)}")
    for key in scale:
        if key in unit:
            raise DataError(f"{key} has a unit and a scale: give one of them (scale turns the raw numbers into SI)")
        columns[key] *= _number(scale, key, "scale.", "SI per raw number")
    for key, name in unit.items():
        if not isinstance(name, str):
            raise DataError(f"units.{key} must be a unit in quotes; {name!r} given")
        try:
            factor, offset = units.into_si(name, key, axis.kind, axis.resolution)
        except DataError as error:
            raise DataError(f"units.{key}: {error}") from None
        columns[key] = columns[key] * factor + offset


def _check(table: formats.Table, columns: Mapping[str, Array]) -> None:
    """What can be told with the line in the file; Record checks the rest."""
    lengths = {k: len(v) for k, v in columns.items()}
    if len(set(lengths.values())) > 1:
        raise DataError("columns differ in length: " + ", ".join(f"{k} has {n}" for k, n in lengths.items()))
    for key, value in columns.items():
        bad = np.flatnonzero(~(np.abs(value) < _LARGEST))
        if len(bad):
            raise DataError(f"{table.place(bad[0])}: {key} is {value[bad[0]]}, not a finite number ({len(bad)} such)")
    if lengths["time"] < 16:
        raise DataError(f"{lengths['time']} samples; at least 16 are needed")
    time = columns["time"]
    back = np.flatnonzero(np.diff(time) <= 0)
    if len(back):
        i = int(back[0])
        raise DataError(f"{table.place(i + 1)}: time does not run forward ({time[i]:.9g} s, then {time[i + 1]:.9g} s)")
    if np.ptp(columns["position"]) == 0:
        raise DataError("position never changes; nothing can be learnt from a joint that does not move")


def _split(records: list[Record], uses: list[Any]) -> tuple[list[Record], str]:
    """Records with their use, and the sentence that tells it."""
    if any(uses):
        given = "as given"
        if not all(uses):
            rest = ", ".join(r.name for r, use in zip(records, uses, strict=True) if not use)
            given = f"as given; {rest}: no use given, so fit"
    elif len(records) == 1:
        whole = records[0]
        cut = round(_FIT_SHARE * len(whole))
        if cut < 16 or len(whole) - cut < 16:
            raise DataError(f"{whole.name}: {len(whole)} samples are too few to fit and validate; give a second record")
        records = [
            whole.slice(0, cut, name=f"{whole.name} (first 60 %)"),
            whole.slice(cut, len(whole), name=f"{whole.name} (last 40 %)", use="validate"),
        ]
        given = "no use was given: the first 60 % of the only record fit, the rest validate"
    else:
        every = 3 if len(records) > 2 else 2
        records = [replace(r, use="validate" if i % every == every - 1 else "fit") for i, r in enumerate(records)]
        given = f"no use was given: every {'third' if every == 3 else 'second'} record validates, the others fit"
    if not any(r.use == "fit" for r in records):
        raise DataError('no record has use = "fit"; nothing could be identified')
    counts = [f"{n} to {use}" for use in USES if (n := sum(r.use == use for r in records))]
    return records, f"records: {', '.join(counts)} ({given})"


def _frf(i: int, entry: Mapping[str, Any], folder: Path, axis: _Axis) -> FRF:
    key = f"frf {i}"
    _known(entry, _KEYS["frf"], f"{key}: ")
    name = entry.get("file")
    if not isinstance(name, str) or not name:
        raise DataError(f"{key}: file must be the name of a file; {name!r} given")
    try:
        use = entry.get("use", "fit")
        if use not in USES:
            raise DataError(f"use must be one of {listing(USES)}; {use!r} given")
        for side, example in (("input", "torque"), ("output", "position")):
            if not isinstance(entry.get(side), str):
                raise DataError(f'{side} must be given, as in {side} = "{example}"; {entry.get(side)!r} given')
        # A current is turned into torque; then the amplitude is one of torque already.
        source, constant = entry["input"], 1.0
        if source == "current":
            if axis.torque_constant is None:
                raise DataError("the input is current, not torque: axis.torque_constant [N m/A] is needed")
            constant = axis.torque_constant
        drive = INPUTS.get(source, "")
        amplitude = _number(entry, "amplitude", "", drive if axis.kind == "hinge" else drive.replace("N m", "N"))
        scale = _number(entry, "scale", "", "SI per raw number")
        if not os.path.isfile(folder / name):
            raise DataError(f"no such file: {name}")
        found = frf_table.from_table(
            formats.read(folder / name), Path(name).name, source, entry["output"],
            columns=_sub(entry, "columns"), unit=_sub(entry, "units"), scale=1.0 if scale is None else scale,
            amplitude=amplitude, kind=axis.kind, count=axis.resolution, use=use,
        )  # fmt: skip
        if source == "current":
            excitation = None if found.excitation is None else found.excitation * abs(constant)
            sigma = None if found.sigma is None else found.sigma / abs(constant)
            unit = response_unit("torque", found.output, axis.kind)
            found = replace(
                found, response=found.response / constant, input="torque", unit=unit, excitation=excitation, sigma=sigma
            )
    except DataError as error:
        raise DataError(f"{key} ({name}): {error}") from None
    return found


def _toml(file: Path) -> dict[str, Any]:
    try:
        return tomllib.loads(file.read_text(encoding="utf-8"))
    except FileNotFoundError:
        where = f"{file.parent}: no {FILE} in this folder" if file.name == FILE else f"{file}: no such file or folder"
        raise DataError(f"{where}; expected a measurement set, a folder with {FILE}") from None
    except tomllib.TOMLDecodeError as error:
        raise DataError(f"{file}: not TOML ({error})") from None
    except (OSError, ValueError, RecursionError) as error:
        raise DataError(f"{file}: cannot be read ({error})") from None


def _known(table: Mapping[str, Any], names: tuple[str, ...], where: str) -> None:
    for key in table:
        if key not in names:
            raise DataError(f"unknown key {where}{key}; expected {listing(names)}")


def _sub(table: Mapping[str, Any], key: str) -> Mapping[str, Any]:
    value = table.get(key, {})
    if not isinstance(value, Mapping):
        raise DataError(f"{key} must be a table; {value!r} given")
    return value


def _list(table: Mapping[str, Any], key: str) -> list[Mapping[str, Any]]:
    value = table.get(key, [])
    if not isinstance(value, list) or not all(isinstance(v, Mapping) for v in value):
        raise DataError(f"{key} must be written as [[{key}]]; {value!r} given")
    return value


def _number(table: Mapping[str, Any], key: str, where: str, unit: str) -> Any:
    value = table.get(key)
    if value is None:
        return None
    if isinstance(value, bool) or not isinstance(value, int | float) or not 1e-30 < abs(value) < 1e30:
        raise DataError(f"{where}{key} must be a number other than 0 [{unit}]; {value!r} given")
    return float(value)


def _positive(table: Mapping[str, Any], key: str, unit: str) -> float | None:
    value: float | None = _number(table, key, "axis.", unit)
    if value is not None and value < 0:
        raise DataError(f"axis.{key} must be positive [{unit}]; {value!r} given")
    return value
