"""Columns of a log as they are drawn: the lowest and the highest of each stretch, so that ten hours are light."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.preflight.raw_columns import RawColumn

_DIGITS = 6


def columns_document(
    columns: Mapping[str, RawColumn], needed: Sequence[str], begin: float, end: float, bins: int
) -> dict[str, Any]:
    """Every column between ``begin`` and ``end``, in s from the instant that [[leave_out]] counts from.

    Parameters
    ----------
    needed
        Sources of the heading, first, and of the commands: the log begins where all of them are known.
    bins
        How many stretches each is cut into.
    """
    zero = _zero(columns, needed)
    times = [one.time for one in columns.values() if len(one.time)]
    first = min((float(time.min()) for time in times), default=0.0) - zero
    last = max((float(time.max()) for time in times), default=0.0) - zero
    low, high = max(begin, first), min(end, last)
    return {
        "begin": first,
        "end": last,
        "columns": [
            {"source": source, **_drawn(one.time - zero, one.values, low, high, bins)}
            for source, one in columns.items()
        ],
    }


def _zero(columns: Mapping[str, RawColumn], needed: Sequence[str]) -> float:
    known = [one.time[np.isfinite(one.values)] for source, one in columns.items() if source in needed]
    starts = [float(time.min()) for time in known if time.size]
    if not starts:
        return min((float(one.time.min()) for one in columns.values() if len(one.time)), default=0.0)
    heading = columns.get(needed[0])
    if heading is None:
        return max(starts)
    measured = heading.time[np.isfinite(heading.values)]
    after = measured[measured >= max(starts)]
    return float(after.min()) if after.size else max(starts)


def _drawn(time: FloatArray, values: FloatArray, begin: float, end: float, bins: int) -> dict[str, Any]:
    """The range of all values, how many there are, and instants with the lowest and the highest of each stretch."""
    known = np.isfinite(values)
    order = np.argsort(time[known], kind="stable")
    clock, level = time[known][order], values[known][order]
    document: dict[str, Any] = {"samples": len(level), "lowest": None, "highest": None}
    if len(level):
        document |= {"lowest": _short(level.min()), "highest": _short(level.max())}
    # One beyond either end, so that a line leaves the picture.
    first = max(int(np.searchsorted(clock, begin)) - 1, 0)
    last = int(np.searchsorted(clock, end, side="right")) + 1
    clock, level = clock[first:last], level[first:last]
    if len(clock) <= 2 * bins:
        return document | {"time": _instants(clock), "low": _shortened(level), "high": _shortened(level)}
    starts = np.unique(np.searchsorted(clock, np.linspace(clock[0], clock[-1], bins, endpoint=False)))
    lowest, highest = np.minimum.reduceat(level, starts), np.maximum.reduceat(level, starts)
    return document | {"time": _instants(clock[starts]), "low": _shortened(lowest), "high": _shortened(highest)}


def _short(value: float) -> float:
    return float(f"{value:.{_DIGITS}g}")


def _shortened(values: FloatArray) -> list[float]:
    return [_short(value) for value in values.tolist()]


def _instants(values: FloatArray) -> list[float]:
    """In s, to the ms in a log of weeks."""
    return [round(value, 4) for value in values.tolist()]
