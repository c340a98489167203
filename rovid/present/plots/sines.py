"""Sine runs: what a period looks like, and why nothing peaks together."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from rovid.core.array_types import FloatArray
from rovid.estimate.sine_inertia import SineTrial
from rovid.model.model import Model
from rovid.present.plots.canvas import BLUE, GREEN, GREY, ORANGE, panel_grid, report_style, shorten_name
from rovid.trial.axis import Axis

PER_SHEET = 6
# Of torque (or force), rate and acceleration.
_LOOKS = ((BLUE, "-", "o"), (ORANGE, "--", "s"), (GREEN, ":", "^"))


@report_style
def plot_sine_runs(trials: Sequence[SineTrial], drag: Model | None, axis: Axis) -> Figure:
    """Each run's mean period: torque, rate and acceleration over time, and torque over rate."""
    figure, panels = panel_grid([(1.85, 2)] * len(trials), top=0.75, down=0.85)
    for (over_time, loop), trial in zip(panels, trials, strict=True):
        waves = _waves(trial)
        peaks = _peaks(waves)
        _over_time(over_time, trial, waves, peaks, axis)
        _loop(loop, waves, peaks, drag, axis)
    for panel, columns in zip(panels[0], (3, 2), strict=True):
        handles, labels = panel.get_legend_handles_labels()
        panel.legend(handles, labels, loc="lower left", bbox_to_anchor=(-0.02, 1.15), ncols=columns, borderaxespad=0.0)
    return figure


def _waves(trial: SineTrial) -> list[FloatArray]:
    """Torque, rate and acceleration over one period."""
    wave = trial.motion
    return [wave.over_one_period(each) for each in (wave.torque, wave.rate, wave.acceleration())]


def _peaks(waves: list[FloatArray]) -> list[int]:
    """Where each wave peaks, all on the side on which the torque is largest."""
    torque = waves[0]
    side = np.sign(torque[np.argmax(np.abs(torque))])
    return [int(np.argmax(side * values)) for values in waves]


def _over_time(panel: Axes, trial: SineTrial, waves: list[FloatArray], peaks: list[int], axis: Axis) -> None:
    names = (axis.force_name, axis.rate_words, "acceleration")
    for name, (colour, dash, marker), values, at in zip(names, _LOOKS, waves, peaks, strict=True):
        share = values / np.max(np.abs(values))
        time = np.arange(len(values) + 1) * trial.period / len(values)
        panel.plot(time, np.append(share, share[0]), color=colour, linestyle=dash, label=name)
        panel.vlines(time[at], 0.0, share[at], color=colour, linewidth=0.8)
        panel.plot(time[at], share[at], marker, color=colour, markersize=6)
    panel.set_title(f"{shorten_name(trial.source, 26)}: mean of {trial.cycles} periods of {trial.period:.3g} s")
    panel.set(xlabel="time in the period, s", ylabel="share of its peak", ylim=(-1.15, 1.15), xlim=(0.0, trial.period))


def _loop(panel: Axes, waves: list[FloatArray], peaks: list[int], drag: Model | None, axis: Axis) -> None:
    """Torque over rate in one period, with the moments of the peaks and the steady drag."""
    torque, rate, _ = waves
    if drag is not None:
        line = np.linspace(rate.min(), rate.max(), 200)
        # A net buoyancy is all that weight and buoyancy do where there are sine runs to show.
        steady = drag.drag(line) + sum(drag.restoring_values)
        panel.plot(line, steady, color=GREY, linewidth=1.2, linestyle="-.", label="steady drag")
    panel.plot(np.append(rate, rate[0]), np.append(torque, torque[0]), color=BLUE)
    for name, (colour, _, marker), at in zip((axis.force_name, "rate", "acceleration"), _LOOKS, peaks, strict=True):
        panel.plot(rate[at], torque[at], marker, color=colour, markersize=6, label=f"{name} peaks here")
    panel.set(xlabel=f"{axis.rate_words}, {axis.rate_unit}", ylabel=f"{axis.force_name}, {axis.force_unit}")
