"""Intervals between samples: the usual interval, and the longest that is no gap."""

from __future__ import annotations

import numpy as np

from rovid.core.array_types import FloatArray

# A gap is longer than this many median intervals, and than this many s.
_GAP_INTERVALS, _GAP_SECONDS = 5.0, 0.5


def subsampled_median(values: FloatArray) -> float:
    """Median of at most about ten thousand evenly picked ``values``, for thresholds; NaN for none."""
    if not values.size:
        return float("nan")
    return float(np.median(values[:: len(values) // 10_000 + 1]))


def gap_limit(intervals: FloatArray) -> float:
    """Longest interval in s that is no gap, for samples ``intervals`` apart."""
    return max(_GAP_INTERVALS * subsampled_median(intervals), _GAP_SECONDS)
