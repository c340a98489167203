"""Writes small campaigns for the reader tests: rovid.toml, CSV, and MCAP in every encoding."""

from __future__ import annotations

import io
import json
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
from mcap.writer import CompressionType, IndexType, Writer
from mcap_ros2._dynamic import serialize_dynamic
from numpy.typing import ArrayLike, NDArray

from rovid.core.array_types import FloatArray
from rovid.readers import read_log
from rovid.trial.config import Config, load_config
from rovid.trial.trial import Trial

CURVE = "command,thrust_N\n-5,-500\n0,0\n5,1000\n"
HEADING = 'heading = { csv = "heading_deg", mcap = "/phins/heading.data", unit = "deg" }'
TIME = 'time = { csv = "time_s" }'
COMMAND = '{ csv = "fore_V", mcap = "/thrusters/fore.data" }'


def toml(*signals: str, time: str = TIME, heading: str = HEADING, command: str = COMMAND) -> str:
    lines = ["[[thrusters]]", 'name = "fore"', "yaw_arm = 0.86", 'curve = "curve.csv"', f"command = {command}"]
    return "\n".join([*lines, "[signals]", time, heading, *signals]) + "\n"


def campaign(folder: Path, text: str | None = None) -> Config:
    """Write rovid.toml and the thrust curve into ``folder``."""
    folder.mkdir(exist_ok=True)
    (folder / "curve.csv").write_text(CURVE)
    (folder / "rovid.toml").write_text(text or toml())
    return load_config(folder / "rovid.toml")


def kinds(trial: Trial) -> dict[str, int]:
    """Remark kind -> count."""
    found: dict[str, int] = {}
    for remark in trial.remarks:
        found[remark.kind] = found.get(remark.kind, 0) + remark.count
    return found


def turning(
    count: int = 400, rate: float = 8.0, interval: float = 0.05, seed: int = 1
) -> tuple[FloatArray, FloatArray]:
    """(time s, unwrapped heading deg) of a vehicle that turns steadily, with 0.01 deg of noise."""
    time = np.round(np.arange(count) * interval, 6)
    return time, 10.0 + rate * time + np.random.default_rng(seed).normal(0.0, 0.01, count)


def csv_text(columns: Mapping[str, ArrayLike], separator: str = ",", form: str = ".4f") -> str:
    """A table; strings are written as they are."""
    cells = [_cells(values, form) for values in columns.values()]
    rows = [separator.join(row) for row in zip(*cells, strict=True)]
    return "\n".join([separator.join(columns), *rows]) + "\n"


def _cells(values: ArrayLike, form: str) -> list[str]:
    array = np.asarray(values)
    if array.dtype.kind in "OU":
        return [str(value) for value in array]
    if array.dtype.kind == "i":
        return [str(value) for value in array.tolist()]
    return ["" if np.isnan(value) else format(value, form) for value in array.tolist()]


def standard(**changes: ArrayLike) -> dict[str, ArrayLike]:
    """The columns of an ordinary log, with some changed or added."""
    time, heading = turning()
    command = np.where(time < 10.0, 1.0, 2.0)
    return {"time_s": time, "heading_deg": heading % 360.0, "fore_V": command, **changes}


def read_csv(folder: Path, text: str | bytes, config: Config | None = None, name: str = "hold_3.csv") -> Trial:
    """Write ``text`` as a log and read it."""
    config = config or campaign(folder)
    data = text if isinstance(text, bytes) else text.encode()
    (folder / name).write_bytes(data)
    return read_log(folder / name, config)


# --- MCAP ------------------------------------------------------------------------------------------------

Message = tuple[str, int, Any]  # topic, ns, fields
Encoder = Callable[[Writer, str, Any], tuple[int, Callable[[Any], bytes]]]

STAMPED = """std_msgs/Header header
float64 data
float64[3] list
================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
"""
IMU = """std_msgs/Header header
geometry_msgs/Quaternion orientation
geometry_msgs/Vector3 angular_velocity
================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
================================================================================
MSG: geometry_msgs/Quaternion
float64 x
float64 y
float64 z
float64 w
================================================================================
MSG: geometry_msgs/Vector3
float64 x
float64 y
float64 z
"""


def encode_json(writer: Writer, topic: str, _fields: Any) -> tuple[int, Callable[[Any], bytes]]:
    schema = writer.register_schema(f"schema of {topic}", "jsonschema", b"{}")
    return writer.register_channel(topic, "json", schema), lambda fields: json.dumps(fields).encode()


def encode_ros2(writer: Writer, topic: str, fields: Any) -> tuple[int, Callable[[Any], bytes]]:
    name, text = ("sensor_msgs/msg/Imu", IMU) if "orientation" in fields else ("test_msgs/msg/Stamped", STAMPED)
    schema = writer.register_schema(name, "ros2msg", text.encode())
    encode = serialize_dynamic(name, text)[name]

    def encoded(values: Any) -> bytes:
        data: bytes = encode(values)
        return data

    return writer.register_channel(topic, "cdr", schema), encoded


def _proto_message(field_type: int) -> tuple[Any, bytes]:
    file = descriptor_pb2.FileDescriptorProto(name="stamped.proto", package="test", syntax="proto3")
    stamp = file.message_type.add(name="Stamp")
    stamp.field.add(name="seconds", number=1, type=3, label=1)
    stamp.field.add(name="nanos", number=2, type=5, label=1)
    message = file.message_type.add(name="Stamped")
    message.field.add(name="timestamp", number=1, type=11, label=1, type_name=".test.Stamp")
    message.field.add(name="data", number=2, type=field_type, label=1)
    message.field.add(name="list", number=3, type=1, label=3)
    pool = descriptor_pool.DescriptorPool()
    pool.Add(file)
    kind = message_factory.GetMessageClass(pool.FindMessageTypeByName("test.Stamped"))
    return kind, descriptor_pb2.FileDescriptorSet(file=[file]).SerializeToString()


def encode_protobuf(writer: Writer, topic: str, _fields: Any) -> tuple[int, Callable[[Any], bytes]]:
    kind, description = _proto_message(1)
    schema = writer.register_schema("test.Stamped", "protobuf", description)

    def encode(fields: Any) -> bytes:
        stamp = fields.get("header", {}).get("stamp", {"sec": 0, "nanosec": 0})
        message = kind(data=fields["data"], list=fields.get("list", []))
        message.timestamp.seconds, message.timestamp.nanos = stamp["sec"], stamp["nanosec"]
        data: bytes = message.SerializeToString()
        return data

    return writer.register_channel(topic, "protobuf", schema), encode


ENCODERS: dict[str, Encoder] = {"json": encode_json, "ros2": encode_ros2, "protobuf": encode_protobuf}
COMPRESSIONS = {"none": CompressionType.NONE, "lz4": CompressionType.LZ4, "zstd": CompressionType.ZSTD}


def mcap_bytes(
    messages: Sequence[Message],
    *,
    encoding: str = "json",
    compression: str = "none",
    chunked: bool = True,
    chunk_size: int = 4096,
    indexed: bool = True,
    summary: bool = True,
    publish_late: int = 0,
) -> bytes:
    """A recording of ``messages`` in their order."""
    output = io.BytesIO()
    writer = Writer(
        output,
        chunk_size=chunk_size,
        compression=COMPRESSIONS[compression],
        use_chunking=chunked,
        index_types=IndexType.ALL if indexed else IndexType.NONE,
        repeat_channels=summary,
        repeat_schemas=summary,
        use_statistics=summary,
        use_summary_offsets=summary,
    )
    writer.start()
    channels: dict[str, tuple[int, Callable[[Any], bytes]]] = {}
    for topic, ns, fields in messages:
        if topic not in channels:
            channels[topic] = ENCODERS[encoding](writer, topic, fields)
        channel, encode = channels[topic]
        writer.add_message(channel, ns, encode(fields), ns + publish_late)
    return finished(writer, output)


def finished(writer: Writer, output: io.BytesIO) -> bytes:
    """The whole recording."""
    writer.finish()  # type: ignore[no-untyped-call]  # the library leaves its annotation out
    return output.getvalue()


EPOCH = 1_767_787_200_000_000_000


def stamped(value: float, ns: int) -> dict[str, Any]:
    return {
        "header": {"stamp": {"sec": ns // 10**9, "nanosec": ns % 10**9}, "frame_id": "phins"},
        "data": float(value),
        "list": [0.0, 1.0, float(value)],
    }


def to_ns(time: ArrayLike) -> NDArray[np.int64]:
    return EPOCH + np.round(np.asarray(time) * 1e9).astype(np.int64)


def dive(count: int = 400, extra: Sequence[Message] = ()) -> list[Message]:
    """Heading at 20 Hz and a command on change, with a little other traffic."""
    time, heading = turning(count)
    messages: list[Message] = [("/phins/heading", int(ns), stamped(h, int(ns))) for ns, h in _pairs(time, heading)]
    for at, value in ((0.0, 1.0), (3.017, 1.5), (7.033, 2.0)):
        ns = int(to_ns(at))
        messages.append(("/thrusters/fore", ns, stamped(value, ns)))
    messages += [("/depth", int(ns), stamped(5.0, int(ns))) for ns in to_ns(time[::10])]
    return sorted([*messages, *extra], key=lambda message: message[1])


def _pairs(time: FloatArray, heading: FloatArray) -> list[tuple[int, float]]:
    return list(zip(to_ns(time).tolist(), np.round(heading % 360.0, 4).tolist(), strict=True))


def read_mcap(folder: Path, data: bytes, config: Config | None = None) -> Trial:
    """Write ``data`` as a recording and read it."""
    config = config or campaign(folder)
    (folder / "dive.mcap").write_bytes(data)
    return read_log(folder / "dive.mcap", config)
