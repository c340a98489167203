"""ROS bags: ROS 1 (.bag) and ROS 2 in SQLite (.db3), decoded by rosbags. Fields are named as in MCAP."""

import json
import os
import sqlite3
from collections.abc import Callable, Collection, Iterable, Iterator
from contextlib import AbstractContextManager, closing, contextmanager
from functools import partial
from itertools import islice
from pathlib import Path
from shutil import copyfile
from tempfile import TemporaryDirectory
from typing import NamedTuple
from urllib.parse import quote

from rosbags.rosbag1 import Reader
from rosbags.typesys import Stores, get_typestore

from rovid.core.errors import LogError, suggestion
from rovid.core.input_files import file_parts
from rovid.readers.message_topics import Decoder, TopicExtractor, TopicListing, ros_decoder
from rovid.readers.raw_log import LogContents, RawLog, damaged, require_mark, required_signals
from rovid.trial.config import Config
from rovid.trial.trial import Remark

KIND = "bag"
_DAMAGED = "a bag that is cut or damaged"
_ROS1_MARK, _ROS2_MARK = b"#ROSBAG V", b"SQLite format 3\0"
# Values of damaged tables are cast, so that decoding reports the damage. TYPEOF finds NULL in columns that are declared
# NOT NULL, for which SQLite does not evaluate IS NOT NULL.
_TOPICS = """SELECT CAST(id AS INTEGER), CAST(name AS TEXT), CAST(type AS TEXT), CAST(serialization_format AS TEXT)
    FROM topics WHERE 'null' NOT IN (TYPEOF(id), TYPEOF(name), TYPEOF(type), TYPEOF(serialization_format))"""
_DEFINITIONS = """SELECT CAST(topic_type AS TEXT), CAST(encoded_message_definition AS TEXT) FROM message_definitions
    WHERE 'null' NOT IN (TYPEOF(topic_type), TYPEOF(encoded_message_definition))"""
_MESSAGES = """SELECT CAST(topic_id AS INTEGER), CAST(timestamp AS INTEGER), CAST(data AS BLOB) FROM messages
    WHERE topic_id IN (SELECT value FROM json_each(?)) AND 'null' NOT IN (TYPEOF(timestamp), TYPEOF(data))"""
_TABLES = "SELECT CAST(name AS TEXT) FROM sqlite_master WHERE type = 'table'"


class _BagConnection(NamedTuple):
    """A topic of one type; ``definition`` is empty if the bag does not hold it."""

    number: int
    topic: str
    kind: str
    encoding: str
    definition: str


_Messages = Callable[[Collection[int]], Iterable[tuple[int, int, bytes]]]
# Connections, messages of some of them, and descriptions of damage.
_Bag = tuple[list[_BagConnection], _Messages, list[str]]


def read(path: Path, config: Config) -> RawLog:
    """Mapped fields of ``path``, with the same clocks as MCAP."""
    topics = TopicExtractor(path, KIND, required_signals(config, KIND, path), config.time)
    with _opened(path) as (connections, messages, damage):
        handlers = {}
        for one in connections:
            if (handler := topics.handler(one.topic, partial(_decoder, path, one), mapping=False)) is not None:
                handlers[one.number] = handler
        for number, stamp, data in _until_damage(messages, handlers, damage):
            handlers[number](data, stamp, stamp)
    remarks = tuple(Remark(kind="truncated", count=1, text=text) for text in damage)
    return topics.result(lambda _: remarks, "".join(f" {text}" for text in damage))


def sources(path: Path) -> LogContents:
    """Every field that holds a number or an orientation."""
    listing = TopicListing(path, KIND)
    with _opened(path) as (connections, messages, damage):
        for one in connections:
            if (handler := listing.handler(one.topic, partial(_decoder, path, one), mapping=False)) is not None:
                for _, stamp, data in islice(_until_damage(messages, [one.number], damage), 1):
                    handler(data, stamp, stamp)
    return listing.contents(dict.fromkeys(damage))


def _until_damage(messages: _Messages, wanted: Collection[int], damage: list[str]) -> Iterator[tuple[int, int, bytes]]:
    """The messages of the connections ``wanted``; an early end is described in ``damage``."""
    try:
        # rosbags takes an empty selection for every connection.
        for message in messages(wanted) if wanted else ():
            # A damaged index leads to messages of other connections.
            if message[0] in wanted:
                yield message
    except Exception as error:  # noqa: BLE001 - libraries raise any exception on damaged files
        damage.append(f"The bag is cut or damaged ({str(error)[:100]}); the rest was not read.")


def _opened(path: Path) -> AbstractContextManager[_Bag]:
    if path.suffix.lower() == ".db3":
        require_mark(path, _ROS2_MARK, "a ROS 2 bag in SQLite")
        return _ros2(path)
    require_mark(path, _ROS1_MARK, "a ROS 1 bag")
    return _ros1(path)


@contextmanager
def _ros1(path: Path) -> Iterator[_Bag]:
    reader = Reader(path)
    try:
        reader.open()
    except Exception as error:
        mend = "If it was not closed, `rosbag reindex` mends it; else leave it out."
        raise damaged(path, _DAMAGED, error, mend) from error

    def messages(wanted: Collection[int]) -> Iterator[tuple[int, int, bytes]]:
        chosen = [one for one in found if one.id in wanted]
        for one, stamp, data in reader.messages(connections=chosen):
            yield one.id, stamp, data

    found = reader.connections
    connections = [_BagConnection(one.id, one.topic, one.msgtype, "ros1", one.msgdef.data) for one in found]
    try:
        yield connections, messages, []
    finally:
        reader.close()


@contextmanager
def _connected(path: Path) -> Iterator[sqlite3.Connection]:
    """The database with its write-ahead log, if it was not merged; nothing is written next to either.

    SQLite creates an index next to a database with such a log, and may merge both. It therefore reads copies. Without a
    log all data are in the database, which is then opened as immutable.
    """
    parts = [Path(os.path.realpath(part)) for part in file_parts(path)]
    with TemporaryDirectory(prefix="rovid_") as folder:
        if len(parts) > 1:
            parts = [Path(copyfile(part, Path(folder) / part.name)) for part in parts]
        mode = "mode=ro" if len(parts) > 1 else "mode=ro&immutable=1"
        with closing(sqlite3.connect(f"file:{quote(str(parts[0]))}?{mode}", uri=True)) as bag:
            yield bag


@contextmanager
def _ros2(path: Path) -> Iterator[_Bag]:
    with _connected(path) as bag:
        bag.text_factory = lambda text: text.decode("utf-8", errors="replace")
        connections = []
        try:
            names = {name for (name,) in bag.execute(_TABLES)}
            if lacking := {"topics", "messages"} - names:
                raise sqlite3.DatabaseError(f"no table {min(lacking)}")
            # Bags up to ROS 2 Humble do not hold the definitions of their messages.
            definitions = dict(bag.execute(_DEFINITIONS)) if "message_definitions" in names else {}
            for number, topic, kind, encoding in bag.execute(_TOPICS):
                connections.append(_BagConnection(number, topic, kind, encoding, definitions.get(kind, "")))
            ((pages,),), ((page_size,),) = bag.execute("PRAGMA page_count"), bag.execute("PRAGMA page_size")
        except (sqlite3.Error, UnicodeDecodeError) as error:  # SQLite quotes damaged text in its messages.
            raise damaged(path, _DAMAGED, error, "Record the log again, or leave it out.") from error
        # A write-ahead log holds pages that are not in the file yet.
        lost = int(pages * page_size) - sum(part.stat().st_size for part in file_parts(path))
        damage = [f"The bag is cut: its last {lost} bytes are missing."] if lost > 0 else []
        yield connections, lambda wanted: bag.execute(_MESSAGES, (json.dumps(sorted(wanted)),)), damage


def _decoder(path: Path, one: _BagConnection) -> Decoder:
    """Function that turns the payloads of a connection into objects."""
    try:
        return ros_decoder(one.kind, one.definition, one.encoding)
    except (KeyError, ValueError) as error:
        text = f"the type {one.kind} of topic {one.topic!r}, encoded as {one.encoding!r}, is not defined in the bag, "
        text += f"and it is none of ROS 2's own. {suggestion(one.kind, get_typestore(Stores.LATEST).fielddefs)}"
        mend = "Convert the bag to MCAP where the type is known, or map another topic."
        raise LogError(text, where=path, mend=mend) from error
    except Exception as error:
        text = f"the type {one.kind} of topic {one.topic!r} cannot be parsed ({str(error)[:100]!r})."
        raise LogError(text, where=path, mend="Convert the bag to MCAP, or leave it out.") from error
