"""What filters are given of several models side by side, as lanes."""

from __future__ import annotations

from typing import Any

from rovid.effects.base import Body
from rovid.jit.decorators import inlined
from rovid.jit.simd import LANES, alike, lane, read, with_lane, write
from rovid.jit.tracing import straight
from rovid.model.packed_terms import Equation


@straight
def body_of(numbers: Any) -> Any:
    """In lanes, of (5, LANES) ``numbers``, see `rovid.model.filter_batch.Abreast`."""
    return Body(read(numbers, 0), read(numbers, 1), read(numbers, 2), read(numbers, 3), read(numbers, 4))


@straight
def in_lanes(equation: Any) -> Any:
    """An `rovid.model.packed_terms.Equation` of numbers, the same in all lanes."""
    own = equation.body
    body = Body(
        alike(own.inertia),
        alike(own.quadratic_drag),
        alike(own.linear_drag),
        alike(own.stiffness),
        alike(own.trim),
    )
    return Equation(body, equation.terms, alike(equation.start))


@straight
def each(rows: Any, of_lane: Any, k: int) -> Any:
    """In lanes, the column ``k`` of each one's own of the ``rows``."""
    x = alike(0.0)
    for i in range(LANES):
        x = with_lane(x, i, rows[of_lane[i], k])
    return x


@straight
def beside_of(driven: Any, k: int) -> Any:
    """In lanes, what effects are told of the instant ``k`` beside the torque."""
    race = surge = sway = alike(0.0)
    for i in range(LANES):
        own = driven.told[i]
        race = with_lane(race, i, driven.beside[own, k, 0])
        surge = with_lane(surge, i, driven.beside[own, k, 1])
        sway = with_lane(sway, i, driven.beside[own, k, 2])
    return race, surge, sway


@inlined
def put(table: Any, column: int, x: Any) -> None:
    """Lanes into a ``column`` of a (LANES, N) table; nowhere if that is -1."""
    if column >= 0:
        for i in range(LANES):
            table[i, column] = lane(x, i)


@inlined
def clear(rows: Any) -> None:
    """Write zeros."""
    for j in range(len(rows)):
        write(rows, j, 0.0)
