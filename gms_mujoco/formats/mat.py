"""MATLAB files up to version 7. The fields of a struct are columns "struct.field"."""

from __future__ import annotations

import io
from collections.abc import Mapping
from pathlib import Path

import scipy.io

from ..errors import DataError
from ..files import write_bytes
from . import Array, Table, unpack

SUFFIXES = (".mat",)


def read(path: Path) -> Table:
    with path.open("rb") as stream:
        head = stream.read(128)
    if head.startswith(b"MATLAB 7.3") or b"HDF5" in head:
        raise DataError(f"{path}: MATLAB 7.3 files are not readable; save with the option '-v7' in MATLAB")
    arrays: dict[str, object] = {}
    for name, value in scipy.io.loadmat(path, struct_as_record=False, squeeze_me=True).items():
        if not name.startswith("__"):
            _flatten(name, value, arrays)
    return unpack(arrays)


def write(path: Path, columns: Mapping[str, Array]) -> None:
    stream = io.BytesIO()
    scipy.io.savemat(stream, {k: v[:, None] for k, v in columns.items()})
    write_bytes(path, stream.getvalue())


def _flatten(name: str, value: object, into: dict[str, object]) -> None:
    fields = getattr(value, "_fieldnames", None)
    if fields is None:
        into[name] = value
        return
    for field in fields:
        _flatten(f"{name}.{field}", getattr(value, field), into)
