"""The container of MCAP: finds the messages of wanted channels, whole file or cut, and touches little else.

Records come from the mcap library's own definitions; the loop over messages, the use of the index, and what
is done about damage are ours, because a crash-cut recording of some gigabytes of camera images must give up
its heading in seconds and in little memory.
"""

from __future__ import annotations

import io
import struct
import zlib
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import BinaryIO

from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, ChunkIndex, Footer, Schema, Statistics

from rovid.core.errors import LogError
from rovid.readers.mcap_chunks import COMPRESSIONS, Damage, unpacked, verify
from rovid.readers.topic_extractor import Handler

MAGIC = b"\x89MCAP0\r\n"
_FOOTER = 9 + 20 + len(MAGIC)
# Opcodes at which the loop over records stops: the caller deals with them.
_STRUCTURE = frozenset({0, Opcode.CHUNK, Opcode.DATA_END, Opcode.FOOTER})
_BLOCK = 1 << 18
_LARGE = 1 << 16
# The largest message, schema or channel that is read, for its contents take up to thirty times the memory; what all
# schemas and channels may take; and the largest summary that is read: without it the file is scanned.
LARGEST, _DECLARED, _SUMMARY = 4 << 20, 64 << 20, 32 << 20
# A chunk may claim to be this large when unpacked, or this much larger than it is packed; all chunks together may be
# that large, or this much larger than the file.
_CHUNK_BYTES, _CHUNK_RATIO, _FILE_RATIO = 64 << 20, 100, 1000
# A chunk up to this size is unpacked once and held, a larger one twice: to test it, and to read it.
_HELD = 16 << 20

_HEAD = struct.Struct("<BQ")
_HEAD_ID = struct.Struct("<BQH")
_STAMPS = struct.Struct("<QQ")
_CHUNK = struct.Struct("<QQQII")

_Places = list[tuple[int, int]]  # (offset, length)


@dataclass(kw_only=True, eq=False)
class Recording:
    """An MCAP file that is being read.

    Attributes
    ----------
    path, size
        The file and its bytes.
    open_channel
        Called once for each channel; returns what takes its messages, or None where nobody wants them.
    end
        Where the part that was read whole ends, in bytes.
    damage
        Why reading ended early; empty where it did not.
    rescued
        Messages taken from a chunk that is cut inside.
    taken, missed
        Messages handed over, and how many more the summary counts than its index led to.
    too_large
        Wanted topics with a message above `LARGEST`, and its size in bytes; what else they hold is not read either.
    """

    path: Path
    size: int
    file: BinaryIO
    open_channel: Callable[[Channel, Schema | None], Handler | None]
    end: int = len(MAGIC)
    damage: str = ""
    rescued: int = 0
    taken: int = 0
    missed: int = 0
    too_large: dict[str, int] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)
    handlers: dict[int, Handler] = field(default_factory=dict)
    _schemas: dict[int, Schema] = field(default_factory=dict)
    _declared: int = 0  # bytes of schemas and channels
    _claimed: int = 0  # bytes that the chunks so far are said to hold
    _skipped: _Places = field(default_factory=list)

    def read(self, *, by_index: bool = True) -> None:
        """Give every message of a wanted channel to its handler, in the order of the file.

        Raises
        ------
        LogError
            The file is no MCAP file or packs its chunks in an unknown way.
        """
        if self._bytes(0, len(MAGIC)) != MAGIC:
            text = "is not an MCAP file: it does not begin with the bytes that mark one."
            raise LogError(text, where=self.path, mend="Export the log again, or give it the suffix of its format.")
        summary = self._summary() if by_index else None
        try:
            if summary is not None:
                self._indexed(*summary)
            else:
                self._scan()
        except Damage as damage:
            self.damage = str(damage)

    def _bytes(self, offset: int, count: int) -> bytes:
        """What the file has of these: a record may claim any length, beyond what a file can have."""
        if offset >= self.size:
            return b""
        self.file.seek(offset)
        return self.file.read(min(count, self.size - offset))

    # --- with an index -----------------------------------------------------------------------------------

    def _summary(self) -> tuple[_Places, Statistics] | None:
        """The chunks to read, in their order; None unless the summary is whole and covers every message."""
        tail = self._bytes(max(0, self.size - _FOOTER), _FOOTER)
        if len(tail) < _FOOTER or not tail.endswith(MAGIC) or _HEAD.unpack_from(tail) != (Opcode.FOOTER, 20):
            return None
        footer = Footer.read(ReadDataStream(io.BytesIO(tail[9:])))
        start, end = footer.summary_start, self.size - _FOOTER
        if not len(MAGIC) <= start < end <= start + _SUMMARY:
            return None
        data = self._bytes(start, end - start)
        if footer.summary_crc and zlib.crc32(tail[:25], zlib.crc32(data)) != footer.summary_crc:
            return None
        try:
            summary = self._parse_summary(data, start)
        except (McapError, ValueError, struct.error, Damage):  # an index is a help; without it the file is scanned
            summary = None
        if summary is None:
            self._forget()
        return summary

    def _forget(self) -> None:
        self.channels.clear()
        self.handlers.clear()
        self._schemas.clear()
        self._declared = 0

    def _parse_summary(self, data: bytes, start: int) -> tuple[_Places, Statistics] | None:
        for body in _bodies(data, Opcode.SCHEMA):
            self._declare(Opcode.SCHEMA, body)
        channels = [Channel.read(_stream(body)) for body in _bodies(data, Opcode.CHANNEL)]
        if not {channel.schema_id for channel in channels} <= {0, *self._schemas}:
            return None  # a summary may repeat channels, and leave their schemas to the data
        counts = next((Statistics.read(_stream(body)) for body in _bodies(data, Opcode.STATISTICS)), None)
        if counts is None:
            return None
        of_channels = counts.channel_message_counts  # empty where the writer did not count
        if sum(of_channels.values()) != counts.message_count or not of_channels.keys() <= {one.id for one in channels}:
            return None
        for channel in channels:
            self._open(channel)
        wanted: dict[int, tuple[int, bool]] = {}
        for body in _bodies(data, Opcode.CHUNK_INDEX):
            index = ChunkIndex.read(_stream(body))
            offset, length, present = index.chunk_start_offset, index.chunk_length, index.message_index_offsets
            if not len(MAGIC) <= offset <= offset + length <= start:
                return None
            wanted[offset] = length, not present or not self.handlers.keys().isdisjoint(present)
        if not wanted or len(wanted) != counts.chunk_count:
            return None
        return [(offset, length) for offset, (length, needed) in sorted(wanted.items()) if needed], counts

    def _indexed(self, places: _Places, counts: Statistics) -> None:
        for offset, whole in places:
            opcode, length = _HEAD.unpack(self._bytes(offset, _HEAD.size))
            if opcode != Opcode.CHUNK or _HEAD.size + length != whole:
                raise Damage("a chunk is not where the index says")
            self._chunk(offset, length)
            self.end = offset + whole
        self.end = self.size
        self.missed = sum(counts.channel_message_counts.get(one, 0) for one in self.handlers) - self.taken

    # --- without one -------------------------------------------------------------------------------------

    def _scan(self) -> None:
        """From record to record; the end mark ends it."""
        offset = len(MAGIC)
        while True:
            self.end = offset
            head = self._bytes(offset, _HEAD_ID.size)
            if len(head) < _HEAD.size:
                raise Damage("it ends without its end mark")
            opcode, length = _HEAD.unpack_from(head)
            after = offset + _HEAD.size + length
            if opcode in {Opcode.DATA_END, Opcode.FOOTER}:
                self.end = self.size
                if self._bytes(self.size - len(MAGIC), len(MAGIC)) != MAGIC:
                    raise Damage("it ends without its end mark, but behind all messages")
                return
            if opcode == 0:
                raise Damage("it goes on with bytes that are no record")
            if after > self.size:
                self._rescue(opcode, offset, length)
                raise Damage("its last record is cut")
            if opcode == Opcode.CHUNK:
                if self._unwanted(after):
                    self._skipped.append((offset, length))
                else:
                    self._chunk(offset, length)
                offset = after
            elif length > _LARGE and not self._needed(*_HEAD_ID.unpack(head)):
                offset = after
            else:
                walked = self._walk(self._bytes(offset, max(_BLOCK, _HEAD.size + length)))
                offset += walked or _HEAD.size + length

    def _unwanted(self, offset: int) -> bool:
        """Whether the message indexes behind a chunk name known channels only, and none that is wanted."""
        named = False
        while True:
            head = self._bytes(offset, _HEAD_ID.size)
            if len(head) < _HEAD_ID.size:
                return False
            opcode, length, channel = _HEAD_ID.unpack(head)
            if opcode != Opcode.MESSAGE_INDEX:
                return named
            if channel in self.handlers or channel not in self.channels:
                return False
            named = True
            offset += _HEAD.size + length

    def _rescue(self, opcode: int, offset: int, length: int) -> None:
        """Take the whole messages out of the chunk that the end of the file cuts."""
        before = self.taken
        try:
            if opcode == Opcode.CHUNK:
                self._chunk(offset, length, cut=True)
        finally:
            self.rescued = self.taken - before

    def _catch_up(self) -> None:
        """Find the channels that were declared in chunks where nobody wanted anything."""
        places, self._skipped = self._skipped, []
        for place in places:
            self._chunk(*place)

    # --- chunks and records ------------------------------------------------------------------------------

    def _chunk(self, offset: int, length: int, *, cut: bool = False) -> None:
        body = offset + _HEAD.size
        head = self._bytes(body, min(length, _CHUNK.size + 64))
        if len(head) < _CHUNK.size:
            raise Damage("a chunk is cut in its head")
        _, _, size, crc, name_length = _CHUNK.unpack_from(head)
        data_at = _CHUNK.size + name_length + 8
        if name_length > 32 or len(head) < data_at:
            raise Damage("a chunk is cut in its head")
        name = head[_CHUNK.size : _CHUNK.size + name_length].decode("utf-8", errors="replace")
        (packed,) = struct.unpack_from("<Q", head, _CHUNK.size + name_length)
        if data_at + packed > length:
            raise Damage("a chunk is longer than its record")
        if name not in COMPRESSIONS:
            raise LogError(
                f"packs its chunks with {name!r}; lz4, zstd or nothing was expected.",
                where=self.path,
                mend="Write it again with `mcap compress`.",
            )
        packed = min(packed, max(0, self.size - body - data_at))
        self._claimed += size
        out_of_chunk = size > max(_CHUNK_BYTES, _CHUNK_RATIO * packed)
        if name and (out_of_chunk or self._claimed > max(_CHUNK_BYTES, _FILE_RATIO * self.size)):
            raise Damage("a chunk claims a size out of proportion")

        def blocks() -> Iterable[bytes]:
            return unpacked(self.file, body + data_at, packed, name, size)

        if cut:
            self._records(blocks())
        elif size > _HELD:
            verify(blocks(), size, crc)
            self._records(blocks(), whole=True)
        else:
            held = b"".join(blocks())
            verify((held,), size, crc)
            self._records((held,), whole=True)

    def _records(self, blocks: Iterable[bytes], *, whole: bool = False) -> None:
        """Take the records of a chunk; the last one may be cut unless the chunk is ``whole``."""
        held, skip = b"", 0
        for block in blocks:
            if skip >= len(block):
                skip -= len(block)
                continue
            data = held + block[skip:]
            skip = 0
            held = data[self._walk(data) :]
            if len(held) < _HEAD_ID.size:
                continue
            opcode, length, number = _HEAD_ID.unpack_from(held)
            if opcode in _STRUCTURE:
                break
            if not self._needed(opcode, length, number):
                held, skip = b"", _HEAD.size + length - len(held)
        if whole and (held or skip):
            raise Damage("a chunk holds a record that is longer than itself")

    def _needed(self, opcode: int, length: int, number: int) -> bool:
        """Whether a record that is not yet there as a whole is worth waiting for."""
        if opcode == Opcode.MESSAGE:
            return self._handler(number) is not None and not self._refuse(length, number)
        if opcode in {Opcode.SCHEMA, Opcode.CHANNEL}:
            _limit(length)
            return True
        return False

    def _handler(self, number: int) -> Handler | None:
        """What takes the messages of the channel ``number``."""
        if number not in self.channels:
            self._catch_up()
        return self.handlers.get(number)

    def _refuse(self, length: int, number: int) -> bool:
        """Whether a message is too large; its topic is then given up."""
        if length < 22:
            raise Damage("a message is shorter than its head")
        if length > LARGEST:
            self.too_large[self.channels[number].topic] = length
            del self.handlers[number]
        return length > LARGEST

    def _walk(self, data: bytes) -> int:
        """Take all whole records from ``data`` up to one that the caller must deal with; where that begins."""
        at, end = 0, len(data)
        handlers, channels, unpack, stamps = self.handlers, self.channels, _HEAD_ID.unpack_from, _STAMPS.unpack_from
        while at + 11 <= end:
            opcode, length, channel = unpack(data, at)
            after = at + 9 + length
            if after > end or opcode in _STRUCTURE:
                break
            if opcode == 5:  # Opcode.MESSAGE; an enumeration costs time here
                handler = handlers.get(channel)
                if handler is None and channel not in channels:
                    handler = self._handler(channel)
                if handler is not None and (22 <= length <= LARGEST or not self._refuse(length, channel)):
                    handler(data[at + 31 : after], *stamps(data, at + 15))
                    self.taken += 1
            elif opcode in {3, 4}:
                self._declare(opcode, data[at + 9 : after])
            at = after
        return at

    def _declare(self, opcode: int, body: bytes) -> None:
        """Remember a schema or a channel; the first of an id counts, as MCAP asks."""
        _limit(len(body))
        try:
            declared = Schema.read(_stream(body)) if opcode == Opcode.SCHEMA else Channel.read(_stream(body))
        except (McapError, ValueError, struct.error) as error:
            raise Damage("a schema or channel record makes no sense") from error
        known = self._schemas if isinstance(declared, Schema) else self.channels
        if declared.id not in known:
            self._declared += len(body)
        if self._declared > _DECLARED:
            raise Damage(f"its schemas and channels are larger than {_DECLARED / 1e6:.0f} MB")
        if isinstance(declared, Schema):
            self._schemas.setdefault(declared.id, declared)
        else:
            self._open(declared)

    def _open(self, channel: Channel) -> None:
        if channel.id in self.channels:
            return
        self.channels[channel.id] = channel
        handler = self.open_channel(channel, self._schemas.get(channel.schema_id))
        if handler is not None:
            self.handlers[channel.id] = handler


def _limit(length: int) -> None:
    """That a schema or channel is not too large."""
    if length > LARGEST:
        raise Damage(f"a schema or channel is larger than {LARGEST / 1e6:.1f} MB")


def _bodies(data: bytes, wanted: int) -> Iterator[bytes]:
    """The records with the opcode ``wanted`` in a summary."""
    at = 0
    while at + _HEAD.size <= len(data):
        opcode, length = _HEAD.unpack_from(data, at)
        at += _HEAD.size + length
        if at > len(data):
            raise Damage("the summary is cut")
        if opcode == wanted:
            yield data[at - length : at]


def _stream(body: bytes) -> ReadDataStream:
    return ReadDataStream(io.BytesIO(body))
