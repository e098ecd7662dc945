"""Servo logs in JSON: a list of samples, each an object with the same numeric fields.

The list is the document itself or its "entries" (the layout in which users of Rhoban's BAM log their servos), or the
lines of a `.jsonl`; a document of equally long lists is read as columns. Single numbers beside them are no columns.
What stands inside a field is a column by its path, "motors.elbow.position", of a list by its place, "position.0". A
null is what pandas writes for a number that is missing, and NaN here too, as is a field that a sample lacks. Text that
is dates or times of day is seconds (see stamps.py).
"""

from __future__ import annotations

import itertools
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import DataError
from ..files import write_text
from . import Array, Table, stamps

SUFFIXES = (".json", ".jsonl")
_LINES = ".jsonl"
_MOST_PLACES = 64  # of a list inside a sample: joints, not samples


def read(path: Path) -> Table:
    text = path.read_text(encoding="utf-8-sig")
    if path.name.lower().endswith(_LINES):
        text = "[" + ",\n".join(line for line in text.split("\n") if line.strip()) + "]"
    try:
        document = json.loads(text)
    except json.JSONDecodeError as error:
        hint = f"; an object in each line is a {_LINES}" if error.msg == "Extra data" else ""
        raise DataError(f"{path}: line {error.lineno}: not JSON ({error.msg}){hint}") from None
    except RecursionError:
        raise DataError(f"{path}: not a servo log (nested too deeply)") from None
    entries = document.get("entries") if isinstance(document, dict) else document
    columns: dict[str, Array] = {}
    unusable: dict[str, str] = {}
    if isinstance(entries, list):
        if not all(isinstance(e, dict) for e in entries):
            raise DataError(f"{path}: every sample must be an object with named fields")
        flat = [_flat(e) for e in entries]
        lists: dict[str, list[Any]] = {k: [e.get(k) for e in flat] for k in dict.fromkeys(itertools.chain(*flat))}
    elif isinstance(document, dict):
        lists = {k: v for k, v in document.items() if isinstance(v, list)}
    else:
        raise DataError(f"{path}: expected 'entries', a list of samples; found {type(document).__name__}")
    for name, values in lists.items():
        wrong = next((i for i, v in enumerate(values) if not isinstance(v, int | float | None)), None)
        if wrong is None:
            columns[name] = np.array([np.nan if v is None else float(v) for v in values])
        elif (seconds := stamps.from_strings(values)) is not None:
            columns[name] = seconds
        else:
            unusable[name] = f"sample {wrong}: {_short(values[wrong])} is not a number"
    return Table(columns, unusable)


def write(path: Path, columns: Mapping[str, Array]) -> None:
    rows = zip(*(v.tolist() for v in columns.values()), strict=True)
    entries = [dict(zip(columns, row, strict=True)) for row in rows]
    lines = path.name.lower().endswith(_LINES)
    write_text(path, "\n".join(map(json.dumps, entries)) + "\n" if lines else json.dumps({"entries": entries}))


def _flat(value: Mapping[str, Any], path: str = "") -> dict[str, Any]:
    """The fields of a sample by their paths."""
    out: dict[str, Any] = {}
    for key, inner in value.items():
        if isinstance(inner, list) and 0 < len(inner) <= _MOST_PLACES:
            inner = {str(i): x for i, x in enumerate(inner)}
        out |= _flat(inner, f"{path}{key}.") if isinstance(inner, dict) else {f"{path}{key}": inner}
    return out


def _short(value: Any) -> str:
    text = repr(value)
    return text if len(text) < 40 else text[:37] + "..."
