"""Clock offsets of joined files: certain offsets, and offsets that may be delays."""

from __future__ import annotations

import tomllib
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from benchmarks.clocks import told
from tests.conftest import Rovid, slow
from tests.readers.test_formats import day
from tools.folders import Clocks, write_folder

JOIN = 'parts = ["ins", "thr"]\n'


def clocks(rovid: Rovid, folder: str) -> list[dict[str, object]]:
    found: list[dict[str, object]] = rovid("check", folder, "--json").document["clocks"]
    return found


def test_a_response_before_the_command_is_a_clock_offset(tmp_path: Path, rovid: Rovid) -> None:
    folder = day(tmp_path / "day", split="{run}_{part}.csv", late=0.6)
    document = rovid("check", "day", "--json").document
    (one,) = document["clocks"]
    assert one["name"] == "thr"
    assert one["certain"] is True
    assert one["offset"] == pytest.approx(-0.6, abs=0.1)
    assert document["verdict"] == "no_go"
    (advice,) = [each for each in document["advice"] if each["kind"] == "clock_offset"]
    assert "which is impossible" in advice["text"]
    assert "Put offset = { thr = -0.6" in advice["text"]
    # A first rovid.toml sets it, with the reason; nothing is left then.
    (folder / "rovid.toml").unlink()
    init = rovid("init", "day", "--json").document
    assert [each["name"] for each in init["clocks"]] == ["thr"]
    written = tomllib.loads((folder / "rovid.toml").read_text(encoding="utf-8"))
    assert written["join"]["offset"]["thr"] == pytest.approx(-0.6, abs=0.1)
    assert "which is impossible" in (folder / "rovid.toml").read_text(encoding="utf-8")
    again = rovid("check", "day", "--json").document
    assert not [each for each in again["advice"] if each["kind"] == "clock_offset"]
    remarks = [remark["text"] for log in again["logs"] for remark in log["remarks"] if remark["kind"] == "clock"]
    assert len(remarks) == len(again["logs"])


def test_a_late_response_is_not_called_a_clock_offset(tmp_path: Path, rovid: Rovid) -> None:
    folder = day(tmp_path / "day", split="{run}_{part}.csv", late=-0.6)
    document = rovid("check", "day", "--json").document
    (one,) = document["clocks"]
    assert one["certain"] is False
    assert one["offset"] == pytest.approx(0.6, abs=0.1)
    (advice,) = [each for each in document["advice"] if each["kind"] == "clocks"]
    assert "The logs do not show which" in advice["text"]
    (folder / "rovid.toml").unlink()
    assert rovid("init", "day").code == 0
    assert "offset" not in tomllib.loads((folder / "rovid.toml").read_text(encoding="utf-8"))["join"]


def test_a_heading_in_both_files_determines_each_offset(tmp_path: Path, rovid: Rovid) -> None:
    """The offset differs from run to run."""
    folder = day(tmp_path / "day", split="{run}_{part}.csv", block=JOIN)
    rng = np.random.default_rng(4)
    late = {"hold_03": 0.4, "steps": -0.7, "sine_20s": 1.1}
    for run, seconds in late.items():
        ins, thr = (folder / f"{run}_{part}.csv" for part in ("ins", "thr"))
        log, other = pd.read_csv(ins), pd.read_csv(thr)
        turned = np.unwrap(log["heading_deg"], period=360.0)
        other["compass_deg"] = np.interp(other["time_s"], log["time_s"], turned) + rng.normal(0.0, 0.02, len(other))
        other["time_s"] += seconds
        other.to_csv(thr, index=False)
    found = {str(one["name"]): one for one in clocks(rovid, "day") if one["by"]}
    assert found.keys() == {f"{run}_thr.csv" for run in late}
    for run, seconds in late.items():
        one = found[f"{run}_thr.csv"]
        assert one["certain"] is True
        assert one["offset"] == pytest.approx(-seconds, abs=max(4.0 * float(str(one["error"])), 0.01))


@pytest.mark.parametrize(("index", "twice"), [(13, "heading"), slow(20, "rate"), (28, "")])
def test_clock_offsets_in_a_generated_folder(index: int, twice: str, tmp_path: Path) -> None:
    truth = write_folder(tmp_path, seed=77, index=index, clocks=Clocks(apart=0.9, drift=1e-4, twice=twice))
    rows = told(tmp_path, truth)
    assert not isinstance(rows, str)
    assert rows
    assert all(bool(row.by) is bool(twice) for row in rows)
    # Without the same in both files a lag of the thrusters stands against it.
    most = 0.05 if twice else 0.6
    assert all(abs(row.off) < max(most, 4.0 * row.error) for row in rows)
    assert all(row.certain for row in rows) or not twice


def test_a_diagnosed_delay_may_be_a_clock_offset(tmp_path: Path, rovid: Rovid) -> None:
    day(tmp_path / "day", split="{run}_{part}.csv")
    document = rovid("diagnose", "day", "--json").document
    assert {finding["effect"] for finding in document["findings"]} & {"thruster_lag", "command_delay"}
    assert any("may be a clock offset of the joined files" in text for text in document["warnings"])
