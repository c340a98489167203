"""Some runs, which a filter goes through in one pass."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple, Self

import numpy as np

from rovid.core.array_types import FloatArray, IntArray
from rovid.core.lru_cache import SizedCache
from rovid.estimate.input_cache import InputCache
from rovid.model.filter_batch import FilterData
from rovid.model.heading_sensor import HeadingSensor
from rovid.model.model import Model
from rovid.model.torque_input import TorqueInput
from rovid.signals.preprocessing import Run


@dataclass(frozen=True, eq=False, kw_only=True)
class RunData:
    """What is looked at in one run.

    Attributes
    ----------
    at
        Where the filter steps to, (n,) of the log's instants or all of them.
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
    at: IntArray | slice
    time: FloatArray
    angle: FloatArray
    gyro_rate: FloatArray
    known_positions: IntArray
    known_rates: IntArray

    @classmethod
    def from_run(cls, run: Run, at: IntArray | slice, *, gyro: bool) -> Self:
        """Of the instants ``at`` of a run; logged rates too where ``gyro`` says so, or nothing else was measured."""
        time, angle = run.trial.time[at], run.trial.body_position[at]
        if run.trial.rate_only:
            angle = np.where(np.arange(len(time)) == 0, angle, np.nan)
        gyro_rate = np.broadcast_to(np.nan, len(time))
        if run.trial.rate is not None and (gyro or run.trial.rate_only):
            offset = np.nan_to_num(run.rates.gyro_offset)
            gyro_rate = run.trial.rate[at] - offset
        return cls(
            run=run,
            at=at,
            time=time,
            angle=angle,
            gyro_rate=gyro_rate,
            known_positions=np.flatnonzero(np.isfinite(angle))[1:],
            known_rates=np.flatnonzero(np.isfinite(gyro_rate)),
        )

    @property
    def innovation_times(self) -> FloatArray:
        """(m,) s, of each innovation: of the positions, then of the rates."""
        return np.concatenate((self.time[self.known_positions], self.time[self.known_rates]))


class CorrectedAngle(NamedTuple):
    """(n,) the angle without the deviation of the heading, and d(measured)/d(true) where there is one."""

    angle: FloatArray
    gain: FloatArray | None

    @property
    def nbytes(self) -> int:
        """Bytes."""
        return self.angle.nbytes + (0 if self.gain is None else self.gain.nbytes)


@dataclass(frozen=True, eq=False, kw_only=True)
class DataChunk:
    """Runs that are gone through together.

    Attributes
    ----------
    of_runs
        What is looked at in each.
    first
        (m, 2) rate of each at its first instant, and its standard deviation.
    driving
        What drives them.
    rows
        Which of the innovations of all runs are those of these.
    recent
        Where what was `seen` is kept, for all portions together.
    """

    run_data: Sequence[RunData]
    initial_rates: FloatArray
    inputs: InputCache
    rows: slice
    cache: SizedCache

    @cached_property
    def filter_data(self) -> FilterData:
        """All of it, the runs one after the other."""
        return FilterData(
            begins=self._begins,
            time=np.concatenate([run.time for run in self.run_data]),
            rate=np.concatenate([run.gyro_rate for run in self.run_data]),
            start=np.array([run.run.trial.first_position for run in self.run_data]),
            first=self.initial_rates,
            row=self._rows,
        )

    def torque_input(self, model: Model) -> TorqueInput:
        """What drives the runs from each instant that is looked at to the next."""
        return self.inputs.between_steps(model)

    def corrected_angle(self, model: Model) -> CorrectedAngle:
        """What a filter goes by, with the heading as the instrument of ``model`` shows it; worked out once."""
        instrument = model.heading_sensor
        if not instrument.deviates:
            return CorrectedAngle(self._angle, None)
        return self.cache.get_or_make((self.rows.start, instrument.cache_key), lambda: self._corrected(instrument))

    def _corrected(self, instrument: HeadingSensor) -> CorrectedAngle:
        position = np.concatenate([run.run.trial.position[run.at] for run in self.run_data])
        true, gain = instrument.to_true(position)
        return CorrectedAngle(self._angle - (position - true), gain)

    @cached_property
    def _angle(self) -> FloatArray:
        """(n,) measured position along the body's axis at each instant, the runs one after the other."""
        return np.concatenate([run.angle for run in self.run_data])

    @cached_property
    def _begins(self) -> IntArray:
        """(m + 1,) the instant with which each run begins, and how many there are in all."""
        return np.cumsum([0, *(len(run.time) for run in self.run_data)])

    @property
    def _rows(self) -> IntArray:
        """(n, 2) as in `Logged`."""
        rows = np.full(2 * len(self._angle), -1)
        told = self.innovation_index
        rows[told] = np.arange(len(told))
        return rows.reshape(-1, 2)

    @property
    def innovation_index(self) -> IntArray:
        """(N,) of each innovation, twice the instant that it is of, and one more if it is of the rate."""
        pairs = zip(self.run_data, self._begins[:-1], strict=True)
        of_runs = [(2 * (begin + run.known_positions), 2 * (begin + run.known_rates) + 1) for run, begin in pairs]
        return np.concatenate([series for both in of_runs for series in both])
