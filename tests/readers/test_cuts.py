"""A small log of every format, cut behind each of its bytes: read with the loss said, or refused in one message."""

from __future__ import annotations

import contextlib
import functools
import re
import sqlite3
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader

from rovid.core.errors import RovidError
from rovid.preflight.log_survey import survey
from rovid.readers import READERS, read_log
from rovid.trial.config import Config
from tests.readers import recordings
from tests.readers.logs import campaign, csv_text, dive, mcap_bytes, standard
from tests.readers.recordings import RECORDINGS
from tests.readers.test_formats import configured

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
    assert {suffix.lower() for suffix in SUFFIXES} == set(READERS)


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


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_cut_behind_some_of_its_bytes(suffix: str, tmp_path: Path) -> None:
    size = len(small(suffix))
    cut(suffix, tmp_path, range(0, size, max(1, size // 61)))


@pytest.mark.slow
@pytest.mark.parametrize("suffix", SUFFIXES)
def test_cut_behind_each_of_its_bytes(suffix: str, tmp_path: Path) -> None:
    cut(suffix, tmp_path, range(len(small(suffix))))
