"""The motion ahead from many restarts on a measured course, and what effects do along it."""

from __future__ import annotations

from typing import Any

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.effects.base import TERM_STATES, Body
from rovid.jit.decorators import njit_noalloc
from rovid.jit.simd import LANES, broadcast, extract, insert, maximum, nan_unless_below, reduce_max
from rovid.model.kernels.effect_terms import SCRATCH_ROWS, jump, torque_at
from rovid.model.kernels.rk4_step import (
    REACH,
    bare_step,
    brakes,
    copy,
    move,
    shares_of,
    step,
    wanted_steps,
    whole_steps,
)
from rovid.model.kernels.simd_io import clear, each, in_lanes
from rovid.model.kernels.warmup import warmed_up
from rovid.model.packed_terms import Equation

# So many times the largest rate that was measured is none of the vehicle's.
_RUNAWAY = 30.0
# Predictions are of a vehicle whose time constant is ten steps of their grid or more.
_MAX_SUBSTEPS_AHEAD = 200


def predict_multi_step(
    period: FloatArray,
    torque: FloatArray,
    beside: FloatArray,
    rate: FloatArray,
    angle: FloatArray,
    states: FloatArray,
    restarts: Any,
    reach: Any,
    start: FloatArray,
    body: Body,
    terms: Any,
) -> FloatArray:
    """Angle turned after each of up to ``reach`` steps of ``period`` s from each of the (m,) restarts.

    Parameters
    ----------
    period
        (m,) s.
    torque, beside
        (n,) N m and (n, 3), see `rovid.model.torque_input.Drive`; means over each interval of a grid.
    rate, angle, states
        (n,), (n,) and (n, k * TERM_STATES) on the measured course.
    restarts, reach
        (m,) indices on the grid, and numbers of steps.
    start
        (m,) rad; the position at the start of the trial.
    body, terms
        Of the `rovid.model.packed_terms.Equation` of them all.

    Returns
    -------
    turned
        (m, 1 + the largest reach) rad; NaN beyond the reach, and where the model runs away or asks for endless steps.
    """
    rows, most = TERM_STATES * len(terms.kinds), _RUNAWAY * float(np.fmax.reduce(np.abs(rate), initial=0.0))
    turned = np.full((len(restarts), 1 + int(reach.max(initial=0))), np.nan)
    state, work = np.zeros((rows, LANES)), np.zeros((3, rows + SCRATCH_ROWS, LANES))
    course, begun = (torque, beside, rate, angle, states), (restarts, reach, period, start)
    _predict(begun, course, body, terms, most, state, work, turned)
    return turned


@warmed_up
@njit_noalloc
def _predict(
    begun: Any,
    course: Any,
    body: Any,
    terms: Any,
    most: float,
    state: Any,
    work: Any,
    turned: Any,
) -> None:
    """From all restarts, one in each lane; fills in their rows of ``turned``."""
    (restarts, reach, period, start), (torque, beside, rate, angle, states) = begun, course
    whole, none = in_lanes(Equation(body, terms, 0.0)).body, broadcast(0.0)
    brake = brakes(whole)
    for first in range(0, len(restarts), LANES):
        r, a, span, origin, longest = broadcast(0.0), broadcast(0.0), broadcast(1.0), broadcast(0.0), 0
        for i in range(LANES):
            # Lanes beyond the last restart do as that does.
            own = min(first + i, len(restarts) - 1)
            at, longest = restarts[own], max(longest, reach[own])
            r, a = insert(r, i, rate[at]), insert(a, i, angle[at])
            span, origin = insert(span, i, period[own]), insert(origin, i, start[own])
            for j in range(TERM_STATES * terms.remembering):
                state[j, i] = states[at, j]
            turned[own, 0] = 0.0
        equation, begin, stiffness = Equation(whole, terms, origin), a, none
        for k in range(longest):
            push, race, surge, sway = none, none, none, none
            for i in range(LANES):
                at = min(restarts[min(first + i, len(restarts) - 1)] + k, len(torque) - 1)
                push, race = insert(push, i, torque[at]), insert(race, i, beside[at, 0])
                surge, sway = insert(surge, i, beside[at, 1]), insert(sway, i, beside[at, 2])
            wanted = wanted_steps(r, push, stiffness, span, equation)
            # One that asks for endless steps is given up.
            r, wanted = (
                nan_unless_below(r, wanted, _MAX_SUBSTEPS_AHEAD),
                nan_unless_below(wanted, wanted, _MAX_SUBSTEPS_AHEAD),
            )
            steps = whole_steps(wanted)
            h, stiffness = span / steps, none
            for _ in range(steps):
                if len(terms.kinds) == 0:
                    r, a, damping = bare_step(r, a, push, brake, h)
                else:
                    r, a, damping = step(r, a, push, none, (race, surge, sway), equation, state, work, h)
                stiffness = maximum(stiffness, damping)
            # So is one that runs away.
            r = nan_unless_below(r, abs(r), most)
            for i in range(LANES):
                own = first + i
                if own < len(restarts) and k < reach[own] and extract(r, i) == extract(r, i):
                    turned[own, k + 1] = extract(a, i) - extract(begin, i)


def effects_along(
    begins: Any,
    periods: FloatArray,
    course: FloatArray,
    beside: FloatArray,
    starts: FloatArray,
    body: Body,
    terms: Any,
) -> tuple[FloatArray, FloatArray]:
    """(n,) torque in N m of all effects, and their (n, m * TERM_STATES) states, on the measured courses of r runs.

    Parameters
    ----------
    begins
        (r + 1,) the instant with which each course begins, and how many there are in all.
    periods, starts
        (r,) s between its instants; rad, the position at the start of its trial.
    course
        (n, 3) rate, angle since the start of the trial and thrusters' torque, which is held.
    beside
        As for ``simulate_effects``.
    body, terms
        Of the `rovid.model.packed_terms.Equation` of them all.
    """
    count = TERM_STATES * len(terms.kinds)
    torque, states, room = (
        np.zeros(len(course)),
        np.zeros((len(course), count)),
        np.zeros((4, count + SCRATCH_ROWS, LANES)),
    )
    at = np.zeros((2, LANES), dtype=np.int64)
    _follow((begins, periods, starts), (course, beside), Equation(body, terms, 0.0), at, room, torque, states)
    return torque, states


@warmed_up
@njit_noalloc
def _follow(runs: Any, measured: Any, equation: Any, at: Any, room: Any, torque: Any, states: Any) -> None:
    """The courses of all runs, one in each lane; fills in ``torque`` and ``states``."""
    (begins, periods, starts), (course, beside), terms = runs, measured, equation.terms
    state, change, there, moved, whole = room[0], room[1], room[2], room[3], in_lanes(equation).body
    for first in range(0, len(periods), LANES):
        period, origin, longest = broadcast(1.0), broadcast(0.0), 0
        for i in range(LANES):
            # Lanes beyond the last run do as that does.
            own = min(first + i, len(periods) - 1)
            period, origin = insert(period, i, periods[own]), insert(origin, i, starts[own])
            longest = max(longest, begins[own + 1] - begins[own])
        abreast = Equation(whole, terms, origin)
        steps = shares_of(reduce_max(period), terms)
        h, rows = period / steps, TERM_STATES * terms.remembering
        clear(state)
        for k in range(longest):
            # This instant of each run and the next, or its last.
            for i in range(LANES):
                own = min(first + i, len(periods) - 1)
                at[0, i] = min(begins[own] + k, begins[own + 1] - 1)
                at[1, i] = min(begins[own] + k + 1, begins[own + 1] - 1)
            here, behind = at[0], at[1]
            rate, angle, push = each(course, here, 0), each(course, here, 1), each(course, here, 2)
            told = each(beside, here, 0), each(beside, here, 1), each(beside, here, 2)
            jump(rate, abreast, state)
            given = torque_at(rate, angle, push, told, abreast, state, change)
            for i in range(min(LANES, len(periods) - first)):
                if begins[first + i] + k < begins[first + i + 1]:
                    torque[here[i]] = extract(given, i)
                    for j in range(states.shape[1]):
                        states[here[i], j] = state[j, i]
            faster, farther = (each(course, behind, 0) - rate) / steps, (each(course, behind, 1) - angle) / steps
            for number in range(steps):
                r, a = rate + float(number) * faster, angle + float(number) * farther
                jump(r, abreast, state)
                passed = 0.0
                copy(rows, state, there)
                for stage in range(4):
                    torque_at(r + passed * faster, a + passed * farther, push, told, abreast, there, change)
                    move(stage, rows, state, change, h, there, moved)
                    if stage < 3:
                        passed = REACH[stage]
