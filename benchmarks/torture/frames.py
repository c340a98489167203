"""Where the length fields of a file are, so that its content can be changed under a right length, or a wrong one."""

from __future__ import annotations

import re
import struct
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import reduce
from operator import xor

from pymavlink.dialects.v20 import ardupilotmega as mavlink
from pymavlink.generator.mavcrc import x25crc

_MCAP_MAGIC = 8
_SCHEMA, _CHANNEL, _CHUNK = 3, 4, 6
_CHUNK_HEAD = 28
_SENTENCE = re.compile(rb"\$([^*\r\n]*)\*[0-9A-F]{2}")


@dataclass(frozen=True, kw_only=True)
class Frame:
    """``size`` bytes at ``at`` hold the length of what stands between ``start`` and ``end``."""

    at: int
    size: int
    start: int
    end: int

    def written(self, length: int) -> bytes:
        """``length`` as it stands in the file, cut to the field's size."""
        return (length % (1 << (8 * self.size))).to_bytes(self.size, "little")

    def holds(self, other: Frame) -> bool:
        """Whether ``other`` lies within."""
        return self.start <= other.at and other.end <= self.end and other is not self


def _prefixed(data: bytes, at: int, size: int) -> Frame:
    length = int.from_bytes(data[at : at + size], "little")
    return Frame(at=at, size=size, start=at + size, end=at + size + length)


def _in_turn(data: bytes, at: int, size: int, count: int) -> Iterator[Frame]:
    for _ in range(count):
        frame = _prefixed(data, at, size)
        yield frame
        at = frame.end


def mcap_frames(data: bytes) -> tuple[Frame, ...]:
    """Records, those in chunks that are not compressed too, and the texts in schemas and channels."""
    return tuple(_mcap_records(data, _MCAP_MAGIC, len(data) - _MCAP_MAGIC))


def _mcap_records(data: bytes, at: int, end: int) -> Iterator[Frame]:
    while at < end:
        kind, record = data[at], _prefixed(data, at + 1, 8)
        yield record
        if kind == _SCHEMA:
            yield from _in_turn(data, record.start + 2, 4, 3)
        elif kind == _CHANNEL:
            yield from _in_turn(data, record.start + 4, 4, 3)
        elif kind == _CHUNK:
            name = _prefixed(data, record.start + _CHUNK_HEAD, 4)
            inside = _prefixed(data, name.end, 8)
            yield name
            yield inside
            if name.start == name.end:
                yield from _mcap_records(data, inside.start, inside.end)
        at = record.end


def bag_frames(data: bytes) -> tuple[Frame, ...]:
    """Headers, each of their fields, and data, those in chunks that are not compressed too."""
    return tuple(_bag_records(data, data.index(b"\n") + 1, len(data)))


def _bag_records(data: bytes, at: int, end: int) -> Iterator[Frame]:
    while at < end:
        header = _prefixed(data, at, 4)
        content = _prefixed(data, header.end, 4)
        yield header
        field = header.start
        while field < header.end:
            frame = _prefixed(data, field, 4)
            yield frame
            field = frame.end
        yield content
        if b"compression=none" in data[header.start : header.end]:
            yield from _bag_records(data, content.start, content.end)
        at = content.end


def ulog_frames(data: bytes) -> tuple[Frame, ...]:
    """Messages; the byte of their kind is not counted."""
    found, at = [], 16
    while at < len(data):
        length = int.from_bytes(data[at : at + 2], "little")
        found.append(Frame(at=at, size=2, start=at + 3, end=at + 3 + length))
        at = found[-1].end
    return tuple(found)


def tlog_frames(data: bytes) -> tuple[Frame, ...]:
    """Payloads of the frames."""
    return tuple(frame for frame, _ in _mavlink(data))


def _mavlink(data: bytes) -> Iterator[tuple[Frame, int]]:
    """Payloads and message numbers of consecutive frames, up to the first gap."""
    at = 8
    while at + 10 < len(data) and data[at] in b"\xfd\xfe":
        new = data[at] == 0xFD
        start = at + (10 if new else 6)
        end = start + data[at + 1]
        if end + 2 > len(data):
            return
        number = int.from_bytes(data[start - 3 : start], "little") if new else data[start - 1]
        yield Frame(at=at + 1, size=1, start=start, end=end), number
        at = end + 2 + (13 if new and data[at + 2] & 1 else 0) + 8


def sealed_tlog(data: bytes) -> bytes:
    """With the checksums of all frames right."""
    mended = bytearray(data)
    for frame, number in _mavlink(data):
        kind = mavlink.mavlink_map.get(number)
        if kind is not None:
            checksum = x25crc(data[frame.at : frame.end])
            checksum.accumulate(bytes([kind.crc_extra]))
            struct.pack_into("<H", mended, frame.end, checksum.crc)
    return bytes(mended)


def sealed_nmea(data: bytes) -> bytes:
    """With the checksums of all sentences right."""
    return _SENTENCE.sub(lambda one: b"$%b*%02X" % (one[1], reduce(xor, one[1], 0)), data)


# Lengths at which a cut shows nothing: formats that have no end of their own, between one record and the next


def table_ends(data: bytes) -> frozenset[int]:
    """Of lines; a last cell that is cut is still a number."""
    return _line_ends(data, lambda line: line.rindex(b",") + 2)


def sentence_ends(data: bytes) -> frozenset[int]:
    """Of sentences, with or without the end of the line."""
    return _line_ends(data, lambda line: len(line.rstrip()))


def _line_ends(data: bytes, least: Callable[[bytes], int]) -> frozenset[int]:
    found, at = set(), 0
    for line in data.splitlines(keepends=True):
        found |= set(range(at + least(line), at + len(line) + 1))
        at += len(line)
    return frozenset(found)


def ulog_ends(data: bytes) -> frozenset[int]:
    """Of messages."""
    return frozenset(frame.end for frame in ulog_frames(data))


def tlog_ends(data: bytes) -> frozenset[int]:
    """Of frames, behind their checksum."""
    return frozenset(frame.end + 2 for frame in tlog_frames(data))


def dataflash_ends(data: bytes) -> frozenset[int]:
    """Of messages: where the next begins."""
    return frozenset(found.start() for found in re.finditer(b"\xa3\x95", data))
