"""Facts of each log, and an unreadable log among others."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from rovid.preflight.check import check_logs
from rovid.trial.config import Config, load_config
from tests.conftest import SAMPLES

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
