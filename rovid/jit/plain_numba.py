"""Backend in plain numba: a vector is a structure of four numbers, and functions are compiled as they are.

Only numba's public extension interface is used. This backend takes over if a numba release changes the private modules
that the LLVM backend needs, or if the environment variable ROVID_PLAIN_NUMBA is 1. The results agree to rounding.
Compiling takes several times as long.
"""

# mypy: allow-untyped-calls, allow-untyped-decorators

import math
import operator
from collections.abc import Callable, Mapping
from typing import Any, TypeVar

import numpy as np
from numba import types
from numba.extending import (
    intrinsic,
    lower_cast,
    make_attribute_wrapper,
    models,
    overload,
    register_jitable,
    register_model,
)

from rovid.jit.simd import broadcast, exp, extract, insert, load, maximum, minimum, sqrt, store, where_nonnegative

Function = TypeVar("Function", bound=Callable[..., Any])
# Names of the numbers in a vector.
_FIELDS = ("a", "b", "c", "d")
_OPTIONS = {"error_model": "numpy"}


class _StructType(types.Type):
    def __init__(self) -> None:
        super().__init__(name="PlainFloat64x4")


_VECTOR = _StructType()


@register_model(_StructType)
class _StructVectorModel(models.StructModel):
    def __init__(self, manager: Any, numba_type: _StructType) -> None:
        super().__init__(manager, numba_type, [(name, types.float64) for name in _FIELDS])


for _name in _FIELDS:
    make_attribute_wrapper(_StructType, _name, _name)


def _vector_of(_: Any, a: Any, b: Any, c: Any, d: Any) -> Any:  # noqa: ARG001 - numba reads the names
    def build(context: Any, builder: Any, sig: Any, values: Any) -> Any:
        made = context.make_helper(builder, sig.return_type)
        for name, value in zip(_FIELDS, values, strict=True):
            setattr(made, name, value)
        return made._getvalue()  # noqa: SLF001 - part of numba's documented interface

    return _VECTOR(*[types.float64] * len(_FIELDS)), build


# (a, b, c, d) -> vector, in compiled code.
_vector: Any = intrinsic(_vector_of)


@lower_cast(types.Number, _StructType)
def _broadcast_number(context: Any, builder: Any, source: Any, target: Any, value: Any) -> Any:
    made = context.make_helper(builder, target)
    for name in _FIELDS:
        setattr(made, name, context.cast(builder, value, source, types.float64))
    return made._getvalue()  # noqa: SLF001 - as above


def _is_vector(*arguments: Any) -> bool:
    return any(isinstance(one, _StructType) for one in arguments)


@overload(broadcast, strict=False)
def _broadcast(x: Any) -> Any:
    if _is_vector(x):
        return lambda x: x
    return lambda x: _vector(x, x, x, x)


@overload(extract, strict=False)
def _extract(x: Any, i: Any) -> Any:  # noqa: ARG001 - numba reads the names
    def lane(x: Any, i: Any) -> Any:
        if i == 0:
            return x.a
        if i == 1:
            return x.b
        return x.c if i == 2 else x.d

    return lane


@overload(insert, strict=False)
def _insert(x: Any, i: Any, value: Any) -> Any:  # noqa: ARG001 - as above
    def changed(x: Any, i: Any, value: Any) -> Any:
        number = float(value)
        return _vector(
            number if i == 0 else x.a, number if i == 1 else x.b, number if i == 2 else x.c, number if i == 3 else x.d
        )

    return changed


@overload(load, strict=False)
def _load(rows: Any, at: Any) -> Any:  # noqa: ARG001 - as above
    if rows.ndim != 2 or rows.layout != "C":
        return None
    return lambda rows, at: _vector(rows[at, 0], rows[at, 1], rows[at, 2], rows[at, 3])


@overload(store, strict=False)
def _store(rows: Any, at: Any, x: Any) -> Any:  # noqa: ARG001 - as above
    if rows.ndim != 2 or rows.layout != "C":
        return None

    def write(rows: Any, at: Any, x: Any) -> None:
        vector = broadcast(x)
        rows[at, 0], rows[at, 1], rows[at, 2], rows[at, 3] = vector.a, vector.b, vector.c, vector.d

    return write


def _register_unary(function: Any, scalar: Any) -> None:
    """Let compiled code call ``function`` with a vector: ``scalar`` of each lane."""
    if scalar is not function:

        @overload(function, strict=False)
        def of_number(x: Any) -> Any:
            return (lambda x: scalar(float(x))) if isinstance(x, types.Number) else None

    @overload(function, strict=False)
    def of_vector(x: Any) -> Any:
        if not _is_vector(x):
            return None
        return lambda x: _vector(scalar(x.a), scalar(x.b), scalar(x.c), scalar(x.d))


def _register_binary(function: Any, scalar: Any) -> None:
    if scalar is not function:

        @overload(function, strict=False)
        def of_numbers(x: Any, y: Any) -> Any:
            if not (isinstance(x, types.Number) and isinstance(y, types.Number)):
                return None
            return lambda x, y: scalar(float(x), float(y))

    @overload(function, strict=False)
    def of_vectors(x: Any, y: Any) -> Any:
        if not _is_vector(x, y):
            return None

        def lanes(x: Any, y: Any) -> Any:
            p, q = broadcast(x), broadcast(y)
            return _vector(scalar(p.a, q.a), scalar(p.b, q.b), scalar(p.c, q.c), scalar(p.d, q.d))

        return lanes


@register_jitable(**_OPTIONS)
def _larger(x: float, y: float) -> float:
    return y if x <= y else x


@register_jitable(**_OPTIONS)
def _smaller(x: float, y: float) -> float:
    return y if x >= y else x


@register_jitable(**_OPTIONS)
def _choice(x: float, y: float, otherwise: float) -> float:
    return y if x >= 0.0 else otherwise


@overload(where_nonnegative, strict=False)
def _where_nonnegative(x: Any, y: Any, otherwise: Any) -> Any:
    if not _is_vector(x, y, otherwise):
        return lambda x, y, otherwise: _choice(float(x), float(y), float(otherwise))

    def lanes(x: Any, y: Any, otherwise: Any) -> Any:
        p, q, r = broadcast(x), broadcast(y), broadcast(otherwise)
        return _vector(_choice(p.a, q.a, r.a), _choice(p.b, q.b, r.b), _choice(p.c, q.c, r.c), _choice(p.d, q.d, r.d))

    return lanes


_BINARY: tuple[Any, ...] = (operator.add, operator.sub, operator.mul, operator.truediv, math.pow)
_UNARY: tuple[Any, ...] = (operator.neg, abs, math.exp, math.tanh, math.sin, math.cos, math.tan, math.atan, math.log)
for _function in _BINARY:
    _register_binary(_function, _function)
_register_binary(maximum, _larger)
_register_binary(minimum, _smaller)
for _function in _UNARY:
    _register_unary(_function, _function)
_register_unary(sqrt, math.sqrt)
_register_unary(exp, math.exp)


@overload(math.floor, strict=False)
def _floor(x: Any) -> Any:
    if not _is_vector(x):
        return None
    return lambda x: _vector(np.floor(x.a), np.floor(x.b), np.floor(x.c), np.floor(x.d))


def traced(function: Function) -> Function:
    """Let compiled code call ``function`` too."""
    register_jitable(**_OPTIONS)(function)
    return function


def switch(functions: Mapping[int, Callable[..., Any]], otherwise: Callable[..., Any]) -> Callable[..., Any]:
    """(number, ...) -> result of the function with that number. All functions return the same type."""
    names: dict[str, Any] = {f"function_{number}": _callable(function) for number, function in functions.items()}
    names["otherwise"] = _callable(otherwise)
    # Numba compiles no mapping of functions: the choice is written out.
    lines = ["def chosen(number, *arguments):"]
    lines += [f"    if number == {number}:\n        return function_{number}(*arguments)" for number in functions]
    exec("\n".join([*lines, "    return otherwise(*arguments)"]), names)  # noqa: S102 - the source is made here
    chosen: Callable[..., Any] = names["chosen"]
    return traced(chosen)


def _callable(function: Any) -> Any:
    return function if hasattr(function, "py_func") else traced(function)


def is_branch_free(function: Any) -> bool:  # noqa: ARG001 - as in the other backend
    """Whether ``function`` accepts vectors: all functions of the catalogue do, as a test makes sure."""
    return True
