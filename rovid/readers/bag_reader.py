"""ROS bags: ROS 1 (.bag) and ROS 2 in SQLite (.db3); rosbags decodes their messages, fields are named as in MCAP."""

from __future__ import annotations

import bz2
import json
import sqlite3
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from contextlib import AbstractContextManager, closing, contextmanager
from dataclasses import dataclass
from functools import partial
from itertools import islice
from pathlib import Path
from typing import Any
from urllib.parse import quote

import lz4.frame

from rovid.core.errors import LogError, suggestion
from rovid.readers.raw_log import LogContents, RawLog, foreign, mapped, require_library
from rovid.readers.topic_extractor import Decoder, Handler, Listing, Topics
from rovid.trial.config import Config
from rovid.trial.trial import Remark

KIND = "bag"
_EXTRA = "ros"
# Kinds of fields in rosbags' definitions.
_NAME, _ARRAY, _SEQUENCE = 2, 3, 4
_ROS1_MARK, _ROS2_MARK = b"#ROSBAG V", b"SQLite format 3\0"
# Of SQLite's header, up to the byte that is 2 where the database is written ahead.
_READ_VERSION, _HEADER = 19, 20
# What a damaged table holds in the place of a number, text or bytes is made such: decoding then says what is wrong.
# Of IS NOT NULL SQLite believes a column's definition, and does not look.
_TOPICS = """SELECT CAST(id AS INTEGER), CAST(name AS TEXT), CAST(type AS TEXT), CAST(serialization_format AS TEXT)
    FROM topics WHERE 'null' NOT IN (TYPEOF(id), TYPEOF(name), TYPEOF(type), TYPEOF(serialization_format))"""
_DEFINITIONS = """SELECT CAST(topic_type AS TEXT), CAST(encoded_message_definition AS TEXT) FROM message_definitions
    WHERE 'null' NOT IN (TYPEOF(topic_type), TYPEOF(encoded_message_definition))"""
_MESSAGES = """SELECT CAST(topic_id AS INTEGER), CAST(timestamp AS INTEGER), CAST(data AS BLOB) FROM messages
    WHERE topic_id IN (SELECT value FROM json_each(?)) AND 'null' NOT IN (TYPEOF(timestamp), TYPEOF(data))"""
# Views could make up rows without end.
_TABLES = "SELECT CAST(name AS TEXT) FROM sqlite_master WHERE type = 'table'"
# Of a chunk when unpacked, or of a row, in bytes.
_LARGEST = 128 << 20
# A type of more fields, fixed arrays of types written out, takes rosbags longer than anybody waits.
_MOST_FIELDS = 8192
_LONGEST_DEFINITION = 1 << 20


@dataclass(frozen=True, kw_only=True)
class _Connection:
    """A topic of one type; ``definition`` is empty where the bag does not hold it."""

    number: int
    topic: str
    kind: str
    encoding: str
    definition: str


_Messages = Callable[[Collection[int]], Iterable[tuple[int, int, bytes]]]
# Connections, messages of some of them, and what is known to be lacking.
_Bag = tuple[list[_Connection], _Messages, list[str]]


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
    with _opened(path) as (connections, messages, damage):
        found = {one.number: _handler(path, topics, one) for one in connections}
        handlers = {number: handler for number, handler in found.items() if handler is not None}
        for number, stamp, data in _until_damage(messages, handlers, damage):
            handlers[number](data, stamp, stamp)
    remarks = tuple(Remark(kind="truncated", count=1, text=text) for text in damage)
    return topics.result(lambda _: remarks, "".join(f" {text}" for text in damage))


def _handler(path: Path, topics: Topics, one: _Connection) -> Handler | None:
    """What takes the messages of ``one``; None where they are not wanted."""
    topic = topics.open(one.topic, mapping=False)
    if topic is None:
        return None
    return topic.handler(partial(_decoder, path, one), mapping=False)


def sources(path: Path) -> LogContents:
    """Every field that holds a number or an orientation.

    Raises
    ------
    LogError
        It is no bag, or rosbags is not installed.
    """
    listing = Listing(path, KIND)
    require_library("rosbags.typesys", _EXTRA, path)
    with _opened(path) as (connections, messages, damage):
        for one in connections:
            handler = listing.handler(one.topic, partial(_decoder, path, one), mapping=False)
            if handler is not None:
                for _, stamp, data in islice(_until_damage(messages, [one.number], damage), 1):
                    handler(data, stamp, stamp)
    return listing.contents(dict.fromkeys(damage))


def _until_damage(messages: _Messages, wanted: Collection[int], damage: list[str]) -> Iterator[tuple[int, int, bytes]]:
    """The messages of the connections ``wanted``; what ends them early is put into ``damage``."""
    try:
        # To rosbags an empty choice would be every connection.
        for message in messages(wanted) if wanted else ():
            # A damaged index leads to messages of any.
            if message[0] in wanted:
                yield message
    except Exception as error:  # noqa: BLE001 - damaged files make the libraries raise anything
        damage.append(f"The bag is cut or damaged ({str(error)[:100]}); what comes behind was not read.")


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
    reader = require_library("rosbags.rosbag1", _EXTRA, path).Reader(path)
    try:
        reader.open()
    except Exception as error:
        raise _unreadable(path, error, "If it was not closed, `rosbag reindex` mends it; else leave it out.") from error
    reader.chunks = {at: chunk._replace(decompressor=_unpacker(chunk)) for at, chunk in reader.chunks.items()}

    def messages(wanted: Collection[int]) -> Iterator[tuple[int, int, bytes]]:
        chosen = [one for one in reader.connections if one.id in wanted]
        for one, stamp, data in reader.messages(connections=chosen):
            yield one.id, stamp, data

    try:
        yield list(map(_connection, reader.connections)), messages, []
    finally:
        reader.close()


def _connection(one: Any) -> _Connection:
    """As rosbags has it of a ROS 1 bag."""
    return _Connection(number=one.id, topic=one.topic, kind=one.msgtype, encoding="ros1", definition=one.msgdef.data)


def _unpacker(chunk: Any) -> Callable[[bytes], bytes]:
    """What unpacks a chunk of rosbags' and makes no more of it than there is room for."""
    kinds: dict[Any, Any] = {bz2.decompress: bz2.BZ2Decompressor, lz4.frame.decompress: lz4.frame.LZ4FrameDecompressor}
    kind = kinds.get(chunk.decompressor)

    def unpack(data: bytes) -> bytes:
        unpacked: bytes = data if kind is None else kind().decompress(data, max_length=_LARGEST + 1)
        if len(unpacked) > _LARGEST:
            raise ValueError(f"a chunk holds more than {_LARGEST >> 20} MB")
        return unpacked

    return unpack


@contextmanager
def _connected(path: Path) -> Iterator[sqlite3.Connection]:
    """The database; nothing is left beside it.

    Of one that is written ahead SQLite makes a journal and its index where they are not, and leaves them there. Where
    no journal was left there is nothing in it, and the database is read as what cannot change.
    """
    whole = path.resolve()
    journal, index = (whole.with_name(whole.name + end) for end in ("-wal", "-shm"))
    with whole.open("rb") as file:
        ahead = file.read(_HEADER)[_READ_VERSION:] == b"\2"
    how = "mode=ro&immutable=1" if ahead and not journal.exists() else "mode=ro"
    is_ours = ahead and not index.exists()
    try:
        with closing(sqlite3.connect(f"file:{quote(str(whole))}?{how}", uri=True)) as bag:
            yield bag
    finally:
        if is_ours:
            index.unlink(missing_ok=True)


@contextmanager
def _ros2(path: Path) -> Iterator[_Bag]:
    with _connected(path) as bag:
        bag.text_factory = lambda text: text.decode("utf-8", errors="replace")
        bag.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, _LARGEST)
        try:
            names = {name for (name,) in bag.execute(_TABLES)}
            if lacking := {"topics", "messages"} - names:
                raise sqlite3.DatabaseError(f"no table {min(lacking)}")
            # Bags up to ROS 2 Humble do not hold the definitions of their messages.
            definitions = dict(bag.execute(_DEFINITIONS)) if "message_definitions" in names else {}
            connections = _connections(bag, definitions)
            size = _whole_size(bag)
        except (sqlite3.Error, UnicodeDecodeError) as error:  # SQLite quotes what is damaged, text or not
            raise _unreadable(path, error, "Record the log again, or leave it out.") from error
        lost = size - path.stat().st_size
        damage = [f"The bag is cut: {lost} bytes of it are not there."] if lost > 0 else []
        yield connections, lambda wanted: bag.execute(_MESSAGES, (json.dumps(sorted(wanted)),)), damage


def _connections(bag: sqlite3.Connection, definitions: Mapping[str, str]) -> list[_Connection]:
    connections = []
    for number, topic, kind, encoding in bag.execute(_TOPICS):
        text = definitions.get(kind, "")
        one = _Connection(number=number, topic=topic, kind=kind, encoding=encoding, definition=text)
        connections.append(one)
    return connections


def _whole_size(bag: sqlite3.Connection) -> int:
    """Bytes that the file has if it is not cut."""
    ((pages,),) = bag.execute("PRAGMA page_count")
    ((page,),) = bag.execute("PRAGMA page_size")
    return int(pages * page)


def _unreadable(path: Path, error: Exception, mend: str) -> LogError:
    text = f"is a bag that is cut or damaged ({type(error).__name__}: {str(error)[:100]})."
    return LogError(text.replace("\n", " "), where=path, mend=mend)


def _decoder(path: Path, one: _Connection) -> Decoder:
    """What turns the payloads of ``one`` into objects."""
    types = require_library("rosbags.typesys", _EXTRA, path)
    try:
        store = types.get_typestore(types.Stores.EMPTY if one.definition else types.Stores.LATEST)
        if one.definition:
            layouts = types.get_types_from_msg(_short_enough(one.definition), one.kind)
            _count_fields(layouts, one.kind, {})
            store.register(layouts)
    except Exception as error:
        raise LogError(
            f"the type {one.kind} of topic {one.topic!r} cannot be understood ({str(error)[:100]!r}).",
            where=path,
            mend="Convert the bag to MCAP, or leave it out.",
        ) from error
    if one.kind not in store.fielddefs or one.encoding not in {"ros1", "cdr"}:
        raise LogError(
            f"the type {one.kind} of topic {one.topic!r}, encoded as {one.encoding!r}, is not defined in the bag, and "
            f"it is none of ROS 2's own. {suggestion(one.kind, store.fielddefs)}",
            where=path,
            mend="Convert the bag to MCAP where the type is known, or map another topic.",
        )
    decode = store.deserialize_ros1 if one.encoding == "ros1" else store.deserialize_cdr
    return lambda payload: decode(payload, one.kind)


def _short_enough(definition: str) -> str:
    if len(definition) > _LONGEST_DEFINITION:
        raise ValueError(f"its definition is {len(definition)} characters long")
    return definition


def _count_fields(types: Mapping[str, Any], kind: str, known: dict[str, int]) -> int:
    """Fields of ``kind``, those of the types inside it counted; the types in ``known`` have been.

    Raises
    ------
    ValueError
        They are too many, or without end: a type holds itself.
    """
    known[kind] = _MOST_FIELDS  # until it is counted: a type that holds itself is too large
    known[kind] = sum(_count(types, field, known) for _, field in types.get(kind, ((), ()))[1])
    if known[kind] >= _MOST_FIELDS:
        raise ValueError(f"{kind} has more than {_MOST_FIELDS} fields")
    return known[kind]


def _count(types: Mapping[str, Any], field: tuple[int, Any], known: dict[str, int]) -> int:
    """What a field of rosbags' definitions counts for; a fixed array of what is no number, for each of its places."""
    node, description = field
    if node == _NAME:
        return known[description] if description in known else _count_fields(types, description, known)
    if node in {_ARRAY, _SEQUENCE}:
        inside, length = description
        places = length if node == _ARRAY and (inside[0] == _NAME or inside[1][0] == "string") else 1
        return places * _count(types, inside, known)
    return 1
