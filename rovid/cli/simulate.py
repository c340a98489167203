"""``rovid simulate``."""

from pathlib import Path
from typing import Annotated

from rovid.cli.context import (
    console,
    existing_parameters,
    is_planar,
    model_assumptions,
    open_logs,
    open_planar_logs,
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
    from rovid.present.console import show_caution, show_faults, show_warnings
    from rovid.trial.fault import fault_texts

    if is_planar(axes, axis, cutoff=cutoff, mcap=mcap):
        from rovid.planar.standard_manoeuvres import run_manoeuvres
        from rovid.present.documents.planar import planar_simulation_document
        from rovid.present.terminal.planar import show_planar_simulation

        stored = existing_parameters(parameters, planar=True)
        coupled = open_planar_logs(logs or stored_logs(stored))
        remarks, assumptions = require_fresh(stored, coupled.logs), model_assumptions(stored, coupled.logs)
        planar_model = coupled.model(stored)
        with progress("Simulating …"):
            motions = coupled.simulate(planar_model)
        warnings = [*fault_texts(coupled.logs.faults), *coupled.remarks(), *remarks]
        if json:
            found = run_manoeuvres(planar_model, coupled.data)
            print_json(planar_simulation_document(stored, motions, warnings, assumptions, found))
        else:
            show_planar_simulation(console(), motions, assumptions, warnings)
        return
    from rovid.model.simulation import simulate_runs
    from rovid.present.documents.results import simulation_document
    from rovid.present.mcap_output import recording_outputs, write_recordings
    from rovid.present.tables.trials import simulation_table

    stored = existing_parameters(parameters, axis)
    model = stored.model()
    study = open_logs(logs or stored_logs(stored), cutoff, stored.axis)
    if study.campaign is None or study.runs is None:
        raise DataError("are tables; only logs can be simulated.", where="LOGS", mend="Give LOGS.")
    study.require_effects(model.effects)
    remarks, assumptions = require_fresh(stored, study), model_assumptions(stored, study)
    recordings = recording_outputs(mcap, [run.trial for run in study.runs.items]) if mcap else []
    outputs = reserve_outputs(recordings, study.paths, stored.path, force=force)
    with progress("Simulating …"):
        simulations = simulate_runs(study.runs.items, model, study.vehicle)
        if recordings:
            write_recordings(outputs, recordings, simulations, study.runs, model, study.vehicle)
    warnings = [*study.remarks(), *remarks]
    if json:
        warnings = [*fault_texts(study.faults), *warnings]
        document = simulation_document(stored, simulations, warnings, assumptions)
        print_json(document | {"recordings": [str(recording.path) for recording in recordings]})
    else:
        show_caution(console(), assumptions)
        show_faults(console(), study.faults)
        simulation_table(simulations).print(console(), assumptions)
        show_warnings(console(), warnings)
