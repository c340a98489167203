"""A foreign log as a rival of the causes whose size differs between trials.

A log of another vehicle or payload passes for a cause with another size in each trial, or in one trial. Each size is
compared with those of the other trials. Where one or two logs, and fewer than half, have nearly all of the differences,
the diagnosis is repeated without these logs. If the cause is not established there, it is not established at all: the
logs are set aside, and the cause is a suspect next to them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.core.budget import Budget, ProgressCallback
from rovid.diagnose.algorithm import diagnose
from rovid.diagnose.result import Diagnosis, Finding
from rovid.effects.per_trial import trials_in_form
from rovid.faults.base import named
from rovid.signals.preprocessing import PreparedRuns
from rovid.trial.fault import Fault
from rovid.trial.vehicle import Vehicle

# Logs at least, of which a minority can be foreign; logs at most that are taken for foreign.
_MIN_LOGS, _MOST_FOREIGN = 4, 2
# Share of the differences (chi-square) that the other logs keep, below which the evidence comes from a few logs.
_LEFT = 0.25
# Share of the probability that is the own one of the cause: the logs do not distinguish it from a foreign log.
_EVEN = 0.5


def diagnose_majority(
    prepared: PreparedRuns, vehicle: Vehicle, report: ProgressCallback, budget: Budget | None = None
) -> Diagnosis:
    """The diagnosis, in which no cause is established whose only evidence is that a few logs differ from the others."""
    diagnosis = diagnose(prepared, vehicle, report, budget)
    names = tuple(dict.fromkeys(run.trial.parent or run.trial.name for run in prepared.items))
    doubted = [(finding, logs) for finding in diagnosis.findings if (logs := few_logs(finding, len(names)))]
    if not doubted:
        return diagnosis
    remaining, remedy = diagnosis, "none"
    few = dict.fromkeys(name for _, logs in doubted for name in logs)
    if len(names) >= _MIN_LOGS and 2 * len(few) < len(names) and not (budget and budget.skips("foreign_log")):
        report(f"Repeating the diagnosis without {' and '.join(few)} …")
        kept = tuple(run for run in prepared.items if not {run.trial.parent, run.trial.name} & few.keys())
        others = diagnose(replace(prepared, items=kept), vehicle, report, budget)
        shown = {finding.effect.id for finding in others.findings}
        doubted = [(finding, logs) for finding, logs in doubted if finding.effect.id not in shown]
        if doubted and others.verdict != "too_little_data":
            remaining, remedy = others, "set_aside"
    for finding, logs in doubted:
        findings = tuple(one for one in remaining.findings if one is not finding)
        remaining = _with_suspect(replace(remaining, findings=findings), finding, _fault(finding, logs, remedy))
    return remaining


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
    places = [estimate.names.index(f"{finding.effect.key}.{one.name}") for one in finding.effect.parameters[:count]]
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


def _with_suspect(diagnosis: Diagnosis, finding: Finding, fault: Fault) -> Diagnosis:
    """``diagnosis`` with the ``finding`` as its first suspect, and the ``fault`` as the rival."""
    suspect = replace(finding, probability=_EVEN * finding.probability)
    verdict = "found" if diagnosis.findings else "suspected"
    suspects = (suspect, *(one for one in diagnosis.suspects if one.effect.id != finding.effect.id))
    return replace(diagnosis, verdict=verdict, suspects=suspects, faults=(*diagnosis.faults, fault))


def _fault(finding: Finding, logs: tuple[str, ...], remedy: str) -> Fault:
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
        confidence=_EVEN * finding.probability,
        remedy="set_aside" if remedy == "set_aside" else "none",
    )
