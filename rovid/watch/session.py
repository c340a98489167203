"""The trial day: after each log what it added, what is suspected, the run to make next, and whether to go on."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from rovid.core.errors import ConfigError, DataError, OutputError, RovidError
from rovid.design.candidate_runs import RunLimits
from rovid.design.experiment_design import ExperimentPlan, candidate_model, plan_experiment
from rovid.diagnose.next_experiment import next_experiment
from rovid.diagnose.result import Diagnosis
from rovid.effects import Effect
from rovid.estimate.estimate import Estimate
from rovid.estimate.maximum_likelihood import LikelihoodFit
from rovid.model.parameter_names import without_form
from rovid.store.study import Study, open_study
from rovid.watch.folder_monitor import FolderChange, FolderMonitor, Problem, WatchedLog
from rovid.watch.stop_criteria import CriterionStatus, StopCriterion

Report = Callable[[str], None]


@dataclass(frozen=True, kw_only=True, eq=False)
class LogsChanged:
    """Logs that are gone by now, and what became of others."""

    change: FolderChange


@dataclass(frozen=True, kw_only=True, eq=False)
class ModelFitted:
    """The fit to all logs, beside the one before it.

    Attributes
    ----------
    fit
        None where there is too little to fit.
    missing
        Of what, then.
    before
        What was known before the last log; None where nothing was.
    new
        Names of the logs that came, or came anew.
    """

    study: Study
    new: tuple[str, ...]
    fit: LikelihoodFit | None
    missing: str
    before: Estimate | None
    criteria: tuple[CriterionStatus, ...]


@dataclass(frozen=True, kw_only=True, eq=False)
class LogsDiagnosed:
    """What the diagnosis of all logs says; ``fit`` is what was known before it."""

    study: Study
    diagnosis: Diagnosis
    fit: LikelihoodFit | None
    criteria: tuple[CriterionStatus, ...]


@dataclass(frozen=True, kw_only=True, eq=False)
class NextRun:
    """The run to make next.

    Attributes
    ----------
    words, reason
        In a line each.
    plan
        With its commands; None where it is known in words alone.
    written
        Where the command file is; None where none was written.
    """

    words: str
    reason: str
    plan: ExperimentPlan | None
    written: Path | None


@dataclass(frozen=True, kw_only=True, eq=False)
class SessionEnded:
    """The end.

    Attributes
    ----------
    why
        reached, interrupted or once.
    logs
        Those that were fitted.
    diagnosis
        Of all ``logs``; None where there is none of them all.
    """

    reason: str
    criteria: tuple[CriterionStatus, ...]
    logs: tuple[WatchedLog, ...]
    study: Study | None
    fit: LikelihoodFit | None
    diagnosis: Diagnosis | None


Event = LogsChanged | ModelFitted | LogsDiagnosed | NextRun | Problem | SessionEnded


@dataclass(frozen=True, kw_only=True)
class SessionActions:
    """What is done with the logs.

    Attributes
    ----------
    diagnose
        Of a study, told how to report; None where there is to be none.
    keep
        Called with what is known after each log.
    write
        Puts a plan where the user wants it, and says where that is.
    """

    diagnose: Callable[[Study, Report], Diagnosis] | None
    keep: Callable[[Study, Estimate], None]
    write: Callable[[ExperimentPlan], Path | None]
    limits: RunLimits = field(default_factory=RunLimits)
    cutoff: float | None = None


class _OvertakenError(Exception):
    """Another log came while the diagnosis went on."""


class WatchSession:
    """What happens in a folder, until enough is known.

    Parameters
    ----------
    until
        What has to be known; all of it.
    interval
        s between two looks.
    report
        Told what is being done.
    """

    def __init__(
        self,
        watched: FolderMonitor,
        work: SessionActions,
        until: Sequence[StopCriterion] = (),
        *,
        interval: float = 2.0,
        report: Report = lambda _: None,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        self._watched = watched
        self._work = work
        self._until = tuple(until)
        self._interval = interval
        self._report = report
        self._sleep = sleep
        self._effects: tuple[Effect, ...] = ()
        self._study: Study | None = None
        self._logs: tuple[WatchedLog, ...] = ()
        self._fit: LikelihoodFit | None = None
        self._diagnosis: Diagnosis | None = None
        self._overtaken = False

    def events(self) -> Iterator[Event]:
        """What happens, as it does; the last is a `Stop`."""
        while True:
            change = self._watched.poll()
            yield from self._watched.problems.take_new()
            if change is not None:
                self._watched.accept(change)
                yield from self._step(change)
                if self._met():
                    yield self.ended("reached")
                    return
            elif self._watched.once:
                yield self.ended("once")
                return
            else:
                self._report(self._waiting())
                self._sleep(self._interval)

    def ended(self, why: str) -> SessionEnded:
        """The end, for this reason."""
        return SessionEnded(
            reason=why,
            criteria=self._standings(),
            logs=self._logs,
            study=self._study,
            fit=self._fit,
            diagnosis=self._diagnosis,
        )

    def _waiting(self) -> str:
        count = len(self._watched.logs)
        return f"Waiting for {'another' if count else 'a'} log …"

    def _step(self, change: FolderChange) -> Iterator[Event]:
        """Everything that is worked out anew."""
        troubles, path = self._watched.problems, self._watched.path
        self._report("Fitting …")
        before = self._estimate()
        try:
            study = open_study(
                [path],
                cutoff=self._work.cutoff,
                axis=self._watched.axis,
                reading=change.reading,
                without=change.excluded,
            )
            # Its logs' digests are taken while they are there.
            _ = study.provenance
        except (RovidError, OSError) as error:
            if isinstance(error, OSError) or isinstance(error.__cause__, OSError):
                self._again(error)
            else:
                yield LogsChanged(change=change)
                troubles.report("logs", str(error))
            return
        troubles.resolve("logs")
        yield LogsChanged(change=change)
        self._study, self._fit, self._diagnosis = study, None, None
        self._logs = tuple(change.logs.values())
        missing = ""
        try:
            self._fit = self._fitted(study)
        except RovidError as error:
            missing = str(error)
        new = tuple(log.name for log in (*change.added, *change.replaced))
        standings = self._standings()
        yield ModelFitted(study=study, new=new, fit=self._fit, missing=missing, before=before, criteria=standings)
        yield from self._diagnosed(study)
        yield from troubles.take_new()

    def _again(self, error: Exception) -> None:
        """A log, or all of a share, is gone in between: the folder is looked at anew."""
        self._watched.problems.report(self._watched.path, str(error))
        self._watched.revert()
        self._sleep(self._interval)

    def _fitted(self, study: Study) -> LikelihoodFit:
        """With what the last diagnosis found, as far as these logs know of it."""
        try:
            return study.likelihood(self._effects)
        except ConfigError:
            self._effects = ()
            return study.likelihood()

    def _diagnosed(self, study: Study) -> Iterator[Event]:
        """The diagnosis where there is to be one, and the next run."""
        if self._work.diagnose is not None:
            self._report("Diagnosing …")
            try:
                self._diagnosis = self._work.diagnose(study, self._unless_overtaken)
            except _OvertakenError:
                self._overtaken = True
                return
            except OSError as error:
                self._again(error)
                return
            self._overtaken = False
            self._effects = tuple(finding.effect for finding in self._diagnosis.findings)
            yield LogsDiagnosed(study=study, diagnosis=self._diagnosis, fit=self._fit, criteria=self._standings())
        known = self._estimate()
        if known is not None:
            self._keep(study, known)
        if not self._met():
            self._report("Trying runs …")
            yield from self._next(study)

    def _unless_overtaken(self, words: str) -> None:
        """Pass on how far the diagnosis is; end it where another log came, but not the second time, nor the last."""
        self._report(words)
        if not self._overtaken and not self._met() and self._watched.poll() is not None:
            raise _OvertakenError

    def _keep(self, study: Study, estimate: Estimate) -> None:
        try:
            self._work.keep(study, estimate)
        except (RovidError, OSError) as error:
            self._watched.problems.report("parameters", str(error))
        else:
            self._watched.problems.resolve("parameters")

    def _next(self, study: Study) -> Iterator[Event]:
        """The run that decides between causes; else the one that makes surer what is asked for, or least sure."""
        found = None if self._diagnosis is None else next_experiment(self._diagnosis)
        reason = found["reason"] if found else "it makes a parameter surer"
        try:
            best = self._deciding() or self._narrowing(study)
        except RovidError as error:
            if found:
                yield NextRun(words=found["run"], reason=reason, plan=None, written=None)
            else:
                self._watched.problems.report("next run", str(error))
            return
        self._watched.problems.resolve("next run")
        written = None
        try:
            written = self._work.write(best)
        except OutputError as error:
            self._watched.problems.report("command file", str(error))
        else:
            self._watched.problems.resolve("command file")
        if best.parameter:
            reason = f"it makes {best.parameter} surer"
        yield NextRun(words=best.best.run.name, reason=reason, plan=best, written=written)

    def _deciding(self) -> ExperimentPlan | None:
        """Of the diagnosis, where a run is expected to tell two causes apart."""
        if self._diagnosis is None:
            return None
        plans = [one.plan for one in (*self._diagnosis.findings, *self._diagnosis.suspects) if one.plan is not None]
        return next((one for one in plans if one.is_decisive), None)

    def _narrowing(self, study: Study) -> ExperimentPlan:
        """For the first parameter that is asked for and not known well enough; else for the least sure."""
        if self._fit is None or study.campaign is None:
            raise DataError("there is too little for a plan.")
        if {effect.key for effect in self._effects} != {effect.key for effect in self._fit.model.effects}:
            self._fit = study.likelihood(self._effects)
        names = self._fit.model.names
        wanted = [one.criterion.name for one in self._standings() if not one.met and not one.criterion.is_effect]
        full = [name for want in wanted for name in names if without_form(name) == want]
        belief = candidate_model(self._fit, "the model")
        return plan_experiment([belief], study.vehicle, study.campaign.trials, self._work.limits, next(iter(full), ""))

    def _estimate(self) -> Estimate | None:
        """What is known: by the diagnosis where there is one of all logs, else by the fit."""
        if self._diagnosis is not None and self._diagnosis.extended is not None:
            return self._diagnosis.extended.estimate
        return None if self._fit is None else self._fit.estimate

    def _standings(self) -> tuple[CriterionStatus, ...]:
        estimate = self._estimate()
        return tuple(one.status(estimate, self._diagnosis) for one in self._until)

    def _met(self) -> bool:
        """Whether there is something to be reached, and all of it is."""
        standings = self._standings()
        return bool(standings) and all(one.met for one in standings)
