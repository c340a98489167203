"""Compiled recursions over held signals, exact between the instants."""

from __future__ import annotations

import math

import numpy as np

from rovid.effects.base import compiled
from rovid.trial import FloatArray


@compiled
def lagged(time: FloatArray, values: FloatArray, time_constant: float) -> FloatArray:
    """Mean until the next instant of a first-order lag of the held (n,) ``values``, at rest at the start."""
    n = len(time)
    out = np.empty(n)
    state = values[0]
    for k in range(n):
        interval = time[k + 1] - time[k] if k + 1 < n else 0.0
        if time_constant <= 0.0 or interval <= 0.0:
            state = values[k] if time_constant <= 0.0 else state
            out[k] = state
            continue
        fade = math.exp(-interval / time_constant)
        out[k] = values[k] + (state - values[k]) * (1.0 - fade) * time_constant / interval
        state = values[k] + (state - values[k]) * fade
    return out


@compiled
def slewed(time: FloatArray, values: FloatArray, rate: float) -> FloatArray:
    """Mean until the next instant of a signal that follows the held (n,) ``values`` at ``rate`` per s at most."""
    n = len(time)
    out = np.empty(n)
    state = values[0]
    for k in range(n):
        interval = time[k + 1] - time[k] if k + 1 < n else 0.0
        gap = values[k] - state
        reach = rate * interval
        moved = min(max(gap, -reach), reach)
        # The mean of a ramp that arrives after a part of the interval.
        share = 1.0 if abs(gap) > reach or reach <= 0.0 else abs(gap) / reach
        out[k] = state + moved * (1.0 - 0.5 * share)
        state += moved
    return out


@compiled
def played(values: FloatArray, width: float) -> FloatArray:
    """Output of a play of total ``width`` driven by (n,) ``values``."""
    out = np.empty(len(values))
    state = values[0]
    for k in range(len(values)):
        state = min(max(state, values[k] - 0.5 * width), values[k] + 0.5 * width)
        out[k] = state
    return out


def delayed(time: FloatArray, values: FloatArray, delay: float) -> FloatArray:
    """Mean until the next instant of the held (n,) ``values``, ``delay`` s later; the first value before."""
    integral = np.concatenate(([0.0], np.cumsum(values[:-1] * np.diff(time))))
    shifted = time - delay
    area = np.interp(shifted, time, integral) + values[0] * np.minimum(shifted - time[0], 0.0)
    out = np.empty(len(values))
    out[:-1] = np.diff(area) / np.diff(time)
    out[-1] = out[-2] if len(values) > 1 else values[0]
    return out
