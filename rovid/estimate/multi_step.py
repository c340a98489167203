"""Multi-step predictions and their likelihood, for models whose errors are too large for one-step predictions.

The position is predicted from many restarts over horizons from half to eight time constants of the vehicle. Short
horizons resemble one-step predictions, long ones the free-running simulation. Restarts remove drift, and waves average
out. Each horizon has its own error variance, so all horizons count alike.
"""

import math
from collections.abc import Hashable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar, Self

import numpy as np

from rovid.core.array_types import FloatArray, IntArray
from rovid.core.threads import thread_map
from rovid.effects.base import Term
from rovid.estimate.dataset import NOISE_FLOOR, FitData, time_constant
from rovid.estimate.fisher_information import Innovations
from rovid.estimate.objective import NegativeLogLikelihood
from rovid.estimate.parametrization import DISTURBANCE, NOISE, Parametrization
from rovid.estimate.restart_grid import (
    GRID,
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
from rovid.model.simulation import filtered_input, terms_along
from rovid.trial.rates import resample
from rovid.trial.vehicle import Vehicle

# Length of a block in time constants, and the least number of blocks.
_BLOCK, _BLOCKS = 8.0, 12
# Largest effective number of predictions. The errors of an incomplete model recur however long the logs are.
_MAX_COUNT = 200.0
# Least number of predictions over a horizon, but the shortest: the parameters could fit a few predictions exactly, and
# their mean square, which is the variance, would vanish. Twice the parameters of a model with one or two effects.
_MIN_PREDICTIONS = 12
# Index of the horizon between short and long ones.
_MIDDLE = len(HORIZONS) // 2
# Error of a model that diverges, over the scale of positions: large, but finite.
_DIVERGED = 1e6


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
        return [np.unique(held_rows(gridded.run.trial.time, gridded.time)) for gridded in self.gridded_runs]

    @cached_property
    def gridded_runs(self) -> list[GriddedRun]:
        """Measured motion of each run on its grid, with the horizons that all runs together have enough of."""
        total = sum(float(np.ptp(run.trial.time)) for run in self.runs)
        apart = max(RESTARTS * self.time_constant, total / MAX_RESTARTS)
        runs = [GriddedRun.of(run, self.time_constant, apart) for run in self.runs]
        counts = np.bincount(np.concatenate([run.horizon for run in runs]), minlength=len(HORIZONS))
        kept = np.flatnonzero((counts >= _MIN_PREDICTIONS) | (np.arange(len(HORIZONS)) == 0))
        return [run.over(kept) for run in runs]

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
                times = [time[rows] for time, rows in zip(times, self.inputs.chosen_rows[count], strict=True)]
            self._interval_means[count] = IntervalMeans.between_grids(times, [one.time for one in self.gridded_runs])
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


def prediction_errors(data: MultiStepData, model: Model, first_states: FloatArray | None = None) -> FloatArray:
    """(N,) predicted minus measured position at the end of every prediction, in rad or m.

    ``first_states``: (r, m * TERM_STATES) states of the terms at the first sample of each run; zeros by default.
    """
    from rovid.model.kernels import effects_along, predict_multi_step

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
    # (m, k * TERM_STATES) states of the terms along the measured motion.
    states, first = np.zeros((len(torque), 0)), data.first_positions
    if model.terms.stateful:
        motion = np.column_stack((measured.bridged_rate, measured.angle, torque))
        offsets = np.cumsum([0, *(len(gridded.time) for gridded in data.gridded_runs)])
        periods = np.array([gridded.period for gridded in data.gridded_runs])
        known = motion, effect_inputs, first, model.body, model.terms, first_states
        states = effects_along(offsets, periods, *known)[1]
    course = torque, effect_inputs, measured.rate, measured.angle, states
    restarts = grid.restarts, grid.reach, first[grid.run]
    turned = predict_multi_step(grid.period, *course, *restarts, model.body, model.terms)
    predicted = turned[grid.restart_number, grid.ends - grid.starts]
    # The likelihood is that of the measured position, including the sensor's deviation.
    error = predicted - (measured.angle[grid.ends] - measured.angle[grid.starts])
    return np.asarray(error * measured.slope[grid.ends])


def states_at_starts(data: MultiStepData, model: Model, vehicle: Vehicle) -> FloatArray | None:
    """(r, m * TERM_STATES) states of the terms at the first sample of each run, as the measured motion shows them."""
    if not model.terms.stateful:
        return None
    found = []
    for one in data.gridded_runs:
        held = filtered_input(one.run, model, vehicle)
        motion = one.trajectory.bridged_rate, one.trajectory.angle
        found.append(terms_along(one.run, model, vehicle, held, motion, one.stride)[1])
    return np.array(found)


def _true_trajectory(gridded: GriddedRun, model: Model) -> Trajectory:
    """Measured motion of a run without the deviation of the heading sensor."""
    trial, rates = gridded.run.trial, gridded.run.rates
    true, slopes = model.heading_sensor.to_true(trial.position)
    correction = resample(trial, true - trial.position, rates.time)[:: gridded.stride]
    slope = np.interp(gridded.time, trial.time, slopes)
    rate = gridded.trajectory.rate if rates.from_gyro else gridded.trajectory.rate / slope
    return Trajectory.of(gridded.time, gridded.angle + correction, rate, slope)


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


@dataclass(frozen=True, eq=False)
class MultiStepLikelihood(NegativeLogLikelihood):
    """Negative log-likelihood of multi-step predictions of the position; docs/method.md, (16).

    The variance of each horizon is the mean square of its errors. So the coordinates of the disturbance and of the
    noise are fixed.
    """

    data: MultiStepData
    limit: float = math.inf

    method: ClassVar[str] = "maximum likelihood of predictions over half to eight time constants"
    # The Fisher information of least squares with an estimated variance is accurate.
    bfgs_pairs: ClassVar[int] = 0
    profiles_variance: ClassVar[bool] = True
    simd_slots_left: ClassVar[int] = 0
    is_smooth: ClassVar[bool] = False

    @cached_property
    def parametrization(self) -> Parametrization:
        """Coordinates within physical bounds, with disturbance and noise fixed."""
        parametrization = Parametrization.of(self.data, self.effects, self.limit)
        fixed = slice(DISTURBANCE, NOISE + 1)
        parametrization.low[fixed] = parametrization.high[fixed] = 0.0
        # States of effects that are faster than the grid have no influence on any prediction.
        grid = GRID * self.data.time_constant
        low, high = parametrization.bounds
        for at, effect, parameter in parametrization.effect_parameters():
            if not (isinstance(effect.acts, Term) and effect.acts.fastest):
                continue
            unit = self.data.scales.unit_size(parameter)
            if parameter.name == "time_constant":
                low[at] = min(max(low[at], grid / unit), high[at])
            if parameter.name == "frequency":
                high[at] = max(min(high[at], 1.0 / grid / unit), low[at])
        return parametrization

    @cached_property
    def _horizon(self) -> IntArray:
        """(N,) index of the horizon of each used prediction."""
        return self.masked(self.data.horizon)

    @cached_property
    def weight(self) -> FloatArray:
        """(N,) weight of each used prediction."""
        return self.data.weights[self._horizon]

    @property
    def batch_key(self) -> Hashable:
        """Unique: objectives are evaluated one at a time."""
        return id(self)

    @property
    def chunks(self) -> Sequence[Self]:
        """The objective itself: all predictions are evaluated at once."""
        return [self]

    @property
    def rows(self) -> slice:
        """All rows."""
        return slice(0, None)

    @property
    def _least_variance(self) -> float:
        """Least mean square error: two readings at the noise floor. A few predictions may all be met by chance."""
        return 2.0 * (NOISE_FLOOR * self.data.position_scale) ** 2

    def _predict(self, x: FloatArray) -> Innovations:
        """(N,) prediction errors in rad or m, and the mean square of the errors over the same horizon."""
        model = self.parametrization.model(x)
        with np.errstate(over="ignore", invalid="ignore"):
            error = prediction_errors(self.data, model)
            if self.mask is not None:
                error = error[self.mask]
            far = _DIVERGED * self.data.position_scale
            error = np.nan_to_num(error, nan=far, posinf=far, neginf=-far)
            variances = np.maximum(_mean_squares(self._horizon, error), self._least_variance)
            return Innovations(error, variances[self._horizon])

    def evaluate(self, points: Sequence[FloatArray]) -> list[Innovations]:
        """For each of the (p,) ``points``, (N,) errors in rad or m and mean squares over the same horizon."""
        return list(map(self._predict, points))

    def evaluate_nearby(
        self, x: FloatArray, near: Sequence[FloatArray], centre: Innovations | None = None
    ) -> list[Innovations]:
        """As `evaluate`, at ``x`` and at ``near`` points; ``centre`` is the known value at x."""
        if centre is None:
            return thread_map(self._predict, [x, *near])
        return [centre, *thread_map(self._predict, near)]

    @classmethod
    def evaluate_each(cls, pairs: Sequence[tuple[Self, FloatArray]]) -> list[Innovations]:
        """As `evaluate`, of objectives of the same data, each at a point of its own, on all cores."""
        return thread_map(lambda pair: pair[0].innovations(pair[1]), pairs)

    def held_out_values(self, tests: Sequence[Self], fits: Sequence[FloatArray]) -> list[float]:
        """Value of each of the ``tests`` at coordinates fitted to others; variances are those over all tests."""
        errors = [test.innovations(x).error for test, x in zip(tests, fits, strict=True)]
        horizons = [test.masked(self.data.horizon) for test in tests]
        variances = np.maximum(_mean_squares(np.concatenate(horizons), np.concatenate(errors)), self._least_variance)
        each = zip(tests, errors, horizons, strict=True)
        return [test.value_of(Innovations(error, variances[horizon])) for test, error, horizon in each]

    def reweighted(self, model: Model) -> Self:
        """The objective with weights by the correlation of the errors of ``model``."""
        return replace(self, data=self.data.reweighted(model))

    def split_horizons(self) -> tuple[Self, Self]:
        """The predictions over horizons below the middle one, and above it."""
        horizon = self.data.horizon
        return self.with_effects(self.effects, horizon < _MIDDLE), self.with_effects(self.effects, horizon > _MIDDLE)

    def at_limit(self, x: FloatArray) -> bool:  # noqa: ARG002 - as every objective
        """False: there is no disturbance."""
        return False

    def disturbance(self, x: FloatArray) -> tuple[float, float]:
        """Standard deviation in N m and correlation time in s of a torque that causes the errors over horizon 1."""
        memory = self.data.time_constant
        span = HORIZONS[0] * memory
        error = math.sqrt(float(_mean_squares(self._horizon, self.innovations(x).error)[0]))
        return 2.0 * self.parametrization.model(x).inertia * error / span**2, memory

    def position_noise(self, x: FloatArray) -> float:  # noqa: ARG002 - as every objective
        """Standard deviation of the measurement noise, from differences of the measurements."""
        return self.data.position_noise


def _mean_squares(horizon: IntArray, error: FloatArray) -> FloatArray:
    """(q,) mean squares of the (N,) errors of each horizon; zero for an empty horizon."""
    square = np.bincount(horizon, weights=error**2, minlength=len(HORIZONS))
    return np.asarray(square / np.maximum(np.bincount(horizon, minlength=len(HORIZONS)), 1))
