"""How large what is measured usually is: the units in which a fit searches."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.effects.actuator_inputs import SPEEDS, actuator_inputs, neutral_commands
from rovid.effects.base import Scales
from rovid.signals.preprocessing import Run
from rovid.trial.trial import Trial
from rovid.trial.vehicle import Vehicle

# It is divided by.
_NOT_NOTHING = 1e-9
_HOUR = 3600.0


def rms(series: Sequence[FloatArray]) -> float:
    """Root mean square of what is known, but never nothing."""
    values = np.concatenate(series)
    return max(float(np.sqrt(np.nanmean(values**2))), _NOT_NOTHING)


def rms_rate(runs: Sequence[Run]) -> float:
    """Root mean square of the rate, rad/s or m/s."""
    return rms([run.rates.rate for run in runs])


def rms_nonzero(values: FloatArray) -> float:
    """Root mean square of those ``values`` that are not nothing; 1 where all are."""
    some = values[np.abs(values) > 0.0]
    return float(np.sqrt(np.mean(some**2))) if some.size else 1.0


def effect_scales(
    trials: Sequence[Trial], vehicle: Vehicle | None, torque: float, rate: float, *, has_actuators: bool
) -> Scales:
    """What one unit of each effect's parameter is, by the ``torque`` in N m and the ``rate`` in rad/s in use.

    ``driven`` is whether anything drives the vehicle.
    """
    race, root, load = math.sqrt(torque), math.sqrt(torque), 1.0
    if vehicle is not None and has_actuators:
        race, root = _races(trials, vehicle)
        load = _load(trials, vehicle)
    surge, sway = (_speed(trials, name) for name in SPEEDS)
    longest, day = _hours(trials)
    return Scales(
        command=_command(trials, vehicle),
        torque=torque,
        rate=rate,
        wash=race,
        sqrt_thrust=root,
        surge=surge,
        sway=sway,
        load=load,
        longest=longest,
        day=day,
    )


def _command(trials: Sequence[Trial], vehicle: Vehicle | None) -> float:
    """Farthest command from neutral."""
    neutral = 0.0 if vehicle is None else neutral_commands(vehicle)
    farthest = [np.max(np.abs(trial.commands - neutral), initial=0.0) for trial in trials]
    return float(max(farthest))


def _races(trials: Sequence[Trial], vehicle: Vehicle) -> tuple[float, float]:
    """Of the race in use, N^0.5 m^2, and of the root of a thrust in use, N^0.5."""
    thrusts = [vehicle.thrust(trial.commands) for trial in trials]
    races = [actuator_inputs(vehicle, trial).wash(thrust) for trial, thrust in zip(trials, thrusts, strict=True)]
    return rms_nonzero(np.concatenate(races)), rms_nonzero(np.sqrt(np.abs(np.concatenate(thrusts))))


def _load(trials: Sequence[Trial], vehicle: Vehicle) -> float:
    """Heaviest load of all thrusters together, as a share of their full thrust; 1 where there is none."""
    full = sum(thruster.full_thrust for thruster in vehicle.thrusters)
    loads = [np.abs(vehicle.thrust(trial.commands)).sum(axis=1) for trial in trials]
    heaviest = max([0.0, *(float(load.max(initial=0.0)) for load in loads)])
    return heaviest / full or 1.0


def _speed(trials: Sequence[Trial], name: str) -> float:
    """Root mean square of a logged speed, m/s; 1 where there is none."""
    logged = np.concatenate([trial.extras.get(name, np.zeros(0)) for trial in trials])
    known = logged[np.isfinite(logged)]
    if not known.any():
        return 1.0
    return float(np.sqrt(np.mean(known**2)))


def _hours(trials: Sequence[Trial]) -> tuple[float, float]:
    """Of the longest log, and of all from the beginning of the first to the end of the last."""
    spans = [float(np.ptp(trial.time)) for trial in trials]
    ends = [trial.campaign_time + span for trial, span in zip(trials, spans, strict=True)]
    return max([0.0, *spans]) / _HOUR, max([0.0, *ends]) / _HOUR
