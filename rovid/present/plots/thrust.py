"""Bench curve of each thruster, and the part of it that the logs use."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from rovid.core.array_types import FloatArray
from rovid.present.number_text import arm_words
from rovid.present.plots.canvas import BLACK, BLUE, ORANGE, panel_grid, report_style, shorten_name
from rovid.signals.preprocessing import Run
from rovid.trial.vehicle import ThrustCurve, Thruster, Vehicle

_ROOM = 48  # signs of a name that fit over a single panel


@report_style
def plot_thrust_curves(vehicle: Vehicle, runs: Sequence[Run]) -> Figure | None:
    """Thrust against command; None for a vehicle whose torque was logged."""
    curves = [(k, item, item.curve) for k, item in enumerate(vehicle.thrusters) if item.curve is not None]
    if not curves:
        return None
    # Four stand two by two; no more than three beside one another.
    columns = 2 if len(curves) == 4 else min(len(curves), 3)
    rows = -(-len(curves) // columns)
    figure, panels = panel_grid([(1.9, columns)] * rows, top=0.75, across=0.85, down=0.95)
    flat = [panel for row in panels for panel in row]
    for panel, (k, thruster, curve) in zip(flat, curves, strict=False):
        _one_curve(panel, curve, _used(runs, k))
        panel.set_title(f"{shorten_name(thruster.name, _ROOM // columns)}, {_lever(vehicle, thruster)}", fontsize=9)
    for panel in flat[len(curves) :]:
        panel.set_axis_off()
    handles, labels = flat[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="upper left", bbox_to_anchor=(0.09, 1.0), ncols=3)
    return figure


def _used(runs: Sequence[Run], k: int) -> FloatArray:
    """All commands of the thruster with index ``k``."""
    commands: FloatArray = np.concatenate([np.empty(0), *(run.trial.commands[:, k] for run in runs)])
    return commands[np.isfinite(commands)]


def _one_curve(panel: Axes, curve: ThrustCurve, used: FloatArray) -> None:
    panel.plot(curve.command, curve.thrust, color=BLACK, linewidth=1.0, label="bench curve")
    if used.size:
        low, high = float(used.min()), float(used.max())
        panel.axvspan(low, high, color=ORANGE, alpha=0.13, linewidth=0)
        inside = curve.command[(curve.command > low) & (curve.command < high)]
        command = np.concatenate(([low], inside, [high]))
        panel.plot(
            command,
            curve(command),
            color=BLUE,
            linewidth=3.2,
            solid_capstyle="butt",
            label="commands that the logs use",
        )
    panel.set(xlabel="command", ylabel="thrust, N")
    panel.locator_params(nbins=6)


def _lever(vehicle: Vehicle, thruster: Thruster) -> str:
    """What the thrust acts by: a lever arm, or a share along the axis."""
    if vehicle.axis.angular:
        return f"arm {thruster.arm:.3g} m"
    name, _ = arm_words(vehicle.axis)
    return f"{name} {thruster.arm:.3g}"
