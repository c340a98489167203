"""From logs and a parameter file to the page."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import TypeVar

from rovid.control.design import ControllerDesign, design_controller
from rovid.control.specs import ControllerOptions, loop_conditions
from rovid.core.atomic_write import OutputFile, OutputSet
from rovid.core.errors import DataError
from rovid.core.signatures import pdf_signature
from rovid.diagnose.result import Diagnosis
from rovid.effects import effect_named
from rovid.estimate.estimate import Estimate
from rovid.export import FORMATS
from rovid.export.interface import export_input
from rovid.export.run_export import VerifiedExport, load_exporter, verified_export
from rovid.model.model import Model
from rovid.model.simulation import TrialSimulation, simulate_runs
from rovid.present.page.nested_simulations import simulate_nested_models
from rovid.present.page.pdf import print_pdf, require_browser
from rovid.present.page.render import claim_report, write_report
from rovid.present.page.report_data import ReportData
from rovid.store.agreement import JOINT_METHODS
from rovid.store.history import history_output
from rovid.store.parameter_file import Parameters
from rovid.store.staleness import check_freshness
from rovid.store.study import Study, input_files
from rovid.store.update import update_parameters
from rovid.trial.axis import YAW

_T = TypeVar("_T")
_PATIENCE = "Diagnosing, which takes some seconds or more (--no-diagnosis leaves it out):"


def build_report(
    stored: Parameters,
    study: Study,
    folder: Path,
    *,
    diagnosed: bool = True,
    controlled: bool = True,
    exported: bool = True,
    pdf: bool = False,
    force: bool = False,
    report: Callable[[str], None] = lambda _: None,
) -> tuple[Path, ReportData]:
    """Work the evidence out anew from the logs and write the page, all of it of one model; the page, and what it shows.

    That is the model of the diagnosis, which goes into the parameter file in the place of what that held. Without one
    the file's own is kept where it holds for these logs, and what it lacks is fitted and written to it.

    Parameters
    ----------
    diagnosed
        Whether the page says what the simulation misses, which takes longer than all the rest.
    controlled, exported
        Whether it says what controller suits the vehicle, and what simulators' formats hold of it; in yaw alone.
    pdf
        Whether the page is printed too, as `printed_page` in ``folder``.
    force
        Whether to write over files that are in the way; never over what the report is made from.
    report
        Called with a line of text as the work goes on.

    Raises
    ------
    OutputError
        The folder or the parameter file cannot be written, or the page not be printed.
    ConfigError
        There is no browser to print it with.
    """
    at_hand = input_files(study.paths)
    parameters = OutputSet([stored.output, history_output(stored.path)], force=force, protected=at_hand)
    protected = [*at_hand, stored.path]
    page = claim_report(folder, force=force, protected=protected)
    browser = require_browser() if pdf else ""
    paper = OutputSet([pdf_output(folder)] if pdf else [], force=force, protected=protected)
    evidence = _identified(stored, study, parameters, report, diagnosed=diagnosed)
    evidence = _handed_on(evidence, study, report, controlled=controlled, exported=exported)
    report("Drawing and writing the page …")
    evidence = _simulated(evidence, study)
    written = write_report(folder, evidence, claim=page)
    if pdf:
        report("Printing the page …")
        paper.write({pdf_output(folder): print_pdf(written, browser)})
    return written, evidence


def pdf_output(folder: Path) -> OutputFile:
    """The page of ``folder`` as PDF."""
    return OutputFile(folder / "report.pdf", pdf_signature("report"))


def _identified(
    stored: Parameters, study: Study, claim: OutputSet, report: Callable[[str], None], *, diagnosed: bool
) -> ReportData:
    """What the logs say, and the one model, which is in the parameter file by then."""
    before = stored
    stored, notes = _holding(stored, study)
    drag, drag_refusal = _or_refusal(study.drag)
    estimates = {"quadratic_drag": None if drag is None else drag.estimate}
    # A drag that was found together with the inertia cannot judge it; the steady turns of these logs can.
    judge = _completed(stored, study, estimates).independent_drag() or estimates["quadratic_drag"]
    inertia, inertia_refusal = _or_refusal(lambda: study.inertia(judge))
    estimates["inertia"] = None if inertia is None else inertia.estimate
    diagnosis, refusal = _diagnosis(study, judge, report) if diagnosed else (None, "")
    whole = None
    if diagnosis is not None and diagnosis.extended is not None:
        whole = diagnosis.extended.estimate
    elif stored is not before:
        whole = _fitted_again(before, study)

    def change(now: Parameters) -> Parameters:
        held, _ = _holding(now, study)
        return _completed(held, study, estimates) if whole is None else held.with_estimate(whole, study.provenance)

    if whole is not None or change(stored) is not stored or not stored.path.exists():
        seen = {} if diagnosis is None else diagnosis.detectable_sizes
        stored = update_parameters(stored, claim, change, seen=None if whole is None else seen)
    return ReportData(
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


def _handed_on(
    evidence: ReportData, study: Study, report: Callable[[str], None], *, controlled: bool, exported: bool
) -> ReportData:
    """With controller and exports, which are of yaw alone, and never of what hangs on a guess."""
    stored, guess = evidence.parameters, study.vehicle.assumptions
    if study.vehicle.axis is not YAW:
        return evidence
    guessed = f"{stored.path.name} {guess.refusal}" if guess else ""
    if controlled:
        control, refusal = (None, guessed) if guess else designed_control(study, stored, report)
        evidence = replace(evidence, control=control, control_refusal=refusal)
    if exported:
        exports, refusal = (None, guessed) if guess else every_export(study, stored, report)
        evidence = replace(evidence, exports=exports, export_refusal=refusal)
    return evidence


def _simulated(evidence: ReportData, study: Study) -> ReportData:
    """With every trial simulated by the model, and without what was found and with some of it."""
    stages = () if evidence.diagnosis is None else simulate_nested_models(study, evidence.diagnosis)
    return replace(evidence, simulations=_simulations(study, evidence.parameters), nested=stages)


def _holding(stored: Parameters, study: Study) -> tuple[Parameters, list[str]]:
    """``stored`` without what does not hold for exactly these logs, and what is to be said of that."""
    if not stored.entries:
        return stored, []
    origin, found = study.provenance, check_freshness(stored, study.provenance)
    # Some of the logs that it rests on are no others, wherever they are.
    known = {source.sha256 for source in stored.sources}
    other = bool(known) and any(source.sha256 not in known for source in origin.sources)
    given = set(origin.options.split())
    otherwise = any(not given <= set(entry.options.split()) for entry in stored.entries.values())
    if not found.changes and not other and not otherwise:
        return stored, list(found.remarks)
    options = f"it was fitted without {origin.options}" if otherwise else ""
    why = found.reason or ("these are other logs than those that it was fitted to" if other else options)
    return stored.cleared(), [f"{stored.path.name} no longer held, and was fitted again: {why}."]


def _fitted_again(before: Parameters, study: Study) -> Estimate | None:
    """What a model that was fitted as a whole is by now, with the same effects; None where it was not.

    Raises
    ------
    ConfigError
        An effect does not suit the vehicle any more.
    """
    if not any(entry.method in JOINT_METHODS for entry in before.entries.values()):
        return None
    gyro = any("--gyro" in entry.options for entry in before.entries.values())
    fit, _ = _or_refusal(lambda: study.likelihood(tuple(map(effect_named, before.effects)), gyro=gyro))
    return None if fit is None else fit.estimate


def _completed(stored: Parameters, study: Study, estimates: Mapping[str, Estimate | None]) -> Parameters:
    """With those of the estimates by name that it lacks; itself where it lacks none."""
    for name, estimate in estimates.items():
        if estimate is not None and name not in stored.entries:
            stored = stored.with_estimate(estimate, study.provenance)
    return stored


def _or_refusal(fit: Callable[[], _T]) -> tuple[_T | None, str]:
    """What ``fit`` gives, or None and why it gives nothing."""
    try:
        return fit(), ""
    except DataError as error:
        return None, str(error)


def _model_of(study: Study, stored: Parameters) -> Model:
    """The parameter file's model.

    Raises
    ------
    DataError
        It has none.
    ConfigError
        An effect does not suit the vehicle.
    """
    if not _whole(stored):
        raise DataError("inertia or drag is missing.")
    model = stored.model()
    study.require_effects(model.effects)
    return model


def designed_control(
    study: Study, stored: Parameters, report: Callable[[str], None]
) -> tuple[ControllerDesign | None, str]:
    """What `rovid control` designs where nothing else is asked for."""

    def design() -> ControllerDesign:
        model, options = _model_of(study, stored), ControllerOptions()
        setting = loop_conditions(options, model, study.position_noise(), study.median_torque())
        return design_controller(stored, study.vehicle, setting, options)

    report("Closing the loop, which takes long where there are effects (--no-control leaves it out) …")
    return _or_refusal(design)


def every_export(
    study: Study, stored: Parameters, report: Callable[[str], None]
) -> tuple[Mapping[str, VerifiedExport] | None, str]:
    """What `rovid export` makes, format by format."""

    def every() -> Mapping[str, VerifiedExport]:
        _model_of(study, stored)
        subject = export_input(stored, study)
        return {name: verified_export(load_exporter(name), subject) for name in FORMATS}

    report("Simulating what simulators make of it (--no-export leaves it out) …")
    return _or_refusal(every)


def _diagnosis(study: Study, drag: Estimate | None, report: Callable[[str], None]) -> tuple[Diagnosis | None, str]:
    report(_PATIENCE)

    def patiently(text: str) -> None:
        report(f"{_PATIENCE} {text}")

    return _or_refusal(lambda: study.diagnosis(patiently, drag=drag))


def _simulations(study: Study, stored: Parameters) -> tuple[TrialSimulation, ...]:
    if study.runs is None or not _whole(stored):
        return ()
    return tuple(simulate_runs(study.runs.items, _model_of(study, stored), study.vehicle))


def _whole(stored: Parameters) -> bool:
    """Whether the file has all that a simulation needs."""
    return {"inertia", "quadratic_drag"} <= set(stored.entries)
