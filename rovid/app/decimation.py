"""Columns of a log for plots, as the minimum and maximum of each time bin."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.preflight.raw_columns import RawColumn


def columns_document(
    columns: Mapping[str, RawColumn],
    needed: Sequence[str],
    begin: float,
    end: float,
    bins: int,
    turns: Mapping[str, float] | None = None,
) -> dict[str, Any]:
    """All columns between ``begin`` and ``end``, in s from the origin of the times in [[leave_out]].

    ``needed``: Sources of the heading (first) and of the commands: the log begins when all of them are known.
    ``bins``: Number of time bins.
    ``turns``: Source of an angle -> a full turn in its unit; it is shown without jumps of whole turns.
    """
    turns = turns or {}
    origin = _time_origin(columns, needed)
    times = [column.time for column in columns.values() if len(column.time)]
    first = min((float(time.min()) for time in times), default=0.0) - origin
    last = max((float(time.max()) for time in times), default=0.0) - origin
    low, high = max(begin, first), min(end, last)
    return {
        "begin": first,
        "end": last,
        "columns": [
            {"source": source, **_decimate(column.time - origin, column.values, low, high, bins, turns.get(source))}
            for source, column in columns.items()
        ],
    }


def _time_origin(columns: Mapping[str, RawColumn], needed: Sequence[str]) -> float:
    known = [column.time[np.isfinite(column.values)] for source, column in columns.items() if source in needed]
    starts = [float(time.min()) for time in known if time.size]
    if not starts:
        return min((float(column.time.min()) for column in columns.values() if len(column.time)), default=0.0)
    heading = columns.get(needed[0])
    if heading is None:
        return max(starts)
    measured = heading.time[np.isfinite(heading.values)]
    after = measured[measured >= max(starts)]
    return float(after.min()) if after.size else max(starts)


def _decimate(
    time: FloatArray, values: FloatArray, begin: float, end: float, bins: int, turn: float | None
) -> dict[str, Any]:
    """Number and range of all values; times, minima and maxima of the bins in view."""
    known = np.isfinite(values)
    order = np.argsort(time[known], kind="stable")
    time, values = time[known][order], values[known][order]
    document: dict[str, Any] = {"samples": len(values), "lowest": None, "highest": None}
    if len(values):
        document |= {"lowest": _rounded(values.min()), "highest": _rounded(values.max())}
    if turn is not None:
        values = np.unwrap(values, period=turn)
    # One more sample at each end lets the line leave the plot.
    first = max(int(np.searchsorted(time, begin)) - 1, 0)
    last = int(np.searchsorted(time, end, side="right")) + 1
    time, low, high = time[first:last], values[first:last], values[first:last]
    if len(time) > 2 * bins:
        starts = np.unique(np.searchsorted(time, np.linspace(time[0], time[-1], bins, endpoint=False)))
        low, high = np.minimum.reduceat(low, starts), np.maximum.reduceat(high, starts)
        time = time[starts]
    # Times in s to 0.1 ms.
    clock = [round(value, 4) for value in time.tolist()]
    return document | {
        "time": clock,
        "low": list(map(_rounded, low.tolist())),
        "high": list(map(_rounded, high.tolist())),
    }


def _rounded(value: float) -> float:
    return float(f"{value:.6g}")
