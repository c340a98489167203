"""Folders: what is a log, what it is called, what is left out and said."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from rovid.core import budget
from rovid.core.errors import LogError
from rovid.readers import find_logs, read_campaign
from rovid.trial.config import Config
from rovid.trial.trial import Campaign
from tests.readers.logs import (
    campaign,
    csv_text,
    dive,
    kinds,
    mcap_bytes,
    standard,
    toml,
    turning,
)


def names(found: Campaign) -> list[str]:
    return [trial.name for trial in found.trials]


def said(found: Campaign) -> str:
    return " ".join(remark.text for remark in found.remarks)


def log(seed: int, rate: float = 8.0) -> str:
    time, heading = turning(seed=seed, rate=rate)
    return csv_text(standard(time_s=time, heading_deg=heading % 360.0))


def test_a_folder_in_the_order_of_names(tmp_path: Path, config: Config) -> None:
    for folder in ("b", "a/deep", ".hidden"):
        (tmp_path / folder).mkdir(parents=True)
    (tmp_path / "b" / "x.csv").write_text(log(1))
    (tmp_path / "a" / "deep" / "y.CSV").write_text(log(2, rate=5.0))
    (tmp_path / "z.mcap").write_bytes(mcap_bytes(dive(300)))
    (tmp_path / ".hidden" / "h.csv").write_text("nonsense")
    (tmp_path / ".h.csv").write_text("nonsense")
    (tmp_path / "notes.txt").write_text("nonsense")
    found = read_campaign([tmp_path], config)
    assert names(found) == ["a/deep/y.CSV", "b/x.csv", "z.mcap"]
    assert found.remarks == ()
    assert found.sources == (tmp_path,)


TABLES = {
    "curve": "command,thrust_N\n0,0\n1,1\n",
    "steady": "command,yaw_rate_rad_s,torque_Nm\n1,0.1,42\n",
    "sine": "trial,period_s,torque_amplitude_Nm,peak_yaw_rate_rad_s\na,40,100,0.1\n",
}


@pytest.mark.parametrize("table", TABLES)
def test_known_tables_are_no_logs(table: str, tmp_path: Path, config: Config) -> None:
    (tmp_path / "table.csv").write_text(TABLES[table])
    (tmp_path / "hold.csv").write_text(log(1))
    found = read_campaign([tmp_path], config)
    assert names(found) == ["hold.csv"]
    assert found.remarks == ()


@pytest.mark.parametrize("text", ["PWM (µs), Force\n1100,-4\n", "-4.9,-63.1\n-4.8,-57.3\n", "just a note\n"])
def test_tables_without_a_mapped_column_are_said(text: str, tmp_path: Path, config: Config) -> None:
    (tmp_path / "bench.csv").write_bytes(text.encode("latin-1"))
    (tmp_path / "hold.csv").write_text(log(1))
    found = read_campaign([tmp_path], config)
    assert names(found) == ["hold.csv"]
    assert [remark.kind for remark in found.remarks] == ["skipped"]
    assert "bench.csv was left out" in said(found)


@pytest.mark.parametrize("missing", ["time_s", "heading_deg", "fore_V"])
def test_a_log_that_lacks_one_column_is_an_error(missing: str, tmp_path: Path, config: Config) -> None:
    columns = standard()
    columns["other"] = columns.pop(missing)
    (tmp_path / "bad.csv").write_text(csv_text(columns))
    (tmp_path / "hold.csv").write_text(log(1))
    with pytest.raises(LogError, match=f"bad.csv: has no column '{missing}'"):
        read_campaign([tmp_path], config)


@pytest.mark.parametrize("content", [b"", bytes(range(256)) * 10])
def test_a_file_that_cannot_be_looked_at_counts_as_a_log(content: bytes, tmp_path: Path, config: Config) -> None:
    (tmp_path / "bad.csv").write_bytes(content)
    (tmp_path / "hold.csv").write_text(log(1))
    found, _ = find_logs([tmp_path], config)
    assert [name for name, _ in found] == ["bad.csv", "hold.csv"]
    with pytest.raises(LogError, match=r"bad\.csv"):
        read_campaign([tmp_path], config)


def test_nothing_there(tmp_path: Path, config: Config) -> None:
    with pytest.raises(LogError, match=r"holds 1 tables \(curve.csv\) but no log"):
        read_campaign([tmp_path], config)
    (tmp_path / "empty").mkdir()
    with pytest.raises(LogError, match=r"empty: holds no logs: no \.csv, \.mcap, "):
        read_campaign([tmp_path / "empty"], config)
    with pytest.raises(LogError, match=r"nowhere: there is no such file or folder"):
        read_campaign([tmp_path / "nowhere"], config)
    with pytest.raises(LogError, match="no column 'time_s'"):
        read_campaign([tmp_path / "curve.csv"], config)
    with pytest.raises(LogError, match=r"suffix '\.toml'"):
        read_campaign([tmp_path / "rovid.toml"], config)


def test_files_and_folders_together(tmp_path: Path, config: Config) -> None:
    for number, folder in enumerate(("mon", "tue")):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "hold.csv").write_text(log(number, rate=5.0 + number))
        (tmp_path / folder / f"only_{folder}.csv").write_text(log(number, rate=9.0 + number))
    found = read_campaign([tmp_path / "mon", tmp_path / "tue", tmp_path / "mon" / "hold.csv"], config)
    assert sorted(Path(name).name for name in names(found)) == ["hold.csv", "hold.csv", "only_mon.csv", "only_tue.csv"]
    assert len(set(names(found))) == 4
    assert "the same file" in said(found)


def test_progress_is_told(tmp_path: Path, config: Config, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(budget, "_PROGRESS_INTERVAL", 0.0)
    (tmp_path / "a.csv").write_text(log(1))
    (tmp_path / "b.csv").write_text(log(2, rate=5.0))
    seen: list[str] = []
    read_campaign([tmp_path], config, seen.append)
    assert [words.partition(",")[0] for words in seen] == [
        "Reading the logs: log 1 of 2",
        "Reading the logs: log 2 of 2",
    ]


def test_unreadable_folder_entries_are_told(tmp_path: Path, config: Config) -> None:
    (tmp_path / "folder.csv").mkdir()
    (tmp_path / "hold.csv").write_text(log(1))
    (tmp_path / "gone.csv").symlink_to(tmp_path / "nowhere.csv")
    with pytest.raises(LogError, match=r"gone\.csv"):
        read_campaign([tmp_path], config)


def test_formats_mix(tmp_path: Path) -> None:
    config = campaign(tmp_path, toml('supply = { csv = "supply_V" }'))
    (tmp_path / "a.csv").write_text(csv_text(standard(supply_V=np.full(400, 48.0))))
    (tmp_path / "b.mcap").write_bytes(mcap_bytes([(t, ns + 10**12, f) for t, ns, f in dive(700)]))
    found = read_campaign([tmp_path], config)
    assert [sorted(trial.extras) for trial in found.trials] == [["supply"], []]
    assert all(kinds(trial) == {} for trial in found.trials)


def test_readers_start_light() -> None:
    heavy = ["pandas", "mcap", "scipy", "numba", "rich"]
    code = "import sys, rovid.readers; print([m for m in sys.argv[1:] if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code, *heavy], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_when_each_trial_began_where_every_log_tells(tmp_path: Path, config: Config) -> None:
    """By the clock, whatever the names; parts of a trial begin later."""
    for name, hour in (("b.csv", 12), ("a.csv", 14)):
        begun = np.datetime64(f"2026-01-07T{hour}:00:00", "ms")
        time, heading = turning(seed=hour, rate=hour - 5.0)
        moments = [f"{begun + round(1000 * t)}Z" for t in time]
        (tmp_path / name).write_text(csv_text(standard(time_s=moments, heading_deg=heading % 360.0)))
    second, first = read_campaign([tmp_path], config).trials
    assert (first.campaign_time, second.campaign_time) == pytest.approx((0.0, 7200.0))
    assert second.part(slice(100, None), "part").campaign_time == pytest.approx(7200.0 + second.time[100])


def test_where_no_log_tells_they_follow_each_other_by_name(tmp_path: Path, config: Config) -> None:
    for number in (1, 2, 3):
        (tmp_path / f"run_{number}.csv").write_text(log(number, rate=3.0 + number))
    trials = read_campaign([tmp_path], config).trials
    lengths = [trial.duration for trial in trials]
    assert [trial.campaign_time for trial in trials] == pytest.approx([0.0, lengths[0], lengths[0] + lengths[1]])
