"""Compiled extended Kalman filter of the planar model, with the states of `rovid.planar.equations`."""

import math
from typing import Any

import numpy as np

from rovid.jit.decorators import compiled
from rovid.planar.equations import (
    CURRENT,
    FORCE,
    HEADING,
    MAX_SUBSTEPS,
    NORTH,
    STATES,
    STEP_SHARE,
    SURGE,
    YAW,
    advance_state,
    fastest,
    has_couplings,
    slopes,
    speed_jacobian,
)
from rovid.planar.model import CURRENT_INDEX, PLACE_INDEX, SENSORS

# Entries of ``noise``: standard deviations of the disturbances in N and N m, their correlation times in s, the standard
# deviation of each sensor, and the latency of each sensor in s beyond that of its stamps.
NOISE_STD, NOISE_TIME, NOISE_SENSOR = 0, 3, 6
NOISE_LATENCY = NOISE_SENSOR + len(SENSORS)
NOISE_COUNT = NOISE_LATENCY + len(SENSORS)
# First of the sensors of a position; states of a filter without position and wandering current, in whole SIMD vectors.
_POSITIONS, _WITHOUT_POSITION = SENSORS.index("north"), 8


@compiled
def filter_runs(
    offsets: Any,
    time: Any,
    inputs: Any,
    event_offsets: Any,
    sensors: Any,
    values: Any,
    starts: Any,
    start_std: Any,
    speed_scale: Any,
    yaw_only: bool,
    c: Any,
    noise: Any,
    error: Any,
    variance: Any,
    states: Any,
) -> None:
    """Filter one run after the other; write the innovations and their variances.

    ``offsets``: (runs + 1,) first instant of each run.
    ``time``, ``inputs``: (n,) s; (n, k) inputs from each instant to the next.
    ``event_offsets``, ``sensors``, ``values``: (n + 1,) first measurement at each instant; (m,) sensor and value of
        each measurement.
    ``starts``, ``start_std``: (runs, 6) first heading, u, v over ground, r, north, east; their standard deviations, for
        heading and position beyond the sensor's noise.
    ``c``, ``noise``: Coefficients of `rovid.planar.model`, and `NOISE_STD` and so on.
    ``error``, ``variance``: (m,) written.
    ``states``: (n, 12) filtered states, written if it has rows.
    """
    keep, wander = len(states) > 0, c[CURRENT_INDEX + 2]
    located = not yaw_only and (keep or bool(np.any(sensors >= _POSITIONS)))
    # A filter without position and wandering current has no covariance of these states.
    size = STATES if located or wander > 0.0 else _WITHOUT_POSITION
    p, t, f = np.zeros((size, size)), np.zeros((size, size)), np.zeros((STATES, STATES))
    column, x = np.zeros(size), np.zeros(STATES)
    jacobian, decays, coupled = np.zeros((3, 3)), np.ones((2, 4)), has_couplings(c)
    leak = max(1.0 / noise[NOISE_TIME], 1.0 / noise[NOISE_TIME + 1], 1.0 / noise[NOISE_TIME + 2])
    north, east, last_h = c[CURRENT_INDEX], c[CURRENT_INDEX + 1], -1.0
    for run in range(len(offsets) - 1):
        _start(c, yaw_only, noise, starts[run], start_std[run], x, p)
        speed_jacobian(c, coupled, inputs[offsets[run]], speed_scale, x[1], x[2], x[3], jacobian)
        for k in range(offsets[run], offsets[run + 1]):
            if k > offsets[run]:
                interval, held = time[k] - time[k - 1], inputs[k - 1]
                rate = max(fastest(c, jacobian, yaw_only), leak)
                steps = min(int(interval * rate / STEP_SHARE) + 1, MAX_SUBSTEPS)
                h = interval / steps
                if abs(h - last_h) > 1e-9 * h:
                    last_h = h
                    for axis in range(3):
                        decays[0, axis] = math.exp(-0.5 * h / noise[NOISE_TIME + axis])
                        decays[1, axis] = decays[0, axis] ** 2
                    decays[1, 3] = math.exp(-h / c[CURRENT_INDEX + 3])
                for _ in range(steps):
                    _step(c, coupled, yaw_only, located, held, speed_scale, noise, decays, h, x, jacobian, f)
                    _propagate(f, p, t)
                    _add_noise(c, yaw_only, located, noise, decays, h, x[HEADING], jacobian, p)
                    if size == STATES:
                        add = (1.0 - decays[1, 3] ** 2) * wander**2
                        p[CURRENT, CURRENT] += add
                        p[CURRENT + 1, CURRENT + 1] += add
            for m in range(event_offsets[k], event_offsets[k + 1]):
                late = 0.0
                if noise[NOISE_LATENCY + sensors[m]] != 0.0:
                    held = inputs[max(k - 1, offsets[run])]
                    slope = _sensor_slope(c, coupled, yaw_only, held, north, east, sensors[m], x)
                    late = noise[NOISE_LATENCY + sensors[m]] * slope
                error[m], variance[m] = _update(c, noise, sensors[m], values[m] + late, x, p, column)
            if keep:
                states[k] = x


@compiled
def _start(c: Any, yaw_only: bool, noise: Any, start: Any, std: Any, x: Any, p: Any) -> None:
    """Write the state and its covariance at the first instant of a run; see `filter_runs`."""
    p[:] = 0.0
    x[:] = 0.0
    cosine, sine = math.cos(start[0]), math.sin(start[0])
    x[HEADING], x[YAW] = start[0], start[3]
    p[HEADING, HEADING] = noise[NOISE_SENSOR] ** 2 + std[0] ** 2
    p[YAW, YAW] = std[3] ** 2
    p[FORCE + 2, FORCE + 2] = noise[2] ** 2
    if not yaw_only:
        north, east = c[CURRENT_INDEX], c[CURRENT_INDEX + 1]
        x[SURGE] = start[1] - north * cosine - east * sine
        x[SURGE + 1] = start[2] + north * sine - east * cosine
        ahead, aside = c[PLACE_INDEX + 2], c[PLACE_INDEX + 3]
        x[NORTH] = start[4] - ahead * cosine + aside * sine
        x[NORTH + 1] = start[5] - ahead * sine - aside * cosine
        for k in range(2):
            p[SURGE + k, SURGE + k] = std[1 + k] ** 2
            p[FORCE + k, FORCE + k] = noise[k] ** 2
            if len(p) == STATES:
                p[NORTH + k, NORTH + k] = noise[NOISE_SENSOR + _POSITIONS + k] ** 2 + std[4 + k] ** 2
                p[CURRENT + k, CURRENT + k] = c[CURRENT_INDEX + 2] ** 2


@compiled
def _step(
    c: Any,
    coupled: bool,
    yaw_only: bool,
    located: bool,
    held: Any,
    speed_scale: Any,
    noise: Any,
    decays: Any,
    h: float,
    x: Any,
    jacobian: Any,
    f: Any,
) -> None:
    """Advance the state ``x`` by ``h`` s, and write its transition matrix ``f``."""
    psi, u, v, r = x[0], x[1], x[2], x[3]
    north, east = c[CURRENT_INDEX] + x[CURRENT], c[CURRENT_INDEX + 1] + x[CURRENT + 1]
    advance_state(c, coupled, yaw_only, located, held, decays, h, north, east, x)
    for k in range(3):
        x[FORCE + k] *= decays[1, k]
    for k in range(2):
        x[CURRENT + k] *= decays[1, 3]
    um, vm, rm, pm = 0.5 * (u + x[1]), 0.5 * (v + x[2]), 0.5 * (r + x[3]), 0.5 * (psi + x[0])
    speed_jacobian(c, coupled, held, speed_scale, um, vm, rm, jacobian)
    if yaw_only:
        jacobian[0], jacobian[1] = 0.0, 0.0
        jacobian[2, 0], jacobian[2, 1] = 0.0, 0.0
    j = jacobian
    # Powers of the Jacobian, and the series of exp(J h), its integral and its second integral.
    f[HEADING, HEADING] = 1.0
    f[CURRENT, CURRENT], f[CURRENT + 1, CURRENT + 1] = decays[1, 3], decays[1, 3]
    cosine, sine = (math.cos(pm), math.sin(pm)) if located else (1.0, 0.0)
    if located:
        f[NORTH, HEADING] = h * (-um * sine - vm * cosine)
        f[NORTH + 1, HEADING] = h * (um * cosine - vm * sine)
        f[NORTH, NORTH], f[NORTH + 1, NORTH + 1] = 1.0, 1.0
        f[NORTH, CURRENT], f[NORTH + 1, CURRENT + 1] = h, h
    for b in range(3):
        first = (j[0, b], j[1, b], j[2, b])
        second = _times(j, first)
        third = _times(j, second)
        _write_series(f, 1 + b, h, located, cosine, sine, first, second, third, _times(j, third))
        f[1 + b, 1 + b] += 1.0
    f[HEADING, 3] += h
    if located:
        turn = h * h / 2.0
        f[NORTH, 1] += h * cosine
        f[NORTH, 2] -= h * sine
        f[NORTH + 1, 1] += h * sine
        f[NORTH + 1, 2] += h * cosine
        f[NORTH, 3] += turn * (-um * sine - vm * cosine)
        f[NORTH + 1, 3] += turn * (um * cosine - vm * sine)
    scale = 1.0 / (c[1] * c[2] - c[3] * c[3])
    for b in range(3):
        if yaw_only and b < 2:
            continue
        first = _response(c, scale, yaw_only, b)
        second = _times(j, first)
        third = _times(j, second)
        fourth = _times(j, third)
        # Forces decay: each power of J comes with the lower powers of the decay rate.
        leak = -1.0 / noise[NOISE_TIME + b]
        second = _plus(second, leak, first)
        third = _plus(third, leak, second)
        _write_series(f, 4 + b, h, located, cosine, sine, first, second, third, _plus(fourth, leak, third))
        f[4 + b, 4 + b] = decays[1, b]


@compiled
def _times(j: Any, a: Any) -> tuple[float, float, float]:
    """Product of the (3, 3) ``j`` and a vector."""
    return (
        j[0, 0] * a[0] + j[0, 1] * a[1] + j[0, 2] * a[2],
        j[1, 0] * a[0] + j[1, 1] * a[1] + j[1, 2] * a[2],
        j[2, 0] * a[0] + j[2, 1] * a[1] + j[2, 2] * a[2],
    )


@compiled
def _plus(a: Any, factor: float, b: Any) -> tuple[float, float, float]:
    return a[0] + factor * b[0], a[1] + factor * b[1], a[2] + factor * b[2]


@compiled
def _write_series(
    f: Any, at: int, h: float, located: bool, cosine: float, sine: float, a: Any, b: Any, c: Any, d: Any
) -> None:
    """Write the column ``at`` of the transition matrix: series over ``h`` s with the derivatives ``a`` to ``d``."""
    for i in range(3):
        f[1 + i, at] = h * (a[i] + h / 2.0 * (b[i] + h / 3.0 * (c[i] + h / 4.0 * d[i])))
    f[HEADING, at] = h * h / 2.0 * (a[2] + h / 3.0 * (b[2] + h / 4.0 * c[2]))
    if located:
        x, y = h * h / 2.0 * (a[0] + h / 3.0 * b[0]), h * h / 2.0 * (a[1] + h / 3.0 * b[1])
        f[NORTH, at], f[NORTH + 1, at] = x * cosine - y * sine, x * sine + y * cosine


@compiled
def _response(c: Any, scale: float, yaw_only: bool, axis: int) -> tuple[float, float, float]:
    """Accelerations by a unit force along ``axis``: a column of the inverse mass matrix."""
    if axis == 0:
        return 1.0 / c[0], 0.0, 0.0
    if axis == 1:
        return 0.0, c[2] * scale, -c[3] * scale
    if yaw_only:
        return 0.0, 0.0, 1.0 / c[2]
    return 0.0, -c[3] * scale, c[1] * scale


@compiled
def _propagate(f: Any, p: Any, t: Any) -> None:
    """``p`` = f p f' with the zeros of the transition matrix left out; ``t`` is overwritten with f p."""
    size = len(p)
    for i in range(4):
        f0, f1, f2, f3, f4, f5, f6 = _row(f, i)
        for k in range(size):
            forces = f4 * p[4, k] + f5 * p[5, k] + f6 * p[6, k]
            t[i, k] = f0 * p[0, k] + f1 * p[1, k] + f2 * p[2, k] + f3 * p[3, k] + forces
    for i in range(4, min(size, NORTH)):
        own = f[i, i]
        for k in range(size):
            t[i, k] = own * p[i, k]
    for i in range(NORTH, size - 1):
        f0, f1, f2, f3, f4, f5, f6 = _row(f, i)
        own = f[i, i - 2]
        for k in range(size):
            forces = f4 * p[4, k] + f5 * p[5, k] + f6 * p[6, k]
            motion = f0 * p[0, k] + f1 * p[1, k] + f2 * p[2, k] + f3 * p[3, k]
            t[i, k] = p[i, k] + motion + forces + own * p[i - 2, k]
    # The product with f' is symmetric: its lower triangle, by columns.
    for k in range(4):
        f0, f1, f2, f3, f4, f5, f6 = _row(f, k)
        for i in range(k, size):
            forces = f4 * t[i, 4] + f5 * t[i, 5] + f6 * t[i, 6]
            p[i, k] = f0 * t[i, 0] + f1 * t[i, 1] + f2 * t[i, 2] + f3 * t[i, 3] + forces
            p[k, i] = p[i, k]
    for k in range(4, min(size, NORTH)):
        own = f[k, k]
        for i in range(k, size):
            p[i, k] = own * t[i, k]
            p[k, i] = p[i, k]
    for k in range(NORTH, size - 1):
        f0, f1, f2, f3, f4, f5, f6 = _row(f, k)
        own = f[k, k - 2]
        for i in range(k, size - 1):
            forces = f4 * t[i, 4] + f5 * t[i, 5] + f6 * t[i, 6]
            motion = f0 * t[i, 0] + f1 * t[i, 1] + f2 * t[i, 2] + f3 * t[i, 3]
            p[i, k] = t[i, k] + motion + forces + own * t[i, k - 2]
            p[k, i] = p[i, k]


@compiled
def _row(f: Any, i: int) -> tuple[float, float, float, float, float, float, float]:
    """Entries of a row of the transition matrix for heading, speeds and forces."""
    return f[i, 0], f[i, 1], f[i, 2], f[i, 3], f[i, 4], f[i, 5], f[i, 6]


@compiled
def _add_noise(
    c: Any, yaw_only: bool, located: bool, noise: Any, decays: Any, h: float, psi: float, jacobian: Any, p: Any
) -> None:
    """Add the covariance of the disturbances' white noise over a step, by Simpson's rule over the response to it."""
    j = jacobian
    cosine, sine = (math.cos(psi), math.sin(psi)) if located else (1.0, 0.0)
    scale = 1.0 / (c[1] * c[2] - c[3] * c[3])
    for b in range(3):
        if yaw_only and b < 2:
            continue
        first = _response(c, scale, yaw_only, b)
        a0, a1, a2 = first
        b0, b1, b2 = _plus(_times(j, first), -1.0 / noise[NOISE_TIME + b], first)
        power = 2.0 * noise[b] ** 2 / noise[NOISE_TIME + b]
        # At the end of the step the noise moves the force alone.
        p[FORCE + b, FORCE + b] += power * h / 6.0
        for part in range(1, 3):
            s = 0.5 * h * part
            weight = power * h / 6.0 * (4.0 if part == 1 else 1.0)
            half = s * s / 2.0
            u, v, r = s * (a0 + s / 2.0 * b0), s * (a1 + s / 2.0 * b1), s * (a2 + s / 2.0 * b2)
            k, e, q = FORCE + b, decays[part - 1, b], half * (a2 + s / 3.0 * b2)
            p[k, k] += weight * e * e
            for row in range(4):
                value = q if row == 0 else (u if row == 1 else (v if row == 2 else r))
                p[k, row] += weight * e * value
                p[row, k] += weight * e * value
                p[row, 0] += weight * value * q
                p[row, 1] += weight * value * u
                p[row, 2] += weight * value * v
                p[row, 3] += weight * value * r
            if located:
                x, y = half * (a0 * cosine - a1 * sine), half * (a0 * sine + a1 * cosine)
                for row, value in ((0, q), (1, u), (2, v), (3, r), (k, e)):
                    p[row, 9] += weight * value * x
                    p[9, row] += weight * value * x
                    p[row, 10] += weight * value * y
                    p[10, row] += weight * value * y
                p[9, 9] += weight * x * x
                p[9, 10] += weight * x * y
                p[10, 9] += weight * x * y
                p[10, 10] += weight * y * y


@compiled
def _sensor_slope(  # noqa: PLR0911 - one for each sensor
    c: Any, coupled: bool, yaw_only: bool, held: Any, north: float, east: float, sensor: int, x: Any
) -> float:
    """Derivative in time of what a sensor measures."""
    if sensor == 0:
        return float(x[YAW])
    cosine, sine, r = math.cos(x[HEADING]), math.sin(x[HEADING]), x[YAW]
    if sensor == 4:
        return float(x[1] * cosine - x[2] * sine + north + x[CURRENT])
    if sensor == 5:
        return float(x[1] * sine + x[2] * cosine + east + x[CURRENT + 1])
    if yaw_only:
        return float((held[2] + x[FORCE + 2] - (c[6] + c[9] * abs(r)) * r) / c[2])
    du, dv, dr = slopes(c, coupled, held, x[1], x[2], r, x[FORCE], x[FORCE + 1], x[FORCE + 2])
    vn, ve = north + x[CURRENT], east + x[CURRENT + 1]
    if sensor == 1:
        return float(dr)
    if sensor == 2:
        return float(du + r * (ve * cosine - vn * sine))
    return float(dv - r * (vn * cosine + ve * sine))


@compiled
def _update(c: Any, noise: Any, sensor: int, value: float, x: Any, p: Any, column: Any) -> tuple[float, float]:
    """Update state and covariance with one measurement; its innovation and variance."""
    if sensor < 2:
        at = HEADING if sensor == 0 else YAW
        predicted = x[at]
        for k in range(len(p)):
            column[k] = p[at, k]
        spread = column[at]
    else:
        cosine, sine = math.cos(x[HEADING]), math.sin(x[HEADING])
        vn, ve = c[CURRENT_INDEX] + x[CURRENT], c[CURRENT_INDEX + 1] + x[CURRENT + 1]
        ahead, across = vn * cosine + ve * sine, -vn * sine + ve * cosine
        place = PLACE_INDEX if sensor < 4 else PLACE_INDEX + 2
        lx, ly = c[place], c[place + 1]
        by_north, by_east, by_rate = 0.0, 0.0, 0.0
        if sensor == 2:
            at, predicted, by_heading = 1, x[1] + ahead - ly * x[YAW], across
            by_north, by_east, by_rate = cosine, sine, -ly
        elif sensor == 3:
            at, predicted, by_heading = 2, x[2] + across + lx * x[YAW], -ahead
            by_north, by_east, by_rate = -sine, cosine, lx
        elif sensor == 4:
            at, predicted, by_heading = NORTH, x[NORTH] + lx * cosine - ly * sine, -lx * sine - ly * cosine
        else:
            at, predicted, by_heading = NORTH + 1, x[NORTH + 1] + lx * sine + ly * cosine, lx * cosine - ly * sine
        for k in range(len(p)):
            column[k] = p[at, k] + by_heading * p[0, k] + by_rate * p[YAW, k]
        spread = column[at] + by_heading * column[0] + by_rate * column[YAW]
        if len(p) == STATES:
            for k in range(STATES):
                column[k] += by_north * p[CURRENT, k] + by_east * p[CURRENT + 1, k]
            spread = column[at] + by_heading * column[0] + by_rate * column[YAW]
            spread += by_north * column[CURRENT] + by_east * column[CURRENT + 1]
    error, variance = value - predicted, spread + noise[NOISE_SENSOR + sensor] ** 2
    gain = error / variance
    for i in range(len(p)):
        x[i] += column[i] * gain
        scaled = column[i] / variance
        for k in range(len(p)):
            p[i, k] -= scaled * column[k]
    return error, variance
