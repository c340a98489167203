"""Extended Kalman filter with three states: angle, rate and a coloured disturbance torque."""

import math
from typing import Any

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.effects.base import TERM_STATES
from rovid.jit.decorators import njit_inline, njit_noalloc
from rovid.jit.simd import LANES, broadcast, exp, extract, load, maximum, minimum, reduce_max, sqrt, store, traced
from rovid.model.bound_effects import Equation
from rovid.model.kernels.effect_terms import (
    SCRATCH_ROWS,
    clear_rows,
    fill_rows,
    gather,
    gather_effect_inputs,
    load_body,
    store_column,
)
from rovid.model.kernels.rk4 import MAX_STEPS, drag_damping, drag_slopes, plain_step, rk4_step, state_substeps
from rovid.model.kernels.warmup import warmed_up

# Step of the covariance in shares of the shortest time constant: the transition of fourth order is then exact to 1e-4.
_STEP_SHARE = 0.3
# Gauss-Legendre nodes and weights on 0..1.
NODES = (0.1127016653792583, 0.5, 0.8872983346207417)
WEIGHTS = (5.0 / 18.0, 8.0 / 18.0, 5.0 / 18.0)
_TINY = 1e-12
# Steps that differ by no more than this share count as equal.
SAME = 1e-9
# First rows of power series in the damping: transition from the disturbance to angle and rate (four terms each), noise
# covariance of disturbance with angle and rate (four terms each), of angle, angle with rate, and rate (seven terms
# each).
_F02, _F12, _N02, _N12, _N00, _N01, _N11, _SERIES = 0, 4, 8, 12, 16, 23, 30, 37


@njit_inline
def filter_step_count(
    interval: float, rate: Any, torque: Any, damping: Any, limits: Any, slopes: Any, share: float
) -> int:
    """Number of steps of at most such a ``share`` of the shortest time constant in an ``interval`` in s.

    ``limits`` are those of `step_limits`, ``slopes`` those of `drag_slopes`.
    """
    # The fastest rate before the interval is over, or at which drag balances the torque.
    size, acceleration = abs(rate), abs(torque) * slopes[2]
    fastest = minimum(size + interval * acceleration, maximum(size, sqrt(acceleration * limits[1])))
    wanted = reduce_max(interval * (maximum(damping, drag_damping(fastest, slopes)) + limits[0])) / share
    return 1 if not wanted > 1.0 else min(int(wanted) + 1, MAX_STEPS)


@traced
def step_limits(body: Any, decay_rate: Any) -> Any:
    """Constant inputs of `filter_step_count`: rates of the disturbance and a swing in 1/s; inertia over drag."""
    return decay_rate + sqrt(body.stiffness / body.inertia), body.inertia / (body.quadratic_drag + _TINY)


def ekf3_innovations(data: Any, inputs: Any, models: Any) -> tuple[FloatArray, FloatArray]:
    """Innovations of four extended Kalman filters with a coloured disturbance torque, and their variances.

    States: angle, rate r, disturbance d, with ``inertia*rdot = torque + d - quadratic*|r|*r - linear*r``, angle_dot =
    r, and d a first-order Gauss-Markov process. Runge-Kutta steps propagate the mean, the transition matrix of the
    linearised motion propagates the covariance (Maybeck 1979, chapter 6). Steps are short compared to the time
    constants, and the same in all lanes. States of effects follow the mean, without variance. In plain numpy:
    `rovid.model.reference`.

    ``data``, ``inputs``, ``models``: `FilterData`, `FilterInputs` and `ParameterBatch` of `rovid.model.filter_batch`.
    Returns ``innovation``, ``variance``: (LANES, N) in the order of ``data.output_index``.
    """
    rows, count = TERM_STATES * len(models.terms.kinds), data.output_index.max() + 1
    innovation, variance = np.empty((2, LANES, count))
    state, work, series = np.zeros((rows, LANES)), np.zeros((3, rows + SCRATCH_ROWS, LANES)), np.zeros((_SERIES, LANES))
    _filter(data, inputs, models, state, work, series, innovation, variance)
    return innovation, variance


@warmed_up
@njit_noalloc
def _filter(  # noqa: PLR0915 - one filter, from top to bottom
    data: Any, inputs: Any, models: Any, state: Any, work: Any, series: Any, innovation: Any, variance: Any
) -> None:
    """Filter one run after the other; fills in ``innovation`` and ``variance``."""
    time, terms, body = data.time, models.terms, load_body(models.body)
    disturbance_std, tau = load(models.noise, 0), load(models.noise, 1)
    angle_noise, rate_noise = load(models.noise, 2), load(models.noise, 3)
    angle_variance, rate_variance = angle_noise * angle_noise, rate_noise * rate_noise
    disturbance_variance = disturbance_std * disturbance_std
    slopes, has_stiffness = drag_slopes(body), reduce_max(body.stiffness) > 0.0
    inverse_inertia = slopes[2]
    decay_rate = 1.0 / tau
    limits, zero = step_limits(body, decay_rate), broadcast(0.0)
    for run in range(len(data.offsets) - 1):
        clear_rows(state)
        fill_rows(state, data.states, run)
        begin, end = data.offsets[run], data.offsets[run + 1]
        equation = Equation(body, terms, broadcast(data.start_position[run]))
        origin, damping = gather(inputs.angles, inputs.angle_index, begin), slopes[1]
        a, r, d = origin, broadcast(data.initial_rate[run, 0]), zero
        p00, p01, p02 = angle_variance, zero, zero
        p11, p12 = broadcast(data.initial_rate[run, 1] * data.initial_rate[run, 1]), zero
        p22 = disturbance_variance
        h, decay, mean, noise22, kick = 0.0, zero, zero, zero, zero
        for k in range(begin, end):
            if k > begin:
                interval = time[k] - time[k - 1]
                torque = gather(inputs.torque, inputs.torque_index, k - 1)
                effect_inputs = gather_effect_inputs(inputs, k - 1)
                steps = filter_step_count(interval, r, torque, damping, limits, slopes, _STEP_SHARE)
                # Most logs are sampled evenly, except for rounding: values that depend on the step alone are kept.
                if abs(interval / steps - h) > SAME * h:
                    h = interval / steps
                    # Decay of the disturbance over a step, and its mean in the step.
                    decay = exp(-h * decay_rate)
                    mean = (1.0 - decay) * tau / h
                    noise22, kick = (
                        disturbance_variance * (1.0 - decay * decay),
                        0.5 * h * body.stiffness * inverse_inertia,
                    )
                    _expand(h, decay_rate, inverse_inertia, 2.0 * disturbance_variance * decay_rate * h, series)
                # States of effects faster than this have no variance: substeps of the mean alone are enough.
                substeps = state_substeps(h, terms)
                for _ in range(steps):
                    a = a - origin
                    # In the step the disturbance acts by its mean.
                    if len(terms.kinds) == 0:
                        r, a, damping = plain_step(r, a, torque + d * mean, slopes, h)
                    else:
                        for _ in range(substeps):
                            r, a, damping = rk4_step(
                                r, a, torque, d * mean, effect_inputs, equation, state, work, broadcast(h / substeps)
                            )
                    # The decaying disturbance is larger early in the step, which turns the vehicle more.
                    early = (1.0 - decay) * d * inverse_inertia * (h * h / 12.0)
                    a = a + origin + early
                    r = r - damping * early
                    d = d * decay
                    # The restoring torque acts as half an impulse at each end of the step (Strang 1968).
                    if has_stiffness:
                        p11 = p11 + kick * (kick * p00 - 2.0 * p01)
                        p12 = p12 - kick * p02
                        p01 = p01 - kick * p00
                    # The series would diverge for a damping that has grown since the steps were counted.
                    limited = minimum(damping, 1.0 / h)
                    x = limited * h
                    f = 1.0 - x * (0.5 - x * (1.0 / 6.0 - x * (1.0 / 24.0)))
                    f11, f01 = 1.0 - x * f, h * f
                    f02, f12 = _cubic(series, _F02, limited), _cubic(series, _F12, limited)
                    q00 = p00 + f01 * p01 + f02 * p02
                    q01 = p01 + f01 * p11 + f02 * p12
                    q02 = p02 + f01 * p12 + f02 * p22
                    q11 = f11 * p11 + f12 * p12
                    q12 = f11 * p12 + f12 * p22
                    p00 = q00 + f01 * q01 + f02 * q02 + _sextic(series, _N00, limited)
                    p01 = f11 * q01 + f12 * q02 + _sextic(series, _N01, limited)
                    p02 = decay * q02 + _cubic(series, _N02, limited)
                    p11 = f11 * q11 + f12 * q12 + _sextic(series, _N11, limited)
                    p12 = decay * q12 + _cubic(series, _N12, limited)
                    p22 = decay * decay * p22 + noise22
                    if has_stiffness:
                        p11 = p11 + kick * (kick * p00 - 2.0 * p01)
                        p12 = p12 - kick * p02
                        p01 = p01 - kick * p00
                late = gather(inputs.timing_moment, inputs.torque_index, k - 1) * inverse_inertia
                a = a + late
                r = r - damping * late
                impulse = (
                    gather(inputs.impulse_variance, inputs.torque_index, k - 1) * inverse_inertia * inverse_inertia
                )
                p00 = p00 + impulse * (interval * interval / 3.0)
                p01 = p01 + impulse * (interval / 2.0)
                p11 = p11 + impulse
            measured = gather(inputs.angles, inputs.angle_index, k)
            if not math.isnan(extract(measured, 0)):
                s = p00 + angle_variance
                e = measured - a
                store_column(innovation, data.output_index[k, 0], e)
                store_column(variance, data.output_index[k, 0], s)
                inverse = 1.0 / s
                k0, k1, k2 = p00 * inverse, p01 * inverse, p02 * inverse
                a, r, d = a + k0 * e, r + k1 * e, d + k2 * e
                p11, p12, p22 = p11 - k1 * p01, p12 - k1 * p02, p22 - k2 * p02
                rest = 1.0 - k0
                p02, p01, p00 = rest * p02, rest * p01, rest * p00
            if not math.isnan(data.rate[k]):
                s = p11 + rate_variance
                e = data.rate[k] - r
                store_column(innovation, data.output_index[k, 1], e)
                store_column(variance, data.output_index[k, 1], s)
                inverse = 1.0 / s
                k0, k1, k2 = p01 * inverse, p11 * inverse, p12 * inverse
                a, r, d = a + k0 * e, r + k1 * e, d + k2 * e
                p00, p02, p22 = p00 - k0 * p01, p02 - k0 * p12, p22 - k2 * p12
                rest = 1.0 - k1
                p01, p12, p11 = rest * p01, rest * p12, rest * p11


@njit_noalloc
def _expand(h: float, decay_rate: Any, inverse_inertia: Any, impulse: Any, series: Any) -> None:
    """`_write_series` without inlining, which makes the loop around it faster."""
    _write_series(h, decay_rate, inverse_inertia, impulse, series)


@traced
def _write_series(h: float, decay_rate: Any, inverse_inertia: Any, impulse: Any, series: Any) -> None:
    """Write the ``series`` in the damping for steps of ``h`` s; ``impulse`` is the noise variance in a step."""
    for at in range(_N02, _SERIES):
        store(series, at, broadcast(0.0))
    angle, rate = _response(h, decay_rate, inverse_inertia)
    for i in range(4):
        store(series, _F02 + i, angle[i])
        store(series, _F12 + i, rate[i])
    for node in range(3):
        t, weight = NODES[node] * h, impulse * WEIGHTS[node]
        angle, rate = _response(t, decay_rate, inverse_inertia)
        left = exp(-t * decay_rate)
        for i in range(4):
            _add(series, _N02 + i, weight * angle[i] * left)
            _add(series, _N12 + i, weight * rate[i] * left)
            for j in range(4):
                _add(series, _N00 + i + j, weight * angle[i] * angle[j])
                _add(series, _N01 + i + j, weight * angle[i] * rate[j])
                _add(series, _N11 + i + j, weight * rate[i] * rate[j])


@traced
def _add(series: Any, at: int, x: Any) -> None:
    store(series, at, load(series, at) + x)


@traced
def _response(t: float, decay_rate: Any, inverse_inertia: Any) -> Any:
    """Angle and rate after ``t`` s under a torque exp(-b t) with b the ``decay_rate``, as series in the damping a.

    These are (exp(-b t) - exp(-a t)) / (a - b) / inertia and its integral, without a pole at a = b.
    """
    c, d, e = t / 2.0, t * t / 6.0, t * t * t / 24.0
    b, b2 = decay_rate, decay_rate * decay_rate
    rate = t * inverse_inertia
    rates = rate * (1.0 - c * b + d * b2 - e * b2 * b), rate * (d * b - c - e * b2), rate * (d - e * b), rate * -e
    c, d, e = t / 3.0, t * t / 12.0, t * t * t / 60.0
    angle = 0.5 * t * t * inverse_inertia
    angles = angle * (1.0 - c * b + d * b2 - e * b2 * b), angle * (d * b - c - e * b2), angle * (d - e * b), angle * -e
    return angles, rates


@traced
def _cubic(series: Any, at: int, x: Any) -> Any:
    return ((load(series, at + 3) * x + load(series, at + 2)) * x + load(series, at + 1)) * x + load(series, at)


@traced
def _sextic(series: Any, at: int, x: Any) -> Any:
    # In two halves, which can be computed at the same time.
    square = x * x
    even = (load(series, at + 6) * square + load(series, at + 4)) * square + load(series, at + 2)
    odd = (load(series, at + 5) * square + load(series, at + 3)) * square + load(series, at + 1)
    return even * square + odd * x + load(series, at)
