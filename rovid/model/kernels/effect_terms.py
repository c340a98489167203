"""Sum of all terms in the equation of motion at one instant, and the arrays of several models as vectors."""

from collections.abc import Callable
from typing import Any

from rovid.effects import TERMS
from rovid.effects.base import TERM_PARAMETERS, TERM_STATES, Body, Instant, Term
from rovid.effects.further_terms import flattened
from rovid.jit.decorators import call_at, njit_inline, njit_noalloc
from rovid.jit.simd import LANES, broadcast, extract, insert, is_branch_free, load, store, switch, traced
from rovid.model.bound_effects import Equation

# Rows after the derivatives of the states, which hold rate, relative rate and angle while the terms are summed.
SCRATCH_ROWS = 3


def taking_lanes(function: Callable[..., Any]) -> Callable[..., Any]:
    """``function`` of an instant, parameters and states for vectors; if it branches, called for each lane by itself."""
    if is_branch_free(function):
        return function

    def lane_by_lane(*arguments: Any) -> Any:
        def lane(x: Any, i: int) -> Any:
            if not isinstance(x, tuple):
                return extract(x, i)
            members = [lane(one, i) for one in x]
            return type(x)(*members) if hasattr(x, "_fields") else tuple(members)

        def vector(numbers: Any) -> Any:
            if isinstance(numbers[0], tuple):
                return tuple([vector(column) for column in zip(*numbers, strict=True)])
            x = broadcast(0.0)
            for i in range(LANES):
                x = insert(x, i, numbers[i])
            return x

        return vector([function(*lane(arguments, i)) for i in range(LANES)])

    return traced(lane_by_lane)


def _padded(term: Term) -> Callable[..., Any]:
    """The torque of ``term`` and the derivatives of TERM_STATES states, as vectors."""
    torque = taking_lanes(term.torque)

    def without_states(kind: Any, at: Any, p: Any, x: Any) -> Any:  # noqa: ARG001 - as with states
        return broadcast(torque(at, p)), broadcast(0.0), broadcast(0.0)

    def one_state(kind: Any, at: Any, p: Any, x: Any) -> Any:  # noqa: ARG001 - as `_further_term`
        given, first = torque(at, p, x)
        return broadcast(given), broadcast(first), broadcast(0.0)

    def two_states(kind: Any, at: Any, p: Any, x: Any) -> Any:  # noqa: ARG001 - as above
        given, first, second = torque(at, p, x)
        return broadcast(given), broadcast(first), broadcast(second)

    return (without_states, one_state, two_states)[term.states]


def _further_term(kind: Any, at: Any, p: Any, x: Any) -> Any:
    """The same of a term outside the catalogue, whose ``kind`` is the address of its function."""
    return call_at(kind, flattened(at, p, x))


def _still_water(p: Any, x: Any) -> Any:  # noqa: ARG001 - as any entrained rate
    return broadcast(0.0)


def _no_reset(rate: Any, x: Any) -> Any:  # noqa: ARG001 - as any reset
    return x[0]


def _choice(functions: dict[int, Callable[..., Any] | None], otherwise: Callable[..., Any]) -> Callable[..., Any]:
    return switch({kind: taking_lanes(one) for kind, one in functions.items() if one is not None}, otherwise)


# The kind of a term is its index in ``rovid.effects.TERMS``, or an address: see `rovid.effects.further_terms`.
_term = switch({kind: _padded(term) for kind, term in enumerate(TERMS)}, _further_term)
_entrained_rate = _choice({kind: term.entrained_rate for kind, term in enumerate(TERMS)}, _still_water)
_reset = _choice({kind: term.reset for kind, term in enumerate(TERMS)}, _no_reset)


@njit_inline
def sum_terms(
    rate: Any, angle: Any, thruster_torque: Any, effect_inputs: Any, equation: Any, state: Any, derivative: Any
) -> Any:
    """Torque in N m of all terms; writes the derivatives of their states.

    Parameters
    ----------
    rate, angle, thruster_torque
        Vectors, as in `rovid.effects.base.Instant`.
    effect_inputs
        Vectors of wash, surge and sway speed, as there.
    equation
        `rovid.model.bound_effects.Equation` of vectors.
    state, derivative
        (m * TERM_STATES, LANES) of the m terms; ``derivative`` has `SCRATCH_ROWS` more rows.
    """
    terms, total = equation.terms, broadcast(0.0)
    kinds, parameters, water = terms.kinds, terms.parameters, broadcast(0.0)
    for j in range(terms.entraining):
        water = water + _entrained_rate(kinds[j], _parameters(parameters, j), _states(state, j))
    # These pass through memory. LLVM would otherwise compute beforehand what any of the terms makes of them.
    scratch = TERM_STATES * len(kinds)
    store(derivative, scratch, rate)
    store(derivative, scratch + 1, rate - water)
    store(derivative, scratch + 2, angle)
    for j in range(len(kinds)):
        at = Instant(
            load(derivative, scratch),
            load(derivative, scratch + 1),
            load(derivative, scratch + 2),
            equation.start,
            thruster_torque,
            effect_inputs[0],
            effect_inputs[1],
            effect_inputs[2],
            equation.body,
        )
        torque, first, second = _term(kinds[j], kinds[j], at, _parameters(parameters, j), _states(state, j))
        total = total + torque
        store(derivative, TERM_STATES * j, first)
        store(derivative, TERM_STATES * j + 1, second)
    return total


@njit_noalloc
def call_sum_terms(
    rate: Any, angle: Any, thruster_torque: Any, effect_inputs: Any, equation: Any, state: Any, derivative: Any
) -> Any:
    """`sum_terms` without inlining, for loops that are not the innermost."""
    return sum_terms(rate, angle, thruster_torque, effect_inputs, equation, state, derivative)


@traced
def _parameters(rows: Any, j: int) -> Any:
    """Parameters of term ``j``."""
    at = TERM_PARAMETERS * j
    return load(rows, at), load(rows, at + 1), load(rows, at + 2), load(rows, at + 3)


@traced
def _states(rows: Any, j: int) -> Any:
    """States of term ``j``."""
    return load(rows, TERM_STATES * j), load(rows, TERM_STATES * j + 1)


@njit_inline
def reset_states(rate: Any, equation: Any, state: Any) -> None:
    """Reset the states of terms that do so at this ``rate`` in rad/s."""
    terms = equation.terms
    for j in range(terms.stateful if terms.resetting else 0):
        store(state, TERM_STATES * j, _reset(terms.kinds[j], rate, _states(state, j)))


@traced
def load_body(numbers: Any) -> Any:
    """A `Body` of vectors from its (5, LANES) numbers."""
    return Body(load(numbers, 0), load(numbers, 1), load(numbers, 2), load(numbers, 3), load(numbers, 4))


@traced
def broadcast_equation(equation: Any) -> Any:
    """An `Equation` of numbers with the same numbers in all lanes."""
    own = equation.body
    body = Body(
        broadcast(own.inertia),
        broadcast(own.quadratic_drag),
        broadcast(own.linear_drag),
        broadcast(own.stiffness),
        broadcast(own.trim),
    )
    return Equation(body, equation.terms, broadcast(equation.start))


@traced
def gather(rows: Any, row_of_lane: Any, column: int) -> Any:
    """A vector of ``rows[row_of_lane[i], column]`` for each lane i."""
    x = broadcast(0.0)
    for i in range(LANES):
        x = insert(x, i, rows[row_of_lane[i], column])
    return x


@traced
def gather_effect_inputs(inputs: Any, k: int) -> Any:
    """Vectors of wash, surge and sway speed at instant ``k`` from `rovid.model.filter_batch.FilterInputs`."""
    wash = surge = sway = broadcast(0.0)
    for i in range(LANES):
        own = inputs.input_index[i]
        wash = insert(wash, i, inputs.effect_inputs[own, k, 0])
        surge = insert(surge, i, inputs.effect_inputs[own, k, 1])
        sway = insert(sway, i, inputs.effect_inputs[own, k, 2])
    return wash, surge, sway


@njit_inline
def store_column(table: Any, column: int, x: Any) -> None:
    """Write a vector to a column of a (LANES, n) table; nowhere if ``column`` is -1."""
    if column >= 0:
        for i in range(LANES):
            table[i, column] = extract(x, i)


@njit_inline
def clear_rows(rows: Any) -> None:
    """Write zeros."""
    for j in range(len(rows)):
        store(rows, j, 0.0)


@njit_inline
def fill_rows(rows: Any, numbers: Any, at: int) -> None:
    """Write the numbers of row ``at`` of an (m, n) table to the first n rows, the same in all lanes."""
    for j in range(numbers.shape[1]):
        store(rows, j, broadcast(numbers[at, j]))


@njit_inline
def copy_rows(count: int, source: Any, target: Any) -> None:
    """Copy the first ``count`` rows."""
    for j in range(count):
        store(target, j, load(source, j))
