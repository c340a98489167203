"""What a closed-loop run is judged by."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from rovid.control.closed_loop import ClosedLoopRun
from rovid.core.array_types import FloatArray

# Share of the step that the time constant is read at, of an exponential.
_RISEN = 1.0 - math.exp(-1.0)
# Settled: within this share of the step, or within the paper's steady error where that is more.
_SETTLED_SHARE, _SETTLED_DEG = 0.02, 0.6
# The end of a run, over which the steady error and limit cycles are read.
_END = 1.0 / 3.0
# deg; a smaller swing is no limit cycle that anybody sees. One that falls by this much from half to half dies out.
_SEEN, _DYING = 0.01, 0.8


@dataclass(frozen=True, kw_only=True)
class LimitCycle:
    """A swing that goes on without noise and disturbance: its amplitude in deg and period in s."""

    amplitude_deg: float
    period_s: float


@dataclass(frozen=True, kw_only=True)
class StepMetrics:
    """Of one run; None where there is no step, or where it was not reached.

    Attributes
    ----------
    time_constant, rise_time, settling_time
        s; to 63 % of the step, from 10 to 90 % of it, and until it stays within 2 % of it or 0.6 deg.
    overshoot_deg, steady_error_deg
        deg; beyond the wanted heading, and the largest error over the last third of the run.
    effort, effort_change
        N m; root mean square of the torque asked for, and of its change from sample to sample.
    limit_cycle
        Of the same run without noise and disturbance.
    """

    time_constant: float | None
    rise_time: float | None
    settling_time: float | None
    overshoot_deg: float | None
    steady_error_deg: float
    effort: float
    effort_change: float
    limit_cycle: LimitCycle | None


def step_metrics(course: ClosedLoopRun, quiet: ClosedLoopRun) -> StepMetrics:
    """Judge ``course``, and ``quiet``, the same without noise and disturbance, by its limit cycle."""
    time, error = course.time, np.degrees(course.setpoint - course.heading)
    late = np.abs(error[time >= (1.0 - _END) * time[-1]])
    measures = StepMetrics(
        time_constant=None,
        rise_time=None,
        settling_time=None,
        overshoot_deg=None,
        steady_error_deg=float(np.max(late)),
        effort=float(np.sqrt(np.mean(course.torque**2))),
        effort_change=float(np.sqrt(np.mean(np.diff(course.torque) ** 2))),
        limit_cycle=limit_cycle(quiet.time, np.degrees(quiet.heading)),
    )
    if not abs(error[0]) > 2.0 * _SETTLED_DEG:
        return measures
    return _with_step(measures, time, error)


def _with_step(measures: StepMetrics, time: FloatArray, error: FloatArray) -> StepMetrics:
    """``measures`` with those of the step that begins with the first ``error`` in deg."""
    step = float(error[0])
    done = 1.0 - error / step
    at10, at90 = _first(time, done, 0.1), _first(time, done, 0.9)
    beyond = float(np.max(done) - 1.0) * abs(step)
    return replace(
        measures,
        time_constant=_first(time, done, _RISEN),
        rise_time=None if at10 is None or at90 is None else at90 - at10,
        settling_time=_settled(time, error, max(_SETTLED_SHARE * abs(step), _SETTLED_DEG)),
        overshoot_deg=max(beyond, 0.0),
    )


def limit_cycle(time: FloatArray, heading: FloatArray) -> LimitCycle | None:
    """The swing that is left over the last third of (n,) ``heading`` in deg at ``time`` in s; None if it dies out."""
    late = time >= (1.0 - _END) * time[-1]
    t, swing = time[late], heading[late] - np.mean(heading[late])
    first, second = np.array_split(swing, 2)
    before, after = float(np.ptp(first)) / 2.0, float(np.ptp(second)) / 2.0
    rising = np.flatnonzero((swing[:-1] < 0.0) & (swing[1:] >= 0.0))
    if after < _SEEN or after < _DYING * before or len(rising) < 2:
        return None
    return LimitCycle(amplitude_deg=after, period_s=float(np.mean(np.diff(t[rising]))))


def _first(time: FloatArray, done: FloatArray, share: float) -> float | None:
    """When ``done`` first reaches ``share``, linear between the instants."""
    above = np.flatnonzero(done >= share)
    if not above.size:
        return None
    at = int(above[0])
    if at == 0:
        return 0.0
    pair = slice(at - 1, at + 1)
    return float(np.interp(share, done[pair], time[pair]))


def _settled(time: FloatArray, error: FloatArray, band: float) -> float | None:
    outside = np.flatnonzero(np.abs(error) > band)
    if not outside.size:
        return 0.0
    after = outside[-1] + 1
    if after == len(time):
        return None
    return float(time[after])
