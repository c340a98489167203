"""Compiled: where nothing changes by more than its tolerance."""

from __future__ import annotations

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.jit.decorators import compiled


@compiled
def find_constant_runs(values: FloatArray, tolerance: FloatArray) -> FloatArray:
    """Cut (n, k) ``values`` greedily into runs within which no column spans more than its ``tolerance``.

    Returns
    -------
    starts
        (m,) index of each run's first row, as floats.
    """
    n, width = values.shape
    starts = np.empty(n)
    count = 0
    low = np.empty(width)
    high = np.empty(width)
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
