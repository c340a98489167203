"""Compiled loops over samples. Nothing here knows of files, units or effects' names."""

from __future__ import annotations

import hashlib
import math
from pathlib import Path
from typing import Any

import numba
import numpy as np

from rovid import effects
from rovid.effects import MOTION, TERMS
from rovid.effects.base import BESIDE, STIFFNESS, TERM_STATES
from rovid.effects.base import compiled as _compiled
from rovid.ground.arrays import FloatArray
from rovid.ground.caches import keeps_compiled

# A step of this share of the shortest time constant leaves fourth-order Runge-Kutta exact to about 1e-6.
_STEP_SHARE = 0.2
# With effects, whose equations are not known so well, 1e-4 will do.
_EFFECTS_STEP_SHARE = 0.5
# The covariance is stepped by a transition of fourth order: good to a percent of a percent with such steps.
_FILTER_STEP_SHARE = 0.3
# Gauss-Legendre nodes and weights on 0..1.
_NODES = (0.1127016653792583, 0.5, 0.8872983346207417)
_WEIGHTS = (5.0 / 18.0, 8.0 / 18.0, 5.0 / 18.0)
_MAX_SUBSTEPS = 1000
_CARRIED = np.array([effect.carried for effect in MOTION])
_REMEMBERS = np.array([effect.remembers for effect in MOTION])
# Of the series for the transition of the filter with more states: good to 1e-4 at such steps.
_ORDER = 4
_SETTLED = 1e-9
_TINY = 1e-12
# So many times the largest rate that was measured is none of the vehicle's.
_RUNAWAY = 30.0
# Predictions are of a vehicle whose time constant is ten steps of their grid or more.
_MAX_SUBSTEPS_AHEAD = 200
# With effects a gap is stepped through to its end, however long.
_MAX_GAP_SUBSTEPS = 1_000_000

# What is called several times in each step: numba hands over an array as seven numbers or more, and a call costs more
# than what is done in it.
_inlined = numba.njit(error_model="numpy", nogil=True, inline="always")


@_compiled
def _acceleration(rate: float, torque: float, inertia: float, quadratic: float, linear: float) -> float:
    return (torque - (quadratic * abs(rate) + linear) * rate) / inertia


@_compiled
def simulate(
    time: FloatArray,
    torque: FloatArray,
    inertia: float,
    quadratic: float,
    linear: float,
    initial_rate: float,
) -> tuple[FloatArray, FloatArray]:
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
    n = len(time)
    rate = np.empty(n)
    angle = np.empty(n)
    rate[0] = initial_rate
    angle[0] = 0.0
    for k in range(n - 1):
        r = rate[k]
        a = angle[k]
        # The rate heads for the one that balances the torque: the faster of the two sets the time constant.
        balance = math.sqrt(abs(torque[k]) / quadratic) if quadratic > 0.0 else 0.0
        if linear > 0.0:
            balance = min(balance, abs(torque[k]) / linear) if quadratic > 0.0 else 0.0
        left = time[k + 1] - time[k]
        while left > 0.0:
            stiffness = (2.0 * quadratic * max(abs(r), balance) + linear) / inertia
            wanted = left * stiffness / _STEP_SHARE
            # A gap in the log can be longer than so many steps: they are taken again until the rate has settled.
            long = wanted > _MAX_SUBSTEPS
            steps = 1 if not wanted > 1.0 else int(min(wanted, _MAX_SUBSTEPS - 1.0)) + 1
            h = _STEP_SHARE / stiffness if long else left / steps
            before = r
            for _ in range(steps):
                k1 = _acceleration(r, torque[k], inertia, quadratic, linear)
                r2 = r + 0.5 * h * k1
                k2 = _acceleration(r2, torque[k], inertia, quadratic, linear)
                r3 = r + 0.5 * h * k2
                k3 = _acceleration(r3, torque[k], inertia, quadratic, linear)
                r4 = r + h * k3
                k4 = _acceleration(r4, torque[k], inertia, quadratic, linear)
                a += h * (r + 2.0 * r2 + 2.0 * r3 + r4) / 6.0
                r += h * (k1 + 2.0 * k2 + 2.0 * k3 + k4) / 6.0
            left = left - steps * h if long else 0.0
            if not abs(r - before) > _SETTLED * abs(r):
                a += r * left
                left = 0.0
        rate[k + 1] = r
        angle[k + 1] = a
    return rate, angle


def _any_term() -> Any:
    """Compiled; the term of a ``kind``, which is its index in ``rovid.effects.MOTION``, before what it takes itself.

    As a chain of comparisons, which compiles to one jump: numba's own loop over functions takes ten times as long.
    """
    takes = "rate, angle, push, base, p, x, dx, j"
    lines = [f"    if kind == {kind}: return term_{kind}({takes})" for kind in range(len(TERMS))]
    namespace: dict[str, Any] = {f"term_{kind}": term for kind, term in enumerate(TERMS)}
    exec("\n".join((f"def term(kind, {takes}):", *lines, "    return 0.0")), namespace)  # noqa: S102 - all of it is above
    return numba.njit(error_model="numpy", nogil=True)(namespace["term"])


_term = _any_term()


def _any_term_of_lanes() -> Any:
    """Compiled; adds the term of a ``kind`` to the ``total`` of each lane that is ``live``.

    A call for each lane would cost more than most terms do.
    """
    takes = "kind, live, rate, angle, push, base, p, x, dx, j, total"
    lane = "rate[i], angle[i], push[i], base[i], p, x[i], dx[i], j"
    lines = [f"def term(\n    {takes}\n):"]
    for kind in range(len(TERMS)):
        lines += [f"    if kind == {kind}:", "        for i in live:", f"            total[i] += term_{kind}({lane})"]
    namespace: dict[str, Any] = {f"term_{kind}": term for kind, term in enumerate(TERMS)}
    exec("\n".join(lines), namespace)  # noqa: S102 - all of it is above
    return numba.njit(error_model="numpy", nogil=True)(namespace["term"])


_term_of_lanes = _any_term_of_lanes()


@_inlined
def _sum_terms(
    rate: float, angle: float, push: float, base: Any, terms: Any, kinds: Any, state: Any, change: Any
) -> Any:
    """Torque of all effects; fills in the rates of change of their states."""
    total = 0.0
    for j in range(len(kinds)):
        total += _term(kinds[j], rate, angle, push, base, terms, state, change, j)
    return total


@_compiled
def _bare_substep(r: float, a: float, push: float, inertia: float, quadratic: float, linear: float, h: float) -> Any:
    """One Runge-Kutta step of rate and angle without effects; also the damping half way, in 1/s."""
    k1 = _acceleration(r, push, inertia, quadratic, linear)
    r2 = r + 0.5 * h * k1
    k2 = _acceleration(r2, push, inertia, quadratic, linear)
    r3 = r + 0.5 * h * k2
    k3 = _acceleration(r3, push, inertia, quadratic, linear)
    r4 = r + h * k3
    k4 = _acceleration(r4, push, inertia, quadratic, linear)
    a += h * (r + 2.0 * r2 + 2.0 * r3 + r4) / 6.0
    r += h * (k1 + 2.0 * k2 + 2.0 * k3 + k4) / 6.0
    return r, a, (2.0 * quadratic * abs(r2) + linear) / inertia


@_inlined
def _substep(
    r: float, a: float, push: float, other: float, base: Any, terms: Any, kinds: Any, state: Any, work: Any, h: float
) -> Any:
    """One Runge-Kutta step of rate and angle, and of the states of effects.

    Parameters
    ----------
    push, other
        What the thrusters give, on which effects depend, and what else there is.
    state, work
        (m, TERM_STATES), moved on; (3, m, TERM_STATES) room. Effects without states may be left out.

    Returns
    -------
    rate, angle, damping
        The damping -d(rdot)/dr in 1/s is that of drag half way, of effects at the start.
    """
    if len(kinds) == 0:
        return _bare_substep(r, a, push + other, base[0], base[1], base[2], h)
    inertia, quadratic, linear = base[0], base[1], base[2]
    all_push, change, there, reached = push + other, work[0], work[1], work[2]
    extra = _sum_terms(r, a, push, base, terms, kinds, state, change)
    nudge = 1e-6 + 1e-4 * abs(r)
    given = (_sum_terms(r + nudge, a, push, base, terms, kinds, state, there) - extra) / (nudge * inertia)
    k1 = _acceleration(r, all_push + extra, inertia, quadratic, linear)
    _advance(state, change, h / 6.0, reached)
    _advance(state, change, 0.5 * h, there)
    r2 = r + 0.5 * h * k1
    extra = _sum_terms(r2, a + 0.5 * h * r, push, base, terms, kinds, there, change)
    k2 = _acceleration(r2, all_push + extra, inertia, quadratic, linear)
    _advance(reached, change, h / 3.0, reached)
    _advance(state, change, 0.5 * h, there)
    r3 = r + 0.5 * h * k2
    extra = _sum_terms(r3, a + 0.5 * h * r2, push, base, terms, kinds, there, change)
    k3 = _acceleration(r3, all_push + extra, inertia, quadratic, linear)
    _advance(reached, change, h / 3.0, reached)
    _advance(state, change, h, there)
    r4 = r + h * k3
    extra = _sum_terms(r4, a + h * r3, push, base, terms, kinds, there, change)
    k4 = _acceleration(r4, all_push + extra, inertia, quadratic, linear)
    _advance(reached, change, h / 6.0, state)
    a += h * (r + 2.0 * r2 + 2.0 * r3 + r4) / 6.0
    r += h * (k1 + 2.0 * k2 + 2.0 * k3 + k4) / 6.0
    return r, a, max((2.0 * quadratic * abs(r2) + linear) / inertia - given, 0.0)


@_inlined
def _advance(state: Any, change: Any, h: float, out: Any) -> None:
    """Write state + h*change into ``out``."""
    for j in range(state.shape[0]):
        for i in range(state.shape[1]):
            out[j, i] = state[j, i] + h * change[j, i]


@_inlined
def _tell(base: Any, beside: Any) -> None:
    """Write into ``base`` what terms are told of an interval besides."""
    for at in range(len(beside)):
        base[BESIDE + at] = beside[at]


@_compiled
def _rows(kinds: Any) -> int:
    """How many effects there are down to the last that has states of its own."""
    rows = 0
    for j in range(len(kinds)):
        if _REMEMBERS[kinds[j]]:
            rows = j + 1
    return rows


@_inlined
def _substeps(r: float, torque: float, stiffness: float, interval: float, base: Any) -> int:
    """How many Runge-Kutta steps an interval takes, ``stiffness`` in 1/s having been that of the one before."""
    balance = math.sqrt(abs(torque) / base[1]) if base[1] > 0.0 else 0.0
    if base[2] > 0.0:
        balance = min(balance, abs(torque) / base[2]) if base[1] > 0.0 else 0.0
    stiffness = max(stiffness, base[4], (2.0 * base[1] * max(abs(r), balance) + base[2]) / base[0])
    wanted = interval * stiffness / _EFFECTS_STEP_SHARE
    return 1 if not wanted > 1.0 else min(int(wanted) + 1, _MAX_GAP_SUBSTEPS)


@_compiled
def advance(
    r: float,
    a: float,
    push: float,
    other: float,
    moment: float,
    beside: Any,
    interval: float,
    base: Any,
    terms: Any,
    kinds: Any,
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
        What else effects are told of the interval, see `rovid.model.drive.Drive`.
    state, work
        (m, TERM_STATES) states of the effects, moved on; (3, m, TERM_STATES) room.
    stiffness
        1/s, as the interval before returned it; 0 at the start.

    Returns
    -------
    rate, angle, stiffness
        At the interval's end.
    """
    _tell(base, beside)
    steps = _substeps(r, push + other, stiffness, interval, base)
    h = interval / steps
    stiffness = base[4]
    for _ in range(steps):
        r, a, damping = _substep(r, a, push, other, base, terms, kinds, state, work, h)
        stiffness = max(stiffness, damping)
    # What came late in the interval has turned the vehicle less, and drag has taken less of it.
    a += moment / base[0]
    r -= (2.0 * base[1] * abs(r) + base[2]) / base[0] * moment / base[0]
    return r, a, stiffness


@_compiled
def simulate_effects(
    time: FloatArray,
    torque: FloatArray,
    moment: FloatArray,
    beside: FloatArray,
    base: FloatArray,
    terms: FloatArray,
    kinds: Any,
    start: tuple[float, float],
    states: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """As ``simulate``, with effects in the equation of motion.

    Parameters
    ----------
    torque
        (n,) N m; each value the mean until the next instant.
    moment, beside
        (n,) N m s^2 and (n, 3), see `rovid.model.drive.Drive`.
    base
        Inertia, quadratic and linear drag, the position at the first instant, the fastest rate of the effects' own
        states in 1/s, the stiffness of the restoring torque in N m/rad and where it is level, and room for the rate
        of the water about the hull and for what of ``beside`` goes for the interval.
    terms, kinds
        (m, 4) parameters of each effect in the equation of motion; (m,) its index in ``rovid.effects.MOTION``.
    start
        Rate in rad/s and angle in rad, since the start of the trial, at the first instant.
    states
        (m, TERM_STATES) of the effects there.
    """
    n = len(time)
    rate, angle = np.empty(n), np.empty(n)
    r, a = start
    rate[0], angle[0] = r, a
    state, work = states.copy(), np.zeros((3, len(terms), TERM_STATES))
    stiffness = 0.0
    for k in range(n - 1):
        r, a, stiffness = advance(
            r,
            a,
            torque[k],
            0.0,
            moment[k],
            beside[k],
            time[k + 1] - time[k],
            base,
            terms,
            kinds,
            state,
            work,
            stiffness,
        )
        rate[k + 1], angle[k + 1] = r, a
    return rate, angle


@_compiled
def predict(
    period: FloatArray,
    torque: FloatArray,
    beside: FloatArray,
    rate: FloatArray,
    angle: FloatArray,
    states: FloatArray,
    starts: Any,
    reach: Any,
    base: FloatArray,
    terms: FloatArray,
    kinds: Any,
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
    starts, reach
        (m,) indices on the grid, and numbers of steps.
    base
        (m, BASE_SIZE), see ``simulate_effects``.

    Returns
    -------
    turned
        (m, 1 + the largest reach) rad; NaN beyond the reach, and where the model runs away or asks for endless steps.
    """
    count, rows = len(starts), _rows(kinds)
    turned = np.full((count, reach.max() + 1), np.nan)
    turned[:, 0] = 0.0
    # All restarts go on together, a lane each: those that reach farthest first, so that the others end behind them.
    order = np.argsort(-reach)
    begin = starts[order]
    r, a = rate[begin], angle[begin]
    state = np.zeros((count, rows, TERM_STATES))
    told = base[order]
    for i in range(count):
        state[i] = states[begin[i], :rows]
    push, h, stiffness = np.zeros((3, count))
    steps, live = np.zeros(count, dtype=np.int64), np.arange(count)
    rooms, work = np.zeros((8, count)), np.zeros((3, count, rows, TERM_STATES))
    most = _RUNAWAY * np.nanmax(np.abs(rate))
    for k in range(reach.max()):
        while reach[order[count - 1]] <= k:
            count -= 1
        for i in range(count):
            at = begin[i] + k
            push[i] = torque[at]
            _tell(told[i], beside[at])
            steps[i] = _substeps(r[i], push[i], stiffness[i], period[order[i]], told[i])
            if steps[i] > _MAX_SUBSTEPS_AHEAD:
                r[i], steps[i] = np.nan, 1
            h[i] = period[order[i]] / steps[i]
            stiffness[i] = told[i, 4]
        moving = live[:count]
        for step in range(steps[:count].max()):
            if step > 0:
                moving = moving[steps[moving] > step]
            _substep_of_lanes(moving, r, a, push, told, terms, kinds, state, h, stiffness, rooms, work)
        for i in range(count):
            if not abs(r[i]) < most:
                # It runs away.
                r[i] = a[i] = np.nan
            turned[order[i], k + 1] = a[i] - angle[begin[i]]
    return turned


@_inlined
def _substep_of_lanes(
    live: Any,
    r: Any,
    a: Any,
    push: Any,
    told: Any,
    terms: Any,
    kinds: Any,
    state: Any,
    h: Any,
    stiffness: Any,
    rooms: Any,
    work: Any,
) -> None:
    """As `_substep` for each lane that is ``live``, in place; ``told`` is the ``base`` of each.

    ``stiffness`` is raised to the damping, ``rooms`` (8, lanes) and ``work`` (3, lanes, m, TERM_STATES) are room.
    """
    # The same for all.
    inertia, quadratic, linear = told[0, 0], told[0, 1], told[0, 2]
    r_here, a_here, extra, given, k1, k2, r2, r3 = rooms
    change, there, reached = work
    for i in live:
        r_here[i], a_here[i] = r[i] + 1e-6 + 1e-4 * abs(r[i]), a[i]
    _sum_terms_of_lanes(live, r_here, a_here, push, told, terms, kinds, state, there, given)
    _sum_terms_of_lanes(live, r, a, push, told, terms, kinds, state, change, extra)
    _advance_lanes(live, state, change, h, 1.0 / 6.0, reached)
    _advance_lanes(live, state, change, h, 0.5, there)
    for i in live:
        given[i] = (given[i] - extra[i]) / ((r_here[i] - r[i]) * inertia)
        k1[i] = _acceleration(r[i], push[i] + extra[i], inertia, quadratic, linear)
        r2[i], a_here[i] = r[i] + 0.5 * h[i] * k1[i], a[i] + 0.5 * h[i] * r[i]
    _sum_terms_of_lanes(live, r2, a_here, push, told, terms, kinds, there, change, extra)
    _advance_lanes(live, reached, change, h, 1.0 / 3.0, reached)
    _advance_lanes(live, state, change, h, 0.5, there)
    for i in live:
        k2[i] = _acceleration(r2[i], push[i] + extra[i], inertia, quadratic, linear)
        r3[i], a_here[i] = r[i] + 0.5 * h[i] * k2[i], a[i] + 0.5 * h[i] * r2[i]
        stiffness[i] = max(stiffness[i], (2.0 * quadratic * abs(r2[i]) + linear) / inertia - given[i])
    _sum_terms_of_lanes(live, r3, a_here, push, told, terms, kinds, there, change, extra)
    _advance_lanes(live, reached, change, h, 1.0 / 3.0, reached)
    _advance_lanes(live, state, change, h, 1.0, there)
    k3 = given
    for i in live:
        k3[i] = _acceleration(r3[i], push[i] + extra[i], inertia, quadratic, linear)
        r_here[i], a_here[i] = r[i] + h[i] * k3[i], a[i] + h[i] * r3[i]
    _sum_terms_of_lanes(live, r_here, a_here, push, told, terms, kinds, there, change, extra)
    _advance_lanes(live, reached, change, h, 1.0 / 6.0, state)
    for i in live:
        k4 = _acceleration(r_here[i], push[i] + extra[i], inertia, quadratic, linear)
        a[i] += h[i] * (r[i] + 2.0 * r2[i] + 2.0 * r3[i] + r_here[i]) / 6.0
        r[i] += h[i] * (k1[i] + 2.0 * k2[i] + 2.0 * k3[i] + k4) / 6.0


@_compiled
def _sum_terms_of_lanes(
    live: Any, rate: Any, angle: Any, push: Any, told: Any, terms: Any, kinds: Any, state: Any, change: Any, total: Any
) -> None:
    """Fill in the torque of all effects of each lane, and the rates of change of its states."""
    for i in live:
        total[i] = 0.0
    for j in range(len(kinds)):
        _term_of_lanes(kinds[j], live, rate, angle, push, told, terms, state, change, j, total)


@_compiled
def _advance_lanes(live: Any, state: Any, change: Any, h: Any, share: float, out: Any) -> None:
    """Write state + share*h*change of each lane into ``out``."""
    for i in live:
        for j in range(state.shape[1]):
            for c in range(state.shape[2]):
                out[i, j, c] = state[i, j, c] + share * h[i] * change[i, j, c]


@_compiled
def effects_along(
    period: float, course: FloatArray, beside: FloatArray, base: FloatArray, terms: FloatArray, kinds: Any
) -> tuple[FloatArray, FloatArray]:
    """(n,) torque in N m of all effects, and their (n, m, TERM_STATES) states, on a measured course.

    Parameters
    ----------
    period
        s between its instants.
    course
        (n, 3) rate, angle since the start of the trial and thrusters' torque, which is held.
    beside, base, terms, kinds
        As for ``simulate_effects``.
    """
    n = len(course)
    torque, states = np.zeros(n), np.zeros((n, len(terms), TERM_STATES))
    steps = max(math.ceil(period * base[4] / _EFFECTS_STEP_SHARE), 1)
    h = period / steps
    change, there, reached = np.zeros((3, len(terms), TERM_STATES))
    for k in range(n):
        state = states[k]
        rate, angle, push = course[k]
        _tell(base, beside[k])
        torque[k] = _sum_terms(rate, angle, push, base, terms, kinds, state, change)
        if k == n - 1:
            break
        faster, farther = (course[k + 1, 0] - rate) / steps, (course[k + 1, 1] - angle) / steps
        following = states[k + 1]
        following[:] = state
        for step in range(steps):
            r, a = rate + step * faster, angle + step * farther
            _sum_terms(r, a, push, base, terms, kinds, following, change)
            _advance(following, change, h / 6.0, reached)
            _advance(following, change, 0.5 * h, there)
            _sum_terms(r + 0.5 * faster, a + 0.5 * farther, push, base, terms, kinds, there, change)
            _advance(reached, change, h / 3.0, reached)
            _advance(following, change, 0.5 * h, there)
            _sum_terms(r + 0.5 * faster, a + 0.5 * farther, push, base, terms, kinds, there, change)
            _advance(reached, change, h / 3.0, reached)
            _advance(following, change, h, there)
            _sum_terms(r + faster, a + farther, push, base, terms, kinds, there, change)
            _advance(reached, change, h / 6.0, following)
    return torque, states


@_compiled
def _pushed(t: float, a: float, b: float, inertia: float) -> tuple[float, float]:
    """Angle and rate after ``t`` s of a unit torque that fades at ``b`` 1/s, against a damping of ``a`` 1/s.

    (exp(-b t) - exp(-a t)) / (a - b) / inertia and its integral, as series, since a and b may be equal.
    """
    first, second, third = a + b, a * a + a * b + b * b, (a + b) * (a * a + b * b)
    rate = t / inertia * (1.0 - t / 2.0 * (first - t / 3.0 * (second - t / 4.0 * third)))
    return 0.5 * t * t / inertia * (1.0 - t / 3.0 * (first - t / 4.0 * (second - t / 5.0 * third))), rate


@_compiled
def _filter_steps(interval: float, rate: float, push: float, damping: float, fastest: float, base: Any) -> int:
    """How many steps a filter takes through ``interval``; ``fastest`` in 1/s is the rate of what disturbs."""
    inertia = base[0]
    # How fast it may turn before the interval is over, or where drag balances the torque.
    soon = min(abs(rate) + interval * abs(push) / inertia, max(abs(rate), math.sqrt(abs(push) / (base[1] + _TINY))))
    stiffness = (
        max(damping, (2.0 * base[1] * soon + base[2]) / inertia) + fastest + math.sqrt(base[STIFFNESS] / inertia)
    )
    wanted = interval * stiffness / _FILTER_STEP_SHARE
    return 1 if not wanted > 1.0 else min(int(wanted) + 1, _MAX_GAP_SUBSTEPS)


@_compiled
def innovations(  # noqa: PLR0915 - the covariance is written out term by term, without arrays
    time: FloatArray,
    torque: FloatArray,
    beside: FloatArray,
    moment: FloatArray,
    scatter: FloatArray,
    angle: FloatArray,
    rate: FloatArray,
    base: FloatArray,
    terms: FloatArray,
    kinds: Any,
    noise: FloatArray,
    start: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Innovations of an extended Kalman filter with a coloured disturbance torque.

    State: angle, rate r, disturbance d. ``inertia*rdot = torque + d - quadratic*|r|*r - linear*r``, angle_dot = r,
    d a first-order Gauss-Markov process. The mean is stepped by Runge-Kutta, the covariance by the transition of the
    linearised motion (Maybeck 1979, chapter 6), in steps short beside its time constants.

    Parameters
    ----------
    time, torque, beside, moment, scatter
        (n,) s; the others from each instant to the next, see `rovid.model.drive.Drive`.
    angle, rate
        (n,) measured angle in rad and rate in rad/s; NaN where not measured.
    base, terms, kinds
        As for ``simulate_effects``; the states of the effects follow the mean, without a variance of their own.
    noise
        Standard deviation of d in N m, its correlation time in s, standard deviation of the white noise of a
        measured angle in rad and of a measured rate in rad/s.
    start
        Rate in rad/s at the first instant and its standard deviation.

    Returns
    -------
    innovation, variance
        (n, 2) of angle and rate; NaN where nothing was measured.
    """
    n = len(time)
    inertia = base[0]
    sigma, tau = noise[0], noise[1]
    rows = _rows(kinds)
    state, work = np.zeros((rows, TERM_STATES)), np.zeros((3, rows, TERM_STATES))
    origin, damping = angle[0], base[2] / inertia
    innovation = np.full((n, 2), np.nan)
    variance = np.full((n, 2), np.nan)
    a, r, d = angle[0], start[0], 0.0
    p00, p01, p02 = noise[2] ** 2, 0.0, 0.0
    p11, p12, p22 = start[1] ** 2, 0.0, sigma**2
    h, fade, mean, fresh, grown, pull, left = 0.0, 1.0, 1.0, 0.0, 0.0, 0.0, np.empty(3)
    for k in range(n):
        if k > 0:
            interval = time[k] - time[k - 1]
            push = torque[k - 1]
            _tell(base, beside[k - 1])
            steps = _filter_steps(interval, r, push, damping, 1.0 / tau, base)
            # Most logs are sampled evenly: what depends on the step alone is kept.
            if interval / steps != h:
                h = interval / steps
                fade = math.exp(-h / tau)
                mean = (1.0 - fade) * tau / h
                fresh, grown = sigma**2 * (1.0 - fade * fade), 2.0 * sigma**2 / tau * h
                pull = 0.5 * base[STIFFNESS] * h / inertia
                for node in range(3):
                    left[node] = math.exp(-_NODES[node] * h / tau)
            # States of effects that are faster than all this have no variance: steps of the mean alone do for them.
            shares = max(math.ceil(h * base[4] / _FILTER_STEP_SHARE), 1)
            for _ in range(steps):
                a -= origin
                for _ in range(shares):
                    # Over a step the disturbance acts by its mean.
                    r, a, damping = _substep(r, a, push, d * mean, base, terms, kinds, state, work, h / shares)
                a += origin
                # What of it comes early in the step turns the vehicle more.
                early = (1.0 - fade) * d * h**2 / (12.0 * inertia)
                a += early
                r -= damping * early
                d *= fade
                # What brings the vehicle back, as half an impulse at each end of the step (Strang 1968).
                if base[STIFFNESS] > 0.0:
                    p11 += pull * (pull * p00 - 2.0 * p01)
                    p12 -= pull * p02
                    p01 -= pull * p00
                part = damping * h
                f11 = 1.0 - part * (1.0 - 0.5 * part * (1.0 - part / 3.0 * (1.0 - 0.25 * part)))
                f01 = h * (1.0 - 0.5 * part * (1.0 - part / 3.0 * (1.0 - 0.25 * part)))
                f02, f12 = _pushed(h, damping, 1.0 / tau, inertia)
                n00, n01, n02, n11, n12 = 0.0, 0.0, 0.0, 0.0, 0.0
                for node in range(3):
                    c0, c1 = _pushed(_NODES[node] * h, damping, 1.0 / tau, inertia)
                    c2, weight = left[node], grown * _WEIGHTS[node]
                    n00 += weight * c0 * c0
                    n01 += weight * c0 * c1
                    n02 += weight * c0 * c2
                    n11 += weight * c1 * c1
                    n12 += weight * c1 * c2
                q00 = p00 + f01 * p01 + f02 * p02
                q01 = p01 + f01 * p11 + f02 * p12
                q02 = p02 + f01 * p12 + f02 * p22
                q11 = f11 * p11 + f12 * p12
                q12 = f11 * p12 + f12 * p22
                p00 = q00 + f01 * q01 + f02 * q02 + n00
                p01 = f11 * q01 + f12 * q02 + n01
                p02 = fade * q02 + n02
                p11 = f11 * q11 + f12 * q12 + n11
                p12 = fade * q12 + n12
                p22 = fade * fade * p22 + fresh
                if base[STIFFNESS] > 0.0:
                    p11 += pull * (pull * p00 - 2.0 * p01)
                    p12 -= pull * p02
                    p01 -= pull * p00
            a += moment[k - 1] / inertia
            r -= damping * moment[k - 1] / inertia
            kick = scatter[k - 1] / inertia**2
            p00 += kick * interval**2 / 3.0
            p01 += kick * interval / 2.0
            p11 += kick
        if angle[k] == angle[k]:
            s = p00 + noise[2] ** 2
            e = angle[k] - a
            innovation[k, 0] = e
            variance[k, 0] = s
            g0, g1, g2 = p00 / s, p01 / s, p02 / s
            a += g0 * e
            r += g1 * e
            d += g2 * e
            p11 -= g1 * p01
            p12 -= g1 * p02
            p22 -= g2 * p02
            p02 *= 1.0 - g0
            p01 *= 1.0 - g0
            p00 *= 1.0 - g0
        if rate[k] == rate[k]:
            s = p11 + noise[3] ** 2
            e = rate[k] - r
            innovation[k, 1] = e
            variance[k, 1] = s
            g0, g1, g2 = p01 / s, p11 / s, p12 / s
            a += g0 * e
            r += g1 * e
            d += g2 * e
            p00 -= g0 * p01
            p02 -= g0 * p12
            p22 -= g2 * p12
            p01 *= 1.0 - g1
            p12 *= 1.0 - g1
            p11 *= 1.0 - g1
    return innovation, variance


@_compiled
def innovations_wide(  # noqa: PLR0912, PLR0915 - one filter, from top to bottom
    time: FloatArray,
    torque: FloatArray,
    beside: FloatArray,
    moment: FloatArray,
    scatter: FloatArray,
    angle: FloatArray,
    rate: FloatArray,
    base: FloatArray,
    terms: FloatArray,
    kinds: Any,
    noise: FloatArray,
    wave: FloatArray,
    start: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """As ``innovations``, with two states more: a narrow-band torque of random phase, or those of a carried effect.

    The wave is a second-order shaping filter driven by white noise (Fossen 2011, section 8.2.6). The states of an
    effect that is ``carried`` are no better known than the motion that sets them off. Beside a wave they have no
    variance of their own.

    Parameters
    ----------
    wave
        Root 2 times the standard deviation of the wave in N m, its frequency in rad/s and the damping of its filter;
        empty where there is none.
    """
    n, inertia, sigma, tau, waves = len(time), base[0], noise[0], noise[1], len(wave) > 0
    rows = _rows(kinds)
    state, work = np.zeros((rows, TERM_STATES)), np.zeros((3, rows, TERM_STATES))
    innovation, variance = np.full((n, 2), np.nan), np.full((n, 2), np.nan)
    carried = 0
    for j in range(len(kinds)):
        if _CARRIED[kinds[j]]:
            carried = j
    # Angle, rate, disturbance, and the two.
    a, r, d, w, v = angle[0], start[0], 0.0, 0.0, 0.0
    p, f, q = np.zeros((5, 5)), np.zeros((5, 5)), np.zeros((5, 5))
    slopes, room = np.zeros((5, 5)), np.zeros((5, 5))
    origin, damping = angle[0], base[2] / inertia
    p[0, 0], p[1, 1], p[2, 2] = noise[2] ** 2, start[1] ** 2, sigma**2
    # Of the first and fourth state it is known: they are the integrals of those behind them.
    slopes[1, 0], slopes[1, 2], slopes[2, 2] = -base[STIFFNESS] / inertia, 1.0 / inertia, -1.0 / tau
    frequency, leak, power = base[4], 0.0, 0.0
    if waves:
        frequency, leak, power = wave[1], 2.0 * wave[2] * wave[1], 0.5 * wave[0] ** 2
        p[3, 3], p[4, 4] = power, power * frequency**2
        slopes[1, 3], slopes[4, 3], slopes[4, 4] = 1.0 / inertia, -(frequency**2), -leak
    else:
        _carry(slopes, carried, base, terms, kinds, state, work)
    for k in range(n):
        if k > 0:
            _tell(base, beside[k - 1])
            push, interval = torque[k - 1], time[k] - time[k - 1]
            steps = _filter_steps(interval, r, push, damping, 1.0 / tau + frequency, base)
            h = interval / steps
            fade = math.exp(-h / tau)
            mean = (1.0 - fade) * tau / h
            shares = max(math.ceil(h * base[4] / _FILTER_STEP_SHARE), 1)
            for _ in range(steps):
                faded, swung, slope, other = d * fade, 0.0, 0.0, d * mean
                if waves:
                    bend = -leak * v - frequency**2 * w
                    jerk = -leak * bend - frequency**2 * v
                    jolt = -leak * jerk - frequency**2 * bend
                    swung = w + h * (v + h / 2.0 * (bend + h / 3.0 * (jerk + h / 4.0 * jolt)))
                    slope = v + h * (bend + h / 2.0 * (jerk + h / 3.0 * jolt))
                    # Its mean over the step.
                    other += w + h / 2.0 * (v + h / 3.0 * (bend + h / 4.0 * (jerk + h / 5.0 * jolt)))
                for _ in range(shares):
                    r, a, damping = _substep(r, a - origin, push, other, base, terms, kinds, state, work, h / shares)
                    a += origin
                # What of it comes late in the step turns the vehicle less.
                late = -(swung - w + faded - d) * h**2 / (12.0 * inertia)
                a += late
                r -= damping * late
                d, w, v = faded, swung, slope
                slopes[1, 1] = -damping
                _transition(slopes, h, f)
                q[:] = 0.0
                _add_noise(slopes, 2, sigma * math.sqrt(2.0 / tau), h, q)
                if waves:
                    _add_noise(slopes, 4, frequency * math.sqrt(2.0 * leak * power), h, q)
                _congruence(f, p, q, room)
            a += moment[k - 1] / inertia
            r -= damping * moment[k - 1] / inertia
            kick = scatter[k - 1] / inertia**2
            p[0, 0] += kick * interval**2 / 3.0
            p[0, 1] += kick * interval / 2.0
            p[1, 0] += kick * interval / 2.0
            p[1, 1] += kick
        for m in range(2):
            reading, known = (angle[k], a) if m == 0 else (rate[k], r)
            if not math.isnan(reading):
                s = p[m, m] + noise[2 + m] ** 2
                e = reading - known
                innovation[k, m], variance[k, m] = e, s
                a += p[m, 0] / s * e
                r += p[m, 1] / s * e
                d += p[m, 2] / s * e
                if waves:
                    w += p[m, 3] / s * e
                    v += p[m, 4] / s * e
                else:
                    state[carried, 0] += p[m, 3] / s * e
                    state[carried, 1] += p[m, 4] / s * e
                for i in range(5):
                    room[0, i] = p[m, i]
                for i in range(5):
                    for j in range(5):
                        p[i, j] -= room[0, i] * room[0, j] / s
    return innovation, variance


@_compiled
def _carry(slopes: Any, carried: int, base: Any, terms: Any, kinds: Any, state: Any, work: Any) -> None:
    """Fill in how the two states of an effect act on the rate, and how the second follows from it and from both."""
    change = work[0]
    _sum_terms(1.0, 0.0, 0.0, base, terms, kinds, state, change)
    slopes[4, 1] = change[carried, 1]
    rest = _sum_terms(0.0, 0.0, 0.0, base, terms, kinds, state, change)
    for j in range(2):
        state[carried, j] = 1.0
        slopes[1, 3 + j] = (_sum_terms(0.0, 0.0, 0.0, base, terms, kinds, state, change) - rest) / base[0]
        slopes[4, 3 + j] = change[carried, 1]
        state[carried, j] = 0.0


@_inlined
def _transition(slopes: Any, h: float, f: Any) -> None:
    """Write exp(slopes h) into ``f``, by its series.

    Row by row: the derivative of the angle's row is the rate's, and so it is of the two states, the first of which is
    the integral of the other.
    """
    f[2, 2] = math.exp(slopes[2, 2] * h)
    for at in (0, 3):
        y0, y1, y2, y3, y4 = 0.0, 1.0 if at == 0 else 0.0, 0.0, 0.0, 1.0 if at == 3 else 0.0
        a0, a1, a2, a3, a4 = 1.0 if at == 0 else 0.0, h * y1, 0.0, 1.0 if at == 3 else 0.0, h * y4
        r0, r1, r2, r3, r4 = y0, y1, y2, y3, y4
        factor = h
        for order in range(2, _ORDER + 2):
            y0, y1, y2, y3, y4 = (
                y1 * slopes[1, 0],
                y0 + y1 * slopes[1, 1] + y4 * slopes[4, 1],
                y1 * slopes[1, 2] + y2 * slopes[2, 2],
                y1 * slopes[1, 3] + y4 * slopes[4, 3],
                y1 * slopes[1, 4] + y3 + y4 * slopes[4, 4],
            )
            r0, r1, r2, r3, r4 = (
                r0 + factor * y0,
                r1 + factor * y1,
                r2 + factor * y2,
                r3 + factor * y3,
                r4 + factor * y4,
            )
            factor *= h / order
            a0, a1, a2, a3, a4 = (
                a0 + factor * y0,
                a1 + factor * y1,
                a2 + factor * y2,
                a3 + factor * y3,
                a4 + factor * y4,
            )
        f[at, 0], f[at, 1], f[at, 2], f[at, 3], f[at, 4] = a0, a1, a2, a3, a4
        f[at + 1, 0], f[at + 1, 1], f[at + 1, 2], f[at + 1, 3], f[at + 1, 4] = r0, r1, r2, r3, r4


@_inlined
def _add_noise(slopes: Any, into: int, size: float, h: float, q: Any) -> None:
    """Add to ``q``, on and above its diagonal, what white noise of ``size`` into the state ``into`` grows in ``h`` s.

    By Gauss and Legendre, with its path to each node as a series: no covariance comes out of that negative.
    """
    for node in range(3):
        t, weight = _NODES[node] * h, _WEIGHTS[node] * h
        v0, v1, v2, v3, v4 = 0.0, 0.0, size if into == 2 else 0.0, 0.0, size if into == 4 else 0.0
        c0, c1, c2, c3, c4 = v0, v1, v2, v3, v4
        for order in range(1, _ORDER + 1):
            share = t / order
            v0, v1, v2, v3, v4 = (
                share * v1,
                share
                * (slopes[1, 0] * v0 + slopes[1, 1] * v1 + slopes[1, 2] * v2 + slopes[1, 3] * v3 + slopes[1, 4] * v4),
                share * slopes[2, 2] * v2,
                share * v4,
                share * (slopes[4, 1] * v1 + slopes[4, 3] * v3 + slopes[4, 4] * v4),
            )
            c0, c1, c2, c3, c4 = c0 + v0, c1 + v1, c2 + v2, c3 + v3, c4 + v4
        q[0, 0] += weight * c0 * c0
        q[0, 1] += weight * c0 * c1
        q[0, 2] += weight * c0 * c2
        q[0, 3] += weight * c0 * c3
        q[0, 4] += weight * c0 * c4
        q[1, 1] += weight * c1 * c1
        q[1, 2] += weight * c1 * c2
        q[1, 3] += weight * c1 * c3
        q[1, 4] += weight * c1 * c4
        q[2, 2] += weight * c2 * c2
        q[2, 3] += weight * c2 * c3
        q[2, 4] += weight * c2 * c4
        q[3, 3] += weight * c3 * c3
        q[3, 4] += weight * c3 * c4
        q[4, 4] += weight * c4 * c4


@_inlined
def _congruence(f: Any, p: Any, q: Any, room: Any) -> None:
    """Write f p f^T + q into ``p``; the disturbance follows from itself alone."""
    for j in range(5):
        p0, p1, p2, p3, p4 = p[0, j], p[1, j], p[2, j], p[3, j], p[4, j]
        room[0, j] = f[0, 0] * p0 + f[0, 1] * p1 + f[0, 2] * p2 + f[0, 3] * p3 + f[0, 4] * p4
        room[1, j] = f[1, 0] * p0 + f[1, 1] * p1 + f[1, 2] * p2 + f[1, 3] * p3 + f[1, 4] * p4
        room[2, j] = f[2, 2] * p2
        room[3, j] = f[3, 0] * p0 + f[3, 1] * p1 + f[3, 2] * p2 + f[3, 3] * p3 + f[3, 4] * p4
        room[4, j] = f[4, 0] * p0 + f[4, 1] * p1 + f[4, 2] * p2 + f[4, 3] * p3 + f[4, 4] * p4
    for i in range(5):
        r0, r1, r2, r3, r4 = room[i, 0], room[i, 1], room[i, 2], room[i, 3], room[i, 4]
        for j in range(i, 5):
            total = r0 * f[j, 0] + r1 * f[j, 1] + r2 * f[j, 2] + r3 * f[j, 3] + r4 * f[j, 4]
            p[i, j] = p[j, i] = q[i, j] + total


def is_compiled() -> bool:
    """Whether this machine has compiled the simulation before."""
    return keeps_compiled() and any(Path(str(simulate.stats.cache_path)).glob("kernels.simulate*.nbi"))


def _forget_stale() -> None:
    """Delete compiled kernels that were made from other effects.

    Numba looks at the age of this file alone, and would run the old terms under the new numbers.
    """
    if not keeps_compiled():
        return
    folder = Path(str(simulate.stats.cache_path))
    mark, digest = folder / "kernels.sources", hashlib.sha256()
    for source in (*sorted(Path(effects.__file__).parent.glob("*.py")), Path(__file__)):
        digest.update(source.read_bytes())
    try:
        if mark.exists() and mark.read_text() == digest.hexdigest():
            return
        for stale in folder.glob("kernels.*.nb[ci]"):
            stale.unlink(missing_ok=True)
        folder.mkdir(parents=True, exist_ok=True)
        mark.write_text(digest.hexdigest())
    except OSError:  # nothing can be kept there, so that nothing is stale either
        return


_forget_stale()
