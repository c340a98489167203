"""Logs of another vehicle or payload, and logs that were taken for such.

A log of another vehicle or payload passes for a cause with another size in each trial, in one trial, or from an instant
on. A cause that begins or ends at an instant may act in one or two logs alone. Each size is compared with those of the
other trials. Where one or two logs, and fewer than half, have nearly all of the differences, the diagnosis is repeated
without these logs. If the cause is not established there, it is not established at all: the logs are set aside, and the
cause is a suspect next to them. Of the logs of two payloads those of one are diagnosed. Where two payloads are only
likely, a cause that the logs of one do not show is not established.

A cause that the plain model lacks may deviate most in one log: a moment of sideslip in the only log with sideslip, or a
dead zone in the only log with small commands. The causes that the other logs establish give the torque that acted in
the log. With that torque the log is compared with the others once more, by the test that set it aside. A log that
belongs takes part in a second diagnosis. It is kept if it belongs by the causes found then, too.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.core.budget import Budget, ProgressCallback
from rovid.diagnose.algorithm import diagnose
from rovid.diagnose.result import EVEN, Diagnosis, Finding, doubted
from rovid.diagnose.thresholds import THRESHOLDS
from rovid.effects.base import HOUR
from rovid.effects.further_terms import trials_in_form
from rovid.faults.base import named
from rovid.faults.foreign_log import LIKELY, belonging, minority_payload
from rovid.faults.quick_model import log_name, log_parts
from rovid.model.simulation import acting_torque
from rovid.trial.fault import Fault, Remedy
from rovid.trial.preprocessing import PreparedRuns, Run
from rovid.trial.vehicle import Vehicle

# Logs at least, of which a minority can be foreign; logs at most that are taken for foreign.
_MIN_LOGS, _MOST_FOREIGN = 4, 2
# Share of the differences (chi-square) that the other logs keep, below which the evidence comes from a few logs.
_LEFT = 0.25
# Probability that a returned log is of another vehicle after all: that of residuals which the test calls usual.
_REMAINING = 0.05


def diagnose_majority(
    prepared: PreparedRuns, vehicle: Vehicle, report: ProgressCallback, budget: Budget | None = None
) -> Diagnosis:
    """The diagnosis, in which no cause is established whose only evidence is that a few logs differ from the others."""
    diagnosis = diagnose(prepared, vehicle, report, budget)
    payload = minority_payload(prepared.items, vehicle) if diagnosis.findings or diagnosis.suspects else ()
    kind = payload or (minority_payload(prepared.items, vehicle, LIKELY) if diagnosis.findings else ())
    odd = [(finding, logs) for finding in diagnosis.findings if (logs := kind or few_logs(finding, prepared.items))]
    few = dict.fromkeys([*payload, *(name for _, logs in odd for name in logs)])
    count = len(log_parts(prepared.items))
    is_minority = bool(kind) or (count >= _MIN_LOGS and 2 * len(few) < count)
    # The faults of the logs contain two payloads already.
    told = not payload
    if not (few and is_minority) or (budget and budget.skips("foreign_log")):
        return _doubting(diagnosis, odd, "none", told=told)
    report(f"Repeating the diagnosis without {' and '.join(few)} …")
    kept = tuple(run for run in prepared.items if not {run.trial.parent, run.trial.name} & few.keys())
    others = diagnose(replace(prepared, items=kept), vehicle, report, budget)
    shown = {finding.effect.id for finding in others.findings}
    odd = [(finding, logs) for finding, logs in odd if finding.effect.id not in shown]
    if not (odd or payload) or others.verdict == "too_little_data":
        return _doubting(diagnosis, odd, "none", told=told)
    again = [(finding, logs) for finding in others.findings if (logs := few_logs(finding, kept))]
    others = _doubting(_doubting(others, odd, "set_aside", told=told), again, "none")
    text = f"The diagnosis is of one payload alone: it leaves out {named(payload)}."
    return replace(others, warnings=(text, *others.warnings)) if payload else others


def _doubting(
    diagnosis: Diagnosis, odd: Sequence[tuple[Finding, tuple[str, ...]]], remedy: Remedy, *, told: bool = True
) -> Diagnosis:
    """The ``diagnosis`` whose ``odd`` findings, of these logs alone, are suspects; the logs are faults if ``told``."""
    for finding, logs in odd:
        diagnosis = doubted(diagnosis, finding)
        if not told:
            continue
        belong, done = ("does not belong", "It was") if len(logs) == 1 else ("do not belong", "They were")
        text = (
            f"{named(logs)} {belong} to the other logs, or {finding.effect.title} acts there: the other logs alone do "
            f"not show it. {f'{done} set aside.' if remedy == 'set_aside' else 'Repeat these runs, and compare.'}"
        )
        confidence = EVEN * finding.probability
        fault = Fault(fault="foreign_log", logs=logs, text=text, confidence=confidence, remedy=remedy)
        diagnosis = replace(diagnosis, faults=(*diagnosis.faults, fault))
    return diagnosis


def few_logs(finding: Finding, runs: Sequence[Run]) -> tuple[str, ...]:
    """The one or two logs of ``runs`` that alone show a cause, or its size; empty if there are none, or more logs."""
    count = len(log_parts(runs))
    if finding.effect.instants:
        acts = _logs_between(finding, runs)
        return acts if count >= _MIN_LOGS and len(acts) <= _MOST_FOREIGN and 2 * len(acts) < count else ()
    names = trials_in_form(finding.effect.form)
    if len(names) < 2 or count < _MIN_LOGS:
        return names
    own = finding.estimate.only(finding.effect.parameter_names[: len(names)])
    sizes, covariance, rows = own.values, own.covariance, range(len(names))
    if len(sizes) < len(names):
        # The last size follows from the mean of all, which is 1.
        added = np.vstack((np.eye(len(sizes)), -np.ones(len(sizes))))
        sizes, covariance = np.append(sizes, len(names) - sizes.sum()), added @ covariance @ added.T
    every = _differences(sizes, covariance, rows)
    for few in range(1, _MOST_FOREIGN + 1):
        if 2 * few >= len(names):
            break
        outs = list(combinations(rows, few))
        left = [_differences(sizes, covariance, [at for at in rows if at not in out]) for out in outs]
        if min(left) < _LEFT * every:
            return tuple(names[at] for at in outs[left.index(min(left))])
    return ()


def _logs_between(finding: Finding, runs: Sequence[Run]) -> tuple[str, ...]:
    """The logs in which a cause acts that begins, or ends, at an instant."""
    effect = finding.effect
    instants = [finding.estimate.value(effect.parameter_names[at]) for at in effect.instants]
    begin, end = (HOUR * value for value in (*instants, math.inf)[:2])
    share = {}
    for name, parts in log_parts(runs).items():
        spans = [(one.trial.campaign_time, one.trial.campaign_time + one.trial.duration) for one in parts]
        acting = sum(max(min(last, end) - max(first, begin), 0.0) for first, last in spans)
        share[name] = acting / sum(last - first for first, last in spans)
    return tuple(name for name, each in share.items() if each > THRESHOLDS.acting_share)


def _differences(sizes: FloatArray, covariance: FloatArray, rows: Sequence[int]) -> float:
    """Chi-square of the differences between the sizes of these ``rows``."""
    contrast = np.eye(len(rows))[1:] - np.eye(len(rows))[0]
    among = contrast @ covariance[np.ix_(rows, rows)] @ contrast.T
    differences = contrast @ sizes[list(rows)]
    return float(differences @ np.linalg.pinv(among, rcond=1e-12, hermitian=True) @ differences)


def with_returned_logs(
    prepared: PreparedRuns,
    vehicle: Vehicle,
    diagnose: Callable[[PreparedRuns], Diagnosis],
    report: ProgressCallback,
    budget: Budget,
) -> tuple[PreparedRuns, Diagnosis, tuple[Fault, ...]]:
    """The runs with the logs that belong by their causes, the diagnosis of these runs, and the faults taken back."""
    diagnosis = diagnose(prepared)
    logs = returning_logs(diagnosis, prepared.items, prepared.set_aside, vehicle)
    if not logs or budget.skips("foreign_log"):
        return prepared, diagnosis, ()
    report(f"Repeating the diagnosis with {named(logs)} …")
    returned = tuple(run for run in prepared.set_aside if log_name(run) in logs)
    complete = replace(prepared, items=(*prepared.items, *returned), set_aside=())
    again = diagnose(complete)
    others = any(fault.fault == "foreign_log" for fault in again.faults)
    if others or set(returning_logs(again, prepared.items, returned, vehicle)) != set(logs):
        return prepared, diagnosis, ()
    causes = " and ".join(finding.effect.title for finding in again.findings)
    text = (
        f" does not belong to the other logs by inertia and drag alone. The model with {causes} predicts it as well "
        "as the other logs. It was put back: the diagnosis includes it."
    )
    back = [Fault(fault="foreign_log", logs=(log,), text=log + text, confidence=_REMAINING) for log in logs]
    return complete, again, tuple(back)


def returning_logs(
    diagnosis: Diagnosis, runs: Sequence[Run], aside: Sequence[Run], vehicle: Vehicle
) -> tuple[str, ...]:
    """Names of the logs set ``aside`` that belong to the other ``runs`` by the causes of the ``diagnosis``."""
    if not aside or not diagnosis.findings or diagnosis.extended is None:
        return ()
    model, found = diagnosis.extended.model, []
    for log in dict.fromkeys(map(log_name, aside)):
        plain = [*runs, *(run for run in aside if log_name(run) == log)]
        acting = [replace(run, filtered_torque=acting_torque(run, model, vehicle)) for run in plain]
        if belonging(log, plain, acting, vehicle):
            found.append(log)
    return tuple(found)
