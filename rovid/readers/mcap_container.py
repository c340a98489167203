"""The container of MCAP: finds the messages of wanted channels, whole file or cut, and touches little else.

Records come from the mcap library's own definitions; the loop over messages, the use of the index, and what
is done about damage are ours, because a crash-cut recording of some gigabytes of camera images must give up
its heading in seconds and in little memory.
"""

from __future__ import annotations

import io
import struct
import zlib
from collections.abc import Callable, Collection
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, cast

from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, ChunkIndex, Footer, Schema, Statistics

from rovid.errors import LogError
from rovid.readers.topics import Handler

MAGIC = b"\x89MCAP0\r\n"
_FOOTER = 9 + 20 + len(MAGIC)
# Opcodes at which the loop over records stops: the caller deals with them.
_STRUCTURE = frozenset({0, Opcode.CHUNK, Opcode.DATA_END, Opcode.FOOTER})
_BLOCK = 1 << 18
_LARGE = 1 << 16
# A chunk may claim to be this large when unpacked, or this much larger than it is packed.
_CHUNK_BYTES, _CHUNK_RATIO = 64 << 20, 100
_COMPRESSIONS = ("", "lz4", "zstd")

_HEAD = struct.Struct("<BQ")
_HEAD_ID = struct.Struct("<BQH")
_STAMPS = struct.Struct("<QQ")
_CHUNK = struct.Struct("<QQQII")


class Damage(Exception):  # noqa: N818  no error of the program: what is wrong with the recording from here on
    """The rest of the recording cannot be trusted; the message says why."""


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
    """

    path: Path
    size: int
    file: IO[bytes]
    open_channel: Callable[[Channel, Schema | None], Handler | None]
    end: int = len(MAGIC)
    damage: str = ""
    rescued: int = 0
    taken: int = 0
    missed: int = 0
    channels: dict[int, Channel] = field(default_factory=dict)
    handlers: dict[int, Handler] = field(default_factory=dict)
    _schemas: dict[int, Schema] = field(default_factory=dict)

    def read(self, *, by_index: bool = True) -> None:
        """Give every message of a wanted channel to its handler, in the order of the file.

        Raises
        ------
        LogError
            The file is no MCAP file or packs its chunks in an unknown way.
        """
        if self._bytes(0, len(MAGIC)) != MAGIC:
            raise LogError(
                "is not an MCAP file: it does not begin with the bytes that mark one.",
                where=self.path,
                mend="Export the log again, or give it the suffix of its format.",
            )
        summary = self._summary() if by_index else None
        try:
            if summary is not None:
                self._indexed(*summary)
            else:
                self._scan()
        except Damage as damage:
            self.damage = str(damage)

    def _bytes(self, offset: int, count: int) -> bytes:
        self.file.seek(offset)
        return self.file.read(min(count, max(0, self.size - offset)))  # a record may claim any length

    # --- with an index -----------------------------------------------------------------------------------

    def _summary(self) -> tuple[list[ChunkIndex], Statistics] | None:
        """Chunks by their place in the file; None unless the summary is whole and covers every message."""
        tail = self._bytes(max(0, self.size - _FOOTER), _FOOTER)
        if len(tail) < _FOOTER or not tail.endswith(MAGIC) or _HEAD.unpack_from(tail) != (Opcode.FOOTER, 20):
            return None
        footer = Footer.read(ReadDataStream(io.BytesIO(tail[9:])))
        start, end = footer.summary_start, self.size - _FOOTER
        if not len(MAGIC) <= start < end:
            return None
        data = self._bytes(start, end - start)
        if footer.summary_crc and zlib.crc32(tail[:25], zlib.crc32(data)) != footer.summary_crc:
            return None
        try:
            return self._parse_summary(data, start)
        except (McapError, ValueError, struct.error, Damage):  # an index is a help; without it the file is scanned
            self._forget()
            return None

    def _forget(self) -> None:
        self.channels.clear()
        self.handlers.clear()
        self._schemas.clear()

    def _parse_summary(self, data: bytes, start: int) -> tuple[list[ChunkIndex], Statistics] | None:
        bodies: dict[int, list[bytes]] = {}
        at = 0
        while at + _HEAD.size <= len(data):
            opcode, length = _HEAD.unpack_from(data, at)
            at += _HEAD.size + length
            if at > len(data):
                return None
            bodies.setdefault(opcode, []).append(data[at - length : at])
        for opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
            for body in bodies.get(opcode, ()):
                self._declare(opcode, body)
        statistics = [Statistics.read(_stream(body)) for body in bodies.get(Opcode.STATISTICS, ())]
        found = [ChunkIndex.read(_stream(body)) for body in bodies.get(Opcode.CHUNK_INDEX, ())]
        indexes = {index.chunk_start_offset: index for index in found}
        if not statistics or not self._covers(indexes.values(), statistics[0], start):
            self._forget()
            return None
        return [indexes[offset] for offset in sorted(indexes)], statistics[0]

    def _covers(self, indexes: Collection[ChunkIndex], counts: Statistics, end: int) -> bool:
        """Whether all messages lie in indexed chunks and all channels are known."""
        whole = all(
            len(MAGIC) <= index.chunk_start_offset and index.chunk_start_offset + index.chunk_length <= end
            for index in indexes
        )
        channels = set(counts.channel_message_counts)
        return bool(indexes) and whole and len(indexes) == counts.chunk_count and channels <= set(self.channels)

    def _indexed(self, indexes: list[ChunkIndex], counts: Statistics) -> None:
        for index in indexes:
            present = index.message_index_offsets
            if present and not any(channel in self.handlers for channel in present):
                continue
            offset = index.chunk_start_offset
            opcode, length = _HEAD.unpack(self._bytes(offset, _HEAD.size))
            if opcode != Opcode.CHUNK or _HEAD.size + length != index.chunk_length:
                raise Damage("a chunk is not where the index says")
            self._chunk(offset, length)
            self.end = offset + _HEAD.size + length
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
                return
            if opcode == 0:
                raise Damage("it goes on with bytes that are no record")
            if after > self.size:
                self._rescue(opcode, offset, length)
                raise Damage("its last record is cut")
            if opcode == Opcode.CHUNK:
                if not self._unwanted(after):
                    self._chunk(offset, length)
                offset = after
            elif length > _LARGE and opcode == Opcode.MESSAGE:
                if _HEAD_ID.unpack(head)[2] in self.handlers:
                    self._walk(self._bytes(offset, _HEAD.size + length))
                offset = after
            elif length > _LARGE and opcode not in {Opcode.SCHEMA, Opcode.CHANNEL}:
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
        if opcode == Opcode.CHUNK:
            self._chunk(offset, length, cut=True)

    # --- chunks and records ------------------------------------------------------------------------------

    def _chunk(self, offset: int, length: int, *, cut: bool = False) -> None:
        body = offset + _HEAD.size
        head = self._bytes(body, min(length, _CHUNK.size + 64))
        if len(head) < _CHUNK.size:
            raise Damage("a chunk is cut in its head")
        _, _, unpacked, crc, name_length = _CHUNK.unpack_from(head)
        data_at = _CHUNK.size + name_length + 8
        if name_length > 32 or len(head) < data_at:
            raise Damage("a chunk is cut in its head")
        name = head[_CHUNK.size : _CHUNK.size + name_length].decode("utf-8", errors="replace")
        (packed,) = struct.unpack_from("<Q", head, _CHUNK.size + name_length)
        if data_at + packed > length:
            raise Damage("a chunk is longer than its record")
        data = _unpack(self.path, name, self._bytes(body + data_at, packed), unpacked)
        if cut:
            before = self.taken
            self._walk(data)
            self.rescued = self.taken - before
            return
        if len(data) != unpacked:
            raise Damage("a chunk does not unpack to the size it claims")
        if crc and zlib.crc32(data) != crc:
            raise Damage("a chunk's checksum does not fit its contents")
        if self._walk(data) != len(data):
            raise Damage("a chunk holds a record that is longer than itself")

    def _walk(self, data: bytes) -> int:
        """Take all whole records from ``data`` up to one that the caller must deal with; where that begins."""
        at, end = 0, len(data)
        handlers, unpack, stamps = self.handlers, _HEAD_ID.unpack_from, _STAMPS.unpack_from
        while at + 11 <= end:
            opcode, length, channel = unpack(data, at)
            after = at + 9 + length
            if after > end or opcode in _STRUCTURE:
                break
            if opcode == 5:  # Opcode.MESSAGE; an enumeration costs time here
                handler = handlers.get(channel)
                if handler is not None:
                    if length < 22:
                        raise Damage("a message is shorter than its head")
                    handler(data[at + 31 : after], *stamps(data, at + 15))
                    self.taken += 1
            elif opcode in {3, 4}:
                self._declare(opcode, data[at + 9 : after])
            at = after
        return at

    def _declare(self, opcode: int, body: bytes) -> None:
        """Remember a schema or a channel; the first of an id counts, as MCAP asks."""
        try:
            if opcode == Opcode.SCHEMA:
                schema = Schema.read(_stream(body))
                self._schemas.setdefault(schema.id, schema)
                return
            channel = Channel.read(_stream(body))
        except (McapError, ValueError, struct.error) as error:
            raise Damage("a schema or channel record makes no sense") from error
        if channel.id in self.channels:
            return
        self.channels[channel.id] = channel
        handler = self.open_channel(channel, self._schemas.get(channel.schema_id))
        if handler is not None:
            self.handlers[channel.id] = handler


def _stream(body: bytes) -> ReadDataStream:
    return ReadDataStream(io.BytesIO(body))


def _unpack(path: Path, compression: str, data: bytes, size: int) -> bytes:
    """At most ``size`` bytes from ``data`` and one more where there is more; fewer where ``data`` is cut.

    Raises
    ------
    Damage
        The size is out of proportion (a few bytes could claim all memory), or the data make no sense.
    LogError
        The compression is not known.
    """
    if not compression:
        return data
    if compression not in _COMPRESSIONS:
        raise LogError(
            f"packs its chunks with {compression!r}; lz4, zstd or nothing was expected.",
            where=path,
            mend="Write it again with `mcap compress`.",
        )
    if size > max(_CHUNK_BYTES, _CHUNK_RATIO * len(data)):
        raise Damage("a chunk claims a size out of proportion")
    try:
        return _zstd(data, size) if compression == "zstd" else _lz4(data, size)
    except (RuntimeError, ValueError, MemoryError) as error:
        raise Damage("a chunk does not unpack") from error


def _zstd(data: bytes, size: int) -> bytes:
    import zstandard

    try:
        return zstandard.ZstdDecompressor().stream_reader(data).read(size + 1)
    except zstandard.ZstdError as error:
        raise ValueError(str(error)) from error


def _lz4(data: bytes, size: int) -> bytes:
    import lz4.frame

    return cast("bytes", lz4.frame.LZ4FrameDecompressor().decompress(data, max_length=size + 1))
