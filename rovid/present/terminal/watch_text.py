"""What `rovid watch` says through a trial day: a block for each log, its answer first."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from datetime import datetime
from pathlib import Path

from rich.console import Console

from rovid.core.console import labelled_text
from rovid.core.formatting import plus_minus
from rovid.estimate.estimate import Estimate
from rovid.present.documents.watch import parameters_with_previous
from rovid.present.terminal.result_tables import print_text, show_caution, show_warnings, table_number
from rovid.present.terminal.table import Columns, table
from rovid.present.verdict import cause_name, confidence_words, join_words, verdict_sentence
from rovid.watch.folder_monitor import Problem
from rovid.watch.session import Event, LogsChanged, LogsDiagnosed, ModelFitted, NextRun, SessionEnded
from rovid.watch.stop_criteria import CriterionStatus, StopCriterion
from rovid.watch.watched_log import WatchedLog

# Times as narrow: less is not worth a word.
_NARROWER = 1.05


def show_watch_start(
    console: Console, folder: Path, until: Sequence[StopCriterion], interval: float, *, once: bool
) -> None:
    """Print what is watched, and how it ends."""
    if once:
        return
    ends = f"until {join_words([str(one) for one in until])}; Ctrl-C ends it before" if until else "until Ctrl-C"
    print_text(console, labelled_text("Watching", f"{folder}, every {interval:g} s, {ends}."))


def show_watch_event(console: Console, event: Event, *, at: datetime | None = None) -> None:
    """Print what happened, with the time of day where that tells anything."""
    if isinstance(event, LogsChanged):
        _show_taken(console, event, "Logs:" if at is None else f"{at:%H:%M:%S}")
    elif isinstance(event, ModelFitted):
        _show_model(console, event)
    elif isinstance(event, LogsDiagnosed):
        _show_suspects(console, event)
    elif isinstance(event, NextRun):
        _show_next(console, event)
    elif isinstance(event, Problem):
        style = "green" if event.resolved else "yellow"
        text = event.text if event.text.startswith(event.where) else f"{event.where}: {event.text}"
        print_text(console, labelled_text("Mended:" if event.resolved else "Note:", text, style))
    else:
        _show_stop(console, event)


def _show_taken(console: Console, event: LogsChanged, lead: str) -> None:
    """The head of a block."""
    console.print()
    print_text(console, labelled_text(lead, f"{'; '.join(_taken(event))}."), 2)
    change = event.change
    cut = [
        f"{log.name}: it was cut short and has not grown since. {log.cut}"
        for log in (*change.added, *change.replaced)
        if log.cut
    ]
    show_warnings(console, cut)


def _taken(event: LogsChanged) -> Iterator[str]:
    change = event.change
    if change.added:
        yield _named(change.added)
    for log in change.replaced:
        yield f"{log.name} is another now, {_size(log)}"
    for before, after in change.renamed:
        yield f"{before.name} is called {after.name} now"
    if change.removed:
        yield f"without {join_words([log.name for log in change.removed])}, gone from the folder"
    if change.settings:
        yield "rovid.toml, or a thrust curve, has changed"


def _named(logs: Sequence[WatchedLog]) -> str:
    if len(logs) == 1:
        return f"{logs[0].name}, {_size(logs[0])}"
    minutes = sum(log.seconds for log in logs) / 60.0
    return f"{len(logs)} logs, {minutes:.1f} min: {join_words([log.name for log in logs])}"


def _size(log: WatchedLog) -> str:
    return f"{log.seconds / 60.0:.1f} min"


def _show_model(console: Console, event: ModelFitted) -> None:
    if event.fit is None:
        print_text(console, labelled_text("Not enough yet:", event.missing, "bold yellow"), 2)
        return
    estimate = event.fit.estimate
    show_caution(console, estimate.assumptions)
    print_text(console, labelled_text(_added(estimate, event.before) if event.new else "The model with that."), 2)
    console.print(_parameters(estimate, event.before))
    _show_standings(console, event.criteria)


def _added(estimate: Estimate, before: Estimate | None) -> str:
    """What the logs added, in a sentence."""
    if before is None:
        return "A first model."
    rows = parameters_with_previous(estimate, before)
    narrower = {name: row["narrower"] for name, row in rows.items() if row["narrower"] is not None}
    told = sorted((name for name, by in narrower.items() if by >= _NARROWER), key=lambda name: -narrower[name])
    if not told:
        return "It made nothing surer."
    return f"It made {join_words([f'{name} {narrower[name]:.2g} times' for name in told])} surer."


def _parameters(estimate: Estimate, before: Estimate | None) -> Columns:
    history = () if before is None else ("before", "narrower")
    rows = table("", "parameter", "value ± error", "unit", "95 % within", *history)
    for name, row in parameters_with_previous(estimate, before).items():
        was = row["before"]
        value = plus_minus(row["value"], row["standard_error"])
        if row.get("placeholder"):
            rows.add_row(name, value, row["unit"], "guessed", style="red")
            continue
        then = "–" if was is None else plus_minus(was["value"], was["standard_error"])
        narrower = "–" if row["narrower"] is None else f"{row['narrower']:.2g} ×"
        told = (then, narrower) if history else ()
        rows.add_row(name, value, row["unit"], _percent(row["relative_interval"]), *told)
    for name in estimate.refused:
        rows.add_row(name, "not determined", estimate.unit(name), "–")
    return rows


def _percent(share: float | None) -> str:
    return "–" if share is None else f"{table_number(100.0 * share, 2)} %"


def _show_standings(console: Console, standings: Sequence[CriterionStatus]) -> None:
    if standings:
        print_text(console, labelled_text("Until:", "; ".join(map(_standing, standings)) + "."), 2)


def _standing(one: CriterionStatus) -> str:
    words = f"{_percent(one.current)} now" if one.current is not None else "not known yet"
    return f"{one.criterion}: {'reached, ' if one.met else ''}{words}"


def _show_suspects(console: Console, event: LogsDiagnosed) -> None:
    diagnosis = event.diagnosis
    if diagnosis.verdict == "too_little_data":
        print_text(console, labelled_text("Causes:", f"none can be told yet: {diagnosis.missing}"), 2)
        return
    print_text(console, labelled_text("Causes:", verdict_sentence(diagnosis, event.study.vehicle.assumptions)), 2)
    for finding in (*diagnosis.findings, *diagnosis.suspects):
        print_text(console, f"  {cause_name(finding)}: {confidence_words(finding)}", 4)
    side = diagnosis.extended
    if side is not None and (event.fit is None or side.estimate.names != event.fit.estimate.names):
        print_text(console, labelled_text("With that:"))
        console.print(_parameters(side.estimate, None if event.fit is None else event.fit.estimate))
    if not all(one.met for one in event.criteria):
        _show_standings(console, event.criteria)


def _show_next(console: Console, event: NextRun) -> None:
    plan = event.plan
    minutes = "" if plan is None else f", {plan.best.run.seconds / 60.0:.1f} min"
    print_text(console, labelled_text("Next:", f"{event.words}{minutes}; {event.reason}."), 2)
    if event.written is not None:
        console.print(f"  written: {event.written}", highlight=False, soft_wrap=True)


def _show_stop(console: Console, event: SessionEnded) -> None:
    console.print()
    count = len(event.logs)
    logs = f"{count} log{'s' * (count != 1)}"
    if event.reason == "reached":
        print_text(
            console,
            labelled_text(
                "Stop:", f"enough is known, by {logs}: {'; '.join(map(_standing, event.criteria))}.", "bold green"
            ),
            2,
        )
    else:
        print_text(console, labelled_text("Ended:", f"{logs}."))
        _show_standings(console, event.criteria)
    if event.reason != "interrupted":
        return
    # Who was away reads this alone.
    side = None
    if event.diagnosis is not None and event.study is not None:
        side = event.diagnosis.extended
        print_text(
            console, labelled_text("Causes:", verdict_sentence(event.diagnosis, event.study.vehicle.assumptions)), 2
        )
    known = side.estimate if side is not None else event.fit.estimate if event.fit is not None else None
    if known is not None:
        console.print(_parameters(known, None))
    if event.diagnosis is None and event.fit is not None:
        print_text(console, "The last logs were fitted and not diagnosed: `rovid diagnose` does that.")
