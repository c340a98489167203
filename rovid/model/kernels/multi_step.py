"""Multi-step predictions from many restarts on a measured trajectory, and the terms of effects along it."""

from typing import Any

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.effects.base import TERM_STATES, Body
from rovid.jit.decorators import njit_noalloc
from rovid.jit.simd import LANES, broadcast, extract, insert, maximum, nan_unless_below, reduce_max
from rovid.model.bound_effects import Equation
from rovid.model.kernels.effect_terms import (
    SCRATCH_ROWS,
    broadcast_equation,
    call_sum_terms,
    copy_rows,
    gather,
    reset_states,
)
from rovid.model.kernels.rk4 import (
    NODES,
    advance_states,
    drag_slopes,
    plain_step,
    rk4_step,
    state_substeps,
    step_count,
    wanted_steps,
)
from rovid.model.kernels.warmup import warmed_up

# A prediction has diverged at so many times the largest measured rate.
_DIVERGED = 30.0
# A prediction that needs more steps in an interval is given up: time constants are ten intervals or more.
_MAX_STEPS = 200


def predict_multi_step(
    period: FloatArray,
    torque: FloatArray,
    effect_inputs: FloatArray,
    rate: FloatArray,
    angle: FloatArray,
    states: FloatArray,
    restarts: Any,
    steps_ahead: Any,
    start: FloatArray,
    body: Body,
    terms: Any,
) -> FloatArray:
    """Angle turned after each of up to ``steps_ahead`` grid intervals from each of the (m,) restarts.

    ``period``: (m,) s, the grid interval of each restart.
    ``torque``, ``effect_inputs``: (n,) N m and (n, 3), see `TorqueInput`; means over the grid intervals.
    ``rate``, ``angle``, ``states``: (n,), (n,) and (n, k * TERM_STATES) on the measured trajectory.
    ``restarts``, ``steps_ahead``: (m,) indices on the grid, and numbers of intervals.
    ``start``: (m,) rad; the position at the start of the trial.
    ``body``, ``terms``: Those of the common `rovid.model.bound_effects.Equation`.
    Returns (m, 1 + largest of ``steps_ahead``) rad; NaN beyond, and after a prediction has diverged or needs too many
    steps.
    """
    rows, limit = TERM_STATES * len(terms.kinds), _DIVERGED * float(np.fmax.reduce(np.abs(rate), initial=0.0))
    turned = np.full((len(restarts), 1 + int(steps_ahead.max(initial=0))), np.nan)
    state, work = np.zeros((rows, LANES)), np.zeros((3, rows + SCRATCH_ROWS, LANES))
    trajectory, begun = (torque, effect_inputs, rate, angle, states), (restarts, steps_ahead, period, start)
    _predict(begun, trajectory, body, terms, limit, state, work, turned)
    return turned


@warmed_up
@njit_noalloc
def _predict(
    begun: Any, trajectory: Any, body: Any, terms: Any, limit: float, state: Any, work: Any, turned: Any
) -> None:
    """Predict from one restart in each lane; fills in the rows of ``turned``."""
    (restarts, steps_ahead, period, start), (torque, effect_inputs, rate, angle, states) = begun, trajectory
    all_bodies, zero = broadcast_equation(Equation(body, terms, 0.0)).body, broadcast(0.0)
    slopes = drag_slopes(all_bodies)
    for first in range(0, len(restarts), LANES):
        r, a, interval, origin, longest = broadcast(0.0), broadcast(0.0), broadcast(1.0), broadcast(0.0), 0
        for i in range(LANES):
            # Lanes without a restart of their own repeat the last one.
            own = min(first + i, len(restarts) - 1)
            at, longest = restarts[own], max(longest, steps_ahead[own])
            r, a = insert(r, i, rate[at]), insert(a, i, angle[at])
            interval, origin = insert(interval, i, period[own]), insert(origin, i, start[own])
            for j in range(TERM_STATES * terms.stateful):
                state[j, i] = states[at, j]
            turned[own, 0] = 0.0
        equation, begin, largest_damping = Equation(all_bodies, terms, origin), a, zero
        for k in range(longest):
            thruster_torque, wash, surge, sway = zero, zero, zero, zero
            for i in range(LANES):
                at = min(restarts[min(first + i, len(restarts) - 1)] + k, len(torque) - 1)
                thruster_torque, wash = insert(thruster_torque, i, torque[at]), insert(wash, i, effect_inputs[at, 0])
                surge, sway = insert(surge, i, effect_inputs[at, 1]), insert(sway, i, effect_inputs[at, 2])
            wanted = wanted_steps(r, thruster_torque, largest_damping, interval, equation)
            # NaN gives up the predictions that need too many steps.
            r, wanted = nan_unless_below(r, wanted, _MAX_STEPS), nan_unless_below(wanted, wanted, _MAX_STEPS)
            steps = step_count(wanted)
            h, largest_damping = interval / steps, zero
            for _ in range(steps):
                if len(terms.kinds) == 0:
                    r, a, damping = plain_step(r, a, thruster_torque, slopes, h)
                else:
                    r, a, damping = rk4_step(r, a, thruster_torque, zero, (wash, surge, sway), equation, state, work, h)
                largest_damping = maximum(largest_damping, damping)
            r = nan_unless_below(r, abs(r), limit)
            for i in range(LANES):
                own = first + i
                if own < len(restarts) and k < steps_ahead[own] and extract(r, i) == extract(r, i):
                    turned[own, k + 1] = extract(a, i) - extract(begin, i)


def effects_along(
    offsets: Any,
    periods: FloatArray,
    trajectory: FloatArray,
    effect_inputs: FloatArray,
    starts: FloatArray,
    body: Body,
    terms: Any,
    first_states: FloatArray | None = None,
) -> tuple[FloatArray, FloatArray]:
    """(n,) torque in N m of all terms, and their (n, m * TERM_STATES) states, along measured trajectories of r runs.

    ``offsets``: (r + 1,) index of each run's first instant, and n.
    ``periods``, ``starts``: (r,) s between instants, and rad, the position at the start of the trial.
    ``trajectory``: (n, 3) rate, angle since the start of the trial, and thruster torque, which is held.
    ``effect_inputs``: (n, 3), see `rovid.model.torque_input.TorqueInput`.
    ``body``, ``terms``: Those of the common `rovid.model.bound_effects.Equation`.
    ``first_states``: (r, m * TERM_STATES) states at each run's first instant; zeros by default.
    """
    count = TERM_STATES * len(terms.kinds)
    torque, states = np.zeros(len(trajectory)), np.zeros((len(trajectory), count))
    if first_states is not None:
        states[offsets[:-1]] = first_states
    at, work = np.zeros((2, LANES), dtype=np.int64), np.zeros((4, count + SCRATCH_ROWS, LANES))
    runs, measured = (offsets, periods, starts), (trajectory, effect_inputs)
    _follow(runs, measured, Equation(body, terms, 0.0), at, work, torque, states)
    return torque, states


@warmed_up
@njit_noalloc
def _follow(runs: Any, measured: Any, equation: Any, at: Any, work: Any, torque: Any, states: Any) -> None:
    """Follow one trajectory in each lane; fills in ``torque``, and ``states`` after each run's first instant."""
    (offsets, periods, starts), (trajectory, effect_inputs), terms = runs, measured, equation.terms
    state, derivative, stage_state, sums = work[0], work[1], work[2], work[3]
    body = broadcast_equation(equation).body
    for first in range(0, len(periods), LANES):
        period, origin, longest = broadcast(1.0), broadcast(0.0), 0
        for i in range(LANES):
            # Lanes without a run of their own repeat the last one.
            own = min(first + i, len(periods) - 1)
            period, origin = insert(period, i, periods[own]), insert(origin, i, starts[own])
            longest = max(longest, offsets[own + 1] - offsets[own])
            for j in range(states.shape[1]):
                state[j, i] = states[offsets[own], j]
        own_equation = Equation(body, terms, origin)
        steps = state_substeps(reduce_max(period), terms)
        h, rows = period / steps, TERM_STATES * terms.stateful
        for k in range(longest):
            # This instant of each run and the next one, or the run's last.
            for i in range(LANES):
                own = min(first + i, len(periods) - 1)
                at[0, i] = min(offsets[own] + k, offsets[own + 1] - 1)
                at[1, i] = min(offsets[own] + k + 1, offsets[own + 1] - 1)
            here, following = at[0], at[1]
            rate, angle = gather(trajectory, here, 0), gather(trajectory, here, 1)
            thruster_torque = gather(trajectory, here, 2)
            inputs = gather(effect_inputs, here, 0), gather(effect_inputs, here, 1), gather(effect_inputs, here, 2)
            reset_states(rate, own_equation, state)
            given = call_sum_terms(rate, angle, thruster_torque, inputs, own_equation, state, derivative)
            for i in range(min(LANES, len(periods) - first)):
                if offsets[first + i] + k < offsets[first + i + 1]:
                    torque[here[i]] = extract(given, i)
                    for j in range(states.shape[1]):
                        states[here[i], j] = state[j, i]
            # Rate and angle are interpolated linearly.
            rate_change = (gather(trajectory, following, 0) - rate) / steps
            angle_change = (gather(trajectory, following, 1) - angle) / steps
            for number in range(steps):
                r, a = rate + float(number) * rate_change, angle + float(number) * angle_change
                reset_states(r, own_equation, state)
                share = 0.0
                copy_rows(rows, state, stage_state)
                for stage in range(4):
                    stage_rate, stage_angle = r + share * rate_change, a + share * angle_change
                    call_sum_terms(
                        stage_rate, stage_angle, thruster_torque, inputs, own_equation, stage_state, derivative
                    )
                    advance_states(stage, rows, state, derivative, h, stage_state, sums)
                    if stage < 3:
                        share = NODES[stage]
