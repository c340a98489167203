"""MCAP recordings: the mapped fields of the mapped topics, decoded from JSON, protobuf or ROS 2 messages.

The mcap library parses summary, schemas and channels. The loops over records are rovid's own: the library loads every
record and chunk as a whole, and nothing of a chunk that is cut. A cut recording with gigabytes of camera images must
yield its heading in seconds and little memory.
"""

import io
import json
import struct
import zlib
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, BinaryIO, cast

from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, ChunkIndex, Footer, Schema, Statistics
from mcap.stream_reader import StreamReader

from rovid.core.errors import LogError
from rovid.readers.message_topics import Decoder, Handler, TopicExtractor, TopicListing, ros_decoder
from rovid.readers.raw_log import FilePart, LogContents, RawLog, required_signals
from rovid.trial.config import Config
from rovid.trial.trial import Remark

KIND = "mcap"
MAGIC = b"\x89MCAP0\r\n"
_FOOTER = 9 + 20 + len(MAGIC)  # Bytes of the footer record and the end mark.
# Bytes: a block of an unpacked chunk, the largest message that is read (decoded, it takes up to thirty times the
# memory), and the largest summary. Without a summary of at most this size the file is scanned.
_BLOCK, MAX_MESSAGE, _MAX_SUMMARY = 1 << 20, 4 << 20, 32 << 20
# Numbers of records. The enumeration is slow where it is compared for each message.
_MESSAGE, _DECLARATIONS = int(Opcode.MESSAGE), {int(Opcode.SCHEMA), int(Opcode.CHANNEL)}
_OPCODES = {int(one) for one in Opcode}
_HEAD, _HEAD_ID = struct.Struct("<BQ"), struct.Struct("<BQH")
_MESSAGE_HEAD, _CHUNK = struct.Struct("<HIQQ"), struct.Struct("<QQQII")


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
    unread, damage, lost = recording.size - recording.end, "", list[Remark]()
    if recording.damage:
        damage = f" The recording is cut: {recording.damage}, {unread} bytes were not read."
    if recording.left_out:
        count, left_out = len(recording.left_out), sum(size for size, _ in recording.left_out)
        text = "A chunk is" if count == 1 else f"{count} chunks are"
        text += f" damaged: {recording.left_out[0][1]}. The messages in these {left_out} of {recording.size} bytes are "
        text += "lost, and those after them were read."
        damage += f" {text}"
        lost.append(Remark(kind="damaged", count=left_out, text=text))

    def remarks(last: float) -> tuple[Remark, ...]:
        if not recording.damage:
            return tuple(lost)
        text = f"The recording is cut or damaged: {recording.damage}. The first {last:.1f} s were read; the last "
        text += f"{unread} of {recording.size} bytes are damaged."
        if recording.rescued:
            text += f" {recording.rescued} messages were read from the damaged part."
        return (*lost, Remark(kind="truncated", count=unread, text=text))

    return topics.result(remarks, damage)


def sources(path: Path) -> LogContents:
    """Every field that holds a number or an orientation."""
    listing = TopicListing(path, KIND)
    _read_messages(path, listing.handler)
    return listing.contents()


def _read_messages(path: Path, make_handler: Callable[..., Handler | None], *, by_index: bool = True) -> "McapFile":
    with path.open("rb", buffering=1 << 16) as file:
        recording = McapFile(path=path, size=file.seek(0, io.SEEK_END), file=file, make_handler=make_handler)
        recording.read(by_index=by_index)
    return recording


def _decoder(channel: Channel, schema: Schema | None, where: str) -> Decoder:
    """Function that turns payloads into objects; `LogError` if encoding or schema cannot be read."""
    encodings = channel.message_encoding, schema.encoding if schema else ""
    try:
        if encodings[0] == "json":
            return lambda payload: json.loads(str(payload, "utf-8"))
        if schema is not None and encodings == ("cdr", "ros2msg"):
            return ros_decoder(schema.name, schema.data.decode(), "cdr")
        if schema is not None and encodings == ("protobuf", "protobuf"):
            from mcap_protobuf.decoder import DecoderFactory

            if decoder := DecoderFactory().decoder_for("protobuf", schema):
                return decoder
    except Exception as error:  # Libraries raise any exception on damaged schemas.
        reason = f"{type(error).__name__}: {error}"[:120].split("\n", 1)[0]
        text = f"the schema of topic {channel.topic!r} cannot be parsed ({reason})."
        raise LogError(text, where=where, mend="Record the log again, or leave it out.") from error
    of_schema = f" with schema {encodings[1]!r}" if encodings[1] else " without a schema"
    text = f"topic {channel.topic!r} is encoded as {encodings[0]!r}{of_schema}; json, cdr with ros2msg, or protobuf "
    text += "with protobuf was expected."
    raise LogError(text, where=where, mend="Convert the recording (`mcap convert`), or map a topic in one of these.")


# --- the container: messages of mapped channels in whole and in cut files -----------------------------------------


class Damage(Exception):  # noqa: N818  a state of the recording, not an error of the program
    """The rest of the recording is unreliable; the message states why."""


@dataclass(kw_only=True, eq=False)
class McapFile:
    """An MCAP file of ``size`` bytes being read."""

    path: Path
    size: int
    file: BinaryIO
    # Called once for each channel with topic, maker of its decoder, and mapping: the taker of its messages, or None.
    make_handler: Callable[..., Handler | None]
    end: int = len(MAGIC)  # Bytes of the part that was read whole.
    damage: str = ""  # Why reading ended early.
    rescued: int = 0  # Number of messages taken from a cut chunk.
    # Bytes and fault of each damaged chunk that was left out, with readable records after it.
    left_out: list[tuple[int, str]] = field(default_factory=list)
    taken: int = 0  # Number of messages handed over.
    missed: int = 0  # Number of further messages that the summary counts.
    too_large: dict[str, int] = field(default_factory=dict)  # Mapped topic -> bytes of a message above MAX_MESSAGE.
    channels: dict[int, Channel] = field(default_factory=dict)
    handlers: dict[int, Handler] = field(default_factory=dict)
    _schemas: dict[int, Schema] = field(default_factory=dict)

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
        self.file.seek(offset)
        return self.file.read(max(0, min(count, self.size - offset)))

    def _summary(self) -> tuple[list[tuple[int, int]], Statistics] | None:
        """(offset, length) of the chunks to read; None unless the summary is whole and covers every message."""
        tail = self._bytes(max(0, self.size - _FOOTER), _FOOTER)
        if len(tail) < _FOOTER or not tail.endswith(MAGIC) or _HEAD.unpack_from(tail) != (Opcode.FOOTER, 20):
            return None
        footer = Footer.read(ReadDataStream(io.BytesIO(tail[9:])))
        start, end = footer.summary_start, self.size - _FOOTER
        if not len(MAGIC) <= start < end <= start + _MAX_SUMMARY:
            return None
        data = self._bytes(start, end - start)
        if footer.summary_crc and zlib.crc32(tail[:25], zlib.crc32(data)) != footer.summary_crc:
            return None
        reader = StreamReader(io.BytesIO(data + tail), skip_magic=True, record_size_limit=len(data) + len(tail))
        try:
            records = list(reader.records)
        except (McapError, ValueError, struct.error):  # Without an index the file is scanned.
            return None
        schemas = {one.id: one for one in reversed(records) if isinstance(one, Schema)}
        channels = {one.id: one for one in reversed(records) if isinstance(one, Channel)}
        counts = next((one for one in records if isinstance(one, Statistics)), None)
        chunks = {one.chunk_start_offset: one for one in records if isinstance(one, ChunkIndex)}
        # A summary may repeat channels without their schemas, and a writer may not count the messages.
        by_channel = counts.channel_message_counts if counts else {}
        if not (
            counts
            and {one.schema_id for one in channels.values()} <= {0, *schemas}
            and sum(by_channel.values()) == counts.message_count
            and by_channel.keys() <= channels.keys()
            and 0 < len(chunks) == counts.chunk_count
            and all(len(MAGIC) <= offset <= start - one.chunk_length for offset, one in chunks.items())
        ):
            return None
        self._schemas |= schemas
        for channel in channels.values():
            self._open(channel)
        places = []
        for offset, chunk in sorted(chunks.items()):
            present = chunk.message_index_offsets
            if not present or not self.handlers.keys().isdisjoint(present):
                places.append((offset, chunk.chunk_length))
        return places, counts

    def _read_indexed(self, places: list[tuple[int, int]], counts: Statistics) -> None:
        for offset, whole in places:
            opcode, length = _HEAD.unpack(self._bytes(offset, _HEAD.size))
            try:
                if opcode != Opcode.CHUNK or _HEAD.size + length != whole:
                    raise Damage("a chunk is not where the index says")
                self._read_chunk(offset + _HEAD.size, length)
            except Damage as damage:
                self.left_out.append((whole, str(damage)))
        self.end = self.size
        if not self.left_out:
            self.missed = sum(counts.channel_message_counts.get(one, 0) for one in self.handlers) - self.taken

    def _scan(self) -> None:
        """Read record by record, up to the end mark."""
        after = len(MAGIC)
        while True:
            self.end = offset = after
            head = self._bytes(offset, _HEAD.size)
            if len(head) < _HEAD.size:
                raise Damage("it ends without its end mark")
            opcode, length = _HEAD.unpack(head)
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
                    self._read_chunk(offset + _HEAD.size, length, cut=True)
                raise Damage("its last record is cut")
            if opcode == Opcode.CHUNK:
                try:
                    self._read_chunk(offset + _HEAD.size, length)
                except Damage as damage:
                    if self._holds_only_unmapped(after):
                        continue
                    if not self._continues(after):
                        raise
                    self.left_out.append((after - offset, str(damage)))
            else:
                self._take(self.file, opcode, length)

    def _continues(self, offset: int) -> bool:
        """Whether a record begins at ``offset`` and another one at its end: then the length before it was right."""
        for _ in range(2):
            head = self._bytes(offset, _HEAD.size)
            if len(head) < _HEAD.size or head[0] not in _OPCODES:
                return False
            offset += _HEAD.size + _HEAD.unpack(head)[1]
        return offset <= self.size

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
        """Take the records of a chunk: all after a check of size and checksum, or as many as a ``cut`` one has."""
        head = self._bytes(offset, min(length, _CHUNK.size + 64))
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
        packed = min(packed, max(0, self.size - offset - data_at))
        taken = self.taken
        try:
            if not cut:
                _verify(_unpacked(FilePart(self.file, offset + data_at, packed), compression), size, crc)
            stream = _unpacked(FilePart(self.file, offset + data_at, packed), compression)
            while len(rest := stream.read(_HEAD.size)) == _HEAD.size and self._take(stream, *_HEAD.unpack(rest)):
                pass
            if rest and not cut:
                raise Damage("a chunk holds a record that is longer than itself")
        finally:
            self.rescued = self.taken - taken if cut else 0

    def _take(self, stream: BinaryIO, opcode: int, length: int) -> bool:
        """Take the rest of a record from ``stream``; whether all of it was there, outside a chunk as far as needed."""
        if opcode == _MESSAGE:
            if length < _MESSAGE_HEAD.size:
                raise Damage("a message is shorter than its head")
            head, length = stream.read(_MESSAGE_HEAD.size), length - _MESSAGE_HEAD.size
            if len(head) < _MESSAGE_HEAD.size:
                return False
            channel, _, logged, published = _MESSAGE_HEAD.unpack(head)
            handler = self.handlers.get(channel)
            if handler is not None and length > MAX_MESSAGE:
                self.too_large[self.channels[channel].topic] = length
                del self.handlers[channel]
            elif handler is not None:
                payload = stream.read(length)
                if len(payload) == length:
                    handler(payload, logged, published)
                    self.taken += 1
                return len(payload) == length
        elif opcode in _DECLARATIONS:
            body = stream.read(min(length, MAX_MESSAGE))
            if len(body) == length:
                self._declare(opcode, body)
            return len(body) == length
        while stream is not self.file and length:
            skipped = len(stream.read(min(length, _BLOCK)))
            if not skipped:
                return False
            length -= skipped
        return True

    def _declare(self, opcode: int, body: bytes) -> None:
        """Register a schema or a channel; the first of an id counts, as MCAP specifies."""
        stream = ReadDataStream(io.BytesIO(body))
        try:
            if opcode == Opcode.SCHEMA:
                schema = Schema.read(stream)
                self._schemas.setdefault(schema.id, schema)
                return
            channel = Channel.read(stream)
        except (McapError, ValueError, struct.error) as error:
            raise Damage("a schema or channel record makes no sense") from error
        self._open(channel)

    def _open(self, channel: Channel) -> None:
        if channel.id in self.channels:
            return
        self.channels[channel.id], schema = channel, self._schemas.get(channel.schema_id)
        is_json, where = channel.message_encoding == "json", str(self.path)
        handler = self.make_handler(channel.topic, lambda: _decoder(channel, schema, where), mapping=is_json)
        if handler is not None:
            self.handlers[channel.id] = handler


class _Unpacked(io.RawIOBase):
    """The bytes that ``read`` unpacks, up to where the packed bytes end; `Damage` where they do not unpack."""

    def __init__(self, read: Callable[[int], bytes]) -> None:
        self._read = read

    def readable(self) -> bool:
        return True

    def readinto(self, buffer: Any) -> int:
        try:
            block = self._read(len(buffer))
        except EOFError:  # Raised by lz4 where the chunk is cut.
            return 0
        except Exception as error:  # Each library raises its own errors.
            raise Damage("a chunk does not unpack") from error
        buffer[: len(block)] = block
        return len(block)


def _unpacked(part: FilePart, compression: str) -> BinaryIO:
    read: Any = part.read
    if compression == "zstd":
        import zstandard

        read = zstandard.ZstdDecompressor().stream_reader(cast("BinaryIO", part), read_across_frames=True).read
    elif compression == "lz4":
        import lz4.frame

        read = lz4.frame.LZ4FrameFile(part).read1
    return io.BufferedReader(_Unpacked(read), _BLOCK)


def _verify(stream: BinaryIO, size: int, crc: int) -> None:
    """Check size and checksum of what ``stream`` holds; ``crc`` 0 stands for no checksum."""
    found = checksum = 0
    while found <= size and (block := stream.read(_BLOCK)):
        found += len(block)
        checksum = zlib.crc32(block, checksum)
    if found != size:
        raise Damage("a chunk does not unpack to the size it claims")
    if crc and checksum != crc:
        raise Damage("a chunk's checksum does not fit its contents")
