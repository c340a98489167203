"""What was read of a log before anybody knows what it is, and how fast a vehicle moves."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rovid.core.array_types import FloatArray

# A whole turn.
TURN = {"deg": 360.0, "rad": 2.0 * np.pi}
# Readings without which nothing is guessed.
FEWEST = 30
WINDOW = 0.5  # s over which a rate is a mean
_LONGEST = 3e6  # s from the middle of a log
_MOST = 500_000  # windows of one log


@dataclass(frozen=True, kw_only=True, eq=False)
class RawColumn:
    """One column or field of one log: its (n,) times in s and values; ``radians`` where it is an orientation."""

    source: str
    time: FloatArray
    values: FloatArray
    radians: bool = False


@dataclass(frozen=True, kw_only=True)
class SignalGuess:
    """What one signal is taken from, in what unit and sense, and why; ``rate`` where it is a velocity."""

    source: str
    reason: str
    unit: str = ""
    sign: int = 1
    is_rate: bool = False


def finite_values(seen: Sequence[RawColumn]) -> FloatArray:
    """(n,) values that were measured, of all logs."""
    values = np.concatenate([one.values for one in seen])
    return np.asarray(values[np.isfinite(values)])


def _places(measured: SignalGuess, seen: RawColumn) -> tuple[FloatArray, FloatArray]:
    """(n,) s and the place along the axis: a heading unwrapped in rad, a velocity summed up."""
    known = np.flatnonzero(np.isfinite(seen.values) & np.isfinite(seen.time))
    if known.size:
        stamps = seen.time[known]
        # A stamp of before the clock was set, or a damaged one, is years away.
        known = known[np.abs(stamps - np.median(stamps)) < _LONGEST]
    time, values = seen.time[known], measured.sign * seen.values[known]
    if measured.is_rate:
        steps = 0.5 * (values[1:] + values[:-1]) * np.diff(time)
        return time, np.concatenate(([0.0], np.cumsum(steps)))[: len(time)]
    if measured.unit in TURN:
        return time, np.unwrap(values * (2.0 * np.pi / TURN[measured.unit]))
    return time, values


def mean_rates(measured: SignalGuess, seen: RawColumn, window: float = WINDOW) -> tuple[FloatArray, FloatArray]:
    """(m + 1,) s, a ``window`` of so many apart, and the (m,) mean rates between them, of angles in rad/s."""
    time, place = _places(measured, seen)
    if len(time) < FEWEST:
        return np.empty(0), np.empty(0)
    # A single stamp weeks away would else make millions of windows.
    window = max(window, 2.0 * float(np.median(np.diff(time))), float(np.ptp(time)) / _MOST)
    grid = np.arange(time[0], time[-1], window)
    return grid, np.diff(np.interp(grid, time, place)) / window


def position_at(measured: SignalGuess, seen: RawColumn, time: FloatArray) -> FloatArray:
    """(m,) places along the axis at ``time`` in s, of angles in rad."""
    known, place = _places(measured, seen)
    return np.asarray(np.interp(time, known, place))


def held_mean(seen: RawColumn, time: FloatArray) -> FloatArray:
    """(m,) means of the held values between (m + 1,) ``time`` in s."""
    known = np.isfinite(seen.values)
    if not known.any():
        return np.zeros(len(time) - 1)
    clock, values = seen.time[known], seen.values[known]
    ends = np.append(clock, max(clock[-1], time[-1]) + 1.0)
    integral = np.concatenate(([0.0], np.cumsum(values * np.diff(ends))))
    return np.asarray(np.diff(np.interp(time, ends, integral)) / np.diff(time))
