"""Free-running simulation of runs, and how well it explains the measured speeds."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.estimate.estimate import r_squared
from rovid.planar.coordinates import is_of_actuators
from rovid.planar.dataset import SENSORS, PlanarData, PlanarRun
from rovid.planar.integration import CURRENT, HEADING, NORTH, STATES, SURGE, simulate_runs
from rovid.planar.model import AXIS_NAMES, PlanarModel
from rovid.planar.smoothing import measured_axes, run_inputs, sensor_noise, slowest_interval, smooth_run

# Width of the smoothing of measured speeds, in intervals of the slowest sensor.
_WIDTH = 2.0
# Time constants whose readings determine the start of a simulation, least number of readings, Gauss-Newton steps.
_START_TIMES, _START_READINGS, _START_ITERATIONS = 2.0, 30, 4


@dataclass(frozen=True, kw_only=True, eq=False)
class PlanarMotion:
    """Free-running simulation of a run at the instants of its ``time``."""

    time: FloatArray  #: (n,) s.
    heading: FloatArray  #: (n,) rad.
    #: ``surge_velocity``, ``sway_velocity``: (n,) m/s over ground, in body axes; ``yaw_rate``: (n,) rad/s.
    surge_velocity: FloatArray
    sway_velocity: FloatArray
    yaw_rate: FloatArray
    #: ``north``, ``east``: (n,) m.
    north: FloatArray
    east: FloatArray
    #: (n, 3) u, v, r through the water.
    through_water: FloatArray

    @classmethod
    def of_states(cls, time: FloatArray, states: FloatArray, current: tuple[float, float]) -> PlanarMotion:
        """The motion of (n, 12) states of `rovid.planar.kernels`, in a current to north and east in m/s."""
        heading = states[:, HEADING]
        cosine, sine = np.cos(heading), np.sin(heading)
        north, east = current[0] + states[:, CURRENT], current[1] + states[:, CURRENT + 1]
        return cls(
            time=time,
            heading=heading,
            surge_velocity=states[:, SURGE] + north * cosine + east * sine,
            sway_velocity=states[:, SURGE + 1] + east * cosine - north * sine,
            yaw_rate=states[:, SURGE + 2],
            north=states[:, NORTH],
            east=states[:, NORTH + 1],
            through_water=states[:, SURGE : SURGE + 3],
        )

    def sensor(self, name: str) -> FloatArray:
        """(n,) noise-free readings of a sensor, by its name."""
        return np.asarray(getattr(self, name))


def simulate_planar(
    model: PlanarModel, run: PlanarRun, start: FloatArray | None = None, *, yaw_only: bool = False
) -> PlanarMotion:
    """Free-running simulation of ``run``.

    Parameters
    ----------
    start
        (6,) heading, u and v over ground, r, north and east at the first instant; by default from the readings.
    yaw_only
        Whether surge and sway are left out.
    """
    inputs = run_inputs(run, tuple(one for one in model.effects if is_of_actuators(one.effect)))
    first = measured_start(run) if start is None else np.asarray(start, dtype=np.float64)
    states = np.zeros((len(run.time), STATES))
    speed = np.maximum(np.abs(first[1:4]), 0.1)
    offsets = np.array([0, len(run.time)])
    simulate_runs(offsets, run.time, inputs, first[None], speed, yaw_only, model.coefficients, states)
    return PlanarMotion.of_states(run.time, states, model.current)


def measured_start(run: PlanarRun) -> FloatArray:
    """(6,) heading, u and v over ground, r, north and east at the first instant, by the readings; zeros where none."""
    start = np.zeros(6)
    smooth = smooth_run(run, _WIDTH * slowest_interval(run))
    if smooth is not None:
        start[1:4] = smooth.speeds[0]
    for at, name in ((0, "heading"), (4, "north"), (5, "east")):
        if name in run.sensors:
            start[at] = run.readings(name).values[0]
    return start


def estimated_start(model: PlanarModel, run: PlanarRun, *, yaw_only: bool) -> FloatArray:
    """(6,) heading, u and v over ground, r, north and east at the first instant of a run.

    Least squares of the simulation against the readings of the first time constants, by the Gauss-Newton method.
    """
    start = measured_start(run)
    speed = np.maximum(np.abs(start[1:4]), 0.1)
    rates = (model.base[4:7] + 2.0 * model.base[7:10] * speed) / np.diag(model.mass_matrix)
    fastest = float(rates.max())  # 1/s; 0 without drag, as where no actuator acts
    last = int(np.searchsorted(run.time, run.time[0] + _START_TIMES / fastest)) if fastest else len(run.time)
    events = max(int(np.searchsorted(run.event_index, last)), _START_READINGS)
    index, sensor, value = run.event_index[:events], run.event_sensor[:events], run.event_value[:events]
    rows = slice(0, int(index[-1]) + 2)
    inputs, time = (
        run_inputs(run, tuple(one for one in model.effects if is_of_actuators(one.effect)))[rows],
        run.time[rows],
    )
    noise = np.array([sensor_noise(run, SENSORS[at]) if at in sensor else 1.0 for at in range(len(SENSORS))])
    weight = 1.0 / np.where(noise > 0.0, noise, 1.0)[sensor]

    def simulated(first: FloatArray) -> FloatArray:
        states, offsets = np.zeros((len(time), STATES)), np.array([0, len(time)])
        simulate_runs(offsets, time, inputs, first[None], speed, yaw_only, model.coefficients, states)
        motion = PlanarMotion.of_states(time, states, model.current)
        return weight * np.column_stack([motion.sensor(name) for name in SENSORS])[index, sensor]

    steps = 1e-4 * np.array([1.0, *speed, 1.0, 1.0])
    free = [0, 3] if yaw_only else range(len(start))
    for _ in range(_START_ITERATIONS):
        now = simulated(start)
        columns = [(simulated(start + steps * (np.arange(len(start)) == at)) - now) / steps[at] for at in free]
        if not all(np.isfinite(column).all() for column in (now, *columns)):
            # The model diverges within the readings.
            return measured_start(run)
        # The least-norm step: components that these readings do not determine keep their values.
        change = np.linalg.lstsq(np.column_stack(columns), weight * value - now, rcond=1e-9)[0]
        start = start + np.bincount(list(free), change, len(start))
    return start


def free_run_r2(model: PlanarModel, data: PlanarData, *, yaw_only: bool = False) -> Mapping[str, float]:
    """Axis -> R^2 of the free-running speed against the smoothed speed; axes that are not measured are left out."""
    measured: list[FloatArray] = []
    simulated: list[FloatArray] = []
    for run in data.runs:
        smooth = smooth_run(run, _WIDTH * slowest_interval(run))
        if smooth is None:
            continue
        start = estimated_start(model, run, yaw_only=yaw_only)
        motion = simulate_planar(model, run, start, yaw_only=yaw_only)
        speeds = (motion.surge_velocity, motion.sway_velocity, motion.yaw_rate)
        measured.append(smooth.speeds)
        simulated.append(np.column_stack([np.interp(smooth.time, run.time, one) for one in speeds]))
    if not measured:
        return {}
    whole, rest = np.concatenate(measured), np.concatenate(measured) - np.concatenate(simulated)
    known = measured_axes(data.sensors)
    return {name: r_squared(whole[:, at], rest[:, at]) for at, name in enumerate(AXIS_NAMES) if known[at]}


def mean_free_run_r2(model: PlanarModel, data: PlanarData, *, yaw_only: bool) -> float:
    """Mean R^2 of the free-running speeds, each -1 at least."""
    with np.errstate(over="ignore", invalid="ignore"):
        r2 = free_run_r2(model, data, yaw_only=yaw_only)
    return float(np.mean([max(value, -1.0) if math.isfinite(value) else -1.0 for value in r2.values()] or [-1.0]))
