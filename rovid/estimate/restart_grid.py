"""Runs on a grid, and where predictions begin and end."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple, Self

import numpy as np

from rovid.core.array_types import FloatArray, IntArray
from rovid.effects.actuator_inputs import interpolate_gaps
from rovid.estimate.interval_means import IntervalMeans
from rovid.signals.preprocessing import Run
from rovid.signals.rates import resample

# How far ahead, in time constants of the vehicle.
HORIZONS = (0.5, 1.0, 2.0, 4.0, 8.0)
# Restarts for a horizon are a quarter of it apart, and no less than so many time constants; those for a longer one are
# among those for a shorter. Drives and courses are followed on a grid.
RESTARTS, GRID = 0.25, 0.1
# Nor are there more of them than so many: with their horizons they are more than the readings that may count.
MOST_RESTARTS = 300


@dataclass(frozen=True, kw_only=True, eq=False)
class RestartGrid:
    """Where predictions begin and end, on the grid of one run or on those of several, one after the other.

    Attributes
    ----------
    starts, ends
        (N,) indices of the restart and of the end of each prediction.
    restarts, reach, number
        (m,) indices of the restarts, each once, and the steps to the farthest end from each; (N,) which of them is that
        of each prediction.
    run, period
        (m,) index of the run of each restart, and s from each instant of its grid to the next.
    """

    starts: IntArray
    ends: IntArray
    restarts: IntArray
    reach: IntArray
    restart_number: IntArray
    run: IntArray
    period: FloatArray

    @classmethod
    def concatenated(cls, courses: Sequence[GriddedRun]) -> Self:
        """Those of all ``courses``."""
        starts, ends, restarts, number, run = [], [], [], [], []
        # How many instants, and how many restarts, there are in the runs before.
        before = earlier = 0
        for k, course in enumerate(courses):
            grid = course.grid
            starts.append(grid.starts + before)
            ends.append(grid.ends + before)
            restarts.append(grid.restarts + before)
            number.append(grid.restart_number + earlier)
            run.append(np.full(len(grid.restarts), k))
            before += len(course.time)
            earlier += len(grid.restarts)
        return cls(
            starts=np.concatenate(starts),
            ends=np.concatenate(ends),
            restarts=np.concatenate(restarts),
            reach=np.concatenate([course.grid.reach for course in courses]),
            restart_number=np.concatenate(number),
            run=np.concatenate(run),
            period=np.concatenate([course.grid.period for course in courses]),
        )

    def sorted_by_reach(self) -> Self:
        """The same with the restarts that reach farthest first: those beside each other end together."""
        order = np.argsort(-self.reach, kind="stable")
        place = np.empty_like(order)
        place[order] = np.arange(len(order))
        return replace(
            self,
            restarts=self.restarts[order],
            reach=self.reach[order],
            restart_number=place[self.restart_number],
            run=self.run[order],
            period=self.period[order],
        )


class Trajectory(NamedTuple):
    """(n,) how a vehicle moved, on the grid of one run or on those of several, one after the other.

    ``rate`` is NaN where the filter has none, and ``moving`` the same bridged by the angle's slope: at the ends of a
    trial the water already moves. ``turned`` is the angle since the first known one, with straight lines through its
    gaps. ``slope`` is the measured angle's by the true.
    """

    rate: FloatArray
    bridged_rate: FloatArray
    angle: FloatArray
    slope: FloatArray

    @classmethod
    def of(cls, time: FloatArray, angle: FloatArray, rate: FloatArray, slope: FloatArray) -> Self:
        """Of one run, by its (n,) angle and rate at instants in s."""
        turned = angle - angle[int(np.argmax(np.isfinite(angle)))]
        moving = rate
        if len(time) > 1:
            moving = np.where(np.isfinite(rate), rate, np.gradient(turned, time[1] - time[0]))
        return cls(rate, interpolate_gaps(moving), interpolate_gaps(turned), slope)

    @classmethod
    def concatenated(cls, each: Sequence[Self]) -> Self:
        """Of several runs."""
        return cls(*(np.concatenate(series) for series in zip(*each, strict=True)))


@dataclass(frozen=True, kw_only=True, eq=False)
class GriddedRun:
    """What was measured of one run, on a grid.

    Attributes
    ----------
    time
        (n,) s.
    angle
        (n,) about the body's axis, as measured; NaN where not known.
    motion
        What was measured of it.
    horizon
        (N,) index of the horizon of each prediction.
    grid
        Where predictions begin and end.
    """

    run: Run
    time: FloatArray
    angle: FloatArray
    trajectory: Trajectory
    horizon: IntArray
    grid: RestartGrid

    @property
    def period(self) -> float:
        """Seconds from each instant to the next."""
        if len(self.time) < 2:
            return self.run.rates.kernel.period
        return float(self.time[1] - self.time[0])


@dataclass(frozen=True, eq=False)
class GriddedRuns:
    """Those of some runs, and what was measured in all of them, one after the other."""

    runs: Sequence[GriddedRun]

    @cached_property
    def grid(self) -> RestartGrid:
        """Where all predictions begin and end."""
        return RestartGrid.concatenated(self.runs).sorted_by_reach()

    @cached_property
    def trajectory(self) -> Trajectory:
        """What was measured of it."""
        return Trajectory.concatenated([course.trajectory for course in self.runs])

    @cached_property
    def interval_means(self) -> IntervalMeans:
        """From series that are held between the instants of the logs to those of the grids."""
        return IntervalMeans.between_grids(
            [course.run.trial.time for course in self.runs], [course.time for course in self.runs]
        )

    @cached_property
    def torque(self) -> FloatArray:
        """(n,) N m, mean from each instant to the next, of the thrusters by their bench curves."""
        return self.interval_means.apply(np.concatenate([course.run.torque for course in self.runs]))

    @cached_property
    def periods(self) -> FloatArray:
        """(r,) s from each instant of a run's grid to the next."""
        return np.array([course.period for course in self.runs])

    @cached_property
    def starts(self) -> FloatArray:
        """(r,) rad or m; the first position of each run that was measured."""
        return np.array([course.run.trial.first_position for course in self.runs])


def grid_run(run: Run, constant: float, between: float) -> GriddedRun:
    """``constant`` and the time ``between`` restarts in s."""
    rates, trial = run.rates, run.trial
    every = max(round(GRID * constant / rates.kernel.period), 1)
    time = rates.time[::every]
    angle = resample(trial, trial.body_position, rates.time)[::every]
    rate = rates.rate[::every]
    period = every * rates.kernel.period
    start, end, horizon = _predictions(angle, rate, period, constant, between)
    return GriddedRun(
        run=run,
        time=time,
        angle=angle,
        trajectory=Trajectory.of(time, angle, rate, np.ones(len(time))),
        horizon=horizon,
        grid=_grid(start, end, period),
    )


def _predictions(
    angle: FloatArray, rate: FloatArray, period: float, constant: float, between: float
) -> tuple[IntArray, IntArray, IntArray]:
    """(N,) where each prediction begins and ends on the grid, and the index of its horizon.

    ``period`` from each instant of it to the next, the time ``constant`` and the time ``between`` restarts are in s.
    """
    known = np.isfinite(angle)
    # How many instants before each are not known: none more at the end than at the start where a stretch is whole.
    gaps = np.concatenate(([0], np.cumsum(~known)))
    restarts = np.flatnonzero(np.isfinite(rate) & known)
    steps = max(round(between / period), 1)
    starts, ends, horizons = [], [], []
    for number, horizon in enumerate(HORIZONS):
        length = max(round(horizon * constant / period), 1)
        apart = steps * max(round(0.25 * horizon / RESTARTS), 1)
        first = restarts[(restarts % apart == 0) & (restarts + length < len(angle))]
        # How far the vehicle turned inside a gap is not measured.
        whole = first[gaps[first + length + 1] == gaps[first]]
        starts.append(whole)
        ends.append(whole + length)
        horizons.append(np.full(len(whole), number))
    return np.concatenate(starts), np.concatenate(ends), np.concatenate(horizons)


def _grid(start: IntArray, end: IntArray, period: float) -> RestartGrid:
    """Of the predictions of one run, by their (N,) starts and ends; ``period`` in s from each instant to the next."""
    restarts, number = np.unique(start, return_inverse=True)
    reach = np.zeros(len(restarts), dtype=np.intp)
    np.maximum.at(reach, number, end - start)
    return RestartGrid(
        starts=start,
        ends=end,
        restarts=restarts,
        reach=reach,
        restart_number=number,
        run=np.zeros(len(restarts), dtype=np.intp),
        period=np.full(len(restarts), period),
    )
