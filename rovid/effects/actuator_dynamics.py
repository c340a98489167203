"""Compiled recursions over held signals, exact between the instants.

Each is of (n,) instants in s and (n,) values, for `Actuation.each` to take trial by trial.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.effects.actuator_inputs import ActuatorInputs
from rovid.jit.decorators import compiled

# So many delays stand for any between two, evenly.
_DELAYS = 5
# Intervals that differ by no more than this share are one.
_SAME = 1e-9


def speed_of_thrust(where: ActuatorInputs, thrust: FloatArray, time_constant: float) -> FloatArray:
    """What stands in for a speed ahead that is not logged, in N^0.5; (n,) of (n, k) thrusts in N.

    Steady speed goes with the root of the thrust that drives it, and follows it late; its factor is part of whatever
    coefficient it is multiplied with.
    """
    ahead = where.weighted_sum(thrust, where.forward_share)
    return where.apply_per_trial(lagged, np.sign(ahead) * np.sqrt(np.abs(ahead)), time_constant)


@compiled
def lagged(time: FloatArray, values: FloatArray, time_constant: float) -> FloatArray:
    """Mean until the next instant of a first-order lag of the held (n,) ``values``, at rest at the start."""
    n = len(time)
    out = np.empty(n)
    state, before, fade, mean = values[0], 0.0, 1.0, 1.0
    for k in range(n):
        interval = time[k + 1] - time[k] if k + 1 < n else 0.0
        if time_constant <= 0.0 or interval <= 0.0:
            state = values[k] if time_constant <= 0.0 else state
            out[k] = state
            continue
        # Most logs are sampled evenly, to rounding: what depends on the interval alone is kept.
        if abs(interval - before) > _SAME * before:
            before, fade = interval, math.exp(-interval / time_constant)
            mean = (1.0 - fade) * time_constant / interval
        away = state - values[k]
        out[k] = values[k] + away * mean
        state = values[k] + away * fade
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
def soft_started(time: FloatArray, values: FloatArray, rate: float) -> FloatArray:
    """As ``slewed``, for a signal whose size is limited as it grows only, and falls at once."""
    n = len(time)
    out = np.empty(n)
    state = values[0]
    for k in range(n):
        interval = time[k + 1] - time[k] if k + 1 < n else 0.0
        if state * values[k] < 0.0:
            state = 0.0
        if abs(values[k]) <= abs(state):
            out[k] = state = values[k]
            continue
        gap = values[k] - state
        reach = rate * interval
        moved = min(max(gap, -reach), reach)
        share = 1.0 if abs(gap) > reach or reach <= 0.0 else abs(gap) / reach
        out[k] = state + moved * (1.0 - 0.5 * share)
        state += moved
    return out


@compiled
def rotor_speed(speed: float, push: float, interval: float) -> float:
    """Speed n after ``interval`` of n' = push - n*|n|, exactly (a Riccati equation)."""
    sign = 1.0 if push >= 0.0 else -1.0
    start, goal = sign * speed, math.sqrt(abs(push))
    if goal < 1e-9:
        return speed / (1.0 + abs(speed) * interval)
    left = interval
    if start < 0.0:
        # It runs the other way yet: up to zero first.
        behind = math.atan(start / goal)
        left += behind / goal
        if left <= 0.0:
            return sign * goal * math.tan(goal * interval + behind)
        start = 0.0
    gained = math.tanh(goal * left)
    return sign * goal * (start + goal * gained) / (goal + start * gained)


@compiled
def rotor_lagged(time: FloatArray, thrust: FloatArray, time_constant: float) -> FloatArray:
    """Mean until the next instant of the thrust of a rotor with square-law load (Yoerger et al. 1990).

    Parameters
    ----------
    thrust
        (n,) held thrust that the rotor is driven to, over the reference thrust.
    time_constant
        s; of small changes at the reference thrust: n' = (thrust - n*|n|) / (2*time_constant).
    """
    n = len(time)
    out = np.empty(n)
    speed = math.copysign(math.sqrt(abs(thrust[0])), thrust[0])
    for k in range(n):
        interval = time[k + 1] - time[k] if k + 1 < n else 0.0
        if time_constant <= 0.0:
            out[k] = thrust[k]
        elif interval <= 0.0:
            out[k] = speed * abs(speed)
        else:
            scaled = 0.5 * interval / time_constant
            new = rotor_speed(speed, thrust[k], scaled)
            # The equation of motion itself, integrated, gives the mean of n*|n|.
            out[k] = thrust[k] - (new - speed) / scaled
            speed = new
    return out


@compiled
def latched(_: FloatArray, excess: FloatArray, width: float, ramp: float) -> FloatArray:
    """What passes of (n,) ``excess`` once it was more than ``width``, until it is 0 or turns; off at the start.

    ``ramp``, a share of ``width``, is the range of the excess over which it comes on.
    """
    out = np.empty(len(excess))
    on = 0.0
    before = 0.0
    for k in range(len(excess)):
        if excess[k] * before <= 0.0:
            on = 0.0
        on = max(on, comes_on(abs(excess[k]), width, ramp))
        out[k] = on * excess[k]
        before = excess[k]
    return out


@compiled
def comes_on(size: float, threshold: float, ramp: float) -> float:
    """From 0 to 1 as ``size`` passes ``threshold``, linearly over the share ``ramp`` of it."""
    if threshold <= 0.0:
        return 1.0
    return min(max((size / threshold - 1.0) / ramp + 0.5, 0.0), 1.0)


@compiled
def played(_: FloatArray, values: FloatArray, width: float) -> FloatArray:
    """Output of a play of total ``width`` driven by (n,) ``values``."""
    out = np.empty(len(values))
    state = values[0]
    for k in range(len(values)):
        state = min(max(state, values[k] - 0.5 * width), values[k] + 0.5 * width)
        out[k] = state
    return out


@compiled
def delayed(time: FloatArray, values: FloatArray, delay: float) -> FloatArray:
    """Mean until the next instant of the held (n,) ``values``, ``delay`` s later; the first value before."""
    n = len(values)
    out = np.empty(n)
    at = 0
    passed = before = 0.0
    for k in range(n):
        then = time[k] - delay
        while at + 1 < n and time[at + 1] <= then:
            passed += values[at] * (time[at + 1] - time[at])
            at += 1
        area = passed + values[at] * (then - time[at])
        if k > 0:
            out[k - 1] = (area - before) / (time[k] - time[k - 1])
        before = area
    out[n - 1] = out[n - 2] if n > 1 else values[0]
    return out


@compiled
def delayed_anyhow(time: FloatArray, values: FloatArray, shortest: float, longest: float) -> FloatArray:
    """As ``delayed``, the mean over delays from the ``shortest`` to the ``longest``."""
    out = np.zeros(len(values))
    for number in range(_DELAYS):
        out += delayed(time, values, shortest + (number + 0.5) / _DELAYS * (longest - shortest))
    return out / _DELAYS


@compiled
def open_changes(time: FloatArray, values: FloatArray, shortest: float, longest: float) -> FloatArray:
    """Sum of the squared changes of (n,) ``values`` that one delay has let through, and the longer one not yet."""
    n = len(values)
    out = np.zeros(n)
    early = late = 0
    total = 0.0
    for k in range(n):
        while early + 1 < n and time[early + 1] <= time[k] - shortest:
            early += 1
            total += (values[early] - values[early - 1]) ** 2
        while late < early and time[late + 1] <= time[k] - longest:
            late += 1
            total -= (values[late] - values[late - 1]) ** 2
        # Nothing is left of what was rounded.
        total = total if late < early else 0.0
        out[k] = total
    return out


# Each loop over held signals, with how many numbers it takes besides, in the order in which they are asked for.
LOOPS: tuple[tuple[Callable[..., FloatArray], int], ...] = (
    (lagged, 1),
    (delayed, 1),
    (open_changes, 2),
    (delayed_anyhow, 2),
    (rotor_lagged, 1),
    (latched, 2),
    (slewed, 1),
    (soft_started, 1),
    (played, 1),
)
