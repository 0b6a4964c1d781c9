"""ROS bags and MCAP files, read by rosbags and mcap: numbers of all messages, a column for each field.

Messages carry no units, so that a column needs one, by ``units``, before a model can use it.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from bondgraph.data.formats.table import Signal, Table, extra, merged
from bondgraph.data.header import UNKNOWN_UNIT, Reading
from bondgraph.errors import DataError

#: Longest array whose elements are columns: joints of a robot, a covariance; scans and pictures are left out.
_LONGEST_ARRAY = 40
_NANOSECOND = 1e-9
#: Topic, time at which it was recorded in ns, message.
Messages = Iterator[tuple[str, int, Any]]


def read_bag(path: Path, _: Reading) -> Table:
    """Numbers of the messages of a ROS 1 bag; columns are called ``topic.field`` and ``topic.field.index``.

    Times are those of the headers of messages where all of a topic have one, else those of recording; they count from
    the first.
    """
    highlevel, typesys = extra("rosbags.highlevel", path, "ros"), extra("rosbags.typesys", path, "ros")

    def messages() -> Messages:
        store = typesys.get_typestore(typesys.Stores.LATEST)
        with highlevel.AnyReader([path], default_typestore=store) as bag:
            for connection, stamp, raw in bag.messages():
                yield connection.topic, stamp, bag.deserialize(raw, connection.msgtype)

    return _table(messages(), path)


def read_mcap(path: Path, _: Reading) -> Table:
    """Numbers of the messages of an MCAP file, written by ROS 2, ROS 1 or as JSON, as :func:`read_bag` does."""
    reader = extra("mcap.reader", path, "mcap")

    def messages() -> Messages:
        decoders: dict[int, Callable[[bytes], Any]] = {}
        with path.open("rb") as file:
            for schema, channel, message in reader.make_reader(file).iter_messages():
                if channel.id not in decoders:
                    decoders[channel.id] = _decoder(path, schema, channel)
                yield channel.topic, message.log_time, decoders[channel.id](message.data)

    return _table(messages(), path)


def _decoder(path: Path, schema: Any, channel: Any) -> Callable[[bytes], Any]:
    if channel.message_encoding == "json":
        return json.loads
    if channel.message_encoding not in ("cdr", "ros1"):
        raise DataError(
            f"{path.name}: messages of {channel.topic!r} are written as {channel.message_encoding!r}, which is not "
            "read - write them as cdr (ROS 2), ros1 or json",
            where=(path.name, channel.topic),
        )
    typesys = extra("rosbags.typesys", path, "mcap")
    is_ros1 = channel.message_encoding == "ros1"
    store = typesys.get_typestore(typesys.Stores.ROS1_NOETIC if is_ros1 else typesys.Stores.LATEST)
    name = schema.name if "/msg/" in schema.name else schema.name.replace("/", "/msg/")
    types = typesys.get_types_from_msg(schema.data.decode(), name)
    store.register({key: value for key, value in types.items() if key not in store.types})
    read = store.deserialize_ros1 if is_ros1 else store.deserialize_cdr
    return lambda raw: read(raw, name)


def _table(messages: Messages, path: Path) -> Table:
    topics: dict[str, list[tuple[int, int | None, dict[str, float]]]] = {}
    for topic, recorded, message in messages:
        topics.setdefault(topic.strip("/"), []).append((recorded, _stamp(message), dict(_numbers(message, ""))))
    times = {
        topic: [recorded if any(one[1] is None for one in rows) else int(stamp or 0) for recorded, stamp, _ in rows]
        for topic, rows in topics.items()
    }
    first = min((min(stamps) for stamps in times.values()), default=0)
    signals = []
    for topic, rows in topics.items():
        seconds = np.multiply(np.array(times[topic], dtype=np.int64) - first, _NANOSECOND, dtype=np.float64)
        order = np.argsort(seconds, kind="stable")
        for name in dict.fromkeys(name for _, _, fields in rows for name in fields):
            values = np.array([fields.get(name, np.nan) for _, _, fields in rows])
            signals.append(Signal(f"{topic}{name} [{UNKNOWN_UNIT}]", seconds[order], values[order]))
    if not signals:
        raise DataError(f"{path.name}: no message holds a number", where=(path.name,))
    return merged(signals)


def _fields(message: Any) -> Any:
    """Names and values of the fields of a message."""
    if isinstance(message, dict):
        return message.items()
    names = getattr(message, "__dataclass_fields__", ())
    return ((name, getattr(message, name)) for name in names if not name.startswith("__"))


def _stamp(message: Any) -> int | None:
    """The time in the header of a message in ns; None where it has none."""
    stamp = getattr(getattr(message, "header", None), "stamp", None)
    return None if stamp is None or not (stamp.sec or stamp.nanosec) else stamp.sec * 10**9 + stamp.nanosec


def _numbers(value: Any, name: str) -> Iterator[tuple[str, float]]:
    """The numbers in a message by the names of their fields, without its header."""
    if isinstance(value, bool | int | float | np.number):
        yield name, float(value)
    elif isinstance(value, list | tuple | np.ndarray):
        if len(value) <= _LONGEST_ARRAY:
            for index, one in enumerate(value):
                yield from _numbers(one, f"{name}.{index}")
    elif not isinstance(value, str | bytes) and value is not None:
        for field, one in _fields(value):
            if field != "header":
                yield from _numbers(one, f"{name}.{field}")
