"""Wild stamps: single readings with a time far from that of their neighbours.

A stamp is wild where dropping it leaves the rest in order, at the usual interval. Readings logged before the clock was
set (stamps of 0, 1970 or 2000) precede a leap of hours, and are wild if they are few; a single stamp of 0, or below,
precedes any gap.
"""

from collections.abc import Iterator

import numpy as np

from rovid.core.array_types import BoolArray, FloatArray
from rovid.faults.base import ClockData, Detection, Detectors
from rovid.trial.fault import Fault
from rovid.trial.segments import find_leap

# Readings in a row that can be wild between good ones; more of them are a step of the clock.
_MOST_IN_A_ROW = 3
# Readings at an end of the log, before or after a leap, that are left out; a longer part is a log of its own.
_MOST_AT_END = 9
# Share of steps back, above which a clock has no order; origin: as many readings were once dropped at most.
_MOST_BACK = 0.05
# Interval across the dropped readings, in usual intervals of as many readings. Below: a clock set back.
_LEAST, _MOST = 0.6, 2.0
# Excursion in usual intervals that no step back explains, because so few readings stand ahead of it.
_VERY_FAR = 10.0
# s; recorders store messages out of order by less, and sort them.
_DISORDER = 1.0
# Usual intervals from a first stamp of zero or below to the next one, from which the clock was not set: no pause begins
# with one reading.
_UNSET = 20.0
# Intervals by which a first or last stamp must be out of order: single messages are stored late by one or two.
_FAR = 3.0


def _detect(data: ClockData) -> Iterator[Detection[ClockData]]:
    wild = _wild(data.time, data.interval, _DISORDER if data.sortable else 0.0)
    if data.measured in data.values and len(wild) > 1 and data.time[0] <= 0.0:
        wild[0] |= data.time[1] - data.time[0] > _UNSET * data.interval
    rows = np.flatnonzero(wild)
    if not rows.size:
        return
    good = np.flatnonzero(~wild)
    usual = np.interp(rows, good, data.time[good])
    offsets = data.time[rows] - usual
    worst = float(offsets[np.argmax(np.abs(offsets))])
    places = data.place(int(data.rows[rows[0]]))
    count = "a wild stamp" if len(rows) == 1 else f"{len(rows)} wild stamps, the first"
    at = tuple(float(value) for value in usual - data.time[good[0]])
    fault = Fault(
        fault="wild_stamp",
        logs=(data.log,),
        text=f"{data.log}: {data.clock} has {count} at {places}, {abs(worst):.6g} s from its neighbours.",
        at=at,
        size=worst,
        standard_error=data.interval,
        unit="s",
        remedy="left_out",
    )
    done = "The reading was left out." if len(rows) == 1 else "These readings were left out."
    yield Detection(fault=fault, done=done, repair=lambda found: found.select(~wild))


def _wild(time: FloatArray, interval: float, disorder: float) -> BoolArray:
    """(n,) where the ``time`` in s, usually ``interval`` apart, is wild by more than ``disorder`` in s."""
    wild = np.zeros(len(time), dtype=bool)
    back = np.flatnonzero(np.diff(time) < -disorder)
    if len(back) > max(1, _MOST_BACK * len(time)):
        return wild
    for row in back.tolist():
        runs = (_ahead(time, row), _behind(time, row))
        for run in sorted(runs, key=lambda run: run.stop - run.start):
            if _leaves_order(time, run, interval):
                wild[run] = True
                break
    good = np.flatnonzero(~wild)
    while (leap := find_leap(time[good])) is not None:
        if leap < _MOST_AT_END:
            wild[good[: leap + 1]] = True
        elif len(good) - leap - 2 < _MOST_AT_END:
            wild[good[leap + 1 :]] = True
        else:
            break
        good = np.flatnonzero(~wild)
    return wild


def _ahead(time: FloatArray, row: int) -> slice:
    """Readings up to ``row`` that are later than the next one, one more than can be wild at most."""
    begin = max(0, row - _MOST_IN_A_ROW)
    later = time[begin : row + 1] > time[row + 1]
    return slice(row + 1 - int(np.argmin(np.append(later[::-1], False))), row + 1)


def _behind(time: FloatArray, row: int) -> slice:
    """Readings after ``row`` that are earlier than it, one more than can be wild at most."""
    earlier = time[row + 1 : row + 2 + _MOST_IN_A_ROW] < time[row]
    return slice(row + 1, row + 1 + int(np.argmin(np.append(earlier, False))))


def _leaves_order(time: FloatArray, run: slice, interval: float) -> bool:
    """Whether the readings around ``run`` follow each other as if only those in it lay between."""
    count = run.stop - run.start
    if count > _MOST_IN_A_ROW:
        return False
    if run.start == 0:
        return bool(time[run.stop - 1] - time[run.stop] > _FAR * interval)
    if run.stop == len(time):
        return bool(time[run.start - 1] - time[run.start] > _FAR * interval)
    across = time[run.stop] - time[run.start - 1]
    usual = (count + 1) * interval
    excursion = np.abs(time[run] - time[run.start - 1]).min()
    return bool(across >= 0.0 and (_LEAST * usual <= across <= _MOST * usual or excursion > _VERY_FAR * usual))


DETECTORS: Detectors = {"clock": (_detect,)}
