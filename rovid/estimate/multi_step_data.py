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
from typing import ClassVar, Self

import numpy as np

from rovid.core.array_types import FloatArray, IntArray
from rovid.estimate.dataset import Records
from rovid.estimate.interval_means import Means, held_since
from rovid.estimate.restart_grid import HORIZONS, MOST_RESTARTS, RESTARTS, Course, Courses, Motion, course_of
from rovid.model.model import Model
from rovid.model.torque_input import Drive
from rovid.signals.rates import on_grid

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

    means_alone: ClassVar[bool] = True

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
        errors = predictions(self, model, self.drives_between(model))
        return replace(self, share=_shares(self, errors))

    @property
    def interval(self) -> float:
        """Zero: no reading is passed over."""
        return 0.0

    @cached_property
    def steps(self) -> list[IntArray]:
        """(n,) of each run, which of the log's instants what the grid has is held since."""
        pairs = [(course.run.trial.time, course.time) for course in self.courses.each]
        return [held_since(time, grid) for time, grid in pairs]

    def drives_between(self, model: Model) -> Drive:
        """What drives the runs from each instant that is looked at to the next."""
        return self._driving.between_steps(model)

    def means(self, series: FloatArray) -> FloatArray:
        """(m,) means from each instant of the grids to the next, of an (n,) series at all or at the chosen instants."""
        if len(series) not in self._means:
            at = self._driving.chosen(len(series))
            times = [run.trial.time[here] for run, here in zip(self.runs, at, strict=True)]
            self._means[len(series)] = Means.onto(times, [course.time for course in self.courses.each])
        return self._means[len(series)].of(series)

    @cached_property
    def _means(self) -> dict[int, Means]:
        """By how many instants they are of."""
        whole = self.courses.means
        return {len(whole.length): whole}

    @cached_property
    def courses(self) -> Courses:
        """What was measured of each run."""
        total = sum(float(np.ptp(run.trial.time)) for run in self.runs)
        between = max(RESTARTS * self.time_constant, total / MOST_RESTARTS)
        return Courses([course_of(run, self.time_constant, between) for run in self.runs])

    @cached_property
    def spans(self) -> list[tuple[FloatArray, FloatArray]]:
        """Of each run the (n,) s at which each prediction begins and ends."""
        return [(course.time[course.grid.starts], course.time[course.grid.ends]) for course in self.courses.each]

    @cached_property
    def horizon(self) -> IntArray:
        """(N,) index of the horizon of each prediction."""
        return np.concatenate([course.horizon for course in self.courses.each])

    @property
    def readings(self) -> float:
        """How many predictions count."""
        return float(self.share[self.horizon].sum())

    @property
    def block_seconds(self) -> float:
        """Length of a stretch whose predictions are taken together."""
        total = sum(float(np.ptp(course.time)) for course in self.courses.each)
        return min(_BLOCK * self.time_constant, total / _BLOCKS)


def time_constant(model: Model, rate: float) -> float:
    """Seconds in which a motion at ``rate`` dies out, or a third of a swing to and fro where that is less."""
    slope = 2.0 * model.quadratic_drag * rate + model.linear_drag
    constant = model.inertia / max(slope, 1e-12)
    if model.swing > 0.0:
        return min(constant, 2.0 / model.swing)
    return constant


def predictions(records: HorizonRecords, model: Model, drive: Drive) -> FloatArray:
    """(N,) predicted less measured position of every prediction, in rad or m, under the ``drive``."""
    from rovid.model.kernels import predict

    courses, grid = records.courses, records.courses.grid
    if not grid.starts.size:
        return np.empty(0)
    motion = courses.motion
    if model.instrument.deviates:
        motion = Motion.joined([_true_motion(course, model) for course in courses.each])
    torque = courses.torque if model.drivetrain.is_plain else records.means(drive.torque)
    beside = _beside(records, drive)
    here = (torque, beside, motion.rate, motion.turned, _states(courses, model, motion, torque, beside))
    start = courses.starts[grid.run]
    moved = predict(grid.period, *here, grid.restarts, grid.reach, start, model.body, model.terms)
    ahead = moved[grid.number, grid.ends - grid.starts]
    measured = motion.turned[grid.ends] - motion.turned[grid.starts]
    # What is predicted is the position as it is measured, whatever that deviates by.
    return np.asarray((ahead - measured) * motion.slope[grid.ends])


def _true_motion(course: Course, model: Model) -> Motion:
    """What was measured of it, without the deviation of the heading."""
    trial, rates = course.run.trial, course.run.rates
    true, slopes = model.instrument.as_true(trial.position)
    off = on_grid(trial, true - trial.position, rates.time)
    every = round(course.period / rates.kernel.period)
    slope = np.interp(course.time, trial.time, slopes)
    return Motion.of(course.time, course.angle + off[::every], course.motion.rate / slope, slope)


def _beside(records: HorizonRecords, drive: Drive) -> FloatArray:
    """(n, m) what acts beside the thrusters, on the grid."""
    beside = np.zeros((len(records.courses.torque), drive.beside.shape[1]))
    if not drive.is_told:
        return beside
    for column, series in zip(beside.T, drive.beside.T, strict=True):
        if series.any():
            column[:] = records.means(series)
    return beside


def _states(courses: Courses, model: Model, motion: Motion, torque: FloatArray, beside: FloatArray) -> FloatArray:
    """(n, k * TERM_STATES) of the terms of ``model``, on the grid."""
    from rovid.model.kernels import effects_along

    if not model.terms.remembering:
        return np.zeros((len(torque), 0))
    course = np.column_stack((motion.moving, motion.turned, torque))
    begins = courses.means.grid_begins
    _, states = effects_along(begins, courses.periods, course, beside, courses.starts, model.body, model.terms)
    return np.asarray(states)


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
    for course in records.courses.each:
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
