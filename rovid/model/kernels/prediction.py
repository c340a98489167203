"""The motion ahead from many restarts on a measured course, and what effects do along it."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from rovid.effects.base import TERM_STATES, Body
from rovid.ground.arrays import FloatArray
from rovid.ground.compiled import compiled, inlined, lean
from rovid.ground.lanes import LANES, gathered, lane, larger, largest, spread, with_lane, within
from rovid.model.equation import Equation
from rovid.model.kernels.batch import in_lanes
from rovid.model.kernels.step import EFFECTS_STEP_SHARE, REACH, bare_step, brakes, copy, move, step, wanted_steps, whole_steps
from rovid.model.kernels.torque import ROOM, jump, torque_at

# So many times the largest rate that was measured is none of the vehicle's.
_RUNAWAY = 30.0
# Predictions are of a vehicle whose time constant is ten steps of their grid or more.
_MAX_SUBSTEPS_AHEAD = 200


@compiled
def predict(
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
        (n,) N m and (n, 3), see `rovid.model.drive.Drive`; means over each interval of a grid.
    rate, angle, states
        (n,), (n,) and (n, k * TERM_STATES) on the measured course.
    restarts, reach
        (m,) indices on the grid, and numbers of steps.
    start
        (m,) rad; the position at the start of the trial.
    body, terms
        Of the `rovid.model.equation.Equation` of them all.

    Returns
    -------
    turned
        (m, 1 + the largest reach) rad; NaN beyond the reach, and where the model runs away or asks for endless steps.
    """
    count, rows = len(restarts), TERM_STATES * len(terms.kinds)
    turned = np.full((count, reach.max() + 1), np.nan)
    turned[:, 0] = 0.0
    # Restarts go on together, one in each lane: those that reach as far as each other.
    order = np.argsort(-reach)
    most = _RUNAWAY * np.nanmax(np.abs(rate))
    state, work = np.zeros((rows, LANES)), np.zeros((3, rows + ROOM, LANES))
    for first in range(0, count, LANES):
        own = order[np.minimum(np.arange(first, first + LANES), count - 1)]
        begin, equation = restarts[own], in_lanes(Equation(body, terms, 0.0))
        equation = Equation(equation.body, terms, gathered(start[own]))
        # Those of terms that do not remember are nobody's.
        for j in range(TERM_STATES * terms.remembering):
            for i in range(LANES):
                state[j, i] = states[begin[i], j]
        course = torque, beside, rate, angle
        _predict(begin, reach[own], gathered(period[own]), own, course, equation, most, state, work, turned)
    return turned


@lean
def _predict(
    begin: Any,
    reach: Any,
    period: Any,
    own: Any,
    course: Any,
    equation: Any,
    most: float,
    state: Any,
    work: Any,
    turned: Any,
) -> None:
    """From the restarts of each lane, the first of which reaches farthest; fills in its ``own`` row of ``turned``."""
    torque, beside, rate, angle = course
    last = len(torque) - 1
    r, a, stiffness = _each(rate, begin, 0, last), _each(angle, begin, 0, last), spread(0.0)
    begun, none, brake = a, spread(0.0), brakes(equation.body)
    for k in range(reach[0]):
        push = _each(torque, begin, k, last)
        told = _each(beside[:, 0], begin, k, last), _each(beside[:, 1], begin, k, last), _each(beside[:, 2], begin, k, last)
        wanted = wanted_steps(r, push, stiffness, period, equation)
        # One that asks for endless steps is given up.
        r, wanted = within(r, wanted, _MAX_SUBSTEPS_AHEAD), within(wanted, wanted, _MAX_SUBSTEPS_AHEAD)
        steps = whole_steps(wanted)
        h, stiffness = period / steps, none
        for _ in range(steps):
            if len(equation.terms.kinds) == 0:
                r, a, damping = bare_step(r, a, push, brake, h)
            else:
                r, a, damping = step(r, a, push, none, told, equation, state, work, h)
            stiffness = larger(stiffness, damping)
        # So is one that runs away.
        r = within(r, abs(r), most)
        for i in range(LANES):
            if k < reach[i] and lane(r, i) == lane(r, i):
                turned[own[i], k + 1] = lane(a, i) - lane(begun, i)


@inlined
def _each(series: Any, begin: Any, k: int, last: int) -> Any:
    """In lanes, the number ``k`` behind where each begins, and the last beyond."""
    x = spread(0.0)
    for i in range(LANES):
        x = with_lane(x, i, series[min(begin[i] + k, last)])
    return x


@compiled
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
        Of the `rovid.model.equation.Equation` of them all.
    """
    n, count, runs = len(course), TERM_STATES * len(terms.kinds), len(periods)
    torque, states, room = np.zeros(n), np.zeros((n, count)), np.zeros((4, count + ROOM, LANES))
    for first in range(0, runs, LANES):
        own = np.minimum(np.arange(first, first + LANES), runs - 1)
        equation = Equation(in_lanes(Equation(body, terms, 0.0)).body, terms, gathered(starts[own]))
        room[:] = 0.0
        _follow(begins[own], begins[own + 1] - 1, gathered(periods[own]), course, beside, equation, room, torque, states)
    return torque, states


@lean
def _follow(
    begin: Any,
    last: Any,
    period: Any,
    course: Any,
    beside: Any,
    equation: Any,
    room: Any,
    torque: Any,
    states: Any,
) -> None:
    """A course in each lane, from its ``begin`` to its ``last`` instant; fills in ``torque`` and ``states`` there."""
    steps = max(math.ceil(largest(period) * equation.terms.fastest / EFFECTS_STEP_SHARE), 1)
    h, rows = period / steps, TERM_STATES * equation.terms.remembering
    state, change, there, moved = room[0], room[1], room[2], room[3]
    longest = 0
    for i in range(LANES):
        longest = max(longest, last[i] - begin[i])
    for k in range(longest + 1):
        rate, angle, push = _at(course, 0, begin, k, last), _at(course, 1, begin, k, last), _at(course, 2, begin, k, last)
        told = _at(beside, 0, begin, k, last), _at(beside, 1, begin, k, last), _at(beside, 2, begin, k, last)
        jump(rate, equation, state)
        given = torque_at(rate, angle, push, told, equation, state, change)
        for i in range(LANES):
            at = begin[i] + k
            if at <= last[i]:
                torque[at] = lane(given, i)
                for j in range(states.shape[1]):
                    states[at, j] = state[j, i]
        faster = (_at(course, 0, begin, k + 1, last) - rate) / steps
        farther = (_at(course, 1, begin, k + 1, last) - angle) / steps
        for number in range(steps if k < longest else 0):
            r, a = rate + float(number) * faster, angle + float(number) * farther
            jump(r, equation, state)
            passed = 0.0
            copy(rows, state, there)
            for stage in range(4):
                torque_at(r + passed * faster, a + passed * farther, push, told, equation, there, change)
                move(stage, rows, state, change, h, there, moved)
                if stage < 3:
                    passed = REACH[stage]


@inlined
def _at(table: Any, column: int, begin: Any, k: int, last: Any) -> Any:
    """In lanes, the row ``k`` behind where each begins, and the ``last`` of each beyond."""
    x = spread(0.0)
    for i in range(LANES):
        x = with_lane(x, i, table[min(begin[i] + k, last[i]), column])
    return x
