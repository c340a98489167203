"""One and the same short run, written in every format but CSV and MCAP."""

from __future__ import annotations

import io
import json
import struct
import tempfile
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from rosbags.rosbag1 import Writer as Rosbag1
from rosbags.rosbag2 import Writer as Rosbag2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from scipy.io import savemat

from rovid.core.array_types import FloatArray
from tests.readers.logs import EPOCH, turning

TIME, HEADING = turning(300)
CHANGES = ((0.0, 1.0), (3.017, 2.0), (7.033, 3.0))
Row = tuple[str, tuple[object, ...]]


@dataclass(frozen=True, kw_only=True)
class Recording:
    """A format, and the run in it."""

    write: Callable[[], bytes]  # Makes its bytes.
    heading: str  # As in rovid.toml; empty where the format has a standard one.
    command: str  # As in rovid.toml.
    tolerance: float = 1e-6
    beside: Mapping[str, str] = field(default_factory=dict)  # Suffix -> text of another file of the same name.


# --- ArduPilot DataFlash ------------------------------------------------------------------------------------------

_BIN_LETTERS = {"Q": "Q", "I": "I", "f": "f", "B": "B", "H": "H", "C": "H"}
_BIN_MESSAGES = {"ATT": ("Qf", "TimeUS,Yaw"), "RCOU": ("QH", "TimeUS,C1"), "BAT": ("QBC", "TimeUS,Inst,Volt")}


# Before 2015.
OLD_MESSAGES = {"ATT": ("If", "TimeMS,Yaw"), "RCOU": ("IHH", "TimeMS,Ch1,Ch2")}


def dataflash(rows: list[Row], messages: Mapping[str, tuple[str, str]] = _BIN_MESSAGES) -> bytes:
    """A DataFlash log of ``messages``: ATT, RCOU and BAT."""
    kinds, data = {}, b""
    for number, (name, (letters, labels)) in enumerate(messages.items(), start=1):
        form = struct.Struct("<" + "".join(_BIN_LETTERS[letter] for letter in letters))
        kinds[name] = (bytes([number]), form)
        texts = name.encode(), letters.encode(), labels.encode()
        data += b"\xa3\x95\x80" + struct.pack("<BB4s16s64s", number, 3 + form.size, *texts)
    for name, values in rows:
        mark, form = kinds[name]
        data += b"\xa3\x95" + mark + form.pack(*values)
    return data


def _bin() -> bytes:
    rows: list[Row] = [("ATT", (int(1e6 * t), h % 360.0)) for t, h in zip(TIME, HEADING, strict=True)]
    rows += [("RCOU", (int(1e6 * t), int(c))) for t, c in CHANGES]
    return dataflash(sorted(rows, key=lambda row: row[1][0]))  # type: ignore[arg-type, return-value]


# --- Parquet ------------------------------------------------------------------------------------------------------


def parquet(columns: Mapping[str, Any]) -> bytes:
    """A table of ``columns``."""
    out = io.BytesIO()
    pq.write_table(pa.table(dict(columns)), out)
    return out.getvalue()


def table() -> dict[str, FloatArray]:
    """The run as columns."""
    command = np.select([at <= TIME for at, _ in CHANGES[::-1]], [value for _, value in CHANGES[::-1]])
    return {"time_s": TIME, "heading_deg": HEADING % 360.0, "fore_V": command}


# --- JSON lines and MATLAB ----------------------------------------------------------------------------------------


def json_lines(rows: Iterable[Mapping[str, Any]]) -> bytes:
    """One object a line."""
    return "".join(json.dumps(row) + "\n" for row in rows).encode()


def _jsonl() -> bytes:
    columns = {name: values.tolist() for name, values in table().items()}
    return json_lines(dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True))


def mat(variables: Mapping[str, Any]) -> bytes:
    """A MATLAB file of version 7."""
    with tempfile.TemporaryDirectory() as folder:
        savemat(f"{folder}/a.mat", dict(variables), do_compression=True)
        return Path(folder, "a.mat").read_bytes()


# --- PX4 ULog -----------------------------------------------------------------------------------------------------

_ULG_FORMATS = {
    "vehicle_attitude": ("uint64_t timestamp;float[4] q;", "<Q4f"),
    "actuator_motors": ("uint64_t timestamp;float[2] control;", "<Q2f"),
}


def ulog(rows: list[Row]) -> bytes:
    """A ULog; the topic of a row may name its instance, ``actuator_motors#1``."""

    def message(kind: bytes, body: bytes) -> bytes:
        return struct.pack("<HB", len(body), kind[0]) + body

    data = b"ULog\x01\x12\x35\x01" + struct.pack("<Q", 0) + message(b"B", bytes(40))
    for name, (fields, _) in _ULG_FORMATS.items():
        data += message(b"F", f"{name}:{fields}".encode())
    numbers = {topic: number for number, topic in enumerate(dict.fromkeys(topic for topic, _ in rows))}
    for topic, number in numbers.items():
        name, _, instance = topic.partition("#")
        data += message(b"A", struct.pack("<BH", int(instance or 0), number) + name.encode())
    for topic, values in rows:
        form = _ULG_FORMATS[topic.partition("#")[0]][1]
        data += message(b"D", struct.pack("<H", numbers[topic]) + struct.pack(form, *values))
    return data


def attitude(microseconds: float, heading: float, roll: float = 0.0) -> Row:
    """A message that turns by ``heading`` deg and then rolls."""
    z, x = 0.5 * np.deg2rad(heading), 0.5 * np.deg2rad(roll)
    quaternion = np.cos(z) * np.cos(x), np.cos(z) * np.sin(x), np.sin(z) * np.sin(x), np.sin(z) * np.cos(x)
    return "vehicle_attitude", (int(microseconds), *map(float, quaternion))


def _ulg() -> bytes:
    rows = [attitude(1e6 * t, h) for t, h in zip(TIME, HEADING, strict=True)]
    rows += [("actuator_motors", (int(1e6 * t), c, 0.0)) for t, c in CHANGES]
    return ulog(sorted(rows, key=lambda row: row[1][0]))  # type: ignore[arg-type, return-value]


# --- ROS bags -----------------------------------------------------------------------------------------------------

Said = tuple[str, str, float, dict[str, Any]]  # topic, type, s, fields
_STAMPED = "std_msgs/Header header\nfloat64 data\nfloat64[3] list\n"


def said() -> list[Said]:
    """Heading and command with a header, and an attitude."""
    rows: list[Said] = []
    for at, heading in zip(TIME.tolist(), HEADING.tolist(), strict=True):
        fields = {"data": heading % 360.0, "list": [1.0, 2.0, heading % 360.0]}
        rows.append(("/phins/heading", "test_msgs/msg/Stamped", at, fields))
        z = np.deg2rad(heading) / 2.0
        quaternion = {"x": 0.0, "y": 0.0, "z": float(np.sin(z)), "w": float(np.cos(z))}
        rows.append(("/attitude", "geometry_msgs/msg/Quaternion", at, quaternion))
    rows += [("/thrusters/fore", "std_msgs/msg/Float32", at, {"data": value}) for at, value in CHANGES]
    return sorted(rows, key=lambda row: row[2])


def bag(rows: list[Said], *, ros: int) -> bytes:
    """A ROS 1 bag or a ROS 2 database."""
    store = get_typestore(Stores.ROS1_NOETIC if ros == 1 else Stores.ROS2_HUMBLE)
    store.register(get_types_from_msg(_STAMPED, "test_msgs/msg/Stamped"))
    serialize = store.serialize_ros1 if ros == 1 else store.serialize_cdr
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / ("a.bag" if ros == 1 else "a")
        with Rosbag1(path) if ros == 1 else Rosbag2(path, version=9) as writer:
            connections: dict[str, Any] = {}
            for topic, kind, at, fields in rows:
                if topic not in connections:
                    connections[topic] = writer.add_connection(topic, kind, typestore=store)
                ns = EPOCH + round(at * 1e9)
                writer.write(connections[topic], ns, serialize(_message(store, kind, ns, fields), kind))
        return (path if ros == 1 else path / "a.db3").read_bytes()


def _message(store: Any, kind: str, ns: int, fields: dict[str, Any]) -> Any:
    if kind != "test_msgs/msg/Stamped":
        return store.types[kind](**fields)
    stamp = store.types["builtin_interfaces/msg/Time"](sec=ns // 10**9, nanosec=ns % 10**9)
    sequence = {"seq": 0} if "seq" in store.types["std_msgs/msg/Header"].__dataclass_fields__ else {}
    header = store.types["std_msgs/msg/Header"](stamp=stamp, frame_id="phins", **sequence)
    return store.types[kind](header=header, data=fields["data"], list=np.array(fields["list"]))


# --- MAVLink telemetry --------------------------------------------------------------------------------------------

Sent = tuple[float, int, Any]  # s, system, message


def tlog(rows: list[Sent], *, version: int = 2) -> bytes:
    """Telemetry of ``rows``."""
    senders: dict[int, Any] = {}
    data = b""
    for at, system, message in rows:
        sender = senders.setdefault(system, mavlink.MAVLink(None, srcSystem=system, srcComponent=1))
        frame = bytes(message.pack(sender, force_mavlink1=version == 1))
        sender.seq = (sender.seq + 1) % 256
        data += struct.pack(">Q", EPOCH // 1000 + round(at * 1e6)) + frame
    return data


def attitude_sent(at: float, heading: float, system: int = 1) -> Sent:
    """An attitude in deg."""
    yaw = float((np.deg2rad(heading) + np.pi) % (2.0 * np.pi) - np.pi)
    return at, system, mavlink.MAVLink_attitude_message(int(1e3 * at), 0.0, 0.0, yaw, 0.0, 0.0, 0.0)


def servos_sent(at: float, first: int, port: int = 0, system: int = 1) -> Sent:
    """Eight servos, of which the fourth is ``first``."""
    values = [1500, 1500, 1500, first, *[1500] * 4]
    return at, system, mavlink.MAVLink_servo_output_raw_message(int(1e6 * at), port, *values)


def _tlog() -> bytes:
    rows = [attitude_sent(t, h) for t, h in zip(TIME.tolist(), HEADING.tolist(), strict=True)]
    rows += [servos_sent(t, int(c)) for t, c in CHANGES]
    return tlog(sorted(rows, key=lambda row: row[0]))


# --- NMEA ---------------------------------------------------------------------------------------------------------

BEGIN = datetime(2026, 1, 7, 12, tzinfo=UTC)  # EPOCH


def sentence(text: str, front: str = "") -> str:
    """A line, with its checksum."""
    checksum = 0
    for byte in text.encode():
        checksum ^= byte
    return f"{front}${text}*{checksum:02X}\r\n"


def iso(at: float) -> str:
    """The time ``at`` s after the beginning."""
    return (BEGIN + timedelta(seconds=at)).isoformat()


def _nmea() -> bytes:
    pairs = zip(TIME.tolist(), HEADING.tolist(), strict=True)
    return "".join(sentence(f"HEHDT,{h % 360.0:.6f},T", f"{iso(t)} ") for t, h in pairs).encode()


COMMANDS_BESIDE = "time_s,fore_V\n" + "".join(f"{iso(t)},{c}\n" for t, c in (*CHANGES, (20.0, 4.0)))


def _recorded(ros: int) -> Recording:
    heading = 'heading = { mcap = "/phins/heading.data", unit = "deg" }'
    return Recording(write=lambda: bag(said(), ros=ros), heading=heading, command='{ mcap = "/thrusters/fore.data" }')


RECORDINGS: Mapping[str, Recording] = {
    **{
        suffix: Recording(write=write, heading='heading = { csv = "heading_deg" }', command='{ csv = "fore_V" }')
        for suffix, write in {
            ".parquet": lambda: parquet(table()),
            ".jsonl": _jsonl,
            ".ndjson": _jsonl,
            ".mat": lambda: mat(table()),
        }.items()
    },
    ".bag": _recorded(1),
    ".db3": _recorded(2),
    ".BIN": Recording(write=_bin, heading="", command='{ bin = "RCOU.C1" }', tolerance=1e-5),
    ".tlog": Recording(write=_tlog, heading="", command='{ tlog = "SERVO_OUTPUT_RAW.servo4_raw" }', tolerance=1e-4),
    ".nmea": Recording(
        write=_nmea,
        heading='heading = { nmea = "heading", unit = "deg" }',
        command='{ csv = "fore_V" }',
        beside={".csv": COMMANDS_BESIDE},
        tolerance=1e-5,
    ),
    ".ulg": Recording(write=_ulg, heading="", command='{ ulg = "actuator_motors.control[0]" }', tolerance=1e-4),
}
