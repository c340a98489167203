"""Plots of models: thrust curves, steady states, sine runs, inertia, and tracks and speeds of the coupled model."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from rovid.core.array_types import FloatArray
from rovid.core.stats import NORMAL_95, t_quantile
from rovid.effects import restoring_effect
from rovid.effects.restoring_curve import regressors
from rovid.estimate.estimate import Estimate
from rovid.estimate.inertia import InertiaFit
from rovid.estimate.oscillation_tests import SineTrial
from rovid.estimate.steady_drag import DragFit
from rovid.model.model import Model
from rovid.planar.trial_simulation import SENSOR_UNITS, PlanarTrialSimulation
from rovid.present.number_format import arm_words, shorten_name, steady_state_words, unit_symbol
from rovid.present.plots.canvas import (
    BLACK,
    BLUE,
    GREEN,
    GREY,
    ORANGE,
    PALE,
    decimate_min_max,
    legend_above,
    panel_grid,
    panel_sheet,
    report_style,
)
from rovid.present.tables.fits import method_interval, method_title
from rovid.trial.axis import Axis
from rovid.trial.preprocessing import Run
from rovid.trial.vehicle import Vehicle

SINES_PER_SHEET = 6
# Characters of a name above a panel that takes the whole width; points of a line.
_NAME_LENGTH, _STEPS = 48, 300
# Of torque or force, rate and acceleration.
_SINE_LOOKS = ((BLUE, "-", "o"), (ORANGE, "--", "s"), (GREEN, ":", "^"))
# Intervals that together take less than this share of the axis from zero are shown a second time, enlarged.
_CROWDED = 0.3


@report_style
def plot_thrust_curves(vehicle: Vehicle, runs: Sequence[Run]) -> Figure | None:
    """Thrust against command, with the commands in use; None for a vehicle whose torque was logged."""
    curves = [(k, item, item.curve) for k, item in enumerate(vehicle.thrusters) if item.curve is not None]
    if not curves:
        return None
    # Four curves stand two by two, others at most three in a row.
    columns = 2 if len(curves) == 4 else min(len(curves), 3)
    figure, panels = panel_sheet(len(curves), columns, 1.9, top=0.75, across=0.85, down=0.95)
    for panel, (k, thruster, curve) in zip(panels, curves, strict=True):
        commands = np.concatenate([np.empty(0), *(run.trial.commands[:, k] for run in runs)])
        used = commands[np.isfinite(commands)]
        panel.plot(curve.command, curve.thrust, color=BLACK, linewidth=1.0, label="bench curve")
        if used.size:
            low, high = float(used.min()), float(used.max())
            panel.axvspan(low, high, color=ORANGE, alpha=0.13, linewidth=0)
            inside = curve.command[(curve.command > low) & (curve.command < high)]
            command = np.concatenate(([low], inside, [high]))
            (line,) = panel.plot(command, curve(command), color=BLUE, linewidth=3.2, label="commands that the logs use")
            line.set_solid_capstyle("butt")
        panel.set(xlabel="command", ylabel="thrust, N")
        panel.locator_params(nbins=6)
        words, unit = ("arm", " m") if vehicle.axis.angular else (arm_words(vehicle.axis)[0], "")
        lever = f"{words} {thruster.arm:.3g}{unit}"
        panel.set_title(f"{shorten_name(thruster.name, _NAME_LENGTH // columns)}, {lever}", fontsize=9)
    legend_above(figure, *panels[0].get_legend_handles_labels(), 3, loc="upper left", bbox_to_anchor=(0.09, 1.0))
    return figure


@report_style
def plot_steady_states(fit: DragFit) -> Figure:
    """Torque against rate with the fitted drag, its 95 % band, and the residuals."""
    figure, ((top,), (bottom,)) = panel_grid([(3.6, 1), (1.5, 1)], top=0.6, down=0.2, share_x=True)
    axis, estimate = fit.estimate.axis, fit.estimate
    rates = np.array([0.0, *(point.rate for point in (*fit.points, *fit.unsteady))])
    line = np.linspace(1.05 * rates.min(), 1.05 * rates.max(), _STEPS)
    design = _regressors(estimate, line)
    drag = design @ estimate.values
    # Two or fewer points leave no error. Rounding may leave a small variance below zero.
    if np.isfinite(estimate.covariance).all():
        variance = np.einsum("ni,ij,nj->n", design, estimate.covariance, design)
        reach = t_quantile(0.975, estimate.degrees_of_freedom) * np.sqrt(np.maximum(variance, 0.0))
        top.fill_between(line, drag - reach, drag + reach, color=BLUE, alpha=0.22, linewidth=0, label="95 % band")
        bottom.fill_between(line, -reach, reach, color=BLUE, alpha=0.22, linewidth=0)
    buoyancy = " + B" if len(estimate.names) > 2 else ""
    top.plot(line, drag, color=BLUE, label=f"fit: DQ·|r|·r + DL·r{buoyancy}")
    bottom.axhline(0.0, color=BLUE)
    _plot_points(top, fit, np.array([point.torque for point in fit.points]))
    _plot_points(bottom, fit, fit.residuals)
    if fit.unsteady:
        unsteady = [point.rate for point in fit.unsteady], [point.torque for point in fit.unsteady]
        top.plot(*unsteady, "x", color=GREY, markersize=6, label="rate still changing: not fitted")
    for name, direction in fit.directions.items():
        part = line[line >= 0] if name == "up" else line[line <= 0]
        own, both = (_regressors(one, part) @ one.values for one in (direction, estimate))
        bottom.plot(part, own - both, color=ORANGE, linestyle="--")
    if fit.directions:
        top.plot([], [], color=ORANGE, linestyle="--", label="each direction alone, below")
    top.set_ylabel(f"{axis.force_name}, {axis.force_unit}")
    bottom.set(xlabel=f"{axis.rate_words}, {axis.rate_unit}", ylabel=f"residual, {axis.force_unit}")
    legend_above(figure, *top.get_legend_handles_labels(), 3)
    return figure


def _regressors(estimate: Estimate, rate: FloatArray) -> FloatArray:
    """(n, p) regressors of the drag parameters, and of a net buoyancy where the axis has one."""
    buoyancy = regressors(restoring_effect(estimate.axis), np.zeros(len(rate)))
    return np.column_stack((np.abs(rate) * rate, rate, buoyancy))


def _plot_points(panel: Axes, fit: DragFit, values: FloatArray) -> None:
    """Steady states with their errors, by direction."""
    axis, rate = fit.estimate.axis, np.array([point.rate for point in fit.points])
    for rows, filled, text in ((rate > 0, BLACK, "growing"), (rate < 0, "white", "falling")):
        if rows.any():
            errors = fit.torque_error[rows] if fit.torque_error_known else None
            label = f"{steady_state_words(axis)}, {axis.position_words} {text}"
            look: dict[str, Any] = {"color": BLACK, "markerfacecolor": filled, "markersize": 5, "elinewidth": 1.2}
            panel.errorbar(rate[rows], values[rows], yerr=errors, fmt="o", label=label, **look)


@report_style
def plot_sine_runs(trials: Sequence[SineTrial], drag: Model | None, axis: Axis) -> Figure:
    """Mean period of each run: torque, rate and acceleration over time, and torque over rate."""
    figure, panels = panel_grid([(1.85, 2)] * len(trials), top=0.75, down=0.85)
    for (over_time, loop), trial in zip(panels, trials, strict=True):
        motion = trial.motion
        waves = list(map(motion.over_one_period, (motion.torque, motion.rate, motion.acceleration())))
        # All peaks are taken on the side of the largest torque.
        side = np.sign(waves[0][np.argmax(np.abs(waves[0]))])
        peaks = [int(np.argmax(side * values)) for values in waves]
        names = (axis.force_name, axis.rate_words, "acceleration")
        for name, (colour, dash, marker), values, peak in zip(names, _SINE_LOOKS, waves, peaks, strict=True):
            share = values / np.max(np.abs(values))
            time = np.arange(len(values) + 1) * trial.period / len(values)
            over_time.plot(time, np.append(share, share[0]), color=colour, linestyle=dash, label=name)
            over_time.vlines(time[peak], 0.0, share[peak], color=colour, linewidth=0.8)
            over_time.plot(time[peak], share[peak], marker, color=colour, markersize=6)
        over_time.set_title(f"{shorten_name(trial.source, 26)}: mean of {trial.cycles} periods of {trial.period:.3g} s")
        over_time.set(xlabel="time in the period, s", xlim=(0.0, trial.period))
        over_time.set(ylabel="share of its peak", ylim=(-1.15, 1.15))
        _plot_loop(loop, waves, peaks, drag, axis)
    for panel, columns in zip(panels[0], (3, 2), strict=True):
        handles, labels = panel.get_legend_handles_labels()
        panel.legend(handles, labels, loc="lower left", bbox_to_anchor=(-0.02, 1.15), ncols=columns, borderaxespad=0.0)
    return figure


def _plot_loop(panel: Axes, waves: list[FloatArray], peaks: list[int], drag: Model | None, axis: Axis) -> None:
    """Torque over rate in one period, with the moments of the peaks and the steady drag."""
    torque, rate, _ = waves
    if drag is not None:
        line = np.linspace(rate.min(), rate.max(), 200)
        # Axes with sine runs have a net buoyancy at most, which does not depend on the position.
        steady = drag.drag(line) + sum(drag.restoring_values)
        panel.plot(line, steady, color=GREY, linewidth=1.2, linestyle="-.", label="steady drag")
    panel.plot(np.append(rate, rate[0]), np.append(torque, torque[0]), color=BLUE)
    names = (axis.force_name, "rate", "acceleration")
    for name, (colour, _, marker), peak in zip(names, _SINE_LOOKS, peaks, strict=True):
        panel.plot(rate[peak], torque[peak], marker, color=colour, markersize=6, label=f"{name} peaks here")
    panel.set(xlabel=f"{axis.rate_words}, {axis.rate_unit}", ylabel=f"{axis.force_name}, {axis.force_unit}")


@report_style
def plot_inertia_methods(fit: InertiaFit, rigid_body: float | None, model: tuple[float, float] | None = None) -> Figure:
    """Inertia by each method with its 95 % interval and single runs; enlarged a second time where they crowd.

    ``model``: inertia of the model and its standard error, for comparison.
    """
    names = list(fit.methods)
    unbiased = [name for name in names if name != "peak"]
    intervals = [method_interval(fit, name) for name in unbiased]
    ends = [end for interval in intervals if interval is not None for end in interval]
    crowded = len(names) >= 2 and bool(ends) and max(ends) - min(ends) < _CROWDED * max(ends)
    rows = [(0.5 * len(names) + 0.3, 2 if crowded else 1)]
    figure, ((whole, *more),) = panel_grid(rows, left=1.75, across=0.4, top=0.62)
    _plot_methods(whole, fit, names)
    bias = "" if fit.peak_bias is None else f": {100.0 * fit.peak_bias:.0f} % of true"
    notes = {fit.chosen: "\n(best of these)", "peak": f"\n(biased{bias})"}
    labels = [f"{method_title(name)}{notes.get(name, '')}" for name in names]
    whole.set_yticks(range(len(names)), labels)
    whole.set(title="from zero", xlim=(0.0, None))
    if rigid_body is not None:
        whole.axvline(rigid_body, color=GREY, linestyle="--", label="rigid body alone")
    if model is not None:
        value, reach = model[0], NORMAL_95 * np.nan_to_num(model[1], posinf=0.0)
        for panel in (whole, *more):
            panel.axvspan(value - reach, value + reach, color=GREEN, alpha=0.25, label="the model, 95 %")
            panel.axvline(value, color=GREEN, linewidth=1.0)
    if whole.get_legend_handles_labels()[0]:
        legend_above(figure, *whole.get_legend_handles_labels(), 2)
    for enlarged in more:
        _plot_methods(enlarged, fit, unbiased)
        below = enlarged.get_position().x0 == whole.get_position().x0
        own = [label if below and name in unbiased else "" for label, name in zip(labels, names, strict=True)]
        enlarged.set_yticks(range(len(names)), own)
        enlarged.locator_params(axis="x", nbins=6)
        enlarged.set_title("enlarged, without the peak method" if "peak" in fit.methods else "enlarged")
    return figure


def _plot_methods(panel: Axes, fit: InertiaFit, names: list[str]) -> None:
    """Each method on the row of its place among all methods."""
    every = list(fit.methods)
    looks = {"peak": (ORANGE, "x"), fit.chosen: (BLUE, "o")}
    for name in names:
        reading, row = fit.methods[name], every.index(name)
        colour, marker = looks.get(name, (BLACK, "o"))
        for _, value, _ in reading.runs:
            panel.plot(value, row + 0.26, "|", color=colour, markersize=7)
        interval = method_interval(fit, name)
        if interval is not None:
            half_width = 0.5 * (interval[1] - interval[0])
            panel.errorbar(reading.value, row, xerr=half_width, color=colour, capsize=4, elinewidth=1.6)
        panel.plot(reading.value, row, marker, color=colour, markersize=6, markeredgewidth=1.8)
    panel.set(xlabel=f"inertia, {unit_symbol(fit.estimate.unit('inertia'))}", ylim=(len(every) - 0.45, -0.55))
    panel.grid(visible=False, axis="y")


TRACKS_SHOWN, _COLUMNS = 9, 3
# Marks on each track at equal times: a track alone does not show the speed.
_MARKS = 6
_SPEED_NAMES = {"surge_velocity": "surge u", "sway_velocity": "sway v", "yaw_rate": "yaw rate r"}
_FORCE_UNITS = {"surge": "N", "sway": "N", "yaw": "N m"}


@report_style
def plot_tracks(before: Sequence[PlanarTrialSimulation], after: Sequence[PlanarTrialSimulation]) -> Figure:
    """Simulated tracks over the measured positions, north up, at equal scale; two simulations where they differ."""
    margins = {"left": 0.75, "top": 0.6, "bottom": 0.55, "across": 0.6, "down": 0.55}
    figure, panels = panel_sheet(len(after), min(len(after), _COLUMNS), 2.6, **margins)
    for panel, base, full in zip(panels, before, after, strict=True):
        run = full.run
        if {"north", "east"} <= set(run.sensors):
            north, east = run.readings("north"), run.readings("east")
            across = np.interp(north.time, east.time, east.values)
            panel.plot(across, north.values, color=PALE, linewidth=3.6, label="measured")
        if base is not full:
            panel.plot(base.motion.east, base.motion.north, "--", color=ORANGE, linewidth=1.1, label="plain model")
        name = "simulated" if base is full else "extended model"
        panel.plot(full.motion.east, full.motion.north, color=BLACK, linewidth=1.1, label=name)
        panel.plot(full.motion.east[0], full.motion.north[0], "o", color=BLACK, markersize=4)
        marks = np.linspace(0.0, full.motion.time[-1], _MARKS)[1:]
        places = np.searchsorted(full.motion.time, marks).clip(max=len(full.motion.time) - 1)
        panel.plot(full.motion.east[places], full.motion.north[places], ".", color=BLACK, markersize=4)
        panel.set_aspect("equal", adjustable="datalim")
        panel.set_title(shorten_name(run.name, 22), fontsize=9, pad=3)
        if math.isfinite(full.track_rms):
            panel.set_title(f"{full.track_rms:.2g} m RMS", fontsize=8, loc="right", pad=3)
        panel.tick_params(labelsize=8)
        panel.locator_params(nbins=5)
    figure.supxlabel("east, m", y=0.06 / figure.get_figheight(), fontsize=10, va="bottom")
    figure.supylabel("north, m", x=0.01, fontsize=10, ha="left")
    legend_above(figure, *panels[0].get_legend_handles_labels(), 4, loc="upper left", bbox_to_anchor=(0.07, 1.0))
    return figure


@report_style
def plot_speeds(base: PlanarTrialSimulation, full: PlanarTrialSimulation) -> Figure:
    """Surge, sway and yaw rate of one run: measured, and simulated without and with the causes."""
    shown = {speed: title for speed, title in _SPEED_NAMES.items() if np.any(getattr(full.motion, speed))}
    figure, panels = panel_grid([(1.25, 1)] * len(shown), left=0.95, top=0.55, down=0.16, share_x=True)
    for (panel,), (speed, title) in zip(panels, shown.items(), strict=True):
        if speed in full.measured:
            measured = full.measured[speed]
            panel.plot(*decimate_min_max(measured.time, measured.values), color=PALE, linewidth=3.6, label="measured")
        if base is not full:
            simulated = _speed(base, speed)
            panel.plot(*decimate_min_max(*simulated), "--", color=ORANGE, linewidth=1.1, label="plain model")
        name = "simulated" if base is full else "extended model"
        panel.plot(*decimate_min_max(*_speed(full, speed)), color=BLACK, linewidth=1.1, label=name)
        panel.set_ylabel(f"{title},\n{SENSOR_UNITS[speed]}")
        panel.locator_params(axis="y", nbins=5)
        if speed in full.fits and math.isfinite(full.fits[speed].r2):
            panel.set_title(f"R² {full.fits[speed].r2:.3f}", fontsize=8, loc="right", pad=2)
    panels[0][0].set_title(shorten_name(full.name, 48))
    handles: dict[str, Artist] = {}
    for (panel,) in panels:
        drawn, labels = panel.get_legend_handles_labels()
        handles |= dict(zip(labels, drawn, strict=True))
    legend_above(figure, list(handles.values()), list(handles), 3)
    panels[-1][0].set(xlabel="time, s", xlim=(0.0, full.motion.time[-1]))
    figure.align_ylabels()
    return figure


def _speed(item: PlanarTrialSimulation, speed: str) -> tuple[FloatArray, FloatArray]:
    """Time and simulated speed; a rate that comes from the heading is compared with one from the heading."""
    if speed in item.measured:
        return item.measured[speed].time, item.simulated[speed]
    return item.motion.time, np.asarray(getattr(item.motion, speed))


@report_style
def plot_missing_forces(
    name: str, time: FloatArray, before: Mapping[str, FloatArray], after: Mapping[str, FloatArray]
) -> Figure:
    """Smoothed forces that each model misses in one run, by axis; one line where both are the same."""
    figure, panels = panel_grid([(1.15, 1)] * len(after), left=0.95, top=0.55, down=0.16, share_x=True)
    for (panel,), (axis, force) in zip(panels, after.items(), strict=True):
        if before is not after:
            base = decimate_min_max(time, before[axis])
            panel.plot(*base, "--", color=ORANGE, linewidth=1.1, label="missing in the plain model")
        label = "missing" if before is after else "missing in the extended model"
        panel.plot(*decimate_min_max(time, force), color=BLUE, linewidth=1.1, label=label)
        panel.axhline(0.0, color=BLACK, linewidth=0.6)
        panel.set_ylabel(f"{axis},\n{_FORCE_UNITS[axis]}")
        panel.locator_params(axis="y", nbins=5)
    panels[0][0].set_title(shorten_name(name, 48))
    legend_above(figure, *panels[0][0].get_legend_handles_labels(), 2)
    figure.align_ylabels()
    panels[-1][0].set_xlabel("time, s")
    return figure


@report_style
def plot_turning_curve(curve: FloatArray, *, angle: bool) -> Figure:
    """R' of steady turns against (points, 2) steering; ``angle``: in rad, else a share of the largest torque."""
    figure, ((panel,),) = panel_grid([(2.2, 1)], left=0.75)
    panel.plot(np.degrees(curve[:, 0]) if angle else curve[:, 0], curve[:, 1], "o-", color=BLACK, markersize=4)
    panel.set(xlabel="rudder angle, deg" if angle else "torque over the largest torque", ylabel="r' = r·L/U")
    return figure
