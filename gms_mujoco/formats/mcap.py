"""MCAP logs (the format of ROS 2 bags and of Foxglove) with messages in JSON or ROS 2 CDR, through mcap.

Every number in the messages of a topic is a column: "velocity", "header.seq", "position.elbow" where the message names
its joints beside (`sensor_msgs/JointState`), else "position.0". Where the file has several topics their name stands
before: "joint_states.position.elbow". "time" is the stamp in the header of each message, else the time of its logging
[s from the first message of the file].
"""

from __future__ import annotations

import io
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import DataError
from ..files import write_bytes
from . import Array, Table, needed

SUFFIXES = (".mcap",)

_LABELS = ("name", "names", "joint_names")
_TOPIC = "record"  # of what `write` writes
_DEEPEST = 8


def read(path: Path) -> Table:
    reader_of = needed("mcap.reader", "MCAP files (.mcap)", "mcap").make_reader
    topics: dict[str, list[tuple[int, dict[str, Any]]]] = {}
    undecoded: dict[str, str] = {}
    ros2: Any = None
    with path.open("rb") as stream:
        for schema, channel, message in reader_of(stream).iter_messages():
            if channel.topic in undecoded:
                continue
            if channel.message_encoding == "json":
                content = json.loads(message.data)
            elif channel.message_encoding == "cdr":
                ros2 = ros2 or needed("mcap_ros2.decoder", "ROS 2 messages", "mcap").DecoderFactory()
                decode = ros2.decoder_for("cdr", schema)
                content = None if decode is None else _plain(decode(message.data), 0)
            else:
                content = None
            if isinstance(content, dict):
                topics.setdefault(channel.topic, []).append((message.log_time, content))
            else:
                undecoded[channel.topic] = (
                    f"its messages are {channel.message_encoding or 'raw'}; JSON objects and ROS 2 CDR are read"
                )
    if not topics:
        why = "; ".join(f"topic {k}: {v}" for k, v in undecoded.items())
        raise DataError(f"{path}: no messages that can be read" + (f" ({why})" if why else ""))
    start = min(times[0][0] for times in topics.values())
    columns: dict[str, Array] = {}
    unusable: dict[str, str] = dict(undecoded)
    for topic, messages in topics.items():
        before = "" if len(topics) == 1 else topic.strip("/") + "."
        numbers, wrong = _columns(messages, start)
        columns |= {before + k: v for k, v in numbers.items()}
        unusable |= {before + k: v for k, v in wrong.items()}
    return Table(columns, unusable)


def write(path: Path, columns: Mapping[str, Array]) -> None:
    """One topic with a JSON message for each sample."""
    writer_of = needed("mcap.writer", "MCAP files (.mcap)", "mcap").Writer
    stream = io.BytesIO()
    writer = writer_of(stream)
    writer.start()
    fields = {k: {"type": "number"} for k in columns}
    schema = json.dumps({"type": "object", "properties": fields}).encode()
    channel = writer.register_channel(_TOPIC, "json", writer.register_schema(_TOPIC, "jsonschema", schema))
    rows = zip(*(v.tolist() for v in columns.values()), strict=True)
    stamps = np.asarray(columns.get("time", np.arange(len(next(iter(columns.values()))))))
    for stamp, row in zip(stamps - stamps.min(), rows, strict=True):
        data = json.dumps(dict(zip(columns, row, strict=True))).encode()
        writer.add_message(channel, log_time=round(1e9 * stamp), publish_time=round(1e9 * stamp), data=data)
    writer.finish()
    write_bytes(path, stream.getvalue())


def _columns(messages: list[tuple[int, dict[str, Any]]], start: int) -> tuple[dict[str, Array], dict[str, str]]:
    """The columns of one topic, and those that are not numbers in every message."""
    rows = []
    for logged, content in messages:
        row: dict[str, Any] = {}
        _flatten("", content, row, 0)
        row.setdefault("time", row.get("header.stamp") or logged)
        rows.append(row)
    columns: dict[str, Array] = {}
    unusable: dict[str, str] = {}
    for name in rows[0]:
        values = [row.get(name) for row in rows]
        wrong = next((i for i, v in enumerate(values) if not isinstance(v, int | float)), None)
        if wrong is not None:
            unusable[name] = f"message {wrong}: {'nothing' if values[wrong] is None else 'text'} is not a number"
        elif name == "time" and all(isinstance(v, int) and v > 10**9 for v in values):  # nanoseconds of an epoch
            columns[name] = np.array([(v - start) * 1e-9 for v in values])  # type: ignore[operator]
        else:
            columns[name] = np.array(values, float)
    return columns, unusable


def _flatten(name: str, value: Any, into: dict[str, Any], depth: int) -> None:
    if isinstance(value, dict):
        second = next((k for k in ("sec", "secs") if k in value), None)
        if second and len(value) == 2 and all(isinstance(v, int) for v in value.values()):  # a stamp [ns]
            into[name] = value[second] * 10**9 + next(v for k, v in value.items() if k != second)
            return
        labels = next((value[k] for k in _LABELS if _are_labels(value.get(k))), None)
        for key, part in value.items():
            inner = f"{name}.{key}" if name else str(key)
            if labels is not None and isinstance(part, list) and len(part) == len(labels) and part is not labels:
                part = dict(zip(labels, part, strict=True))
            if depth < _DEEPEST:
                _flatten(inner, part, into, depth + 1)
    elif isinstance(value, list):
        for i, part in enumerate(value):
            if depth < _DEEPEST and not isinstance(part, str):
                _flatten(f"{name}.{i}", part, into, depth + 1)
    else:
        into[name] = value


def _are_labels(value: Any) -> bool:
    return isinstance(value, list) and 0 < len(value) == len({str(v) for v in value}) and all(
        isinstance(v, str) for v in value
    )


def _plain(value: Any, depth: int) -> Any:
    """A decoded ROS 2 message as dictionaries and lists."""
    if isinstance(value, bool | int | float | str) or depth > _DEEPEST:
        return value
    if isinstance(value, bytes | bytearray):
        return None  # a picture or the like
    if hasattr(value, "__iter__"):
        return [_plain(v, depth + 1) for v in value]
    names = [k for k in getattr(value, "__slots__", None) or vars(value) if not k.startswith("_")]
    return {k: _plain(getattr(value, k), depth + 1) for k in names}
