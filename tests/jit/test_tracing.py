"""Traced functions in compiled loops."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numba
import numpy as np
import pytest

from rovid.jit.decorators import compiled
from rovid.jit.simd import (
    LANES,
    broadcast,
    exp,
    insert,
    is_branch_free,
    load,
    maximum,
    store,
    switch,
    traced,
    where_nonnegative,
)

RNG = np.random.default_rng(4)
ROWS = RNG.uniform(0.2, 2.0, (6, LANES))
FACTOR = 1.7


class Pair(NamedTuple):
    left: Any
    right: Any


@compiled
def _helper(x: float) -> float:
    return math.exp(-x) + FACTOR * x


@compiled
def _branching(x: float) -> float:
    return 2.0 * x if x > 1.0 else -x


@compiled
def _summed(rows: Any) -> Any:
    total = 0.0
    for number in rows[0]:
        total += number
    return total


@traced
def _operators(rows: Any) -> Any:
    x, y = load(rows, 0), load(rows, 1)
    return (2.0 - x) / y + x * y - abs(-x) / 3.0 + 1.0 / x + (x - 1)


@traced
def _calling(rows: Any) -> Any:
    x = load(rows, 0)
    return maximum(_operators(rows), 0.1) + exp(-x) * math.pi + _summed(rows) + math.sin(FACTOR)


@traced
def _unrolled(rows: Any) -> Any:
    sums = [broadcast(0.0), broadcast(1.0)]
    for j in range(len(ROWS)):
        if j % 2 == 0:
            sums[j % 2] = sums[j % 2] + float(j) * load(rows, j)
    x = sums[0]
    for i in range(LANES):
        x = insert(x, i, rows[i, 0] * rows[0, 1])
    return x + sums[1]


@traced
def _tuples(rows: Any) -> Any:
    def swapped(pair: Pair) -> Pair:
        return Pair(pair.right, pair.left)

    inside = swapped(Pair(load(rows, 0), (load(rows, 1), FACTOR)))
    return inside.left[0] * inside.left[1] + inside.right


@traced
def _writing(rows: Any) -> Any:
    store(rows, 2, load(rows, 0) + 1.0)
    store(rows, 3, 5.0)
    return load(rows, 2) * load(rows, 3)


@traced
def _constant(rows: Any) -> Any:
    return broadcast(2.5)


@pytest.mark.parametrize("function", [_operators, _calling, _unrolled, _tuples, _writing, _constant])
def test_a_traced_function_gives_the_same_compiled_and_uncompiled(function: Callable[..., Any]) -> None:
    @numba.njit(error_model="numpy")
    def run(rows: Any, out: Any) -> None:
        store(out, 0, function(rows))

    here, there, out = ROWS.copy(), ROWS.copy(), np.empty((1, LANES))
    run(here, out)
    np.testing.assert_allclose(out[0], function(there), rtol=1e-14)
    np.testing.assert_allclose(here, there, rtol=1e-15)


@traced
def _helped(x: Any) -> Any:
    return _helper(x) * 2.0


def test_a_compiled_function_accepts_vectors() -> None:
    @numba.njit(error_model="numpy")
    def run(rows: Any, out: Any) -> None:
        store(out, 0, _helped(load(rows, 0)))

    out = np.empty((1, LANES))
    run(ROWS, out)
    np.testing.assert_allclose(out[0], 2.0 * (np.exp(-ROWS[0]) + FACTOR * ROWS[0]), rtol=1e-14)


@traced
def _of_numbers(x: float, pair: Pair) -> tuple[float, Pair, float]:
    return x * pair.left, Pair(pair.right, where_nonnegative(x, 1.0, pair.left)), _branching(x)


def test_traced_functions_of_numbers_and_tuples() -> None:
    @numba.njit
    def run(x: float, pair: Pair) -> Any:
        return _of_numbers(x, pair)

    for x in (3.0, -2.0):
        assert run(x, Pair(2.0, 7)) == _of_numbers(x, Pair(2.0, 7))
        assert isinstance(run(x, Pair(2.0, 7))[1], Pair)


@traced
def _asking(x: float) -> float:
    return x if x else 1.0


@traced
def _comparing(x: float) -> float:
    return x if x == 2.0 else 1.0


@traced
def _ordering(x: float) -> float:
    return max(x, 1.0)


@pytest.mark.parametrize("function", [_asking, _comparing, _ordering])
def test_a_traced_function_cannot_branch_on_a_number(function: Callable[..., Any]) -> None:
    """Nor is it compiled to something else."""

    def run(x: float) -> None:
        function(x)

    loop: Any = numba.njit(run)
    with pytest.raises(TypeError):
        loop(2.0)


def test_branch_free_functions_are_recognised() -> None:
    @compiled
    def calls(x: float) -> float:
        return _branching(x)

    assert is_branch_free(_operators)
    assert is_branch_free(_helper)
    assert not is_branch_free(_branching)
    assert not is_branch_free(calls)
    assert not is_branch_free(math.exp)


def _double(x: Any, y: Any) -> Any:
    return x + x, y


def _product(x: Any, y: Any) -> Any:
    return x * y, y / x


def _other(x: Any, y: Any) -> Any:
    return broadcast(0.0), y


CHOSEN = switch({0: _double, 3: _product}, _other)


def test_switch() -> None:
    @numba.njit
    def run(kinds: Any, rows: Any, out: Any) -> None:
        for j in range(len(kinds)):
            first, second = CHOSEN(kinds[j], load(rows, 0), load(rows, 1))
            store(out, 2 * j, first)
            store(out, 2 * j + 1, second)

    kinds, wanted = np.array([3, 0, 1, -1, 3]), np.empty((10, LANES))
    out = np.empty_like(wanted)
    run(kinds, ROWS, out)
    run.py_func(kinds, ROWS, wanted)
    np.testing.assert_array_equal(out, wanted)
    np.testing.assert_array_equal(wanted[0], ROWS[0] * ROWS[1])
    np.testing.assert_array_equal(wanted[4:8:2], np.zeros((2, LANES)))
