"""Small files that are large, deep or endless inside: each has to be read or refused in bounded memory and time."""

from __future__ import annotations

import io
import sqlite3
import struct
import tempfile
from collections.abc import Mapping
from pathlib import Path
from random import Random

import lz4.frame
import pyarrow as pa
import pyarrow.parquet as pq
import zstandard
from mcap.writer import CompressionType, Writer

from tests.readers import logs, recordings

_MILLION = 1_000_000
_ROWS = 10 * _MILLION
_UNPACKED = 1 << 30
# Of each megabyte so much says something.
_TOLD = 12_000
# Of doubles: what `rovid check` needs of the table below.
NEEDED: Mapping[str, int] = {"constant.parquet": 3 * 8 * _ROWS}


def bombs() -> dict[str, bytes]:
    """Name -> bytes."""
    return {
        "constant.parquet": _constant_parquet(),
        "zstd.mcap": _swollen("zstd"),
        "lz4.mcap": _swollen("lz4"),
        "fields.mcap": _schema("\n".join(f"float64 field_{k}" for k in range(200_000))),
        "types.mcap": _schema(_nested(2000)),
        "doubling.mcap": _schema(_doubling(40)),
        "recursive.mcap": _schema(f"test_msgs/A a\n{_RULE}\nMSG: test_msgs/A\ntest_msgs/A a"),
        "array.mcap": _schema("float64[2000000000] data\nstd_msgs/Header header"),
        "columns.csv": _columns(),
        "line.csv": b"time_s,heading_deg,fore_V\n" + b"1" * 30_000_000,
        "quote.csv": b'time_s,heading_deg,fore_V\n0,1,"' + b"1,2,3\n" * 3_000_000,
        "endless.db3": _endless(),
        "recursive.ulg": _recursive_ulog(),
    }


_RULE = "=" * 80


def _constant_parquet() -> bytes:
    out = pa.BufferOutputStream()
    names = ("time_s", "heading_deg", "fore_V")
    group = pa.table({name: pa.array([1.0]).take(pa.array([0] * _MILLION)) for name in names})
    with pq.ParquetWriter(out, group.schema) as writer:
        for _ in range(_ROWS // _MILLION):
            writer.write_table(group)
    data: bytes = out.getvalue().to_pybytes()
    return data


def _swollen(compression: str) -> bytes:
    """A chunk of some megabytes, as camera images might be, that is a gigabyte when it is unpacked."""
    rng = Random(1)  # noqa: S311 - nothing secret
    packed = io.BytesIO()
    open_packed = zstandard.ZstdCompressor(level=1).stream_writer if compression == "zstd" else lz4.frame.open
    mode = {"size": _UNPACKED, "closefd": False} if compression == "zstd" else {"mode": "wb"}
    with open_packed(packed, **mode) as stream:
        for _ in range(_UNPACKED >> 20):
            stream.write(rng.randbytes(_TOLD) + bytes((1 << 20) - _TOLD))
    data, name = packed.getvalue(), compression.encode()
    chunk = struct.pack("<QQQII", 0, 1, _UNPACKED, 0, len(name)) + name + struct.pack("<Q", len(data)) + data
    header = struct.pack("<BQII", 1, 8, 0, 0)
    magic = b"\x89MCAP0\r\n"
    return magic + header + struct.pack("<BQ", 6, len(chunk)) + chunk + magic


def _schema(text: str) -> bytes:
    """A recording whose messages are of this type, in ROS 2's words."""
    output = io.BytesIO()
    writer = Writer(output, compression=CompressionType.NONE)
    writer.start()
    schema = writer.register_schema("test_msgs/msg/Bomb", "ros2msg", text.encode())
    for topic in ("/phins/heading", "/thrusters/fore"):
        channel = writer.register_channel(topic, "cdr", schema)
        for k in range(20):
            writer.add_message(channel, logs.EPOCH + k * 10**8, b"\0\1\0\0" + bytes(200), logs.EPOCH + k * 10**8)
    return logs.finished(writer, output)


def _nested(depth: int) -> str:
    """Each type holds the next."""
    types = [f"{_RULE}\nMSG: test_msgs/T{k}\ntest_msgs/T{k + 1} t" for k in range(depth)]
    return "\n".join(["test_msgs/T0 t", *types, _RULE, f"MSG: test_msgs/T{depth}", "float64 data"])


def _doubling(depth: int) -> str:
    """Each type holds the next twice: as many fields as two to the depth."""
    types = [f"{_RULE}\nMSG: test_msgs/T{k}\ntest_msgs/T{k + 1} a\ntest_msgs/T{k + 1} b" for k in range(depth)]
    return "\n".join(["test_msgs/T0 t", *types, _RULE, f"MSG: test_msgs/T{depth}", "float64 data"])


def _columns() -> bytes:
    count = 200_000
    header = ",".join(["time_s", "heading_deg", "fore_V", *(f"column_{k}" for k in range(count))])
    rows = [",".join([f"{0.1 * k:.1f}", f"{k}", f"{k % 3}", *["0"] * count]) for k in range(12)]
    return "\n".join([header, *rows]).encode()


def _endless() -> bytes:
    """A ROS 2 database whose messages are a view without an end."""
    rows = [(f"/{name}", "std_msgs/msg/Float64", 0.1 * k, {"data": float(k)}) for k in range(3) for name in "ab"]
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "a.db3"
        path.write_bytes(recordings.bag(rows, ros=2))
        base = sqlite3.connect(path)
        base.execute("DROP TABLE messages")
        base.execute(
            "CREATE VIEW messages AS WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n) "
            "SELECT i AS id, 1 AS topic_id, i AS timestamp, zeroblob(12) AS data FROM n"
        )
        base.commit()
        base.close()
        return path.read_bytes()


def _recursive_ulog() -> bytes:
    """A topic of a type that holds itself."""
    rows = [recordings.attitude(1e5 * k, float(k)) for k in range(20)]
    plain, recursive = (
        b"vehicle_attitude:%b;" % one for one in (b"uint64_t timestamp;float[4] q", b"vehicle_attitude a")
    )
    was, now = (struct.pack("<HB", len(text), ord("F")) + text for text in (plain, recursive))
    return recordings.ulog(rows).replace(was, now)
