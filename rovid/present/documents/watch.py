"""What happens on a trial day as JSON: one document a line."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from datetime import datetime
from pathlib import Path
from typing import Any

from rovid.design.experiment_design import commands_by_name
from rovid.estimate.estimate import Estimate
from rovid.present.documents.diagnosis import diagnosis_document
from rovid.present.documents.fits import Document, likelihood_document, parameter_document
from rovid.watch.folder_monitor import Problem
from rovid.watch.session import Event, LogsChanged, LogsDiagnosed, ModelFitted, NextRun, SessionEnded
from rovid.watch.stop_criteria import CriterionStatus, StopCriterion, relative_half_width
from rovid.watch.watched_log import WatchedLog

SCHEMA = "rovid-watch/1"


def watch_start_document(folder: Path, until: Sequence[StopCriterion]) -> Document:
    """That a folder is watched."""
    return _line("start", {"folder": str(folder), "until": [str(one) for one in until]})


def watch_documents(event: Event) -> list[Document]:
    """One of each log, else one of each event."""
    if isinstance(event, LogsChanged):
        return [_line("log", each) for each in _logs(event)]
    if isinstance(event, ModelFitted):
        return [_line("model", _model(event))]
    if isinstance(event, LogsDiagnosed):
        return [_line("suspects", _suspects(event))]
    if isinstance(event, NextRun):
        return [_line("next_run", _next_run(event))]
    if isinstance(event, Problem):
        return [_line("problem", {"where": event.where, "text": event.text, "over": event.resolved})]
    return [_line("stop", _stop(event))]


def _line(kind: str, content: Document) -> Document:
    now = datetime.now().astimezone().isoformat(timespec="seconds")
    return {"schema": SCHEMA, "event": kind, "time": now, **content}


def _logs(event: LogsChanged) -> list[Document]:
    change = event.change
    told = [(what, log) for what in ("removed", "replaced", "added") for log in getattr(change, what)]
    documents = [_log(what, log) for what, log in told]
    documents += [_log("renamed", after) | {"before": before.name} for before, after in change.renamed]
    if change.settings:
        documents.append({"action": "settings", "name": "rovid.toml"})
    return documents


def _log(what: str, log: WatchedLog) -> Document:
    remarks = [remark.text for trial in log.trials for remark in trial.remarks]
    return {
        "action": what,
        "name": log.name,
        "path": str(log.path),
        "samples": log.samples,
        "seconds": log.seconds,
        "cut": bool(log.cut),
        "remarks": remarks,
    }


def _model(event: ModelFitted) -> Document:
    fit = event.fit
    document: Document = {
        "logs": _names(event),
        "new": list(event.new),
        "missing": event.missing or None,
        "until": _standings(event.criteria),
    }
    if fit is None:
        return document | {"effects": [], "parameters": {}, "fit": None}
    return document | {
        "effects": [effect.key for effect in fit.model.effects],
        "parameters": parameters_with_previous(fit.estimate, event.before),
        "fit": likelihood_document(fit, event.study),
    }


def parameters_with_previous(estimate: Estimate, before: Estimate | None) -> dict[str, Document]:
    """Each parameter with what it was before the last logs, and how many times as narrow its interval is now."""
    now = parameter_document(estimate)
    then: Mapping[str, Any] = {} if before is None else parameter_document(before)
    for name, document in now.items():
        was = then.get(name)
        document["relative_interval"] = relative_half_width(estimate, name)
        document["before"] = was
        document["narrower"] = None if was is None else _width(was) / max(_width(document), 1e-300)
    return now


def _width(document: Document) -> float:
    low, high = document["interval_95"]
    return float(high - low)


def _names(event: ModelFitted | LogsDiagnosed) -> list[str]:
    campaign = event.study.campaign
    return [] if campaign is None else [trial.name for trial in campaign.trials]


def _suspects(event: LogsDiagnosed) -> Document:
    document, side = diagnosis_document(event.diagnosis, event.study), event.diagnosis.extended
    return {
        "logs": _names(event),
        "verdict": document["verdict"],
        "findings": document["findings"],
        "suspects": document["suspects"],
        "parameters": {} if side is None else parameters_with_previous(side.estimate, None),
        "next_experiment": document["next_experiment"],
        "until": _standings(event.criteria),
    }


def _next_run(event: NextRun) -> Document:
    plan = event.plan
    return {
        "run": event.words,
        "reason": event.reason,
        "seconds": None if plan is None else plan.best.run.seconds,
        "narrow": None if plan is None else plan.parameter or None,
        "between": [belief.name for belief in plan.models] if plan is not None and len(plan.models) > 1 else None,
        "gain": None if plan is None else plan.best.gain,
        "command_file": None if event.written is None else str(event.written),
        "commands": None if plan is None else commands_by_name(plan),
    }


def _stop(event: SessionEnded) -> Document:
    study, fit, diagnosis = event.study, event.fit, event.diagnosis
    return {
        "reason": event.reason,
        "logs": [log.name for log in event.logs],
        "until": _standings(event.criteria),
        "fit": None if fit is None or study is None else likelihood_document(fit, study),
        "diagnosis": None if diagnosis is None or study is None else diagnosis_document(diagnosis, study),
    }


def _standings(standings: Sequence[CriterionStatus]) -> list[Document]:
    return [
        {
            "condition": str(one.criterion),
            "percent": None if one.current is None else 100.0 * one.current,
            "met": one.met,
        }
        for one in standings
    ]
