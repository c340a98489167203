"""MCAP files that claim or hold too much: bounded memory and time, and one message on what is too large."""

from __future__ import annotations

import io
import json
import struct
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import IO

import lz4.frame
import numpy as np
import pytest
import zstandard
from google.protobuf import descriptor_pb2
from mcap.writer import CompressionType, IndexType, Writer

from rovid.campaign.config import Config
from rovid.ground.errors import LogError
from rovid.readers import mcap_reader
from tests.readers.logs import EPOCH, Message, campaign, dive, finished, mcap_bytes, read_mcap

MAGIC = b"\x89MCAP0\r\n"
WHOLE = mcap_bytes(dive(), summary=False, indexed=False)
LOOSE = mcap_bytes(dive(), chunked=False, summary=False, indexed=False)
STATUS = Path("/proc/self/status")
# What a fresh interpreter needs to read a log is 130 MB or so; the columns here are of no size.
READ = f"""
import sys
from pathlib import Path
from rovid.campaign.config import load_config
from rovid.ground.errors import RovidError
from rovid.readers import read_log
try:
    trial = read_log(Path(sys.argv[2]), load_config(Path(sys.argv[1])))
    print(trial.measured.sum(), *(remark.text for remark in trial.remarks))
except RovidError as error:
    print(error)
print(Path("{STATUS}").read_text().split("VmHWM:")[1].split()[0])
"""


@pytest.fixture
def config(tmp_path: Path) -> Config:
    return campaign(tmp_path)


def read_apart(path: Path, config: Config) -> str:
    """What is said of the log; in little memory and time."""
    command = [sys.executable, "-W", "error", "-c", READ, str(config.path), str(path)]
    done = subprocess.run(command, capture_output=True, text=True, check=True, timeout=60)
    *said, peak = done.stdout.splitlines()
    assert int(peak) < 300_000, "more than 300 MB"
    assert not done.stderr
    return "\n".join(said)


def record(opcode: int, body: bytes) -> bytes:
    return struct.pack("<BQ", opcode, len(body)) + body


def channel(number: int, topic: str, encoding: str = "json", schema: int = 0) -> bytes:
    texts = b"".join(struct.pack("<I", len(text)) + text.encode() for text in (topic, encoding))
    return record(4, struct.pack("<HH", number, schema) + texts + struct.pack("<I", 0))


def chunk_head(name: str, packed: int, size: int) -> bytes:
    texts = struct.pack("<I", len(name)) + name.encode() + struct.pack("<Q", packed)
    body = struct.pack("<QQQI", 0, 0, size, 0) + texts
    return struct.pack("<BQ", 6, len(body) + packed) + body


def pictures(count: int, size: int = 1_000_000) -> Iterator[bytes]:
    """Messages of a camera, which take a hundredth when packed."""
    yield channel(100, "/camera")
    noise = np.random.default_rng(1)
    for _ in range(count):
        picture = noise.bytes(size // 90)
        yield record(5, struct.pack("<HIQQ", 100, 0, EPOCH, EPOCH) + picture + bytes(size - len(picture)))


def in_front(path: Path, more: bytes) -> Path:
    path.write_bytes(MAGIC + more + WHOLE[len(MAGIC) :])
    return path


@pytest.mark.skipif(not STATUS.exists(), reason="tells its memory in no such file")
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
    assert read_apart(path, config) == "400"


@pytest.mark.skipif(not STATUS.exists(), reason="tells its memory in no such file")
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
    assert read_apart(path, config) == "400"


@pytest.mark.skipif(not STATUS.exists(), reason="tells its memory in no such file")
@pytest.mark.parametrize("chunked", [True, False])
def test_a_wanted_message_that_is_too_large(chunked: bool, config: Config, tmp_path: Path) -> None:
    """Thirty times its size as objects is more than there may be."""
    large = b'{"data": [' + b"{}," * 10_000_000 + b"1]}"
    message = record(5, struct.pack("<HIQQ", 7, 0, EPOCH, EPOCH) + large)
    part = channel(7, "/phins/heading") + message
    path = in_front(tmp_path / "dive.mcap", chunk_head("", len(part), len(part)) + part if chunked else part)
    said = read_apart(path, config)
    assert "topic '/phins/heading' has a message of 30.0 MB; at most 4.2 MB was expected" in said
    assert said.count("\n") == 0


def test_a_message_that_is_too_large_does_not_keep_init_from_the_others(tmp_path: Path) -> None:
    large = record(5, struct.pack("<HIQQ", 100, 0, EPOCH, EPOCH) + bytes(5_000_000))
    path = in_front(tmp_path / "dive.mcap", channel(100, "/camera") + large)
    assert "/phins/heading.data" in mcap_reader.sources(path).sources


@pytest.mark.parametrize("opcode", [3, 4])
def test_a_schema_or_channel_that_is_too_large(opcode: int, config: Config, tmp_path: Path) -> None:
    path = in_front(tmp_path / "dive.mcap", record(opcode, bytes(5_000_000)))
    with pytest.raises(LogError, match=r"a schema or channel is larger than 4\.2 MB"):
        mcap_reader.read(path, config.of("mcap"))


def test_schemas_that_are_too_large_together(config: Config, tmp_path: Path) -> None:
    def schema(number: int) -> bytes:
        return record(3, struct.pack("<HIII", number, 0, 0, 4_000_000) + bytes(4_000_000))

    path = in_front(tmp_path / "dive.mcap", b"".join(map(schema, range(1, 20))))
    with pytest.raises(LogError, match="its schemas and channels are larger than 67 MB"):
        mcap_reader.read(path, config.of("mcap"))


def test_small_bombs_are_one_large_one(config: Config, tmp_path: Path) -> None:
    """Each chunk alone may be of this size, for some are; a thousand of them in a small file are not."""
    packed = zstandard.compress(b"\x80" + struct.pack("<Q", 60_000_000) + bytes(60_000_000))
    bomb = chunk_head("zstd", len(packed), 60_000_009) + packed
    path = in_front(tmp_path / "dive.mcap", bomb * 1000)
    with pytest.raises(LogError, match="a chunk claims a size out of proportion"):
        mcap_reader.read(path, config.of("mcap"))


def test_a_frame_that_wants_too_much_memory_to_be_unpacked(tmp_path: Path) -> None:
    wide = zstandard.ZstdCompressionParameters(window_log=27)
    packer = zstandard.ZstdCompressor(compression_params=wide).compressobj()  # of a size that it does not know
    packed = packer.compress(bytes(1000)) + packer.flush()
    bomb = chunk_head("zstd", len(packed), 1000) + packed
    end = len(LOOSE) - 29 - len(MAGIC)
    trial = read_mcap(tmp_path, LOOSE[: end - 13] + bomb + LOOSE[end - 13 :])
    assert any("does not unpack" in remark.text for remark in trial.remarks)


# --- lengths ------------------------------------------------------------------------------------------------------


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


# --- depth --------------------------------------------------------------------------------------------------------


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
    "ros2": ("cdr", ("a/A", "ros2msg", b"B b\n===\nMSG: a/B\nA a\n"), bytes(9), "one inside another too deep"),
    "ros2, many": (
        "cdr",
        ("a/A", "ros2msg", b"B[] b\n===\nMSG: a/B\n"),
        b"\0\1\0\0" + struct.pack("<I", 200_000) + bytes(200_000),
        "too many messages",
    ),
    "ros2, a list of all memory": ("cdr", ("a/A", "ros2msg", b"float64[4000000000] x"), bytes(9), "shorter"),
    "ros2, a list of more": ("cdr", ("a/A", "ros2msg", b"float64[" + b"9" * 5000 + b"] x"), bytes(9), "parsed"),
}


@pytest.mark.parametrize("name", DEEP)
def test_deep_and_recursive_messages(name: str, config: Config, tmp_path: Path) -> None:
    encoding, schema, payload, words = DEEP[name]
    path = tmp_path / "dive.mcap"
    with path.open("wb") as file:
        one_message(file, encoding, schema, payload)
    with pytest.raises(LogError, match=words) as caught:
        mcap_reader.read(path, config.of("mcap"))
    assert len(str(caught.value)) < 1000
