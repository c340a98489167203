"""Kalman filters of angle, rate and a coloured disturbance, several side by side."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from rovid.effects.base import TERM_STATES
from rovid.ground.arrays import FloatArray
from rovid.ground.compiled import compiled, inlined, lean
from rovid.ground.lanes import LANES, lane, larger, largest, read, root, smaller, spread, write
from rovid.model.equation import Equation
from rovid.model.kernels.batch import beside_of, body_of, each
from rovid.model.kernels.step import MAX_GAP_SUBSTEPS, bare_step, damping_of, step

# The covariance is stepped by a transition of fourth order: good to a percent of a percent with such steps.
FILTER_STEP_SHARE = 0.3
# Gauss-Legendre nodes and weights on 0..1.
NODES = (0.1127016653792583, 0.5, 0.8872983346207417)
WEIGHTS = (5.0 / 18.0, 8.0 / 18.0, 5.0 / 18.0)
_TINY = 1e-12


@inlined
def filter_steps(interval: float, rate: Any, push: Any, damping: Any, fastest: Any, body: Any) -> int:
    """How many steps filters take through ``interval``; ``fastest`` in 1/s is the rate of what disturbs."""
    # How fast it may turn before the interval is over, or where drag balances the torque.
    size = abs(rate)
    balance = root(abs(push) / (body.quadratic_drag + _TINY))
    soon = smaller(size + interval * abs(push) / body.inertia, larger(size, balance))
    stiffness = larger(damping, damping_of(soon, body)) + fastest + root(body.stiffness / body.inertia)
    wanted = largest(interval * stiffness) / FILTER_STEP_SHARE
    return 1 if not wanted > 1.0 else min(int(wanted) + 1, MAX_GAP_SUBSTEPS)


@compiled
def innovations(logged: Any, driven: Any, models: Any) -> tuple[FloatArray, FloatArray]:
    """Innovations of extended Kalman filters with a coloured disturbance torque, one in each lane.

    State: angle, rate r, disturbance d. ``inertia*rdot = torque + d - quadratic*|r|*r - linear*r``, angle_dot = r,
    d a first-order Gauss-Markov process. The mean is stepped by Runge-Kutta, the covariance by the transition of the
    linearised motion (Maybeck 1979, chapter 6), in steps short beside the time constants, as many in all lanes. The
    states of effects follow the mean, without a variance of their own.

    Parameters
    ----------
    logged, driven, models
        See `rovid.model.batch`.

    Returns
    -------
    innovation, variance
        (n, 2, LANES) of angle and rate; NaN where nothing was measured.
    """
    rows, count = TERM_STATES * len(models.terms.kinds), 2 * len(logged.time)
    innovation, variance = np.full((count, LANES), np.nan), np.full((count, LANES), np.nan)
    state, work = np.zeros((rows, LANES)), np.zeros((3, rows, LANES))
    for run in range(len(logged.begins) - 1):
        state[:] = 0.0
        _filter(run, logged, driven, models, state, work, innovation, variance)
    return innovation.reshape(-1, 2, LANES), variance.reshape(-1, 2, LANES)


@lean
def _filter(  # noqa: PLR0915 - one filter, from top to bottom
    run: int, logged: Any, driven: Any, models: Any, state: Any, work: Any, innovation: Any, variance: Any
) -> None:
    """Through one run; fills in its rows, see ``innovations``, two for each instant."""
    time, terms, body = logged.time, models.terms, body_of(models.body)
    sigma, tau = read(models.noise, 0), read(models.noise, 1)
    angle_noise, rate_noise = read(models.noise, 2), read(models.noise, 3)
    angle_noise, rate_noise, power = angle_noise * angle_noise, rate_noise * rate_noise, sigma * sigma
    inverse, restores = 1.0 / body.inertia, largest(body.stiffness) > 0.0
    # Damping b of the disturbance, in 1/s.
    b = 1.0 / tau
    zero = spread(0.0)
    begin, end = logged.begins[run], logged.begins[run + 1]
    equation = Equation(body, terms, spread(logged.start[run]))
    origin, damping = each(driven.angles, driven.angle, begin), body.linear_drag * inverse
    a, r, d = origin, spread(logged.first[run, 0]), zero
    p00, p01, p02 = angle_noise, zero, zero
    p11, p12, p22 = spread(logged.first[run, 1] ** 2), zero, power
    h, fade, mean, fresh, grown, pull = 0.0, zero, zero, zero, zero, zero
    left0, left1, left2 = zero, zero, zero
    for k in range(begin, end):
        if k > begin:
            interval = time[k] - time[k - 1]
            push, beside = each(driven.torque, driven.drive, k - 1), beside_of(driven, k - 1)
            steps = filter_steps(interval, r, push, damping, b, body)
            # Most logs are sampled evenly: what depends on the step alone is kept.
            if interval / steps != h:
                h = interval / steps
                fade = math.exp(-h * b)
                mean = (1.0 - fade) * tau / h
                fresh, grown = power * (1.0 - fade * fade), 2.0 * power * b * h
                pull = 0.5 * h * body.stiffness * inverse
                left0, left1 = math.exp(-NODES[0] * h * b), math.exp(-NODES[1] * h * b)
                left2 = math.exp(-NODES[2] * h * b)
            # States of effects that are faster than all this have no variance: steps of the mean alone do for them.
            shares = max(math.ceil(h * terms.fastest / FILTER_STEP_SHARE), 1)
            for _ in range(steps):
                a = a - origin
                # Over a step the disturbance acts by its mean.
                if len(terms.kinds) == 0:
                    r, a, damping = bare_step(r, a, push + d * mean, body, h)
                else:
                    for _ in range(shares):
                        share = spread(h / shares)
                        r, a, damping = step(r, a, push, d * mean, beside, equation, state, work, share)
                # What of it comes early in the step turns the vehicle more.
                early = (1.0 - fade) * d * inverse * (h**2 / 12.0)
                a = a + origin + early
                r = r - damping * early
                d = d * fade
                # What brings the vehicle back, as half an impulse at each end of the step (Strang 1968).
                if restores:
                    p11 = p11 + pull * (pull * p00 - 2.0 * p01)
                    p12 = p12 - pull * p02
                    p01 = p01 - pull * p00
                part = damping * h
                slow = 1.0 - part * (0.5 - part * (1.0 / 6.0 - part * (1.0 / 24.0)))
                f11, f01 = 1.0 - part * slow, h * slow
                bend = _bends(damping, b)
                f02, f12 = _pushed(h, bend, inverse)
                n00, n01, n02, n11, n12 = zero, zero, zero, zero, zero
                for node in range(3):
                    c0, c1 = _pushed(NODES[node] * h, bend, inverse)
                    c2 = left0 if node == 0 else left1 if node == 1 else left2
                    weight = grown * WEIGHTS[node]
                    w0, w1 = weight * c0, weight * c1
                    n00, n01, n02 = n00 + w0 * c0, n01 + w0 * c1, n02 + w0 * c2
                    n11, n12 = n11 + w1 * c1, n12 + w1 * c2
                q00 = p00 + f01 * p01 + f02 * p02
                q01 = p01 + f01 * p11 + f02 * p12
                q02 = p02 + f01 * p12 + f02 * p22
                q11 = f11 * p11 + f12 * p12
                q12 = f11 * p12 + f12 * p22
                p00 = q00 + f01 * q01 + f02 * q02 + n00
                p01 = f11 * q01 + f12 * q02 + n01
                p02 = fade * q02 + n02
                p11 = f11 * q11 + f12 * q12 + n11
                p12 = fade * q12 + n12
                p22 = fade * fade * p22 + fresh
                if restores:
                    p11 = p11 + pull * (pull * p00 - 2.0 * p01)
                    p12 = p12 - pull * p02
                    p01 = p01 - pull * p00
            late = each(driven.moment, driven.drive, k - 1) * inverse
            a = a + late
            r = r - damping * late
            kick = each(driven.scatter, driven.drive, k - 1) * inverse * inverse
            p00 = p00 + kick * (interval**2 / 3.0)
            p01 = p01 + kick * (interval / 2.0)
            p11 = p11 + kick
        measured = each(driven.angles, driven.angle, k)
        if not math.isnan(lane(measured, 0)):
            s = p00 + angle_noise
            e = measured - a
            write(innovation, 2 * k, e)
            write(variance, 2 * k, s)
            g0, g1, g2 = p00 / s, p01 / s, p02 / s
            a, r, d = a + g0 * e, r + g1 * e, d + g2 * e
            p11, p12, p22 = p11 - g1 * p01, p12 - g1 * p02, p22 - g2 * p02
            kept = 1.0 - g0
            p02, p01, p00 = kept * p02, kept * p01, kept * p00
        if not math.isnan(logged.rate[k]):
            s = p11 + rate_noise
            e = logged.rate[k] - r
            write(innovation, 2 * k + 1, e)
            write(variance, 2 * k + 1, s)
            g0, g1, g2 = p01 / s, p11 / s, p12 / s
            a, r, d = a + g0 * e, r + g1 * e, d + g2 * e
            p00, p02, p22 = p00 - g0 * p01, p02 - g0 * p12, p22 - g2 * p12
            kept = 1.0 - g1
            p01, p12, p11 = kept * p01, kept * p12, kept * p11


@inlined
def _bends(a: Any, b: Any) -> Any:
    """What `_pushed` asks of a damping of ``a`` and a fading of ``b`` 1/s, over the divisors of its series."""
    both, squares = a + b, a * a + b * b
    return both, squares + a * b, both * squares


@inlined
def _pushed(t: float, bends: Any, inverse: Any) -> Any:
    """Angle and rate after ``t`` s of a unit torque that fades at b 1/s, against a damping of a 1/s.

    (exp(-b t) - exp(-a t)) / (a - b) / inertia and its integral, as series, since a and b may be equal.
    """
    first, second, third = bends
    rate = t * inverse * (1.0 - (t / 2.0) * first + (t * t / 6.0) * second - (t * t * t / 24.0) * third)
    angle = 0.5 * t * t * inverse * (1.0 - (t / 3.0) * first + (t * t / 12.0) * second - (t * t * t / 60.0) * third)
    return angle, rate
