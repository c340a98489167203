"""The pages: the report of one axis with its plots, and the comparison of two campaigns."""

import math
from collections.abc import Iterator, Sequence
from datetime import UTC, date, datetime
from pathlib import Path
from typing import Any

import numpy as np
from markupsafe import Markup

from rovid import __version__
from rovid.compare.comparison import Comparison
from rovid.core.formatting import plus_minus
from rovid.core.output_files import OutputFile, OutputSet
from rovid.diagnose.result import NEVER_IDENTIFIABLE, discriminating_experiment, not_identifiable
from rovid.effects import restoring_effect
from rovid.estimate.inertia import METHODS
from rovid.model.parameter_names import base_names
from rovid.present import sentences
from rovid.present.number_format import arm_words, parameter_title, steady_state_words, unit_symbol
from rovid.present.page.figures import ReportFigures, draw_figures
from rovid.present.page.page_files import claim_page, long_date, read_assets, template_environment, write_page
from rovid.present.page.summary import summarize
from rovid.present.page.viewer_data import viewer_document
from rovid.present.plots.canvas import WIDTH, journal_plots, render_inline_svg
from rovid.present.plots.results import plot_drag, plot_ratios
from rovid.present.plots.trials import plot_before_after
from rovid.present.report_data import ReportData, worst_first
from rovid.present.residuals import rms_sizes, unexplained_torques
from rovid.present.tables import diagnosis, fits, trials
from rovid.present.tables.diagnosis import changes_table, cross_prediction_table
from rovid.trial.assumptions import Assumptions
from rovid.trial.fault import fault_texts
from rovid.trial.vehicle import Vehicle, box_inertia

_ROW_HEIGHTS = (1.7, 1.2)  # in


def write_comparison(
    claim: OutputSet, page: OutputFile, comparison: Comparison, guess: Assumptions, notes: Sequence[str]
) -> None:
    """Write the page. Raises OutputError if the page cannot be written; an earlier page stays complete."""
    environment = template_environment()
    environment.globals["guess"] = guess
    context: dict[str, Any] = {
        "comparison": comparison,
        "headline": sentences.comparison_headline(comparison),
        "reasons": list(sentences.comparison_sentences(comparison)),
        "parameters": changes_table(comparison, guess),
        "predictions": cross_prediction_table(comparison),
        "pictures": list(_pictures(comparison)),
        "causes": [list(map(sentences.cause_title, names)) for names in comparison.causes],
        "warnings": [*comparison.warnings, *notes],
        "today": long_date(datetime.now(UTC).date()),
        "version": __version__,
    }
    claim.write({page: environment.get_template("comparison.html.j2").render(context)})


def _pictures(comparison: Comparison) -> Iterator[tuple[Markup, str]]:
    changes, axis = comparison.changes, comparison.a.axis
    ratios = plot_ratios(changes, {name: parameter_title(sentences.document_key(name)) for name in changes.pair.names})
    if ratios is not None:
        text = "B over A of each parameter, by itself, with its 95 % interval; filled: the parameter changed."
        yield (render_inline_svg(ratios, "ratios"), text)
    rates = [run.rates.rate for campaign in (comparison.a, comparison.b) for run in campaign.runs]
    fastest = float(np.nanmax(np.abs(np.concatenate(rates)))) if rates else 1.0
    drag = plot_drag(changes, fastest, axis)
    if drag is not None:
        yield render_inline_svg(drag, "drag"), f"Drag against {axis.rate_words}, up to the fastest of both."
    for runs, other in (("a", "b"), ("b", "a")):
        by_other, own = (comparison.predictions.get((model, runs)) for model in (other, runs))
        if by_other is None or own is None:
            continue
        worst, *_ = worst_first(by_other.simulations)
        figure = plot_before_after(
            by_other.simulations[worst],
            own.simulations[worst],
            width=WIDTH,
            rows=_ROW_HEIGHTS,
            names=(f"model of {other.upper()}", f"model of {runs.upper()}"),
        )
        trial = own.simulations[worst].run.trial.name
        caption = f"{trial} of {runs.upper()}, which the other model predicts worst."
        yield render_inline_svg(figure, f"worst-{runs}"), caption


# Axis -> the side of a box that lies along it.
_SIDE_ALONG = {"roll": "long", "pitch": "wide", "yaw": "high"}


def write_report(
    folder: Path,
    report: ReportData,
    *,
    claim: OutputSet | None = None,
    today: date | None = None,
    journal: Sequence[str] = (),
) -> Path:
    """Write ``folder``/index.html and ``folder``/plots/*.png and *.svg; return the page.

    Page and plots change together. Plots of an older report that this one does not have are removed.

    Raises OutputError if the folder cannot be written; an earlier page stays complete.

    ``claim``: Permission to write, where it was requested before.
    ``today``: The date on the page; today's date, UTC, if None.
    ``journal``: Widths as "84mm": the plots are also written that wide, each width into a folder of its name.
    """
    claim = claim or claim_page(folder, "inertia")
    figures = draw_figures(report)
    text = render_page(report, figures, today=today or datetime.now(UTC).date())
    plots = figures.files(folder / "plots")
    for name in journal:
        with journal_plots(name):
            plots |= draw_figures(report).files(folder / "plots" / name)
    return write_page(folder, text, plots, claim)


def render_page(report: ReportData, figures: ReportFigures, *, today: date) -> str:
    """The page as HTML, with its plots."""
    environment = template_environment()
    # Macros see globals only.
    environment.globals["guess"] = report.vehicle.assumptions
    return environment.get_template("page.html.j2").render(_context(report, figures, today))


def _context(report: ReportData, figures: ReportFigures, today: date) -> dict[str, Any]:
    # Without an inertia there is no model of the parameters, and the simulations are those of the diagnosis.
    axis, simulations = report.axis, report.simulations_with
    missing = list(_missing_parameters(report))
    unidentifiable, residual_sizes = not_identifiable(report.vehicle, report.diagnosis), None
    if report.runs is not None and report.simulations:
        residual_sizes = rms_sizes(unexplained_torques(report.runs, report.parameters.model(), report.vehicle))
    # Inertia that the water adds to the rigid body, where both are known and no guesses.
    entry, rigid_body, added = report.parameters.entries.get("inertia"), report.vehicle.rigid_body_inertia, ""
    if entry is not None and rigid_body is not None and not report.vehicle.assumptions:
        added = f"{plus_minus(entry.value - rigid_body, entry.standard_error)} {unit_symbol(entry.unit)}"
    return vars(report) | {
        "report": report,
        "simulations": simulations,
        "fault_texts": fault_texts(report.faults),
        "axis": axis,
        "steady": steady_state_words(axis),
        "arm": arm_words(axis)[0],
        "restoring": restoring_effect(axis),
        "stored": report.parameters,
        "trials": report.trials,
        "remarked": sum(bool(trial.remarks) for trial in report.trials),
        "answer": summarize(report),
        "added": added,
        "correlations": fits.correlation_table(report.parameters),
        "unidentifiable": [text for name, text in unidentifiable.items() if name not in NEVER_IDENTIFIABLE],
        "residual_sizes": residual_sizes,
        "effects": report.parameters.effect_forms(),
        "missing": missing,
        "warnings": list(_warnings(report, [reason for _, reason in missing if reason])),
        "refused": [*missing, *_other_refusals(report)],
        "rate_source": _rate_source(report),
        "noise": _noise(report),
        "box": _box_sides(report.vehicle),
        "methods": METHODS,
        "sections": _sections(report, figures),
        "control_verdict": sentences.control_verdict,
        "size_of": sentences.size_words,
        "evidence_words": sentences.evidence_words,
        "evidence_definitions": sentences.evidence_definitions,
        "effect_title": sentences.effect_title,
        "deciding_experiment": discriminating_experiment,
        "fit_tables": fits,
        "trial_tables": trials,
        "diagnosis_tables": diagnosis,
        "figures": figures,
        "viewer": viewer_document(report) if simulations else None,
        "assets": read_assets(),
        "today": long_date(today),
        "version": __version__,
    }


def _sections(report: ReportData, figures: ReportFigures) -> tuple[list[tuple[str, str]], list[tuple[str, str]]]:
    """Keys and titles of the open and of the folded sections that have something to show."""
    found, axis, steady = report.diagnosis, report.axis, steady_state_words(report.axis)
    # The first screen says all where neither logs nor tables were diagnosed.
    diagnosed = found is not None and (found.base is not None or found.from_tables is not None)
    shown = [
        ("faults", "Faults of the logs", bool(report.faults)),
        ("trials", "Trials", bool(report.trials)),
        ("model", "The model", True),
        ("diagnosis", "Causes", diagnosed),
        ("misses", "What is left over", bool(figures["left_over"] or figures["residuals"])),
    ]
    folded = [
        ("drag", "Drag" if axis.self_righting else f"Drag from {steady}s", report.drag is not None),
        ("inertia", "Inertia", report.inertia is not None),
        ("control", "Heading controller", report.control is not None),
        ("export", "Export to simulators", bool(report.exports)),
        ("limits", "What these data cannot tell", True),
        ("sources", "Where it comes from", True),
    ]
    open_sections, folded_sections = ([(key, title) for key, title, has in each if has] for each in (shown, folded))
    return open_sections, folded_sections


def _missing_parameters(report: ReportData) -> Iterator[tuple[str, str]]:
    """Each base parameter that the file lacks, with the reason."""
    entries, drag = report.parameters.entries, report.drag
    for name in base_names(report.axis):
        if name in entries:
            continue
        # On a self-righting axis all parameters are estimated together with the inertia.
        if name == "inertia" or report.axis.self_righting:
            reason = report.inertia_refusal
        elif drag is None:
            reason = report.drag_refusal
        else:
            reason = drag.estimate.refused.get(name, "")
        yield parameter_title(name), reason


def _warnings(report: ReportData, said: list[str]) -> Iterator[str]:
    """Warnings and remarks, the most serious first, without those that end with a sentence of ``said``."""
    texts = list(report.notes)
    if report.diagnosis is not None:
        texts += report.diagnosis.warnings
    for fit in (report.drag, report.inertia):
        if fit is not None and fits.is_source_of_model(report, fit.estimate):
            texts += fit.estimate.warnings
    for remarked in (report.campaign, report.runs):
        if remarked is not None:
            texts += [remark.text for remark in remarked.remarks]
    for text in dict.fromkeys(texts):
        if not text.endswith(tuple(said)):
            yield text


def _other_refusals(report: ReportData) -> Iterator[tuple[str, str]]:
    """Results besides base parameters that could not be determined, each with the reason."""
    entries = report.parameters.entries
    for title, refusal in (("A controller", report.control_refusal), ("Exports", report.export_refusal)):
        if refusal:
            yield title, refusal
    if report.drag is None and "quadratic_drag" in entries and not report.axis.self_righting:
        yield f"Drag from {steady_state_words(report.axis)}s", report.drag_refusal
    if report.inertia is None:
        if "inertia" in entries:
            yield "Inertia from these logs", report.inertia_refusal
        return
    methods: dict[str, list[str]] = {}
    for name, reason in report.inertia.refused.items():
        methods.setdefault(reason, []).append(METHODS[name])
    for reason, names in methods.items():
        yield "Inertia by " + ", by ".join(names), reason


def _rate_source(report: ReportData) -> str:
    """The signal that the rate comes from, in words."""
    if report.runs is None:
        return ""
    logged, position = f"the logged {report.axis.rate_words}", f"the {report.axis.position_words}"
    from_gyro = [run.rates.from_gyro for run in report.runs.items]
    if all(from_gyro):
        return logged
    return f"{logged} where there is one, else from {position}" if any(from_gyro) else position


def _noise(report: ReportData) -> dict[str, Any] | None:
    """Name, unit and noise of the measured signal, and the noise of the filtered rate; standard deviations."""
    if report.runs is None:
        return None
    measured, rate, _ = report.runs.noise()
    name, unit, factor = report.axis.measured_quantity(integrated=report.runs.rate_only)
    return {"name": name, "unit": unit, "measured": factor * measured, "rate": rate}


def _box_sides(vehicle: Vehicle) -> list[tuple[str, float]]:
    """Sides of the uniform box that the rigid-body inertia was computed from; empty where it was not."""
    if vehicle.axis.name not in _SIDE_ALONG or vehicle.mass is None or vehicle.rigid_body_inertia is None:
        return []
    sides = {"long": vehicle.length, "wide": vehicle.width, "high": vehicle.height}
    # The inertia about an axis depends on the two sides across it.
    del sides[_SIDE_ALONG[vehicle.axis.name]]
    across = [(word, side) for word, side in sides.items() if side is not None]
    if len(across) < 2:
        return []
    inertia = box_inertia(vehicle.mass, across[0][1], across[1][1])
    return across if math.isclose(vehicle.rigid_body_inertia, inertia) else []
