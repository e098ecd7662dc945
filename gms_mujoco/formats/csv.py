"""Text tables: comma, semicolon, tab or blank separated, with or without a header line, plain or gzipped.

Lines that start with # or % before the table are comments. With semicolons, tabs or blanks a decimal comma is
understood. Other lines before the header are left out, and a row of units below it is read. A few lines that each
begin with a name and go on with numbers are columns laid on their side.
"""

from __future__ import annotations

import gzip
import io
import re
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from pyarrow import csv

from ..errors import DataError
from ..files import write_bytes
from ..units import is_unit
from . import Array, Table

SUFFIXES = (".csv", ".csv.gz", ".txt", ".txt.gz", ".dat", ".tsv")
_MOST_PREAMBLE = 200  # lines before the header
_FEW = 12  # lines at most of a table that lies on its side
_NUMBER = re.compile(r"[+-]?\d*(,\d+)?([eE][+-]?\d+)?")  # with a decimal comma


def read(path: Path) -> Table:
    lines = _text(path).splitlines()
    start = next((i for i, s in enumerate(lines) if s.strip() and s.lstrip()[0] not in "#%"), None)
    if start is None:
        raise DataError(f"{path}: the file is empty; expected columns of numbers")
    # What is read, with the line it stands on: empty lines are no samples.
    kept = [(i + 1, s) for i, s in enumerate(lines[start:], start) if s.strip()]
    kept = _without_preamble(kept)
    separator = _separator(kept)
    if separator == " ":
        kept = [(i, re.sub(r"\s+", " ", s.strip())) for i, s in kept]
    comma = separator != "," and any(_has_decimal_comma(s.split(separator)) for _, s in kept if "," in s)
    lying = _lying(path, kept, separator, comma)
    if lying is not None:
        return lying
    first = [s.strip().strip('"') for s in kept[0][1].split(separator)]
    named = not all(_is_number(s.replace(",", ".") if comma else s) for s in first)
    names = first if named else [str(i) for i in range(len(first))]
    for name in names:
        if names.count(name) > 1:
            raise DataError(f"{path}: line {kept[0][0]}: two columns are called {name!r}")
    samples = kept[1:] if named else kept
    units: dict[str, str] = {}
    if named and len(samples) > 1 and (below := _units_row(samples[0][1].split(separator), len(names))):
        samples, units = samples[1:], {name: unit for name, unit in zip(names, below, strict=True) if unit}
    if not samples:
        raise DataError(f"{path}: the file has a header but no samples")
    for i, s in samples:
        fields = s.count(separator) + 1
        if fields != len(names) and '"' not in s:
            raise DataError(f"{path}: line {i}: {fields} columns; expected {len(names)}")
    table = csv.read_csv(
        io.BytesIO("\n".join(s for _, s in samples).encode()),
        csv.ReadOptions(column_names=names, use_threads=False),
        csv.ParseOptions(delimiter=separator),
        csv.ConvertOptions(decimal_point="," if comma else ".", strings_can_be_null=True),
    )
    if len(table) != len(samples):
        raise DataError(f"{path}: {len(samples)} lines read as {len(table)} samples; quoted text spans lines")
    columns: dict[str, Array] = {}
    unusable: dict[str, str] = {}
    for name in names:
        column, wrong = _numbers(table[name])
        if column is None:
            unusable[name] = f"line {samples[wrong][0]}: {table[name][wrong].as_py()!r} is not a number"
        else:
            columns[name] = column
    return Table(columns, unusable, named, np.array([i for i, _ in samples]), units)


def write(path: Path, columns: Mapping[str, Array]) -> None:
    rows = zip(*(map(repr, v.tolist()) for v in columns.values()), strict=True)
    text = "\n".join([",".join(columns), *map(",".join, rows)]) + "\n"
    data = text.encode()
    write_bytes(path, gzip.compress(data, mtime=0) if path.name.lower().endswith(".gz") else data)


def _text(path: Path) -> str:
    data = path.read_bytes()
    if path.name.lower().endswith(".gz"):
        data = gzip.decompress(data)
    if b"\0" in data[:4096]:
        raise DataError(f"{path}: not a text file; expected columns of numbers")
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError:
        return data.decode("latin-1")  # a degree or micro sign in a header from a Windows machine


def _without_preamble(kept: list[tuple[int, str]]) -> list[tuple[int, str]]:
    """The lines from the header on, where others stand before it that are no rows of the table.

    The header is the last line with a name in each cell before the first with a number in each; above it stands at
    least one line of another width.
    """
    for mark in ";\t,":
        rows = [[c.strip().strip('"') for c in s.split(mark)] for _, s in kept[: _MOST_PREAMBLE + 2]]
        width = len(kept[-1][1].split(mark))
        if width < 2:
            continue
        numbers = [len(r) == width and all(c and _is_number(c.replace(",", ".")) for c in r) for r in rows]
        first = next((i for i, good in enumerate(numbers) if good), 0)
        header = first - 1
        if header > 0 and _units_row(rows[header], width) and _is_named(rows[header - 1], width):
            header -= 1
        if header > 0 and _is_named(rows[header], width) and any(len(r) != width for r in rows[:header]):
            return kept[header:]
        return kept
    return kept


def _is_named(cells: list[str], width: int) -> bool:
    return len(cells) == width and all(c and not _is_number(c) for c in cells)


def _units_row(cells: list[str], width: int) -> list[str]:
    """The units of a row of their own below the names, "" where a cell is empty; [] where it is no such row."""
    found = [c.strip().strip('"').strip("[]()").strip() for c in cells]
    named = len(found) == width and not any(c and _is_number(c) for c in found)
    return found if named and any(map(is_unit, found)) else []


def _separator(kept: list[tuple[int, str]]) -> str:
    """Of the columns: semicolon, tab, comma or " ", by the first line; commas inside numbers are decimal ones."""
    cells = kept[-1][1].split()
    numbers = [_NUMBER.fullmatch(c) or (i == 0 and "," not in c) for i, c in enumerate(cells)]
    blank = len(cells) > 1 and all(numbers) and _has_decimal_comma(cells)
    return next((c for c in (";\t" if blank else ";\t,") if c in kept[0][1]), " ")


def _has_decimal_comma(cells: list[str]) -> bool:
    return any("," in c and _NUMBER.fullmatch(c.strip().strip('"')) for c in cells)


def _lying(path: Path, kept: list[tuple[int, str]], separator: str, comma: bool) -> Table | None:
    """A table with a line per quantity, each with its name in front; None where the lines are not of that kind."""
    if not 2 <= len(kept) <= _FEW:
        return None
    columns: dict[str, Array] = {}
    for i, line in kept:
        name, *cells = [s.strip().strip('"') for s in (line.replace(",", ".") if comma else line).split(separator)]
        if len(cells) < 2 or _is_number(name) or not all(map(_is_number, cells)):
            return None
        if name in columns:
            raise DataError(f"{path}: line {i}: two lines are called {name!r}")
        columns[name] = np.array([float(c) if c else np.nan for c in cells])
    return Table(columns)


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return text == ""
    return True


def _numbers(column: pa.ChunkedArray) -> tuple[Array | None, int]:
    """A column as numbers, or the first sample that is none."""
    if pa.types.is_string(column.type):
        column = pc.utf8_trim_whitespace(column)
        try:
            return np.asarray(pc.cast(column, pa.float64()).to_numpy(zero_copy_only=False)), 0
        except pa.ArrowInvalid:
            cells = column.to_pylist()
            return None, next((i for i, s in enumerate(cells) if s is not None and not _is_number(s)), 0)
    if pa.types.is_null(column.type):
        return np.full(len(column), np.nan), 0
    if pa.types.is_floating(column.type) or pa.types.is_integer(column.type):
        return np.asarray(pc.cast(column, pa.float64(), safe=False).to_numpy(zero_copy_only=False)), 0
    return None, 0
