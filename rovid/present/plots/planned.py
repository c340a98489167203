"""A run to come: its commands, and what each model predicts."""

from __future__ import annotations

from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from rovid.design.experiment_design import ExperimentPlan
from rovid.present.plots.canvas import (
    BLACK,
    BLUE,
    GREY,
    ORANGE,
    PALE,
    panel_grid,
    render_png,
    report_style,
    shorten_name,
)
from rovid.trial.axis import Axis

_LOOKS = ((BLUE, "-"), (ORANGE, "--"))
_ABOVE: dict[str, Any] = {"loc": "lower right", "bbox_to_anchor": (1.0, 0.97), "borderaxespad": 0.0}


@report_style
def plot_plan(plan: ExperimentPlan, axis: Axis) -> Figure:
    """Commands, predicted rates, and by how much these differ beside what the disturbance drives."""
    rivals = len(plan.models) > 1
    rows = [(1.4, 1), (2.0, 1)]
    if rivals:
        rows.append((1.4, 1))
    figure, panels = panel_grid(rows, left=1.05, down=0.42, top=0.75, share_x=True)
    (command,), (rate,), *more = panels
    _commands(command, plan)
    figure.suptitle(shorten_name(plan.best.run.name, 90), x=0.115, ha="left", fontsize=11)
    _rates(rate, plan, axis)
    if rivals:
        rate.legend(**_ABOVE, ncols=2)
    for (apart,) in more:
        _difference(apart, plan, axis)
    panels[-1][0].set_xlabel("time, s")
    return figure


def _commands(panel: Axes, plan: ExperimentPlan) -> None:
    """Four kinds of dashes in each of two colours: as many thrusters can be told apart, and have a legend."""
    run = plan.best.run
    for at, name in enumerate(plan.thrusters):
        dashes = ("-", "--", ":", "-.")[at % 4]
        colour = (BLACK, GREY)[at // 4 % 2]
        panel.step(run.time, run.commands[:, at], dashes, where="post", color=colour, linewidth=1.0, label=name)
    panel.set_ylabel("command")
    if len(plan.thrusters) <= 8:
        panel.legend(**_ABOVE, ncols=4)


def _rates(panel: Axes, plan: ExperimentPlan, axis: Axis) -> None:
    """What each model makes of the best run."""
    best = plan.best
    for belief, values, (colour, dashes) in zip(plan.models, best.rates, _LOOKS, strict=False):
        panel.plot(best.run.time, values, dashes, color=colour, label=belief.name.replace("_", " "))
    panel.set_ylabel(f"{axis.rate_words},\n{axis.rate_unit}")


def _difference(panel: Axes, plan: ExperimentPlan, axis: Axis) -> None:
    best, band = plan.best, plan.disturbance_rate
    panel.axhspan(-band, band, color=PALE, alpha=0.5, label="what the disturbance drives, ± one sd")
    panel.plot(best.run.time, best.rates[0] - best.rates[1], color=BLACK, linewidth=1.0, label="difference")
    panel.set_ylabel(f"difference,\n{axis.rate_unit}")
    panel.legend(**_ABOVE, ncols=2)


def plan_picture(plan: ExperimentPlan, axis: Axis) -> bytes:
    """The same as PNG."""
    return render_png(plot_plan(plan, axis), "plan")
