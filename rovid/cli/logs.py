"""``rovid init``, ``rovid check`` and ``rovid convert``: the logs before any fit."""

from __future__ import annotations

import sys
from pathlib import Path

import typer

from rovid.cli import context
from rovid.cli.options import SharedOptions
from rovid.core.errors import LINE_LENGTH, DataError, display_text, shortened_list


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
    if shared.json:
        context.print_json(survey_document(found, written))
    else:
        show_survey(context.console(), found, written)


def check(logs: list[Path], *, shared: SharedOptions) -> None:
    """Check the logs and list their content and problems."""
    planar = context.is_planar(shared)
    from rovid.api.records import check_record
    from rovid.trial.config import find_config, load_config, load_planar_config
    from rovid.trial.tables import SINE_COLUMNS, STEADY_COLUMNS, find_table

    if table := find_table(logs, STEADY_COLUMNS) or find_table(logs, SINE_COLUMNS):
        text = "is a table of steady turns or of sines. Tables need no heading and no [signals]; only logs are checked."
        raise DataError(text, where=table, mend="Go on with `rovid fit-drag` or `rovid diagnose` and the same folder.")
    if planar:
        from rovid.preflight.planar_check import check_planar
        from rovid.store.planar_study import planar_prior

        config = load_planar_config(find_config(logs))
        planar_prior(config)  # A wrong prior is refused before the fit.
        coupled = check_planar(logs, config)
        record, problems, usable = check_record(coupled, config.vehicle), coupled.problems, len(coupled.trials)
    else:
        from rovid.preflight.check import check_logs

        context.announce_compilation()
        config = load_config(find_config(logs), context.named_axis(shared.axis))
        checked = check_logs(logs, config)
        record, problems, usable = check_record(checked, config.vehicle), checked.problems, len(checked.rows)
    context.print_record(record, json=shared.json)
    if problems:
        name, problem = next(iter(problems.items()))
        count = f"{len(problems)} of {len(problems) + usable} logs cannot be used"
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
