"""A first-order recursion. To import scipy.signal for its filter takes longer than whole commands that need one."""

from __future__ import annotations

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.jit.decorators import compiled


@compiled
def first_order_sum(values: FloatArray, fade: float) -> FloatArray:
    """(n,) ``values``, each with the sum before it times ``fade``."""
    out, total = np.empty(len(values)), 0.0
    for k in range(len(values)):
        total = values[k] + fade * total
        out[k] = total
    return out
