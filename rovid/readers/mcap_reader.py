"""MCAP recordings: the mapped fields of the mapped topics, decoded from JSON, protobuf or ROS 2 messages.

A core install reads ROS 2 messages with this module alone. It decodes each run of plain numbers with one compiled
`struct`.
"""

from __future__ import annotations

import io
import json
import re
import struct
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import cache, partial
from itertools import groupby
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from mcap.records import Channel, Schema

from rovid.core.errors import LogError
from rovid.readers.mcap_container import MAX_MESSAGE, McapFile
from rovid.readers.message_topics import Decoder, Handler, TopicExtractor, TopicListing
from rovid.readers.raw_log import LogContents, RawLog, required_signals
from rovid.trial.config import Config
from rovid.trial.trial import Remark

# Type in ros2msg -> letter of `struct`.
_NUMBERS = {
    "bool": "?",
    "byte": "B",
    "char": "B",
    "int8": "b",
    "uint8": "B",
    "int16": "h",
    "uint16": "H",
    "int32": "i",
    "uint32": "I",
    "int64": "q",
    "uint64": "Q",
    "float32": "f",
    "float64": "d",
}
_SEPARATOR = re.compile(r"={3,}")
_TYPE = re.compile(r"(?P<kind>[A-Za-z][\w/]*)(<=\d+)?(?P<list>\[((<=)?\d+)?\])?", re.ASCII)
_NAME = re.compile(r"[A-Za-z]\w*", re.ASCII)


@dataclass(frozen=True, slots=True)
class _Type:
    """``kind``, or a list of ``count`` of it; of a count that the message holds if ``count`` is 0."""

    kind: str
    is_list: bool = False
    count: int = 0


class Message(SimpleNamespace):
    """A decoded message with its fields as attributes."""


_Fields = dict[str, _Type]
_STAMP = {"sec": _Type("uint32"), "nanosec": _Type("uint32")}
# Types that need no definition, and their short names.
_BUILTIN = {"builtin_interfaces/Time": _STAMP, "builtin_interfaces/Duration": _STAMP}
_SHORT = {"time": "builtin_interfaces/Time", "duration": "builtin_interfaces/Duration"}


# --- definitions --------------------------------------------------------------------------------------------------


def _parse_definitions(name: str, text: str) -> dict[str, _Fields]:
    """Type -> fields of each definition in ``text``; the first is ``name``, each separator begins another."""
    definitions: dict[str, _Fields] = dict(_BUILTIN)
    fields = definitions[_short_name(name)] = {}
    package = name.partition("/")[0]
    is_named = True
    for line in text.splitlines():
        words = line.partition("#")[0].split(None, 2)
        if not words:
            continue
        is_constant = len(words) > 1 and ("=" in words[1] or words[-1].startswith("="))
        if len(words) == 1 and _SEPARATOR.fullmatch(words[0]):
            is_named = False
        elif not is_named:
            if len(words) != 2 or words[0] != "MSG:":
                raise ValueError(f"{line[:60]!r} does not name the message that is defined next")
            fields = definitions[_short_name(words[1])] = {}
            package, is_named = words[1].partition("/")[0], True
        elif not is_constant:
            kind = _parse_type(words[0], package)
            if kind is None or len(words) == 1 or not _NAME.fullmatch(words[1]):
                raise ValueError(f"{' '.join(words)[:60]!r} is no field")
            if words[1] in fields:
                raise ValueError(f"two fields are called {words[1][:60]!r}")
            fields[words[1]] = kind
    return definitions


def _short_name(name: str) -> str:
    """``std_msgs/Header`` of ``std_msgs/msg/Header``."""
    parts = name.split("/")
    return f"{parts[0]}/{parts[-1]}"


def _parse_type(text: str, package: str) -> _Type | None:
    match = _TYPE.fullmatch(text)
    if match is None:
        return None
    kind = _SHORT.get(match["kind"], match["kind"])
    if kind not in _NUMBERS and kind != "string":
        kind = _short_name(kind) if "/" in kind else f"{package}/{kind}"
    brackets = match["list"] or ""
    count = int(brackets[1:-1]) if brackets[1:-1].isdigit() else 0
    return _Type(kind, is_list=bool(brackets), count=count)


# --- bytes --------------------------------------------------------------------------------------------------------


@dataclass(slots=True)
class _Cursor:
    """Position ``at`` in the bytes after a message's header; ``order`` is the byte order of `struct`."""

    data: bytes
    order: str
    at: int = 0

    def take(self, count: int) -> bytes:
        if count > len(self.data) - self.at:
            raise ValueError("it is shorter than its definition")
        self.at += count
        return self.data[self.at - count : self.at]

    def numbers(self, letter: str, count: int) -> list[Any]:
        size = struct.calcsize(letter)
        if count:  # An empty list is not aligned.
            self.take(-self.at % size)
        return list(struct.unpack(f"{self.order}{count}{letter}", self.take(count * size)))

    def count(self) -> int:
        self.take(-self.at % 4)
        return int.from_bytes(self.take(4), "little" if self.order == "<" else "big")

    def string(self) -> str:
        return self.take(self.count())[:-1].decode()  # Without the final NUL.


_Step = Callable[[_Cursor, dict[str, Any]], object]
_Steps = dict[str, list[_Step]]


def _number_step(names: tuple[str, ...], letters: str) -> _Step:
    """Decode consecutive numbers; their alignment depends on the position of the first."""
    layout_at = cache(partial(_layout, letters))

    def step(cursor: _Cursor, values: dict[str, Any]) -> None:
        layout = layout_at(cursor.at % 8, cursor.order)
        values.update(zip(names, layout.unpack(cursor.take(layout.size)), strict=True))

    return step


def _layout(letters: str, at: int, order: str) -> struct.Struct:
    text = order
    for letter in letters:
        size = struct.calcsize(letter)
        gap = -at % size
        text += "x" * gap + letter
        at += gap + size
    return struct.Struct(text)


def _other_step(name: str, read: Callable[[_Cursor], Any]) -> _Step:
    def step(cursor: _Cursor, values: dict[str, Any]) -> None:
        values[name] = read(cursor)

    return step


def _reader(kind: _Type, steps: _Steps) -> Callable[[_Cursor], Any]:
    """Function that decodes any value but a single number."""
    if not kind.is_list and kind.kind == "string":
        return _Cursor.string
    if not kind.is_list:
        return lambda cursor: _read_message(steps[kind.kind], cursor)
    if kind.kind in {"byte", "uint8"}:
        return lambda cursor: cursor.take(kind.count or cursor.count())
    if kind.kind in _NUMBERS:
        letter = _NUMBERS[kind.kind]
        return lambda cursor: cursor.numbers(letter, kind.count or cursor.count())
    read_one = _reader(_Type(kind.kind), steps)
    return lambda cursor: [read_one(cursor) for _ in range(kind.count or cursor.count())]


def _read_message(steps: list[_Step], cursor: _Cursor) -> Message:
    message = Message()
    values = vars(message)
    for step in steps:
        step(cursor, values)
    return message


def _steps_of(fields: _Fields, steps: _Steps) -> Iterator[_Step]:
    if not fields:  # Such a message takes one byte.
        yield lambda cursor, _: cursor.take(1)
    for is_number, group in groupby(fields.items(), lambda item: item[1].kind in _NUMBERS and not item[1].is_list):
        if is_number:
            names, kinds = zip(*group, strict=True)
            yield _number_step(names, "".join(_NUMBERS[kind.kind] for kind in kinds))
            continue
        for name, kind in group:
            yield _other_step(name, _reader(kind, steps))


def _linked(root: str, definitions: Mapping[str, _Fields]) -> _Steps:
    """Steps to decode ``root`` and all types inside it."""
    steps: _Steps = {}
    waiting = [root]
    while waiting:
        name = waiting.pop()
        if name in steps:
            continue
        if name not in definitions:
            raise ValueError(f"the type {name[:60]!r} is not defined, or not supported")
        fields = definitions[name]
        steps[name] = list(_steps_of(fields, steps))
        waiting += {one.kind for one in fields.values()} - {*_NUMBERS, "string"}
    return steps


def cdr_decoder(name: str, text: str) -> Callable[[bytes], Any]:
    """Function that decodes messages of the type ``name``, which ``text`` defines; `ValueError` for damage."""
    root = _short_name(name)
    steps = _linked(root, _parse_definitions(name, text))[root]

    def decode(payload: bytes) -> Any:
        if len(payload) < 4:
            raise ValueError("it is shorter than its header")
        order = "<" if payload[1] & 1 else ">"
        return _read_message(steps, _Cursor(payload[4:], order))

    return decode


KIND = "mcap"


def read(path: Path, config: Config) -> RawLog:
    """Mapped fields of ``path``.

    ``time = { mcap = … }`` selects the clock: "log" (time of recording; the default), "publish", "header" (the
    message's own stamp), or a field of each message.
    """
    signals = required_signals(config, KIND, path)
    topics = TopicExtractor(path, KIND, signals, config.time)
    recording = _read_messages(path, topics.handler)
    if recording.missed > 0 and not recording.too_large:  # Messages outside the index are rare, but legal.
        topics = TopicExtractor(path, KIND, signals, config.time)
        recording = _read_messages(path, topics.handler, by_index=False)
    for topic, size in recording.too_large.items():
        text = f"topic {topic!r} has a message of {size / 1e6:.1f} MB; at most {MAX_MESSAGE / 1e6:.1f} MB was expected."
        raise LogError(text, where=path, mend="Map a topic of smaller messages.")
    unread = recording.size - recording.end
    damage = f" The recording is cut: {recording.damage}, {unread} bytes were not read." if recording.damage else ""
    return topics.result(lambda last: _damage_remarks(recording, last), damage)


def sources(path: Path) -> LogContents:
    """Every field that holds a number or an orientation."""
    listing = TopicListing(path, KIND)
    _read_messages(path, listing.handler)
    return listing.contents()


def _read_messages(path: Path, make_handler: Callable[..., Handler | None], *, by_index: bool = True) -> McapFile:
    """Read a file whose channels get their handlers from ``make_handler(topic, make_decoder, mapping=...)``."""

    def open_channel(channel: Channel, schema: Schema | None) -> Handler | None:
        is_json = channel.message_encoding == "json"
        return make_handler(channel.topic, lambda: _decoder(channel, schema, str(path)), mapping=is_json)

    with path.open("rb", buffering=1 << 16) as file:
        recording = McapFile(path=path, size=file.seek(0, io.SEEK_END), file=file, open_channel=open_channel)
        recording.read(by_index=by_index)
    return recording


def _damage_remarks(recording: McapFile, last: float) -> tuple[Remark, ...]:
    if not recording.damage:
        return ()
    unread = recording.size - recording.end
    text = (
        f"The recording is cut or damaged: {recording.damage}. {unread} of {recording.size} bytes were not "
        f"read; the last time read is {last:.1f} s after the first."
    )
    if recording.rescued:
        text += f" {recording.rescued} messages were rescued from its last chunk."
    return (Remark(kind="truncated", count=unread, text=text),)


def _decoder(channel: Channel, schema: Schema | None, where: str) -> Decoder:
    """Function that turns payloads into objects; `LogError` if encoding or schema cannot be read."""
    encodings = channel.message_encoding, schema.encoding if schema else ""
    try:
        if encodings[0] == "json":
            return lambda payload: json.loads(str(payload, "utf-8"))
        if schema is not None and encodings == ("cdr", "ros2msg"):
            return cdr_decoder(schema.name, schema.data.decode())
        if schema is not None and encodings == ("protobuf", "protobuf"):
            from mcap_protobuf.decoder import DecoderFactory

            if decoder := DecoderFactory().decoder_for("protobuf", schema):
                return decoder
    except Exception as error:  # Libraries raise any exception on damaged schemas.
        reason = f"{type(error).__name__}: {error}"[:120].split("\n", 1)[0]
        text = f"the schema of topic {channel.topic!r} cannot be parsed ({reason})."
        raise LogError(text, where=where, mend="Record the log again, or leave it out.") from error
    of_schema = f" with schema {encodings[1]!r}" if encodings[1] else " without a schema"
    text = (
        f"topic {channel.topic!r} is encoded as {encodings[0]!r}{of_schema}; json, cdr with ros2msg, or protobuf "
        "with protobuf was expected."
    )
    raise LogError(text, where=where, mend="Convert the recording (`mcap convert`), or map a topic in one of these.")
