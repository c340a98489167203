"""Drift between the clocks of commands and motion: the delay of the motion grows within each log.

The acceleration is fitted by the torque T(t - delay - drift s), with s the time since the begin of the log, by drag,
and by trim. Each Gauss-Newton step is a linear regression on T, T' and s T'. Hidden causes delay the motion as well,
but by the change of the torque and not by s. A lag may differ for rising and falling torque, a slew limit for small and
large torque. T' of both, |T| T', T'' and |T| T are therefore in the regression, with the water's memory and torques of
the angle. The time s is centred in each log, for rising and falling torque separately: a delay of one log or of one
direction is no drift.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.faults.log_regressors import first_order
from rovid.trial.preprocessing import Run

#: Length of a jackknife block in periods of the cut-off.
BLOCK = 8.0
# Time constants of the water's memory in periods of the cut-off; sums of such responses approximate others.
_MEMORIES = (2.0, 8.0)
# Least number of blocks.
_MIN_BLOCKS = 10
# Largest number of Gauss-Newton steps, and their share, because whole steps may oscillate. A converged step changes the
# delay at the ends of the logs by less than this share of a period of the cut-off.
_MAX_STEPS, _SHARE, _CONVERGED = 20, 0.5, 4e-3
# Columns of the regression: torque, its derivative (rising, falling), and the derivative times the time.
_TORQUE, _DELAYS, _DRIFT = 0, slice(1, 3), 3


@dataclass(frozen=True, kw_only=True)
class ClockDrift:
    """Growth of the delay of the motion after the commands, in s per s, with its standard error."""

    drift: float
    error: float
    explained: float  #: Share of the mean square residual that the drift removes.


def clock_drift(runs: Sequence[Run]) -> ClockDrift | None:
    """The drift that restarts in each log; None where the logs do not determine one.

    The standard error is a jackknife over blocks or over logs, whichever is larger.
    """
    durations = [run.trial.duration for run in runs]
    unit, delay, drift = _CONVERGED / runs[0].rates.kernel.cutoff, 0.0, 0.0
    for _ in range(_MAX_STEPS):
        logs = [_block_moments(run, delay, drift) for run in runs]
        blocks = np.concatenate(logs)
        total = blocks.sum(axis=0)
        step, more = _steps(total)
        if len(blocks) < _MIN_BLOCKS or not math.isfinite(step + more):
            return None
        delay, drift = delay + _SHARE * more, drift + _SHARE * step
        if max(abs(more), abs(step) * max(durations)) < unit:
            break
    else:
        return None
    without = np.concatenate([_block_moments(run, delay, 0.0) for run in runs]).sum(axis=0)
    without = np.delete(np.delete(without, _DRIFT, axis=0), _DRIFT, axis=1)
    errors = [_jackknife(total, blocks)]
    if len(logs) > 1:
        errors.append(_jackknife(total, np.array([log.sum(axis=0) for log in logs])))
    return ClockDrift(drift=drift, error=max(errors), explained=1.0 - _fit(total)[1] / max(_fit(without)[1], 1e-300))


def _block_moments(run: Run, delay: float, drift: float) -> FloatArray:
    """(b, p + 1, p + 1) moments of the p regressors and of the acceleration in each block."""
    rates, period = run.rates, run.rates.kernel.period
    since = rates.time - run.trial.time[0] - 0.5 * run.trial.duration
    shifted = rates.time - delay - drift * since
    torque = np.interp(shifted, rates.time, run.filtered_torque, left=np.nan, right=np.nan)
    slope = np.gradient(torque, period)
    bend = np.gradient(slope, period)
    known = rates.valid & np.isfinite(bend)
    if run.trial.axis.angular:
        known &= np.isfinite(rates.position)  # A logged rate may be known where the position is not.
    rising, ramp = torque * slope > 0.0, np.zeros(len(torque))
    for side in (known & rising, known & ~rising):
        weights = slope[side] ** 2
        if weights.any():
            ramp[side] = slope[side] * (since[side] - np.average(since[side], weights=weights))
    size, rate = np.abs(torque), rates.rate
    columns = [
        torque,
        slope * rising,
        slope * ~rising,
        ramp,
        bend,
        size * torque,
        size * slope,
        np.abs(rate) * rate,
        rate,
    ]
    if run.trial.axis.angular:
        columns += [np.sin(rates.position), np.cos(rates.position)]
    past = np.nan_to_num(rate)
    columns += [first_order(past, memory / rates.kernel.cutoff, period) for memory in _MEMORIES]
    rows = np.column_stack((*columns, np.ones(len(rate)), rates.acceleration))[known]
    length = max(int(BLOCK / (rates.kernel.cutoff * period)), 10)
    blocks = [rows[first : first + length] for first in range(0, len(rows), length)]
    return np.array([block.T @ block for block in blocks]).reshape(-1, rows.shape[1], rows.shape[1])


def _fit(moments: FloatArray) -> tuple[FloatArray, float]:
    """(p,) parameters, and sum of squares of the residual."""
    xx, xy = moments[:-1, :-1], moments[:-1, -1]
    scale = np.sqrt(np.diag(xx)).clip(1e-300)
    values = np.linalg.lstsq(xx / scale / scale[:, None], xy / scale, rcond=1e-10)[0] / scale
    return values, float(moments[-1, -1] - 2.0 * values @ xy + values @ xx @ values)


def _steps(moments: FloatArray) -> tuple[float, float]:
    """Changes of drift and delay; infinite where the torque moves nothing."""
    values, _ = _fit(moments)
    if not values[_TORQUE]:
        return math.inf, math.inf
    weights = np.diag(moments)[_DELAYS]
    delay = -float(np.average(values[_DELAYS], weights=weights)) / values[_TORQUE] if weights.any() else math.inf
    return -float(values[_DRIFT] / values[_TORQUE]), delay


def _jackknife(total: FloatArray, groups: FloatArray) -> float:
    """Standard error of the drift, each of the (n, p + 1, p + 1) ``groups`` left out in turn."""
    drifts = np.array([_steps(total - group)[0] for group in groups])
    return math.sqrt((len(drifts) - 1.0) / len(drifts) * float(np.sum((drifts - drifts.mean()) ** 2)))
