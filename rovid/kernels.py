"""Compiled loops over samples. Nothing here knows of files, units or effects' names."""

from __future__ import annotations

import math
import warnings
from typing import Any

import numpy as np
from numba import literal_unroll
from numba.core.errors import NumbaExperimentalFeatureWarning

from rovid.effects import TERMS
from rovid.effects.base import TERM_STATES
from rovid.effects.base import compiled as _compiled
from rovid.trial import FloatArray

# The loop over the effects' terms hands functions to numba, which calls that new; it works and is tested.
warnings.filterwarnings("ignore", category=NumbaExperimentalFeatureWarning)

# A step of this share of the shortest time constant leaves fourth-order Runge-Kutta exact to about 1e-6.
_STEP_SHARE = 0.2
# The covariance is stepped by a transition of second order, which needs shorter steps to be good to a percent.
_FILTER_STEP_SHARE = 0.05
_MAX_SUBSTEPS = 1000
_SETTLED = 1e-9
# With effects a gap is stepped through to its end, however long.
_MAX_GAP_SUBSTEPS = 1_000_000


@_compiled
def _acceleration(rate: float, torque: float, inertia: float, quadratic: float, linear: float) -> float:
    return (torque - (quadratic * abs(rate) + linear) * rate) / inertia


@_compiled
def simulate(
    time: FloatArray,
    torque: FloatArray,
    inertia: float,
    quadratic: float,
    linear: float,
    initial_rate: float,
) -> tuple[FloatArray, FloatArray]:
    """Integrate ``inertia*rdot + quadratic*|r|*r + linear*r = torque`` and ``angle_dot = r``.

    Parameters
    ----------
    time
        (n,) s, increasing.
    torque
        (n,) N m, held from each instant to the next.
    initial_rate
        rad/s at the first instant; the angle starts at 0.

    Returns
    -------
    rate, angle
        (n,) rad/s and (n,) rad. Classical fourth-order Runge-Kutta, sub-stepped so that a step is a small
        share of the local time constant ``inertia / (2*quadratic*|r| + linear)``.
    """
    n = len(time)
    rate = np.empty(n)
    angle = np.empty(n)
    rate[0] = initial_rate
    angle[0] = 0.0
    for k in range(n - 1):
        r = rate[k]
        a = angle[k]
        # The rate heads for the one that balances the torque: the faster of the two sets the time constant.
        balance = math.sqrt(abs(torque[k]) / quadratic) if quadratic > 0.0 else 0.0
        if linear > 0.0:
            balance = min(balance, abs(torque[k]) / linear) if quadratic > 0.0 else 0.0
        left = time[k + 1] - time[k]
        while left > 0.0:
            stiffness = (2.0 * quadratic * max(abs(r), balance) + linear) / inertia
            wanted = left * stiffness / _STEP_SHARE
            # A gap in the log can be longer than so many steps: they are taken again until the rate has settled.
            long = wanted > _MAX_SUBSTEPS
            steps = 1 if not wanted > 1.0 else int(min(wanted, _MAX_SUBSTEPS - 1.0)) + 1
            h = _STEP_SHARE / stiffness if long else left / steps
            before = r
            for _ in range(steps):
                k1 = _acceleration(r, torque[k], inertia, quadratic, linear)
                r2 = r + 0.5 * h * k1
                k2 = _acceleration(r2, torque[k], inertia, quadratic, linear)
                r3 = r + 0.5 * h * k2
                k3 = _acceleration(r3, torque[k], inertia, quadratic, linear)
                r4 = r + h * k3
                k4 = _acceleration(r4, torque[k], inertia, quadratic, linear)
                a += h * (r + 2.0 * r2 + 2.0 * r3 + r4) / 6.0
                r += h * (k1 + 2.0 * k2 + 2.0 * k3 + k4) / 6.0
            left = left - steps * h if long else 0.0
            if not abs(r - before) > _SETTLED * abs(r):
                a += r * left
                left = 0.0
        rate[k + 1] = r
        angle[k + 1] = a
    return rate, angle


@_compiled
def _sum_terms(
    rate: float, angle: float, push: float, base: Any, terms: Any, active: Any, state: Any, change: Any
) -> Any:
    """Torque of all active effects; fills in the rates of change of their states."""
    total = 0.0
    k = 0
    for term in literal_unroll(TERMS):
        if active[k]:
            total += term(rate, angle, push, base, terms[k], state[k], change[k])
        k += 1  # noqa: SIM113 - numba unrolls the bare loop only
    return total


@_compiled
def _extra(rate: float, angle: float, push: float, base: Any, terms: Any, active: Any, state: Any, change: Any) -> Any:
    """As ``_sum_terms``, at no cost where the last flag says that there is no effect."""
    return _sum_terms(rate, angle, push, base, terms, active, state, change) if active[-1] else 0.0


@_compiled
def _substep(
    r: float, a: float, push: float, base: Any, terms: Any, active: Any, state: Any, middle: Any, change: Any, h: float
) -> Any:
    """One Runge-Kutta step of rate and angle with effects; their states by the midpoint rule.

    Returns the new rate and angle, and the damping -d(rdot)/dr at the start, in 1/s.
    """
    inertia, quadratic, linear = base[0], base[1], base[2]
    damping = (2.0 * quadratic * abs(r) + linear) / inertia
    extra = _extra(r, a, push, base, terms, active, state, change)
    k1 = _acceleration(r, push + extra, inertia, quadratic, linear)
    if active[-1]:
        _advance(state, change, 0.5 * h, middle)
        nudge = 1e-6 + 1e-4 * abs(r)
        damping -= (_extra(r + nudge, a, push, base, terms, active, state, change) - extra) / (nudge * inertia)
    r2 = r + 0.5 * h * k1
    extra = _extra(r2, a + 0.5 * h * r, push, base, terms, active, middle, change)
    k2 = _acceleration(r2, push + extra, inertia, quadratic, linear)
    if active[-1]:
        _advance(state, change, h, state)
    r3 = r + 0.5 * h * k2
    extra = _extra(r3, a + 0.5 * h * r2, push, base, terms, active, middle, change)
    k3 = _acceleration(r3, push + extra, inertia, quadratic, linear)
    r4 = r + h * k3
    extra = _extra(r4, a + h * r3, push, base, terms, active, state, change)
    k4 = _acceleration(r4, push + extra, inertia, quadratic, linear)
    a += h * (r + 2.0 * r2 + 2.0 * r3 + r4) / 6.0
    r += h * (k1 + 2.0 * k2 + 2.0 * k3 + k4) / 6.0
    return r, a, max(damping, 0.0)


@_compiled
def _advance(state: Any, change: Any, h: float, out: Any) -> None:
    """Write state + h*change into ``out``."""
    for j in range(state.shape[0]):
        for i in range(state.shape[1]):
            out[j, i] = state[j, i] + h * change[j, i]


@_compiled
def simulate_effects(
    time: FloatArray, torque: FloatArray, base: FloatArray, terms: FloatArray, active: Any, start: tuple[float, float]
) -> tuple[FloatArray, FloatArray]:
    """As ``simulate``, with effects in the equation of motion.

    Parameters
    ----------
    torque
        (n,) N m; each value the mean until the next instant.
    base
        Inertia, quadratic and linear drag, and the heading in rad at the first instant.
    terms, active
        (m, 4) parameters of each effect of ``rovid.effects.MOTION``; (m + 1,) which are there, and whether any is.
    start
        Rate in rad/s and angle in rad, since the start of the trial, at the first instant.
    """
    n = len(time)
    rate, angle = np.empty(n), np.empty(n)
    r, a = start
    rate[0], angle[0] = r, a
    state = np.zeros((len(terms), TERM_STATES))
    middle, change = np.zeros_like(state), np.zeros_like(state)
    stiffness = base[2] / base[0]
    for k in range(n - 1):
        interval = time[k + 1] - time[k]
        balance = math.sqrt(abs(torque[k]) / base[1]) if base[1] > 0.0 else 0.0
        if base[2] > 0.0:
            balance = min(balance, abs(torque[k]) / base[2]) if base[1] > 0.0 else 0.0
        stiffness = max(stiffness, (2.0 * base[1] * max(abs(r), balance) + base[2]) / base[0])
        wanted = interval * stiffness / _STEP_SHARE
        steps = 1 if not wanted > 1.0 else min(int(wanted) + 1, _MAX_GAP_SUBSTEPS)
        h = interval / steps
        stiffness = 0.0
        for _ in range(steps):
            r, a, damping = _substep(r, a, torque[k], base, terms, active, state, middle, change, h)
            stiffness = max(stiffness, damping)
        rate[k + 1], angle[k + 1] = r, a
    return rate, angle


@_compiled
def constant_runs(values: FloatArray, tolerance: FloatArray) -> FloatArray:
    """Cut (n, k) ``values`` greedily into runs within which no column spans more than its ``tolerance``.

    Returns
    -------
    starts
        (m,) index of each run's first row, as floats.
    """
    n, width = values.shape
    starts = np.empty(n)
    count = 0
    low = np.empty(width)
    high = np.empty(width)
    for k in range(n):
        fits = k > 0
        for j in range(width):
            if fits and max(high[j], values[k, j]) - min(low[j], values[k, j]) > tolerance[j]:
                fits = False
        if fits:
            for j in range(width):
                low[j] = min(low[j], values[k, j])
                high[j] = max(high[j], values[k, j])
        else:
            starts[count] = k
            count += 1
            for j in range(width):
                low[j] = high[j] = values[k, j]
    return starts[:count]


@_compiled
def innovations(  # noqa: PLR0915 - the covariance is written out term by term, without arrays
    time: FloatArray,
    torque: FloatArray,
    angle: FloatArray,
    rate: FloatArray,
    base: FloatArray,
    terms: FloatArray,
    active: Any,
    noise: FloatArray,
    start: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Innovations of an extended Kalman filter with a coloured disturbance torque.

    State: angle, rate r, disturbance d. ``inertia*rdot = torque + d - quadratic*|r|*r - linear*r``, angle_dot = r,
    d a first-order Gauss-Markov process. The mean is stepped by Runge-Kutta, the covariance by the exact
    transition of the linearised motion (Maybeck 1979, chapter 6), both sub-stepped like ``simulate``.

    Parameters
    ----------
    time, torque
        (n,) s and N m held to the next instant.
    angle, rate
        (n,) measured angle in rad and rate in rad/s; NaN where not measured.
    base, terms, active
        As for ``simulate_effects``; the states of the effects are carried along without a variance of their own.
    noise
        Standard deviation of d in N m, its correlation time in s, standard deviation of the white noise of a
        measured angle in rad and of a measured rate in rad/s.
    start
        Rate in rad/s at the first instant and its standard deviation.

    Returns
    -------
    innovation, variance
        (n, 2) of angle and rate; NaN where nothing was measured.
    """
    n = len(time)
    inertia = base[0]
    sigma, tau = noise[0], noise[1]
    state = np.zeros((len(terms), TERM_STATES))
    middle, change = np.zeros_like(state), np.zeros_like(state)
    origin, damping = angle[0], base[2] / inertia
    innovation = np.full((n, 2), np.nan)
    variance = np.full((n, 2), np.nan)
    a, r, d = angle[0], start[0], 0.0
    p00, p01, p02 = noise[2] ** 2, 0.0, 0.0
    p11, p12, p22 = start[1] ** 2, 0.0, sigma**2
    intensity = 2.0 * sigma**2 / tau
    for k in range(n):
        if k > 0:
            interval = time[k] - time[k - 1]
            push = torque[k - 1]
            stiffness = max(damping, (2.0 * base[1] * abs(r) + base[2]) / inertia) + 1.0 / tau
            wanted = interval * stiffness / _FILTER_STEP_SHARE
            steps = 1 if not wanted > 1.0 else min(int(wanted) + 1, _MAX_GAP_SUBSTEPS)
            h = interval / steps
            fade = math.exp(-h / tau)
            for _ in range(steps):
                # The disturbance is taken at its mean over the step, which is short beside its memory.
                push_here = push + d * (1.0 - 0.5 * h / tau)
                r, a, damping = _substep(r, a - origin, push_here, base, terms, active, state, middle, change, h)
                a += origin
                d *= fade
                # Transition of the linearised motion to second order in h, which sub-stepping keeps small.
                f11 = math.exp(-damping * h)
                f01 = h * (1.0 - 0.5 * damping * h)
                f12 = h / inertia * (1.0 - 0.5 * h * (damping + 1.0 / tau))
                f02 = 0.5 * h * h / inertia
                q00 = p00 + f01 * p01 + f02 * p02
                q01 = p01 + f01 * p11 + f02 * p12
                q02 = p02 + f01 * p12 + f02 * p22
                q11 = f11 * p11 + f12 * p12
                q12 = f11 * p12 + f12 * p22
                p00 = q00 + f01 * q01 + f02 * q02 + intensity * h**5 / (20.0 * inertia**2)
                p01 = f11 * q01 + f12 * q02 + intensity * h**4 / (8.0 * inertia**2)
                p02 = fade * q02 + intensity * h**3 / (6.0 * inertia)
                p11 = f11 * q11 + f12 * q12 + intensity * h**3 / (3.0 * inertia**2)
                p12 = fade * q12 + intensity * h**2 / (2.0 * inertia)
                p22 = fade * fade * p22 + sigma**2 * (1.0 - fade * fade)
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
