"""Predictions some time ahead, for models that miss too much to be judged by the next reading.

A user means by a wrong model that it predicts a wrong heading some time ahead. So the position is predicted from many
restarts over horizons from half to eight time constants of the vehicle. Short horizons say much the same as the next
reading, long ones as the free run; a restart takes away what drifts, and waves average out. Each horizon counts alike,
whatever the size of its errors: theirs are the logarithms of mean squares that are added.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple, Self

import numpy as np

from rovid.ground.arrays import FloatArray, IntArray
from rovid.identify.courses import HORIZONS, MOST_RESTARTS, RESTARTS, Course, Grid, course_of, means_on, motion_of
from rovid.identify.records import Records
from rovid.model.drive import Drive
from rovid.model.integration import along
from rovid.model.model import Model
from rovid.motion.rates import on_grid

# Time constants that a stretch lasts whose errors are taken together.
_BLOCK, _BLOCKS = 8.0, 12
# However long the logs are, what a model's form misses returns in all of them: so many readings are there at most.
_MOST = 200.0


@dataclass(frozen=True, eq=False, kw_only=True)
class HorizonRecords(Records):
    """Predictions of the position from restarts.

    Attributes
    ----------
    time_constant
        s, of the vehicle; its unit of all times here.
    share
        (q,) how much each prediction over a horizon counts, for its neighbours tell much the same.
    """

    time_constant: float
    share: FloatArray

    @classmethod
    def of(cls, records: Records, model: Model) -> Self:
        """With the shares that the errors of ``model`` leave."""
        constant = time_constant(records.start, records.rate)
        fresh = cls(
            runs=records.runs,
            vehicle=records.vehicle,
            start=records.start,
            gyro=records.gyro,
            time_constant=constant,
            share=np.ones(len(HORIZONS)),
        )
        return fresh.counting(model)

    def counting(self, model: Model) -> Self:
        """The same with the shares that the errors of ``model`` leave."""
        errors = predictions(self, model, self.drives(model))
        return replace(self, share=_shares(self, errors))

    @property
    def interval(self) -> float:
        """Zero: no reading is passed over."""
        return 0.0

    @property
    def steps(self) -> None:
        """None: all instants are looked at."""
        return None

    @cached_property
    def courses(self) -> list[Course]:
        """What was measured of each run."""
        total = sum(float(np.ptp(run.trial.time)) for run in self.runs)
        between = max(RESTARTS * self.time_constant, total / MOST_RESTARTS)
        return [course_of(run, self.time_constant, between) for run in self.runs]

    @cached_property
    def grid(self) -> Grid:
        """Where all predictions begin and end, the runs one after the other."""
        return Grid.joined(self.courses)

    @cached_property
    def spans(self) -> list[tuple[FloatArray, FloatArray]]:
        """Of each run the (n,) s at which each prediction begins and ends."""
        return [(course.time[course.grid.starts], course.time[course.grid.ends]) for course in self.courses]

    @cached_property
    def horizon(self) -> IntArray:
        """(N,) index of the horizon of each prediction."""
        return np.concatenate([course.horizon for course in self.courses])

    @property
    def readings(self) -> float:
        """How many predictions count."""
        return float(self.share[self.horizon].sum())

    @property
    def block_seconds(self) -> float:
        """Length of a stretch whose predictions are taken together."""
        total = sum(float(np.ptp(course.time)) for course in self.courses)
        return min(_BLOCK * self.time_constant, total / _BLOCKS)


def time_constant(model: Model, rate: float) -> float:
    """Seconds in which a motion at ``rate`` dies out, or a third of a swing to and fro where that is less."""
    slope = 2.0 * model.quadratic_drag * rate + model.linear_drag
    constant = model.inertia / max(slope, 1e-12)
    if model.swing > 0.0:
        return min(constant, 2.0 / model.swing)
    return constant


def predictions(records: HorizonRecords, model: Model, drives: Sequence[Drive]) -> FloatArray:
    """(N,) predicted less measured position of every prediction, in rad or m."""
    from rovid.model.kernels import predict

    courses, grid = records.courses, records.grid
    if not grid.starts.size:
        return np.empty(0)
    followed = [_followed(course, model, drive) for course, drive in zip(courses, drives, strict=True)]
    torque, beside, rate, turned, states, slope = (np.concatenate(series) for series in zip(*followed, strict=True))
    start = np.array([model.equation_in(course.run.trial).start for course in courses])[grid.run]
    here = (torque, beside, rate, np.nan_to_num(turned), states)
    moved = predict(grid.period, *here, grid.restarts, grid.reach, start, model.body, model.terms)
    ahead = moved[grid.number, grid.ends - grid.starts]
    measured = turned[grid.ends] - turned[grid.starts]
    # What is predicted is the position as it is measured, whatever that deviates by.
    return np.asarray((ahead - measured) * slope[grid.ends])


class _Followed(NamedTuple):
    """What a model makes of a course, as `rovid.model.kernels.predict` takes it.

    ``slope`` is the measured angle's by the true.
    """

    torque: FloatArray
    beside: FloatArray
    rate: FloatArray
    turned: FloatArray
    states: FloatArray
    slope: FloatArray


def _followed(course: Course, model: Model, drive: Drive) -> _Followed:
    trial, time = course.run.trial, course.time
    turned, moving, rate, slope = course.turned, course.moving, course.rate, np.ones(len(time))
    if model.instrument.deviates:
        true, slopes = model.instrument.true_angle(trial, trial.position, np.arange(len(trial.time)))
        off = on_grid(trial, true - trial.position, course.run.rates.time)
        every = round(course.period / course.run.rates.kernel.period)
        slope = np.interp(time, trial.time, slopes)
        rate = course.rate / slope
        turned, moving = motion_of(time, course.angle + off[::every], rate)
    torque, beside = course.torque, _beside(course, drive)
    if not model.drivetrain.is_plain:
        torque = means_on(trial.time, drive.torque, time, course.held, course.since)
    states = np.zeros((len(time), 0))
    if model.terms.remembering:
        _, states = along(model.equation_in(trial), course.period, (moving, turned, torque), beside)
    return _Followed(torque, beside, rate, turned, states, slope)


def _beside(course: Course, drive: Drive) -> FloatArray:
    """(n, m) what acts beside the thrusters, on the grid."""
    beside = np.zeros((len(course.time), drive.beside.shape[1]))
    for column, series in zip(beside.T, drive.beside.T, strict=True):
        if series.any():
            column[:] = means_on(course.run.trial.time, series, course.time, course.held, course.since)
    return beside


def _shares(records: HorizonRecords, errors: FloatArray) -> FloatArray:
    """(q,) how much each prediction counts: neighbours in time, and horizons from one restart, tell much the same."""
    count = len(HORIZONS)
    share, readings = np.zeros(count), np.zeros(count)
    tables = _tables(records, errors)
    for number in range(count):
        series = [table[:, number] for table in tables]
        readings[number] = sum(np.isfinite(one).sum() for one in series)
        share[number] = 1.0 / (2.0 * _memory(series))
    together = _alike(np.concatenate(tables))
    independent = float(share @ readings) * together
    return share * together / (1.0 + independent / _MOST)


def _tables(records: HorizonRecords, errors: FloatArray) -> list[FloatArray]:
    """Of each run the (restarts, horizons) errors; NaN where there is none."""
    tables, at = [], 0
    for course in records.courses:
        grid = course.grid
        mine = errors[at : at + len(grid.starts)]
        at += len(grid.starts)
        table = np.full((len(grid.restarts), len(HORIZONS)), np.nan)
        table[grid.number, course.horizon] = mine
        tables.append(table)
    return tables


def _memory(series: Sequence[FloatArray]) -> float:
    """Integral of the autocorrelation up to where it first vanishes, in restarts; a half where there is none."""
    longest = max((len(one) for one in series), default=0)
    total, square = np.zeros(max(longest, 1)), 0.0
    for one in series:
        known = one[np.isfinite(one)]
        if not known.size:
            continue
        full = np.correlate(known, known, mode="full")[len(known) - 1 :]
        total[: len(full)] += full
        square += full[0]
    if square <= 0.0:
        return 0.5
    ratio = total / square
    crossing = int(np.argmax(ratio <= 0.0)) or len(ratio)
    return float(0.5 + ratio[1:crossing].sum())


def _alike(table: FloatArray) -> float:
    """Share of the horizons that are told by themselves: the participation ratio of their correlations' eigenvalues."""
    known = np.isfinite(table).any(axis=0)
    table = table[:, known]
    if table.shape[1] < 2:
        return 1.0
    usual = np.sqrt(np.nanmean(table**2, axis=0))
    scaled = np.nan_to_num(table / np.maximum(usual, 1e-300))
    paired = np.isfinite(table).astype(float)
    matrix = (scaled.T @ scaled) / np.maximum(paired.T @ paired, 1.0)
    return float(np.trace(matrix) ** 2 / np.sum(matrix**2) / len(matrix))
