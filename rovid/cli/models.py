"""``rovid simulate``, ``rovid control`` and ``rovid export``: uses of a fitted model."""

from dataclasses import replace
from pathlib import Path

from rovid.cli import context
from rovid.cli.options import SharedOptions
from rovid.cli.streams import progress
from rovid.core.errors import DataError


def simulate(logs: list[Path] | None = None, *, mcap: Path | None = None, shared: SharedOptions) -> None:
    """Simulate the runs and compare with the logs."""
    from rovid.present.console import show_caution, show_faults, show_warnings
    from rovid.trial.fault import fault_texts

    if context.is_planar(shared, mcap=mcap):
        from rovid.planar.standard_manoeuvres import run_manoeuvres
        from rovid.present.documents.planar import planar_simulation_document
        from rovid.present.terminal.planar import show_planar_simulation

        stored = context.existing_parameters(shared, planar=True)
        coupled = context.open_planar_logs(logs or context.stored_logs(stored))
        remarks = context.require_fresh(stored, coupled.logs)
        assumptions = context.model_assumptions(stored, coupled.logs)
        planar_model = coupled.model(stored)
        with progress("Simulating …"):
            motions = coupled.simulate(planar_model)
        warnings = [*fault_texts(coupled.logs.faults), *coupled.remarks(), *remarks]
        if shared.json:
            found = run_manoeuvres(planar_model, coupled.data)
            context.print_json(planar_simulation_document(stored, motions, warnings, assumptions, found))
        else:
            show_planar_simulation(context.console(), motions, assumptions, warnings)
        return
    from rovid.model.simulation import simulate_runs
    from rovid.present.documents.results import simulation_document
    from rovid.present.mcap_output import recording_outputs, write_recordings
    from rovid.present.tables.trials import simulation_table

    stored = context.existing_parameters(shared)
    model = stored.model()
    study = context.open_logs(logs or context.stored_logs(stored), shared.cutoff, stored.axis)
    if study.campaign is None or study.runs is None:
        raise DataError("are tables; only logs can be simulated.", where="LOGS", mend="Give LOGS.")
    study.require_effects(model.effects)
    remarks, assumptions = context.require_fresh(stored, study), context.model_assumptions(stored, study)
    recordings = recording_outputs(mcap, [run.trial for run in study.runs.items]) if mcap else []
    outputs = context.reserve_outputs(recordings, study.paths, stored.path, force=shared.force)
    with progress("Simulating …"):
        simulations = simulate_runs(study.runs.items, model, study.vehicle)
        if recordings:
            write_recordings(outputs, recordings, simulations, study.runs, model, study.vehicle)
    warnings = [*study.remarks(), *remarks]
    if shared.json:
        warnings = [*fault_texts(study.faults), *warnings]
        document = simulation_document(stored, simulations, warnings, assumptions)
        context.print_json(document | {"recordings": [str(recording.path) for recording in recordings]})
    else:
        show_caution(context.console(), assumptions)
        show_faults(context.console(), study.faults)
        simulation_table(simulations).print(context.console(), assumptions)
        show_warnings(context.console(), warnings)


def control(
    logs: list[Path] | None = None,
    *,
    kp: float | None = None,
    kd: float | None = None,
    damping: float = 0.7,
    bandwidth: float | None = None,
    period: float = 0.1,
    delay: float = 0.0,
    rate_filter: float | None = None,
    law: str = "model",
    step: list[str] | None = None,
    c: Path | None = None,
    python: Path | None = None,
    shared: SharedOptions,
) -> None:
    """Design a heading controller."""
    from rovid.control.control_law import ControlLaw, ControllerOptions, c_source, loop_conditions, python_source
    from rovid.control.design import design_controller
    from rovid.core.errors import ConfigError
    from rovid.core.output_files import C_SOURCE, PYTHON_SOURCE, OutputFile
    from rovid.present.console import show_caution, show_warnings
    from rovid.present.documents.results import control_document
    from rovid.present.terminal.diagnosis import show_control
    from rovid.trial.fault import fault_texts

    options = ControllerOptions(
        kp=kp,
        kd=kd,
        damping=damping,
        bandwidth=bandwidth,
        period=period,
        delay=delay,
        rate_filter=rate_filter,
        law=law,
        steps=tuple(step or ()),
    )
    if law != "model" and (c or python):
        raise ConfigError(f"is {law}; --c and --python write the model-aided law alone.", where="--law")
    stored = context.yaw_parameters(shared)
    model = stored.model()
    paths = logs or context.stored_logs(stored)
    generators = {}
    for path, signature, source in ((c, C_SOURCE, c_source), (python, PYTHON_SOURCE, python_source)):
        if path is not None:
            generators[OutputFile(path, signature)] = source
    outputs = context.reserve_outputs(list(generators), paths, stored.path, force=shared.force)
    study = context.open_logs(paths, None, stored.axis)
    study.vehicle.require_no_rudder("the controller")
    study.require_effects(model.effects)
    remarks, assumptions = context.require_usable(stored, study, force=shared.force)
    conditions = loop_conditions(options, model, study.position_noise(), study.median_torque())
    with progress("Simulating the closed loop …"):
        result = design_controller(stored, study.vehicle, conditions, options)
    if generators and isinstance(result.law, ControlLaw):
        outputs.write({output: source(result.law, assumptions) for output, source in generators.items()})
    warnings = [*fault_texts(study.faults), *study.remarks(), *remarks]
    if shared.json:
        context.print_json(control_document(result, warnings, assumptions))
    else:
        show_caution(context.console(), assumptions)
        show_control(context.console(), result, assumptions)
        show_warnings(context.console(), warnings)


def export(
    format: str,  # noqa: A002 - the word that the help shows
    *,
    output: Path | None = None,
    shared: SharedOptions,
) -> None:
    """Write the model in the format of a simulator."""
    planar = context.is_planar(shared)
    from rovid.export.interface import export_input
    from rovid.export.planar_input import planar_input
    from rovid.export.verification import select_exporter, verified_export
    from rovid.present.console import show_caution
    from rovid.present.documents.results import export_document
    from rovid.present.terminal.results import show_export

    exporter, target = select_exporter(format, output, planar=planar)
    if planar:
        stored = context.existing_parameters(shared, planar=True)
    else:
        stored = context.yaw_parameters(shared)
        stored.model()
    outputs = context.reserve_outputs([target], stored.logs, stored.path, force=shared.force)
    logs, coupled = None, None
    if stored.logs and all(path.exists() for path in stored.logs):
        if planar:
            coupled = context.open_planar_logs(stored.logs)
            logs = coupled.logs
        else:
            logs = context.open_logs(stored.logs, None, stored.axis)
            logs.vehicle.require_no_rudder("the format")
    remarks, assumptions = context.require_usable(stored, logs, force=shared.force)
    with progress("Simulating …"):
        subject = planar_input(stored, coupled) if planar else export_input(stored, logs)
        exported = verified_export(exporter, replace(subject, guess=assumptions))
    exported = replace(exported, warnings=(*exported.warnings, *remarks))
    outputs.write({target: exported.content})
    if shared.json:
        context.print_json(export_document(format, str(target.path), exported, assumptions))
    else:
        show_caution(context.console(), assumptions)
        show_export(context.console(), target.path, exported)
