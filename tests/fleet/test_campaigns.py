"""Campaigns of a fleet: search, records, and a process for each."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import pytest

from rovid.core.errors import ConfigError
from rovid.core.threads import CORES_VARIABLE
from rovid.fleet import campaigns
from rovid.fleet import campaigns as module
from rovid.fleet.campaigns import (
    CampaignRecord,
    CampaignTask,
    campaign_digest,
    diagnose_campaign,
    find_campaigns,
    read_record,
)
from tests.conftest import ROOT

ELSEWHERE = CampaignTask(name="a", folder="/a", axis="yaw", cutoff=None, digest="0123")
RECORD = CampaignRecord(campaign="a", folder="/a", digest="0123", seconds=1.5, diagnosis={"verdict": "found"})


def test_record_round_trip(tmp_path: Path) -> None:
    path = tmp_path / "a.json"
    path.write_text(RECORD.text, encoding="utf-8")
    assert read_record(path) == RECORD
    for cut in range(0, len(RECORD.text) - 2, 7):
        path.write_text(RECORD.text[:cut], encoding="utf-8")
        assert read_record(path) is None
    for other in ("[]", "3", '{"schema": "rovid-campaign/1"}', RECORD.text.replace("campaign/1", "campaign/2")):
        path.write_text(other, encoding="utf-8")
        assert read_record(path) is None


@pytest.mark.parametrize(
    ("record", "holds"),
    [
        (RECORD, True),
        (replace(RECORD, digest="4567"), False),
        (replace(RECORD, failure="input", error="no logs"), True),
        (replace(RECORD, failure="crash", error="ended"), False),
        (replace(RECORD, failure="timeout", error="late", patience=60.0), True),
        (replace(RECORD, failure="timeout", error="late", patience=59.0), False),
    ],
)
def test_validity_of_a_record(record: CampaignRecord, holds: bool) -> None:
    assert record.is_valid_for(ELSEWHERE, 60.0) is holds
    assert not record.is_valid_for(replace(ELSEWHERE, digest=""), 60.0)


def test_the_digest_depends_on_every_input(sea: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import shutil

    folder = tmp_path / "copy"
    shutil.copytree(sea / "alpha/spring", folder)
    begun = campaign_digest(sea / "alpha/spring", "yaw", None)
    assert campaign_digest(folder, "yaw", None) == begun  # independent of its place
    found = {begun, campaign_digest(folder, "surge", None), campaign_digest(folder, "yaw", 0.3)}
    for name in ("down.csv", "thrust_curve.csv", "rovid.toml"):
        with (folder / name).open("a") as stream:
            stream.write("\n")
        found.add(campaign_digest(folder, "yaw", None))
    monkeypatch.setattr(module, "__version__", "99.0")
    found.add(campaign_digest(folder, "yaw", None))
    assert len(found) == 7


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


TASK = CampaignTask(name="a", folder="/nowhere/a", axis="yaw", cutoff=None, digest="0123")


def test_the_process_gets_its_cores_and_reports_errors(monkeypatch: pytest.MonkeyPatch) -> None:
    code = f"import os, sys; sys.exit(os.environ[{CORES_VARIABLE!r}] + os.environ['OPENBLAS_NUM_THREADS'])"
    monkeypatch.setattr(campaigns, "_CODE", code)
    record = diagnose_campaign(TASK, 60.0, 3)
    assert (record.error, record.failure) == ("its process ended with status 1: 31", "crash")
    assert (record.campaign, record.digest, record.patience) == ("a", "0123", 60.0)


def test_other_output_of_the_process_is_ignored(monkeypatch: pytest.MonkeyPatch) -> None:
    noise = "import rovid.fleet.campaigns as a; was = a.campaign_record; "
    noise += "a.campaign_record = lambda t: (print('noise'), was(t))[1]; "
    monkeypatch.setattr(campaigns, "_CODE", noise + campaigns._CODE)  # noqa: SLF001 - what the process runs
    record = diagnose_campaign(TASK, 60.0, 1)
    assert record.failure == "input"
    assert record.error == "a: there is no such file or folder. Give a log or the folder that holds the logs."


def test_the_process_ends_with_its_parent(tmp_path: Path) -> None:
    told = tmp_path / "pid"
    task = json.dumps({"name": "a", "folder": str(tmp_path), "axis": "yaw", "cutoff": None, "digest": ""})
    slow = f"import os, time, rovid.fleet.campaigns as a; open({str(told)!r}, 'w').write(str(os.getpid())); "
    slow += "a.campaign_record = lambda task: time.sleep(600); a.main()"
    code = f"import json, sys, rovid.fleet.campaigns as a; a._CODE = {slow!r}\n"
    code += f"a.diagnose_campaign(a.CampaignTask(**json.loads({task!r})), 600.0, 1)"
    with subprocess.Popen([sys.executable, "-c", code], cwd=ROOT) as first:
        until(lambda: told.exists() and bool(told.read_text()))
        first.send_signal(signal.SIGKILL)
    number = int(told.read_text())
    until(lambda: not runs(number))


def until(condition: object, patience: float = 30.0) -> None:
    assert callable(condition)
    deadline = time.monotonic() + patience
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.02)


def runs(number: int) -> bool:
    try:
        os.kill(number, 0)
    except ProcessLookupError:
        return False
    # An ended process exists until its status is read.
    state = Path(f"/proc/{number}/stat")
    return not (state.exists() and state.read_text().rpartition(")")[2].split()[0] == "Z")
