"""Changes of a file, each from a seed and a number alone."""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from random import Random

from benchmarks.torture.frames import Frame
from benchmarks.torture.samples import FORMATS, Sample, Text, samples

Change = Callable[[Random, bytes], bytes]

_INTEGERS = [0, 1, 2, 7, 8, 127, 128, 255, 256, 65535, 65536, 10**6, 10**9, 2**62]
_INTEGERS += [2**bits + more for bits in (15, 31, 32, 63, 64) for more in (-1, 0, 1)]
_DEEP = 3000
_WEIRD = [
    *(b"\0", b"\0" * 8, b"\xff" * 8, b"\x1b[2J\x1b[31m", b"\x1b]0;title\x07", b"\x7f", b"\xc2\x9b31m", b"\xff\xfe"),
    *(b"\xed\xa0\x80", b"\xf4\x90\x80\x80", "\u202e\u2028".encode(), b"\r", b"\n", b"\r\n\r\n", b"\t", b" "),
    *(b'"', b'""', b"'", b"'''", b"\\", b"\\u0000", b"\\ud800", b"%s%n", b"=1+1", b"[red]", b"[/]", b"#", b"$", b"*"),
    *(b",", b";", b",,,,", b"{", b"}", b"[", b"]", b"=", b".", b":", b"/", b"../", b"null", b"true", b"NaN"),
    *(b"[" * _DEEP, b'{"a":' * _DEEP, b"(" * 200, b"x" * 300, b"x" * 70_000, b"9" * 5000),
]
_NUMBERS = [
    *("nan", "-nan", "inf", "-inf", "1e400", "-1e400", "1e308", "-1e308", "5e-324", "-0.0", "0", "1", "-1", "1_0"),
    *("9" * 20, "9" * 400, "9" * 5000, "0." + "0" * 400 + "1", "0x7fffffff", "1,5", "1e", "--1", "+1", "", "²", "٣"),
    *("9223372036854775807", "9223372036854775808", "-9223372036854775809", "18446744073709551616", "1e15", "1e16"),
    *("2026-01-07", "2026-01-07T12:00:00Z", "0001-01-01", "9999-12-31T23:59:59Z", "24:00:00", "true", '"a"'),
]
_NUMBER = re.compile(rb"[-+]?\d[\d.]*(?:[eE][-+]?\d+)?")
_WORD = re.compile(rb"[A-Za-z_][\w/]*")


@dataclass(frozen=True, kw_only=True)
class Case:
    """What is put where: ``data`` as ``name`` into the folder of ``sample``."""

    sample: Sample
    name: str
    data: bytes


def mutated(format_name: str, seed: int, command: str, number: int) -> Case:
    """A sample with some changes."""
    changed = FORMATS[format_name].changed
    if changed == "nothing":
        sample = samples(format_name)[number]
        return Case(sample=sample, name=sample.name, data=sample.data)
    rng = Random(f"{seed}/{format_name}/{command}/{number}")  # noqa: S311 - nothing secret
    sample = rng.choice(samples(format_name))
    if changed == "name":
        return Case(sample=sample, name=_named(rng, sample.name), data=sample.data)
    return Case(sample=sample, name=sample.name, data=_changed(rng, sample, format_name))


def _changed(rng: Random, sample: Sample, format_name: str) -> bytes:
    data = sample.data
    count = rng.choice((1, 1, 1, 1, 2, 2, 3, 6))
    if sample.frames and rng.random() < 0.5:
        # Frames are known of the file as it was.
        data = rng.choice(_FRAMED)(rng, data, sample.frames)
        count -= 1
    for _ in range(count):
        if rng.random() < 0.03:
            data = _spliced(rng, data, format_name)
        else:
            data = rng.choice(_CHANGES[FORMATS[format_name].text])(rng, data)
    if sample.seal is not None and rng.random() < 0.5:
        data = sample.seal(data)
    return data


def _named(rng: Random, name: str) -> str:
    """Valid file name with random bytes; bytes that are not UTF-8 become surrogates."""
    stem, _, suffix = name.rpartition(".")
    weird = b"".join(rng.choice(_WEIRD) for _ in range(rng.choice((1, 1, 2)))) + rng.randbytes(rng.choice((0, 0, 3)))
    kept = weird.replace(b"/", b"").replace(b"\0", b"")[: rng.choice((8, 100, 240))]
    at = rng.randint(0, len(stem))
    return f"{stem[:at]}{os.fsdecode(kept)}{stem[at:]}.{suffix}"


def _spliced(rng: Random, data: bytes, format_name: str) -> bytes:
    """The beginning, and the end of another file: mostly of this format."""
    other = rng.choice(samples(format_name if rng.random() < 0.8 else rng.choice(_READ))).data
    return data[: _place(rng, data)] + other[_place(rng, other) :]


_READ = [name for name, one in FORMATS.items() if one.changed == "content"]

# Bytes


def _place(rng: Random, data: bytes) -> int:
    """Anywhere, more often near the ends, where the headers are."""
    size = len(data)
    near = rng.random()
    if near < 0.15:
        return min(rng.randrange(256), size)
    if near < 0.3:
        return max(size - rng.randrange(256), 0)
    return rng.randint(0, size)


def _run(rng: Random) -> int:
    return rng.choice((1, 1, 2, 3, 4, 8, 16, 64, 256))


def _flip(rng: Random, data: bytes) -> bytes:
    changed = bytearray(data)
    for _ in range(rng.choice((1, 1, 1, 2, 4, 16)) if changed else 0):
        changed[min(_place(rng, data), len(changed) - 1)] ^= 1 << rng.randrange(8)
    return bytes(changed)


def _put(rng: Random, data: bytes) -> bytes:
    at, run = _place(rng, data), _run(rng)
    new = rng.choice((bytes(run), b"\xff" * run, rng.randbytes(run), rng.randbytes(run)))
    return data[:at] + new + data[at + run :]


def _insert(rng: Random, data: bytes) -> bytes:
    at = _place(rng, data)
    return data[:at] + (rng.choice(_WEIRD) if rng.random() < 0.5 else rng.randbytes(_run(rng))) + data[at:]


def _delete(rng: Random, data: bytes) -> bytes:
    at = _place(rng, data)
    return data[:at] + data[at + _run(rng) :]


def _truncate(rng: Random, data: bytes) -> bytes:
    return data[: _place(rng, data)]


def _repeat(rng: Random, data: bytes) -> bytes:
    at, run = _place(rng, data), 4 * _run(rng)
    return data[:at] + data[at : at + run] * rng.choice((2, 2, 3, 20)) + data[at + run :]


def _swap(rng: Random, data: bytes) -> bytes:
    first, middle, last = sorted(_place(rng, data) for _ in range(3))
    return data[:first] + data[middle:last] + data[first:middle] + data[last:]


def _integer(rng: Random, data: bytes) -> bytes:
    at, size = _place(rng, data), rng.choice((1, 2, 4, 8))
    value = rng.choice(_INTEGERS) * rng.choice((1, 1, -1)) % (1 << 8 * size)
    return data[:at] + value.to_bytes(size, rng.choice(("little", "little", "big"))) + data[at + size :]


def _number(rng: Random, data: bytes) -> bytes:
    """A number in a text becomes another."""
    return _replaced(rng, data, _NUMBER, [number.encode() for number in _NUMBERS])


def _word(rng: Random, data: bytes) -> bytes:
    """A word becomes another of the file, as the name of a type or of a field that is there already."""
    near = _place(rng, data)
    return _replaced(rng, data, _WORD, _WORD.findall(data[max(near - 1000, 0) : near + 1000]) or _WEIRD)


def _replaced(rng: Random, data: bytes, pattern: re.Pattern[bytes], choices: Sequence[bytes]) -> bytes:
    found = pattern.search(data, _place(rng, data))
    if found is None:
        return data
    return data[: found.start()] + rng.choice(choices) + data[found.end() :]


def _lines(rng: Random, data: bytes) -> bytes:
    """A line is lost, doubled, moved, or joined to the next."""
    lines = data.splitlines(keepends=True) or [b""]
    at, way = rng.randrange(len(lines)), rng.randrange(4)
    if way == 0:
        del lines[at]
    elif way == 1:
        lines.insert(rng.randint(0, len(lines)), lines[at])
    elif way == 2:
        lines.insert(rng.randrange(len(lines)), lines.pop(at))
    else:
        lines[at] = lines[at].rstrip(b"\r\n")
    return b"".join(lines)


_BYTES: Sequence[Change] = (_flip, _flip, _put, _insert, _delete, _truncate, _repeat, _swap, _integer, _number, _word)
_LINED: Sequence[Change] = (*_BYTES, _number, _number, _word, _lines, _lines, _insert)

# Under right lengths, and wrong ones


def _wrong_length(rng: Random, data: bytes, frames: Sequence[Frame]) -> bytes:
    frame = rng.choice(frames)
    length, rest = frame.end - frame.start, len(data) - frame.start
    value = rng.choice((*_INTEGERS, *(-one for one in _INTEGERS), length + 1, length - 1, rest, rest + 1, rest - 1))
    return data[: frame.at] + frame.written(value) + data[frame.at + frame.size :]


def _other_content(rng: Random, data: bytes, frames: Sequence[Frame]) -> bytes:
    """Changed bytes in a frame; its length, and that of all around it, is mended."""
    frame = rng.choice(frames)
    inside = rng.choice(_BYTES)(rng, data[frame.start : frame.end])
    longer = len(inside) - (frame.end - frame.start)
    changed = bytearray(data)
    for one in (frame, *(other for other in frames if other.holds(frame))):
        changed[one.at : one.at + one.size] = one.written(one.end - one.start + longer)
    changed[frame.start : frame.end] = inside
    return bytes(changed)


def _moved(rng: Random, data: bytes, frames: Sequence[Frame]) -> bytes:
    """A whole frame is lost, doubled, or takes the place of another."""
    one, other = rng.choice(frames), rng.choice(frames)
    way = rng.randrange(3)
    if way == 0:
        return data[: one.at] + data[one.end :]
    if way == 1:
        return data[: one.end] + data[one.at : one.end] + data[one.end :]
    return data[: other.at] + data[one.at : one.end] + data[other.end :]


_FRAMED = (_wrong_length, _other_content, _other_content, _moved)

# TOML

_VALUE = re.compile(rb"(?<== )[^\n]+|(?<== )\"[^\"\n]*\"")
_STRING = re.compile(rb'"[^"\n]*"')
_KEY = re.compile(rb"^[\w.\"]+(?= *=)|^\[+[\w.]+\]+", re.MULTILINE)
_STRINGS = [
    *('""', '"\\u0000"', '"\\u001b[31m"', '"a\\nb"', '"\\ud800"', '"=1+1"', '"[red]x[/]"', '"..."', '"."', '".."'),
    *('"' + "x" * 300 + '"', '"' + "x" * 100_000 + '"', '"/etc/passwd"', '"/nowhere/at/all.csv"', '"/dev/null"'),
    *("'''a'''", '"dive.csv"', '"rovid.toml"', '"nan"', '"\u202e"', '"\\u0085"', '"a.b.c"', '"a/../../b"'),
]
_VALUES = [
    *("true", "[]", "{}", "[1, 2]", "[[1.0]]", '{ csv = "fore_V" }', "{ csv = 5 }", "{ mcap = [] }", "1979-05-27"),
    *(
        "1979-05-27T07:32:00Z",
        "07:32:00",
        "[" * _DEEP + "]" * _DEEP,
        "[" * 200 + "]" * 200,
        "{ a = " * 300 + "1" + "}" * 300,
    ),
    *(one for one in _NUMBERS if one),
    *_STRINGS,
]


def _toml_value(rng: Random, data: bytes) -> bytes:
    return _replaced(rng, data, _VALUE, [value.encode() for value in _VALUES])


def _toml_string(rng: Random, data: bytes) -> bytes:
    return _replaced(rng, data, _STRING, [value.encode() for value in _STRINGS])


def _toml_key(rng: Random, data: bytes) -> bytes:
    """A key or the name of a table becomes another of the file, or none that is known."""
    keys = [
        *_KEY.findall(data),
        b"unknown",
        b'""',
        b'"\\u0000"',
        b"a.b",
        b"[[vehicle]]",
        b"[thrusters]",
        b"[signals.a]",
    ]
    return _replaced(rng, data, _KEY, keys)


_TOML: Sequence[Change] = (*(_toml_value, _toml_string, _toml_key, _number) * 5, *_LINED)
_CHANGES: Mapping[Text, Sequence[Change]] = {"": _BYTES, "lines": _LINED, "toml": _TOML}
