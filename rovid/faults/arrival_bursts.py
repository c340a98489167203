"""Arrival bursts: readings sent in packs and stamped when the pack arrived.

A pack is a run of readings that follow each other in less than a fifth of the mean interval. Packs of about equal
length over equal times come from a regular sensor: its interval is the time from pack to pack over the number of
readings. A pack arrives after its last reading was taken: that reading gets the first stamp of the pack, and the others
are spread back to the pack before.
"""

from collections.abc import Iterator
from dataclasses import replace
from functools import partial

import numpy as np

from rovid.core.array_types import FloatArray, IntArray
from rovid.faults.base import ClockData, Detection, Detectors
from rovid.trial.fault import Fault

# Readings of a usual pack; packs in a log; readings of the log that are in packs of that size.
_LEAST_PACK, _LEAST_PACKS, _LEAST_SHARE = 3, 10, 0.8
# Longest interval within a pack, in mean intervals.
_WITHIN = 0.2
# Interquartile range of the intervals of all packs, over their median, up to which the sensor is regular.
_REGULAR = 0.3
# Interval of a pack, in usual intervals, from which on readings were lost before it.
_LOST = 1.5
# Share of the stamps that are whole multiples of the tick of a coarse clock.
_WHOLE = 0.9
# Share of the changes of a command at the first readings of packs: above it the command is sent several times.
_SENT_AGAIN = 0.5


def _detect(data: ClockData) -> Iterator[Detection[ClockData]]:
    lasts = _last_of_packs(data.time)
    if len(lasts) < _LEAST_PACKS:
        return
    sizes = np.diff(lasts, prepend=-1)
    in_packs = sizes >= _LEAST_PACK
    if np.sum(sizes[in_packs]) < _LEAST_SHARE * len(data.time):
        return
    intervals = np.diff(data.time[lasts]) / sizes[1:]
    low, usual, high = np.quantile(intervals, (0.25, 0.5, 0.75))
    if not usual > 0.0 or high - low > _REGULAR * usual or _sent_again(data, lasts) or _rounded(data.time, lasts):
        return
    size = float(np.median(sizes))
    # The first and the last pack may be incomplete.
    error = float(np.std(intervals) / np.sqrt(len(intervals)))
    fault = Fault(
        fault="arrival_bursts",
        logs=(data.log,),
        text=f"{data.log}: {data.clock} holds stamps of arrival, in packs of {size:.0f} readings.",
        size=float(usual),
        standard_error=max(error, 1e-3 * float(usual)),
        unit="s",
        remedy="none",
    )
    done = f"The readings were spread evenly, {usual:.4g} s apart."
    yield Detection(fault=fault, done=done, repair=partial(_spread, lasts=lasts, usual=float(usual)))


def _last_of_packs(time: FloatArray) -> IntArray:
    """Number of the last reading of each pack; each reading is a pack of its own where they are evenly spaced."""
    if len(time) < _LEAST_PACK * _LEAST_PACKS:
        return np.zeros(0, dtype=np.int64)
    advance = np.diff(time)
    # Mean interval of many readings, which neither a gap nor a step of the clock moves.
    span = min(60, len(time) // 3)
    mean = float(np.median((time[span:] - time[:-span]) / span))
    return np.append(np.flatnonzero(np.abs(advance) > _WITHIN * mean), len(time) - 1)


def _rounded(time: FloatArray, lasts: IntArray) -> bool:
    """Whether packs share one stamp, a whole multiple of one tick: the clock is coarse, and packs have no arrival."""
    stamps = time[lasts]
    tick = float(np.median(np.diff(stamps)))
    if np.median(np.diff(time)) != 0.0 or not tick > 0.0:
        return False
    return bool(np.mean(np.isclose(stamps / tick, np.rint(stamps / tick), rtol=0.0, atol=1e-5)) > _WHOLE)


def _sent_again(data: ClockData, lasts: IntArray) -> bool:
    """Whether a clock of commands alone shows commands that are sent several times at each change."""
    if data.measured in data.values:
        return False
    columns = np.array(list(data.values.values()))
    changes = np.flatnonzero(np.any(np.diff(columns, axis=1) != 0.0, axis=0))
    return not len(changes) or float(np.mean(np.isin(changes, lasts))) > _SENT_AGAIN


def _spread(data: ClockData, lasts: IntArray, usual: float) -> ClockData:
    """The readings on one line, where it passes the last ones of all packs; else even within each pack."""
    rows = np.arange(len(data.time))
    sizes = np.diff(lasts, prepend=-1)
    ends = data.time[lasts + 1 - sizes]
    # The last pack may have been sent before it was full.
    ends[-1] = ends[-2] + usual * sizes[-1]
    line = np.polynomial.Polynomial.fit(lasts, ends, 1)
    if np.abs(ends - line(lasts)).max() < usual:
        return replace(data, time=line(rows))
    intervals = np.diff(ends, prepend=ends[0] - usual * sizes[0]) / sizes
    # Readings were lost before a pack that lasts too long; the clock was set back before one that lasts no time.
    intervals[(intervals > _LOST * usual) | (intervals <= 0.0)] = usual
    pack = np.searchsorted(lasts, rows)
    return replace(data, time=ends[pack] - (lasts[pack] - rows) * intervals[pack])


DETECTORS: Detectors = {"clock": (_detect,)}
