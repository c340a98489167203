"""ROS 2 messages are decoded as another implementation encodes them."""

from __future__ import annotations

import string
import struct
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap_ros2._dynamic import serialize_dynamic

from rovid.readers.mcap_reader import Message, cdr_decoder

FLOAT32 = st.floats(width=32, allow_nan=False)
NUMBERS: dict[str, st.SearchStrategy[Any]] = {
    "bool": st.booleans(),
    "byte": st.integers(0, 2**8 - 1),
    "char": st.integers(0, 2**7 - 1),  # the other implementation gives it a sign
    "float32": FLOAT32,
    "float64": st.floats(allow_nan=False),
    "string": st.text(st.characters(codec="utf-8", exclude_characters="\0"), max_size=5),
} | {
    f"{sign}int{bits}": st.integers(0, 2**bits - 1) if sign else st.integers(-(2 ** (bits - 1)), 2 ** (bits - 1) - 1)
    for sign in ("", "u")
    for bits in (8, 16, 32, 64)
}
SETTINGS = settings(max_examples=300, deadline=None, derandomize=True)


@st.composite
def written(draw: st.DrawFn) -> tuple[str, dict[str, Any]]:
    """A definition of three messages, each inside the one before, and the fields of one message."""
    texts: list[str] = []
    values: dict[str, Any] = {}
    inner = ""
    for name in ("C", "B", "A"):
        lines, now = [], {}
        for label in string.ascii_lowercase[: draw(st.integers(0, 6))]:
            kind = draw(st.sampled_from([*NUMBERS, *([inner] if inner else [])]))
            one = st.just(values) if kind == inner else NUMBERS[kind]
            form = draw(st.sampled_from(["", "", "[]", "[2]", "[<=3]"]))
            bounded = "<=5" if kind == "string" and draw(st.booleans()) else ""
            lines.append(f"{kind}{bounded}{form}  {label}  # {draw(st.sampled_from(['', 'm', '= 3', '[deg]']))}")
            many = st.lists(one, min_size=2, max_size=2) if form == "[2]" else st.lists(one, max_size=3)
            now[label] = draw(many if form else one)
        lines.insert(draw(st.integers(0, len(lines))), draw(st.sampled_from(["", "# text", "uint8 MODE_A=1", "\t"])))
        texts.insert(0, "\n".join(lines))
        values, inner = now, f"test_msgs/{name}"
    return f"\n{'=' * 80}\n".join([texts[0], f"MSG: test_msgs/B\n{texts[1]}", f"MSG: test_msgs/C\n{texts[2]}"]), values


def plain(value: Any) -> Any:
    if isinstance(value, Message):
        return {name: plain(member) for name, member in vars(value).items()}
    if isinstance(value, bytes | list):
        return [plain(member) for member in value]
    return value


@SETTINGS
@given(one=written())
def test_messages_of_another_implementation(one: tuple[str, dict[str, Any]]) -> None:
    text, values = one
    data = serialize_dynamic("test_msgs/msg/A", text)["test_msgs/msg/A"](values)
    decode = cdr_decoder("test_msgs/msg/A", text)
    assert plain(decode(data)) == values
    for size in range(4, len(data)):
        if data[size:].strip(b"\0"):  # the last alignment and an empty text may be left out
            with pytest.raises(ValueError, match=r"shorter|codec"):
                decode(data[:size])


def test_the_order_of_bytes() -> None:
    decode = cdr_decoder("a/A", "uint8 a\nuint32 b\nfloat64[] c")
    for kind, order in ((0, ">"), (1, "<")):
        data = bytes([0, kind, 0, 0]) + struct.pack(f"{order}BxxxIIxxxxd", 1, 2, 1, 3.0)
        assert plain(decode(data)) == {"a": 1, "b": 2, "c": [3.0]}


def test_times_need_no_definition() -> None:
    data = b"\0\1\0\0" + struct.pack("<IIII", 1, 2, 3, 4)
    times = {"sec": 1, "nanosec": 2}, {"sec": 3, "nanosec": 4}
    for text in ("builtin_interfaces/Time a\nbuiltin_interfaces/msg/Duration b", "time a\nduration b"):
        assert plain(cdr_decoder("a/A", text)(data)) == dict(zip("ab", times, strict=True))


def test_defaults_and_constants_take_no_bytes() -> None:
    text = "uint8 ONE=1\nstring NAME = 'a # b'\nuint8 a 7 # seven\nint8[] b [1, 2]\nuint8 TWO =2\n===\n"
    assert plain(cdr_decoder("a/A", text)(b"\0\1\0\0" + bytes(8))) == {"a": 0, "b": []}


BAD = {
    "float64": "is no field",
    "float64 1a": "is no field",
    "float64[ a": "is no field",
    "float64 a\nfloat32 a": "two fields are called 'a'",
    "Other a": "'a/Other' is not defined",
    "wstring a": "'a/wstring' is not defined, or not supported",
    "float64 a\n===\nfloat64 b": "does not name the message",
}


@pytest.mark.parametrize("text", BAD)
def test_definitions_that_make_no_sense(text: str) -> None:
    with pytest.raises(ValueError, match=BAD[text]):
        cdr_decoder("a/A", text)
