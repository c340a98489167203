"""``rovid simulate``."""

from pathlib import Path

from rovid.cli import context
from rovid.cli.options import add_effects
from rovid.cli.streams import progress
from rovid.core.errors import DataError


def simulate(
    logs: list[Path] | None = None,
    *,
    axis: str | None = None,
    axes: str | None = None,
    parameters: Path | None = None,
    cutoff: float | None = None,
    mcap: Path | None = None,
    force: bool = False,
    effects_from: list[Path] | None = None,
    json: bool = False,
) -> None:
    """Simulate the runs and compare with the logs."""
    add_effects(effects_from)
    from rovid.present.console import show_caution, show_faults, show_warnings
    from rovid.trial.fault import fault_texts

    if context.is_planar(axes, axis, cutoff=cutoff, mcap=mcap):
        from rovid.planar.standard_manoeuvres import run_manoeuvres
        from rovid.present.documents.planar import planar_simulation_document
        from rovid.present.terminal.planar import show_planar_simulation

        stored = context.existing_parameters(parameters, planar=True)
        coupled = context.open_planar_logs(logs or context.stored_logs(stored))
        remarks, assumptions = (
            context.require_fresh(stored, coupled.logs),
            context.model_assumptions(stored, coupled.logs),
        )
        planar_model = coupled.model(stored)
        with progress("Simulating …"):
            motions = coupled.simulate(planar_model)
        warnings = [*fault_texts(coupled.logs.faults), *coupled.remarks(), *remarks]
        if json:
            found = run_manoeuvres(planar_model, coupled.data)
            context.print_json(planar_simulation_document(stored, motions, warnings, assumptions, found))
        else:
            show_planar_simulation(context.console(), motions, assumptions, warnings)
        return
    from rovid.model.simulation import simulate_runs
    from rovid.present.documents.results import simulation_document
    from rovid.present.mcap_output import recording_outputs, write_recordings
    from rovid.present.tables.trials import simulation_table

    stored = context.existing_parameters(parameters, axis)
    model = stored.model()
    study = context.open_logs(logs or context.stored_logs(stored), cutoff, stored.axis)
    if study.campaign is None or study.runs is None:
        raise DataError("are tables; only logs can be simulated.", where="LOGS", mend="Give LOGS.")
    study.require_effects(model.effects)
    remarks, assumptions = context.require_fresh(stored, study), context.model_assumptions(stored, study)
    recordings = recording_outputs(mcap, [run.trial for run in study.runs.items]) if mcap else []
    outputs = context.reserve_outputs(recordings, study.paths, stored.path, force=force)
    with progress("Simulating …"):
        simulations = simulate_runs(study.runs.items, model, study.vehicle)
        if recordings:
            write_recordings(outputs, recordings, simulations, study.runs, model, study.vehicle)
    warnings = [*study.remarks(), *remarks]
    if json:
        warnings = [*fault_texts(study.faults), *warnings]
        document = simulation_document(stored, simulations, warnings, assumptions)
        context.print_json(document | {"recordings": [str(recording.path) for recording in recordings]})
    else:
        show_caution(context.console(), assumptions)
        show_faults(context.console(), study.faults)
        simulation_table(simulations).print(context.console(), assumptions)
        show_warnings(context.console(), warnings)
