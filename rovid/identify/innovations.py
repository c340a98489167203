"""The likelihood of Kalman-filter innovations, its derivatives, and how to climb it."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Self

import numpy as np

from rovid.campaign.axis import Axis
from rovid.campaign.vehicle import PLAUSIBLE_RATIO, Vehicle
from rovid.effects import Effect, restoring_of
from rovid.effects.base import SPEEDS, Actuation, Scales, actuation, neutral_commands, race
from rovid.ground.arrays import BoolArray, FloatArray, IntArray
from rovid.ground.workers import spread
from rovid.model.model import MOST_PARTS, Drive, Model
from rovid.motion.rates import body_position
from rovid.motion.runs import Run

# Coordinates before those of effects and of what weight and buoyancy do: log I, DQ and DL over their scale, log of
# the disturbance's size and memory, log of the measurement's noise.
BASE = 6
DISTURBANCE, MEMORY, NOISE = 3, 4, 5
_RATE_ERROR = 0.2  # of the rate's root mean square: how well the first rate of a trial is known
_ANGLE_NOISE_FLOOR = 1e-5  # rad; no heading is better, and one from an autopilot's filter would claim to be
_RATE_NOISE_FLOOR = 1e-5  # rad/s; likewise
_HOUR = 3600.0
_BLOCK_SECONDS, _BLOCKS = 40.0, 12
# Share of the position's noise.
_LOST = 0.1
# Innovations beyond so many standard deviations count in proportion, not squared (Huber 1964).
_OUTLIER = 5.0
_FARTHEST = 1e100
# Step for slopes of the logarithms and scaled drags.
_STEP = 1e-5
# No step changes a logarithm by more: far from the top the slopes promise too much.
_LONGEST = 1.0
_LOGARITHMS = [0, DISTURBANCE, MEMORY, NOISE]
_WORST = 1e12
# Sizes of the disturbance, of the torque in use, and memories in s, to begin with.
_SHARES, _MEMORIES = (0.01, 0.1, 1.0), (0.3, 4.0)
# Curvature of less than this share of the promised is noise of the slopes.
_LEAST_CURVATURE = 1e-3
# How many drives are kept as one climbs: where one is, and the latest two beside it.
_DRIVES = 3


@dataclass(frozen=True, eq=False)
class Records:
    """What the likelihood looks at in some runs, worked out once.

    Attributes
    ----------
    start
        A model to start from and to take scales from.
    interval
        Headings nearer to each other, in s, are passed over; 0 for none. A quick look needs no more.
    gyro
        Whether logged rates are looked at besides the positions.
    """

    runs: Sequence[Run]
    vehicle: Vehicle | None
    start: Model
    interval: float = 0.0
    gyro: bool = False

    @cached_property
    def instants(self) -> list[IntArray]:
        """Where the filter steps to in each run."""
        if self.interval <= 0.0:
            return [np.arange(len(run.trial.time)) for run in self.runs]
        return [_spaced(run.trial.time, np.flatnonzero(run.trial.measured), self.interval) for run in self.runs]

    @cached_property
    def times(self) -> list[FloatArray]:
        """(n,) s, of the instants."""
        return [run.trial.time[at] for run, at in zip(self.runs, self.instants, strict=True)]

    @cached_property
    def angles(self) -> list[FloatArray]:
        """(n,) measured position along the body's axis at the instants, rad or m.

        Where the rate alone was measured, no more than the first.
        """
        angles = [body_position(run.trial)[at] for run, at in zip(self.runs, self.instants, strict=True)]
        if self.integrated:
            return [np.where(np.arange(len(angle)) == 0, angle, np.nan) for angle in angles]
        return angles

    @property
    def integrated(self) -> bool:
        """Whether the rate alone was measured."""
        return self.runs[0].trial.integrated

    @property
    def axis(self) -> Axis:
        """The degree of freedom that is looked at."""
        return self.runs[0].trial.axis

    def drives(self, model: Model) -> list[Drive]:
        """What drives each run, at all instants of its log."""
        vehicle = self.vehicle
        if vehicle is None or not model.acts_on_drive:
            return [Drive.held(run.torque) for run in self.runs]
        return [model.drive(vehicle, run.trial) for run in self.runs]

    def drives_between(self, model: Model) -> list[Drive]:
        """What drives each run from each of the filter's instants to the next."""
        vehicle = self.vehicle
        if vehicle is None or not model.acts_on_drive:
            return self._plain
        parts = min(self._parts, model.parts)
        if parts not in self._actuations:
            self._actuations[parts] = [actuation(vehicle, run.trial, parts) for run in self.runs]
        each, thinned = zip(self.runs, self._actuations[parts], self.instants, strict=True), self.interval > 0.0
        return [model.driven(vehicle, where, run.trial.commands, at if thinned else None) for run, where, at in each]

    @cached_property
    def _actuations(self) -> dict[int, list[Actuation]]:
        """By how many parts an interval is cut into: what effects between command and torque know of each run."""
        return {}

    @cached_property
    def _plain(self) -> list[Drive]:
        drives = [Drive.held(run.torque) for run in self.runs]
        if self.interval <= 0.0:
            return drives
        return [
            drive.between(run.trial.time, at) for run, drive, at in zip(self.runs, drives, self.instants, strict=True)
        ]

    @cached_property
    def _parts(self) -> int:
        """How finely a torque that changes between two samples has to be known.

        What a mean in its place does to the angle is to be lost in the position's noise.
        """
        period = float(np.median([run.trial.period for run in self.runs]))
        most = max(float(np.max(np.abs(run.torque))) for run in self.runs)
        lost = most / self.start.inertia * period**2 / 8.0
        return int(np.clip(math.ceil(math.sqrt(lost / (_LOST * self.position_noise))), 1, MOST_PARTS))

    @cached_property
    def gyro_rates(self) -> list[FloatArray]:
        """(n,) measured rate less the gyro's offset from the position's rate; NaN where none is looked at."""
        return [
            np.full(len(at), np.nan)
            if run.trial.rate is None or not (self.gyro or self.integrated)
            else run.trial.rate[at] - np.nan_to_num(run.rates.gyro_offset)
            for run, at in zip(self.runs, self.instants, strict=True)
        ]

    @cached_property
    def gyro_noise(self) -> float:
        """Standard deviation of the gyro's white noise, rad/s, from its differences; 1 where there is none."""
        bends = np.concatenate([np.diff(rates, n=2) for rates in self.gyro_rates])
        if not np.isfinite(bends).any():
            return 1.0
        # The second difference of white noise has six times its variance.
        return max(float(np.sqrt(np.nanmean(bends**2) / 6.0)), _RATE_NOISE_FLOOR)

    @cached_property
    def known(self) -> list[IntArray]:
        """Where each run has a position; the first is where the filter starts."""
        return [np.flatnonzero(np.isfinite(angle))[1:] for angle in self.angles]

    @cached_property
    def known_rates(self) -> list[IntArray]:
        """Where each run has a rate that is looked at."""
        return [np.flatnonzero(np.isfinite(rate)) for rate in self.gyro_rates]

    @cached_property
    def looked_at(self) -> list[IntArray]:
        """Instant of each innovation of each run: of the positions, then of the rates."""
        return [np.concatenate(pair) for pair in zip(self.known, self.known_rates, strict=True)]

    @cached_property
    def spans(self) -> list[tuple[FloatArray, FloatArray]]:
        """Of each run the (n,) s at which each innovation begins and ends to tell of the motion."""
        return [(time[at], time[at]) for time, at in zip(self.times, self.looked_at, strict=True)]

    @cached_property
    def initial_rates(self) -> list[float]:
        """Rate of each run at its first instant, rad/s."""
        return [self.start.initial_rate(run.trial) for run in self.runs]

    @cached_property
    def trial(self) -> IntArray:
        """(N,) index of the run of each innovation."""
        return np.repeat(np.arange(len(self.runs)), [len(at) for at in self.looked_at])

    @cached_property
    def block(self) -> IntArray:
        """(N,) number of the stretch of time of each innovation."""
        length = self.block_seconds
        pieces = [(time[at] / length).astype(np.intp) for time, at in zip(self.times, self.looked_at, strict=True)]
        offsets = np.cumsum([0, *(int(piece.max(initial=0)) + 1 for piece in pieces)])[:-1]
        return np.concatenate([piece + offset for piece, offset in zip(pieces, offsets, strict=True)])

    @property
    def block_seconds(self) -> float:
        """Length of a stretch of time: 40 s, or less of short runs."""
        return min(_BLOCK_SECONDS, sum(float(np.ptp(time)) for time in self.times) / _BLOCKS)

    @cached_property
    def rate(self) -> float:
        """Root mean square of the rate, rad/s or m/s."""
        rates = np.concatenate([run.rates.rate for run in self.runs])
        return max(float(np.sqrt(np.nanmean(rates**2))), 1e-9)

    @cached_property
    def torque(self) -> float:
        """Root mean square of the torque in use, N m."""
        torque = np.concatenate([run.torque for run in self.runs])
        if not self.driven:
            # Of what brings the vehicle back.
            tilt = np.concatenate([run.trial.position[run.trial.measured] for run in self.runs])
            torque = self.start.stiffness * np.sin(tilt - self.start.restoring_values[1])
        return float(np.sqrt(np.mean(torque[torque != 0.0] ** 2)))

    @property
    def driven(self) -> bool:
        """Whether anything drives the vehicle; else all torques, and the inertia, are those of 1 kg m^2."""
        return self.runs[0].trial.driven

    @cached_property
    def drag_scale(self) -> FloatArray:
        """Quadratic and linear drag that would each brake as much as all drag does."""
        drag = self.start.quadratic_drag * self.rate + self.start.linear_drag
        return np.array([drag / self.rate, drag])

    @cached_property
    def scales(self) -> Scales:
        """Of the effects' parameters."""
        neutral = 0.0 if self.vehicle is None else neutral_commands(self.vehicle)
        command = max(float(np.max(np.abs(run.trial.commands - neutral), initial=0.0)) for run in self.runs)
        surge, sway = (self._speed(name) for name in SPEEDS)
        race, root = self._races
        longest, day = self._hours
        return Scales(
            command, self.torque, self.rate, race, root, surge, sway, load=self._load, longest=longest, day=day
        )

    @property
    def _load(self) -> float:
        """Heaviest load of all thrusters together, as a share of their full thrust; 1 where there is none."""
        if self.vehicle is None or not self.driven:
            return 1.0
        full = sum(thruster.full_thrust for thruster in self.vehicle.thrusters)
        loads = (np.abs(self.vehicle.thrust(run.trial.commands)).sum(axis=1) for run in self.runs)
        return max(float(load.max(initial=0.0)) for load in loads) / full or 1.0

    @property
    def _hours(self) -> tuple[float, float]:
        """Of the longest log, and of all from the beginning of the first to the end of the last."""
        spans = [float(np.ptp(run.trial.time)) for run in self.runs]
        day = max(run.trial.since + span for run, span in zip(self.runs, spans, strict=True))
        return max(spans) / _HOUR, day / _HOUR

    def _speed(self, name: str) -> float:
        """Root mean square of a logged speed, m/s; 1 where there is none."""
        logged = np.concatenate([run.trial.extras.get(name, np.zeros(0)) for run in self.runs])
        return float(np.sqrt(np.mean(logged[np.isfinite(logged)] ** 2))) if np.nansum(np.abs(logged)) > 0.0 else 1.0

    @cached_property
    def _races(self) -> tuple[float, float]:
        """Root mean squares of the race in use, N^0.5 m^2, and of the root of a thrust in use, N^0.5."""
        if self.vehicle is None or not self.driven:
            return math.sqrt(self.torque), math.sqrt(self.torque)
        arms = np.array([thruster.arm for thruster in self.vehicle.thrusters])
        thrust = np.concatenate([self.vehicle.thrust(run.trial.commands) for run in self.runs])
        races, roots = race(thrust, arms), np.sqrt(np.abs(thrust))
        race_in_use, root_in_use = (float(np.sqrt(np.mean(each[each > 0.0] ** 2))) for each in (races, roots))
        return race_in_use, root_in_use

    @cached_property
    def position_noise(self) -> float:
        """Standard deviation of the noise of what is measured, before any fit."""
        return max(float(np.median([run.rates.position_noise for run in self.runs])), _ANGLE_NOISE_FLOOR)


@dataclass(frozen=True, eq=False)
class Slopes:
    """The likelihood about a point.

    Attributes
    ----------
    cost
        Negative log-likelihood.
    residual
        (2N,) normalised innovations above, and what their squares are short of one below.
    matrix
        (2N, p) slopes of the same: the gradient of the cost is ``matrix.T @ residual``, the information ``matrix.T @
        matrix`` (Fisher scoring).
    """

    cost: float
    residual: FloatArray
    matrix: FloatArray


class Likelihood:
    """Negative log-likelihood of the innovations as a function of scaled coordinates; see ``BASE``.

    Attributes
    ----------
    method
        What is likely.
    weight
        Of every innovation, or of each that counts; below one where neighbours tell much the same.
    remembered
        How many points of before tell the curvature, as one climbs.

    Parameters
    ----------
    limit
        Of the disturbance, as a share of the torque in use.
    effects
        Their parameters are the last coordinates, behind those of what weight and buoyancy do.
    counted
        (N,) which innovations count; all of them if None. The filter passes over the others all the same.
    """

    method = "maximum likelihood of Kalman-filter innovations"
    weight: float | FloatArray = 1.0
    remembered = 10

    def __init__(
        self,
        records: Records,
        limit: float,
        effects: tuple[Effect, ...] = (),
        counted: BoolArray | None = None,
    ) -> None:
        self.records = records
        self.limit = limit
        self.effects = effects
        self.counted = counted
        restoring = restoring_of(records.axis)
        self.restoring = () if restoring is None else restoring.parameters
        self.parameters = [*self.restoring, *(parameter for effect in effects for parameter in effect.parameters)]
        self.units = np.array([records.scales.of(parameter) for parameter in self.parameters])
        top = math.log(limit * records.torque)
        start = records.start
        open_by = 2.5 if records.driven else 0.0
        self.low = np.array(
            [
                math.log(start.inertia) - open_by,
                *(0.0, 0.0, top - 9.0, math.log(0.2), math.log(_ANGLE_NOISE_FLOOR)),
                *(p.low for p in self.parameters),
            ]
        )
        self.high = np.array(
            [
                math.log(start.inertia) + open_by,
                *(np.inf, np.inf, top, math.log(100.0), math.log(0.2)),
                *(p.high for p in self.parameters),
            ]
        )
        self._bound_frequencies()
        self._drives: dict[tuple[float, ...], list[Drive]] = {}

    def _bound_frequencies(self) -> None:
        """Keep what swings by itself slower than readings show (Nyquist)."""
        fastest = math.pi / max(self.records.interval, min(run.trial.period for run in self.records.runs))
        names = [(effect.wave or effect.carried, p.name) for effect in self.effects for p in effect.parameters]
        for at, (swings, name) in enumerate(names, start=self.base):
            if swings and name == "frequency":
                self.high[at] = max(min(self.high[at], fastest), self.low[at])

    def starts(self) -> list[FloatArray]:
        """Where to begin the search for the parameters of the last effect, within their bounds."""
        own = slice(len(self.low) - len(self.effects[-1].parameters), None)
        within = np.clip(self.effects[-1].starts, self.low[own], self.high[own])
        return [start for k, start in enumerate(within) if not (within[:k] == start).all(axis=1).any()]

    def like(self, effects: tuple[Effect, ...], counted: BoolArray | None = None) -> Self:
        """The same question asked of a model with other effects, or of other innovations."""
        return type(self)(self.records, self.limit, effects, counted)

    def held_out_costs(self, tests: Sequence[Self], fits: Sequence[FloatArray]) -> list[float]:
        """Cost of each of ``tests`` with the coordinates that were fitted to others."""
        return [test.cost(x) for test, x in zip(tests, fits, strict=True)]

    @property
    def base(self) -> int:
        """How many coordinates stand before those of the effects."""
        return BASE + len(self.restoring)

    def at_limit(self, x: FloatArray) -> bool:
        """Whether the disturbance would be larger if it might."""
        return bool(x[DISTURBANCE] > self.high[DISTURBANCE] - 1e-3)

    def disturbance(self, x: FloatArray) -> tuple[float, float]:
        """Standard deviation of the disturbance torque in N m, and its memory in s."""
        return math.exp(x[DISTURBANCE]), math.exp(x[MEMORY])

    def is_physical(self, x: FloatArray) -> bool:
        """Whether the inertia is one that such a vehicle can have, or no farther from that than before any effect.

        In slow motion, too, it is no less than the rigid body's, whatever water goes along.
        """
        rigid = None if self.records.vehicle is None else self.records.vehicle.rigid_body_inertia
        if rigid is None or not self.records.driven:
            return True
        # What thrust is taken for may be off, and with it every inertia.
        low, high = (ratio * rigid for ratio in PLAUSIBLE_RATIO)
        before, model = self.records.start.inertia, self.model(x)
        least, most = min(low, PLAUSIBLE_RATIO[0] * before), max(high, before / PLAUSIBLE_RATIO[0])
        return least <= min(model.inertia, model.slow_inertia) and model.inertia <= most

    def driven_rate(self, x: FloatArray) -> float:
        """Standard deviation of the rate that the disturbance drives, about the usual rate."""
        torque, memory = self.disturbance(x)
        return torque * self.model(x).restlessness(self.records.rate, memory)

    def position_noise(self, x: FloatArray) -> float:
        """Standard deviation of the noise of what is measured."""
        return math.exp(x[NOISE])

    def of_model(self, x: FloatArray) -> tuple[list[int], FloatArray]:
        """Which coordinates are the model's own parameters, and the change of each of those with its coordinate."""
        own = [0, 1, 2, *range(BASE, len(x))]
        return own, np.array([math.exp(x[0]), *self.records.drag_scale, *self.units])

    def first(self) -> FloatArray:
        """Coordinates to start from, each effect at the first of its starts."""
        start, scale = self.records.start, self.records.drag_scale
        x = [
            math.log(start.inertia),
            start.quadratic_drag / scale[0],
            start.linear_drag / scale[1],
            min(math.log(0.01 * self.records.torque), self.high[DISTURBANCE] - 0.1),
            math.log(4.0),
            math.log(self.records.position_noise),
            *(np.array(start.restoring_values) / self.units[: len(self.restoring)]),
            *(parameter.starts[0] for parameter in self.parameters[len(self.restoring) :]),
        ]
        return np.asarray(np.clip(x, self.low, self.high))

    def disturbed(self, x: FloatArray) -> FloatArray:
        """``x`` with the likeliest of a few disturbances: unlimited, a climb from one far too small goes astray."""
        begins = []
        for share, memory in itertools.product(_SHARES, _MEMORIES):
            begin = x.copy()
            begin[DISTURBANCE], begin[MEMORY] = math.log(share * self.records.torque), math.log(memory)
            begins.append(np.clip(begin, self.low, self.high))
        return min(begins, key=self.cost)

    def model(self, x: FloatArray) -> Model:
        """The model at ``x``."""
        sizes = tuple(float(value) for value in x[BASE:] * self.units)
        return Model(
            inertia=math.exp(x[0]),
            quadratic_drag=float(x[1] * self.records.drag_scale[0]),
            linear_drag=float(x[2] * self.records.drag_scale[1]),
            effects=self.effects,
            effect_values=sizes[len(self.restoring) :],
            axis=self.records.axis,
            restoring_values=sizes[: len(self.restoring)],
        )

    def drives(self, model: Model) -> list[Drive]:
        """What drives each run after the effects between command and torque, held between the instants."""
        key = model.drive_values
        found = self._drives.pop(key, None) or self.records.drives_between(model)
        # The slopes along all other parameters ask for the same again, and so does the next step.
        self._drives[key] = found
        for old in list(self._drives)[:-_DRIVES]:
            self._drives.pop(old, None)
        return found

    def innovations(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """(N,) innovations in rad and their variances; those not counted are left out."""
        from rovid.model.kernels import innovations, innovations_wide

        records, model = self.records, self.model(x)
        terms, active = model.terms()
        wave, wide = model.wave(), any(effect.wave or effect.carried for effect in model.effects)
        sizes = np.exp(x[DISTURBANCE:BASE])
        noise = np.array([*sizes, sizes[2] if records.integrated else records.gyro_noise])
        errors, variances = [], []
        parts = zip(records.runs, self.drives(model), records.angles, records.gyro_rates, strict=True)
        for number, (run, drive, angle, gyro) in enumerate(parts):
            start = np.array([records.initial_rates[number], _RATE_ERROR * records.rate])
            true, gain = model.true_angle(run.trial, angle, records.instants[number])
            driven = (records.times[number], drive.torque, drive.beside, drive.moment, drive.scatter)
            motion = (model.base(run.trial), terms, active, noise)
            if wide:
                error, variance = innovations_wide(*driven, true, gyro, *motion, wave, start)
            else:
                error, variance = innovations(*driven, true, gyro, *motion, start)
            known = records.known[number]
            # The density is that of the measured heading, whatever it deviates by.
            errors.append(error[known, 0] * gain[known])
            variances.append(variance[known, 0] * gain[known] ** 2)
            errors.append(error[records.known_rates[number], 1])
            variances.append(variance[records.known_rates[number], 1])
        error, variance = np.concatenate(errors), np.concatenate(variances)
        return (error, variance) if self.counted is None else (error[self.counted], variance[self.counted])

    @property
    def count(self) -> float:
        """How many independent innovations there are."""
        number = len(self.records.trial) if self.counted is None else int(self.counted.sum())
        return float(np.sum(np.broadcast_to(self.weight, number)))

    def cost(self, x: FloatArray) -> float:
        """Negative log-likelihood."""
        return self.cost_of(*self.innovations(x))

    def cost_of(self, error: FloatArray, variance: FloatArray) -> float:
        """Negative log-likelihood of innovations of these variances."""
        total = float(np.sum(self.weight * _pieces(error, variance)))
        return total if math.isfinite(total) else _WORST

    def pieces(self, error: FloatArray, variance: FloatArray) -> FloatArray:
        """(N,) what each innovation adds to the cost."""
        return np.asarray(self.weight * _pieces(error, variance))

    def scores(self, here: Slopes, group: IntArray) -> FloatArray:
        """(m, p) gradient of the cost over each (N,) ``group``; their scatter tells what the information does not."""
        group = group if self.counted is None else group[self.counted]
        score = here.matrix * here.residual[:, None]
        score = score[: len(group)] + score[len(group) :]
        used, number = np.unique(group, return_inverse=True)
        return np.column_stack([np.bincount(number, weights=column, minlength=len(used)) for column in score.T])

    def _steps(self, x: FloatArray) -> FloatArray:
        """Small changes of ``x``: an effect's parameter in proportion to itself, or to its start where it is gone."""
        starts = np.array([abs(parameter.starts[0]) or 1.0 for parameter in self.parameters])
        shares = np.array([parameter.step for parameter in self.parameters])
        return np.concatenate((np.full(BASE, _STEP), shares * np.maximum(np.abs(x[BASE:]), 0.1 * starts)))

    def slopes(self, x: FloatArray, centre: tuple[FloatArray, FloatArray] | None = None) -> Slopes:
        """Slopes at ``x`` by forward differences, backward at an upper bound; on all cores at once.

        ``centre`` is what `innovations` gives at ``x``, where that is known already.
        """
        step = self._steps(x)
        centre = self.innovations(x) if centre is None else centre
        return self._slopes_over(np.where(x + step > self.high, -step, step), x, centre, range(len(x)))

    def flatter_slopes(self, x: FloatArray) -> Slopes:
        """As ``slopes``, but of the slopes ahead and behind the flatter for each innovation.

        Where a change cuts an interval of the filter into one step more, innovations jump by a part of their error.
        Over the short step of a slope that is more than all others together, but on one side alone.
        """
        step, centre = self._steps(x), self.innovations(x)
        here = self.slopes(x, centre)
        # Along stairs all that is told is told by jumps, and at a bound there is one side.
        stairs = np.array([False] * BASE + [parameter.stairs for parameter in self.parameters])
        twice = np.flatnonzero(~stairs & (x + step <= self.high) & (x - step >= self.low))
        ahead, behind = here.matrix[:, twice], self._slopes_over(-step, x, centre, twice.tolist()).matrix
        here.matrix[:, twice] = np.where(np.abs(behind) < np.abs(ahead), behind, ahead)
        return here

    def _slopes_over(
        self, step: FloatArray, x: FloatArray, centre: tuple[FloatArray, FloatArray], coordinates: Sequence[int]
    ) -> Slopes:
        sides = spread(lambda k: self._aside(x, centre, k, float(step[k])), coordinates)
        return self.slopes_between(centre, sides, step[list(coordinates)])

    def _aside(
        self, x: FloatArray, centre: tuple[FloatArray, FloatArray], coordinate: int, step: float
    ) -> tuple[FloatArray, FloatArray]:
        """Innovations and variances one ``step`` aside along a coordinate; ``centre`` are those at ``x``."""
        if self.low[coordinate] == self.high[coordinate]:
            return centre
        moved = x.copy()
        moved[coordinate] += step
        return self.innovations(moved)

    def slopes_between(
        self,
        centre: tuple[FloatArray, FloatArray],
        sides: Sequence[tuple[FloatArray, FloatArray]],
        step: FloatArray,
    ) -> Slopes:
        """Slopes from innovations and variances at a point and one ``step`` aside along each coordinate."""
        error, variance = centre
        root = np.sqrt(variance)
        z = error / root
        # So that squares have the weights.
        share = np.sqrt(self.weight)
        weight = share * np.sqrt(np.minimum(1.0, _OUTLIER / np.maximum(np.abs(z), 1e-300)))
        matrix = np.empty((2 * len(z), len(sides)))
        # A model that runs away has no slopes, which whoever asks can see.
        with np.errstate(over="ignore", invalid="ignore"):
            for k, (side, scatter) in enumerate(sides):
                matrix[: len(z), k] = weight * (side - error) / (step[k] * root)
                matrix[len(z) :, k] = share * (scatter - variance) / (step[k] * math.sqrt(2.0) * variance)
        residual = np.concatenate((weight * z, (share - (weight * z) ** 2 / share) / math.sqrt(2.0)))
        return Slopes(self.cost_of(error, variance), residual, matrix)

    def climb(self, start: FloatArray, *, iterations: int = 60, tolerance: float = 0.01) -> tuple[FloatArray, float]:
        """Most likely coordinates from ``start`` and their cost, by Fisher scoring within the bounds.

        Ends when less than ``tolerance`` of log-likelihood is still to be gained.
        """
        x = np.clip(start, self.low, self.high)
        damping = 1e-3
        centre = self.innovations(x)
        cost = self.cost_of(*centre)
        been: list[tuple[FloatArray, FloatArray]] = []
        for _ in range(iterations):
            here = self.slopes(x, centre)
            gradient, information = here.matrix.T @ here.residual, here.matrix.T @ here.matrix
            if not np.isfinite(information).all():
                break
            been = [*been, (x, gradient)][-self.remembered - 1 :]
            information = _with_curvature(information, been)
            moved = False
            while damping < 1e6:
                step = self._step(x, gradient, information, damping)
                step *= min(1.0, _LONGEST / max(float(np.max(np.abs(step[_LOGARITHMS]))), 1e-300))
                promised = -float(gradient @ step)
                trial = np.clip(x + step, self.low, self.high)
                there = self.innovations(trial)
                reached = self.cost_of(*there)
                if reached < cost:
                    ratio = (cost - reached) / max(promised - 0.5 * float(step @ information @ step), 1e-300)
                    damping = max(damping * 0.1, 1e-7) if ratio > 0.75 else damping * (10.0 if ratio < 0.4 else 1.0)
                    moved = True
                    break
                if promised < tolerance:
                    break
                damping *= 10.0
            if not moved:
                break
            gained, cost, x, centre = cost - reached, reached, trial, there
            if gained < tolerance:
                break
        self._drives.clear()
        return x, cost

    def _step(self, x: FloatArray, gradient: FloatArray, information: FloatArray, damping: float) -> FloatArray:
        """Levenberg-Marquardt step; coordinates that would leave their bounds stay."""
        free = ~(((x <= self.low) & (gradient > 0.0)) | ((x >= self.high) & (gradient < 0.0)))
        step = np.zeros(len(x))
        size = np.diag(information)
        for _ in range(len(x)):
            if not free.any():
                break
            part = np.ix_(free, free)
            floor = 1e-12 * float(size.max()) + 1e-12
            matrix = information[part] + np.diag(damping * size[free] + floor)
            step[:] = 0.0
            step[free] = np.linalg.lstsq(matrix, -gradient[free], rcond=None)[0]
            # A coordinate at its bound that the others push outward is held there too.
            out = free & (((x <= self.low) & (step < 0.0)) | ((x >= self.high) & (step > 0.0)))
            if not out.any():
                break
            free &= ~out
        return step


def _with_curvature(information: FloatArray, been: Sequence[tuple[FloatArray, FloatArray]]) -> FloatArray:
    """``information`` with the curvature between the points and gradients of before, last of all the latest.

    Far from white innovations the information promises too little of it, and scoring alone crawls. It is told by
    differences of gradients (BFGS: Nocedal & Wright 2006, section 6.1), which change nothing where it is right.
    """
    matrix = information.copy()
    for (x, gradient), (following, slope) in itertools.pairwise(been):
        step, change = following - x, slope - gradient
        expected = matrix @ step
        met, promised = float(step @ change), float(step @ expected)
        if met > _LEAST_CURVATURE * promised > 0.0:
            matrix += np.outer(change, change) / met - np.outer(expected, expected) / promised
    return matrix


def _spaced(time: FloatArray, known: IntArray, interval: float) -> IntArray:
    """The first of ``known`` in each cell of a grid of ``interval`` s, and the last of all."""
    cell = np.floor((time[known] - time[known[0]]) / interval + 1e-6)
    first = np.concatenate(([True], cell[1:] != cell[:-1]))
    first[-1] = True
    return np.asarray(known[first])


def _pieces(error: FloatArray, variance: FloatArray) -> FloatArray:
    # No innovation is so far out that its square could not be told from infinity; a filter that runs away has no
    # likelihood, which whoever asks can see.
    with np.errstate(over="ignore", invalid="ignore"):
        z = np.minimum(np.abs(error) / np.sqrt(variance), _FARTHEST)
    square = np.where(z > _OUTLIER, _OUTLIER * (2.0 * z - _OUTLIER), z * z)
    return np.asarray(0.5 * (np.log(2.0 * np.pi * variance) + square))
