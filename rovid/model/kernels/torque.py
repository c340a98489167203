"""The torque of all terms of the equation of motion at one instant, of several motions side by side."""

from __future__ import annotations

import dis
from collections.abc import Callable, Mapping
from typing import Any

import numba
from numba.core.dispatcher import Dispatcher

from rovid.effects import TERMS
from rovid.effects.base import TERM_PARAMETERS, TERM_STATES, Body, Instant
from rovid.ground.compiled import Function, inlined, lean
from rovid.ground.lanes import LANES, alike, lane, read, with_lane, write

# What a term gives, by how many states it has: its torque and how two states change.
_GIVES = ("alike({}(at, p)), none, none", "both({}(at, p, x), none)", "{}(at, p, x)")
# Rows behind the rates of change of the states, in which it is kept what terms look at.
ROOM = 3
# Compiled into its caller, and making no arrays of its own, as `rovid.ground.compiled.lean`.
_part: Callable[[Function], Function] = numba.njit(  # type: ignore[call-overload]  # its types leave out _nrt
    error_model="numpy", nogil=True, _nrt=False, forceinline=True
)


def _any_of(takes: str, gives: Mapping[int, str], names: Mapping[str, Any], otherwise: str) -> Any:
    """Compiled; of a ``kind``, before what it ``takes``, what that gives; ``otherwise`` of any other.

    As a chain of comparisons, which compiles to one jump: numba's own loop over functions takes ten times as long.
    """
    lines = [f"def any_of(kind, {takes}):"]
    lines += [f"    if kind == {kind}: return {text}" for kind, text in gives.items()]
    namespace = dict(names)
    exec("\n".join((*lines, f"    return {otherwise}")), namespace)  # noqa: S102 - all of it is here
    return numba.njit(error_model="numpy", nogil=True, inline="always")(namespace["any_of"])


def taking_lanes(function: Any, states: int) -> Any:
    """Compiled; a term's ``function`` as one of lanes: itself, or where it branches one that goes lane by lane."""
    return function if _takes_lanes(function) else _lane_by_lane(function, states)


def _takes_lanes(function: Any) -> bool:
    """Whether a compiled ``function`` and all that it calls go on the same way whatever the numbers are."""
    if not isinstance(function, Dispatcher):
        return False
    plain = function.py_func
    names = plain.__code__.co_names
    if {"min", "max"} & set(names) or any("JUMP" in step.opname for step in dis.get_instructions(plain)):
        return False
    called = [plain.__globals__.get(name) for name in names]
    return all(_takes_lanes(one) for one in called if isinstance(one, Dispatcher))


def _lane_by_lane(function: Callable[..., Any], states: int) -> Any:
    """Compiled; as a ``function`` that takes lanes."""

    @_part
    def without(at: Any, p: Any) -> Any:
        torque = alike(0.0)
        for i in range(LANES):
            torque = with_lane(torque, i, function(_instant(at, i), _four(p, i)))
        return torque

    @_part
    def with_one(at: Any, p: Any, x: Any) -> Any:
        torque = change = alike(0.0)
        for i in range(LANES):
            own, first = function(_instant(at, i), _four(p, i), _two(x, i))
            torque, change = with_lane(torque, i, own), with_lane(change, i, first)
        return torque, change

    @_part
    def with_two(at: Any, p: Any, x: Any) -> Any:
        torque = change = further = alike(0.0)
        for i in range(LANES):
            own, first, second = function(_instant(at, i), _four(p, i), _two(x, i))
            torque, change = with_lane(torque, i, own), with_lane(change, i, first)
            further = with_lane(further, i, second)
        return torque, change, further

    return (without, with_one, with_two)[states]


@inlined
def _two(x: Any, i: int) -> Any:
    return lane(x[0], i), lane(x[1], i)


@inlined
def _four(p: Any, i: int) -> Any:
    return lane(p[0], i), lane(p[1], i), lane(p[2], i), lane(p[3], i)


@inlined
def _instant(at: Any, i: int) -> Any:
    """What lane ``i`` is told."""
    inertia, quadratic, linear, stiffness = _four(at.body, i)
    rate, slip, angle, start = _four(at, i)
    body = Body(inertia, quadratic, linear, stiffness, lane(at.body.trim, i))
    return Instant(
        rate, slip, angle, start, lane(at.push, i), lane(at.race, i), lane(at.surge, i), lane(at.sway, i), body
    )


@inlined
def _both(torque_and_change: Any, none: Any) -> Any:
    return alike(torque_and_change[0]), torque_and_change[1], none


# The kind of a term is its index in ``rovid.effects.TERMS``.
_term = _any_of(
    "at, p, x, none",
    {kind: _GIVES[term.states].format(f"term_{kind}") for kind, term in enumerate(TERMS)},
    {f"term_{kind}": taking_lanes(term.torque, term.states) for kind, term in enumerate(TERMS)}
    | {"alike": alike, "both": _both},
    "none, none, none",
)
_MOVING = {kind: term.water for kind, term in enumerate(TERMS) if term.water is not None}
_water_of = _any_of(
    "p, x",
    {kind: f"water_{kind}(p, x)" for kind in _MOVING},
    {f"water_{kind}": water for kind, water in _MOVING.items()},
    "0.0",
)
_JUMPING = {kind: term.jumps for kind, term in enumerate(TERMS) if term.jumps is not None}
_jumped = _any_of(
    "rate, x",
    {kind: f"jumps_{kind}(rate, x)" for kind in _JUMPING},
    {f"jumps_{kind}": jumps for kind, jumps in _JUMPING.items()},
    "x[0]",
)


@_part
def torque_of(rate: Any, angle: Any, push: Any, beside: Any, equation: Any, state: Any, change: Any) -> Any:
    """Torque in N m of all terms of ``equation``; fills in the rates of ``change`` of their states.

    Parameters
    ----------
    rate, angle, push
        Lanes, as in `rovid.effects.base.Instant`.
    beside
        Lanes of the thrusters' race and of the speeds, as there.
    equation
        `rovid.model.equation.Equation` in lanes.
    state, change
        (m * TERM_STATES, LANES); ``change`` has `ROOM` rows more.
    """
    terms, total, none = equation.terms, alike(0.0), alike(0.0)
    kinds, parameters, water = terms.kinds, terms.parameters, alike(0.0)
    for j in range(terms.moving):
        for i in range(LANES):
            moved = _water_of(kinds[j], _four(_parameters(parameters, j), i), _two(_states(state, j), i))
            water = with_lane(water, i, lane(water, i) + moved)
    # Through memory: else what every term makes of these would be worked out beforehand, for terms that are not there.
    seen = TERM_STATES * len(kinds)
    write(change, seen, rate)
    write(change, seen + 1, rate - water)
    write(change, seen + 2, angle)
    for j in range(len(kinds)):
        moving, slip, there = read(change, seen), read(change, seen + 1), read(change, seen + 2)
        at = Instant(moving, slip, there, equation.start, push, beside[0], beside[1], beside[2], equation.body)
        torque, first, second = _term(kinds[j], at, _parameters(parameters, j), _states(state, j), none)
        total = total + torque
        write(change, TERM_STATES * j, first)
        write(change, TERM_STATES * j + 1, second)
    return total


@lean
def torque_at(rate: Any, angle: Any, push: Any, beside: Any, equation: Any, state: Any, change: Any) -> Any:
    """As ``torque_of``, which is long, as a function of its own: for loops that are not the innermost."""
    return torque_of(rate, angle, push, beside, equation, state, change)


@inlined
def _parameters(rows: Any, j: int) -> Any:
    """Of term ``j``."""
    at = TERM_PARAMETERS * j
    return read(rows, at), read(rows, at + 1), read(rows, at + 2), read(rows, at + 3)


@inlined
def _states(rows: Any, j: int) -> Any:
    """Of term ``j``."""
    return read(rows, TERM_STATES * j), read(rows, TERM_STATES * j + 1)


@inlined
def jump(rate: Any, equation: Any, state: Any) -> None:
    """Let the states jump that do so at such a ``rate`` in rad/s."""
    terms = equation.terms
    for j in range(terms.remembering if terms.jumping else 0):
        for i in range(LANES):
            at = TERM_STATES * j
            state[at, i] = _jumped(terms.kinds[j], lane(rate, i), (state[at, i], state[at + 1, i]))
