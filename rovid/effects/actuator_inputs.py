"""Trials on the way from command to torque: what the effects that act there are told."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from typing import NamedTuple, Self

import numpy as np

from rovid.core.array_types import BoolArray, FloatArray, IntArray
from rovid.trial.trial import Trial
from rovid.trial.vehicle import ThrustCurve, Thruster, Vehicle

# Channels of the log that say how fast the vehicle goes ahead and to starboard, m/s.
SPEEDS = ("surge_velocity", "sway_velocity")
# Of the bench's largest thrust; the same for thrust. Trials seldom use much more in yaw, and away from the thrust in
# use a change of shape would be one of scale, which inertia and drag would have to follow.
_REFERENCE_SHARE = 0.1


@dataclass(frozen=True, eq=False)
class SampleSelection:
    """Some of the n instants of a log, and the means from each of them to the next of what is held between all.

    Attributes
    ----------
    at
        (m,) which they are; the first and the last of the log are among them.
    length
        (n,) s from each instant of the log to the next, 0 from the last.
    """

    at: IntArray
    length: FloatArray

    @classmethod
    def of(cls, time: FloatArray, at: IntArray) -> Self:
        """``at`` of a log's (n,) instants in s."""
        return cls(at, np.diff(time, append=time[-1]))

    def means(self, held: FloatArray) -> FloatArray:
        """(m,) of (n,) values; of those that are known, NaN where none is."""
        known = np.isfinite(held)
        area = np.add.reduceat(np.where(known, held, 0.0) * self.length, self.at)
        span = np.add.reduceat(known * self.length, self.at)
        return np.where(span > 0.0, area / np.where(span > 0.0, span, 1.0), held[self.at])


class TrialRows(NamedTuple):
    """One of the trials that stand one after the other.

    ``whole`` is the name of the trial that it is a part of, its own where it is none; ``since`` is in s from the
    beginning of the campaign's first trial to that of this one. ``rows`` are its instants: those of its log that were
    ``chosen``, all where that is None. ``cut`` is (m,) which of the intervals from these on are cut into parts, all
    where that is None.
    """

    name: str = ""
    parent: str = ""
    start_offset: float = 0.0
    rows: slice = slice(None)
    selection: SampleSelection | None = None
    subdivided: BoolArray | None = None

    def held_means(self, values: FloatArray) -> FloatArray:
        """(m,) of (n,) values that are held between the log's instants, means where not all of these were chosen."""
        return values if self.selection is None else self.selection.means(values)


@dataclass(frozen=True, kw_only=True, eq=False)
class ActuatorInputs:
    """One trial, or several one after the other, on the way from command to torque.

    Attributes
    ----------
    time
        (n,) s, from the beginning of each trial.
    neutral
        (k,) command of no thrust of each actuator.
    arms
        (k,) yaw arm of each actuator.
    full_thrust
        (k,) N; largest thrust of each actuator's bench curve, or largest torque or force of a campaign that logs it.
    names
        (k,) of the thrusters.
    ahead
        (k,) share of each thrust that drives the vehicle ahead; 0 where that is not known.
    ends
        (k, 2) the least and the largest command of the bench curve.
    dead_zone
        (k, 2) commands between which the bench curve gives no thrust; both ``neutral`` where there is no such zone.
    extras
        Further channels of the log, (n,), held; NaN in a trial without.
    reference
        The median of each further channel over the whole campaign.
    trials
        Which they are.
    parts
        How many each interval between two of the log's instants is cut into, of those that are.
    """

    time: FloatArray
    neutral: FloatArray
    arms: FloatArray
    full_thrust: FloatArray
    names: tuple[str, ...]
    forward_share: FloatArray
    command_range: FloatArray
    dead_zone: FloatArray
    extras: Mapping[str, FloatArray]
    reference: Mapping[str, float] = field(default_factory=dict)
    trials: tuple[TrialRows, ...] = (TrialRows(),)
    subdivision: int = 1
    _speeds: dict[str, FloatArray] = field(default_factory=dict, init=False, repr=False)
    # By the identity of what it is of, which is kept too, so that nothing else has it.
    _of_trials: dict[int, tuple[object, FloatArray]] = field(default_factory=dict, init=False, repr=False)

    @classmethod
    def concatenated(cls, each: Sequence[Self]) -> Self:
        """Of several trials of one vehicle, one after the other."""
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
        """``function(time, values, *numbers)`` of each trial by itself, in (n, k) ``series`` of each column too.

        That is for what depends on the values before, or on the next: no trial remembers the one before it.
        """
        if series.ndim > 1:
            columns = np.ascontiguousarray(series.T)
            return np.column_stack([self.apply_per_trial(function, column, *numbers) for column in columns])
        return np.concatenate([function(self.time[one.rows], series[one.rows], *numbers) for one in self.trials])

    def weighted_sum(self, thrust: FloatArray, shares: FloatArray) -> FloatArray:
        """(n,) sum over the thrusters of their (n, k) thrust times their (k,) share in it."""
        # Of all rows at once BLAS would take every core, for next to nothing.
        return np.concatenate([thrust[one.rows] @ shares for one in self.trials])

    @cached_property
    def offsets(self) -> IntArray:
        """(t + 1,) the instant with which each of t trials begins, and how many there are in all."""
        return np.cumsum([0, *(len(self.time[one.rows]) for one in self.trials)])

    @cached_property
    def intervals(self) -> FloatArray:
        """(n,) s from each instant to the next of its trial, 0 from the last."""
        times = [self.time[one.rows] for one in self.trials]
        return np.concatenate([np.diff(time, append=time[-1]) for time in times])

    @cached_property
    def campaign_time(self) -> FloatArray:
        """(n,) s from the beginning of the campaign's first trial."""
        return np.concatenate([one.start_offset + self.time[one.rows] for one in self.trials])

    @property
    def reference_thrust(self) -> FloatArray:
        """(k,) N; a tenth of the full thrust, at which forms of the thrust curve agree with the bench."""
        return _REFERENCE_SHARE * self.full_thrust

    def speed(self, name: str) -> FloatArray:
        """(n,) m/s, the mean until the next instant of one of `SPEEDS`; that of the campaign where it is not logged."""
        if name not in self._speeds:
            logged = self.extras.get(name, np.full(len(self.time), np.nan))
            self._speeds[name] = self.apply_per_trial(_mean_speed, logged, self.reference.get(name, 0.0))
        return self._speeds[name]

    def wash(self, thrust: FloatArray) -> FloatArray:
        """(n,) N^0.5 m^2; sum over the thrusters of the root of their (n, k) thrust in N times their arm squared."""
        return self.weighted_sum(np.sqrt(np.abs(thrust)), self.arms**2)

    def from_trials(self, held: Mapping[str, FloatArray]) -> FloatArray:
        """(n,) values that are held between the instants of each trial's log, which are told by its name."""
        if id(held) not in self._of_trials:
            series = np.concatenate([one.held_means(held[one.name]) for one in self.trials])
            self._of_trials[id(held)] = held, self.subdivide(series)
        return self._of_trials[id(held)][1]

    def subdivide(self, held: FloatArray) -> FloatArray:
        """(n, ...) of values that are held between the chosen instants, with each interval cut into ``parts``."""
        if self.subdivision == 1:
            return held
        return np.repeat(held, np.concatenate(self.subdivisions), axis=0)

    @cached_property
    def subdivisions(self) -> list[IntArray]:
        """(m,) of each trial, into how many the interval from each of the chosen instants to the next is cut."""
        lengths = np.diff(self.offsets).tolist()
        return [
            _counts(
                (length - 1) // self.subdivision + 1 if one.subdivided is None else len(one.subdivided),
                self.subdivision,
                one.subdivided,
            )
            for length, one in zip(lengths, self.trials, strict=True)
        ]

    def excess(self, command: FloatArray) -> FloatArray:
        """(n, k) how far each command is beyond the bench's dead zone, with its sign; 0 inside."""
        low, high = self.dead_zone.T
        return np.asarray(np.maximum(command - high, 0.0) + np.minimum(command - low, 0.0))

    def from_excess(self, excess: FloatArray) -> FloatArray:
        """(n, k) commands that are so far beyond the dead zone; neutral where that is 0."""
        low, high = self.dead_zone.T
        return np.where(excess > 0.0, high + excess, np.where(excess < 0.0, low + excess, self.neutral))


def _counts(count: int, parts: int, cut: BoolArray | None) -> IntArray:
    """(n,) into how many each of the intervals is cut; the last instant has none."""
    counts = np.full(count, parts) if cut is None else np.where(cut, parts, 1)
    counts[-1:] = 1
    return counts


def interpolate_gaps(values: FloatArray) -> FloatArray:
    """(n,) ``values`` with straight lines through their gaps; zeros where none is known."""
    known = np.flatnonzero(np.isfinite(values))
    if known.size == len(values):
        return values
    return np.interp(np.arange(len(values)), known, values[known]) if known.size else np.zeros(len(values))


def _mean_speed(_: FloatArray, logged: FloatArray, usual: float) -> FloatArray:
    """(n,) mean until the next instant of what is ``logged``; ``usual`` where nothing is."""
    if not np.isfinite(logged).any():
        return np.full(len(logged), usual)
    known = interpolate_gaps(logged)
    return np.asarray(0.5 * (known + np.append(known[1:], known[-1])))


def _instants(time: FloatArray, counts: IntArray) -> FloatArray:
    first = np.repeat(np.cumsum(counts) - counts, counts)
    part = (np.arange(len(first)) - first) / np.repeat(counts, counts)
    return np.asarray(np.repeat(time, counts) + part * np.repeat(np.diff(time, append=time[-1]), counts))


def actuator_inputs(
    vehicle: Vehicle, trial: Trial, parts: int = 1, at: IntArray | None = None, cut: BoolArray | None = None
) -> ActuatorInputs:
    """What the effects between command and torque need to know of ``vehicle`` and ``trial``.

    ``parts`` is how many each interval between two instants is cut into, those ``at`` alone where it is not None, and
    no other intervals than those ``cut``, where that is not None.
    """
    chosen = None if at is None else SampleSelection.of(trial.time, at)
    time = trial.time if at is None else trial.time[at]
    counts = _counts(len(time), parts, cut)
    stretch = TrialRows(trial.name, trial.parent or trial.name, trial.campaign_time, selection=chosen, subdivided=cut)
    return replace(
        _of_vehicle(vehicle),
        time=time if parts == 1 else _instants(time, counts),
        # Between two instants a speed is what is between its readings there, and any other channel is held.
        extras={
            name: np.repeat(values[at] if at is not None and name in SPEEDS else stretch.held_means(values), counts)
            for name, values in trial.extras.items()
        },
        reference=trial.reference,
        trials=(stretch,),
        subdivision=parts,
    )


@lru_cache(maxsize=4)
def _of_vehicle(vehicle: Vehicle) -> ActuatorInputs:
    """What is told of ``vehicle``, whatever the trial; asked for by every one."""
    return ActuatorInputs(
        time=np.zeros(0),
        names=tuple(thruster.name for thruster in vehicle.thrusters),
        forward_share=vehicle.surge_shares,
        command_range=np.array([_ends(thruster) for thruster in vehicle.thrusters]),
        dead_zone=np.array([_dead_zone(thruster.curve) for thruster in vehicle.thrusters]),
        extras={},
        neutral=neutral_commands(vehicle),
        arms=np.array([thruster.arm for thruster in vehicle.thrusters]),
        full_thrust=np.array([thruster.full_thrust for thruster in vehicle.thrusters]),
    )


def neutral_commands(vehicle: Vehicle) -> FloatArray:
    """(k,) the command of no thrust: the middle of the bench curve's zeros, or where it crosses zero."""
    return np.array([0.0 if t.curve is None else sum(_dead_zone(t.curve)) / 2.0 for t in vehicle.thrusters])


def _ends(thruster: Thruster) -> tuple[float, float]:
    """Lowest and highest command."""
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
