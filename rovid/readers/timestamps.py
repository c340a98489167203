"""Time as logged -> seconds."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from rovid.core.array_types import FloatArray
from rovid.core.errors import LogError

_SCALE = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
# "time_ms", "t [us]", "stamp(ns)": the unit that a column's own name declares.
_SUFFIX = re.compile(r"[\s_.\[(](ms|us|µs|μs|ns)[\])]?$", re.IGNORECASE)

# s since 1970 from which on a time counts as one since then: 1973.
EPOCH_FROM = 1e8


def unit_of(name: str, magnitude: float, declared: str) -> str:
    """s, ms, us or ns: as ``declared``, else by the column's name, else by the size of an epoch time.

    Seconds since 1970 are near 1.7e9 these decades, so a factor of a thousand apart leaves no doubt; anything
    below 1e11 counts as seconds.
    """
    if declared in _SCALE:
        return declared
    if named := _SUFFIX.search(name):
        return named[1].lower().replace("µ", "u").replace("μ", "u")
    for unit, lowest in (("ns", 1e17), ("us", 1e14), ("ms", 1e11)):
        if magnitude >= lowest:
            return unit
    return "s"


def to_seconds(values: NDArray[Any], name: str, declared: str, origin: int | None = None) -> FloatArray:
    """(n,) s of (n,) numbers; integers lose their start before they become floats, so no digit is lost.

    Parameters
    ----------
    values
        float64 with NaN where missing, or int64.
    name
        The column or field.
    declared
        Unit of rovid.toml: auto, s, ms, us or ns.
    origin
        What to take off integers; the first of them by default.
    """
    if not values.size:
        return values.astype(np.float64)
    if values.dtype.kind == "u":
        values = values.astype(np.int64)
    few = np.abs(values[:: len(values) // 1000 + 1].astype(np.float64))
    few = few[few < 1e30]  # without what is no time at all
    scale = _SCALE[unit_of(name, float(np.median(few)) if few.size else 0.0, declared)]
    since: FloatArray = values
    if values.dtype.kind == "i":
        since = (values - (values[0] if origin is None else origin)).astype(np.float64)
    return since if scale == 1.0 else since * scale


def column_to_seconds(column: pd.Series[Any], name: str, declared: str, where: Callable[[int], str]) -> FloatArray:
    """(n,) s of a column of numbers, dates or text; NaN where missing.

    Parameters
    ----------
    name, declared
        As in `seconds`.
    where
        Row -> its place in the file, for messages.

    Raises
    ------
    LogError
        A text is no ISO 8601 time.
    """
    if isinstance(column.dtype, np.dtype) and column.dtype.kind in "iuf":
        return to_seconds(column.to_numpy(), name, declared)
    if column.dtype == "Int64":
        known = column.notna().to_numpy()
        time = np.full(len(column), np.nan)
        time[known] = to_seconds(column[known].to_numpy(dtype=np.int64), name, declared)
        return time
    if column.dtype.kind == "m":
        return np.asarray(column.dt.total_seconds(), dtype=np.float64)
    dates = to_datetimes(column, name, where)
    if dates.isna().all():
        return np.full(len(dates), np.nan)
    return np.asarray((dates - dates.min()) / pd.Timedelta(seconds=1), dtype=np.float64)


def to_datetimes(column: pd.Series[Any], name: str, where: Callable[[int], str]) -> pd.Series[Any]:
    """A column of dates or text as points in time; none where missing.

    Raises
    ------
    LogError
        A text is no ISO 8601 time.
    """
    dates = pd.to_datetime(column, format="ISO8601", utc=True, errors="coerce")
    if dates.notna().sum() < column.notna().sum():
        # ISO 8601 allows a comma, pandas does not.
        tidy = column.astype("string").str.strip().str.replace(",", ".", regex=False)
        dates = pd.to_datetime(tidy, format="ISO8601", utc=True, errors="coerce")
    if dates.notna().sum() < column.notna().sum():
        row = int(np.argmax((dates.isna() & column.notna()).to_numpy()))
        raise LogError(
            f"{name} is {column.iloc[row]!r}; seconds, an ISO 8601 time (2026-01-07T12:00:00.05Z) or an epoch time "
            "was expected.",
            where=where(row),
            mend="Delete the row, or write its time so.",
        )
    return dates


def epoch_of(column: pd.Series[Any], time: FloatArray, name: str, declared: str) -> float | None:
    """S since 1970 of time zero, where ``time`` in s is what `stamps` makes of ``column``; None where nobody knows."""
    known = np.flatnonzero(np.isfinite(time))
    if not known.size:
        return None
    first = column.iloc[int(known[0])]
    if isinstance(first, pd.Timedelta):
        return None
    if isinstance(first, str | pd.Timestamp):
        moment = pd.to_datetime(str(first).strip().replace(",", "."), utc=True).timestamp()
    else:
        moment = float(first) * _SCALE[unit_of(name, abs(float(first)), declared)]
    return float(moment - time[known[0]]) if moment > EPOCH_FROM else None
