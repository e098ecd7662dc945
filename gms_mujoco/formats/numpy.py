"""NumPy files: `.npz` with one array per column, `.npy` with one array of rows or columns. Never pickled objects."""

from __future__ import annotations

import io
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from ..errors import DataError
from ..files import write_bytes
from . import Array, Table, unpack

SUFFIXES = (".npz", ".npy")


def read(path: Path) -> Table:
    loaded = np.load(path, allow_pickle=False)
    if isinstance(loaded, np.ndarray):
        if loaded.dtype.names:  # a structured array names its columns
            return unpack({k: loaded[k] for k in loaded.dtype.names})
        table = unpack({"": loaded})
        columns = {k.lstrip(".") or "0": v for k, v in table.columns.items()}
        return Table(columns, {"0": table.unusable[""]} if table.unusable else {}, named=False)
    with loaded:
        return unpack({k: _member(path, loaded, k) for k in loaded.files})


def write(path: Path, columns: Mapping[str, Array]) -> None:
    stream = io.BytesIO()
    if path.suffix.lower() == ".npy":
        np.save(stream, np.array(list(columns.values())))
    else:
        np.savez_compressed(stream, **columns)  # type: ignore[arg-type]  # a stub takes them for allow_pickle
    write_bytes(path, stream.getvalue())


def _member(path: Path, loaded: Mapping[str, Array], key: str) -> Array:
    try:
        return loaded[key]
    except ValueError:
        raise DataError(f"{path}: {key!r} holds pickled Python objects, which are never loaded; save numbers") from None
