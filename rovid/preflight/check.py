"""`rovid check`: facts and problems of each log, and advice before a fit."""

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np

from rovid.core.errors import DataError, LogError, RovidError
from rovid.estimate.inner_loop import find_inner_loop
from rovid.estimate.steady_drag import DragFit
from rovid.faults.base import examine_runs, named, resolve
from rovid.faults.quick_model import log_name
from rovid.preflight.advice import Advice, advise, feedback_text, joined_clocks
from rovid.preflight.clock_alignment import ClockOffsets
from rovid.preflight.clock_offsets import estimate_clock_offsets
from rovid.preflight.command_effects import ThrusterCheck, all_reversed, check_thrusters
from rovid.preflight.feedback_detection import SIGNIFICANCE_LEVEL, Feedback, detect_feedback
from rovid.readers import find_logs, read_trials
from rovid.readers.campaign import examine_campaign
from rovid.readers.formats import relative_name
from rovid.store.study import Study
from rovid.trial.config import Config
from rovid.trial.fault import Fault, stopping
from rovid.trial.preprocessing import Run, prepare
from rovid.trial.rates import choose_cutoff, white_noise
from rovid.trial.segments import find_holds, find_sines
from rovid.trial.trial import Campaign, Remark, Trial
from rovid.trial.vehicle import Vehicle


@dataclass(frozen=True, kw_only=True)
class CheckedLogs:
    """The readable logs, the problems of the others, and findings; ``advice`` is sorted by severity."""

    trials: tuple[Trial, ...]
    problems: dict[str, str]
    remarks: tuple[Remark, ...]
    advice: tuple[Advice, ...] = ()
    faults: tuple[Fault, ...] = ()

    @property
    def verdict(self) -> Literal["go", "care", "no_go"]:
        """Whether the logs are ready for a fit."""
        weights = {one.weight for one in self.advice}
        if not self.trials or self.problems or "grave" in weights or stopping(self.faults):
            return "no_go"
        return "care" if "care" in weights or self.faults else "go"


@dataclass(frozen=True, kw_only=True)
class LogCheck(CheckedLogs):
    """The check for one axis, with the ``facts`` of each of the ``trials``.

    The advice rests on ``feedback``, on the ``clocks`` of joined files and on the check of each of the ``thrusters``.
    """

    facts: tuple[dict[str, Any], ...]
    feedback: tuple[Feedback, ...] = ()
    clocks: ClockOffsets = field(default_factory=ClockOffsets)
    thrusters: tuple[ThrusterCheck, ...] = ()


def read_each_log(paths: Sequence[Path], config: Config) -> tuple[list[Trial], dict[str, str], list[Remark]]:
    """The trials of all logs that can be read, the message for each other log by its name, and remarks."""
    found, remarks = find_logs(paths, config)
    trials: list[Trial] = []
    problems = {}
    for name, path in found:
        try:
            trials += read_trials(path, config, name, remarks)
        except RovidError as error:
            problems[name] = str(error)
    return trials, problems, remarks


def check_logs(paths: Sequence[Path], config: Config) -> LogCheck:
    """Check all logs. Each log is read by itself: an unreadable log does not hide the others."""
    return check_trials(config, *read_each_log(paths, config))


def check_trials(
    config: Config, every: Sequence[Trial], problems: dict[str, str] | None = None, remarks: Sequence[Remark] = ()
) -> LogCheck:
    """Check trials that were read; ``problems`` has the message for each log that could not be read."""
    problems = dict(problems or {})
    trials, faults = examine_campaign(every, config)
    vehicle = config.vehicle.clamped() if stopping(faults) else config.vehicle
    readable, facts = [], []
    cutoff = 0.0
    with suppress(RovidError):  # `advise` reports logs that are too short.
        cutoff = choose_cutoff(every) if every else 0.0
    for trial in every:
        try:
            facts.append(_facts(trial, config, vehicle, cutoff))
            readable.append(trial)
        except RovidError as error:
            problems[trial.parent or trial.name] = str(error)
    usable = set(map(id, readable))
    trials = [trial for trial in trials if id(trial) in usable]
    checked = LogCheck(
        trials=tuple(readable), facts=tuple(facts), problems=problems, remarks=tuple(remarks), faults=faults
    )
    if stopping(faults):
        return checked
    more: tuple[Fault, ...] = ()
    runs: Sequence[Run] = ()
    with suppress(RovidError):
        prepared = prepare(Campaign(trials=tuple(trials), sources=()), config.vehicle) if trials else None
        runs = prepared.items if prepared else ()
        levels = [remark for remark in prepared.remarks if remark.kind == "level"] if prepared else []
        checked = replace(checked, remarks=(*checked.remarks, *levels))
    if runs and (loop := find_inner_loop(runs, config)) is not None:
        return replace(checked, advice=(Advice(kind="inner_loop", text=f"{loop.error}", weight="grave"),))
    if runs and trials[0].has_actuators:
        # The trials that stay after the remedies of faults that torque and rates show.
        kept, more = examine_runs(runs, config.vehicle, config.faults)
        used = {id(run.trial) for run in runs}
        trials = [*(run.trial for run in kept), *(trial for trial in trials if id(trial) not in used)]
    # Logs that were set aside because of their clocks.
    aside = {
        log for fault in more if fault.fault == "clocks_apart" and fault.remedy == "set_aside" for log in fault.logs
    }
    apart = [run.trial for run in runs if log_name(run) in aside]
    feedback = detect_feedback(trials, vehicle)
    clocks = estimate_clock_offsets([*trials, *apart], config)
    known = {relative_name(file, config) for trial in apart for file in (trial.path, *trial.companion_files)}
    unknown = replace(clocks, offsets=tuple(clock for clock in clocks.offsets if clock.name not in known))
    thrusters = check_thrusters(trials, vehicle)
    advice = advise(trials, vehicle, feedback, unknown, thrusters, config.faults, all_read=not problems)
    # The quick model and a fit find the same inertia.
    doubled = {"scale"} if any(fault.fault == "thrust_unit" for fault in more) else set()
    return replace(
        checked,
        advice=tuple(each for each in advice if each.kind not in doubled),
        feedback=tuple(feedback),
        clocks=clocks,
        thrusters=tuple(thrusters),
        faults=(*faults, *more, *_clock_faults(unknown, more, config)),
    )


def _clock_faults(clocks: ClockOffsets, found: Sequence[Fault], config: Config) -> Iterator[Fault]:
    """Certain offsets of joined files, unless the response of the vehicle has shown them already."""
    for clock in clocks.offsets:
        if clock.certain and not any(each.fault == "clocks_apart" and each.stops for each in found):
            fault = Fault(fault="clocks_apart", logs=(clock.name,), text=clock.text, size=clock.offset, unit="s")
            yield resolve(replace(fault, standard_error=clock.error, stops=True), config.faults)


def _facts(trial: Trial, config: Config, vehicle: Vehicle, cutoff: float) -> dict[str, Any]:
    torque = vehicle.torque(trial)
    position = trial.position[trial.measured]
    measured = trial.rate[trial.measured] if trial.rate_only and trial.rate is not None else position
    return {
        "duration": trial.duration,
        "samples": int(trial.measured.sum()),
        "sample_rate": 1.0 / trial.sampling_interval,
        "measured": config.measured_signal,
        "noise": white_noise(measured),
        "travel": float(np.sum(np.abs(np.diff(position)))),
        f"{trial.axis.force_name}_range": [float(torque.min()), float(torque.max())],
        "held_commands": len(find_holds(trial, vehicle, torque, cutoff)) if cutoff else 0,
        "sine_runs": len(find_sines(trial, torque)),
        "remarks": list(map(remark_document, trial.remarks)),
    }


def drag_without_feedback(study: Study) -> DragFit:
    """`Study.drag` of the logs whose commands do not follow the motion.

    A held command of an autopilot answers the disturbance of that time, which biases drag. A pilot's steps are held
    whatever the motion does then. Raises DataError if there is no steady turn without feedback.
    """
    if study.runs is None:
        return study.drag()
    found = detect_feedback([run.trial for run in study.runs.items], study.vehicle)
    found = [one for one in found if one.seen_in == "flow" and one.chance < SIGNIFICANCE_LEVEL]
    if not found:
        return study.drag()
    axis, names = study.vehicle.axis, {one.name for one in found}
    text = f"{feedback_text(found, axis)} Such commands answer the motion, which biases drag"
    kept = tuple(run for run in study.runs.items if run.trial.name not in names)
    mend = "Run `rovid fit`, which is valid under feedback, or hold commands with the autopilot off."
    if not kept:
        raise DataError(f"{text[0].lower()}{text[1:]}.", mend=mend)
    try:
        fit = replace(study, runs=replace(study.runs, items=kept)).drag()
    except DataError as error:
        raise DataError(f"{text[0].lower()}{text[1:]}. In the other logs: {error}", mend=mend) from error
    warnings = (*fit.estimate.warnings, f"{text}: {named(sorted(names))} left out.")
    return replace(fit, estimate=replace(fit.estimate, warnings=warnings))


def require_fittable(study: Study, config: Config | None) -> None:
    """Refuse logs for which the verdict of `rovid check` is no go. Raises LogError.

    Such are logs with a fault that no fit survives, with a thruster that turns the vehicle the other way, and joined
    files whose clocks are certainly apart, by their ``config``, None for tables.
    """
    study.require_sound()
    if found := reversed_thrusters(study):
        axis = study.vehicle.axis
        mend = f"Check in rovid.toml the signs of {axis.arm_key}, command and {axis.required_signals}."
        raise LogError(found, mend=mend)
    if study.runs is None or config is None or not config.join:
        return
    clocks = estimate_clock_offsets([run.trial for run in study.runs.items], config)
    for fault in stopping([*_clock_faults(clocks, study.faults, config)]):
        grave = next(advice for advice in joined_clocks(clocks) if advice.weight == "grave")
        raise LogError(fault.text, mend=f"{grave.text.split('. ', 1)[0]}.")


def reversed_thrusters(study: Study) -> str:
    """Sentences on thrusters that turn the vehicle the other way, for which the verdict is no go; empty without one."""
    if study.runs is None or not study.runs.items[0].trial.has_actuators:
        return ""
    checks = check_thrusters([run.trial for run in study.runs.items], study.vehicle)
    every = all_reversed(checks, study.vehicle.axis)
    return every or " ".join(check.text(study.vehicle.axis) for check in checks if check.is_reversed)


def remark_document(remark: Remark) -> dict[str, Any]:
    """JSON document of one remark of a reader."""
    return {"kind": remark.kind, "count": remark.count, "text": remark.text}
