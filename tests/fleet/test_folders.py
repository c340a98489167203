"""Search for campaigns and their names."""

from __future__ import annotations

from pathlib import Path

import pytest

from rovid.core.errors import ConfigError
from rovid.fleet.campaigns import find_campaigns


def campaign(folder: Path, *, toml: bool = True) -> Path:
    folder.mkdir(parents=True)
    (folder / "hold.csv").touch()
    if toml:
        (folder / "rovid.toml").touch()
    return folder


def named(*folders: Path, out: Path = Path("/nowhere/out")) -> dict[str, Path]:
    return find_campaigns(folders, out)


def test_a_folder_with_rovid_toml_is_one_campaign(tmp_path: Path) -> None:
    day = campaign(tmp_path / "day")
    campaign(day / "afternoon")
    assert named(day) == {"day": day}
    assert named(tmp_path) == {"day": day}


def test_campaigns_at_any_depth_have_unique_names(tmp_path: Path) -> None:
    places = [campaign(tmp_path / name) for name in ("2025/alpha", "2025/beta", "2026/x/alpha", "2026/y/alpha")]
    assert named(tmp_path) == dict(zip(["2025/alpha", "beta", "x/alpha", "y/alpha"], places, strict=True))


def test_a_repeated_campaign_counts_once(tmp_path: Path) -> None:
    day = campaign(tmp_path / "day")
    (tmp_path / "link").symlink_to(day)
    assert list(named(day, tmp_path, tmp_path / "." / "day", tmp_path / "link").values()) == [day]


def test_logs_without_rovid_toml_are_a_campaign(tmp_path: Path) -> None:
    good, lost = campaign(tmp_path / "a/good"), campaign(tmp_path / "a/lost/logs", toml=False)
    (tmp_path / "a" / "papers").mkdir()
    assert set(named(tmp_path / "a").values()) == {good, lost.parent}
    # Below a vehicle's rovid.toml nothing is missing, and a folder without logs is no campaign.
    assert named(lost) == {"logs": lost}
    assert named(tmp_path / "a/papers") == {"papers": tmp_path / "a/papers"}


def test_output_and_hidden_folders_are_no_campaigns(tmp_path: Path) -> None:
    day = campaign(tmp_path / "day")
    campaign(tmp_path / ".trash/day")
    campaign(tmp_path / "out", toml=False)
    assert named(tmp_path, out=tmp_path / "out") == {"day": day}


def test_the_output_must_not_lie_in_a_campaign(tmp_path: Path) -> None:
    day = campaign(tmp_path / "day")
    for out in (day, day / "out", day / "deeper/out"):
        with pytest.raises(ConfigError, match="lies in the campaign"):
            find_campaigns([tmp_path], out)


def test_a_missing_folder_is_a_campaign_only_next_to_existing_ones(tmp_path: Path) -> None:
    day = campaign(tmp_path / "day")
    assert set(named(day, tmp_path / "gone")) == {"day", "gone"}
    with pytest.raises(ConfigError, match="there is no such folder"):
        find_campaigns([tmp_path / "gone"], tmp_path / "out")
