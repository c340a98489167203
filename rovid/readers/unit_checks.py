"""Detect a heading or a gyro that is logged in another unit or sense than declared in rovid.toml."""

import math

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.core.errors import LogError
from rovid.readers.raw_log import Channel
from rovid.readers.timestamps import is_plausible
from rovid.trial.axis import Signal

_DEG_PER_RAD = 180.0 / math.pi
_TURN_RAD, _TURN_DEG = 2.0 * math.pi, 360.0
# Range of a heading that is more than half a turn in radians, but only 3.5 degrees.
_MIN_RANGE = 3.5
# Radians are logged with more than two decimals (half a degree); degrees often are not.
_COARSE = 0.01
# Share of the readings of a tilt that are no spikes.
_MOST = 0.99
# rad/s; no underwater vehicle keeps turning this fast.
_MAX_RATE = 6.0
# Even number of intervals in a window of the comparison of gyro and heading, and the smallest number of windows and
# correlation.
_WIDTH, _MIN_WINDOWS, _MIN_CORRELATION = 10, 50, 0.8


def refuse_wrong_heading(channel: Channel, signal: Signal, heading: FloatArray, where: str) -> None:
    """Raise `LogError` if the heading is declared in degrees but logged in radians, or the reverse.

    The evidence is the range and the jumps of the ``channel`` as logged and of the (n,) ``heading`` in rad, cleaned.
    """
    if channel.radians or signal.unit not in {"deg", "rad"}:
        return
    evidence = ""
    if signal.unit == "deg":
        evidence = _evidence_of_radians(heading[np.isfinite(heading)] * _DEG_PER_RAD)
    else:
        good = is_plausible(channel.time) & is_plausible(channel.values)
        evidence = _evidence_of_degrees(channel.time[good], channel.values[good])
    if evidence:
        names = {"deg": "degrees", "rad": "radians"}
        other = "rad" if signal.unit == "deg" else "deg"
        text = f"{channel.source} is declared in {names[signal.unit]} but looks like {names[other]}: {evidence}."
        raise LogError(text, where=where, mend=f'Set unit = "{other}" in [signals] heading.')


def refuse_wrong_tilt(channel: Channel, signal: Signal, where: str) -> None:
    """Raise `LogError` if a roll or pitch that is declared in radians exceeds half a turn."""
    values = channel.values[is_plausible(channel.values)]
    if channel.radians or signal.unit != "rad" or not len(values):
        return
    largest = float(np.quantile(np.abs(values - np.median(values)), _MOST))
    if largest > math.pi:
        text = (
            f"{channel.source} is declared in radians but looks like degrees: it reaches {largest:.3g} from its "
            f"median, {largest / (2.0 * math.pi):.2g} turns in radians."
        )
        raise LogError(text, where=where, mend=f'Set unit = "deg" in [signals] {signal.name}.')


def _evidence_of_radians(values: FloatArray) -> str:
    low, high = float(values.min()), float(values.max())
    if max(-low, high) > _TURN_RAD + 0.01:
        return ""
    steps = np.abs(np.diff(values))
    whole_turn = np.abs(steps - _TURN_RAD) < 0.5
    # A vehicle that spins fast makes large steps all the time.
    sudden = steps > 10.0 * np.median(steps)
    if np.any(whole_turn & sudden):
        return f"it jumps by {_TURN_RAD:.4g}, a whole turn in radians"
    in_coarse = values / _COARSE
    rounded = bool(np.all(np.abs(in_coarse - np.rint(in_coarse)) < 1e-6))
    if high - low > _MIN_RANGE and not rounded:
        return f"all its values lie between {low:.4g} and {high:.4g}"
    return ""


def _evidence_of_degrees(time: FloatArray, values: FloatArray) -> str:
    low, high = float(values.min()), float(values.max())
    if max(-low, high) <= 2.0 * _TURN_RAD or low < -181.0 or high > 361.0:
        return ""
    steps = np.diff(values)
    if np.any(np.abs(np.abs(steps) - _TURN_DEG) < 40.0):
        return "it jumps by 360, a whole turn in degrees"
    seconds = np.diff(time)
    later = seconds > 0
    rates = np.abs(steps[later] / seconds[later])
    if rates.size and (fast := float(np.percentile(rates, 95))) > _MAX_RATE:
        return f"in radians it would turn at {fast:.3g} rad/s"
    return ""


def gyro_confirms_unit(
    time: FloatArray, heading: FloatArray, yaw_rate: FloatArray, signals: tuple[Signal, Signal], where: str
) -> bool:
    """Whether the logged yaw rate confirms the unit of the heading; `LogError` if one contradicts its unit or sense.

    ``time``, ``heading``, ``yaw_rate``: (n,) s, rad, rad/s; NaN where not measured. ``signals``: heading, yaw rate.
    """
    compared = _compare(time, heading, yaw_rate)
    if compared is None:
        return False
    ratio, correlation = compared
    if correlation < 0:
        text = f"yaw_rate falls when heading grows (correlation {correlation:.2f}); both should grow in the same sense."
        mend = "Set sign = -1 in [signals] yaw_rate, or in heading if that one is reversed."
        raise LogError(text, where=where, mend=mend)
    if _DEG_PER_RAD / 1.6 < max(ratio, 1.0 / ratio) < _DEG_PER_RAD * 1.6:
        raise _wrong_unit(ratio, heading, signals, where)
    return 0.5 < ratio < 2.0


def _compare(time: FloatArray, heading: FloatArray, yaw_rate: FloatArray) -> tuple[float, float] | None:
    """(yaw rate over rate of heading, correlation) over short windows; None without enough correlation."""
    rows = np.flatnonzero(np.isfinite(heading) & np.isfinite(yaw_rate))
    if len(rows) < _MIN_WINDOWS:
        return None
    t, psi, r = time[rows], heading[rows], yaw_rate[rows]
    width = _WIDTH
    first = np.arange(0, len(t) - width, max(1, len(t) // 20_000))
    if first.size:  # Windows with a gap are left out.
        span = t[first + width] - t[first]
        first = first[span < 2.0 * np.median(span)]
    if len(first) < _MIN_WINDOWS:
        return None
    middle, last = first + width // 2, first + width
    rate = (psi[last] - psi[first]) / (t[last] - t[first])
    gyro = (r[first] + 4.0 * r[middle] + r[last]) / 6.0  # Simpson's rule.
    regular = np.abs(rate) <= np.percentile(np.abs(rate), 98)  # Without the jumps caused by a wrong unit.
    rate, gyro = rate[regular], gyro[regular]
    rate_norm, gyro_norm = math.sqrt(float(rate @ rate)), math.sqrt(float(gyro @ gyro))
    if min(rate_norm, gyro_norm) == 0.0:
        return None
    correlation = float(rate @ gyro) / (rate_norm * gyro_norm)
    if abs(correlation) > _MIN_CORRELATION:
        return gyro_norm / rate_norm, correlation
    return None


def _wrong_unit(ratio: float, heading: FloatArray, signals: tuple[Signal, Signal], where: str) -> LogError:
    heading_signal, gyro_signal = signals
    # Radians declared as degrees stay within a turn divided by 57; a larger heading exonerates the heading.
    small = bool(np.nanmax(np.abs(heading)) <= _TURN_RAD / _DEG_PER_RAD * 1.01)
    heading_is_wrong = heading_signal.unit == "rad"
    if ratio > 1.0:
        heading_is_wrong = heading_signal.unit == "deg" and small
    culprit = heading_signal if heading_is_wrong else gyro_signal
    other = {"deg": "rad", "rad": "deg", "deg/s": "rad/s", "rad/s": "deg/s"}.get(culprit.unit, "rad")
    text = f"yaw_rate is {ratio:.3g} times the change of heading per second; with heading in {heading_signal.unit} and "
    text += f"yaw_rate in {gyro_signal.unit} one of them has the wrong unit, degrees for radians or the reverse."
    return LogError(text, where=where, mend=f'Set unit = "{other}" in [signals] {culprit.name}.')
