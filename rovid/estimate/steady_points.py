"""Held commands and rows of a table -> steady states, each with its scatter."""

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

_BLOCK_SECONDS = 1.0
_MIN_BLOCKS = 6
# A drift over the stretch is a trend when it exceeds three of its standard errors and half a percent of the
# rate: heading is so precise that a drift of no consequence is often significant.
_TREND_SIGMAS = 3.0
_TREND_SHARE = 0.005


@dataclass(frozen=True, kw_only=True)
class SteadyPoint:
    """One steady state.

    Attributes
    ----------
    source
        Log, or row of the table.
    start, stop
        s; the part of the hold that was used. NaN for a table.
    command
        One number per actuator.
    torque, rate
        N m and rad/s (or N and m/s), means over the part used.
    square_rate
        Mean of |r| r over the part used, rad^2/s^2.
    rate_error
        Standard error of ``rate`` that allows for the rate's own memory; NaN for a table.
    drift, drift_error
        Change of rate over the part used, and its standard error, rad/s.
    steady
        False where that drift is a trend; such a point is shown but not fitted.
    """

    source: str
    start: float
    stop: float
    command: tuple[float, ...]
    torque: float
    rate: float
    square_rate: float
    rate_error: float
    drift: float
    drift_error: float
    steady: bool = True

    @property
    def duration(self) -> float:
        """Length used in s."""
        return self.stop - self.start


def steady_points(runs: Sequence[Run], vehicle: Vehicle) -> list[SteadyPoint]:
    """Reduce every held command under which the vehicle turns to one steady state.

    A hold at rest (no torque, or a rate that is not told from zero) is not a steady turn and is left out.
    """
    points = []
    for run in runs:
        for hold in find_holds(run.trial, vehicle, run.torque):
            point = None if hold.torque == 0.0 else _reduce(run, hold)
            if point is not None and abs(point.rate) > 4.0 * point.rate_error:
                points.append(point)
    return points


def points_from_table(table: CsvTable) -> list[SteadyPoint]:
    """Steady states from a table with the columns yaw_rate_rad_s, torque_Nm and, if there, command.

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
    for line, command, torque, rate in zip(table.lines, commands, torques, rates, strict=True):
        source = f"{table.path.name}:{line}"
        points.append(_point_of_row(source, float(command), float(torque), float(rate)))
    return points


def _point_of_row(source: str, command: float, torque: float, rate: float) -> SteadyPoint:
    """A row's command, torque in N m and rate in rad/s, of which no error is known."""
    return SteadyPoint(
        source=source,
        start=math.nan,
        stop=math.nan,
        command=(command,),
        torque=torque,
        rate=rate,
        square_rate=abs(rate) * rate,
        rate_error=math.nan,
        drift=math.nan,
        drift_error=math.nan,
    )


def _reduce(run: Run, hold: Hold) -> SteadyPoint | None:
    blocks, squares, times = _blocks(run, hold)
    if len(blocks) < _MIN_BLOCKS:
        return None
    first = _settled(blocks)
    blocks, squares, times = blocks[first:], squares[first:], times[first:]
    count = len(blocks)
    x = np.arange(count) - 0.5 * (count - 1)
    slope = float(x @ blocks / (x @ x))
    mean = float(blocks.mean())
    spectrum = long_run_variance(blocks - mean - slope * x)
    drift, drift_error = slope * count, math.sqrt(spectrum / float(x @ x)) * count
    trend = abs(drift) > max(_TREND_SIGMAS * drift_error, _TREND_SHARE * abs(mean))
    return SteadyPoint(
        source=run.trial.name,
        start=float(times[0]),
        stop=float(times[-1]) + _BLOCK_SECONDS,
        command=tuple(float(value) for value in hold.command),
        torque=hold.torque,
        rate=mean,
        square_rate=float(squares.mean()),
        rate_error=math.sqrt(spectrum / count),
        drift=drift,
        drift_error=drift_error,
        steady=not trend,
    )


def _blocks(run: Run, hold: Hold) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Means of r and |r| r over blocks of about a second inside the hold, and each block's start in s."""
    rates = run.rates
    # The zero-phase filter lets the next command show before it comes: stay half a kernel away from it.
    inside = (rates.time >= hold.start) & (rates.time <= hold.stop - rates.kernel.half_width) & rates.valid
    rows = np.flatnonzero(inside)
    size = max(round(_BLOCK_SECONDS / rates.kernel.period), 1)
    count = len(rows) // size
    if count == 0:
        empty = np.empty(0)
        return empty, empty, empty
    # Counted from the end: the start is what settling takes away.
    block = rows[len(rows) - count * size :].reshape(count, size)
    rate = rates.rate[block]
    mean = rate.mean(axis=1)
    # The square of sensor noise has a mean, that of the motion's own unrest belongs to the drag.
    square = (np.abs(rate) * rate).mean(axis=1) - np.sign(mean) * rates.rate_noise**2
    return mean, square, rates.time[block[:, 0]]


def _settled(blocks: FloatArray) -> int:
    """Index from which the blocks are taken as settled.

    The marginal standard error rule (White 1997, "An effective truncation heuristic for bias reduction in
    simulation output"): drop as many as make the standard error of the rest smallest, three quarters at most.
    """
    count = len(blocks)
    most = max(min(3 * count // 4, count - _MIN_BLOCKS), 0)
    candidates = np.arange(0, most + 1)
    spread = [float(np.var(blocks[k:])) / (count - k) for k in candidates]
    return int(candidates[int(np.argmin(spread))])


def long_run_variance(values: FloatArray) -> float:
    """Variance of the mean of (n,) zero-mean ``values`` times n, from a first-order autoregression.

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
