"""The report's plots: which there are, what they show in words, and their files."""

from __future__ import annotations

import base64
import itertools
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TypeVar

from markupsafe import Markup
from matplotlib.figure import Figure

from rovid.core.atomic_write import OutputFile
from rovid.core.formatting import plus_minus
from rovid.core.signatures import png_signature, svg_signature
from rovid.core.spmd import forked_workers, parallel_map
from rovid.diagnose.cross_validation import split_runs
from rovid.diagnose.result import Finding
from rovid.effects import Effect
from rovid.model.model import Model
from rovid.model.simulation import TrialSimulation
from rovid.present.number_text import format_number, steady_state_words, unit_symbol
from rovid.present.page import residual_drivers
from rovid.present.page.control_runs import paper_step_runs
from rovid.present.page.nested_simulations import worst_first
from rovid.present.page.report_data import ReportData
from rovid.present.page.residual_torque import ResidualTorque, rms_sizes, unexplained_torques
from rovid.present.plots import (
    before_after,
    canvas,
    closed_loop,
    findings,
    inertia,
    residual_torque,
    residuals,
    simulations,
    sines,
    steady,
    thrust,
)
from rovid.present.plots import missing as missing_torque
from rovid.present.tables.diagnosis import RIVALS, effect_name
from rovid.signals.preprocessing import PreparedRuns
from rovid.trial.assumptions import Assumptions
from rovid.trial.axis import Axis

# A page with more large trial plots than this is slow to open on a tablet; the overview shows all trials.
LARGE_PLOTS = 40

# What a plot of any report may be called.
_NAMES = re.compile(
    r"(thrust_curves|steady_\w+|inertia|residuals|diagnosis_gain|diagnosis_residuals|closed_loop|rivals_\w+|missing_\w+"
    r"|(sine_runs|overview)(_\d\d+)?|trial_\d\d+_\w*)\.(png|svg)"
)

T = TypeVar("T")


@dataclass(frozen=True, kw_only=True)
class ReportFigure:
    """A plot: file name without suffix, the text under it, the text in its place, and its bytes."""

    name: str
    caption: str
    alt: str
    png: bytes
    svg: bytes

    @property
    def data(self) -> str:
        """The PNG, to be embedded."""
        return base64.b64encode(self.png).decode("ascii")

    def files(self, folder: Path) -> dict[OutputFile, bytes]:
        """The plot as PNG and as SVG."""
        return {
            OutputFile(folder / f"{self.name}.png", png_signature("report")): self.png,
            OutputFile(folder / f"{self.name}.svg", svg_signature("report")): self.svg,
        }


@dataclass(frozen=True, eq=False)
class FigureDraft:
    """A plot before it is drawn: file name without suffix, the text under it, and the text in its place."""

    name: str
    figure: Figure
    caption: str = field(kw_only=True)
    alt: str = field(kw_only=True)


@dataclass(frozen=True, kw_only=True)
class WorstTrialFigure:
    """The worst trial before and after, as SVG to stand in the page: for a wide one and for a narrow one."""

    caption: str
    alt: str
    wide: Markup
    narrow: Markup


@dataclass(frozen=True, kw_only=True)
class ReportFigures:
    """All plots of a page, by the section that shows them.

    ``worst`` is the picture of the first screen; ``rivals`` and ``drivers`` are by the key of the effect found.
    The page shows neither ``large`` nor ``compared``: its viewer, and its first screen, do.
    """

    worst: WorstTrialFigure | None = None

    thrust: tuple[ReportFigure, ...] = ()
    steady: tuple[ReportFigure, ...] = ()
    inertia: tuple[ReportFigure, ...] = ()
    sines: tuple[ReportFigure, ...] = ()
    overview: tuple[ReportFigure, ...] = ()
    large: tuple[ReportFigure, ...] = ()
    residuals: tuple[ReportFigure, ...] = ()
    rivals: Mapping[str, ReportFigure] = field(default_factory=dict)
    drivers: Mapping[str, ReportFigure] = field(default_factory=dict)
    compared: tuple[ReportFigure, ...] = ()
    left_over: tuple[ReportFigure, ...] = ()
    closed_loop: tuple[ReportFigure, ...] = ()

    def files(self, folder: Path) -> dict[OutputFile, bytes]:
        """Every plot, as the files in ``folder`` that it makes."""
        first = (self.thrust, self.steady, self.inertia, self.sines, self.overview, self.large, self.residuals)
        sections = (
            *first,
            self.rivals.values(),
            self.drivers.values(),
            self.compared,
            self.left_over,
            self.closed_loop,
        )
        files: dict[OutputFile, bytes] = {}
        for pictures in sections:
            for picture in pictures:
                files |= picture.files(folder)
        return files


def existing_plots(folder: Path) -> list[OutputFile]:
    """Files in ``folder`` that are called like a report's plots, whoever made them."""
    if not folder.is_dir():
        return []
    forms = {".png": png_signature("report"), ".svg": svg_signature("report")}
    plots = [path for path in sorted(folder.iterdir()) if _NAMES.fullmatch(path.name)]
    return [OutputFile(path, forms[path.suffix]) for path in plots]


def draw_figures(evidence: ReportData) -> ReportFigures:
    """Draw whatever the evidence allows: on Linux copies of this process draw their part of it."""
    with forked_workers():
        return _album(evidence)


def _album(evidence: ReportData) -> ReportFigures:
    sections = {
        "thrust": [*_thrust(evidence)],
        "steady": [*_steady(evidence)],
        "inertia": [*_inertia(evidence)],
        "sines": [*_sines(evidence)],
        "overview": [*_overview(evidence)],
        "large": [*_large(evidence.simulations_with)],
        "residuals": [*_residuals(evidence)],
        "compared": [*_compared(evidence)],
        "left_over": [*_left_over(evidence)],
        "closed_loop": [*_closed_loop(evidence)],
    }
    of_rivals, of_drivers = dict(_rivals(evidence)), dict(_drivers(evidence))
    sketches = [*itertools.chain(*sections.values()), *of_rivals.values(), *of_drivers.values()]
    guess = evidence.vehicle.assumptions
    # Matplotlib's style is that of the process, so that threads cannot draw.
    pictures = parallel_map(lambda sketch: _picture(sketch, guess), sketches, use_threads=False)
    drawn = dict(zip(sketches, pictures, strict=True))
    return ReportFigures(
        worst=_worst(evidence),
        rivals={key: drawn[sketch] for key, sketch in of_rivals.items()},
        drivers={key: drawn[sketch] for key, sketch in of_drivers.items()},
        **{name: tuple(drawn[sketch] for sketch in every) for name, every in sections.items()},
    )


def _picture(sketch: FigureDraft, guess: Assumptions) -> ReportFigure:
    figure = canvas.mark_guessed(sketch.figure, guess)
    return ReportFigure(
        name=sketch.name,
        caption=sketch.caption,
        alt=sketch.alt,
        png=canvas.render_png(figure),
        svg=canvas.render_svg(figure),
    )


def _worst(evidence: ReportData) -> WorstTrialFigure | None:
    """The trial that is simulated worst, without and with what was found."""
    if not evidence.simulations_without:
        return None
    number_of, *_ = worst_first(evidence.simulations_without)
    before, after, guess = (
        evidence.simulations_without[number_of],
        evidence.simulations_with[number_of],
        evidence.vehicle.assumptions,
    )
    wide = before_after.plot_before_after(before, after, width=5.6, rows=(1.9, 1.0))
    narrow = before_after.plot_before_after(before, after, width=3.9, rows=(0.75, 0.45))
    return WorstTrialFigure(
        caption=f"The worst trial, {before.run.trial.name}, simulated freely.",
        alt=_alt(before, after),
        wide=canvas.render_inline_svg(canvas.mark_guessed(wide, guess), "wide"),
        narrow=canvas.render_inline_svg(canvas.mark_guessed(narrow, guess), "narrow"),
    )


def _alt(before: TrialSimulation, after: TrialSimulation) -> str:
    """What the picture of the worst trial says."""
    axis = before.run.trial.axis
    rates = f"{axis.rate_words} is off by {format_number(before.fit.rmse, '.2g')}"
    if after is not before:
        rates = f"{rates} {axis.rate_unit} without and by {format_number(after.fit.rmse, '.2g')}"
    return f"{before.run.trial.name}: the simulated {rates} {axis.rate_unit}{' with' if after is not before else ''}."


def _steady_drag(evidence: ReportData) -> Model | None:
    """Model of what balances the push in a steady state; None where the drag is not known."""
    entries = evidence.parameters.entries
    if "quadratic_drag" not in entries or evidence.parameters.per_inertia:
        return None
    quadratic, linear, buoyancy = map(entries.get, ("quadratic_drag", "linear_drag", "net_buoyancy"))
    return Model(
        inertia=math.nan,
        quadratic_drag=quadratic.value if quadratic else 0.0,
        linear_drag=linear.value if linear else 0.0,
        axis=evidence.axis,
        restoring_values=(buoyancy.value,) if buoyancy else (),
    )


def _thrust(evidence: ReportData) -> Iterator[FigureDraft]:
    """Thrust curves with the commands in use."""
    runs = () if evidence.runs is None else evidence.runs.items
    figure = thrust.plot_thrust_curves(evidence.vehicle, runs)
    if figure is None:
        return
    names = ", ".join(thruster.name for thruster in evidence.vehicle.thrusters)
    yield FigureDraft(
        "thrust_curves",
        figure,
        caption="Bench curve of each thruster. The thick, shaded part is what the logs use.",
        alt=f"Thrust in newtons against command for {names}, with the range of commands in the logs marked.",
    )


def _steady(evidence: ReportData) -> Iterator[FigureDraft]:
    fit = evidence.drag
    if fit is None:
        return
    axis = fit.estimate.axis
    rates = [point.rate for point in fit.points]
    what = steady_state_words(axis)
    yield FigureDraft(
        f"steady_{axis.force_name}",
        steady.plot_steady_states(fit),
        caption=f"{axis.force_name.capitalize()} of each {what} against its {axis.rate_words}, and the fitted drag. Below, "
        "what the fit leaves over.",
        alt=f"{len(rates)} {what}s from {min(rates):.3g} to {max(rates):.3g} {axis.rate_unit} with the fitted curve; "
        f"the largest residual is {max(abs(fit.residuals)):.3g} {axis.force_unit}.",
    )


def _inertia(evidence: ReportData) -> Iterator[FigureDraft]:
    """Inertia by each method."""
    fit = evidence.inertia
    if fit is None:
        return
    readings = []
    for name, each in fit.methods.items():
        value = plus_minus(each.value, each.standard_error)
        readings.append(f"{inertia.method_title(name)} {value}")
    yield FigureDraft(
        "inertia",
        inertia.plot_inertia_methods(fit, evidence.vehicle.rigid_body_inertia),
        caption="Inertia by each method: points with 95 % intervals, and ticks for single sine runs.",
        alt=f"Inertia in {unit_symbol(fit.estimate.unit('inertia'))}: {'; '.join(readings)}.",
    )


def _sines(evidence: ReportData) -> Iterator[FigureDraft]:
    fit, axis = evidence.inertia, evidence.axis
    if fit is None:
        return
    drag = _steady_drag(evidence)
    parts = list(paginate(fit.trials, sines.PER_SHEET))
    # The first sheet explains them all.
    caption = (
        f"Mean period of each sine run; right, {axis.force_name} over rate. The marks are the three moments that the peak "
        "method takes for one."
    )
    for k, (trials, suffix) in enumerate(parts):
        if k > 0:
            caption = f"Mean period of each sine run, sheet {k + 1} of {len(parts)}."
        periods = ", ".join(f"{trial.period:.3g}" for trial in trials)
        yield FigureDraft(
            f"sine_runs{suffix}",
            sines.plot_sine_runs(trials, drag, axis),
            caption=caption,
            alt=f"{axis.force_name.capitalize()}, {axis.rate_words} and acceleration over one period of {periods} s: the "
            f"acceleration peaks about when the {axis.force_name} does, the rate later.",
        )


def paginate(items: Sequence[T], size: int) -> Iterator[tuple[Sequence[T], str]]:
    """Up to ``size`` items at a time, with a suffix for the file's name where there is more than one sheet."""
    if 0 < len(items) <= size:
        yield items, ""
        return
    starts = range(0, len(items), size)
    for place, first in enumerate(starts, start=1):
        yield items[first : first + size], f"_{place:02d}"


def _overview(evidence: ReportData) -> Iterator[FigureDraft]:
    """All trials, simulated, in small panels."""
    pairs = list(zip(evidence.simulations_without, evidence.simulations_with, strict=True))
    both = " without and with what was found" if evidence.extended else ""
    for part, suffix in paginate(pairs, simulations.PER_SHEET):
        rate = part[0][0].run.trial.axis.rate_words
        fits = "; ".join(f"{item.run.trial.name} R² {format_number(item.fit.r2, '.4f')}" for _, item in part)
        yield FigureDraft(
            f"overview{suffix}",
            simulations.plot_overview(part),
            caption=f"Measured {rate} of every trial, simulated freely{both}.",
            alt=f"Measured and simulated {rate} over time: {fits}.",
        )


def _large(items: Sequence[TrialSimulation]) -> Iterator[FigureDraft]:
    """Each trial, or those with the largest error where there are too many."""
    for place in sorted(worst_first(items)[:LARGE_PLOTS]):
        item = items[place]
        name, axis = item.run.trial.name, item.run.trial.axis
        yield FigureDraft(
            f"trial_{place + 1:02d}_{_file_name(name)}",
            simulations.plot_trial(item),
            caption=f"{name}: {axis.force_name}, {axis.rate_words} and the simulation's errors.",
            alt=_alt(item, item),
        )


def _residuals(evidence: ReportData) -> Iterator[FigureDraft]:
    """What the model leaves of the torque."""
    if evidence.runs is None or not evidence.simulations:
        return
    axis = evidence.axis
    items = unexplained_torques(evidence.runs, evidence.parameters.model(), evidence.vehicle)
    yield FigureDraft(
        "residuals",
        residuals.plot_residuals(items, evidence.runs.cutoff),
        caption=f"Residual {axis.force_name} against rate, {axis.force_name} and time, its autocorrelation, and its spectrum.",
        alt=f"Five panels of the residual {axis.force_name}: against {axis.rate_words}, against {axis.force_name}, over time, "
        "its autocorrelation and its spectrum.",
    )


def _rivals(evidence: ReportData) -> Iterator[tuple[str, FigureDraft]]:
    """A plot for each finding that has rivals, by the key of its effect."""
    for finding in evidence.diagnosis.findings if evidence.diagnosis else ():
        if finding.alternatives:
            yield finding.effect.key, _rivals_of(finding)


def _rivals_of(finding: Finding) -> FigureDraft:
    axis = finding.estimate.axis
    shown = [f"{effect_name(rival.effect, axis)} {rival.bic_gain:.0f}" for rival in finding.alternatives[:RIVALS]]
    rest = "; ".join(shown)
    return FigureDraft(
        f"rivals_{_file_name(finding.effect.key)}",
        findings.plot_alternatives(finding),
        caption="Log-likelihood that each cause gains in its place, less the price of its parameters.",
        alt=f"Log-likelihood gained by {effect_name(finding.effect, axis)}: {finding.bic_gain:.0f}; in its place {rest}.",
    )


def _drivers(evidence: ReportData) -> Iterator[tuple[str, FigureDraft]]:
    """A plot for each finding, by the key of its effect: the torque that is missing without it."""
    diagnosis, runs = evidence.diagnosis, _diagnosed(evidence)
    if diagnosis is None or evidence.extended is None or runs is None:
        return
    for finding in diagnosis.findings:
        missing = residual_drivers.missing_without(finding.effect, runs, evidence.extended.model, evidence.vehicle)
        if missing is not None:
            yield finding.effect.key, _driver(finding.effect, missing, evidence.axis)


def _driver(effect: Effect, missing: residual_drivers.MissingTorque, axis: Axis) -> FigureDraft:
    what, _, _ = missing.driver.rpartition(",")
    name = effect_name(effect, axis)
    return FigureDraft(
        f"missing_{_file_name(effect.key)}",
        missing_torque.plot_missing_torque(missing, axis),
        caption=f"The {axis.force_name} that the model misses without {name}.",
        alt=f"Missing {axis.force_name} against {what or missing.driver}: the readings lie about the line of the equation.",
    )


def _diagnosed(evidence: ReportData) -> PreparedRuns | None:
    """The runs that were diagnosed: all, or the parts into which they were cut."""
    if evidence.runs is None:
        return None
    return split_runs(evidence.runs.items, evidence.vehicle, evidence.runs.cutoff) or evidence.runs


def _compared(evidence: ReportData) -> Iterator[FigureDraft]:
    """The picture of the first screen, as a file."""
    if not evidence.nested or evidence.extended is None:
        return
    worst, *_ = worst_first(evidence.simulations_without)
    before, after = evidence.simulations_without[worst], evidence.simulations_with[worst]
    yield FigureDraft(
        "diagnosis_gain",
        before_after.plot_before_after(before, after, width=canvas.WIDTH, rows=(2.4, 1.5)),
        caption=f"The worst trial, {before.run.trial.name}, simulated freely without and with what was found.",
        alt=_alt(before, after),
    )


def _left_over(evidence: ReportData) -> Iterator[FigureDraft]:
    diagnosis, runs = evidence.diagnosis, _diagnosed(evidence)
    found = evidence.extended
    if runs is None or diagnosis is None or diagnosis.base is None or found is None:
        return
    axis, vehicle = evidence.axis, evidence.vehicle
    before = unexplained_torques(runs, diagnosis.base.model, vehicle)
    after = unexplained_torques(runs, found.model, vehicle)
    was, now = (vehicle.assumptions.mark_number(_root_mean_square(left), axis.force_unit) for left in (before, after))
    yield FigureDraft(
        "diagnosis_residuals",
        residual_torque.plot_residual_comparison(before, after, runs.cutoff),
        caption=f"The {axis.force_name} that the model leaves over, without and with what was found: {was} and {now} "
        f"{axis.force_unit} root mean square.",
        alt=f"Five panels of the residual {axis.force_name}: {was} {axis.force_unit} root mean square without what was "
        f"found, {now} {axis.force_unit} with it.",
    )


def _root_mean_square(items: Sequence[ResidualTorque]) -> str:
    """Of what is left, in N m or N, as text."""
    left, _, _ = rms_sizes(items)
    return format_number(left, ".3g")


def _closed_loop(evidence: ReportData) -> Iterator[FigureDraft]:
    control = evidence.control
    if control is None:
        return
    courses = paper_step_runs(control)
    effects = bool(control.model.effects)
    full = {run.name: run.metrics for run in control.runs if run.model_aid and run.effects_known == effects}
    steps = "; ".join(f"{name}, {format_number(full[name].overshoot_deg, '.1f')} deg too far" for name in courses)
    yield FigureDraft(
        "closed_loop",
        closed_loop.plot_closed_loop(courses, control.bandwidth),
        caption="Steps of the wanted heading, simulated without noise and disturbance: heading against set point, and "
        "the torque that the controller asks for.",
        alt=f"Heading and torque over time in three steps; with full aid, and disturbed as in the table: {steps}.",
    )


def _file_name(name: str) -> str:
    """``name`` with nothing in it that a file's name may not hold."""
    return re.sub(r"[^A-Za-z0-9]+", "_", name).strip("_")[-60:]
