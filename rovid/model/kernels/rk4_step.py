"""One step of classical fourth-order Runge-Kutta, and how many an interval takes, of several motions side by side.

Nothing here is changed in place but states: lanes may be held by others too.
"""

from __future__ import annotations

import math
from typing import Any

from rovid.effects.base import TERM_STATES
from rovid.jit.decorators import njit_inline, njit_noalloc
from rovid.jit.simd import broadcast, load, maximum, minimum, reduce_max, sqrt, store
from rovid.jit.tracing import traced
from rovid.model.kernels.effect_terms import jump, torque_of

# How far along the step the second to fourth stage stand, and how often each of the four counts in the mean.
REACH = (0.5, 0.5, 1.0)
WEIGHT = (1.0, 2.0, 2.0, 1.0)
# With effects, whose equations are not known so well, a step of this share of the shortest time constant, exact to
# 1e-4, will do.
EFFECTS_STEP_SHARE = 0.5
# With effects a gap is stepped through to its end, however long.
MAX_GAP_SUBSTEPS = 1_000_000
# In place of a drag that is not there, where it is divided by.
_TINY = 1e-12


@traced
def brakes(body: Any) -> Any:
    """Quadratic and linear drag over the inertia, and one over the inertia: divided once, not in each stage."""
    return body.quadratic_drag / body.inertia, body.linear_drag / body.inertia, 1.0 / body.inertia


@traced
def _accelerated(rate: Any, push: Any, brake: Any) -> Any:
    """In rad/s^2, by a ``push`` over the inertia, of the plain model."""
    return push - (brake[0] * abs(rate) + brake[1]) * rate


@traced
def damping_of(rate: Any, brake: Any) -> Any:
    """-d(acceleration)/d(rate) of the plain model, in 1/s; see `brakes`."""
    return 2.0 * brake[0] * abs(rate) + brake[1]


@traced
def bare_step(r: Any, a: Any, torque: Any, brake: Any, h: Any) -> Any:
    """One step of rate and angle without effects; also the damping half way, in 1/s.

    As `step` without terms, which takes twice as long: this is the innermost of all loops. Of numbers or of lanes;
    ``brake`` is what `brakes` gives.
    """
    push, half = torque * brake[2], 0.5 * h
    k1 = _accelerated(r, push, brake)
    r2 = r + half * k1
    k2 = _accelerated(r2, push, brake)
    r3 = r + half * k2
    k3 = _accelerated(r3, push, brake)
    r4 = r + h * k3
    k4 = _accelerated(r4, push, brake)
    angle = a + h / 6.0 * (r + 2.0 * (r2 + r3) + r4)
    return r + h / 6.0 * (k1 + 2.0 * (k2 + k3) + k4), angle, damping_of(r2, brake)


@njit_noalloc
def step(
    r: Any,
    a: Any,
    push: Any,
    other: Any,
    beside: Any,
    equation: Any,
    state: Any,
    work: Any,
    h: Any,
) -> Any:
    """One step of rate and angle, and of the states of effects.

    Parameters
    ----------
    push, other
        N m of the thrusters, on which effects depend, and of what else there is.
    beside, equation
        As `torque_of` takes them.
    state, work
        As there, moved on; (3, ...) room.
    h
        s, lanes as all else.

    Returns
    -------
    rate, angle, damping
        The damping -d(rdot)/dr in 1/s is that of drag half way, of effects at the start.
    """
    rows, change, there, moved = TERM_STATES * equation.terms.remembering, work[0], work[1], work[2]
    brake = brakes(equation.body)
    drive, nudge = (push + other) * brake[2], 1e-6 + 1e-4 * abs(r)
    # One that hardly moves may be about to turn back: states jump with the nudge too.
    rate, angle = r + nudge, a
    jump(rate, equation, state)
    copy(rows, state, there)
    turned = gained = given = damping = broadcast(0.0)
    for stage in range(-1, 4):
        extra = torque_of(rate, angle, push, beside, equation, there, change) * brake[2]
        if stage < 0:
            given, rate = extra, r
            jump(rate, equation, state)
            copy(rows, state, there)
            continue
        if stage == 0:
            given = (given - extra) / nudge
        if stage == 1:
            damping = maximum(damping_of(rate, brake) - given, 0.0)
        pull = _accelerated(rate, drive + extra, brake)
        turned = turned + WEIGHT[stage] * rate
        gained = gained + WEIGHT[stage] * pull
        move(stage, rows, state, change, h, there, moved)
        if stage < 3:
            angle = a + REACH[stage] * h * rate
            rate = r + REACH[stage] * h * pull
    return r + h / 6.0 * gained, a + h / 6.0 * turned, damping


@njit_inline
def copy(rows: int, state: Any, there: Any) -> None:
    """Write the first ``rows`` of ``state`` into ``there``."""
    for j in range(rows):
        store(there, j, load(state, j))


@njit_inline
def move(stage: int, rows: int, state: Any, change: Any, h: Any, there: Any, moved: Any) -> None:
    """Move the states of effects from one stage ``there``, to the next, and behind the last stage themselves.

    There are as many ``rows`` of them. ``moved`` gathers what the stages count for, ``h`` is the step in s, of each
    lane if need be.
    """
    for j in range(rows):
        change_here = load(change, j)
        after = load(state if stage == 0 else moved, j) + (WEIGHT[stage] / 6.0) * h * change_here
        if stage < 3:
            store(moved, j, after)
            store(there, j, load(state, j) + REACH[stage] * h * change_here)
        else:
            store(state, j, after)


@njit_inline
def shares_of(h: float, terms: Any) -> int:
    """How many shares of ``h`` s the states of effects are moved by, one after the other."""
    fastest: float = terms.fastest
    return max(math.ceil(h * fastest / EFFECTS_STEP_SHARE), 1)


@njit_inline
def wanted_steps(r: Any, torque: Any, stiffness: Any, interval: Any, equation: Any) -> Any:
    """How many steps an interval asks for, ``stiffness`` in 1/s having been that of the one before."""
    body, size = equation.body, abs(torque)
    balance = minimum(sqrt(size / maximum(body.quadratic_drag, _TINY)), size / maximum(body.linear_drag, _TINY))
    stiffness = maximum(maximum(stiffness, equation.terms.fastest), damping_of(maximum(abs(r), balance), brakes(body)))
    return interval * stiffness / EFFECTS_STEP_SHARE


@njit_inline
def whole_steps(wanted: Any) -> int:
    """The number of steps that does for what is ``wanted``, in all lanes."""
    most = reduce_max(wanted)
    return 1 if not most > 1.0 else min(int(most) + 1, MAX_GAP_SUBSTEPS)
