"""Universal files, dataset 58 (functions at nodal degrees of freedom), ascii and binary, through pyuff.

Functions that share their abscissa share its column. Columns are named after what they hold: "time" or "frequency",
then of a frequency response "real" and "imag", of another function the label of its axis. Where a name comes again,
the number of the function, counted from 1, stands before it ("2.real").
"""

from __future__ import annotations

import contextlib
import io
import re
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import DataError
from ..files import whole
from . import Array, Table, needed

SUFFIXES = (".uff", ".unv")

_FRF, _TIME, _FREQUENCY, _GENERAL = 4, 17, 18, 1  # func_type, abscissa_spec_data_type
# Of ordinate_spec_data_type and orddenom_spec_data_type; 9 and 13 are forces of reaction and excitation.
_QUANTITIES = {8: "position", 9: "torque", 11: "velocity", 12: "acceleration", 13: "torque"}
_OTHERS = {2: "auto spectrum", 3: "cross spectrum", 6: "coherence", 9: "psd"}


def read(path: Path) -> Table:
    pyuff = needed("pyuff", "universal files (.uff, .unv)", "uff")
    head = path.read_bytes()[:4096]
    if not re.search(rb"^ {4}-1\s*$", head, re.MULTILINE):
        raise DataError(f"{path}: not a universal file; expected datasets between lines of '    -1'")
    with contextlib.redirect_stdout(io.StringIO()), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        file = pyuff.UFF(str(path))
        kinds = [int(k) for k in file.get_set_types()]
        sets = [file.read_sets(i) for i, kind in enumerate(kinds) if kind == 58]
    if not sets:
        whole_ones = f"it has {', '.join(map(str, sorted(set(kinds))))}" if kinds else "it has no whole dataset; cut?"
        raise DataError(f"{path}: no dataset 58 (function); {whole_ones}")
    columns: dict[str, Array] = {}
    units: dict[str, str] = {}
    quantities: dict[str, tuple[str, str]] = {}
    for i, one in enumerate(sets, 1):
        x, data = np.asarray(one["x"], float), np.asarray(one["data"])
        if x.shape != data.shape or x.ndim != 1 or len(x) < 2:
            raise DataError(f"{path}: function {i} has {data.size} values at {x.size} points; the file may be cut")
        if int(one["num_pts"]) != len(x):
            raise DataError(f"{path}: function {i} has {len(x)} values, its header says {one['num_pts']}; cut?")

        of_what = tuple(_QUANTITIES.get(int(one.get(f"{k}_spec_data_type") or 0), "") for k in ("ordinate", "orddenom"))

        def put(name: str, values: Array, unit: str, i: int = i, what: tuple[str, ...] = of_what) -> None:
            name = name if name not in columns else f"{i}.{name}"
            columns[name] = values
            units.update({name: unit} if unit else {})
            quantities[name] = (what[0], what[1])

        base, unit = _abscissa(one)
        if not any(k.split(".")[-1] == base and np.array_equal(v, x) for k, v in columns.items()):
            put(base, x, unit)
        over, under = _text(one, "ordinate_axis_units_lab"), _text(one, "orddenom_axis_units_lab")
        unit = f"{over}/({under})" if over and under else over
        if int(one["func_type"]) == _FRF and np.iscomplexobj(data):
            put("real", data.real.astype(float), unit)
            put("imag", data.imag.astype(float), unit)
        else:
            kind = _OTHERS.get(int(one["func_type"]))
            put(kind or _text(one, "ordinate_axis_lab") or "value", data.real.astype(float), unit)
    return Table(columns, units=units, quantities=quantities)


def write(path: Path, columns: Mapping[str, Array]) -> None:
    """The first column is the abscissa of the others; "real" and "imag" make one frequency response."""
    pyuff = needed("pyuff", "universal files (.uff, .unv)", "uff")
    names = list(columns)
    x = np.asarray(columns[names[0]], float)
    functions: list[tuple[str, Any]] = []
    if {"real", "imag"} <= set(names):
        functions.append(("response", columns["real"] + 1j * columns["imag"]))
    functions += [(k, columns[k]) for k in names[1:] if k not in ("real", "imag") or not functions]
    kind = {"time": _TIME, "frequency": _FREQUENCY}.get(names[0], 0)
    with whole(path) as temporary:
        file = pyuff.UFF(str(temporary))
        for name, data in functions:
            one = {
                "type": 58, "binary": 1, "func_type": _FRF if np.iscomplexobj(data) else _GENERAL,
                "rsp_node": 1, "rsp_dir": 1, "ref_node": 1, "ref_dir": 1, "data": data, "x": x, "abscissa_spacing": 0,
                "id1": name, "abscissa_spec_data_type": kind, "abscissa_axis_lab": names[0][:20],
                "abscissa_axis_units_lab": {_TIME: "s", _FREQUENCY: "Hz"}.get(kind, "NONE"),
                "ordinate_axis_lab": name[:20], "orddenom_spec_data_type": 0,
            }  # fmt: skip
            file.write_sets(one, "add")  # "overwrite" loses the header of a binary set (pyuff 2.5)


def _abscissa(one: Mapping[str, Any]) -> tuple[str, str]:
    label, unit = _text(one, "abscissa_axis_lab"), _text(one, "abscissa_axis_units_lab")
    kind = int(one["abscissa_spec_data_type"])
    if kind == _FREQUENCY or unit.lower() in ("hz", "rad/s") or label.lower() in ("hz", "frequency"):
        return "frequency", unit or "Hz"  # the format states frequencies in Hz
    if kind == _TIME or unit == "s" or label.lower().startswith("time"):
        return "time", unit or "s"
    return label or "abscissa", unit


def _text(one: Mapping[str, Any], key: str) -> str:
    text = str(one.get(key, "")).strip()
    return "" if text.upper() == "NONE" else text
