"""Measurement sets: a folder with `dataset.toml` becomes Records in SI units."""

from __future__ import annotations

import json
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
from numpy.typing import NDArray

from . import files, formats, servo_run
from .errors import DataError, listing
from .frf import FRF, drive_unit
from .logs import plausible, record_files
from .logs.columns import ASKED_FOR, expect_known, subtable
from .logs.measured_axis import ENCODER, Axis, encoder_count, joint_names
from .logs.robot import Robot, Setup
from .record import USES, Record, told_uses
from .responses import frf_files, frf_table
from .servo_run import CONTROLLERS, ServoRun

Array = NDArray[np.float64]

FILE = "dataset.toml"
_FIT_SHARE = 0.6  # of a single record, in time
_HARDLY = 0.1  # of the longest record: a clock that began so little before it began with it


@dataclass(frozen=True)
class Dataset:
    """The measurements of one axis; a frozen value.

    Attributes:
        path: folder it was read from.
        records: each with its use; one that says no kind of joint is of that of the set.
        kind: "hinge" (rad, N m) or "slide" (m, N).
        inertia: [kg m^2] or [kg]; None: to be identified.
        torque_constant: [N m/A], None where not given.
        split: a sentence: which records fit, select and validate, and who decided it.
        notes: what was done to the data or left unread, one sentence each.
        frfs: frequency responses, each with its use.
        joint: of the robot whose measurements these are; None for a bare axis.
        servos: runs of a servo that closes its own position loop, each with its use; a set has these, or records and
            responses.
        robot: whose joint that is; None for a bare axis.
    """

    path: Path
    records: tuple[Record, ...]
    kind: str = "hinge"
    inertia: float | None = None
    torque_constant: float | None = None
    split: str = ""
    notes: tuple[str, ...] = ()
    frfs: tuple[FRF, ...] = ()
    joint: str | None = None
    servos: tuple[ServoRun, ...] = ()
    robot: Robot | None = field(default=None, repr=False)

    def __post_init__(self) -> None:
        of_joint = tuple(r if r.kind else replace(r, kind=self.kind) for r in self.records)
        object.__setattr__(self, "records", of_joint)

    def __iter__(self) -> NoReturn:
        """A set is no list: `fit(plant, runs)` would take what is set apart for validation.

        Raises:
            DataError: always.
        """
        raise DataError("a measurement set is given as one of its parts: .fit, .select, .validate or .all")

    @property
    def controller(self) -> str | None:
        """What the drive closes by itself: "position", or None where it takes a torque."""
        return "position" if self.servos else None

    def set_up(self, setup: Setup) -> Dataset:
        """The same measurements of a robot that was set up in another way.

        Raises:
            DataError: a bare axis, or a body or joint that its model does not have.
        """
        if self.robot is None:
            raise DataError("a setup is that of a robot; this set has no axis.model")
        robot = self.robot.set_up(setup)
        return replace(self, records=tuple(robot.on(self.records)[0]), robot=robot)

    def with_acting_load(self, sign: int) -> Dataset:
        """The same measurements of an axis on which the logged load acts too, see `Record.with_acting_load`."""
        return replace(self, records=tuple(r.with_acting_load(sign) for r in self.records))

    def with_temperature_of_all(self) -> Dataset:
        """The same measurements without a temperature that only some of the records have: what friction that follows it
        does in the others nobody could say."""
        known = sum("temperature" in r.signals for r in self.records)
        if known in (0, len(self.records)):
            return self
        said = f"the temperature is not used: {known} of {len(self.records)} records have one"
        records = (replace(r, signals={k: v for k, v in r.signals.items() if k != "temperature"}) for r in self.records)
        return replace(self, records=tuple(records), notes=(*self.notes, said))

    @property
    def all(self) -> tuple[Record | FRF | ServoRun, ...]:
        """Records, frequency responses and runs of a servo, whatever they are for."""
        return (*self.records, *self.frfs, *self.servos)

    @property
    def fit(self) -> tuple[Record | FRF | ServoRun, ...]:
        """Those that identify parameters."""
        return self._used("fit")

    @property
    def select(self) -> tuple[Record | FRF | ServoRun, ...]:
        """Those that choose between models; empty where none was set apart."""
        return self._used("select")

    @property
    def validate(self) -> tuple[Record | FRF | ServoRun, ...]:
        """Those that are scored after every choice."""
        return self._used("validate")

    def _used(self, use: str) -> tuple[Record | FRF | ServoRun, ...]:
        return tuple(x for x in self.all if x.use == use)


def joints(path: str | Path) -> tuple[str, ...]:
    """Names of the joints that a measurement set is of; none for a bare axis.

    Raises:
        DataError: `dataset.toml` cannot be read, or its axis.joint is no name.
    """
    file = find(path)
    try:
        return joint_names(subtable(read_toml(file), "axis"))
    except DataError as error:
        raise DataError(f"{file}: {error}") from None


def files_of(path: str | Path) -> list[Path]:
    """`dataset.toml` of a measurement set, and the files that it names: what is lost where a result is written over it.

    Raises:
        DataError: `dataset.toml` cannot be read.
    """
    file = find(path)
    table = read_toml(file)
    try:
        entries = [*tables(table, "record"), *tables(table, "frf")]
        names = [*(e.get("file") for e in entries), subtable(table, "axis").get("model")]
    except DataError as error:
        raise DataError(f"{file}: {error}") from None
    return [file, *(file.parent / name for name in names if isinstance(name, str))]


def load(path: str | Path, joint: str | None = None) -> Dataset:
    """Reads a measurement set.

    Where no record says what it is for, they are split: of several, every third validates and the rest fit; one
    alone fits with its first 60 % and validates with the rest. Where only some say it, the others fit.

    Args:
        path: the folder with `dataset.toml`, or that file.
        joint: which of its joints, of a set that has several (see `joints`).

    Raises:
        DataError: anything that cannot be read or understood; one line that names file, line or key.
    """
    file = find(path)
    table = read_toml(file)
    try:
        expect_known(table, ("axis", "record", "frf"), "")
        if "controller" in subtable(table, "axis"):
            return _servo_set(table, file.parent, joint)
        axis = Axis(subtable(table, "axis"), file.parent, joint)
        entries = [e for i, e in enumerate(tables(table, "record"), 1) if axis.has(e, f"record {i}")]
        numbered = [(f"frf {i}", e) for i, e in enumerate(tables(table, "frf"), 1)]
        for key, e in numbered:
            if len(axis.names) > 1 and "joint" not in e:
                raise DataError(f"{key}: joint must be given, for the set is of several, {listing(axis.names)}, and a "
                                "response is of one")
        numbered = [(key, e) for key, e in numbered if axis.has(e, key)]
        responses = [e for _, e in numbered]
        frfs = tuple(f for key, e in numbered for f in frf_files.read(key, e, file.parent, axis))
        if not entries and not frfs:
            raise DataError("no [[record]] and no [[frf]]; a measurement set needs at least one"
                            + (f" for joint {axis.joint.name}" if axis.robot else ""))
        notes = frf_table.listed(frfs)
        read = [*zip(entries, record_files.read_all(entries, file.parent, axis), strict=True)]
        notes += [f"{r.record.name}: position never changes: left out" for _, r in read if not r.moves]
        read = [(e, r) for e, r in read if r.moves]
        notes += record_files.listed([r for _, r in read])
        records, uses = [r.record for _, r in read], [e.get("use") for e, _ in read]
        if entries and not records:
            raise DataError("position never changes in any record; nothing can be learnt from a joint that does not "
                            "move")  # fmt: skip
        if records and not any(r.torque.any() for r in records):
            raise DataError("torque is zero in every record; at least one must be driven")
        if axis.torque_constant is not None and not axis.has_current:
            notes.append("axis.torque_constant is not used: no record and no response has a current")
        elif axis.in_amperes:
            unit = drive_unit("torque", axis.joint.kind)
            notes.append(f"the torque constant is unknown: torque stays in A, and {unit} means A in every unit")
        if len(axis.current_kinds) > 1:
            told = " and ".join(f"A {kind} ({name})" for kind, name in axis.current_kinds.items())
            notes.append(f"currents are in {told}, and no torque constant is right for both: say scale = "
                         "{ current = ... } for one of them")
        if axis.robot and records:
            records, on_robot = axis.robot.on(records)
            notes += on_robot
        if axis.load_acts:
            if not any("load" in r.signals for r in records):
                raise DataError("axis.load_acts: no record has a load")
            records = [r.with_acting_load(axis.load_acts) for r in records]
        for mended in (plausible.without_spikes, plausible.answered):
            records, failed = mended(records, axis.inertia)
            notes += failed
        records, clock = _from_the_first(records, any("span" in e for e in entries))
        notes += filter(None, [clock])
        records, split = _split(records, uses) if records else ([], "")
        if records:
            notes += plausible.doubts(records, axis.inertia, axis.joint.kind)
        notes += plausible.doubts_of_responses(frfs, axis.inertia, axis.joint.kind)
        if frfs:
            frfs, said = (frfs, "as given") if any(e.get("use") for e in responses) else frf_files.split(frfs)
            counts = ", ".join(f"{n} to {use}" for use in USES if (n := sum(f.use == use for f in frfs)))
            split = "; ".join(filter(None, (split, f"frequency responses: {len(frfs)}, {counts} ({said})")))
    except DataError as error:
        raise DataError(f"{file}: {error}") from None
    return Dataset(
        file.parent, tuple(records), axis.joint.kind, axis.inertia, axis.torque_constant, split, tuple(notes), frfs,
        axis.joint.name or None, robot=axis.robot,
    )  # fmt: skip


def _from_the_first(records: list[Record], cut: bool) -> tuple[list[Record], str]:
    """Records by a clock that began before them, as that of a computer does, with times that count from the first stamp
    of all, and a sentence; else the same.

    What settles as an axis warms up would be over before the first row.

    Args:
        records: of a set.
        cut: whether some are the later parts of files: of these a clock may have begun with the axis where it began by
            less than the longest of them before the first.
    """
    begins = min((float(r.time[0]) for r in records), default=0.0)
    longest = max((float(np.ptp(r.time)) for r in records), default=0.0)
    if abs(begins) <= (longest if cut else _HARDLY * longest):
        return records, ""
    return [replace(r, time=r.time - begins) for r in records], (
        f"the stamps begin at {round(begins, 6):.15g} s: times count from there"
    )


def _servo_set(table: Mapping[str, Any], folder: Path, joint: str | None) -> Dataset:
    """The set of a servo that closes its own position loop."""
    axis = subtable(table, "axis")
    expect_known(axis, ("controller", *ENCODER), "axis.")
    if axis["controller"] not in CONTROLLERS:
        raise DataError(f"axis.controller must be {listing(CONTROLLERS)}; {axis['controller']!r} given")
    if "frf" in table:
        raise DataError("a servo that closes its own position loop takes no torque: [[frf]] has no place here")
    if joint is not None:
        raise DataError(f"the set is of a servo, not of joints of a robot; joint {joint!r} given")
    runs, split = servo_run.read_all(tables(table, "record"), folder, encoder_count(axis, "hinge"))
    notes = tuple(dict.fromkeys(f"{r.name}: {note}" for r in runs for note in r.notes))
    return Dataset(folder, (), split=split, notes=notes, servos=runs)


def save(
    path: str | Path,
    records: Sequence[Record | ServoRun],
    kind: str = "hinge",
    inertia: float | None = None,
    suffix: str = ".csv",
) -> None:
    """Writes records as a measurement set that `load` reads back: a file each, named after it, and `dataset.toml`.

    Args:
        path: folder, made where it does not exist.
        records: of one axis, with the resolution of the first; or runs of a servo that closes its own position loop.
        kind, inertia: of the axis; [kg m^2] or [kg]. Of a servo neither is asked.
        suffix: of a format in `formats`.

    Raises:
        GmsError: two records of one name, or a place that cannot be written.
    """
    folder = files.make_folder(path)
    names = [f"{r.name.removesuffix(suffix)}{suffix}" for r in records]
    for name in names:
        if names.count(name) > 1:
            raise DataError(f"{path}: two records are called {name!r}")
    lines = ["[axis]"]
    if any(isinstance(r, ServoRun) for r in records):
        lines.append('controller = "position"')
    else:
        lines.append(f'kind = "{kind}"')
        if inertia is not None:
            lines.append(f"inertia = {float(inertia)!r}")
        if records and isinstance(records[0], Record) and records[0].resolution:
            lines.append(f"encoder_resolution = {float(records[0].resolution)!r}")
    for name, r in zip(names, records, strict=True):
        if isinstance(r, ServoRun):
            signals, header = servo_run.to_table(r)
        else:
            signals, header = {"time": r.time, **r.signals}, {}
        formats.write(folder / name, signals)
        lines += ["", "[[record]]", f"file = {json.dumps(name)}", f'use = "{r.use}"']
        lines += [f"{key} = {value!r}" for key, value in header.items()]
        if isinstance(r, Record) and r.sensed:
            lines.append("sensed = true")
        if isinstance(r, Record):
            lines += [f'columns = {{ {k} = "{k}" }}' for k in ASKED_FOR if k in r.signals]
    files.write_text(folder / FILE, "\n".join(lines) + "\n")


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
    return records, told_uses([r.use for r in records], given)


def find(path: str | Path) -> Path:
    """The `dataset.toml` of a measurement set that is given by its folder or by that file."""
    path = Path(path)
    return path / FILE if path.is_dir() else path


def read_toml(file: Path) -> dict[str, Any]:
    """What stands in it; DataError where there is none or it is no TOML."""
    if file.is_file() and file.suffix != ".toml" and not formats.known(file):
        formats.find(file)
    if file.is_file() and formats.known(file):
        raise DataError(f"{file}: is a log; expected a measurement set, a folder with {FILE}; {_how(file)}")
    try:
        return tomllib.loads(file.read_text(encoding="utf-8-sig"))
    except FileNotFoundError:
        if file.name != FILE:
            where = f"{file}: no such file or folder"
            raise DataError(f"{where}; expected a measurement set, a folder with {FILE}") from None
        logs = sorted(f for f in file.parent.glob("*") if formats.known(f))
        raise DataError(f"{file.parent}: no {FILE} in this folder; expected a measurement set, a folder with {FILE}"
                        + (f"; {_how(logs[0])}" if logs else "")) from None
    except tomllib.TOMLDecodeError as error:
        hint = "; write / in the place of \\ in the names of files" if "\\" in str(error) else ""
        raise DataError(f"{file}: not TOML ({error}){hint}") from None
    except (OSError, ValueError, RecursionError) as error:
        raise DataError(f"{file}: cannot be read ({error})") from None


def _how(log: Path) -> str:
    """How to make a measurement set of a log."""
    return (f'write one beside it with [[record]] and file = "{log.name}", and columns = {{ time = ..., torque = '
            "..., position = ... } where they have other names")


def tables(table: Mapping[str, Any], key: str) -> list[Mapping[str, Any]]:
    """The tables [[key]]; DataError where it is something else."""
    value = table.get(key, [])
    if not isinstance(value, list) or not all(isinstance(v, Mapping) for v in value):
        raise DataError(f"{key} must be written as [[{key}]]; {value!r} given")
    return value
