"""What a planar fit needs before its first step: typical sizes, and the runs as arrays of the compiled loops."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.effects.base import Scales
from rovid.estimate.dataset import effect_scales
from rovid.planar.coordinates import PlanarSizes
from rovid.planar.dataset import PlanarData
from rovid.planar.likelihood import PlanarGrid
from rovid.planar.smoothing import smooth_run
from rovid.planar.start_values import StartValues, first_noise

# Noise of a sensor at the start where its readings do not show it, in shares of the typical speed or time constant.
_DEFAULT_NOISE = 0.02
# Standard deviation of the speeds at the start of a run, in typical speeds.
START_STD = 0.5


def planar_sizes(data: PlanarData, start: StartValues) -> PlanarSizes:
    """Typical sizes of the runs, by the regression that gave ``start``."""
    longest = max(run.duration for run in data.runs)
    shortest = min(float(np.median(np.diff(run.time))) for run in data.runs)
    time = np.clip(start.time, shortest, max(longest, 2.0 * shortest))
    noise = {}
    for name in data.sensors:
        found = first_noise(data, name)
        axis = {"surge_velocity": 0, "sway_velocity": 1, "north": 0, "east": 0}.get(name, 2)
        usual = start.speed[axis] * (1.0 if name.endswith(("velocity", "rate")) else time[axis])
        noise[name] = found if found > 1e-6 * usual else _DEFAULT_NOISE * usual
    return PlanarSizes(
        force=start.force,
        speed=start.speed,
        time=time,
        inertia=start.model.base[:3],
        effects=_effect_scales(data, start, time),
        noise=noise,
    )


def _effect_scales(data: PlanarData, start: StartValues, time: FloatArray) -> Scales:
    columns = data.actuators.thruster_columns
    trials = [replace(run.trial, commands=run.trial.commands[:, columns], past=None) for run in data.runs]
    force, speed = start.force, start.speed
    thrusters = data.actuators.thrusters
    scales = effect_scales(
        trials, thrusters if len(columns) else None, float(force[2]), float(speed[2]), float(time[2])
    )
    if data.actuators.steered:  # Effects on commands act on the angles.
        angles = [run.trial.commands[:, data.actuators.angle_columns] for run in data.runs]
        scales = replace(scales, command=max(float(np.max(np.abs(angle))) for angle in angles) or scales.command)
    return replace(
        scales,
        surge=float(speed[0]),
        sway=float(speed[1]),
        surge_force=float(force[0]),
        sway_force=float(force[1]),
    )


def planar_grid(
    data: PlanarData, sizes: PlanarSizes, *, yaw_only: bool, interval: float, latency: FloatArray | None = None
) -> PlanarGrid:
    """The runs as arrays of the compiled loops, with the smoothed speeds at the start of each."""
    starts = np.zeros((len(data.runs), 6))
    stds = np.zeros((len(data.runs), 6))
    stds[:, 1:4] = START_STD * sizes.speed
    for number, run in enumerate(data.runs):
        smooth = smooth_run(run, max(0.3 * float(sizes.time.min()), 3.0 * float(np.median(np.diff(run.time)))))
        if smooth is not None:
            starts[number, 1:4] = smooth.speeds[0]
        for at, name, rate in ((0, "heading", 3), (4, "north", 1), (5, "east", 1)):
            if name in run.sensors:
                first = run.readings(name)
                starts[number, at] = first.values[0]
                # Without a reading at the start the position there is uncertain by what the vehicle moves until then.
                stds[number, at] = sizes.speed[rate - 1] * float(first.time[0])
    return PlanarGrid.of(data, starts, stds, sizes.speed, yaw_only=yaw_only, interval=interval, latency=latency)
