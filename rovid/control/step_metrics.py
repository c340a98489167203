"""Metrics of a closed-loop run: step response, steady error, effort and limit cycle."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from rovid.control.closed_loop import ClosedLoopRun
from rovid.core.array_types import FloatArray

# Share of the step at one time constant of an exponential.
_RISEN = 1.0 - math.exp(-1.0)
# Settling band: share of the step, or deg, steady error of the paper, whichever is larger.
_SETTLED_SHARE, _SETTLED_DEG = 0.02, 0.6
# Final share of a run for the steady error and limit cycles.
_END = 1.0 / 3.0
# deg, smallest amplitude of a limit cycle; ratio of the amplitudes of both halves below which it decays.
_VISIBLE, _DECAYING = 0.01, 0.8


@dataclass(frozen=True, kw_only=True)
class LimitCycle:
    """Sustained oscillation without noise and disturbance."""

    amplitude_deg: float
    period_s: float


@dataclass(frozen=True, kw_only=True)
class StepMetrics:
    """Metrics of one run; None where there is no step, or it was not reached."""

    #: ``time_constant``, ``rise_time``, ``settling_time``: s; to 63 % of the step, from 10 to 90 %, and until the error
    #: stays within 2 % or 0.6 deg.
    time_constant: float | None = None
    rise_time: float | None = None
    settling_time: float | None = None
    #: ``overshoot_deg``, ``steady_error_deg``: deg; largest error over the last third of the run.
    overshoot_deg: float | None = None
    steady_error_deg: float
    #: ``effort``, ``effort_change``: N m, root mean square of the commanded torque, and of its change from step to
    #: step.
    effort: float
    effort_change: float
    limit_cycle: LimitCycle | None  #: In the same run without noise and disturbance.


def step_metrics(run: ClosedLoopRun, noise_free: ClosedLoopRun) -> StepMetrics:
    """Metrics of ``run``, with the limit cycle of the same run without noise and disturbance."""
    time, error = run.time, np.degrees(run.setpoint - run.heading)
    metrics = StepMetrics(
        steady_error_deg=float(np.max(np.abs(error[time >= (1.0 - _END) * time[-1]]))),
        effort=float(np.sqrt(np.mean(run.torque**2))),
        effort_change=float(np.sqrt(np.mean(np.diff(run.torque) ** 2))),
        limit_cycle=limit_cycle(noise_free.time, np.degrees(noise_free.heading)),
    )
    step = float(error[0])
    if not abs(step) > 2.0 * _SETTLED_DEG:
        return metrics
    response = 1.0 - error / step
    at10, at90 = _first_time(time, response, 0.1), _first_time(time, response, 0.9)
    return replace(
        metrics,
        time_constant=_first_time(time, response, _RISEN),
        rise_time=None if at10 is None or at90 is None else at90 - at10,
        settling_time=_settling_time(time, error, max(_SETTLED_SHARE * abs(step), _SETTLED_DEG)),
        overshoot_deg=max(float(np.max(response) - 1.0) * abs(step), 0.0),
    )


def limit_cycle(time: FloatArray, heading: FloatArray) -> LimitCycle | None:
    """Oscillation over the last third of (n,) ``heading`` in deg at ``time`` in s; None if it decays."""
    late = time >= (1.0 - _END) * time[-1]
    t, swing = time[late], heading[late] - np.mean(heading[late])
    first, second = np.array_split(swing, 2)
    before, after = float(np.ptp(first)) / 2.0, float(np.ptp(second)) / 2.0
    rising = np.flatnonzero((swing[:-1] < 0.0) & (swing[1:] >= 0.0))
    if after < _VISIBLE or after < _DECAYING * before or len(rising) < 2:
        return None
    return LimitCycle(amplitude_deg=after, period_s=float(np.mean(np.diff(t[rising]))))


def _first_time(time: FloatArray, response: FloatArray, share: float) -> float | None:
    """Time at which ``response`` first reaches ``share``, interpolated."""
    above = np.flatnonzero(response >= share)
    if not above.size:
        return None
    at = int(above[0])
    if at == 0:
        return 0.0
    pair = slice(at - 1, at + 1)
    return float(np.interp(share, response[pair], time[pair]))


def _settling_time(time: FloatArray, error: FloatArray, band: float) -> float | None:
    outside = np.flatnonzero(np.abs(error) > band)
    if not outside.size:
        return 0.0
    after = outside[-1] + 1
    return None if after == len(time) else float(time[after])
