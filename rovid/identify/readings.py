"""The readings of each run, one after the other, as a Kalman filter takes them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple, Self

import numpy as np

from rovid.ground.arrays import FloatArray, IntArray
from rovid.ground.recent import Recent
from rovid.identify.records import Records
from rovid.model.batch import Logged
from rovid.model.instrument import Instrument
from rovid.model.integration import initial_rate
from rovid.model.model import Model
from rovid.motion.runs import Run

_RATE_NOISE_FLOOR = 1e-5  # rad/s; no gyro is better
# Of the usual rate: how well the first rate of a trial is known.
_RATE_ERROR = 0.2
# s, and into how many at least all time is cut.
_BLOCK_SECONDS, _BLOCKS = 40.0, 12
# Bytes of headings without their deviation that are kept.
_KEPT = 16_000_000


@dataclass(frozen=True, eq=False, kw_only=True)
class RunReadings:
    """What is looked at in one run.

    Attributes
    ----------
    at
        (n,) where the filter steps to, of the log's instants.
    time
        (n,) s, there.
    angle
        (n,) measured position along the body's axis, rad or m. Where the rate alone was measured, no more than the
        first.
    gyro_rate
        (n,) measured rate less the gyro's offset from the position's rate; NaN where none is looked at.
    known, known_rates
        Which of the n have a position, but for the first, where the filter starts; and which have a rate.
    """

    run: Run
    at: IntArray
    time: FloatArray
    angle: FloatArray
    gyro_rate: FloatArray
    known: IntArray
    known_rates: IntArray

    @classmethod
    def of(cls, run: Run, at: IntArray, *, gyro: bool) -> Self:
        """Of the instants ``at`` of a run; logged rates too where ``gyro`` says so, or nothing else was measured."""
        angle = run.trial.body_position[at]
        if run.trial.integrated:
            angle[1:] = np.nan
        gyro_rate = np.full(len(at), np.nan)
        if run.trial.rate is not None and (gyro or run.trial.integrated):
            offset = np.nan_to_num(run.rates.gyro_offset)
            gyro_rate = run.trial.rate[at] - offset
        return cls(
            run=run,
            at=at,
            time=run.trial.time[at],
            angle=angle,
            gyro_rate=gyro_rate,
            known=np.flatnonzero(np.isfinite(angle))[1:],
            known_rates=np.flatnonzero(np.isfinite(gyro_rate)),
        )

    @property
    def told_at(self) -> FloatArray:
        """(m,) s, of each innovation: of the positions, then of the rates."""
        return np.concatenate((self.time[self.known], self.time[self.known_rates]))


class Seen(NamedTuple):
    """(n,) the angle without the deviation of the heading, and d(measured)/d(true) where there is one."""

    angle: FloatArray
    gain: FloatArray | None

    @property
    def nbytes(self) -> int:
        """Bytes."""
        return self.angle.nbytes + (0 if self.gain is None else self.gain.nbytes)


@dataclass(frozen=True, eq=False)
class Readings(Records):
    """The next reading of each run, time and again.

    Attributes
    ----------
    interval
        Headings nearer to each other, in s, are passed over; 0 for none. A quick look needs no more.
    """

    interval: float = 0.0

    @cached_property
    def steps(self) -> list[IntArray] | None:
        """(n,) of each run, where the filter steps to; None for all instants."""
        if self.interval <= 0.0:
            return None
        return [_spaced(run.trial.time, np.flatnonzero(run.trial.measured), self.interval) for run in self.runs]

    @cached_property
    def of_runs(self) -> list[RunReadings]:
        """What is looked at in each run."""
        pairs = zip(self.runs, self._steps_in_use(), strict=True)
        return [RunReadings.of(run, at, gyro=self.gyro) for run, at in pairs]

    def _steps_in_use(self) -> Sequence[IntArray]:
        """Instants of each run that are looked at: all of them where none were chosen."""
        if self.steps is not None:
            return self.steps
        return [np.arange(len(run.trial.time)) for run in self.runs]

    @cached_property
    def spans(self) -> list[tuple[FloatArray, FloatArray]]:
        """Of each run the (n,) s of each innovation, at which it begins and ends to tell of the motion."""
        return [(readings.told_at, readings.told_at) for readings in self.of_runs]

    @property
    def block_seconds(self) -> float:
        """Length of a stretch of time: 40 s, or less of short runs."""
        total = sum(float(np.ptp(readings.time)) for readings in self.of_runs)
        return min(_BLOCK_SECONDS, total / _BLOCKS)

    @cached_property
    def logged(self) -> Logged:
        """All of it, the runs one after the other."""
        runs = self.of_runs
        first = [(rate, _RATE_ERROR * self.rate) for rate in self.initial_rates]
        return Logged(
            begins=self._begins,
            time=np.concatenate([run.time for run in runs]),
            rate=np.concatenate([run.gyro_rate for run in runs]),
            start=np.array([run.trial.start for run in self.runs]),
            first=np.array(first, dtype=float),
            row=self._rows,
        )

    @cached_property
    def angle(self) -> FloatArray:
        """(n,) measured position along the body's axis at each instant, the runs one after the other."""
        return np.concatenate([run.angle for run in self.of_runs])

    def seen(self, model: Model) -> Seen:
        """What a filter goes by, with the heading as the instrument of ``model`` shows it; worked out once."""
        instrument = model.instrument
        if not instrument.deviates:
            return Seen(self.angle, None)
        return self._recent.of(instrument.made_of, lambda: self._corrected(instrument))

    def _corrected(self, instrument: Instrument) -> Seen:
        true, gain = instrument.as_true(self._position)
        return Seen(self.angle - (self._position - true), gain)

    @cached_property
    def _recent(self) -> Recent:
        """What was `seen`: models that are compared have the same deviation, but where that is what is looked at."""
        return Recent(_KEPT)

    @cached_property
    def _position(self) -> FloatArray:
        """(n,) measured position itself, as `angle`."""
        return np.concatenate([run.run.trial.position[run.at] for run in self.of_runs])

    @cached_property
    def _begins(self) -> IntArray:
        """(r + 1,) the instant with which each run begins, and how many there are in all."""
        return np.cumsum([0, *(len(run.time) for run in self.of_runs)])

    @property
    def _rows(self) -> IntArray:
        """(n, 2) as in `Logged`."""
        rows = np.full(2 * len(self.angle), -1)
        rows[self.told] = np.arange(len(self.told))
        return rows.reshape(-1, 2)

    @cached_property
    def told(self) -> IntArray:
        """(N,) of each innovation, twice the instant that it is of, and one more if it is of the rate."""
        pairs = zip(self.of_runs, self._begins[:-1], strict=True)
        of_runs = [(2 * (begin + run.known), 2 * (begin + run.known_rates) + 1) for run, begin in pairs]
        return np.concatenate([series for both in of_runs for series in both])

    @cached_property
    def initial_rates(self) -> list[float]:
        """Rate of each run at its first instant, rad/s."""
        return [initial_rate(run.trial, self.start.swing) for run in self.runs]

    @cached_property
    def gyro_noise(self) -> float:
        """Standard deviation of the gyro's white noise, rad/s, from its differences; 1 where there is none."""
        bends = np.concatenate([np.diff(readings.gyro_rate, n=2) for readings in self.of_runs])
        if not np.isfinite(bends).any():
            return 1.0
        # The second difference of white noise has six times its variance.
        return max(float(np.sqrt(np.nanmean(bends**2) / 6.0)), _RATE_NOISE_FLOOR)


def _spaced(time: FloatArray, known: IntArray, interval: float) -> IntArray:
    """The first of ``known`` in each cell of a grid of ``interval`` s, and the last of all."""
    cell = np.floor((time[known] - time[known[0]]) / interval + 1e-6)
    first = np.concatenate(([True], cell[1:] != cell[:-1]))
    first[-1] = True
    return np.asarray(known[first])
