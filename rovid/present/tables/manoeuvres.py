"""Table of standard manoeuvres: as measured, and as the coupled model simulates them."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.core.formatting import plus_minus
from rovid.planar.dataset import PlanarRun
from rovid.planar.manoeuvres import (
    ManoeuvreMeasure,
    Measures,
    RecognisedManoeuvre,
    Track,
    nomoto,
    recognise,
    turning_circle,
    zigzag,
)
from rovid.planar.trial_simulation import PlanarTrialSimulation
from rovid.present.number_format import DASH, format_number, unit_symbol
from rovid.present.tables.table import ResultTable, mixed_number_column, text_column

# s; interval of the grid of tracks, at least.
_STEP = 0.1
# Units that are shown in degrees.
_ANGLES = ("rad", "rad/s")
_MEASURES = {"turning_circle": turning_circle, "zigzag": zigzag}


def manoeuvre_tables(simulations: Sequence[PlanarTrialSimulation], current: tuple[float, float]) -> list[ResultTable]:
    """Turning circles and zigzags of all runs, a table of each kind; ``current`` in m/s to north and east."""
    rows: dict[str, list[tuple[str, Measures, Measures]]] = {}
    for item in simulations:
        measured, simulated = _tracks(item, current)
        for manoeuvre in recognise(measured):
            found, twin = (_measures(track, manoeuvre) for track in (measured, simulated))
            title = f"{item.name}, from {measured.time[manoeuvre.first]:.0f} s"
            rows.setdefault(manoeuvre.kind, []).append((title, found, twin))
    return [_table(kind, rows[kind]) for kind in _MEASURES if kind in rows]


def _table(kind: str, rows: Sequence[tuple[str, Measures, Measures]]) -> ResultTable:
    units = {name: _unit(one) for _, *sides in rows for side in sides for name, one in side.items()}
    columns = [mixed_number_column(name.replace("_", " "), unit) for name, unit in units.items()]
    title = f"{kind.replace('_', ' ').capitalize()}s"
    table = ResultTable(title, text_column("run"), text_column("track"), *columns)
    for name, measured, simulated in rows:
        table.add_row(name, "measured", *_cells(measured, units), begins_section=True)
        table.add_row("", "simulated", *_cells(simulated, units))
    return table


def _cells(measures: Measures, names: Iterable[str]) -> list[str]:
    return [_cell(measures[name]) if name in measures else DASH for name in names]


def _measures(track: Track, manoeuvre: RecognisedManoeuvre) -> Measures:
    part = track.part(manoeuvre.first, manoeuvre.last)
    return {**_MEASURES[manoeuvre.kind](part), **(nomoto(part) if manoeuvre.kind == "zigzag" else {})}


def _cell(one: ManoeuvreMeasure) -> str:
    factor = 180.0 / math.pi if one.unit in _ANGLES else 1.0
    if one.standard_error is None:
        return format_number(factor * one.value)
    return plus_minus(factor * one.value, factor * one.standard_error)


def _unit(one: ManoeuvreMeasure) -> str:
    return unit_symbol(one.unit.replace("rad", "deg") if one.unit in _ANGLES else one.unit)


def _tracks(item: PlanarTrialSimulation, current: tuple[float, float]) -> tuple[Track, Track]:
    """The measured and the simulated track relative to the water, on one grid."""
    run, motion = item.run, item.motion
    step = max(_STEP, float(np.median(np.diff(run.time))))
    grid = np.arange(0.0, run.duration, step)
    steering = _steering(run, grid)
    north, east = (part * grid for part in current)

    def held(values: FloatArray) -> FloatArray:
        return np.asarray(np.interp(grid, motion.time, values))

    def read(sensor: str) -> FloatArray:
        if sensor not in run.sensors:
            return np.full(len(grid), np.nan)
        readings = run.readings(sensor)
        return np.asarray(np.interp(grid, readings.time, readings.values))

    heading = read("heading") if "heading" in run.sensors else held(motion.heading)
    rate = read("yaw_rate") if "yaw_rate" in run.sensors else np.gradient(heading, step)
    measured = Track(
        time=grid,
        heading=heading,
        yaw_rate=rate,
        steering=steering,
        north=read("north") - north,
        east=read("east") - east,
        **_through_water(heading, read("surge_velocity"), read("sway_velocity"), current),
    )
    turned = held(motion.heading)
    simulated = Track(
        time=grid,
        heading=turned,
        yaw_rate=held(motion.yaw_rate),
        steering=steering,
        north=held(motion.north) - north,
        east=held(motion.east) - east,
        **_through_water(turned, held(motion.surge_velocity), held(motion.sway_velocity), current),
    )
    return measured, simulated


def _through_water(
    heading: FloatArray, surge: FloatArray, sway: FloatArray, current: tuple[float, float]
) -> Mapping[str, FloatArray]:
    """Velocities through the water in body axes, from those over ground."""
    north, east = current
    cos, sin = np.cos(heading), np.sin(heading)
    return {"surge": surge - north * cos - east * sin, "sway": sway + north * sin - east * cos}


def _steering(run: PlanarRun, grid: FloatArray) -> FloatArray:
    """(n,) angle of the first rudder in rad, or else the yaw torque of the thrusters over the largest one."""
    forces = run.forces()
    if forces.angle.shape[1]:
        steering = forces.angle[:, 0]
    else:
        torque = forces.force[:, 2]
        steering = torque / max(float(np.max(np.abs(torque))), 1e-12)
    at = np.searchsorted(run.time, grid, side="right") - 1
    return np.asarray(steering[at.clip(min=0)])
