"""One signal on its own clock, and how it is put on the time base."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from rovid.core.array_types import BoolArray, FloatArray
from rovid.readers.cleaning import gap_limit
from rovid.readers.raw_log import is_plausible


@dataclass(frozen=True, kw_only=True, eq=False)
class TimedSeries:
    """One signal in order of time.

    Attributes
    ----------
    time
        (m,) s, strictly increasing. Signals of one clock share the array itself, which spares searching it.
    values
        (m,) in SI or the command's unit; NaN where missing.
    """

    time: FloatArray
    values: FloatArray

    @cached_property
    def good(self) -> BoolArray:
        """(m,) where it is not missing."""
        return is_plausible(self.values)

    @cached_property
    def missing(self) -> int:
        """How many samples are missing."""
        return len(self.good) - int(np.count_nonzero(self.good))

    @cached_property
    def stamps(self) -> FloatArray:
        """(k,) s at which it is known; ``time`` itself where nothing is missing."""
        if not self.missing:
            return self.time
        return self.time[self.good]

    @cached_property
    def known(self) -> FloatArray:
        """(k,) values at ``stamps``."""
        if not self.missing:
            return self.values
        return self.values[self.good]

    @cached_property
    def held(self) -> FloatArray:
        """(m,) last known value; NaN before the first."""
        if not self.missing:
            return self.values
        last = np.maximum.accumulate(np.where(self.good, np.arange(len(self.good)), -1))
        return np.where(last < 0, np.nan, self.values[last])

    @cached_property
    def changed(self) -> BoolArray:
        """(m,) where the held value differs from the one before."""
        return np.concatenate(([False], np.diff(self.held) != 0.0))


@dataclass(frozen=True, kw_only=True, eq=False)
class TimeBase:
    """The instants of a trial.

    Attributes
    ----------
    time
        (n,) s, strictly increasing.
    clock, rows
        Where every one of them stands on one clock: that clock, and which of its samples they are.
    """

    time: FloatArray
    clock: FloatArray | None = None
    rows: BoolArray | slice = field(default_factory=lambda: slice(None))

    def held(self, series: TimedSeries) -> FloatArray:
        """(n,) last value known at or before each instant; NaN before the first."""
        if series.time is self.clock:
            return series.held[self.rows]
        if not series.stamps.size:
            return np.full(len(self.time), np.nan)
        at = np.searchsorted(series.stamps, self.time, side="right") - 1
        return np.where(at < 0, np.nan, series.known[at])

    def exactly(self, series: TimedSeries) -> FloatArray:
        """(n,) the value measured at each instant; NaN where there is none."""
        if series.time is self.clock:
            return series.values[self.rows]
        at = np.minimum(np.searchsorted(series.stamps, self.time), len(series.stamps) - 1)
        return np.where(series.stamps[at] == self.time, series.known[at], np.nan)

    def interpolated(self, series: TimedSeries, *, angle: bool) -> FloatArray:
        """(n,) linear between neighbours no farther apart than a gap, NaN elsewhere; the short way for an ``angle``."""
        if series.time is self.clock and not series.missing:
            return series.values[self.rows]
        stamps = series.stamps
        known = np.unwrap(series.known) if angle else series.known
        after = np.minimum(np.searchsorted(stamps, self.time), len(stamps) - 1)
        before = np.maximum(after - 1, 0)
        exact = stamps[after] == self.time
        inside = (stamps[before] <= self.time) & (self.time <= stamps[after])
        near = stamps[after] - stamps[before] <= gap_limit(np.diff(stamps))
        return np.where(exact | (inside & near), np.interp(self.time, stamps, known), np.nan)


def common_base(heading: TimedSeries, commands: Sequence[TimedSeries], begin: float, end: float) -> TimeBase:
    """Instants from ``begin`` to ``end`` (s) at which the heading was measured or a command changed."""
    if all(command.time is heading.time for command in commands):
        return _one_clock(heading, commands, begin, end)
    stamps = heading.stamps[(heading.stamps >= begin) & (heading.stamps <= end)]
    changes = [command.time[command.changed] for command in commands]
    inside = [times[(times > begin) & (times < end)] for times in changes]
    times = np.sort(np.concatenate([stamps, *inside]), kind="stable")  # merges runs, where unique would sort anew
    return TimeBase(time=times[np.diff(times - times[0], prepend=-1.0) > 0.0])  # distinct to what a float can hold


def _one_clock(heading: TimedSeries, commands: Sequence[TimedSeries], begin: float, end: float) -> TimeBase:
    first, last = np.searchsorted(heading.time, (begin, end)).tolist()
    rows: BoolArray | slice = slice(first, last + 1)
    if heading.missing:
        rows = heading.good.copy()
        for command in commands:
            rows |= command.changed
        rows[:first] = rows[last + 1 :] = False
    return TimeBase(time=heading.time[rows], clock=heading.time, rows=rows)
