"""Kalman filters of angle, rate and a coloured disturbance, several side by side."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.effects.base import TERM_STATES
from rovid.jit.decorators import njit_inline, njit_noalloc
from rovid.jit.simd import LANES, broadcast, exp, extract, load, maximum, minimum, reduce_max, sqrt, store
from rovid.jit.tracing import traced
from rovid.model.kernels.effect_terms import SCRATCH_ROWS
from rovid.model.kernels.rk4_step import MAX_GAP_SUBSTEPS, bare_step, brakes, damping_of, shares_of, step
from rovid.model.kernels.simd_io import beside_of, body_of, clear, each, put
from rovid.model.kernels.warmup import warmed_up
from rovid.model.packed_terms import Equation

# The covariance is stepped by a transition of fourth order: good to a percent of a percent with such steps.
_STEP_SHARE = 0.3
# Gauss-Legendre nodes and weights on 0..1.
NODES = (0.1127016653792583, 0.5, 0.8872983346207417)
WEIGHTS = (5.0 / 18.0, 8.0 / 18.0, 5.0 / 18.0)
_TINY = 1e-12
# Steps that differ by no more than this share are one.
SAME = 1e-9
# Where the series in the damping begin of what a unit torque that fades turns, and of what its noise adds to the
# covariance in a step: of four terms each, or seven.
_F02, _F12, _N02, _N12, _N00, _N01, _N11, _SERIES = 0, 4, 8, 12, 16, 23, 30, 37


@njit_inline
def filter_steps(interval: float, rate: Any, push: Any, damping: Any, pace: Any, brake: Any, share: float) -> int:
    """How many steps of no more than such a ``share`` of the shortest time constant filters take through ``interval``.

    See `pace_of` and `brakes` for the rest.
    """
    # How fast it may turn before the interval is over, or where drag balances the torque.
    size, turning = abs(rate), abs(push) * brake[2]
    soon = minimum(size + interval * turning, maximum(size, sqrt(turning * pace[1])))
    wanted = reduce_max(interval * (maximum(damping, damping_of(soon, brake)) + pace[0])) / share
    return 1 if not wanted > 1.0 else min(int(wanted) + 1, MAX_GAP_SUBSTEPS)


@traced
def pace_of(body: Any, fastest: Any) -> Any:
    """What `filter_steps` asks for of what disturbs at rates up to ``fastest`` 1/s; worked out once."""
    return fastest + sqrt(body.stiffness / body.inertia), body.inertia / (body.quadratic_drag + _TINY)


def ekf3_innovations(logged: Any, driven: Any, models: Any) -> tuple[FloatArray, FloatArray]:
    """Innovations of extended Kalman filters with a coloured disturbance torque, one in each lane.

    State: angle, rate r, disturbance d. ``inertia*rdot = torque + d - quadratic*|r|*r - linear*r``, angle_dot = r,
    d a first-order Gauss-Markov process. The mean is stepped by Runge-Kutta, the covariance by the transition of the
    linearised motion (Maybeck 1979, chapter 6), in steps short beside the time constants, as many in all lanes. The
    states of effects follow the mean, without a variance of their own.

    Parameters
    ----------
    logged, driven, models
        See `rovid.model.filter_batch`.

    Returns
    -------
    innovation, variance
        (LANES, N) in the order that `Logged` asks for.
    """
    rows, count = TERM_STATES * len(models.terms.kinds), logged.row.max() + 1
    innovation, variance = np.empty((2, LANES, count))
    state, work, series = np.zeros((rows, LANES)), np.zeros((3, rows + SCRATCH_ROWS, LANES)), np.zeros((_SERIES, LANES))
    _filter(logged, driven, models, state, work, series, innovation, variance)
    return innovation, variance


@warmed_up
@njit_noalloc
def _filter(  # noqa: PLR0915 - one filter, from top to bottom
    logged: Any,
    driven: Any,
    models: Any,
    state: Any,
    work: Any,
    series: Any,
    innovation: Any,
    variance: Any,
) -> None:
    """Through one run after the other; fills in what ``innovations`` gives."""
    time, terms, body = logged.time, models.terms, body_of(models.body)
    sigma, tau = load(models.noise, 0), load(models.noise, 1)
    angle_noise, rate_noise = load(models.noise, 2), load(models.noise, 3)
    angle_noise, rate_noise, power = angle_noise * angle_noise, rate_noise * rate_noise, sigma * sigma
    brake, restores = brakes(body), reduce_max(body.stiffness) > 0.0
    inverse = brake[2]
    # Damping b of the disturbance, in 1/s.
    b = 1.0 / tau
    pace, zero = pace_of(body, b), broadcast(0.0)
    for run in range(len(logged.begins) - 1):
        clear(state)
        begin, end = logged.begins[run], logged.begins[run + 1]
        equation = Equation(body, terms, broadcast(logged.start[run]))
        origin, damping = each(driven.angles, driven.angle, begin), brake[1]
        a, r, d = origin, broadcast(logged.first[run, 0]), zero
        p00, p01, p02 = angle_noise, zero, zero
        p11, p12, p22 = broadcast(logged.first[run, 1] * logged.first[run, 1]), zero, power
        h, fade, mean, fresh, pull = 0.0, zero, zero, zero, zero
        for k in range(begin, end):
            if k > begin:
                interval = time[k] - time[k - 1]
                push, beside = each(driven.torque, driven.drive, k - 1), beside_of(driven, k - 1)
                steps = filter_steps(interval, r, push, damping, pace, brake, _STEP_SHARE)
                # Most logs are sampled evenly, to rounding: what depends on the step alone is kept.
                if abs(interval / steps - h) > SAME * h:
                    h = interval / steps
                    fade = exp(-h * b)
                    mean = (1.0 - fade) * tau / h
                    fresh, pull = power * (1.0 - fade * fade), 0.5 * h * body.stiffness * inverse
                    _expand(h, b, inverse, 2.0 * power * b * h, series)
                # States of effects that are faster than all this have no variance: steps of the mean alone do for them.
                shares = shares_of(h, terms)
                for _ in range(steps):
                    a = a - origin
                    # Over a step the disturbance acts by its mean.
                    if len(terms.kinds) == 0:
                        r, a, damping = bare_step(r, a, push + d * mean, brake, h)
                    else:
                        for _ in range(shares):
                            share = broadcast(h / shares)
                            r, a, damping = step(r, a, push, d * mean, beside, equation, state, work, share)
                    # What of it comes early in the step turns the vehicle more.
                    early = (1.0 - fade) * d * inverse * (h * h / 12.0)
                    a = a + origin + early
                    r = r - damping * early
                    d = d * fade
                    # What brings the vehicle back, as half an impulse at each end of the step (Strang 1968).
                    if restores:
                        p11 = p11 + pull * (pull * p00 - 2.0 * p01)
                        p12 = p12 - pull * p02
                        p01 = p01 - pull * p00
                    # One that has grown since the steps were counted would carry the series away.
                    held = minimum(damping, 1.0 / h)
                    part = held * h
                    slow = 1.0 - part * (0.5 - part * (1.0 / 6.0 - part * (1.0 / 24.0)))
                    f11, f01 = 1.0 - part * slow, h * slow
                    f02, f12 = _cubic(series, _F02, held), _cubic(series, _F12, held)
                    q00 = p00 + f01 * p01 + f02 * p02
                    q01 = p01 + f01 * p11 + f02 * p12
                    q02 = p02 + f01 * p12 + f02 * p22
                    q11 = f11 * p11 + f12 * p12
                    q12 = f11 * p12 + f12 * p22
                    p00 = q00 + f01 * q01 + f02 * q02 + _sextic(series, _N00, held)
                    p01 = f11 * q01 + f12 * q02 + _sextic(series, _N01, held)
                    p02 = fade * q02 + _cubic(series, _N02, held)
                    p11 = f11 * q11 + f12 * q12 + _sextic(series, _N11, held)
                    p12 = fade * q12 + _cubic(series, _N12, held)
                    p22 = fade * fade * p22 + fresh
                    if restores:
                        p11 = p11 + pull * (pull * p00 - 2.0 * p01)
                        p12 = p12 - pull * p02
                        p01 = p01 - pull * p00
                late = each(driven.moment, driven.drive, k - 1) * inverse
                a = a + late
                r = r - damping * late
                kick = each(driven.scatter, driven.drive, k - 1) * inverse * inverse
                p00 = p00 + kick * (interval * interval / 3.0)
                p01 = p01 + kick * (interval / 2.0)
                p11 = p11 + kick
            measured = each(driven.angles, driven.angle, k)
            if not math.isnan(extract(measured, 0)):
                s = p00 + angle_noise
                e = measured - a
                put(innovation, logged.row[k, 0], e)
                put(variance, logged.row[k, 0], s)
                one = 1.0 / s
                g0, g1, g2 = p00 * one, p01 * one, p02 * one
                a, r, d = a + g0 * e, r + g1 * e, d + g2 * e
                p11, p12, p22 = p11 - g1 * p01, p12 - g1 * p02, p22 - g2 * p02
                kept = 1.0 - g0
                p02, p01, p00 = kept * p02, kept * p01, kept * p00
            if not math.isnan(logged.rate[k]):
                s = p11 + rate_noise
                e = logged.rate[k] - r
                put(innovation, logged.row[k, 1], e)
                put(variance, logged.row[k, 1], s)
                one = 1.0 / s
                g0, g1, g2 = p01 * one, p11 * one, p12 * one
                a, r, d = a + g0 * e, r + g1 * e, d + g2 * e
                p00, p02, p22 = p00 - g0 * p01, p02 - g0 * p12, p22 - g2 * p12
                kept = 1.0 - g1
                p01, p12, p11 = kept * p01, kept * p12, kept * p11


@njit_noalloc
def _expand(h: float, b: Any, inverse: Any, grown: Any, series: Any) -> None:
    """As ``_fill_in``, which is long, as a function of its own: the loop about it is better off without."""
    _fill_in(h, b, inverse, grown, series)


@traced
def _fill_in(h: float, b: Any, inverse: Any, grown: Any, series: Any) -> None:
    """Fill in the ``series`` for steps of ``h`` s, a disturbance that fades at ``b`` 1/s and a noise so ``grown``."""
    sums = [broadcast(0.0)] * _SERIES

    def add(at: int, x: Any) -> None:
        sums[at] = sums[at] + x

    angle, rate = _pushed(h, b, inverse)
    sums[_F02:_N02] = *angle, *rate
    for node in range(3):
        t, weight = NODES[node] * h, grown * WEIGHTS[node]
        angle, rate = _pushed(t, b, inverse)
        left = exp(-t * b)
        for i in range(4):
            add(_N02 + i, weight * angle[i] * left)
            add(_N12 + i, weight * rate[i] * left)
            for j in range(4):
                add(_N00 + i + j, weight * angle[i] * angle[j])
                add(_N01 + i + j, weight * angle[i] * rate[j])
                add(_N11 + i + j, weight * rate[i] * rate[j])
    for at in range(_SERIES):
        store(series, at, sums[at])


@traced
def _pushed(t: float, b: Any, inverse: Any) -> Any:
    """Angle and rate after ``t`` s of a unit torque that fades at ``b`` 1/s, as series in the damping a in 1/s.

    (exp(-b t) - exp(-a t)) / (a - b) / inertia and its integral, without a pole where a and b are equal.
    """
    c, d, e = t / 2.0, t * t / 6.0, t * t * t / 24.0
    rate, per = t * inverse, b * b
    rates = rate * (1.0 - c * b + d * per - e * per * b), rate * (d * b - c - e * per), rate * (d - e * b), rate * -e
    c, d, e = t / 3.0, t * t / 12.0, t * t * t / 60.0
    angle = 0.5 * t * t * inverse
    angles = (
        angle * (1.0 - c * b + d * per - e * per * b),
        angle * (d * b - c - e * per),
        angle * (d - e * b),
        angle * -e,
    )
    return angles, rates


@traced
def _cubic(series: Any, at: int, x: Any) -> Any:
    return ((load(series, at + 3) * x + load(series, at + 2)) * x + load(series, at + 1)) * x + load(series, at)


@traced
def _sextic(series: Any, at: int, x: Any) -> Any:
    # In two halves, which do not wait for each other.
    square = x * x
    even = (load(series, at + 6) * square + load(series, at + 4)) * square + load(series, at + 2)
    odd = (load(series, at + 5) * square + load(series, at + 3)) * square + load(series, at + 1)
    return even * square + odd * x + load(series, at)
