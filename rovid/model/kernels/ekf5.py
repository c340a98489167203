"""Extended Kalman filter with five states: angle, rate, disturbance torque, and the two states of an oscillator.

The oscillator is a wave torque, or an effect that is oscillatory. Its first state is the integral of the second.
"""

import math
from typing import Any

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.effects.base import TERM_STATES
from rovid.jit.decorators import njit_inline, njit_noalloc
from rovid.jit.simd import LANES, broadcast, exp, extract, load, minimum, reduce_max, sqrt, store
from rovid.model.bound_effects import Equation
from rovid.model.kernels.covariance5 import (
    DAMPED,
    POINTS,
    POWERS,
    SERIES,
    SIZE,
    Slopes,
    add_noise,
    add_point,
    congruence,
    evaluate_series,
    subtract_square,
    transition,
)
from rovid.model.kernels.effect_terms import (
    SCRATCH_ROWS,
    call_sum_terms,
    clear_rows,
    fill_rows,
    gather,
    gather_effect_inputs,
    load_body,
    store_column,
)
from rovid.model.kernels.ekf3 import SAME, filter_step_count, step_limits
from rovid.model.kernels.rk4 import drag_slopes, plain_step, rk4_step, state_substeps
from rovid.model.kernels.warmup import warmed_up

# Step in shares of the shortest time constant: the transition of sixth order is then exact to 1e-4.
_STEP_SHARE = 0.6
# A step length that occurs in so many intervals gets polynomials in the damping, which cost as much as ten steps.
_WORTH_A_SERIES = 32
# Step lengths with a table. Rows after the polynomials: length in s, number of its intervals, decay of the disturbance
# over the step, and its mean in the step.
_LENGTHS, _LENGTH, _INTERVALS, _DECAY, _MEAN = 16, SERIES, SERIES + 1, SERIES + 2, SERIES + 3


def ekf5_innovations(data: Any, inputs: Any, models: Any) -> tuple[FloatArray, FloatArray]:
    """Innovations as by `ekf3_innovations`, with two more states: those of a wave torque, or of an oscillatory effect.

    The wave is white noise through a second-order filter (Fossen 2011, section 8.2.6). The states of an oscillatory
    effect are as uncertain as the motion that excites them. With a wave they have no variance of their own.
    """
    rows, count = TERM_STATES * len(models.terms.kinds), data.output_index.max() + 1
    innovation, variance = np.empty((2, LANES, count))
    state, work = np.zeros((rows, LANES)), np.zeros((3, rows + SCRATCH_ROWS, LANES))
    matrices, tables = np.zeros((4, SIZE * SIZE, LANES)), np.zeros((_LENGTHS, _MEAN + 1, LANES))
    _filter(data, inputs, models, state, work, matrices, tables, innovation, variance)
    return innovation, variance


@warmed_up
@njit_noalloc
def _filter(  # noqa: PLR0912, PLR0915 - one filter, from top to bottom
    data: Any,
    inputs: Any,
    models: Any,
    state: Any,
    work: Any,
    matrices: Any,
    tables: Any,
    innovation: Any,
    variance: Any,
) -> None:
    """Filter one run after the other; fills in ``innovation`` and ``variance``."""
    time, terms, body, has_wave = data.time, models.terms, load_body(models.body), len(models.wave) > 0
    first, p, f, q, scratch = TERM_STATES * terms.oscillatory, matrices[0], matrices[1], matrices[2], matrices[3]
    disturbance_std, tau = load(models.noise, 0), load(models.noise, 1)
    drag, decay_rate, zero = drag_slopes(body), 1.0 / tau, broadcast(0.0)
    inverse_inertia = drag[2]
    noise_std = disturbance_std * sqrt(2.0 * decay_rate)
    frequency, leak, power, wave_std = broadcast(terms.fastest), zero, zero, zero
    if has_wave:
        frequency = load(models.wave, 1)
        leak = 2.0 * load(models.wave, 2) * frequency
        power = 0.5 * load(models.wave, 0) * load(models.wave, 0)
        wave_std = frequency * sqrt(2.0 * leak * power)
        rate_fourth, rate_fifth, fifth_rate = inverse_inertia, zero, zero
        fifth_fourth, fifth_fifth = -frequency * frequency, -leak
    else:
        rate_fourth, rate_fifth, fifth_rate, fifth_fourth, fifth_fifth = _oscillator_slopes(
            body, terms, inverse_inertia, state, work[0]
        )
    limits, stiffness_slope = step_limits(body, decay_rate + frequency), -body.stiffness * inverse_inertia
    slopes = inverse_inertia, rate_fourth, rate_fifth, -decay_rate, fifth_rate, fifth_fourth, fifth_fifth
    h, table, oldest = 0.0, tables[0], 0
    for run in range(len(data.offsets) - 1):
        clear_rows(state)
        fill_rows(state, data.states, run)
        begin, end = data.offsets[run], data.offsets[run + 1]
        equation = Equation(body, terms, broadcast(data.start_position[run]))
        origin, damping = gather(inputs.angles, inputs.angle_index, begin), drag[1]
        # Angle, rate, disturbance, and the oscillator's two states.
        a, r, d, w, v = origin, broadcast(data.initial_rate[run, 0]), zero, zero, zero
        clear_rows(p)
        store(p, 0, load(models.noise, 2) * load(models.noise, 2))
        store(p, SIZE + 1, broadcast(data.initial_rate[run, 1] * data.initial_rate[run, 1]))
        store(p, 2 * SIZE + 2, disturbance_std * disturbance_std)
        if has_wave:
            store(p, 3 * SIZE + 3, power)
            store(p, 4 * SIZE + 4, power * frequency * frequency)
        for k in range(begin, end):
            if k > begin:
                torque = gather(inputs.torque, inputs.torque_index, k - 1)
                effect_inputs = gather_effect_inputs(inputs, k - 1)
                interval = time[k] - time[k - 1]
                steps = filter_step_count(interval, r, torque, damping, limits, drag, _STEP_SHARE)
                if abs(interval / steps - h) > SAME * h:
                    h = interval / steps
                    at = _find_table(tables, h)
                    if at == _LENGTHS:
                        at, oldest = oldest, (oldest + 1) % _LENGTHS
                        _start_table(tables[at], h, tau)
                    table = tables[at]
                    store(f, 2 * SIZE + 2, load(table, _DECAY))
                decay, mean = load(table, _DECAY), load(table, _MEAN)
                table[_INTERVALS, 0] += 1.0
                if table[_INTERVALS, 0] == _WORTH_A_SERIES:
                    _write_series(stiffness_slope, slopes, h, noise_std, wave_std, f, q, table)
                substeps = state_substeps(h, terms)
                for _ in range(steps):
                    d_end, w_end, v_end, other_torque = d * decay, zero, zero, d * mean
                    if has_wave:
                        # Taylor series of the oscillator without noise, and its mean in the step.
                        v1 = fifth_fourth * w + fifth_fifth * v
                        v2 = fifth_fourth * v + fifth_fifth * v1
                        v3 = fifth_fourth * v1 + fifth_fifth * v2
                        w_end = w + h * (v + (h / 2.0) * (v1 + (h / 3.0) * (v2 + (h / 4.0) * v3)))
                        v_end = v + h * (v1 + (h / 2.0) * (v2 + (h / 3.0) * v3))
                        change = v1 + (h / 4.0) * (v2 + (h / 5.0) * v3)
                        other_torque = other_torque + w + (h / 2.0) * (v + (h / 3.0) * change)
                    a = a - origin
                    if len(terms.kinds) == 0:
                        r, a, damping = plain_step(r, a, torque + other_torque, drag, h)
                    else:
                        for _ in range(substeps):
                            r, a, damping = rk4_step(
                                r,
                                a,
                                torque,
                                other_torque,
                                effect_inputs,
                                equation,
                                state,
                                work,
                                broadcast(h / substeps),
                            )
                    # Torque that grows in the step comes late, and turns the vehicle less.
                    late = (w_end - w + d_end - d) * inverse_inertia * (-h * h / 12.0)
                    a = a + origin + late
                    r = r - damping * late
                    d, w, v = d_end, w_end, v_end
                    # The series would diverge for a larger damping, as in ekf3.
                    limited = minimum(damping, 1.0 / h)
                    if table[_INTERVALS, 0] < _WORTH_A_SERIES:
                        _write_step(stiffness_slope, limited, slopes, h, noise_std, wave_std, f, q)
                    else:
                        evaluate_series(table, limited * h, f, q)
                    congruence(f, p, q, scratch)
                late = gather(inputs.timing_moment, inputs.torque_index, k - 1) * inverse_inertia
                a = a + late
                r = r - damping * late
                impulse = (
                    gather(inputs.impulse_variance, inputs.torque_index, k - 1) * inverse_inertia * inverse_inertia
                )
                store(p, 0, load(p, 0) + impulse * (interval * interval / 3.0))
                store(p, 1, load(p, 1) + impulse * (interval / 2.0))
                store(p, SIZE + 1, load(p, SIZE + 1) + impulse)
            for m in range(2):
                measured, predicted = (
                    (gather(inputs.angles, inputs.angle_index, k), a) if m == 0 else (broadcast(data.rate[k]), r)
                )
                if math.isnan(extract(measured, 0)):
                    continue
                noise = load(models.noise, 2 + m)
                s = load(p, (SIZE + 1) * m) + noise * noise
                e = measured - predicted
                store_column(innovation, data.output_index[k, m], e)
                store_column(variance, data.output_index[k, m], s)
                inverse = 1.0 / s
                scaled = e * inverse
                # Column m of the covariance.
                row = SIZE * m
                p0, p1, p2 = load(p, m), load(p, row + 1), load(p, row + 2)
                p3, p4 = load(p, row + 3), load(p, row + 4)
                a, r, d = a + p0 * scaled, r + p1 * scaled, d + p2 * scaled
                if has_wave:
                    w, v = w + p3 * scaled, v + p4 * scaled
                else:
                    store(state, first, load(state, first) + p3 * scaled)
                    store(state, first + 1, load(state, first + 1) + p4 * scaled)
                subtract_square(p, (p0, p1, p2, p3, p4), inverse)


@njit_noalloc
def _find_table(tables: Any, h: float) -> int:
    """Index of the table for steps of ``h`` s; `_LENGTHS` if there is none."""
    at = 0
    while at < _LENGTHS and abs(h - tables[at, _LENGTH, 0]) > SAME * h:
        at += 1
    return at


@njit_inline
def _start_table(table: Any, h: float, tau: Any) -> None:
    """Use ``table`` for steps of ``h`` s, with a disturbance of correlation time ``tau`` in s."""
    decay = exp(-h / tau)
    store(table, _LENGTH, broadcast(h))
    store(table, _INTERVALS, broadcast(0.0))
    store(table, _DECAY, decay)
    store(table, _MEAN, (1.0 - decay) * tau / h)


@njit_noalloc
def _write_step(
    stiffness_slope: Any, damping: Any, slopes: Any, h: float, noise_std: Any, wave_std: Any, f: Any, q: Any
) -> None:
    """Write transition ``f``, without the disturbance's row, and noise covariance ``q`` of a step of ``h`` s."""
    zero, system = broadcast(0.0), Slopes(stiffness_slope, -damping, *slopes)
    transition(system, h, f)
    clear_rows(q)
    add_noise(system, (zero, zero, noise_std, zero, zero), h, q)
    if reduce_max(wave_std) > 0.0:
        add_noise(system, (zero, zero, zero, zero, wave_std), h, q)


@njit_noalloc
def _write_series(
    stiffness_slope: Any, slopes: Any, h: float, noise_std: Any, wave_std: Any, f: Any, q: Any, series: Any
) -> None:
    """Write the polynomials in the damping of transition and noise, for steps of ``h`` s."""
    for at in range(SERIES):
        store(series, at, 0.0)
    for point in range(POINTS):
        _write_step(stiffness_slope, broadcast(DAMPED[point] / h), slopes, h, noise_std, wave_std, f, q)
        add_point(POWERS, point, f, q, series)


@njit_inline
def _oscillator_slopes(body: Any, terms: Any, inverse_inertia: Any, state: Any, derivative: Any) -> Any:
    """Slopes of rdot in the two states of the oscillatory term, and of the second state in r and both states."""
    zero, first = broadcast(0.0), TERM_STATES * terms.oscillatory
    equation, no_inputs = Equation(body, terms, zero), (zero, zero, zero)
    call_sum_terms(broadcast(1.0), zero, zero, no_inputs, equation, state, derivative)
    fifth_rate = load(derivative, first + 1)
    rest = call_sum_terms(zero, zero, zero, no_inputs, equation, state, derivative)
    store(state, first, 1.0)
    rate_fourth = (call_sum_terms(zero, zero, zero, no_inputs, equation, state, derivative) - rest) * inverse_inertia
    fifth_fourth = load(derivative, first + 1)
    store(state, first, 0.0)
    store(state, first + 1, 1.0)
    rate_fifth = (call_sum_terms(zero, zero, zero, no_inputs, equation, state, derivative) - rest) * inverse_inertia
    store(state, first + 1, 0.0)
    return rate_fourth, rate_fifth, fifth_rate, fifth_fourth, load(derivative, first + 1)
