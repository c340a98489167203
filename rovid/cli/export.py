"""``rovid export``."""

from dataclasses import replace
from pathlib import Path

from rovid.cli import context
from rovid.cli.options import add_effects
from rovid.cli.streams import progress


def export(
    format: str,  # noqa: A002 - the word that the help shows
    *,
    output: Path | None = None,
    axes: str | None = None,
    parameters: Path | None = None,
    force: bool = False,
    effects_from: list[Path] | None = None,
    json: bool = False,
) -> None:
    """Write the model in the format of a simulator."""
    add_effects(effects_from)
    planar = context.is_planar(axes, None)
    from rovid.export.interface import export_input
    from rovid.export.planar_input import planar_input
    from rovid.export.run_export import select_exporter, verified_export
    from rovid.present.console import show_caution
    from rovid.present.documents.results import export_document
    from rovid.present.terminal.results import show_export

    exporter, target = select_exporter(format, output, planar=planar)
    if planar:
        stored = context.existing_parameters(parameters, planar=True)
    else:
        stored = context.yaw_parameters(parameters)
        stored.model()
    outputs = context.reserve_outputs([target], stored.logs, stored.path, force=force)
    logs, coupled = None, None
    if stored.logs and all(path.exists() for path in stored.logs):
        if planar:
            coupled = context.open_planar_logs(stored.logs)
            logs = coupled.logs
        else:
            logs = context.open_logs(stored.logs, None, stored.axis)
            logs.vehicle.require_no_rudder("the format")
    remarks, assumptions = context.require_usable(stored, logs, force=force)
    with progress("Simulating …"):
        subject = planar_input(stored, coupled) if planar else export_input(stored, logs)
        exported = verified_export(exporter, replace(subject, guess=assumptions))
    exported = replace(exported, warnings=(*exported.warnings, *remarks))
    outputs.write({target: exported.content})
    if json:
        context.print_json(export_document(format, str(target.path), exported, assumptions))
    else:
        show_caution(context.console(), assumptions)
        show_export(context.console(), target.path, exported)
