"""Scores of one folder of dirty logs: what rovid said of the folder against the truth."""

from __future__ import annotations

import math
from typing import Any

PARAMETERS = ("inertia", "quadratic_drag", "linear_drag")
WITHIN = 4.0  # standard errors in which an estimate has to be
# The effect that finds each hidden effect.
EFFECTS = {"thruster_lag": "thruster_lag", "bias_torque": "bias_torque", "reverse_gain": "thrust_asymmetry"}


def score(record: dict[str, Any]) -> dict[str, Any]:
    """Scores of a folder.

    ``named``: check or diagnose names the fault, with the logs where the fault is not in all of them.
    ``false_faults``: ids of other faults. ``false_causes``: established effects that do not act. ``either``: those of
    them that are established as one of a class with the fault. ``worst``: largest
    error of a parameter in standard errors; None where the fit is refused or gives no number. ``crash``: commands that
    ended with a traceback or without an answer. ``no_go``: check says no go.
    """
    truth, said = record["truth"], record["said"]
    faults = [fault for command in ("check", "diagnose") for fault in said[command].get("faults") or []]
    errors = errors_of(record)
    hidden = EFFECTS.get(truth["hidden"] or "")
    findings = said["diagnose"].get("findings") or []
    either = [one["effect"] for one in findings if truth["fault"] in one["cannot_be_told_from"]]
    wrong = [one["effect"] for one in findings if one["effect"] != hidden]
    return {
        "named": any(fault["fault"] == truth["fault"] and right_logs(fault, truth) for fault in faults),
        "named_somewhere": any(fault["fault"] == truth["fault"] for fault in faults),
        "false_faults": sorted({fault["fault"] for fault in faults} - {truth["fault"]}),
        "false_causes": [name for name in wrong if name not in either],
        "either": [name for name in wrong if name in either],
        "worst": max(errors.values(), default=None),
        "wrong": sorted(name for name, error in errors.items() if error > WITHIN),
        "crash": [command for command, one in said.items() if crashed(one)],
        "no_go": said["check"].get("verdict") == "no_go",
        "grave": [advice["kind"] for advice in said["check"].get("advice") or [] if advice["weight"] == "grave"],
        "unreadable": len(said["check"].get("unreadable") or []),
        "seconds": {command: one["seconds"] for command, one in said.items()},
    }


def crashed(answer: dict[str, Any]) -> bool:
    """Whether a command ended without an answer: a traceback, a signal, or the time limit."""
    return answer["exit"] not in {0, 2} or "Traceback" in answer["failure"]


def errors_of(record: dict[str, Any]) -> dict[str, float]:
    """Errors of the fitted parameters, in standard errors; parameters without a number are absent.

    A parameter without a finite, positive standard error does not determine an error, and counts as refused.
    """
    fit = record["said"]["fit"]
    if fit["exit"] != 0:
        return {}
    errors = {}
    for name in PARAMETERS:
        estimate = (fit.get("parameters") or {}).get(name) or {}
        value, error = estimate.get("value"), estimate.get("standard_error")
        if value is not None and error is not None and math.isfinite(error) and error > 0.0:
            errors[name] = abs(value - record["truth"][name]) / error
    return errors


def right_logs(fault: dict[str, Any], truth: dict[str, Any]) -> bool:
    """Whether a fault that not all logs have is attributed to no log without it, and to one with it at least.

    Of one run in two logs either log may be named, next to the other.
    """
    concerned, runs = {_run(name) for name in truth["logs"]}, {_run(name) for name in truth["runs"]}
    if not concerned or concerned == runs:
        return True
    found = {_run(name) for name in fault["logs"]}
    if truth["fault"] == "foreign_log" and truth["note"].startswith("drags"):
        return bool(found) and (found <= concerned or found <= runs - concerned or found == runs)
    return bool(found) and found <= concerned


def _run(name: str) -> str:
    """Name of the run of a file."""
    return name.split(".", maxsplit=1)[0].removesuffix("_nav").removesuffix("_thr")
