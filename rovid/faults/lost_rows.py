"""Rows lost at random from an otherwise regular log.

The intervals are whole multiples of the usual one, and the readings stay on its grid. What a command did within such a
hole is not known. Irregular clocks leave the grid; clocks that skip every second or third tick do so evenly, not at
random; topics published on change never repeat a value.
"""

from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from typing import Any, TypeVar

import numpy as np

from rovid.core.array_types import BoolArray, FloatArray
from rovid.faults.base import ClockData, ClocksData, Detection, Detectors, Intervals
from rovid.trial.fault import Fault
from rovid.trial.segments import subsampled_median

_Stamps = TypeVar("_Stamps", ClockData, ClocksData)
# Holes, and share of lost rows, up to which a loss is usual: sensors and recorders lose single rows, and seldom several
# in succession. With 3 % at most one change of a command in thirty is off by an interval. A log is named where it loses
# more by this many deviations.
_LEAST_HOLES, _USUAL_SHARE, _USUAL_LONGER, _DEVIATIONS = 3, 0.03, 0.01, 3.0
# Readings that a log needs.
_FEWEST = 20
# Usual intervals without any reading from which the recording paused; the commands are then unknown, even if they are
# the same before and after.
_PAUSE = 20.0
# Pauses that a message lists.
_SHOWN = 3
# Usual intervals from which a hole is a gap: rows lost at random are lost by one or a few.
_GAP = 10.0
# Holes from which their places show whether they are at random; with fewer holes no clock skips every few ticks.
_PLACES = 5
# Usual intervals within which most intervals of regular commands lie.
_REGULAR = 3.0
# Distance from the median interval, in median intervals, of those whose mean is the usual interval.
_NEAR = 0.3
# Distance from a whole multiple of the usual interval, in usual intervals, and share of the intervals within it.
_OFF_GRID, _ON_GRID = 0.15, 0.95
# Standard deviation of the rows between holes over that of chance, above which they are at random.
_AT_RANDOM = 0.5
# Share of the rows with a reading of the measured signal, below which a table joins several sensors.
_FULL = 0.8
# Share of readings that repeat all values of the one before: below it a command may be published on change.
_REPEATED = 0.1
# Share of the changes of a signal that are one step of its resolution: above it the signal is logged on change.
_ONE_STEP = 0.5


def _detect(data: ClockData) -> Iterator[Detection[ClockData]]:
    if len(data.time) < _FEWEST or not data.interval > 0.0:
        return
    time = np.sort(data.time) if data.sortable else data.time
    found = _losses(time)
    if found is None or _on_change(data):
        return
    # Where a table joins several sensors, its rows are as irregular as their stamps. Rows lost at random would be
    # missing among those of each sensor, too.
    of_measured = np.isfinite(data.values[data.measured]) if data.measured in data.values else np.ones(len(time), bool)
    if not data.sortable and _FEWEST <= of_measured.sum() < _FULL * len(time) and _losses(time[of_measured]) is None:
        return
    ticks, holes = found
    lost = int((ticks[ticks < _GAP] - 1.0).sum())
    total = lost + len(time)
    share = lost / total
    fault = Fault(
        fault="lost_rows",
        logs=(data.log,),
        text=f"{data.log}: {share:.1%} of the rows of {data.clock} are missing, {lost} in {holes.sum()} holes.",
        size=share,
        standard_error=float(np.sqrt(share * (1.0 - share) / total)),
        remedy="unknown" if data.commands else "none",
    )
    rows = np.flatnonzero(ticks > 1.0)
    unknown = tuple(zip(time[rows].tolist(), time[rows + 1].tolist(), strict=True)) if data.commands else ()
    done = "The commands within the holes are taken as unknown." if data.commands else "Nothing needs to be done."
    yield Detection(fault=fault, done=done, repair=partial(_unknown, intervals=unknown))


def _pauses(data: ClockData) -> Iterator[Detection[ClockData]]:
    """Long holes of a table with the measured signal and the commands: several tests, or an interrupted one."""
    if len(data.time) < _FEWEST or not data.interval > 0.0 or not data.commands or data.measured not in data.values:
        return
    time = np.sort(data.time) if data.sortable else data.time
    rows = np.flatnonzero(np.diff(time) > _PAUSE * data.interval)
    if not rows.size:
        return
    holes = tuple(zip(time[rows].tolist(), time[rows + 1].tolist(), strict=True))
    yield _pause(data.log, "no row", float(time[0]), holes)


def _common_pauses(data: ClocksData) -> Iterator[Detection[ClocksData]]:
    """Long holes that the motion and all commands have in common, in topics or files of their own."""
    if min(map(len, (data.measured, *data.commands))) < _FEWEST:
        return
    interval = subsampled_median(np.diff(data.measured))
    rows = np.flatnonzero(np.diff(data.measured) > _PAUSE * interval)
    holes = zip(data.measured[rows].tolist(), data.measured[rows + 1].tolist(), strict=True)
    common = tuple(hole for hole in holes if all(_is_silent(time, *hole, interval) for time in data.commands))
    if common:
        yield _pause(data.log, "nothing", float(data.measured[0]), common)


def _is_silent(time: FloatArray, begin: float, end: float, margin: float) -> bool:
    """Whether readings at the (n,) ``time``, which are regular elsewhere, are absent from ``begin`` to ``end``, in s.

    ``margin``: usual interval in s of the motion, within which a pause may begin and end.
    """
    usual, longest = np.percentile(np.diff(time), (50.0, 90.0)).tolist()
    margin = max(margin, usual)
    inside = time[(time > begin + margin) & (time < end - margin)]
    return not inside.size and longest < _REGULAR * usual and end - begin > _REGULAR * longest + 2.0 * usual


def _pause(log: str, what: str, start: float, intervals: Intervals) -> Detection[Any]:
    """Pauses of a recording between these ``intervals`` in s, from ``start`` on."""
    holes = [f"{begin - start:.1f} to {end - start:.1f} s" for begin, end in intervals[:_SHOWN]]
    text = f"{log}: {what} is logged from {' and from '.join(holes)}"
    if len(intervals) > _SHOWN:
        text += f", and {len(intervals) - _SHOWN} more times"
    fault = Fault(
        fault="lost_rows",
        logs=(log,),
        text=f"{text}: the recording paused, or its clock was set ahead.",
        at=tuple(begin - start for begin, _ in intervals),
        size=sum(end - begin for begin, end in intervals),
        unit="s",
        remedy="cut",
    )
    done = "The log was cut there, and each part is a run of its own."
    return Detection(fault=fault, done=done, repair=partial(_unknown, intervals=intervals))


def _losses(time: FloatArray) -> tuple[FloatArray, BoolArray] | None:
    """(n-1,) usual intervals that each interval of the (n,) ``time`` in s lasts, and where rows are lost; None if none.

    A reading that comes late shortens the next interval: nothing is lost.
    """
    advance = np.diff(time)
    median = subsampled_median(advance[advance > 0.0])
    near = advance[np.abs(advance - median) < _NEAR * median]
    if advance.min() < 0.0 or not near.size:
        return None
    interval = float(near.mean())  # To a precision that the median of rounded stamps lacks.
    ticks = np.rint(advance / interval)
    holes = (ticks > 1.0) & (ticks < _GAP)
    lost = int((ticks[ticks < _GAP] - 1.0).sum())
    total = lost + len(time)
    longer = int((ticks[holes & (ticks > 2.0)] - 1.0).sum())
    losses = [(lost, _USUAL_SHARE * total), (longer, _USUAL_LONGER * total)]
    if holes.sum() < _LEAST_HOLES or all(count < usual + _DEVIATIONS * np.sqrt(usual) for count, usual in losses):
        return None
    on_grid = np.abs(advance - ticks * interval) < _OFF_GRID * interval
    if min(np.mean(on_grid), np.mean(on_grid[holes])) < _ON_GRID:
        return None
    share = float(np.mean(holes))
    by_chance = np.sqrt(1.0 - share) / share  # Standard deviation of a geometric distribution, of rows between holes.
    if np.count_nonzero(holes) >= _PLACES and np.std(np.diff(np.flatnonzero(holes))) <= _AT_RANDOM * by_chance:
        return None
    return ticks, holes


def _on_change(data: ClockData) -> bool:
    """Whether readings are only logged when a value changes: no row is lost then."""
    columns = np.array(list(data.values.values()))
    changed = np.diff(columns, axis=1) != 0.0
    if np.mean(~np.any(changed, axis=0)) >= _REPEATED:
        return False
    if data.measured not in data.values:
        return True
    values = data.values[data.measured]
    steps = np.abs(np.diff(values[np.isfinite(values)]))
    steps = steps[steps > 0.0]
    return not steps.size or float(np.mean(steps < 1.5 * steps.min())) > _ONE_STEP


def _unknown(data: _Stamps, intervals: Intervals) -> _Stamps:
    return replace(data, unknown=(*data.unknown, *intervals))


DETECTORS: Detectors = {"clock": (_detect, _pauses), "clocks": (_common_pauses,)}
