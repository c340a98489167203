"""LLVM backend of the vector: the functions of `rovid.jit.simd` as instructions on vector registers."""

import math
import operator
from collections.abc import Callable
from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.datamodel.models import PrimitiveModel
from numba.core.imputils import lower_builtin, lower_cast
from numba.core.typing.templates import AbstractTemplate, infer_global, signature
from numba.extending import register_model

from rovid.core.array_types import FloatArray
from rovid.jit.decorators import njit_inline
from rovid.jit.simd import (
    LANES,
    broadcast,
    exp,
    extract,
    insert,
    load,
    maximum,
    minimum,
    sqrt,
    store,
    where_nonnegative,
)

_VECTOR = ir.VectorType(ir.DoubleType(), LANES)
_INDEX = ir.IntType(32)
# A product may be added without rounding it first (fused multiply-add).
_FLAGS = ("contract",)
# Adding and subtracting this number rounds a double to an integer.
_ROUNDING = 1.5 * 2.0**52
# 1/ln 2, and ln 2 in two parts: the first part times a moderate integer is exact (Cody and Waite).
_PER_LN_2, _LN_2, _LN_2_REST = 1.4426950408889634, 0.693147180369123816490, 1.90821492927058770002e-10
# 2/pi, and pi/2 in three parts: the first two times a moderate integer are exact.
_PER_QUARTER = 2.0 / math.pi
_QUARTER, _QUARTER_REST, _QUARTER_LAST = 1.57079632673412561417, 6.07710050630396597660e-11, 2.02226624879595063154e-21
# The exponential of a double is zero below the first and infinite above the second.
_EXP_LOW, _EXP_HIGH = -746.0, 710.0
_TAYLOR = tuple(1.0 / math.factorial(k) for k in range(17))


class Float64x4Type(types.Type):
    """Numba type of a vector of `LANES` doubles."""

    def __init__(self) -> None:
        super().__init__(name=f"Float64x{LANES}")


_FLOAT64X4 = Float64x4Type()


@register_model(Float64x4Type)
class _VectorModel(PrimitiveModel):
    def __init__(self, manager: Any, numba_type: Float64x4Type) -> None:
        super().__init__(manager, numba_type, _VECTOR)  # type: ignore[no-untyped-call]  # numba ships no types


@lower_cast(types.Number, Float64x4Type)  # type: ignore[untyped-decorator, no-untyped-call]  # as above
def _lower_broadcast(context: Any, builder: Any, source: Any, _: Any, value: Any) -> Any:
    number = context.cast(builder, value, source, types.float64)
    undefined = ir.Constant(_VECTOR, ir.Undefined)
    first = builder.insert_element(undefined, number, _INDEX(0))
    return builder.shuffle_vector(first, undefined, ir.Constant(ir.VectorType(_INDEX, LANES), [0] * LANES))


def constant_vector(x: FloatArray) -> tuple[types.Type, Any]:
    """Numba type and LLVM constant of an array of `LANES` numbers."""
    return _FLOAT64X4, ir.Constant(_VECTOR, x.tolist())


def register_intrinsic(
    function: Any, infer: Callable[..., Any], lower: Callable[..., Any], *argument_types: tuple[Any, ...]
) -> None:
    """Let compiled code call ``function``.

    Parameters
    ----------
    infer
        (types of the arguments) -> type of the result, then the types to which the arguments are converted; or None.
    lower
        (context, builder, types, values) -> value; writes the instructions.
    argument_types
        Each tuple is one signature for which ``lower`` is used.
    """

    class Template(AbstractTemplate):
        key = function

        def generic(self, arguments: Any, named: Any) -> Any:  # noqa: ARG002 - numba's interface
            inferred = infer(*arguments)
            return None if inferred is None else signature(*inferred)  # type: ignore[no-untyped-call]  # as above

    infer_global(function, types.Function(Template))  # type: ignore[no-untyped-call]  # as above
    for one in argument_types:

        @lower_builtin(function, *one)  # type: ignore[untyped-decorator, no-untyped-call]  # as above
        def lowered(context: Any, builder: Any, sig: Any, values: Any) -> Any:
            return lower(context, builder, sig.args, values)


# Type inference: what the arguments are converted to.
def _to_vectors(*arguments: types.Type) -> Any:
    """All vectors, if one of the arguments is a vector."""
    if any(isinstance(x, Float64x4Type) for x in arguments):
        return (_FLOAT64X4,) * (len(arguments) + 1)
    return None


def _to_vectors_or_numbers(*arguments: types.Type) -> Any:
    return _to_vectors(*arguments) or (types.float64,) * (len(arguments) + 1)


def _is_contiguous(rows: types.Array) -> bool:
    """Whether a row of the array can be loaded into a register."""
    return bool(rows.ndim == 2 and rows.layout == "C" and rows.dtype == types.float64)


def _infer_load(rows: Any, at: Any) -> Any:
    return (_FLOAT64X4, rows, at) if _is_contiguous(rows) else None


def _infer_store(rows: Any, at: Any, _: Any) -> Any:
    return (types.none, rows, at, _FLOAT64X4) if _is_contiguous(rows) else None


# Lowering: the instructions.
def _instruction(name: str) -> Callable[..., Any]:
    return lambda _, builder, __, values: getattr(builder, name)(*values, flags=_FLAGS)


def _select_by(comparison: str) -> Callable[..., Any]:
    """The first argument if it compares so with the second or if one of them is NaN, else the second."""

    def lower(_: Any, builder: Any, __: Any, values: Any) -> Any:
        x, y = values
        return builder.select(builder.fcmp_unordered(comparison, x, y), x, y)

    return lower


def _llvm_intrinsic(name: str) -> Callable[..., Any]:
    def lower(_: Any, builder: Any, __: Any, values: Any) -> Any:
        operand = values[0].type
        suffix = f"v{LANES}f64" if operand == _VECTOR else "f64"
        function = cgutils.get_or_insert_function(  # type: ignore[no-untyped-call]  # numba ships no types
            builder.module, ir.FunctionType(operand, [operand]), f"llvm.{name}.{suffix}"
        )
        return builder.call(function, values)

    return lower


def _lower_where(_: Any, builder: Any, __: Any, values: Any) -> Any:
    x, y, otherwise = values
    zero = ir.Constant(x.type, [0.0] * LANES if x.type == _VECTOR else 0.0)
    return builder.select(builder.fcmp_ordered(">=", x, zero), y, otherwise)


def _lower_extract(context: Any, builder: Any, kinds: Any, values: Any) -> Any:
    return builder.extract_element(values[0], context.cast(builder, values[1], kinds[1], types.int32))


def _lower_insert(context: Any, builder: Any, kinds: Any, values: Any) -> Any:
    return builder.insert_element(values[0], values[2], context.cast(builder, values[1], kinds[1], types.int32))


def _row_pointer(context: Any, builder: Any, kinds: Any, values: Any) -> Any:
    view = context.make_array(kinds[0])(context, builder, values[0])
    at = context.cast(builder, values[1], kinds[1], types.intp)
    return builder.gep(builder.bitcast(view.data, _VECTOR.as_pointer()), [at])


def _lower_load(context: Any, builder: Any, kinds: Any, values: Any) -> Any:
    return builder.load(_row_pointer(context, builder, kinds, values), align=8)


def _lower_store(context: Any, builder: Any, kinds: Any, values: Any) -> Any:
    builder.store(values[2], _row_pointer(context, builder, kinds, values), align=8)
    return context.get_dummy_value()


_V, _N, _AT = Float64x4Type, types.Float, types.Integer
# There are no in-place operators: uncompiled they would change an array that others hold too.
register_intrinsic(operator.add, _to_vectors, _instruction("fadd"), (_V, _V))
register_intrinsic(operator.sub, _to_vectors, _instruction("fsub"), (_V, _V))
register_intrinsic(operator.mul, _to_vectors, _instruction("fmul"), (_V, _V))
register_intrinsic(operator.truediv, _to_vectors, _instruction("fdiv"), (_V, _V))
register_intrinsic(operator.neg, _to_vectors, _instruction("fneg"), (_V,))
register_intrinsic(abs, _to_vectors, _llvm_intrinsic("fabs"), (_V,))
register_intrinsic(math.floor, _to_vectors, _llvm_intrinsic("floor"), (_V,))
register_intrinsic(maximum, _to_vectors_or_numbers, _select_by(">"), (_V, _V), (_N, _N))
register_intrinsic(minimum, _to_vectors_or_numbers, _select_by("<"), (_V, _V), (_N, _N))
register_intrinsic(sqrt, _to_vectors_or_numbers, _llvm_intrinsic("sqrt"), (_V,), (_N,))
register_intrinsic(where_nonnegative, _to_vectors_or_numbers, _lower_where, (_V, _V, _V), (_N, _N, _N))
register_intrinsic(broadcast, lambda _: (_FLOAT64X4, _FLOAT64X4), lambda _, __, ___, values: values[0], (_V,))
register_intrinsic(extract, lambda x, i: (types.float64, x, i), _lower_extract, (_V, _AT))
register_intrinsic(insert, lambda x, i, _: (_FLOAT64X4, x, i, types.float64), _lower_insert, (_V, _AT, _N))
register_intrinsic(load, _infer_load, _lower_load, (types.Array, _AT))
register_intrinsic(store, _infer_store, _lower_store, (types.Array, _AT, _V))


def _power_of_two(x: Any) -> Any:
    """2**x for integers from -1022 to 1023; in compiled code alone."""
    raise NotImplementedError


def _lower_power_of_two(_: Any, builder: Any, __: Any, values: Any) -> Any:
    """Write the integer into the exponent of a double."""
    integers = ir.VectorType(ir.IntType(64), LANES)
    # A double of this size has no fraction: its last bits are the integer.
    shifted = builder.fadd(values[0], ir.Constant(_VECTOR, [_ROUNDING + 1023.0] * LANES))
    exponent = builder.shl(builder.bitcast(shifted, integers), ir.Constant(integers, [52] * LANES))
    return builder.bitcast(exponent, _VECTOR)


register_intrinsic(_power_of_two, _to_vectors, _lower_power_of_two, (_V,))


@njit_inline
def _reduced_exp(x: Any) -> Any:
    """Integer n and number y of exp(x) = 2**n * y, for a moderate ``x``."""
    powers = (x * _PER_LN_2 + _ROUNDING) - _ROUNDING
    y = (x - powers * _LN_2) - powers * _LN_2_REST
    square = y * y
    fourth = square * square
    # The Taylor series in pairs of terms, which can be computed at the same time (Estrin's scheme).
    low = (1.0 + y) + (_TAYLOR[2] + y * _TAYLOR[3]) * square
    middle = (_TAYLOR[4] + y * _TAYLOR[5]) + (_TAYLOR[6] + y * _TAYLOR[7]) * square
    high = (_TAYLOR[8] + y * _TAYLOR[9]) + (_TAYLOR[10] + y * _TAYLOR[11] + square * _TAYLOR[12]) * square
    return powers, low + (middle + high * fourth) * fourth


@njit_inline
def _exp(x: Any) -> Any:
    """``math.exp`` to two units in the last place, with infinity and zero beyond the range of doubles."""
    powers, rest = _reduced_exp(minimum(maximum(x, broadcast(_EXP_LOW)), broadcast(_EXP_HIGH)))
    # Two factors: the largest power itself is out of range.
    half = (0.5 * powers + _ROUNDING) - _ROUNDING
    return rest * _power_of_two(half) * _power_of_two(powers - half)


@njit_inline
def _tanh(x: Any) -> Any:
    """``math.tanh`` with an error of 2e-16."""
    # tanh(20) is one in double precision.
    powers, rest = _reduced_exp(-2.0 * minimum(abs(x), broadcast(20.0)))
    decayed = rest * _power_of_two(powers)
    size = (1.0 - decayed) / (1.0 + decayed)
    return where_nonnegative(x, size, -size)


@njit_inline
def _shifted_sin(x: Any, quarter_turns: float) -> Any:
    """``math.sin`` of ``x`` plus so many quarter turns, with an error of 2e-16 up to a million turns."""
    turned = (x * _PER_QUARTER + _ROUNDING) - _ROUNDING
    y = ((x - turned * _QUARTER) - turned * _QUARTER_REST) - turned * _QUARTER_LAST
    square, quarters = y * y, turned + quarter_turns
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
    return _shifted_sin(x, 0.0)


@njit_inline
def _cos(x: Any) -> Any:
    return _shifted_sin(x, 1.0)


def _register_formula(function: Any, formula: Any) -> None:
    """Let compiled code call a ``function`` of one number with a vector, by a compiled ``formula``."""

    def lower(context: Any, builder: Any, _: Any, values: Any) -> Any:
        sig = signature(_FLOAT64X4, _FLOAT64X4)  # type: ignore[no-untyped-call]  # numba ships no types
        return context.compile_internal(builder, formula.py_func, sig, values)

    register_intrinsic(function, _to_vectors, lower, (_V,))


def _register_lane_by_lane(function: Any, count: int = 1) -> None:
    """Let compiled code call a ``function`` of so many numbers with vectors: one call for each lane."""

    def lower(context: Any, builder: Any, _: Any, values: Any) -> Any:
        numbers = [types.float64] * count
        sig = signature(types.float64, *numbers)  # type: ignore[no-untyped-call]  # as above
        scalar = context.get_function(function, sig)
        result = ir.Constant(_VECTOR, ir.Undefined)
        for i in range(LANES):
            arguments = [builder.extract_element(value, _INDEX(i)) for value in values]
            result = builder.insert_element(result, scalar(builder, arguments), _INDEX(i))
        return result

    register_intrinsic(function, _to_vectors, lower, (_V,) * count)


_FORMULAS = {math.exp: _exp, exp: _exp, math.tanh: _tanh, math.sin: _sin, math.cos: _cos}
for _function, _formula in _FORMULAS.items():
    _register_formula(_function, _formula)
for _function in (math.tan, math.atan, math.log):
    _register_lane_by_lane(_function)
_register_lane_by_lane(math.pow, 2)
