"""Multi-step predictions, for models whose errors are too large for one-step predictions.

The position is predicted from many restarts over horizons from half to eight time constants of the vehicle. Short
horizons resemble one-step predictions, long ones the free-running simulation. Restarts remove drift, and waves average
out. Each horizon has its own error variance, so all horizons count alike.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar, Self

import numpy as np

from rovid.core.array_types import FloatArray, IntArray
from rovid.estimate.dataset import FitData, time_constant
from rovid.estimate.restart_grid import (
    HORIZONS,
    MAX_RESTARTS,
    RESTARTS,
    GriddedRun,
    IntervalMeans,
    RestartGrid,
    Trajectory,
    held_rows,
)
from rovid.model.model import Model
from rovid.signals.rates import resample

# Length of a block in time constants, and the least number of blocks.
_BLOCK, _BLOCKS = 8.0, 12
# Largest effective number of predictions. The errors of an incomplete model recur however long the logs are.
_MAX_COUNT = 200.0


@dataclass(frozen=True, eq=False, kw_only=True)
class MultiStepData(FitData):
    """Data of the multi-step likelihood: predictions of the position from restarts."""

    time_constant: float  #: Time constant of the vehicle in s, the unit of horizons.
    #: (q,) weight of the predictions over each horizon; below 1 because neighbouring predictions are correlated.
    weights: FloatArray

    means_only: ClassVar[bool] = True

    @classmethod
    def from_data(cls, data: FitData, model: Model) -> Self:
        """Predictions along the runs of ``data``, weighted by the correlation of the errors of ``model``."""
        fresh = cls(
            runs=data.runs,
            vehicle=data.vehicle,
            initial_model=data.initial_model,
            gyro=data.gyro,
            time_constant=time_constant(data.initial_model, data.rms_rate),
            weights=np.ones(len(HORIZONS)),
        )
        return fresh.reweighted(model)

    def reweighted(self, model: Model) -> Self:
        """The same predictions, weighted by the correlation of the errors of ``model``."""
        return replace(self, weights=_weights(self.gridded_runs, prediction_errors(self, model)))

    @cached_property
    def steps(self) -> list[IntArray]:
        """For each run, the (n,) samples that are held at the grid instants."""
        return [held_rows(gridded.run.trial.time, gridded.time) for gridded in self.gridded_runs]

    @cached_property
    def gridded_runs(self) -> list[GriddedRun]:
        """Measured motion of each run on its grid."""
        total = sum(float(np.ptp(run.trial.time)) for run in self.runs)
        apart = max(RESTARTS * self.time_constant, total / MAX_RESTARTS)
        return [GriddedRun.of(run, self.time_constant, apart) for run in self.runs]

    @cached_property
    def grid(self) -> RestartGrid:
        """Predictions of all runs."""
        return RestartGrid.of(self.gridded_runs)

    @cached_property
    def trajectory(self) -> Trajectory:
        """Measured motion of all runs, one after the other."""
        return Trajectory.concatenated([gridded.trajectory for gridded in self.gridded_runs])

    @cached_property
    def torque(self) -> FloatArray:
        """(m,) mean torque by the bench curves over each grid interval, N m."""
        return self.interval_means(np.concatenate([run.torque for run in self.runs]))

    @cached_property
    def first_positions(self) -> FloatArray:
        """(r,) first measured position of each run, rad or m."""
        return np.array([run.trial.first_position for run in self.runs])

    def interval_means(self, series: FloatArray) -> FloatArray:
        """(m,) means over the grid intervals, of an (n,) series at all samples or at the chosen ones."""
        count = len(series)
        if count not in self._interval_means:
            times = [run.trial.time for run in self.runs]
            if count != sum(map(len, times)):
                chosen = self.inputs.chosen_rows[count]
                times = [time[rows] for time, rows in zip(times, chosen, strict=True)]
            grids = [gridded.time for gridded in self.gridded_runs]
            self._interval_means[count] = IntervalMeans.between_grids(times, grids)
        return self._interval_means[count].apply(series)

    @cached_property
    def _interval_means(self) -> dict[int, IntervalMeans]:
        """By the number of samples of the series."""
        return {}

    @cached_property
    def innovation_spans(self) -> list[tuple[FloatArray, FloatArray]]:
        """For each run, the (n,) s at which each prediction begins and ends."""
        return [(gridded.time[gridded.starts], gridded.time[gridded.ends]) for gridded in self.gridded_runs]

    @cached_property
    def horizon(self) -> IntArray:
        """(N,) index of the horizon of each prediction."""
        return np.concatenate([gridded.horizon for gridded in self.gridded_runs])

    @property
    def effective_count(self) -> float:
        """Number of independent predictions."""
        return float(self.weights[self.horizon].sum())

    @property
    def block_seconds(self) -> float:
        """Length in s of a block, within which predictions may be correlated."""
        total = sum(float(np.ptp(gridded.time)) for gridded in self.gridded_runs)
        return min(_BLOCK * self.time_constant, total / _BLOCKS)


def prediction_errors(data: MultiStepData, model: Model) -> FloatArray:
    """(N,) predicted minus measured position at the end of every prediction, in rad or m."""
    from rovid.model.kernels import predict_multi_step

    grid = data.grid
    if not grid.starts.size:
        return np.empty(0)
    measured = data.trajectory
    if model.heading_sensor.deviates:
        measured = Trajectory.concatenated([_true_trajectory(gridded, model) for gridded in data.gridded_runs])
    torque_input = data.inputs.between_steps(model)
    torque = data.torque if model.actuators.is_plain else data.interval_means(torque_input.torque)
    effect_inputs = np.zeros((len(torque), torque_input.effect_inputs.shape[1]))
    if torque_input.has_effect_inputs:
        for column, series in zip(effect_inputs.T, torque_input.effect_inputs.T, strict=True):
            if series.any():
                column[:] = data.interval_means(series)
    predicted = predict_multi_step(
        grid.period,
        torque,
        effect_inputs,
        measured.rate,
        measured.angle,
        _term_states(data, model, measured, torque, effect_inputs),
        grid.restarts,
        grid.reach,
        data.first_positions[grid.run],
        model.body,
        model.terms,
    )[grid.restart_number, grid.ends - grid.starts]
    # The likelihood is that of the measured position, including the sensor's deviation.
    error = predicted - (measured.angle[grid.ends] - measured.angle[grid.starts])
    return np.asarray(error * measured.slope[grid.ends])


def _true_trajectory(gridded: GriddedRun, model: Model) -> Trajectory:
    """Measured motion of a run without the deviation of the heading sensor."""
    trial, rates = gridded.run.trial, gridded.run.rates
    true, slopes = model.heading_sensor.to_true(trial.position)
    correction = resample(trial, true - trial.position, rates.time)[:: gridded.stride]
    slope = np.interp(gridded.time, trial.time, slopes)
    rate = gridded.trajectory.rate if rates.from_gyro else gridded.trajectory.rate / slope
    return Trajectory.of(gridded.time, gridded.angle + correction, rate, slope)


def _term_states(
    data: MultiStepData, model: Model, measured: Trajectory, torque: FloatArray, effect_inputs: FloatArray
) -> FloatArray:
    """(m, k * TERM_STATES) states of the terms of ``model`` along the measured motion."""
    from rovid.model.kernels import effects_along

    if not model.terms.stateful:
        return np.zeros((len(torque), 0))
    motion = np.column_stack((measured.bridged_rate, measured.angle, torque))
    runs = data.gridded_runs
    offsets = np.cumsum([0, *(len(gridded.time) for gridded in runs)])
    periods = np.array([gridded.period for gridded in runs])
    start = data.first_positions
    return np.asarray(effects_along(offsets, periods, motion, effect_inputs, start, model.body, model.terms)[1])


def _weights(runs: Sequence[GriddedRun], errors: FloatArray) -> FloatArray:
    """(q,) weight of the predictions over each horizon.

    One over twice the integral of the autocorrelation between neighbouring predictions, times the share of the horizons
    that are independent of each other; docs/method.md, "Multi-step predictions".
    """
    tables, begin = [], 0
    for run in runs:
        restarts, number = run.restarts
        table = np.full((len(restarts), len(HORIZONS)), np.nan)
        table[number, run.horizon] = errors[begin : begin + len(number)]
        tables.append(table)
        begin += len(number)
    weights, counts = np.zeros(len(HORIZONS)), np.zeros(len(HORIZONS))
    for horizon in range(len(HORIZONS)):
        series = [table[:, horizon] for table in tables]
        counts[horizon] = sum(np.isfinite(one).sum() for one in series)
        weights[horizon] = 1.0 / (2.0 * _correlation_length(series))
    independent = _independent_share(np.concatenate(tables))
    count = float(weights @ counts) * independent
    return weights * independent / (1.0 + count / _MAX_COUNT)


def _correlation_length(series: Sequence[FloatArray]) -> float:
    """Integral of the autocorrelation to its first zero, in restarts; 0.5 for uncorrelated errors."""
    longest = max((len(one) for one in series), default=0)
    total, power = np.zeros(max(longest, 1)), 0.0
    for one in series:
        known = one[np.isfinite(one)]
        if not known.size:
            continue
        products = np.correlate(known, known, mode="full")[len(known) - 1 :]
        total[: len(products)] += products
        power += products[0]
    if power <= 0.0:
        return 0.5
    correlation = total / power
    crossing = int(np.argmax(correlation <= 0.0)) or len(correlation)
    return float(0.5 + correlation[1:crossing].sum())


def _independent_share(table: FloatArray) -> float:
    """Effective number of independent horizons over their number, by the eigenvalues' participation ratio.

    ``table`` is (restarts, horizons) errors, NaN where there is no prediction.
    """
    known = np.isfinite(table).any(axis=0)
    table = table[:, known]
    if table.shape[1] < 2:
        return 1.0
    size = np.sqrt(np.nanmean(table**2, axis=0))
    scaled = np.nan_to_num(table / np.maximum(size, 1e-300))
    paired = np.isfinite(table).astype(float)
    correlation = (scaled.T @ scaled) / np.maximum(paired.T @ paired, 1.0)
    return float(np.trace(correlation) ** 2 / np.sum(correlation**2) / len(correlation))
