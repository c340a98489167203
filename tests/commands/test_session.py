"""What the parameter file remembers for the commands that follow."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from tests.conftest import Rovid


def test_later_commands_remember_the_logs_wherever_they_run(
    day: Path, rovid: Rovid, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert rovid("fit-drag", day, "-p", "süb dir/p.toml").code == 0
    inertia = rovid("fit-inertia", "-p", "süb dir/p.toml", "--json").document
    monkeypatch.chdir(tmp_path / "süb dir")
    assert rovid("simulate", "-p", "p.toml", "--json").document["overall"]["yaw_rate_r2"] > 0.99
    assert inertia["chosen"] == "orbit_integral"


def test_a_folder_moved_with_its_parameter_file_still_works(day: Path, rovid: Rovid, tmp_path: Path) -> None:
    shutil.copytree(day, tmp_path / "here" / "logs")
    assert rovid("fit-drag", "here/logs", "-p", "here/p.toml").code == 0
    (tmp_path / "here").rename(tmp_path / "there")
    assert rovid("fit-inertia", "-p", "there/p.toml").code == 0


def test_logs_may_be_given_one_by_one_and_twice(day: Path, rovid: Rovid) -> None:
    whole = rovid("fit-drag", day, "--json").document["parameters"]
    single = rovid("fit-drag", day / "holds up.csv", day / "holds dówn.csv", day / "sine.csv", "--json").document
    assert single["parameters"] == whole
    twice = rovid("fit-drag", day, day / "holds up.csv", "--json").document
    assert twice["parameters"] == whole
    assert any("same file" in text for text in twice["warnings"])
