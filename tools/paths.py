"""From the command that is given to the one that acts: hysteresis, delay and slew limit, event by event.

A path is linear between its instants, so that delays of any length and ramps that end inside a sample are exact to
the microsecond in which instants are counted.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numba
import numpy as np

from tools.hidden import Hidden
from tools.truth import MICRO, FloatArray, IntArray

_compiled = numba.njit(cache=True)


@dataclass(frozen=True, kw_only=True, eq=False)
class Path:
    """Command less its neutral: ``value`` at each ``instant`` in us, from there on with ``slope`` a second.

    It is zero before the first instant.
    """

    instant: IntArray
    value: FloatArray
    slope: FloatArray

    def over(self, begin: IntArray, after: FloatArray) -> FloatArray:
        """Value at ``begin`` plus ``after``, both in us, on the piece that holds at ``begin``."""
        index = np.searchsorted(self.instant, begin, side="right") - 1
        held = np.maximum(index, 0)
        value = self.value[held] + self.slope[held] * ((begin - self.instant[held] + after) / MICRO)
        return np.where(index < 0, 0.0, value)


def acting_path(instant: IntArray, value: FloatArray, dead_zone: float, hidden: Mapping[str, Hidden]) -> Path:
    """Path of the command ``value``, less its neutral, that is held from each ``instant`` in us to the next.

    Hysteresis comes first, then delay, then slew limit. ``dead_zone`` is that of the bench curve.
    """
    value = _with_hysteresis(value, dead_zone, hidden.get("command_hysteresis"))
    instant, value = _delayed(instant, value, hidden.get("command_delay"))
    return _slewed(instant, value, hidden.get("slew_limit"))


def _with_hysteresis(value: FloatArray, dead_zone: float, hidden: Hidden | None) -> FloatArray:
    if hidden is None:
        return value
    width = hidden.parameters["width"]
    if hidden.form == "play":
        return np.asarray(_play(value, width / 2.0))
    return np.asarray(_schmitt(value, dead_zone + width, dead_zone))


def _delayed(instant: IntArray, value: FloatArray, hidden: Hidden | None) -> tuple[IntArray, FloatArray]:
    if hidden is None:
        return instant, value
    delay = round(hidden.parameters["delay"] * MICRO)
    if hidden.form == "constant":
        return instant + delay, value
    every = max(2 * delay, 1)
    read = -(-instant // every) * every  # upwards, to the next reading
    last = np.diff(read, append=read[-1] + 1) != 0
    return read[last], value[last]


def _slewed(instant: IntArray, value: FloatArray, hidden: Hidden | None) -> Path:
    if hidden is None:
        return Path(instant=instant, value=value, slope=np.zeros(len(value)))
    rate = hidden.parameters["rate"]
    when, where, slope = _ramps(instant, value, rate / MICRO, hidden.form == "soft_start")
    return Path(instant=when, value=where, slope=slope * MICRO)


@_compiled
def _play(value: FloatArray, half: float) -> FloatArray:
    """Backlash of ``half`` either way, in its middle before the first command."""
    out = np.empty_like(value)
    held = 0.0
    for k in range(len(value)):
        held = min(max(held, value[k] - half), value[k] + half)
        out[k] = held
    return out


@_compiled
def _schmitt(value: FloatArray, start: float, stop: float) -> FloatArray:
    """``value`` while it runs: from |value| above ``start`` until it is below ``stop``."""
    out = np.empty_like(value)
    runs = False
    for k in range(len(value)):
        size = abs(value[k])
        runs = size > start or (runs and size >= stop)
        out[k] = value[k] if runs else 0.0
    return out


@_compiled
def _ramps(
    instant: IntArray, value: FloatArray, rate: float, soft_start: bool
) -> tuple[IntArray, FloatArray, FloatArray]:
    """Instants, values and slopes of a path that follows ``value`` by ``rate`` a microsecond at most."""
    count = len(instant)
    when = np.empty(2 * count, dtype=np.int64)
    where = np.empty(2 * count)
    slope = np.zeros(2 * count)
    n = 0
    held = 0.0
    for k in range(count):
        target = value[k]
        if soft_start:
            # What takes thrust away acts at once: down to the target, or to a stand before it turns round.
            same = target * held > 0.0
            held = min(abs(held), abs(target)) * np.sign(held) if same else 0.0
        when[n] = instant[k]
        where[n] = held
        lasts = abs(target - held) / rate
        direction = np.sign(target - held)
        if lasts < 0.5:  # us: there within the instant
            held = target
            where[n] = held
            n += 1
            continue
        slope[n] = direction * rate
        n += 1
        if k + 1 < count and instant[k] + lasts >= instant[k + 1]:
            held += direction * rate * (instant[k + 1] - instant[k])
            continue
        when[n] = instant[k] + np.int64(np.rint(lasts))
        where[n] = target
        held = target
        n += 1
    return when[:n], where[:n], slope[:n]
