"""Tracks, speeds and missing forces of the coupled model."""

import math
from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from rovid.core.array_types import FloatArray
from rovid.planar.trial_simulation import SENSOR_UNITS, PlanarTrialSimulation
from rovid.present.number_format import shorten_name
from rovid.present.plots.canvas import (
    BLACK,
    BLUE,
    ORANGE,
    PALE,
    decimate_min_max,
    panel_grid,
    panel_sheet,
    report_style,
)

TRACKS_SHOWN = 9
_COLUMNS = 3
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
        _plot_track(panel, base, full)
    figure.supxlabel("east, m", y=0.06 / figure.get_figheight(), fontsize=10, va="bottom")
    figure.supylabel("north, m", x=0.01, fontsize=10, ha="left")
    figure.legend(
        *panels[0].get_legend_handles_labels(), ncols=4, loc="upper left", bbox_to_anchor=(0.07, 1.0), borderaxespad=0.1
    )
    return figure


def _plot_track(panel: Axes, base: PlanarTrialSimulation, full: PlanarTrialSimulation) -> None:
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
    figure.legend(list(handles.values()), list(handles), ncols=3, loc="upper right", borderaxespad=0.1)
    panels[-1][0].set_xlabel("time, s")
    panels[-1][0].set_xlim(0.0, full.motion.time[-1])
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
    figure.legend(*panels[0][0].get_legend_handles_labels(), ncols=2, loc="upper right", borderaxespad=0.1)
    figure.align_ylabels()
    panels[-1][0].set_xlabel("time, s")
    return figure


@report_style
def plot_turning_curve(curve: FloatArray, *, angle: bool) -> Figure:
    """R' of steady turns against (points, 2) steering; ``angle``: in rad, else a share of the largest torque."""
    figure, ((panel,),) = panel_grid([(2.2, 1)], left=0.75)
    panel.plot(np.degrees(curve[:, 0]) if angle else curve[:, 0], curve[:, 1], "o-", color=BLACK, markersize=4)
    panel.set_xlabel("rudder angle, deg" if angle else "torque over the largest torque")
    panel.set_ylabel("r' = r·L/U")
    return figure
