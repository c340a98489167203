"""``rovid simulate``."""

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

from rovid.cli.context import (
    console,
    existing_parameters,
    model_assumptions,
    open_logs,
    print_json,
    require_fresh,
    reserve_outputs,
    stored_logs,
)
from rovid.cli.options import (
    Axes,
    AxisName,
    Cutoff,
    EffectsFrom,
    Force,
    Json,
    OptionalLogs,
    ParameterFile,
    add_effects,
    option,
)
from rovid.cli.planar_session import is_planar, planar_logs, planar_parameters
from rovid.cli.streams import progress
from rovid.core.errors import DataError


def simulate(
    logs: OptionalLogs = None,
    *,
    axis: AxisName = None,
    axes: Axes = None,
    parameters: ParameterFile = None,
    cutoff: Cutoff = None,
    mcap: Annotated[
        Path | None,
        option("OUT", "Write measurement, simulation and residual as MCAP: a file for one run, else a folder."),
    ] = None,
    force: Force = False,
    effects_from: EffectsFrom = None,
    json: Json = False,
) -> None:
    """Simulate the runs and compare with the logs."""
    add_effects(effects_from)
    if is_planar(axes, axis, cutoff=cutoff, mcap=mcap):
        _simulate_planar(logs, parameters, json=json)
        return
    from rovid.model.simulation import simulate_runs
    from rovid.present.console import show_caution, show_faults, show_warnings
    from rovid.present.documents.results import simulation_document
    from rovid.present.mcap_output import recording_outputs, write_recordings
    from rovid.present.tables.trials import simulation_table
    from rovid.trial.fault import fault_texts

    stored = existing_parameters(parameters, axis)
    model = stored.model()
    study = open_logs(logs or stored_logs(stored), cutoff, stored.axis)
    if study.campaign is None or study.runs is None:
        raise DataError("are tables; only logs can be simulated.", where="LOGS", mend="Give LOGS.")
    study.require_effects(model.effects)
    remarks = require_fresh(stored, study)
    recordings = recording_outputs(mcap, [run.trial for run in study.runs.items]) if mcap else []
    outputs = reserve_outputs(recordings, study.paths, stored.path, force=force)
    with progress("Simulating …"):
        simulations = simulate_runs(study.runs.items, model, study.vehicle)
        if recordings:
            write_recordings(outputs, recordings, simulations, study.runs, model, study.vehicle)
    warnings, assumptions = [*study.remarks(), *remarks], model_assumptions(stored, study)
    if json:
        warnings = [*fault_texts(study.faults), *warnings]
        document = simulation_document(stored, simulations, warnings, assumptions)
        print_json(document | {"recordings": [str(recording.path) for recording in recordings]})
    else:
        show_caution(console(), assumptions)
        show_faults(console(), study.faults)
        simulation_table(simulations).print(console(), assumptions)
        show_warnings(console(), warnings)


def _simulate_planar(logs: Sequence[Path] | None, parameters: Path | None, *, json: bool) -> None:
    """Simulate surge, sway and yaw together."""
    from rovid.planar.standard_manoeuvres import run_manoeuvres
    from rovid.present.documents.planar import planar_simulation_document
    from rovid.present.terminal.planar import show_planar_simulation
    from rovid.store.planar_study import open_planar_study
    from rovid.trial.fault import fault_texts

    stored = planar_parameters(parameters)
    study = open_planar_study(logs or planar_logs(stored))
    remarks, assumptions = require_fresh(stored, study.logs), model_assumptions(stored, study.logs)
    model = study.model(stored)
    with progress("Simulating …"):
        simulations = study.simulate(model)
    warnings = [*fault_texts(study.logs.faults), *study.remarks(), *remarks]
    if json:
        found = run_manoeuvres(model, study.data)
        print_json(planar_simulation_document(stored, simulations, warnings, assumptions, found))
    else:
        show_planar_simulation(console(), simulations, assumptions, warnings)
