"""Bags of ROS 1 (.bag) and of ROS 2 in SQLite (.db3), through rosbags; those of ROS 2 in MCAP are `.mcap`.

`messages` says how messages become columns: of `sensor_msgs/JointState` "position.elbow", "effort.elbow" and "time".
A .db3 is read by itself, without the metadata.yaml beside it. One from before ROS 2 Iron does not say how its messages
are laid out: those that come with ROS 2 are known, others are left out.
"""

from __future__ import annotations

import re
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import DataError
from ..files import write_bytes
from . import Array, Table, messages, needed

SUFFIXES = (".bag", ".db3")

_WHAT = "rosbags (.bag, .db3)"
_TYPE = "gms_mujoco/msg/Record"  # of what `write` writes
_TOPIC = "/record"
_BEGIN = {".bag": b"#ROSBAG V2.0\n", ".db3": b"SQLite format 3\0"}


def read(path: Path) -> Table:
    highlevel = needed("rosbags.highlevel", _WHAT, "ros")
    kind = path.suffix.lower()
    with path.open("rb") as stream:
        if stream.read(len(_BEGIN[kind])) != _BEGIN[kind]:
            raise DataError(f"{path}: not a rosbag; expected it to begin with {_BEGIN[kind].decode().strip()!r}")
    typesys = needed("rosbags.typesys", _WHAT, "ros")
    known = typesys.get_typestore(typesys.Stores.LATEST)
    topics: dict[str, list[tuple[int, dict[str, Any]]]] = {}
    unread: dict[str, str] = {}
    with tempfile.TemporaryDirectory() as folder:
        place = path
        if path.suffix != kind or set("?#%") & set(str(path)):  # rosbags asks for small letters, SQLite for an address
            place = Path(folder) / f"bag{kind}"
            place.symlink_to(path.resolve())
        with highlevel.AnyReader([place], default_typestore=known) as reader:
            for connection, stamp, data in reader.messages():
                topic = connection.topic
                if topic in unread:
                    continue
                if connection.msgtype not in reader.typestore.fielddefs:
                    unread[topic] = f"the layout of its messages, {connection.msgtype}, is not known"
                    continue
                content = messages.plain(reader.deserialize(data, connection.msgtype))
                topics.setdefault(topic, []).append((stamp, content))
    return messages.table(path, topics, unread)


def write(path: Path, columns: Mapping[str, Array]) -> None:
    """One topic with a message of doubles for each sample, named after the columns."""
    typesys = needed("rosbags.typesys", _WHAT, "ros")
    for name in columns:
        if not re.fullmatch(r"[a-z](_?[a-z0-9])*", name):
            raise DataError(f"{path}: a field of a ROS message is in small letters, figures and _; {name!r} given")
    store = typesys.get_typestore(typesys.Stores.EMPTY)
    store.register(typesys.get_types_from_msg("".join(f"float64 {k}\n" for k in columns), _TYPE))
    message = store.types[_TYPE]
    old = path.suffix.lower() == ".bag"
    encode = store.serialize_ros1 if old else store.serialize_cdr
    stamps = np.asarray(columns.get("time", np.arange(len(next(iter(columns.values()))))))
    stamps = np.round(1e9 * (stamps - stamps.min())).astype(int) + 10**9
    with tempfile.TemporaryDirectory() as folder:
        bag = Path(folder) / "record"
        if old:
            writer = needed("rosbags.rosbag1", _WHAT, "ros").Writer(bag)
        else:
            writer = needed("rosbags.rosbag2", _WHAT, "ros").Writer(bag, version=9)
        with writer:
            connection = writer.add_connection(_TOPIC, _TYPE, typestore=store)
            rows = zip(*(v.tolist() for v in columns.values()), strict=True)
            for stamp, row in zip(stamps.tolist(), rows, strict=True):
                writer.write(connection, stamp, encode(message(*row), _TYPE))
        write_bytes(path, (bag if old else bag / "record.db3").read_bytes())
