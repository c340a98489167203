"""The torque of all terms of the equation of motion at one instant."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numba

from rovid.effects import TERMS
from rovid.effects.base import Instant
from rovid.ground.compiled import compiled, inlined

# What a term gives, by how many states it has: its torque and how two states change.
_GIVES = ("{}(at, p), 0.0, 0.0", "{}(at, p, x) + (0.0,)", "{}(at, p, x)")


def _any_of(takes: str, gives: Mapping[int, str], functions: Mapping[int, Callable[..., Any]], otherwise: str) -> Any:
    """Compiled; of a ``kind``, before what it ``takes``, what it ``gives`` by its function; ``otherwise`` of any other.

    As a chain of comparisons, which compiles to one jump: numba's own loop over functions takes ten times as long.
    """
    lines = [f"def any_of(kind, {takes}):"]
    lines += [f"    if kind == {kind}: return {text.format(f'function_{kind}')}" for kind, text in gives.items()]
    namespace: dict[str, Any] = {f"function_{kind}": function for kind, function in functions.items()}
    exec("\n".join((*lines, f"    return {otherwise}")), namespace)  # noqa: S102 - all of it is above
    return numba.njit(error_model="numpy", nogil=True, inline="always")(namespace["any_of"])


# The kind of a term is its index in ``rovid.effects.TERMS``.
_term = _any_of(
    "at, p, x",
    {kind: _GIVES[term.states] for kind, term in enumerate(TERMS)},
    {kind: term.torque for kind, term in enumerate(TERMS)},
    "0.0, 0.0, 0.0",
)
_MOVING = {kind: term.water for kind, term in enumerate(TERMS) if term.water is not None}
water_of = _any_of("p, x", dict.fromkeys(_MOVING, "{}(p, x)"), _MOVING, "0.0")
_JUMPING = {kind: term.jumps for kind, term in enumerate(TERMS) if term.jumps is not None}
jumped = _any_of("rate, x", dict.fromkeys(_JUMPING, "{}(rate, x)"), _JUMPING, "x[0]")


@inlined
def numbers_of(terms: Any, j: int) -> Any:
    """Parameters of term ``j``."""
    row = terms.parameters[j]
    return row[0], row[1], row[2], row[3]


@compiled
def torque_of(rate: float, angle: float, push: float, beside: Any, equation: Any, state: Any, change: Any) -> float:
    """Torque in N m of all terms of ``equation``; fills in the rates of ``change`` of their states.

    Parameters
    ----------
    rate, angle, push
        As in `rovid.effects.base.Instant`.
    beside
        The thrusters' race and the speeds, as there.
    equation
        `rovid.model.equation.Equation`.
    state, change
        (m, TERM_STATES).
    """
    terms, water = equation.terms, 0.0
    kinds = terms.kinds
    for j in range(terms.moving):
        p = numbers_of(terms, j)
        water += water_of(kinds[j], p, (state[j, 0], state[j, 1]))
    at = Instant(rate, rate - water, angle, equation.start, push, beside[0], beside[1], beside[2], equation.body)
    total = 0.0
    for j in range(len(kinds)):
        p = numbers_of(terms, j)
        torque, first, second = _term(kinds[j], at, p, (state[j, 0], state[j, 1]))
        total += torque
        change[j, 0], change[j, 1] = first, second
    return total


@inlined
def jump(rate: float, equation: Any, state: Any) -> None:
    """Let the states jump that do so at such a ``rate`` in rad/s."""
    terms = equation.terms
    for j in range(terms.remembering if terms.jumping else 0):
        state[j, 0] = jumped(terms.kinds[j], rate, (state[j, 0], state[j, 1]))
