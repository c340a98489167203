"""A watch session: interrupted diagnoses, vanished network shares, files that cannot be written."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from rovid.core.budget import ProgressCallback
from rovid.core.errors import LogError, OutputError
from rovid.diagnose.result import Diagnosis
from rovid.estimate.estimate import Estimate
from rovid.estimate.experiment_design import ExperimentPlan
from rovid.store.study import Study, open_study
from rovid.trial.axis import YAW
from rovid.watch import session as days
from rovid.watch.folder_monitor import FolderMonitor, Problem
from rovid.watch.session import (
    LogsChanged,
    LogsDiagnosed,
    ModelFitted,
    NextRun,
    SessionActions,
    WatchSession,
    parse_criteria,
)
from tests.watch.days import write_day


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    write_day(tmp_path / "store")
    (tmp_path / "day").mkdir()
    for name in ("rovid.toml", "thrust_curve.csv"):
        shutil.copy(tmp_path / "store" / name, tmp_path / "day")
    return tmp_path / "day"


def put(folder: Path, name: str) -> None:
    shutil.copy(folder.parent / "store" / name, folder)


def keep(study: Study, estimate: Estimate) -> None:
    pass


def write(plan: ExperimentPlan) -> Path:
    return Path("plan.csv")


def day_of(folder: Path, work: SessionActions, until: str = "") -> WatchSession:
    """A session in which every log is complete at once, and that ends when it waits."""
    watched = FolderMonitor(path=folder, axis=YAW, settled=0.0, abandoned=0.0)
    return WatchSession(watched, work, parse_criteria(until, YAW) if until else (), interval=0.0, sleep=_ends)


def _ends(_seconds: float) -> None:
    raise KeyboardInterrupt


def until_idle(day: WatchSession) -> Iterator[object]:
    try:
        yield from day.events()
    except KeyboardInterrupt:
        return


def test_a_diagnosis_is_interrupted_by_a_new_log_but_not_twice(folder: Path) -> None:
    to_come = ["sine.csv", "coast.csv", "steps.csv"]
    begun: list[int] = []

    def diagnose(study: Study, report: ProgressCallback) -> Diagnosis:
        assert study.campaign is not None
        begun.append(len(study.campaign.trials))
        if to_come:
            put(folder, to_come.pop(0))
        report("Looking …")
        return Diagnosis(verdict="nothing_found")

    put(folder, "hold_up.csv")
    events = list(until_idle(day_of(folder, SessionActions(diagnose=diagnose, keep=keep, write=write))))
    assert begun == [1, 2, 3, 4]
    finished = [
        len(event.study.campaign.trials)
        for event in events
        if isinstance(event, LogsDiagnosed) and event.study.campaign
    ]
    assert finished == [2, 4]
    assert sum(isinstance(event, ModelFitted) for event in events) == 4


def test_a_possibly_final_diagnosis_is_not_interrupted(folder: Path) -> None:
    def diagnose(study: Study, report: ProgressCallback) -> Diagnosis:
        put(folder, "steps.csv")
        report("Looking …")
        return Diagnosis(verdict="nothing_found")

    for name in ("hold_up.csv", "sine.csv", "coast.csv"):
        put(folder, name)
    *_, last = until_idle(day_of(folder, SessionActions(diagnose=diagnose, keep=keep, write=write), "inertia 5 %"))
    assert isinstance(last, days.SessionEnded)
    assert last.reason == "reached"
    assert len(last.logs) == 3


def test_the_session_continues_if_files_cannot_be_written(folder: Path) -> None:
    def refused(*_: object) -> Path:
        raise OutputError("is write-protected.", where="plan.csv")

    def away(*_: object) -> None:
        raise OSError(116, "Stale file handle")

    put(folder, "sine.csv")
    events = list(until_idle(day_of(folder, SessionActions(diagnose=None, keep=away, write=refused))))
    (run,) = [event for event in events if isinstance(event, NextRun)]
    assert run.plan is not None
    assert run.written is None
    assert {event.where for event in events if isinstance(event, Problem)} == {"parameters", "command file"}


def test_a_vanished_network_share_is_tried_again(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    opened: Callable[..., Study] = open_study
    fails = [True, True]

    def flaky(*arguments: object, **options: object) -> Study:
        if fails:
            fails.pop()
            raise LogError("cannot be read.", where=folder) from OSError(116, "Stale file handle")
        return opened(*arguments, **options)

    monkeypatch.setattr(days, "open_study", flaky)
    put(folder, "sine.csv")
    work = SessionActions(diagnose=None, keep=keep, write=write)
    watched = FolderMonitor(path=folder, axis=YAW, settled=0.0, abandoned=0.0)
    slept: list[float] = []

    def sleep(seconds: float) -> None:
        slept.append(seconds)
        if len(slept) > 2:
            raise KeyboardInterrupt

    events = list(until_idle(WatchSession(watched, work, sleep=sleep)))
    assert [type(event) for event in events] == [Problem, Problem, LogsChanged, ModelFitted, NextRun]


@pytest.mark.parametrize(
    ("rows", "kinds"), [(12, [LogsChanged, Problem]), (400, [LogsChanged, ModelFitted])], ids=["short", "at rest"]
)
def test_a_failed_fit_is_reported_and_the_session_continues(rows: int, kinds: list[type], folder: Path) -> None:
    put(folder, "sine.csv")
    head, *lines = (folder / "sine.csv").read_text().splitlines()
    at_rest = [line.split(",") for line in lines[:rows]]
    for number, row in enumerate(at_rest):
        row[1:4] = [f"{10.0 + 0.01 * (number * 7 % 5):.2f}", "0.0", "0.0"]
    (folder / "sine.csv").write_text("\n".join([head, *map(",".join, at_rest)]) + "\n")
    day = day_of(folder, SessionActions(diagnose=None, keep=keep, write=write))
    events = list(until_idle(day))
    assert [type(event) for event in events][:2] == kinds
    assert all(event.fit is None and event.missing for event in events if isinstance(event, ModelFitted))
    put(folder, "sine.csv")
    put(folder, "hold_up.csv")
    models = [event for event in until_idle(day) if isinstance(event, ModelFitted)]
    assert models[-1].fit is not None
