"""One step of classical fourth-order Runge-Kutta, and how many an interval takes."""

from __future__ import annotations

import math
from typing import Any

from rovid.effects.base import TERM_STATES, Body, drag
from rovid.ground.compiled import compiled, inlined
from rovid.model.kernels.torque import jump, torque_of

# How far along the step the second to fourth stage stand, and how often each of the four counts in the mean.
REACH = (0.5, 0.5, 1.0)
WEIGHT = (1.0, 2.0, 2.0, 1.0)
# With effects, whose equations are not known so well, a step of this share of the shortest time constant, exact to
# 1e-4, will do.
EFFECTS_STEP_SHARE = 0.5
# With effects a gap is stepped through to its end, however long.
MAX_GAP_SUBSTEPS = 1_000_000


@compiled
def acceleration(rate: float, torque: float, body: Body) -> float:
    """In rad/s^2, of the plain model."""
    return (torque - drag(body, rate)) / body.inertia


@compiled
def damping_of(rate: float, body: Body) -> float:
    """-d(acceleration)/d(rate) of the plain model, in 1/s."""
    return (2.0 * body.quadratic_drag * abs(rate) + body.linear_drag) / body.inertia


@compiled
def bare_step(r: float, a: float, torque: float, body: Body, h: float) -> Any:
    """One step of rate and angle without effects; also the damping half way, in 1/s.

    As `step` without terms, which takes twice as long: this is the innermost of all loops.
    """
    k1 = acceleration(r, torque, body)
    r2 = r + 0.5 * h * k1
    k2 = acceleration(r2, torque, body)
    r3 = r + 0.5 * h * k2
    k3 = acceleration(r3, torque, body)
    r4 = r + h * k3
    k4 = acceleration(r4, torque, body)
    a += h * (r + 2.0 * r2 + 2.0 * r3 + r4) / 6.0
    r += h * (k1 + 2.0 * k2 + 2.0 * k3 + k4) / 6.0
    return r, a, damping_of(r2, body)


@inlined
def step(
    r: float,
    a: float,
    push: float,
    other: float,
    beside: Any,
    equation: Any,
    state: Any,
    work: Any,
    h: float,
) -> Any:
    """One step of rate and angle, and of the states of effects.

    Parameters
    ----------
    push, other
        N m of the thrusters, on which effects depend, and of what else there is.
    beside, equation
        As `torque_of` takes them.
    state, work
        (m, TERM_STATES), moved on; (3, m, TERM_STATES) room.

    Returns
    -------
    rate, angle, damping
        The damping -d(rdot)/dr in 1/s is that of drag half way, of effects at the start.
    """
    body = equation.body
    if len(equation.terms.kinds) == 0:
        return bare_step(r, a, push + other, body, h)
    rows, change, there, moved = equation.terms.remembering, work[0], work[1], work[2]
    nudge = 1e-6 + 1e-4 * abs(r)
    # One that hardly moves may be about to turn back: states jump with the nudge too.
    jump(r + nudge, equation, state)
    nudged = torque_of(r + nudge, a, push, beside, equation, state, change)
    jump(r, equation, state)
    copy(rows, state, there)
    rate, angle = r, a
    turned, gained, given, damping = 0.0, 0.0, 0.0, 0.0
    for stage in range(4):
        extra = torque_of(rate, angle, push, beside, equation, there, change)
        if stage == 0:
            given = (nudged - extra) / (nudge * body.inertia)
        if stage == 1:
            damping = max(damping_of(rate, body) - given, 0.0)
        pull = acceleration(rate, push + other + extra, body)
        turned += WEIGHT[stage] * rate
        gained += WEIGHT[stage] * pull
        move(stage, rows, state, change, h, there, moved)
        if stage < 3:
            angle = a + REACH[stage] * h * rate
            rate = r + REACH[stage] * h * pull
    return r + h * gained / 6.0, a + h * turned / 6.0, damping


@inlined
def copy(rows: int, state: Any, there: Any) -> None:
    """Write the first ``rows`` of ``state`` into ``there``."""
    for j in range(rows):
        for i in range(TERM_STATES):
            there[j, i] = state[j, i]


@inlined
def move(stage: int, rows: int, state: Any, change: Any, h: float, there: Any, moved: Any) -> None:
    """Move the states of effects from one stage ``there``, to the next, and behind the last stage themselves.

    There are (``rows``, TERM_STATES) of them. ``moved`` gathers what the stages count for, ``h`` is the step in s.
    """
    for j in range(rows):
        for i in range(TERM_STATES):
            before = state[j, i] if stage == 0 else moved[j, i]
            after = before + WEIGHT[stage] * h / 6.0 * change[j, i]
            if stage < 3:
                moved[j, i] = after
                there[j, i] = state[j, i] + REACH[stage] * h * change[j, i]
            else:
                state[j, i] = after


@inlined
def steps_of(r: float, torque: float, stiffness: float, interval: float, equation: Any) -> int:
    """How many steps an interval takes, ``stiffness`` in 1/s having been that of the one before."""
    body = equation.body
    balance = math.sqrt(abs(torque) / body.quadratic_drag) if body.quadratic_drag > 0.0 else 0.0
    if body.linear_drag > 0.0:
        balance = min(balance, abs(torque) / body.linear_drag) if body.quadratic_drag > 0.0 else 0.0
    stiffness = max(stiffness, equation.terms.fastest, damping_of(max(abs(r), balance), body))
    wanted = interval * stiffness / EFFECTS_STEP_SHARE
    return 1 if not wanted > 1.0 else min(int(wanted) + 1, MAX_GAP_SUBSTEPS)
