"""Smoothed speeds of runs, for start values: readings through one Gaussian kernel, on a uniform grid."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.planar.kernels import SENSORS

if TYPE_CHECKING:
    from rovid.planar.dataset import PlanarRun

# Grid points in a standard deviation of the kernel, standard deviations to each side, and the least points of a run.
_POINTS, _REACH, _LEAST = 3, 3, 8


@dataclass(frozen=True, eq=False)
class SmoothRun:
    """Smoothed motion of one run over ground on a uniform grid; speeds that are not measured are zero."""

    time: FloatArray  #: (g,) s.
    heading: FloatArray  #: (g,) rad.
    speeds: FloatArray  #: (g, 3) u, v over ground in m/s, r in rad/s.
    accelerations: FloatArray  #: (g, 3) of the speeds.
    inputs: FloatArray  #: (g, k) as in `rovid.planar.reference.forces`.


def measured_axes(sensors: tuple[str, ...]) -> tuple[bool, bool, bool]:
    """Whether surge, sway and yaw are measured by these ``sensors``, as a speed or as a position."""
    position = "north" in sensors and "east" in sensors
    return position or "surge_velocity" in sensors, position or "sway_velocity" in sensors, True


def run_inputs(run: PlanarRun, effects: tuple[object, ...] = ()) -> FloatArray:
    """(n, k) inputs of the equations from each instant of ``run`` to the next, with actuator ``effects``."""
    held = run.forces(effects)  # type: ignore[arg-type]  # bound effects
    # The angle of each rudder is followed by the thrust ahead of it.
    pairs = np.stack((held.angle, held.slipstream_thrust), axis=2).reshape(len(held.force), -1)
    return np.ascontiguousarray(np.hstack((held.force, pairs)), dtype=np.float64)


def _edges(run: PlanarRun, width: float) -> FloatArray:
    """(g + 1,) s; edges of the cells of the grid, before its ends are cut off."""
    step = width / _POINTS
    return np.asarray(run.time[0] + step * np.arange(int((run.time[-1] - run.time[0]) / step) + 1))


def smooth_inputs(run: PlanarRun, width: float, effects: tuple[object, ...] = ()) -> FloatArray:
    """(g, k) inputs on the grid of `smooth_run`, with ``effects`` between command and thrust."""
    edges, inputs = _edges(run, width), run_inputs(run, effects)
    step = width / _POINTS
    area = np.vstack((np.zeros(inputs.shape[1]), np.cumsum(inputs[:-1] * np.diff(run.time)[:, None], axis=0)))
    means = [np.diff(np.interp(edges, run.time, column)) / step for column in area.T]
    forced = np.column_stack([_convolved(mean, step)[0] for mean in means])
    return np.asarray(forced[_REACH * _POINTS : len(edges) - 1 - _REACH * _POINTS])


def smooth_run(run: PlanarRun, width: float, effects: tuple[object, ...] = ()) -> SmoothRun | None:
    """Motion of ``run`` through a kernel with a standard deviation of ``width`` s; None for too short a run.

    ``effects`` are those between command and thrust, for the inputs.
    """
    edges, step = _edges(run, width), width / _POINTS
    count = len(edges) - 1
    if count < 2 * _REACH * _POINTS + _LEAST:
        return None
    grid = 0.5 * (edges[1:] + edges[:-1])
    readings = {name: run.readings(name) for name in SENSORS if name in run.sensors}

    def smoothed(name: str) -> tuple[FloatArray, FloatArray]:
        """Values and derivative of a sensor on the grid."""
        own = readings[name]
        area = np.concatenate(([0.0], np.cumsum(0.5 * (own.values[1:] + own.values[:-1]) * np.diff(own.time))))
        # Means over the cells; beyond the readings the end values hold.
        inside = np.clip(edges, own.time[0], own.time[-1])
        total = np.interp(inside, own.time, area)
        total += np.where(edges < own.time[0], (edges - own.time[0]) * own.values[0], 0.0)
        total += np.where(edges > own.time[-1], (edges - own.time[-1]) * own.values[-1], 0.0)
        return _convolved(np.diff(total) / step, step)

    if "heading" in readings:
        heading, rate = smoothed("heading")
    else:
        rate = smoothed("yaw_rate")[0]
        heading = np.cumsum(rate) * step
    acceleration = np.gradient(rate, step)
    if "yaw_rate" in readings:
        rate, acceleration = smoothed("yaw_rate")
    speeds, accelerations = np.zeros((count, 3)), np.zeros((count, 3))
    speeds[:, 2], accelerations[:, 2] = rate, acceleration
    if "north" in readings and "east" in readings:
        (_, north), (_, east) = smoothed("north"), smoothed("east")
        cosine, sine = np.cos(heading), np.sin(heading)
        speeds[:, 0], speeds[:, 1] = north * cosine + east * sine, east * cosine - north * sine
        accelerations[:, :2] = np.gradient(speeds[:, :2], step, axis=0)
    for axis, name in enumerate(("surge_velocity", "sway_velocity")):
        if name in readings:
            speeds[:, axis], accelerations[:, axis] = smoothed(name)
    inner = slice(_REACH * _POINTS, count - _REACH * _POINTS)
    inputs = smooth_inputs(run, width, effects)
    return SmoothRun(grid[inner], heading[inner], speeds[inner], accelerations[inner], inputs)


def _convolved(values: FloatArray, step: float) -> tuple[FloatArray, FloatArray]:
    """(g,) cell means through the kernel, and their derivative."""
    at = np.arange(-_REACH * _POINTS, _REACH * _POINTS + 1)
    kernel = np.exp(-0.5 * (at / _POINTS) ** 2)
    kernel /= kernel.sum()
    padded = np.pad(values, _REACH * _POINTS, mode="edge")
    slope = -at / _POINTS**2 * kernel
    # Exact for a straight line.
    slope /= -np.sum(slope * at)
    return np.convolve(padded, kernel, mode="valid"), np.convolve(padded, slope[::1], mode="valid") / step


def slowest_interval(run: PlanarRun) -> float:
    """Interval in s between the readings of the slowest sensor from which `smooth_run` takes a speed."""
    used = set(run.sensors)
    if {"surge_velocity", "sway_velocity"} <= used:
        used -= {"north", "east"}
    stamps = [run.readings(name).time for name in used]
    return max(float(np.median(np.diff(time))) for time in stamps if len(time) > 1)


def sensor_noise(run: PlanarRun, name: str) -> float:
    """Standard deviation of the white noise of a sensor, from the median second difference of its readings."""
    values = run.readings(name).values
    if len(values) < 8:
        return float("nan")
    # The second difference of white noise has six times its variance.
    return float(1.4826 * np.median(np.abs(np.diff(values, 2))) / np.sqrt(6.0))
