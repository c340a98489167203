"""The encodings of MCAP messages."""

from __future__ import annotations

import json
from pathlib import Path
from typing import IO

import numpy as np
import pytest
from google.protobuf import descriptor_pb2
from mcap.writer import Writer

from rovid.core.errors import LogError
from rovid.readers import mcap_reader, read_log
from rovid.trial.config import Config
from tests.readers.logs import EPOCH, campaign, toml
from tests.readers.recordings import HEADING, TIME


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
