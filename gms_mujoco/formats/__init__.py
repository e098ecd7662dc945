"""Readers of measured data: one file per format, reached by suffix.

A module of this folder is a format. Joining the folder is all it takes: `read` finds it, and the contract tests
(`tests/test_formats.py`) run over it. It defines

    SUFFIXES: tuple of file endings in lower case, such as (".csv", ".csv.gz")
    read(path) -> Table: the raw columns of the file, neither scaled nor renamed
    write(path, columns) -> None: the same columns as such a file (tests and examples need one)

`read` raises DataError for whatever is wrong with the content. Formats that can run code (pickle) have no place here.
"""

from __future__ import annotations

import importlib
import os
import pkgutil
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import DataError, GmsError, listing
from . import stamps

Array = NDArray[np.float64]

EPISODE = "episode_index"  # column of the data sets of LeRobot
LARGEST = 1e30  # of what is measured, in SI; no axis has more of anything, and squares still fit into a double
_SOME = 8  # names in a message
_MOST_IN_TURNS = 12  # motors on a bus
_MOSTLY = 0.95  # of the rows


@dataclass(frozen=True)
class Table:
    """The raw columns of one file; a frozen value.

    Attributes:
        columns: (n,) each, in the order of the file. Where the file names none they are "0", "1", ...
        unusable: columns that are not numbers, and why ("line 7: 'off' is not a number").
        named: False where the file has no names for its columns.
        lines: (n,) line of the file where each sample stands, counted from 1; None where there are no lines.
        units: of the columns of which the file states it.
        order: names of all columns in the order of the file, those that are no numbers too; () for that of `columns`.
        texts: (n,) of columns that are no numbers but text, to choose rows by.
        remarks: what stands above the names of the columns, and may say a unit.
        quantities: of columns that are a response and of which the file says it, what over what, as in ("velocity",
            "torque"); "" for what it does not say.
        samples: (n,) number of each sample in the file, counted from 0; None where all are here.
    """

    columns: Mapping[str, Array]
    unusable: Mapping[str, str] = field(default_factory=dict)
    named: bool = True
    lines: NDArray[np.int64] | None = None
    units: Mapping[str, str] = field(default_factory=dict)
    order: tuple[str, ...] = ()
    texts: Mapping[str, NDArray[np.str_]] = field(default_factory=dict)
    remarks: tuple[str, ...] = ()
    quantities: Mapping[str, tuple[str, str]] = field(default_factory=dict)
    samples: NDArray[np.int64] | None = None

    @property
    def names(self) -> tuple[str, ...]:
        """Of all columns, as they are counted from 0."""
        return self.order or tuple(self.columns)

    def where(self, choice: Mapping[str, Any]) -> Table:
        """The rows in which columns have the values of a choice: of one of several motors in a log.

        Raises:
            DataError: no such column, or no such row.
        """
        here = None
        for name, value in choice.items():
            known = {**self.columns, **self.texts}
            if name not in known:
                raise DataError(f"where: no column {name!r}; the file has {listing(known)}")
            column = known[name]
            wanted = str(value) if name in self.texts else value
            if isinstance(value, bool) or not isinstance(value, int | float | str) or not np.any(column == wanted):
                raise DataError(f"where: no row in which {name} is {value!r}; it is {some_of(column)}")
            here = (column == wanted) if here is None else here & (column == wanted)
        if here is None:
            return self
        if not here.any():
            raise DataError(f"where: no row with all of {dict(choice)!r}")
        return self.rows(here)

    def in_turns(self) -> tuple[str, int]:
        """A column of a few values that come one after another, row for row, as the numbers of several motors do, and
        how many; "" and 0 without one."""
        for name, column in {**self.texts, **self.columns}.items():
            count = len(np.unique(column)) if column.ndim == 1 and column.dtype.kind != "O" else 0
            if 2 <= count <= _MOST_IN_TURNS and len(column) > 4 * count:
                returns, stays = np.mean(column[count:] == column[:-count]), np.mean(column[1:] == column[:-1])
                if returns > _MOSTLY and stays < 1 - _MOSTLY:
                    return name, count
        return "", 0

    def episode(self, number: int | None) -> Table:
        """The rows of one episode, by the column "episode_index" of a robot's data set; itself where there is but one.

        Raises:
            DataError: no whole number, there is no such episode, or there are several and none is chosen.
        """
        if number is not None and (isinstance(number, bool) or not isinstance(number, int)):
            raise DataError(f"episode must be a whole number; {number!r} given")
        index = self.columns.get(EPISODE)
        if index is None:
            if number is None:
                return self
            raise DataError(f"episode = {number} needs a column {EPISODE!r}; the file has {listing(self.columns)}")
        found = np.unique(index)
        if number is None and len(found) <= 1:
            return self
        if number is None or number not in found:
            some = some_of(found)
            asked = "choose one, as in episode = " + f"{found[0]:g}" if number is None else f"{number} is none of them"
            raise DataError(f"the file has {len(found)} episodes, {some}: {asked}")
        return self.rows(index == number)

    def rows(self, here: NDArray[np.bool_] | slice) -> Table:
        """Some of the rows; of a mask, columns of another length stay."""

        def some(v: NDArray[Any]) -> NDArray[Any]:
            return v[here] if isinstance(here, slice) or len(v) == len(here) else v

        columns = {k: some(v) for k, v in self.columns.items()}
        texts = {k: some(v) for k, v in self.texts.items()}
        size = len(here) if isinstance(here, np.ndarray) else max(map(len, self.columns.values()))
        samples = np.arange(size) if self.samples is None else self.samples
        lines = None if self.lines is None else some(self.lines)
        return replace(self, columns=columns, texts=texts, lines=lines, samples=some(samples))

    def place(self, sample: int) -> str:
        """Where a sample stands in the file, for messages: "line 7", or "sample 5" counted from 0."""
        if self.lines is not None:
            return f"line {self.lines[sample]}"
        return f"sample {sample if self.samples is None else self.samples[sample]}"


def some_of(values: NDArray[Any]) -> str:
    """The different ones of some values, for a message."""
    found = np.unique(values)
    told = [f"{x:g}" if found.dtype.kind == "f" else repr(str(x)) for x in found[:_SOME]]
    return ", ".join(told) + (", ..." if len(found) > _SOME else "")


def why_unusable(value: float) -> str:
    """Why a value is none that was measured, for a message."""
    return "more than any axis has" if np.isfinite(value) else "not a finite number"


@cache
def suffixes() -> dict[str, ModuleType]:
    """Every readable file ending and the format that reads it."""
    modules = (importlib.import_module(f"{__name__}.{m.name}") for m in pkgutil.iter_modules(__path__))
    return {suffix: m for m in modules if hasattr(m, "SUFFIXES") for suffix in m.SUFFIXES}


def known(path: str | Path) -> bool:
    """Whether a file is of a format by its suffix."""
    return Path(path).name.lower().endswith(tuple(suffixes()))


def beside(path: Path) -> str:
    """The logs in the folder of a file that is not there, for the end of a message."""
    return f"logs in that folder: {listing(f.name for f in path.parent.glob('*') if known(f))}"


def find(path: str | Path) -> ModuleType:
    """The format of a file by its suffix; raises DataError naming those that exist."""
    name = Path(path).name.lower()
    for suffix in sorted(suffixes(), key=len, reverse=True):  # .csv.gz before .gz
        if name.endswith(suffix):
            return suffixes()[suffix]
    raise DataError(f"{path}: no reader for this kind of file; readable are {listing(suffixes())}; a table of text is "
                    "read whatever it is called once its name ends in .txt")


def read(path: str | Path) -> Table:
    """The raw columns of a file.

    Raises:
        DataError: no such file, no reader for its suffix, or content that cannot be read; names file and line.
    """
    path = Path(path)
    module = find(path)
    if not os.path.isfile(path):
        raise DataError(f"{path}: no such file; {beside(path)}")
    try:
        if path.stat().st_size == 0:
            raise DataError(f"{path}: the file is empty; expected columns of numbers")
        table: Table = module.read(path)
    except GmsError:
        raise
    except Exception as error:  # the parsers below raise anything on garbage; for the user it is one thing
        reason = " ".join(str(error).split()) or type(error).__name__
        raise DataError(f"{path}: cannot be read as {path.suffix[1:]} ({reason[:200]})") from error
    if not table.columns:
        why = "; ".join(f"{k}: {v}" for k, v in list(table.unusable.items())[:3])
        raise DataError(f"{path}: no columns of numbers" + (f" ({why})" if why else ""))
    return table


def write(path: str | Path, columns: Mapping[str, Array]) -> None:
    """Writes columns of equal length to a file of the format that its suffix names."""
    find(path).write(Path(path), {k: np.asarray(v, float) for k, v in columns.items()})


def needed(module: str, what: str, extra: str) -> Any:
    """An optional library, imported where its files are; raises DataError naming the extra that installs it."""
    try:
        return importlib.import_module(module)
    except ImportError:
        name = module.split(".")[0].replace("_ros2", "-ros2-support")
        raise DataError(f"{what} need {name}: pip install 'gms-mujoco[{extra}]'") from None


def unpack(arrays: Mapping[str, object]) -> Table:
    """Named arrays of any shape as columns.

    (n,), (n, 1) and (1, n) are a column; of (n, m) and (m, n) the longer side is time and the columns are
    "name.0", "name.1", ...; a column of complex numbers is two, "name.real" and "name.imag", or one where every
    imaginary part is 0; dates are seconds from the first; single numbers and text are unusable.
    """
    columns: dict[str, Array] = {}
    unusable: dict[str, str] = {}
    for name, value in arrays.items():
        array = np.asarray(value)
        if array.dtype.kind in "mM" and array.ndim == 1:
            array = stamps.from_numpy(array)
        if array.dtype.kind == "U" and array.ndim == 1 and (seconds := stamps.from_strings(array.tolist())) is not None:
            array = seconds
        if array.dtype.kind not in "bifuc":
            unusable[name] = "it holds no numbers"
        elif array.size < 2:
            unusable[name] = "it is a single number" if array.size else "it is empty"
        elif max(array.shape) == array.size:
            columns |= real_and_imaginary(name, array.ravel())
        elif array.ndim == 2:
            rows = array.T if array.shape[0] >= array.shape[1] else array
            for i, row in enumerate(rows):
                columns |= real_and_imaginary(f"{name}.{i}", row)
        else:
            unusable[name] = f"it has {array.ndim} dimensions"
    return Table(columns, unusable)


def real_and_imaginary(name: str, values: NDArray[Any]) -> dict[str, Array]:
    """A column by its name, or two of a complex one, "name.real" and "name.imag"."""
    if values.dtype.kind != "c" or not np.any(np.nan_to_num(values.imag)):
        return {name: values.real.astype(float)}
    return {f"{name}.real": values.real.astype(float), f"{name}.imag": values.imag.astype(float)}
