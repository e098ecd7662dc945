"""Parquet tables, those of LeRobot data sets among them.

A column of lists of one length is a column for each place, "observation.state.0". LeRobot says what the places are in
meta/info.json of the data set: then they are "observation.state.elbow_flex.pos". Its versions before 3 have a file for
each episode, version 3 has several in one: `episode = 3` in `dataset.toml` takes one of them.
"""

from __future__ import annotations

import io
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from ..errors import DataError
from ..files import write_bytes
from . import Array, Table, stamps

SUFFIXES = (".parquet", ".pq")

_INFO = Path("meta") / "info.json"
_NUMBERS = (pa.types.is_floating, pa.types.is_integer, pa.types.is_boolean, pa.types.is_decimal)
_ABOVE = 3  # folders: data/chunk-000/file-000.parquet


def read(path: Path) -> Table:
    table = pq.ParquetFile(path).read().flatten()  # of a struct, as of a complex number, "name.real" and "name.imag"
    columns: dict[str, Array] = {}
    unusable: dict[str, str] = {}
    for i, name in enumerate(table.column_names):
        if name in columns or name in unusable:
            raise DataError(f"{path}: two columns are called {name!r}")
        kind = table.schema.types[i]
        if pa.types.is_list(kind) or pa.types.is_large_list(kind) or pa.types.is_fixed_size_list(kind):
            places = _places(table.column(i))
            if isinstance(places, str):
                unusable[name] = places
            else:
                labels = _labels(path, name, len(places))
                columns |= {f"{name}.{label}": place for label, place in zip(labels, places, strict=True)}
        elif any(is_kind(kind) for is_kind in _NUMBERS):
            numbers = pc.cast(table.column(i), pa.float64(), safe=False)
            columns[name] = numbers.to_numpy().astype(float)
        elif (seconds := stamps.from_arrow(table.column(i))) is not None:
            columns[name] = seconds
        else:
            unusable[name] = f"it holds {kind}, not numbers"
    return Table(columns, unusable)


def write(path: Path, columns: Mapping[str, Array]) -> None:
    stream = io.BytesIO()
    pq.write_table(pa.table(dict(columns)), stream)
    write_bytes(path, stream.getvalue())


def _places(column: Any) -> list[Array] | str:
    """(n,) numbers at each place of lists of one length, or why there are none."""
    kind = column.type.value_type
    if not any(is_kind(kind) for is_kind in _NUMBERS):
        return f"it holds lists of {kind}, not of numbers"
    lengths = set(pc.list_value_length(column).to_pylist())
    if len(lengths) != 1 or lengths <= {None, 0}:
        return "its lists have different lengths" if len(lengths) > 1 else "its lists are empty"
    flat = pc.cast(pc.list_flatten(column), pa.float64(), safe=False).to_numpy().astype(float)
    rows = flat.reshape(-1, lengths.pop())
    return [rows[:, k].copy() for k in range(rows.shape[1])]


def _labels(path: Path, column: str, n: int) -> list[str]:
    """What LeRobot calls the places of a column; their numbers where it does not say."""
    numbers = [str(k) for k in range(n)]
    for folder in list(path.resolve().parents)[:_ABOVE]:
        try:
            info = json.loads((folder / _INFO).read_text(encoding="utf-8"))
        except (OSError, ValueError, RecursionError):
            continue
        features = info.get("features") if isinstance(info, dict) else None
        feature = features.get(column) if isinstance(features, dict) else None
        names = feature.get("names") if isinstance(feature, dict) else None
        if isinstance(names, dict):  # {"motors": [...]}
            parts = [v for v in names.values() if isinstance(v, list)]
            names = [x for part in parts for x in part]
        if isinstance(names, list) and len(names) == n == len({str(x) for x in names}):
            return [str(x) for x in names]
        return numbers
    return numbers
