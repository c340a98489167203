"""The report's figures. Each function takes evidence and returns a figure; nothing is written here."""

from __future__ import annotations

import io
import math
from collections.abc import Sequence
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from scipy import signal

from rovid.identify.estimate import student_t
from rovid.identify.inertia import METHODS, InertiaFit
from rovid.identify.sine import SineTrial
from rovid.identify.steady import DragFit
from rovid.model import Model
from rovid.runs import Run
from rovid.simulation import TrialSimulation
from rovid.trial import FloatArray
from rovid.vehicle import Vehicle

# Okabe and Ito's palette: told apart by every kind of colour vision; markers and dashes say the same again.
BLUE, ORANGE, GREEN, RED, GREY = "#0072B2", "#D55E00", "#009E73", "#CC3311", "#777777"
STYLE: dict[Any, Any] = {
    "font.size": 10,
    "axes.titlesize": 11,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.color": "#dddddd",
    "grid.linewidth": 0.6,
    "figure.facecolor": "white",
    "legend.frameon": False,
    "lines.linewidth": 1.4,
    "svg.hashsalt": "rovid",
    "path.simplify": True,
}
Panels = np.ndarray[tuple[int, ...], np.dtype[Any]]
_PNG_DPI = 120
_WIDTH = 8.0
_POINTS = 1000


def render(figure: Figure, kind: str) -> bytes:
    """The figure as ``kind`` (png or svg), without dates, so that the same evidence gives the same bytes."""
    buffer = io.BytesIO()
    metadata = {"Date": None} if kind == "svg" else {"Software": None}
    with mpl.rc_context(STYLE):
        figure.savefig(buffer, format=kind, dpi=_PNG_DPI, metadata=metadata)
    # The layout, half of the work, is the same for the next kind.
    figure.set_layout_engine("none")
    return buffer.getvalue()


def _axes(rows: int, columns: int, *, height: float, ratios: Sequence[float] | None = None) -> tuple[Figure, Panels]:
    """A grid of panels; panels with height ``ratios`` share their horizontal axis."""
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(_WIDTH, height), layout="constrained")
        return figure, figure.subplots(
            rows, columns, squeeze=False, sharex=ratios is not None, gridspec_kw={"height_ratios": ratios or [1] * rows}
        )


def extremes(time: FloatArray, values: FloatArray, count: int = _POINTS) -> tuple[FloatArray, FloatArray]:
    """At most about ``count`` points of a long series, with the lowest and highest of each stretch kept."""
    size = -(-2 * len(values) // count)
    if size <= 2:
        return time, values
    usable = len(values) // size * size
    blocks = values[:usable].reshape(-1, size)
    filled_low, filled_high = np.where(np.isnan(blocks), np.inf, blocks), np.where(np.isnan(blocks), -np.inf, blocks)
    pick = np.sort(np.stack((filled_low.argmin(axis=1), filled_high.argmax(axis=1)), axis=1), axis=1)
    rows = (pick + size * np.arange(len(blocks))[:, None]).ravel()
    return time[rows], values[rows]


def steady_torque(fit: DragFit) -> Figure:
    """Torque against rate with the fitted line, its 95 % band, and the residuals."""
    figure, axes = _axes(2, 1, height=6.0, ratios=(3, 1))
    top, bottom = axes[:, 0]
    rate = np.array([point.yaw_rate for point in fit.points])
    torque = np.array([point.torque for point in fit.points])
    line = np.linspace(min(0.0, 1.05 * rate.min()), max(0.0, 1.05 * rate.max()), 300)
    design = np.column_stack((np.abs(line) * line, line))
    drag = design @ fit.estimate.values
    reach = student_t(0.975, fit.estimate.degrees_of_freedom) * np.sqrt(
        np.einsum("ni,ij,nj->n", design, np.nan_to_num(fit.estimate.covariance), design)
    )
    top.fill_between(line, drag - reach, drag + reach, color=BLUE, alpha=0.2, linewidth=0, label="95 % band")
    top.plot(line, drag, color=BLUE, label="DQ·|r|·r + DL·r")
    errors = fit.torque_error if np.any(fit.torque_error != 1.0) else None
    top.errorbar(rate, torque, yerr=errors, fmt="o", color="black", markersize=4.5, label="steady states")
    if fit.unsteady:
        top.plot(
            [point.yaw_rate for point in fit.unsteady],
            [point.torque for point in fit.unsteady],
            "x",
            color=GREY,
            label="still changing, not fitted",
        )
    top.set_ylabel("torque, N m")
    top.legend()
    bottom.axhline(0.0, color=BLUE, linewidth=1.0)
    bottom.errorbar(rate, fit.residuals, yerr=errors, fmt="o", color="black", markersize=4.5)
    bottom.set_ylabel("residual, N m")
    bottom.set_xlabel("yaw rate, rad/s")
    return figure


def sine_runs(trials: Sequence[SineTrial]) -> Figure:
    """Each sine run's mean period: torque, rate and acceleration, and torque over rate."""
    figure, axes = _axes(len(trials), 2, height=2.7 * len(trials) + 0.3)
    for row, trial in zip(axes, trials, strict=True):
        _one_period(row[0], trial)
        _loop(row[1], trial)
    return figure


def _one_period(axes: Axes, trial: SineTrial) -> None:
    wave = trial.wave
    curves = (
        ("torque", wave.torque, BLUE, "-", "N m"),
        ("rate", wave.rate, ORANGE, "--", "rad/s"),
        ("acceleration", wave.acceleration(), GREEN, ":", "rad/s²"),
    )
    for name, amplitudes, colour, dash, unit in curves:
        values = wave.over_one_period(amplitudes)
        peak = float(np.max(np.abs(values)))
        time = np.linspace(0.0, trial.period, len(values), endpoint=False)
        axes.plot(time, values / peak, color=colour, linestyle=dash, label=f"{name}, peak {peak:.3g} {unit}")
        axes.plot(time[np.argmax(values)], float(np.max(values)) / peak, "o", color=colour, markersize=5)
    axes.set_title(f"{trial.source}: {trial.cycles} periods of {trial.period:.3g} s", loc="left")
    axes.set_xlabel("time in the period, s")
    axes.set_ylabel("share of peak")
    axes.set_ylim(-1.15, 2.1)
    axes.legend(fontsize=8, loc="upper left")


def _loop(axes: Axes, trial: SineTrial) -> None:
    wave = trial.wave
    rate, torque = wave.over_one_period(wave.rate), wave.over_one_period(wave.torque)
    axes.plot(np.append(rate, rate[0]), np.append(torque, torque[0]), color=BLUE)
    at = int(np.argmax(rate))
    axes.plot(rate[at], torque[at], "s", color=ORANGE, label="peak rate: no acceleration here")
    axes.set_xlabel("yaw rate, rad/s")
    axes.set_ylabel("torque, N m")
    axes.legend(fontsize=8, loc="upper left")
    axes.margins(y=0.25)


def inertia_methods(fit: InertiaFit, rigid_body: float | None) -> Figure:
    """Inertia by each method with its 95 % interval: all of them, and the unbiased ones enlarged."""
    figure, axes = _axes(1, 2, height=0.55 * len(fit.methods) + 1.4)
    everything, enlarged = axes[0]
    for panel, names in ((everything, list(fit.methods)), (enlarged, [n for n in fit.methods if n != "peak"])):
        for name in names:
            _one_method(panel, list(fit.methods).index(name), name, fit)
        panel.set_ylim(len(fit.methods) - 0.4, -0.6)
        panel.set_xlabel("inertia, kg m²")
    labels = [METHODS[name].replace(" of the founding paper", "") for name in fit.methods]
    everything.set_yticks(range(len(labels)), labels)
    everything.set_xlim(left=0.0)
    enlarged.set_yticks(range(len(labels)), [""] * len(labels))
    enlarged.set_title("enlarged", loc="left")
    if rigid_body is not None:
        everything.axvline(rigid_body, color=GREY, linestyle="--", label="rigid body")
        everything.legend(fontsize=8, loc="lower left")
    return figure


def _one_method(panel: Axes, row: int, name: str, fit: InertiaFit) -> None:
    inertia, biased = fit.methods[name], name == "peak"
    colour = RED if biased else (BLUE if name == fit.chosen else "black")
    for _, value, _ in inertia.runs:
        panel.plot(value, row + 0.22, "|", color=colour, alpha=0.7, markersize=8)
    reach = 1.96 * inertia.standard_error if math.isfinite(inertia.standard_error) and not biased else 0.0
    panel.errorbar(inertia.value, row, xerr=reach, fmt="x" if biased else "o", color=colour, capsize=4, markersize=5)


def simulation(item: TrialSimulation) -> Figure:
    """One trial: measured and simulated rate, their difference, and the heading's error."""
    figure, axes = _axes(3, 1, height=5.2, ratios=(3, 1.2, 1.2))
    rate, difference, heading = axes[:, 0]
    time = item.run.rates.time
    rate.plot(*extremes(time, item.measured), color="black", label="measured")
    rate.plot(*extremes(time, item.simulated), color=ORANGE, linestyle="--", label="simulated")
    rate.set_ylabel("yaw rate, rad/s")
    title = "" if not math.isfinite(item.fit.r2) else f"   R² {item.fit.r2:.4f}, fit {item.fit.fit_percent:.1f} %"
    rate.set_title(item.run.trial.name + title, loc="left")
    rate.legend(ncols=2, loc="upper right", fontsize=9)
    difference.plot(*extremes(time, item.measured - item.simulated), color=BLUE, linewidth=0.9)
    difference.set_ylabel("difference,\nrad/s")
    trial = item.run.trial
    known = trial.measured
    error = np.degrees(trial.heading - item.heading)[known]
    heading.plot(*extremes(trial.time[known], error), color=BLUE, linewidth=0.9)
    heading.set_ylabel("heading\nerror, deg")
    heading.set_xlabel("time, s")
    return figure


def overview(simulations: Sequence[TrialSimulation]) -> Figure:
    """All trials small: measured and simulated rate."""
    columns = 3
    rows = -(-len(simulations) // columns)
    figure, axes = _axes(rows, columns, height=1.55 * rows + 0.5)
    for panel, item in zip(axes.ravel(), simulations, strict=False):
        panel.plot(*extremes(item.run.rates.time, item.measured, 500), color="black", linewidth=1.0)
        panel.plot(*extremes(item.run.rates.time, item.simulated, 500), color=ORANGE, linestyle="--", linewidth=1.0)
        name = item.run.trial.name
        panel.set_title(name if len(name) < 26 else f"…{name[-24:]}", fontsize=9, loc="left")
        panel.tick_params(labelsize=8)
    for panel in axes.ravel()[len(simulations) :]:
        panel.set_axis_off()
    figure.supxlabel("time, s", fontsize=10)
    figure.supylabel("yaw rate, rad/s (black measured, dashed simulated)", fontsize=10)
    return figure


def residuals(runs: Sequence[Run], model: Model) -> Figure:
    """Torque that the model leaves over: against rate, torque and time, and its spectrum."""
    figure, axes = _axes(2, 2, height=6.2)
    against_rate, against_torque, over_time, spectrum = axes.ravel()
    clock = 0.0
    for k, run in enumerate(runs):
        left = residual_torque(run, model)
        known = np.isfinite(left)
        step = max(known.sum() * len(runs) // 6000, 1)
        rows = np.flatnonzero(known)[::step]
        dots = {"linestyle": "none", "marker": ".", "markersize": 1.5, "alpha": 0.5, "rasterized": True}
        against_rate.plot(run.rates.yaw_rate[rows], left[rows], color=BLUE, **dots)
        against_torque.plot(run.drive[rows], left[rows], color=BLUE, **dots)
        over_time.plot(*extremes(clock + run.rates.time, left, 400), color=(BLUE, ORANGE)[k % 2], linewidth=0.6)
        clock += float(run.rates.time[-1])
    against_rate.set(xlabel="yaw rate, rad/s", ylabel="residual torque, N m")
    against_torque.set(xlabel="torque, N m", ylabel="residual torque, N m")
    over_time.set(xlabel="time, trials one after another, s", ylabel="residual torque, N m")
    frequency, density = residual_spectrum(runs, model)
    spectrum.semilogy(frequency, density, color=BLUE)
    spectrum.set(xlabel="frequency, Hz", ylabel="density, (N m)²/Hz", xlim=(0.0, None))
    return figure


def residual_torque(run: Run, model: Model) -> FloatArray:
    """(m,) T - I rdot - D(r) in N m, all behind the same filter."""
    return np.asarray(run.drive - model.inertia * run.rates.acceleration - model.drag(run.rates.yaw_rate))


def residual_spectrum(runs: Sequence[Run], model: Model) -> tuple[FloatArray, FloatArray]:
    """Frequency in Hz up to the cut-off, and density in (N m)^2/Hz, averaged over the runs."""
    length, parts = 1024, []
    for run in runs:
        left = residual_torque(run, model)
        left = left[np.isfinite(left)]
        if len(left) >= 64:
            size = min(length, len(left))
            parts.append(signal.welch(left, fs=1.0 / run.rates.kernel.period, nperseg=size, nfft=length)[1])
    frequency = np.asarray(np.fft.rfftfreq(length, runs[0].rates.kernel.period), dtype=np.float64)
    inside = (frequency > 0) & (frequency <= runs[0].rates.kernel.cutoff)
    density = np.asarray(np.mean(parts, axis=0)) if parts else np.full(len(frequency), np.nan)
    return frequency[inside], density[inside]


def thrust_curves(vehicle: Vehicle, runs: Sequence[Run]) -> Figure | None:
    """Each thruster's curve, with the range of commands that the logs use."""
    curves = [(k, item, item.curve) for k, item in enumerate(vehicle.thrusters) if item.curve is not None]
    if not curves:
        return None
    columns = min(len(curves), 2)
    rows = -(-len(curves) // columns)
    figure, axes = _axes(rows, columns, height=2.9 * rows + 0.2)
    for panel, (k, thruster, curve) in zip(axes.ravel(), curves, strict=False):
        used = np.concatenate([run.trial.commands[:, k] for run in runs])
        panel.axvspan(float(used.min()), float(used.max()), color=ORANGE, alpha=0.15, label="commands in the logs")
        panel.plot(curve.command, curve.thrust, color=BLUE, label="bench curve")
        panel.set_title(f"{thruster.name}: yaw arm {thruster.yaw_arm:g} m", loc="left")
        panel.set_xlabel("command")
        panel.set_ylabel("thrust, N")
        panel.legend(fontsize=8, loc="upper left")
    for panel in axes.ravel()[len(curves) :]:
        panel.set_axis_off()
    return figure
