"""Pictures of the gallery of real logs, drawn of what rovid's commands left: recordings, tables and JSON."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from mcap.reader import make_reader
from scipy.signal import find_peaks

from benchmarks.gallery.judge import Answer
from rovid.core.array_types import FloatArray
from rovid.present.plots.canvas import (
    BLACK,
    BLUE,
    GREEN,
    GREY,
    ORANGE,
    PALE,
    decimate_min_max,
    panel_grid,
    report_style,
)

_SMALLEST_SWING = 0.05  # deg


def recorded(path: Path, topic: str) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Time, measured and simulated of one topic of a recording of `rovid simulate --mcap`."""
    rows = []
    with path.open("rb") as file:
        for _, _, message in make_reader(file).iter_messages(topics=[topic]):
            fields = json.loads(message.data)
            by_kind = {name.partition("_")[0]: value for name, value in fields.items()}
            rows.append((message.log_time / 1e9, by_kind.get("measured", np.nan), by_kind.get("simulated", np.nan)))
    time, measured, simulated = np.array(rows).T
    return time, measured, simulated


@report_style
def free_runs(room: Path, trial: str) -> Figure | None:
    """Measured yaw rate of one log, and the free runs of the plain model and of the extended one."""
    runs = {
        label: recorded(room / folder / f"{trial}.mcap", "/yaw_rate")
        for folder, label in (("plain", "plain model"), ("extended", "with what was found"))
        if (room / folder / f"{trial}.mcap").is_file()
    }
    if not runs:
        return None
    figure, panels = panel_grid([(1.6, 1)] * len(runs), left=0.75, top=0.3, down=0.35, share_x=True)
    for (panel,), (label, (time, measured, simulated)) in zip(panels, runs.items(), strict=True):
        panel.plot(*decimate_min_max(time, measured), color=PALE, linewidth=3.6, label="measured")
        panel.plot(*decimate_min_max(time, simulated), color=BLACK, linewidth=1.1, label="simulated")
        known = np.isfinite(measured) & np.isfinite(simulated)
        left = np.sum((measured - simulated)[known] ** 2)
        r2 = 1.0 - left / np.sum((measured[known] - np.mean(measured[known])) ** 2)
        panel.set_title(f"{label}   R² {r2:.3f}")
        panel.set_ylabel("yaw rate, rad/s")
    figure.legend(*panels[0][0].get_legend_handles_labels(), ncols=2, loc="upper right", borderaxespad=0.1)
    panels[-1][0].set_xlabel("time, s")
    return figure


@report_style
def by_run(answers: Mapping[str, Answer]) -> Figure | None:
    """R² of each run, by the plain model and by the extended one."""
    plain = answers.get("plain")
    if plain is None or plain.document is None:
        return None
    names = [trial["name"] for trial in plain.document["trials"]]
    left = 0.4 + 0.062 * max(map(len, names))  # inches of a letter of this size
    figure, ((panel,),) = panel_grid([(0.24 * len(names) + 0.3, 1)], left=left, top=0.45)
    # Where nothing was found both are one point: the larger mark lies behind the smaller one.
    marks = (("plain", "plain model", GREY, "o", 9.0), ("extended", "with what was found", BLUE, "D", 5.0))
    for step, label, colour, marker, size in marks:
        answer = answers.get(step)
        if answer is not None and answer.document is not None:
            r2 = [trial["yaw_rate_r2"] for trial in answer.document["trials"]]
            panel.plot(r2, range(len(names)), linestyle="none", marker=marker, ms=size, color=colour, label=label)
    panel.set_yticks(range(len(names)), names, fontsize=8)
    panel.invert_yaxis()
    panel.axvline(1.0, color=BLACK, linewidth=0.8)
    panel.set_xlabel("R² of the yaw rate")
    figure.legend(*panel.get_legend_handles_labels(), ncols=2, loc="upper right", borderaxespad=0.1)
    return figure


@report_style
def decays(room: Path, trials: tuple[str, ...]) -> Figure | None:
    """Roll of each decay, with the envelope of each model's free run."""
    if not all((room / "plain" / f"{trial}.mcap").is_file() for trial in trials):
        return None
    figure, panels = panel_grid([(1.55, 1)] * len(trials), left=0.75, top=0.5, down=0.6)
    models = (
        ("plain", "plain model", GREY, "--"),
        ("extended", "what the diagnosis found", ORANGE, "-"),
        ("told", "both causes given by name", BLUE, ":"),
    )
    for (panel,), trial in zip(panels, trials, strict=True):
        for place, (folder, label, colour, dashes) in enumerate(models):
            path = room / folder / f"{trial}.mcap"
            if not path.is_file():
                continue
            time, measured, simulated = recorded(path, "/roll")
            if place == 0:
                panel.plot(*decimate_min_max(time, measured), color=PALE, linewidth=1.0, label="measured")
            for sign in (1.0, -1.0):
                at, height = envelope(time, sign * simulated)
                name = label if sign > 0.0 else None
                panel.plot(at, sign * height, color=colour, linestyle=dashes, linewidth=1.6, label=name)
        panel.set_title(f"{trial}.csv")
        panel.set_ylabel("roll, deg")
    figure.legend(*panels[0][0].get_legend_handles_labels(), ncols=4, loc="upper right", borderaxespad=0.1)
    panels[-1][0].set_xlabel("time since the release, s")
    return figure


def envelope(time: FloatArray, values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Where the peaks of a swing stand, and how high."""
    peaks, _ = find_peaks(values, prominence=_SMALLEST_SWING)
    return time[peaks], values[peaks]


@report_style
def outputs(path: Path, thrusters: Mapping[str, str], others: Mapping[str, str]) -> Figure | None:
    """Heading, and the pulses to thrusters and others; by label, the column of the table that `convert` wrote."""
    if not path.is_file():
        return None
    table = pd.read_csv(path)
    groups = [group for group in (thrusters, others) if group]
    figure, panels = panel_grid(
        [(1.3, 1)] * (1 + len(groups)), left=0.95, right=1.35, top=0.15, down=0.25, share_x=True
    )
    known = table.dropna(subset="heading_deg")
    heading = np.unwrap(known["heading_deg"].to_numpy(), period=360.0)
    panels[0][0].plot(*decimate_min_max(known["time_s"].to_numpy(), heading), color=BLACK)
    panels[0][0].ticklabel_format(axis="y", useOffset=False)
    panels[0][0].set_ylabel("heading, deg")
    for (panel,), group in zip(panels[1:], groups, strict=True):
        _pulses(panel, table, group)
    panels[-1][0].set_xlabel("time, s")
    return figure


def _pulses(panel: Axes, table: pd.DataFrame, columns: Mapping[str, str]) -> None:
    styles = zip((BLUE, ORANGE, GREEN, BLACK), ("-", "--", "-.", ":"), strict=True)
    for (label, column), (colour, dashes) in zip(columns.items(), styles, strict=False):
        if column in table:
            panel.step(
                table["time_s"], table[column], where="post", color=colour, linestyle=dashes, linewidth=1.1, label=label
            )
    panel.set_ylabel("pulse, us")
    panel.legend(loc="center left", bbox_to_anchor=(1.0, 0.5))


@report_style
def benches(room: Path, folder: str, keys: tuple[str, ...]) -> Figure | None:
    """Bench readings of each thruster and the curve made of them, near zero as well."""
    if not all((room / f"{key}_curve.csv").is_file() for key in keys):
        return None
    figure, panels = panel_grid([(2.0, 2)] * len(keys), left=0.75)
    for row, key in zip(panels, keys, strict=True):
        readings = pd.read_csv(room / folder / f"{key}.csv", header=None).to_numpy()
        curve = pd.read_csv(room / f"{key}_curve.csv").to_numpy()
        for panel in row:
            panel.plot(*readings.T, linestyle="none", marker="o", markersize=4, color=PALE, label="readings")
            panel.plot(*curve.T, color=BLACK, linewidth=1.1, label="curve")
            panel.set_xlabel("command, V")
        row[0].set_ylabel("thrust, N")
        row[0].set_title(key)
        row[0].legend(loc="upper left")
        row[1].set(xlim=(-2.0, 2.0), ylim=(-3.0, 3.0))
        row[1].set_title("near zero")
    return figure
