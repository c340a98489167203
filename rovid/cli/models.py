"""``rovid simulate``, ``rovid plan``, ``rovid control`` and ``rovid export``: uses of a fitted model."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rovid.cli import context
from rovid.cli.options import SharedOptions
from rovid.cli.streams import progress
from rovid.core.errors import ConfigError, DataError, join_words

if TYPE_CHECKING:
    from rovid.effects import Effect
    from rovid.estimate.candidate_runs import RunLimits
    from rovid.store.parameter_file import Parameters
    from rovid.store.study import Study


def simulate(logs: list[Path] | None = None, *, mcap: Path | None = None, shared: SharedOptions) -> None:
    """Simulate the runs and compare with the logs."""
    planar = context.is_planar(shared, mcap=mcap)
    from rovid.api.records import simulation_record

    stored, document = context.existing_parameters(shared, planar=planar), dict[str, Any]()
    if planar:
        coupled = context.open_planar_logs(logs or context.stored_logs(stored))
        remarks = context.require_fresh(stored, coupled)
        with progress("Simulating …"):
            assumptions = context.model_assumptions(stored, coupled)
            record = simulation_record(stored, coupled, remarks, assumptions)
    else:
        from rovid.present.residuals import recording_outputs, write_recordings

        model = stored.model()
        study = context.open_logs(logs or context.stored_logs(stored), shared.cutoff, stored.axis)
        if study.runs is None:
            raise DataError("are tables; only logs can be simulated.", where="LOGS", mend="Give LOGS.")
        study.require_stored_effects(stored)
        remarks = context.require_fresh(stored, study)
        recordings = recording_outputs(mcap, [run.trial for run in study.runs.items]) if mcap else []
        outputs = context.reserve_outputs(recordings, study.paths, stored.path, force=shared.force)
        with progress("Simulating …"):
            record = simulation_record(stored, study, remarks, context.model_assumptions(stored, study))
            if recordings:
                write_recordings(outputs, recordings, record.simulations, study.runs, model, study.vehicle)
        document["recordings"] = [str(recording.path) for recording in recordings]
    context.print_record(record, json=shared.json, document=document)


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
    study.require_stored_effects(stored)
    remarks, assumptions = context.require_usable(stored, study, force=shared.force)
    conditions = loop_conditions(options, model, study.position_noise(), study.median_torque())
    with progress("Simulating the closed loop …"):
        result = design_controller(stored, study.vehicle, conditions, options)
    if generators and isinstance(result.law, ControlLaw):
        sources = {output: source(result.law, assumptions) for output, source in generators.items()}
        remarks += context.write_outputs(outputs, sources)
    warnings = [*fault_texts(study.faults), *study.remarks(), *remarks]
    document = control_document(result, warnings, assumptions)
    context.print_either(document, show_control, result, assumptions, warnings, json=shared.json)


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
    from rovid.present.documents.results import export_document
    from rovid.present.terminal.results import show_export

    exporter, target = select_exporter(format, output, planar=planar)
    stored = context.existing_parameters(shared, planar=True) if planar else context.yaw_parameters(shared)
    if not planar:
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
    remarks, assumptions = context.require_usable(stored, coupled or logs, force=shared.force)
    with progress("Simulating …"):
        subject = planar_input(stored, coupled) if planar else export_input(stored, logs)
        exported = verified_export(exporter, replace(subject, guess=assumptions))
    remarks += context.write_outputs(outputs, {target: exported.content})
    exported = replace(exported, warnings=(*exported.warnings, *remarks))
    document = export_document(format, str(target.path), exported, assumptions)
    context.print_either(document, show_export, target.path, exported, assumptions, json=shared.json)


def plan(
    logs: list[Path] | None = None,
    *,
    between: list[str] | None = None,
    narrow: str | None = None,
    effect: list[str] | None = None,
    share: float = 1.0,
    minutes: float = 10.0,
    max_rate: float | None = None,
    turns: float | None = None,
    design: bool = False,
    matrix: bool = False,
    output: Path = Path("plan.csv"),
    shared: SharedOptions,
) -> None:
    """Design the next run."""
    from rovid.core.output_files import PLAN, Content, OutputFile, png_signature
    from rovid.effects import effect_named
    from rovid.estimate.candidate_runs import RunLimits
    from rovid.estimate.experiment_design import command_csv
    from rovid.present.documents.results import plan_document
    from rovid.present.plots.results import plan_picture
    from rovid.present.terminal.results import show_plan

    def limits(*, angular: bool) -> RunLimits:
        """Limits of a run in SI units."""
        rate = math.inf if max_rate is None else max_rate
        if angular:
            rate = math.radians(rate)
        travel = math.inf if turns is None else turns
        return RunLimits(share=share, seconds=60.0 * minutes, rate=rate, travel=travel, design=design)

    if context.is_planar(shared, between=between):
        if matrix or design:
            where, text = "--matrix" if matrix else "--design", "is for one axis; it does not exist for --axes planar."
            raise ConfigError(text, where=where, mend="Leave it out.")
        _plan_planar(logs, shared, output, effect or (), limits(angular=True), narrow or "")
        return
    causes = tuple(dict.fromkeys(map(effect_named, between or ())))
    if matrix:
        if len(causes) == 1:
            raise ConfigError("names one cause; two or more were expected.", where="--between")
        _plan_matrix(logs, shared, causes, effect or (), share)
        return
    if len({cause.id for cause in causes}) not in {0, 2} or len(causes) > 2:
        raise ConfigError("expects two different causes.", where="--between", mend="Give it once for each of them.")
    stored = context.parameters_at(shared)
    paths = logs or context.stored_logs(stored)
    commands, picture = OutputFile(output, PLAN), OutputFile(output.with_suffix(".png"), png_signature("plan"))
    outputs = context.reserve_outputs([commands, picture], paths, stored.path, force=shared.force)
    study = context.open_logs(paths, None, stored.axis)
    if not shared.force:
        study.require_sound()
    effects = tuple(dict.fromkeys((*stored.effect_forms(), *map(effect_named, effect or ()))))
    with progress("Fitting, and comparing candidate runs …"):
        found = study.plan(effects, causes, limits(angular=stored.axis.angular), narrow or "")
    contents: dict[OutputFile, Content] = {commands: command_csv(found), picture: plan_picture(found, stored.axis)}
    warnings = [*context.write_outputs(outputs, contents), *_stale_effects(stored, study)]
    if not (effects or causes or stored.path.exists()):
        reason = "does not exist, so the run is planned for a model without causes"
        warnings.append(f"{stored.path} {reason}. Give the parameter file of a diagnosis with -p.")
    if hidden := [model.name for model in found.models if model.is_assumed]:
        text = "The runs are compared at the largest size that the logs leave open, three standard errors."
        warnings.append(f"These logs do not show {join_words(hidden)}. {text}")
    document = plan_document(found, study.vehicle, str(commands.path), str(picture.path), warnings)
    shown = found, [commands.path, picture.path], study.vehicle.assumptions, warnings
    context.print_either(document, show_plan, *shown, json=shared.json)


def _plan_matrix(
    logs: Sequence[Path] | None, shared: SharedOptions, causes: Sequence[Effect], effect: Sequence[str], share: float
) -> None:
    """Show which pairs of causes a programme separates: with the model of a fit, or without logs with an estimate."""
    from rovid.effects import effect_named
    from rovid.estimate.assumed_models import SizedCause, estimated_model, full_range_trial, split_causes, tested_causes
    from rovid.estimate.candidate_runs import standard_programme
    from rovid.estimate.experiment_design import candidate_model, require_thrusters
    from rovid.estimate.isolability import isolability
    from rovid.present.documents.results import estimated_model_sentence, matrix_document
    from rovid.present.terminal.results import show_matrix
    from rovid.readers.campaign import config_without_logs
    from rovid.trial.config import Config

    stored = context.parameters_at(shared)
    known, fitted = stored.effect_forms(), list[SizedCause]()
    config = None if stored.path.exists() else config_without_logs(logs or [Path()], stored.axis)
    if config and effect:
        text = "needs logs: without one the size of an effect cannot be fitted."
        raise ConfigError(text, where="--effect", mend="Name causes to compare with --between.")
    study = config or context.open_logs(logs or context.stored_logs(stored), None, stored.axis)
    vehicle = study.vehicle
    require_thrusters(vehicle)
    with progress("Fitting …") as report:
        if isinstance(study, Config):
            base = estimated_model(vehicle, integrated=study.measured_signal == study.axis.rate_signal)
            programme = [full_range_trial(vehicle, study.signals)]
        else:
            forms = tuple(dict.fromkeys((*known, *map(effect_named, effect))))
            base, fitted = split_causes(candidate_model(study.likelihood(forms), "the model"), known)
            assert study.campaign is not None  # noqa: S101 - tables were refused by the fit
            programme = list(study.campaign.trials)
        if config or not logs:
            programme = standard_programme(base.model, vehicle, programme, share)
        tested = tested_causes(base, fitted, causes, vehicle, programme)
        found = isolability(base, tested, vehicle, programme, report)
    warnings = [estimated_model_sentence(base.model)] if config else []
    document = matrix_document(found, vehicle, warnings)
    context.print_either(document, show_matrix, found, vehicle.assumptions, warnings, json=shared.json)


def _stale_effects(stored: Parameters, study: Study) -> list[str]:
    """A warning if the effects come from a parameter file that is out of date."""
    from rovid.store.checks import check_freshness

    reason = stored.effects and check_freshness(stored, study.provenance).reason
    return [f"{stored.path.name} is out of date: {reason}. Only the names of its effects were used."] if reason else []


def _plan_planar(
    logs: Sequence[Path] | None,
    shared: SharedOptions,
    output: Path,
    effect: Sequence[str],
    limits: RunLimits,
    narrow: str,
) -> None:
    from rovid.core.output_files import PLAN, OutputFile
    from rovid.estimate.experiment_design import command_csv
    from rovid.present.documents.results import planar_plan_document
    from rovid.present.terminal.results import show_planar_plan
    from rovid.store.planar_study import planar_effect

    stored = context.parameters_at(shared, planar=True)
    effects = list(map(planar_effect, dict.fromkeys((*stored.effects, *effect))))
    paths = logs or context.stored_logs(stored)
    commands = OutputFile(output, PLAN)
    outputs = context.reserve_outputs([commands], paths, stored.path, force=shared.force)
    study = context.open_planar_logs(paths)
    if not shared.force:
        study.logs.require_sound()
    with progress("Fitting, and comparing candidate runs …"):
        found = study.plan(effects, limits, narrow)
    replaced = context.write_outputs(outputs, {commands: command_csv(found.ranked)})
    warnings = [*replaced, *study.remarks(), *map(study.vehicle.assumptions.mark_sentence, found.warnings)]
    warnings += _stale_effects(stored, study.logs)
    document = planar_plan_document(found, study.vehicle, str(commands.path), warnings)
    context.print_either(document, show_planar_plan, found, study, [commands.path], warnings, json=shared.json)
