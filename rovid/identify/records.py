"""What was measured, as the likelihood takes it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from rovid.campaign.axis import Axis
from rovid.campaign.vehicle import Vehicle
from rovid.effects.actuation import SPEEDS, Actuation, actuation, neutral_commands, race
from rovid.effects.base import Scales
from rovid.ground.arrays import FloatArray, IntArray
from rovid.model.drive import MOST_PARTS, Drive
from rovid.model.integration import initial_rate
from rovid.model.model import Model
from rovid.motion.rates import body_position
from rovid.motion.runs import Run

ANGLE_NOISE_FLOOR = 1e-5  # rad; no heading is better, and one from an autopilot's filter would claim to be
_RATE_NOISE_FLOOR = 1e-5  # rad/s; likewise
_HOUR = 3600.0
_BLOCK_SECONDS, _BLOCKS = 40.0, 12
# Share of the position's noise.
_LOST = 0.1


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
            return [_first_alone(angle) for angle in angles]
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
        if vehicle is None or model.drivetrain.is_plain:
            return [Drive.held(run.torque) for run in self.runs]
        return [model.drive(vehicle, run.trial) for run in self.runs]

    def drives_between(self, model: Model) -> list[Drive]:
        """What drives each run from each of the filter's instants to the next."""
        vehicle = self.vehicle
        if vehicle is None or model.drivetrain.is_plain:
            return self._plain
        parts = min(self._parts, model.drivetrain.parts)
        if parts not in self._actuations:
            self._actuations[parts] = [actuation(vehicle, run.trial, parts) for run in self.runs]
        drives = []
        for run, where, at in zip(self.runs, self._actuations[parts], self.instants, strict=True):
            instants = at if self.interval > 0.0 else None
            drives.append(model.drivetrain.driven(vehicle, where, run.trial.commands, instants))
        return drives

    @cached_property
    def _actuations(self) -> dict[int, list[Actuation]]:
        """By how many parts an interval is cut into: what effects between command and torque know of each run."""
        return {}

    @cached_property
    def _plain(self) -> list[Drive]:
        if self.interval <= 0.0:
            return [Drive.held(run.torque) for run in self.runs]
        drives = []
        for run, at in zip(self.runs, self.instants, strict=True):
            drives.append(Drive.held(run.torque).between(run.trial.time, at))
        return drives

    @cached_property
    def _parts(self) -> int:
        """How finely a torque that changes between two samples has to be known.

        What a mean in its place does to the angle is to be lost in the position's noise.
        """
        period = float(np.median([run.trial.period for run in self.runs]))
        most = max(float(np.max(np.abs(run.torque))) for run in self.runs)
        # A parabola over the interval and its chord are so far apart in the middle.
        lost = most / self.start.inertia * period**2 / 8.0
        parts = math.ceil(math.sqrt(lost / (_LOST * self.position_noise)))
        return int(np.clip(parts, 1, MOST_PARTS))

    @cached_property
    def gyro_rates(self) -> list[FloatArray]:
        """(n,) measured rate less the gyro's offset from the position's rate; NaN where none is looked at."""
        found = []
        for run, at in zip(self.runs, self.instants, strict=True):
            if run.trial.rate is None or not (self.gyro or self.integrated):
                found.append(np.full(len(at), np.nan))
            else:
                offset = np.nan_to_num(run.rates.gyro_offset)
                found.append(run.trial.rate[at] - offset)
        return found

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
        return [initial_rate(run.trial, self.start.swing) for run in self.runs]

    @cached_property
    def trial(self) -> IntArray:
        """(N,) index of the run of each innovation."""
        return np.repeat(np.arange(len(self.runs)), [len(at) for at in self.looked_at])

    @cached_property
    def block(self) -> IntArray:
        """(N,) number of the stretch of time of each innovation."""
        length = self.block_seconds
        blocks, before = [], 0
        for time, at in zip(self.times, self.looked_at, strict=True):
            block = (time[at] / length).astype(np.intp)
            blocks.append(block + before)
            before += int(block.max(initial=0)) + 1
        return np.concatenate(blocks)

    @property
    def block_seconds(self) -> float:
        """Length of a stretch of time: 40 s, or less of short runs."""
        total = sum(float(np.ptp(time)) for time in self.times)
        return min(_BLOCK_SECONDS, total / _BLOCKS)

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
        surge, sway = map(self._speed, SPEEDS)
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
        heaviest = []
        for run in self.runs:
            load = np.abs(self.vehicle.thrust(run.trial.commands)).sum(axis=1)
            heaviest.append(float(load.max(initial=0.0)))
        return max(heaviest) / full or 1.0

    @property
    def _hours(self) -> tuple[float, float]:
        """Of the longest log, and of all from the beginning of the first to the end of the last."""
        spans = [float(np.ptp(run.trial.time)) for run in self.runs]
        ends = [run.trial.since + span for run, span in zip(self.runs, spans, strict=True)]
        return max(spans) / _HOUR, max(ends) / _HOUR

    def _speed(self, name: str) -> float:
        """Root mean square of a logged speed, m/s; 1 where there is none."""
        logged = np.concatenate([run.trial.extras.get(name, np.zeros(0)) for run in self.runs])
        if not np.nansum(np.abs(logged)) > 0.0:
            return 1.0
        known = logged[np.isfinite(logged)]
        return float(np.sqrt(np.mean(known**2)))

    @cached_property
    def _races(self) -> tuple[float, float]:
        """Root mean squares of the race in use, N^0.5 m^2, and of the root of a thrust in use, N^0.5."""
        if self.vehicle is None or not self.driven:
            return math.sqrt(self.torque), math.sqrt(self.torque)
        arms = np.array([thruster.arm for thruster in self.vehicle.thrusters])
        thrust = np.concatenate([self.vehicle.thrust(run.trial.commands) for run in self.runs])
        return _in_use(race(thrust, arms)), _in_use(np.sqrt(np.abs(thrust)))

    @cached_property
    def position_noise(self) -> float:
        """Standard deviation of the noise of what is measured, before any fit."""
        return max(float(np.median([run.rates.position_noise for run in self.runs])), ANGLE_NOISE_FLOOR)


def _first_alone(angle: FloatArray) -> FloatArray:
    """``angle`` with nothing known after its first."""
    return np.where(np.arange(len(angle)) == 0, angle, np.nan)


def _in_use(values: FloatArray) -> float:
    """Root mean square of those ``values`` that are above nothing."""
    return float(np.sqrt(np.mean(values[values > 0.0] ** 2)))


def _spaced(time: FloatArray, known: IntArray, interval: float) -> IntArray:
    """The first of ``known`` in each cell of a grid of ``interval`` s, and the last of all."""
    cell = np.floor((time[known] - time[known[0]]) / interval + 1e-6)
    first = np.concatenate(([True], cell[1:] != cell[:-1]))
    first[-1] = True
    return np.asarray(known[first])
