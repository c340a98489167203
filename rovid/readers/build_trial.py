"""Raw channels -> one trial on one time base.

The time base is the union of the instants at which the position along the axis (in yaw the heading) was measured and
those at which a command changed. It begins at the first measurement for which every command is known, and ends at the
last measurement. Where no position is logged, the rate along the axis takes its place, or the position on the map
together with the heading.

- The position is never interpolated: it is NaN between. Commands and extra signals hold their value until the next one.
- Rate, roll and pitch have mostly a clock of their own: they are interpolated linearly, except in gaps.
"""

from collections.abc import Iterator, Mapping
from dataclasses import replace
from itertools import chain
from pathlib import Path
from typing import TypeVar

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.core.errors import LogError
from rovid.faults import base as fault_base
from rovid.faults.base import ClockData, ClocksData, CommandData, SignalData, TrialData, detectors_at
from rovid.readers import time_base
from rovid.readers.cleaning import ANGLE, DISTANCE, SPEED_KIND, TURN, TURNING, Kind, clean
from rovid.readers.raw_log import ANGLES, Channel, RawLog
from rovid.readers.time_base import TimeBase, TimedSeries
from rovid.readers.timestamps import make_monotonic, timed_rows, without_rounding
from rovid.trial.axis import YAW
from rovid.trial.config import Config
from rovid.trial.fault import Fault
from rovid.trial.rates import cumulative, integral
from rovid.trial.segments import merged_intervals, subsampled_median
from rovid.trial.trial import Remark, Trial
from rovid.trial.vehicle import Steering

_TILTS = ("roll", "pitch")
_Data = TypeVar("_Data", ClockData, ClocksData, SignalData, CommandData, TrialData)
_MIN_READINGS = 10
# s; median intervals outside these limits show no dynamics: the unit of time is probably wrong.
MAX_INTERVAL, _MIN_INTERVAL = 10.0, 2e-4
_LATE_START = 1.0  # s; a later start of the trial is remarked upon.


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
        self.faults: list[Fault] = []
        self.cuts: list[float] = []  # s on the clocks of the log.
        self.unknown: list[tuple[float, float]] = []
        self.resets: tuple[tuple[float, float], ...] = ()  # s from the start of the trial, and sizes.
        self.clock_steps: tuple[fault_base.ClockStep, ...] = ()
        kinds = {(True, True): TURNING, (True, False): SPEED_KIND, (False, True): ANGLE, (False, False): DISTANCE}
        self.kind: Kind = kinds[self.rate_only, self.axis.angular]

    def remark(self, kind: str, count: int, text: str) -> None:
        self.remarks.append(Remark(kind=kind, count=count, text=text))

    def examined(self, stage: fault_base.Stage, data: _Data) -> _Data:
        """``data`` of this ``stage`` with the remedies of its faults."""
        data, faults = fault_base.examine(detectors_at(stage), data, self.config.faults)
        # A step that several clocks of one host share is one fault.
        self.faults += [fault for fault in faults if fault not in self.faults]
        return data

    def error(self, text: str, mend: str) -> LogError:
        return LogError(text, where=self.name, mend=mend)

    def trial(self) -> Trial:
        trial = self.on_one_time_base()
        known = frozenset(fault.fault for fault in self.faults)
        data = TrialData(trial=trial, vehicle=self.config.vehicle, resets=self.resets, known=known)
        trial = replace(self.examined("trial", data).trial, faults=tuple(self.faults))
        if self.measured_signal not in self.axis.fix_signals:
            return trial
        # A position on the map is none along the body before the heading is known, too.
        return trial.part(slice(int(np.argmax(trial.measured)), None), self.name)

    def on_one_time_base(self) -> Trial:
        """All signals, before the faults of the whole trial are examined. The clocks' own columns end here."""
        axis, measured_signal = self.axis, self.measured_signal
        series = self.ordered()
        measured, clock = self.cleaned(series[measured_signal]), series[measured_signal].time
        commands = self.commands(series, measured)
        base = TimeBase.union(measured, commands, *self.span(measured, commands))
        position = base.match(measured)
        fixes = axis.fix_signals if measured_signal in axis.fix_signals else ()
        names = dict.fromkeys((axis.rate_signal, *_TILTS, *fixes))
        interpolated = [key for key in names if key in series and key != measured_signal]
        continuous = {key: self.continuous(key, series[key], base) for key in interpolated}
        rate = continuous.get(axis.rate_signal)
        if self.rate_only:
            rate, position = position, integral(base.time, position)
        elif fixes:
            position = self.distance_along(position, {key: continuous[key] for key in fixes[1:]})
        if not self.rate_only and rate is not None and self.is_frozen(base.time, rate, position):
            source = self.raw.channels[axis.rate_signal].source
            text = f"{source} ({axis.rate_signal}) stays the same while the vehicle moves; left out."
            self.remark("frozen", len(rate), text)
            rate = None
        if (axis is YAW or axis.self_righting) and not self.rate_only:
            self.check_units(base.time, position, rate)
        extras = {}
        for key in series:
            if key in self.config.signals and key not in (measured_signal, *interpolated):
                if not series[key].known.size:
                    text = f"{self.raw.channels[key].source} ({key}) holds no number."
                    self.remark("missing", series[key].missing, text)
                extras[key] = base.hold(series[key])
        thrusters = self.config.vehicle.thrusters
        held = np.ones((len(commands), len(base.time)))
        gains = np.ones_like(held) if any(one.is_rudder for one in thrusters) else None
        for at, (command, thruster) in enumerate(zip(commands, thrusters, strict=True)):
            held[at] = base.hold(command)
            if (steering := thruster.steering) is not None:
                speed = self.speed_of(steering, base, series)
                held[at] = steering.command(held[at], speed)
                if gains is not None:
                    gains[at] = steering.gain(speed)
        start = float(base.time[0])
        places = {name: signal.position or (0.0, 0.0) for name, signal in self.config.signals.items()}
        is_planar = self.config.vehicle.planar
        readings, remarks = time_base.planar_readings(series, base.time, position, places, wanted=is_planar)
        self.remarks += remarks
        self.resets = tuple((at - start, size) for at, size in self.raw.resets)
        return Trial(
            name=self.name,
            path=self.path,
            time=base.time - base.time[0],
            position=position,
            commands=held.T,
            angle_gains=None if gains is None else gains.T,
            extras=extras,
            remarks=tuple(self.remarks),
            cuts=tuple(sorted(cut - start for cut in self.cuts)),
            unknown=merged_intervals([(begin - start, end - start) for begin, end in self.unknown]),
            rate=rate,
            roll=continuous.get("roll"),
            pitch=continuous.get("pitch"),
            axis=axis,
            rate_only=self.rate_only,
            start_epoch=None if self.raw.epoch is None else self.raw.epoch + float(base.time[0]),
            companion_files=self.raw.companion_files,
            readings=readings,
            separate_clocks=all(series[one.name].time is not clock for one in self.config.commands),
        )

    def ordered(self) -> dict[str, TimedSeries]:
        """Every signal in order of time, in SI; each clock is sorted once."""
        clocks: dict[int, dict[str, Channel]] = {}
        for name, channel in self.raw.channels.items():
            clocks.setdefault(id(channel.time), {})[name] = channel
        # The clock of the measured signal comes first: the others may share its steps.
        ordered = sorted(clocks.values(), key=lambda channels: self.measured_signal not in channels)
        series = dict(chain.from_iterable(map(self.one_clock, ordered)))
        # Pauses of motion and commands that are not in one table.
        measured, commands = series[self.measured_signal], [series[one.name] for one in self.config.commands]
        stamps = tuple({id(one.time): one.known_time for one in commands if one.time is not measured.time}.values())
        if stamps and not self.cuts:
            data = ClocksData(log=self.name, measured=measured.known_time, commands=stamps)
            self.unknown += self.examined("clocks", data).unknown
        if {"north", "east"} <= series.keys() and self.config.signals["north"].is_geodetic:
            series["north"], series["east"] = time_base.local_position(series["north"], series["east"])
        return series

    def one_clock(self, channels: Mapping[str, Channel]) -> Iterator[tuple[str, TimedSeries]]:
        first = next(iter(channels))
        signals = {**self.config.signals, **{command.name: command for command in self.config.commands}}
        periods = {}
        for name, channel in channels.items():
            if name in ANGLES:
                periods[name] = TURN if channel.radians else TURN / abs(signals[name].factor)
        logged, clock = channels[first].time, channels[first].clock
        rows = timed_rows(logged, clock, self.name, self.remarks)
        data = ClockData(
            log=self.name,
            clock=clock,
            time=logged[rows],
            rows=rows,
            values={name: channel.values[rows] for name, channel in channels.items()},
            periods=periods,
            measured=self.measured_signal,
            sortable=self.raw.sortable,
            steps=self.clock_steps,
            place=lambda row: self.raw.place(first, row),
        )
        data = self.examined("clock", data)
        self.clock_steps = data.steps
        self.cuts += data.cuts
        self.unknown += data.unknown
        time, ordered, remarks = make_monotonic(
            data.time,
            data.values,
            clock=clock,
            place=lambda index: self.raw.place(first, int(data.rows[index])),
            sortable=self.raw.sortable,
            where=self.name,
        )
        self.remarks += remarks
        if not data.cuts:
            time = without_rounding(time)
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
        signal = SignalData(
            log=self.name,
            name=self.measured_words,
            time=logged.known_time,
            values=known,
            period=self.kind.turn,
            unit=self.axis.unit("rad/s" if self.rate_only else "rad"),
            unknown=tuple(self.unknown),
        )
        signal = self.examined("signal", signal)
        position, remarks = clean(signal.time, signal.values, self.kind, self.measured_words)
        self.remark_missing(self.measured_signal, logged)
        self.remarks += remarks
        interval = subsampled_median(np.diff(logged.known_time))
        is_slow_by_unit = interval > MAX_INTERVAL and self.config.time.unit != "auto"
        if not (_MIN_INTERVAL <= interval <= MAX_INTERVAL or is_slow_by_unit):
            text = f"successive {self.measured_words} readings are {interval:.4g} s apart by the assumed unit of "
            text += f"{self.raw.channels[self.measured_signal].clock}; an interval between a millisecond and some "
            mend = 'Set unit = "s", "ms", "us" or "ns" in [signals] time. The unit holds for all logs: if others have '
            mend += "another unit, convert the stamps of this log instead."
            raise self.error(f"{text}seconds was expected.", mend)
        if len(position) == len(logged.time):
            return TimedSeries(time=logged.time, values=position)
        values = np.full(len(logged.time), np.nan)
        values[np.searchsorted(logged.time, signal.time)] = position
        return TimedSeries(time=logged.time, values=values)

    def remark_missing(self, name: str, logged: TimedSeries, consequence: str = "") -> None:
        # In a table of several sensors most cells are empty.
        if logged.missing and (consequence or not self.config.vehicle.planar):
            source = self.raw.channels[name].source
            text = f"{source} ({name}) is missing in {logged.missing} samples{consequence}."
            self.remark("missing", logged.missing, text)

    def commands(self, series: Mapping[str, TimedSeries], measured: TimedSeries) -> list[TimedSeries]:
        """Every command, each known at least once."""
        names = [signal.name for signal in self.config.commands]
        position = integral(measured.known_time, measured.known) if self.rate_only else measured.known
        logged = [
            CommandData(
                log=self.name,
                name=thruster.name,
                time=series[name].time,
                values=series[name].values,
                thruster=None if thruster.curve is None else thruster,
                measured=measured.known_time,
                position=position,
                alone=series[name].time is not series[self.measured_signal].time,
                source=self.raw.channels[name].source,
                sparse=self.raw.sparse,
            )
            for name, thruster in zip(names, self.config.vehicle.thrusters, strict=True)
        ]
        found: list[tuple[str, tuple[Fault, ...]]] = []
        commands = []
        for at, (name, data) in enumerate(zip(names, logged, strict=True)):
            others = (*logged[:at], *logged[at + 1 :])
            fixed, faults = fault_base.examine(
                detectors_at("command"), replace(data, others=others), self.config.faults
            )
            found.append((data.name, faults))
            self.unknown += fixed.unknown
            command = replace(series[name], values=fixed.values)
            if not command.known.size:
                text = f"{fixed.source} ({name}) holds no number."
                raise self.error(text, "Map the column or topic that holds the command, or leave this log out.")
            self.remark_missing(name, command, "; the value before was held")
            commands.append(command)
        self.faults += fault_base.faults_of_all(found)
        return commands

    def speed_of(self, steering: Steering, base: TimeBase, series: Mapping[str, TimedSeries]) -> FloatArray:
        """(n,) logged speed of a steered drive, interpolated over its gaps."""
        speed = series[steering.speed]
        if not speed.known.size:
            text = f"{self.raw.channels[steering.speed].source} ({steering.speed}) holds no number."
            raise self.error(text, "Map the column or topic that holds the speed, or leave this log out.")
        return np.interp(base.time, speed.known_time, speed.known)

    def span(self, measured: TimedSeries, commands: list[TimedSeries]) -> tuple[float, float]:
        """First instant measured when every command is known, and last instant measured."""
        time = measured.known_time
        known = max((float(command.known_time[0]) for command in commands), default=-np.inf)
        first = int(np.searchsorted(time, known))
        count = len(time) - first
        if count < _MIN_READINGS:
            text = f"{count} {self.measured_words} readings come after every command is known (from "
            text += f"{known - time[0]:.1f} s after the first reading on); at least {_MIN_READINGS} were expected."
            mend = "Leave this log out, or check the mapping of its topics or columns."
            if known > time[-1]:
                apart = f"The commands begin {known - time[-1]:.1f} s after the last reading: another clock?"
                mend = f"{apart} Correct it, for joined files by [join.offset] in rovid.toml, or leave this log out."
            raise self.error(text, mend)
        late = time[first] - time[0]
        if late > _LATE_START:
            self.remark("start", first, f"The first {late:.1f} s were left out: a command was not known yet.")
        return float(time[first]), float(time[-1])

    def continuous(self, name: str, logged: TimedSeries, base: TimeBase) -> FloatArray | None:
        """(n,) interpolated on the time base; None if no value is known."""
        self.remark_missing(name, logged)
        if not logged.known.size:
            return None
        is_angle = name in ANGLES
        signal = SignalData(
            log=self.name,
            name=name.replace("_", " "),
            time=logged.known_time,
            values=logged.known,
            period=TURN if is_angle else np.inf,
            unit="rad" if is_angle else "rad/s",
            measured=False,
        )
        if len((repaired := self.examined("signal", signal)).time) < len(signal.time):
            logged = TimedSeries(time=repaired.time, values=repaired.values)
        return base.interpolate(logged, angle=is_angle)

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
            text = f"{subject} cannot be read at {len(north) - len(known)} "
            text += f"of {len(north)} places; all three were expected at {_MIN_READINGS} at least."
            raise self.error(text, "Leave this log out, or map the column or topic that holds them.")
        course = 0.5 * (heading[known][1:] + heading[known][:-1])
        directions = np.column_stack((np.cos(course), np.sin(course)))
        if self.axis.name == "sway":  # A quarter turn to starboard.
            directions = np.column_stack((-np.sin(course), np.cos(course)))
        steps = np.column_stack((np.diff(north[known]), np.diff(east[known])))
        return cumulative(np.sum(steps * directions, axis=1), known, len(north))

    def check_units(self, time: FloatArray, heading: FloatArray, yaw_rate: FloatArray | None) -> None:
        signal = self.config.signals[self.axis.position_signal]
        try:
            if self.axis.self_righting:
                time_base.refuse_wrong_tilt(self.raw.channels[signal.name], signal, self.name)
                return
            if yaw_rate is not None:
                signals = (signal, self.config.signals["yaw_rate"])
                if time_base.gyro_confirms_unit(time, heading, yaw_rate, signals, self.name):
                    return
            time_base.refuse_wrong_heading(self.raw.channels[signal.name], signal, heading, self.name)
        except LogError as error:
            fault = Fault(fault="scaled_heading", logs=(self.name,), text=str(error), stops=True)
            self.faults.append(fault_base.resolve(fault, self.config.faults))
