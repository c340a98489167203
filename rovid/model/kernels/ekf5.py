"""Kalman filters of angle, rate and a coloured disturbance, and of two states more that swing, several side by side."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.effects.base import TERM_STATES
from rovid.jit.decorators import njit_inline, njit_noalloc
from rovid.jit.simd import LANES, broadcast, exp, extract, load, minimum, reduce_max, sqrt, store
from rovid.model.kernels.covariance5 import (
    DAMPED,
    POINTS,
    POWERS,
    SERIES,
    SIZE,
    Swing,
    add_noise,
    add_point,
    by_series,
    congruence,
    take,
    transition,
)
from rovid.model.kernels.effect_terms import SCRATCH_ROWS, torque_at
from rovid.model.kernels.ekf3 import SAME, filter_steps, pace_of
from rovid.model.kernels.rk4_step import bare_step, brakes, shares_of, step
from rovid.model.kernels.simd_io import beside_of, body_of, clear, each, put
from rovid.model.kernels.warmup import warmed_up
from rovid.model.packed_terms import Equation

# The transition of sixth order is good to a percent of a percent with such steps.
_STEP_SHARE = 0.6
# After so many intervals with steps of one length series in the damping are worked out for it, which takes as long as
# ten steps without them.
_WORTH_A_SERIES = 32
# So many lengths are remembered: intervals differ, and are stepped through by how fast the vehicle may turn. Of each
# the series, behind which stand the length in s, for how many intervals it did, and what a step leaves of the
# disturbance in the end and in the mean.
_LENGTHS, _LENGTH, _INTERVALS, _FADE, _MEAN = 16, SERIES, SERIES + 1, SERIES + 2, SERIES + 3


def ekf5_innovations(logged: Any, driven: Any, models: Any) -> tuple[FloatArray, FloatArray]:
    """As ``innovations``, with two states more: a narrow-band torque of random phase, or those of an effect that rings.

    The wave is a second-order shaping filter driven by white noise (Fossen 2011, section 8.2.6). The states of an
    effect that ``rings`` are no better known than the motion that sets them off. Beside a wave they have no
    variance of their own.
    """
    rows, count = TERM_STATES * len(models.terms.kinds), logged.row.max() + 1
    innovation, variance = np.empty((2, LANES, count))
    state, work = np.zeros((rows, LANES)), np.zeros((3, rows + SCRATCH_ROWS, LANES))
    matrices, series = np.zeros((4, SIZE * SIZE, LANES)), np.zeros((_LENGTHS, _MEAN + 1, LANES))
    _filter(logged, driven, models, state, work, matrices, series, innovation, variance)
    return innovation, variance


@warmed_up
@njit_noalloc
def _filter(  # noqa: PLR0912, PLR0915 - one filter, from top to bottom
    logged: Any,
    driven: Any,
    models: Any,
    state: Any,
    work: Any,
    matrices: Any,
    series: Any,
    innovation: Any,
    variance: Any,
) -> None:
    """Through one run after the other; fills in what ``innovations`` gives."""
    time, terms, body, waves = logged.time, models.terms, body_of(models.body), len(models.wave) > 0
    ringing, p, f, q, room = TERM_STATES * terms.ringing, matrices[0], matrices[1], matrices[2], matrices[3]
    sigma, tau = load(models.noise, 0), load(models.noise, 1)
    brake, b, zero = brakes(body), 1.0 / tau, broadcast(0.0)
    inverse = brake[2]
    drive = sigma * sqrt(2.0 * b)
    frequency, leak, power, kicks = broadcast(terms.fastest), zero, zero, zero
    if waves:
        frequency = load(models.wave, 1)
        leak = 2.0 * load(models.wave, 2) * frequency
        power = 0.5 * load(models.wave, 0) * load(models.wave, 0)
        kicks = frequency * sqrt(2.0 * leak * power)
        rate_fourth, rate_fifth, fifth_rate = inverse, zero, zero
        fifth_fourth, fifth_fifth = -frequency * frequency, -leak
    else:
        rate_fourth, rate_fifth, fifth_rate, fifth_fourth, fifth_fifth = _ring(body, terms, inverse, state, work[0])
    pace, pull = pace_of(body, b + frequency), -body.stiffness * inverse
    slopes = inverse, rate_fourth, rate_fifth, -b, fifth_rate, fifth_fourth, fifth_fifth
    h, own, oldest = 0.0, series[0], 0
    for run in range(len(logged.begins) - 1):
        clear(state)
        begin, end = logged.begins[run], logged.begins[run + 1]
        equation = Equation(body, terms, broadcast(logged.start[run]))
        # Angle, rate, disturbance, and the two.
        origin, damping = each(driven.angles, driven.angle, begin), brake[1]
        a, r, d, w, v = origin, broadcast(logged.first[run, 0]), zero, zero, zero
        clear(p)
        store(p, 0, load(models.noise, 2) * load(models.noise, 2))
        store(p, SIZE + 1, broadcast(logged.first[run, 1] * logged.first[run, 1]))
        store(p, 2 * SIZE + 2, sigma * sigma)
        if waves:
            store(p, 3 * SIZE + 3, power)
            store(p, 4 * SIZE + 4, power * frequency * frequency)
        for k in range(begin, end):
            if k > begin:
                push, beside = each(driven.torque, driven.drive, k - 1), beside_of(driven, k - 1)
                interval = time[k] - time[k - 1]
                steps = filter_steps(interval, r, push, damping, pace, brake, _STEP_SHARE)
                if abs(interval / steps - h) > SAME * h:
                    h = interval / steps
                    at = _place_of(series, h)
                    if at == _LENGTHS:
                        at, oldest = oldest, (oldest + 1) % _LENGTHS
                        _begin(series[at], h, tau)
                    own = series[at]
                    store(f, 2 * SIZE + 2, load(own, _FADE))
                fade, mean = load(own, _FADE), load(own, _MEAN)
                own[_INTERVALS, 0] += 1.0
                if own[_INTERVALS, 0] == _WORTH_A_SERIES:
                    _expand(pull, slopes, h, drive, kicks, f, q, own)
                shares = shares_of(h, terms)
                for _ in range(steps):
                    faded, swung, slope, other = d * fade, zero, zero, d * mean
                    if waves:
                        bend = fifth_fourth * w + fifth_fifth * v
                        jerk = fifth_fourth * v + fifth_fifth * bend
                        jolt = fifth_fourth * bend + fifth_fifth * jerk
                        swung = w + h * (v + (h / 2.0) * (bend + (h / 3.0) * (jerk + (h / 4.0) * jolt)))
                        slope = v + h * (bend + (h / 2.0) * (jerk + (h / 3.0) * jolt))
                        # Its mean over the step.
                        late = bend + (h / 4.0) * (jerk + (h / 5.0) * jolt)
                        other = other + w + (h / 2.0) * (v + (h / 3.0) * late)
                    a = a - origin
                    if len(terms.kinds) == 0:
                        r, a, damping = bare_step(r, a, push + other, brake, h)
                    else:
                        for _ in range(shares):
                            r, a, damping = step(
                                r, a, push, other, beside, equation, state, work, broadcast(h / shares)
                            )
                    # What of it comes late in the step turns the vehicle less.
                    late = (swung - w + faded - d) * inverse * (-h * h / 12.0)
                    a = a + origin + late
                    r = r - damping * late
                    d, w, v = faded, swung, slope
                    # As in the other filter, no more than the series bear.
                    held = minimum(damping, 1.0 / h)
                    if own[_INTERVALS, 0] < _WORTH_A_SERIES:
                        _move(pull, held, slopes, h, drive, kicks, f, q)
                    else:
                        by_series(own, held * h, f, q)
                    congruence(f, p, q, room)
                late = each(driven.moment, driven.drive, k - 1) * inverse
                a = a + late
                r = r - damping * late
                kick = each(driven.scatter, driven.drive, k - 1) * inverse * inverse
                store(p, 0, load(p, 0) + kick * (interval * interval / 3.0))
                store(p, 1, load(p, 1) + kick * (interval / 2.0))
                store(p, SIZE + 1, load(p, SIZE + 1) + kick)
            for m in range(2):
                reading, known = (each(driven.angles, driven.angle, k), a) if m == 0 else (broadcast(logged.rate[k]), r)
                if math.isnan(extract(reading, 0)):
                    continue
                noise = load(models.noise, 2 + m)
                s = load(p, (SIZE + 1) * m) + noise * noise
                e = reading - known
                put(innovation, logged.row[k, m], e)
                put(variance, logged.row[k, m], s)
                one = 1.0 / s
                by = e * one
                # The column of the angle or of the rate, above the diagonal first.
                at = SIZE * m
                p0, p1, p2, p3, p4 = load(p, m), load(p, at + 1), load(p, at + 2), load(p, at + 3), load(p, at + 4)
                a, r, d = a + p0 * by, r + p1 * by, d + p2 * by
                if waves:
                    w, v = w + p3 * by, v + p4 * by
                else:
                    store(state, ringing, load(state, ringing) + p3 * by)
                    store(state, ringing + 1, load(state, ringing + 1) + p4 * by)
                take(p, (p0, p1, p2, p3, p4), one)


@njit_noalloc
def _place_of(series: Any, h: float) -> int:
    """Which of the ``series`` is for steps of ``h`` s; behind the last where none is."""
    at = 0
    while at < _LENGTHS and abs(h - series[at, _LENGTH, 0]) > SAME * h:
        at += 1
    return at


@njit_inline
def _begin(own: Any, h: float, tau: Any) -> None:
    """Forget what ``own`` was for: it is for steps of ``h`` s, beside a disturbance with a memory of ``tau`` s."""
    fade = exp(-h / tau)
    store(own, _LENGTH, broadcast(h))
    store(own, _INTERVALS, broadcast(0.0))
    store(own, _FADE, fade)
    store(own, _MEAN, (1.0 - fade) * tau / h)


@njit_noalloc
def _move(pull: Any, damping: Any, slopes: Any, h: float, drive: Any, kicks: Any, f: Any, q: Any) -> None:
    """Write transition and noise of a step of ``h`` s into ``f`` and ``q``, all but what is left of the disturbance."""
    zero, swing = broadcast(0.0), Swing(pull, -damping, *slopes)
    transition(swing, h, f)
    clear(q)
    add_noise(swing, (zero, zero, drive, zero, zero), h, q)
    if reduce_max(kicks) > 0.0:
        add_noise(swing, (zero, zero, zero, zero, kicks), h, q)


@njit_noalloc
def _expand(pull: Any, slopes: Any, h: float, drive: Any, kicks: Any, f: Any, q: Any, series: Any) -> None:
    """Fill in the ``series`` in the damping of transition and noise, for steps of ``h`` s."""
    for at in range(SERIES):
        store(series, at, 0.0)
    for point in range(POINTS):
        _move(pull, broadcast(DAMPED[point] / h), slopes, h, drive, kicks, f, q)
        add_point(POWERS, point, f, q, series)


@njit_inline
def _ring(body: Any, terms: Any, inverse: Any, state: Any, change: Any) -> Any:
    """How the two states of the term that rings act on the rate, and how the second follows from all three."""
    zero, ringing = broadcast(0.0), TERM_STATES * terms.ringing
    equation, nothing = Equation(body, terms, zero), (zero, zero, zero)
    torque_at(broadcast(1.0), zero, zero, nothing, equation, state, change)
    fifth_rate = load(change, ringing + 1)
    rest = torque_at(zero, zero, zero, nothing, equation, state, change)
    store(state, ringing, 1.0)
    rate_fourth = (torque_at(zero, zero, zero, nothing, equation, state, change) - rest) * inverse
    fifth_fourth = load(change, ringing + 1)
    store(state, ringing, 0.0)
    store(state, ringing + 1, 1.0)
    rate_fifth = (torque_at(zero, zero, zero, nothing, equation, state, change) - rest) * inverse
    store(state, ringing + 1, 0.0)
    return rate_fourth, rate_fifth, fifth_rate, fifth_fourth, load(change, ringing + 1)
