"""The clock as a rival of the causes: commands with stamps later than their action.

The clock of a joined file may be late, and a logger may write a command at the end of the interval in which it acted.
`rovid.diagnose.objectives.pose` adds the clock offset to the candidates. Where the offset is established, the commands
are moved by it and the diagnosis is repeated. Where it is possible, it is a fault that may act, and no cause.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace

from rovid.core.budget import Budget, ProgressCallback
from rovid.core.formatting import plus_minus
from rovid.diagnose.candidate_fits import Challenger
from rovid.diagnose.coupled_causes import coupled_sentence
from rovid.diagnose.foreign_rival import diagnose_majority
from rovid.diagnose.objectives import preload
from rovid.diagnose.result import Diagnosis, Finding
from rovid.diagnose.thresholds import THRESHOLDS
from rovid.effects.clock_offset import CLOCKS_APART
from rovid.faults.base import named
from rovid.signals.preprocessing import PreparedRuns, Run, prepare, shift_commands
from rovid.signals.rates import highest_cutoff
from rovid.trial.fault import Fault
from rovid.trial.trial import Campaign
from rovid.trial.vehicle import Vehicle

_LEAD = f"{CLOCKS_APART.id}.lead"
# Share of the probability of a delay that is its own: the logs do not prefer a delay to a clock offset. Convention.
_EVEN = 0.5
# s; a longer delay of the drive is unlikely: bus, radio and controller take a tenth of it. Decision.
_LONG_DELAY = 0.5
# Effects that a clock offset between commands and motion resembles.
_DELAYS = ("command_delay", "thruster_lag")


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
        *([coupled] if coupled else []),
    )
    return replace(diagnosis, warnings=warnings, budget=budget.use)


def _diagnose(prepared: PreparedRuns, vehicle: Vehicle, report: ProgressCallback, budget: Budget) -> Diagnosis:
    diagnosis = diagnose_majority(prepared, vehicle, report, budget)
    offset = _clock_offset(diagnosis.findings)
    if offset is None:
        return _without_offset(diagnosis, prepared.items)
    lead = offset.estimate.value(_LEAD)
    long = [run.trial for run in prepared.items if run.trial.duration > 2.0 * lead]
    if not long:
        return _without_offset(diagnosis, prepared.items)
    short = [run.trial.name for run in prepared.items if run.trial.duration <= 2.0 * lead]
    left_out = f" {named(short)} {'is' if len(short) == 1 else 'are'} too short for that: left out." if short else ""
    fault = _fault(offset, prepared.items, f"The commands were moved by it.{left_out}")
    trials = tuple(shift_commands(trial, -lead) for trial in long)
    corrected = prepare(
        Campaign(trials=trials, sources=()), vehicle, cutoff=min(prepared.cutoff, highest_cutoff(trials))
    )
    report("Repeating the diagnosis with the clocks corrected …")
    diagnosis = _without_offset(diagnose_majority(corrected, vehicle, report, budget), corrected.items)
    return replace(diagnosis, faults=(fault, *diagnosis.faults))


def _clock_offset(findings: Sequence[Finding]) -> Finding | None:
    return next((finding for finding in findings if finding.effect is CLOCKS_APART), None)


def _without_offset(diagnosis: Diagnosis, runs: Sequence[Run]) -> Diagnosis:
    """``diagnosis`` with clock offsets as faults; a delay that may be one is no more than a suspect."""
    every = [finding for finding in (*diagnosis.findings, *diagnosis.suspects) if finding.effect is not CLOCKS_APART]
    offset, faults = _clock_offset((*diagnosis.findings, *diagnosis.suspects)), list[Fault]()
    if offset is not None:
        faults.append(_fault(offset, runs, "It may act."))
    findings = [finding for finding in diagnosis.findings if finding in every]
    suspects = [finding for finding in diagnosis.suspects if finding in every]
    for delay in [
        finding for finding in findings if finding.effect.id == "command_delay" and _may_be_offset(finding, runs)
    ]:
        findings.remove(delay)
        rivals = (*delay.indistinguishable, CLOCKS_APART)
        suspects.insert(0, replace(delay, indistinguishable=rivals, probability=_EVEN * delay.probability))
        faults.append(_delay_fault(delay, runs))
        # The offset explains the logs exactly as the delay does, at the same price.
        challenger = Challenger((*(finding.effect for finding in findings), CLOCKS_APART), 0.0, 0.0)
        diagnosis = replace(diagnosis, challengers=(challenger, *diagnosis.challengers)[: THRESHOLDS.challengers_shown])
    verdict = diagnosis.verdict
    if verdict in {"found", "suspected"} and not findings:
        verdict = "suspected" if suspects else "nothing_found"
    every_fault = (*diagnosis.faults, *faults)
    return replace(diagnosis, verdict=verdict, findings=tuple(findings), suspects=tuple(suspects), faults=every_fault)


def _may_be_offset(delay: Finding, runs: Sequence[Run]) -> bool:
    """Whether the clocks of commands and motion may differ by the delay: in joined logs, or in all logs by topics."""
    size = delay.estimate.value(f"{delay.effect.key}.delay")
    return bool(_joined(runs)) or (all(run.trial.separate_clocks for run in runs) and size > _LONG_DELAY)


def _joined(runs: Sequence[Run]) -> tuple[str, ...]:
    """Names of the logs that were joined from several files."""
    return tuple(dict.fromkeys(run.trial.parent or run.trial.name for run in runs if run.trial.companion_files))


def _delay_fault(delay: Finding, runs: Sequence[Run]) -> Fault:
    """The clock offset that looks like a command delay."""
    name = f"{delay.effect.key}.delay"
    size, error = delay.estimate.value(name), delay.estimate.standard_error(name)
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
        confidence=_EVEN * delay.probability,
        text=text,
    )


def _fault(offset: Finding, runs: Sequence[Run], done: str) -> Fault:
    lead, error = offset.estimate.value(_LEAD), offset.estimate.standard_error(_LEAD)
    joined = _joined(runs)
    text = f"The vehicle responds {plus_minus(lead, error)} s before its commands, which is impossible: "
    if joined:
        text += f"the clock of the commands is ahead of the clock of the motion. {done} Give a known offset in [join]."
    else:
        text += f"the stamps of the commands are late, as where a row holds the command that acted before it. {done}"
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
    titles = {effect.id: effect.title for cause in causes for effect in (cause.effect, *cause.indistinguishable)}
    delays = [title for key, title in titles.items() if key in _DELAYS]
    joined = any(remark.kind == "joined" for run in runs for remark in run.trial.remarks)
    if delays and joined:
        yield (
            f"The {' or '.join(delays)} may be a clock offset of the joined files. The logs do not distinguish the "
            "two. Give the known offset in [join] offset."
        )
