"""The trial day: after each log the updated model, suspected causes, the next run and the stop criteria."""

import re
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import KW_ONLY, dataclass
from pathlib import Path

from rovid.core.budget import ProgressCallback
from rovid.core.errors import ConfigError, DataError, OutputError, RovidError, suggestion
from rovid.diagnose.result import Diagnosis, next_experiment
from rovid.diagnose.signal_regressors import is_signal
from rovid.effects import Effect, effect_named, every_form
from rovid.estimate.candidate_runs import RunLimits
from rovid.estimate.estimate import Estimate
from rovid.estimate.experiment_design import ExperimentPlan, candidate_model, plan_experiment
from rovid.estimate.maximum_likelihood import LikelihoodFit
from rovid.model.parameter_names import base_names, without_form
from rovid.store.folder_monitor import FolderChange, FolderMonitor, Problem, WatchedLog
from rovid.store.study import Study, open_study
from rovid.trial.axis import Axis
from rovid.trial.fault import stopping

_CRITERION = re.compile(r"\s*([A-Za-z_][\w.:@ -]*?)\s+(?:to\s+)?(\d+(?:\.\d+)?)\s*%\s*")
_OPTION = "--until"


@dataclass(frozen=True, kw_only=True)
class StopCriterion:
    """A required relative half width of a parameter's 95 % interval, or a required probability of a cause."""

    name: str  # Name of a parameter, or id of an effect
    share: float  # Limit; 1 is 100 %
    is_effect: bool  # Whether ``name`` is an effect

    def __str__(self) -> str:
        """The criterion as the user writes it."""
        return f"{self.name} {100.0 * self.share:g} %"

    def status(self, estimate: Estimate | None, diagnosis: Diagnosis | None) -> "CriterionStatus":
        """Current value and whether the criterion is met."""
        current = _probability(self.name, diagnosis) if self.is_effect else _half_width(self.name, estimate)
        met = current is not None and (current >= self.share if self.is_effect else current <= self.share)
        return CriterionStatus(criterion=self, current=current, met=met)


@dataclass(frozen=True, kw_only=True)
class CriterionStatus:
    """Progress of a criterion; ``current`` is None if unknown."""

    criterion: StopCriterion
    current: float | None
    met: bool


def parse_criteria(text: str, axis: Axis, *, diagnosed: bool = True) -> tuple[StopCriterion, ...]:
    """Criteria in ``text``, as "inertia 2 %"; causes only if ``diagnosed``. Raises ConfigError if one is wrong."""
    found, known = [], {*base_names(axis), *(effect.id for effect in every_form())}
    for part in text.split(","):
        match = _CRITERION.fullmatch(part)
        if match is None:
            text = f"is {part.strip()!r}; a name and a percentage were expected."
            raise ConfigError(text, where=_OPTION, mend='As in --until "inertia 2 %, quadratic_drag 5 %".')
        name, share = re.sub(r"[ -]+", "_", match[1]), float(match[2]) / 100.0
        key, _, parameter = name.rpartition(".")
        if key:
            names = [one.name for one in effect_named(key).parameters]
            if parameter not in names:
                text = f"{parameter!r} is no parameter of {key}. {suggestion(parameter, names)}"
                raise ConfigError(text, where=_OPTION)
        elif name not in known:
            text = f"{name!r} is no parameter and no effect. {suggestion(name, sorted(known))}"
            raise ConfigError(text, where=_OPTION)
        is_effect = not key and name not in base_names(axis)
        if is_effect and not diagnosed:
            raise ConfigError(f"needs a diagnosis to find {name}.", where=_OPTION, mend="Leave --no-diagnosis out.")
        if share <= 0.0 or (is_effect and share >= 1.0):
            raise ConfigError(f"{name} {100.0 * share:g} % cannot be reached.", where=_OPTION)
        found.append(StopCriterion(name=name, share=share, is_effect=is_effect))
    return tuple(dict.fromkeys(found))


def _half_width(name: str, estimate: Estimate | None) -> float | None:
    """Relative half width of the first parameter of this name; None if it is unknown or a placeholder."""
    if estimate is not None:
        for full in estimate.names:
            if without_form(full) == name and full not in estimate.refused and not estimate.is_placeholder(full):
                return relative_half_width(estimate, full)
    return None


def relative_half_width(estimate: Estimate, name: str) -> float | None:
    """Larger distance of the 95 % interval's ends from the value, relative to the value; None for a value of zero."""
    value = estimate.value(name)
    return max(abs(end - value) for end in estimate.interval(name)) / abs(value) if value else None


def _probability(name: str, diagnosis: Diagnosis | None) -> float | None:
    """Probability of the effect; 0 if the diagnosis does not name it, None without a diagnosis."""
    if diagnosis is None:
        return None
    causes = (*diagnosis.findings, *diagnosis.suspects)
    return max((float(cause.probability) for cause in causes if cause.effect.id == name), default=0.0)


@dataclass(frozen=True, kw_only=True, eq=False)
class LogsChanged:
    """Event: logs came, changed or went."""

    change: FolderChange


@dataclass(frozen=True, kw_only=True, eq=False)
class ModelFitted:
    """Event: the model was fitted to all logs."""

    study: Study
    new: tuple[str, ...]  # Names of the new or replaced logs
    fit: LikelihoodFit | None  # None if the data do not suffice
    missing: str  # What the fit lacks in that case
    before: Estimate | None  # Estimate before the last logs; None for the first fit
    criteria: tuple[CriterionStatus, ...]


@dataclass(frozen=True, kw_only=True, eq=False)
class LogsDiagnosed:
    """Event: all logs were diagnosed; ``fit`` is the fit before the diagnosis."""

    study: Study
    diagnosis: Diagnosis
    fit: LikelihoodFit | None
    criteria: tuple[CriterionStatus, ...]


@dataclass(frozen=True, kw_only=True, eq=False)
class NextRun:
    """Event: the recommended next run."""

    words: str  # The run and its reason in one line each
    reason: str
    plan: ExperimentPlan | None  # The run with its commands; None if only its description is known
    written: Path | None  # Path of the command file; None if none was written


@dataclass(frozen=True, kw_only=True, eq=False)
class SessionEnded:
    """Event: the end of the session."""

    reason: str  # "reached", "interrupted" or "once"
    criteria: tuple[CriterionStatus, ...]
    logs: tuple[WatchedLog, ...]  # The fitted logs
    study: Study | None
    fit: LikelihoodFit | None
    diagnosis: Diagnosis | None  # Diagnosis of these logs; None if there is none


Event = LogsChanged | ModelFitted | LogsDiagnosed | NextRun | Problem | SessionEnded


@dataclass(frozen=True, kw_only=True)
class SessionActions:
    """What a session does with the logs."""

    # Function that diagnoses a study and reports its progress; None: no diagnosis
    diagnose: Callable[[Study, ProgressCallback], Diagnosis] | None
    keep: Callable[[Study, Estimate], None]  # Called with the estimate after each log
    write: Callable[[ExperimentPlan], Path | None]  # Writes the command file of a plan and returns its path
    cutoff: float | None = None  # Low-pass cut-off in Hz; None: chosen from the data


class _OvertakenError(Exception):
    """A new log came during the diagnosis."""


@dataclass(eq=False)
class WatchSession:
    """The events in a folder until all stop criteria are met."""

    monitor: FolderMonitor
    actions: SessionActions
    until: Sequence[StopCriterion] = ()
    _: KW_ONLY
    interval: float = 2.0  #: s, time between two polls.
    report: ProgressCallback = lambda _: None
    sleep: Callable[[float], None] = time.sleep
    _effects: tuple[Effect, ...] = ()
    _study: Study | None = None
    _logs: tuple[WatchedLog, ...] = ()
    _fit: LikelihoodFit | None = None
    _diagnosis: Diagnosis | None = None
    _overtaken: bool = False

    def events(self) -> Iterator[Event]:
        """Events as they happen; the last one is a `SessionEnded`."""
        while True:
            change = self.monitor.poll()
            yield from self.monitor.problems.take_new()
            if change is not None:
                self.monitor.accept(change)
                yield from self._process(change)
                if self._are_criteria_met():
                    yield self.ended("reached")
                    return
            elif self.monitor.once:
                yield self.ended("once")
                return
            else:
                self.report(f"Waiting for {'another' if self.monitor.logs else 'a'} log …")
                self.sleep(self.interval)

    def ended(self, reason: str) -> SessionEnded:
        """The final event."""
        return SessionEnded(
            reason=reason,
            criteria=self._criteria(),
            logs=self._logs,
            study=self._study,
            fit=self._fit,
            diagnosis=self._diagnosis,
        )

    def _process(self, change: FolderChange) -> Iterator[Event]:
        """Fit and diagnose the changed logs, and plan the next run."""
        problems = self.monitor.problems
        self.report("Fitting …")
        before = self._estimate()
        try:
            study = open_study(
                [self.monitor.path],
                cutoff=self.actions.cutoff,
                axis=self.monitor.axis,
                reading=change.reading,
                without=change.excluded,
            )
            # The digests of the logs are computed now, while the files are there.
            _ = study.provenance
        except (RovidError, OSError) as error:
            if isinstance(error, OSError) or isinstance(error.__cause__, OSError):
                self._try_again(error)
            else:
                yield LogsChanged(change=change)
                problems.report("logs", str(error))
            return
        problems.resolve("logs")
        yield LogsChanged(change=change)
        self._study, self._fit, self._diagnosis = study, None, None
        self._logs = tuple(change.logs.values())
        missing = ""
        try:
            study.require_sound()
            try:  # With the effects of the last diagnosis, if these logs hold their signals.
                self._fit = study.likelihood(self._effects)
            except ConfigError:
                self._effects = ()
                self._fit = study.likelihood()
        except RovidError as error:
            missing = str(error)
        new = tuple(log.name for log in (*change.added, *change.replaced))
        criteria = self._criteria()
        yield ModelFitted(study=study, new=new, fit=self._fit, missing=missing, before=before, criteria=criteria)
        yield from self._diagnose(study)
        yield from problems.take_new()

    def _try_again(self, error: Exception) -> None:
        """Return to the previous state after a file, or a whole network share, disappeared."""
        self.monitor.problems.report(self.monitor.path, str(error))
        self.monitor.revert()
        self.sleep(self.interval)

    def _diagnose(self, study: Study) -> Iterator[Event]:
        """Diagnose the logs if required, keep the estimate, and plan the next run."""
        if self.actions.diagnose is not None:
            self.report("Diagnosing …")
            try:
                self._diagnosis = self.actions.diagnose(study, self._report_unless_overtaken)
            except _OvertakenError:
                self._overtaken = True
                return
            except OSError as error:
                self._try_again(error)
                return
            self._overtaken = False
            extended = self._diagnosis.extended  # with suspects, as in the parameter file
            effects = () if extended is None else extended.model.effects
            self._effects = tuple(effect for effect in effects if not is_signal(effect))
            yield LogsDiagnosed(study=study, diagnosis=self._diagnosis, fit=self._fit, criteria=self._criteria())
        estimate = self._estimate()
        if estimate is not None:
            try:
                self.actions.keep(study, estimate)
                self.monitor.problems.resolve("parameters")
            except (RovidError, OSError) as error:
                self.monitor.problems.report("parameters", str(error))
        if not self._are_criteria_met() and not stopping(study.faults):
            self.report("Comparing candidate runs …")
            yield from self._next_run(study)

    def _report_unless_overtaken(self, words: str) -> None:
        """Report progress; a new log ends the diagnosis, unless the last one was ended, or the criteria are met."""
        self.report(words)
        if not self._overtaken and not self._are_criteria_met() and self.monitor.poll() is not None:
            raise _OvertakenError

    def _next_run(self, study: Study) -> Iterator[Event]:
        """Recommend the run that discriminates between causes, or else the run that narrows a parameter."""
        problems = self.monitor.problems
        advice = None if self._diagnosis is None else next_experiment(self._diagnosis)
        try:
            plan = self._discriminating_plan() or self._narrowing_plan(study)
        except RovidError as error:
            if advice:
                yield NextRun(words=advice["run"], reason=advice["reason"], plan=None, written=None)
            else:
                problems.report("next run", str(error))
            return
        problems.resolve("next run")
        written = None
        try:
            written = self.actions.write(plan)
            problems.resolve("command file")
        except OutputError as error:
            problems.report("command file", str(error))
        reason = advice["reason"] if advice and not plan.parameter else plan.reason
        if self._diagnosis is not None and self._diagnosis.is_settled:
            reason += "; nothing more to run for the causes"
        yield NextRun(words=plan.best.run.name, reason=reason, plan=plan, written=written)

    def _discriminating_plan(self) -> ExperimentPlan | None:
        """The diagnosis' plan for a run that is expected to discriminate between two causes."""
        if self._diagnosis is None:
            return None
        plans = [cause.plan for cause in (*self._diagnosis.findings, *self._diagnosis.suspects)]
        return next((plan for plan in plans if plan is not None and plan.is_decisive), None)

    def _narrowing_plan(self, study: Study) -> ExperimentPlan:
        """Plan for the first parameter whose criterion is not met, or else for the least certain parameter."""
        if self._fit is None or study.campaign is None:
            raise DataError("there are too few data for a plan.")
        if {effect.key for effect in self._effects} != {effect.key for effect in self._fit.model.effects}:
            self._fit = study.likelihood(self._effects)
        names = self._fit.model.names
        wanted = [one.criterion.name for one in self._criteria() if not one.met and not one.criterion.is_effect]
        parameters = [name for parameter in wanted for name in names if without_form(name) == parameter]
        models = [candidate_model(self._fit, "the model")]
        return plan_experiment(models, study.vehicle, study.campaign.trials, RunLimits(), next(iter(parameters), ""))

    def _estimate(self) -> Estimate | None:
        """Estimate of the diagnosis, or else of the fit."""
        if self._diagnosis is not None and self._diagnosis.extended is not None:
            return self._diagnosis.extended.estimate
        return None if self._fit is None else self._fit.estimate

    def _criteria(self) -> tuple[CriterionStatus, ...]:
        estimate = self._estimate()
        return tuple(criterion.status(estimate, self._diagnosis) for criterion in self.until)

    def _are_criteria_met(self) -> bool:
        """Whether there are criteria and all of them are met."""
        criteria = self._criteria()
        return bool(criteria) and all(status.met for status in criteria)
