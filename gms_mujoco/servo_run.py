"""Runs of a servo that closes its own position loop: a log of goal and position with a known payload, and sets of them.

A set is a folder with `dataset.toml`, as of any axis; its records have a goal in the place of a torque:

    [axis]
    controller = "position"              # the servo closes its own position loop

    [[record]]
    file = "slow_sine.json"              # any table; JSON in the layout of Rhoban's BAM says all that follows itself
    use = "fit"                          # or "validate"
    gain = 16                            # of the position loop, as set in the servo
    mass = 0.535                         # kg, at the end of the arm
    length = 0.1                         # m, of the arm
    columns = { time = "t", goal = "asked", position = "q", powered = "on" }    # powered may be absent: always on
    units = { goal = "deg", position = "deg" }
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import signal

from . import columns as named
from . import dataset, formats
from .columns import expect_known, subtable
from .errors import DataError, listing

Array = NDArray[np.float64]

GRAVITY = 9.81  # m/s^2
CONTROLLERS = ("position",)
_KEYS = ("file", "use", "gain", "mass", "length", "columns", "units", "scale")
_BAM = {"time": "timestamp", "position": "position", "goal": "goal_position", "powered": "torque_enable"}
_BAM_HEADER = {"mass": "mass", "length": "length", "gain": "kp"}
_HEADER_UNITS = {"mass": "kg", "length": "m", "gain": "1"}
_WINDOW = 5  # samples, whose median a reading is compared with
_GLITCH = 0.15  # rad from that median: no servo gets there and back within four samples
_FIRST = 6  # samples that tell how fast a run begins


@dataclass(frozen=True)
class ServoRun:
    """One run of a servo with a pendulum on its shaft; position 0 hangs down.

    Attributes:
        name: where it comes from.
        time: (n,) [s], from 0, strictly increasing.
        goal: (n,) position asked for, from each sample on [rad].
        powered: (n,) 1 where the bridge was on, else 0.
        position: (n,) measured [rad].
        gain: of the position loop, as set in the servo.
        inertia: of the payload about the shaft [kg m^2].
        weight: torque of the payload when it stands out level [N m].
        notes: what was done to the data, one sentence each.
    """

    name: str
    time: Array
    goal: Array
    powered: Array
    position: Array
    gain: float
    inertia: float
    weight: float
    notes: tuple[str, ...] = ()

    @cached_property
    def velocity(self) -> float:
        """At the first sample [rad/s]."""
        return float(np.polyfit(self.time[:_FIRST], self.position[:_FIRST], 1)[0])


@dataclass(frozen=True)
class ServoSet:
    """The logs of one servo; a frozen value.

    Attributes:
        path: folder it was read from.
        fit: runs that identify parameters and choose between models.
        validate: runs that are scored once, after every choice.
        notes: what was done to the data, one sentence each.
    """

    path: Path
    fit: tuple[ServoRun, ...]
    validate: tuple[ServoRun, ...] = ()
    notes: tuple[str, ...] = ()


def load(path: str | Path) -> ServoSet:
    """Reads a measurement set of a servo. Where no record says what it is for, every third validates.

    Args:
        path: the folder with `dataset.toml`, or that file.

    Raises:
        DataError: anything that cannot be read or understood; one line that names file and key.
    """
    file = dataset.find(path)
    table = dataset.read_toml(file)
    try:
        expect_known(table, ("axis", "record"), "")
        axis = subtable(table, "axis")
        expect_known(axis, ("controller",), "axis.")
        if axis.get("controller") not in CONTROLLERS:
            raise DataError(f"axis.controller must be {listing(CONTROLLERS)}; {axis.get('controller')!r} given")
        entries = dataset.tables(table, "record")
        runs, uses = [], [e.get("use") for e in entries]
        for i, (entry, use) in enumerate(zip(entries, uses, strict=True), 1):
            expect_known(entry, _KEYS, f"record {i}: ")
            name = entry.get("file")
            if not isinstance(name, str) or not name:
                raise DataError(f"record {i}: file must be the name of a file; {name!r} given")
            if use not in (None, "fit", "validate"):
                raise DataError(f'record {i} ({name}): use must be "fit" or "validate"; {use!r} given')
            try:
                layout: dict[str, Any] = {k: subtable(entry, k) for k in ("columns", "units", "scale")}
                header = {k: entry[k] for k in _BAM_HEADER if k in entry}
                runs.append(read_run(file.parent / name, **layout, **header))
            except DataError as error:
                raise DataError(f"record {i}: {error}") from None
        if not any(uses):
            uses = ["validate" if i % 3 == 2 else "fit" for i in range(len(runs))]
        fitted = tuple(r for r, use in zip(runs, uses, strict=True) if use != "validate")
        if not fitted:
            raise DataError('no record has use = "fit"; nothing could be identified')
    except DataError as error:
        raise DataError(f"{file}: {error}") from None
    judged = tuple(r for r, use in zip(runs, uses, strict=True) if use == "validate")
    return ServoSet(file.parent, fitted, judged, tuple(f"{r.name}: {note}" for r in runs for note in r.notes))


def read_run(
    path: str | Path, *, columns: Mapping[str, Any] | None = None, units: Mapping[str, Any] | None = None,
    scale: Mapping[str, Any] | None = None, **header: float,
) -> ServoRun:  # fmt: skip
    """Reads one log: time, goal and position, and whether the bridge is on; a pendulum hangs on the shaft.

    JSON in the layout of Rhoban's BAM has mass [kg], length [m], kp and entries with timestamp [s], position and
    goal_position [rad], and torque_enable. A reading that is far off the median of its neighbours is a glitch of the
    sensor and replaced by that, with a note.

    Args:
        path: a table in any format of `formats`.
        columns: names of its columns by time, goal, position and powered, where they are not called so.
        units, scale: of columns that are not in SI, as in `dataset.toml`.
        **header: gain, mass [kg] and length [m], where the file does not say.

    Raises:
        DataError: the file cannot be read, or something is missing, not a number, or too short.
    """
    path = Path(path)
    if not path.is_file():
        raise DataError(f"{path}: no such file")
    table = formats.read(path)
    values = _header(path, header)
    try:
        found = _signals(table, columns or {})
        for key in {**(units or {}), **(scale or {})}:
            if key not in ("time", "goal", "position"):
                raise DataError(f"units and scale are of time, goal and position; {key!r} given")
            like = "position" if key == "goal" else key
            given = (units or {}).get(key), (scale or {}).get(key)
            found[key] = named.into_si(found[key], like, *given, "hinge", None)
    except DataError as error:
        raise DataError(f"{path}: {error}") from None
    time, position, goal, powered = (found[k] for k in _BAM)
    if len(time) < 2 * _FIRST or not all(np.isfinite(x).all() for x in (time, position, goal, powered)):
        raise DataError(f"{path}: expected at least {2 * _FIRST} samples, all finite; {len(time)} given")
    if np.any(np.diff(time) <= 0):
        raise DataError(f"{path}: time does not run forward at sample {int(np.argmax(np.diff(time) <= 0)) + 1}")
    usual = signal.medfilt(position, _WINDOW)
    usual[[0, 1, -2, -1]] = position[[0, 1, -2, -1]]  # its ends are padded with zeros
    wrong = np.abs(position - usual) > _GLITCH
    notes = (f"{wrong.sum()} readings of the position were glitches: the median of their neighbours is taken",)
    mass, length, gain = (values[k] for k in _BAM_HEADER)
    return ServoRun(
        path.name, time - time[0], goal, (powered > 0.5).astype(float), np.where(wrong, usual, position), gain,
        mass * length**2, GRAVITY * mass * length, notes if wrong.any() else (),
    )  # fmt: skip


def _header(path: Path, given: Mapping[str, Any]) -> dict[str, float]:
    """Gain and payload of a run, from what was given or else from the file."""
    expect_known(given, tuple(_BAM_HEADER), "")
    document = json.loads(path.read_text(encoding="utf-8")) if path.suffix == ".json" else {}  # read once: it is JSON
    values = {}
    for key, name in _BAM_HEADER.items():
        value = given.get(key, document.get(name) if isinstance(document, dict) else None)
        if isinstance(value, bool) or not isinstance(value, int | float) or not 0 < value < 1e6:
            said = key if key == name else f"{key} ({name} in the file)"
            raise DataError(f"{path}: {said} must be a positive number [{_HEADER_UNITS[key]}], beside the file or in "
                            f"it; {value!r} given")
        values[key] = float(value)
    return values


def _signals(table: formats.Table, chosen: Mapping[str, Any]) -> dict[str, Array]:
    """(n,) columns by time, position, goal and powered, raw; power is on where nothing says."""
    expect_known(chosen, tuple(_BAM), "columns.")
    found: dict[str, Array] = {}
    for key, usual in _BAM.items():
        at = chosen.get(key, next((k for k in (key, usual) if k in table.columns or k in table.unusable), None))
        if at is None and key == "powered":
            found[key] = np.ones_like(found["time"])
            continue
        found[key] = named.column(table, f"columns.{key}", key if at is None else at, None if key in chosen else key)
    if len({len(x) for x in found.values()}) > 1:
        raise DataError("columns differ in length: " + ", ".join(f"{k} has {len(x)}" for k, x in found.items()))
    return found
