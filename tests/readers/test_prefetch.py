"""Logs that a copy reads are as those that are read here."""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from pathlib import Path

import pytest

from rovid.core import spmd
from rovid.core.errors import LogError
from rovid.readers import campaign as module
from rovid.readers import read_campaign
from rovid.readers.campaign import PrefetchedReader, read_trials
from rovid.trial.axis import YAW, Axis
from rovid.trial.config import Config, find_config, load_config
from rovid.trial.trial import Campaign, Remark, Trial
from tests.conftest import write_short_day
from tests.synthetic import assert_same_trial

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="there are copies on Linux alone")


@pytest.fixture(autouse=True)
def two_cores(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(spmd, "core_count", lambda: 2)


@pytest.fixture
def day(tmp_path: Path) -> Path:
    """A short day, of which one log lacks readings and one has a stretch that is left out."""
    write_short_day(tmp_path / "day")
    log = tmp_path / "day" / "hold_03.csv"
    head, *rows = log.read_text(encoding="utf-8").splitlines()
    log.write_text("\n".join([head, *rows[:900], *rows[1400:]]) + "\n", encoding="utf-8")
    config = tmp_path / "day" / "rovid.toml"
    left_out = '\n[[leave_out]]\nlog = "hold_05.csv"\nfrom = 100.0\nto = 150.0\nreason = "a hand"\n'
    config.write_text(config.read_text(encoding="utf-8") + left_out, encoding="utf-8")
    return tmp_path / "day"


def read(day: Path, *, ahead: bool) -> tuple[Campaign, list[Path]]:
    """The campaign, and which logs this process read itself; what it does meanwhile it does once, before it waits."""
    here: list[Path] = []
    done: list[None] = []

    def noted(path: Path, config: Config, name: str, remarks: list[Remark]) -> list[Trial]:
        here.append(path)
        return read_trials(path, config, name, remarks)

    config = load_config(find_config([day]), YAW)
    asked, meanwhile = lambda: ([day], YAW), lambda: done.append(None)
    with pytest.MonkeyPatch.context() as patched, PrefetchedReader(asked, meanwhile) as reading:
        patched.setattr(module, "read_trials", noted)
        campaign = read_campaign([day], config, reading=reading if ahead else None)
    assert len(done) == int(ahead)
    return campaign, here


def test_where_the_copy_was_stopped_nothing_is_done_meanwhile(day: Path) -> None:
    config = load_config(find_config([day]), YAW)
    with PrefetchedReader(lambda: ([day], YAW), lambda: pytest.fail("there is no copy to wait for")) as reading:
        reading.stop()
        assert len(read_campaign([day], config, reading=reading).trials) == 9  # one of the 8 logs pauses


def test_trials_and_remarks_are_the_same(day: Path) -> None:
    (ahead, none), (usual, every) = read(day, ahead=True), read(day, ahead=False)
    assert none == []
    assert len(every) == 7
    assert ahead.remarks == usual.remarks
    assert [trial.name for trial in ahead.trials] == [trial.name for trial in usual.trials]
    assert any(trial.remarks for trial in usual.trials)
    for one, other in zip(ahead.trials, usual.trials, strict=True):
        assert one.axis is YAW
        assert_same_trial(one, other)


def test_a_log_that_cannot_be_read_says_so_here(day: Path) -> None:
    (day / "staircase.csv").write_text("time_s,heading_deg,fore_V,aft_V\n0,1,2\n", encoding="utf-8")
    with pytest.raises(LogError, match="staircase"):
        read(day, ahead=True)


def test_large_logs_are_read_here(day: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "_LARGE", 1000)
    _, every = read(day, ahead=True)
    assert len(every) == 7


def test_where_the_copy_ends_all_is_read_here(day: Path) -> None:
    def asks() -> tuple[Sequence[Path], Axis]:
        os._exit(1)

    config = load_config(find_config([day]), YAW)
    with PrefetchedReader(asks, lambda: None) as reading:
        assert len(read_campaign([day], config, reading=reading).trials) == 9  # one of the 8 logs pauses
