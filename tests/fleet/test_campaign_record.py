"""Records of campaigns and their validity."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from rovid.fleet import campaigns as module
from rovid.fleet.campaigns import CampaignRecord, CampaignTask, campaign_digest, read_record

TASK = CampaignTask(name="a", folder="/a", axis="yaw", cutoff=None, digest="0123")
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
    assert record.is_valid_for(TASK, 60.0) is holds
    assert not record.is_valid_for(replace(TASK, digest=""), 60.0)


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
