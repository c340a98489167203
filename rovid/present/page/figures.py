"""The plots of the report, their descriptions in words, and their files."""

import itertools
import re
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

from rovid.core.formatting import plus_minus
from rovid.core.output_files import OutputFile
from rovid.core.spmd import forked_workers, parallel_map
from rovid.diagnose.cross_validation import split_runs
from rovid.model.simulation import TrialSimulation
from rovid.present.number_format import format_number, steady_state_words, unit_symbol
from rovid.present.page.page_files import FigureDraft, plot_files, render_draft
from rovid.present.plots import canvas, models, results, trials
from rovid.present.report_data import ReportData, worst_first
from rovid.present.residuals import missing_without, rms_sizes, unexplained_torques
from rovid.present.sentences import effect_title
from rovid.present.tables.diagnosis import ALTERNATIVES_SHOWN
from rovid.present.tables.fits import method_title
from rovid.trial.preprocessing import PreparedRuns

# Most large trial plots and plots of faults: a page with more opens slowly on a tablet. The page lists all of them.
LARGE_PLOTS, FAULT_PLOTS = 40, 8
_T = TypeVar("_T")


class ReportFigures(defaultdict[str, Any]):
    """All plots of a report by section, empty where there are none; ``rivals`` and ``drivers`` by the key of an effect.

    ``worst``, on the first screen, has caption, alternative text and inline SVG for a wide and for a narrow screen.
    ``large`` and ``compared`` are files only: the viewer and ``worst`` show the same.
    """

    def __init__(self, **sections: Any) -> None:
        super().__init__(tuple, sections)

    def files(self, folder: Path) -> dict[OutputFile, bytes]:
        """Every plot as PNG and as SVG in ``folder``."""
        sections = [one for name, one in self.items() if name != "worst"]  # The worst trial is part of the page.
        each = (section.values() if isinstance(section, Mapping) else section for section in sections)
        return plot_files(itertools.chain.from_iterable(each), folder)


def draw_figures(report: ReportData) -> ReportFigures:
    """Draw all plots that the data allow; on Linux several processes share the work."""
    with forked_workers():
        faults = []
        for number, fault in enumerate([fault for fault in report.faults if fault.excerpt][:FAULT_PLOTS], 1):
            name, plot = f"fault_{number:02d}", results.plot_fault(fault)
            faults.append(FigureDraft(name, plot, caption=f"{fault.title}.", alt="The signal at the fault."))
        large, overview, rate = [], [], report.axis.rate_words
        for place in sorted(worst_first(report.simulations_with)[:LARGE_PLOTS]):
            item = report.simulations_with[place]
            name, plot = item.run.trial.name, trials.plot_trial(item)
            caption = f"{name}: {report.axis.force_name}, {rate} and the simulation's errors."
            name = f"trial_{place + 1:02d}_{_file_name(name)}"
            large.append(FigureDraft(name, plot, caption=caption, alt=_error_words(item, item)))
        pairs = list(zip(report.simulations_without, report.simulations_with, strict=True))
        caption = f"Measured {rate} of every trial, simulated freely"
        caption += " by the plain and the extended model." if report.extended else "."
        for sheet, suffix in paginate(pairs, trials.PER_SHEET):
            fits = "; ".join(f"{item.run.trial.name} R² {format_number(item.fit.r2, '.4f')}" for _, item in sheet)
            text = f"Measured and simulated {rate} over time: {fits}."
            overview.append(FigureDraft(f"overview{suffix}", trials.plot_overview(sheet), caption=caption, alt=text))
        sections = {
            "faults": faults,
            "thrust": list(_thrust(report)),
            "steady": list(_steady(report)),
            "inertia": list(_inertia(report)),
            "sines": list(_sines(report)),
            "overview": overview,
            "large": large,
            "residuals": list(_residuals(report)),
            "compared": list(_compared(report)),
            "left_over": list(_left_over(report)),
            "closed_loop": list(_closed_loop(report)),
        }
        rivals, drivers = dict(_rivals(report)), dict(_drivers(report))
        drafts = [*itertools.chain(*sections.values()), *rivals.values(), *drivers.values()]
        # Matplotlib's style belongs to the process: threads cannot draw.
        figures = parallel_map(lambda draft: render_draft(draft, report.vehicle.assumptions), drafts, use_threads=False)
        rendered = dict(zip(drafts, figures, strict=True))
        return ReportFigures(
            worst=_worst(report),
            rivals={key: rendered[draft] for key, draft in rivals.items()},
            drivers={key: rendered[draft] for key, draft in drivers.items()},
            **{name: [rendered[draft] for draft in section] for name, section in sections.items()},
        )


def _worst(report: ReportData) -> dict[str, str]:
    """The trial with the largest error, without and with the causes."""
    if not report.simulations_without:
        return {}
    (before, after), guess = _worst_pair(report), report.vehicle.assumptions
    worst = {"caption": f"The worst trial, {before.run.trial.name}, simulated freely."}
    worst["alt"] = _error_words(before, after)
    for name, width, rows in (("wide", 5.6, (1.9, 1.0)), ("narrow", 3.9, (0.75, 0.45))):
        figure = canvas.mark_guessed(trials.plot_before_after(before, after, width=width, rows=rows), guess)
        worst[name] = canvas.render_inline_svg(figure, name)
    return worst


def _worst_pair(report: ReportData) -> tuple[TrialSimulation, TrialSimulation]:
    worst = worst_first(report.simulations_without)[0]
    return report.simulations_without[worst], report.simulations_with[worst]


def _error_words(before: TrialSimulation, after: TrialSimulation) -> str:
    """RMS errors of the rate as alternative text of a trial's plot."""
    trial, axis = before.run.trial, before.run.trial.axis
    errors = [f"{format_number(item.fit.rmse, '.2g')} {axis.rate_unit}" for item in (before, after)]
    size = errors[0] if after is before else f"{errors[0]} without and by {errors[1]} with"
    return f"{trial.name}: the simulated {axis.rate_words} is off by {size}."


def _thrust(report: ReportData) -> Iterator[FigureDraft]:
    runs = report.runs.items if report.runs else ()
    figure = models.plot_thrust_curves(report.vehicle, runs)
    if figure is not None:
        names = ", ".join(thruster.name for thruster in report.vehicle.thrusters)
        caption = "Bench curve of each thruster. The thick, shaded part is what the logs use."
        text = f"Thrust in newtons against command for {names}, with the range of commands in the logs marked."
        yield FigureDraft("thrust_curves", figure, caption=caption, alt=text)


def _steady(report: ReportData) -> Iterator[FigureDraft]:
    fit = report.drag
    if fit is None:
        return
    axis, state = fit.estimate.axis, steady_state_words(fit.estimate.axis)
    rates = [point.rate for point in fit.points]
    yield FigureDraft(
        f"steady_{axis.force_name}",
        models.plot_steady_states(fit),
        caption=f"{axis.force_name.capitalize()} of each {state} against its {axis.rate_words}, and the fitted drag. "
        "Below, the residuals.",
        alt=f"{len(rates)} {state}s from {min(rates):.3g} to {max(rates):.3g} {axis.rate_unit} with the fitted curve; "
        f"the largest residual is {max(abs(fit.residuals)):.3g} {axis.force_unit}.",
    )


def _inertia(report: ReportData) -> Iterator[FigureDraft]:
    fit = report.inertia
    if fit is None:
        return
    methods = fit.methods.items()
    readings = [f"{method_title(name)} {plus_minus(one.value, one.standard_error)}" for name, one in methods]
    entry = report.parameters.entries.get("inertia")
    model = (entry.value, entry.standard_error) if entry else None
    yield FigureDraft(
        "inertia",
        models.plot_inertia_methods(fit, report.vehicle.rigid_body_inertia, model),
        caption="Inertia by each method: points with 95 % intervals, and ticks for single sine runs. Green: the model.",
        alt=f"Inertia in {unit_symbol(fit.estimate.unit('inertia'))}: {'; '.join(readings)}.",
    )


def _sines(report: ReportData) -> Iterator[FigureDraft]:
    fit, axis = report.inertia, report.axis
    if fit is None:
        return
    drag, force = report.steady_drag_model, axis.force_name
    sheets = list(paginate(fit.trials, models.SINES_PER_SHEET))
    for number, (runs, suffix) in enumerate(sheets, start=1):
        caption = f"Mean period of each sine run, sheet {number} of {len(sheets)}."
        if number == 1:
            caption = f"Mean period of each sine run; right, {force} over rate."
            caption += " The marks are the three moments of a peak."
        periods = ", ".join(f"{trial.period:.3g}" for trial in runs)
        text = f"{force.capitalize()}, {axis.rate_words} and acceleration over one period of {periods} s: the "
        text += f"acceleration peaks about when the {force} does, the rate later."
        yield FigureDraft(f"sine_runs{suffix}", models.plot_sine_runs(runs, drag, axis), caption=caption, alt=text)


def paginate(items: Sequence[_T], size: int) -> Iterator[tuple[Sequence[_T], str]]:
    """Up to ``size`` items at a time, with a suffix for the file name where there is more than one sheet."""
    if 0 < len(items) <= size:
        yield items, ""
        return
    for number, first in enumerate(range(0, len(items), size), start=1):
        yield items[first : first + size], f"_{number:02d}"


def _residuals(report: ReportData) -> Iterator[FigureDraft]:
    if report.runs is None or not report.simulations:
        return
    axis, force = report.axis, report.axis.force_name
    items = unexplained_torques(report.runs, report.parameters.model(), report.vehicle)
    caption = f"Residual {force} against rate, {force} and time, its autocorrelation, and its spectrum."
    text = f"Panels of the residual {force}: against {axis.rate_words}, against {force}, over time, "
    text += "its autocorrelation and its spectrum."
    yield FigureDraft("residuals", trials.plot_residuals(items, report.runs.cutoff), caption=caption, alt=text)


def _rivals(report: ReportData) -> Iterator[tuple[str, FigureDraft]]:
    for finding in report.diagnosis.findings if report.diagnosis else ():
        if not finding.alternatives:
            continue
        effect, axis = finding.effect, report.axis
        shown = finding.alternatives[:ALTERNATIVES_SHOWN]
        others = "; ".join(f"{effect_title(other.effect, axis)} {other.bic_gain:.0f}" for other in shown)
        gain = f"Log-likelihood gained by {effect_title(effect, axis)}: {finding.bic_gain:.0f}"
        caption = "Log-likelihood gain of each cause in its place, after the parameter penalty."
        name, figure = f"rivals_{_file_name(effect.key)}", results.plot_alternatives(finding)
        yield effect.key, FigureDraft(name, figure, caption=caption, alt=f"{gain}; in its place {others}.")


def _drivers(report: ReportData) -> Iterator[tuple[str, FigureDraft]]:
    """Key of each effect that was found, and the plot of the torque that is missing without it."""
    diagnosis, runs, axis = report.diagnosis, _diagnosed_runs(report), report.axis
    if diagnosis is None or report.extended is None or runs is None:
        return
    for finding in diagnosis.findings:
        effect = finding.effect
        missing = missing_without(effect, runs, report.extended.model, report.vehicle)
        if missing is None:
            continue
        driver = missing.driver.rpartition(",")[0] or missing.driver
        name, plot = f"missing_{_file_name(effect.key)}", trials.plot_missing_torque(missing, axis)
        caption = f"The {axis.force_name} that the model misses without {effect_title(effect, axis)}."
        text = f"Missing {axis.force_name} against {driver}: the readings lie about the line of the equation."
        yield effect.key, FigureDraft(name, plot, caption=caption, alt=text)


def _diagnosed_runs(report: ReportData) -> PreparedRuns | None:
    """The runs of the diagnosis: all runs, or the parts into which they were split."""
    if report.runs is None:
        return None
    return split_runs(report.runs.items, report.vehicle, report.runs.cutoff) or report.runs


def _compared(report: ReportData) -> Iterator[FigureDraft]:
    """The plot of the first screen, as a file."""
    if not report.nested or report.extended is None:
        return
    before, after = _worst_pair(report)
    plot = trials.plot_before_after(before, after, width=canvas.WIDTH, rows=(2.4, 1.5))
    caption = f"The worst trial, {before.run.trial.name}, simulated freely by the plain and the extended model."
    yield FigureDraft("diagnosis_gain", plot, caption=caption, alt=_error_words(before, after))


def _left_over(report: ReportData) -> Iterator[FigureDraft]:
    diagnosis, runs, vehicle = report.diagnosis, _diagnosed_runs(report), report.vehicle
    if runs is None or diagnosis is None or diagnosis.base is None or report.extended is None:
        return
    force, unit = report.axis.force_name, report.axis.force_unit
    before = unexplained_torques(runs, diagnosis.base.model, vehicle)
    after = unexplained_torques(runs, report.extended.model, vehicle)
    sizes = [format_number(rms_sizes(items)[0], ".3g") for items in (before, after)]
    was, now = (vehicle.assumptions.mark_number(size, unit) for size in sizes)
    yield FigureDraft(
        "diagnosis_residuals",
        trials.plot_residual_comparison(before, after, runs.cutoff),
        caption=f"The {force} that the model does not explain, by the plain and the extended model: {was} and {now} "
        f"{unit} root mean square.",
        alt=f"Panels of the residual {force}: {was} {unit} root mean square by the plain model, {now} {unit} "
        "with the causes.",
    )


def _closed_loop(report: ReportData) -> Iterator[FigureDraft]:
    control = report.control
    if control is None:
        return
    runs = results.paper_step_runs(control)
    effects = bool(control.model.effects)
    full = {run.name: run.metrics for run in control.runs if run.model_aid and run.effects_known == effects}
    steps = "; ".join(f"{name}, {format_number(full[name].overshoot_deg, '.1f')} deg too far" for name in runs)
    yield FigureDraft(
        "closed_loop",
        results.plot_closed_loop(runs, control.bandwidth),
        caption="Steps of the wanted heading, simulated without noise and disturbance: heading against set point, and "
        "the torque that the controller commands.",
        alt=f"Heading and torque over time in three steps; with full aid, and disturbed as in the table: {steps}.",
    )


def _file_name(name: str) -> str:
    return re.sub(r"[^A-Za-z0-9]+", "_", name).strip("_")[-60:]
