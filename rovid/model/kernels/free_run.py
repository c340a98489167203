"""The motion from its first instant on, undisturbed by what is measured."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from rovid.effects.base import Body
from rovid.ground.arrays import FloatArray
from rovid.ground.compiled import lean
from rovid.ground.lanes import LANES, alike, lane, larger
from rovid.model.kernels.batch import in_lanes
from rovid.model.kernels.step import bare_step, brakes, damping_of, step, wanted_steps, whole_steps
from rovid.model.kernels.torque import ROOM

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


@lean
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


@lean
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
        (3,) what else effects are told of the interval, see `rovid.model.drive.Drive`.
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
    abreast, body = in_lanes(equation), equation.body
    told = alike(beside[0]), alike(beside[1]), alike(beside[2])
    rate, angle, torque = alike(r), alike(a), alike(push)
    steps = whole_steps(wanted_steps(rate, torque + other, alike(stiffness), interval, abreast))
    h, fastest = alike(interval / steps), alike(equation.terms.fastest)
    for _ in range(steps):
        rate, angle, damping = step(rate, angle, torque, alike(other), told, abreast, state, work, h)
        fastest = larger(fastest, damping)
    r, a = lane(rate, 0), lane(angle, 0)
    # What came late in the interval has turned the vehicle less, and drag has taken less of it.
    a += moment / body.inertia
    r -= damping_of(r, brakes(body)) * moment / body.inertia
    return r, a, lane(fastest, 0)


def simulate_effects(
    time: FloatArray,
    torque: FloatArray,
    moment: FloatArray,
    beside: FloatArray,
    equation: Any,
    begin: tuple[float, float],
    states: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """As ``simulate``, with effects in the equation of motion.

    Parameters
    ----------
    torque
        (n,) N m; each value the mean until the next instant.
    moment, beside
        (n,) N m s^2 and (n, 3), see `rovid.model.drive.Drive`.
    equation
        `rovid.model.equation.Equation`.
    begin
        Rate in rad/s and angle in rad, since the start of the trial, at the first instant.
    states
        (m * TERM_STATES, LANES) of the effects there.
    """
    rate, angle = np.empty(len(time)), np.empty(len(time))
    rate[0], angle[0] = begin
    state, work = states.copy(), np.zeros((3, len(states) + ROOM, LANES))
    _simulate_effects(np.diff(time), (torque, moment, beside), equation, state, work, rate, angle)
    return rate, angle


@lean
def _simulate_effects(
    intervals: FloatArray, drive: Any, equation: Any, state: Any, work: Any, rate: FloatArray, angle: FloatArray
) -> None:
    """Fill in ``rate`` and ``angle`` behind the first."""
    (torque, moment, beside), stiffness = drive, 0.0
    r, a = rate[0], angle[0]
    for k in range(len(intervals)):
        interval = intervals[k]
        r, a, stiffness = advance(
            r, a, torque[k], 0.0, moment[k], beside[k], interval, equation, state, work, stiffness
        )
        rate[k + 1], angle[k + 1] = r, a
