"""Logs and whole campaigns: ``rovid init``, ``check``, ``convert``, ``compare``, ``fleet`` and ``watch``."""

from __future__ import annotations

import signal
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, nullcontext
from datetime import datetime
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from rovid.cli import context
from rovid.cli.context import compile_in_background, console, parameters_at, reserve_outputs
from rovid.cli.options import SharedOptions
from rovid.cli.sessions import diagnose_study, store_estimate
from rovid.cli.streams import progress
from rovid.core.errors import LINE_LENGTH, ConfigError, DataError, LogError, display_text, shortened_list

if TYPE_CHECKING:
    from rich.status import Status

    from rovid.compare.campaign_fit import CampaignFit
    from rovid.estimate.estimate import Estimate
    from rovid.estimate.experiment_design import ExperimentPlan
    from rovid.present.documents.fits import Document
    from rovid.store.study import Study
    from rovid.store.watch_session import Event, StopCriterion
    from rovid.trial.axis import Axis


def init(
    logs: list[Path],
    *,
    vehicle: str | None = None,
    heading: str | None = None,
    command: str | None = None,
    shared: SharedOptions,
) -> None:
    """Write a first rovid.toml for your logs."""
    from rovid.core.output_files import OutputSet
    from rovid.preflight.config_writer import write_config
    from rovid.preflight.log_survey import SurveyOptions, config_output, survey
    from rovid.present.documents.results import survey_document
    from rovid.present.terminal.check import show_survey

    planar = context.is_planar(shared)
    # An existing file is an error before the logs are read.
    OutputSet([config_output(logs)], force=shared.force)
    commands = tuple(part.strip() for part in (command or "").split(",") if part.strip())
    headings = (heading,) if heading else ()
    options = SurveyOptions(
        axis=context.named_axis(shared.axis), headings=headings, commands=commands, vehicle=vehicle or "", planar=planar
    )
    found, written = write_config(survey(logs, options), logs, force=shared.force)
    context.print_either(survey_document(found, written), show_survey, found, written, json=shared.json)


def check(logs: list[Path], *, shared: SharedOptions) -> None:
    """Check the logs and list their content and problems."""
    planar = context.is_planar(shared)
    from rovid.api.records import check_record
    from rovid.preflight.check import check_logs
    from rovid.preflight.planar_check import check_planar
    from rovid.store.planar_study import planar_prior
    from rovid.trial.axis import PLANAR
    from rovid.trial.config import find_config, load_config
    from rovid.trial.tables import SINE_COLUMNS, STEADY_COLUMNS, find_table

    if table := find_table(logs, STEADY_COLUMNS) or find_table(logs, SINE_COLUMNS):
        text = "is a table of steady turns or of sines. Tables need no heading and no [signals]; only logs are checked."
        raise DataError(text, where=table, mend="Go on with `rovid fit-drag` or `rovid diagnose` and the same folder.")
    if not planar:
        context.announce_compilation()
    config = load_config(find_config(logs), PLANAR if planar else context.named_axis(shared.axis))
    if planar:
        planar_prior(config)  # A wrong prior is refused before the fit.
    checked = (check_planar if planar else check_logs)(logs, config)
    context.print_record(check_record(checked, config.vehicle), json=shared.json)
    if problems := checked.problems:
        name, problem = next(iter(problems.items()))
        count = f"{len(problems)} of {len(problems) + len(checked.trials)} logs cannot be used"
        if sys.stdout.isatty() and sys.stderr.isatty():
            # The numbered list is on the same screen, and has the reason.
            raise DataError(f"{count}: {shortened_list(problems)}.")
        lead = f"{count}. " if name in problem else f"{name}: "
        raise DataError(f"{lead}{problem}")


def convert(log: Path, *, output: Path, shared: SharedOptions) -> None:
    """Convert a log to another format."""
    from rovid.readers.convert import convert as convert_log
    from rovid.readers.convert import output_at
    from rovid.trial.config import find_config, load_config

    target = output_at(output, log)
    config = load_config(find_config([log]), context.named_axis(shared.axis))
    outputs = context.reserve_outputs([target], [config.path.parent, log], force=shared.force)
    converted = convert_log(log, config, output)
    outputs.write({target: converted.content})
    remarks = [remark.text for remark in converted.trial.remarks]
    if shared.json:
        document = {"schema": "rovid-convert/1", "file": str(output), "configuration": converted.mapping}
        context.print_json(document | {"warnings": remarks})
    else:
        typer.echo(converted.mapping, nl=False)
        sys.stderr.writelines(f"Note: {display_text(text, LINE_LENGTH)}\n" for text in remarks)


def compare(
    campaigns: list[Path] | None = None, *, output: Path | None = None, matters: float = 10.0, shared: SharedOptions
) -> None:
    """Find what changed between two campaigns."""
    given = campaigns or []
    if len(given) > 2:
        text = f"{len(given)} campaigns were given; at most two were expected."
        raise ConfigError(text, mend="Give each campaign's folder, not its single logs.")
    if context.is_planar(shared, output=output):
        _compare_planar(given, shared, matters / 100.0)
        return
    context.compile_in_background()
    from rovid.compare.comparison import compare as compare_campaigns
    from rovid.present.documents.diagnosis import comparison_document
    from rovid.present.terminal.diagnosis import show_comparison
    from rovid.store.load import history_output

    current = context.parameters_at(shared).path
    pages = []
    if output is not None:
        from rovid.core.output_files import COMPARISON, OutputFile
        from rovid.present.page.render import write_comparison

        pages = [OutputFile(output, COMPARISON)]
    protected = [path for path in given if path.exists()]
    outputs = context.reserve_outputs(pages, protected, current, history_output(current).path, force=shared.force)
    with progress("Reading …") as report:
        (a, b), notes = _campaigns(given, shared)
        comparison = compare_campaigns(a, b, relevant_change=matters / 100.0, report=report, budget=shared.budget)
        assumptions = comparison.a.assumptions | comparison.b.assumptions
        for page in pages:
            report("Drawing and writing the page …")
            write_comparison(outputs, page, comparison, assumptions, notes)
    document = comparison_document(comparison, assumptions, notes)
    if output is not None:
        document["page"] = str(output)
    context.print_either(document, show_comparison, comparison, assumptions, notes, output, json=shared.json)


def _campaigns(given: list[Path], shared: SharedOptions) -> tuple[tuple[CampaignFit, CampaignFit], list[str]]:
    """Campaigns A and B, with remarks on the parameter file."""
    from rovid.compare.campaign_fit import campaign_from_file, previous_campaign

    if len(given) == 2:
        names = [path.resolve().name for path in given]
        if names[0] == names[1]:
            names = list(map(str, given))
        axis = context.named_axis(shared.axis)
        a, b = (_campaign([path], name, axis, shared.cutoff) for path, name in zip(given, names, strict=True))
        return (a, b), []
    stored, cutoff = context.existing_parameters(shared), shared.cutoff
    notes = context.require_fresh(stored, None)
    if given and not _is_parameter_file(given[0]):
        logs = context.stored_logs(stored)
        a = _campaign(given, given[0].resolve().name, stored.axis, cutoff)
        return (a, _campaign(logs, ", ".join(path.name for path in logs), stored.axis, cutoff)), notes
    a = campaign_from_file(given[0], str(given[0])) if given else previous_campaign(stored)
    return (a, campaign_from_file(stored.path, str(stored.path))), notes


def _campaign(paths: list[Path], name: str, axis: Axis, cutoff: float | None) -> CampaignFit:
    """The campaign of a parameter file or of logs."""
    from rovid.compare.campaign_fit import campaign_from_file, campaign_from_study

    if _is_parameter_file(paths[0]):
        return campaign_from_file(paths[0], name)
    return campaign_from_study(context.open_logs(paths, cutoff, axis), name)


def _is_parameter_file(path: Path) -> bool:
    from rovid.core.output_files import PARAMETERS

    return path.is_file() and (path.suffix == ".toml" or PARAMETERS.matches(path))


def _compare_planar(given: list[Path], shared: SharedOptions, matters: float) -> None:
    if not given:
        raise ConfigError("no campaign was given.", mend="Give one or two folders of logs or parameter files.")
    from rovid.compare.comparison import compare_planar, planar_campaigns
    from rovid.present.documents.diagnosis import planar_comparison_document
    from rovid.present.terminal.diagnosis import show_planar_comparison

    notes: list[str] = []
    if len(given) == 1:
        stored = context.existing_parameters(shared, planar=True)
        given, notes = [*given, stored.path], context.require_fresh(stored, None)
    with progress("Reading …") as report:
        a, b = planar_campaigns((given[0], given[1]), report, shared.budget)
        comparison = compare_planar(a, b, relevant_change=matters)
    notes = [*notes, *(f"{clause[0].upper()}{clause[1:]}." for clause in comparison.open_questions)]
    document = planar_comparison_document(comparison, notes)
    context.print_either(document, show_planar_comparison, comparison, notes, json=shared.json)


def fleet(
    folders: list[Path],
    *,
    output: Path,
    jobs: int | None = None,
    cluster: str = "",
    timeout: float = 3600.0,
    shrink: bool = False,
    shared: SharedOptions,
) -> None:
    """Diagnose many campaigns and summarise them."""
    from rovid.fleet.run import FleetOptions, fleet_document, run_fleet, show_fleet

    options = FleetOptions(
        axis=context.named_axis(shared.axis).name,
        cutoff=shared.cutoff,
        jobs=jobs,
        cluster=cluster,
        patience=timeout,
        shrink=shrink,
    )
    with progress("Looking for campaigns …") as report:
        result = run_fleet(folders, output, options, force=shared.force, report=report)
    context.print_either(fleet_document(result), show_fleet, result, json=shared.json)


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
    shared: SharedOptions,
) -> None:
    """Follow a trial day: results after each log, and the next run."""
    compile_in_background()
    from rovid.core.formatting import SafeConsole
    from rovid.core.output_files import PLAN, OutputFile
    from rovid.estimate.experiment_design import command_csv
    from rovid.store.folder_monitor import FolderMonitor, Problem
    from rovid.store.watch_session import SessionActions, WatchSession, parse_criteria

    if folder.is_file():
        raise ConfigError("is a file; a folder was expected.", where=folder, mend="Give the folder of the logs.")
    stored = parameters_at(shared, force=shared.force)
    criteria = parse_criteria(until, stored.axis, diagnosed=not no_diagnosis) if until else ()
    commands = OutputFile(output, PLAN)
    outputs = reserve_outputs([stored.output, commands], [folder], force=shared.force)

    def keep(study: Study, estimate: Estimate) -> None:
        store_estimate(stored, outputs, study, estimate, with_history=False)

    def write(plan: ExperimentPlan) -> Path:
        outputs.write({commands: command_csv(plan)})
        return output

    diagnose = None if no_diagnosis else partial(diagnose_study, stored, budget=shared.budget)
    actions = SessionActions(diagnose=diagnose, keep=keep, write=write, cutoff=shared.cutoff)
    monitor = FolderMonitor(path=folder, axis=stored.axis, settled=whole, abandoned=cut, once=once)
    problems: list[str] = []
    # On a terminal the progress line stays below the printed text.
    with SafeConsole(stderr=True).status("Looking …") if sys.stderr.isatty() else nullcontext() as status:
        report = (lambda _: None) if status is None else status.update
        session = WatchSession(monitor, actions, criteria, interval=interval, report=report)
        show = _printer(folder, criteria, interval, once=once, json=shared.json)
        interrupted, previous = False, signal.signal(signal.SIGTERM, signal.default_int_handler)
        try:
            for event in session.events():
                if isinstance(event, Problem):
                    problems.append(f"{event.where}: {event.text}")
                with _paused(status):
                    show(event)
        except KeyboardInterrupt:
            interrupted = True
        finally:
            signal.signal(signal.SIGTERM, previous)
        if interrupted:
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
def _paused(status: Status | None) -> Iterator[None]:
    """Remove the progress line while something is printed."""
    if status is not None:
        status.stop()
    yield
    if status is not None:
        status.start()
