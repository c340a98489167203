"""Rivals of the causes of a diagnosis: the clock, a foreign log, an offset of the gyro, and the coupled model.

The clock of a joined file may be late, and a logger may write a command at the end of the interval in which it acted.
`rovid.diagnose.objectives.pose` adds the clock offset to the candidates. Where the offset is established, the commands
are moved by it and the diagnosis is repeated. Where it is possible, it is a fault that may act, and no cause.

A log of another vehicle or payload passes for a cause with another size in each trial, or in one trial. Each size is
compared with those of the other trials. Where one or two logs, and fewer than half, have nearly all of the differences,
the diagnosis is repeated without these logs. If the cause is not established there, it is not established at all: the
logs are set aside, and the cause is a suspect next to them. Of the logs of two payloads those of one are diagnosed.

Some causes of a diagnosis of yaw are motion along surge and sway, which the coupled model explains.
"""

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.core.budget import Budget, ProgressCallback
from rovid.core.formatting import plus_minus
from rovid.diagnose.algorithm import diagnose
from rovid.diagnose.candidate_fits import Challenger
from rovid.diagnose.gyro_offset import without_gyro_offset
from rovid.diagnose.objectives import preload
from rovid.diagnose.result import EVEN, Diagnosis, Finding, delays_of_the_sensor, doubted, is_delay
from rovid.diagnose.returned_logs import with_returned_logs
from rovid.diagnose.thresholds import THRESHOLDS
from rovid.effects.actuator_inputs import SPEEDS
from rovid.effects.base import INSTANT, UNTIL, EffectParameter
from rovid.effects.clock_offset import CLOCKS_APART
from rovid.effects.further_terms import trials_in_form
from rovid.effects.thruster_imbalance import thruster_of
from rovid.faults.base import named
from rovid.faults.foreign_log import minority_payload
from rovid.trial.axis import YAW
from rovid.trial.fault import Fault
from rovid.trial.preprocessing import PreparedRuns, Run, prepare, shift_commands
from rovid.trial.rates import highest_cutoff
from rovid.trial.trial import Campaign, Trial
from rovid.trial.vehicle import Vehicle

# Logs at least, of which a minority can be foreign; logs at most that are taken for foreign.
_MIN_LOGS, _MOST_FOREIGN = 4, 2
# Share of the differences (chi-square) that the other logs keep, below which the evidence comes from a few logs.
_LEFT = 0.25
# Effects of yaw that stand for motion along surge and sway, which the coupled model has as states.
_OF_MOTION = ("sideslip_moment", "speed_dependent_damping")
# Effects that slow motion along sway may imitate; they count next to one of the former alone.
_IMITATED = ("wave_torque", "heading_dependent_torque")
_POSITIONS = {"north", "east"}
# s; a longer delay of the drive is unlikely: bus, radio and controller take a tenth of it. Decision.
_LONG_DELAY = 0.5
# Standard errors by which a delay exceeds the lateness of the stamps, if it is the drive's own. Convention.
_CERTAIN = 2.0
_COMMAND_DELAY = "command_delay"


def diagnose_majority(
    prepared: PreparedRuns, vehicle: Vehicle, report: ProgressCallback, budget: Budget | None = None
) -> Diagnosis:
    """The diagnosis, in which no cause is established whose only evidence is that a few logs differ from the others."""
    diagnosis = diagnose(prepared, vehicle, report, budget)
    names = tuple(dict.fromkeys(run.trial.parent or run.trial.name for run in prepared.items))
    payload = minority_payload(prepared.items, vehicle) if diagnosis.findings else ()
    odd = [(finding, logs) for finding in diagnosis.findings if (logs := payload or few_logs(finding, len(names)))]
    if not odd:
        return diagnosis
    remaining, remedy = diagnosis, "none"
    few = dict.fromkeys(name for _, logs in odd for name in logs)
    is_minority = bool(payload) or (len(names) >= _MIN_LOGS and 2 * len(few) < len(names))
    if is_minority and not (budget and budget.skips("foreign_log")):
        report(f"Repeating the diagnosis without {' and '.join(few)} …")
        kept = tuple(run for run in prepared.items if not {run.trial.parent, run.trial.name} & few.keys())
        others = diagnose(replace(prepared, items=kept), vehicle, report, budget)
        shown = {finding.effect.id for finding in others.findings}
        odd = [(finding, logs) for finding, logs in odd if finding.effect.id not in shown]
        if (odd or payload) and others.verdict != "too_little_data":
            remaining, remedy = others, "set_aside"
    if not odd and remaining is diagnosis:
        return diagnosis
    for finding, _ in odd:
        remaining = doubted(remaining, finding)
    # The faults of the logs contain two payloads already.
    faults = () if payload else tuple(_foreign_fault(finding, logs, remedy) for finding, logs in odd)
    warnings = remaining.warnings
    if payload and remedy == "set_aside":
        warnings = (f"The diagnosis is of one payload alone: it leaves out {named(payload)}.", *warnings)
    return replace(remaining, faults=(*remaining.faults, *faults), warnings=warnings)


def few_logs(finding: Finding, count: int) -> tuple[str, ...]:
    """The one or two of ``count`` logs that alone show a size of their own; empty if there are none, or more logs."""
    names = trials_in_form(finding.effect.form)
    if len(names) < 2 or count < _MIN_LOGS:
        return names
    sizes, covariance = _sizes(finding, len(names))
    every = _differences(sizes, covariance, range(len(names)))
    for few in range(1, _MOST_FOREIGN + 1):
        if 2 * few >= len(names):
            break
        left = {
            out: _differences(sizes, covariance, [at for at in range(len(names)) if at not in out])
            for out in combinations(range(len(names)), few)
        }
        out = min(left, key=lambda each: left[each])
        if left[out] < _LEFT * every:
            return tuple(names[at] for at in out)
    return ()


def _sizes(finding: Finding, count: int) -> tuple[FloatArray, FloatArray]:
    """(count,) sizes of the trials, and their covariance. The last size may follow from the mean of all, which is 1."""
    estimate = finding.estimate
    places = list(map(estimate.names.index, finding.effect.parameter_names[:count]))
    values, covariance = estimate.values[places], estimate.covariance[np.ix_(places, places)]
    if len(places) == count:
        return values, covariance
    added = np.vstack((np.eye(len(places)), -np.ones(len(places))))
    return np.append(values, count - values.sum()), added @ covariance @ added.T


def _differences(sizes: FloatArray, covariance: FloatArray, rows: Sequence[int]) -> float:
    """Chi-square of the differences between the sizes of these ``rows``."""
    contrast = np.eye(len(rows))[1:] - np.eye(len(rows))[0]
    among = contrast @ covariance[np.ix_(rows, rows)] @ contrast.T
    differences = contrast @ sizes[list(rows)]
    return float(differences @ np.linalg.pinv(among, rcond=1e-12, hermitian=True) @ differences)


def _foreign_fault(finding: Finding, logs: tuple[str, ...], remedy: str) -> Fault:
    belong = "does not belong" if len(logs) == 1 else "do not belong"
    done = "It was set aside." if len(logs) == 1 else "They were set aside."
    text = (
        f"{named(logs)} {belong} to the other logs, or {finding.effect.title} acts there: the other logs alone do not "
        f"show it. {done if remedy == 'set_aside' else 'Repeat these runs, and compare.'}"
    )
    return Fault(
        fault="foreign_log",
        logs=logs,
        text=text,
        confidence=EVEN * finding.probability,
        remedy="set_aside" if remedy == "set_aside" else "none",
    )


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
    coupled = coupled_sentence(diagnosis, [run.trial for run in prepared.items])
    warnings = (
        *diagnosis.warnings,
        *_clock_warnings(prepared.items, diagnosis.causes),
        *_sensor_warnings(prepared.items, diagnosis.causes),
        *_instants(prepared.items, diagnosis.causes),
        *([coupled] if coupled else []),
    )
    return replace(diagnosis, warnings=warnings, budget=budget.use)


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
    offset = _clock_offset(diagnosis.findings)
    if prepared.clocks_agree:
        return diagnosis
    if offset is None:
        return _without_offset(diagnosis, prepared.items)
    lead, _ = _size(offset, "lead")
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
    return _without_offset(majority(corrected), prepared.items, offset, f"The commands were moved by it.{left_out}")


def _clock_offset(findings: Sequence[Finding]) -> Finding | None:
    return next((finding for finding in findings if finding.effect is CLOCKS_APART), None)


def _without_offset(
    diagnosis: Diagnosis, runs: Sequence[Run], moved: Finding | None = None, done: str = "It may act."
) -> Diagnosis:
    """``diagnosis`` with clock offsets as faults; a delay that may be one is no more than a suspect.

    ``moved`` is an offset by which the commands were moved before the diagnosis.
    """
    every = [finding for finding in (*diagnosis.findings, *diagnosis.suspects) if finding.effect is not CLOCKS_APART]
    offset, faults = moved or _clock_offset((*diagnosis.findings, *diagnosis.suspects)), list[Fault]()
    if offset is not None:
        scatter = [finding for finding in every if _is_scatter(finding, offset)]
        every = [finding for finding in every if finding not in scatter]
        if scatter:
            size = plus_minus(*_size(scatter[0], "delay"))
            done += f" Their lateness scatters by {size} s, as where the logger reads the commands only for its rows."
        faults.append(_offset_fault(offset, runs, done))
    findings = [finding for finding in diagnosis.findings if finding in every]
    suspects = [finding for finding in diagnosis.suspects if finding in every]
    for delay in [
        finding for finding in findings if is_delay(finding.effect, (_COMMAND_DELAY,)) and _may_be_offset(finding, runs)
    ]:
        findings.remove(delay)
        rivals = (*delay.indistinguishable, CLOCKS_APART)
        suspects.insert(0, replace(delay, indistinguishable=rivals, probability=EVEN * delay.probability))
        faults.append(_delay_fault(delay, runs))
        # The offset explains the logs exactly as the delay does, at the same price.
        challenger = Challenger((*(finding.effect for finding in findings), CLOCKS_APART), 0.0, 0.0)
        diagnosis = replace(diagnosis, challengers=(challenger, *diagnosis.challengers)[: THRESHOLDS.challengers_shown])
    verdict = diagnosis.verdict
    if verdict in {"found", "suspected"} and not findings:
        # An offset that may act, and was not corrected, leaves the error of the model open.
        is_open = any(one.effect is CLOCKS_APART for one in (*diagnosis.findings, *diagnosis.suspects))
        verdict = "suspected" if suspects else "unexplained" if is_open else "nothing_found"
    every_fault = (*diagnosis.faults, *faults)
    return replace(diagnosis, verdict=verdict, findings=tuple(findings), suspects=tuple(suspects), faults=every_fault)


def _may_be_offset(delay: Finding, runs: Sequence[Run]) -> bool:
    """Whether the clocks of commands and motion may differ by the delay: in joined logs, or in all logs by topics."""
    size, _ = _size(delay, "delay")
    return bool(_joined(runs)) or (all(run.trial.separate_clocks for run in runs) and size > _LONG_DELAY)


def _is_scatter(finding: Finding, offset: Finding) -> bool:
    """Whether a command delay leaves the commands ahead of their stamps: stamps that are late by chance, no delay."""
    if not is_delay(finding.effect, (_COMMAND_DELAY,)):
        return False
    (delay, error), (lead, lead_error) = _size(finding, "delay"), _size(offset, "lead")
    return delay - lead < _CERTAIN * math.hypot(error, lead_error)


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
    joined = _joined(runs)
    text += (
        "Log a copy of a command or of the heading in both files, or give a known offset in [join]."
        if joined
        else "Log commands and motion with stamps of one clock."
    )
    return Fault(
        fault=CLOCKS_APART.id,
        logs=joined or tuple(dict.fromkeys(run.trial.parent or run.trial.name for run in runs)),
        size=size,
        standard_error=error,
        unit="s",
        confidence=EVEN * delay.probability,
        text=text,
    )


def _offset_fault(offset: Finding, runs: Sequence[Run], done: str) -> Fault:
    lead, error = _size(offset, "lead")
    joined = _joined(runs)
    text = f"The vehicle responds {plus_minus(lead, error)} s before its commands, which is impossible: "
    if joined:
        text += f"the clock of the commands is ahead of the clock of the motion. {done} Give a known offset in [join]."
    elif lead - _CERTAIN * error <= float(np.median([run.trial.sampling_interval for run in runs])):
        text += f"the stamps of the commands are late, as where a row holds the command that acted before it. {done}"
    else:
        text += (
            "the stamps of the commands are late by more than a row, or a torque that the catalogue lacks looks the "
            f"same, for instance of water with several memories. {done}"
        )
    return Fault(
        fault=CLOCKS_APART.id,
        logs=joined or tuple(dict.fromkeys(run.trial.parent or run.trial.name for run in runs)),
        size=-lead,
        standard_error=error,
        unit="s",
        confidence=offset.probability,
        text=text,
    )


def _clock_warnings(runs: Sequence[Run], causes: Sequence[Finding]) -> Iterator[str]:
    """Warning about delays if commands and motion come from clocks that were not compared."""
    every = [effect for cause in causes for effect in (cause.effect, *cause.indistinguishable)]
    titles = {effect.id: effect.title for effect in every if is_delay(effect)}
    delays = titles.values()
    joined = any(remark.kind == "joined" for run in runs for remark in run.trial.remarks)
    if delays and joined:
        yield (
            f"The {' or '.join(delays)} may be a clock offset of the joined files. The logs do not distinguish the "
            "two. Give the known offset in [join] offset."
        )
    elif _COMMAND_DELAY in titles and all(run.trial.separate_clocks for run in runs):
        yield (
            f"The {titles[_COMMAND_DELAY]} may be an offset between the stamps of commands and motion, which are "
            "separate in these logs. The logs do not distinguish the two."
        )


def _sensor_warnings(runs: Sequence[Run], causes: Sequence[Finding]) -> Iterator[str]:
    """Warning about delays of which the sensor may be the cause."""
    if delays := delays_of_the_sensor((run.trial for run in runs), causes):
        yield (
            f"The {' and the '.join(delays)} may act in the sensor: a {runs[0].trial.axis.position_words} that a "
            "navigation filter delays or smooths by the same time looks the same in these logs. Log a gyro's rate, or "
            "the motors' speed, to tell which."
        )


def _instants(runs: Sequence[Run], causes: Sequence[Finding]) -> Iterator[str]:
    """Log and time of each loss of thrust from an instant on, and of its end."""
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
