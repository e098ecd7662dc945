"""Columns from the messages of a log: what the formats of robots (MCAP, rosbag) have in common.

Every number in the messages of a topic is a column: "velocity", "header.seq", "position.elbow" where the message names
its joints beside (`sensor_msgs/JointState`), else "position.0". Where the file has several topics their name stands
before: "joint_states.position.elbow". "time" is the stamp in the header of each message, else the time of its logging
[s from the first message of the file].
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import DataError
from . import Array, Table

_LABELS = ("name", "names", "joint_names")
_DEEPEST = 8


def table(path: Path, topics: Mapping[str, Sequence[tuple[int, dict[str, Any]]]], unread: Mapping[str, str]) -> Table:
    """The columns of a log.

    Args:
        path: of the file, for messages to the user.
        topics: time of logging [ns] and content of each message, by topic.
        unread: topics that are left out, and why.

    Raises:
        DataError: there is no message.
    """
    if not topics:
        why = "; ".join(f"topic {k}: {v}" for k, v in unread.items())
        raise DataError(f"{path}: no messages that can be read" + (f" ({why})" if why else ""))
    start = min(messages[0][0] for messages in topics.values())
    columns: dict[str, Array] = {}
    unusable: dict[str, str] = dict(unread)
    for topic, messages in topics.items():
        before = "" if len(topics) == 1 else topic.strip("/") + "."
        numbers, wrong = _columns(messages, start)
        columns |= {before + k: v for k, v in numbers.items()}
        unusable |= {before + k: v for k, v in wrong.items()}
    return Table(columns, unusable)


def _columns(messages: Sequence[tuple[int, dict[str, Any]]], start: int) -> tuple[dict[str, Array], dict[str, str]]:
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


def plain(value: Any, depth: int = 0) -> Any:
    """A decoded ROS message as dictionaries and lists."""
    if isinstance(value, bool | int | float | str) or depth > _DEEPEST:
        return value
    if isinstance(value, bytes | bytearray):
        return None  # a picture or the like
    if isinstance(value, np.ndarray):
        return None if value.dtype.kind == "u" and value.itemsize == 1 else value.tolist()
    if hasattr(value, "__iter__"):
        return [plain(v, depth + 1) for v in value]
    names = [k for k in getattr(value, "__slots__", None) or vars(value) if not k.startswith("_")]
    return {k: plain(getattr(value, k), depth + 1) for k in names}
