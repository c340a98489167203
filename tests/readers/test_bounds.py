"""Large logs and damaged ones are read in little memory."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from tests.readers.apart import STATUS, read
from tests.readers.logs import campaign, csv_text, standard, toml, turning
from tests.readers.recordings import CHANGES, RECORDINGS, TIME

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
def test_too_many_rows_are_refused_by_the_footer(what: str, tmp_path: Path) -> None:
    campaign(tmp_path)
    constant(tmp_path / "a.parquet", 24_000_000)
    assert (tmp_path / "a.parquet").stat().st_size < _MB
    memory, found = read(tmp_path / "a.parquet", what)
    assert "holds 24000000 rows, of which 3 columns are mapped: 549 MB unpacked; at most 512 MB" in found
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


def ulog_config(folder: Path) -> bytes:
    campaign(folder, toml(heading="", command=RECORDINGS[".ulg"].command))
    return RECORDINGS[".ulg"].write()


def test_memory_that_was_never_written_to_is_not_read_over_and_over(tmp_path: Path) -> None:
    data = ulog_config(tmp_path)
    (tmp_path / "a.ulg").write_bytes(data + b"\xff" * (8 * _MB))
    memory, found = read(tmp_path / "a.ulg")
    assert found == f"{len(TIME) + len(CHANGES) - 1} samples"
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
