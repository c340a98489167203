"""Steps of the clock: set back or ahead while the log was recorded.

After a step back all later stamps stand back. Messages stored out of order return to the old clock instead: over twice
as many readings, the clock advances as usual. A step ahead is a gap over which heading and rate run on as if no time
had passed. Test: lines through the heading before and after the gap meet, and so well meet hardly any two parts of
the log that lie as far apart in time and move as fast. A leap of hours is a step without this test.
"""

from collections.abc import Iterator
from dataclasses import replace
from functools import partial

import numpy as np

from rovid.core.array_types import FloatArray, IntArray
from rovid.faults.base import ClockData, ClockStep, Detection, Detectors
from rovid.trial.fault import Fault
from rovid.trial.segments import find_leap

# Steps of one log at most, and readings from one to the next at least; more steps are no clock.
_MOST_STEPS, _LEAST_APART = 20, 10
# Readings before and after a step back over which its advance is counted.
_REACH = 200
# Usual intervals by which a gap must exceed the usual interval to be tested as a step ahead: stamps of arrival scatter
# by a few intervals.
_LEAST_INTERVALS = 5.0
# Readings on each side of a gap through which a line is drawn: few for fast vehicles, more for noisy headings.
_LINES = (3, 6)
# Lines like those at the gap that are needed for a limit.
_LEAST_LINES = 30
# Share of uninterrupted readings whose lines meet better than the limit for "the heading ran on".
_MEETS = 0.98
# Multiple of the limit of the offset within which lines are counted: a short log has too few for a small probability.
_WIDER = 4.0
# Ratio of the slopes of two lines, up to which the motion is as fast.
_ALIKE = 2.0
# Relative error of the usual interval, over which lines far apart are still taken as far apart as the gap is long.
_UNEVEN = 0.02
# Gaps of one log at most; with more of them none is rare enough.
_MOST_GAPS = 50
# Least standard error of a step, in usual intervals: stamps have a limited resolution.
_LEAST_ERROR = 0.01
# Probability, over all tested gaps of a log, that a gap in which time passed looks like a step ahead.
_FALSE_ALARMS = 0.02


def _detect(data: ClockData) -> Iterator[Detection[ClockData]]:
    own = data.measured in data.values
    steps = [] if own else [step for step in data.steps if _row(data, step) is not None]
    rest = data
    for step in steps:
        rest = _without(rest, step)
    subject = "the clock" if own else f"the clock of {data.clock}"
    named = [("the clock", step) for step in steps] + [(subject, step) for step in _steps(rest)]
    for subject, step in named:
        days = abs(step.size) / 86400.0
        amount = f"{days:.1f} days" if days >= 1.0 else f"{abs(step.size):.2f} s"
        side = "ahead" if step.size > 0.0 else "back"
        fault = Fault(
            fault="clock_step",
            logs=(data.log,),
            text=f"{data.log}: {subject} was set {side} by {amount} at {step.at:.1f} s.",
            at=(step.at,),
            size=step.size,
            standard_error=step.error,
            unit="s",
            confidence=step.confidence,
            remedy="cut",
        )
        done = "The step was taken out, and the log was cut there."
        yield Detection(fault=fault, done=done, repair=partial(_without, step=step))


def _steps(data: ClockData) -> list[ClockStep]:
    """Steps by the stamps themselves and, on the clock of the measured signal, by the motion; the earliest first."""
    time, interval = data.time, data.interval
    if len(time) < 2 * _LEAST_APART or not interval > 0.0:
        return []
    advance = np.diff(time)
    confidence = {row: 0.99 for row in np.flatnonzero(advance < 0.0).tolist() if _stands_back(time, row, interval)}
    if len(confidence) > _MOST_STEPS:
        return []
    forward = np.where(advance < 0.0, interval, advance)
    while (leap := find_leap(np.concatenate(([0.0], np.cumsum(forward))))) is not None:
        confidence[leap] = 0.99
        forward[leap] = interval
    gaps = np.flatnonzero(forward > (1.0 + _LEAST_INTERVALS) * interval)
    for row, chance in zip(gaps.tolist(), _chances(data, gaps), strict=True):
        if chance * len(gaps) < _FALSE_ALARMS:
            confidence[row] = 1.0 - chance * len(gaps)
    rows = np.array(sorted(confidence), dtype=np.int64)
    apart = np.minimum(np.diff(rows, prepend=-1), np.diff(rows, append=len(advance)))
    rows = rows[apart >= _LEAST_APART]
    usual = advance[np.abs(advance - interval) < interval]
    error = max(float(np.std(usual)) if usual.size else 0.0, _LEAST_ERROR * interval)
    sizes = advance[rows] - interval
    taken = np.cumsum(sizes) - sizes
    return [
        ClockStep(
            before=float(time[row] - earlier),
            after=float(time[row + 1] - earlier),
            size=float(size),
            error=error,
            at=float(time[row] - earlier - time[0]),
            confidence=confidence[row],
        )
        for row, size, earlier in zip(rows.tolist(), sizes, taken, strict=True)
    ]


def _stands_back(time: FloatArray, row: int, interval: float) -> bool:
    """Whether all readings after ``row`` stand back, rather than a few that are stored late."""
    later = time[row + 1 : row + 1 + _REACH] >= time[row]
    reach = int(np.argmax(np.append(later, True))) + 3
    reach = min(reach, row, len(time) - row - 2)
    if reach < 1:
        return False
    before, after = time[max(0, row - 3 * reach) : row - reach + 1], time[row + 1 + reach : row + 2 + 3 * reach]
    paces = [(part[-1] - part[0]) / (len(part) - 1) for part in (before, after) if len(part) > reach]
    pace = float(np.mean(paces)) if paces else interval
    # Set back, the clock advances by less than the pace of as many readings. Late messages change nothing.
    lacks = (2 * reach + 1) * pace - (time[row + 1 + reach] - time[row - reach])
    return bool(lacks > 0.5 * (interval - (time[row + 1] - time[row])))


class _Lines:
    """Lines through each ``length`` successive readings of an angle or a distance."""

    def __init__(self, time: FloatArray, values: FloatArray, period: float, interval: float, length: int) -> None:
        self.time, self.period, self.interval, self.length = time, period, interval, length
        values = np.unwrap(values, period=period) if np.isfinite(period) else values
        windows = np.lib.stride_tricks.sliding_window_view(values, length)
        place = np.arange(length) - 0.5 * (length - 1)
        #: Change per reading, value in the middle, and whether the readings follow each other without a gap.
        self.slope, self.middle = windows @ place / np.sum(place**2), windows.mean(axis=1)
        self.whole = time[length - 1 :] - time[: 1 - length] < 1.5 * (length - 1) * interval

    def meet(self, first: IntArray, second: IntArray) -> FloatArray:
        """(2, n) offset and change of slope from line to line, if the second one begins a reading after the first."""
        offset = self.middle[second] - self.middle[first] - 0.5 * self.length * (self.slope[first] + self.slope[second])
        if np.isfinite(self.period):
            offset -= self.period * np.rint(offset / self.period)
        differences: FloatArray = np.abs(np.array([offset, self.slope[second] - self.slope[first]]))
        return differences

    def pairs(self, shift: int, like: int) -> FloatArray:
        """(2, m) `meet` of all lines that begin ``shift`` readings apart, the first about as steep as line ``like``."""
        slope = np.abs(self.slope)
        alike = (slope >= slope[like] / _ALIKE) & (slope <= slope[like] * _ALIKE)
        first = np.flatnonzero(self.whole[:-shift] & self.whole[shift:] & alike[:-shift])
        lasts = self.time[first + shift] - self.time[first]
        first = first[np.abs(lasts - shift * self.interval) < max(1.0, _UNEVEN * shift) * self.interval]
        return self.meet(first, first + shift)

    def chance(self, gap: int) -> float:
        """Probability that the lines meet across the gap after reading ``gap`` though time passed; 1 if they do not."""
        first = gap - self.length + 1
        if first < 0 or gap + self.length >= len(self.time) or not (self.whole[first] and self.whole[gap + 1]):
            return 1.0
        usual = self.pairs(self.length, first)
        lag = round((self.time[gap + 1] - self.time[gap]) / self.interval)
        others = self.pairs(min(lag, len(self.time) // 2) + self.length - 1, first)
        if usual.shape[1] < _LEAST_LINES:
            return 1.0
        limits = np.quantile(usual, _MEETS, axis=1, keepdims=True)
        if np.any(self.meet(np.array([first]), np.array([gap + 1])) > limits):
            return 1.0
        # Of lines that lie apart by far more than the limit, the offsets are spread evenly about zero.
        wider, count = np.array([[_WIDER], [1.0]]), 1 + others.shape[1]
        meeting, near = (np.all(others <= limits * each, axis=0).sum() for each in (1.0, wider))
        return float(max(meeting / count, (1 + near) / (_WIDER * count)))


def _chances(data: ClockData, gaps: IntArray) -> list[float]:
    """Probability for each gap that the measured signal only seems to run on over it; 1 where it does not."""
    values = data.values.get(data.measured)
    known = np.flatnonzero(np.isfinite(values)) if values is not None else np.zeros(0, dtype=np.int64)
    if not len(gaps) or values is None or len(known) < 10 * max(_LINES) or len(gaps) > _MOST_GAPS:
        return [1.0] * len(gaps)
    period = data.periods.get(data.measured, np.inf)
    lines = [_Lines(data.time[known], values[known], period, data.interval, length) for length in _LINES]
    rows = (np.searchsorted(known, gaps, side="right") - 1).tolist()
    # The best of several tests is as many times as likely by chance.
    return [min(1.0, len(lines) * min(each.chance(row) for each in lines)) for row in rows]


def _row(data: ClockData, step: ClockStep) -> int | None:
    """Number of the reading after which this clock made the ``step`` of the measured signal's; None if it did not."""
    time, advance = data.time, np.diff(data.time)
    if not len(advance):
        return None
    row = int(np.argmin(np.abs(time[:-1] - step.before) + np.abs(time[1:] - step.after)))
    if step.size > 0.0:
        return row if advance[row] > 0.9 * step.size else None
    is_regular = np.quantile(np.abs(advance - data.interval), 0.5) < 0.3 * data.interval
    usual = data.interval + 0.5 * step.size
    return row if not is_regular or advance[row] < usual else None


def _without(data: ClockData, step: ClockStep) -> ClockData:
    """The readings with the ``step`` taken out of the clock, cut there."""
    row = _row(data, step)
    if row is None:
        return data
    time = data.time.copy()
    time[row + 1 :] -= step.size
    # The same instant on all clocks of the log.
    cut = step.before + 0.5 * (step.after - step.size - step.before)
    steps = (*data.steps, step) if data.measured in data.values else data.steps
    return replace(data, time=time, cuts=(*data.cuts, cut), steps=steps)


DETECTORS: Detectors = {"clock": (_detect,)}
