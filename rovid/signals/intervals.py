"""Intervals between samples: the usual interval, and the longest that is no gap."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rovid.core.array_types import FloatArray

# A gap is longer than this many median intervals.
_GAP_INTERVALS = 5.0
# s and multiples of the rest of the log; a clock set while recording (GPS fix, NTP) leaps by more than both. Clocks are
# set by hours, whatever the vehicle.
_LEAP, _LEAP_RATIO = 3600.0, 10.0
# s; intervals that overlap by less only touch.
_TOUCH = 1e-6


def subsampled_median(values: FloatArray) -> float:
    """Median of at most about ten thousand evenly picked ``values``, for thresholds; NaN for none."""
    if not values.size:
        return float("nan")
    return float(np.median(values[:: len(values) // 10_000 + 1]))


def gap_limit(intervals: FloatArray) -> float:
    """Longest interval in s that is no gap, for samples ``intervals`` apart."""
    return _GAP_INTERVALS * subsampled_median(intervals)


def find_leap(time: FloatArray) -> int | None:
    """Number of the reading after which the (n,) ``time`` in s leaps: over an hour and ten times the rest of the log.

    None where it leaps nowhere.
    """
    if len(time) < 2 or time[-1] - time[0] <= _LEAP:
        return None
    steps = np.diff(time)
    at = int(np.argmax(steps))
    rest = float(steps[(steps <= _LEAP) & (steps > 0.0)].sum())
    return at if steps[at] > max(_LEAP, _LEAP_RATIO * rest) else None


def merged_intervals(intervals: Sequence[tuple[float, float]]) -> tuple[tuple[float, float], ...]:
    """The union of ``intervals`` that overlap, in order; a sample lies between two that touch."""
    union: list[tuple[float, float]] = []
    for begin, end in sorted(intervals):
        if union and begin < union[-1][1] - _TOUCH:
            union[-1] = union[-1][0], max(end, union[-1][1])
        else:
            union.append((begin, end))
    return tuple(union)
