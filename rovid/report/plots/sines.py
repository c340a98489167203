"""Sine runs: what a period looks like, and why nothing peaks together."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from rovid.identify.sine import SineTrial
from rovid.model import Model
from rovid.report.plots.canvas import BLUE, GREEN, GREY, ORANGE, sheet, shortened, styled
from rovid.trial import FloatArray

PER_SHEET = 6
_LOOKS = {"torque": (BLUE, "-", "o"), "yaw rate": (ORANGE, "--", "s"), "acceleration": (GREEN, ":", "^")}


@styled
def sine_runs(trials: Sequence[SineTrial], drag: Model | None) -> Figure:
    """Each run's mean period: torque, rate and acceleration over time, and torque over rate."""
    figure, panels = sheet([(1.85, 2)] * len(trials), top=0.75, down=0.85)
    for (over_time, loop), trial in zip(panels, trials, strict=True):
        waves = _waves(trial)
        peaks = _peaks(waves)
        _over_time(over_time, trial, waves, peaks)
        _loop(loop, waves, peaks, drag)
    for panel, columns in zip(panels[0], (3, 2), strict=True):
        handles, labels = panel.get_legend_handles_labels()
        panel.legend(handles, labels, loc="lower left", bbox_to_anchor=(-0.02, 1.15), ncols=columns, borderaxespad=0.0)
    return figure


def _waves(trial: SineTrial) -> dict[str, FloatArray]:
    wave = trial.wave
    amplitudes = (wave.torque, wave.rate, wave.acceleration())
    return {name: wave.over_one_period(each) for name, each in zip(_LOOKS, amplitudes, strict=True)}


def _peaks(waves: dict[str, FloatArray]) -> dict[str, int]:
    """Where each wave peaks, all on the side on which the torque is largest."""
    torque = waves["torque"]
    side = np.sign(torque[np.argmax(np.abs(torque))])
    return {name: int(np.argmax(side * values)) for name, values in waves.items()}


def _over_time(panel: Axes, trial: SineTrial, waves: dict[str, FloatArray], peaks: dict[str, int]) -> None:
    for name, values in waves.items():
        colour, dash, marker = _LOOKS[name]
        share = values / np.max(np.abs(values))
        time = np.arange(len(values) + 1) * trial.period / len(values)
        panel.plot(time, np.append(share, share[0]), color=colour, linestyle=dash, label=name)
        at = peaks[name]
        panel.vlines(time[at], 0.0, share[at], color=colour, linewidth=0.8)
        panel.plot(time[at], share[at], marker, color=colour, markersize=6)
    panel.set_title(f"{shortened(trial.source, 26)}: mean of {trial.cycles} periods of {trial.period:.3g} s")
    panel.set(xlabel="time in the period, s", ylabel="share of its peak", ylim=(-1.15, 1.15), xlim=(0.0, trial.period))


def _loop(panel: Axes, waves: dict[str, FloatArray], peaks: dict[str, int], drag: Model | None) -> None:
    rate, torque = waves["yaw rate"], waves["torque"]
    if drag is not None:
        line = np.linspace(rate.min(), rate.max(), 200)
        panel.plot(line, drag.drag(line), color=GREY, linewidth=1.2, linestyle="-.", label="steady drag")
    panel.plot(np.append(rate, rate[0]), np.append(torque, torque[0]), color=BLUE)
    for name, at in peaks.items():
        colour, _, marker = _LOOKS[name]
        label = name if name == "acceleration" else name.removeprefix("yaw ")
        panel.plot(rate[at], torque[at], marker, color=colour, markersize=6, label=f"{label} peaks here")
    panel.set(xlabel="yaw rate, rad/s", ylabel="torque, N m")
