"""The data that an objective evaluates: runs, RMS values, and scales of the parameters."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar

import numpy as np

from rovid.core.array_types import FloatArray, IntArray
from rovid.effects.actuator_inputs import SPEEDS, actuator_inputs, neutral_commands
from rovid.effects.base import Scales
from rovid.estimate.input_cache import InputCache
from rovid.model.model import Model
from rovid.model.ode import with_past
from rovid.model.simulation import fit_measures, simulated_rate
from rovid.signals.preprocessing import Run
from rovid.trial.axis import Axis
from rovid.trial.trial import Trial
from rovid.trial.vehicle import Vehicle

# Least standard deviation of the measurement noise, over `FitData.reading_scale`. The output of an autopilot's filter
# would claim less.
NOISE_FLOOR = 1e-5
# Least RMS value, because scales are divided by.
_LEAST_RMS = 1e-150
# s, longest time constant that lengths are derived from: longer than any log. Of a fit that ran off, no length follows.
_LONGEST_CONSTANT = 1e6
_HOUR = 3600.0


@dataclass(frozen=True, eq=False)
class FitData(ABC):
    """Runs with all that an objective needs of them, computed once."""

    runs: Sequence[Run]
    vehicle: Vehicle | None
    initial_model: Model  #: Start of the fit, and source of the scales.
    gyro: bool = False  #: Whether logged rates are used besides the positions.
    #: Least time between readings in s; closer readings are skipped, which is enough for a coarse fit. 0 for none.
    interval: float = 0.0

    # As in `InputCache`.
    means_only: ClassVar[bool] = False

    @property
    @abstractmethod
    def steps(self) -> list[IntArray] | None:
        """For each run, the (n,) sample numbers between which the model is stepped; None for all samples."""

    @property
    @abstractmethod
    def innovation_spans(self) -> list[tuple[FloatArray, FloatArray]]:
        """For each run, the (n,) s at which each innovation begins and ends to depend on the motion."""

    @property
    @abstractmethod
    def block_seconds(self) -> float:
        """Length in s of a block, within which innovations may be correlated."""

    @property
    def axis(self) -> Axis:
        """Degree of freedom of the runs."""
        return self.runs[0].trial.axis

    @property
    def rate_only(self) -> bool:
        """Whether only the rate was measured."""
        return self.runs[0].trial.rate_only

    @property
    def has_actuators(self) -> bool:
        """Whether actuators drive the vehicle; else the inertia is 1 kg m^2 and all torques are per kg m^2."""
        return self.runs[0].trial.has_actuators

    @cached_property
    def run_index(self) -> IntArray:
        """(N,) index of the run of each innovation."""
        counts = [len(begin) for begin, _ in self.innovation_spans]
        return np.repeat(np.arange(len(self.runs)), counts)

    @cached_property
    def block_index(self) -> IntArray:
        """(N,) number of the block of each innovation."""
        return self.blocks_of(self.block_seconds)

    def blocks_of(self, seconds: float) -> IntArray:
        """(N,) number of the block of each innovation, for blocks of a length in s."""
        blocks, before = [], 0
        for begin, _ in self.innovation_spans:
            block = (begin / seconds).astype(np.intp)
            blocks.append(block + before)
            before += int(block.max(initial=0)) + 1
        return np.concatenate(blocks)

    @cached_property
    def rms_rate(self) -> float:
        """RMS rate, rad/s or m/s."""
        return rms_rate(self.runs)

    @cached_property
    def rms_torque(self) -> float:
        """RMS of the torque in use, N m; of the restoring torque where there are no actuators."""
        if self.has_actuators:
            return rms_nonzero(np.concatenate([run.torque for run in self.runs]))
        tilt = np.concatenate([run.trial.position[run.trial.measured] for run in self.runs])
        model = self.initial_model
        return rms_nonzero(np.asarray(model.stiffness * np.sin(tilt - model.restoring_values[1])))

    @cached_property
    def drag_scale(self) -> FloatArray:
        """(2,) quadratic and linear drag; each value alone gives the total drag at the RMS rate."""
        drag = self.initial_model.quadratic_drag * self.rms_rate + self.initial_model.linear_drag
        return np.array([drag / self.rms_rate, drag])

    @cached_property
    def scales(self) -> Scales:
        """Scales of the effects' parameters."""
        trials = [run.trial for run in self.runs]
        return effect_scales(trials, self.vehicle, self.rms_torque, self.rms_rate, self.usual_time)

    @cached_property
    def usual_time(self) -> float:
        """Time constant of the vehicle in s, between the sampling interval and the length of the longest run.

        The unit of all times of a fit, such as bounds and initial values.
        """
        shortest = min(run.trial.sampling_interval for run in self.runs)
        longest = max(run.trial.duration for run in self.runs)
        return min(max(time_constant(self.initial_model, self.rms_rate), shortest), longest)

    @cached_property
    def position_scale(self) -> float:
        """Unit of positions: 1 rad, or the m that the vehicle moves in a time constant at the RMS rate."""
        return 1.0 if self.axis.angular else self.rms_rate * self.usual_time

    @property
    def reading_scale(self) -> float:
        """Unit of readings: `position_scale`, or that in a time constant where only the rate was measured."""
        return self.position_scale / self.usual_time if self.rate_only else self.position_scale

    @cached_property
    def position_noise(self) -> float:
        """Standard deviation of the measurement noise before any fit."""
        noise = [run.rates.position_noise for run in self.runs]
        return max(float(np.median(noise)), NOISE_FLOOR * self.reading_scale)

    @cached_property
    def driven_runs(self) -> Sequence[Run]:
        """The runs with the commands before their first sample, see `rovid.model.ode`."""
        vehicle, body = self.vehicle, self.initial_model.body
        if vehicle is None:
            return self.runs
        trials = [with_past(run.trial, body, vehicle) for run in self.runs]
        return [
            run if trial is run.trial else replace(run, trial=trial)
            for run, trial in zip(self.runs, trials, strict=True)
        ]

    @cached_property
    def inputs(self) -> InputCache:
        """Torque inputs of all runs."""
        return InputCache(
            runs=self.driven_runs,
            vehicle=self.vehicle,
            inertia=self.initial_model.inertia,
            position_noise=self.position_noise,
            steps=self.steps,
            means_only=self.means_only,
        )

    def free_run_r2(self, model: Model) -> float:
        """R^2 of the rate over all runs, each simulated freely from its first sample."""
        pairs = zip(self.runs, self.inputs.at_samples(model), strict=True)
        simulated = np.concatenate([simulated_rate(run, model, torque_input) for run, torque_input in pairs])
        return fit_measures(np.concatenate([run.rates.rate for run in self.runs]), simulated).r2


def rms(series: Sequence[FloatArray]) -> float:
    """Root mean square of all finite values, but never zero."""
    values = np.concatenate(series)
    return max(float(np.sqrt(np.nanmean(values**2))), _LEAST_RMS)


def rms_rate(runs: Sequence[Run]) -> float:
    """RMS rate of all runs, rad/s or m/s."""
    return rms([run.rates.rate for run in runs])


def rms_nonzero(values: FloatArray) -> float:
    """Root mean square of the nonzero ``values``; 1 where all are zero."""
    nonzero = values[np.abs(values) > 0.0]
    return float(np.sqrt(np.mean(nonzero**2))) if nonzero.size else 1.0


def time_constant(model: Model, rate: float) -> float:
    """Time constant in s of the decay of a motion at ``rate``, or a third of the natural period where that is less."""
    slope = 2.0 * model.quadratic_drag * rate + model.linear_drag
    constant = min(model.inertia / max(slope, _LEAST_RMS), _LONGEST_CONSTANT)
    if model.natural_frequency > 0.0:
        return min(constant, 2.0 / model.natural_frequency)
    return constant


def effect_scales(
    trials: Sequence[Trial], vehicle: Vehicle | None, torque: float, rate: float, time: float = 1.0
) -> Scales:
    """Scales of the effects' parameters.

    From the RMS ``torque`` in N m, the RMS ``rate``, the time constant ``time`` in s, and the logged channels.
    """
    wash, sqrt_thrust, load, neutral = math.sqrt(torque), math.sqrt(torque), 1.0, np.zeros(1)
    if vehicle is not None:
        neutral = neutral_commands(vehicle)
        if trials[0].has_actuators:
            wash, sqrt_thrust, load = _thruster_scales(trials, vehicle)
    largest_commands = [np.max(np.abs(trial.commands - neutral), initial=0.0) for trial in trials]
    return Scales(
        command=float(max(largest_commands)),
        torque=torque,
        rate=rate,
        wash=wash,
        sqrt_thrust=sqrt_thrust,
        surge=_rms_speed(trials, SPEEDS[0]),
        sway=_rms_speed(trials, SPEEDS[1]),
        load=load,
        longest=max(trial.duration for trial in trials) / _HOUR,
        day=max(trial.campaign_time + trial.duration for trial in trials) / _HOUR,
        time=time,
    )


def _thruster_scales(trials: Sequence[Trial], vehicle: Vehicle) -> tuple[float, float, float]:
    """RMS wash in N^0.5 m^2, RMS of the root of the thrust in N^0.5, and the largest load as a share of full thrust."""
    thrusts = [vehicle.thrust(trial.commands) for trial in trials]
    washes = [actuator_inputs(vehicle, trial).wash(thrust) for trial, thrust in zip(trials, thrusts, strict=True)]
    wash, sqrt_thrust = rms_nonzero(np.concatenate(washes)), rms_nonzero(np.sqrt(np.abs(np.concatenate(thrusts))))
    full_thrust = sum(thruster.full_thrust for thruster in vehicle.thrusters)
    loads = [np.abs(thrust).sum(axis=1) for thrust in thrusts]
    largest = max([0.0, *(float(load.max(initial=0.0)) for load in loads)])
    return wash, sqrt_thrust, largest / full_thrust or 1.0


def _rms_speed(trials: Sequence[Trial], name: str) -> float:
    """RMS of a logged speed, m/s; 1 where it is not logged."""
    logged = np.concatenate([trial.extras.get(name, np.zeros(0)) for trial in trials])
    known = logged[np.isfinite(logged)]
    if not known.any():
        return 1.0
    return float(np.sqrt(np.mean(known**2)))
