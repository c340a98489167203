"""Measured motion on a uniform grid, and the restarts and ends of multi-step predictions on it."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple, Self

import numpy as np

from rovid.core.array_types import BoolArray, FloatArray, IntArray
from rovid.effects.actuator_inputs import interpolate_gaps
from rovid.model.simulation import full_rate
from rovid.trial.preprocessing import Run
from rovid.trial.rates import resample

# Prediction horizons in time constants of the vehicle.
HORIZONS = (0.5, 1.0, 2.0, 4.0, 8.0)
# Least time between restarts in time constants, for the shortest horizon; a quarter of the horizon for longer ones.
# Restarts of longer horizons are among those of shorter ones.
RESTARTS = 0.25
# Interval of the grid in time constants.
GRID = 0.1
# Largest number of restarts; with their horizons they are more than the predictions that may count.
MAX_RESTARTS = 300


class Trajectory(NamedTuple):
    """(n,) measured motion on the grid of one run, or of several runs one after the other.

    ``rate`` is NaN where the filter has no answer. ``bridged_rate`` has the angle's slope there, and straight lines
    in gaps. ``angle`` is relative to the first known angle, with straight lines in gaps. ``slope`` is
    d(measured angle)/d(true angle).
    """

    rate: FloatArray
    bridged_rate: FloatArray
    angle: FloatArray
    slope: FloatArray

    @classmethod
    def of(cls, time: FloatArray, angle: FloatArray, rate: FloatArray, slope: FloatArray) -> Self:
        """Trajectory of one run, from its (n,) angle and rate at instants in s."""
        relative = angle - angle[int(np.argmax(np.isfinite(angle)))]
        bridged = full_rate(rate, relative, time[1] - time[0]) if len(time) > 1 else rate
        return cls(rate, interpolate_gaps(bridged), interpolate_gaps(relative), slope)

    @classmethod
    def concatenated(cls, each: Sequence[Self]) -> Self:
        """Trajectory of several runs."""
        return cls(*(np.concatenate(series) for series in zip(*each, strict=True)))


@dataclass(frozen=True, eq=False)
class GriddedRun:
    """Measured motion of one run on a grid, and the predictions along it."""

    run: Run
    time: FloatArray  #: (n,) s.
    stride: int  #: Samples of the filter's grid per interval of this grid.
    angle: FloatArray  #: (n,) measured angle about the body's axis; NaN where unknown.
    trajectory: Trajectory
    #: ``starts``, ``ends``, ``horizon``: (N,) grid indices of the restart and of the end of each prediction, and the
    #: index of its horizon.
    starts: IntArray
    ends: IntArray
    horizon: IntArray

    @classmethod
    def of(cls, run: Run, time_constant: float, restart_seconds: float) -> Self:
        """Grid of a ``run``, with restarts at least ``restart_seconds`` apart."""
        rates, trial = run.rates, run.trial
        stride = max(round(GRID * time_constant / rates.kernel.period), 1)
        time, rate = rates.time[::stride], rates.rate[::stride]
        angle = resample(trial, trial.body_position, rates.time)[::stride]
        predictions = _predictions(angle, rate, stride * rates.kernel.period, time_constant, restart_seconds)
        return cls(run, time, stride, angle, Trajectory.of(time, angle, rate, np.ones(len(time))), *predictions)

    def over(self, horizons: IntArray) -> Self:
        """The same motion with the predictions over some ``horizons`` alone."""
        kept = np.isin(self.horizon, horizons)
        return replace(self, starts=self.starts[kept], ends=self.ends[kept], horizon=self.horizon[kept])

    @property
    def period(self) -> float:
        """Interval of the grid, s."""
        if len(self.time) < 2:
            return self.run.rates.kernel.period
        return float(self.time[1] - self.time[0])

    @cached_property
    def restarts(self) -> tuple[IntArray, IntArray]:
        """(m,) grid indices of the distinct restarts, and (N,) the number of the restart of each prediction."""
        return np.unique(self.starts, return_inverse=True)


@dataclass(frozen=True, eq=False)
class RestartGrid:
    """Predictions of all runs on their grids, one after the other. Restarts are sorted by reach, the longest first."""

    #: ``starts``, ``ends``: (N,) indices of the restart and of the end of each prediction.
    starts: IntArray
    ends: IntArray
    #: ``restarts``, ``reach``: (m,) index of each restart, and the number of steps to the farthest end from there.
    restarts: IntArray
    reach: IntArray
    restart_number: IntArray  #: (N,) number of the restart of each prediction.
    #: ``run``, ``period``: (m,) number of the run of each restart, and the interval of its grid in s.
    run: IntArray
    period: FloatArray

    @classmethod
    def of(cls, runs: Sequence[GriddedRun]) -> Self:
        """Predictions of all ``runs``."""
        offsets = np.cumsum([0, *(len(run.time) for run in runs)])[:-1]
        starts = np.concatenate([run.starts + offset for run, offset in zip(runs, offsets, strict=True)])
        ends = np.concatenate([run.ends + offset for run, offset in zip(runs, offsets, strict=True)])
        # Indices grow from run to run, so the distinct restarts are in the order of the runs.
        restarts, number = np.unique(starts, return_inverse=True)
        reach = np.zeros(len(restarts), dtype=np.intp)
        np.maximum.at(reach, number, ends - starts)
        run = np.searchsorted(offsets, restarts, side="right") - 1
        # Neighbouring SIMD lanes end together.
        order = np.argsort(-reach, kind="stable")
        place = np.empty_like(order)
        place[order] = np.arange(len(order))
        periods = np.array([one.stride * one.run.rates.kernel.period for one in runs])[run[order]]
        return cls(starts, ends, restarts[order], reach[order], place[number], run[order], periods)


def _predictions(
    angle: FloatArray, rate: FloatArray, period: float, time_constant: float, restart_seconds: float
) -> tuple[IntArray, IntArray, IntArray]:
    """(N,) grid indices of the start and the end of each prediction, and the index of its horizon; times in s."""
    known = np.isfinite(angle)
    # Number of unknown instants before each. A prediction across a gap is left out: the turn in it is not measured.
    unknown = np.concatenate(([0], np.cumsum(~known)))
    restarts = np.flatnonzero(np.isfinite(rate) & known)
    steps = max(round(restart_seconds / period), 1)
    starts, ends, horizons = [], [], []
    for number, horizon in enumerate(HORIZONS):
        length = max(round(horizon * time_constant / period), 1)
        stride = steps * max(round(0.25 * horizon / RESTARTS), 1)
        first = restarts[(restarts % stride == 0) & (restarts + length < len(angle))]
        whole = first[unknown[first + length + 1] == unknown[first]]
        starts.append(whole)
        ends.append(whole + length)
        horizons.append(np.full(len(whole), number))
    return np.concatenate(starts), np.concatenate(ends), np.concatenate(horizons)


@dataclass(frozen=True, eq=False, kw_only=True)
class IntervalMeans:
    """Means over grid intervals, of series that are held between the n samples of some runs."""

    #: ``offsets``, ``grid_offsets``: (r + 1,) first sample, and first of the m grid instants, of each of r runs, and
    #: their totals.
    offsets: IntArray
    grid_offsets: IntArray
    #: ``length``, ``span``: (n,) and (m,) s from each instant to the next of its run; 1 s after the last.
    length: FloatArray
    span: FloatArray
    #: ``held``, ``since``: (m,) sample whose value is held at each grid instant, and the time since that sample in s.
    held: IntArray
    since: FloatArray
    same: BoolArray  #: (m,) whether the same sample is held at the next grid instant.

    @classmethod
    def between_grids(cls, times: Sequence[FloatArray], grids: Sequence[FloatArray]) -> Self:
        """From the samples of each run, in s, to its grid."""
        offsets = np.cumsum([0, *map(len, times)])
        latest, since = [], []
        for offset, time, grid in zip(offsets[:-1], times, grids, strict=True):
            before = held_rows(time, grid)
            latest.append(offset + before)
            since.append(grid - time[before])
        held = np.concatenate(latest)
        return cls(
            offsets=offsets,
            grid_offsets=np.cumsum([0, *map(len, grids)]),
            length=np.concatenate([np.append(np.diff(time), 1.0) for time in times]),
            span=np.concatenate([np.append(np.diff(grid), 1.0) for grid in grids]),
            held=held,
            since=np.concatenate(since),
            same=np.append(held[1:] == held[:-1], False),
        )

    def apply(self, series: FloatArray) -> FloatArray:
        """(m,) means of an (n,) ``series`` over each grid interval; its last value at the last grid instant."""
        # Area between the samples that are held at both ends, corrected for the parts before the grid instants.
        area = np.add.reduceat(series * self.length, self.held)
        area[self.same] = 0.0
        area[:-1] += np.diff(series[self.held] * self.since)
        means = area / self.span
        means[self.grid_offsets[1:] - 1] = series[self.offsets[1:] - 1]
        return means


def held_rows(time: FloatArray, grid: FloatArray) -> IntArray:
    """(m,) latest of the (n,) samples ``time`` at each grid instant, whose values are held there; both in s."""
    return np.clip(np.searchsorted(time, grid, side="right") - 1, 0, len(time) - 1)
