"""The motion from its first instant on, undisturbed by what is measured."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from rovid.core.array_types import FloatArray, IntArray
from rovid.effects.base import Body
from rovid.jit.decorators import njit_inline, njit_noalloc
from rovid.jit.simd import LANES, broadcast, extract, insert, maximum
from rovid.model.kernels.effect_terms import SCRATCH_ROWS
from rovid.model.kernels.rk4_step import bare_step, brakes, damping_of, step, wanted_steps, whole_steps
from rovid.model.kernels.simd_io import each, in_lanes
from rovid.model.packed_terms import Equation

# A step of this share of the shortest time constant leaves fourth-order Runge-Kutta exact to about 1e-6.
_STEP_SHARE = 0.2
_MAX_SUBSTEPS = 1000
_SETTLED = 1e-9


def simulate(time: FloatArray, torque: FloatArray, body: Body, initial_rate: float) -> tuple[FloatArray, FloatArray]:
    """Integrate ``inertia*rdot + quadratic*|r|*r + linear*r = torque`` and ``angle_dot = r``.

    Parameters
    ----------
    time
        (n,) s, increasing.
    torque
        (n,) N m, held from each instant to the next.
    initial_rate
        rad/s at the first instant; the angle starts at 0.

    Returns
    -------
    rate, angle
        (n,) rad/s and (n,) rad. Classical fourth-order Runge-Kutta, sub-stepped so that a step is a small
        share of the local time constant ``inertia / (2*quadratic*|r| + linear)``.
    """
    rate, angle = np.empty(len(time)), np.empty(len(time))
    rate[0], angle[0] = initial_rate, 0.0
    _simulate(np.diff(time), torque, body, rate, angle)
    return rate, angle


@njit_noalloc
def _simulate(intervals: FloatArray, torque: FloatArray, body: Body, rate: FloatArray, angle: FloatArray) -> None:
    """Fill in ``rate`` and ``angle`` behind the first."""
    quadratic, linear, brake = body.quadratic_drag, body.linear_drag, brakes(body)
    for k in range(len(intervals)):
        r = rate[k]
        a = angle[k]
        # The rate heads for the one that balances the torque: the faster of the two sets the time constant.
        balance = math.sqrt(abs(torque[k]) / quadratic) if quadratic > 0.0 else 0.0
        if linear > 0.0:
            balance = min(balance, abs(torque[k]) / linear) if quadratic > 0.0 else 0.0
        left = intervals[k]
        while left > 0.0:
            stiffness = damping_of(max(abs(r), balance), brake)
            wanted = left * stiffness / _STEP_SHARE
            # A gap in the log can be longer than so many steps: they are taken again until the rate has settled.
            long = wanted > _MAX_SUBSTEPS
            steps = 1 if not wanted > 1.0 else int(min(wanted, _MAX_SUBSTEPS - 1.0)) + 1
            h = _STEP_SHARE / stiffness if long else left / steps
            before = r
            for _ in range(steps):
                r, a, _ = bare_step(r, a, torque[k], brake, h)
            left = left - steps * h if long else 0.0
            if not abs(r - before) > _SETTLED * abs(r):
                a += r * left
                left = 0.0
        rate[k + 1] = r
        angle[k + 1] = a


@njit_noalloc
def advance(
    r: float,
    a: float,
    push: float,
    other: float,
    moment: float,
    beside: Any,
    interval: float,
    equation: Any,
    state: Any,
    work: Any,
    stiffness: float,
) -> Any:
    """One interval of ``simulate_effects``, for a loop that is closed outside.

    Parameters
    ----------
    push, other
        N m of the thrusters, on which effects depend, and of what else there is.
    beside
        (3,) what else effects are told of the interval, see `rovid.model.torque_input.Drive`.
    state, work
        (m * TERM_STATES, LANES) states of the effects, moved on, the same in all lanes; (3, m * TERM_STATES + ROOM,
        LANES) room.
    stiffness
        1/s, as the interval before returned it; 0 at the start.

    Returns
    -------
    rate, angle, stiffness
        At the interval's end.
    """
    told = broadcast(beside[0]), broadcast(beside[1]), broadcast(beside[2])
    motion = broadcast(r), broadcast(a), broadcast(stiffness)
    drive = broadcast(push), broadcast(other), broadcast(moment), told
    rate, angle, fastest = _onward(motion, drive, broadcast(interval), in_lanes(equation), state, work)
    return extract(rate, 0), extract(angle, 0), extract(fastest, 0)


@njit_inline
def _onward(motion: Any, drive: Any, interval: Any, equation: Any, state: Any, work: Any) -> Any:
    """Rate, angle and stiffness an ``interval`` later, all in lanes; see ``advance``."""
    (rate, angle, stiffness), (push, other, moment, beside), body = motion, drive, equation.body
    steps = whole_steps(wanted_steps(rate, push + other, stiffness, interval, equation))
    h, fastest = interval / steps, broadcast(equation.terms.fastest)
    for _ in range(steps):
        rate, angle, damping = step(rate, angle, push, other, beside, equation, state, work, h)
        fastest = maximum(fastest, damping)
    # What came late in the interval has turned the vehicle less, and drag has taken less of it.
    late = moment / body.inertia
    return rate - damping_of(rate, brakes(body)) * late, angle + late, fastest


def simulate_effects(
    begins: IntArray,
    time: FloatArray,
    drive: tuple[FloatArray, FloatArray, FloatArray],
    starts: FloatArray,
    first: FloatArray,
    states: FloatArray,
    body: Body,
    terms: Any,
) -> tuple[FloatArray, FloatArray]:
    """As ``simulate``, of r runs one after the other, with effects in the equation of motion.

    Parameters
    ----------
    begins
        (r + 1,) the instant with which each run begins, and how many there are in all.
    drive
        (n,) N m, each value the mean until the next instant; (n,) N m s^2 and (n, 3), the moment and what is beside,
        see `rovid.model.torque_input.Drive`.
    starts
        (r,) rad, the position at the start of each one's trial.
    first, states
        (r, 2) rate in rad/s and angle in rad since the start of the trial, and (r, m * TERM_STATES) of the effects, at
        the first instant of each.
    body, terms
        Of the `rovid.model.packed_terms.Equation` of them all.
    """
    intervals = np.diff(time, append=time[-1])
    # For those that have come to an end no time passes.
    intervals[begins[1:] - 1] = 0.0
    given = np.column_stack((intervals, *drive))
    moved = np.empty((len(time), 2))
    moved[begins[:-1]] = first
    at, room = np.zeros((2, LANES), dtype=np.int64), np.zeros((4, states.shape[1] + SCRATCH_ROWS, LANES))
    _simulate_effects((begins, starts, states), given, Equation(body, terms, 0.0), at, room, moved)
    rate, angle = np.ascontiguousarray(moved.T)
    return rate, angle


@njit_noalloc
def _simulate_effects(runs: Any, given: FloatArray, equation: Any, at: Any, room: Any, moved: FloatArray) -> None:
    """The runs side by side, one in each lane; fills in what they ``moved`` behind the first instant of each."""
    (begins, starts, states), whole = runs, in_lanes(equation).body
    here, last, state, work = at[0], at[1], room[0], room[1:]
    for group in range(0, len(starts), LANES):
        origin, longest = broadcast(0.0), 0
        for i in range(LANES):
            # Lanes beyond the last run do as that does.
            own = min(group + i, len(starts) - 1)
            origin, here[i], last[i] = insert(origin, i, starts[own]), begins[own], begins[own + 1] - 1
            longest = max(longest, last[i] - here[i])
            for j in range(states.shape[1]):
                state[j, i] = states[own, j]
        abreast = Equation(whole, equation.terms, origin)
        r, a, stiffness = each(moved, here, 0), each(moved, here, 1), broadcast(0.0)
        for _ in range(longest):
            interval, late = each(given, here, 0), each(given, here, 2)
            told = each(given, here, 3), each(given, here, 4), each(given, here, 5)
            drive = each(given, here, 1), broadcast(0.0), late, told
            r, a, stiffness = _onward((r, a, stiffness), drive, interval, abreast, state, work)
            for i in range(LANES):
                if here[i] < last[i]:
                    here[i] += 1
                    moved[here[i], 0], moved[here[i], 1] = extract(r, i), extract(a, i)
