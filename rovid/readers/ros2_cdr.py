"""ROS 2 messages as recordings hold them: definitions as text (ros2msg), and the bytes they lay out (CDR).

The libraries for it take a time that grows with the square of a definition's length; a damaged or hostile definition
must not.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import lru_cache
from itertools import groupby
from types import SimpleNamespace
from typing import Any

# One message may hold this many others, and this deep: each takes a hundred times the memory of its bytes.
_MESSAGES, _DEPTH = 100_000, 64
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
_RAW = ("byte", "uint8")  # lists of these are bytes
_SEPARATOR = re.compile(r"={3,}")
_TYPE = re.compile(r"(?P<kind>[A-Za-z][\w/]*)(<=\d+)?(?P<list>\[((<=)?\d+)?\])?", re.ASCII)
_NAME = re.compile(r"[A-Za-z]\w*", re.ASCII)


@dataclass(frozen=True, slots=True)
class _Type:
    """``kind`` by itself, or a list of it: of ``count``, or of as many as the message says where that is 0."""

    kind: str
    is_list: bool = False
    count: int = 0


class Message(SimpleNamespace):
    """What a message holds, by the names of its fields."""


_Fields = dict[str, _Type]
_SECONDS = {"sec": _Type("uint32"), "nanosec": _Type("uint32")}
# Definitions may leave these out.
_BUILTIN = {"builtin_interfaces/Time": _SECONDS, "builtin_interfaces/Duration": _SECONDS}
_SHORT = {"time": "builtin_interfaces/Time", "duration": "builtin_interfaces/Duration"}


# --- definitions --------------------------------------------------------------------------------------------------


def _definitions(name: str, text: str) -> dict[str, _Fields]:
    """Fields of each message that ``text`` defines; the first is ``name``, behind each separator another begins."""
    definitions: dict[str, _Fields] = dict(_BUILTIN)
    fields = definitions[_full(name)] = {}
    package = name.partition("/")[0]
    named = True
    for line in text.splitlines():
        words = line.partition("#")[0].split(None, 2)
        if not words:
            continue
        if len(words) == 1 and _SEPARATOR.fullmatch(words[0]):
            named = False
        elif not named:
            if len(words) != 2 or words[0] != "MSG:":
                raise ValueError(f"{line[:60]!r} does not name the message that is defined next")
            fields = definitions[_full(words[1])] = {}
            package, named = words[1].partition("/")[0], True
        elif not _constant(words):
            label, kind = _field(words, package)
            if label in fields:
                raise ValueError(f"two fields are called {label[:60]!r}")
            fields[label] = kind
    return definitions


def _full(name: str) -> str:
    """``std_msgs/Header`` of ``std_msgs/msg/Header``."""
    parts = name.split("/")
    return f"{parts[0]}/{parts[-1]}"


def _constant(words: list[str]) -> bool:
    return len(words) > 1 and ("=" in words[1] or words[-1].startswith("="))


def _field(words: list[str], package: str) -> tuple[str, _Type]:
    kind = _type(words[0], package)
    if kind is None or len(words) == 1 or not _NAME.fullmatch(words[1]):
        raise ValueError(f"{' '.join(words)[:60]!r} is no field")
    return words[1], kind


@lru_cache(1000)
def _type(text: str, package: str) -> _Type | None:
    match = _TYPE.fullmatch(text)
    if match is None:
        return None
    kind = _SHORT.get(match["kind"], match["kind"])
    if kind not in _NUMBERS and kind != "string":
        kind = _full(kind) if "/" in kind else f"{package}/{kind}"
    brackets = match["list"] or ""
    size = brackets[1:-1]
    count = int(size) if size.isdigit() else 0
    return _Type(kind, is_list=bool(brackets), count=count)


# --- bytes --------------------------------------------------------------------------------------------------------


@dataclass(slots=True)
class _Cursor:
    """Where reading stands in the bytes behind a message's head."""

    data: bytes
    order: str
    at: int = 0
    messages: int = 0
    depth: int = 0

    def take(self, count: int) -> bytes:
        if count > len(self.data) - self.at:
            raise ValueError("it is shorter than its definition")
        self.at += count
        return self.data[self.at - count : self.at]

    def numbers(self, code: str, count: int) -> list[Any]:
        size = struct.calcsize(code)
        if count:  # where there are none, nothing is aligned
            self.take(-self.at % size)
        return list(struct.unpack(f"{self.order}{count}{code}", self.take(count * size)))

    def count(self) -> int:
        self.take(-self.at % 4)
        return int.from_bytes(self.take(4), "little" if self.order == "<" else "big")

    def string(self) -> str:
        return self.take(self.count())[:-1].decode()  # the last is NUL


_Step = Callable[[_Cursor, dict[str, Any]], None]
_Steps = dict[str, list[_Step]]


def _run(names: tuple[str, ...], codes: str) -> _Step:
    """Reads numbers that follow each other; how they are aligned depends on where the first one is."""
    layouts: dict[tuple[int, str], struct.Struct] = {}

    def step(cursor: _Cursor, values: dict[str, Any]) -> None:
        place = cursor.at % 8, cursor.order
        layout = layouts.get(place)
        if layout is None:
            layout = layouts[place] = _layout(codes, *place)
        values.update(zip(names, layout.unpack(cursor.take(layout.size)), strict=True))

    return step


def _layout(codes: str, at: int, order: str) -> struct.Struct:
    parts = [order]
    for code in codes:
        size = struct.calcsize(code)
        gap = -at % size
        parts.append("x" * gap + code)
        at += gap + size
    return struct.Struct("".join(parts))


def _other(name: str, read: Callable[[_Cursor], Any]) -> _Step:
    def step(cursor: _Cursor, values: dict[str, Any]) -> None:
        values[name] = read(cursor)

    return step


def _reader(kind: _Type, steps: _Steps) -> Callable[[_Cursor], Any]:
    """What reads anything but a single number."""
    if not kind.is_list and kind.kind == "string":
        return _Cursor.string
    if not kind.is_list:
        return lambda cursor: _message(steps[kind.kind], cursor)
    if kind.kind in _RAW:
        return lambda cursor: cursor.take(kind.count or cursor.count())
    if kind.kind in _NUMBERS:
        code = _NUMBERS[kind.kind]
        return lambda cursor: cursor.numbers(code, kind.count or cursor.count())
    one = _reader(_Type(kind.kind), steps)
    return lambda cursor: [one(cursor) for _ in range(kind.count or cursor.count())]


def _message(steps: list[_Step], cursor: _Cursor) -> Message:
    cursor.messages += 1
    cursor.depth += 1
    if cursor.messages > _MESSAGES or cursor.depth > _DEPTH:
        raise ValueError("it holds too many messages inside, or one inside another too deep")
    message = Message()
    values = vars(message)
    for step in steps:
        step(cursor, values)
    cursor.depth -= 1
    return message


def _nothing(cursor: _Cursor, _: dict[str, Any]) -> None:
    """Reads the one byte that ROS 2 gives a message without fields."""
    cursor.take(1)


def _steps(fields: _Fields, steps: _Steps) -> Iterator[_Step]:
    readers = {kind: _reader(kind, steps) for kind in set(fields.values())}
    if not fields:
        yield _nothing
    for plain, group in groupby(fields.items(), lambda one: one[1].kind in _NUMBERS and not one[1].is_list):
        run = list(group)
        if plain:
            names, kinds = zip(*run, strict=True)
            yield _run(names, "".join(_NUMBERS[kind.kind] for kind in kinds))
            continue
        for name, kind in run:
            yield _other(name, readers[kind])


def _linked(root: str, definitions: Mapping[str, _Fields]) -> _Steps:
    """How to read ``root`` and all that is inside it."""
    steps: _Steps = {}
    waiting = [root]
    while waiting:
        name = waiting.pop()
        if name in steps:
            continue
        if name not in definitions:
            raise ValueError(f"the type {name[:60]!r} is not defined, or not supported")
        fields = definitions[name]
        steps[name] = list(_steps(fields, steps))
        waiting += {one.kind for one in fields.values()} - {*_NUMBERS, "string"}
    return steps


def decoder(name: str, text: str) -> Callable[[bytes], Any]:
    """What turns a message of the type ``name``, which ``text`` defines, into an object with its fields.

    Raises
    ------
    ValueError
        The definition makes no sense; the message does not follow it, when one is decoded.
    """
    root = _full(name)
    steps = _linked(root, _definitions(name, text))[root]

    def decode(payload: bytes) -> Any:
        if len(payload) < 4:
            raise ValueError("it is shorter than its head")
        order = "<" if payload[1] & 1 else ">"
        return _message(steps, _Cursor(payload[4:], order))

    return decode
