"""Free-running simulation of planar runs, compared to the measurement."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from rovid.core.array_types import BoolArray, FloatArray, IntArray
from rovid.model.simulation import HORIZONS, FitMeasures, fit_measures
from rovid.planar.dataset import (
    SMOOTHED_INTERVALS,
    PlanarData,
    PlanarRun,
    is_yaw_alone,
    measured_axes,
    slowest_interval,
    smooth_motion,
    smooth_run,
)
from rovid.planar.equations import forces
from rovid.planar.free_runs import PlanarMotion, estimated_start, simulate_planar
from rovid.planar.model import AXIS_NAMES, SENSORS, PlanarModel
from rovid.trial.rates import integral
from rovid.trial.trial import Readings

SENSOR_UNITS = dict(zip(SENSORS, ("rad", "rad/s", "m/s", "m/s", "m", "m"), strict=True))
# Speeds, which the measures of agreement are about.
SPEEDS = ("yaw_rate", "surge_velocity", "sway_velocity")
# s; interval over which a heading gives a rate, where none is logged. Measurement and simulation are treated alike.
_DIFFERENCE = 1.0
# Width of the kernel behind missing forces, in shares of the shortest time constant.
_SMOOTH_SHARE = 0.2
# Readings of a run that the interval holds at least.
_LEAST_STEPS = 5


@dataclass(frozen=True, kw_only=True, eq=False)
class PlanarTrialSimulation:
    """Free-running simulation of one run from its first sample, beside the readings."""

    run: PlanarRun
    motion: PlanarMotion
    #: ``measured``, ``simulated``: speed -> its readings and the simulation at the same instants. A rate that is not
    #: logged comes from the heading.
    measured: Mapping[str, Readings]
    simulated: Mapping[str, FloatArray]
    fits: Mapping[str, FitMeasures]  #: Speed -> agreement.
    #: ``heading_errors``, ``track_errors``: horizon in s -> RMS error of the heading in rad and of the position in m so
    #: long after a restart. None where no part of the run is as long, or positions are not measured.
    heading_errors: Mapping[float, float | None]
    track_errors: Mapping[float, float | None]
    track_rms: float  #: m; RMS distance of the simulated from the measured track. NaN where none is measured.

    @property
    def name(self) -> str:
        """Name of the trial."""
        return self.run.name

    @property
    def samples(self) -> int:
        """Number of readings of all sensors."""
        return len(self.run.event_value)


def simulate_planar_trials(model: PlanarModel, data: PlanarData) -> list[PlanarTrialSimulation]:
    """Simulate every run freely, and compare it to its readings."""
    yaw_only = is_yaw_alone(data)
    return [_simulated(model, run, yaw_only=yaw_only) for run in data.runs]


def pooled_measures(simulations: Sequence[PlanarTrialSimulation]) -> dict[str, FitMeasures]:
    """Speed -> agreement over all runs that measure it."""
    pooled = {}
    for speed in SPEEDS:
        items = [item for item in simulations if speed in item.measured]
        if items:
            measured = np.concatenate([item.measured[speed].values for item in items])
            pooled[speed] = fit_measures(measured, np.concatenate([item.simulated[speed] for item in items]))
    return pooled


def worst_run(simulations: Sequence[PlanarTrialSimulation]) -> int:
    """Index of the run with the largest error of the yaw rate."""
    errors = [item.fits["yaw_rate"].rmse if "yaw_rate" in item.fits else math.nan for item in simulations]
    return int(np.argmax(np.nan_to_num(errors, nan=-1.0)))


def missing_forces(
    model: PlanarModel, run: PlanarRun, *, yaw_only: bool
) -> tuple[FloatArray, Mapping[str, FloatArray]] | None:
    """Time in s, and axis -> force in N or N m that the ``model`` misses in a run; None for too short a run.

    Inverse dynamics of the smoothed motion through the water: the force that equation (1) of docs/planar.md lacks.
    """
    linear, quadratic = model.base[4:7], model.base[7:10]
    effects = model.actuator_effects
    width = SMOOTHED_INTERVALS * slowest_interval(run)
    smooth = smooth_run(run, width, effects)
    if smooth is None:
        return None
    speed = np.sqrt(np.mean(smooth.speeds**2, axis=0))
    rates = (linear + 2.0 * quadratic * speed) / np.diag(model.mass_matrix)
    smooth = smooth_run(run, max(width, _SMOOTH_SHARE / float(rates.max())), effects) or smooth
    smooth = smooth.in_current(*model.current)
    missing = np.array([
        model.mass_matrix @ change + model.coriolis_matrix(now.tolist()) @ now - forces(model, now, inputs)
        for now, change, inputs in zip(smooth.speeds, smooth.accelerations, smooth.inputs, strict=True)
    ])  # fmt: skip
    known = (False, False, True) if yaw_only else measured_axes(run.sensors)
    return smooth.time, {name: missing[:, at] for at, name in enumerate(AXIS_NAMES) if known[at]}


def _simulated(model: PlanarModel, run: PlanarRun, *, yaw_only: bool) -> PlanarTrialSimulation:
    motion = simulate_planar(model, run, estimated_start(model, run, yaw_only=yaw_only), yaw_only=yaw_only)
    measured, simulated = {}, {}
    for speed in SPEEDS[:1] if yaw_only else SPEEDS:
        if speed in run.sensors:
            measured[speed] = run.readings(speed)
            simulated[speed] = np.interp(measured[speed].time, motion.time, motion.sensor(speed))
        elif speed == "yaw_rate" and "heading" in run.sensors:
            heading = run.readings("heading")
            measured[speed] = _rate(heading)
            twin = Readings(time=heading.time, values=np.interp(heading.time, motion.time, motion.heading))
            simulated[speed] = _rate(twin).values
    errors = {seconds: _restart_errors(model, run, seconds, yaw_only=yaw_only) for seconds in HORIZONS}
    return PlanarTrialSimulation(
        run=run,
        motion=motion,
        measured=measured,
        simulated=simulated,
        fits={speed: fit_measures(measured[speed].values, simulated[speed]) for speed in measured},
        heading_errors={seconds: _rms(heading) for seconds, (heading, _) in errors.items()},
        track_errors={seconds: None if yaw_only else _rms(track) for seconds, (_, track) in errors.items()},
        track_rms=math.nan if yaw_only else _track_rms(run, motion),
    )


def _rate(heading: Readings) -> Readings:
    """Rate in rad/s as difference quotient of a heading."""
    time, values = heading.time, heading.values
    if len(time) <= _LEAST_STEPS:
        return Readings(time=time[:0], values=values[:0])
    step = min(max(_LEAST_STEPS, round(_DIFFERENCE / float(np.median(np.diff(time))))), len(time) - 1)
    span = time[step:] - time[:-step]
    # Across a gap the quotient is a mean over another time.
    near = span < 2.0 * np.median(span)
    rate = (values[step:] - values[:-step]) / span
    return Readings(time=0.5 * (time[step:] + time[:-step])[near], values=rate[near])


def _track_rms(run: PlanarRun, motion: PlanarMotion) -> float:
    """RMS distance in m between the measured and the simulated positions, at the readings of north."""
    if not {"north", "east"} <= set(run.sensors):
        return math.nan
    north, east = run.readings("north"), run.readings("east")
    along = north.values - np.interp(north.time, motion.time, motion.north)
    across = np.interp(north.time, east.time, east.values) - np.interp(north.time, motion.time, motion.east)
    return float(np.sqrt(np.mean(along**2 + across**2)))


def _restart_errors(
    model: PlanarModel, run: PlanarRun, horizon: float, *, yaw_only: bool
) -> tuple[FloatArray, FloatArray]:
    """Errors of heading in rad and of position in m, ``horizon`` s after restarts that are one horizon apart.

    A restart has the smoothed motion as measured, and the states of the actuators. Between fixes the track is that of
    the smoothed speeds.
    """
    smooth = smooth_motion(run)
    if smooth is None or smooth.time[-1] - smooth.time[0] < horizon:
        return np.zeros(0), np.zeros(0)
    begins = np.arange(smooth.time[0], smooth.time[-1] - horizon + 1e-9, horizon)
    first = np.searchsorted(run.time, begins)
    last = np.minimum(np.searchsorted(run.time, run.time[first] + horizon), len(run.time) - 1)
    has_heading = _are_read(run, ("heading",), first) & _are_read(run, ("heading",), last)
    has_track = _are_read(run, ("north", "east"), first) & _are_read(run, ("north", "east"), last)

    cosine, sine = np.cos(smooth.heading), np.sin(smooth.heading)
    ahead, aside = smooth.speeds[:, 0], smooth.speeds[:, 1]
    rates = {"north": ahead * cosine - aside * sine, "east": ahead * sine + aside * cosine}

    def read(name: str, rows: IntArray) -> FloatArray:
        if name not in run.sensors:
            return np.zeros(len(rows))
        readings, rate = run.readings(name), rates.get(name, np.zeros(len(smooth.time)))
        moved = integral(smooth.time, rate)
        fixed = readings.values - np.interp(readings.time, smooth.time, moved)
        time = run.time[rows]
        return np.asarray(np.interp(time, smooth.time, moved) + np.interp(time, readings.time, fixed))

    starts = np.column_stack([
        np.interp(run.time[first], smooth.time, smooth.heading),
        *(np.interp(run.time[first], smooth.time, column) for column in smooth.speeds.T),
        read("north", first), read("east", first),
    ])  # fmt: skip
    rows = np.concatenate([np.arange(begin, end + 1) for begin, end in zip(first, last, strict=True)])
    offsets = np.concatenate(([0], np.cumsum(last - first + 1)))
    inputs = run.forces(model.actuator_effects).inputs[rows]
    speed = np.maximum(np.sqrt(np.mean(smooth.speeds**2, axis=0)), 1e-3)
    motion = PlanarMotion.simulated(
        model, offsets, run.time[rows], inputs, starts, speed, yaw_only=yaw_only, sensors=run.sensors
    )
    ends = offsets[1:] - 1
    heading = motion.heading[ends] - read("heading", last)
    track = np.hypot(motion.north[ends] - read("north", last), motion.east[ends] - read("east", last))
    return heading[has_heading], track[has_track]


def _are_read(run: PlanarRun, names: Sequence[str], rows: IntArray) -> BoolArray:
    """Whether readings of these sensors are near each of these instants: within two of their usual intervals."""
    near = np.full(len(rows), set(names) <= set(run.sensors))
    for name in names if near.any() else ():
        time = run.readings(name).time
        after = np.clip(np.searchsorted(time, run.time[rows]), 1, len(time) - 1)
        distance = np.minimum(np.abs(time[after] - run.time[rows]), np.abs(run.time[rows] - time[after - 1]))
        near &= distance <= 2.0 * np.median(np.diff(time))
    return near


def _rms(values: FloatArray) -> float | None:
    return float(np.sqrt(np.mean(np.square(values)))) if len(values) else None
