"""Compiled loops over samples."""

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.jit.decorators import compiled


@compiled
def first_order_sum(values: FloatArray, fade: float) -> FloatArray:
    """(n,) first-order recursion y[k] = values[k] + fade * y[k - 1]. Importing scipy.signal for this takes longer."""
    out, total = np.empty(len(values)), 0.0
    for k in range(len(values)):
        total = values[k] + fade * total
        out[k] = total
    return out


@compiled
def find_constant_runs(values: FloatArray, tolerance: FloatArray) -> FloatArray:
    """(m,) first rows, as floats, of greedy runs of (n, k) ``values`` whose columns stay within their ``tolerance``."""
    n, width = values.shape
    starts = np.empty(n)
    count = 0
    low, high = np.empty(width), np.empty(width)
    for k in range(n):
        fits = k > 0
        for j in range(width):
            if fits and max(high[j], values[k, j]) - min(low[j], values[k, j]) > tolerance[j]:
                fits = False
        if fits:
            for j in range(width):
                low[j] = min(low[j], values[k, j])
                high[j] = max(high[j], values[k, j])
        else:
            starts[count] = k
            count += 1
            for j in range(width):
                low[j] = high[j] = values[k, j]
    return starts[:count]
