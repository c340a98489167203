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
from rovid.estimate.dataset import FitData
from rovid.estimate.interval_means import IntervalMeans, held_rows
from rovid.estimate.restart_grid import HORIZONS, MOST_RESTARTS, RESTARTS, GriddedRun, GriddedRuns, Trajectory, grid_run
from rovid.model.model import Model
from rovid.model.torque_input import TorqueInput
from rovid.signals.rates import resample

# Time constants that a stretch lasts whose errors are taken together.
_BLOCK, _BLOCKS = 8.0, 12
# However long the logs are, what a model's form misses returns in all of them: so many readings are there at most.
_MOST = 200.0


@dataclass(frozen=True, eq=False, kw_only=True)
class MultiStepData(FitData):
    """Predictions of the position from restarts.

    Attributes
    ----------
    time_constant
        s, of the vehicle; its unit of all times here.
    share
        (q,) how much each prediction over a horizon counts, for its neighbours tell much the same.
    """

    time_constant: float
    weights: FloatArray

    means_only: ClassVar[bool] = True

    @classmethod
    def from_data(cls, records: FitData, model: Model) -> Self:
        """With the shares that the errors of ``model`` leave."""
        constant = time_constant(records.initial_model, records.rms_rate)
        fresh = cls(
            runs=records.runs,
            vehicle=records.vehicle,
            initial_model=records.initial_model,
            gyro=records.gyro,
            time_constant=constant,
            weights=np.ones(len(HORIZONS)),
        )
        return fresh.reweighted(model)

    def reweighted(self, model: Model) -> Self:
        """The same with the shares that the errors of ``model`` leave."""
        errors = prediction_errors(self, model, self.torque_between_steps(model))
        return replace(self, weights=_shares(self, errors))

    @property
    def interval(self) -> float:
        """Zero: no reading is passed over."""
        return 0.0

    @cached_property
    def steps(self) -> list[IntArray]:
        """(n,) of each run, which of the log's instants what the grid has is held since."""
        pairs = [(course.run.trial.time, course.time) for course in self.gridded.runs]
        return [held_rows(time, grid) for time, grid in pairs]

    def torque_between_steps(self, model: Model) -> TorqueInput:
        """What drives the runs from each instant that is looked at to the next."""
        return self._driving.between_steps(model)

    def interval_means(self, series: FloatArray) -> FloatArray:
        """(m,) means from each instant of the grids to the next, of an (n,) series at all or at the chosen instants."""
        if len(series) not in self._means:
            at = self._driving.chosen_rows(len(series))
            times = [run.trial.time[here] for run, here in zip(self.runs, at, strict=True)]
            self._means[len(series)] = IntervalMeans.between_grids(times, [course.time for course in self.gridded.runs])
        return self._means[len(series)].apply(series)

    @cached_property
    def _means(self) -> dict[int, IntervalMeans]:
        """By how many instants they are of."""
        whole = self.gridded.interval_means
        return {len(whole.length): whole}

    @cached_property
    def gridded(self) -> GriddedRuns:
        """What was measured of each run."""
        total = sum(float(np.ptp(run.trial.time)) for run in self.runs)
        between = max(RESTARTS * self.time_constant, total / MOST_RESTARTS)
        return GriddedRuns([grid_run(run, self.time_constant, between) for run in self.runs])

    @cached_property
    def innovation_spans(self) -> list[tuple[FloatArray, FloatArray]]:
        """Of each run the (n,) s at which each prediction begins and ends."""
        return [(course.time[course.grid.starts], course.time[course.grid.ends]) for course in self.gridded.runs]

    @cached_property
    def horizon(self) -> IntArray:
        """(N,) index of the horizon of each prediction."""
        return np.concatenate([course.horizon for course in self.gridded.runs])

    @property
    def effective_count(self) -> float:
        """How many predictions count."""
        return float(self.weights[self.horizon].sum())

    @property
    def block_seconds(self) -> float:
        """Length of a stretch whose predictions are taken together."""
        total = sum(float(np.ptp(course.time)) for course in self.gridded.runs)
        return min(_BLOCK * self.time_constant, total / _BLOCKS)


def time_constant(model: Model, rate: float) -> float:
    """Seconds in which a motion at ``rate`` dies out, or a third of a swing to and fro where that is less."""
    slope = 2.0 * model.quadratic_drag * rate + model.linear_drag
    constant = model.inertia / max(slope, 1e-12)
    if model.natural_frequency > 0.0:
        return min(constant, 2.0 / model.natural_frequency)
    return constant


def prediction_errors(records: MultiStepData, model: Model, drive: TorqueInput) -> FloatArray:
    """(N,) predicted less measured position of every prediction, in rad or m, under the ``drive``."""
    from rovid.model.kernels import predict_multi_step

    courses, grid = records.gridded, records.gridded.grid
    if not grid.starts.size:
        return np.empty(0)
    motion = courses.trajectory
    if model.heading_sensor.deviates:
        motion = Trajectory.concatenated([_true_motion(course, model) for course in courses.runs])
    torque = courses.torque if model.actuators.is_plain else records.interval_means(drive.torque)
    beside = _beside(records, drive)
    here = (torque, beside, motion.rate, motion.angle, _states(courses, model, motion, torque, beside))
    start = courses.starts[grid.run]
    moved = predict_multi_step(grid.period, *here, grid.restarts, grid.reach, start, model.body, model.terms)
    ahead = moved[grid.restart_number, grid.ends - grid.starts]
    measured = motion.angle[grid.ends] - motion.angle[grid.starts]
    # What is predicted is the position as it is measured, whatever that deviates by.
    return np.asarray((ahead - measured) * motion.slope[grid.ends])


def _true_motion(course: GriddedRun, model: Model) -> Trajectory:
    """What was measured of it, without the deviation of the heading."""
    trial, rates = course.run.trial, course.run.rates
    true, slopes = model.heading_sensor.to_true(trial.position)
    off = resample(trial, true - trial.position, rates.time)
    every = round(course.period / rates.kernel.period)
    slope = np.interp(course.time, trial.time, slopes)
    return Trajectory.of(course.time, course.angle + off[::every], course.trajectory.rate / slope, slope)


def _beside(records: MultiStepData, drive: TorqueInput) -> FloatArray:
    """(n, m) what acts beside the thrusters, on the grid."""
    beside = np.zeros((len(records.gridded.torque), drive.effect_inputs.shape[1]))
    if not drive.has_effect_inputs:
        return beside
    for column, series in zip(beside.T, drive.effect_inputs.T, strict=True):
        if series.any():
            column[:] = records.interval_means(series)
    return beside


def _states(
    courses: GriddedRuns, model: Model, motion: Trajectory, torque: FloatArray, beside: FloatArray
) -> FloatArray:
    """(n, k * TERM_STATES) of the terms of ``model``, on the grid."""
    from rovid.model.kernels import effects_along

    if not model.terms.remembering:
        return np.zeros((len(torque), 0))
    course = np.column_stack((motion.bridged_rate, motion.angle, torque))
    begins = courses.interval_means.grid_begins
    _, states = effects_along(begins, courses.periods, course, beside, courses.starts, model.body, model.terms)
    return np.asarray(states)


def _shares(records: MultiStepData, errors: FloatArray) -> FloatArray:
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


def _tables(records: MultiStepData, errors: FloatArray) -> list[FloatArray]:
    """Of each run the (restarts, horizons) errors; NaN where there is none."""
    tables, at = [], 0
    for course in records.gridded.runs:
        grid = course.grid
        mine = errors[at : at + len(grid.starts)]
        at += len(grid.starts)
        table = np.full((len(grid.restarts), len(HORIZONS)), np.nan)
        table[grid.restart_number, course.horizon] = mine
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
