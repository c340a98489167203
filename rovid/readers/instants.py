"""Time as logged -> seconds."""

from __future__ import annotations

import re
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rovid.trial import FloatArray

_SCALE = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
# "time_ms", "t [us]", "stamp(ns)": the unit that a column's own name declares.
_SUFFIX = re.compile(r"[\s_.\[(](ms|us|µs|μs|ns)[\])]?$", re.IGNORECASE)


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


def seconds(values: NDArray[Any], name: str, declared: str, origin: int | None = None) -> FloatArray:
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
    few = np.abs(values[:: len(values) // 1000 + 1].astype(np.float64))
    few = few[few < 1e30]  # without what is no time at all
    scale = _SCALE[unit_of(name, float(np.median(few)) if few.size else 0.0, declared)]
    since: FloatArray = values
    if values.dtype.kind == "i":
        since = (values - (values[0] if origin is None else origin)).astype(np.float64)
    return since if scale == 1.0 else since * scale
