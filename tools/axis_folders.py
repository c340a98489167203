"""Folders of trials along another axis than yaw, as engineers keep them, each with what a reader of them should find.

Words, styles, units of commands, clocks and layouts are those of `tools.folders`. The motion is that of a point with
drag, that floats or sinks in heave and swings in roll; its thrusters lag, and some do not move it along the axis.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from tools.folder_words import STYLES
from tools.folders import KINDS, Column, Layout, Namer, Stamps, levels
from tools.truth import FloatArray

AXES = ("surge", "heave", "roll")
_SIGNALS = {"surge": ("surge", "m/s"), "heave": ("depth", "m"), "roll": ("heel", "deg")}
# Thruster, in keys of `LANGUAGES` -> whether it moves the vehicle along the axis.
_MOUNTS: Mapping[str, Mapping[tuple[str, ...], int]] = {
    "surge": {("port",): 1, ("stbd",): 1, ("vertical",): 0},
    "heave": {("vertical", "port"): 1, ("vertical", "stbd"): 1, ("port",): 0, ("stbd",): 0},
    "roll": {},
}


@dataclass(frozen=True, kw_only=True)
class AxisFolder:
    """What a reader should find: what is measured, its unit, and each thruster's sense along the axis, 0 for none."""

    axis: str
    measured: str
    unit: str
    time: str
    thrusters: Mapping[str, int] = field(default_factory=dict)
    about: str = ""


def write_axis_folder(folder: Path, *, seed: int, index: int) -> AxisFolder:
    """Write the draw's folder ``index``; the axis goes by it."""
    rng = np.random.default_rng([seed, index, 7])
    folder.mkdir(parents=True, exist_ok=True)
    axis = AXES[index % len(AXES)]
    style = str(rng.choice([style for style in STYLES if style != "topic"]))
    namer = Namer(rng=rng, language=("en", "de", "fr", "no", "es")[index % 5], style=style)
    clock = Stamps.drawn(rng, namer, mcap=False)
    kind = str(rng.choice(["us", "%", "1", "V", "N"]))
    key, unit = _SIGNALS[axis]
    measured = namer.name("nav", key, unit)
    pattern = namer.word("command")
    mounts = _MOUNTS[axis]
    roles = [" ".join(namer.word(part) for part in role) for role in mounts]
    names = [namer.joined("thr", pattern.format(role=role), kind) for role in roles]
    sense = np.where(rng.random(len(names)) < 0.25, -1.0, 1.0)
    layout = Layout.drawn(rng, namer.language, style)
    full, neutral, decimals = float(rng.choice(KINDS[kind][0])), KINDS[kind][1], KINDS[kind][2]
    other = namer.name("sys", "supply", "V")
    for number in range(int(rng.integers(2, 4))):
        step = 0.1
        time = step * np.arange(round(rng.uniform(120.0, 220.0) / step), dtype=np.float64)
        drive, wanted = _drive(rng, len(time), step, list(mounts.values()))
        place, rate = _moved(rng, axis, drive @ np.array(list(mounts.values()), dtype=np.float64), step)
        value = {"surge": rate + rng.normal(0.0, 0.01, len(time)), "heave": place + rng.normal(0.0, 0.01, len(time))}
        value["roll"] = np.degrees(place) + rng.normal(0.0, 0.05, len(time))
        columns = [Column(name=measured, values=value[axis], decimals=3, group="nav")]
        columns += [
            Column(name=name, values=neutral + full * way * command, decimals=decimals, group="thr")
            for name, way, command in zip(names, sense, wanted.T, strict=True)
        ]
        supply = 15.8 - 0.2 * np.abs(wanted).sum(axis=1) + rng.normal(0.0, 0.02, len(time))
        columns.append(Column(name=other, values=supply, decimals=2, group="sys"))
        cells = clock.cells(time, clock.start(rng, number))
        layout.write(folder / f"run_{number + 1:02d}.csv", clock.name, cells, layout.ordered(columns))
    ways = [int(way * moves) for way, moves in zip(sense, mounts.values(), strict=True)]
    return AxisFolder(
        axis=axis,
        measured=measured,
        unit=unit,
        time=clock.name,
        thrusters=dict(zip(names, ways, strict=True)),
        about=f"{axis}, {namer.language}, {style}, {kind}",
    )


def _drive(rng: np.random.Generator, count: int, step: float, moves: list[int]) -> tuple[FloatArray, FloatArray]:
    """(n, k) thrusts that follow late, and commands: those along the axis together, with stretches of one alone."""
    if not moves:
        return np.zeros((count, 0)), np.zeros((count, 0))
    together = levels(rng, count, step, 9.0, (-0.7, -0.4, 0.0, 0.3, 0.6))
    wanted = np.empty((count, len(moves)))
    for k, way in enumerate(moves):
        own = levels(rng, count, step, 6.0, (-0.3, 0.0, 0.0, 0.3))
        wanted[:, k] = np.clip(together + own, -1.0, 1.0) if way else own
    late = wanted.copy()
    keep = math.exp(-step / 0.2)
    for k in range(1, count):
        late[k] = keep * late[k - 1] + (1.0 - keep) * wanted[k]
    return late, wanted


def _moved(rng: np.random.Generator, axis: str, push: FloatArray, step: float) -> tuple[FloatArray, FloatArray]:
    """(n,) places and rates."""
    place, rate, parts = (0.3 if axis == "roll" else 10.0), 0.0, 10
    places, rates = np.empty(len(push)), np.empty(len(push))
    eddy, stiffness, linear = 0.0, (2.5 if axis == "roll" else 0.0), (0.05 if axis == "roll" else 0.15)
    for k, force in enumerate(push.tolist()):
        places[k], rates[k] = place, rate
        eddy += -0.1 * step * eddy + 0.01 * math.sqrt(step) * float(rng.normal())
        for _ in range(parts):
            pull = (
                0.3 * force + eddy * (axis != "roll") - (0.02 if axis == "heave" else 0.0) - stiffness * math.sin(place)
            )
            rate += step / parts * (pull - 0.3 * abs(rate) * rate - linear * rate)
            place += step / parts * rate
        if axis == "roll" and abs(place) < 0.004 and abs(rate) < 0.006:
            place = 0.3  # pushed over again
    return (places if axis == "roll" else places - places.mean() + 10.0), rates
