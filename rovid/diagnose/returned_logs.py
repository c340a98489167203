"""Logs that were set aside as foreign by the plain model, and belong by the model with causes.

A cause that the plain model lacks may deviate most in one log: a moment of sideslip in the only log with sideslip, or a
dead zone in the only log with small commands. The causes that the other logs establish give the torque that acted in
the log. With that torque the log is compared with the others once more, by the test that set it aside. A log that
belongs takes part in a second diagnosis. It is kept if it belongs by the causes found then, too.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace

from rovid.core.budget import Budget, ProgressCallback
from rovid.diagnose.result import Diagnosis
from rovid.faults.base import named
from rovid.faults.foreign_log import belonging
from rovid.faults.quick_model import log_name
from rovid.model.simulation import acting_torque
from rovid.trial.fault import Fault
from rovid.trial.preprocessing import PreparedRuns, Run
from rovid.trial.vehicle import Vehicle

# Probability that a returned log is of another vehicle after all: that of residuals which the test calls usual.
_REMAINING = 0.05


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
    return complete, again, tuple(_taken_back(log, again) for log in logs)


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


def _taken_back(log: str, diagnosis: Diagnosis) -> Fault:
    causes = " and ".join(finding.effect.title for finding in diagnosis.findings)
    text = (
        f"{log} does not belong to the other logs by inertia and drag alone. The model with {causes} predicts it as "
        "well as the other logs. It was put back: the diagnosis includes it."
    )
    return Fault(fault="foreign_log", logs=(log,), text=text, confidence=_REMAINING)
