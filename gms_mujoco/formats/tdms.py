"""TDMS files of LabVIEW and other National Instruments software, through npTDMS.

Channels are columns, "group.channel" where the file has several groups. A channel of a waveform states its sampling;
where all agree and none is called "time" they give that column. Time stamps are seconds from the first.
"""

from __future__ import annotations

import io
import logging
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import DataError
from ..files import write_bytes
from . import Array, Table, needed

SUFFIXES = (".tdms",)

_GROUP = "record"


def read(path: Path) -> Table:
    tdms = needed("nptdms", "TDMS files (.tdms)", "tdms")
    if path.open("rb").read(4) not in (b"TDSm", b"TDSh"):
        raise DataError(f"{path}: not a TDMS file; expected it to begin with TDSm")
    logging.getLogger("nptdms").setLevel(logging.ERROR)  # it warns of a cut file, which is refused below
    columns: dict[str, Array] = {}
    unusable: dict[str, str] = {}
    units: dict[str, str] = {}
    sampling: set[tuple[float, float, int]] = set()
    with path.open("rb") as stream:  # not by path: an index file beside it may belong to another one
        groups = [g for g in tdms.TdmsFile.read(stream).groups() if g.channels()]
    for group in groups:
        for channel in group.channels():
            name = channel.name if len(groups) == 1 else f"{group.name}.{channel.name}"
            if name in columns or name in unusable:
                raise DataError(f"{path}: two channels are called {name!r}")
            data = np.asarray(channel[:])
            if data.dtype.kind == "M":
                data = (data - data[:1]) / np.timedelta64(1, "s")
            if data.dtype.kind not in "biuf" or data.ndim != 1 or not len(data):
                unusable[name] = "it is empty" if not len(data) else "it holds no numbers"
                continue
            columns[name] = data.astype(float)
            if unit := str(channel.properties.get("unit_string", "")).strip():
                units[name] = unit
            sampling.add(_sampling(channel.properties, len(data)))
    if "time" not in columns and len(sampling) == 1:
        start, step, n = sampling.pop()
        if step > 0:
            columns = {"time": np.asarray(start + step * np.arange(n), float), **columns}
            units["time"] = "s"
    return Table(columns, unusable, units=units)


def write(path: Path, columns: Mapping[str, Array]) -> None:
    tdms = needed("nptdms", "TDMS files (.tdms)", "tdms")
    stream = io.BytesIO()
    with tdms.TdmsWriter(stream) as writer:
        writer.write_segment([tdms.ChannelObject(_GROUP, k, v) for k, v in columns.items()])
    write_bytes(path, stream.getvalue())


def _sampling(properties: Mapping[str, Any], n: int) -> tuple[float, float, int]:
    """Time of the first sample and from one to the next [s], 0 where the channel does not say, and samples."""
    try:
        return float(properties.get("wf_start_offset", 0.0)), float(properties.get("wf_increment", 0.0)), n
    except (TypeError, ValueError):
        return 0.0, 0.0, n
