"""``rovid simulate``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from rovid.cli.context import (
    busy,
    claim_of,
    console,
    guess_of,
    known_at,
    opened,
    print_json,
    remembered,
    require_holding,
)
from rovid.cli.help_format import Page
from rovid.cli.options import AxisName, Cutoff, Force, Json, OptionalLogs, ParameterFile
from rovid.core.errors import DataError

PAGE = Page(
    text="""
    Reads the parameter file and the logs. Simulates each run freely from its first sample, by the logged commands
    alone, and prints R^2, fit % and root mean square error of the rate, and the error of the heading after 10 s
    and 60 s. --mcap writes measurement, simulation and what is left over as recordings.

    Parameters that no longer hold, because rovid.toml, a thrust curve or a log has changed since, are refused.

    Use it to judge a model: a free simulation hides nothing. Give LOGS that the fit never saw for an honest test.
    """,
    examples=(
        ("Against the logs that the parameters came from", "rovid simulate"),
        (
            "Against one log, with a recording of it",
            "rovid simulate my_logs/steps.mcap --mcap simulated.mcap",
        ),
        ("With recordings of all runs, in a folder", "rovid simulate --mcap simulated"),
    ),
    see=("rovid diagnose", "rovid report", "rovid help logs"),
)


def simulate(
    logs: OptionalLogs = None,
    *,
    axis: AxisName = None,
    parameters: ParameterFile = None,
    cutoff: Cutoff = None,
    mcap: Annotated[
        Path | None,
        typer.Option(
            metavar="OUT",
            help="Write measurement, simulation and what is left over as MCAP: a file for one run, else a folder.",
            show_default=False,
        ),
    ] = None,
    force: Force = False,
    json: Json = False,
) -> None:
    """Simulate the runs and compare with the logs."""
    from rovid.model.simulation import simulate_runs
    from rovid.present.console import show_caution, show_warnings
    from rovid.present.documents.results import simulation_document
    from rovid.present.mcap_output import recording_outputs, write_recordings
    from rovid.present.terminal.results import show_simulation

    stored = known_at(parameters, axis)
    model = stored.model()
    study = opened(logs or remembered(stored), cutoff, stored.axis)
    if study.campaign is None or study.runs is None:
        raise DataError("are tables; only logs can be simulated.", where="LOGS", mend="Give LOGS.")
    study.require_effects(model.effects)
    remarks = require_holding(stored, study)
    outputs = recording_outputs(mcap, [run.trial for run in study.runs.items]) if mcap else []
    claim = claim_of(outputs, study.paths, stored.path, force=force)
    with busy("Simulating …"):
        simulations = simulate_runs(study.runs.items, model, study.vehicle)
        if outputs:
            write_recordings(claim, outputs, simulations, study.runs, model, study.vehicle)
    recordings = [output.path for output in outputs]
    warnings, guess = [*study.remarks(), *remarks], guess_of(stored, study)
    if json:
        print_json(
            simulation_document(stored, simulations, warnings, guess) | {"recordings": list(map(str, recordings))}
        )
    else:
        show_caution(console(), guess)
        show_simulation(console(), simulations, guess)
        show_warnings(console(), warnings)
