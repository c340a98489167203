"""Signals of one log on their own clocks, the common instants of a trial, positions in m, and checks of units."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Self

import numpy as np

from rovid.core.array_types import BoolArray, FloatArray
from rovid.core.errors import LogError
from rovid.readers.cleaning import DISTANCE, SPEED_KIND, TURNING, Kind, clean
from rovid.readers.raw_log import Channel
from rovid.readers.timestamps import is_plausible
from rovid.trial.axis import EARTH_RADIUS, Signal
from rovid.trial.segments import gap_limit
from rovid.trial.trial import Readings, Remark


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
    def union(cls, position: TimedSeries, commands: Sequence[TimedSeries], begin: float, end: float) -> Self:
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


# WGS 84: semi-major axis, m, and squared eccentricity.
_SEMI_MAJOR, _ECCENTRICITY2 = 6_378_137.0, 6.694379990141e-3


def local_position(north: TimedSeries, east: TimedSeries) -> tuple[TimedSeries, TimedSeries]:
    """North and east, m, from the median fix, of a latitude and a longitude as arcs of `EARTH_RADIUS`, m.

    To first order on the ellipsoid WGS 84, by its radii of curvature in the meridian and in the prime vertical (Torge
    and Mueller 2012, section 4.1). At a distance d it errs by d^2 tan(latitude) / radius: 0.16 m at 1 km and 45 deg.
    """
    if not (north.known.size and east.known.size):
        return north, east
    latitude, longitude = float(np.median(north.known)) / EARTH_RADIUS, float(np.median(east.known)) / EARTH_RADIUS
    flattening = 1.0 - _ECCENTRICITY2 * math.sin(latitude) ** 2
    meridian = _SEMI_MAJOR * (1.0 - _ECCENTRICITY2) / flattening**1.5
    parallel = _SEMI_MAJOR / math.sqrt(flattening) * math.cos(latitude)
    turned = np.remainder(east.values / EARTH_RADIUS - longitude + math.pi, 2.0 * math.pi) - math.pi
    return (
        replace(north, values=meridian * (north.values / EARTH_RADIUS - latitude)),
        replace(east, values=parallel * turned),
    )


# Signal -> limits of its readings. The heading is the position of the trial.
PLANAR_SIGNALS: Mapping[str, Kind] = {
    "yaw_rate": TURNING,
    "surge_velocity": SPEED_KIND,
    "sway_velocity": SPEED_KIND,
    "north": DISTANCE,
    "east": DISTANCE,
}


def planar_readings(
    series: Mapping[str, TimedSeries],
    time: FloatArray,
    heading: FloatArray,
    places: Mapping[str, tuple[float, float]],
    *,
    wanted: bool,
) -> tuple[dict[str, Readings], list[Remark]]:
    """Readings of each signal of the coupled model in ``series`` between the first and the last of (n,) ``time`` in s.

    They are those at the origin, of sensors at their ``places``; (n,) ``heading`` is NaN where it is not measured.
    Missing values, held repeats, spikes and frozen stretches are left out, the last three with a remark. A signal that
    never changes is left out. Nothing at all unless ``wanted``, by a configuration of the coupled model.
    """
    if not wanted:
        return {}, []
    begin, end = float(time[0]), float(time[-1])
    found, remarks = {}, list[Remark]()
    for name, kind in PLANAR_SIGNALS.items():
        logged = series.get(name)
        if logged is None or logged.known.size == 0:
            continue
        words = name.replace("_", " ")
        values, faults = clean(logged.known_time, logged.known, kind, words)
        measured = np.isfinite(values)
        if np.ptp(values[measured]) == 0.0:
            count = int(measured.sum())
            text = f"The {words} never changes; its {count} readings were left out."
            remarks.append(Remark(kind="frozen", count=count, text=text))
            continue
        remarks += faults
        readings = Readings(time=logged.known_time[measured], values=values[measured])
        found[name] = readings.between(begin, end)
    measured = np.isfinite(heading)
    return _at_origin(found, Readings(time=time[measured] - begin, values=heading[measured]), places), remarks


# Width of the kernel for the yaw rate at a sensor, in the median interval of the slower of heading and sensor.
_RATE_WIDTH = 1.0


def _at_origin(
    readings: Mapping[str, Readings], heading: Readings, places: Mapping[str, tuple[float, float]]
) -> dict[str, Readings]:
    """The readings of sensors at their ``places`` in m, ahead and to starboard, as of sensors at the origin.

    Over a lever (x, y) a sensor moves by -r y ahead and r x to starboard (Fossen 2011, section 2.2). The yaw rate r is
    that of the gyro, or the derivative of ``heading`` through a Gaussian kernel.
    """
    moved = dict(readings)
    for name, own in readings.items():
        x, y = places.get(name, (0.0, 0.0))
        if not (x or y):
            continue
        if name in {"north", "east"}:
            psi = np.interp(own.time, heading.time, heading.values)
            ahead, across = (x, y) if name == "north" else (y, -x)
            shift = ahead * np.cos(psi) - across * np.sin(psi)
        else:
            shift = (-y if name == "surge_velocity" else x) * _yaw_rate(own.time, readings.get("yaw_rate"), heading)
        moved[name] = replace(own, values=own.values - shift)
    return moved


def _yaw_rate(time: FloatArray, gyro: Readings | None, heading: Readings) -> FloatArray:
    """(n,) yaw rate in rad/s at the instants of ``time``."""
    if gyro is not None:
        return np.asarray(np.interp(time, gyro.time, gyro.values))
    from scipy.ndimage import gaussian_filter1d

    step = float(np.median(np.diff(heading.time)))
    grid = np.arange(heading.time[0], heading.time[-1], step)
    width = _RATE_WIDTH * max(step, float(np.median(np.diff(time)))) / step
    rate = gaussian_filter1d(np.interp(grid, heading.time, heading.values), width, order=1, mode="nearest") / step
    return np.asarray(np.interp(time, grid, rate))


# --- a heading or a gyro that is logged in another unit or sense than rovid.toml declares ------------------------

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
    if signal.unit == "deg":
        declared, likely, other = "degrees", "radians", "rad"
        evidence = _evidence_of_radians(heading[np.isfinite(heading)] * _DEG_PER_RAD)
    else:
        declared, likely, other = "radians", "degrees", "deg"
        good = is_plausible(channel.time) & is_plausible(channel.values)
        evidence = _evidence_of_degrees(channel.time[good], channel.values[good])
    if evidence:
        text = f"{channel.source} is declared in {declared} but looks like {likely}: {evidence}."
        raise LogError(text, where=where, mend=f'Set unit = "{other}" in [signals] heading.')


def refuse_wrong_tilt(channel: Channel, signal: Signal, where: str) -> None:
    """Raise `LogError` if a roll or pitch that is declared in radians exceeds half a turn."""
    values = channel.values[is_plausible(channel.values)]
    if channel.radians or signal.unit != "rad" or not len(values):
        return
    largest = float(np.quantile(np.abs(values - np.median(values)), _MOST))
    if largest > math.pi:
        text = f"{channel.source} is declared in radians but looks like degrees: it reaches {largest:.3g} from its "
        text += f"median, {largest / (2.0 * math.pi):.2g} turns in radians."
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
        # Radians declared as degrees stay within a turn divided by 57; a larger heading exonerates the heading.
        is_small = bool(np.nanmax(np.abs(heading)) <= _TURN_RAD / _DEG_PER_RAD * 1.01)
        own, gyro = signals
        heading_is_wrong = own.unit == "deg" and is_small if ratio > 1.0 else own.unit == "rad"
        culprit = own if heading_is_wrong else gyro
        other = {"deg": "rad", "rad": "deg", "deg/s": "rad/s", "rad/s": "deg/s"}.get(culprit.unit, "rad")
        text = f"yaw_rate is {ratio:.3g} times the change of heading per second; with heading in {own.unit} and "
        text += f"yaw_rate in {gyro.unit} one of them has the wrong unit, degrees for radians or the reverse."
        raise LogError(text, where=where, mend=f'Set unit = "{other}" in [signals] {culprit.name}.')
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
    return (gyro_norm / rate_norm, correlation) if abs(correlation) > _MIN_CORRELATION else None
