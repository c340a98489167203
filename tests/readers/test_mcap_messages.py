"""Messages of MCAP that are deep, recursive or too large."""

from __future__ import annotations

import io
import json
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import IO

import lz4.frame
import numpy as np
import pytest
import zstandard
from google.protobuf import descriptor_pb2
from mcap.writer import CompressionType, IndexType, Writer

from rovid.core.errors import LogError
from rovid.readers import mcap_reader, read_log
from rovid.trial.config import Config
from tests.readers.apart import STATUS, read
from tests.readers.logs import EPOCH, Message, campaign, dive, finished, mcap_bytes, read_mcap, toml
from tests.readers.recordings import HEADING, TIME

MAGIC = b"\x89MCAP0\r\n"
WHOLE = mcap_bytes(dive(), summary=False, indexed=False)


def read_apart(path: Path) -> str:
    """What is said of the log; in little memory and time."""
    peak, said = read(path, "measured")
    # What a fresh interpreter needs to read a log is 130 MB or so; the columns here are of no size.
    assert peak < 300_000_000
    return said


def record(opcode: int, body: bytes) -> bytes:
    return struct.pack("<BQ", opcode, len(body)) + body


def channel(number: int, topic: str, encoding: str = "json", schema: int = 0) -> bytes:
    texts = b"".join(struct.pack("<I", len(text)) + text.encode() for text in (topic, encoding))
    return record(4, struct.pack("<HH", number, schema) + texts + struct.pack("<I", 0))


def chunk_head(name: str, packed: int, size: int) -> bytes:
    texts = struct.pack("<I", len(name)) + name.encode() + struct.pack("<Q", packed)
    body = struct.pack("<QQQI", 0, 0, size, 0) + texts
    return struct.pack("<BQ", 6, len(body) + packed) + body


def in_front(path: Path, more: bytes) -> Path:
    path.write_bytes(MAGIC + more + WHOLE[len(MAGIC) :])
    return path


@pytest.mark.skipif(not STATUS.exists(), reason="/proc/self/status is missing, which has the peak memory")
@pytest.mark.parametrize("chunked", [True, False])
def test_a_wanted_message_that_is_too_large(chunked: bool, config: Config, tmp_path: Path) -> None:
    """Thirty times its size as objects is more than there may be."""
    large = b'{"data": [' + b"{}," * 10_000_000 + b"1]}"
    message = record(5, struct.pack("<HIQQ", 7, 0, EPOCH, EPOCH) + large)
    part = channel(7, "/phins/heading") + message
    path = in_front(tmp_path / "dive.mcap", chunk_head("", len(part), len(part)) + part if chunked else part)
    said = read_apart(path)
    assert "topic '/phins/heading' has a message of 30.0 MB; at most 4.2 MB was expected" in said
    assert said.count("\n") == 0


def test_a_message_that_is_too_large_does_not_keep_init_from_the_others(tmp_path: Path) -> None:
    large = record(5, struct.pack("<HIQQ", 100, 0, EPOCH, EPOCH) + bytes(5_000_000))
    path = in_front(tmp_path / "dive.mcap", channel(100, "/camera") + large)
    assert "/phins/heading.data" in mcap_reader.sources(path).sources


@pytest.mark.parametrize("length", [2**62, 2**63 - 1, 2**63, 2**64 - 1])
@pytest.mark.parametrize("opcode", [0x05, 0x07, 0x08, 0x09, 0x80])
def test_records_longer_than_files_can_be(length: int, opcode: int, tmp_path: Path) -> None:
    """Behind a chunk whose messages nobody wants, where its message indexes stand."""
    output = io.BytesIO()
    writer = Writer(output, chunk_size=1, compression=CompressionType.NONE, index_types=IndexType.MESSAGE)
    writer.start()
    channels = {topic: writer.register_channel(topic, "json", 0) for topic, _, _ in dive()}
    messages: list[Message] = [*dive(), ("/depth", EPOCH + 10**12, {}), ("/depth", EPOCH + 10**12, {})]
    for topic, ns, fields in messages:
        writer.add_message(channels[topic], ns, json.dumps(fields).encode(), ns)
    data = bytearray(finished(writer, output))
    at = 8
    index = 0
    while data[at] != 0x0F:
        index = at if data[at] == 0x07 else index
        at += 9 + struct.unpack_from("<Q", data, at + 1)[0]
    struct.pack_into("<BQ", data, index, opcode, length)
    trial = read_mcap(tmp_path, bytes(data[:at]))
    assert trial.measured.sum() == 400
    assert any(remark.kind == "truncated" for remark in trial.remarks)


LOOSE = mcap_bytes(dive(), chunked=False, summary=False, indexed=False)


def pictures(count: int, size: int = 1_000_000) -> Iterator[bytes]:
    """Messages of a camera, which take a hundredth when packed."""
    yield channel(100, "/camera")
    noise = np.random.default_rng(1)
    for _ in range(count):
        picture = noise.bytes(size // 90)
        yield record(5, struct.pack("<HIQQ", 100, 0, EPOCH, EPOCH) + picture + bytes(size - len(picture)))


@pytest.mark.skipif(not STATUS.exists(), reason="/proc/self/status is missing, which has the peak memory")
@pytest.mark.parametrize("compression", ["zstd", "lz4"])
def test_a_large_chunk_is_not_held(compression: str, config: Config, tmp_path: Path) -> None:
    output = io.BytesIO()
    size = sum(map(len, pictures(400)))
    if compression == "zstd":
        with zstandard.ZstdCompressor().stream_writer(output, closefd=False) as out:
            for part in pictures(400):
                out.write(part)
    else:
        with lz4.frame.LZ4FrameFile(output, "wb") as file:
            for part in pictures(400):
                file.write(part)
    packed = output.getvalue()
    assert 2e6 < len(packed) < 10e6
    path = in_front(tmp_path / "dive.mcap", chunk_head(compression, len(packed), size) + packed)
    assert read_apart(path) == "400"


@pytest.mark.slow
@pytest.mark.skipif(not STATUS.exists(), reason="/proc/self/status is missing, which has the peak memory")
def test_large_records_are_not_held(config: Config, tmp_path: Path) -> None:
    """A picture, an attachment, a metadata record, a chunk that is not packed: each a hole of 400 MB in the file."""
    size = 400_000_000
    path = tmp_path / "dive.mcap"
    with path.open("wb") as file:

        def hole(head: bytes) -> None:
            file.write(head)
            file.truncate(file.tell() + size)
            file.seek(0, io.SEEK_END)

        picture = struct.pack("<BQHIQQ", 5, 22 + size, 100, 0, EPOCH, EPOCH)
        file.write(MAGIC + channel(100, "/camera"))
        hole(picture)
        hole(struct.pack("<BQ", 9, size))
        hole(struct.pack("<BQ", 12, size))
        hole(chunk_head("", len(picture) + size, len(picture) + size) + picture)
        body = WHOLE[len(MAGIC) : -len(MAGIC) - 29]
        start = len(MAGIC)  # which is no summary, but all of the file
        file.write(body + struct.pack("<BQQQI", 2, 20, start, 0, 0) + MAGIC)
    assert read_apart(path) == "400"


def one_message(file: IO[bytes], encoding: str, schema: tuple[str, str, bytes], payload: bytes) -> None:
    writer = Writer(file)
    writer.start()
    number = writer.register_schema(*schema)
    heading = writer.register_channel("/phins/heading", encoding, number)
    for ns in range(20):
        writer.add_message(heading, EPOCH + ns * 10**9, payload, EPOCH)
    writer.finish()  # type: ignore[no-untyped-call]  # the library leaves its annotation out


def recursive(fields: int, depth: int) -> tuple[bytes, bytes]:
    """A protobuf message of itself, and one that is ``depth`` deep."""
    file = descriptor_pb2.FileDescriptorProto(name="deep.proto", package="test", syntax="proto3")
    message = file.message_type.add(name="Deep")
    for number in range(1, fields + 1):
        message.field.add(name=f"f{number}", number=number, type=11, label=1, type_name=".test.Deep")
    payload = b""
    for _ in range(depth):
        length, head = len(payload), bytearray(b"\x0a")
        while length > 127:
            head.append(length & 127 | 128)
            length >>= 7
        payload = bytes([*head, length]) + payload
    return descriptor_pb2.FileDescriptorSet(file=[file]).SerializeToString(), payload


DEEP: dict[str, tuple[str, tuple[str, str, bytes], bytes, str]] = {
    "json": ("json", ("any", "jsonschema", b"{}"), b'{"data":' * 90_000, "decoded"),
    "protobuf": ("protobuf", ("test.Deep", "protobuf", recursive(3, 2000)[0]), recursive(3, 2000)[1], "decoded"),
    "protobuf, wide": ("protobuf", ("test.Deep", "protobuf", recursive(1500, 1)[0]), b"", "never holds the field"),
    "ros2": ("cdr", ("a/A", "ros2msg", b"B b\n===\nMSG: a/B\nA a\n"), bytes(9), "parsed"),
    "ros2, a list of all memory": ("cdr", ("a/A", "ros2msg", b"float64[4000000000] x"), bytes(9), "cannot be decoded"),
    "ros2, a list of more": ("cdr", ("a/A", "ros2msg", b"float64[" + b"9" * 5000 + b"] x"), bytes(9), "parsed"),
}


@pytest.mark.parametrize("name", DEEP)
def test_deep_and_recursive_messages(name: str, config: Config, tmp_path: Path) -> None:
    encoding, schema, payload, words = DEEP[name]
    path = tmp_path / "dive.mcap"
    with path.open("wb") as file:
        one_message(file, encoding, schema, payload)
    with pytest.raises(LogError, match=words) as caught:
        mcap_reader.read(path, config.for_format("mcap"))
    assert len(str(caught.value)) < 1000


@pytest.mark.parametrize("parts", [("sec", "nanosec"), ("secs", "nsecs")])
@pytest.mark.parametrize("clock", ["at", "at.{}"])
def test_a_field_of_seconds_and_nanoseconds_is_a_clock(parts: tuple[str, str], clock: str, tmp_path: Path) -> None:
    with (tmp_path / "a.mcap").open("wb") as file:
        writer = Writer(file)
        writer.start()
        channel = writer.register_channel("/state", "json", 0)
        for at, heading in zip(TIME.tolist(), HEADING.tolist(), strict=True):
            ns = EPOCH + round(at * 1e9)
            stamp = {parts[0]: ns // 10**9, parts[1]: ns % 10**9}
            payload = json.dumps({"at": stamp, "heading": heading % 360.0, "u": 1.0}).encode()
            writer.add_message(channel, EPOCH, payload, EPOCH)
        writer.finish()  # type: ignore[no-untyped-call]  # the library leaves its annotation out
    time = f'time = {{ mcap = "{clock.format(parts[0])}" }}'
    text = toml(time=time, heading='heading = { mcap = "/state.heading" }', command='{ mcap = "/state.u" }')
    trial = read_log(tmp_path / "a.mcap", campaign(tmp_path, text))
    np.testing.assert_allclose(trial.time[trial.measured], TIME, atol=1e-9)
    assert trial.start_epoch == pytest.approx(EPOCH / 1e9)
