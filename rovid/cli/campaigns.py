"""``rovid compare`` and ``rovid fleet``: several campaigns."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from rovid.cli import context
from rovid.cli.streams import progress
from rovid.core.errors import ConfigError

if TYPE_CHECKING:
    from rovid.compare.campaign_fit import CampaignFit
    from rovid.trial.axis import Axis


def compare(
    campaigns: list[Path] | None = None,
    *,
    axis: str | None = None,
    axes: str | None = None,
    parameters: Path | None = None,
    output: Path | None = None,
    matters: float = 10.0,
    cutoff: float | None = None,
    force: bool = False,
    json: bool = False,
) -> None:
    """Find what changed between two campaigns."""
    given = campaigns or []
    if len(given) > 2:
        raise ConfigError(
            f"{len(given)} campaigns were given; at most two were expected.",
            mend="Give each campaign's folder, not its single logs.",
        )
    if context.is_planar(axes, axis, cutoff=cutoff, output=output):
        _compare_planar(given, parameters, matters / 100.0, json=json)
        return
    context.compile_in_background()
    from rovid.compare.comparison import compare as compare_campaigns
    from rovid.present.documents.diagnosis import comparison_document
    from rovid.present.terminal.diagnosis import show_comparison
    from rovid.store.load import history_output

    current = context.parameters_at(parameters, axis).path
    pages = []
    if output is not None:
        from rovid.core.output_files import COMPARISON, OutputFile
        from rovid.present.page.render import write_comparison

        pages = [OutputFile(output, COMPARISON)]
    protected = [path for path in given if path.exists()]
    outputs = context.reserve_outputs(pages, protected, current, history_output(current).path, force=force)
    with progress("Reading …") as report:
        (a, b), notes = _campaigns(given, parameters, axis, cutoff)
        comparison = compare_campaigns(a, b, relevant_change=matters / 100.0, report=report)
        assumptions = comparison.a.assumptions | comparison.b.assumptions
        for page in pages:
            report("Drawing and writing the page …")
            write_comparison(outputs, page, comparison, assumptions, notes)
    if json:
        document = comparison_document(comparison, assumptions, notes)
        for page in pages:
            document["page"] = str(page.path)
        context.print_json(document)
        return
    show_comparison(context.console(), comparison, assumptions, notes)
    for page in pages:
        context.console().print(str(page.path), highlight=False, soft_wrap=True)


def _campaigns(
    given: list[Path], parameters: Path | None, axis: str | None, cutoff: float | None
) -> tuple[tuple[CampaignFit, CampaignFit], list[str]]:
    """Campaigns A and B, with remarks on the parameter file."""
    from rovid.compare.campaign_fit import campaign_from_file, previous_campaign

    if len(given) == 2:
        names = [path.resolve().name for path in given]
        if names[0] == names[1]:
            names = list(map(str, given))
        a, b = (
            _campaign([path], name, context.named_axis(axis), cutoff) for path, name in zip(given, names, strict=True)
        )
        return (a, b), []
    stored = context.existing_parameters(parameters, axis)
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


def _compare_planar(given: list[Path], parameters: Path | None, matters: float, *, json: bool) -> None:
    """Compare two campaigns by the coupled model."""
    if not given:
        raise ConfigError("no campaign was given.", mend="Give one or two folders of logs or parameter files.")
    from rovid.compare.comparison import compare_planar, planar_campaigns
    from rovid.present.documents.planar import planar_comparison_document
    from rovid.present.terminal.planar import show_planar_comparison

    notes: list[str] = []
    if len(given) == 1:
        stored = context.existing_parameters(parameters, planar=True)
        given, notes = [*given, stored.path], context.require_fresh(stored, None)
    with progress("Reading …") as report:
        a, b = planar_campaigns((given[0], given[1]), report)
        comparison = compare_planar(a, b, relevant_change=matters)
    if json:
        context.print_json(planar_comparison_document(comparison, notes))
    else:
        show_planar_comparison(context.console(), comparison, notes)


def fleet(
    folders: list[Path],
    *,
    output: Path,
    jobs: int | None = None,
    cluster: str = "",
    timeout: float = 3600.0,
    shrink: bool = False,
    axis: str | None = None,
    cutoff: float | None = None,
    force: bool = False,
    json: bool = False,
) -> None:
    """Diagnose many campaigns and summarise them."""
    from rovid.fleet.run import FleetOptions, fleet_document, run_fleet, show_fleet

    options = FleetOptions(
        axis=context.named_axis(axis).name, cutoff=cutoff, jobs=jobs, cluster=cluster, patience=timeout, shrink=shrink
    )
    with progress("Looking for campaigns …") as report:
        result = run_fleet(folders, output, options, force=force, report=report)
    if json:
        context.print_json(fleet_document(result))
    else:
        show_fleet(context.console(), result)
