"""Raw channels -> one trial on one time base.

The time base is the union of the instants at which the position along the axis (in yaw the heading) was measured and
those at which a command changed. It begins at the first measurement for which every command is known, and ends at the
last measurement. Where no position is logged, the rate along the axis takes its place, or the position on the map
together with the heading.

- The position is never interpolated: instants without a measurement are NaN.
- Commands and extra signals hold their value until the next one.
- Rate, roll and pitch have mostly a clock of their own: they are interpolated linearly, except in gaps.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import chain
from pathlib import Path

import numpy as np

from rovid.core.array_types import BoolArray, FloatArray, IntArray
from rovid.core.errors import LogError
from rovid.readers.cleaning import ANGLE, DISTANCE, SPEED_KIND, TURNING, Kind, clean, gap_limit
from rovid.readers.raw_log import Channel, RawLog, subsampled_median
from rovid.readers.timestamps import is_plausible, make_monotonic
from rovid.readers.unit_checks import gyro_confirms_unit, refuse_wrong_heading
from rovid.trial.axis import YAW
from rovid.trial.config import Config
from rovid.trial.trial import Remark, Trial

_TILTS = ("roll", "pitch")
_MIN_READINGS = 10
# s; median intervals outside these limits show no dynamics: the unit of time is probably wrong.
_MAX_INTERVAL, _MIN_INTERVAL = 10.0, 2e-4
# s; a later start of the trial is remarked upon.
_LATE_START = 1.0
# A command logged regularly (90th percentile of its intervals within _REGULAR medians) that then stays silent for this
# many s and medians is remarked upon.
_STALE_SECONDS, _STALE_INTERVALS, _REGULAR = 5.0, 10.0, 3.0


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


def build(raw: RawLog, config: Config, path: Path, name: str) -> Trial:
    """One trial from the channels of one file.

    Raises `LogError` if time runs backwards; the measured signal is missing, frozen or in another unit than declared;
    or a command is never known.
    """
    return _Builder(raw=raw, config=config, path=path, name=name).trial()


class _Builder:
    def __init__(self, *, raw: RawLog, config: Config, path: Path, name: str) -> None:
        self.raw, self.config, self.path, self.name = raw, config, path, name
        self.axis = config.axis
        self.measured_signal = config.measured_signal
        self.measured_words = config.measured_signal.replace("_", " ")
        self.rate_only = config.measured_signal == self.axis.rate_signal
        self.remarks = list(raw.remarks)
        kinds = {(True, True): TURNING, (True, False): SPEED_KIND, (False, True): ANGLE, (False, False): DISTANCE}
        self.kind: Kind = kinds[self.rate_only, self.axis.angular]

    def remark(self, kind: str, count: int, text: str) -> None:
        self.remarks.append(Remark(kind=kind, count=count, text=text))

    def error(self, text: str, mend: str) -> LogError:
        return LogError(text, where=self.name, mend=mend)

    def trial(self) -> Trial:
        axis, measured_signal = self.axis, self.measured_signal
        series = self.ordered()
        measured = self.cleaned(series[measured_signal])
        commands = [self.command(signal.name, series[signal.name]) for signal in self.config.commands]
        base = TimeBase.union(measured, commands, *self.span(measured, commands))
        position = base.match(measured)
        fixes = axis.fix_signals if measured_signal in axis.fix_signals else ()
        names = dict.fromkeys((axis.rate_signal, *_TILTS, *fixes))
        interpolated = [key for key in names if key in series and key != measured_signal]
        continuous = {key: self.continuous(key, series[key], base) for key in interpolated}
        rate = continuous.get(axis.rate_signal)
        if self.rate_only:
            rate, position = position, _integral(base.time, position)
        elif fixes:
            position = self.distance_along(position, {key: continuous[key] for key in fixes[1:]})
        if not self.rate_only and rate is not None and self.is_frozen(base.time, rate, position):
            source = self.raw.channels[axis.rate_signal].source
            text = f"{source} ({axis.rate_signal}) stays the same while the vehicle moves; left out."
            self.remark("frozen", len(rate), text)
            rate = None
        if axis is YAW and not self.rate_only:
            self.check_units(base.time, position, rate)
        extras = {}
        for key in series:
            if key in self.config.signals and key not in (measured_signal, *interpolated):
                if not series[key].known.size:
                    text = f"{self.raw.channels[key].source} ({key}) holds no number."
                    self.remark("missing", series[key].missing, text)
                extras[key] = base.hold(series[key])
        held = np.array([base.hold(command) for command in commands])
        trial = Trial(
            name=self.name,
            path=self.path,
            time=base.time - base.time[0],
            position=position,
            # The shape of no commands at all is (0, n).
            commands=held.reshape(len(commands), len(base.time)).T,
            extras=extras,
            remarks=tuple(self.remarks),
            rate=rate,
            roll=continuous.get("roll"),
            pitch=continuous.get("pitch"),
            axis=axis,
            rate_only=self.rate_only,
            start_epoch=None if self.raw.epoch is None else self.raw.epoch + float(base.time[0]),
            companion_files=self.raw.companion_files,
        )
        if not fixes:
            return trial
        # A position on the map is none along the body before the heading is known, too.
        return trial.part(slice(int(np.argmax(trial.measured)), None), self.name)

    def ordered(self) -> dict[str, TimedSeries]:
        """Every signal in order of time, in SI; each clock is sorted once."""
        clocks: dict[int, dict[str, Channel]] = {}
        for name, channel in self.raw.channels.items():
            clocks.setdefault(id(channel.time), {})[name] = channel
        return dict(chain.from_iterable(map(self.one_clock, clocks.values())))

    def one_clock(self, channels: Mapping[str, Channel]) -> Iterator[tuple[str, TimedSeries]]:
        first = next(iter(channels))
        time, ordered, remarks = make_monotonic(
            channels[first].time,
            {name: channel.values for name, channel in channels.items()},
            clock=channels[first].clock,
            place=lambda index: self.raw.place(first, index),
            sortable=self.raw.sortable,
            where=self.name,
        )
        self.remarks += remarks
        signals = {**self.config.signals, **{command.name: command for command in self.config.commands}}
        for name, values in ordered.items():
            factor = signals[name].factor
            if channels[name].radians:
                factor = float(np.sign(factor))  # Only the sense applies to radians.
            with np.errstate(invalid="ignore"):  # A damaged number may be a signalling NaN.
                yield name, TimedSeries(time=time, values=values if factor == 1.0 else values * factor)

    def cleaned(self, logged: TimedSeries) -> TimedSeries:
        """The measured signal along the axis, unwrapped; NaN where not measured."""
        source, known = self.raw.channels[self.measured_signal].source, logged.known
        mend = f"Map the column or topic that holds the {self.measured_words}, or leave this log out."
        if len(known) < _MIN_READINGS:
            text = f"{source} holds {len(known)} {self.measured_words} readings; at least {_MIN_READINGS} are needed."
            raise self.error(text, mend)
        if known.min() == known.max():
            text = f"{source} never changes: the sensor was frozen, or this is not the {self.measured_words}."
            raise self.error(text, mend)
        position, remarks = clean(logged.known_time, known, self.kind, self.measured_words)
        self.remark_missing(self.measured_signal, logged)
        self.remarks += remarks
        self.check_interval(logged.known_time)
        if not logged.missing:
            return TimedSeries(time=logged.time, values=position)
        values = np.full(len(logged.time), np.nan)
        values[logged.is_known] = position
        return TimedSeries(time=logged.time, values=values)

    def remark_missing(self, name: str, logged: TimedSeries, consequence: str = "") -> None:
        if logged.missing:
            source = self.raw.channels[name].source
            text = f"{source} ({name}) is missing in {logged.missing} samples{consequence}."
            self.remark("missing", logged.missing, text)

    def check_interval(self, time: FloatArray) -> None:
        interval = subsampled_median(np.diff(time))
        is_slow_by_unit = interval > _MAX_INTERVAL and self.config.time.unit != "auto"
        if _MIN_INTERVAL <= interval <= _MAX_INTERVAL or is_slow_by_unit:
            return
        clock = self.raw.channels[self.measured_signal].clock
        raise self.error(
            f"successive {self.measured_words} readings are {interval:.4g} s apart by the assumed unit of {clock}; "
            "an interval between a millisecond and some seconds was expected.",
            'Set unit = "s", "ms", "us" or "ns" in [signals] time.',
        )

    def command(self, name: str, logged: TimedSeries) -> TimedSeries:
        """The command, which must be known at least once."""
        if not logged.known.size:
            text = f"{self.raw.channels[name].source} ({name}) holds no number."
            raise self.error(text, "Map the column or topic that holds the command, or leave this log out.")
        self.remark_missing(name, logged, "; the value before was held")
        return logged

    def span(self, measured: TimedSeries, commands: list[TimedSeries]) -> tuple[float, float]:
        """First instant measured when every command is known, and last instant measured."""
        time = measured.known_time
        known = max((float(command.known_time[0]) for command in commands), default=-np.inf)
        first = int(np.searchsorted(time, known))
        count = len(time) - first
        if count < _MIN_READINGS:
            raise self.error(
                f"{count} {self.measured_words} readings come after every command is known (from "
                f"{known - time[0]:.1f} s after the first reading on); at least {_MIN_READINGS} were expected.",
                "Leave this log out, or check the mapping of its topics or columns.",
            )
        late = time[first] - time[0]
        if late > _LATE_START:
            self.remark("start", first, f"The first {late:.1f} s were left out: a command was not known yet.")
        for signal, command in zip(self.config.commands, commands, strict=True):
            self.remark_stale(signal.name, command.known_time, float(time[-1]))
        return float(time[first]), float(time[-1])

    def remark_stale(self, name: str, time: FloatArray, end: float) -> None:
        silent = end - time[-1]
        if silent <= _STALE_SECONDS or len(time) < _MIN_READINGS:
            return
        median, upper = np.percentile(np.diff(time), (50, 90))
        if silent > _STALE_INTERVALS * median and upper <= _REGULAR * median:
            source = self.raw.channels[name].source
            text = f"{source} ({name}) stops {silent:.1f} s before the {self.measured_words}; its last value was held."
            self.remark("stale", 1, text)

    def continuous(self, name: str, logged: TimedSeries, base: TimeBase) -> FloatArray | None:
        """(n,) interpolated on the time base; None if no value is known."""
        self.remark_missing(name, logged)
        if not logged.known.size:
            return None
        return base.interpolate(logged, angle=name in (*_TILTS, "heading"))

    def is_frozen(self, time: FloatArray, rate: FloatArray, position: FloatArray) -> bool:
        """Whether a rate is constant while the position departs from its integral."""
        known = rate[np.isfinite(rate)]
        if not known.size or np.ptp(known) > 0.0:
            return False
        difference = position - known[0] * time
        return bool(np.nanmax(difference) - np.nanmin(difference) > self.kind.jump)

    def distance_along(self, north: FloatArray, others: Mapping[str, FloatArray | None]) -> FloatArray:
        """(n,) m travelled along a body axis, from north and east in m and heading in rad; NaN where one is unknown."""
        unknown = np.full(len(north), np.nan)
        east, heading = (unknown if values is None else values for values in others.values())
        known = np.flatnonzero(np.isfinite(north) & np.isfinite(east) & np.isfinite(heading))
        if len(known) < _MIN_READINGS:
            empty = [name for name, values in others.items() if values is None or not np.isfinite(values).any()]
            subject = " and ".join(empty) or "north, east and heading together"
            raise self.error(
                f"{subject} cannot be read at {len(north) - len(known)} "
                f"of {len(north)} places; all three were expected at {_MIN_READINGS} at least.",
                "Leave this log out, or map the column or topic that holds them.",
            )
        course = 0.5 * (heading[known][1:] + heading[known][:-1])
        directions = np.column_stack((np.cos(course), np.sin(course)))
        if self.axis.name == "sway":  # A quarter turn to starboard.
            directions = np.column_stack((-np.sin(course), np.cos(course)))
        steps = np.column_stack((np.diff(north[known]), np.diff(east[known])))
        return _cumulative(np.sum(steps * directions, axis=1), known, len(north))

    def check_units(self, time: FloatArray, heading: FloatArray, yaw_rate: FloatArray | None) -> None:
        signal = self.config.signals["heading"]
        if yaw_rate is not None:
            signals = (signal, self.config.signals["yaw_rate"])
            if gyro_confirms_unit(time, heading, yaw_rate, signals, self.name):
                return
        refuse_wrong_heading(self.raw.channels["heading"], signal, heading, self.name)


def _integral(time: FloatArray, rate: FloatArray) -> FloatArray:
    """(n,) integral of the rate by the trapezoidal rule; NaN where not measured."""
    known = np.flatnonzero(np.isfinite(rate))
    steps = 0.5 * (rate[known][1:] + rate[known][:-1]) * np.diff(time[known])
    return _cumulative(steps, known, len(time))


def _cumulative(steps: FloatArray, known: IntArray, count: int) -> FloatArray:
    """(count,) cumulative sum of the (m-1,) ``steps`` between the (m,) ``known`` rows; NaN in the others."""
    position = np.full(count, np.nan)
    position[known] = np.concatenate(([0.0], np.cumsum(steps)))
    return position
