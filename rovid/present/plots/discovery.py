"""The plot of a formula over the torque that the model without it leaves unexplained."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from rovid.diagnose.formulas.discovery import Discovery, Formula
from rovid.model.model import Model
from rovid.present.plots.canvas import BLUE, GREY, ORANGE, panel_grid, render_png, report_style
from rovid.present.residuals import unexplained_torques
from rovid.signals.preprocessing import PreparedRuns
from rovid.trial.vehicle import Vehicle

# Quantiles of the abscissa that bound the groups of readings, and the largest number of single readings drawn.
_GROUPS, _READINGS = 24, 4000


@report_style
def plot_formula(found: Discovery, formula: Formula, runs: PreparedRuns, vehicle: Vehicle) -> Figure:
    """Unexplained torque of the model without the formula, means of groups of readings, and the formula."""
    law, signal, residual = _law_and_residual(found, formula, runs, formula.without, vehicle)
    alone = len(formula.signals) == 1 and not any(product.memory for product in formula.products)
    x = signal if alone else law
    known = np.isfinite(x) & np.isfinite(residual)
    x, law, residual = x[known], law[known], residual[known]
    figure, ((panel,),) = panel_grid([(3.2, 1)])
    some = slice(None, None, max(len(x) // _READINGS, 1))
    panel.plot(x[some], residual[some], ".", markersize=2, color=GREY, alpha=0.4)
    edges = np.unique(np.quantile(x, np.linspace(0.0, 1.0, _GROUPS + 1)))
    group = np.clip(np.searchsorted(edges, x, side="right") - 1, 0, max(len(edges) - 2, 0))
    means = [(x[group == k].mean(), residual[group == k].mean()) for k in np.unique(group)]
    panel.plot(*zip(*means, strict=True), "o", color=BLUE, label="mean of unexplained torque")
    order = np.argsort(x)
    panel.plot(x[order], law[order], color=ORANGE, label="formula")
    units = found.grammar.units if found.grammar else {}
    own = formula.signals[0] if formula.signals else ""
    panel.set_xlabel(f"{own.replace('_', ' ')}, {units[own]}" if alone else "torque of the formula, N m")
    panel.set_ylabel("torque, N m")
    panel.legend()
    return figure


def formula_picture(found: Discovery, formula: Formula, runs: PreparedRuns, vehicle: Vehicle) -> bytes:
    """`plot_formula` as PNG."""
    return render_png(plot_formula(found, formula, runs, vehicle), "formula")


def _law_and_residual(
    found: Discovery, formula: Formula, runs: PreparedRuns, model: Model, vehicle: Vehicle
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(m,) torque of the formula in N m, its first signal, and the unexplained torque in N m, at all known rates."""
    assert found.grammar is not None  # noqa: S101 - a formula has one
    laws, signals, residuals = [], [], []
    for item in unexplained_torques(runs, model, vehicle):
        name, at = item.run.trial.name, item.run.rates.time
        time, series = item.run.trial.time, found.grammar.series[name]
        law = np.zeros(len(time))
        for k, product in enumerate(formula.products, start=1):
            fitted = product.with_memory(formula.estimate.value(f"tau{k}")) if product.memory else product
            law += formula.estimate.value(f"c{k}") * fitted.values(series, time)
        signal = series[formula.signals[0]] if formula.signals else np.zeros(len(time))
        laws.append(np.interp(at, time, law))
        signals.append(np.interp(at, time, signal))
        residuals.append(item.residual)
    return np.concatenate(laws), np.concatenate(signals), np.concatenate(residuals)
