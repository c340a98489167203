"""Arrays of several models, runs or restarts, read into vectors and written from them."""

from __future__ import annotations

from typing import Any

from rovid.effects.base import Body
from rovid.jit.decorators import njit_inline
from rovid.jit.simd import LANES, broadcast, extract, insert, load, store, traced
from rovid.model.bound_effects import Equation


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
