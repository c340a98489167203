"""Writes one simulated run as CSV, as MCAP with JSON messages, or as MCAP with ROS 2 messages."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from mcap.writer import CompressionType
from mcap.writer import Writer as McapWriter
from mcap_ros2.writer import Writer as Ros2Writer

from tools.channels import CHANNELS, column
from tools.programme import Format
from tools.simulate import MICRO, Held
from tools.truth import FloatArray, IntArray, Unit

_SUPPLY_EVERY = 20  # samples; the supply is logged at 1 Hz in MCAP

_FLOAT64 = "float64 data"
_IMU = """\
std_msgs/Header header
geometry_msgs/Quaternion orientation
float64[9] orientation_covariance
geometry_msgs/Vector3 angular_velocity
float64[9] angular_velocity_covariance
geometry_msgs/Vector3 linear_acceleration
float64[9] linear_acceleration_covariance
================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
================================================================================
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
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

_NUMBER = {"type": "number"}
_STAMP = {"type": "object", "properties": {"sec": {"type": "integer"}, "nanosec": {"type": "integer"}}}
_VALUE_SCHEMA = {"type": "object", "properties": {"data": _NUMBER}}
_STAMPED_SCHEMA = {
    "type": "object",
    "properties": {"header": {"type": "object", "properties": {"stamp": _STAMP}}, "data": _NUMBER},
}


@dataclass(frozen=True, kw_only=True, eq=False)
class Recording:
    """What the instruments of one run delivered, rounded as it is logged.

    Attributes
    ----------
    start
        us since the epoch, of the run's time 0.
    instant
        (n,) us since ``start``, of the samples.
    heading, roll, pitch
        (n,) deg; heading clockwise from north, 0 to 360.
    supply
        (n,) V.
    commands
        Thruster -> its command, with its own instants.
    unit
        Of the commands.
    channels
        Extra signal -> (n,), in its own unit.
    """

    start: int
    instant: IntArray
    heading: FloatArray
    roll: FloatArray
    pitch: FloatArray
    supply: FloatArray
    commands: Mapping[str, Held]
    unit: Unit = "V"
    channels: Mapping[str, FloatArray] = field(default_factory=dict)


def command_column(thruster: str, unit: Unit) -> str:
    """Name of the column of a thruster's command in a CSV log."""
    return f"{thruster}_{'command' if unit == '1' else unit}"


def write_csv(recording: Recording, path: Path) -> None:
    """Write a table with one row a sample; commands hold from their row to the next."""
    commands = {
        command_column(name, recording.unit): held.at(recording.instant) for name, held in recording.commands.items()
    }
    columns = {
        "time_s": (recording.instant / MICRO, "%.2f"),
        "heading_deg": (recording.heading, "%.3f"),
        **{name: (value, "%.4f") for name, value in commands.items()},
        "roll_deg": (recording.roll, "%.3f"),
        "pitch_deg": (recording.pitch, "%.3f"),
        "supply_V": (recording.supply, "%.2f"),
        **{column(name): (values, f"%.{CHANNELS[name].decimals}f") for name, values in recording.channels.items()},
    }
    write_table(columns, path)


def write_table(columns: Mapping[str, tuple[FloatArray, str]], path: Path) -> None:
    """Write a comma-separated table; ``columns`` are name -> (values of shape (n,), their %-format)."""
    table = np.column_stack([values for values, _ in columns.values()])
    formats = [form for _, form in columns.values()]
    np.savetxt(path, table, fmt=formats, delimiter=",", header=",".join(columns), comments="", newline="\n")


def write_json_mcap(recording: Recording, path: Path) -> None:
    """Write MCAP with JSON messages in lz4 chunks; the inertial navigation's messages bear a header."""
    with path.open("wb") as stream:
        writer = McapWriter(stream, compression=CompressionType.LZ4)
        writer.start()
        plain = writer.register_schema("Value", "jsonschema", json.dumps(_VALUE_SCHEMA).encode())
        stamped = writer.register_schema("StampedValue", "jsonschema", json.dumps(_STAMPED_SCHEMA).encode())
        channels: dict[str, int] = {}
        for instant, topic, value in _in_order(_values(recording)):
            bears_header = topic.startswith("/phins/")
            if topic not in channels:
                channels[topic] = writer.register_channel(topic, "json", stamped if bears_header else plain)
            nanoseconds = _nanoseconds(recording, instant)
            header = {"header": {"stamp": _stamp(nanoseconds)}} if bears_header else {}
            text = json.dumps({**header, "data": value}, separators=(",", ":"))
            writer.add_message(channels[topic], nanoseconds, text.encode(), nanoseconds)
        writer.finish()  # type: ignore[no-untyped-call]


def write_ros2_mcap(recording: Recording, path: Path) -> None:
    """Write MCAP with ROS 2 messages in zstd chunks: Float64, and Imu in the north, east, down convention."""
    with path.open("wb") as stream:
        writer = Ros2Writer(stream, compression=CompressionType.ZSTD)
        number = writer.register_msgdef("std_msgs/msg/Float64", _FLOAT64)
        imu = writer.register_msgdef("sensor_msgs/msg/Imu", _IMU)
        entries = [*_values(recording), *_orientations(recording)]
        for instant, topic, value in _in_order(iter(entries)):
            nanoseconds = _nanoseconds(recording, instant)
            if topic == "/phins/imu":
                writer.write_message(topic, imu, _imu_message(value, nanoseconds), nanoseconds)
            else:
                writer.write_message(topic, number, {"data": value}, nanoseconds)
        writer.finish()  # type: ignore[no-untyped-call]


WRITERS: Mapping[Format, tuple[str, Callable[[Recording, Path], None]]] = {
    "csv": (".csv", write_csv),
    "json": (".mcap", write_json_mcap),
    "ros2": (".mcap", write_ros2_mcap),
}


def _values(recording: Recording) -> Iterator[tuple[int, str, float]]:
    """(us, topic, value) of every scalar message, topic by topic."""
    thin = slice(None, None, _SUPPLY_EVERY)
    signals = {
        "/phins/heading": (recording.instant, recording.heading),
        "/phins/roll": (recording.instant, recording.roll),
        "/phins/pitch": (recording.instant, recording.pitch),
        "/power/supply": (recording.instant[thin], recording.supply[thin]),
        **{f"/thrusters/{name}": (held.instant, held.value) for name, held in recording.commands.items()},
        **{f"/extra/{name}": (recording.instant, values) for name, values in recording.channels.items()},
    }
    for topic, (instant, value) in signals.items():
        for us, number in zip(instant.tolist(), value.tolist(), strict=True):
            yield us, topic, number


def _orientations(recording: Recording) -> Iterator[tuple[int, str, FloatArray]]:
    """(us, topic, quaternion) of every sample, from the angles as they are logged."""
    angles = (recording.roll, recording.pitch, recording.heading)
    quaternions = ned_quaternion(*(np.radians(angle) for angle in angles))
    for us, quaternion in zip(recording.instant.tolist(), quaternions, strict=True):
        yield us, "/phins/imu", quaternion


def _in_order(entries: Iterator[tuple[int, str, Any]]) -> list[tuple[int, str, Any]]:
    return sorted(entries, key=lambda entry: entry[0])


def ned_quaternion(roll: FloatArray, pitch: FloatArray, yaw: FloatArray) -> FloatArray:
    """(n, 4) x, y, z, w of body z down against north, east, down; angles in rad, yaw clockwise from north."""
    (sr, cr), (sp, cp), (sy, cy) = ((np.sin(a / 2.0), np.cos(a / 2.0)) for a in (roll, pitch, yaw))
    return np.column_stack(
        [
            sr * cp * cy - cr * sp * sy,
            cr * sp * cy + sr * cp * sy,
            cr * cp * sy - sr * sp * cy,
            cr * cp * cy + sr * sp * sy,
        ]
    )


def _imu_message(quaternion: FloatArray, nanoseconds: int) -> dict[str, Any]:
    """Build the message of an instrument that gives attitude alone: -1 is ROS's mark for "not measured"."""
    absent = [-1.0, *[0.0] * 8]
    zero = {"x": 0.0, "y": 0.0, "z": 0.0}
    return {
        "header": {"stamp": _stamp(nanoseconds), "frame_id": "ned"},
        "orientation": dict(zip("xyzw", quaternion.tolist(), strict=True)),
        "orientation_covariance": [0.0] * 9,
        "angular_velocity": zero,
        "angular_velocity_covariance": absent,
        "linear_acceleration": zero,
        "linear_acceleration_covariance": absent,
    }


def _nanoseconds(recording: Recording, instant: int) -> int:
    return (recording.start + instant) * 1000


def _stamp(nanoseconds: int) -> dict[str, int]:
    return {"sec": nanoseconds // 1_000_000_000, "nanosec": nanoseconds % 1_000_000_000}
