"""Call of a function by its address, from compiled loops: the function is compiled later, and changes no loop."""

# mypy: allow-untyped-calls, allow-untyped-decorators

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic, overload

# Number of vectors that such a function returns.
RESULTS = 3
# C signature: (count * LANES) numbers, (RESULTS * LANES) results.
SIGNATURE = types.void(types.CPointer(types.float64), types.CPointer(types.float64))
# Address -> function of vectors, for loops that are not compiled. Compiled functions are kept alive here.
FUNCTIONS: dict[int, Callable[..., Any]] = {}


def call_at(address: int, numbers: Any) -> Any:
    """`RESULTS` vectors that the function at ``address`` returns for a tuple of vectors."""
    return FUNCTIONS[address](numbers)


def _lower(context: Any, builder: Any, sig: Any, values: Any) -> Any:
    address, numbers = values
    array = ir.DoubleType().as_pointer()
    function = ir.FunctionType(ir.VoidType(), [array, array]).as_pointer()
    given = cgutils.alloca_once_value(builder, numbers)
    found = cgutils.alloca_once(builder, context.get_value_type(sig.return_type))
    pointers = [builder.bitcast(one, array) for one in (given, found)]
    builder.call(builder.inttoptr(address, function), pointers)
    return builder.load(found)


@intrinsic
def _call(_: Any, address: Any, numbers: Any) -> Any:
    return types.UniTuple(numbers.dtype, RESULTS)(address, numbers), _lower


@overload(call_at, strict=False)
def _call_at(address: Any, numbers: Any) -> Any:
    if isinstance(address, types.Integer) and isinstance(numbers, types.UniTuple):
        return lambda address, numbers: _call(address, numbers)  # type: ignore[call-arg]  # noqa: PLW0108 - numba's form
    return None
