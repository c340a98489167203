"""What filters are given of several models side by side, as lanes."""

from __future__ import annotations

from typing import Any

from rovid.effects.base import Body
from rovid.jit.decorators import njit_inline
from rovid.jit.simd import LANES, broadcast, extract, insert, load, store
from rovid.jit.tracing import traced
from rovid.model.packed_terms import Equation


@traced
def body_of(numbers: Any) -> Any:
    """In lanes, of (5, LANES) ``numbers``, see `rovid.model.filter_batch.Abreast`."""
    return Body(load(numbers, 0), load(numbers, 1), load(numbers, 2), load(numbers, 3), load(numbers, 4))


@traced
def in_lanes(equation: Any) -> Any:
    """An `rovid.model.packed_terms.Equation` of numbers, the same in all lanes."""
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
def each(rows: Any, of_lane: Any, k: int) -> Any:
    """In lanes, the column ``k`` of each one's own of the ``rows``."""
    x = broadcast(0.0)
    for i in range(LANES):
        x = insert(x, i, rows[of_lane[i], k])
    return x


@traced
def beside_of(driven: Any, k: int) -> Any:
    """In lanes, what effects are told of the instant ``k`` beside the torque."""
    race = surge = sway = broadcast(0.0)
    for i in range(LANES):
        own = driven.told[i]
        race = insert(race, i, driven.beside[own, k, 0])
        surge = insert(surge, i, driven.beside[own, k, 1])
        sway = insert(sway, i, driven.beside[own, k, 2])
    return race, surge, sway


@njit_inline
def put(table: Any, column: int, x: Any) -> None:
    """Lanes into a ``column`` of a (LANES, N) table; nowhere if that is -1."""
    if column >= 0:
        for i in range(LANES):
            table[i, column] = extract(x, i)


@njit_inline
def clear(rows: Any) -> None:
    """Write zeros."""
    for j in range(len(rows)):
        store(rows, j, 0.0)
