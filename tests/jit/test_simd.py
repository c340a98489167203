"""Functions of the vector against numpy, compiled and uncompiled."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numba
import numpy as np
import pytest

from rovid.core.array_types import FloatArray
from rovid.jit.simd import (
    LANES,
    broadcast,
    exp,
    extract,
    insert,
    load,
    maximum,
    minimum,
    nan_unless_below,
    reduce_max,
    sqrt,
    store,
    where_nonnegative,
)

RNG = np.random.default_rng(3)
# One that may be negative, and two that are not.
X, Y, Z = RNG.normal(size=LANES), RNG.uniform(0.5, 2.0, LANES), RNG.uniform(0.5, 2.0, LANES)
X[:2] = -0.7, 0.4
ROWS = np.stack([X, Y, Z])
Function = Callable[..., Any]


def _chosen(x: Any, y: Any, z: Any) -> Any:
    return where_nonnegative(x, y, z)


OPERATORS: dict[str, tuple[Function, FloatArray]] = {
    "add": (lambda x, y, z: x + y, X + Y),
    "subtract": (lambda x, y, z: x - y, X - Y),
    "multiply": (lambda x, y, z: x * y, X * Y),
    "divide": (lambda x, y, z: x / y, X / Y),
    "negative": (lambda x, y, z: -x, -X),
    "absolute": (lambda x, y, z: abs(x), np.abs(X)),
    "a number first": (lambda x, y, z: 2.0 - x, 2.0 - X),
    "a number last": (lambda x, y, z: x / 3, X / 3.0),
    "several": (lambda x, y, z: x * y + z, X * Y + Z),
    "larger": (lambda x, y, z: maximum(x, y), np.maximum(X, Y)),
    "smaller": (lambda x, y, z: minimum(x, 0.0), np.minimum(X, 0.0)),
    "where positive": (_chosen, np.where(X >= 0.0, Y, Z)),
    "where positive, a number": (lambda x, y, z: where_nonnegative(x, 0.0, -y), np.where(X >= 0.0, 0.0, -Y)),
    "root": (lambda x, y, z: sqrt(y), np.sqrt(Y)),
    "exponential": (lambda x, y, z: exp(x), np.exp(X)),
    "alike": (lambda x, y, z: broadcast(2.5), np.full(LANES, 2.5)),
    "alike of lanes": (lambda x, y, z: broadcast(x), X),
    "with lane": (lambda x, y, z: insert(x, 2, 7.0), np.where(np.arange(LANES) == 2, 7.0, X)),
}
FUNCTIONS: dict[str, tuple[Function, FloatArray]] = {
    "sin": (lambda x, y, z: math.sin(x), np.sin(X)),
    "cos": (lambda x, y, z: math.cos(x), np.cos(X)),
    "tan": (lambda x, y, z: math.tan(x), np.tan(X)),
    "atan": (lambda x, y, z: math.atan(x), np.arctan(X)),
    "tanh": (lambda x, y, z: math.tanh(x), np.tanh(X)),
    "exp": (lambda x, y, z: math.exp(x), np.exp(X)),
    "log": (lambda x, y, z: math.log(y), np.log(Y)),
    "pow": (lambda x, y, z: math.pow(y, x), Y**X),
    "pow by a number": (lambda x, y, z: math.pow(y, 1.7), Y**1.7),
    "floor": (lambda x, y, z: math.floor(x), np.floor(X)),
}


def asked(function: Function, rows: FloatArray) -> FloatArray:
    """What a compiled ``function`` of three lanes gives."""
    inner = numba.njit(error_model="numpy")(function)

    @numba.njit(error_model="numpy")
    def run(rows: Any, out: Any) -> None:
        store(out, 0, inner(load(rows, 0), load(rows, 1), load(rows, 2)))

    out = np.empty((1, LANES))
    run(rows, out)
    return np.asarray(out[0])


def asked_of_each(function: Function, numbers: FloatArray) -> FloatArray:
    """What a compiled ``function`` gives of each of as many ``numbers`` as fill some lanes."""

    @numba.njit(error_model="numpy")
    def run(rows: Any, out: Any) -> None:
        for at in range(len(rows)):
            store(out, at, function(load(rows, at)))

    out = np.empty((len(numbers) // LANES, LANES))
    run(numbers.reshape(out.shape), out)
    return out.ravel()


@pytest.mark.parametrize("name", [*OPERATORS, *FUNCTIONS])
def test_compiled_functions_agree_with_numpy(name: str) -> None:
    function, wanted = (OPERATORS | FUNCTIONS)[name]
    # Of the mathematical library each may round the last digit otherwise.
    np.testing.assert_allclose(asked(function, ROWS), wanted, rtol=1e-14)


def test_exponentials_over_the_whole_range() -> None:
    rows = np.concatenate((RNG.uniform(-744.0, 710.0, 4000), RNG.normal(size=4000), RNG.normal(scale=1e-6, size=4000)))
    found = np.array([asked_of_each(math.exp, rows), asked_of_each(math.tanh, rows)])
    with np.errstate(over="ignore", under="ignore"):
        wanted = np.exp(rows)
    np.testing.assert_allclose(found[0], wanted, rtol=1e-15, atol=1e-305)
    np.testing.assert_allclose(found[1], np.tanh(rows), rtol=0.0, atol=4e-16)


def test_exponentials_of_nan_and_infinity() -> None:
    rows = np.array([math.nan, math.inf, -math.inf, 0.0])
    np.testing.assert_array_equal(asked_of_each(math.exp, rows), [math.nan, math.inf, 0.0, 1.0])
    np.testing.assert_array_equal(asked_of_each(math.tanh, rows), [math.nan, 1.0, -1.0, 0.0])


def test_sines_up_to_a_million_turns() -> None:
    quarters = 0.5 * math.pi * np.arange(-400, 400)
    rows = np.concatenate(
        (RNG.uniform(-6e6, 6e6, 4000), RNG.normal(scale=3.0, size=4000), RNG.normal(scale=1e-6, size=4000), quarters)
    )
    found = np.array([asked_of_each(math.sin, rows), asked_of_each(math.cos, rows)])
    np.testing.assert_allclose(found, [np.sin(rows), np.cos(rows)], rtol=0.0, atol=3e-16)


def test_sines_of_nan_and_infinity() -> None:
    rows = np.array([math.nan, math.inf, -math.inf, 0.0])
    np.testing.assert_array_equal(asked_of_each(math.sin, rows), [math.nan, math.nan, math.nan, 0.0])
    np.testing.assert_array_equal(asked_of_each(math.cos, rows), [math.nan, math.nan, math.nan, 1.0])


@pytest.mark.parametrize("name", OPERATORS)
def test_uncompiled_functions_agree_with_numpy(name: str) -> None:
    function, wanted = OPERATORS[name]
    before = ROWS.copy()
    np.testing.assert_allclose(function(*(load(ROWS, at) for at in range(3))), wanted, rtol=1e-15)
    np.testing.assert_array_equal(ROWS, before)


@pytest.mark.parametrize(
    ("formula", "numbers", "wanted"),
    [
        (lambda x, y, z: maximum(x, y), (-1.0, 2.0, 0.0), 2.0),
        (lambda x, y, z: minimum(x, y), (-1.0, 2.0, 0.0), -1.0),
        (lambda x, y, z: sqrt(x), (2.25, 0.0, 0.0), 1.5),
        (_chosen, (0.0, 3.0, 4.0), 3.0),
        (_chosen, (-1e-9, 3.0, 4.0), 4.0),
        (_chosen, (math.nan, 3.0, 4.0), 4.0),
    ],
)
def test_functions_accept_numbers(formula: Function, numbers: tuple[float, ...], wanted: float) -> None:
    compiled: Any = numba.njit(formula)
    for one in (formula, compiled):
        found = one(*numbers)
        assert isinstance(found, float)
        assert found == wanted


def test_integers_are_broadcast() -> None:
    np.testing.assert_array_equal(asked(lambda x, y, z: x + 2, ROWS), X + 2.0)
    np.testing.assert_array_equal(asked(lambda x, y, z: broadcast(3), ROWS), np.full(LANES, 3.0))


@pytest.mark.parametrize("missing", [0, LANES - 1])
def test_reduce_max_ignores_nan(missing: int) -> None:
    numbers = np.where(np.arange(LANES) == missing, np.nan, np.arange(LANES) - 10.0)

    @numba.njit
    def run(rows: Any) -> float:
        return float(reduce_max(load(rows, 0)))

    for one in (run(numbers[np.newaxis]), reduce_max.py_func(numbers)):
        assert one == np.nanmax(numbers)
    assert reduce_max.py_func(np.full(LANES, np.nan)) == run(np.full((1, LANES), np.nan)) == -math.inf


def test_nan_unless_below() -> None:
    size = np.array([0.5, math.nan, math.inf, 1.0, *np.zeros(LANES - 4)])
    wanted = np.where(size < 1.0, X, np.nan)
    np.testing.assert_array_equal(asked(lambda x, y, z: nan_unless_below(x, y, 1.0), np.stack([X, size, Z])), wanted)
    np.testing.assert_array_equal(nan_unless_below.py_func(X, size, 1.0), wanted)


@numba.njit
def _second_lane(rows: Any) -> float:
    return float(extract(load(rows, 1), 2))


@numba.njit
def _spread_over(rows: Any) -> None:
    store(rows, 1, 4.0)


def test_load_and_store() -> None:
    rows = ROWS.copy()
    assert _second_lane(rows) == _second_lane.py_func(rows) == Y[2]
    for spread_over in (_spread_over, _spread_over.py_func):
        rows = ROWS.copy()
        spread_over(rows)
        np.testing.assert_array_equal(rows, np.stack([X, np.full(LANES, 4.0), Z]))


def test_a_loaded_vector_is_a_copy() -> None:
    rows = ROWS.copy()
    row = load(rows, 0)
    store(rows, 0, Y)
    np.testing.assert_array_equal(row, X)
    np.testing.assert_array_equal(insert(row, 0, 1.0)[1:], X[1:])
    np.testing.assert_array_equal(row, X)


@pytest.mark.parametrize("rows", [np.zeros((LANES, 2)).T, np.zeros((2, 2 * LANES))[:, ::2], np.zeros(LANES)])
def test_rows_that_are_not_contiguous_are_refused(rows: FloatArray) -> None:
    with pytest.raises(numba.core.errors.TypingError):
        _spread_over(rows)
    with pytest.raises(numba.core.errors.TypingError):
        _second_lane(rows)


def test_vectors_have_no_in_place_operators() -> None:
    """Uncompiled that would change the lanes of whoever else holds them."""

    def add(x: Any, y: Any, z: Any) -> Any:
        x += y
        return x

    with pytest.raises(numba.core.errors.TypingError):
        asked(add, ROWS)
