"""The trial day and its stop criteria."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from rovid.core.budget import ProgressCallback
from rovid.core.errors import ConfigError, LogError, OutputError
from rovid.diagnose.cross_validation import HeldOutScores
from rovid.diagnose.result import Diagnosis, ModelAssessment
from rovid.effects import effect_named
from rovid.estimate.estimate import Estimate
from rovid.estimate.experiment_design import ExperimentPlan
from rovid.model.model import Model
from rovid.model.parameter_names import base_names
from rovid.store import watch_session as days
from rovid.store.folder_monitor import FolderMonitor, Problem
from rovid.store.study import Study, open_study
from rovid.store.watch_session import (
    LogsChanged,
    LogsDiagnosed,
    ModelFitted,
    NextRun,
    SessionActions,
    WatchSession,
    parse_criteria,
)
from rovid.trial.assumptions import Assumptions
from rovid.trial.axis import YAW, axis_named
from tests.store.days import write_day


def estimate(error: float, *, guess: Assumptions | None = None, refused: bool = False) -> Estimate:
    return Estimate(
        names=("inertia", "thruster_lag:rotor.time_constant"),
        values=np.array([100.0, 0.5]),
        covariance=np.diag([error**2, 0.01**2]),
        method="",
        samples=1,
        refused={"inertia": "nothing drives it"} if refused else {},
        assumptions=guess or Assumptions(),
    )


def test_criteria_are_names_and_percentages() -> None:
    (first, second, third) = parse_criteria(" inertia 2 %, quadratic drag 5%,thruster_lag 95 %", YAW)
    assert (first.name, first.share, first.is_effect) == ("inertia", 0.02, False)
    assert (second.name, second.share) == ("quadratic_drag", 0.05)
    assert (third.name, third.is_effect) == ("thruster_lag", True)
    assert str(third) == "thruster_lag 95 %"


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("inertia", "a name and a percentage were expected"),
        ("inertia 2", "a name and a percentage were expected"),
        ("inertai 2 %", "'inertia'"),
        ("thruster_lag.time 2 %", "'time_constant'"),
        ("inertia 0 %", "cannot be reached"),
        ("thruster_lag 100 %", "cannot be reached"),
    ],
)
def test_invalid_criteria_are_refused(text: str, said: str) -> None:
    with pytest.raises(ConfigError, match=said):
        parse_criteria(text, YAW)


def test_names_are_those_of_the_axis() -> None:
    *_, restoring = base_names(axis_named("roll"))
    (one,) = parse_criteria(f"{restoring} 10 %", axis_named("roll"))
    assert not one.is_effect
    with pytest.raises(ConfigError):
        parse_criteria(f"{restoring} 10 %", YAW)


def test_causes_need_a_diagnosis() -> None:
    with pytest.raises(ConfigError, match="needs a diagnosis"):
        parse_criteria("thruster_lag 90 %", YAW, diagnosed=False)


def test_a_parameter_criterion_uses_the_95_percent_interval() -> None:
    (one, lag) = parse_criteria("inertia 2 %, thruster_lag.time_constant 5 %", YAW)
    # 1.96 standard errors to either side.
    for error, met in ((1.0, True), (1.03, False)):
        standing = one.status(estimate(error), None)
        assert standing.current == pytest.approx(0.0196 * error, rel=1e-3)
        assert standing.met is met
    assert lag.status(estimate(1.0), None).met


def test_unknown_parameters_do_not_meet_a_criterion() -> None:
    (one,) = parse_criteria("inertia 50 %", YAW)
    guess = Assumptions(items=("curve of fore",), thrusters=1)
    for known in (None, estimate(1.0, refused=True), estimate(1.0, guess=guess)):
        standing = one.status(known, None)
        assert (standing.current, standing.met) == (None, False)


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


def test_the_next_run_is_planned_for_the_model_of_the_parameter_file(folder: Path) -> None:
    """With its suspects: `rovid plan` fits them too."""
    lag = effect_named("thruster_lag")
    held = HeldOutScores(log_likelihood=0.0, rate_r2=1.0, rate_rmse=0.0, rate_squares=np.zeros(0), position_errors={})
    model = Model(inertia=1.0, quadratic_drag=1.0, linear_drag=1.0, effects=(lag,), effect_values=(0.5,))

    def diagnose(study: Study, _report: ProgressCallback) -> Diagnosis:
        extended = ModelAssessment(model=model, estimate=study.likelihood((lag,)).estimate, held_out=held)
        return Diagnosis(verdict="suspected", extended=extended)

    for name in ("hold_up.csv", "sine.csv"):
        put(folder, name)
    events = list(until_idle(day_of(folder, SessionActions(diagnose=diagnose, keep=keep, write=write))))
    (run,) = [event for event in events if isinstance(event, NextRun)]
    assert run.plan is not None
    assert [one.model.effects for one in run.plan.models] == [(lag,)]


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
