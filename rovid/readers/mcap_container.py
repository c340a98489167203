"""The container of MCAP: find the messages of mapped channels, in whole and in cut files.

Records are parsed by the mcap library. The loop over messages, the use of the index and the recovery of damaged files
are rovid's own: a cut recording with gigabytes of camera images must yield its heading in seconds and little memory.
"""

from __future__ import annotations

import io
import struct
import zlib
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import BinaryIO, cast

from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, ChunkIndex, Footer, Schema, Statistics

from rovid.core.errors import LogError
from rovid.readers.message_topics import Handler
from rovid.readers.raw_log import FilePart

MAGIC = b"\x89MCAP0\r\n"
# Bytes of the footer record and the end mark.
_FOOTER = 9 + 20 + len(MAGIC)
# Opcodes at which the loop over records stops for the caller.
_STRUCTURE = frozenset({0, Opcode.CHUNK, Opcode.DATA_END, Opcode.FOOTER})
# Bytes: a block of records outside chunks, a block of an unpacked chunk, and the smallest record worth skipping.
_BLOCK, _CHUNK_BLOCK, _LARGE = 1 << 18, 1 << 20, 1 << 16
# Bytes: the largest message that is read (decoded, it takes up to thirty times the memory), and the largest chunk that
# is unpacked only once; a larger chunk is unpacked twice, to verify and to read it in blocks. Without a summary of at
# most this size the file is scanned.
MAX_MESSAGE, _MAX_HELD, _MAX_SUMMARY = 4 << 20, 16 << 20, 32 << 20

_HEAD = struct.Struct("<BQ")
_HEAD_ID = struct.Struct("<BQH")
_STAMPS = struct.Struct("<QQ")
_CHUNK = struct.Struct("<QQQII")

_Places = list[tuple[int, int]]  # (offset, length)


class Damage(Exception):  # noqa: N818  a state of the recording, not an error of the program
    """The rest of the recording is unreliable; the message states why."""


@dataclass(kw_only=True, eq=False)
class McapFile:
    """An MCAP file of ``size`` bytes being read."""

    path: Path
    size: int
    file: BinaryIO
    # Called once for each channel: returns the function that takes its messages, or None.
    open_channel: Callable[[Channel, Schema | None], Handler | None]
    end: int = len(MAGIC)  # Bytes of the part that was read whole.
    damage: str = ""  # Why reading ended early.
    rescued: int = 0  # Number of messages taken from a cut chunk.
    taken: int = 0  # Number of messages handed over.
    missed: int = 0  # Number of further messages that the summary counts.
    too_large: dict[str, int] = field(default_factory=dict)  # Mapped topic -> bytes of a message above MAX_MESSAGE.
    channels: dict[int, Channel] = field(default_factory=dict)
    handlers: dict[int, Handler] = field(default_factory=dict)
    _schemas: dict[int, Schema] = field(default_factory=dict)
    _skipped: _Places = field(default_factory=list)

    def read(self, *, by_index: bool = True) -> None:
        """Hand every message of a mapped channel to its handler, in the order of the file."""
        if self._bytes(0, len(MAGIC)) != MAGIC:
            text = "is not an MCAP file: it does not begin with the mark of one."
            raise LogError(text, where=self.path, mend="Export the log again, or give it the suffix of its format.")
        try:
            if by_index and (summary := self._summary()) is not None:
                self._read_indexed(*summary)
            else:
                self._scan()
        except Damage as damage:
            self.damage = str(damage)

    def _bytes(self, offset: int, count: int) -> bytes:
        """Up to ``count`` bytes of the file: a record may claim any length."""
        if offset >= self.size:
            return b""
        self.file.seek(offset)
        return self.file.read(min(count, self.size - offset))

    def _summary(self) -> tuple[_Places, Statistics] | None:
        """The chunks to read, in order; None unless the summary is whole and covers every message."""
        tail = self._bytes(max(0, self.size - _FOOTER), _FOOTER)
        if len(tail) < _FOOTER or not tail.endswith(MAGIC) or _HEAD.unpack_from(tail) != (Opcode.FOOTER, 20):
            return None
        footer = Footer.read(_stream(tail[9:]))
        start, end = footer.summary_start, self.size - _FOOTER
        if not len(MAGIC) <= start < end <= start + _MAX_SUMMARY:
            return None
        data = self._bytes(start, end - start)
        if footer.summary_crc and zlib.crc32(tail[:25], zlib.crc32(data)) != footer.summary_crc:
            return None
        try:
            summary = self._parse_summary(data, start)
        except (McapError, ValueError, struct.error, Damage):  # Without an index the file is scanned.
            summary = None
        if summary is None:
            for declared in (self.channels, self.handlers, self._schemas):
                declared.clear()
        return summary

    def _parse_summary(self, data: bytes, start: int) -> tuple[_Places, Statistics] | None:
        for body in _bodies(data, Opcode.SCHEMA):
            self._declare(Opcode.SCHEMA, body)
        channels = [Channel.read(_stream(body)) for body in _bodies(data, Opcode.CHANNEL)]
        if not {channel.schema_id for channel in channels} <= {0, *self._schemas}:
            return None  # A summary may repeat channels without their schemas.
        counts = next((Statistics.read(_stream(body)) for body in _bodies(data, Opcode.STATISTICS)), None)
        if counts is None:
            return None
        by_channel = counts.channel_message_counts  # Empty where the writer did not count.
        if sum(by_channel.values()) != counts.message_count or not by_channel.keys() <= {one.id for one in channels}:
            return None
        for channel in channels:
            self._open(channel)
        chunks: dict[int, tuple[int, bool]] = {}
        for body in _bodies(data, Opcode.CHUNK_INDEX):
            index = ChunkIndex.read(_stream(body))
            offset, length, present = index.chunk_start_offset, index.chunk_length, index.message_index_offsets
            if not len(MAGIC) <= offset <= offset + length <= start:
                return None
            chunks[offset] = length, not present or not self.handlers.keys().isdisjoint(present)
        if not chunks or len(chunks) != counts.chunk_count:
            return None
        return [(offset, length) for offset, (length, needed) in sorted(chunks.items()) if needed], counts

    def _read_indexed(self, places: _Places, counts: Statistics) -> None:
        for offset, whole in places:
            opcode, length = _HEAD.unpack(self._bytes(offset, _HEAD.size))
            if opcode != Opcode.CHUNK or _HEAD.size + length != whole:
                raise Damage("a chunk is not where the index says")
            self._read_chunk(offset, length)
            self.end = offset + whole
        self.end = self.size
        self.missed = sum(counts.channel_message_counts.get(one, 0) for one in self.handlers) - self.taken

    def _scan(self) -> None:
        """Read record by record, up to the end mark."""
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
                    raise Damage("it ends without its end mark, but after all messages")
                return
            if opcode == 0:
                raise Damage("it continues with bytes that are no record")
            if after > self.size:
                if opcode == Opcode.CHUNK:
                    self._read_chunk(offset, length, cut=True)
                raise Damage("its last record is cut")
            if opcode == Opcode.CHUNK:
                if self._holds_only_unmapped(after):
                    self._skipped.append((offset, length))
                else:
                    self._read_chunk(offset, length)
                offset = after
            elif length > _LARGE and not self._is_needed(*_HEAD_ID.unpack(head)):
                offset = after
            else:
                walked = self._walk(self._bytes(offset, max(_BLOCK, _HEAD.size + length)))
                offset += walked or _HEAD.size + length

    def _holds_only_unmapped(self, offset: int) -> bool:
        """Whether the message indexes after a chunk name only known channels, none of them mapped."""
        is_indexed = False
        while True:
            head = self._bytes(offset, _HEAD_ID.size)
            if len(head) < _HEAD_ID.size:
                return False
            opcode, length, channel = _HEAD_ID.unpack(head)
            if opcode != Opcode.MESSAGE_INDEX:
                return is_indexed
            if channel in self.handlers or channel not in self.channels:
                return False
            is_indexed = True
            offset += _HEAD.size + length

    def _read_chunk(self, offset: int, length: int, *, cut: bool = False) -> None:
        body = offset + _HEAD.size
        head = self._bytes(body, min(length, _CHUNK.size + 64))
        if len(head) < _CHUNK.size:
            raise Damage("a chunk is cut in its head")
        _, _, size, crc, name_length = _CHUNK.unpack_from(head)
        data_at = _CHUNK.size + name_length + 8
        if name_length > 32 or len(head) < data_at:
            raise Damage("a chunk is cut in its head")
        compression = head[_CHUNK.size : _CHUNK.size + name_length].decode("utf-8", errors="replace")
        (packed,) = struct.unpack_from("<Q", head, _CHUNK.size + name_length)
        if data_at + packed > length:
            raise Damage("a chunk is longer than its record")
        if compression not in {"", "lz4", "zstd"}:
            text = f"packs its chunks with {compression!r}; lz4, zstd or nothing was expected."
            raise LogError(text, where=self.path, mend="Write it again with `mcap compress`.")
        packed = min(packed, max(0, self.size - body - data_at))

        def blocks() -> Iterator[bytes]:
            return _unpacked(self.file, body + data_at, packed, compression, size)

        if cut:
            taken = self.taken
            try:
                self._read_records(blocks())
            finally:
                self.rescued = self.taken - taken
        elif size > _MAX_HELD:
            _verify(blocks(), size, crc)
            self._read_records(blocks(), whole=True)
        else:
            held = b"".join(blocks())
            _verify((held,), size, crc)
            self._read_records((held,), whole=True)

    def _read_records(self, blocks: Iterable[bytes], *, whole: bool = False) -> None:
        """Take the records of a chunk; the last may be cut unless the chunk is ``whole``."""
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
            if not self._is_needed(opcode, length, number):
                held, skip = b"", _HEAD.size + length - len(held)
        if whole and (held or skip):
            raise Damage("a chunk holds a record that is longer than itself")

    def _is_needed(self, opcode: int, length: int, number: int) -> bool:
        """Whether to wait for the rest of a record."""
        if opcode == Opcode.MESSAGE:
            return self._handler(number) is not None and not self._is_too_large(length, number)
        return opcode in {Opcode.SCHEMA, Opcode.CHANNEL}

    def _handler(self, number: int) -> Handler | None:
        """Function that takes the messages of the channel ``number``."""
        if number not in self.channels:
            # The channel may be declared in a chunk that was skipped.
            places, self._skipped = self._skipped, []
            for place in places:
                self._read_chunk(*place)
        return self.handlers.get(number)

    def _is_too_large(self, length: int, number: int) -> bool:
        """Whether a message is too large; its topic is then no longer read."""
        if length < 22:
            raise Damage("a message is shorter than its head")
        if length > MAX_MESSAGE:
            self.too_large[self.channels[number].topic] = length
            del self.handlers[number]
        return length > MAX_MESSAGE

    def _walk(self, data: bytes) -> int:
        """Take all whole records of ``data`` up to one for the caller, and return its offset."""
        at, end = 0, len(data)
        handlers, channels, unpack, stamps = self.handlers, self.channels, _HEAD_ID.unpack_from, _STAMPS.unpack_from
        while at + 11 <= end:
            opcode, length, channel = unpack(data, at)
            after = at + 9 + length
            if after > end or opcode in _STRUCTURE:
                break
            if opcode == 5:  # Opcode.MESSAGE; the enumeration is slower.
                handler = handlers.get(channel)
                if handler is None and channel not in channels:
                    handler = self._handler(channel)
                if handler is not None and (22 <= length <= MAX_MESSAGE or not self._is_too_large(length, channel)):
                    handler(data[at + 31 : after], *stamps(data, at + 15))
                    self.taken += 1
            elif opcode in {3, 4}:
                self._declare(opcode, data[at + 9 : after])
            at = after
        return at

    def _declare(self, opcode: int, body: bytes) -> None:
        """Register a schema or a channel; the first of an id counts, as MCAP specifies."""
        try:
            if opcode == Opcode.SCHEMA:
                schema = Schema.read(_stream(body))
                self._schemas.setdefault(schema.id, schema)
                return
            channel = Channel.read(_stream(body))
        except (McapError, ValueError, struct.error) as error:
            raise Damage("a schema or channel record makes no sense") from error
        self._open(channel)

    def _open(self, channel: Channel) -> None:
        if channel.id in self.channels:
            return
        self.channels[channel.id] = channel
        handler = self.open_channel(channel, self._schemas.get(channel.schema_id))
        if handler is not None:
            self.handlers[channel.id] = handler


def _bodies(data: bytes, wanted: int) -> Iterator[bytes]:
    """Bodies of the records with the opcode ``wanted`` in a summary."""
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


# --- compression -----------------------------------------------------------------------------------------------


def _unpacked(file: BinaryIO, start: int, packed: int, compression: str, size: int) -> Iterator[bytes]:
    """Blocks of a chunk: ``size`` bytes, one more if there are more, fewer if the chunk is cut."""
    left = size + 1
    errors: tuple[type[Exception], ...] = (RuntimeError, ValueError, MemoryError)
    try:
        part = FilePart(file, start, packed)
        read: Callable[[int], bytes] = io.BufferedReader(part, _CHUNK_BLOCK).read1
        if compression == "zstd":
            import zstandard

            errors = (*errors, zstandard.ZstdError)
            source = cast("BinaryIO", part)
            read = zstandard.ZstdDecompressor().stream_reader(source, read_across_frames=True).read
        elif compression == "lz4":
            import lz4.frame

            read = cast("Callable[[int], bytes]", lz4.frame.LZ4FrameFile(part).read1)
        while left and (block := read(min(_CHUNK_BLOCK, left))):
            left -= len(block)
            yield block
    except EOFError:  # Raised by lz4 where the chunk is cut.
        return
    except errors as error:
        raise Damage("a chunk does not unpack") from error


def _verify(blocks: Iterable[bytes], size: int, crc: int) -> None:
    """Check the size and the checksum of ``blocks``; ``crc`` 0 stands for no checksum."""
    found = checksum = 0
    for block in blocks:
        found += len(block)
        checksum = zlib.crc32(block, checksum)
    if found != size:
        raise Damage("a chunk does not unpack to the size it claims")
    if crc and checksum != crc:
        raise Damage("a chunk's checksum does not fit its contents")
