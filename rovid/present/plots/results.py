"""Plots of results: causes, plans, controllers, compared campaigns, faults of logs, and discovered formulas."""

import textwrap
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from rovid.compare.difference_tests import DifferenceTest
from rovid.control.closed_loop import ClosedLoopRun
from rovid.control.control_law import paper_runs
from rovid.control.design import ControllerDesign
from rovid.core.array_types import FloatArray
from rovid.core.stats import NORMAL_95
from rovid.diagnose.formulas.search import Discovery, Formula
from rovid.diagnose.result import Finding
from rovid.estimate.experiment_design import ExperimentPlan
from rovid.present.number_format import shorten_name
from rovid.present.plots import canvas
from rovid.present.residuals import unexplained_torques
from rovid.present.sentences import effect_title
from rovid.present.tables.diagnosis import ALTERNATIVES_SHOWN, alternative_status
from rovid.trial.axis import Axis
from rovid.trial.fault import Fault
from rovid.trial.preprocessing import PreparedRuns
from rovid.trial.vehicle import Vehicle

# Characters of a cause's name beside its bar.
_NAME_LENGTH = 48
_STATUS_LOOKS = {
    "found": (canvas.BLUE, ""),
    "not ruled out": (canvas.ORANGE, "///"),
    "ruled out": (canvas.GREY, ""),
    "depends on a signal": (canvas.PALE, "..."),
}
# Controllers and plants to be drawn -> whether effects act, whether the model aids, whether the aid knows the effects.
_WITH_EFFECTS = {
    "aid of drag and effects": (True, True, True),
    "aid of drag alone": (True, True, False),
    "the same without effects": (False, True, False),
}
_WITHOUT_EFFECTS = {"aided by the model": (False, True, False), "PD alone": (False, False, False)}
# Duration of a step's plot in units of one over the bandwidth.
_STEP_DURATION = 15.0
_STEP_LOOKS = ((canvas.BLACK, "-"), (canvas.ORANGE, "--"), (canvas.BLUE, "-."))
_MODEL_LOOKS = ((canvas.BLUE, "-"), (canvas.ORANGE, "--"))
_LEGEND_ABOVE: dict[str, Any] = {"loc": "lower right", "bbox_to_anchor": (1.0, 0.97), "borderaxespad": 0.0}
_DRAG_STEPS, _DRAG_NAMES = 200, ["quadratic_drag", "linear_drag"]
# Quantiles of the abscissa that bound the groups of readings, and the largest number of single readings drawn.
_GROUPS, _READINGS = 24, 4000


@canvas.report_style
def plot_alternatives(finding: Finding) -> Figure:
    """Log-likelihood gain of a cause and of its best alternatives; those not ruled out are hatched."""
    bars = 1 + len(finding.alternatives[:ALTERNATIVES_SHOWN])
    figure, ((panel,),) = canvas.panel_grid([(0.3 * bars + 0.15, 1)], left=3.8, right=0.55)
    draw_alternatives(panel, finding)
    canvas.legend_above(figure, *panel.get_legend_handles_labels(), 4)
    return figure


def draw_alternatives(panel: Axes, finding: Finding) -> None:
    """Draw the bars of `plot_alternatives`."""
    axis = finding.estimate.axis
    names, gains, statuses = [effect_title(finding.effect, axis)], [finding.bic_gain], ["found"]
    for other in finding.alternatives[:ALTERNATIVES_SHOWN]:
        names.append(effect_title(other.effect, axis))
        gains.append(other.bic_gain)
        statuses.append(alternative_status(finding, other))
    for status, (colour, hatch) in _STATUS_LOOKS.items():
        rows = [row for row, each in enumerate(statuses) if each == status]
        if rows:
            shown = [gains[row] for row in rows]
            panel.barh(rows, shown, height=0.62, color=colour, hatch=hatch, edgecolor="white", label=status)
    for row, gain in enumerate(gains):
        place: dict[str, Any] = {"xytext": (3, 0), "textcoords": "offset points", "va": "center"}
        panel.annotate(f"{gain:.0f}", (max(gain, 0.0), row), fontsize=9, **place)
    # Two lines: a cause in some trials lists them.
    labels = [textwrap.fill(name, _NAME_LENGTH, max_lines=2, placeholder=" …") for name in names]
    panel.set_yticks(range(len(names)), labels)
    panel.set_ylim(len(names) - 0.5, -0.5)
    panel.axvline(0.0, color=canvas.BLACK, linewidth=0.8)
    panel.margins(x=0.08)
    panel.set_xlabel("log-likelihood gain after the parameter penalty", loc="right")
    panel.grid(visible=False, axis="y")
    panel.set_axisbelow(True)


def paper_step_runs(design: ControllerDesign) -> dict[str, dict[str, ClosedLoopRun]]:
    """Noise-free steps of the founding paper: name of the step -> controller and plant -> run."""
    ways = _WITH_EFFECTS if design.model.effects else _WITHOUT_EFFECTS
    runs = {}
    for run in design.runs:
        runs[run.name, bool(run.effects), run.model_aid, run.effects_known] = run.noise_free_run
    return {step.name: {way: runs[step.name, *key] for way, key in ways.items()} for step in paper_runs()}


@canvas.report_style
def plot_closed_loop(steps: Mapping[str, Mapping[str, ClosedLoopRun]], bandwidth: float) -> Figure:
    """Heading and torque of each step; ``bandwidth`` in rad/s sets the duration that is shown."""
    figure, panels = canvas.panel_grid([(1.5, 2)] * len(steps), top=0.55, across=0.95, down=0.55)
    for (heading, torque), (name, ways) in zip(panels, steps.items(), strict=True):
        for (way, run), (colour, dashes) in zip(ways.items(), _STEP_LOOKS, strict=False):
            early = run.time <= _STEP_DURATION / bandwidth
            time = run.time[early]
            turned = canvas.decimate_min_max(time, np.degrees(run.heading[early]))
            heading.plot(*turned, dashes, color=colour, label=way)
            torque.step(*canvas.decimate_min_max(time, run.torque[early]), dashes, where="post", color=colour)
        heading.plot(time, np.degrees(run.setpoint[early]), ":", color=canvas.GREY, linewidth=1.8, label="set point")
        heading.set(title=name, ylabel="heading, deg")
        torque.set_ylabel("torque, N m")
        torque.axhline(0.0, color=canvas.BLACK, linewidth=0.8)
    for panel in panels[-1]:
        panel.set_xlabel("time, s")
    canvas.legend_above(figure, *panels[0][0].get_legend_handles_labels(), 4)
    return figure


@canvas.report_style
def plot_plan(plan: ExperimentPlan, axis: Axis) -> Figure:
    """Commands and predicted rates of the best run; the difference of two models next to the effect of disturbance."""
    discriminates = len(plan.models) > 1
    rows = [(1.4, 1), (2.0, 1), (1.4, 1)]
    figure, panels = canvas.panel_grid(rows[: 2 + discriminates], left=1.05, down=0.42, top=0.75, share_x=True)
    (command,), (rate,), *more = panels
    best, run = plan.best, plan.best.run
    draw_commands(command, plan)
    if len(plan.thrusters) <= 8:
        command.legend(**_LEGEND_ABOVE, ncols=4)
    figure.suptitle(shorten_name(run.name, 90), x=0.115, ha="left", fontsize=11)
    for model, values, (colour, dashes) in zip(plan.models, best.rates, _MODEL_LOOKS, strict=False):
        rate.plot(run.time, values, dashes, color=colour, label=model.name.replace("_", " "))
    rate.set_ylabel(f"{axis.rate_words},\n{axis.rate_unit}")
    if discriminates:
        rate.legend(**_LEGEND_ABOVE, ncols=2)
    for (difference,) in more:
        band = plan.disturbance_rate
        difference.axhspan(-band, band, color=canvas.PALE, alpha=0.5, label="effect of the disturbance, ± one sd")
        difference.plot(run.time, best.rates[0] - best.rates[1], color=canvas.BLACK, linewidth=1.0, label="difference")
        difference.set_ylabel(f"difference,\n{axis.rate_unit}")
        difference.legend(**_LEGEND_ABOVE, ncols=2)
    panels[-1][0].set_xlabel("time, s")
    return figure


def draw_commands(panel: Axes, plan: ExperimentPlan) -> None:
    """Draw the commands of the best run."""
    # Four kinds of dashes in each of two colours distinguish eight thrusters.
    for place, name in enumerate(plan.thrusters):
        dashes, colour = ("-", "--", ":", "-.")[place % 4], (canvas.BLACK, canvas.GREY)[place // 4 % 2]
        time, commands = plan.best.run.time, plan.best.run.commands[:, place]
        panel.step(time, commands, dashes, where="post", color=colour, linewidth=1.0, label=name)
    panel.set_ylabel("command,\nlogged unit")


def plan_picture(plan: ExperimentPlan, axis: Axis) -> bytes:
    """The plot of a plan as PNG."""
    return canvas.render_png(plot_plan(plan, axis), "plan")


@canvas.report_style
def plot_ratios(changes: DifferenceTest, titles: Mapping[str, str]) -> Figure | None:
    """B over A of each parameter with its 95 % interval; None where no ratio is known."""
    known = _known_ratios(changes)
    if not known:
        return None
    figure, ((panel,),) = canvas.panel_grid([(0.42 * len(known) + 0.3, 1)], left=2.4, top=0.15)
    draw_ratios(panel, changes, titles)
    return figure


def _known_ratios(changes: DifferenceTest) -> dict[str, tuple[float, float]]:
    return {name: ratio for name in changes.pair.names if (ratio := changes.ratio(name)) is not None}


def draw_ratios(panel: Axes, changes: DifferenceTest, titles: Mapping[str, str]) -> None:
    """Draw the intervals of `plot_ratios`."""
    known = _known_ratios(changes)
    for row, (name, (value, error)) in enumerate(known.items()):
        changed = any(name in change.candidate.parameters for change in changes.established)
        colour, filled = (canvas.ORANGE, canvas.ORANGE) if changed else (canvas.BLACK, "white")
        panel.errorbar(value, row, xerr=NORMAL_95 * error, fmt="o", capsize=3, color=colour, markerfacecolor=filled)
    panel.axvline(1.0, color=canvas.GREY, linestyle="--")
    panel.set_yticks(range(len(known)), [titles[name] for name in known])
    panel.set(xlabel="B over A, share of 1, with 95 % interval", ylim=(len(known) - 0.5, -0.5))


@canvas.report_style
def plot_drag(changes: DifferenceTest, fastest: float, axis: Axis) -> Figure | None:
    """Drag of A and of B against the rate up to ``fastest``, with 95 % bands; None where one is not known."""
    pair = changes.pair
    if not set(_DRAG_NAMES) <= set(pair.names):
        return None
    places = list(map(pair.names.index, _DRAG_NAMES))
    block = np.ix_(places, places)
    figure, ((top,), (bottom,)) = canvas.panel_grid([(3.0, 1), (1.5, 1)], top=0.25, down=0.2, share_x=True)
    rate = np.linspace(0.0, fastest, _DRAG_STEPS)
    _plot_band(top, rate, pair.a[places], pair.covariance_a[block], (canvas.BLUE, "-", "A, 95 % band"))
    _plot_band(top, rate, pair.b[places], pair.covariance_b[block], (canvas.ORANGE, "--", "B, 95 % band"))
    _plot_band(bottom, rate, (pair.b - pair.a)[places], pair.covariance[block], (canvas.BLACK, "-", "B less A"))
    bottom.axhline(0.0, color=canvas.GREY, linestyle="--")
    top.set_ylabel(f"drag, {axis.force_unit}")
    bottom.set(xlabel=f"{axis.rate_words}, {axis.rate_unit}", ylabel=f"B less A, {axis.force_unit}")
    top.legend(loc="upper left")
    return figure


def _plot_band(
    panel: Axes, rate: FloatArray, values: FloatArray, covariance: FloatArray, look: tuple[str, str, str]
) -> None:
    """Quadratic and linear drag against the rate with its 95 % band."""
    colour, dashes, name = look
    design = np.column_stack((rate**2, rate))
    line = design @ values
    variance = np.einsum("ni,ij,nj->n", design, covariance, design)
    reach = NORMAL_95 * np.sqrt(np.maximum(variance, 0.0))
    panel.fill_between(rate, line - reach, line + reach, color=colour, alpha=0.2, linewidth=0)
    panel.plot(rate, line, dashes, color=colour, label=name)


@canvas.report_style
def plot_fault(fault: Fault) -> Figure:
    """The signal around a ``fault`` with an excerpt, sample by sample, and the instants of the fault."""
    excerpt = fault.excerpt
    assert excerpt is not None  # noqa: S101 - as said above
    figure, ((axes,),) = canvas.panel_grid([(1.4, 1)], left=0.7, right=0.18, top=0.3, bottom=0.45, width=7.2)
    axes.plot(excerpt.time, excerpt.displayed, ".-", color=canvas.BLACK, markersize=3.0, linewidth=0.7)
    for instant in fault.at:
        if excerpt.time.min() <= instant <= excerpt.time.max():
            axes.axvline(instant, color=canvas.ORANGE, linewidth=1.0)
    axes.set(title=fault.title, xlabel="time, s", ylabel=excerpt.label)
    return figure


@canvas.report_style
def plot_formula(found: Discovery, formula: Formula, runs: PreparedRuns, vehicle: Vehicle) -> Figure:
    """Unexplained torque of the model without the formula, means of groups of readings, and the formula."""
    assert found.grammar is not None  # noqa: S101 - a formula has one
    laws, signals, residuals = [], [], []
    for item in unexplained_torques(runs, formula.without, vehicle):
        name, at = item.run.trial.name, item.run.rates.time
        time, series = item.run.trial.time, found.grammar.series[name]
        law = np.zeros(len(time))
        for k, product in enumerate(formula.products, start=1):
            constants = tuple(map(formula.estimate.value, product.units_of_constants(k)))
            law += formula.estimate.value(f"c{k}") * replace(product, constants=constants).values(series, time)
        signal = series[formula.signals[0]] if formula.signals else np.zeros(len(time))
        laws.append(np.interp(at, time, law))
        signals.append(np.interp(at, time, signal))
        residuals.append(item.residual)
    law, signal, residual = map(np.concatenate, (laws, signals, residuals))
    alone = len(formula.signals) == 1 and not any(product.operator for product in formula.products)
    x = signal if alone else law
    known = np.isfinite(x) & np.isfinite(residual)
    x, law, residual = x[known], law[known], residual[known]
    figure, ((panel,),) = canvas.panel_grid([(3.2, 1)])
    some = slice(None, None, max(len(x) // _READINGS, 1))
    panel.plot(x[some], residual[some], ".", markersize=2, color=canvas.GREY, alpha=0.4)
    edges = np.unique(np.quantile(x, np.linspace(0.0, 1.0, _GROUPS + 1)))
    group = np.clip(np.searchsorted(edges, x, side="right") - 1, 0, max(len(edges) - 2, 0))
    means = [(x[group == k].mean(), residual[group == k].mean()) for k in np.unique(group)]
    panel.plot(*zip(*means, strict=True), "o", color=canvas.BLUE, label="mean of unexplained torque")
    order = np.argsort(x)
    panel.plot(x[order], law[order], color=canvas.ORANGE, label="formula")
    label = "torque of the formula, N m"
    if alone:
        label = f"{formula.signals[0].replace('_', ' ')}, {found.grammar.units[formula.signals[0]]}"
    panel.set(xlabel=label, ylabel="torque, N m")
    panel.legend()
    return figure
