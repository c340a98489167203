"""The motion ahead from many restarts on a measured course, and what effects do along it."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from rovid.effects.base import TERM_STATES, Body
from rovid.ground.arrays import FloatArray
from rovid.ground.compiled import compiled, inlined, lean
from rovid.ground.lanes import LANES, alike, lane, larger, largest, with_lane, within
from rovid.model.equation import Equation
from rovid.model.kernels.batch import in_lanes
from rovid.model.kernels.step import (
    EFFECTS_STEP_SHARE,
    REACH,
    bare_step,
    brakes,
    copy,
    move,
    step,
    wanted_steps,
    whole_steps,
)
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
    rows, most = TERM_STATES * len(terms.kinds), 0.0
    for k in range(len(rate)):
        most = max(most, abs(rate[k])) if not math.isnan(rate[k]) else most
    farthest = 0
    for k in range(len(reach)):
        farthest = max(farthest, reach[k])
    turned = np.full((len(restarts), farthest + 1), np.nan)
    state, work = np.zeros((rows, LANES)), np.zeros((3, rows + ROOM, LANES))
    course, begun = (torque, beside, rate, angle, states), (restarts, reach, period, start)
    for first in range(0, len(restarts), LANES):
        _predict(first, begun, course, body, terms, _RUNAWAY * most, state, work, turned)
    return turned


@lean
def _predict(
    first: int,
    begun: Any,
    course: Any,
    body: Any,
    terms: Any,
    most: float,
    state: Any,
    work: Any,
    turned: Any,
) -> None:
    """From the restarts behind the ``first``, one in each lane; fills in their rows of ``turned``."""
    (restarts, reach, period, start), (torque, beside, rate, angle, states) = begun, course
    r, a, span, origin, longest = alike(0.0), alike(0.0), alike(1.0), alike(0.0), 0
    for i in range(LANES):
        # Lanes beyond the last restart do as that does.
        own = min(first + i, len(restarts) - 1)
        at, longest = restarts[own], max(longest, reach[own])
        r, a = with_lane(r, i, rate[at]), with_lane(a, i, angle[at])
        span, origin = with_lane(span, i, period[own]), with_lane(origin, i, start[own])
        for j in range(TERM_STATES * terms.remembering):
            state[j, i] = states[at, j]
        turned[own, 0] = 0.0
    equation, begin = Equation(in_lanes(Equation(body, terms, 0.0)).body, terms, origin), a
    brake, stiffness, none = brakes(equation.body), alike(0.0), alike(0.0)
    for k in range(longest):
        push, race, surge, sway = none, none, none, none
        for i in range(LANES):
            at = min(restarts[min(first + i, len(restarts) - 1)] + k, len(torque) - 1)
            push, race = with_lane(push, i, torque[at]), with_lane(race, i, beside[at, 0])
            surge, sway = with_lane(surge, i, beside[at, 1]), with_lane(sway, i, beside[at, 2])
        wanted = wanted_steps(r, push, stiffness, span, equation)
        # One that asks for endless steps is given up.
        r, wanted = within(r, wanted, _MAX_SUBSTEPS_AHEAD), within(wanted, wanted, _MAX_SUBSTEPS_AHEAD)
        steps = whole_steps(wanted)
        h, stiffness = span / steps, none
        for _ in range(steps):
            if len(terms.kinds) == 0:
                r, a, damping = bare_step(r, a, push, brake, h)
            else:
                r, a, damping = step(r, a, push, none, (race, surge, sway), equation, state, work, h)
            stiffness = larger(stiffness, damping)
        # So is one that runs away.
        r = within(r, abs(r), most)
        for i in range(LANES):
            own = first + i
            if own < len(restarts) and k < reach[own] and lane(r, i) == lane(r, i):
                turned[own, k + 1] = lane(a, i) - lane(begin, i)


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
    count = TERM_STATES * len(terms.kinds)
    torque, states, room = np.zeros(len(course)), np.zeros((len(course), count)), np.zeros((4, count + ROOM, LANES))
    for first in range(0, len(periods), LANES):
        room[:] = 0.0
        _follow(first, (begins, periods, starts), (course, beside), Equation(body, terms, 0.0), room, torque, states)
    return torque, states


@lean
def _follow(first: int, runs: Any, measured: Any, equation: Any, room: Any, torque: Any, states: Any) -> None:
    """The courses of the runs behind the ``first``, one in each lane; fills in ``torque`` and ``states`` there."""
    (begins, periods, starts), (course, beside), terms = runs, measured, equation.terms
    period, origin, longest = alike(1.0), alike(0.0), 0
    for i in range(LANES):
        # Lanes beyond the last run do as that does.
        own = min(first + i, len(periods) - 1)
        period, origin = with_lane(period, i, periods[own]), with_lane(origin, i, starts[own])
        longest = max(longest, begins[own + 1] - begins[own])
    equation = Equation(in_lanes(equation).body, terms, origin)
    steps = max(math.ceil(largest(period) * terms.fastest / EFFECTS_STEP_SHARE), 1)
    h, rows = period / steps, TERM_STATES * terms.remembering
    state, change, there, moved = room[0], room[1], room[2], room[3]
    for k in range(longest):
        rate, angle = _at(course, 0, begins, first, k), _at(course, 1, begins, first, k)
        push, race = _at(course, 2, begins, first, k), _at(beside, 0, begins, first, k)
        told = race, _at(beside, 1, begins, first, k), _at(beside, 2, begins, first, k)
        jump(rate, equation, state)
        given = torque_at(rate, angle, push, told, equation, state, change)
        for i in range(min(LANES, len(periods) - first)):
            at = begins[first + i] + k
            if at < begins[first + i + 1]:
                torque[at] = lane(given, i)
                for j in range(states.shape[1]):
                    states[at, j] = state[j, i]
        faster = (_at(course, 0, begins, first, k + 1) - rate) / steps
        farther = (_at(course, 1, begins, first, k + 1) - angle) / steps
        for number in range(steps):
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
def _at(table: Any, column: int, begins: Any, first: int, k: int) -> Any:
    """In lanes, the instant ``k`` of each run behind the ``first``, or its last."""
    x = alike(0.0)
    for i in range(LANES):
        own = min(first + i, len(begins) - 2)
        x = with_lane(x, i, table[min(begins[own] + k, begins[own + 1] - 1), column])
    return x
