"""``rovid discover``."""

from pathlib import Path
from typing import Annotated

from rovid.cli.context import compile_in_background, console, named_axis, open_logs, print_json
from rovid.cli.options import AxisName, EffectsFrom, Force, Json, Logs, TimeBudget, add_effects, option
from rovid.cli.streams import progress
from rovid.core.errors import ConfigError


def discover(
    logs: Logs,
    *,
    write: Annotated[
        Path | None, option("FILE.py", "Write the best formula as an effect, which has the name of the file.")
    ] = None,
    plot: Annotated[Path | None, option("FILE.png", "Plot the best formula over the unexplained torque.")] = None,
    axis: AxisName = None,
    budget: TimeBudget = None,
    effects_from: EffectsFrom = None,
    force: Force = False,
    json: Json = False,
) -> None:
    """Find a formula that predicts the unexplained torque."""
    add_effects(effects_from)
    compile_in_background()
    from rovid.core.budget import Budget
    from rovid.core.output_files import EFFECT_FILE, OutputFile, OutputSet, png_signature
    from rovid.diagnose.formulas.discovery import discover as find_formulas
    from rovid.effects.plugins import is_id
    from rovid.present.console import print_path, show_caution, show_warnings
    from rovid.present.documents.results import discovery_document
    from rovid.present.terminal.diagnosis import show_discovery
    from rovid.store.study import input_files

    if write is not None and not (is_id(write.stem) and write.suffix == ".py"):
        mend = "Use lower-case letters, digits and _, as in my_law.py."
        raise ConfigError("is no name of an effect's file.", where=write, mend=mend)
    files = {"effect": (write, EFFECT_FILE), "plot": (plot, png_signature("formula"))}
    wanted = {name: OutputFile(path, signature) for name, (path, signature) in files.items() if path is not None}
    outputs = OutputSet([*wanted.values()], force=force, protected=input_files(logs))
    study = open_logs(logs, None, named_axis(axis))
    if study.runs is None:
        raise ConfigError("are tables; a formula is found in logs only.", where="LOGS", mend="Give logs.")
    if not force:
        study.require_sound()
    with progress("Discovering …") as report:
        found = find_formulas(study.runs, study.vehicle, report, Budget(seconds=budget or study.default_budget))
    if found.formulas and wanted:
        from rovid.present.plots.results import formula_picture

        best, contents = found.formulas[0], dict[OutputFile, str | bytes]()
        if write is not None:
            contents[wanted["effect"]] = found.source(best, write.stem, study.vehicle.axis.name)
        if plot is not None:
            contents[wanted["plot"]] = formula_picture(found, best, study.runs, study.vehicle)
        outputs.write(contents)
    warnings = [*study.remarks(), *found.warnings]
    written = {name: str(file.path) for name, file in wanted.items()} if found.formulas else {}
    if json:
        print_json(discovery_document(found, warnings) | written)
        return
    show_caution(console(), study.vehicle.assumptions)
    show_discovery(console(), found)
    show_warnings(console(), warnings)
    for path in written.values():
        print_path(console(), f"written to {path}")
