"""Trials as the effects between command and torque see them."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from typing import NamedTuple, Self, TypeVar

import numpy as np

from rovid.core.array_types import BoolArray, FloatArray, IntArray
from rovid.trial.trial import Trial
from rovid.trial.vehicle import ThrustCurve, Thruster, Vehicle

Series = TypeVar("Series", FloatArray, FloatArray | None)
# Channels with the speed ahead and to starboard in m/s.
SPEEDS = ("surge_velocity", "sway_velocity")
# Reference thrust as a share of the largest bench thrust. In yaw trials thrust is rarely much larger. A change of the
# curve's shape with a reference far from the thrust in use would act like a scale of all thrust, inertia and drag.
_REFERENCE_SHARE = 0.1


@dataclass(frozen=True, eq=False)
class SampleSelection:
    """Some of the n instants of a log, with means over the intervals between them."""

    at: IntArray  #: (m,) indices of the instants, with the first and the last of the log among them.
    length: FloatArray  #: (n,) s from each instant of the log to the next, 0 from the last.

    @classmethod
    def of(cls, time: FloatArray, at: IntArray) -> Self:
        """Select the instants ``at`` of a log's (n,) instants in s."""
        return cls(at, np.diff(time, append=time[-1]))

    def means(self, held: FloatArray) -> FloatArray:
        """(m,) means of (n,) held values, NaN left out; NaN if there is no other value."""
        known = np.isfinite(held)
        area = np.add.reduceat(np.where(known, held, 0.0) * self.length, self.at)
        span = np.add.reduceat(known * self.length, self.at)
        return np.where(span > 0.0, area / np.where(span > 0.0, span, 1.0), held[self.at])


class TrialRows(NamedTuple):
    """One among concatenated trials."""

    name: str = ""
    parent: str = ""  #: Name of the whole trial, if this is a part cut from one; otherwise the same as ``name``.
    start_offset: float = 0.0  #: s from the start of the campaign's first trial.
    rows: slice = slice(None)  #: Indices of its instants.
    selection: SampleSelection | None = None  #: Selected instants of its log; None for all.
    subdivided: BoolArray | None = None  #: (m,) which of the intervals after these are subdivided; None for all.
    past: int = 0  #: Number of instants before the log begins, among these.
    log_offset: float = 0.0  #: s from the start of its log.

    def held_means(self, values: FloatArray) -> FloatArray:
        """(past + m,) of (n,) held values: the first one, and means over the intervals between selected instants."""
        return self.with_past(values if self.selection is None else self.selection.means(values))

    def with_past(self, values: FloatArray) -> FloatArray:
        """(past + m,) ``values``, with the first of these (m,) held before."""
        return np.concatenate((np.full(self.past, values[0]), values)) if self.past else values


@dataclass(frozen=True, kw_only=True, eq=False)
class ActuatorInputs:
    """One trial or several concatenated ones, with k actuators."""

    time: FloatArray  #: (n,) s from the start of each trial.
    neutral: FloatArray  #: (k,) command without thrust.
    arms: FloatArray  #: (k,) yaw arm.
    #: (k,) N; largest thrust of the bench curve, or largest torque or force of a campaign that logs it.
    full_thrust: FloatArray
    names: tuple[str, ...]  #: (k,) names of the thrusters.
    forward_share: FloatArray  #: (k,) share of the thrust that drives the vehicle ahead; 0 if unknown.
    command_range: FloatArray  #: (k, 2) smallest and largest command of the bench curve.
    #: (k, 2) commands between which the bench curve gives no thrust; both ``neutral`` if there is no such zone.
    dead_zone: FloatArray
    extras: Mapping[str, FloatArray]  #: Further channels of the logs, each (n,), held; NaN in a trial without.
    reference: Mapping[str, float] = field(default_factory=dict)  #: Median of each further channel in the campaign.
    trials: tuple[TrialRows, ...] = (TrialRows(),)  #: The trials.
    subdivision: int = 1  #: Number of parts of each subdivided interval between two log instants.
    _speeds: dict[str, FloatArray] = field(default_factory=dict, init=False, repr=False)

    @classmethod
    def concatenated(cls, each: Sequence[Self]) -> Self:
        """Concatenate trials of one vehicle."""
        trials, at = [], 0
        for one in each:
            trials.append(one.trials[0]._replace(rows=slice(at, at + len(one.time))))
            at += len(one.time)
        extras = {}
        for name in dict.fromkeys(name for one in each for name in one.extras):
            extras[name] = np.concatenate([one.extras.get(name, np.full(len(one.time), np.nan)) for one in each])
        time = np.concatenate([one.time for one in each])
        return replace(each[0], time=time, extras=extras, trials=tuple(trials))

    def apply_per_trial(self, function: Callable[..., FloatArray], series: FloatArray, *numbers: float) -> FloatArray:
        """``function(time, values, *numbers)`` of each trial, and of each column of an (n, k) ``series``.

        Functions that depend on earlier or later values go through here, so that trials stay independent.
        """
        if series.ndim > 1:
            columns = np.ascontiguousarray(series.T)
            return np.array([self.apply_per_trial(function, column, *numbers) for column in columns]).T
        return np.concatenate([function(self.time[one.rows], series[one.rows], *numbers) for one in self.trials])

    def weighted_sum(self, thrust: FloatArray, weights: FloatArray) -> FloatArray:
        """(n,) sum of (n, k) thrust times (k,) or (n, k) weights."""
        products = (column * weight for column, weight in zip(thrust.T, weights.T, strict=True))
        return np.asarray(sum(products, start=np.zeros(len(thrust))))

    @cached_property
    def offsets(self) -> IntArray:
        """(t + 1,) index of each trial's first instant, and n."""
        return np.cumsum([0, *(len(self.time[one.rows]) for one in self.trials)])

    def without_past(self, series: Series) -> Series:
        """The rows of an (n, ...) ``series`` that are not before a log begins; None for None."""
        if series is None or not any(one.past for one in self.trials):
            return series
        return np.concatenate([series[one.rows][one.past :] for one in self.trials])

    @cached_property
    def logged_offsets(self) -> IntArray:
        """(t + 1,) `offsets` among the instants that are not before the log begins."""
        return np.asarray(self.offsets - np.cumsum([0, *(one.past for one in self.trials)]))

    @cached_property
    def intervals(self) -> FloatArray:
        """(n,) s from each instant to the next of its trial, 0 from the last."""
        times = [self.time[one.rows] for one in self.trials]
        return np.concatenate([np.diff(time, append=time[-1]) for time in times])

    @cached_property
    def log_time(self) -> FloatArray:
        """(n,) s from the start of each trial's log, of which the trial may be a part."""
        return np.concatenate([one.log_offset + self.time[one.rows] for one in self.trials])

    @cached_property
    def campaign_time(self) -> FloatArray:
        """(n,) s from the start of the campaign's first trial."""
        return np.concatenate([one.start_offset + self.time[one.rows] for one in self.trials])

    def share_after(self, instant: float) -> FloatArray:
        """(n,) share of the interval from each instant to the next that is later than ``instant``, in `campaign_time`.

        The loops end at the last instant of a trial.
        """
        length = np.where(self.intervals > 0.0, self.intervals, 1.0)
        return np.clip((self.campaign_time + length - instant) / length, 0.0, 1.0)

    @property
    def reference_thrust(self) -> FloatArray:
        """(k,) N; a tenth of full thrust, at which all forms of the thrust curve agree with the bench."""
        return _REFERENCE_SHARE * self.full_thrust

    def speed(self, name: str) -> FloatArray:
        """(n,) m/s, mean until the next instant of a channel in `SPEEDS`; the campaign's median if it is not logged."""
        if name not in self._speeds:
            logged = self.extras.get(name, np.full(len(self.time), np.nan))
            self._speeds[name] = self.apply_per_trial(_mean_speed, logged, self.reference.get(name, 0.0))
        return self._speeds[name]

    def wash(self, thrust: FloatArray) -> FloatArray:
        """(n,) N^0.5 m^2; sum of sqrt(thrust) * arm^2 for (n, k) thrust in N."""
        return self.weighted_sum(np.sqrt(np.abs(thrust)), self.arms**2)

    def from_trials(self, held: Mapping[str, FloatArray]) -> FloatArray:
        """(n,) values from those at the log instants of each trial, by its name; held between these."""
        values = np.concatenate([held[one.name] for one in self.trials])
        values = values if self._selection is None else self._selection.means(values)
        return self.subdivide(np.repeat(values, self._held_counts))

    @cached_property
    def _selection(self) -> SampleSelection | None:
        """The selected instants of all trials, one after the other; None for all instants."""
        each = [one.selection for one in self.trials if one.selection is not None]
        if not each:
            return None
        begins = np.cumsum([0, *(len(one.length) for one in each[:-1])])
        at = np.concatenate([one.at + begin for one, begin in zip(each, begins, strict=True)])
        return SampleSelection(at, np.concatenate([one.length for one in each]))

    @cached_property
    def _held_counts(self) -> IntArray:
        """(m,) for how many instants each value of the logs is held: the first of a trial also before its log."""
        counts = list[int]()
        for parts, one in zip(self.subdivisions, self.trials, strict=True):
            counts += [1 + one.past, *[1] * (len(parts) - one.past - 1)]
        return np.array(counts)

    def subdivide(self, held: FloatArray) -> FloatArray:
        """(n, ...) values from those at the selected log instants, held between these; each column in one piece."""
        if self.subdivision == 1:
            return held
        return np.repeat(held.T, np.concatenate(self.subdivisions), axis=-1).T

    @cached_property
    def subdivisions(self) -> list[IntArray]:
        """(past + m,) of each trial: number of parts of the interval after each selected log instant."""
        found = []
        for length, one in zip(np.diff(self.logged_offsets).tolist(), self.trials, strict=True):
            count = (length - 1) // self.subdivision + 1 if one.subdivided is None else len(one.subdivided)
            counts = _part_counts(count, self.subdivision, one.subdivided)
            found.append(np.concatenate((np.ones(one.past, dtype=counts.dtype), counts)))
        return found

    def excess(self, command: FloatArray) -> FloatArray:
        """(n, k) signed distance of each command from the bench's dead zone; 0 inside."""
        low, high = self.dead_zone.T
        return np.asarray(np.maximum(command - high, 0.0) + np.minimum(command - low, 0.0))

    def from_excess(self, excess: FloatArray) -> FloatArray:
        """(n, k) commands with this signed distance from the dead zone; neutral for 0."""
        low, high = self.dead_zone.T
        return np.where(excess > 0.0, high + excess, np.where(excess < 0.0, low + excess, self.neutral))


def _part_counts(count: int, subdivision: int, subdivided: BoolArray | None) -> IntArray:
    """(n,) number of parts of each interval; the last instant begins none."""
    counts = np.full(count, subdivision) if subdivided is None else np.where(subdivided, subdivision, 1)
    counts[-1:] = 1
    return counts


def interpolate_gaps(values: FloatArray) -> FloatArray:
    """(n,) ``values`` with linear interpolation in place of NaN; zeros if all are NaN."""
    known = np.flatnonzero(np.isfinite(values))
    if known.size == len(values):
        return values
    return np.interp(np.arange(len(values)), known, values[known]) if known.size else np.zeros(len(values))


def _mean_speed(_: FloatArray, logged: FloatArray, default: float) -> FloatArray:
    """(n,) mean of the ``logged`` speed until the next instant; ``default`` if nothing is logged."""
    if not np.isfinite(logged).any():
        return np.full(len(logged), default)
    known = interpolate_gaps(logged)
    return np.asarray(0.5 * (known + np.append(known[1:], known[-1])))


def actuator_inputs(
    vehicle: Vehicle,
    trial: Trial,
    subdivision: int = 1,
    at: IntArray | None = None,
    subdivided: BoolArray | None = None,
) -> ActuatorInputs:
    """Inputs of the effects between command and torque for one trial.

    ``subdivision``: Number of parts of each interval between two instants.
    ``at``: Selected instants; all if None.
    ``subdivided``: Which of the intervals after these are subdivided; all if None.
    """
    selection = None if at is None else SampleSelection.of(trial.time, at)
    time = trial.time if at is None else trial.time[at]
    counts = _part_counts(len(time), subdivision, subdivided)
    name, past = trial.parent or trial.name, np.zeros(0) if trial.past is None else trial.past.time
    rows = TrialRows(
        trial.name,
        name,
        trial.campaign_time,
        selection=selection,
        subdivided=subdivided,
        past=len(past),
        log_offset=trial.log_time,
    )
    if len(past):
        counts = np.concatenate((np.ones(len(past), dtype=counts.dtype), counts))
        time = np.concatenate((past, time))
    extras = {}
    for channel, values in trial.channels.items():
        # Between two instants a speed is interpolated later. Other channels are held.
        is_speed = at is not None and channel in SPEEDS
        chosen = rows.with_past(values[at]) if is_speed else rows.held_means(values)
        extras[channel] = np.repeat(chosen, counts)
    if subdivision > 1:
        first = np.repeat(np.cumsum(counts) - counts, counts)
        part = (np.arange(len(first)) - first) / np.repeat(counts, counts)
        time = np.repeat(time, counts) + part * np.repeat(np.diff(time, append=time[-1]), counts)
    return replace(
        _vehicle_inputs(vehicle),
        time=time,
        extras=extras,
        reference=trial.reference,
        trials=(rows,),
        subdivision=subdivision,
    )


@lru_cache(maxsize=4)
def _vehicle_inputs(vehicle: Vehicle) -> ActuatorInputs:
    """Inputs that are the same in all trials of ``vehicle``."""
    return ActuatorInputs(
        time=np.zeros(0),
        names=tuple(thruster.name for thruster in vehicle.thrusters),
        forward_share=vehicle.surge_shares,
        command_range=np.array(list(map(_command_range, vehicle.thrusters))),
        dead_zone=np.array([_dead_zone(thruster.curve) for thruster in vehicle.thrusters]),
        extras={},
        neutral=neutral_commands(vehicle),
        arms=np.array([thruster.arm for thruster in vehicle.thrusters]),
        full_thrust=np.array([thruster.full_thrust for thruster in vehicle.thrusters]),
    )


def neutral_commands(vehicle: Vehicle) -> FloatArray:
    """(k,) commands without thrust: the middle of the bench curve's zeros, or its zero crossing."""
    return np.array([0.0 if t.curve is None else sum(_dead_zone(t.curve)) / 2.0 for t in vehicle.thrusters])


def _command_range(thruster: Thruster) -> tuple[float, float]:
    if thruster.curve is None:
        return -thruster.max_logged_torque, thruster.max_logged_torque
    return float(thruster.curve.command[0]), float(thruster.curve.command[-1])


def _dead_zone(curve: ThrustCurve | None) -> tuple[float, float]:
    if curve is None:
        return 0.0, 0.0
    zeros = curve.command[curve.thrust == 0.0]
    if zeros.size:
        return float(zeros[0]), float(zeros[-1])
    rising = np.argsort(curve.thrust, kind="stable")
    crossing = float(np.interp(0.0, curve.thrust[rising], curve.command[rising]))
    return crossing, crossing
