"""The data that an objective evaluates: runs, RMS values, and scales of the parameters.

`InputCache` holds the torque inputs of all runs, with the resolved commands cached between models.
"""

import math
from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import ClassVar, NamedTuple, Self
from weakref import ref

import numpy as np

from rovid.core.array_types import BoolArray, FloatArray, IntArray
from rovid.core.threads import SizedCache
from rovid.effects.actuator_inputs import SPEEDS, actuator_inputs, neutral_commands
from rovid.effects.base import HOUR, Scales
from rovid.model.actuator_model import CommandSeries
from rovid.model.model import Model
from rovid.model.ode import with_past
from rovid.model.simulation import fit_measures, simulated_rate
from rovid.model.torque_input import MAX_SUBDIVISION, Intervals, TorqueInput
from rovid.trial.axis import Axis
from rovid.trial.preprocessing import Run
from rovid.trial.trial import Trial
from rovid.trial.vehicle import Vehicle

# Largest error of an angle from averaging the torque over an interval, as a share of the position noise.
_MAX_ANGLE_ERROR = 0.1
# Resolved commands of all input caches. Those of logs of hours take more than there is room for.
_COMMANDS = SizedCache(96_000_000, evict_randomly=True)
# Shortest transient after a change of a command that is resolved finely, in steps, and the factor between the
# transients that are distinguished. Few distinct transients let models share commands.
_LEAST_TRANSIENT, _TRANSIENT_FACTOR = 5.0, 4.0


class _StepCommands(NamedTuple):
    """Commands of all runs, and the intervals between steps; None for those between the commands' own instants."""

    commands: CommandSeries
    between: Intervals | None

    @property
    def nbytes(self) -> int:
        """Bytes, approximately."""
        return self.commands.nbytes + (0 if self.between is None else self.between.nbytes)


@dataclass(frozen=True, eq=False)
class InputCache:
    """Torque inputs of some runs."""

    runs: Sequence[Run]
    vehicle: Vehicle | None  #: None where no effect may act between command and torque.
    inertia: float  #: Approximate inertia, kg m^2.
    position_noise: float  #: Standard deviation of the measured position.
    steps: list[IntArray] | None  #: For each run, the (n,) sample numbers of the steps; None for all samples.
    #: Whether only mean torques are needed, see `chosen_rows`; else the torque from each step to the next and its
    #: timing within.
    means_only: bool = False
    parent: Self | None = None  #: The cache of all runs, where this is a subset; it decides on the resolution.
    #: Count of values of a torque input that is shorter than the log -> the samples of each run behind it.
    chosen_rows: dict[int, list[IntArray]] = field(default_factory=dict, init=False, repr=False)

    def subset(self, place: slice) -> Self:
        """The inputs of some of the runs."""
        return self.of(self.runs[place], None if self.steps is None else self.steps[place])

    def of(self, runs: Sequence[Run], steps: list[IntArray] | None) -> Self:
        """The inputs of other ``runs`` at these ``steps``, at the same resolution."""
        return replace(self, runs=runs, steps=steps, parent=self.parent or self)

    def at_samples(self, model: Model) -> Iterator[TorqueInput]:
        """Torque input of each run at all samples of its log."""
        for run in self.runs:
            if self.vehicle is None or model.actuators.is_plain:
                yield TorqueInput.held(run.torque)
            else:
                yield model.torque_input(self.vehicle, run.trial)

    def between_steps(self, model: Model) -> TorqueInput:
        """Torque input of all runs, from each step to the next."""
        if self.vehicle is None or model.actuators.is_plain:
            return self._plain
        return model.actuators.torque_inputs(*self._commands(self.vehicle, model))

    def _commands(self, vehicle: Vehicle, model: Model) -> _StepCommands:
        """Commands at the resolution that ``model`` needs."""
        actuators, root = model.actuators, self.parent or self
        parts = 1 if self.means_only and actuators.has_exact_means else min(root.parts, actuators.subdivision)
        transient = root.transient_seconds(actuators.settling_time(root.largest_change))
        return _COMMANDS.get_or_make((ref(self), parts, transient), lambda: self._resolve(vehicle, parts, transient))

    @cached_property
    def _plain(self) -> TorqueInput:
        """Torque input by the bench curves."""
        torques = [run.torque for run in self.runs]
        held = np.concatenate(torques)
        if self.steps is None or self.means_only:
            return TorqueInput.held(held, offsets=np.cumsum([0, *map(len, torques)]))
        return TorqueInput.averaged_over(Intervals.from_times([run.trial.time for run in self.runs], self.steps), held)

    def _resolve(self, vehicle: Vehicle, parts: int, transient: float) -> _StepCommands:
        """Commands with intervals cut into ``parts`` for ``transient`` s after each change."""
        fresh, steps = [_is_transient(run.trial, transient) for run in self.runs], self.steps
        rows, cut = self._needed_rows(fresh), fresh
        if rows is not None:
            cut = [here[chosen] for here, chosen in zip(fresh, rows, strict=True)]
            if self.means_only:
                self.chosen_rows[sum(map(len, rows))] = rows
            if steps is not None:
                steps = [np.searchsorted(here, step) for here, step in zip(rows, steps, strict=True)]
        trials = [run.trial for run in self.runs]
        commands = CommandSeries.from_trials(vehicle, trials, parts, rows, cut if parts > 1 else None)
        return _StepCommands(commands, None if steps is None or self.means_only else commands.intervals_between(steps))

    def _needed_rows(self, fresh: Sequence[BoolArray]) -> list[IntArray] | None:
        """For each run, the samples at its ends, at its steps and in a transient; None for all samples."""
        if self.steps is None:
            return None
        rows = []
        for here, steps in zip(fresh, self.steps, strict=True):
            needed = here.copy()
            needed[[0, -1]] = needed[steps] = True
            rows.append(np.flatnonzero(needed))
        return None if sum(map(len, rows)) == sum(map(len, fresh)) else rows

    def transient_seconds(self, settling_time: float) -> float:
        """Time in s after a change of commands that is resolved finely: the ``settling_time`` or longer."""
        least = _LEAST_TRANSIENT * self._step_seconds
        if settling_time <= least:
            return least
        if math.isinf(settling_time):
            return settling_time
        return least * _TRANSIENT_FACTOR ** math.ceil(math.log(settling_time / least, _TRANSIENT_FACTOR))

    @cached_property
    def _step_seconds(self) -> float:
        """Median interval between steps, s."""
        if self.steps is None:
            return float(np.median([run.trial.sampling_interval for run in self.runs]))
        each = [np.diff(run.trial.time[at]) for run, at in zip(self.runs, self.steps, strict=True)]
        return float(np.median(np.concatenate(each)))

    @cached_property
    def largest_change(self) -> float:
        """Largest possible change of a command."""
        commands = [run.trial.orders for run in self.runs]
        return max(float(np.max(np.ptp(here, axis=0), initial=0.0)) for here in commands)

    @cached_property
    def parts(self) -> int:
        """Parts per sampling interval that keep the angle's error from averaging the torque below the noise."""
        period = float(np.median([run.trial.sampling_interval for run in self.runs]))
        largest = max(float(np.max(np.abs(run.torque))) for run in self.runs)
        # Distance in the middle between a parabola over the interval and its chord.
        error = largest / self.inertia * period**2 / 8.0
        parts = math.ceil(math.sqrt(error / (_MAX_ANGLE_ERROR * self.position_noise)))
        return int(np.clip(parts, 1, MAX_SUBDIVISION))


def _is_transient(trial: Trial, seconds: float) -> BoolArray:
    """(n,) whether each sample of ``trial`` is at most so many ``seconds`` after a change of a command."""
    count = len(trial.time)
    changed = np.concatenate(([trial.past is not None], (np.diff(trial.commands, axis=0) != 0.0).any(axis=1)))
    latest = np.maximum.accumulate(np.where(changed, np.arange(count), -1))
    return np.asarray((latest >= 0) & (trial.time - trial.time[latest] <= seconds))


# Least standard deviation of the measurement noise, over `FitData.reading_scale`. The output of an autopilot's filter
# would claim less.
NOISE_FLOOR = 1e-5
# Least RMS value, because scales are divided by.
_LEAST_RMS = 1e-150
# s, longest time constant that lengths are derived from: longer than any log. Of a fit that ran off, no length follows.
_LONGEST_CONSTANT = 1e6


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
        return np.repeat(np.arange(len(self.runs)), [len(begin) for begin, _ in self.innovation_spans])

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
        return _rms_torque(self.runs, self.initial_model)

    @cached_property
    def drag_scale(self) -> FloatArray:
        """(2,) quadratic and linear drag; each value alone gives the total drag at the RMS rate."""
        drag = self.initial_model.quadratic_drag * self.rms_rate + self.initial_model.linear_drag
        return np.array([drag / self.rms_rate, drag])

    @cached_property
    def scales(self) -> Scales:
        """Scales of the effects' parameters."""
        return usual_scales(self.runs, self.vehicle, self.initial_model)

    @cached_property
    def usual_time(self) -> float:
        """Time constant of the vehicle in s, between the sampling interval and the length of the longest run.

        The unit of all times of a fit, such as bounds and initial values.
        """
        return _usual_time(self.runs, self.initial_model)

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
        return max(float(np.median([run.rates.position_noise for run in self.runs])), NOISE_FLOOR * self.reading_scale)

    @cached_property
    def driven_runs(self) -> Sequence[Run]:
        """The runs with the commands before their first sample, see `rovid.model.ode`."""
        vehicle, body = self.vehicle, self.initial_model.body
        if vehicle is None:
            return self.runs
        return [replace(run, trial=with_past(run.trial, body, vehicle)) for run in self.runs]

    @cached_property
    def inputs(self) -> InputCache:
        """Torque inputs of all runs."""
        return InputCache(
            self.driven_runs, self.vehicle, self.initial_model.inertia, self.position_noise, self.steps, self.means_only
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


def _rms_torque(runs: Sequence[Run], model: Model) -> float:
    if runs[0].trial.has_actuators:
        return rms_nonzero(np.concatenate([run.torque for run in runs]))
    tilt = np.concatenate([run.trial.position[run.trial.measured] for run in runs])
    return rms_nonzero(np.asarray(model.stiffness * np.sin(tilt - model.restoring_values[1])))


def _usual_time(runs: Sequence[Run], model: Model) -> float:
    shortest, longest = min(run.trial.sampling_interval for run in runs), max(run.trial.duration for run in runs)
    return min(max(time_constant(model, rms_rate(runs)), shortest), longest)


def time_constant(model: Model, rate: float) -> float:
    """Time constant in s of the decay of a motion at ``rate``, or a third of the natural period where that is less."""
    slope = 2.0 * model.quadratic_drag * rate + model.linear_drag
    constant = min(model.inertia / max(slope, _LEAST_RMS), _LONGEST_CONSTANT)
    if model.natural_frequency > 0.0:
        return min(constant, 2.0 / model.natural_frequency)
    return constant


def usual_scales(runs: Sequence[Run], vehicle: Vehicle | None, model: Model) -> Scales:
    """Scales of the effects' parameters for ``runs`` with the plain ``model``."""
    trials = [run.trial for run in runs]
    return effect_scales(trials, vehicle, _rms_torque(runs, model), rms_rate(runs), _usual_time(runs, model))


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
    largest_commands = [np.max(np.abs(trial.orders - neutral), initial=0.0) for trial in trials]
    return Scales(
        command=float(max(largest_commands)),
        torque=torque,
        rate=rate,
        wash=wash,
        sqrt_thrust=sqrt_thrust,
        surge=_rms_speed(trials, SPEEDS[0]),
        sway=_rms_speed(trials, SPEEDS[1]),
        load=load,
        longest=max(trial.log_time + trial.duration for trial in trials) / HOUR,
        day=max(trial.campaign_time + trial.duration for trial in trials) / HOUR,
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
    return float(np.sqrt(np.mean(known**2))) if known.any() else 1.0
