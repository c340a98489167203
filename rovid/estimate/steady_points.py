"""Steady states from held commands and from rows of a table."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.signals.preprocessing import Run
from rovid.signals.segments import Hold, find_holds
from rovid.trial.tables import STEADY_COLUMNS, CsvTable
from rovid.trial.vehicle import Vehicle

# Length of an averaged block in s, and the least number of blocks.
_BLOCK_SECONDS, _MIN_BLOCKS = 1.0, 6
# A drift is a trend if it exceeds this many standard errors and this share of the rate. Headings are so precise that
# negligible drifts are often significant.
_TREND_SIGMAS, _TREND_SHARE = 3.0, 0.005
# Least number of standard errors from zero of the rate of a steady turn.
_MIN_RATE_SIGMAS = 4.0


@dataclass(frozen=True, kw_only=True)
class SteadyPoint:
    """One steady state.

    Attributes
    ----------
    source
        Log, or row of the table.
    start, stop
        Start and end of the part of the hold that was used, s; NaN for a table.
    command
        One number per actuator.
    torque, rate
        Means over the part used, N m and rad/s (or N and m/s).
    square_rate
        Mean of |r| r over the part used, rad^2/s^2.
    rate_error
        Standard error of ``rate``, allowing for its autocorrelation; NaN for a table.
    drift, drift_error
        Change of rate over the part used and its standard error, rad/s; NaN for a table.
    steady
        False where that drift is a trend; such a point is shown but not fitted.
    """

    source: str
    start: float = math.nan
    stop: float = math.nan
    command: tuple[float, ...]
    torque: float
    rate: float
    square_rate: float
    rate_error: float = math.nan
    drift: float = math.nan
    drift_error: float = math.nan
    steady: bool = True

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
        for hold in find_holds(run.trial, vehicle, run.torque):
            point = None if hold.torque == 0.0 else _steady_point(run, hold)
            if point is not None and abs(point.rate) > _MIN_RATE_SIGMAS * point.rate_error:
                points.append(point)
    return points


def points_from_table(table: CsvTable) -> list[SteadyPoint]:
    """Steady states from a table with the columns yaw_rate_rad_s, torque_Nm and optionally command.

    Raises
    ------
    LogError
        A column is missing or a cell is not a number.
    """
    rates, torques = map(table.numbers, STEADY_COLUMNS)
    commands = np.full(len(rates), np.nan)
    if "command" in table.header:
        commands = table.numbers("command")
    points = []
    for line, command, torque, rate in zip(
        table.lines, commands.tolist(), torques.tolist(), rates.tolist(), strict=True
    ):
        point = SteadyPoint(
            source=f"{table.path.name}:{line}",
            command=(command,),
            torque=torque,
            rate=rate,
            square_rate=abs(rate) * rate,
        )
        points.append(point)
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
        stop=float(times[-1]) + _BLOCK_SECONDS,
        command=tuple(float(value) for value in hold.command),
        torque=hold.torque,
        rate=mean,
        square_rate=float(squares.mean()),
        rate_error=math.sqrt(variance / count),
        drift=drift,
        drift_error=drift_error,
        steady=not trend,
    )


def _block_means(run: Run, hold: Hold) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Means of r and |r| r over blocks of about a second inside the hold, and each block's start in s."""
    rates = run.rates
    # The zero-phase filter mixes in the next command within half a kernel of the end.
    inside = (rates.time >= hold.start) & (rates.time <= hold.stop - rates.kernel.half_width) & rates.valid
    rows = np.flatnonzero(inside)
    size = max(round(_BLOCK_SECONDS / rates.kernel.period), 1)
    count = len(rows) // size
    if count == 0:
        return np.empty(0), np.empty(0), np.empty(0)
    # Blocks are counted from the end, because the start is transient.
    block = rows[len(rows) - count * size :].reshape(count, size)
    rate = rates.rate[block]
    mean = rate.mean(axis=1)
    # The square of the sensor noise is subtracted. The square of true fluctuations contributes to the drag.
    square = (np.abs(rate) * rate).mean(axis=1) - np.sign(mean) * rates.rate_noise**2
    return mean, square, rates.time[block[:, 0]]


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
    corrected = correlation + (1.0 + 3.0 * correlation) / count
    correlation = min(max(corrected, 0.0), 0.95)
    return power / (count - 2) * (1.0 + correlation) / (1.0 - correlation)
