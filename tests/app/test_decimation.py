"""Decimated columns keep the extremes of each bin and the time origin of [[leave_out]]."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from rovid.app.form_state import columns_document
from rovid.preflight.log_reading import read_columns
from rovid.preflight.raw_columns import RawColumn
from rovid.readers import read_log
from rovid.trial.config import load_config

TEN_HOURS = np.arange(0.0, 36000.0, 0.1)


def drawn(values: np.ndarray, begin: float = -np.inf, end: float = np.inf, bins: int = 300) -> dict[str, list[float]]:
    columns = {"a": RawColumn(source="a", time=TEN_HOURS, values=values)}
    document = columns_document(columns, [], begin, end, bins)
    assert (document["begin"], round(document["end"])) == (0.0, 36000)
    (column,) = document["columns"]
    return dict(column)


def test_a_long_log_is_decimated_without_losing_peaks() -> None:
    values = np.sin(TEN_HOURS)
    values[123_456] = 40.0
    column = drawn(values)
    assert len(json.dumps(column)) < 20_000
    assert len(column["time"]) == len(column["low"]) == len(column["high"]) == 300
    at = int(np.argmax(column["high"]))
    assert column["high"][at] == 40.0
    assert column["time"][at] <= TEN_HOURS[123_456] < column["time"][at + 1]
    assert min(column["low"]) == pytest.approx(-1.0, abs=1e-4)


def test_an_angle_is_shown_without_jumps_of_whole_turns() -> None:
    heading = (7.0 * TEN_HOURS) % 360.0
    heading[5000:5100] = np.nan
    columns = {"a": RawColumn(source="a", time=TEN_HOURS, values=heading)}
    (column,) = columns_document(columns, ["a"], -np.inf, np.inf, 300, {"a": 360.0})["columns"]
    assert column["high"][-1] == pytest.approx(7.0 * TEN_HOURS[-1], rel=1e-4)
    assert np.all(np.diff(column["low"]) > 0.0)
    # The readings are as logged.
    assert 0.0 <= column["lowest"] < column["highest"] < 360.0


def test_a_zoomed_view_has_every_sample_and_one_at_each_end() -> None:
    column = drawn(TEN_HOURS, 100.0, 110.0)
    assert column["time"][0] == pytest.approx(99.9)
    assert column["time"][-1] == pytest.approx(110.1)
    assert column["low"] == column["high"]
    assert len(column["time"]) == 103


def test_gaps_and_unordered_samples_are_handled() -> None:
    values = np.where(TEN_HOURS < 10.0, np.nan, 1.0)
    order = np.random.default_rng(1).permutation(len(values))
    columns = {
        "a": RawColumn(source="a", time=TEN_HOURS[order], values=values[order]),
        "none": RawColumn(source="none", time=TEN_HOURS, values=np.full(len(values), np.nan)),
        "empty": RawColumn(source="empty", time=np.empty(0), values=np.empty(0)),
    }
    one, none, empty = columns_document(columns, [], -np.inf, np.inf, 50)["columns"]
    assert one["time"] == sorted(one["time"])
    assert one["time"][0] == pytest.approx(10.0)
    assert [none["samples"], none["time"], empty["time"], empty["lowest"]] == [0, [], [], None]
    json.dumps([one, none, empty], allow_nan=False)


def test_the_time_origin_is_that_of_leave_out(tmp_path: Path) -> None:
    # The command is known 3 s after the heading.
    rows = [f"{50 + 0.1 * k:.1f},{k % 360},{'' if k < 30 else 1 + k // 300}" for k in range(900)]
    (tmp_path / "a.csv").write_text("time_s,heading_deg,fore_V\n" + "\n".join(rows) + "\n")
    (tmp_path / "curve.csv").write_text("command,thrust_N\n-5,-100\n5,100\n")
    (tmp_path / "rovid.toml").write_text(
        '[[thrusters]]\nyaw_arm = 1.0\ncurve = "curve.csv"\ncommand = { csv = "fore_V" }\n'
        '[signals]\ntime = { csv = "time_s" }\nheading = { csv = "heading_deg", unit = "deg" }\n'
    )
    trial = read_log(tmp_path / "a.csv", load_config(tmp_path / "rovid.toml"))
    _, columns, _ = read_columns(tmp_path / "a.csv")
    document = columns_document(columns, ["heading_deg", "fore_V"], -np.inf, np.inf, 2000)
    assert (document["begin"], document["end"]) == pytest.approx((-3.0, trial.duration))
