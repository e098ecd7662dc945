"""MCAP logs (the format of ROS 2 bags and of Foxglove) with messages in JSON or ROS 2 CDR, through mcap.

`messages` says how messages become columns.
"""

from __future__ import annotations

import io
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ..files import write_bytes
from . import Array, Table, messages, needed

SUFFIXES = (".mcap",)

_TOPIC = "record"  # of what `write` writes


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
                content = None if decode is None else messages.plain(decode(message.data))
            else:
                content = None
            if isinstance(content, dict):
                topics.setdefault(channel.topic, []).append((message.log_time, content))
            else:
                undecoded[channel.topic] = (
                    f"its messages are {channel.message_encoding or 'raw'}; JSON objects and ROS 2 CDR are read"
                )
    return messages.table(path, topics, undecoded)


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
