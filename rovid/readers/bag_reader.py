"""ROS bags: ROS 1 (.bag) and ROS 2 in SQLite (.db3); rosbags decodes their messages, fields are named as in MCAP."""

from __future__ import annotations

import json
import sqlite3
from collections.abc import Callable, Collection, Iterable, Iterator
from contextlib import AbstractContextManager, closing, contextmanager, suppress
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from urllib.parse import quote

from rovid.config import Config
from rovid.errors import LogError, nearest
from rovid.readers.raw import RawLog, foreign, library, mapped
from rovid.readers.topics import Decoder, Topics, numeric_fields
from rovid.trial import Remark

KIND = "bag"
_EXTRA = "ros"
_ROS1_MARK, _ROS2_MARK = b"#ROSBAG V", b"SQLite format 3\0"
# What a damaged table holds in the place of a number or of bytes is made one: decoding then says what is wrong.
_TOPICS = "SELECT id, CAST(name AS TEXT), CAST(type AS TEXT), CAST(serialization_format AS TEXT) FROM topics"
_DEFINITIONS = "SELECT topic_type, CAST(encoded_message_definition AS TEXT) FROM message_definitions"
_MESSAGES = """SELECT topic_id, CAST(timestamp AS INTEGER), CAST(data AS BLOB) FROM messages
    WHERE topic_id IN (SELECT value FROM json_each(?))"""


@dataclass(frozen=True, kw_only=True)
class _Connection:
    """A topic of one type; ``definition`` is empty where the bag does not hold it."""

    number: int
    topic: str
    kind: str
    encoding: str
    definition: str


_Bag = tuple[list[_Connection], Callable[[Collection[int]], Iterable[tuple[int, int, bytes]]]]


def read(path: Path, config: Config) -> RawLog:
    """Wanted fields of ``path``, on the clocks that MCAP has too.

    Raises
    ------
    LogError
        It is no bag, rosbags is not installed, or a topic or field is missing or no number.
    ConfigError
        rovid.toml does not map the heading or a command for bags or MCAP.
    """
    topics = Topics(path, KIND, mapped(config, KIND, path), config.time)
    damage = ""
    with _opened(path) as (connections, messages):
        handlers = {
            one.number: topic.handler(_decoder(path, one), mapping=False)
            for one in connections
            if (topic := topics.open(one.topic, mapping=False)) is not None
        }
        try:
            for number, stamp, data in messages(handlers) if handlers else ():
                handlers[number](data, stamp, stamp)
        except LogError:
            raise
        except Exception as error:  # noqa: BLE001 - damaged files make the libraries raise anything
            damage = f"The bag is cut or damaged ({str(error)[:100]}); what comes behind was not read."
    remarks = (Remark(kind="truncated", count=1, text=damage),) if damage else ()
    return topics.result(lambda _: remarks, f" {damage}" if damage else "")


def sources(path: Path) -> tuple[str, list[str]]:
    """Nothing, for the clock is that of the recording, and every field that holds a number or an orientation.

    Raises
    ------
    LogError
        It is no bag, or rosbags is not installed.
    """
    found: dict[str, None] = {}
    library("rosbags.typesys", _EXTRA, path)
    with _opened(path) as (connections, messages):
        for one in connections:
            with suppress(Exception):  # what cannot be decoded tells nothing
                for _, _, payload in islice(messages([one.number]), 1):
                    found.update(dict.fromkeys(numeric_fields(_decoder(path, one)(payload), one.topic)))
    return "", list(found)


def _opened(path: Path) -> AbstractContextManager[_Bag]:
    with path.open("rb") as file:
        head = file.read(len(_ROS2_MARK))
    if path.suffix.lower() == ".db3":
        if head != _ROS2_MARK:
            raise foreign(path, "a ROS 2 bag in SQLite")
        return _ros2(path)
    if not head.startswith(_ROS1_MARK):
        raise foreign(path, "a ROS 1 bag")
    return _ros1(path)


@contextmanager
def _ros1(path: Path) -> Iterator[_Bag]:
    reader = library("rosbags.rosbag1", _EXTRA, path).Reader(path)
    try:
        reader.open()
    except Exception as error:
        raise _unreadable(path, error, "If it was not closed, `rosbag reindex` mends it; else leave it out.") from error
    try:
        yield (
            [
                _Connection(number=c.id, topic=c.topic, kind=c.msgtype, encoding="ros1", definition=c.msgdef.data)
                for c in reader.connections
            ],
            lambda wanted: (
                (c.id, stamp, data)
                for c, stamp, data in reader.messages(connections=[c for c in reader.connections if c.id in wanted])
            ),
        )
    finally:
        reader.close()


@contextmanager
def _ros2(path: Path) -> Iterator[_Bag]:
    with closing(sqlite3.connect(f"file:{quote(str(path.resolve()))}?mode=ro", uri=True)) as bag:
        try:
            names = {name for (name,) in bag.execute("SELECT name FROM sqlite_master")}
            # Bags up to ROS 2 Humble do not hold the definitions of their messages.
            definitions = dict(bag.execute(_DEFINITIONS)) if "message_definitions" in names else {}
            connections = [
                _Connection(
                    number=number, topic=topic, kind=kind, encoding=encoding, definition=definitions.get(kind, "")
                )
                for number, topic, kind, encoding in bag.execute(_TOPICS)
            ]
        except sqlite3.Error as error:
            raise _unreadable(path, error, "Record the log again, or leave it out.") from error
        yield connections, lambda wanted: bag.execute(_MESSAGES, (json.dumps(sorted(wanted)),))


def _unreadable(path: Path, error: Exception, mend: str) -> LogError:
    text = f"is a bag that is cut or damaged ({type(error).__name__}: {str(error)[:100]})."
    return LogError(text.replace("\n", " "), where=path, mend=mend)


def _decoder(path: Path, one: _Connection) -> Decoder:
    """What turns the payloads of ``one`` into objects."""
    types = library("rosbags.typesys", _EXTRA, path)
    try:
        store = types.get_typestore(types.Stores.EMPTY if one.definition else types.Stores.LATEST)
        if one.definition:
            store.register(types.get_types_from_msg(one.definition, one.kind))
    except Exception as error:
        raise LogError(
            f"the type {one.kind} of topic {one.topic!r} cannot be understood ({str(error)[:100]!r}).",
            where=path,
            mend="Convert the bag to MCAP, or leave it out.",
        ) from error
    if one.kind not in store.fielddefs or one.encoding not in {"ros1", "cdr"}:
        raise LogError(
            f"the type {one.kind} of topic {one.topic!r}, encoded as {one.encoding!r}, is not defined in the bag, and "
            f"it is none of ROS 2's own. {nearest(one.kind, store.fielddefs)}",
            where=path,
            mend="Convert the bag to MCAP where the type is known, or map another topic.",
        )
    decode = store.deserialize_ros1 if one.encoding == "ros1" else store.deserialize_cdr
    return lambda payload: decode(payload, one.kind)
