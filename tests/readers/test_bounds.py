"""Logs that are cut, and logs with values beyond all bounds."""

from __future__ import annotations

import contextlib
import functools
import re
import sqlite3
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from mcap.reader import make_reader

from rovid.core.errors import RovidError
from rovid.preflight.log_survey import survey
from rovid.readers import READERS, read_log
from rovid.trial.config import Config
from tests.readers import recordings
from tests.readers.apart import STATUS, read
from tests.readers.logs import campaign, csv_text, dive, mcap_bytes, standard, toml, turning
from tests.readers.recordings import CHANGES, RECORDINGS, TIME
from tests.readers.test_formats import configured

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


@pytest.mark.slow
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


_ROWS = 24
SUFFIXES = (".csv", ".mcap", *RECORDINGS)


@functools.cache
def small(suffix: str) -> bytes:
    """A log of few rows, no bigger than its format makes it."""
    if suffix == ".csv":
        return csv_text({name: np.asarray(values)[:_ROWS] for name, values in standard().items()}).encode()
    if suffix == ".mcap":
        return mcap_bytes(dive(_ROWS), chunk_size=1000)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(recordings, "TIME", recordings.TIME[:_ROWS])
        patch.setattr(recordings, "HEADING", recordings.HEADING[:_ROWS])
        data = RECORDINGS[suffix].write()
    return in_small_pages(data) if suffix == ".db3" else data


def in_small_pages(data: bytes) -> bytes:
    with contextlib.closing(sqlite3.connect(":memory:")) as old, contextlib.closing(sqlite3.connect(":memory:")) as new:
        old.deserialize(data)
        new.execute("PRAGMA page_size = 512")
        new.executescript("".join(old.iterdump()))
        return new.serialize()


# What a format without an end looks like where nothing of it is lost: behind a whole record.


def _lines(data: bytes) -> set[int]:
    return {found.end() for found in re.finditer(b"\n", data)}


def _objects(data: bytes) -> set[int]:
    return {found.end() - more for found in re.finditer(b"\n", data) for more in (0, 1)}


def _sentences(data: bytes) -> set[int]:
    return {found.end() + more for found in re.finditer(rb"\*[0-9A-F]{2}", data) for more in (0, 1, 2)}


def _dataflash(data: bytes) -> set[int]:
    lengths, at, ends = {128: 89}, 0, set()
    while at < len(data):
        if data[at + 2] == 128:
            lengths[data[at + 3]] = data[at + 4]
        at += lengths[data[at + 2]]
        ends.add(at)
    return ends


def _telemetry(data: bytes) -> set[int]:
    at, ends = 0, set()
    while at < len(data):
        at += 8 + data[at + 9] + 12
        ends.add(at)
    return ends


def _ulog(data: bytes) -> set[int]:
    at, ends = 16, {16}
    while at < len(data):
        at += 3 + int.from_bytes(data[at : at + 2], "little")
        ends.add(at)
    return ends


def _recording(data: bytes, folder: Path) -> set[int]:
    """The summary is a help, and the messages end in front of it."""
    (folder / "whole.mcap").write_bytes(data)
    with (folder / "whole.mcap").open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    last = max(index.chunk_start_offset + index.chunk_length for index in summary.chunk_indexes)
    return set(range(last, len(data)))


WHOLE: dict[str, Callable[[bytes], set[int]]] = {
    ".csv": _lines,
    ".jsonl": _objects,
    ".ndjson": _objects,
    ".nmea": _sentences,
    ".BIN": _dataflash,
    ".tlog": _telemetry,
    ".ulg": _ulog,
}


def test_every_format_is_cut() -> None:
    tables = {suffix for suffix, form in READERS.items() if form.kind == "csv"}
    assert {suffix.lower() for suffix in SUFFIXES} == set(READERS) - tables | {".csv"}


def cut(suffix: str, folder: Path, lengths: range) -> None:
    """Read the log behind each of ``lengths`` bytes."""
    config: Config = campaign(folder) if suffix in {".csv", ".mcap"} else configured(suffix, folder)
    data, path = small(suffix), folder / f"a{suffix}"
    path.write_bytes(data)
    full = read_log(path, config)
    whole = _recording(data, folder) if suffix == ".mcap" else WHOLE[suffix](data) if suffix in WHOLE else set()
    alone = folder / "alone"
    alone.mkdir()
    for length in lengths:
        for one in (path, alone / path.name):
            one.write_bytes(data[:length])
        try:
            found = read_log(path, config)
        except RovidError as error:
            assert "\n" not in str(error), length  # noqa: PT017  # what is not refused is looked at below
        else:
            said = [remark for remark in found.remarks if remark.kind == "truncated"]
            assert said or length in whole, length
            assert found.time[-1] <= full.time[-1], length
        with contextlib.suppress(RovidError):
            survey([alone])


@pytest.mark.parametrize("suffix", [one for one in SUFFIXES if one != ".ndjson"])  # its reader is that of .jsonl
def test_cut_behind_some_of_its_bytes(suffix: str, tmp_path: Path) -> None:
    size = len(small(suffix))
    cut(suffix, tmp_path, range(0, size, max(1, size // 61)))


@pytest.mark.slow
@pytest.mark.parametrize("suffix", SUFFIXES)
def test_cut_behind_each_of_its_bytes(suffix: str, tmp_path: Path) -> None:
    cut(suffix, tmp_path, range(len(small(suffix))))
