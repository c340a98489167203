"""The motion ahead from many restarts on a measured course, and what effects do along it."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from rovid.effects.base import TERM_STATES, Body
from rovid.ground.arrays import FloatArray
from rovid.ground.compiled import compiled
from rovid.model.equation import Equation
from rovid.model.kernels.lanes import step_lanes
from rovid.model.kernels.step import EFFECTS_STEP_SHARE, REACH, copy, move, steps_of
from rovid.model.kernels.torque import jump, torque_of

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
        (n,), (n,) and (n, k, TERM_STATES) on the measured course.
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
    count, rows = len(restarts), len(terms.kinds)
    turned = np.full((count, reach.max() + 1), np.nan)
    turned[:, 0] = 0.0
    # All restarts go on together, a lane each: those that reach farthest first, so that the others end behind them.
    order = np.argsort(-reach)
    begin = restarts[order]
    r, a, origin = rate[begin], angle[begin], start[order]
    state, told = np.zeros((count, rows, TERM_STATES)), np.zeros((count, 3))
    for i in range(count):
        state[i, : terms.remembering] = states[begin[i], : terms.remembering]
    push, h, stiffness = np.zeros((3, count))
    steps, every = np.zeros(count, dtype=np.int64), np.arange(count)
    rooms, work = np.zeros((7, count)), np.zeros((3, count, rows, TERM_STATES))
    most = _RUNAWAY * np.nanmax(np.abs(rate))
    for k in range(reach.max()):
        while reach[order[count - 1]] <= k:
            count -= 1
        for i in range(count):
            at, span = begin[i] + k, period[order[i]]
            push[i] = torque[at]
            told[i, 0], told[i, 1], told[i, 2] = beside[at, 0], beside[at, 1], beside[at, 2]
            steps[i] = steps_of(r[i], push[i], stiffness[i], span, Equation(body, terms, origin[i]))
            if steps[i] > _MAX_SUBSTEPS_AHEAD:
                r[i], steps[i] = np.nan, 1
            h[i] = span / steps[i]
            stiffness[i] = terms.fastest
        moving = every[:count]
        for number in range(steps[:count].max()):
            if number > 0:
                moving = moving[steps[moving] > number]
            step_lanes(moving, r, a, (push, told, origin), terms, body, state, h, stiffness, rooms, work)
        for i in range(count):
            if not abs(r[i]) < most:
                # It runs away.
                r[i] = a[i] = np.nan
            turned[order[i], k + 1] = a[i] - angle[begin[i]]
    return turned


@compiled
def effects_along(
    period: float, course: FloatArray, beside: FloatArray, equation: Any
) -> tuple[FloatArray, FloatArray]:
    """(n,) torque in N m of all effects, and their (n, m, TERM_STATES) states, on a measured course.

    Parameters
    ----------
    period
        s between its instants.
    course
        (n, 3) rate, angle since the start of the trial and thrusters' torque, which is held.
    beside, equation
        As for ``simulate_effects``.
    """
    n = len(course)
    torque, states = np.zeros(n), np.zeros((n, len(equation.terms.kinds), TERM_STATES))
    steps = max(math.ceil(period * equation.terms.fastest / EFFECTS_STEP_SHARE), 1)
    h = period / steps
    rows = equation.terms.remembering
    change, there, moved = np.zeros((3, len(equation.terms.kinds), TERM_STATES))
    for k in range(n):
        rate, angle, push = course[k]
        told = beside[k, 0], beside[k, 1], beside[k, 2]
        jump(rate, equation, states[k])
        torque[k] = torque_of(rate, angle, push, told, equation, states[k], change)
        if k == n - 1:
            break
        faster, farther = (course[k + 1, 0] - rate) / steps, (course[k + 1, 1] - angle) / steps
        state = states[k + 1]
        state[:] = states[k]
        for number in range(steps):
            r, a = rate + number * faster, angle + number * farther
            jump(r, equation, state)
            passed = 0.0
            copy(rows, state, there)
            for stage in range(4):
                torque_of(r + passed * faster, a + passed * farther, push, told, equation, there, change)
                move(stage, rows, state, change, h, there, moved)
                if stage < 3:
                    passed = REACH[stage]
    return torque, states
