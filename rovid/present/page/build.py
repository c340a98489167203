"""From logs and a parameter file to the report."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TypeVar

from rovid.control.control_law import ControllerOptions, loop_conditions
from rovid.control.design import ControllerDesign, design_controller
from rovid.core.errors import DataError
from rovid.core.output_files import OutputSet
from rovid.estimate.estimate import Estimate
from rovid.export import FORMATS
from rovid.export.interface import export_input
from rovid.export.verification import VerifiedExport, load_exporter, verified_export
from rovid.model.model import Model
from rovid.model.simulation import simulate_runs
from rovid.present.documents.diagnosis import all_faults
from rovid.present.page.page_files import claim_page, write_pdf
from rovid.present.page.render import write_report
from rovid.present.report_data import ReportData, separations, simulate_nested_models
from rovid.store.checks import JOINT_METHODS, check_freshness
from rovid.store.load import history_output, update_parameters
from rovid.store.parameter_file import Parameters
from rovid.store.study import Study, input_files
from rovid.trial.axis import YAW

_T = TypeVar("_T")
_Report = Callable[[str], None]
# Parameters without which there is no simulation.
_NEEDED = {"inertia", "quadratic_drag"}
_DIAGNOSING = "Diagnosing (skip it with --no-diagnosis):"


def build_report(
    stored: Parameters,
    study: Study,
    folder: Path,
    *,
    diagnosed: bool = True,
    budget: float | None = None,
    controlled: bool = True,
    exported: bool = True,
    pdf: bool = False,
    journal: Sequence[str] = (),
    force: bool = False,
    report: _Report = lambda _: None,
) -> tuple[Path, ReportData]:
    """Compute all results from the logs and write the report; return the page and its contents.

    The report's model is that of the diagnosis, which replaces the contents of the parameter file. Without a diagnosis
    the model is that of the file, if the file holds for these logs; parameters that it lacks are fitted and added.

    Raises OutputError if the folder or the parameter file cannot be written, or the page cannot be printed. Raises
    ConfigError if there is no browser to print with.

    ``diagnosed``: Whether to diagnose, which takes longer than all the rest.
    ``budget``: Time in s that the diagnosis may take; None: the default of these logs.
    ``controlled``, ``exported``: Whether to design a heading controller, and to export to every simulator; in yaw only.
    ``pdf``: Whether to print the page too, into `pdf_output` of ``folder``.
    ``journal``: Widths of plots for a journal, which are written too; see `write_report`.
    ``force``: Whether to overwrite files of other programs; the report's inputs are never overwritten.
    ``report``: Called with a line of text on the progress.
    """
    inputs = input_files(study.paths)
    parameters = OutputSet([stored.output, history_output(stored.path)], force=force, protected=inputs)
    page = claim_page(folder, "inertia", pdf=pdf, force=force, protected=[*inputs, stored.path])
    data = _identified(stored, study, parameters, report, diagnosed=diagnosed, budget=budget)
    data = _with_control_and_exports(data, study, report, controlled=controlled, exported=exported)
    report("Drawing and writing the page …")
    if study.runs is not None and set(data.parameters.entries) >= _NEEDED:
        simulations = simulate_runs(study.runs.items, _model_of(study, data.parameters), study.vehicle)
        data = replace(data, simulations=tuple(simulations))
    if data.diagnosis is not None:
        nested, pairs = simulate_nested_models(study, data.diagnosis), separations(study, data.diagnosis)
        data = replace(data, nested=nested, separations=pairs)
    written = write_report(folder, data, claim=page, journal=journal)
    if pdf:
        report("Printing the page …")
        write_pdf(written, page)
    return written, data


def _identified(
    stored: Parameters, study: Study, claim: OutputSet, report: _Report, *, diagnosed: bool, budget: float | None
) -> ReportData:
    """Estimates and diagnosis; writes the report's model into the parameter file."""
    before = stored
    stored, notes = _if_valid(stored, study)
    drag, drag_refusal = _or_refusal(study.drag)
    estimates = {"quadratic_drag": None if drag is None else drag.estimate}
    # Drag that was estimated together with the inertia cannot check it; steady turns can.
    independent_drag = _completed(stored, study, estimates).independent_drag() or estimates["quadratic_drag"]
    inertia, inertia_refusal = _or_refusal(lambda: study.inertia(independent_drag))
    estimates["inertia"] = None if inertia is None else inertia.estimate
    diagnosis, refusal, joint, limits = None, "", None, None
    if diagnosed:
        report(_DIAGNOSING)
        limit, show = budget or study.default_budget, lambda text: report(f"{_DIAGNOSING} {text}")
        diagnosis, refusal = _or_refusal(lambda: study.diagnosis(show, drag=independent_drag, budget=limit))
    if diagnosis is not None and diagnosis.extended is not None:
        joint = diagnosis.extended.estimate
    elif stored is not before and any(entry.method in JOINT_METHODS for entry in before.entries.values()):
        # A joint fit with the effects of before. Raises ConfigError if an effect does not suit.
        gyro, effects = any("--gyro" in entry.options for entry in before.entries.values()), before.effect_forms()
        study.require_stored_effects(before)
        fit, _ = _or_refusal(lambda: study.likelihood(effects, gyro=gyro))
        joint = None if fit is None else fit.estimate
    if joint is not None:
        limits = diagnosis.detectable_sizes if diagnosis else {}

    def change(current: Parameters) -> Parameters:
        held, _ = _if_valid(current, study)
        if joint is None:
            return _completed(held, study, estimates)
        return held.with_estimate(joint, study.provenance)

    if joint is not None or change(stored) is not stored or not stored.path.exists():
        stored = update_parameters(stored, claim, change, detection_limits=limits)
    faults = all_faults(diagnosis, study) if diagnosis else study.faults
    return ReportData(
        faults=tuple(sorted(faults, key=lambda fault: not fault.stops)),
        vehicle=study.vehicle,
        parameters=stored,
        campaign=study.campaign,
        runs=study.runs,
        drag=drag,
        drag_refusal=drag_refusal,
        inertia=inertia,
        inertia_refusal=inertia_refusal,
        simulations=(),
        diagnosis=diagnosis,
        diagnosis_refusal=refusal,
        notes=tuple(notes),
    )


def _with_control_and_exports(
    data: ReportData, study: Study, report: _Report, *, controlled: bool, exported: bool
) -> ReportData:
    """The data with controller and exports, which exist for yaw only, and never with guessed parameters."""
    stored, guess = data.parameters, study.vehicle.assumptions
    if study.vehicle.axis is not YAW:
        return data
    if guess:
        refusal = f"{stored.path.name} {guess.refusal}"
        return replace(data, control_refusal=refusal * controlled, export_refusal=refusal * exported)
    if controlled:
        control, refusal = designed_control(study, stored, report)
        data = replace(data, control=control, control_refusal=refusal)
    if exported:
        exports, refusal = every_export(study, stored, report)
        data = replace(data, exports=exports, export_refusal=refusal)
    return data


def _if_valid(stored: Parameters, study: Study) -> tuple[Parameters, list[str]]:
    """The stored parameters, emptied where they do not hold for exactly these logs, and sentences on their state."""
    if not stored.entries:
        return stored, []
    provenance, freshness = study.provenance, check_freshness(stored, study.provenance)
    # Logs are compared by content, wherever they are.
    known = {source.sha256 for source in stored.sources}
    other_logs = bool(known) and any(source.sha256 not in known for source in provenance.sources)
    options = set(provenance.options.split())
    other_options = any(not options <= set(entry.options.split()) for entry in stored.entries.values())
    if not freshness.changes and not other_logs and not other_options:
        return stored, list(freshness.remarks)
    reason = f"it was fitted without {provenance.options}"
    if other_logs:
        reason = "these are other logs than those that it was fitted to"
    reason = freshness.reason or reason
    return stored.cleared(), [f"{stored.path.name} no longer held, and was fitted again: {reason}."]


def _completed(stored: Parameters, study: Study, estimates: Mapping[str, Estimate | None]) -> Parameters:
    """The parameters with those of ``estimates``, by name, that they lack; the same object where they lack none."""
    for name, estimate in estimates.items():
        if estimate is not None and name not in stored.entries:
            stored = stored.with_estimate(estimate, study.provenance)
    return stored


def _or_refusal(fit: Callable[[], _T]) -> tuple[_T | None, str]:
    """The result of ``fit``, or None and the reason why there is none."""
    try:
        return fit(), ""
    except DataError as error:
        return None, str(error)


def _model_of(study: Study, stored: Parameters) -> Model:
    """The file's model. Raises DataError if it is incomplete, ConfigError if an effect does not suit the vehicle."""
    if not set(stored.entries) >= _NEEDED:
        raise DataError("inertia or drag is missing.")
    model = stored.model()
    study.require_effects(model.effects)
    return model


def designed_control(study: Study, stored: Parameters, report: _Report) -> tuple[ControllerDesign | None, str]:
    """The controller that `rovid control` designs without options; None and the reason where there is none."""

    def design() -> ControllerDesign:
        model, options = _model_of(study, stored), ControllerOptions()
        conditions = loop_conditions(options, model, study.position_noise(), study.median_torque())
        return design_controller(stored, study.vehicle, conditions, options)

    report("Designing the controller, and closing its loop (skip it with --no-control) …")
    return _or_refusal(design)


def every_export(study: Study, stored: Parameters, report: _Report) -> tuple[Mapping[str, VerifiedExport] | None, str]:
    """Export to every format of `rovid export`; None and the reason where there is none."""

    def every() -> Mapping[str, VerifiedExport]:
        _model_of(study, stored)
        subject = export_input(stored, study)
        return {name: verified_export(load_exporter(name), subject) for name in FORMATS}

    report("Simulating with the equations of the simulators (skip it with --no-export) …")
    return _or_refusal(every)
