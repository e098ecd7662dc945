"""Text tables: comma, semicolon, tab or blank separated, with or without a header line, plain or gzipped.

Lines that start with # or % are comments; where no other line names the columns, the comment right above them may. A
decimal comma is understood where it does not separate columns, and whole numbers in hexadecimal of 16 or 32 bits, as
frames of a bus have them, are signed. Other lines before the header are left out, and a row
of units below it is read; so is a file that ends in the middle of a row, which is then without numbers. A few lines
that each begin with a name and go on with numbers are columns laid on their side. A column of complex numbers
("1.5-2i") is two, "name.real" and "name.imag"; dates and times of day are seconds (see stamps.py), true and false 1
and 0. Columns of one name are told apart by a number behind it, "value (2)".
"""

from __future__ import annotations

import gzip
import io
import re
from collections.abc import Mapping
from csv import reader
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray
from pyarrow import csv

from ..errors import DataError
from ..files import write_bytes
from ..logs.units import is_unit
from . import Array, Table, real_and_imaginary, stamps

SUFFIXES = (
    ".csv", ".csv.gz", ".txt", ".txt.gz", ".dat", ".tsv", ".tab", ".log", ".asc", ".prn", ".lvm", ".sto", ".mot",
)  # fmt: skip
_MOST_TEXTS = 100  # different words in a column that rows are chosen by
_MOST_PREAMBLE = 200  # lines before the header
_FEW = 12  # lines at most of a table that lies on its side
_NUMBER = re.compile(r"[+-]?\d*(,\d+)?([eE][+-]?\d+)?")  # with a decimal comma
_POINT = re.compile(r"[+-]?\d*\.\d+([eE][+-]?\d+)?")
_GROUPED = re.compile(r"[+-]?\d{1,3}(([.]\d{3})+,\d+|(,\d{3})+[.]\d+|([\s']\d{3})+([.,]\d+)?)")  # 1.234,5
_HEX = re.compile(r"0[xX][0-9a-fA-F]+")
_BITS = {4: 16, 8: 32}  # of the longest number in a column, by its digits: 0xFFFFFF38 is -200
_FORTRAN = re.compile(r"([\d.])[dD]([+-]?\d)")  # 1.5D-03
Lines = list[tuple[int, str]]  # with the number of each in the file


def read(path: Path) -> Table:
    lines = list(enumerate(_text(path).replace("\r\n", "\n").replace("\r", "\n").split("\n"), 1))
    # What is read, with the line it stands on: empty lines are no samples.
    kept = [(i, s) for i, s in lines if s.strip() and s.lstrip()[0] not in "#%"]
    while kept and not kept[-1][1].strip(";,\t "):  # a spreadsheet writes rows of separators alone
        kept.pop()
    if not kept:
        raise DataError(f"{path}: the file is empty; expected columns of numbers")
    comments = [s for i, s in lines if i < kept[0][0] and s.strip()]
    whole = kept
    kept = _without_preamble(kept)
    remarks = (*comments, *(s for _, s in whole[: len(whole) - len(kept)]))
    separator = _separator(kept)
    whole_first = kept[0][1]
    kept = _squeezed(kept) if separator == " " else _without_last(kept, separator)
    told = (s for _, s in kept if "," in s and (separator != "," or '"' in s))
    comma = any(_has_decimal_comma(_cells(s, separator)) for s in told)
    if comma:
        _refuse_points(path, kept, separator)
    lying = _lying(path, kept, separator, comma)
    if lying is not None:
        return lying
    width = len(_cells(_usual(kept), separator))
    names = _cells(kept[0][1], separator)
    named, samples = _names(kept, separator, comma), kept
    below: list[str] = []
    if named:
        if separator == " " and len(names) != width:  # blanks inside names: two or more stand between them
            names = re.split(r"\s{2,}|\t", whole_first.strip())
        samples = kept[1:]
        if len(samples) > 1 and (below := _units_row(_cells(samples[0][1], separator), len(names))):
            samples = samples[1:]
    else:
        above, below = _names_above(comments, separator, width)
        names, named = above or [str(i) for i in range(width)], bool(above)
    names = _told_apart(names)
    if not samples:
        raise DataError(f"{path}: the file has a header but no samples")
    units = {name: unit for name, unit in zip(names, below, strict=False) if unit}
    if len(_cells(samples[-1][1], separator)) < len(names):  # the logger was stopped in the middle of it
        samples = [*samples[:-1], (samples[-1][0], separator * (len(names) - 1))]
    for i, s in samples:
        fields = s.count(separator) + 1
        if fields != len(names) and ('"' not in s or (fields := len(_cells(s, separator))) != len(names)):
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
    texts: dict[str, NDArray[np.str_]] = {}
    order: list[str] = []
    first = _cells(samples[0][1], separator)
    for i, name in enumerate(names):
        column, wrong = _numbers(table[name], comma)
        if column is not None and _HEX.fullmatch(first[i]):
            column = _signed(column, max(len(_cells(s, separator)[i]) for _, s in samples) - 2)
        if column is None:
            unusable[name] = _why(samples[wrong][0], str(table[name][wrong].as_py()))
            order.append(name)
            if pc.count_distinct(table[name]).as_py() <= _MOST_TEXTS:
                texts[name] = np.array([str(x or "") for x in table[name].to_pylist()])
        else:
            parts = real_and_imaginary(name, column)
            columns |= parts
            order += parts
            units |= dict.fromkeys(parts, units[name]) if name in units else {}
    lines_of = np.array([i for i, _ in samples])
    return Table(columns, unusable, named, lines_of, units, tuple(order), texts, remarks)


def write(path: Path, columns: Mapping[str, Array]) -> None:
    rows = zip(*(map(repr, v.tolist()) for v in columns.values()), strict=True)
    text = "\n".join([",".join(columns), *map(",".join, rows)]) + "\n"
    data = text.encode()
    write_bytes(path, gzip.compress(data, mtime=0) if path.name.lower().endswith(".gz") else data)


def _text(path: Path) -> str:
    data = path.read_bytes()
    if path.name.lower().endswith(".gz"):
        data = gzip.decompress(data)
    if data.startswith((b"\xff\xfe", b"\xfe\xff")):
        text = data.decode("utf-16")  # as Excel and PowerShell write it
    elif b"\0" in data[:4096]:
        raise DataError(f"{path}: not a text file; expected columns of numbers")
    else:
        try:
            text = data.decode("utf-8-sig")
        except UnicodeDecodeError:
            text = data.decode("cp1252", errors="replace")  # a degree or micro sign from a Windows machine
    return text.replace("\N{MINUS SIGN}", "-")


def _cells(line: str, separator: str) -> list[str]:
    if '"' not in line:
        return [c.strip() for c in line.split(separator)]
    return [c.strip() for c in next(reader([line], delimiter=separator, skipinitialspace=True))]


def _squeezed(kept: Lines) -> Lines:
    return [(i, re.sub(r"\s+", " ", s.strip())) for i, s in kept]


def _without_last(kept: Lines, separator: str) -> Lines:
    """The lines without the separator at the end of every row, and of the header where it has one."""
    if not all(s.rstrip(" ").endswith(separator) for _, s in kept[1:]):
        return kept
    head, row = kept[0][1].rstrip(" "), kept[-1][1]
    if not head.endswith(separator) and head.count(separator) == row.count(separator):
        return kept  # a column that is empty
    return [(i, s.rstrip(" ").removesuffix(separator)) for i, s in kept]


def _refuse_points(path: Path, kept: Lines, separator: str) -> None:
    """Raises DataError where a number has a decimal point among others with a comma: one of them groups digits."""
    for i, s in kept:
        for cell in _cells(s, separator) if "." in s else ():
            if _POINT.fullmatch(cell):
                other = next((c, k) for k, line in kept for c in _cells(line, separator) if _has_decimal_comma([c]))
                raise DataError(f"{path}: line {i}: {cell!r} has a point and {other[0]!r} in line {other[1]} a comma; "
                                "write every number with the same decimal mark and without marks between thousands")


def _names_above(comments: list[str], separator: str, width: int) -> tuple[list[str], list[str]]:
    """Names and units of the columns where the comment right above them tells, else []."""
    rows = []
    for line in reversed(comments[-2:]):
        text = line.strip()
        hash_alone = re.match(r"[#%]\s*" + re.escape(separator.strip() or "\t"), text)
        text = text if hash_alone else text.lstrip("#% \t")
        cells = _cells(text, separator) if separator != " " else re.split(r"\s{2,}|\t", text)
        rows.append(cells if len(cells) == width or separator != " " else text.split())
    if len(rows) > 1 and (units := _units_row(rows[0], width)) and _is_named(rows[1], width):
        return rows[1], units
    return (rows[0], []) if rows and _is_named(rows[0], width) and len(set(rows[0])) == width > 1 else ([], [])


def _told_apart(names: list[str]) -> list[str]:
    """Names with a number behind those that stand over several columns: none is taken for another unseen."""
    return [f"{n} ({names[: i + 1].count(n)})".strip() if names.count(n) > 1 else n for i, n in enumerate(names)]


def _without_preamble(kept: Lines) -> Lines:
    """The lines from the header on, where others stand before it that are no rows of the table.

    The header is the last line with a name in each cell before the first with a number in each; above it stands at
    least one line of another width, or with an empty cell or a number.
    """
    for mark in ";\t,":
        rows = [_cells(s, mark) for _, s in kept[: _MOST_PREAMBLE + 2]]
        usual = _cells(_usual(kept), mark)
        if len(usual) > 2 and all(len(r) == len(usual) and not r[-1] for r in rows):  # each ends in a separator
            rows, usual = [r[:-1] for r in rows], usual[:-1]
        width = len(usual)
        if width < 2:
            continue
        numbers = [len(r) == width and bool(r[0] and r[1]) and all(_is_value(c.replace(",", ".")) for c in r)
                   for r in rows]  # some may be missing
        first = next((i for i, good in enumerate(numbers) if good), 0)
        header = first - 1
        if header > 0 and _units_row(rows[header], width) and _is_named(rows[header - 1], width):
            header -= 1
        if header > 0 and _is_named(rows[header], width) and not all(_is_named(r, width) for r in rows[:header]):
            return kept[header:]
        return kept
    return kept


def _names(kept: Lines, separator: str, comma: bool) -> bool:
    """Whether the first line names the columns: it has text where the next has a number, or no number at all."""
    first = _with_points(_cells(kept[0][1], separator), comma)
    told = [not _is_value(c) for c in first]
    if not any(told) or not any(c and _is_number(c) for c in first) or len(kept) < 2:
        return any(told)
    following = _with_points(_cells(kept[1][1], separator), comma)
    if len(following) != len(first):
        return True
    return any(text and _is_value(c) for text, c in zip(told, following, strict=True))


def _usual(kept: Lines) -> str:
    """A line like most: the last one may have been cut."""
    return kept[-2 if len(kept) > 2 else -1][1]


def _is_named(cells: list[str], width: int) -> bool:
    return len(cells) == width and all(c and not _is_value(c) for c in cells)


def _units_row(cells: list[str], width: int) -> list[str]:
    """The units of a row of their own below the names, "" where a cell is empty; [] where it is no such row."""
    found = [c.strip().strip('"').strip("[]()").strip() for c in cells]
    named = len(found) == width and not any(c and _is_number(c) for c in found)
    return found if named and any(map(is_unit, found)) else []


def _separator(kept: Lines) -> str:
    """Of the columns: semicolon, tab, comma or " ", by the first line; commas inside numbers are decimal ones."""
    cells = _usual(kept).split()
    numbers = [_NUMBER.fullmatch(c) or (i == 0 and "," not in c) for i, c in enumerate(cells)]
    blank = len(cells) > 1 and all(numbers) and _has_decimal_comma(cells)
    return next((c for c in (";\t" if blank else ";\t,") if c in kept[0][1]), " ")


def _has_decimal_comma(cells: list[str]) -> bool:
    return any("," in c and _NUMBER.fullmatch(c) for c in cells)


def _with_points(cells: list[str], comma: bool) -> list[str]:
    return [c.replace(",", ".") for c in cells] if comma else cells


def _lying(path: Path, kept: Lines, separator: str, comma: bool) -> Table | None:
    """A table with a line per quantity, each with its name in front, and its unit perhaps; None where there is none."""
    if not 2 <= len(kept) <= _FEW:
        return None
    rows = [_cells(line, separator) for _, line in kept]
    stated = all(len(r) > 3 and r[1] and not _is_number(r[1].replace(",", ".")) for r in rows)
    columns: dict[str, Array] = {}
    units: dict[str, str] = {}
    for (i, _), row in zip(kept, rows, strict=True):
        name, cells = row[0].rstrip(":= "), _with_points(row[2 if stated else 1 :], comma)
        if len(cells) < 2 or _is_number(_with_points([name], comma)[0]) or not all(map(_is_number, cells)):
            return None
        if name in columns:
            raise DataError(f"{path}: line {i}: two lines are called {name!r}")
        parts = real_and_imaginary(name, np.array([_complex(c) for c in cells]))
        columns |= parts
        units |= dict.fromkeys(parts, row[1].strip("[]()")) if stated else {}
    return Table(columns, units=units)


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return text == "" or not np.isnan(_complex(text))
    return True


def _is_value(text: str) -> bool:
    return _is_number(text) or stamps.is_stamp(text)


def _why(line: int, text: str) -> str:
    """Why a column is not one of numbers."""
    hint = "; write it without marks between thousands" if _GROUPED.fullmatch(text) else ""
    return f"line {line}: {text!r} is not a number{hint}"


def _complex(text: str) -> complex:
    """A number as text, "1.5", "1.5D-3", "1.5-2i" or "(1.5-2j)"; nan where it is none."""
    plain = _FORTRAN.sub(r"\1e\2", text.strip())
    if plain[-1:] in "ij)":
        plain = re.sub(r"\s", "", plain).strip("()").replace("*", "").replace("i", "j")
    try:
        return complex(plain)
    except ValueError:
        return complex(np.nan)


def _signed(column: Array, digits: int) -> Array:
    """Numbers of two's complement that were read as from 0 on, by the digits of the longest in hexadecimal."""
    span = 2.0 ** _BITS.get(digits, np.inf)
    return np.where(column >= span / 2, column - span, column)


def _numbers(column: pa.ChunkedArray, comma: bool) -> tuple[NDArray[Any] | None, int]:
    """A column as numbers, or the first sample that is none."""
    if pa.types.is_string(column.type):
        column = pc.utf8_trim_whitespace(column)
        try:
            return np.asarray(pc.cast(column, pa.float64()).to_numpy(zero_copy_only=False)), 0
        except pa.ArrowInvalid:
            cells = _with_points([s or "" for s in column.to_pylist()], comma)
            wrong = next((i for i, s in enumerate(cells) if not _is_number(s)), None)
            if wrong is not None:
                return stamps.from_text(column), wrong
            return np.array([_complex(s) for s in cells]), 0
    if pa.types.is_null(column.type):
        return np.full(len(column), np.nan), 0
    if any(is_kind(column.type) for is_kind in (pa.types.is_floating, pa.types.is_integer, pa.types.is_boolean)):
        return np.asarray(pc.cast(column, pa.float64(), safe=False).to_numpy(zero_copy_only=False)), 0
    return stamps.from_arrow(column), 0
