"""MATLAB files; those of version 7.3 (HDF5) through h5py.

The fields of a struct are columns "struct.field", of an array of structs "struct(1).field"; what a cell holds is
"cell{1}".
"""

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
_MOST = 1000  # of a cell or an array of structs
_LARGEST = 2**31  # bytes of an array: a damaged header may claim any


def read(path: Path) -> Table:
    with path.open("rb") as stream:
        head = stream.read(128)
    if head.startswith((b"MATLAB 7.3", b"\x89HDF")):
        h5py = needed("h5py", "MATLAB 7.3 files (.mat)", "hdf5")
        with h5py.File(path, "r") as file:
            return unpack(_Hdf5(path, h5py, file).arrays)
    if head[126:128] in _ORDERS and all(head[:4]):  # version 5; that of 4 begins with a zero among its first bytes
        content = path.read_bytes()
        _check_elements(path, memoryview(content)[128:], _ORDERS[head[126:128]], 0)
    arrays: dict[str, object] = {}
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


def _flatten(name: str, value: object, into: dict[str, object], depth: int = 0) -> None:
    fields = getattr(value, "_fieldnames", None)
    if depth > _DEEPEST:
        into[name] = "text"
    elif fields is not None:
        for field in fields:
            _flatten(f"{name}.{field}", getattr(value, field), into, depth + 1)
    elif isinstance(value, np.ndarray) and value.dtype.kind == "O" and value.size <= _MOST:
        for i, part in enumerate(value.ravel("F"), 1):
            label = f"({i})" if hasattr(part, "_fieldnames") else f"{{{i}}}"
            _flatten(name + label, part, into, depth + 1)
    else:
        into[name] = value


class _Hdf5:
    """The arrays of a 7.3 file by name: groups are structs, dimensions stand in reverse, references are cells or
    structs."""

    def __init__(self, path: Path, h5py: Any, file: Any) -> None:
        self._path, self._h5py, self._file = path, h5py, file
        self._followed: set[str] = set()  # a damaged file may refer in circles
        self.arrays: dict[str, object] = {}
        self._walk(file, "", 0)

    def _walk(self, group: Any, before: str, depth: int) -> None:
        for key in group:
            # What cells refer to stands under "#refs#"; a link may lead to another file.
            if not key.startswith("#") and isinstance(group.get(key, getlink=True), self._h5py.HardLink):
                self._put(group[key], before, key, depth)

    def _put(self, item: Any, before: str, key: str, depth: int) -> None:
        """One item; its name in two parts, for the number of a struct in an array stands between them."""
        name, kind = before + key, item.attrs.get("MATLAB_class", b"")
        if isinstance(item, self._h5py.Group):
            if depth < _DEEPEST:
                self._walk(item, f"{name}.", depth + 1)
        elif item.attrs.get("MATLAB_empty", 0):
            self.arrays[name] = np.zeros(0)
        elif self._h5py.check_ref_dtype(item.dtype) is self._h5py.Reference and item.size <= _MOST:
            for i, to in enumerate(item[()].ravel(), 1):  # rows and columns change places: this is MATLAB's order
                part = self._file[to] if to else None
                if part is not None and part.name not in self._followed:
                    self._followed.add(part.name)
                    at = (before, f"{key}{{{i}}}") if kind == b"cell" else (f"{before[:-1]}({i}).", key)
                    self._put(part, *at, depth + 1)
        elif item.dtype.kind == "O" or kind == b"char":
            self.arrays[name] = "text"
        else:
            if item.external or item.is_virtual or item.nbytes > _LARGEST:
                raise DataError(f"{self._path}: {name!r} does not lie in this file, or has more than 2 GiB")
            value = item[()]
            if value.dtype.names == ("real", "imag"):
                value = value["real"] + 1j * value["imag"]
            self.arrays[name] = value.T
