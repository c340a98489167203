"""``rovid export``."""

from dataclasses import replace
from pathlib import Path
from typing import Annotated

from rovid.cli import completion
from rovid.cli.context import console, open_logs, print_json, require_usable, reserve_outputs, yaw_parameters
from rovid.cli.options import Axes, EffectsFrom, ForceGuess, Json, ParameterFile, add_effects, argument, option
from rovid.cli.planar_session import is_planar, planar_parameters
from rovid.cli.streams import progress
from rovid.export import FORMATS


def export(
    format: Annotated[  # noqa: A002 - the word that the help shows
        str, argument("FORMAT", f"One of {', '.join(FORMATS)}.", autocompletion=completion.formats)
    ],
    *,
    output: Annotated[
        Path | None,
        option(
            "FILE",
            "The new file. Default: the name of the format, as gz_sim.sdf. uuv writes .xacro or .yaml.",
            "--output",
            "-o",
        ),
    ] = None,
    axes: Axes = None,
    parameters: ParameterFile = None,
    force: ForceGuess = False,
    effects_from: EffectsFrom = None,
    json: Json = False,
) -> None:
    """Write the model in the format of a simulator."""
    add_effects(effects_from)
    if is_planar(axes, None):
        _export_planar(format, output, parameters, force=force, json=json)
        return
    from rovid.export.interface import export_input
    from rovid.export.run_export import select_exporter, verified_export
    from rovid.present.console import show_caution
    from rovid.present.documents.results import export_document
    from rovid.present.terminal.results import show_export

    exporter, target = select_exporter(format, output)
    stored = yaw_parameters(parameters)
    stored.model()
    outputs = reserve_outputs([target], stored.logs, stored.path, force=force)
    study = None
    if stored.logs and all(path.exists() for path in stored.logs):
        study = open_logs(stored.logs, None, stored.axis)
        study.vehicle.require_no_rudder("the format")
    remarks, assumptions = require_usable(stored, study, force=force)
    with progress("Simulating …"):
        exported = verified_export(exporter, replace(export_input(stored, study), guess=assumptions))
    exported = replace(exported, warnings=(*exported.warnings, *remarks))
    outputs.write({target: exported.content})
    if json:
        print_json(export_document(format, str(target.path), exported, assumptions))
    else:
        show_caution(console(), assumptions)
        show_export(console(), target.path, exported)


def _export_planar(name: str, output: Path | None, parameters: Path | None, *, force: bool, json: bool) -> None:
    from rovid.export.planar_input import planar_input
    from rovid.export.run_export import select_planar_exporter, verified_planar_export
    from rovid.present.console import show_caution
    from rovid.present.documents.planar import planar_export_document
    from rovid.present.terminal.planar import show_planar_export
    from rovid.store.planar_study import open_planar_study

    exporter, target = select_planar_exporter(name, output)
    stored = planar_parameters(parameters)
    outputs = reserve_outputs([target], stored.logs, stored.path, force=force)
    study = None
    if stored.logs and all(path.exists() for path in stored.logs):
        study = open_planar_study(stored.logs)
    remarks, assumptions = require_usable(stored, None if study is None else study.logs, force=force)
    with progress("Simulating …"):
        exported = verified_planar_export(exporter, replace(planar_input(stored, study), guess=assumptions))
    exported = replace(exported, warnings=(*exported.warnings, *remarks))
    outputs.write({target: exported.content})
    if json:
        print_json(planar_export_document(name, str(target.path), exported, assumptions))
    else:
        show_caution(console(), assumptions)
        show_planar_export(console(), target.path, exported)
