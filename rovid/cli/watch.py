"""``rovid watch``."""

from __future__ import annotations

import signal
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from datetime import datetime
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from rovid.cli.context import compile_in_background, console, parameters_at, reserve_outputs
from rovid.cli.sessions import diagnose_study, store_estimate
from rovid.core.errors import ConfigError, LogError

if TYPE_CHECKING:
    from rich.status import Status

    from rovid.estimate.estimate import Estimate
    from rovid.estimate.experiment_design import ExperimentPlan
    from rovid.present.documents.fits import Document
    from rovid.store.study import Study
    from rovid.store.watch_session import Event, StopCriterion


def watch(
    folder: Path,
    *,
    until: str | None = None,
    once: bool = False,
    no_diagnosis: bool = False,
    output: Path = Path("plan.csv"),
    interval: float = 2.0,
    whole: float = 5.0,
    cut: float = 60.0,
    axis: str | None = None,
    parameters: Path | None = None,
    cutoff: float | None = None,
    budget: float | None = None,
    force: bool = False,
    json: bool = False,
) -> None:
    """Follow a trial day: results after each log, and the next run."""
    compile_in_background()
    from rovid.core.output_files import PLAN, OutputFile
    from rovid.estimate.experiment_design import command_csv
    from rovid.store.folder_monitor import FolderMonitor, Problem
    from rovid.store.watch_session import SessionActions, WatchSession, parse_criteria

    if folder.is_file():
        raise ConfigError("is a file; a folder was expected.", where=folder, mend="Give the folder of the logs.")
    stored = parameters_at(parameters, axis, force=force)
    criteria = parse_criteria(until, stored.axis, diagnosed=not no_diagnosis) if until else ()
    commands = OutputFile(output, PLAN)
    outputs = reserve_outputs([stored.output, commands], [folder], force=force)

    def keep(study: Study, estimate: Estimate) -> None:
        store_estimate(stored, outputs, study, estimate, with_history=False)

    def write(plan: ExperimentPlan) -> Path:
        outputs.write({commands: command_csv(plan)})
        return output

    diagnose = None if no_diagnosis else partial(diagnose_study, stored, budget=budget)
    actions = SessionActions(diagnose=diagnose, keep=keep, write=write, cutoff=cutoff)
    monitor = FolderMonitor(path=folder, axis=stored.axis, settled=whole, abandoned=cut, once=once)
    problems: list[str] = []
    with _progress() as status:
        report = (lambda _: None) if status is None else status.update
        session = WatchSession(monitor, actions, criteria, interval=interval, report=report)
        show = _printer(folder, criteria, interval, once=once, json=json)
        with _interruptible() as interruption:
            for event in session.events():
                if isinstance(event, Problem):
                    problems.append(f"{event.where}: {event.text}")
                with _paused(status):
                    show(event)
        if interruption:
            with _paused(status):
                show(session.ended("interrupted"))
    if once and not session.ended("once").logs:
        raise LogError(problems[-1] if problems else "holds no logs.", where="" if problems else folder)


def _printer(
    folder: Path, criteria: Sequence[StopCriterion], interval: float, *, once: bool, json: bool
) -> Callable[[Event], None]:
    """Print the start of the session; return a function that prints an event."""
    from rovid.core.formatting import to_json_line
    from rovid.present.terminal.watch import show_watch_event, show_watch_start, watch_documents, watch_start_document

    def print_line(document: Document) -> None:
        typer.echo(to_json_line(document))
        # A program may be reading.
        sys.stdout.flush()

    def show(event: Event) -> None:
        if json:
            for document in watch_documents(event):
                print_line(document)
        else:
            show_watch_event(console(), event, at=None if once else datetime.now().astimezone())

    if json:
        print_line(watch_start_document(folder, criteria))
    else:
        show_watch_start(console(), folder, criteria, interval, once=once)
    return show


@contextmanager
def _interruptible() -> Iterator[list[str]]:
    """Let Ctrl-C or SIGTERM end the block; the yielded list then has an item."""
    interruption: list[str] = []
    previous = signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        yield interruption
    except KeyboardInterrupt:
        interruption.append("interrupted")
    finally:
        signal.signal(signal.SIGTERM, previous)


@contextmanager
def _progress() -> Iterator[Status | None]:
    """The progress line on a terminal, below the printed text."""
    if not sys.stderr.isatty():
        yield None
        return
    from rovid.core.formatting import SafeConsole

    with SafeConsole(stderr=True).status("Looking …") as status:
        yield status


@contextmanager
def _paused(status: Status | None) -> Iterator[None]:
    """Remove the progress line while something is printed."""
    if status is not None:
        status.stop()
    yield
    if status is not None:
        status.start()
