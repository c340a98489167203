"""The torque of all terms of the equation of motion at one instant, of several motions side by side."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rovid.effects import TERMS
from rovid.effects.base import TERM_PARAMETERS, TERM_STATES, Instant, Term
from rovid.jit.decorators import inlined, lean
from rovid.jit.simd import LANES, alike, lane, read, with_lane, write
from rovid.jit.tracing import goes_straight, one_of, straight

# Rows behind the rates of change of the states, in which it is kept what terms look at.
ROOM = 3


def taking_lanes(function: Callable[..., Any]) -> Callable[..., Any]:
    """``function`` of an instant, parameters and states in lanes: itself, or where it branches lane by lane."""
    if goes_straight(function):
        return function

    def lane_by_lane(*arguments: Any) -> Any:
        def own(x: Any, i: int) -> Any:
            if not isinstance(x, tuple):
                return lane(x, i)
            each = [own(one, i) for one in x]
            return type(x)(*each) if hasattr(x, "_fields") else tuple(each)

        def abreast(numbers: Any) -> Any:
            if isinstance(numbers[0], tuple):
                return tuple([abreast(column) for column in zip(*numbers, strict=True)])
            x = alike(0.0)
            for i in range(LANES):
                x = with_lane(x, i, numbers[i])
            return x

        return abreast([function(*own(arguments, i)) for i in range(LANES)])

    return straight(lane_by_lane)


def _whole(term: Term) -> Callable[..., Any]:
    """The torque of ``term`` and the changes of as many states as any has, in lanes."""
    torque, states = taking_lanes(term.torque), term.states

    def whole(at: Any, p: Any, x: Any) -> Any:
        given, *changes = torque(at, p, x) if states else (torque(at, p),)
        return alike(given), *(alike(change) for change in changes), *([alike(0.0)] * (TERM_STATES - states))

    return whole


def _nothing(at: Any, p: Any, x: Any) -> Any:  # noqa: ARG001 - as any term
    return alike(0.0), alike(0.0), alike(0.0)


def _still(p: Any, x: Any) -> Any:  # noqa: ARG001 - as any that takes the water along
    return alike(0.0)


def _stays(rate: Any, x: Any) -> Any:  # noqa: ARG001 - as any that jumps
    return x[0]


# The kind of a term is its index in ``rovid.effects.TERMS``.
_term = one_of({kind: _whole(term) for kind, term in enumerate(TERMS)}, _nothing)
_water_of = one_of(
    {kind: taking_lanes(term.water) for kind, term in enumerate(TERMS) if term.water is not None}, _still
)
_jumped = one_of({kind: taking_lanes(term.jumps) for kind, term in enumerate(TERMS) if term.jumps is not None}, _stays)


@inlined
def torque_of(rate: Any, angle: Any, push: Any, beside: Any, equation: Any, state: Any, change: Any) -> Any:
    """Torque in N m of all terms of ``equation``; fills in the rates of ``change`` of their states.

    Parameters
    ----------
    rate, angle, push
        Lanes, as in `rovid.effects.base.Instant`.
    beside
        Lanes of the thrusters' race and of the speeds, as there.
    equation
        `rovid.model.packed_terms.Equation` in lanes.
    state, change
        (m * TERM_STATES, LANES); ``change`` has `ROOM` rows more.
    """
    terms, total = equation.terms, alike(0.0)
    kinds, parameters, water = terms.kinds, terms.parameters, alike(0.0)
    for j in range(terms.moving):
        water = water + _water_of(kinds[j], _parameters(parameters, j), _states(state, j))
    # Through memory: else what every term makes of these would be worked out beforehand, for terms that are not there.
    seen = TERM_STATES * len(kinds)
    write(change, seen, rate)
    write(change, seen + 1, rate - water)
    write(change, seen + 2, angle)
    for j in range(len(kinds)):
        moving, slip, there = read(change, seen), read(change, seen + 1), read(change, seen + 2)
        at = Instant(moving, slip, there, equation.start, push, beside[0], beside[1], beside[2], equation.body)
        torque, first, second = _term(kinds[j], at, _parameters(parameters, j), _states(state, j))
        total = total + torque
        write(change, TERM_STATES * j, first)
        write(change, TERM_STATES * j + 1, second)
    return total


@lean
def torque_at(rate: Any, angle: Any, push: Any, beside: Any, equation: Any, state: Any, change: Any) -> Any:
    """As ``torque_of``, which is long, as a function of its own: for loops that are not the innermost."""
    return torque_of(rate, angle, push, beside, equation, state, change)


@straight
def _parameters(rows: Any, j: int) -> Any:
    """Of term ``j``."""
    at = TERM_PARAMETERS * j
    return read(rows, at), read(rows, at + 1), read(rows, at + 2), read(rows, at + 3)


@straight
def _states(rows: Any, j: int) -> Any:
    """Of term ``j``."""
    return read(rows, TERM_STATES * j), read(rows, TERM_STATES * j + 1)


@inlined
def jump(rate: Any, equation: Any, state: Any) -> None:
    """Let the states jump that do so at such a ``rate`` in rad/s."""
    terms = equation.terms
    for j in range(terms.remembering if terms.jumping else 0):
        write(state, TERM_STATES * j, _jumped(terms.kinds[j], rate, _states(state, j)))
