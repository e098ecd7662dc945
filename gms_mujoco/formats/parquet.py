"""Parquet tables."""

from __future__ import annotations

import io
from collections.abc import Mapping
from pathlib import Path

import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from ..errors import DataError
from ..files import write_bytes
from . import Array, Table

SUFFIXES = (".parquet", ".pq")


def read(path: Path) -> Table:
    table = pq.ParquetFile(path).read()
    columns: dict[str, Array] = {}
    unusable: dict[str, str] = {}
    for i, name in enumerate(table.column_names):
        if name in columns or name in unusable:
            raise DataError(f"{path}: two columns are called {name!r}")
        kind = table.schema.types[i]
        if pa.types.is_floating(kind) or pa.types.is_integer(kind) or pa.types.is_boolean(kind):
            numbers = pc.cast(table.column(i), pa.float64(), safe=False)
            columns[name] = numbers.to_numpy().astype(float)
        else:
            unusable[name] = f"it holds {kind}, not numbers"
    return Table(columns, unusable)


def write(path: Path, columns: Mapping[str, Array]) -> None:
    stream = io.BytesIO()
    pq.write_table(pa.table(dict(columns)), stream)
    write_bytes(path, stream.getvalue())
