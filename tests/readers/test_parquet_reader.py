"""Parquet: times and numbers of every type, names that it shares with CSV, and what is refused."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Mapping
from datetime import UTC, datetime, timedelta
from decimal import Decimal
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from rovid.core.errors import ConfigError, LogError
from rovid.readers import read_log
from rovid.trial.trial import Trial
from tests.conftest import slow
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


EVERY_BYTE = """
import sys
from pathlib import Path
from rovid.trial.config import load_config
from rovid.core.errors import RovidError
from rovid.readers import READERS, read_log
path, changes = Path(sys.argv[1]), list(map(int, sys.argv[2:]))
data, config = path.read_bytes(), load_config(path.parent / "rovid.toml")
begin = len(data) - 8 - int.from_bytes(data[-8:-4], "little")
step, *changes = changes
for at in range(begin, len(data), step):
    for change in changes:
        path.write_bytes(data[:at] + bytes([data[at] ^ change]) + data[at + 1 :])
        for look in (lambda: read_log(path, config), lambda: READERS[".parquet"].sources(path)):
            try:
                look()
            except RovidError as error:
                assert "Traceback" not in str(error)
"""


@pytest.mark.parametrize("changes", ["5 2", slow("1 1 2 16 128")])
def test_no_byte_of_a_damaged_footer_ends_the_process(changes: str, tmp_path: Path) -> None:
    """What describes the table stands there; pyarrow aborts where some of it is asked for and makes no sense."""
    campaign(tmp_path)
    (tmp_path / "a.parquet").write_bytes(parquet({name: np.asarray(v)[:30] for name, v in standard().items()}))
    code = [sys.executable, "-W", "error", "-c", EVERY_BYTE, str(tmp_path / "a.parquet"), *changes.split()]
    done = subprocess.run(code, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize(
    ("column", "values"),
    [
        ("time_s", pa.array([True] * 400)),
        ("time_s", pa.array([Decimal(f"{t:.6f}") for t in TIME.tolist()])),
        ("time_s", pa.array([None] * 400, pa.null())),
        ("time_s", pa.array([t * 10**6 for t in range(400)], pa.duration("us"))),
        ("time_s", pa.array(list(range(400)), pa.time32("s"))),
        ("time_s", pa.array(list(range(400)), pa.date32())),
        ("time_s", pa.array([2**64 - 1 - t for t in range(400)], pa.uint64())),
        ("heading_deg", pa.array([None] * 400, pa.null())),
        ("heading_deg", pa.array([BEGIN] * 400)),
        ("heading_deg", pa.array([True, False] * 200)),
        ("heading_deg", pa.array(["1"] * 399 + [None])),
    ],
    ids=lambda value: str(getattr(value, "type", value)),
)
def test_columns_of_any_type_are_read_or_refused(column: str, values: pa.Array, tmp_path: Path) -> None:
    try:
        read(tmp_path, {**standard(), column: values})
    except LogError as error:
        assert "a.parquet" in str(error)  # noqa: PT017  # what is not refused is read


def test_columns_of_one_name_are_refused(tmp_path: Path) -> None:
    config = campaign(tmp_path)
    columns = standard()
    table = pa.Table.from_arrays(
        [pa.array(np.asarray(v)) for v in (*columns.values(), TIME)], names=[*columns, "fore_V"]
    )
    pq.write_table(table, tmp_path / "a.parquet")
    with pytest.raises(LogError, match="2 columns 'fore_V'"):
        read_log(tmp_path / "a.parquet", config)


def test_wrong_text_is_found_in_any_batch(tmp_path: Path) -> None:
    rows = 150_000
    time, heading = turning(rows)
    text = ["1.0"] * rows
    text[140_000] = "N/A"
    with pytest.raises(LogError, match=r"row 140001: fore_V \(command.fore\) is 'N/A'"):
        read(tmp_path, {"time_s": time, "heading_deg": heading % 360.0, "fore_V": text})


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
