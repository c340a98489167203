"""A Kalman filter of angle, rate and a coloured disturbance, and of two states more that swing."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from rovid.effects.base import TERM_STATES
from rovid.ground.arrays import FloatArray
from rovid.ground.compiled import compiled
from rovid.model.kernels.covariance import add_noise, congruence, transition
from rovid.model.kernels.filter import FILTER_STEP_SHARE, filter_steps
from rovid.model.kernels.step import step
from rovid.model.kernels.torque import torque_of


@compiled
def innovations_wide(  # noqa: PLR0912, PLR0915 - one filter, from top to bottom
    time: FloatArray,
    torque: FloatArray,
    beside: FloatArray,
    moment: FloatArray,
    scatter: FloatArray,
    angle: FloatArray,
    rate: FloatArray,
    equation: Any,
    noise: FloatArray,
    wave: FloatArray,
    begin: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """As ``innovations``, with two states more: a narrow-band torque of random phase, or those of an effect that rings.

    The wave is a second-order shaping filter driven by white noise (Fossen 2011, section 8.2.6). The states of an
    effect that ``rings`` are no better known than the motion that sets them off. Beside a wave they have no
    variance of their own.

    Parameters
    ----------
    wave
        Root 2 times the standard deviation of the wave in N m, its frequency in rad/s and the damping of its filter;
        empty where there is none.
    """
    body, terms = equation.body, equation.terms
    n, inertia, sigma, tau, waves = len(time), body.inertia, noise[0], noise[1], len(wave) > 0
    rows = len(terms.kinds)
    state, work = np.zeros((rows, TERM_STATES)), np.zeros((3, rows, TERM_STATES))
    innovation, variance = np.full((n, 2), np.nan), np.full((n, 2), np.nan)
    ringing = terms.ringing
    # Angle, rate, disturbance, and the two.
    a, r, d, w, v = angle[0], begin[0], 0.0, 0.0, 0.0
    p, f, q = np.zeros((5, 5)), np.zeros((5, 5)), np.zeros((5, 5))
    slopes, room = np.zeros((5, 5)), np.zeros((5, 5))
    origin, damping = angle[0], body.linear_drag / inertia
    p[0, 0], p[1, 1], p[2, 2] = noise[2] ** 2, begin[1] ** 2, sigma**2
    # Of the first and fourth state it is known: they are the integrals of those behind them.
    slopes[1, 0], slopes[1, 2], slopes[2, 2] = -body.stiffness / inertia, 1.0 / inertia, -1.0 / tau
    frequency, leak, power = terms.fastest, 0.0, 0.0
    if waves:
        frequency, leak, power = wave[1], 2.0 * wave[2] * wave[1], 0.5 * wave[0] ** 2
        p[3, 3], p[4, 4] = power, power * frequency**2
        slopes[1, 3], slopes[4, 3], slopes[4, 4] = 1.0 / inertia, -(frequency**2), -leak
    else:
        _ring(slopes, equation, state, work[0])
    for k in range(n):
        if k > 0:
            told = beside[k - 1, 0], beside[k - 1, 1], beside[k - 1, 2]
            push, interval = torque[k - 1], time[k] - time[k - 1]
            steps = filter_steps(interval, r, push, damping, 1.0 / tau + frequency, body)
            h = interval / steps
            fade = math.exp(-h / tau)
            mean = (1.0 - fade) * tau / h
            shares = max(math.ceil(h * terms.fastest / FILTER_STEP_SHARE), 1)
            for _ in range(steps):
                faded, swung, slope, other = d * fade, 0.0, 0.0, d * mean
                if waves:
                    bend = -leak * v - frequency**2 * w
                    jerk = -leak * bend - frequency**2 * v
                    jolt = -leak * jerk - frequency**2 * bend
                    swung = w + h * (v + h / 2.0 * (bend + h / 3.0 * (jerk + h / 4.0 * jolt)))
                    slope = v + h * (bend + h / 2.0 * (jerk + h / 3.0 * jolt))
                    # Its mean over the step.
                    other += w + h / 2.0 * (v + h / 3.0 * (bend + h / 4.0 * (jerk + h / 5.0 * jolt)))
                for _ in range(shares):
                    r, a, damping = step(r, a - origin, push, other, told, equation, state, work, h / shares)
                    a += origin
                # What of it comes late in the step turns the vehicle less.
                late = -(swung - w + faded - d) * h**2 / (12.0 * inertia)
                a += late
                r -= damping * late
                d, w, v = faded, swung, slope
                slopes[1, 1] = -damping
                transition(slopes, h, f)
                q[:] = 0.0
                add_noise(slopes, 2, sigma * math.sqrt(2.0 / tau), h, q)
                if waves:
                    add_noise(slopes, 4, frequency * math.sqrt(2.0 * leak * power), h, q)
                congruence(f, p, q, room)
            a += moment[k - 1] / inertia
            r -= damping * moment[k - 1] / inertia
            kick = scatter[k - 1] / inertia**2
            p[0, 0] += kick * interval**2 / 3.0
            p[0, 1] += kick * interval / 2.0
            p[1, 0] += kick * interval / 2.0
            p[1, 1] += kick
        for m in range(2):
            reading, known = (angle[k], a) if m == 0 else (rate[k], r)
            if not math.isnan(reading):
                s = p[m, m] + noise[2 + m] ** 2
                e = reading - known
                innovation[k, m], variance[k, m] = e, s
                a += p[m, 0] / s * e
                r += p[m, 1] / s * e
                d += p[m, 2] / s * e
                if waves:
                    w += p[m, 3] / s * e
                    v += p[m, 4] / s * e
                else:
                    state[ringing, 0] += p[m, 3] / s * e
                    state[ringing, 1] += p[m, 4] / s * e
                for i in range(5):
                    room[0, i] = p[m, i]
                for i in range(5):
                    for j in range(5):
                        p[i, j] -= room[0, i] * room[0, j] / s
    return innovation, variance


@compiled
def _ring(slopes: Any, equation: Any, state: Any, change: Any) -> None:
    """Fill in how the two states of the term that rings act on the rate, and how the second follows from all three."""
    told, ringing = (0.0, 0.0, 0.0), equation.terms.ringing
    torque_of(1.0, 0.0, 0.0, told, equation, state, change)
    slopes[4, 1] = change[ringing, 1]
    rest = torque_of(0.0, 0.0, 0.0, told, equation, state, change)
    for j in range(2):
        state[ringing, j] = 1.0
        pull = torque_of(0.0, 0.0, 0.0, told, equation, state, change) - rest
        slopes[1, 3 + j] = pull / equation.body.inertia
        slopes[4, 3 + j] = change[ringing, 1]
        state[ringing, j] = 0.0
