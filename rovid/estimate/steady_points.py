"""Steady states from held commands or a table, and weighted least squares of their torque balance."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple, Self

import numpy as np

from rovid.core.array_types import BoolArray, FloatArray
from rovid.effects import restoring_effect
from rovid.effects.restoring_curve import regressors
from rovid.trial.axis import Axis
from rovid.trial.preprocessing import Run
from rovid.trial.segments import Hold, find_holds
from rovid.trial.tables import STEADY_COLUMNS, CsvTable
from rovid.trial.vehicle import Vehicle

# Length of an averaged block in periods of the cut-off of the rates, and the least number of blocks.
_BLOCK, _MIN_BLOCKS = 0.75, 6
# A drift is a trend if it exceeds this many standard errors and this share of the rate. Headings are so precise that
# negligible drifts are often significant.
_TREND_SIGMAS, _TREND_SHARE = 3.0, 0.005
# Least ratio of the singular values of the normalised design matrix, below which unknowns are not distinguishable.
_LEAST_RATIO = 1e-10
# Parts of a hold whose means show how long a disturbance lasts.
_PARTS = 4
# Least number of standard errors from zero of the rate of a steady turn.
_MIN_RATE_SIGMAS = 4.0


@dataclass(frozen=True, kw_only=True)
class SteadyPoint:
    """One steady state."""

    source: str  #: Log, or row of the table.
    #: ``start``, ``stop``: start and end of the part of the hold that was used, s; NaN for a table.
    start: float = math.nan
    stop: float = math.nan
    command: tuple[float, ...]  #: One number per actuator.
    #: ``torque``, ``rate``: means over the part used, N m and rad/s (or N and m/s).
    torque: float
    rate: float
    square_rate: float  #: Mean of |r| r over the part used, rad^2/s^2.
    rate_error: float = math.nan  #: Standard error of ``rate``, allowing for its autocorrelation; NaN for a table.
    #: ``drift``, ``drift_error``: change of rate over the part used and its standard error, rad/s; NaN for a table.
    drift: float = math.nan
    drift_error: float = math.nan
    steady: bool = True  #: False where that drift is a trend; such a point is shown but not fitted.
    #: Means of |r| r and r over equal parts of the hold; empty for a table.
    parts: tuple[tuple[float, float], ...] = ()

    @property
    def duration(self) -> float:
        """Length used in s."""
        return self.stop - self.start


def steady_points(runs: Sequence[Run], vehicle: Vehicle) -> list[SteadyPoint]:
    """Reduce every held command under which the vehicle turns to one steady state.

    Holds without torque, or with a rate that is not significantly different from zero, are left out.
    """
    points = []
    for run in runs:
        for hold in find_holds(run.trial, vehicle, run.torque, run.rates.kernel.cutoff):
            point = None if hold.torque == 0.0 else _steady_point(run, hold)
            if point is not None and abs(point.rate) > _MIN_RATE_SIGMAS * point.rate_error:
                points.append(point)
    return points


def points_from_table(table: CsvTable) -> list[SteadyPoint]:
    """Steady states from a table with the columns yaw_rate_rad_s, torque_Nm and optionally command.

    Raises LogError if a column is missing or a cell is not a number.
    """
    rates, torques = map(table.numbers, STEADY_COLUMNS)
    commands = table.numbers("command") if "command" in table.header else np.full(len(rates), np.nan)
    points = []
    for line, *row in zip(table.lines, commands.tolist(), torques.tolist(), rates.tolist(), strict=True):
        command, torque, rate = row
        source, square = f"{table.path.name}:{line}", abs(rate) * rate
        points.append(SteadyPoint(source=source, command=(command,), torque=torque, rate=rate, square_rate=square))
    return points


def _steady_point(run: Run, hold: Hold) -> SteadyPoint | None:
    """Steady state of a hold without its transient; None where too little is left."""
    blocks, squares, times = _block_means(run, hold)
    if len(blocks) < _MIN_BLOCKS:
        return None
    first = _settled(blocks)
    blocks, squares, times = blocks[first:], squares[first:], times[first:]
    count = len(blocks)
    x = np.arange(count) - 0.5 * (count - 1)
    slope = float(x @ blocks / (x @ x))
    mean = float(blocks.mean())
    variance = long_run_variance(blocks - mean - slope * x)
    drift, drift_error = slope * count, math.sqrt(variance / float(x @ x)) * count
    trend = abs(drift) > max(_TREND_SIGMAS * drift_error, _TREND_SHARE * abs(mean))
    return SteadyPoint(
        source=run.trial.name,
        start=float(times[0]),
        stop=float(times[-1]) + _block_samples(run) * run.rates.kernel.period,
        command=tuple(map(float, hold.command)),
        torque=hold.torque,
        rate=mean,
        square_rate=float(squares.mean()),
        rate_error=math.sqrt(variance / count),
        drift=drift,
        drift_error=drift_error,
        steady=not trend,
        parts=part_means(squares, blocks),
    )


def part_means(squares: FloatArray, rates: FloatArray) -> tuple[tuple[float, float], ...]:
    """Means of (n,) squared rates and rates over equal parts."""
    pieces = (np.array_split(one, _PARTS) for one in (squares, rates))
    return tuple((float(square.mean()), float(rate.mean())) for square, rate in zip(*pieces, strict=True))


def _block_means(run: Run, hold: Hold) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Means of r and |r| r over blocks inside the hold, and each block's start in s."""
    rates = run.rates
    # The zero-phase filter mixes in the next command within half a kernel of the end.
    # A margin of half a sample: rounding decides nothing.
    begin, end = (
        np.array([hold.start, hold.stop - rates.kernel.half_width]) + np.array([-0.5, 0.5]) * rates.kernel.period
    )
    rows = np.flatnonzero((rates.time >= begin) & (rates.time <= end) & rates.valid)
    size = _block_samples(run)
    # Blocks are counted from the end, because the start is transient.
    block = rows[len(rows) % size :].reshape(-1, size)
    rate = rates.rate[block]
    mean = rate.mean(axis=1)
    # The square of the sensor noise is subtracted. The square of true fluctuations contributes to the drag.
    square = (np.abs(rate) * rate).mean(axis=1) - np.sign(mean) * rates.rate_noise**2
    return mean, square, rates.time[block[:, 0]]


def _block_samples(run: Run) -> int:
    kernel = run.rates.kernel
    return max(round(_BLOCK / (kernel.cutoff * kernel.period)), 1)


def _settled(blocks: FloatArray) -> int:
    """Number of transient blocks by the marginal standard error rule (White 1997).

    The number that minimises the standard error of the mean of the rest, three quarters at most.
    """
    count = len(blocks)
    most = max(min(3 * count // 4, count - _MIN_BLOCKS), 0)
    spread = [float(np.var(blocks[k:])) / (count - k) for k in range(most + 1)]
    return int(np.argmin(spread))


def long_run_variance(values: FloatArray) -> float:
    """Variance of the mean of (n,) zero-mean ``values`` times n, by a first-order autoregression; docs/method.md, (5).

    The lag-one correlation is corrected for the bias of short series (Kendall 1954).
    """
    count = len(values)
    power = float(values @ values)
    if power <= 0.0 or count < 3:
        return power / max(count, 1)
    correlation = float(values[1:] @ values[:-1]) / power
    correlation = min(max(correlation + (1.0 + 3.0 * correlation) / count, 0.0), 0.95)
    return power / (count - 2) * (1.0 + correlation) / (1.0 - correlation)


class WlsSolution(NamedTuple):
    """(p,) values, their (p, p) covariance, and the degrees of freedom behind its scale."""

    values: FloatArray
    covariance: FloatArray
    degrees_of_freedom: float


@dataclass(frozen=True, kw_only=True, eq=False)
class TorqueBalance:
    """Linear model of the torque at k steady states; docs/method.md, (6)."""

    design: FloatArray  #: (k, p) regressors: |r| r, r, and those of the restoring torque.
    torque: FloatArray  #: (k,) N m.
    error: FloatArray  #: (k,) standard errors of the torque balance in N m; ones where unknown.
    error_known: bool  #: Whether the errors are known.
    free: BoolArray  #: (p,) which unknowns are free; the others are zero.

    @classmethod
    def of(cls, points: Sequence[SteadyPoint], axis: Axis, free: BoolArray) -> Self:
        """Torque balance of steady states, with unknown errors."""
        # Position does not matter: an axis with a righting moment has no steady turns.
        restoring = regressors(restoring_effect(axis), np.zeros(len(points)))
        squares, rates = [point.square_rate for point in points], [point.rate for point in points]
        design = np.column_stack((squares, rates, restoring))
        torque = np.array([point.torque for point in points])
        return cls(design=design, torque=torque, error=np.ones(len(points)), error_known=False, free=free)

    @property
    def is_determined(self) -> bool:
        """Whether the steady states determine every free unknown."""
        design = self.design[:, self.free]
        values = np.linalg.svd(design / np.linalg.norm(design, axis=0), compute_uv=False)
        return len(values) == design.shape[1] and bool(values[-1] > _LEAST_RATIO * values[0])

    def with_error(self, error: FloatArray) -> Self:
        """The same balance with known errors."""
        return replace(self, error=error, error_known=True)

    def subset(self, rows: BoolArray) -> Self:
        """The balance of some of the steady states."""
        return replace(self, design=self.design[rows], torque=self.torque[rows], error=self.error[rows])

    def residuals(self, values: FloatArray) -> FloatArray:
        """(k,) measured torque minus that of (p,) ``values``, N m."""
        return np.asarray(self.torque - self.design @ values)

    def chi2(self, values: FloatArray) -> float:
        """Sum of squared residuals over their errors."""
        return float(np.sum((self.residuals(values) / self.error) ** 2))

    @property
    def degrees_of_freedom(self) -> int:
        """Number of steady states beyond that of the free unknowns."""
        return len(self.torque) - int(self.free.sum())

    def solve(self) -> WlsSolution:
        """Weighted least squares; unknowns that are not free stay zero.

        Known errors set the scale of the covariance unless the scatter about the line is larger (Birge 1932).
        """
        count = len(self.free)
        values, covariance = np.zeros(count), np.zeros((count, count))
        solver = self.solver()
        values[self.free] = solver @ self.torque
        # The variance of the normalised residuals; 1 by known errors.
        variance, freedom = (1.0 if self.error_known else math.nan), math.inf
        if self.degrees_of_freedom > 0:
            scatter = self.chi2(values) / self.degrees_of_freedom
            if not self.error_known or scatter > 1.0:
                variance, freedom = scatter, float(self.degrees_of_freedom)
        scaled = solver * self.error
        covariance[np.ix_(self.free, self.free)] = scaled @ scaled.T * variance
        return WlsSolution(values, covariance, freedom)

    def solver(self) -> FloatArray:
        """(f, k) derivatives of the free unknowns by the torques."""
        weighted = self.design[:, self.free] / self.error[:, None]
        # Normalised columns make the cut-off of the pseudo-inverse independent of units.
        scale = np.linalg.norm(weighted, axis=0)
        return np.asarray(np.linalg.pinv(weighted / scale) / scale[:, None] / self.error)

    def leave_one_out(self) -> FloatArray:
        """(k, 3) quadratic and linear drag without each steady state, and the residual of its torque in N m.

        NaN where the other steady states do not determine both.
        """
        count = len(self.torque)
        rows = np.full((count, 3), np.nan)
        for k in range(count):
            others = self.subset(np.arange(count) != k)
            if others.is_determined:
                values = others.solve().values
                rows[k] = (*values[:2], self.torque[k] - self.design[k] @ values)
        return rows


def pooled_errors(balance: TorqueBalance, points: Sequence[SteadyPoint]) -> TorqueBalance:
    """The balance with errors sigma_k^2 = q/t_k + tau^2 of holds of lengths t_k; docs/method.md, (7).

    q is the density of the torque's variance by the errors of the rate, pooled over all holds. tau^2 is the variance
    from hold to hold, such as by a current or trim, which no length averages out.
    """
    duration = np.array([point.duration for point in points])
    rate_error = np.array([point.rate_error for point in points])
    values = balance.with_error(1.0 / np.sqrt(duration)).solve().values
    slope = 2.0 * values[0] * np.abs(balance.design[:, 1]) + values[1]
    density = float(np.mean((slope * rate_error) ** 2 * duration))
    within = density / duration
    return balance.with_error(np.sqrt(within + _variance_between(balance, within)))


def _variance_between(balance: TorqueBalance, within: FloatArray) -> float:
    """Variance tau^2 of the torque balance from hold to hold, N^2 m^2 (Paule and Mandel 1982).

    As large as makes chi-squared, with the (k,) variances ``within`` holds, equal to its degrees of freedom.
    """

    def excess(variance: float) -> float:
        tried = balance.with_error(np.sqrt(within + variance))
        return tried.chi2(tried.solve().values) - balance.degrees_of_freedom

    if balance.degrees_of_freedom < 1 or excess(0.0) <= 0.0:
        return 0.0
    most = float(np.mean(balance.torque**2))
    if not excess(most) < 0.0:
        return most
    from scipy import optimize

    return float(optimize.brentq(excess, 0.0, most))
