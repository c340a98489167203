"""MCAP: encodings, clocks, fields, indexes, and what is said when something is missing."""

from __future__ import annotations

import io
import json
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.writer import Writer

from rovid.core.errors import ConfigError, LogError
from tests.readers.logs import (
    COMPRESSIONS,
    ENCODERS,
    EPOCH,
    Message,
    campaign,
    dive,
    finished,
    kinds,
    mcap_bytes,
    read_mcap,
    to_ns,
    toml,
    turning,
)

TIME, HEADING = turning()


def assert_dive(trial: Any) -> None:
    """The heading is exact, and the base holds the instants at which the command changed."""
    np.testing.assert_allclose(trial.time[trial.measured], TIME, atol=1e-9)
    np.testing.assert_allclose(trial.position[trial.measured], np.deg2rad(HEADING), atol=2e-6)  # four decimals
    np.testing.assert_allclose(trial.time[~trial.measured], [3.017, 7.033], atol=1e-9)
    expected = np.where(trial.time < 3.0169, 1.0, np.where(trial.time < 7.0329, 1.5, 2.0))
    np.testing.assert_array_equal(trial.commands[:, 0], expected)


@pytest.mark.parametrize("encoding", ENCODERS)
@pytest.mark.parametrize("compression", COMPRESSIONS)
@pytest.mark.parametrize("clock", ["log", "publish", "header"])
def test_encodings_compressions_clocks(encoding: str, compression: str, clock: str, tmp_path: Path) -> None:
    config = campaign(tmp_path, toml(time=f'time = {{ mcap = "{clock}" }}'))
    trial = read_mcap(tmp_path, mcap_bytes(dive(), encoding=encoding, compression=compression), config)
    assert_dive(trial)
    assert trial.remarks == ()


LAYOUTS: dict[str, dict[str, Any]] = {
    "unchunked": {"chunked": False},
    "without summary": {"summary": False, "indexed": False},
    "unchunked without summary": {"chunked": False, "summary": False, "indexed": False},
    "chunks without index": {"indexed": False},
    "message indexes only": {"summary": False},
    "one chunk": {"chunk_size": 1 << 24},
    "tiny chunks": {"chunk_size": 1},
}


@pytest.mark.parametrize("layout", LAYOUTS)
def test_layouts(layout: str, tmp_path: Path) -> None:
    trial = read_mcap(tmp_path, mcap_bytes(dive(), compression="zstd", **LAYOUTS[layout]))
    assert_dive(trial)
    assert trial.remarks == ()


def quaternion(yaw: float, roll: float = 0.0, pitch: float = 0.0) -> dict[str, float]:
    c, s = np.cos(np.array([roll, pitch, yaw]) / 2), np.sin(np.array([roll, pitch, yaw]) / 2)
    return {
        "w": float(c[0] * c[1] * c[2] + s[0] * s[1] * s[2]),
        "x": float(s[0] * c[1] * c[2] - c[0] * s[1] * s[2]),
        "y": float(c[0] * s[1] * c[2] + s[0] * c[1] * s[2]),
        "z": float(c[0] * c[1] * s[2] - s[0] * s[1] * c[2]),
    }


def test_time_from_a_field(tmp_path: Path) -> None:
    config = campaign(tmp_path, toml(time='time = { mcap = "own.t_us" }'))
    late = 10**9
    messages = [(topic, ns + late, {**fields, "own": {"t_us": ns // 1000}}) for topic, ns, fields in dive()]
    assert_dive(read_mcap(tmp_path, mcap_bytes(messages), config))
    config = campaign(tmp_path, toml(time='time = { mcap = "t" }'))
    messages = [(topic, ns + late, {**fields, "t": (ns - EPOCH) / 1e9}) for topic, ns, fields in dive()]
    assert_dive(read_mcap(tmp_path, mcap_bytes(messages), config))


def test_messages_outside_the_indexed_chunks_are_found(tmp_path: Path) -> None:
    """A writer may put messages beside its chunks; the index then leads to a part of them only."""
    messages = dive()
    data = bytearray(mcap_bytes(messages[:300]))
    ids = {topic: number + 1 for number, topic in enumerate(dict.fromkeys(topic for topic, _, _ in messages))}
    payload = [(ids[topic], ns, fields) for topic, ns, fields in messages[300:]]
    bodies = [struct.pack("<HIQQ", one, 0, ns, ns) + json.dumps(fields).encode() for one, ns, fields in payload]
    loose = b"".join(b"\x05" + struct.pack("<Q", len(body)) + body for body in bodies)
    end = next(at for at, opcode, _ in records(data) if opcode == 0x0F)
    for at, opcode, length in records(data, end):
        body = at + 9
        if opcode == 0x0B:  # statistics: more messages, in all and in each channel
            struct.pack_into("<Q", data, body, len(messages))
            for entry in range(body + 46, body + length, 10):
                channel, count = struct.unpack_from("<HQ", data, entry)
                more = sum(one == channel for one, _, _ in payload)
                struct.pack_into("<Q", data, entry + 2, count + more)
        if opcode == 0x02:  # footer: the summary moves, its checksum is not given
            struct.pack_into("<QQI", data, body, struct.unpack_from("<Q", data, body)[0] + len(loose), 0, 0)
    assert_dive(read_mcap(tmp_path, bytes(data[:end] + loose + data[end:])))


def records(data: bytes | bytearray, at: int = 8) -> Iterator[tuple[int, int, int]]:
    """(offset, opcode, length) of the records at the top level."""
    while at + 9 < len(data):
        opcode, length = struct.unpack_from("<BQ", data, at)
        yield at, opcode, length
        at += 9 + length


def changed(messages: list[Message], topic: str, **fields: Any) -> list[Message]:
    return [(t, ns, {**f, **fields} if t == topic else f) for t, ns, f in messages]


def without(messages: list[Message], topic: str) -> list[Message]:
    return [message for message in messages if message[0] != topic]


def one_encoding(message_encoding: str, schema_encoding: str, schema: bytes, payload: bytes) -> bytes:
    """A recording whose heading has this encoding and this payload."""
    output = io.BytesIO()
    writer = Writer(output)
    writer.start()
    number = writer.register_schema("test/Thing", schema_encoding, schema) if schema_encoding else 0
    channel = writer.register_channel("/phins/heading", message_encoding, number)
    for ns in to_ns(TIME).tolist():
        writer.add_message(channel, ns, payload, ns)
    return finished(writer, output)


BAD: dict[str, tuple[bytes, tuple[str, ...]]] = {
    "not an MCAP": (b"time_s,heading\n", ("dive.mcap", "is not an MCAP file")),
    "empty": (b"", ("is not an MCAP file",)),
    "only the mark": (b"\x89MCAP0\r\n", ("no topic", "cut")),
    "missing topic": (
        mcap_bytes([*without(dive(), "/phins/heading"), ("/phins/hdg", EPOCH, {"data": 1.0})]),
        ("no topic for '/phins/heading.data'", "Nearest: '/phins/hdg'", "heading"),
    ),
    "missing field": (
        mcap_bytes([(t, ns, {"value": f["data"], "q": {"a": 1}}) for t, ns, f in dive()]),
        ("never holds the field 'data'", "Its fields: value, q.a"),
    ),
    "text": (mcap_bytes(changed(dive(), "/phins/heading", data="12.5")), ("'12.5'", "a number", "/phins/heading.data")),
    "list": (mcap_bytes(changed(dive(), "/phins/heading", data=[1.0])), ("is a list",)),
    "dictionary": (mcap_bytes(changed(dive(), "/phins/heading", data={"a": 1})), ("is a dict", "data.a")),
    "quaternion for a command": (
        mcap_bytes(changed(dive(), "/thrusters/fore", data=quaternion(1.0))),
        ("/thrusters/fore.data", "a number was expected"),
    ),
    "not an object": (mcap_bytes([(t, ns, f["data"]) for t, ns, f in dive()]), ("never holds the field 'data'",)),
    "no JSON": (one_encoding("json", "", b"", b"{nonsense"), ("message 1 of topic '/phins/heading'", "decoded")),
    "bad UTF-8": (one_encoding("json", "", b"", b'{"data": "\xff\xfe"}'), ("message 1", "decoded")),
    "deep JSON": (one_encoding("json", "", b"", b"[" * 100_000), ("message 1", "decoded")),
    "long integer": (one_encoding("json", "", b"", b'{"data": ' + b"9" * 5000 + b"}"), ("message 1", "decoded")),
    "unknown encoding": (one_encoding("cbor", "", b"", b"x"), ("'cbor'", "json, cdr with ros2msg, or protobuf")),
    "ros1": (one_encoding("ros1", "ros1msg", b"float64 data", b"x"), ("'ros1'", "'ros1msg'")),
    "idl": (one_encoding("cdr", "ros2idl", b"struct", b"x"), ("'ros2idl'", "ros2msg")),
    "bad ros2 schema": (one_encoding("cdr", "ros2msg", b"no such field line = = \xff", b"x"), ("schema", "parsed")),
    "endless ros2 schema": (one_encoding("cdr", "ros2msg", b"test/Thing again", bytes(8)), ("schema", "parsed")),
    "bad protobuf schema": (one_encoding("protobuf", "protobuf", b"\xff\xff", b"x"), ("schema", "parsed")),
    "short ros2 message": (one_encoding("cdr", "ros2msg", b"float64 data", b"\0\1\0\0ab"), ("message 1", "decoded")),
    "empty ros2 message": (one_encoding("cdr", "ros2msg", b"float64 data", b""), ("message 1", "decoded")),
}


@pytest.mark.parametrize("name", BAD)
def test_bad_recordings(name: str, tmp_path: Path) -> None:
    data, words = BAD[name]
    with pytest.raises(LogError) as caught:
        read_mcap(tmp_path, data)
    for word in words:
        assert word in str(caught.value)


def test_header_time_that_is_not_there(tmp_path: Path) -> None:
    config = campaign(tmp_path, toml(time='time = { mcap = "header" }'))
    with pytest.raises(LogError, match=r"no time header\.stamp.*fields: data.*mcap = .log."):
        read_mcap(tmp_path, mcap_bytes([(t, ns, {"data": f["data"]}) for t, ns, f in dive()]), config)
    config = campaign(tmp_path, toml(time='time = { mcap = "own.t" }'))
    with pytest.raises(LogError, match=r"no time 'own\.t'"):
        read_mcap(tmp_path, mcap_bytes(dive()), config)


def test_times_beyond_all_calendars(tmp_path: Path) -> None:
    with pytest.raises(LogError, match="2262"):
        read_mcap(tmp_path, mcap_bytes([(topic, ns + 2**63, fields) for topic, ns, fields in dive()]))


def test_a_command_must_be_mapped_for_the_format(tmp_path: Path) -> None:
    config = campaign(tmp_path, toml(command='{ csv = "fore_V" }'))
    with pytest.raises(ConfigError, match=r"command\.fore names no mcap source"):
        read_mcap(tmp_path, mcap_bytes(dive()), config)


def chunk_places(data: bytes | bytearray) -> list[tuple[int, int]]:
    """(offset, length) of the chunk records."""
    return [(at, length) for at, opcode, length in records(data) if opcode == 0x06]


@pytest.mark.parametrize("summary", [True, False])
@pytest.mark.parametrize("compression", COMPRESSIONS)
@pytest.mark.parametrize("number", [1, 3])
def test_a_damaged_chunk_is_left_out(number: int, compression: str, summary: bool, tmp_path: Path) -> None:
    """The chunks after it are read, by the index at the end or one after the other."""
    data = bytearray(mcap_bytes(dive(), compression=compression, indexed=summary, summary=summary))
    offset, length = chunk_places(data)[number]
    data[offset + 9 + length - 200] ^= 0x10
    trial = read_mcap(tmp_path, bytes(data))
    (remark,) = (one for one in trial.remarks if one.kind == "damaged")
    assert remark.count == length + 9
    assert remark.text.startswith("A chunk is damaged: a chunk")
    readings = trial.position[trial.measured]
    whole = np.deg2rad(HEADING)
    assert len(readings) > 0.7 * len(whole)
    assert np.abs(readings[-1] - whole[-1]) < 2e-6
    assert all(np.abs(whole - reading).min() < 2e-6 for reading in readings)


@pytest.mark.parametrize("summary", [True, False])
def test_a_damaged_chunk_that_nobody_needs_does_no_harm(summary: bool, tmp_path: Path) -> None:
    """Chunks without a wanted topic are not even unpacked; the index at the end or behind the chunk tells."""
    image = ("/camera", int(to_ns(5.001)), {"image": "x" * 5000})
    messages = sorted([*dive(), image, ("/camera", EPOCH, {})], key=lambda message: message[1])
    data = bytearray(mcap_bytes(messages, compression="zstd", chunk_size=1, summary=summary))
    offset, length = max(chunk_places(data), key=lambda place: struct.unpack_from("<Q", data, place[0] + 25)[0])
    data[offset + 9 + length - 5] ^= 0x10
    trial = read_mcap(tmp_path, bytes(data))
    assert_dive(trial)
    assert trial.remarks == ()


SIZES = [0, 1, 2**31, 2**40, 2**63, 2**64 - 1]


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("field", [1, 25])
def test_lies_about_sizes(size: int, field: int, tmp_path: Path) -> None:
    """Record length (1) and unpacked size (25) of the fourth chunk; neither memory nor time runs away."""
    data = bytearray(mcap_bytes(dive(), compression="zstd", indexed=False, summary=False))
    offset, _ = chunk_places(data)[3]
    struct.pack_into("<Q", data, offset + field, size)
    trial = read_mcap(tmp_path, bytes(data))
    assert kinds(trial).keys() & {"truncated", "damaged"}
    assert 10 < trial.measured.sum() < 400


def test_unknown_compression(tmp_path: Path) -> None:
    data = mcap_bytes(dive(), compression="lz4", indexed=False, summary=False).replace(
        b"\x03\0\0\0lz4", b"\x03\0\0\0lz5"
    )
    with pytest.raises(LogError, match="'lz5'; lz4, zstd or nothing"):
        read_mcap(tmp_path, data)


def test_a_tail_of_nul_bytes(tmp_path: Path) -> None:
    data = mcap_bytes(dive(), summary=False, indexed=False)
    cut = chunk_places(data)[5][0]
    trial = read_mcap(tmp_path, data[:cut] + bytes(10_000))
    assert kinds(trial) == {"truncated": 10_000}


# Each compression, each encoding, and no chunks: the container is cut before the messages are decoded.
CUTS = [(True, "none", "json"), (True, "lz4", "ros2"), (True, "zstd", "protobuf"), (False, "none", "json")]


@pytest.mark.parametrize(("chunked", "compression", "encoding"), CUTS)
def test_cut_at_every_percent(chunked: bool, compression: str, encoding: str, tmp_path: Path) -> None:
    """What is left is a prefix of the whole, and the loss is said in bytes."""
    config = campaign(tmp_path)
    data = mcap_bytes(dive(), chunked=chunked, compression=compression, encoding=encoding, chunk_size=8192)
    whole = read_mcap(tmp_path, data, config)
    counts = []
    for percent in range(100):
        part = data[: len(data) * percent // 100]
        try:
            trial = read_mcap(tmp_path, part, config)
        except LogError:
            counts.append(0)
            continue
        counts.append(int(trial.measured.sum()))
        n = len(trial.time)
        np.testing.assert_array_equal(trial.time, whole.time[:n])
        np.testing.assert_array_equal(trial.position, whole.position[:n])
        np.testing.assert_array_equal(trial.commands, whole.commands[:n])
        if counts[-1] < 400:
            assert any(remark.kind == "truncated" for remark in trial.remarks)
    assert counts == sorted(counts)
    assert counts[50] > 100, "half the file holds more than a quarter of the samples"


@pytest.mark.parametrize("compression", COMPRESSIONS)
def test_a_cut_chunk_gives_up_its_whole_messages(compression: str, tmp_path: Path) -> None:
    data = mcap_bytes(dive(4000), compression=compression, chunk_size=1 << 20)
    (offset, length), *_ = chunk_places(data)
    trial = read_mcap(tmp_path, data[: offset + length // 2])
    assert 500 < trial.measured.sum() < 3500
    assert any("read from the damaged part" in remark.text for remark in trial.remarks)
