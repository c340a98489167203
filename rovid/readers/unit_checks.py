"""Finds a heading or a gyro that is logged in another unit or sense than rovid.toml says."""

from __future__ import annotations

import math

import numpy as np

from rovid.core.array_types import FloatArray, IntArray
from rovid.core.errors import LogError
from rovid.readers.raw_log import Channel, is_plausible
from rovid.trial.signal_names import Signal

_DEGREES = 180.0 / math.pi
_TURN_RAD, _TURN_DEG = 2.0 * math.pi, 360.0
# More than a half turn in radians, but only three and a half degrees.
_SPAN = 3.5
# Radians are logged finer than to two decimals (half a degree); degrees often are not.
_COARSE = 0.01
# No underwater vehicle keeps turning this fast (rad/s).
_TOO_FAST = 6.0
_FEWEST_WINDOWS, _WINDOW = 50, 0.5
_ALIKE = 0.8


def refuse_wrong_heading(channel: Channel, signal: Signal, heading: FloatArray, where: str) -> None:
    """Look at the range and the jumps of a heading.

    Parameters
    ----------
    channel
        The heading as logged; one made from a quaternion is in radians for sure.
    heading
        (n,) rad, cleaned, as if declared right; NaN where not measured.

    Raises
    ------
    LogError
        It is declared in degrees but logged in radians, or the other way round.
    """
    if channel.radians:
        return
    looks = ""
    if signal.unit == "deg":
        low = float(np.fmin.reduce(heading) * _DEGREES)
        high = float(np.fmax.reduce(heading) * _DEGREES)
        if max(-low, high) <= _TURN_RAD + 0.01:
            looks = _looks_like_radians(heading[np.isfinite(heading)] * _DEGREES, low, high)
    else:
        good = is_plausible(channel.time) & is_plausible(channel.values)
        looks = _looks_like_degrees(channel.time[good], channel.values[good])
    if looks:
        raise _wrong_unit(channel, signal, looks, where)


def _looks_like_radians(values: FloatArray, low: float, high: float) -> str:
    steps = np.abs(np.diff(values))
    whole_turn = np.abs(steps - _TURN_RAD) < 0.5
    # A vehicle that spins fast makes large steps all the time.
    sudden = steps > 10.0 * np.median(steps)
    if np.any(whole_turn & sudden):
        return f"it jumps by {_TURN_RAD:.4g}, a whole turn in radians"
    in_coarse = values / _COARSE
    rounded = bool(np.all(np.abs(in_coarse - np.rint(in_coarse)) < 1e-6))
    if high - low > _SPAN and not rounded:
        return f"all its values lie between {low:.4g} and {high:.4g}"
    return ""


def _looks_like_degrees(time: FloatArray, values: FloatArray) -> str:
    low, high = float(values.min()), float(values.max())
    if max(-low, high) <= 2.0 * _TURN_RAD or low < -181.0 or high > 361.0:
        return ""
    steps = np.diff(values)
    if np.any(np.abs(np.abs(steps) - _TURN_DEG) < 40.0):
        return "it jumps by 360, a whole turn in degrees"
    seconds = np.diff(time)
    later = seconds > 0
    rates = np.abs(steps[later] / seconds[later])
    fast = float(np.percentile(rates, 95)) if rates.size else 0.0
    if fast > _TOO_FAST:
        return f"in radians it would turn at {fast:.3g} rad/s"
    return ""


def _wrong_unit(channel: Channel, signal: Signal, looks: str, where: str) -> LogError:
    names = {"deg": "degrees", "rad": "radians"}
    other = "rad" if signal.unit == "deg" else "deg"
    text = f"{channel.source} is declared in {names[signal.unit]} but looks like {names[other]}: {looks}."
    return LogError(text, where=where, mend=f'Set unit = "{other}" in [signals] heading.')


def told_by_gyro(
    time: FloatArray, heading: FloatArray, yaw_rate: FloatArray, signals: tuple[Signal, Signal], where: str
) -> bool:
    """Whether the logged yaw rate confirms the unit of the heading.

    Parameters
    ----------
    time, heading, yaw_rate
        (n,) s, rad, rad/s; NaN where not measured.
    signals
        Heading and yaw rate as rovid.toml maps them.

    Raises
    ------
    LogError
        One of the two is in another unit or sense than declared.
    """
    compared = _compare(time, heading, yaw_rate)
    if compared is None:
        return False
    ratio, alike = compared
    if alike < 0:
        raise LogError(
            f"yaw_rate falls when heading grows (correlation {alike:.2f}); both should grow in the same sense.",
            where=where,
            mend="Set sign = -1 in [signals] yaw_rate, or in heading if that is the one turned round.",
        )
    if _DEGREES / 1.6 < max(ratio, 1.0 / ratio) < _DEGREES * 1.6:
        raise _wrong_rate(ratio, heading, signals, where)
    return 0.5 < ratio < 2.0


def _compare(time: FloatArray, heading: FloatArray, yaw_rate: FloatArray) -> tuple[float, float] | None:
    """(yaw rate over change of heading, their correlation) over half-second windows; None if they tell nothing."""
    rows = np.flatnonzero(np.isfinite(heading) & np.isfinite(yaw_rate))
    if len(rows) < _FEWEST_WINDOWS:
        return None
    t, psi, r = time[rows], heading[rows], yaw_rate[rows]
    width = max(2, 2 * round(_WINDOW / float(np.median(np.diff(t))) / 2))
    first = _windows(t, width)
    if len(first) < _FEWEST_WINDOWS:
        return None
    middle, last = first + width // 2, first + width
    rate = (psi[last] - psi[first]) / (t[last] - t[first])
    # By Simpson's rule: three readings stand for the whole window.
    mean = (r[first] + 4.0 * r[middle] + r[last]) / 6.0
    usual = np.abs(rate) <= np.percentile(np.abs(rate), 98)  # without the jumps that a wrong unit leaves
    return _ratio(rate[usual], mean[usual])


def _windows(time: FloatArray, width: int) -> IntArray:
    """(m,) first row of each window of ``width`` rows, those with a gap left out."""
    first = np.arange(0, len(time) - width, max(1, len(time) // 20_000))
    span = time[first + width] - time[first]
    # A window with a gap in it says nothing of the middle.
    return first[span < 2.0 * np.median(span)] if span.size else first


def _ratio(rate: FloatArray, gyro: FloatArray) -> tuple[float, float] | None:
    own, logged = (math.sqrt(float(values @ values)) for values in (rate, gyro))
    if min(own, logged) == 0.0:
        return None
    alike = float(rate @ gyro) / (own * logged)
    if abs(alike) > _ALIKE:
        return logged / own, alike
    return None


def _wrong_rate(ratio: float, heading: FloatArray, signals: tuple[Signal, Signal], where: str) -> LogError:
    degrees, gyro = signals
    # Declared degrees that are radians leave less than a turn of 57; beyond it the gyro is the wrong one.
    small = bool(np.nanmax(np.abs(heading)) <= _TURN_RAD / _DEGREES * 1.01)
    heading_wrong = degrees.unit == "rad"
    if ratio > 1.0:
        heading_wrong = degrees.unit == "deg" and small
    culprit = degrees if heading_wrong else gyro
    other = {"deg": "rad", "rad": "deg", "deg/s": "rad/s", "rad/s": "deg/s"}.get(culprit.unit, "rad")
    return LogError(
        f"yaw_rate is {ratio:.3g} times the change of heading per second; with heading in {degrees.unit} and "
        f"yaw_rate in {gyro.unit} one of them is declared in the wrong unit, degrees for radians or the reverse.",
        where=where,
        mend=f'Set unit = "{other}" in [signals] {culprit.name}.',
    )
