"""The readings of each run, one after the other, as a Kalman filter takes them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np

from rovid.core.array_types import FloatArray, IntArray
from rovid.core.lru_cache import SizedCache
from rovid.estimate.data_chunk import DataChunk, RunData
from rovid.estimate.dataset import FitData
from rovid.model.ode import initial_rate

_RATE_NOISE_FLOOR = 1e-5  # rad/s; no gyro is better
# Of the usual rate: how well the first rate of a trial is known.
_RATE_ERROR = 0.2
# s, and into how many at least all time is cut.
_BLOCK_SECONDS, _BLOCKS = 40.0, 12
# Bytes of headings without their deviation that are kept.
_KEPT = 16_000_000
# Instants of logs that are gone through at once.
_AT_ONCE = 200_000


@dataclass(frozen=True, eq=False)
class InnovationData(FitData):
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
    def run_data(self) -> list[RunData]:
        """What is looked at in each run."""
        every: Sequence[IntArray | slice] = [slice(None)] * len(self.runs) if self.steps is None else self.steps
        pairs = zip(self.runs, every, strict=True)
        return [RunData.from_run(run, at, gyro=self.gyro) for run, at in pairs]

    @property
    def innovation_spans(self) -> list[tuple[FloatArray, FloatArray]]:
        """Of each run the (n,) s of each innovation, at which it begins and ends to tell of the motion."""
        return [(readings.innovation_times, readings.innovation_times) for readings in self.run_data]

    @property
    def block_seconds(self) -> float:
        """Length of a stretch of time: 40 s, or less of short runs."""
        total = sum(float(np.ptp(readings.time)) for readings in self.run_data)
        return min(_BLOCK_SECONDS, total / _BLOCKS)

    @cached_property
    def chunks(self) -> list[DataChunk]:
        """All runs, some after the others: what a pass takes of memory is what it takes for so many."""
        ends = np.cumsum([len(begin) for begin, _ in self.innovation_spans])
        recent, portions = SizedCache(_KEPT), list[DataChunk]()
        for place in _portions([len(run.trial.time) for run in self.runs]):
            rates = [(rate, _RATE_ERROR * self.rms_rate) for rate in self.initial_rates[place]]
            portion = DataChunk(
                run_data=self.run_data[place],
                initial_rates=np.array(rates, dtype=float),
                inputs=self._driving.subset(place),
                rows=slice(portions[-1].rows.stop if portions else 0, int(ends[place.stop - 1])),
                cache=recent,
            )
            portions.append(portion)
        return portions

    @cached_property
    def initial_rates(self) -> list[float]:
        """Rate of each run at its first instant, rad/s."""
        return [initial_rate(run.trial, self.initial_model.natural_frequency) for run in self.runs]

    @cached_property
    def gyro_noise(self) -> float:
        """Standard deviation of the gyro's white noise, rad/s, from its differences; 1 where there is none."""
        bends = np.concatenate([np.diff(readings.gyro_rate, n=2) for readings in self.run_data])
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


def _portions(lengths: Sequence[int]) -> list[slice]:
    """Runs of such lengths one after the other, as many together as are not longer than is gone through at once."""
    begins, length = [0], 0
    for place, one in enumerate(lengths):
        if length and length + one > _AT_ONCE:
            begins.append(place)
            length = 0
        length += one
    return [slice(begin, end) for begin, end in pairwise([*begins, len(lengths)])]
