"""A vector of four numbers, on which a compiled loop works at once (SIMD: single instruction, multiple data).

The four numbers belong to four models, runs or restarts, which a loop steps through side by side. All functions take
plain numbers too, so each formula is written once. Without compilation a vector is a numpy array of length four.

Two backends compile these functions: `llvm_vector` with `llvm_tracing`, and the slower `plain_numba`.
"""

import math
from typing import Any, TypeVar

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.jit.decorators import USE_LLVM, njit_inline

# A number, or a vector.
Number = TypeVar("Number", float, FloatArray)
# Numbers in a vector; more are no faster on common machines.
LANES = 4


def broadcast(x: Any) -> Any:
    """A vector with the number ``x`` in all lanes; a vector unchanged."""
    return np.full(LANES, x) if np.ndim(x) == 0 else x


def extract(x: Any, i: int) -> float:
    """The number in lane ``i``."""
    return float(x[i])


def insert(x: Any, i: int, value: float) -> Any:
    """``x`` with ``value`` in lane ``i``."""
    changed = x.copy()
    changed[i] = value
    return changed


def load(rows: Any, at: int) -> Any:
    """Row ``at`` of a contiguous (m, LANES) array as a vector."""
    return rows[at].copy()


def store(rows: Any, at: int, x: Any) -> None:
    """Write a vector, or a number in all lanes, to row ``at`` of a contiguous (m, LANES) array."""
    rows[at] = x


def maximum(x: Number, y: Number) -> Number:
    """The larger number in each lane."""
    return np.maximum(x, y)  # type: ignore[no-any-return]  # numpy's types do not say that the kind is the same


def minimum(x: Number, y: Number) -> Number:
    """The smaller number in each lane."""
    return np.minimum(x, y)  # type: ignore[no-any-return]  # as above


def where_nonnegative(x: Number, y: Number, otherwise: Number) -> Number:
    """In each lane ``y`` if ``x`` >= 0, else ``otherwise``."""
    # [()] turns an array without dimensions into a number.
    return np.where(x >= 0.0, y, otherwise)[()]  # type: ignore[return-value]  # as above


def sqrt(x: Number) -> Number:
    """Square root of each lane."""
    return np.sqrt(x)  # type: ignore[no-any-return]  # as above


def exp(x: Any) -> Any:
    """Exponential of each lane. In compiled code ``math.exp`` takes vectors too."""
    return np.exp(x)


@njit_inline
def reduce_max(x: Any) -> float:
    """The largest number in all lanes; NaN does not count."""
    most = -math.inf
    for i in range(LANES):
        most = extract(x, i) if extract(x, i) > most else most
    return most


@njit_inline
def nan_unless_below(x: Any, size: Any, limit: float) -> Any:
    """``x`` with NaN in each lane in which ``size`` is not below the ``limit``."""
    for i in range(LANES):
        if not extract(size, i) < limit:
            x = insert(x, i, math.nan)
    return x


# Importing a backend lets compiled code call the functions above. It imports them from here, hence at the end.
if USE_LLVM:
    from rovid.jit.llvm_tracing import is_branch_free, switch, traced
else:
    from rovid.jit.plain_numba import is_branch_free, switch, traced

__all__ = [
    "LANES",
    "broadcast",
    "exp",
    "extract",
    "insert",
    "is_branch_free",
    "load",
    "maximum",
    "minimum",
    "nan_unless_below",
    "reduce_max",
    "sqrt",
    "store",
    "switch",
    "traced",
    "where_nonnegative",
]
