"""A small file of every format that rovid reads, in its legal shapes, with the campaign around it."""

from __future__ import annotations

import hashlib
import itertools
import sqlite3
import tempfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from rosbags.rosbag1 import Writer as Rosbag1

from benchmarks.torture.bombs import NEEDED, bombs
from benchmarks.torture.frames import Frame, bag_frames, mcap_frames, sealed_nmea, sealed_tlog, tlog_frames, ulog_frames
from rovid.estimate.estimate import Estimate
from rovid.store.parameter_file import Parameters
from tests.readers import logs, recordings
from tests.readers.logs import EPOCH, csv_text, mcap_bytes, stamped

Files = Mapping[str, bytes]
Text = Literal["", "lines", "toml"]
# As short as `rovid init` still tells a heading in.
ROWS, INTERVAL = 64, 0.25
TIME, HEADING = logs.turning(ROWS, interval=INTERVAL)
CHANGES = ((0.0, 1.0), (5.0, 2.0), (10.0, 3.0))
COMMAND = np.select([at <= TIME for at, _ in CHANGES[::-1]], [value for _, value in CHANGES[::-1]])
ROLL, YAW_RATE = 0.5 * np.sin(TIME), np.full(ROWS, np.deg2rad(8.0))
LOG_COMMANDS = ("check", "init", "convert")


@dataclass(frozen=True, kw_only=True)
class Sample:
    """A file to torture.

    Attributes
    ----------
    name
        Of the file, in its folder.
    beside
        Other files in the folder.
    frames
        Where its length fields are.
    needed
        Bytes of what a command needs of it, where those are many.
    seal
        Mends the checksums of changed bytes, so that a change is not all there is to see.
    """

    name: str
    data: bytes
    beside: Files
    frames: tuple[Frame, ...] = ()
    needed: int = 0
    seal: Callable[[bytes], bytes] | None = None


@dataclass(frozen=True, kw_only=True)
class Format:
    """What is tortured alike: ``make`` writes the samples, ``commands`` read them.

    Attributes
    ----------
    text
        What can be changed besides bytes.
    changed
        What stands in the file, its name, or nothing: then each sample is an input, and need not be read.
    """

    make: Callable[[], list[Sample]]
    commands: tuple[str, ...] = LOG_COMMANDS
    text: Text = ""
    changed: Literal["content", "name", "nothing"] = "content"


@cache
def samples(name: str) -> tuple[Sample, ...]:
    """Of the format ``name``; the first is the one that is cut."""
    return tuple(FORMATS[name].make())


def _folder(toml: str, **others: bytes) -> dict[str, bytes]:
    return {"rovid.toml": toml.encode(), "curve.csv": logs.CURVE.encode(), **others}


def _csv_log(form: str = ".4f", separator: str = ",", time: Any = TIME) -> str:
    columns = {"time_s": time, "heading_deg": HEADING % 360.0, "fore_V": COMMAND, "roll": ROLL, "yaw_rate": YAW_RATE}
    return csv_text(columns, separator, form)


_EXTRAS = ('yaw_rate = { csv = "yaw_rate" }', 'roll = { csv = "roll" }', 'supply_voltage = { csv = "fore_V" }')
_CSV_TOML = logs.toml(*_EXTRAS)


def _csv() -> list[Sample]:
    stamps = np.array([recordings.iso(at) for at in TIME.tolist()])
    quoted = '"' + _csv_log(separator=";").replace(";", '";"').replace("\n", '"\r\n"').removesuffix('"')
    texts = [
        _csv_log(),
        "# recorded by hand\n" + _csv_log(separator="\t", time=stamps),
        "\ufeff" + quoted.replace(".", ","),
        _csv_log(".10g", time=np.round(EPOCH / 1e6 + 1e3 * TIME).astype(int)),
    ]
    return [Sample(name="dive.csv", data=text.encode(), beside=_folder(_CSV_TOML)) for text in texts]


def _messages(*, tilted: bool) -> list[logs.Message]:
    """Heading, command and, where the encoding has it, an orientation."""
    instants = logs.to_ns(TIME).tolist()
    found: list[logs.Message] = []
    for k, (ns, heading) in enumerate(zip(instants, np.round(HEADING % 360.0, 4).tolist(), strict=True)):
        found.append(("/phins/heading", ns, stamped(heading, ns)))
        if tilted and k % 4 == 0:
            z = np.deg2rad(heading) / 2.0
            orientation = {"x": 0.0, "y": 0.0, "z": float(np.sin(z)), "w": float(np.cos(z))}
            rate = {"x": 0.0, "y": 0.0, "z": 0.14}
            found.append(("/imu", ns, {**stamped(0.0, ns), "orientation": orientation, "angular_velocity": rate}))
    for at, value in CHANGES:
        ns = int(logs.to_ns(at))
        found.append(("/thrusters/fore", ns, stamped(value, ns)))
    return sorted(found, key=lambda message: message[1])


def _mcap(encoding: str) -> list[Sample]:
    # The first whole, indexed and uncompressed: cut and changed everywhere, it shows the most.
    shapes = [("none", True, True), ("none", False, True), ("none", False, False)]
    shapes += list(itertools.product(("lz4", "zstd"), (True,), (True, False)))
    signals = () if encoding == "protobuf" else ('roll = { mcap = "/imu.orientation" }',)
    beside = _folder(logs.toml(*signals))
    made = []
    for compression, chunked, summary in shapes:
        data = mcap_bytes(
            _messages(tilted=encoding != "protobuf"),
            encoding=encoding,
            compression=compression,
            chunked=chunked,
            chunk_size=3000,
            indexed=summary,
            summary=summary,
        )
        made.append(Sample(name="dive.mcap", data=data, beside=beside, frames=mcap_frames(data)))
    return made


def _parquet() -> list[Sample]:
    table = pa.table(
        {"time_s": TIME, "heading_deg": HEADING % 360.0, "fore_V": COMMAND, "roll": ROLL, "yaw_rate": YAW_RATE}
    )
    made = []
    shapes: list[dict[str, Any]] = [{"compression": "none", "use_dictionary": False}, {}, {"row_group_size": 20}]
    for options in shapes:
        out = pa.BufferOutputStream()
        pq.write_table(table, out, **options)
        data = out.getvalue().to_pybytes()
        made.append(Sample(name="dive.parquet", data=data, beside=_folder(_CSV_TOML)))
    return made


def _said() -> list[recordings.Said]:
    fields = [{"data": value, "list": [1.0, 2.0, value]} for value in (HEADING % 360.0).tolist()]
    rows = [("/phins/heading", "test_msgs/msg/Stamped", at, one) for at, one in zip(TIME.tolist(), fields, strict=True)]
    rows += [("/thrusters/fore", "std_msgs/msg/Float32", at, {"data": value}) for at, value in CHANGES]
    return sorted(rows, key=lambda row: row[2])


def _bag() -> list[Sample]:
    plain = recordings.bag(_said(), ros=1)
    made = [plain]
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "a.bag"
        for compression in (Rosbag1.CompressionFormat.BZ2, Rosbag1.CompressionFormat.LZ4):
            path.unlink(missing_ok=True)
            _compressed(plain, path, compression)
            made.append(path.read_bytes())
    return [Sample(name="dive.bag", data=one, beside=_folder(logs.toml()), frames=bag_frames(one)) for one in made]


def _compressed(plain: bytes, path: Path, compression: Rosbag1.CompressionFormat) -> None:
    from rosbags.rosbag1 import Reader

    with tempfile.NamedTemporaryFile(suffix=".bag") as source:
        source.write(plain)
        source.flush()
        unopened = Rosbag1(path)
        unopened.set_compression(compression)
        with Reader(source.name) as reader, unopened as writer:
            kinds = {
                one.id: writer.add_connection(one.topic, one.msgtype, msgdef=one.msgdef.data, md5sum=one.digest)
                for one in reader.connections
            }
            for connection, ns, data in reader.messages():
                writer.write(kinds[connection.id], ns, data)


def _db3() -> list[Sample]:
    data = recordings.bag(_said(), ros=2)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "a.db3"
        path.write_bytes(data)
        # Pages of 4096 bytes are mostly empty.
        base = sqlite3.connect(path)
        base.execute("PRAGMA page_size = 512")
        base.execute("VACUUM")
        base.close()
        small = path.read_bytes()
    return [Sample(name="dive.db3", data=small, beside=_folder(logs.toml()))]


def _bin() -> list[Sample]:
    toml = logs.toml(heading="", command='{ bin = "RCOU.C1" }')
    rows: list[recordings.Row] = [
        ("ATT", (int(1e6 * t), h % 360.0)) for t, h in zip(TIME.tolist(), HEADING.tolist(), strict=True)
    ]
    rows += [("RCOU", (int(1e6 * t), int(c))) for t, c in CHANGES]
    rows += [("BAT", (int(1e6 * t), 0, 1500)) for t in TIME[::8].tolist()]
    data = recordings.dataflash(sorted(rows, key=lambda row: row[1][0]))  # type: ignore[arg-type, return-value]
    return [Sample(name="dive.BIN", data=data, beside=_folder(toml))]


def _tlog() -> list[Sample]:
    toml = logs.toml(heading="", command='{ tlog = "SERVO_OUTPUT_RAW.servo4_raw" }')
    rows = [recordings.attitude_sent(t, h) for t, h in zip(TIME.tolist(), HEADING.tolist(), strict=True)]
    rows += [recordings.servos_sent(t, int(c)) for t, c in CHANGES]
    made = [recordings.tlog(sorted(rows, key=lambda row: row[0]), version=version) for version in (2, 1)]
    return [
        Sample(name="dive.tlog", data=data, beside=_folder(toml), frames=tlog_frames(data), seal=sealed_tlog)
        for data in made
    ]


def _ulg() -> list[Sample]:
    toml = logs.toml(heading="", command='{ ulg = "actuator_motors.control[0]" }')
    rows = [recordings.attitude(1e6 * t, h) for t, h in zip(TIME.tolist(), HEADING.tolist(), strict=True)]
    rows += [("actuator_motors", (int(1e6 * t), c, 0.0)) for t, c in CHANGES]
    data = recordings.ulog(sorted(rows, key=lambda row: row[1][0]))  # type: ignore[arg-type, return-value]
    return [Sample(name="dive.ulg", data=data, beside=_folder(toml), frames=ulog_frames(data))]


def _nmea() -> list[Sample]:
    heading = 'heading = { nmea = "heading", csv = "heading_deg", unit = "deg" }'
    toml = logs.toml(heading=heading, command='{ csv = "fore_V" }')
    rows = list(zip(TIME.tolist(), HEADING.tolist(), strict=True))
    fronted = "".join(recordings.sentence(f"HEHDT,{h % 360.0:.4f},T", f"{recordings.iso(t)} ") for t, h in rows)
    clocked = ""
    for t, h in rows:
        second, hundredth = divmod(round(100.0 * t), 100)
        clocked += recordings.sentence(f"GPZDA,1200{second:02d}.{hundredth:02d},07,01,2026,00,00")
        clocked += recordings.sentence(f"HEHDT,{h % 360.0:.4f},T") + recordings.sentence("HEROT,480.0,A")
        clocked += recordings.sentence("PIXSE,ATITUD,0.5,-0.5")
    beside = _csv_log(time=np.array([recordings.iso(at) for at in TIME.tolist()])).encode()
    folder = _folder(toml, **{"dive.csv": beside})
    return [
        Sample(name="dive.nmea", data=text.encode(), beside=folder, seal=sealed_nmea) for text in (fronted, clocked)
    ]


# What is no log


def _configuration() -> list[Sample]:
    parameters = _parameters()[0].data
    folder = {"dive.csv": _csv_log().encode(), "curve.csv": logs.CURVE.encode(), "parameters.toml": parameters}
    vehicle = "[vehicle]\nname = \"a 'vehicle' [b]\"\nmass = 2604.0\nlength = 2.6\nwidth = 2.0\n"
    second = '[[thrusters]]\nname = "aft"\nyaw_arm = -0.43\ncurve = "curve.csv"\ncommand = { csv = "fore_V" }\n'
    whole = logs.toml(*_EXTRAS, 'pressure = { csv = "roll", sign = -1 }').replace("[signals]", second + "[signals]")
    return [Sample(name="rovid.toml", data=text.encode(), beside=folder) for text in (vehicle + whole, _CSV_TOML)]


def _parameters() -> list[Sample]:
    folder = _folder(_CSV_TOML, **{"dive.csv": _csv_log().encode()})
    names = ("inertia", "quadratic_drag", "linear_drag")
    more = (*names, "thruster_lag.time_constant", "bias_torque.torque")
    made = []
    for these in (names, more):
        size = len(these)
        estimate = Estimate(
            names=these,
            values=np.array([5057.0, 3532.0, 132.0, 0.3, 2.0])[:size],
            covariance=np.diag([100.0, 900.0, 9.0, 0.01, 0.04][:size]) - 0.001 * (np.ones((size, size)) - np.eye(size)),
            method="maximum likelihood",
            samples=ROWS,
        )
        with tempfile.TemporaryDirectory() as place:
            path = Path(place) / "parameters.toml"
            log = Path(place) / "dive.csv"
            log.write_bytes(folder["dive.csv"])
            stored = Parameters(path=path, vehicle="a vehicle", logs=(log.resolve(),)).with_estimate(estimate)
            stored.write()
            # Without the moment it was written at: the same bytes each time.
            lines = [line for line in path.read_text().splitlines() if not line.startswith("written")]
        digest = hashlib.sha256(folder["dive.csv"]).hexdigest()
        sources = f'sources = [\n    {{ name = "dive.csv", sha256 = "{digest}", samples = {ROWS} }},\n]'
        text = "\n".join(lines).replace("sources = []", sources) + "\n"
        made.append(Sample(name="parameters.toml", data=text.encode(), beside=folder))
    return made


def _bombs() -> list[Sample]:
    mcap = '{ csv = "fore_V", mcap = "/thrusters/fore.data", ulg = "vehicle_attitude.q[0]" }'
    beside = _folder(logs.toml(command=mcap))
    return [Sample(name=name, data=data, beside=beside, needed=NEEDED.get(name, 0)) for name, data in bombs().items()]


def _curve() -> list[Sample]:
    folder = {"rovid.toml": _CSV_TOML.encode(), "dive.csv": _csv_log().encode()}
    rows = "".join(f"{u / 2.0:g},{8.0 * u * abs(u):g}\n" for u in range(-10, 11))
    texts = (f"command,thrust_N\n{rows}", f"# bench\ncommand;thrust_N\n{rows.replace(',', ';').replace('.', ',')}")
    return [Sample(name="curve.csv", data=text.encode(), beside=folder) for text in texts]


def _bench() -> list[Sample]:
    rows = "".join(f"{1100 + 40 * k},{(k - 10) * abs(k - 10) / 4.0:g},12.1\n" for k in range(21))
    texts = (f"PWM (µs),Force (Kg f),Voltage (V)\n{rows}", f"command,thrust_N\n{rows.replace(',12.1', '')}")
    return [Sample(name="bench.csv", data=text.encode(), beside={}) for text in texts]


def _steady() -> list[Sample]:
    rows = "".join(f"{k},{0.05 * k:g},{3532.0 * (0.05 * k) ** 2 + 132.0 * 0.05 * k:.4g}\n" for k in range(1, 9))
    text = f"command,yaw_rate_rad_s,torque_Nm\n{rows}"
    return [Sample(name="steady.csv", data=text.encode(), beside=_folder(_CSV_TOML))]


FORMATS: Mapping[str, Format] = {
    "csv": Format(make=_csv, text="lines"),
    "mcap-json": Format(make=lambda: _mcap("json")),
    "mcap-ros2": Format(make=lambda: _mcap("ros2")),
    "mcap-protobuf": Format(make=lambda: _mcap("protobuf")),
    "parquet": Format(make=_parquet),
    "bag": Format(make=_bag),
    "db3": Format(make=_db3),
    "bin": Format(make=_bin),
    "tlog": Format(make=_tlog),
    "nmea": Format(make=_nmea, text="lines"),
    "ulg": Format(make=_ulg),
    "rovid.toml": Format(make=_configuration, commands=("check", "convert", "simulate"), text="toml"),
    "parameters.toml": Format(make=_parameters, commands=("simulate", "export"), text="toml"),
    "names": Format(make=_csv, changed="name"),
    "bombs": Format(make=_bombs, changed="nothing"),
    "curve": Format(make=_curve, commands=("check", "init"), text="lines"),
    "bench": Format(make=_bench, commands=("fit-thruster",), text="lines"),
    "steady": Format(make=_steady, commands=("fit-drag",), text="lines"),
}
