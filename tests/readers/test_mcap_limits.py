"""MCAP files that claim or hold too much: bounded memory and time, and one message on what is too large."""

from __future__ import annotations

import io
import json
import struct
from pathlib import Path

import pytest
from mcap.writer import CompressionType, IndexType, Writer

from rovid.readers import mcap_reader
from rovid.trial.config import Config
from tests.readers.apart import STATUS, read
from tests.readers.logs import EPOCH, Message, dive, finished, mcap_bytes, read_mcap

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


@pytest.mark.skipif(not STATUS.exists(), reason="tells its memory in no such file")
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
