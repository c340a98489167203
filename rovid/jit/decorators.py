"""Decorators that compile functions with numba and keep the machine code on disk, and calls of functions by address.

A function that is called by its address is compiled later, and changes no loop.
"""

import importlib
import os
from collections.abc import Callable
from typing import Any, TypeVar

import numba
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic, overload

from rovid.jit.cache_dirs import can_cache

Function = TypeVar("Function", bound=Callable[..., object])
# Modules of numba and llvmlite outside their public interface.
_PRIVATE_MODULES = (
    "llvmlite.ir",
    "numba.core.cgutils",
    "numba.core.caching",
    "numba.core.datamodel.models",
    "numba.core.dispatcher",
    "numba.core.imputils",
    "numba.core.registry",
    "numba.core.runtime.nrt",
    "numba.core.typing.templates",
)
# For functions that a loop calls several times in each step. Numba passes an array as seven numbers or more, and such a
# call would cost more than the function itself.
njit_inline = numba.njit(error_model="numpy", nogil=True, inline="always")
# Number of vectors that such a function returns.
RESULTS = 3
# C signature: (count * LANES) numbers, (RESULTS * LANES) results.
SIGNATURE = types.void(types.CPointer(types.float64), types.CPointer(types.float64))
# Address -> function of vectors, for loops that are not compiled. Compiled functions are kept alive here.
FUNCTIONS: dict[int, Callable[..., Any]] = {}


def _has_private_modules() -> bool:
    try:
        for name in _PRIVATE_MODULES:
            importlib.import_module(name)
    except ImportError:
        return False
    return True


HAS_PRIVATE_MODULES = _has_private_modules()
# Whether loops are compiled by the LLVM backend. The other one is slower, and uses numba's public interface alone.
USE_LLVM = HAS_PRIVATE_MODULES and os.environ.get("ROVID_PLAIN_NUMBA", "0") in {"", "0"}


def compiled(function: Function) -> Function:
    """Compile a function that several threads may run at once. A division by zero gives infinity, as in numpy."""
    return _cached(numba.njit(error_model="numpy", nogil=True)(function), function)


def njit_noalloc(function: Function) -> Function:
    """Compile an innermost loop that creates no arrays: references to its array arguments are not counted."""
    if not USE_LLVM:
        return compiled(function)
    loop = numba.njit(error_model="numpy", nogil=True, _nrt=False)  # type: ignore[call-overload]  # its types leave it out
    return _cached(loop(function), function)


def is_cached(function: Any) -> bool:
    """Whether the machine code of a compiled ``function``, as it is now, is on disk."""
    return hasattr(function, "_cache") and bool(function._cache.is_valid())  # noqa: SLF001 - as below


def _cached(dispatcher: Any, function: Function) -> Function:
    """The ``dispatcher`` of ``function``, with a cache for rovid's own code where there is a folder for it."""
    if HAS_PRIVATE_MODULES and function.__module__.startswith("rovid.") and can_cache():
        from rovid.jit.cache import ContentHashCache

        dispatcher._cache = ContentHashCache(function)  # noqa: SLF001 - numba has no public way to define validity
    return dispatcher  # type: ignore[no-any-return]  # has the signature of the function


# mypy: allow-untyped-calls, allow-untyped-decorators


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
