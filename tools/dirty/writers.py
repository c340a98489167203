"""Writers of a run: CSV in one table or two, MCAP with JSON or ROS 2 messages, ROS 2 bag, DataFlash and ULog."""

from __future__ import annotations

import json
import struct
import tempfile
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from mcap.writer import Writer as McapWriter
from mcap_ros2.writer import Writer as Ros2Writer

from tools.dirty.campaign import Campaign, Log, Stream
from tools.dirty.vehicle import UNITS

Message = tuple[float, float, str, float]  # true instant in s, stamp in s, topic or field, value
_MOTION = {"heading": "heading_deg", "rate": "yaw_rate_dps"}
_FLOAT64 = "float64 data"


def command_column(thruster: str, unit: str) -> str:
    """Name of a command in a log."""
    return f"{thruster}_{'command' if unit == '1' else unit}"


def _table(path: Path, stamps: Any, columns: Mapping[str, tuple[Any, int, str]]) -> None:
    """Write a table; a column is values, decimals, and the text of a value that is absent."""
    texts = [[f"{stamp:.3f}" for stamp in stamps.tolist()]]
    for values, decimals, absent in columns.values():
        texts.append([absent if value != value else f"{value:.{decimals}f}" for value in values.tolist()])  # noqa: PLR0124
    lines = [",".join(["time_s", *columns]), *(",".join(row) for row in zip(*texts, strict=True))]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def _motion_columns(campaign: Campaign, stream: Stream) -> dict[str, tuple[Any, int, str]]:
    decimals = 5 if campaign.heading_unit != "deg" else 3 if campaign.noise < 0.03 else 2
    return {_MOTION[name]: (values, decimals, "") for name, values in stream.columns.items()}


def _thrust_columns(campaign: Campaign, stream: Stream) -> dict[str, tuple[Any, int, str]]:
    unit = campaign.vehicle.unit
    absent = campaign.absent_command
    return {command_column(name, unit): (v, UNITS[unit][2], absent) for name, v in stream.columns.items()}


def _csv(campaign: Campaign, log: Log, folder: Path) -> None:
    columns = _motion_columns(campaign, log.motion) | _thrust_columns(campaign, log.thrust)
    _table(folder / f"{log.name}.csv", log.origin + log.motion.stamps, columns)


def _two_tables(campaign: Campaign, log: Log, folder: Path) -> None:
    for part, stream, columns in (
        ("nav", log.motion, _motion_columns(campaign, log.motion)),
        ("thr", log.thrust, _thrust_columns(campaign, log.thrust)),
    ):
        _table(folder / f"{log.name}_{part}.csv", log.origin + stream.stamps, columns)


def _stamped(log: Log, stream: Stream) -> tuple[list[float], list[float]]:
    return stream.instants.tolist(), np.maximum(log.origin + stream.stamps, 0.0).tolist()


def _messages(log: Log, topics: Mapping[str, tuple[Stream, str]]) -> list[Message]:
    """Messages of ``topics`` (name -> stream and its column) in the order of their arrival."""
    messages: list[Message] = []
    for topic, (stream, column) in topics.items():
        instants, stamps = _stamped(log, stream)
        messages += zip(instants, stamps, [topic] * len(stamps), stream.columns[column].tolist(), strict=True)
    return sorted(messages, key=lambda message: message[0])


def _topics(log: Log) -> dict[str, tuple[Stream, str]]:
    motion = {f"/nav/{column}": (log.motion, column) for column in log.motion.columns}
    return motion | {f"/thrusters/{column}": (log.thrust, column) for column in log.thrust.columns}


def _json(campaign: Campaign, log: Log, folder: Path) -> None:
    """MCAP with a JSON message for each reading of the navigation and of all commands."""
    with (folder / f"{log.name}.mcap").open("wb") as file:
        writer = McapWriter(file)
        writer.start()
        entries = []
        for topic, stream in (("/nav", log.motion), ("/thrusters", log.thrust)):
            schema = writer.register_schema(topic.strip("/"), "jsonschema", b'{"type": "object"}')
            channel = writer.register_channel(topic, "json", schema)
            instants, stamps = _stamped(log, stream)
            rows = np.column_stack([*stream.columns.values()]).tolist()
            entries += [
                (i, s, channel, row, list(stream.columns)) for i, s, row in zip(instants, stamps, rows, strict=True)
            ]
        for _, stamp, channel, row, names in sorted(entries, key=lambda entry: entry[0]):
            fields = {
                name: round(value, 6)
                for name, value in zip(names, row, strict=True)
                if not (campaign.zeros_absent and value == 0.0)
            }
            nanoseconds = round(stamp * 1000.0) * 1_000_000
            writer.add_message(channel, nanoseconds, json.dumps(fields).encode(), nanoseconds)
        writer.finish()  # type: ignore[no-untyped-call]


def _ros2(campaign: Campaign, log: Log, folder: Path) -> None:
    """MCAP with a Float64 message for each value."""
    del campaign
    with (folder / f"{log.name}.mcap").open("wb") as file:
        writer = Ros2Writer(file)
        number = writer.register_msgdef("std_msgs/msg/Float64", _FLOAT64)
        for _, stamp, topic, value in _messages(log, _topics(log)):
            nanoseconds = round(stamp * 1000.0) * 1_000_000
            writer.write_message(topic, number, {"data": value}, nanoseconds)
        writer.finish()  # type: ignore[no-untyped-call]


def _db3(campaign: Campaign, log: Log, folder: Path) -> None:
    """ROS 2 bag in SQLite."""
    from rosbags.rosbag2 import Writer as BagWriter
    from rosbags.typesys import Stores, get_typestore

    del campaign
    store = get_typestore(Stores.ROS2_HUMBLE)
    kind = store.types["std_msgs/msg/Float64"]
    with tempfile.TemporaryDirectory() as room:
        with BagWriter(Path(room) / "bag", version=9) as writer:
            topics = {t: writer.add_connection(t, "std_msgs/msg/Float64", typestore=store) for t in _topics(log)}
            for _, stamp, topic, value in _messages(log, _topics(log)):
                data = store.serialize_cdr(kind(value), "std_msgs/msg/Float64")
                writer.write(topics[topic], round(stamp * 1000.0) * 1_000_000, data)
        (folder / f"{log.name}.db3").write_bytes(next((Path(room) / "bag").glob("*.db3")).read_bytes())


def _bin(campaign: Campaign, log: Log, folder: Path) -> None:
    """DataFlash with ATT, RATE and RCOU messages."""
    del campaign
    count = len(log.thrust.columns)
    kinds = {
        "ATT": ("Qf", "TimeUS,Yaw", struct.Struct("<Qf")),
        "RATE": ("Qf", "TimeUS,Y", struct.Struct("<Qf")),
        "RCOU": (
            "Q" + "H" * count,
            ",".join(["TimeUS", *(f"C{k + 1}" for k in range(count))]),
            struct.Struct(f"<Q{count}H"),
        ),
    }
    parts = []
    for number, (name, (letters, labels, form)) in enumerate(kinds.items(), start=1):
        texts = name.encode(), letters.encode(), labels.encode()
        parts.append(b"\xa3\x95\x80" + struct.pack("<BB4s16s64s", number, 3 + form.size, *texts))
    for name, stamp, values in _rows(log, "ATT", "RATE", "RCOU"):
        number = list(kinds).index(name) + 1
        whole = [int(value) for value in values] if name == "RCOU" else values
        parts.append(b"\xa3\x95" + bytes([number]) + kinds[name][2].pack(round(1e6 * stamp), *whole))
    (folder / f"{log.name}.BIN").write_bytes(b"".join(parts))


def _rows(log: Log, heading: str, rate: str, commands: str) -> list[tuple[str, float, list[float]]]:
    """(message, stamp in s, values) of a log in the order of arrival."""
    entries = []
    for name, stream, columns in (
        (heading, log.motion, ["heading"]),
        (rate, log.motion, ["rate"]),
        (commands, log.thrust, list(log.thrust.columns)),
    ):
        if columns[0] in stream.columns:
            instants, stamps = _stamped(log, stream)
            rows = np.column_stack([stream.columns[column] for column in columns]).tolist()
            entries += [(i, name, s, row) for i, s, row in zip(instants, stamps, rows, strict=True)]
    return [entry[1:] for entry in sorted(entries, key=lambda entry: entry[0])]


def _ulg(campaign: Campaign, log: Log, folder: Path) -> None:
    """ULog with the quaternion of the attitude, the rate, and the motors."""
    count = len(log.thrust.columns)
    topics = {
        "vehicle_attitude": ("uint64_t timestamp;float[4] q;", struct.Struct("<HQ4f")),
        "vehicle_angular_velocity": ("uint64_t timestamp;float[3] xyz;", struct.Struct("<HQ3f")),
        "actuator_motors": (f"uint64_t timestamp;float[{count}] control;", struct.Struct(f"<HQ{count}f")),
    }

    def message(kind: bytes, body: bytes) -> bytes:
        return struct.pack("<HB", len(body), kind[0]) + body

    parts = [b"ULog\x01\x12\x35\x01", struct.pack("<Q", 0), message(b"B", bytes(40))]
    parts += [message(b"F", f"{name}:{fields}".encode()) for name, (fields, _) in topics.items()]
    parts += [message(b"A", struct.pack("<BH", 0, k) + name.encode()) for k, name in enumerate(topics)]
    scale = 1.0 if campaign.heading_unit == "rad" else np.pi / 180.0
    for name, stamp, values in _rows(log, *topics):
        if name == "vehicle_attitude":
            half = 0.5 * scale * values[0]
            values = [np.cos(half), 0.0, 0.0, np.sin(half)]  # noqa: PLW2901
        elif name == "vehicle_angular_velocity":
            values = [0.0, 0.0, np.radians(values[0])]  # noqa: PLW2901
        parts.append(message(b"D", topics[name][1].pack(list(topics).index(name), round(1e6 * stamp), *values)))
    (folder / f"{log.name}.ulg").write_bytes(b"".join(parts))


WRITERS: Mapping[str, tuple[Callable[[Campaign, Log, Path], None], str]] = {
    "csv": (_csv, ".csv"),
    "csv_pair": (_two_tables, "_nav.csv"),
    "json": (_json, ".mcap"),
    "ros2": (_ros2, ".mcap"),
    "db3": (_db3, ".db3"),
    "bin": (_bin, ".BIN"),
    "ulg": (_ulg, ".ulg"),
}


def _sources(campaign: Campaign) -> tuple[str, str, str, Callable[[int, str], str]]:
    """Time, heading and rate entries of rovid.toml, and the source of each command."""
    unit, form = campaign.vehicle.unit, campaign.format
    heading_unit = campaign.heading_unit
    if form in {"csv", "csv_pair"}:
        return (
            'time = { csv = "time_s" }',
            f'heading = {{ csv = "heading_deg", unit = "{heading_unit}" }}',
            'yaw_rate = { csv = "yaw_rate_dps", unit = "deg/s" }',
            lambda _, name: f'csv = "{command_column(name, unit)}"',
        )
    if form in {"json", "ros2", "db3"}:
        key = "bag" if form == "db3" else "mcap"
        heading, rate = ("/nav.heading", "/nav.rate") if form == "json" else ("/nav/heading.data", "/nav/rate.data")
        return (
            "",
            f'heading = {{ {key} = "{heading}", unit = "{heading_unit}" }}',
            f'yaw_rate = {{ {key} = "{rate}", unit = "deg/s" }}',
            lambda _, name: (
                f'{key} = "/thrusters{"." if form == "json" else "/"}{name}{"" if form == "json" else ".data"}"'
            ),
        )
    if form == "bin":
        return (
            "",
            f'heading = {{ bin = "ATT.Yaw", unit = "{heading_unit}" }}',
            'yaw_rate = { bin = "RATE.Y", unit = "deg/s" }',
            lambda k, _: f'bin = "RCOU.C{k + 1}"',
        )
    rate = 'yaw_rate = { ulg = "vehicle_angular_velocity.xyz[2]", unit = "rad/s" }'
    return "", "", rate, lambda k, _: f'ulg = "actuator_motors.control[{k}]"'


def write_campaign(campaign: Campaign, folder: Path) -> None:
    """Write the logs, the thrust curves and rovid.toml."""
    folder.mkdir(parents=True, exist_ok=True)
    for log in campaign.logs:
        WRITERS[campaign.format][0](campaign, log, folder)
    vehicle = campaign.vehicle
    time, heading, rate, command = _sources(campaign)
    lines = ["[vehicle]", 'name = "made up"', f"mass = {vehicle.mass:.5g}", f"length = {vehicle.length:.4g}"]
    lines += [f"width = {vehicle.width:.4g}", ""]
    for k, (thruster, (commands, thrust)) in enumerate(zip(vehicle.thrusters, campaign.curves, strict=True)):
        curve = f"curve_{thruster.name}.csv"
        rows = [f"{c:.9g},{t:.9g}" for c, t in zip(commands.tolist(), thrust.tolist(), strict=True)]
        (folder / curve).write_text("\n".join(["command,thrust_N", *rows]) + "\n", encoding="utf-8")
        lines += ["[[thrusters]]", f'name = "{thruster.name}"', f"yaw_arm = {thruster.arm}", f'curve = "{curve}"']
        lines += [f"command = {{ {command(k, thruster.name)} }}", ""]
    lines += ["[signals]", *filter(None, [time, heading, rate if campaign.with_rate else ""])]
    if campaign.format == "csv_pair":
        lines += ["", "[join]", 'parts = ["nav", "thr"]']
    (folder / "rovid.toml").write_text("\n".join(lines) + "\n", encoding="utf-8")


def log_name(campaign: Campaign, run: str) -> str:
    """Name of a trial in rovid, which is the name of its first file."""
    return run + WRITERS[campaign.format][1]
