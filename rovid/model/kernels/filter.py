"""A Kalman filter of angle, rate and a coloured disturbance."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from rovid.effects.base import TERM_STATES, Body
from rovid.ground.arrays import FloatArray
from rovid.ground.compiled import compiled
from rovid.model.kernels.step import MAX_GAP_SUBSTEPS, damping_of, step

# The covariance is stepped by a transition of fourth order: good to a percent of a percent with such steps.
FILTER_STEP_SHARE = 0.3
# Gauss-Legendre nodes and weights on 0..1.
NODES = (0.1127016653792583, 0.5, 0.8872983346207417)
WEIGHTS = (5.0 / 18.0, 8.0 / 18.0, 5.0 / 18.0)
_TINY = 1e-12


@compiled
def pushed(t: float, a: float, b: float, inertia: float) -> tuple[float, float]:
    """Angle and rate after ``t`` s of a unit torque that fades at ``b`` 1/s, against a damping of ``a`` 1/s.

    (exp(-b t) - exp(-a t)) / (a - b) / inertia and its integral, as series, since a and b may be equal.
    """
    first, second, third = a + b, a * a + a * b + b * b, (a + b) * (a * a + b * b)
    rate = t / inertia * (1.0 - t / 2.0 * (first - t / 3.0 * (second - t / 4.0 * third)))
    return 0.5 * t * t / inertia * (1.0 - t / 3.0 * (first - t / 4.0 * (second - t / 5.0 * third))), rate


@compiled
def filter_steps(interval: float, rate: float, push: float, damping: float, fastest: float, body: Body) -> int:
    """How many steps a filter takes through ``interval``; ``fastest`` in 1/s is the rate of what disturbs."""
    # How fast it may turn before the interval is over, or where drag balances the torque.
    balance = math.sqrt(abs(push) / (body.quadratic_drag + _TINY))
    soon = min(abs(rate) + interval * abs(push) / body.inertia, max(abs(rate), balance))
    stiffness = max(damping, damping_of(soon, body)) + fastest + math.sqrt(body.stiffness / body.inertia)
    wanted = interval * stiffness / FILTER_STEP_SHARE
    return 1 if not wanted > 1.0 else min(int(wanted) + 1, MAX_GAP_SUBSTEPS)


@compiled
def innovations(  # noqa: PLR0915 - the covariance is written out term by term, without arrays
    time: FloatArray,
    torque: FloatArray,
    beside: FloatArray,
    moment: FloatArray,
    scatter: FloatArray,
    angle: FloatArray,
    rate: FloatArray,
    equation: Any,
    noise: FloatArray,
    begin: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Innovations of an extended Kalman filter with a coloured disturbance torque.

    State: angle, rate r, disturbance d. ``inertia*rdot = torque + d - quadratic*|r|*r - linear*r``, angle_dot = r,
    d a first-order Gauss-Markov process. The mean is stepped by Runge-Kutta, the covariance by the transition of the
    linearised motion (Maybeck 1979, chapter 6), in steps short beside its time constants.

    Parameters
    ----------
    time, torque, beside, moment, scatter
        (n,) s; the others from each instant to the next, see `rovid.model.drive.Drive`.
    angle, rate
        (n,) measured angle in rad and rate in rad/s; NaN where not measured.
    equation
        `rovid.model.equation.Equation`; the states of its terms follow the mean, without a variance of their own.
    noise
        Standard deviation of d in N m, its correlation time in s, standard deviation of the white noise of a
        measured angle in rad and of a measured rate in rad/s.
    begin
        Rate in rad/s at the first instant and its standard deviation.

    Returns
    -------
    innovation, variance
        (n, 2) of angle and rate; NaN where nothing was measured.
    """
    n = len(time)
    body, terms = equation.body, equation.terms
    inertia = body.inertia
    sigma, tau = noise[0], noise[1]
    rows = len(terms.kinds)
    state, work = np.zeros((rows, TERM_STATES)), np.zeros((3, rows, TERM_STATES))
    origin, damping = angle[0], body.linear_drag / inertia
    innovation = np.full((n, 2), np.nan)
    variance = np.full((n, 2), np.nan)
    a, r, d = angle[0], begin[0], 0.0
    p00, p01, p02 = noise[2] ** 2, 0.0, 0.0
    p11, p12, p22 = begin[1] ** 2, 0.0, sigma**2
    h, fade, mean, fresh, grown, pull, left = 0.0, 1.0, 1.0, 0.0, 0.0, 0.0, np.empty(3)
    for k in range(n):
        if k > 0:
            interval = time[k] - time[k - 1]
            push = torque[k - 1]
            told = beside[k - 1, 0], beside[k - 1, 1], beside[k - 1, 2]
            steps = filter_steps(interval, r, push, damping, 1.0 / tau, body)
            # Most logs are sampled evenly: what depends on the step alone is kept.
            if interval / steps != h:
                h = interval / steps
                fade = math.exp(-h / tau)
                mean = (1.0 - fade) * tau / h
                fresh, grown = sigma**2 * (1.0 - fade * fade), 2.0 * sigma**2 / tau * h
                pull = 0.5 * body.stiffness * h / inertia
                for node in range(3):
                    left[node] = math.exp(-NODES[node] * h / tau)
            # States of effects that are faster than all this have no variance: steps of the mean alone do for them.
            shares = max(math.ceil(h * terms.fastest / FILTER_STEP_SHARE), 1)
            for _ in range(steps):
                a -= origin
                for _ in range(shares):
                    # Over a step the disturbance acts by its mean.
                    r, a, damping = step(r, a, push, d * mean, told, equation, state, work, h / shares)
                a += origin
                # What of it comes early in the step turns the vehicle more.
                early = (1.0 - fade) * d * h**2 / (12.0 * inertia)
                a += early
                r -= damping * early
                d *= fade
                # What brings the vehicle back, as half an impulse at each end of the step (Strang 1968).
                if body.stiffness > 0.0:
                    p11 += pull * (pull * p00 - 2.0 * p01)
                    p12 -= pull * p02
                    p01 -= pull * p00
                part = damping * h
                f11 = 1.0 - part * (1.0 - 0.5 * part * (1.0 - part / 3.0 * (1.0 - 0.25 * part)))
                f01 = h * (1.0 - 0.5 * part * (1.0 - part / 3.0 * (1.0 - 0.25 * part)))
                f02, f12 = pushed(h, damping, 1.0 / tau, inertia)
                n00, n01, n02, n11, n12 = 0.0, 0.0, 0.0, 0.0, 0.0
                for node in range(3):
                    c0, c1 = pushed(NODES[node] * h, damping, 1.0 / tau, inertia)
                    c2, weight = left[node], grown * WEIGHTS[node]
                    n00 += weight * c0 * c0
                    n01 += weight * c0 * c1
                    n02 += weight * c0 * c2
                    n11 += weight * c1 * c1
                    n12 += weight * c1 * c2
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
                if body.stiffness > 0.0:
                    p11 += pull * (pull * p00 - 2.0 * p01)
                    p12 -= pull * p02
                    p01 -= pull * p00
            a += moment[k - 1] / inertia
            r -= damping * moment[k - 1] / inertia
            kick = scatter[k - 1] / inertia**2
            p00 += kick * interval**2 / 3.0
            p01 += kick * interval / 2.0
            p11 += kick
        if angle[k] == angle[k]:
            s = p00 + noise[2] ** 2
            e = angle[k] - a
            innovation[k, 0] = e
            variance[k, 0] = s
            g0, g1, g2 = p00 / s, p01 / s, p02 / s
            a += g0 * e
            r += g1 * e
            d += g2 * e
            p11 -= g1 * p01
            p12 -= g1 * p02
            p22 -= g2 * p02
            p02 *= 1.0 - g0
            p01 *= 1.0 - g0
            p00 *= 1.0 - g0
        if rate[k] == rate[k]:
            s = p11 + noise[3] ** 2
            e = rate[k] - r
            innovation[k, 1] = e
            variance[k, 1] = s
            g0, g1, g2 = p01 / s, p11 / s, p12 / s
            a += g0 * e
            r += g1 * e
            d += g2 * e
            p00 -= g0 * p01
            p02 -= g0 * p12
            p22 -= g2 * p12
            p01 *= 1.0 - g1
            p12 *= 1.0 - g1
            p11 *= 1.0 - g1
    return innovation, variance
