"""Classical fourth-order Runge-Kutta steps, and the free-running simulation.

SIMD vectors are never changed in place, because other names may refer to them. The states of effects are changed in
place.
"""

import math
from typing import Any

import numpy as np

from rovid.core.array_types import FloatArray, IntArray
from rovid.effects.base import TERM_STATES, Body
from rovid.jit.decorators import njit_inline, njit_noalloc
from rovid.jit.simd import LANES, broadcast, extract, insert, load, maximum, minimum, reduce_max, sqrt, store, traced
from rovid.model.bound_effects import Equation
from rovid.model.kernels.effect_terms import (
    SCRATCH_ROWS,
    broadcast_equation,
    copy_rows,
    gather,
    reset_states,
    sum_terms,
)

# Nodes of stages two to four as shares of the step, and six times the weights of all four stages.
NODES = (0.5, 0.5, 1.0)
WEIGHTS = (1.0, 2.0, 2.0, 1.0)
# Step in shares of the shortest time constant. The error is about 1e-6 without effects, and 1e-4 with effects, because
# their equations are known less well.
_STEP_SHARE, EFFECTS_STEP_SHARE = 0.2, 0.5
# Largest number of steps in an interval. Without effects, the steps of a longer gap are repeated until the relative
# change of the rate is below _SETTLED. With effects all steps are done, up to a gap of 2000 time constants; more steps
# follow only from drags that ran off, where each evaluation would take minutes.
_MAX_PLAIN_STEPS, MAX_STEPS = 100, 10_000
_SETTLED = 1e-9
# Smallest denominator, in place of a drag of zero.
_TINY = 1e-12


@traced
def drag_slopes(body: Any) -> Any:
    """Quadratic and linear drag over the inertia, and one over the inertia."""
    return body.quadratic_drag / body.inertia, body.linear_drag / body.inertia, 1.0 / body.inertia


@traced
def _acceleration(rate: Any, push: Any, slopes: Any) -> Any:
    """Acceleration in rad/s^2 under drag; ``push`` is all other torque over the inertia."""
    return push - (slopes[0] * abs(rate) + slopes[1]) * rate


@traced
def drag_damping(rate: Any, slopes: Any) -> Any:
    """-d(acceleration)/d(rate) of the drag in 1/s; ``slopes`` as by `drag_slopes`."""
    return 2.0 * slopes[0] * abs(rate) + slopes[1]


@traced
def plain_step(rate: Any, angle: Any, torque: Any, slopes: Any, h: Any) -> Any:
    """One step of ``h`` s of rate and angle without effects; also the damping in mid-step in 1/s.

    `rk4_step` without terms takes twice as long, and this is the innermost of all loops.
    """
    push, half = torque * slopes[2], 0.5 * h
    k1 = _acceleration(rate, push, slopes)
    rate2 = rate + half * k1
    k2 = _acceleration(rate2, push, slopes)
    rate3 = rate + half * k2
    k3 = _acceleration(rate3, push, slopes)
    rate4 = rate + h * k3
    k4 = _acceleration(rate4, push, slopes)
    angle = angle + h / 6.0 * (rate + 2.0 * (rate2 + rate3) + rate4)
    return rate + h / 6.0 * (k1 + 2.0 * (k2 + k3) + k4), angle, drag_damping(rate2, slopes)


@njit_noalloc
def rk4_step(
    start_rate: Any,
    start_angle: Any,
    thruster_torque: Any,
    other_torque: Any,
    effect_inputs: Any,
    equation: Any,
    state: Any,
    work: Any,
    h: Any,
) -> Any:
    """One step of rate and angle, and of the states of effects.

    Parameters
    ----------
    thruster_torque, other_torque
        N m. Effects depend on the first alone.
    effect_inputs, equation
        As in `sum_terms`.
    state, work
        States as there, stepped in place; (3, rows + SCRATCH_ROWS, LANES) work space.
    h
        Vector of steps in s.

    Returns
    -------
    rate, angle, damping
        The damping -d(rdot)/dr in 1/s is that of drag in mid-step, and that of effects at the start.
    """
    rows, derivative, stage_state, sums = TERM_STATES * equation.terms.stateful, work[0], work[1], work[2]
    slopes = drag_slopes(equation.body)
    push, nudge = (thruster_torque + other_torque) * slopes[2], 1e-6 + 1e-4 * abs(start_rate)
    # A vehicle that hardly moves may be about to turn back: states are reset for the nudged rate too.
    rate, angle = start_rate + nudge, start_angle
    reset_states(rate, equation, state)
    copy_rows(rows, state, stage_state)
    angle_sum = rate_sum = effect_slope = damping = broadcast(0.0)
    # Stage -1 evaluates the effects at the nudged rate: their slope is a difference quotient.
    for stage in range(-1, 4):
        extra = sum_terms(rate, angle, thruster_torque, effect_inputs, equation, stage_state, derivative) * slopes[2]
        if stage < 0:
            effect_slope, rate = extra, start_rate
            reset_states(rate, equation, state)
            copy_rows(rows, state, stage_state)
            continue
        if stage == 0:
            effect_slope = (effect_slope - extra) / nudge
        if stage == 1:
            damping = maximum(drag_damping(rate, slopes) - effect_slope, 0.0)
        acceleration = _acceleration(rate, push + extra, slopes)
        angle_sum = angle_sum + WEIGHTS[stage] * rate
        rate_sum = rate_sum + WEIGHTS[stage] * acceleration
        advance_states(stage, rows, state, derivative, h, stage_state, sums)
        if stage < 3:
            angle = start_angle + NODES[stage] * h * rate
            rate = start_rate + NODES[stage] * h * acceleration
    return start_rate + h / 6.0 * rate_sum, start_angle + h / 6.0 * angle_sum, damping


@njit_inline
def advance_states(stage: int, rows: int, state: Any, derivative: Any, h: Any, stage_state: Any, sums: Any) -> None:
    """Advance ``stage_state`` to the next stage, and after the last stage ``state`` itself, by a step ``h`` in s.

    ``sums`` accumulates the weighted derivatives of the ``rows`` states.
    """
    for j in range(rows):
        slope = load(derivative, j)
        total = load(state if stage == 0 else sums, j) + (WEIGHTS[stage] / 6.0) * h * slope
        if stage < 3:
            store(sums, j, total)
            store(stage_state, j, load(state, j) + NODES[stage] * h * slope)
        else:
            store(state, j, total)


@njit_inline
def state_substeps(h: float, terms: Any) -> int:
    """Number of substeps that the states of effects need in a step of ``h`` s, at most `MAX_STEPS`."""
    wanted: float = h * terms.fastest / EFFECTS_STEP_SHARE
    return 1 if not wanted > 1.0 else math.ceil(min(wanted, float(MAX_STEPS)))


@njit_inline
def wanted_steps(rate: Any, torque: Any, damping: Any, interval: Any, equation: Any) -> Any:
    """Steps that an interval needs, as real numbers; ``damping`` in 1/s is that of the interval before."""
    body, size = equation.body, abs(torque)
    # The steady rate is at most the smaller one of those with either drag alone.
    balance = minimum(sqrt(size / maximum(body.quadratic_drag, _TINY)), size / maximum(body.linear_drag, _TINY))
    damping = maximum(
        maximum(damping, equation.terms.fastest), drag_damping(maximum(abs(rate), balance), drag_slopes(body))
    )
    return interval * damping / EFFECTS_STEP_SHARE


@njit_inline
def step_count(wanted: Any) -> int:
    """Whole number of steps for the largest of the ``wanted`` ones."""
    most = reduce_max(wanted)
    return 1 if not most > 1.0 else min(int(most) + 1, MAX_STEPS)


def simulate(time: FloatArray, torque: FloatArray, body: Body, initial_rate: float) -> tuple[FloatArray, FloatArray]:
    """Integrate ``inertia*rdot + quadratic*|r|*r + linear*r = torque`` and ``angle_dot = r``.

    ``time``: (n,) s, increasing.
    ``torque``: (n,) N m, held from each instant to the next.
    ``initial_rate``: rad/s at the first instant; the angle starts at 0.
    Returns (n,) rate in rad/s and (n,) angle in rad. Steps are a small share of the local time constant
    ``inertia / (2*quadratic*|r| + linear)``.
    """
    rates, angles = np.empty(len(time)), np.empty(len(time))
    rates[0], angles[0] = initial_rate, 0.0
    _simulate(np.diff(time), torque, body, rates, angles)
    return rates, angles


@njit_noalloc
def _simulate(intervals: FloatArray, torque: FloatArray, body: Body, rates: FloatArray, angles: FloatArray) -> None:
    """Fill in ``rates`` and ``angles`` after the first instant."""
    quadratic, linear, slopes = body.quadratic_drag, body.linear_drag, drag_slopes(body)
    for k in range(len(intervals)):
        rate = rates[k]
        angle = angles[k]
        # The rate approaches the steady rate. The larger one of the two rates determines the time constant.
        balance = math.sqrt(abs(torque[k]) / quadratic) if quadratic > 0.0 else 0.0
        if linear > 0.0:
            balance = min(balance, abs(torque[k]) / linear) if quadratic > 0.0 else 0.0
        left = intervals[k]
        while left > 0.0:
            damping = drag_damping(max(abs(rate), balance), slopes)
            wanted = left * damping / _STEP_SHARE
            is_gap = wanted > _MAX_PLAIN_STEPS
            steps = 1 if not wanted > 1.0 else int(min(wanted, _MAX_PLAIN_STEPS - 1.0)) + 1
            h = _STEP_SHARE / damping if is_gap else left / steps
            before = rate
            for _ in range(steps):
                rate, angle, _ = plain_step(rate, angle, torque[k], slopes, h)
            left = left - steps * h if is_gap else 0.0
            if not abs(rate - before) > _SETTLED * abs(rate):
                angle += rate * left
                left = 0.0
        rates[k + 1] = rate
        angles[k + 1] = angle


@njit_noalloc
def advance(
    rate: float,
    angle: float,
    thruster_torque: float,
    other_torque: float,
    timing_moment: float,
    effect_inputs: Any,
    interval: float,
    equation: Any,
    state: Any,
    work: Any,
    damping: float,
) -> Any:
    """One interval of `simulate_effects`, for a control loop outside.

    Parameters
    ----------
    thruster_torque, other_torque
        N m. Effects depend on the first alone.
    effect_inputs
        (3,) wash, surge and sway speed in the interval, see `rovid.model.torque_input.TorqueInput`.
    state, work
        (m * TERM_STATES, LANES) states of the effects, advanced in place, the same in all lanes; (3, m * TERM_STATES +
        SCRATCH_ROWS, LANES) work space.
    damping
        1/s, as returned for the interval before; 0 at the start.

    Returns
    -------
    rate, angle, damping
        At the interval's end.
    """
    inputs = broadcast(effect_inputs[0]), broadcast(effect_inputs[1]), broadcast(effect_inputs[2])
    motion = broadcast(rate), broadcast(angle), broadcast(damping)
    torque = broadcast(thruster_torque), broadcast(other_torque), broadcast(timing_moment), inputs
    end_rate, end_angle, fastest = _advance(
        motion, torque, broadcast(interval), broadcast_equation(equation), state, work
    )
    return extract(end_rate, 0), extract(end_angle, 0), extract(fastest, 0)


@njit_inline
def _advance(motion: Any, torque: Any, interval: Any, equation: Any, state: Any, work: Any) -> Any:
    """Rate, angle and damping after an ``interval``, all vectors; see `advance`."""
    (rate, angle, damping), (thruster_torque, other_torque, timing_moment, effect_inputs) = motion, torque
    steps = step_count(wanted_steps(rate, thruster_torque + other_torque, damping, interval, equation))
    h, fastest = interval / steps, broadcast(equation.terms.fastest)
    for _ in range(steps):
        rate, angle, damping = rk4_step(
            rate, angle, thruster_torque, other_torque, effect_inputs, equation, state, work, h
        )
        fastest = maximum(fastest, damping)
    # Torque late in the interval (negative moment) has turned the vehicle less, and drag has reduced the rate less.
    late = timing_moment / equation.body.inertia
    return rate - drag_damping(rate, drag_slopes(equation.body)) * late, angle + late, fastest


def simulate_effects(
    offsets: IntArray,
    time: FloatArray,
    torque_input: tuple[FloatArray, FloatArray, FloatArray],
    starts: FloatArray,
    first: FloatArray,
    states: FloatArray,
    body: Body,
    terms: Any,
) -> tuple[FloatArray, FloatArray]:
    """Simulate r runs, concatenated, with effects in the equation of motion.

    ``offsets``: (r + 1,) index of each run's first instant, and n.
    ``time``: (n,) s.
    ``torque_input``: (n,) torque in N m, (n,) timing moment in N m s^2 and (n, 3) effect inputs, see `TorqueInput`.
    ``starts``: (r,) rad, the position at the start of each run's trial.
    ``first``, ``states``: (r, 2) rate in rad/s and angle in rad since the start of the trial, and (r, m * TERM_STATES)
        states of the effects, at the first instant of each run.
    ``body``, ``terms``: Those of the runs' `rovid.model.bound_effects.Equation`.
    Returns (n,) rate in rad/s and (n,) angle in rad.
    """
    intervals = np.diff(time, append=time[-1])
    # Lanes whose run has ended stay where they are.
    intervals[offsets[1:] - 1] = 0.0
    inputs = np.column_stack((intervals, *torque_input))
    motion = np.empty((len(time), 2))
    motion[offsets[:-1]] = first
    at, work = np.zeros((2, LANES), dtype=np.int64), np.zeros((4, states.shape[1] + SCRATCH_ROWS, LANES))
    _simulate_effects((offsets, starts, states), inputs, Equation(body, terms, 0.0), at, work, motion)
    rate, angle = np.ascontiguousarray(motion.T)
    return rate, angle


@njit_noalloc
def _simulate_effects(runs: Any, inputs: FloatArray, equation: Any, at: Any, work: Any, motion: FloatArray) -> None:
    """Simulate one run in each lane; fills in ``motion`` after the first instant of each."""
    (offsets, starts, states), body = runs, broadcast_equation(equation).body
    here, last, state = at[0], at[1], work[0]
    for group in range(0, len(starts), LANES):
        start, longest = broadcast(0.0), 0
        for i in range(LANES):
            # Lanes without a run of their own repeat the last one.
            run = min(group + i, len(starts) - 1)
            start, here[i], last[i] = insert(start, i, starts[run]), offsets[run], offsets[run + 1] - 1
            longest = max(longest, last[i] - here[i])
            for j in range(states.shape[1]):
                state[j, i] = states[run, j]
        own = Equation(body, equation.terms, start)
        rate, angle, damping = gather(motion, here, 0), gather(motion, here, 1), broadcast(0.0)
        for _ in range(longest):
            interval, timing_moment = gather(inputs, here, 0), gather(inputs, here, 2)
            effect_inputs = gather(inputs, here, 3), gather(inputs, here, 4), gather(inputs, here, 5)
            torque = gather(inputs, here, 1), broadcast(0.0), timing_moment, effect_inputs
            rate, angle, damping = _advance((rate, angle, damping), torque, interval, own, state, work[1:])
            for i in range(LANES):
                if here[i] < last[i]:
                    here[i] += 1
                    motion[here[i], 0], motion[here[i], 1] = extract(rate, i), extract(angle, i)
