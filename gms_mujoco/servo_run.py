"""Runs of a servo that closes its own position loop: a log of goal and position with a known payload.

A measurement set of them is a folder with `dataset.toml`, as of any axis; its records have a goal in the place of a
torque:

    [axis]
    controller = "position"              # the servo closes its own position loop

    [[record]]
    file = "slow_sine.json"              # any table; JSON in the layout of Rhoban's BAM says all that follows itself
    use = "fit"                          # or "select", "validate"
    gain = 16                            # of the position loop, as set in the servo
    mass = 0.535                         # kg, at the end of the arm
    length = 0.1                         # m, of the arm
    columns = { time = "t", goal = "asked", position = "q", powered = "on" }    # powered may be absent: always on
    units = { goal = "deg", position = "deg" }
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from . import formats
from .errors import DataError, listing
from .logs import columns as named
from .logs import timing, turns
from .logs.columns import expect_known, subtable
from .record import USES, told_uses

Array = NDArray[np.float64]

GRAVITY = 9.81  # m/s^2
CONTROLLERS = ("position",)
_KEYS = ("file", "use", "episode", "rate", "span", "gain", "mass", "length", "columns", "units", "scale")
_BAM = {"time": "timestamp", "position": "position", "goal": "goal_position", "powered": "torque_enable"}
_BAM_HEADER = {"mass": "mass", "length": "length", "gain": "kp"}
_LIKE = {"time": "time", "position": "position", "goal": "position", "powered": ""}  # what a column measures
_HEADER_UNITS = {"mass": "kg", "length": "m", "gain": "1"}
_WINDOW = 5  # samples, whose median a reading is compared with
_GLITCH = 0.15  # rad from that median: no servo gets there and back within four samples
_FIRST = 6  # samples that tell how fast a run begins
_FEWEST = 2 * _FIRST  # samples of a run
_SAME_GOAL = 0.02  # of its standard deviation, within which two goals are the same
_FIT_SHARE = 0.6  # of a single run, in time


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
        use: "fit" (identifies parameters), "select" (chooses between models) or "validate" (scored after every choice).
        judged: (first, end) samples that are looked at, of a run that is cut in two; the motion is always simulated
            from the first. None: all.
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
    use: str = "fit"
    judged: tuple[int, int] | None = None

    def __post_init__(self) -> None:
        if self.use not in USES:
            raise DataError(f"{self.name}: use must be one of {listing(USES)}; {self.use!r} given")

    @cached_property
    def velocity(self) -> float:
        """At the first sample [rad/s]."""
        return float(np.polyfit(self.time[:_FIRST], self.position[:_FIRST], 1)[0])

    @property
    def sample_time(self) -> float:
        """Usual time from one sample to the next [s]."""
        return float(np.median(np.diff(self.time)))

    @property
    def condition(self) -> tuple[float, float, float]:
        """Payload and gain: what is particular to them is shared by all runs that have the same."""
        return self.inertia, self.weight, self.gain

    def repeats(self, other: ServoRun) -> bool:
        """Whether another run was asked for the same motion under the same conditions."""
        if self.condition != other.condition or abs(self.time[-1] - other.time[-1]) > 0.02 * self.time[-1]:
            return False
        same = np.interp(self.time, other.time, other.goal), np.interp(self.time, other.time, other.powered)
        size = float(np.std(self.goal)) or 1.0
        close = float(np.sqrt(np.mean((self.goal - same[0]) ** 2))) < _SAME_GOAL * size
        return close and float(np.mean(np.abs(self.powered - same[1]))) < _SAME_GOAL


def repetitions(runs: Sequence[ServoRun]) -> list[list[int]]:
    """Numbers of the runs that repeat each other, a list for each motion that was asked for."""
    out: list[list[int]] = []
    for i, run in enumerate(runs):
        group = next((g for g in out if runs[g[0]].repeats(run)), None)
        if group is None:
            out.append([i])
        else:
            group.append(i)
    return out


def read_all(
    entries: Sequence[Mapping[str, Any]], folder: Path, count: float | None = None
) -> tuple[tuple[ServoRun, ...], str]:
    """The runs of a measurement set, each with its use, and the sentence that tells who decided it.

    Where no record says what it is for, every third motion validates, together with its repetitions: one that was
    fitted does not validate itself. A single run is cut at 60 % of its time.

    Args:
        entries: tables of `dataset.toml`.
        folder: of the files that they name.
        count: position of one count of the encoder [rad], None where unknown.

    Raises:
        DataError: a record that cannot be read or understood, or none that is fitted.
    """
    runs = [_from_entry(f"record {i}", e, folder, count) for i, e in enumerate(entries, 1)]
    if not runs:
        raise DataError("no [[record]]; a measurement set needs at least one")
    if any(e.get("use") for e in entries):
        said = "as given"
    elif len(runs) == 1:
        whole, cut = runs[0], round(_FIT_SHARE * len(runs[0].time))
        first = replace(whole, name=f"{whole.name} (first 60 %)", judged=(0, cut))
        rest = replace(whole, name=f"{whole.name} (last 40 %)", judged=(cut, len(whole.time)), use="validate")
        runs, said = [first, rest], "no use was given: the first 60 % of the only record fit, the rest validate"
    else:
        motions = repetitions(runs)
        every = 3 if len(motions) > 2 else 2
        chosen = {i for k, group in enumerate(motions) if k % every == every - 1 for i in group}
        runs = [replace(r, use="validate" if i in chosen else "fit") for i, r in enumerate(runs)]
        said = f"no use was given: every {'third' if every == 3 else 'second'} motion validates with its repetitions"
    return tuple(runs), told_uses([r.use for r in runs], said)


def _from_entry(key: str, entry: Mapping[str, Any], folder: Path, count: float | None) -> ServoRun:
    name, use = named.file_and_use(entry, _KEYS, key)
    try:
        layout: dict[str, Any] = {k: subtable(entry, k) for k in ("columns", "units", "scale")}
        header = {k: entry[k] for k in _BAM_HEADER if k in entry}
        parts: dict[str, Any] = {k: entry.get(k) for k in ("episode", "rate", "span")}
        return replace(read_run(folder / name, **layout, **parts, count=count, **header), use=use)
    except DataError as error:
        raise DataError(f"{key}: {error}") from None


def to_table(run: ServoRun) -> tuple[dict[str, Array], dict[str, float]]:
    """The columns of a run, and its gain, mass and length, as `read_run` takes them."""
    length = run.inertia * GRAVITY / run.weight
    columns = {"time": run.time, "goal": run.goal, "position": run.position, "powered": run.powered}
    return columns, {"gain": run.gain, "mass": run.weight / (GRAVITY * length), "length": length}


def read_run(
    path: str | Path, *, columns: Mapping[str, Any] | None = None, units: Mapping[str, Any] | None = None,
    scale: Mapping[str, Any] | None = None, episode: int | None = None, rate: float | None = None,
    span: Sequence[float] | None = None, count: float | None = None, **header: float,
) -> ServoRun:  # fmt: skip
    """Reads one log: time, goal and position, and whether the bridge is on; a pendulum hangs on the shaft.

    JSON in the layout of Rhoban's BAM has mass [kg], length [m], kp and entries with timestamp [s], position and
    goal_position [rad], and torque_enable. Positions that wrap are unwrapped, and the goals are taken in their turns. A
    reading that is far off the median of its neighbours is a glitch of the sensor and replaced by that. Of both there
    is a note.

    Args:
        path: a table in any format of `formats`.
        columns: names of its columns by time, goal, position and powered, where they are not called so.
        units, scale: of columns that are not in SI, as in `dataset.toml`.
        episode: which, where a file has several.
        rate: samples per second, for time that is counted instead of read.
        span: from when to when [s], of the part that is taken; None: all.
        count: position of one count of the encoder [rad], for units = { position = "counts" }.
        **header: gain, mass [kg] and length [m], where the file does not say.

    Raises:
        DataError: the file cannot be read, or something is missing, not a number, or too short.
    """
    path = Path(path)
    table, values = formats.read(path), _header(path, header)
    try:
        table = table.episode(episode)
        found, stated = _signals(table, columns or {}, named.rate({"rate": rate}))
        own = {**(units or {}), **(scale or {})}
        for key in own:
            if key not in ("time", "goal", "position"):
                raise DataError(f"units and scale are of time, goal and position; {key!r} given")
        stated = {k: unit for k, unit in stated.items() if k not in own}
        said = {**own, **named.are_units(stated, _LIKE)}
        named.expect_unit(found, said, "hinge", "goal", "position")
        read = named.as_stated(found, stated, named.Joint(resolution=count), _LIKE)
        for key in own:
            given = (units or {}).get(key), (scale or {}).get(key)
            found[key] = named.into_si(found[key], _LIKE[key], *given, "hinge", count)
        if span is not None:
            here = timing.within(found["time"], span)
            found, table = {k: v[here] for k, v in found.items()}, table.rows(here)
        kept, left_out = named.trimmed(found)
        table = table.rows(kept)
        named.check(table, found, fewest=_FEWEST)
        if rate is None and "time" not in said:
            timing.expect_clock(found["time"])
        time, position, goal, powered = (found[k] for k in _BAM)
        position, goal, turned = _unwrapped(position, goal, count)
    except DataError as error:
        raise DataError(f"{path}: {error}") from None
    usual = _usual(position)
    wrong = np.abs(position - usual) > _GLITCH
    glitches = f"{wrong.sum()} readings of the position were glitches: the median of their neighbours is taken"
    notes = tuple(n for n in (read, left_out, turned, glitches if wrong.any() else None) if n)
    mass, length, gain = (values[k] for k in _BAM_HEADER)
    name = path.name + ("" if episode is None else f" episode {episode}")
    name += "" if span is None else f" {span[0]:g} to {span[1]:g} s"
    return ServoRun(
        name, time - time[0], goal, (powered > 0.5).astype(float), np.where(wrong, usual, position), gain,
        mass * length**2, GRAVITY * mass * length, notes,
    )  # fmt: skip


def _unwrapped(position: Array, goal: Array, count: float | None) -> tuple[Array, Array, str | None]:
    """Position and goal (n,) without the jumps of a reading that wraps [rad], and a sentence where there were any.

    They show in the median of neighbours: a glitch would hide them.
    """
    usual = _usual(position)
    smooth, note = turns.unwrapped(usual, "hinge", count)
    if note is None:
        return position, goal, None
    size = turns.turn(usual, smooth)
    position = position + size * np.round((smooth - position) / size)
    return position, turns.beside(goal, position, size), note


def _usual(position: Array) -> Array:
    """(n,) median of each reading and its neighbours [rad]."""
    usual = np.asarray(scipy.signal.medfilt(position, _WINDOW))
    usual[[0, 1, -2, -1]] = position[[0, 1, -2, -1]]  # its ends are padded with zeros
    return usual


def _header(path: Path, given: Mapping[str, Any]) -> dict[str, float]:
    """Gain and payload of a run, from what was given or else from the file."""
    expect_known(given, tuple(_BAM_HEADER), "")
    # It was read once: it is JSON.
    document = json.loads(path.read_text(encoding="utf-8-sig")) if path.suffix == ".json" else {}
    values = {}
    for key, name in _BAM_HEADER.items():
        value = given.get(key, document.get(name) if isinstance(document, dict) else None)
        if isinstance(value, bool) or not isinstance(value, int | float) or not 0 < value < 1e6:
            said = key if key == name else f"{key} ({name} in the file)"
            raise DataError(f"{path}: {said} must be a positive number [{_HEADER_UNITS[key]}], beside the file or in "
                            f"it; {value!r} given")
        values[key] = float(value)
    return values


def _signals(
    table: formats.Table, chosen: Mapping[str, Any], rate: float | None
) -> tuple[dict[str, Array], dict[str, str]]:
    """(n,) columns by time, position, goal and powered, raw, and the units that the file states for them; power is on
    where nothing says."""
    expect_known(chosen, tuple(_BAM), "columns.")
    names = {**_LIKE, **{usual: _LIKE[key] for key, usual in _BAM.items()}}
    available = named.by_name(table, names)
    wanted = {k: chosen.get(k, available.get(k, available.get(usual))) for k, usual in _BAM.items()}
    if wanted["powered"] is None:
        del wanted["powered"]
    if rate is not None:
        named.expect_rate(table, wanted.pop("time"), rate)
    wanted = {k: k if at is None else at for k, at in wanted.items()}
    named.expect_found(table, {k: at for k, at in wanted.items() if k not in chosen})
    found = {k: named.column(table, f"columns.{k}", at, None if k in chosen else k) for k, at in wanted.items()}
    if rate is not None:
        found["time"] = np.arange(len(found["position"])) / rate
    found.setdefault("powered", np.ones_like(found["time"]))
    if len({len(x) for x in found.values()}) > 1:
        raise DataError("columns differ in length: " + ", ".join(f"{k} has {len(x)}" for k, x in found.items()))
    stated = {k: named.stated_unit(table, at, _LIKE[k]) for k, at in wanted.items() if k != "powered"}
    return found, {k: unit for k, unit in stated.items() if unit}
