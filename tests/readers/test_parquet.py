"""Parquet: times and numbers of every type, names that it shares with CSV, and what is refused."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from datetime import UTC, datetime, timedelta
from decimal import Decimal
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa
import pytest

from rovid.errors import ConfigError, LogError
from rovid.readers import read_log
from rovid.trial import Trial
from tests.readers.logs import EPOCH, campaign, kinds, standard, to_ns, toml, turning
from tests.readers.recordings import parquet

TIME, HEADING = turning()
BEGIN = datetime(2026, 1, 7, 12, tzinfo=UTC)


def read(folder: Path, columns: Mapping[str, Any], text: str | None = None) -> Trial:
    config = campaign(folder, text)
    (folder / "a.parquet").write_bytes(parquet(columns))
    return read_log(folder / "a.parquet", config)


TIMES: dict[str, Any] = {
    "float": TIME,
    "epoch": EPOCH * 1e-9 + TIME,
    "ns": to_ns(TIME),
    "uint64": to_ns(TIME).astype(np.uint64),
    "timestamps": to_ns(TIME).astype("datetime64[ns]"),
    "text": [(BEGIN + timedelta(seconds=t)).isoformat() for t in TIME.tolist()],
    "float32": TIME.astype(np.float32),
}


@pytest.mark.parametrize("kind", TIMES)
def test_times(kind: str, tmp_path: Path) -> None:
    trial = read(tmp_path, standard() | {"time_s": TIMES[kind]})
    np.testing.assert_allclose(trial.time, TIME, atol=1e-6)


def test_a_missing_time_loses_no_digit_of_the_others(tmp_path: Path) -> None:
    stamps: list[int | None] = to_ns(TIME).tolist()
    stamps[7] = None
    trial = read(tmp_path, standard() | {"time_s": pa.array(stamps, pa.int64())})
    np.testing.assert_allclose(trial.time, np.delete(TIME, 7), atol=1e-9)


NUMBERS: dict[str, Any] = {
    "float32": (HEADING % 360.0).astype(np.float32),
    "text": [f"{heading:.5f}" for heading in HEADING % 360.0],
    "decimal": [Decimal(f"{heading:.5f}") for heading in HEADING % 360.0],
    "category": pd.Categorical([f"{heading:.5f}" for heading in HEADING % 360.0]),
}


@pytest.mark.parametrize("kind", NUMBERS)
def test_numbers(kind: str, tmp_path: Path) -> None:
    trial = read(tmp_path, standard() | {"heading_deg": pa.array(NUMBERS[kind])})
    np.testing.assert_allclose(np.rad2deg(trial.position), HEADING, atol=1e-4)


@pytest.mark.parametrize("missing", [None, float("nan")])
def test_missing_numbers(missing: float | None, tmp_path: Path) -> None:
    heading: list[float | None] = (HEADING % 360.0).tolist()
    heading[5] = missing
    assert kinds(read(tmp_path, standard() | {"heading_deg": heading}))["missing"] == 1


def test_columns_inside_columns_and_names_of_its_own(tmp_path: Path) -> None:
    columns = standard()
    columns["pose"] = pa.array([{"psi": heading, "z": 1.0} for heading in HEADING % 360.0])
    heading = 'heading = { csv = "no", parquet = "pose.psi", unit = "deg" }'
    trial = read(tmp_path, columns, toml(heading=heading))
    np.testing.assert_allclose(np.rad2deg(trial.position), HEADING, atol=1e-6)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"heading": HEADING, "heading_deg": None}, r"no column 'heading_deg', which .* Nearest: 'heading'"),
        ({"fore_V": ["a"] * 400}, r"row 1: fore_V \(command.fore\) is 'a'; a number"),
        ({"fore_V": [[1.0]] * 400}, "no column 'fore_V'.* There are: 'time_s', 'heading_deg'. Correct"),
        ({"fore_V": [b"\xff\xfe"] * 400}, "fore_V holds bytes; numbers"),
        ({"time_s": ["noon"] * 400}, r"row 1: time_s is 'noon'"),
    ],
)
def test_wrong_columns(change: Mapping[str, Any], words: str, tmp_path: Path) -> None:
    columns = {name: values for name, values in {**standard(), **change}.items() if values is not None}
    with pytest.raises(LogError, match=words):
        read(tmp_path, columns)


def test_no_rows(tmp_path: Path) -> None:
    with pytest.raises(LogError, match="has columns but no rows"):
        read(tmp_path, {name: np.asarray(values)[:0] for name, values in standard().items()})


def test_time_has_to_be_mapped(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="time names no parquet column"):
        read(tmp_path, standard(), toml(time=""))


def test_without_pyarrow_the_message_names_the_extra(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pyarrow.parquet", None)
    with pytest.raises(LogError, match=r"needs the package pyarrow. Install it with `pip install 'rovid\[parquet\]'`"):
        read(tmp_path, standard())
