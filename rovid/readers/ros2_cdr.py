"""ROS 2 messages in recordings: definitions as text (ros2msg), and decoders of their bytes (CDR).

A core install reads ROS 2 messages in MCAP with this module alone. It decodes each run of plain numbers with one
compiled `struct`.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import cache, partial
from itertools import groupby
from types import SimpleNamespace
from typing import Any

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
