"""Facts of each log, and an unreadable log among others."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from rovid.preflight.check import check_logs
from rovid.trial.config import Config, load_config
from tests.conftest import SAMPLES, Rovid

TANK = SAMPLES / "rosub_tank"


def config(folder: Path, *logs: str) -> Config:
    for name in ("rovid.toml", "thrust_curve.csv", *logs):
        shutil.copy(TANK / name, folder)
    return load_config(folder / "rovid.toml")


def test_holds_sines_and_samples_are_counted(tmp_path: Path) -> None:
    found = check_logs([tmp_path], config(tmp_path, "hold_03.csv", "sine_20s.mcap"))
    facts = {trial.name: row for trial, row in found.rows}
    assert not found.problems
    hold, sine = facts["hold_03.csv"], facts["sine_20s.mcap"]
    assert (hold["held_commands"], hold["sine_runs"]) == (3, 0)
    assert (sine["held_commands"], sine["sine_runs"]) == (0, 1)
    assert hold["sample_rate"] == pytest.approx(20.0, rel=0.01)
    assert hold["samples"] == pytest.approx(20.0 * hold["duration"], rel=0.01)
    low, high = sine["torque_range"]
    assert low < 0.0 < high


def test_a_bad_log_does_not_hide_the_others(tmp_path: Path) -> None:
    wanted = config(tmp_path, "hold_01.csv")
    (tmp_path / "bad.csv").write_text("time_s,heading_deg\n0,1\n")
    found = check_logs([tmp_path], wanted)
    assert [trial.name for trial, _ in found.rows] == ["hold_01.csv"]
    assert set(found.problems) == {"bad.csv"}


def test_a_log_of_two_seconds_is_one_message(tmp_path: Path, rovid: Rovid) -> None:
    day = tmp_path / "day"
    day.mkdir()
    for name in ("rovid.toml", "thrust_curve.csv"):
        shutil.copy(SAMPLES / "rosub_tank" / name, day)
    rows = (SAMPLES / "rosub_tank" / "staircase.csv").read_text(encoding="utf-8").splitlines()
    time = [float(row.split(",")[0]) for row in rows[1:]]
    (day / "run.csv").write_text("\n".join(rows[: 1 + sum(one <= 2.9 for one in time)]) + "\n", encoding="utf-8")
    done = rovid("check", "day")
    assert done.code == 2
    assert done.out == ""
    assert "too short to determine the inertia" in done.err
