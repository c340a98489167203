"""Events of a trial day on a terminal and as JSON."""

from collections.abc import Iterator, Sequence
from datetime import datetime
from pathlib import Path

from rich.console import Console

from rovid.core.errors import join_words
from rovid.core.formatting import plus_minus, significant
from rovid.estimate.estimate import Estimate
from rovid.estimate.experiment_design import commands_by_name
from rovid.present import console as printing
from rovid.present.documents.diagnosis import diagnosis_document
from rovid.present.documents.fits import Document, fields, fit_document, parameter_document
from rovid.present.number_format import DASH, format_number
from rovid.present.sentences import cause_name, cut_short_sentence, evidence_words, verdict_sentence
from rovid.store import watch_session
from rovid.store.folder_monitor import Problem, WatchedLog
from rovid.trial.fault import stopping

# Ratio of the 95 % intervals before and after a log from which the log is said to narrow them.
_NARROWER = 1.05


def show_watch_start(
    console: Console, folder: Path, until: Sequence[watch_session.StopCriterion], interval: float, *, once: bool
) -> None:
    """Print which folder is watched, and what ends the session."""
    if once:
        return
    end = "until Ctrl-C"
    if until:
        end = f"until {join_words(list(map(str, until)))}; Ctrl-C ends it before"
    printing.print_labelled(console, "Watching", f"{folder}, every {interval:g} s, {end}.")


def show_watch_event(console: Console, event: watch_session.Event, *, at: datetime | None = None) -> None:
    """Print an event, with its time of day where one is given."""
    if isinstance(event, watch_session.LogsChanged):
        console.print()
        label = "Logs:" if at is None else f"{at:%H:%M:%S}"
        printing.print_labelled(console, label, f"{'; '.join(_log_changes(event))}.", indent=2)
        for log in filter(lambda log: log.cut, (*event.change.added, *event.change.replaced)):
            text = f"{log.name}: the log was cut short and has not grown since. {log.cut}"
            printing.show_warnings(console, [text])
    elif isinstance(event, watch_session.ModelFitted):
        _show_model(console, event)
    elif isinstance(event, watch_session.LogsDiagnosed):
        _show_diagnosis(console, event)
    elif isinstance(event, watch_session.NextRun):
        run = event.words
        if event.plan is not None:
            run += f", {event.plan.best.run.seconds / 60.0:.1f} min"
        printing.print_labelled(console, "Next:", f"{run}; {event.reason}.", indent=2)
        if event.written is not None:
            printing.print_path(console, f"  written: {event.written}")
    elif isinstance(event, Problem):
        label, style = ("Mended:", "green") if event.resolved else ("Note:", "yellow")
        text = event.text if event.text.startswith(event.where) else f"{event.where}: {event.text}"
        printing.print_labelled(console, label, text, style)
    else:
        _show_end(console, event)


def _log_changes(event: watch_session.LogsChanged) -> Iterator[str]:
    change = event.change
    if len(change.added) == 1:
        yield f"{change.added[0].name}, {_duration(change.added)}"
    elif change.added:
        yield f"{len(change.added)} logs, {_duration(change.added)}: {join_words([log.name for log in change.added])}"
    for log in change.replaced:
        yield f"{log.name} was replaced, {_duration([log])}"
    for before, after in change.renamed:
        yield f"{before.name} was renamed to {after.name}"
    if change.removed:
        yield f"{join_words([log.name for log in change.removed])} removed from the folder"
    if change.settings:
        yield "rovid.toml, or a thrust curve, has changed"


def _duration(logs: Sequence[WatchedLog]) -> str:
    return f"{sum(log.seconds for log in logs) / 60.0:.1f} min"


def _show_model(console: Console, event: watch_session.ModelFitted) -> None:
    if event.fit is None:
        label = "No go:" if stopping(event.study.faults) else "Not enough yet:"
        printing.print_labelled(console, label, event.missing, "bold yellow", indent=2)
        return
    estimate = event.fit.estimate
    printing.show_caution(console, estimate.assumptions)
    headline = _narrowing_sentence(estimate, event.before) if event.new else "The model with these logs."
    printing.print_labelled(console, headline, indent=2)
    console.print(_parameters_table(estimate, event.before))
    _show_criteria(console, event.criteria)


def _narrowing_sentence(estimate: Estimate, before: Estimate | None) -> str:
    """By how much new logs narrowed the intervals."""
    if before is None:
        return "A first model."
    rows = parameters_with_previous(estimate, before).items()
    factors = {name: row["narrower"] for name, row in rows if (row["narrower"] or 0.0) >= _NARROWER}
    if not factors:
        return "The new logs narrowed no interval."
    largest_first = sorted(factors, key=lambda name: -factors[name])
    factors_words = [f"{name} {significant(factors[name], 2)} times" for name in largest_first]
    return f"The new logs narrowed the intervals: {join_words(factors_words)}."


def _parameters_table(estimate: Estimate, before: Estimate | None) -> printing.ResultTable:
    """Parameters with their relative intervals, and how these compare with those before the last logs."""
    titles = ["value ± error", "unit", "95 % within"]
    if before is not None:
        titles += ["before", "narrower"]
    table = printing.ResultTable("", printing.text_column("parameter"), *map(printing.mixed_number_column, titles))
    for name, row in parameters_with_previous(estimate, before).items():
        cells = [name, plus_minus(row["value"], row["standard_error"]), row["unit"]]
        if row.get("placeholder"):
            table.add_row(*cells, "guessed", style="red")
            continue
        cells.append(_percent(row["relative_interval"]))
        if before is not None:
            old, factor = row["before"], row["narrower"]
            cells.append(DASH if old is None else plus_minus(old["value"], old["standard_error"]))
            cells.append(DASH if factor is None else f"{significant(factor, 2)} ×")
        table.add_row(*cells)
    for name in estimate.refused:
        table.add_row(name, "not determined", estimate.unit(name), DASH)
    return table


def _percent(share: float | None) -> str:
    return DASH if share is None else f"{format_number(100.0 * share, 2)} %"


def _show_criteria(console: Console, criteria: Sequence[watch_session.CriterionStatus]) -> None:
    if criteria:
        printing.print_labelled(console, "Until:", "; ".join(map(_criterion_words, criteria)) + ".", indent=2)


def _criterion_words(status: watch_session.CriterionStatus) -> str:
    current = "not known yet" if status.current is None else f"{_percent(status.current)} now"
    return f"{status.criterion}: {'reached, ' * status.met}{current}"


def _show_diagnosis(console: Console, event: watch_session.LogsDiagnosed) -> None:
    diagnosis, extended = event.diagnosis, event.diagnosis.extended
    if diagnosis.verdict == "too_little_data":
        printing.print_labelled(console, "Causes:", f"not yet determined: {diagnosis.missing}", indent=2)
        return
    printing.print_labelled(console, "Causes:", verdict_sentence(diagnosis, event.study.vehicle.assumptions), indent=2)
    for finding in diagnosis.causes:
        printing.print_text(console, f"  {cause_name(finding)}: {evidence_words(finding)}", 4)
    if diagnosis.is_cut_short and diagnosis.causes:
        printing.print_text(console, cut_short_sentence(diagnosis), 2)
    fitted = None if event.fit is None else event.fit.estimate
    if extended is not None and diagnosis.findings and (fitted is None or extended.estimate.names != fitted.names):
        printing.print_labelled(console, "Extended model, with these causes:")
        console.print(_parameters_table(extended.estimate, fitted))
    if not all(status.met for status in event.criteria):
        _show_criteria(console, event.criteria)


def _show_end(console: Console, event: watch_session.SessionEnded) -> None:
    """Print why the session ended; after Ctrl-C also the causes and the parameters."""
    count = len(event.logs)
    logs = f"{count} log{'s' * (count != 1)}"
    console.print()
    if event.reason == "reached":
        criteria = "; ".join(map(_criterion_words, event.criteria))
        printing.print_labelled(console, "Stop:", f"enough is known, by {logs}: {criteria}.", "bold green", indent=2)
        return
    printing.print_labelled(console, "Ended:", f"{logs}.")
    _show_criteria(console, event.criteria)
    if event.reason != "interrupted":
        return
    estimate = None if event.fit is None else event.fit.estimate
    if event.diagnosis is not None and event.study is not None:
        guess = event.study.vehicle.assumptions
        printing.print_labelled(console, "Causes:", verdict_sentence(event.diagnosis, guess), indent=2)
        if event.diagnosis.extended is not None:
            estimate = event.diagnosis.extended.estimate
    if estimate is not None:
        console.print(_parameters_table(estimate, None))
    if event.diagnosis is None and event.fit is not None:
        printing.print_text(console, "The last logs were fitted but not diagnosed: run `rovid diagnose`.")


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
        whole, extended = diagnosis_document(event.diagnosis, event.study), event.diagnosis.extended
        document: Document = {"logs": _trial_names(event)}
        document |= {key: whole[key] for key in ("verdict", "findings", "suspects", "next_experiment")}
        document["parameters"] = {} if extended is None else parameters_with_previous(extended.estimate, None)
        return [_line("suspects", document | {"until": _criteria(event.criteria)})]
    if isinstance(event, watch_session.NextRun):
        return [_line("next_run", _next_run_document(event))]
    if isinstance(event, Problem):
        return [_line("problem", {"where": event.where, "text": event.text, "over": event.resolved})]
    end: Document = {"reason": event.reason, "logs": [log.name for log in event.logs]}
    end |= {"until": _criteria(event.criteria), "fit": None, "diagnosis": None}
    if event.study is not None and event.fit is not None:
        end["fit"] = fit_document(event.fit, event.study)
    if event.study is not None and event.diagnosis is not None:
        end["diagnosis"] = diagnosis_document(event.diagnosis, event.study)
    return [_line("stop", end)]


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
    document: Document = {"logs": _trial_names(event), "new": list(event.new), "missing": event.missing or None}
    document["until"] = _criteria(event.criteria)
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
    previous = {} if before is None else parameter_document(before)
    for name, document in documents.items():
        old = previous.get(name)
        document["relative_interval"] = watch_session.relative_half_width(estimate, name)
        document |= {"before": old, "narrower": None}
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
    written = None if event.written is None else str(event.written)
    return document | {"run": event.words, "reason": event.reason, "command_file": written}


def _criteria(criteria: Sequence[watch_session.CriterionStatus]) -> list[Document]:
    documents = []
    for status in criteria:
        percent = None if status.current is None else 100.0 * status.current
        documents.append({"condition": str(status.criterion), "percent": percent, "met": status.met})
    return documents
