"""Compiled recursions over held signals, exact between the instants.

Each takes (n,) instants in s and (n,) values of one trial, see `ActuatorInputs.apply_per_trial`.
"""

import math
from collections.abc import Callable

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.effects.actuator_inputs import ActuatorInputs
from rovid.jit.decorators import compiled

# Delays over which a range of delays is averaged.
_DELAYS = 5
# Least relative difference of the time constants of two lags in series; the response changes by half of it.
_APART = 1e-4
# Intervals that differ by no more than this share count as equal.
_SAME = 1e-9


def speed_of_thrust(inputs: ActuatorInputs, thrust: FloatArray, time_constant: float) -> FloatArray:
    """(n,) estimate of the speed ahead in N^0.5 from (n, k) thrusts in N, if it is not logged.

    The steady speed is proportional to the root of the thrust ahead, and follows it with a lag. The constant factor is
    part of the coefficient by which the speed is multiplied.
    """
    ahead = inputs.weighted_sum(thrust, inputs.forward_share)
    return inputs.apply_per_trial(lagged, np.sign(ahead) * np.sqrt(np.abs(ahead)), time_constant)


@compiled
def lagged(time: FloatArray, values: FloatArray, time_constant: float) -> FloatArray:
    """Mean until the next instant of (n,) held ``values`` behind a first-order lag, in equilibrium at the start."""
    n = len(time)
    out = np.empty(n)
    state, before, decay, mean = values[0], 0.0, 1.0, 1.0
    for k in range(n):
        interval = time[k + 1] - time[k] if k + 1 < n else 0.0
        if time_constant <= 0.0 or interval <= 0.0:
            state = values[k] if time_constant <= 0.0 else state
            out[k] = state
            continue
        # Most logs are sampled evenly, except for rounding: values that depend on the interval alone are kept.
        if abs(interval - before) > _SAME * before:
            before, decay = interval, math.exp(-interval / time_constant)
            mean = (1.0 - decay) * time_constant / interval
        offset = state - values[k]
        out[k] = values[k] + offset * mean
        state = values[k] + offset * decay
    return out


@compiled
def lagged_unequally(time: FloatArray, values: FloatArray, growing: float, falling: float) -> FloatArray:
    """As ``lagged``, with the lag ``growing`` while the size is below that of the held value, else ``falling``."""
    n = len(time)
    out = np.empty(n)
    state = values[0]
    for k in range(n):
        whole = time[k + 1] - time[k] if k + 1 < n else 0.0
        goal, area, first, lag = values[k], 0.0, whole, growing
        if abs(goal) <= abs(state):
            lag = falling
            if goal * state < 0.0:
                # A reversal falls to the size of the new value, and then crosses zero.
                first = min(whole, falling * math.log(0.5 - 0.5 * state / goal))
        for part in (first, whole - first):
            gap = state - goal
            left = gap * math.exp(-part / lag) if lag > 0.0 and part > 0.0 else gap * (part <= 0.0)
            area += goal * part + lag * (gap - left)
            state, lag = goal + left, growing
        out[k] = area / whole if whole > 0.0 else state
    return out


@compiled
def lagged_in_series(time: FloatArray, values: FloatArray, first: float, second: float) -> FloatArray:
    """Mean until the next instant of (n,) held ``values`` behind two first-order lags, in equilibrium at the start."""
    if first <= 0.0 or second <= 0.0:
        return lagged(time, values, max(first, second))
    # Each response is a sum of two exponentials, which equal time constants would divide by zero.
    if abs(second - first) < _APART * first:
        second = first * (1.0 + _APART)
    n = len(time)
    out = np.empty(n)
    middle = state = values[0]
    for k in range(n):
        interval = time[k + 1] - time[k] if k + 1 < n else 0.0
        if interval <= 0.0:
            out[k] = state
            continue
        one, other = math.exp(-interval / first), math.exp(-interval / second)
        of_first = (middle - values[k]) * first / (first - second)
        of_second = state - values[k] - of_first
        out[k] = values[k] + (of_first * first * (1.0 - one) + of_second * second * (1.0 - other)) / interval
        middle = values[k] + (middle - values[k]) * one
        state = values[k] + of_first * one + of_second * other
    return out


@compiled
def slewed(time: FloatArray, values: FloatArray, rate: float) -> FloatArray:
    """Mean until the next instant of a signal that follows (n,) held ``values`` with a limited ``rate`` in 1/s."""
    return _limited(time, values, rate, False)


@compiled
def soft_started(time: FloatArray, values: FloatArray, rate: float) -> FloatArray:
    """As ``slewed``, but only the growth of the magnitude is limited."""
    return _limited(time, values, rate, True)


@compiled
def _limited(time: FloatArray, values: FloatArray, rate: float, falls_freely: bool) -> FloatArray:
    n = len(time)
    out = np.empty(n)
    state = values[0]
    for k in range(n):
        interval = time[k + 1] - time[k] if k + 1 < n else 0.0
        if falls_freely:
            if state * values[k] < 0.0:
                state = 0.0
            if abs(values[k]) <= abs(state):
                out[k] = state = values[k]
                continue
        gap = values[k] - state
        reach = rate * interval
        moved = min(max(gap, -reach), reach)
        # Mean of a ramp that ends within the interval.
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
        # The rotor turns the other way: first down to zero.
        phase = math.atan(start / goal)
        left += phase / goal
        if left <= 0.0:
            return sign * goal * math.tan(goal * interval + phase)
        start = 0.0
    growth = math.tanh(goal * left)
    return sign * goal * (start + goal * growth) / (goal + start * growth)


@compiled
def rotor_lagged(time: FloatArray, thrust: FloatArray, time_constant: float) -> FloatArray:
    """Mean thrust until the next instant of a rotor with square-law load (Yoerger et al. 1990).

    ``thrust``: (n,) held steady thrust of the rotor, over the reference thrust.
    ``time_constant``: s; for small changes at the reference thrust: n' = (thrust - n*|n|) / (2*time_constant).
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
            # Integrating the equation of motion gives the mean of n*|n|.
            out[k] = thrust[k] - (new - speed) / scaled
            speed = new
    return out


@compiled
def latched(_: FloatArray, excess: FloatArray, width: float, ramp: float) -> FloatArray:
    """(n,) ``excess`` behind a switch that closes above ``width`` and opens at zero or at a change of sign.

    The switch is open at the start. It closes over a range of the excess that is ``ramp`` times ``width`` wide.
    """
    out = np.empty(len(excess))
    on = 0.0
    before = 0.0
    for k in range(len(excess)):
        if excess[k] * before <= 0.0:
            on = 0.0
        on = max(on, ramp_up(abs(excess[k]), width, ramp))
        out[k] = on * excess[k]
        before = excess[k]
    return out


@compiled
def ramp_up(size: float, threshold: float, ramp: float) -> float:
    """Linear ramp from 0 to 1 as ``size`` passes ``threshold``, over the share ``ramp`` of it."""
    if threshold <= 0.0:
        return 1.0
    return min(max((size / threshold - 1.0) / ramp + 0.5, 0.0), 1.0)


@compiled
def played(_: FloatArray, values: FloatArray, width: float) -> FloatArray:
    """Output of a backlash (play) of total ``width`` for (n,) ``values``."""
    out = np.empty(len(values))
    state = values[0]
    for k in range(len(values)):
        state = min(max(state, values[k] - 0.5 * width), values[k] + 0.5 * width)
        out[k] = state
    return out


@compiled
def root_slewed(time: FloatArray, values: FloatArray, rate: float) -> FloatArray:
    """The squared ``slewed`` root of (n,) held ``values``: a thrust goes with the square of the command."""
    root = slewed(time, np.sign(values) * np.sqrt(np.abs(values)), rate)
    return root * np.abs(root)


@compiled
def root_played(time: FloatArray, values: FloatArray, width: float) -> FloatArray:
    """As ``root_slewed``, of ``played``."""
    root = played(time, np.sign(values) * np.sqrt(np.abs(values)), width)
    return root * np.abs(root)


@compiled
def delayed(time: FloatArray, values: FloatArray, delay: float) -> FloatArray:
    """Mean until the next instant of (n,) held ``values`` with a ``delay`` in s; before, the first value."""
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
def waited(time: FloatArray, values: FloatArray, delay: float) -> FloatArray:
    """Mean until the next instant of (n,) held ``values`` that are zero for ``delay`` s after each change of sign."""
    n = len(values)
    out = np.empty(n)
    before, until = 0.0, time[0]
    for k in range(n):
        if values[k] * before < 0.0:
            until = time[k] + delay
        if values[k] != 0.0:
            before = values[k]
        interval = time[k + 1] - time[k] if k + 1 < n else 0.0
        left = max(until - time[k], 0.0)
        out[k] = values[k] * (1.0 - min(left / interval, 1.0)) if interval > 0.0 else values[k] * (left <= 0.0)
    return out


@compiled
def mean_delayed(time: FloatArray, values: FloatArray, shortest: float, longest: float) -> FloatArray:
    """Mean of ``delayed`` over delays from the ``shortest`` to the ``longest``."""
    out = np.zeros(len(values))
    for number in range(_DELAYS):
        out += delayed(time, values, shortest + (number + 0.5) / _DELAYS * (longest - shortest))
    return out / _DELAYS


@compiled
def pending_changes(time: FloatArray, values: FloatArray, shortest: float, longest: float) -> FloatArray:
    """Sum of squared changes of (n,) ``values`` that the shortest delay has passed, and the longest not yet."""
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
        # Remove the rounding error when nothing is pending.
        total = total if late < early else 0.0
        out[k] = total
    return out


# Loops with the number of further arguments, in the order in which a diagnosis needs them.
LOOPS: tuple[tuple[Callable[..., FloatArray], int], ...] = (
    (lagged, 1),
    (lagged_in_series, 2),
    (delayed, 1),
    (waited, 1),
    (pending_changes, 2),
    (mean_delayed, 2),
    (rotor_lagged, 1),
    (latched, 2),
    (slewed, 1),
    (soft_started, 1),
    (played, 1),
)
