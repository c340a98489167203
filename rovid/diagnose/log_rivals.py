"""Rivals of the causes of a diagnosis: the clock, an offset of the gyro, and the coupled model.

The clock of a joined file may be late, and a logger may write a command at the end of the interval in which it acted.
`rovid.diagnose.objectives.pose` adds the clock offset to the candidates. Where the offset is established, the commands
are moved by it and the diagnosis is repeated. Where it is possible, it is a fault that may act, and no cause.

A gyro whose readings are off by a constant shows a turn that no torque causes. A measured heading tells the offset.
Otherwise a constant torque, or drag that differs between the two senses, may stand for it. The offset is
fitted in place of such causes. If it is as likely, they are not established.

Some causes of a diagnosis of yaw are motion along surge and sway, which the coupled model explains.
"""

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace

import numpy as np

from rovid.core.budget import Budget, ProgressCallback
from rovid.core.errors import DataError
from rovid.core.formatting import plus_minus
from rovid.diagnose.candidate_fits import Challenger
from rovid.diagnose.foreign_logs import diagnose_majority, with_returned_logs
from rovid.diagnose.objectives import preload
from rovid.diagnose.result import EVEN, Diagnosis, Finding, delays_of_the_sensor, doubted, is_delay
from rovid.diagnose.thresholds import THRESHOLDS
from rovid.effects.actuator_inputs import SPEEDS
from rovid.effects.base import INSTANT, UNTIL, Effect, EffectParameter
from rovid.effects.clock_offset import CLOCKS_APART
from rovid.effects.thruster_imbalance import thruster_of
from rovid.estimate.maximum_likelihood import fit_likelihood
from rovid.faults.base import named
from rovid.trial.axis import YAW
from rovid.trial.fault import Fault
from rovid.trial.preprocessing import PreparedRuns, Run, prepare, shift_commands
from rovid.trial.rates import highest_cutoff
from rovid.trial.trial import Campaign, Trial
from rovid.trial.vehicle import Vehicle

# Effects of yaw that stand for motion along surge and sway, which the coupled model has as states.
_OF_MOTION = ("sideslip_moment", "speed_dependent_damping")
# Effects that slow motion along sway may imitate; they count next to one of the former alone.
_IMITATED = ("wave_torque", "heading_dependent_torque")
_POSITIONS = {"north", "east"}
# s; a longer delay of the drive is unlikely: bus, radio and controller take a tenth of it. Between topics of one file
# it is no more than a suspect. A shorter one is of a class with the offset. Decision.
_LONG_DELAY = 0.5
# Standard errors by which a delay exceeds the lateness of the stamps, if it is the drive's own. Convention.
_CERTAIN = 2.0
_COMMAND_DELAY = ("command_delay",)
# Effects with a mean turn of their own, which an offset of the gyro imitates.
_MEAN_TURN = ("bias_torque", "drag_asymmetry")
# Largest offset of the gyro and its resolution, relative to the RMS rate of the logs. Convention: a larger offset is a
# fault that every plot shows, and a finer one is below the errors of the drags.
_LARGEST, _FINEST = 0.5, 0.002


def coupled_causes(diagnosis: Diagnosis, trials: Iterable[Trial]) -> tuple[str, ...]:
    """Ids of findings that the coupled model would explain; none if no speed or position is logged."""
    every = list(trials)
    logged = [set(trial.extras) | set(trial.readings) for trial in every]
    if not every or any(trial.axis is not YAW for trial in every):
        return ()
    if not all(SPEEDS[1] in names or names >= _POSITIONS for names in logged):
        return ()
    found = [one.effect.id for one in diagnosis.findings]
    if not any(name in _OF_MOTION for name in found):
        return ()
    return tuple(name for name in found if name in _OF_MOTION or name in _IMITATED)


def coupled_sentence(diagnosis: Diagnosis, trials: Iterable[Trial]) -> str:
    """Recommendation of the coupled model; empty where the diagnosis gives no reason for it."""
    coupled, count = coupled_causes(diagnosis, trials), len(diagnosis.findings)
    if not coupled:
        return ""
    share = f"{len(coupled)} of {count} causes are" if count > 1 else "The cause is"
    return f"{share} motion along surge and sway: run `rovid diagnose --axes planar`, which fits it together with yaw."


def diagnose_logs(
    prepared: PreparedRuns, vehicle: Vehicle, report: ProgressCallback, seconds: float = math.inf
) -> Diagnosis:
    """The diagnosis within a budget of ``seconds``, in which a clock offset is a fault of the logs and no cause."""
    # The first run on a machine compiles the simulation: that time does not count.
    preload(wait=math.isfinite(seconds))
    budget = Budget(seconds)
    diagnosis = _diagnose(prepared, vehicle, report, budget)
    warnings = [*diagnosis.warnings, *_warnings(prepared.items, diagnosis.causes)]
    if coupled := coupled_sentence(diagnosis, [run.trial for run in prepared.items]):
        warnings.append(coupled)
    return replace(diagnosis, warnings=tuple(warnings), budget=budget.use)


def _diagnose(prepared: PreparedRuns, vehicle: Vehicle, report: ProgressCallback, budget: Budget) -> Diagnosis:
    def majority(runs: PreparedRuns) -> Diagnosis:
        return diagnose_majority(runs, vehicle, report, budget)

    prepared, diagnosis, returned = with_returned_logs(prepared, vehicle, majority, report, budget)
    diagnosis = _by_one_clock(prepared, diagnosis, vehicle, majority, report)
    diagnosis = without_gyro_offset(prepared, diagnosis, vehicle, report, budget)
    return replace(diagnosis, faults=(*returned, *diagnosis.faults))


def _by_one_clock(
    prepared: PreparedRuns,
    diagnosis: Diagnosis,
    vehicle: Vehicle,
    majority: Callable[[PreparedRuns], Diagnosis],
    report: ProgressCallback,
) -> Diagnosis:
    """The ``diagnosis`` without a clock offset, repeated by the ``majority`` of logs with corrected clocks."""

    def as_stamped() -> Diagnosis:
        report("Repeating the diagnosis with the clocks as logged …")
        return _without_offset(majority(replace(prepared, clocks_agree=True)), prepared.items)

    if prepared.clocks_agree:
        return diagnosis
    offset = _clock_offset(diagnosis.findings)
    if offset and _is_undone(offset, diagnosis.findings):
        return as_stamped()
    lead = math.inf if offset is None else _size(offset, "lead")[0]
    long = [run.trial for run in prepared.items if run.trial.duration > 2.0 * lead]
    if not long:
        return _without_offset(diagnosis, prepared.items)
    short = [run.trial.name for run in prepared.items if run.trial.duration <= 2.0 * lead]
    left_out = f" {named(short)} {'is' if len(short) == 1 else 'are'} too short for that: left out." if short else ""
    trials = tuple(shift_commands(trial, -lead) for trial in long)
    corrected = prepare(
        Campaign(trials=trials, sources=()), vehicle, cutoff=min(prepared.cutoff, highest_cutoff(trials))
    )
    report("Repeating the diagnosis with the clocks corrected …")
    diagnosis = majority(corrected)
    if offset and _is_undone(offset, diagnosis.findings):
        return as_stamped()
    return _without_offset(diagnosis, prepared.items, offset, f"The commands were moved by it.{left_out}")


def _clock_offset(findings: Sequence[Finding]) -> Finding | None:
    return next((finding for finding in findings if finding.effect is CLOCKS_APART), None)


def _without_offset(
    diagnosis: Diagnosis,
    runs: Sequence[Run],
    moved: Finding | None = None,
    done: str = "This is possible, not established: the commands were not moved.",
) -> Diagnosis:
    """``diagnosis`` with clock offsets as faults; a delay that may be one is no more than a suspect.

    ``moved`` is an offset by which the commands were moved before the diagnosis.
    """
    both = (*diagnosis.findings, *diagnosis.suspects)
    every = [finding for finding in both if finding.effect is not CLOCKS_APART]
    possible, faults = _clock_offset(both), list(diagnosis.faults)
    if (offset := moved or possible) is not None:
        # A delay that leaves the commands ahead of their stamps: stamps that are late by chance, and no delay.
        scatter = [finding for finding in every if _lateness(finding, offset) > -_CERTAIN]
        every = [finding for finding in every if finding not in scatter]
        if scatter:
            size = plus_minus(*_size(scatter[0], "delay"))
            done += f" Their lateness scatters by {size} s, as where the logger reads the commands only for its rows."
        faults.append(_offset_fault(offset, runs, done))
    findings = [finding for finding in diagnosis.findings if finding in every]
    suspects = [finding for finding in diagnosis.suspects if finding in every]
    # The clocks of commands and motion may differ in joined logs, and in logs by topics. The offset explains the logs
    # exactly as a delay does, at the same price.
    apart, separate = bool(_joined(runs)), all(run.trial.separate_clocks for run in runs)
    for delay in [finding for finding in findings if apart or separate]:
        if not any(is_delay(effect, _COMMAND_DELAY) for effect in (delay.effect, *delay.indistinguishable)):
            continue
        place, either = findings.index(delay), (*delay.indistinguishable, CLOCKS_APART)
        findings[place] = replace(delay, indistinguishable=either)
        if not is_delay(delay.effect, _COMMAND_DELAY):
            continue
        faults.append(_delay_fault(delay, runs))
        if not apart and _size(delay, "delay")[0] <= _LONG_DELAY:
            continue
        suspects.insert(0, replace(findings.pop(place), probability=EVEN * delay.probability))
        challenger = Challenger((*(finding.effect for finding in findings), CLOCKS_APART), 0.0, 0.0)
        diagnosis = replace(diagnosis, challengers=(challenger, *diagnosis.challengers)[: THRESHOLDS.challengers_shown])
    verdict = diagnosis.verdict
    if verdict in {"found", "suspected"} and not findings:
        # An offset that may act, and was not corrected, leaves the error of the model open.
        verdict = "nothing_found" if possible is None else "unexplained"
        if suspects:
            verdict = "suspected"
    return replace(diagnosis, verdict=verdict, findings=tuple(findings), suspects=tuple(suspects), faults=tuple(faults))


def _is_undone(offset: Finding, findings: Sequence[Finding]) -> bool:
    """Whether a command delay takes the ``offset`` back: the stamps are right, and the two only smooth the commands."""
    return any(_lateness(finding, offset) < _CERTAIN for finding in findings)


def _lateness(finding: Finding, offset: Finding) -> float:
    """What a command delay leaves of the lateness of the stamps, in standard errors; NaN for another cause."""
    if not is_delay(finding.effect, _COMMAND_DELAY):
        return math.nan
    (delay, error), (lead, lead_error) = _size(finding, "delay"), _size(offset, "lead")
    return (lead - delay) / math.hypot(error, lead_error)


def _size(finding: Finding, parameter: str) -> tuple[float, float]:
    """Value of a parameter, and its standard error."""
    name = f"{finding.effect.key}.{parameter}"
    return finding.estimate.value(name), finding.estimate.standard_error(name)


def _joined(runs: Sequence[Run]) -> tuple[str, ...]:
    """Names of the logs that were joined from several files."""
    return tuple(dict.fromkeys(run.trial.parent or run.trial.name for run in runs if run.trial.companion_files))


def _delay_fault(delay: Finding, runs: Sequence[Run]) -> Fault:
    """The clock offset that looks like a command delay."""
    size, error = _size(delay, "delay")
    text = (
        f"The vehicle responds {plus_minus(size, error)} s after its commands: a command delay, or a clock of the "
        "commands that is behind the clock of the motion. The logs do not show which. "
    )
    if _joined(runs):
        text += "Log a copy of a command or of the heading in both files, or give a known offset in [join]."
    else:
        text += "Log commands and motion with stamps of one clock."
    return _clock_fault(runs, size, error, EVEN * delay.probability, text)


def _offset_fault(offset: Finding, runs: Sequence[Run], done: str) -> Fault:
    lead, error = _size(offset, "lead")
    text = f"The vehicle responds {plus_minus(lead, error)} s before its commands, which is impossible: "
    if _joined(runs):
        text += f"the clock of the commands is ahead of the clock of the motion. {done} Give a known offset in [join]."
    elif lead - _CERTAIN * error <= float(np.median([run.trial.sampling_interval for run in runs])):
        text += f"the stamps of the commands are late, as where a row holds the command that acted before it. {done}"
    else:
        text += (
            "the stamps of the commands are late by more than a row, or a torque that the catalogue lacks looks the "
            f"same, for instance of water with several memories. {done}"
        )
    return _clock_fault(runs, -lead, error, offset.probability, text)


def _clock_fault(runs: Sequence[Run], size: float, error: float, confidence: float, text: str) -> Fault:
    logs = _joined(runs) or tuple(dict.fromkeys(run.trial.parent or run.trial.name for run in runs))
    return Fault(
        fault=CLOCKS_APART.id, logs=logs, size=size, standard_error=error, unit="s", confidence=confidence, text=text
    )


def _warnings(runs: Sequence[Run], causes: Sequence[Finding]) -> Iterator[str]:
    """Delays that may be of clocks which were not compared, or of the sensor; log and time of each loss of thrust."""
    every = [effect for cause in causes for effect in (cause.effect, *cause.indistinguishable)]
    titles = {effect.id: effect.title for effect in every if is_delay(effect)}
    joined = any(remark.kind == "joined" for run in runs for remark in run.trial.remarks)
    if titles and joined:
        yield (
            f"The {' or '.join(titles.values())} may be a clock offset of the joined files. The logs do not "
            "distinguish the two. Give the known offset in [join] offset."
        )
    if delays := delays_of_the_sensor((run.trial for run in runs), causes):
        yield (
            f"The {' and the '.join(delays)} may act in the sensor: a {runs[0].trial.axis.position_words} that a "
            "navigation filter delays or smooths by the same time looks the same in these logs. Log a gyro's rate, or "
            "the motors' speed, to tell which."
        )
    trials = sorted((run.trial for run in runs), key=lambda trial: trial.campaign_time)

    def place(cause: Finding, instant: EffectParameter) -> str:
        seconds = 3600.0 * _size(cause, instant.name)[0]
        before = [trial for trial in trials if trial.campaign_time <= seconds][-1]
        after = seconds - before.campaign_time
        if after < before.duration:
            return f"{before.name}, {after:.1f} s after its start"
        return f"the end of {before.name}"

    for cause in causes:
        if not cause.effect.instants:
            continue
        until = f" to {place(cause, UNTIL)}" if UNTIL in cause.effect.parameters else ""
        thruster = f" of {thruster_of(cause.effect.form)}" if cause.effect.per_thruster else ""
        gain = plus_minus(*_size(cause, "gain"))
        yield f"From {place(cause, INSTANT)}{until}, the thrust{thruster} is {gain} times the thrust before."


def without_gyro_offset(
    prepared: PreparedRuns, diagnosis: Diagnosis, vehicle: Vehicle, report: ProgressCallback, budget: Budget
) -> Diagnosis:
    """The ``diagnosis``, in which no cause is established that an offset of the gyro explains as well."""
    imitated = [cause for cause in diagnosis.causes if cause.effect.id in _MEAN_TURN]
    causes = [cause for cause in imitated if cause in diagnosis.findings] or imitated[:1]
    if not causes or not prepared.rate_only or budget.skips("offset of the gyro"):
        return diagnosis
    report("Testing an offset of the gyro …")
    others = tuple(finding.effect for finding in diagnosis.findings if finding not in causes)
    axis = prepared.items[0].trial.axis
    try:
        best = fit_likelihood(prepared.items, vehicle, (*others, *(cause.effect for cause in causes))).log_likelihood
        offset, likelihood = _fitted_offset(prepared, vehicle, others)
    except DataError:
        # Without the causes the logs determine nothing: the offset does not replace them.
        return diagnosis
    if likelihood < best - THRESHOLDS.tie_margin:
        return diagnosis
    for cause in causes:
        diagnosis = doubted(diagnosis, cause)
    unit, factor = axis.display_unit
    titles = " and ".join(cause.effect.title for cause in causes)
    text = (
        f"Only a rate was measured. A sensor that is off by {factor * offset:.2g} {unit}/s explains these logs as well "
        f"as {titles}. Measure the {axis.position_words}, or the rate of the vehicle ashore, to tell which."
    )
    return replace(diagnosis, warnings=(text, *diagnosis.warnings))


def _fitted_offset(prepared: PreparedRuns, vehicle: Vehicle, effects: tuple[Effect, ...]) -> tuple[float, float]:
    """The likeliest offset of the gyro in rad/s, and its log-likelihood with these ``effects``."""
    from scipy.optimize import minimize_scalar

    trials = [run.trial for run in prepared.items]

    def loss(offset: float) -> float:
        corrected = []
        for trial in trials:
            rate = None if trial.rate is None else trial.rate - offset
            position = trial.position - offset * (trial.time - trial.time[0])
            corrected.append(replace(trial, rate=rate, position=position))
        runs = prepare(Campaign(trials=tuple(corrected), sources=()), vehicle, cutoff=prepared.cutoff)
        return -fit_likelihood(runs.items, vehicle, effects).log_likelihood

    size = float(np.sqrt(np.nanmean(np.concatenate([trial.rate for trial in trials if trial.rate is not None]) ** 2)))
    bounds = (-_LARGEST * size, _LARGEST * size)
    found = minimize_scalar(loss, bounds=bounds, method="bounded", options={"xatol": _FINEST * size})
    return float(found.x), -float(found.fun)
