"""MCAP in every legal shape: whatever its summary leaves out, however it is packed, wherever it is cut."""

from __future__ import annotations

import io
import itertools
import os
import struct
import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import lz4.frame
import numpy as np
import pytest
import zstandard
from mcap.opcode import Opcode
from mcap.writer import IndexType, Writer

from rovid.core.errors import LogError
from rovid.readers.mcap_reader import read
from rovid.readers.raw_log import RawLog
from rovid.trial.config import Config
from tests.conftest import slow
from tests.readers.logs import COMPRESSIONS, ENCODERS, EPOCH, Message, campaign, dive, finished, mcap_bytes

MESSAGES = dive(15)
HEADING = [fields["data"] for topic, _, fields in MESSAGES if topic == "/phins/heading"]
TIME = [(ns - EPOCH) / 1e9 for topic, ns, _ in MESSAGES if topic == "/phins/heading"]
COMMAND = [fields["data"] for topic, _, fields in MESSAGES if topic == "/thrusters/fore"]
# A file without chunks, and one for each way to pack them.
PACKINGS = [None, *COMPRESSIONS]
OPTIONS = (
    "schemas",
    "channels",
    "statistics",
    "offsets",
    "chunk_index",
    "message_index",
    "attachment_index",
    "metadata_index",
    "crcs",
    "data_crcs",
    "extras",
)


@dataclass(frozen=True)
class Shape:
    encoding: str
    packing: str | None
    options: frozenset[str]

    def __str__(self) -> str:
        return f"{self.encoding}, {self.packing or 'no chunks'}, without {sorted(set(OPTIONS) - self.options)}"


def written(shape: Shape, messages: list[Message] = MESSAGES, chunk_size: int = 600) -> bytes:
    """A recording of this shape, with attachments and metadata before, amid and behind the messages."""
    given = shape.options
    index = IndexType.NONE
    for name in ("chunk", "message", "attachment", "metadata"):
        if f"{name}_index" in given:
            index |= IndexType[name.upper()]
    output = io.BytesIO()
    writer = Writer(
        output,
        chunk_size=chunk_size,
        compression=COMPRESSIONS[shape.packing or "none"],
        index_types=index,
        repeat_channels="channels" in given,
        repeat_schemas="schemas" in given,
        use_chunking=shape.packing is not None,
        use_statistics="statistics" in given,
        use_summary_offsets="offsets" in given,
        enable_crcs="crcs" in given,
        enable_data_crcs="data_crcs" in given,
    )
    writer.start()
    channels: dict[str, Any] = {}
    for number, (topic, ns, fields) in enumerate(messages):
        if "extras" in given and number % 8 == 0:
            writer.add_attachment(ns, ns, "picture.jpg", "image/jpeg", bytes(90))
            writer.add_metadata("crew", {"pilot": "one", "number": str(number)})
        if topic not in channels:
            channels[topic] = ENCODERS[shape.encoding](writer, topic, fields)
        channel, encode = channels[topic]
        writer.add_message(channel, ns, encode(fields), ns)
    if "extras" in given:
        writer.add_metadata("end", {})
    return finished(writer, output)


def every() -> Iterator[Shape]:
    for encoding, packing in itertools.product(ENCODERS, PACKINGS):
        for given in itertools.product((True, False), repeat=len(OPTIONS)):
            yield Shape(encoding, packing, frozenset(itertools.compress(OPTIONS, given)))


def pairs() -> Iterator[Shape]:
    """Shapes among which every two options are both there, both left out, and either one; each of an encoding too."""
    for shape in every():
        if len(OPTIONS) - len(shape.options) <= (2 if shape.encoding == "json" else 1):
            yield shape


@pytest.fixture(scope="module")
def config(tmp_path_factory: pytest.TempPathFactory) -> Config:
    return campaign(tmp_path_factory.mktemp("shapes")).for_format("mcap")


def read_bytes(data: bytes, config: Config) -> RawLog:
    path = config.path.parent / "dive.mcap"
    path.write_bytes(data)
    return read(path, config)


def assert_whole(log: RawLog, shape: object = "") -> None:
    assert log.remarks == (), shape
    np.testing.assert_allclose(log.channels["heading"].time, TIME, atol=1e-9, err_msg=str(shape))
    assert log.channels["heading"].values.tolist() == HEADING, shape
    assert log.channels["command.fore"].values.tolist() == COMMAND, shape


@pytest.mark.parametrize("encoding", ENCODERS)
def test_every_two_options(encoding: str, config: Config) -> None:
    shapes = [shape for shape in pairs() if shape.encoding == encoding]
    assert len(shapes) == 4 * (1 + 11 + (55 if encoding == "json" else 0))
    for shape in shapes:
        assert_whole(read_bytes(written(shape), config), shape)


@pytest.mark.slow
@pytest.mark.parametrize("encoding", ENCODERS)
@pytest.mark.parametrize("packing", PACKINGS)
def test_every_combination_of_options(encoding: str, packing: str | None, config: Config) -> None:
    for shape in every():
        if (shape.encoding, shape.packing) == (encoding, packing):
            assert_whole(read_bytes(written(shape), config), shape)


# --- what the library does not write --------------------------------------------------------------------------------

Records = list[tuple[int, bytes]]  # (opcode, contents)


def records(data: bytes) -> Records:
    found, at = [], 8
    while at + 9 < len(data):
        opcode, length = struct.unpack_from("<BQ", data, at)
        found.append((opcode, data[at + 9 : at + 9 + length]))
        at += 9 + length
    return found


def joined(parts: Records) -> bytes:
    return b"".join(struct.pack("<BQ", opcode, len(body)) + body for opcode, body in parts)


def resummed(data: bytes, change: Callable[[Records], Records], more: bytes = b"") -> bytes:
    """The recording with ``more`` behind its data, and its summary changed."""
    all_records = records(data)
    end = [opcode for opcode, _ in all_records].index(Opcode.DATA_END)
    front = data[:8] + joined(all_records[:end]) + more + joined(all_records[end : end + 1])
    summary = joined(change([one for one in all_records[end + 1 : -1] if one[0] != Opcode.SUMMARY_OFFSET]))
    footer = struct.pack("<BQQQ", Opcode.FOOTER, 20, len(front), 0)
    return front + summary + footer + struct.pack("<I", zlib.crc32(footer, zlib.crc32(summary))) + data[:8]


def uncounted(parts: Records, more: int = 0) -> Records:
    """Statistics that count all messages but not those of each channel."""

    def changed(body: bytes) -> bytes:
        return struct.pack("<Q", struct.unpack_from("<Q", body)[0] + more) + body[8:42] + struct.pack("<I", 0)

    return [(opcode, changed(body) if opcode == Opcode.STATISTICS else body) for opcode, body in parts]


PRIVATE: Records = [(0x80, b""), (0xFF, b"something of one's own")]
SUMMARIES: dict[str, Callable[[Records], Records]] = {
    "the last group first": lambda parts: parts[::-1],
    "channels not counted": uncounted,
    "private records": lambda parts: [*PRIVATE, *parts, *PRIVATE],
    "each record twice": lambda parts: [one for one in parts for _ in range(2)],
    "half the chunk index": lambda parts: parts[:-2],
    "the first channel left out": lambda parts: [
        one for k, one in enumerate(parts) if one[0] != Opcode.CHANNEL or parts[k - 1][0] == Opcode.CHANNEL
    ],
    "nothing": lambda parts: [],
}


@pytest.mark.parametrize("name", SUMMARIES)
@pytest.mark.parametrize("encoding", ENCODERS)
def test_other_summaries(name: str, encoding: str, config: Config) -> None:
    data = written(Shape(encoding, "zstd", frozenset({*OPTIONS} - {"extras"})))
    assert_whole(read_bytes(resummed(data, SUMMARIES[name]), config))


def test_messages_beside_chunks_that_nobody_counted(config: Config) -> None:
    data = mcap_bytes(MESSAGES[:8], chunk_size=300)
    numbers = {topic: number + 1 for number, topic in enumerate(dict.fromkeys(topic for topic, _, _ in MESSAGES))}
    loose = [(numbers[topic], ns, fields) for topic, ns, fields in MESSAGES[8:]]
    body = mcap_bytes(MESSAGES, chunked=False, summary=False, indexed=False)
    messages = [one for one in records(body) if one[0] == Opcode.MESSAGE][8:]
    assert len(messages) == len(loose)
    whole = resummed(data, lambda parts: uncounted(parts, len(loose)), joined(messages))
    assert_whole(read_bytes(whole, config))


def test_private_records_anywhere(config: Config) -> None:
    data = mcap_bytes(MESSAGES, chunk_size=300, compression="lz4", summary=False, indexed=False)
    mixed = [part for one in records(data) for part in (*PRIVATE, one)]
    assert_whole(read_bytes(data[:8] + joined(mixed) + data[:8], config))


@pytest.mark.parametrize("compression", ["zstd", "lz4"])
def test_a_chunk_of_many_frames(compression: str, config: Config) -> None:
    data = mcap_bytes(MESSAGES, chunk_size=1 << 20, summary=False, indexed=False)
    pack = zstandard.compress if compression == "zstd" else lz4.frame.compress
    changed = []
    for opcode, body in records(data):
        if opcode == Opcode.CHUNK:
            head, contents = body[:28], body[28 + 4 + 8 :]
            packed = b"".join(pack(contents[at : at + 500]) for at in range(0, len(contents), 500))
            name = struct.pack("<I", len(compression)) + compression.encode()
            changed.append((opcode, head + name + struct.pack("<Q", len(packed)) + packed))
        else:
            changed.append((opcode, body))
    assert_whole(read_bytes(data[:8] + joined(changed) + data[:8], config))


@pytest.mark.parametrize("encoding", ENCODERS)
@pytest.mark.parametrize("index", [IndexType.NONE, IndexType.MESSAGE, IndexType.ALL])
def test_channels_declared_long_before_their_messages(encoding: str, index: IndexType, config: Config) -> None:
    """The chunk that declares a channel may hold messages of others only, which nobody wants."""
    output = io.BytesIO()
    writer = Writer(output, chunk_size=50, index_types=index, repeat_channels=False, repeat_schemas=False)
    writer.start()
    camera = writer.register_channel("/camera", "json", 0)
    for number in range(3):
        writer.add_message(camera, EPOCH + number, b'{"image": "' + b"x" * 100 + b'"}', EPOCH)
    channels = {topic: ENCODERS[encoding](writer, topic, fields) for topic, _, fields in MESSAGES}
    writer.add_message(camera, EPOCH + 9, b'{"image": "' + b"x" * 100 + b'"}', EPOCH)
    for topic, ns, fields in MESSAGES:
        channel, encode = channels[topic]
        writer.add_message(channel, ns, encode(fields), ns)
    assert_whole(read_bytes(finished(writer, output), config))


# --- cuts -----------------------------------------------------------------------------------------------------------


def assert_cuts(data: bytes, config: Config) -> None:
    """Cut anywhere, it is a beginning of the whole and says so, or it is refused in one line."""
    path = config.path.parent / "cut.mcap"
    path.write_bytes(data)
    read_whole, refused = 0, []
    for size in range(len(data) - 1, -1, -1):
        os.truncate(path, size)
        try:
            log = read(path, config)
        except LogError as error:
            refused.append(str(error))
            continue
        (remark,) = log.remarks
        assert remark.kind == "truncated"
        values = log.channels["heading"].values.tolist()
        assert values == HEADING[: len(values)]
        read_whole += values == HEADING
    assert all("\n" not in text and len(text) < 1000 for text in refused)
    assert read_whole > 100, "behind the data only the summary is cut"


@pytest.mark.parametrize("encoding", [slow("json"), slow("ros2"), slow("protobuf")])
def test_cut_at_every_byte(encoding: str, config: Config) -> None:
    packing = {"json": "zstd", "ros2": "lz4", "protobuf": None}[encoding]
    assert_cuts(written(Shape(encoding, packing, frozenset(OPTIONS)), chunk_size=900), config)


@pytest.mark.slow
@pytest.mark.parametrize("encoding", ENCODERS)
@pytest.mark.parametrize("packing", PACKINGS)
@pytest.mark.parametrize("without", ["", "extras", "message_index"])
def test_cut_at_every_byte_in_more_shapes(encoding: str, packing: str | None, without: str, config: Config) -> None:
    assert_cuts(written(Shape(encoding, packing, frozenset({*OPTIONS} - {without})), chunk_size=900), config)
