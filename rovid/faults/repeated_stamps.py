"""Repeated stamps: several readings with one time stamp, the next stamps missing.

Clocks rounded to whole seconds or milliseconds, or read once per batch, repeat stamps. Where the readings up to the
next stamp fill the time at the usual interval, the sensor is regular: they are spread over that time. A reading stored
twice instead leaves no time: its copy is left out, as elsewhere.
"""

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial

import numpy as np

from rovid.core.array_types import BoolArray, FloatArray, IntArray
from rovid.faults.base import ClockData, Detection, Detectors
from rovid.trial.fault import Fault

# Repeated stamps, below which the damage does not matter.
_LEAST = 3
# s; closer stamps are equal.
_TICK = 1e-9
# Limits of the interval that readings with one stamp have if spread, in usual intervals.
_LEAST_INTERVAL, _MOST_INTERVAL = 0.7, 1.4
# Share of the groups that the readings fill at the usual interval.
_FILLED = 0.8
# Intervals by which a stamp may be off the regular one.
_OFF_GRID = 0.3
# Range of the errors of rounded stamps in steps of the rounding, where the fit of the line is off by a little; distance
# of a whole multiple of it; least rounding in intervals.
_ROUNDED, _WHOLE, _COARSE = 1.1, 0.01, 1.1
# Share of repeated stamps whose values differ from the reading before, below which readings are stored twice.
_NEW = 0.05


def _detect(data: ClockData) -> Iterator[Detection[ClockData]]:
    repeated = np.abs(np.diff(data.time)) <= _TICK
    firsts = np.flatnonzero(np.concatenate(([True], ~repeated)))
    if min(int(repeated.sum()), len(firsts)) < _LEAST or _stored_twice(data, repeated):
        return
    sizes = np.diff(np.append(firsts, len(data.time)))
    known = np.isfinite(np.array(list(data.values.values())))
    most = np.add.reduceat(known, firsts, axis=1, dtype=np.int64).max(axis=0)
    if np.mean(most[sizes > 1] > 1) < _FILLED:  # Each row holds another signal.
        return
    if (even := _unrounded(data.time)) is not None:
        yield _found(data, repeated, float(np.mean(np.diff(even))), partial(replace, time=even))
        return
    stamps = data.time[firsts]
    steps = np.diff(stamps)
    usual = _usual(steps, sizes[:-1])
    # A stamp off by one unit of its resolution moves no reading by more than that.
    resolution = float(np.abs(steps).min()) if np.mean(repeated) > 0.25 else 0.0
    expected = usual * sizes[:-1]
    fills = (steps > _LEAST_INTERVAL * expected - resolution) & (steps < _MOST_INTERVAL * expected + resolution)
    groups = sizes[:-1] > 1
    # The first group may have begun before the log.
    if not groups[1:].any():
        return
    exact = _with_own_stamps(data.time)
    if exact is None and np.mean(fills[1:][groups[1:]]) < _FILLED:
        return
    spread = partial(_spread, firsts=firsts, usual=usual, fills=fills)
    yield _found(data, repeated, usual, spread if exact is None else partial(replace, time=exact))


def _found(
    data: ClockData, repeated: BoolArray, usual: float, repair: Callable[[ClockData], ClockData]
) -> Detection[ClockData]:
    count = int(repeated.sum())
    fault = Fault(
        fault="repeated_stamps",
        logs=(data.log,),
        text=f"{data.log}: {data.clock} repeats the stamp before it {count} times, and the next stamps are missing.",
        size=count / len(data.time),
        standard_error=float(np.sqrt(count) / len(data.time)),
        remedy="none",
    )
    return Detection(fault=fault, done=f"The readings were spread evenly, about {usual:.4g} s apart.", repair=repair)


def _with_own_stamps(time: FloatArray) -> FloatArray | None:
    """(n,) s of a regular clock, some of whose readings have the stamp of the reading before; None for other clocks.

    Two such readings in a row repeat one stamp, not two. The number of the reading shows which stamps are late.
    """
    interval = float(time[-1] - time[0]) / (len(time) - 1)
    if not interval > _TICK:
        return None
    late = (time[0] + interval * np.arange(len(time)) - time) / interval
    late -= np.median(late)
    whole = np.rint(late)
    if np.abs(late - whole).max() > _OFF_GRID or whole.min() < 0.0 or whole.max() > 1.0:
        return None
    return np.asarray(time + interval * whole)


def _unrounded(time: FloatArray) -> FloatArray | None:
    """(n,) s of a regular clock whose readings, rounded to more than their interval, are the stamps; None for others.

    The stamps are whole multiples of the rounding, and off by one step of it at most. A spread from stamp to stamp
    would be off by as much.
    """
    steps = np.diff(time)
    resolution = float(steps[steps > _TICK].min(initial=np.inf))
    rows = np.arange(len(time), dtype=np.float64)
    interval, start = np.polyfit(rows, time - time[0], 1).tolist()
    even = time[0] + start + interval * rows
    scatter = float(np.ptp(time - even))
    is_multiple = np.all(np.abs(steps / resolution - np.rint(steps / resolution)) < _WHOLE)
    is_rounded = 0.5 * resolution < scatter <= _ROUNDED * resolution
    # A rounding that is nearly the interval looks like a row that is stored twice here and there.
    return even if is_multiple and is_rounded and resolution > _COARSE * interval > _TICK else None


def _usual(steps: FloatArray, sizes: IntArray) -> float:
    """Usual interval in s: the median over the readings of each stamp, long gaps and steps of the clock aside."""
    order = np.argsort(steps / sizes)
    middle = np.searchsorted(np.cumsum(sizes[order]), 0.5 * sizes.sum())
    near = np.abs(steps) < 3.0 * np.median(np.abs(steps))
    mean = float(steps[near].sum() / sizes[near].sum())
    median = float((steps / sizes)[order[middle]])
    # The mean is exact where each stamp is rounded, the median where few stamps are repeated.
    return mean if np.mean(sizes > 1) > 0.25 else median


def _stored_twice(data: ClockData, repeated: BoolArray) -> bool:
    """Whether the readings with repeated stamps hold nothing new, while the others mostly do."""
    columns = np.array(list(data.values.values()))
    before, after = columns[:, :-1], columns[:, 1:]
    new = np.any((before != after) & ~(np.isnan(before) & np.isnan(after)), axis=0)
    return bool(np.mean(new[repeated]) < _NEW) and bool(np.mean(new[~repeated]) > 2.0 * _NEW)


def _spread(data: ClockData, firsts: IntArray, usual: float, fills: BoolArray) -> ClockData:
    """The readings spread from each stamp to the next; those of stamps that they do not fill stay."""
    rows = np.arange(len(data.time))
    group = np.searchsorted(firsts, rows, side="right") - 1
    sizes = np.diff(np.append(firsts, len(rows)))
    stamps = data.time[firsts]
    ends = np.append(stamps[1:], stamps[-1] + usual * sizes[-1])
    intervals = np.where(np.append(fills, True), (ends - stamps) / sizes, 0.0)
    begins = stamps.copy()
    intervals[0], begins[0] = usual, ends[0] - usual * sizes[0]
    if sizes[0] == 1:
        intervals[0], begins[0] = 0.0, stamps[0]
    return replace(data, time=begins[group] + (rows - firsts[group]) * intervals[group])


DETECTORS: Detectors = {"clock": (_detect,)}
