"""How far two clocks are apart that saw the same: a heading or a yaw rate in both files, or one command twice."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.preflight.raw_columns import FEWEST, RawColumn
from rovid.preflight.signal_guess import is_yaw_rate, turn_of_heading
from rovid.preflight.thruster_guess import is_thruster_command

# What is alike goes together to this degree at the best shift; a copy of a command to that.
_ALIKE, _COPY = 0.9, 0.999
# s by which clocks may be apart, no more than this share of what both saw.
_LONGEST, _SHARE = 30.0, 0.25
# Intervals of the coarser series over which a rate is a mean; of these the one that tells most is taken. Others tell
# about as much whose standard error is no more than so many of its own.
_SPANS, _ABOUT = (2.0, 5.0, 12.0, 30.0), 2.0
# The surest of several is a little too sure: by so much in `benchmarks.clocks`.
_TOO_SURE = 1.4
# Stretches whose scatter tells how sure it is: errors go on for a while.
_STRETCHES, _FEWEST_STRETCHES = 24, 8
_STEPS, _MOST_DRIFT = 12, 0.01


@dataclass(frozen=True, kw_only=True)
class ClockAlignment:
    """What brings a clock onto another one.

    Attributes
    ----------
    offset, error
        s to be added to it in the middle of the log, with its standard error.
    drift, drift_error
        The same that comes with each s, as a share.
    middle
        s from the beginning to that.
    by
        Columns that told it, for people.
    """

    offset: float
    error: float
    drift: float
    drift_error: float
    middle: float
    columns: str


@dataclass(frozen=True, kw_only=True, eq=False)
class _Course:
    """A running integral, so that its mean rate over any window is known: (n,) s and values."""

    source: str
    time: FloatArray
    total: FloatArray
    command: bool = False
    gyro: bool = False

    @property
    def interval(self) -> float:
        return float(np.median(np.diff(self.time)))

    def rate(self, instants: FloatArray, span: float) -> FloatArray:
        """(m,) mean rates over ``span`` s around ``instants``."""
        ends = (np.interp(instants + way * 0.5 * span, self.time, self.total) for way in (1.0, -1.0))
        return np.asarray(np.subtract(*ends) / span)

    def slope(self, instants: FloatArray, span: float) -> FloatArray:
        """(m,) how that rate changes there."""
        apart = 0.5 * span
        return np.asarray((self.rate(instants + apart, span) - self.rate(instants - apart, span)) / (2.0 * apart))


def align_clocks(reference: Mapping[str, RawColumn], other: Mapping[str, RawColumn]) -> ClockAlignment | None:
    """What brings the clock of ``other`` onto that of ``reference``; None where they hold nothing that is alike."""
    pairs = [
        (one, two)
        for one in _courses(reference)
        for two in _courses(other)
        if one.command is two.command and _overlap(one, two) > 0.0
    ]
    found = sorted((each for one, two in pairs for each in _by_spans(one, two)), key=lambda each: each.error)
    if not found:
        return None
    best = found[0]
    # What tells about as much tells how far another choice would move it.
    near = [each for each in found if each.error <= _ABOUT * best.error]
    doubt, more = (float(np.std([getattr(each, what) for each in near])) for what in ("offset", "drift"))
    error, drift_error = math.hypot(best.error, doubt), math.hypot(best.drift_error, more)
    return replace(best, error=_TOO_SURE * error, drift_error=_TOO_SURE * drift_error)


def _courses(log: Mapping[str, RawColumn]) -> Iterator[_Course]:
    for source, seen in log.items():
        known = np.isfinite(seen.values) & np.isfinite(seen.time)
        time, values = seen.time[known], seen.values[known]
        if len(time) < 4 * FEWEST or not np.ptp(values) > 0.0 or not (np.diff(time) > 0.0).all():
            continue
        if (turn := turn_of_heading(seen)) is not None:
            yield _Course(source=source, time=time, total=np.unwrap(values * (2.0 * np.pi / turn)))
        elif is_yaw_rate(source):
            steps = 0.5 * (values[1:] + values[:-1]) * np.diff(time)
            yield _Course(source=source, time=time, total=np.concatenate(([0.0], np.cumsum(steps))), gyro=True)
        elif is_thruster_command(source):
            held = np.concatenate(([0.0], np.cumsum(values[:-1] * np.diff(time))))
            yield _Course(source=source, time=time, total=held, command=True)


def _overlap(one: _Course, two: _Course) -> float:
    """S that both saw, as their clocks have it."""
    return float(min(one.time[-1], two.time[-1]) - max(one.time[0], two.time[0]))


def _by_spans(one: _Course, two: _Course) -> Iterator[ClockAlignment]:
    """By each window that tells."""
    step = max(one.interval, two.interval)
    for span in _SPANS:
        for coarse in _coarse(one, two, step, span):
            found = _refined(one, two, span * step, coarse)
            if found is not None:
                yield found


def _coarse(one: _Course, two: _Course, step: float, spans: float) -> Iterator[float]:
    """S to be added to the clock of ``two``, to a ``step``, where both then go together."""
    longest = min(_LONGEST, _SHARE * _overlap(one, two))
    grid = np.arange(max(one.time[0], two.time[0]), min(one.time[-1], two.time[-1]), step)
    if len(grid) < 4 * FEWEST:
        return
    a, b = (course.rate(grid, spans * step) for course in (one, two))
    a, b = a - a.mean(), b - b.mean()
    size = float(np.sqrt((a @ a) * (b @ b)))
    if not size > 0.0:
        return
    # By Fourier transforms, long enough that no end meets the other.
    long = 2 * len(grid)
    together = np.fft.irfft(np.fft.rfft(a, long) * np.conj(np.fft.rfft(b, long)), long) / size
    shifts = np.fft.fftfreq(long, 1.0 / long) * step
    near = np.abs(shifts) <= longest
    # The clocks' overlap takes its share of what goes together.
    fair = together[near] * len(grid) / np.maximum(len(grid) - np.abs(shifts[near]) / step, 1.0)
    at = int(np.argmax(np.abs(fair)))
    # A shift as long as any that was looked for is none that was found.
    if abs(fair[at]) >= _ALIKE - 0.1 and abs(shifts[near][at]) < longest - step:
        yield float(shifts[near][at])


def _refined(one: _Course, two: _Course, span: float, offset: float) -> ClockAlignment | None:
    """From the shift ``offset`` on, with the slopes of one as instruments of the other's; each has noise of its own."""
    room = 0.5 * span + 2.0 * two.interval
    grid = np.arange(two.time[0] + room, two.time[-1] - room, max(one.interval, two.interval))
    middle, drift, step = 0.5 * (two.time[0] + two.time[-1]), 0.0, np.full(2, np.inf)
    for _ in range(_STEPS):
        there = grid + offset + drift * (grid - middle)
        inside = (there > one.time[0] + room) & (there < one.time[-1] - room)
        if int(inside.sum()) < 4 * FEWEST:
            return None
        at, since = grid[inside], grid[inside] - middle
        seen, target = one.rate(there[inside], span), two.rate(at, span)
        if not (np.ptp(seen) > 0.0 and np.ptp(target) > 0.0):
            return None
        gain, level = np.polyfit(seen, target, 1)
        left = target - level - gain * seen
        x = gain * one.slope(there[inside], span)[:, None] * np.column_stack((np.ones(len(at)), since))
        instruments = two.slope(at, span)[:, None] * np.column_stack((np.ones(len(at)), since))
        inverse = np.linalg.pinv(instruments.T @ x)
        step = inverse @ (instruments.T @ left)
        offset, drift = offset + float(step[0]), drift + float(step[1])
        if not (np.isfinite(step).all() and abs(offset) < _LONGEST and abs(drift) < _MOST_DRIFT):
            return None
    spread = _spread(instruments, left, inverse)
    alike = float(np.corrcoef(seen, target)[0, 1])
    if not (abs(alike) >= (_COPY if one.command else _ALIKE) and abs(step[0]) <= spread[0]):
        return None
    # A rate may be that at an instant or the mean of an interval; of a heading nobody knows that either.
    unlike = max(one.interval, two.interval) / 12.0**0.5 if one.gyro is not two.gyro else 0.0
    by = one.source if one.source == two.source else f"{two.source} against {one.source}"
    return ClockAlignment(
        offset=offset,
        error=math.hypot(float(spread[0]), unlike),
        drift=drift,
        drift_error=float(spread[1]),
        middle=float(middle - two.time[0]),
        columns=by,
    )


def _spread(instruments: FloatArray, left: FloatArray, inverse: FloatArray) -> FloatArray:
    """(k,) standard errors by the scatter of stretches, in which errors may be of any colour."""
    stretches = max(min(_STRETCHES, len(left) // FEWEST), _FEWEST_STRETCHES)
    sums = np.array([part.sum(axis=0) for part in np.array_split(instruments * left[:, None], stretches)])
    few = stretches / (stretches - 1.0)
    return np.sqrt(np.diag(inverse @ (sums.T @ sums) @ inverse.T) * few)
