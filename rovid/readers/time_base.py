"""Signals of one log on their own clocks, and the common instants of a trial."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from rovid.core.array_types import BoolArray, FloatArray, IntArray
from rovid.readers.timestamps import is_plausible
from rovid.signals.intervals import gap_limit


@dataclass(frozen=True, kw_only=True, eq=False)
class TimedSeries:
    """One signal in order of time."""

    time: FloatArray  #: (m,) s, strictly increasing. Signals of one clock share the array itself, which saves searches.
    values: FloatArray  #: (m,) in SI or the unit of the command; NaN where missing.

    @cached_property
    def is_known(self) -> BoolArray:
        """(m,) where the value is not missing."""
        return is_plausible(self.values)

    @cached_property
    def missing(self) -> int:
        """Number of missing samples."""
        return len(self.is_known) - int(np.count_nonzero(self.is_known))

    @cached_property
    def known_time(self) -> FloatArray:
        """(k,) s of the known values; ``time`` itself if none is missing."""
        return self.time[self.is_known] if self.missing else self.time

    @cached_property
    def known(self) -> FloatArray:
        """(k,) known values."""
        return self.values[self.is_known] if self.missing else self.values

    @cached_property
    def held(self) -> FloatArray:
        """(m,) last known value; NaN before the first."""
        if not self.missing:
            return self.values
        last = np.maximum.accumulate(np.where(self.is_known, np.arange(len(self.is_known)), -1))
        return np.where(last < 0, np.nan, self.values[last])

    @cached_property
    def changed(self) -> BoolArray:
        """(m,) where the held value differs from the one before."""
        return np.concatenate(([False], np.diff(self.held) != 0.0))


@dataclass(frozen=True, kw_only=True, eq=False)
class TimeBase:
    """The (n,) instants ``time`` of a trial in s; if all lie on one ``clock``, ``rows`` are their samples there."""

    time: FloatArray
    clock: FloatArray | None = None
    rows: BoolArray | slice = field(default_factory=lambda: slice(None))

    @classmethod
    def union(cls, position: TimedSeries, commands: Sequence[TimedSeries], begin: float, end: float) -> TimeBase:
        """Instants from ``begin`` to ``end`` (s) at which the position was measured or a command changed."""
        if all(command.time is position.time for command in commands):
            first, last = np.searchsorted(position.time, (begin, end)).tolist()
            rows: BoolArray | slice = slice(first, last + 1)
            if position.missing:
                rows = position.is_known.copy()
                for command in commands:
                    rows |= command.changed
                rows[:first] = rows[last + 1 :] = False
            return cls(time=position.time[rows], clock=position.time, rows=rows)
        measured = position.known_time[(position.known_time >= begin) & (position.known_time <= end)]
        changes = [command.time[command.changed] for command in commands]
        inside = [times[(times > begin) & (times < end)] for times in changes]
        times = np.sort(np.concatenate([measured, *inside]), kind="stable")  # Merges sorted runs; unique would not.
        # Instants that are distinct to the precision of a float.
        return cls(time=times[np.diff(times - times[0], prepend=-1.0) > 0.0])

    def hold(self, series: TimedSeries) -> FloatArray:
        """(n,) last value known at or before each instant; NaN before the first."""
        if series.time is self.clock:
            return series.held[self.rows]
        if not series.known_time.size:
            return np.full(len(self.time), np.nan)
        at = np.searchsorted(series.known_time, self.time, side="right") - 1
        return np.where(at < 0, np.nan, series.known[at])

    def match(self, series: TimedSeries) -> FloatArray:
        """(n,) value measured at each instant; NaN where there is none."""
        if series.time is self.clock:
            return series.values[self.rows]
        at = np.minimum(np.searchsorted(series.known_time, self.time), len(series.known_time) - 1)
        return np.where(series.known_time[at] == self.time, series.known[at], np.nan)

    def interpolate(self, series: TimedSeries, *, angle: bool) -> FloatArray:
        """(n,) linear interpolation, along the shorter arc for an ``angle``; NaN in gaps and outside the series."""
        if series.time is self.clock and not series.missing:
            return series.values[self.rows]
        stamps = series.known_time
        known = np.unwrap(series.known) if angle else series.known
        after = np.minimum(np.searchsorted(stamps, self.time), len(stamps) - 1)
        before = np.maximum(after - 1, 0)
        exact = stamps[after] == self.time
        inside = (stamps[before] <= self.time) & (self.time <= stamps[after])
        near = stamps[after] - stamps[before] <= gap_limit(np.diff(stamps))
        return np.where(exact | (inside & near), np.interp(self.time, stamps, known), np.nan)


def integral(time: FloatArray, rate: FloatArray) -> FloatArray:
    """(n,) integral of the rate by the trapezoidal rule; NaN where not measured."""
    known = np.flatnonzero(np.isfinite(rate))
    steps = 0.5 * (rate[known][1:] + rate[known][:-1]) * np.diff(time[known])
    return cumulative(steps, known, len(time))


def cumulative(steps: FloatArray, known: IntArray, count: int) -> FloatArray:
    """(count,) cumulative sum of the (m-1,) ``steps`` between the (m,) ``known`` rows; NaN in the others."""
    position = np.full(count, np.nan)
    position[known] = np.concatenate(([0.0], np.cumsum(steps)))
    return position
