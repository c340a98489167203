"""Torque, or force, against rate in steady states."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from rovid.core.array_types import FloatArray
from rovid.core.stats import t_quantile
from rovid.effects import restoring_effect
from rovid.effects.restoring import regressors
from rovid.estimate.estimate import Estimate
from rovid.estimate.steady_drag import DragFit
from rovid.present.number_text import steady_state_words
from rovid.present.plots.canvas import BLACK, BLUE, GREY, ORANGE, panel_grid, report_style

_STEPS = 300


@report_style
def plot_steady_states(fit: DragFit) -> Figure:
    """Torque against rate with the fitted line, its 95 % band, and the residuals."""
    figure, ((top,), (bottom,)) = panel_grid([(3.6, 1), (1.5, 1)], top=0.25, down=0.2, share_x=True)
    axis = fit.estimate.axis
    rate = np.array([point.rate for point in fit.points])
    torque = np.array([point.torque for point in fit.points])
    line = _line(fit)
    _fitted(top, bottom, fit.estimate, line)
    _points(top, fit, rate, torque)
    _points(bottom, fit, rate, fit.residuals)
    if fit.unsteady:
        _unsteady(top, fit)
    _each_direction(bottom, fit, line)
    if fit.directions:
        top.plot([], [], color=ORANGE, linestyle="--", label="each direction alone, below")
    top.set_ylabel(f"{axis.force_name}, {axis.force_unit}")
    bottom.set_ylabel(f"residual, {axis.force_unit}")
    bottom.set_xlabel(f"{axis.rate_words}, {axis.rate_unit}")
    top.legend(loc="upper left")
    return figure


def _fitted(top: Axes, bottom: Axes, estimate: Estimate, line: FloatArray) -> None:
    """The line of the fit and its band; below, where it is zero, the band alone."""
    reach = _reach(estimate, line)
    drag = _drag(estimate, line)
    if reach is not None:
        top.fill_between(line, drag - reach, drag + reach, color=BLUE, alpha=0.22, linewidth=0, label="95 % band")
        bottom.fill_between(line, -reach, reach, color=BLUE, alpha=0.22, linewidth=0)
    buoyancy = " + B" if len(estimate.names) > 2 else ""
    top.plot(line, drag, color=BLUE, label=f"fit: DQ·|r|·r + DL·r{buoyancy}")
    bottom.axhline(0.0, color=BLUE)


def _unsteady(panel: Axes, fit: DragFit) -> None:
    """Holds in which the rate still changed."""
    rates = [point.rate for point in fit.unsteady]
    torques = [point.torque for point in fit.unsteady]
    panel.plot(rates, torques, "x", color=GREY, markersize=6, label="rate still changing: not fitted")


def _line(fit: DragFit) -> FloatArray:
    """(n,) rates in rad/s or m/s, from a little below all points to a little above."""
    rates = [0.0, *(point.rate for point in (*fit.points, *fit.unsteady))]
    return np.linspace(1.05 * min(rates), 1.05 * max(rates), _STEPS)


def _design(estimate: Estimate, rate: FloatArray) -> FloatArray:
    """(n, p) what each of the estimate's parameters is multiplied by: those of drag, and a net buoyancy."""
    more = regressors(restoring_effect(estimate.axis), np.zeros(len(rate)))
    return np.column_stack((np.abs(rate) * rate, rate, more))


def _drag(estimate: Estimate, rate: FloatArray) -> FloatArray:
    """(n,) N m or N at each rate."""
    return np.asarray(_design(estimate, rate) @ estimate.values)


def _reach(estimate: Estimate, rate: FloatArray) -> FloatArray | None:
    """Half the width of the 95 % band in N m or N; None where two or fewer points leave no error to speak of."""
    if not np.isfinite(estimate.covariance).all():
        return None
    design = _design(estimate, rate)
    variance = np.einsum("ni,ij,nj->n", design, estimate.covariance, design)
    # Where the line is sure round-off may leave a variance just below zero.
    errors = np.sqrt(np.maximum(variance, 0.0))
    return np.asarray(t_quantile(0.975, estimate.degrees_of_freedom) * errors)


def _points(panel: Axes, fit: DragFit, rate: FloatArray, values: FloatArray) -> None:
    axis = fit.estimate.axis
    for rows, filled, text in ((rate > 0, BLACK, "growing"), (rate < 0, "white", "falling")):
        if not rows.any():
            continue
        errors = fit.torque_error[rows] if fit.torque_error_known else None
        label = f"{steady_state_words(axis)}, {axis.position_words} {text}"
        _error_bars(panel, rate[rows], values[rows], errors, filled, label)


def _error_bars(panel: Axes, x: FloatArray, y: FloatArray, errors: FloatArray | None, filled: str, label: str) -> None:
    panel.errorbar(
        x, y, yerr=errors, fmt="o", color=BLACK, markerfacecolor=filled, markersize=5, elinewidth=1.2, label=label
    )


def _each_direction(panel: Axes, fit: DragFit, line: FloatArray) -> None:
    """Each direction's own fit, less the fit of both."""
    for name, estimate in fit.directions.items():
        part = line[line >= 0] if name == "up" else line[line <= 0]
        apart = _drag(estimate, part) - _drag(fit.estimate, part)
        panel.plot(part, apart, color=ORANGE, linestyle="--")
