"""The data of the coupled model: runs with the readings of every sensor at their own instants.

What the kernels get of a run: `PlanarRun.time`, on which the model is stepped; the events, each a reading of one sensor
at one of these instants; and `PlanarRun.forces(effects)`, constant from each instant to the next. Intervals have any
length: a few microseconds between two sensors, or many seconds in a gap, within which an integrator takes several
steps. For start values, `smooth_run` takes the readings through one Gaussian kernel, on a uniform grid.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, fields, replace
from typing import TYPE_CHECKING, Self

import numpy as np

from rovid.core.array_types import FloatArray, IntArray
from rovid.core.errors import DataError
from rovid.model.bound_effects import BoundEffect
from rovid.planar.model import SENSORS, PlanarActuators, PlanarCommands, PlanarForces
from rovid.trial.preprocessing import with_rows
from rovid.trial.trial import Campaign, Readings, Trial
from rovid.trial.vehicle import Vehicle

if TYPE_CHECKING:
    from rovid.planar.likelihood import PlanarPrior

# s; readings as close as this to an instant of the log belong to it.
_SAME_INSTANT = 1e-4
# Share of the thrust by which rounding leaves a force.
_ROUNDING = 1e-6
# Number of latest forces that a run remembers.
_REMEMBERED = 8
# Width of the smoothing of measured speeds that are compared with a model, in intervals of the slowest sensor.
SMOOTHED_INTERVALS = 2.0
# Grid points in a standard deviation of the kernel, standard deviations to each side, and the least points of a run.
_POINTS, _REACH, _LEAST = 3, 3, 8


@dataclass(frozen=True, kw_only=True, eq=False)
class PlanarRun:
    """One trial with the readings of all its sensors."""

    name: str
    #: The trial with one row for each instant of ``time``: where a command changed or anything was measured. Its
    #: position is the heading, NaN where not measured.
    trial: Trial
    time: FloatArray  #: (n,) s, strictly increasing from 0.
    event_index: IntArray  #: (m,) index in ``time`` of each reading, not decreasing.
    event_sensor: IntArray  #: (m,) index in `SENSORS`.
    event_value: FloatArray  #: (m,) SI, rad.
    commands: PlanarCommands
    actuators: PlanarActuators
    _known: dict[tuple[object, ...], PlanarForces] = field(default_factory=dict, init=False, repr=False)

    @classmethod
    def of(cls, trial: Trial, actuators: PlanarActuators) -> Self:
        """The run of a ``trial`` that was read with `load_planar_config`."""
        readings = dict(trial.readings)
        if not trial.rate_only:
            measured = trial.measured
            readings["heading"] = Readings(time=trial.time[measured], values=trial.position[measured])
        whole = _with_instants(trial, [one.time for one in readings.values()])
        index, sensor, value = [], [], []
        for number, name in enumerate(SENSORS):
            if name in readings:
                index.append(_nearest(whole.time, readings[name].time))
                sensor.append(np.full(len(readings[name].time), number))
                value.append(readings[name].values)
        order = np.argsort(np.concatenate(index), kind="stable")
        return cls(
            name=trial.name,
            trial=whole,
            time=whole.time,
            event_index=np.concatenate(index)[order],
            event_sensor=np.concatenate(sensor)[order],
            event_value=np.concatenate(value)[order],
            commands=PlanarCommands(actuators, whole),
            actuators=actuators,
        )

    @property
    def sensors(self) -> tuple[str, ...]:
        """Names of the sensors with readings."""
        return tuple(SENSORS[at] for at in np.unique(self.event_sensor).tolist())

    @property
    def duration(self) -> float:
        """Length in s."""
        return float(self.time[-1])

    def readings(self, name: str) -> Readings:
        """Readings of the sensor ``name``, at the instants of ``time``; none where it was not logged."""
        chosen = self.event_sensor == SENSORS.index(name)
        return Readings(time=self.time[self.event_index[chosen]], values=self.event_value[chosen])

    def forces(self, effects: Sequence[BoundEffect] = ()) -> PlanarForces:
        """Forces from each instant to the next, with the ``effects`` between command and thrust."""
        key = tuple(part for one in effects for part in (one.effect, *one.parameters.tolist()))
        known = self._known.get(key)
        if known is None:
            # Other threads may do the same at any time.
            known = self.actuators.forces(self.commands, effects)
            for oldest in list(self._known)[: 1 - _REMEMBERED]:
                self._known.pop(oldest, None)
            self._known[key] = known
        return known


@dataclass(frozen=True, kw_only=True, eq=False)
class PlanarData:
    """The runs of one campaign."""

    runs: tuple[PlanarRun, ...]
    vehicle: Vehicle
    actuators: PlanarActuators
    prior: PlanarPrior | None = None  #: What the user knows of the parameters from elsewhere.
    placed: frozenset[str] = frozenset()  #: Names of the sensors whose position rovid.toml has.

    @property
    def sensors(self) -> tuple[str, ...]:
        """Names of the sensors with readings in any run, in the order of `SENSORS`."""
        return tuple(name for name in SENSORS if any(name in run.sensors for run in self.runs))

    def subset(self, numbers: Sequence[int]) -> Self:
        """The data of some runs, in this order."""
        return replace(self, runs=tuple(self.runs[number] for number in numbers))


def is_yaw_alone(data: PlanarData) -> bool:
    """Whether only yaw can be estimated: surge and sway are not measured, or nothing drives them."""
    if not any(measured_axes(data.sensors)[:2]):
        return True
    return not data.actuators.rudders and not is_pushed(data)


def is_pushed(data: PlanarData) -> bool:
    """Whether a thruster pushes along surge or sway."""
    # Thrusters in opposite pairs leave rounding errors.
    force = max(float(np.abs(run.forces().force[:, :2]).max(initial=0.0)) for run in data.runs)
    return force > _ROUNDING * sum(thruster.full_thrust for thruster in data.actuators.thrusters.thrusters)


def has_hidden_sway(data: PlanarData) -> bool:
    """Whether the logs measure the surge but not the sway."""
    surge, sway, _ = measured_axes(data.sensors)
    return surge and not sway


def require_measured(data: PlanarData) -> None:
    """Refuse headings alone where they cannot determine the yaw model, and rudders without propulsion."""
    if not is_yaw_alone(data):
        if not is_pushed(data):
            raise DataError(
                f"nothing pushes the vehicle but {data.actuators.rudder_names[0]}, which only turns it.",
                mend="Enter its propulsion in [[thrusters]] of rovid.toml, or fit yaw alone without --axes planar.",
            )
        return
    mend = "Map surge_velocity and sway_velocity, or north and east, in [signals] of rovid.toml."
    if data.actuators.rudders:
        raise DataError(
            f"the force of {data.actuators.rudder_names[0]} depends on the speed through the water, and these logs "
            "measure neither a speed nor a position.",
            mend=mend,
        )
    if not any(run.forces().force[:, 2].any() for run in data.runs):
        raise DataError("no actuator turns the vehicle in these logs, which measure the heading alone.", mend=mend)


def planar_data(campaign: Campaign, vehicle: Vehicle) -> PlanarData:
    """All runs of a campaign that was read with `load_planar_config`.

    Raises DataError if ``vehicle`` was read for one axis.
    """
    if not vehicle.planar:
        raise DataError("the logs were read for one axis, not for surge, sway and yaw together.")
    vehicle = vehicle.with_logged_torque(campaign.trials)
    for trial in campaign.trials:
        vehicle.torque(trial)  # Refuses commands outside the bench curves.
    actuators = PlanarActuators.of(vehicle, campaign.trials)
    runs = tuple(PlanarRun.of(trial, actuators) for trial in campaign.trials)
    return PlanarData(runs=runs, vehicle=vehicle, actuators=actuators)


def _with_instants(trial: Trial, stamps: Sequence[FloatArray]) -> Trial:
    """``trial`` with a row at each of the ``stamps`` that has none."""
    every = np.sort(np.concatenate(stamps))
    rows = np.minimum(np.searchsorted(trial.time, every), len(trial.time) - 1)
    before = trial.time[np.maximum(rows - 1, 0)]
    is_new = np.minimum(np.abs(trial.time[rows] - every), np.abs(every - before)) > _SAME_INSTANT
    new = every[is_new & (every > 0.0) & (every < trial.time[-1])]
    # Of several sensors with nearly the same stamp the first one counts.
    kept = np.diff(np.floor(new / _SAME_INSTANT), prepend=-1.0) > 0.0
    new = new[kept]
    if not new.size:
        return trial
    at = np.searchsorted(trial.time, new)
    return with_rows(trial, new, trial.commands[at - 1], at)


def _nearest(time: FloatArray, stamps: FloatArray) -> IntArray:
    after = np.clip(np.searchsorted(time, stamps), 1, len(time) - 1)
    return np.where(stamps - time[after - 1] <= time[after] - stamps, after - 1, after)


@dataclass(frozen=True, eq=False)
class SmoothRun:
    """Smoothed motion of one run over ground on a uniform grid; speeds that are not measured are zero."""

    time: FloatArray  #: (g,) s.
    heading: FloatArray  #: (g,) rad.
    speeds: FloatArray  #: (g, 3) u, v over ground in m/s, r in rad/s.
    accelerations: FloatArray  #: (g, 3) of the speeds.
    inputs: FloatArray  #: (g, k) as in `rovid.planar.equations.forces`.

    @classmethod
    def stacked(cls, runs: Sequence[Self], most: int) -> Self:
        """The runs one after the other, thinned to ``most`` points."""
        every = sum(len(run.time) for run in runs) // most + 1
        columns = ([getattr(run, one.name)[::every] for run in runs] for one in fields(cls))
        return cls(*map(np.concatenate, columns))

    def from_place(self, ahead: float) -> Self:
        """The same at the origin, with the sensors of the speeds ``ahead`` m of it."""
        lever = np.array([0.0, ahead, 0.0])
        turning = (one[:, 2:] * lever for one in (self.speeds, self.accelerations))
        speeds, accelerations = (
            own - more for own, more in zip((self.speeds, self.accelerations), turning, strict=True)
        )
        return replace(self, speeds=speeds, accelerations=accelerations)

    def in_current(self, north: float, east: float) -> Self:
        """The same with speeds and accelerations relative to a current."""
        cosine, sine, r = np.cos(self.heading), np.sin(self.heading), self.speeds[:, 2]
        ahead, across = north * cosine + east * sine, east * cosine - north * sine
        zero = np.zeros(len(r))
        speeds = self.speeds - np.column_stack((ahead, across, zero))
        accelerations = self.accelerations - np.column_stack((across * r, -ahead * r, zero))
        return replace(self, speeds=speeds, accelerations=accelerations)


def measured_axes(sensors: tuple[str, ...]) -> tuple[bool, bool, bool]:
    """Whether surge, sway and yaw are measured by these ``sensors``, as a speed or as a position."""
    position = "north" in sensors and "east" in sensors
    return position or "surge_velocity" in sensors, position or "sway_velocity" in sensors, True


def _edges(run: PlanarRun, width: float) -> FloatArray:
    """(g + 1,) s; edges of the cells of the grid, before its ends are cut off."""
    step = width / _POINTS
    return np.asarray(run.time[0] + step * np.arange(int((run.time[-1] - run.time[0]) / step) + 1))


def mean_inputs(run: PlanarRun, width: float, effects: tuple[BoundEffect, ...] = ()) -> FloatArray:
    """(g, k) mean inputs of the cells of the grid of `smooth_run`, with ``effects`` between command and thrust."""
    return np.asarray(_mean_inputs(run, width, effects)[_REACH * _POINTS : -_REACH * _POINTS])


def _mean_inputs(run: PlanarRun, width: float, effects: tuple[BoundEffect, ...]) -> FloatArray:
    edges, inputs = _edges(run, width), run.forces(effects).inputs
    area = np.vstack((np.zeros(inputs.shape[1]), np.cumsum(inputs[:-1] * np.diff(run.time)[:, None], axis=0)))
    return np.column_stack([np.diff(np.interp(edges, run.time, column)) for column in area.T]) / (width / _POINTS)


def smoothed(values: FloatArray) -> FloatArray:
    """(g, a) columns on the grid of `smooth_run` through its kernel."""
    return np.column_stack([_convolved(column, 1.0)[0] for column in values.T])


def smooth_run(run: PlanarRun, width: float, effects: tuple[BoundEffect, ...] = ()) -> SmoothRun | None:
    """Motion of ``run`` through a kernel with a standard deviation of ``width`` s; None for too short a run.

    ``effects`` are those between command and thrust, for the inputs.
    """
    edges, step = _edges(run, width), width / _POINTS
    count = len(edges) - 1
    if count < 2 * _REACH * _POINTS + _LEAST:
        return None
    grid = 0.5 * (edges[1:] + edges[:-1])
    readings = {name: run.readings(name) for name in SENSORS if name in run.sensors}

    def through_kernel(own: Readings) -> tuple[FloatArray, FloatArray]:
        """Values and derivative of a sensor on the grid."""
        area = np.concatenate(([0.0], np.cumsum(0.5 * (own.values[1:] + own.values[:-1]) * np.diff(own.time))))
        # Means over the cells; beyond the readings the end values hold.
        inside = np.clip(edges, own.time[0], own.time[-1])
        total = np.interp(inside, own.time, area)
        total += np.where(edges < own.time[0], (edges - own.time[0]) * own.values[0], 0.0)
        total += np.where(edges > own.time[-1], (edges - own.time[-1]) * own.values[-1], 0.0)
        return _convolved(np.diff(total) / step, step)

    if "heading" in readings:
        heading, rate = through_kernel(readings["heading"])
    else:
        rate = through_kernel(readings["yaw_rate"])[0]
        heading = np.cumsum(rate) * step
    acceleration = np.gradient(rate, step)
    if "yaw_rate" in readings:
        rate, acceleration = through_kernel(readings["yaw_rate"])
    speeds, accelerations = np.zeros((count, 3)), np.zeros((count, 3))
    speeds[:, 2], accelerations[:, 2] = rate, acceleration
    measured = [readings.get("surge_velocity"), readings.get("sway_velocity")]
    if "north" in readings and "east" in readings and None in measured:
        known = readings.get("heading", Readings(time=grid, values=heading))
        of_position = _body_velocity(readings["north"], readings["east"], known)
        measured = [own or other for own, other in zip(measured, of_position, strict=True)]
    for axis, own in enumerate(measured):
        if own is not None:
            speeds[:, axis], accelerations[:, axis] = through_kernel(own)
    inner = slice(_REACH * _POINTS, count - _REACH * _POINTS)
    inputs = smoothed(_mean_inputs(run, width, effects))[inner]
    return SmoothRun(grid[inner], heading[inner], speeds[inner], accelerations[inner], inputs)


def _body_velocity(north: Readings, east: Readings, heading: Readings) -> tuple[Readings, Readings]:
    """Mean velocity ahead and to starboard between successive positions, at the middle of each interval.

    A kernel over the velocity to north and east would take the turn of the vehicle for a loss of speed.
    """
    steps, time = np.diff(north.time), 0.5 * (north.time[1:] + north.time[:-1])
    psi = np.interp(time, heading.time, heading.values)
    to_north = np.diff(north.values) / steps
    to_east = np.diff(np.interp(north.time, east.time, east.values)) / steps
    ahead, across = (to_north * np.cos(psi) + to_east * np.sin(psi), to_east * np.cos(psi) - to_north * np.sin(psi))
    return Readings(time=time, values=ahead), Readings(time=time, values=across)


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


def smooth_motion(run: PlanarRun) -> SmoothRun | None:
    """`smooth_run` with a width of two intervals of the slowest sensor, for comparisons with a model."""
    return smooth_run(run, SMOOTHED_INTERVALS * slowest_interval(run))


def sensor_noise(run: PlanarRun, name: str) -> float:
    """Standard deviation of the white noise of a sensor, from the median second difference of its readings."""
    values = run.readings(name).values
    if len(values) < 8:
        return float("nan")
    # The second difference of white noise has six times its variance.
    return float(1.4826 * np.median(np.abs(np.diff(values, 2))) / np.sqrt(6.0))
