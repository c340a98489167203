"""The page of the coupled model: tracks, speeds, missing forces, manoeuvres and parameters."""

import contextlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from rovid import __version__
from rovid.core.array_types import FloatArray
from rovid.core.errors import DataError
from rovid.core.output_files import OutputSet
from rovid.diagnose.result import UNIDENTIFIABLE
from rovid.planar.dataset import PlanarRun, is_yaw_alone
from rovid.planar.diagnosis import PlanarDiagnosis
from rovid.planar.fit import PlanarFit
from rovid.planar.manoeuvres import Measures
from rovid.planar.standard_manoeuvres import SteeringSystem, model_manoeuvres, run_manoeuvres, turning_curve
from rovid.planar.trial_simulation import PlanarTrialSimulation, missing_forces, worst_run
from rovid.present import sentences
from rovid.present.console import ResultTable
from rovid.present.documents.diagnosis import next_planar_experiment
from rovid.present.number_format import sensor_words
from rovid.present.page import page_files
from rovid.present.plots import canvas
from rovid.present.plots import models as plots
from rovid.present.tables.fits import planar_parameters_table
from rovid.present.tables.trials import model_manoeuvre_tables, planar_simulation_table, run_manoeuvre_tables
from rovid.present.terminal import results as printed
from rovid.present.terminal.diagnosis import planar_held_out_table
from rovid.store.parameter_file import Parameters
from rovid.store.planar_study import PlanarStudy, planar_effect
from rovid.store.study import input_files
from rovid.trial.axis import PLANAR
from rovid.trial.fault import fault_texts


@dataclass(frozen=True, kw_only=True, eq=False)
class PlanarReport:
    """The contents of the page. ``base`` and ``full`` are the same object where no cause was found."""

    study: PlanarStudy
    stored: Parameters
    #: ``base``, ``full``: the model without, and with the causes; each with all runs simulated.
    base: PlanarFit
    full: PlanarFit
    before: Sequence[PlanarTrialSimulation]
    after: Sequence[PlanarTrialSimulation]
    #: Worst run, time in s, and smoothed forces in N or N m by axis that each model misses there.
    missing: tuple[str, FloatArray, Mapping[str, FloatArray], Mapping[str, FloatArray]] | None
    manoeuvres: Measures  #: Standard manoeuvres of the model ``full``.
    headline: str  #: The result in one sentence or two.
    diagnosis: PlanarDiagnosis | None = None
    notes: Sequence[str] = ()


def build_planar_report(
    study: PlanarStudy,
    stored: Parameters,
    folder: Path,
    store: Callable[[PlanarFit], Parameters],
    *,
    diagnosed: bool,
    budget: float | None,
    pdf: bool,
    journal: Sequence[str],
    force: bool,
    report: Callable[[str], None],
) -> tuple[Path, PlanarReport]:
    """Fit, diagnose and simulate the logs, and write the page; return the page and its contents.

    Raises OutputError if the folder or the parameter file cannot be written.

    ``store``: Writes the report's model to the parameter file, and returns its new content.
    ``diagnosed``, ``budget``: Whether to look for causes, and for how many seconds; otherwise the model has the effects
        of ``stored``.
    ``pdf``, ``force``: Whether to print the page too, and whether to replace files of other programs.
    ``journal``: Widths as "84mm": the plots are also written that wide.
    """
    inputs = [*input_files(study.logs.paths), stored.path]
    claim = page_files.claim_page(folder, "planar_tracks", pdf=pdf, force=force, protected=inputs)
    diagnosis = study.diagnosis(report, budget=budget) if diagnosed else None
    if diagnosis is not None and diagnosis.base is not None and diagnosis.extended is not None:
        base, full = diagnosis.base.fit, diagnosis.extended.fit
    else:
        base = study.fit()
        effects = tuple(map(planar_effect, stored.effects))
        full = study.fit(effects) if effects else base
    if not full.model.effects:
        full = base
    report("Simulating and drawing …")
    before = study.simulate(base.model)
    headline = printed.fit_sentence(full)
    if diagnosis is not None:
        headline = sentences.verdict_sentence(diagnosis, study.vehicle.assumptions)
    contents = PlanarReport(
        study=study,
        stored=store(full),
        base=base,
        full=full,
        before=before,
        after=before if full is base else study.simulate(full.model),
        missing=_missing(study, study.data.runs[worst_run(before)], base, full),
        manoeuvres=model_manoeuvres(full, study.data),
        headline=headline,
        diagnosis=diagnosis,
    )
    page = _write(folder, contents, claim, journal)
    if pdf:
        report("Printing the page …")
        page_files.write_pdf(page, claim)
    return page, contents


def _missing(
    study: PlanarStudy, run: PlanarRun, base: PlanarFit, full: PlanarFit
) -> tuple[str, FloatArray, Mapping[str, FloatArray], Mapping[str, FloatArray]] | None:
    """Forces that both models miss in a run, as in `PlanarReport`."""
    without, rest = (missing_forces(fit.model, run, yaw_only=is_yaw_alone(study.data)) for fit in (base, full))
    if without is None or rest is None:
        return None
    (time, forces), (other_time, others) = without, rest
    held = {axis: np.asarray(np.interp(time, other_time, force)) for axis, force in others.items()}
    return run.name, time, forces, forces if full is base else held


def _write(folder: Path, report: PlanarReport, claim: OutputSet, journal: Sequence[str]) -> Path:
    """Write ``folder``/index.html and the plots; return the page."""

    def draw() -> dict[str, page_files.ReportFigure]:
        guess = report.study.vehicle.assumptions
        return {draft.name: page_files.render_draft(draft, guess) for draft in _drafts(report)}

    figures = draw()
    plots = page_files.plot_files(figures.values(), folder / "plots")
    for name in journal:
        with canvas.journal_plots(name):
            plots |= page_files.plot_files(draw().values(), folder / "plots" / name)
    return page_files.write_page(folder, _render(report, figures), plots, claim)


def _drafts(report: PlanarReport) -> Iterator[page_files.FigureDraft]:
    before, after = report.before, report.after
    worst = worst_run(before)
    # Indices of the runs that are drawn: the worst first, then the others in their order.
    others = [at for at in range(len(after)) if at != worst]
    chosen = [worst, *others][: plots.TRACKS_SHOWN]
    two = report.base is not report.full
    models = "dashed: plain model; black: extended model" if two else "black: simulated"
    measured = "pale: measured; " if {"north", "east"} <= set(report.study.data.sensors) else ""
    if not is_yaw_alone(report.study.data):
        yield page_files.FigureDraft(
            "planar_tracks",
            plots.plot_tracks([before[at] for at in chosen], [after[at] for at in chosen]),
            caption=f"Tracks, simulated freely from the first sample; {measured}{models}; dots: equal times.",
            alt=f"North against east of {len(chosen)} runs.",
        )
    for number, at in enumerate(chosen, 1):
        agreements = [f"{sensor_words(speed)} R² {fit.r2:.3f}" for speed, fit in after[at].fits.items()]
        yield page_files.FigureDraft(
            f"planar_speeds_{number:02d}",
            plots.plot_speeds(before[at], after[at]),
            caption=f"{after[at].name}: speeds over ground in body axes. Pale: measured; {models}.",
            alt=f"Surge, sway and yaw rate of {after[at].name}: {', '.join(agreements)}.",
        )
    length = report.study.vehicle.length
    if length is not None and not is_yaw_alone(report.study.data):
        with contextlib.suppress(DataError):
            system = SteeringSystem.of(report.study.data, report.full.model)
            curve = turning_curve(report.full.model, system, length)
            plot, text = (
                plots.plot_turning_curve(curve, angle=system.rudders > 0),
                "Dimensionless yaw rate against steering.",
            )
            caption = "Steady turns of the model: r' = r·L/U against the steering."
            yield page_files.FigureDraft("planar_turning_curve", plot, caption=caption, alt=text)
    if report.missing is not None:
        run, *_ = report.missing
        yield page_files.FigureDraft(
            "planar_missing",
            plots.plot_missing_forces(*report.missing),
            caption=f"{run}: forces that each model misses along each axis, from the smoothed motion.",
            alt=f"Missing forces of {run} against time.",
        )


def _render(report: PlanarReport, figures: Mapping[str, page_files.ReportFigure]) -> str:
    study, fit = report.study, report.full
    guess = study.vehicle.assumptions
    environment = page_files.template_environment()
    environment.globals["guess"] = guess

    def of_kind(kind: str) -> list[page_files.ReportFigure]:
        return [figure for name, figure in figures.items() if name.startswith(f"planar_{kind}")]

    speeds, found, warnings, step = of_kind("speeds"), report.diagnosis, fit.warnings, None
    if found is not None:
        warnings = warnings if found.extended is None else found.warnings
        plan = sentences.plan_command(report.stored.path, PLANAR)
        step = sentences.next_step(found, next_planar_experiment(found), study.vehicle, plan)
    manoeuvres: list[ResultTable] = []
    if not is_yaw_alone(study.data):
        manoeuvres = run_manoeuvre_tables(run_manoeuvres(fit.model, study.data))
        manoeuvres += model_manoeuvre_tables(report.manoeuvres)
    causes, cause_words = () if found is None else found.causes, []
    for cause in causes:
        name = sentences.cause_name(cause)
        evidence = sentences.evidence_words(cause).capitalize()
        cause_words.append(f"{name[:1].upper()}{name[1:]}: {sentences.size_words(cause)}. {evidence}.")
    context: dict[str, Any] = {
        "vehicle": study.vehicle,
        "minutes": sum(run.duration for run in study.data.runs) / 60.0,
        "runs": len(study.data.runs),
        "headline": report.headline,
        "fit_sentence": printed.fit_sentence(fit) if report.diagnosis else "",
        "simulation_sentence": printed.simulation_sentence(report.after),
        "criterion": sentences.criterion_sentence(fit),
        "causes": cause_words,
        "definitions": sentences.evidence_definitions(causes),
        "gain": found and planar_held_out_table(found),
        "undetermined": printed.undetermined_sentences(fit),
        "by_prior": printed.prior_sentences(fit),
        "unknown": "" if study.vehicle.thrust_scale_error else UNIDENTIFIABLE["thrust_scale"],
        "next_step": step,
        "tracks": of_kind("tracks"),
        "worst": speeds[:1],
        "others": speeds[1:],
        "missing": of_kind("missing"),
        "manoeuvres": manoeuvres,
        "curve": of_kind("turning_curve"),
        "parameters": planar_parameters_table(report.stored, guess),
        "without": planar_simulation_table(report.before) if report.base is not fit else None,
        "simulations": planar_simulation_table(report.after),
        "faults": fault_texts(study.logs.faults),
        "warnings": [*study.remarks(), *warnings, *report.notes],
        "sources": report.stored.sources,
        "today": page_files.long_date(datetime.now(UTC).date()),
        "version": __version__,
    }
    return environment.get_template("planar.html.j2").render(context)
