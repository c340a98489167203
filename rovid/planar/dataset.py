"""The data of the coupled model: runs with the readings of every sensor at their own instants.

What the kernels get of a run: `PlanarRun.time`, on which the model is stepped; the events, each a reading of one sensor
at one of these instants; and `PlanarRun.forces(effects)`, constant from each instant to the next. Intervals have any
length: a few microseconds between two sensors, or many seconds in a gap, within which an integrator takes several
steps.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Self

import numpy as np

from rovid.core.array_types import FloatArray, IntArray
from rovid.core.errors import DataError
from rovid.model.bound_effects import BoundEffect
from rovid.planar.actuators import PlanarActuators, PlanarCommands, PlanarForces
from rovid.trial.cutting import with_rows
from rovid.trial.trial import Campaign, Readings, Trial
from rovid.trial.vehicle import Vehicle

# Sensors in their order. Heading in rad, unwrapped; rates and velocities over ground in body axes; north and east in m.
SENSORS = ("heading", "yaw_rate", "surge_velocity", "sway_velocity", "north", "east")
# s; readings as close as this to an instant of the log belong to it.
_SAME_INSTANT = 1e-4
# Number of latest forces that a run remembers.
_REMEMBERED = 8


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

    @property
    def sensors(self) -> tuple[str, ...]:
        """Names of the sensors with readings in any run, in the order of `SENSORS`."""
        return tuple(name for name in SENSORS if any(name in run.sensors for run in self.runs))

    def subset(self, numbers: Sequence[int]) -> Self:
        """The data of some runs, in this order."""
        return replace(self, runs=tuple(self.runs[number] for number in numbers))


def planar_data(campaign: Campaign, vehicle: Vehicle) -> PlanarData:
    """All runs of a campaign that was read with `load_planar_config`.

    Raises
    ------
    DataError
        ``vehicle`` was read for one axis.
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
