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
from rovid.watch.folder_monitor import Log, Trouble
from rovid.watch.session import Event, Model, NextRun, Stop, Suspects, Taken
from rovid.watch.stop_criteria import Condition, Standing, relative_reach

SCHEMA = "rovid-watch/1"


def began_document(folder: Path, until: Sequence[Condition]) -> Document:
    """That a folder is watched."""
    return _line("start", {"folder": str(folder), "until": [str(one) for one in until]})


def event_documents(event: Event) -> list[Document]:
    """One of each log, else one of each event."""
    if isinstance(event, Taken):
        return [_line("log", each) for each in _logs(event)]
    if isinstance(event, Model):
        return [_line("model", _model(event))]
    if isinstance(event, Suspects):
        return [_line("suspects", _suspects(event))]
    if isinstance(event, NextRun):
        return [_line("next_run", _next_run(event))]
    if isinstance(event, Trouble):
        return [_line("problem", {"where": event.where, "text": event.text, "over": event.over})]
    return [_line("stop", _stop(event))]


def _line(kind: str, content: Document) -> Document:
    now = datetime.now().astimezone().isoformat(timespec="seconds")
    return {"schema": SCHEMA, "event": kind, "time": now, **content}


def _logs(event: Taken) -> list[Document]:
    change = event.change
    told = [(what, log) for what in ("removed", "replaced", "added") for log in getattr(change, what)]
    documents = [_log(what, log) for what, log in told]
    documents += [_log("renamed", after) | {"before": before.name} for before, after in change.renamed]
    if change.settings:
        documents.append({"action": "settings", "name": "rovid.toml"})
    return documents


def _log(what: str, log: Log) -> Document:
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


def _model(event: Model) -> Document:
    fit = event.fit
    document: Document = {
        "logs": _names(event),
        "new": list(event.new),
        "missing": event.missing or None,
        "until": _standings(event.standings),
    }
    if fit is None:
        return document | {"effects": [], "parameters": {}, "fit": None}
    return document | {
        "effects": [effect.key for effect in fit.model.effects],
        "parameters": beside(fit.estimate, event.before),
        "fit": likelihood_document(fit, event.study),
    }


def beside(estimate: Estimate, before: Estimate | None) -> dict[str, Document]:
    """Each parameter with what it was before the last logs, and how many times as narrow its interval is now."""
    now = parameter_document(estimate)
    then: Mapping[str, Any] = {} if before is None else parameter_document(before)
    for name, document in now.items():
        was = then.get(name)
        document["relative_interval"] = relative_reach(estimate, name)
        document["before"] = was
        document["narrower"] = None if was is None else _width(was) / max(_width(document), 1e-300)
    return now


def _width(document: Document) -> float:
    low, high = document["interval_95"]
    return float(high - low)


def _names(event: Model | Suspects) -> list[str]:
    campaign = event.study.campaign
    return [] if campaign is None else [trial.name for trial in campaign.trials]


def _suspects(event: Suspects) -> Document:
    document, side = diagnosis_document(event.diagnosis, event.study), event.diagnosis.extended
    return {
        "logs": _names(event),
        "verdict": document["verdict"],
        "findings": document["findings"],
        "suspects": document["suspects"],
        "parameters": {} if side is None else beside(side.estimate, None),
        "next_experiment": document["next_experiment"],
        "until": _standings(event.standings),
    }


def _next_run(event: NextRun) -> Document:
    plan = event.plan
    return {
        "run": event.words,
        "reason": event.reason,
        "seconds": None if plan is None else plan.best.run.seconds,
        "narrow": None if plan is None else plan.narrow or None,
        "between": [belief.name for belief in plan.beliefs] if plan is not None and len(plan.beliefs) > 1 else None,
        "gain": None if plan is None else plan.best.gain,
        "command_file": None if event.written is None else str(event.written),
        "commands": None if plan is None else commands_by_name(plan),
    }


def _stop(event: Stop) -> Document:
    study, fit, diagnosis = event.study, event.fit, event.diagnosis
    return {
        "reason": event.why,
        "logs": [log.name for log in event.logs],
        "until": _standings(event.standings),
        "fit": None if fit is None or study is None else likelihood_document(fit, study),
        "diagnosis": None if diagnosis is None or study is None else diagnosis_document(diagnosis, study),
    }


def _standings(standings: Sequence[Standing]) -> list[Document]:
    return [
        {"condition": str(one.condition), "percent": None if one.now is None else 100.0 * one.now, "met": one.met}
        for one in standings
    ]
