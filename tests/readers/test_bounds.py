"""A small file that stands for a large one: refused in one message before it is unpacked, or read in little memory."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from rosbags.rosbag1 import Writer
from rosbags.typesys import Stores, get_typestore

from rovid.core.errors import RovidError
from rovid.preflight.log_survey import survey
from rovid.readers import bag_reader, read_log
from rovid.trial.config import load_config
from tests.conftest import slow
from tests.preflight.test_log_survey import changed
from tests.readers.apart import STATUS, read
from tests.readers.logs import EPOCH, campaign, csv_text, standard, toml, turning
from tests.readers.recordings import CHANGES, RECORDINGS, TIME, bag, said

pytestmark = pytest.mark.skipif(not STATUS.exists(), reason="Linux tells how much memory was taken")
_MB = 1 << 20
# What rovid and the libraries take before anything is read, and room for a batch.
_ALWAYS = 300 * _MB


def constant(path: Path, rows: int, batch: int = 1_000_000) -> None:
    """``rows`` times the same row, which packs to next to nothing."""
    table = pa.table({name: np.zeros(batch) for name in ("time_s", "heading_deg", "fore_V")})
    with pq.ParquetWriter(path, table.schema) as writer:
        for _ in range(rows // batch):
            writer.write_table(table)


@pytest.mark.parametrize("what", ["read", "init"])
def test_rows_without_end_are_refused_by_the_footer(what: str, tmp_path: Path) -> None:
    campaign(tmp_path)
    constant(tmp_path / "a.parquet", 24_000_000)
    assert (tmp_path / "a.parquet").stat().st_size < _MB
    memory, found = read(tmp_path / "a.parquet", what)
    assert "holds 24000000 rows, of which 3 columns are wanted: 549 MB unpacked; at most 512 MB" in found
    assert memory < _ALWAYS


def numbered(path: Path, rows: int, others: int) -> None:
    """A log of ``rows``, with ``others`` columns of noise that nobody asks for."""
    time_s, heading = turning(rows)
    noise = np.random.default_rng(1).normal(size=rows)
    columns = {"time_s": time_s, "heading_deg": heading % 360.0, "fore_V": np.ones(rows)}
    table = pa.table({**columns, **{f"other_{at}": noise for at in range(others)}})
    pq.write_table(table, path, row_group_size=100_000, use_dictionary=False, compression="none")


def test_only_the_needed_columns_are_unpacked(tmp_path: Path) -> None:
    campaign(tmp_path)
    rows = 500_000
    numbered(tmp_path / "a.parquet", rows, others=60)  # 240 MB beside 12 MB
    memory, found = read(tmp_path / "a.parquet")
    assert found == f"{rows} samples"
    assert memory < _ALWAYS + 4 * 3 * 8 * rows


@pytest.mark.slow
def test_a_large_log_takes_four_times_its_columns(tmp_path: Path) -> None:
    campaign(tmp_path)
    rows = 5_000_000
    numbered(tmp_path / "a.parquet", rows, others=2)
    memory, found = read(tmp_path / "a.parquet")
    assert found == f"{rows} samples"
    assert memory < _ALWAYS + 4 * 3 * 8 * rows


def test_one_long_text_in_every_row_is_unpacked_once(tmp_path: Path) -> None:
    campaign(tmp_path)
    rows = 200_000
    command = pa.array(["1" + " " * 20_000]).take(pa.array(np.zeros(rows, dtype=np.int64)[:1]))
    time_s, heading = turning(rows)
    text = pa.DictionaryArray.from_arrays(pa.array(np.zeros(rows, dtype=np.int32)), command)  # 4 GB written out
    pq.write_table(pa.table({"time_s": time_s, "heading_deg": heading % 360.0, "fore_V": text}), tmp_path / "a.parquet")
    memory, found = read(tmp_path / "a.parquet")
    assert found == f"{rows} samples"
    assert memory < _ALWAYS + 4 * 3 * 8 * rows


def packed_bag(path: Path, size: int) -> None:
    """A ROS 1 bag whose one chunk unpacks to ``size`` bytes and more."""
    store = get_typestore(Stores.ROS1_NOETIC)
    kind = "std_msgs/msg/String"
    writer = Writer(path)
    writer.set_compression(writer.CompressionFormat.LZ4)
    with writer:
        heading, other = (writer.add_connection(topic, kind, typestore=store) for topic in ("/phins/heading", "/other"))
        for connection, text in ((heading, "1"), (other, "\0" * size)):
            writer.write(connection, EPOCH, store.serialize_ros1(store.types[kind](data=text), kind))


def bag_config(folder: Path) -> None:
    campaign(folder, toml(heading=RECORDINGS[".bag"].heading, command=RECORDINGS[".bag"].command))


@pytest.mark.parametrize("what", ["read", "init"])
def test_a_chunk_is_unpacked_no_further_than_there_is_room(
    what: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(bag_reader, "_LARGEST", 1 << 16)
    bag_config(tmp_path)
    packed_bag(tmp_path / "a.bag", 1 << 17)
    with pytest.raises(RovidError, match="a chunk holds more than"):
        survey([tmp_path]) if what == "init" else read_log(tmp_path / "a.bag", load_config(tmp_path / "rovid.toml"))


@pytest.mark.slow
def test_a_chunk_of_300_mb_takes_no_more_memory(tmp_path: Path) -> None:
    bag_config(tmp_path)
    packed_bag(tmp_path / "a.bag", 300 * _MB)
    assert (tmp_path / "a.bag").stat().st_size < 4 * _MB
    memory, found = read(tmp_path / "a.bag")
    assert "a chunk holds more than 128 MB" in found
    assert memory < _ALWAYS + 128 * _MB


_LINE = "=" * 80
_INSIDE = f"a_msgs/B[1000] b\n{_LINE}\nMSG: a_msgs/B\n"
DEFINITIONS = {
    "arrays of arrays": f"{_INSIDE}a_msgs/C[1000] c\n{_LINE}\nMSG: a_msgs/C\nuint8 x\n",
    "a million texts": "string[1000000] x\n",
    "a type that holds itself": f"{_INSIDE}a_msgs/B b\n",
    "200 000 fields": "".join(f"float64 f{at}\n" for at in range(200_000)),
}


@pytest.mark.parametrize("what", DEFINITIONS)
def test_definitions_without_end_are_refused(what: str, tmp_path: Path) -> None:
    bag_config(tmp_path)
    change = (
        "UPDATE message_definitions SET encoded_message_definition = '{}' WHERE topic_type = 'test_msgs/msg/Stamped'"
    )
    (tmp_path / "a.db3").write_bytes(changed(bag(said(), ros=2), change.format(DEFINITIONS[what])))
    memory, found = read(tmp_path / "a.db3")
    assert "the type test_msgs/msg/Stamped of topic '/phins/heading' cannot be understood" in found
    assert memory < _ALWAYS


def test_rows_that_a_view_makes_up_are_not_waited_for(tmp_path: Path) -> None:
    bag_config(tmp_path)
    without_end = (
        "DROP TABLE messages",
        """CREATE VIEW messages AS WITH RECURSIVE n(id) AS (SELECT 1 UNION ALL SELECT id + 1 FROM n)
        SELECT id, (SELECT min(id) FROM topics) AS topic_id, id AS timestamp, zeroblob(1000) AS data FROM n""",
    )
    (tmp_path / "a.db3").write_bytes(changed(bag(said(), ros=2), *without_end))
    memory, found = read(tmp_path / "a.db3")
    assert "no table messages" in found
    assert memory < _ALWAYS


def ulog_config(folder: Path) -> bytes:
    campaign(folder, toml(heading="", command=RECORDINGS[".ulg"].command))
    return RECORDINGS[".ulg"].write()


def formats(*texts: str) -> bytes:
    return b"".join(struct.pack("<HB", len(text), ord("F")) + text.encode() for text in texts)


FORMATS = {
    "arrays of arrays": ("vehicle_attitude:uint64_t timestamp;b[60000] q;", "b:c[60000] x;", "c:float[60000] x;"),
    "a type that holds itself": ("vehicle_attitude:uint64_t timestamp;vehicle_attitude q;",),
}


@pytest.mark.parametrize("what", FORMATS)
@pytest.mark.parametrize("way", ["read", "init"])
def test_formats_without_end_are_not_unrolled(what: str, way: str, tmp_path: Path) -> None:
    data = ulog_config(tmp_path)
    at = data.index(b"A", data.index(b"actuator_motors:")) - 2  # the first topic is added behind all formats
    (tmp_path / "a.ulg").write_bytes(data[:at] + formats(*FORMATS[what]) + data[at:])
    memory, found = read(tmp_path / "a.ulg", way)
    assert "vehicle_attitude" in found or "no heading" in found
    assert memory < _ALWAYS


def test_topics_without_end_are_not_unrolled(tmp_path: Path) -> None:
    data = ulog_config(tmp_path)
    at = data.index(b"A", data.index(b"actuator_motors:")) - 2
    many = formats("other:uint8_t[60000] x;") + b"".join(
        struct.pack("<HBBH", 8, ord("A"), 0, 100 + number % 60_000) + b"other" for number in range(20_000)
    )
    (tmp_path / "a.ulg").write_bytes(data[:at] + many + data[at:])
    memory, found = read(tmp_path / "a.ulg")
    assert found == f"{len(TIME) + len(CHANGES) - 1} samples"
    assert memory < _ALWAYS


def test_memory_that_was_never_written_to_is_not_read_over_and_over(tmp_path: Path) -> None:
    data = ulog_config(tmp_path)
    (tmp_path / "a.ulg").write_bytes(data + b"\xff" * (8 * _MB))
    memory, found = read(tmp_path / "a.ulg")
    assert found == f"{len(TIME) + len(CHANGES) - 1} samples"
    assert memory < _ALWAYS


LINES = {"of commas": (b",", 100), "of digits": (b"1", 300)}


@pytest.mark.parametrize("what", LINES)
@pytest.mark.parametrize("behind", ["", "20.0,1.0,2.0\n"])
def test_a_line_without_end_is_not_taken_apart(what: str, behind: str, tmp_path: Path) -> None:
    campaign(tmp_path)
    long(tmp_path / "a.csv", csv_text(standard()), *LINES[what], f"\n{behind}")
    memory, found = read(tmp_path / "a.csv")
    assert "has a line of more than 1 MB" in found
    assert memory < _ALWAYS


def long(path: Path, before: str, sign: bytes, size: int, behind: str) -> None:
    """Text with ``size`` MB of one sign in it."""
    with path.open("wb") as file:
        file.write(before.encode())
        for _ in range(size):
            file.write(sign * _MB)
        file.write(behind.encode())


@pytest.mark.parametrize("what", ["read", "init"])
@pytest.mark.parametrize("size", [300, slow(1024)])
def test_a_file_of_one_line_is_not_taken_apart(what: str, size: int, tmp_path: Path) -> None:
    campaign(tmp_path)
    long(tmp_path / "a.csv", "time_s,heading_deg,fore_V,", b",", size, "")
    memory, found = read(tmp_path / "a.csv", what)
    assert "a.csv: " in found
    assert memory < _ALWAYS


def test_a_stamp_weeks_away_makes_no_grid_of_weeks(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text(csv_text(standard()) + "2900000.0,1.0,1.0\n")
    memory, _ = read(tmp_path / "a.csv", "init")
    assert memory < _ALWAYS


def test_zeros_behind_a_log_are_not_taken_for_a_line(tmp_path: Path) -> None:
    campaign(tmp_path)
    with (tmp_path / "a.csv").open("wb") as file:
        file.write(csv_text(standard()).encode())
        file.truncate(300 * _MB)
    memory, found = read(tmp_path / "a.csv")
    assert found == "400 samples"
    assert memory < _ALWAYS
