"""``rovid watch``."""

from __future__ import annotations

import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rovid.cli.context import claim_of, compile_beside, console, diagnosed, put, stored_at
from rovid.cli.help_format import Page
from rovid.cli.options import AxisName, Cutoff, Force, ParameterFile
from rovid.core.errors import ConfigError, LogError

if TYPE_CHECKING:
    from rich.status import Status

    from rovid.design.experiment_design import ExperimentPlan
    from rovid.estimate.estimate import Estimate
    from rovid.present.documents.fits import Document
    from rovid.store.study import Study
    from rovid.watch.session import Event

PAGE = Page(
    text="""
    Looks at FOLDER through a trial day. After each new log that is whole it says what the log added, which causes
    are suspected or established, which run to make next, and with --until when enough is known. Writes the next run
    as a command file and the model to the parameter file, each anew after every log. Ctrl-C ends it, with a summary.

    A log is taken when it has stayed as it is for some seconds and its end is found in it; one that was cut short,
    after a longer wait. Folder and rovid.toml need not be there yet. Logs may be renamed, replaced or deleted.
    """,
    examples=(
        ("Through a trial day", "rovid watch my_logs"),
        (
            "Until inertia and drag are known well enough",
            'rovid watch my_logs --until "inertia 2 %, quadratic_drag 5 %"',
        ),
        ("What is there now, as JSON lines for a program", "rovid watch my_logs --once --json"),
    ),
    see=("rovid diagnose", "rovid plan", "rovid check", "rovid help watch"),
)


def watch(
    folder: Annotated[Path, typer.Argument(metavar="FOLDER", help="Where the logs come in.", show_default=False)],
    *,
    until: Annotated[
        str | None,
        typer.Option(
            metavar="TEXT",
            help='Stop when parameters are known this well, by their 95 % intervals, "inertia 2 %, linear_drag 9 %"; '
            'or a cause is this sure, as "thruster_lag 95 %".',
            show_default=False,
        ),
    ] = None,
    once: Annotated[bool, typer.Option("--once", help="Take what is there as it is, then end.")] = False,
    no_diagnosis: Annotated[
        bool, typer.Option("--no-diagnosis", help="Fit alone: seconds after each log in place of minutes.")
    ] = False,
    output: Annotated[
        Path, typer.Option("--output", "-o", metavar="FILE", help="Where the next run's command file goes.")
    ] = Path("plan.csv"),
    interval: Annotated[float, typer.Option(metavar="S", min=0.05, help="Between two looks, in s.")] = 2.0,
    whole: Annotated[
        float, typer.Option(metavar="S", min=0.0, help="How long a log has to stay as it is to be read, in s.")
    ] = 5.0,
    cut: Annotated[
        float, typer.Option(metavar="S", min=0.0, help="The same of one that has no end, or cannot be read, in s.")
    ] = 60.0,
    axis: AxisName = None,
    parameters: ParameterFile = None,
    cutoff: Cutoff = None,
    force: Force = False,
    json: Annotated[
        bool, typer.Option("--json", help="Print one JSON document a line on standard output, and nothing else there.")
    ] = False,
) -> None:
    """Follow a trial day: after each log what it added and what to run next."""
    compile_beside()
    from rovid.core.atomic_write import OutputFile
    from rovid.core.signatures import PLAN
    from rovid.design.experiment_design import command_csv
    from rovid.present.documents.watch import watch_documents, watch_start_document
    from rovid.present.terminal.watch import show_watch_event, show_watch_start
    from rovid.watch.folder_monitor import FolderMonitor, Problem, SettleTimes
    from rovid.watch.session import SessionActions, WatchSession
    from rovid.watch.stop_criteria import parse_criteria

    if folder.is_file():
        raise ConfigError("is a file; a folder was expected.", where=folder, mend="Give the folder of the logs.")
    stored = stored_at(parameters, axis, force=force)
    wanted = parse_criteria(until, stored.axis, diagnosed=not no_diagnosis) if until else ()
    commands = OutputFile(output, PLAN)
    claim = claim_of([stored.output, commands], [folder], force=force)

    def keep(study: Study, estimate: Estimate) -> None:
        put(stored, claim, study, estimate, for_good=False)

    def write(plan: ExperimentPlan) -> Path:
        claim.write({commands: command_csv(plan)})
        return output

    troubles: list[str] = []

    def show(event: Event) -> None:
        if isinstance(event, Problem):
            troubles.append(f"{event.where}: {event.text}")
        if json:
            for document in watch_documents(event):
                _print_line(document)
        else:
            show_watch_event(console(), event, at=None if once else datetime.now().astimezone())

    with _progress() as progress:
        day = WatchSession(
            FolderMonitor(path=folder, axis=stored.axis, patience=SettleTimes(whole=whole, cut=cut), once=once),
            SessionActions(
                diagnose=None if no_diagnosis else lambda study, report: diagnosed(stored, study, report),
                keep=keep,
                write=write,
                cutoff=cutoff,
            ),
            wanted,
            interval=interval,
            report=progress.say,
        )
        if json:
            _print_line(watch_start_document(folder, wanted))
        else:
            show_watch_start(console(), folder, wanted, interval, once=once)
        with _ended() as ended:
            for event in day.events():
                with progress.aside():
                    show(event)
        if ended:
            with progress.aside():
                show(day.ended("interrupted"))
    if once and not day.ended("once").logs:
        raise LogError(troubles[-1] if troubles else "holds no logs.", where="" if troubles else folder)


def _print_line(document: Document) -> None:
    """For whoever reads along: at once."""
    from rovid.core.formatting import to_json_line

    typer.echo(to_json_line(document))
    sys.stdout.flush()


@contextmanager
def _ended() -> Iterator[list[str]]:
    """Whether Ctrl-C, or whoever asks a process to end, ended what is done here."""
    ended: list[str] = []
    before = signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        yield ended
    except KeyboardInterrupt:
        ended.append("interrupted")
    finally:
        signal.signal(signal.SIGTERM, before)


class _Progress:
    """What is being done, on a terminal, in a line of its own below what was printed."""

    def __init__(self, status: Status | None) -> None:
        self._status = status

    def say(self, words: str) -> None:
        """It is this now."""
        if self._status is not None:
            self._status.update(words)

    @contextmanager
    def aside(self) -> Iterator[None]:
        """Out of the way while something is printed."""
        if self._status is not None:
            self._status.stop()
        yield
        if self._status is not None:
            self._status.start()


@contextmanager
def _progress() -> Iterator[_Progress]:
    if not sys.stderr.isatty():
        yield _Progress(None)
        return
    from rovid.core.console import SafeConsole

    with SafeConsole(stderr=True).status("Looking …") as status:
        yield _Progress(status)
