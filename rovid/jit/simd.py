"""Several numbers side by side, which a compiled loop works on at once (single instruction, multiple data).

In compiled code lanes are one vector register, or as many as the machine needs. What is here takes plain numbers too,
so that a formula is written once. Where nothing is compiled lanes are small numpy arrays.
"""

from __future__ import annotations

import math
import operator
from collections.abc import Callable
from typing import Any, TypeVar

import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.datamodel.models import PrimitiveModel
from numba.core.imputils import lower_builtin, lower_cast
from numba.core.typing.templates import AbstractTemplate, infer_global, signature
from numba.extending import register_model

from rovid.core.array_types import FloatArray
from rovid.jit.decorators import njit_inline

# A number, or lanes.
Number = TypeVar("Number", float, FloatArray)
# So many; more are no faster on the usual machines.
LANES = 4
_VECTOR = ir.VectorType(ir.DoubleType(), LANES)
_INDEX = ir.IntType(32)
# A product may go into the sum behind it without being rounded (fused multiply-add).
_FLAGS = ("contract",)
# Added and taken away again this rounds a double to a whole number.
_ROUNDS = 1.5 * 2.0**52
_PER_LN_2, _LN_2, _LN_2_REST = 1.4426950408889634, 0.693147180369123816490, 1.90821492927058770002e-10
_PER_QUARTER = 2.0 / math.pi
_QUARTER, _QUARTER_REST, _QUARTER_LAST = 1.57079632673412561417, 6.07710050630396597660e-11, 2.02226624879595063154e-21
# Beyond these the exponential of a double is zero or infinite.
_LEAST, _MOST = -746.0, 710.0
_TAYLOR = tuple(1.0 / math.factorial(k) for k in range(17))


class Float64x4Type(types.Type):
    """Of `LANES` numbers side by side, in compiled code."""

    def __init__(self) -> None:
        super().__init__(name=f"Lanes({LANES})")


_LANES = Float64x4Type()


@register_model(Float64x4Type)
class _Register(PrimitiveModel):
    def __init__(self, manager: Any, lanes: Float64x4Type) -> None:
        super().__init__(manager, lanes, _VECTOR)  # type: ignore[no-untyped-call]  # numba ships no types


def broadcast(x: Any) -> Any:
    """Lanes that all hold the number ``x``; lanes as they are."""
    return np.full(LANES, x) if np.ndim(x) == 0 else x


def extract(x: Any, i: int) -> float:
    """The number in lane ``i``."""
    return float(x[i])


def insert(x: Any, i: int, value: float) -> Any:
    """``x`` with another number in lane ``i``."""
    changed = x.copy()
    changed[i] = value
    return changed


def maximum(x: Number, y: Number) -> Number:
    """Of each lane the larger number."""
    return np.maximum(x, y)  # type: ignore[no-any-return]  # of the same kind, which numpy does not tell


def minimum(x: Number, y: Number) -> Number:
    """Of each lane the smaller number."""
    return np.minimum(x, y)  # type: ignore[no-any-return]  # as above


def where_nonnegative(x: Number, y: Number, otherwise: Number) -> Number:
    """Of each lane ``y`` where ``x`` is zero or more, else the other."""
    # No array of a single number.
    return np.where(x >= 0.0, y, otherwise)[()]  # type: ignore[return-value]  # as above


def sqrt(x: Number) -> Number:
    """Square root of each lane."""
    return np.sqrt(x)  # type: ignore[no-any-return]  # as above


def exp(x: Any) -> Any:
    """As ``math.exp``, which takes no lanes where nothing is compiled."""
    return np.exp(x)


def exp2(x: Any) -> Any:
    """Two to the power of each lane, which are whole numbers from -1022 to 1023."""
    return np.exp2(x)


def load(rows: Any, at: int) -> Any:
    """Lanes from the row ``at`` of (m, LANES) numbers without gaps."""
    return rows[at].copy()


def store(rows: Any, at: int, x: Any) -> None:
    """Store lanes, or a number in all of them, as the row ``at`` of (m, LANES) numbers without gaps."""
    rows[at] = x


def constant_vector(x: FloatArray) -> tuple[types.Type, Any]:
    """Their kind, and ``x`` as constant lanes in compiled code."""
    return _LANES, ir.Constant(_VECTOR, x.tolist())


def _are_lanes(*every: types.Type) -> bool:
    return any(isinstance(x, Float64x4Type) for x in every)


@lower_cast(types.Number, Float64x4Type)  # type: ignore[untyped-decorator, no-untyped-call]  # numba ships no types
def _alike_number(context: Any, builder: Any, kind: Any, _: Any, value: Any) -> Any:
    number = context.cast(builder, value, kind, types.float64)
    undefined = ir.Constant(_VECTOR, ir.Undefined)
    first = builder.insert_element(undefined, number, _INDEX(0))
    return builder.shuffle_vector(first, undefined, ir.Constant(ir.VectorType(_INDEX, LANES), [0] * LANES))


def register_intrinsic(
    function: Any, typed: Callable[..., Any], generate: Callable[..., Any], *kinds_of_arguments: tuple[Any, ...]
) -> None:
    """Let compiled code call ``function`` with arguments of such kinds.

    ``typed``: types of the arguments -> type of the result and those that arguments are turned into, or None.
    ``generate``: (context, builder, types, values) -> value.
    """

    class Template(AbstractTemplate):
        key = function

        def generic(self, arguments: Any, named: Any) -> Any:  # noqa: ARG002 - as numba calls it
            told = typed(*arguments)
            return None if told is None else signature(*told)  # type: ignore[no-untyped-call]  # numba ships no types

    infer_global(function, types.Function(Template))  # type: ignore[no-untyped-call]  # as above
    for kinds in kinds_of_arguments:

        @lower_builtin(function, *kinds)  # type: ignore[untyped-decorator, no-untyped-call]  # as above
        def lower(context: Any, builder: Any, told: Any, values: Any) -> Any:
            return generate(context, builder, told.args, values)


def _all_lanes(*arguments: types.Type) -> Any:
    """Lanes of lanes, whatever else is a number."""
    return (_LANES,) * (len(arguments) + 1) if _are_lanes(*arguments) else None


def _lanes_or_numbers(*arguments: types.Type) -> Any:
    return _all_lanes(*arguments) or (types.float64,) * (len(arguments) + 1)


def _of(instruction: str) -> Callable[..., Any]:
    return lambda _, builder, __, values: getattr(builder, instruction)(*values, flags=_FLAGS)


def _selecting(comparison: str) -> Callable[..., Any]:
    """One of two by how the first two compare, where they do."""

    def generate(_: Any, builder: Any, __: Any, values: Any) -> Any:
        x, y = values
        return builder.select(builder.fcmp_unordered(comparison, x, y), x, y)

    return generate


def _by_llvm(name: str) -> Callable[..., Any]:
    """An intrinsic of LLVM."""

    def generate(_: Any, builder: Any, __: Any, values: Any) -> Any:
        kind = values[0].type
        suffix = f"v{LANES}f64" if kind == _VECTOR else "f64"
        told = ir.FunctionType(kind, [kind])
        intrinsic = f"llvm.{name}.{suffix}"
        function = cgutils.get_or_insert_function(  # type: ignore[no-untyped-call]  # numba ships no types
            builder.module, told, intrinsic
        )
        return builder.call(function, values)

    return generate


def _two_to(_: Any, builder: Any, __: Any, values: Any) -> Any:
    """By writing the number where a double keeps its exponent."""
    whole = ir.VectorType(ir.IntType(64), LANES)
    # So large a double has no room for fractions: its last bits are the whole number.
    shifted = builder.fadd(values[0], ir.Constant(_VECTOR, [_ROUNDS + 1023.0] * LANES))
    exponent = builder.shl(builder.bitcast(shifted, whole), ir.Constant(whole, [52] * LANES))
    return builder.bitcast(exponent, _VECTOR)


def _where_positive(_: Any, builder: Any, __: Any, values: Any) -> Any:
    x, y, otherwise = values
    zero = ir.Constant(x.type, [0.0] * LANES if x.type == _VECTOR else 0.0)
    return builder.select(builder.fcmp_ordered(">=", x, zero), y, otherwise)


def _lane(context: Any, builder: Any, kinds: Any, values: Any) -> Any:
    return builder.extract_element(values[0], context.cast(builder, values[1], kinds[1], types.int32))


def _with_lane(context: Any, builder: Any, kinds: Any, values: Any) -> Any:
    return builder.insert_element(values[0], values[2], context.cast(builder, values[1], kinds[1], types.int32))


def _row(context: Any, builder: Any, kinds: Any, values: Any) -> Any:
    """Where the row of an array begins, as lanes."""
    view = context.make_array(kinds[0])(context, builder, values[0])
    at = context.cast(builder, values[1], kinds[1], types.intp)
    return builder.gep(builder.bitcast(view.data, _VECTOR.as_pointer()), [at])


def _without_gaps(rows: types.Array) -> bool:
    """Whether lanes can stand in such an array as they do in a register."""
    return bool(rows.ndim == 2 and rows.layout == "C" and rows.dtype == types.float64)


def _read(context: Any, builder: Any, kinds: Any, values: Any) -> Any:
    return builder.load(_row(context, builder, kinds, values), align=8)


def _write(context: Any, builder: Any, kinds: Any, values: Any) -> Any:
    builder.store(values[2], _row(context, builder, kinds, values), align=8)
    return context.get_dummy_value()


_ONE, _TWO, _THREE = ((Float64x4Type,) * count for count in (1, 2, 3))
_NUMBER, _NUMBERS, _AT = (types.Float,), (types.Float, types.Float), types.Integer
# No ``+=`` or the like: uncompiled it would change the lanes of whoever else holds them.
register_intrinsic(operator.add, _all_lanes, _of("fadd"), _TWO)
register_intrinsic(operator.sub, _all_lanes, _of("fsub"), _TWO)
register_intrinsic(operator.mul, _all_lanes, _of("fmul"), _TWO)
register_intrinsic(operator.truediv, _all_lanes, _of("fdiv"), _TWO)
register_intrinsic(operator.neg, _all_lanes, _of("fneg"), _ONE)
register_intrinsic(abs, _all_lanes, _by_llvm("fabs"), _ONE)
register_intrinsic(maximum, _lanes_or_numbers, _selecting(">"), _TWO, _NUMBERS)
register_intrinsic(minimum, _lanes_or_numbers, _selecting("<"), _TWO, _NUMBERS)
register_intrinsic(sqrt, _lanes_or_numbers, _by_llvm("sqrt"), _ONE, _NUMBER)
register_intrinsic(where_nonnegative, _lanes_or_numbers, _where_positive, _THREE, (types.Float,) * 3)
register_intrinsic(broadcast, lambda _: (_LANES, _LANES), lambda _, __, ___, values: values[0], _ONE)
register_intrinsic(extract, lambda x, i: (types.float64, x, i), _lane, (Float64x4Type, _AT))
register_intrinsic(insert, lambda x, i, _: (_LANES, x, i, types.float64), _with_lane, (Float64x4Type, _AT, types.Float))
register_intrinsic(
    load, lambda rows, at: (_LANES, rows, at) if _without_gaps(rows) else None, _read, (types.Array, _AT)
)
register_intrinsic(
    store,
    lambda rows, at, _: (types.none, rows, at, _LANES) if _without_gaps(rows) else None,
    _write,
    (types.Array, _AT, Float64x4Type),
)


def _each(function: Any, count: int = 1) -> None:
    """Let compiled code use a ``function`` of plain numbers with lanes too, one by one."""

    def generate(context: Any, builder: Any, _: Any, values: Any) -> Any:
        numbers = [types.float64] * count
        told = signature(types.float64, *numbers)  # type: ignore[no-untyped-call]  # numba ships no types
        of_numbers = context.get_function(function, told)
        result = ir.Constant(_VECTOR, ir.Undefined)
        for i in range(LANES):
            own = [builder.extract_element(value, _INDEX(i)) for value in values]
            result = builder.insert_element(result, of_numbers(builder, own), _INDEX(i))
        return result

    register_intrinsic(function, _all_lanes, generate, (Float64x4Type,) * count)


@njit_inline
def _powers(x: Any) -> Any:
    """Whole powers of two, and what times these gives the exponential of a moderate ``x``."""
    powers = (x * _PER_LN_2 + _ROUNDS) - _ROUNDS
    # ln 2 in two parts, of which the first times any power has no rounding.
    y = (x - powers * _LN_2) - powers * _LN_2_REST
    square = y * y
    fourth = square * square
    # Pairs of terms do not wait for each other (Estrin).
    low = (1.0 + y) + (_TAYLOR[2] + y * _TAYLOR[3]) * square
    middle = (_TAYLOR[4] + y * _TAYLOR[5]) + (_TAYLOR[6] + y * _TAYLOR[7]) * square
    high = (_TAYLOR[8] + y * _TAYLOR[9]) + (_TAYLOR[10] + y * _TAYLOR[11] + square * _TAYLOR[12]) * square
    return powers, low + (middle + high * fourth) * fourth


@njit_inline
def _exp(x: Any) -> Any:
    """As ``math.exp`` to two units in the last place, infinity above the largest and zero below the least double."""
    powers, rest = _powers(minimum(maximum(x, broadcast(_LEAST)), broadcast(_MOST)))
    # In two steps: the largest power there is, is out of reach for one.
    half = (0.5 * powers + _ROUNDS) - _ROUNDS
    return rest * exp2(half) * exp2(powers - half)


@njit_inline
def _tanh(x: Any) -> Any:
    """As ``math.tanh`` to 2e-16."""
    # Beyond 20 it is one.
    powers, rest = _powers(-2.0 * minimum(abs(x), broadcast(20.0)))
    fading = rest * exp2(powers)
    size = (1.0 - fading) / (1.0 + fading)
    return where_nonnegative(x, size, -size)


@njit_inline
def _sine(x: Any, ahead: float) -> Any:
    """As ``math.sin`` so many quarter turns ``ahead`` of ``x``, to 2e-16 up to a million turns."""
    turned = (x * _PER_QUARTER + _ROUNDS) - _ROUNDS
    # A quarter turn in three parts, of which the first two times any such number have no rounding.
    y = ((x - turned * _QUARTER) - turned * _QUARTER_REST) - turned * _QUARTER_LAST
    square, quarters = y * y, turned + ahead
    sine, cosine = broadcast(_TAYLOR[15]), broadcast(_TAYLOR[16])
    for k in range(7):
        sine, cosine = _TAYLOR[13 - 2 * k] - sine * square, _TAYLOR[14 - 2 * k] - cosine * square
    cosine = 1.0 - cosine * square
    half = 0.5 * quarters
    size = where_nonnegative(half - math.floor(half) - 0.25, cosine, sine * y)
    full = 0.5 * half
    return where_nonnegative(full - math.floor(full) - 0.375, -size, size)


@njit_inline
def _sin(x: Any) -> Any:
    return _sine(x, 0.0)


@njit_inline
def _cos(x: Any) -> Any:
    return _sine(x, 1.0)


def _by_formula(function: Any, formula: Any) -> None:
    """Let compiled code use a ``function`` of one plain number with lanes too, by a ``formula`` of lanes."""

    def generate(context: Any, builder: Any, _: Any, values: Any) -> Any:
        told = signature(_LANES, _LANES)  # type: ignore[no-untyped-call]  # numba ships no types
        return context.compile_internal(builder, formula.py_func, told, values)

    register_intrinsic(function, _all_lanes, generate, _ONE)


register_intrinsic(exp2, _all_lanes, _two_to, _ONE)
register_intrinsic(math.floor, _all_lanes, _by_llvm("floor"), _ONE)
_FORMULAS = {math.exp: _exp, exp: _exp, math.tanh: _tanh, math.sin: _sin, math.cos: _cos}
for _function, _formula in _FORMULAS.items():
    _by_formula(_function, _formula)
for _function in (math.tan, math.atan, math.log):
    _each(_function)
_each(math.pow, 2)


@njit_inline
def reduce_max(x: Any) -> float:
    """Of all lanes that hold a number."""
    most = -math.inf
    for i in range(LANES):
        most = extract(x, i) if extract(x, i) > most else most
    return most


@njit_inline
def nan_unless_below(x: Any, size: Any, most: float) -> Any:
    """``x``, no number in the lanes whose ``size`` is not below ``most``."""
    for i in range(LANES):
        if not extract(size, i) < most:
            x = insert(x, i, math.nan)
    return x
