"""What `rovid watch` says through a trial day: a block for each log, its answer first."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from datetime import datetime
from pathlib import Path

from rich.console import Console

from rovid.core.console import led
from rovid.core.formatting import plus_minus
from rovid.estimate.estimate import Estimate
from rovid.present.documents.watch import beside
from rovid.present.terminal.result_tables import number, say, show_caution, show_warnings
from rovid.present.terminal.table import Columns, table
from rovid.present.verdict import cause, listed, sureness, verdict
from rovid.watch.folder_monitor import Log, Trouble
from rovid.watch.session import Event, Model, NextRun, Stop, Suspects, Taken
from rovid.watch.stop_criteria import Condition, Standing

# Times as narrow: less is not worth a word.
_NARROWER = 1.05


def show_began(console: Console, folder: Path, until: Sequence[Condition], interval: float, *, once: bool) -> None:
    """Print what is watched, and how it ends."""
    if once:
        return
    ends = f"until {listed([str(one) for one in until])}; Ctrl-C ends it before" if until else "until Ctrl-C"
    say(console, led("Watching", f"{folder}, every {interval:g} s, {ends}."))


def show_event(console: Console, event: Event, *, at: datetime | None = None) -> None:
    """Print what happened, with the time of day where that tells anything."""
    if isinstance(event, Taken):
        _show_taken(console, event, "Logs:" if at is None else f"{at:%H:%M:%S}")
    elif isinstance(event, Model):
        _show_model(console, event)
    elif isinstance(event, Suspects):
        _show_suspects(console, event)
    elif isinstance(event, NextRun):
        _show_next(console, event)
    elif isinstance(event, Trouble):
        style = "green" if event.over else "yellow"
        text = event.text if event.text.startswith(event.where) else f"{event.where}: {event.text}"
        say(console, led("Mended:" if event.over else "Note:", text, style))
    else:
        _show_stop(console, event)


def _show_taken(console: Console, event: Taken, lead: str) -> None:
    """The head of a block."""
    console.print()
    say(console, led(lead, f"{'; '.join(_taken(event))}."), 2)
    change = event.change
    cut = [
        f"{log.name}: it was cut short and has not grown since. {log.cut}"
        for log in (*change.added, *change.replaced)
        if log.cut
    ]
    show_warnings(console, cut)


def _taken(event: Taken) -> Iterator[str]:
    change = event.change
    if change.added:
        yield _named(change.added)
    for log in change.replaced:
        yield f"{log.name} is another now, {_size(log)}"
    for before, after in change.renamed:
        yield f"{before.name} is called {after.name} now"
    if change.removed:
        yield f"without {listed([log.name for log in change.removed])}, gone from the folder"
    if change.settings:
        yield "rovid.toml, or a thrust curve, has changed"


def _named(logs: Sequence[Log]) -> str:
    if len(logs) == 1:
        return f"{logs[0].name}, {_size(logs[0])}"
    minutes = sum(log.seconds for log in logs) / 60.0
    return f"{len(logs)} logs, {minutes:.1f} min: {listed([log.name for log in logs])}"


def _size(log: Log) -> str:
    return f"{log.seconds / 60.0:.1f} min"


def _show_model(console: Console, event: Model) -> None:
    if event.fit is None:
        say(console, led("Not enough yet:", event.missing, "bold yellow"), 2)
        return
    estimate = event.fit.estimate
    show_caution(console, estimate.guess)
    say(console, led(_added(estimate, event.before) if event.new else "The model with that."), 2)
    console.print(_parameters(estimate, event.before))
    _show_standings(console, event.standings)


def _added(estimate: Estimate, before: Estimate | None) -> str:
    """What the logs added, in a sentence."""
    if before is None:
        return "A first model."
    rows = beside(estimate, before)
    narrower = {name: row["narrower"] for name, row in rows.items() if row["narrower"] is not None}
    told = sorted((name for name, by in narrower.items() if by >= _NARROWER), key=lambda name: -narrower[name])
    if not told:
        return "It made nothing surer."
    return f"It made {listed([f'{name} {narrower[name]:.2g} times' for name in told])} surer."


def _parameters(estimate: Estimate, before: Estimate | None) -> Columns:
    history = () if before is None else ("before", "narrower")
    rows = table("", "parameter", "value ± error", "unit", "95 % within", *history)
    for name, row in beside(estimate, before).items():
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
    return "–" if share is None else f"{number(100.0 * share, 2)} %"


def _show_standings(console: Console, standings: Sequence[Standing]) -> None:
    if standings:
        say(console, led("Until:", "; ".join(map(_standing, standings)) + "."), 2)


def _standing(one: Standing) -> str:
    words = f"{_percent(one.now)} now" if one.now is not None else "not known yet"
    return f"{one.condition}: {'reached, ' if one.met else ''}{words}"


def _show_suspects(console: Console, event: Suspects) -> None:
    diagnosis = event.diagnosis
    if diagnosis.verdict == "too_little_data":
        say(console, led("Causes:", f"none can be told yet: {diagnosis.missing}"), 2)
        return
    say(console, led("Causes:", verdict(diagnosis, event.study.vehicle.guess)), 2)
    for finding in (*diagnosis.findings, *diagnosis.suspects):
        say(console, f"  {cause(finding)}: {sureness(finding)}", 4)
    side = diagnosis.extended
    if side is not None and (event.fit is None or side.estimate.names != event.fit.estimate.names):
        say(console, led("With that:"))
        console.print(_parameters(side.estimate, None if event.fit is None else event.fit.estimate))
    if not all(one.met for one in event.standings):
        _show_standings(console, event.standings)


def _show_next(console: Console, event: NextRun) -> None:
    plan = event.plan
    minutes = "" if plan is None else f", {plan.best.run.seconds / 60.0:.1f} min"
    say(console, led("Next:", f"{event.words}{minutes}; {event.reason}."), 2)
    if event.written is not None:
        console.print(f"  written: {event.written}", highlight=False, soft_wrap=True)


def _show_stop(console: Console, event: Stop) -> None:
    console.print()
    count = len(event.logs)
    logs = f"{count} log{'s' * (count != 1)}"
    if event.why == "reached":
        say(
            console,
            led("Stop:", f"enough is known, by {logs}: {'; '.join(map(_standing, event.standings))}.", "bold green"),
            2,
        )
    else:
        say(console, led("Ended:", f"{logs}."))
        _show_standings(console, event.standings)
    if event.why != "interrupted":
        return
    # Who was away reads this alone.
    side = None
    if event.diagnosis is not None and event.study is not None:
        side = event.diagnosis.extended
        say(console, led("Causes:", verdict(event.diagnosis, event.study.vehicle.guess)), 2)
    known = side.estimate if side is not None else event.fit.estimate if event.fit is not None else None
    if known is not None:
        console.print(_parameters(known, None))
    if event.diagnosis is None and event.fit is not None:
        say(console, "The last logs were fitted and not diagnosed: `rovid diagnose` does that.")
