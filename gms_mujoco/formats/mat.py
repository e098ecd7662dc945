"""MATLAB files; those of version 7.3 (HDF5) through h5py. The fields of a struct are columns "struct.field"."""

from __future__ import annotations

import io
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal

import numpy as np
import scipy.io

from ..errors import DataError
from ..files import write_bytes
from . import Array, Table, needed, unpack

SUFFIXES = (".mat",)

_DEEPEST = 16
_ORDERS: Mapping[bytes, Literal["little", "big"]] = {b"IM": "little", b"MI": "big"}
_TYPES = {1, 2, 3, 4, 5, 6, 7, 9, 12, 13, 14, 15, 16, 17, 18}
_MATRIX, _COMPRESSED = 14, 15
_LARGEST = 2**31  # bytes of an array: a damaged header may claim any


def read(path: Path) -> Table:
    with path.open("rb") as stream:
        head = stream.read(128)
    arrays: dict[str, object] = {}
    if head.startswith((b"MATLAB 7.3", b"\x89HDF")):
        h5py = needed("h5py", "MATLAB 7.3 files (.mat)", "hdf5")
        with h5py.File(path, "r") as file:
            _walk(path, h5py, file, "", arrays, 0)
        return unpack(arrays)
    if head[126:128] in _ORDERS and all(head[:4]):  # version 5; that of 4 begins with a zero among its first bytes
        content = path.read_bytes()
        _check_elements(path, memoryview(content)[128:], _ORDERS[head[126:128]], 0)
    for name, value in scipy.io.loadmat(path, struct_as_record=False, squeeze_me=True).items():
        if not name.startswith("__"):
            _flatten(name, value, arrays)
    return unpack(arrays)


def _check_elements(path: Path, content: memoryview, order: Literal["little", "big"], depth: int) -> None:
    """Raises DataError where an element is of a type that does not exist: SciPy's reader would end the process.

    Source: MATLAB, MAT-File Format (level 5): an element is a tag of type and size, and data padded to 8 bytes.
    """
    at = 0
    while at + 8 <= len(content):
        kind, size, start = int.from_bytes(content[at : at + 4], order), 0, at + 8
        if kind >> 16:  # small: its data stand in the tag
            kind, start, size = kind & 0xFFFF, at + 4, 4
        else:
            size = int.from_bytes(content[at + 4 : at + 8], order)
        if kind not in _TYPES or start + size > len(content) or depth > _DEEPEST:
            raise DataError(f"{path}: cut or damaged: an element of type {kind} and {size} bytes")
        data = content[start : start + size]
        if kind == _COMPRESSED:
            plain = zlib.decompressobj().decompress(data, _LARGEST)
            _check_elements(path, memoryview(plain), order, depth + 1)
        elif kind == _MATRIX:
            _check_elements(path, data, order, depth + 1)
        at = start + size
        if kind != _COMPRESSED:
            at += -at % 8


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


def _walk(path: Path, h5py: Any, group: Any, before: str, into: dict[str, object], depth: int) -> None:
    """The arrays of a 7.3 file: groups are structs, dimensions stand in reverse, references are cells or structs."""
    for key in group:
        if key.startswith("#") or not isinstance(group.get(key, getlink=True), h5py.HardLink):
            continue  # what cells refer to; a link may lead to another file
        item, name = group[key], f"{before}{key}"
        if isinstance(item, h5py.Group):
            if depth < _DEEPEST:
                _walk(path, h5py, item, f"{name}.", into, depth + 1)
        elif item.attrs.get("MATLAB_empty", 0):
            into[name] = np.zeros(0)
        elif item.dtype.kind == "O" or item.attrs.get("MATLAB_class", b"") == b"char":
            into[name] = "text, a cell or an array of structs"
        else:
            if item.external or item.is_virtual or item.nbytes > _LARGEST:
                raise DataError(f"{path}: {name!r} does not lie in this file, or has more than 2 GiB")
            value = item[()]
            if value.dtype.names == ("real", "imag"):
                value = value["real"] + 1j * value["imag"]
            into[name] = value.T
