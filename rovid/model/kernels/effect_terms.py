"""The torque of all terms of the equation of motion at one instant, of several motions side by side."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rovid.effects import TERMS
from rovid.effects.base import TERM_PARAMETERS, TERM_STATES, Instant, Term
from rovid.jit.decorators import njit_inline, njit_noalloc
from rovid.jit.simd import LANES, broadcast, extract, insert, load, store
from rovid.jit.tracing import is_branch_free, switch, traced

# Rows behind the rates of change of the states, in which it is kept what terms look at.
SCRATCH_ROWS = 3


def taking_lanes(function: Callable[..., Any]) -> Callable[..., Any]:
    """``function`` of an instant, parameters and states in lanes: itself, or where it branches lane by lane."""
    if is_branch_free(function):
        return function

    def lane_by_lane(*arguments: Any) -> Any:
        def own(x: Any, i: int) -> Any:
            if not isinstance(x, tuple):
                return extract(x, i)
            each = [own(one, i) for one in x]
            return type(x)(*each) if hasattr(x, "_fields") else tuple(each)

        def abreast(numbers: Any) -> Any:
            if isinstance(numbers[0], tuple):
                return tuple([abreast(column) for column in zip(*numbers, strict=True)])
            x = broadcast(0.0)
            for i in range(LANES):
                x = insert(x, i, numbers[i])
            return x

        return abreast([function(*own(arguments, i)) for i in range(LANES)])

    return traced(lane_by_lane)


def _whole(term: Term) -> Callable[..., Any]:
    """The torque of ``term`` and the changes of as many states as any has, in lanes."""
    torque, states = taking_lanes(term.torque), term.states

    def whole(at: Any, p: Any, x: Any) -> Any:
        given, *changes = torque(at, p, x) if states else (torque(at, p),)
        return (
            broadcast(given),
            *(broadcast(change) for change in changes),
            *([broadcast(0.0)] * (TERM_STATES - states)),
        )

    return whole


def _nothing(at: Any, p: Any, x: Any) -> Any:  # noqa: ARG001 - as any term
    return broadcast(0.0), broadcast(0.0), broadcast(0.0)


def _still(p: Any, x: Any) -> Any:  # noqa: ARG001 - as any that takes the water along
    return broadcast(0.0)


def _stays(rate: Any, x: Any) -> Any:  # noqa: ARG001 - as any that jumps
    return x[0]


# The kind of a term is its index in ``rovid.effects.TERMS``.
_term = switch({kind: _whole(term) for kind, term in enumerate(TERMS)}, _nothing)
_water_of = switch(
    {kind: taking_lanes(term.entrained_rate) for kind, term in enumerate(TERMS) if term.entrained_rate is not None},
    _still,
)
_jumped = switch({kind: taking_lanes(term.reset) for kind, term in enumerate(TERMS) if term.reset is not None}, _stays)


@njit_inline
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
    terms, total = equation.terms, broadcast(0.0)
    kinds, parameters, water = terms.kinds, terms.parameters, broadcast(0.0)
    for j in range(terms.moving):
        water = water + _water_of(kinds[j], _parameters(parameters, j), _states(state, j))
    # Through memory: else what every term makes of these would be worked out beforehand, for terms that are not there.
    seen = TERM_STATES * len(kinds)
    store(change, seen, rate)
    store(change, seen + 1, rate - water)
    store(change, seen + 2, angle)
    for j in range(len(kinds)):
        moving, slip, there = load(change, seen), load(change, seen + 1), load(change, seen + 2)
        at = Instant(moving, slip, there, equation.start, push, beside[0], beside[1], beside[2], equation.body)
        torque, first, second = _term(kinds[j], at, _parameters(parameters, j), _states(state, j))
        total = total + torque
        store(change, TERM_STATES * j, first)
        store(change, TERM_STATES * j + 1, second)
    return total


@njit_noalloc
def torque_at(rate: Any, angle: Any, push: Any, beside: Any, equation: Any, state: Any, change: Any) -> Any:
    """As ``torque_of``, which is long, as a function of its own: for loops that are not the innermost."""
    return torque_of(rate, angle, push, beside, equation, state, change)


@traced
def _parameters(rows: Any, j: int) -> Any:
    """Of term ``j``."""
    at = TERM_PARAMETERS * j
    return load(rows, at), load(rows, at + 1), load(rows, at + 2), load(rows, at + 3)


@traced
def _states(rows: Any, j: int) -> Any:
    """Of term ``j``."""
    return load(rows, TERM_STATES * j), load(rows, TERM_STATES * j + 1)


@njit_inline
def jump(rate: Any, equation: Any, state: Any) -> None:
    """Let the states jump that do so at such a ``rate`` in rad/s."""
    terms = equation.terms
    for j in range(terms.remembering if terms.jumping else 0):
        store(state, TERM_STATES * j, _jumped(terms.kinds[j], rate, _states(state, j)))
