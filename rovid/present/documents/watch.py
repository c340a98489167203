"""Events of a watched trial day as JSON, one document a line."""

from collections.abc import Sequence
from datetime import datetime
from pathlib import Path

from rovid.estimate.estimate import Estimate
from rovid.estimate.experiment_design import commands_by_name
from rovid.present.documents.diagnosis import diagnosis_document
from rovid.present.documents.fits import Document, fields, fit_document, parameter_document
from rovid.store import watch_session
from rovid.store.folder_monitor import Problem, WatchedLog

SCHEMA = "rovid-watch/1"


def watch_start_document(folder: Path, until: Sequence[watch_session.StopCriterion]) -> Document:
    """The first document of a session."""
    return _line("start", {"folder": str(folder), "until": list(map(str, until))})


def watch_documents(event: watch_session.Event) -> list[Document]:
    """The documents of an event; a change of logs has a document for each log."""
    if isinstance(event, watch_session.LogsChanged):
        change = event.change
        logs = {"removed": change.removed, "replaced": change.replaced, "added": change.added}
        documents = [_log_document(action, log) for action, each in logs.items() for log in each]
        documents += [_log_document("renamed", after) | {"before": before.name} for before, after in change.renamed]
        if change.settings:
            documents.append({"action": "settings", "name": "rovid.toml"})
        return [_line("log", document) for document in documents]
    if isinstance(event, watch_session.ModelFitted):
        return [_line("model", _model_document(event))]
    if isinstance(event, watch_session.LogsDiagnosed):
        document, extended = diagnosis_document(event.diagnosis, event.study), event.diagnosis.extended
        suspects_document = {
            "logs": _trial_names(event),
            **{key: document[key] for key in ("verdict", "findings", "suspects", "next_experiment")},
            "parameters": {} if extended is None else parameters_with_previous(extended.estimate, None),
            "until": _criteria(event.criteria),
        }
        return [_line("suspects", suspects_document)]
    if isinstance(event, watch_session.NextRun):
        return [_line("next_run", _next_run_document(event))]
    if isinstance(event, Problem):
        return [_line("problem", {"where": event.where, "text": event.text, "over": event.resolved})]
    return [_line("stop", _end_document(event))]


def _line(kind: str, content: Document) -> Document:
    now = datetime.now().astimezone().isoformat(timespec="seconds")
    return {"schema": SCHEMA, "event": kind, "time": now, **content}


def _log_document(action: str, log: WatchedLog) -> Document:
    return {
        "action": action,
        **fields(log, "name", "samples", "seconds"),
        "path": str(log.path),
        "cut": bool(log.cut),
        "remarks": [remark.text for trial in log.trials for remark in trial.remarks],
    }


def _model_document(event: watch_session.ModelFitted) -> Document:
    fit = event.fit
    document: Document = {
        "logs": _trial_names(event),
        "new": list(event.new),
        "missing": event.missing or None,
        "until": _criteria(event.criteria),
    }
    if fit is None:
        return document | {"effects": [], "parameters": {}, "fit": None}
    return document | {
        "effects": [effect.key for effect in fit.model.effects],
        "parameters": parameters_with_previous(fit.estimate, event.before),
        "fit": fit_document(fit, event.study),
    }


def parameters_with_previous(estimate: Estimate, before: Estimate | None) -> dict[str, Document]:
    """Each parameter with its value before the last logs, and the factor by which its interval is narrower now."""

    def width(document: Document) -> float:
        low, high = document["interval_95"]
        return float(high - low)

    documents: dict[str, Document] = parameter_document(estimate)
    previous: dict[str, Document] = {}
    if before is not None:
        previous = parameter_document(before)
    for name, document in documents.items():
        old = previous.get(name)
        document |= {
            "relative_interval": watch_session.relative_half_width(estimate, name),
            "before": old,
            "narrower": None,
        }
        if old is not None:
            document["narrower"] = width(old) / max(width(document), 1e-300)
    return documents


def _trial_names(event: watch_session.ModelFitted | watch_session.LogsDiagnosed) -> list[str]:
    campaign = event.study.campaign
    return [] if campaign is None else [trial.name for trial in campaign.trials]


def _next_run_document(event: watch_session.NextRun) -> Document:
    plan = event.plan
    document: Document = dict.fromkeys(("seconds", "narrow", "between", "gain", "commands"))
    if plan is not None:
        document |= {
            "seconds": plan.best.run.seconds,
            "narrow": plan.parameter or None,
            "between": [model.name for model in plan.models] if len(plan.models) > 1 else None,
            "gain": plan.best.gain,
            "commands": commands_by_name(plan),
        }
    return document | {
        "run": event.words,
        "reason": event.reason,
        "command_file": None if event.written is None else str(event.written),
    }


def _end_document(event: watch_session.SessionEnded) -> Document:
    document: Document = {
        "reason": event.reason,
        "logs": [log.name for log in event.logs],
        "until": _criteria(event.criteria),
        "fit": None,
        "diagnosis": None,
    }
    if event.study is not None and event.fit is not None:
        document["fit"] = fit_document(event.fit, event.study)
    if event.study is not None and event.diagnosis is not None:
        document["diagnosis"] = diagnosis_document(event.diagnosis, event.study)
    return document


def _criteria(criteria: Sequence[watch_session.CriterionStatus]) -> list[Document]:
    documents = []
    for status in criteria:
        percent = None
        if status.current is not None:
            percent = 100.0 * status.current
        documents.append({"condition": str(status.criterion), "percent": percent, "met": status.met})
    return documents
