"""Raw channels -> one Trial on one time base.

The base is the union of the instants at which the position along the axis (in yaw the heading) was measured and
those at which a command changed. It begins at the first one measured when every command is known, and ends at the
last one measured. Where no position is logged, the rate along the axis takes its place, or where the vehicle is on the
map and its heading do together.

- What is measured is never interpolated; an instant without it holds NaN.
- A command holds its value until the next, over empty cells too; so do extra signals.
- A rate beside the position, roll and pitch are measured, continuous and mostly on a clock of their own: they alone
  are interpolated, linearly, between neighbours that are no farther apart than a gap.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from rovid.core.array_types import FloatArray, IntArray
from rovid.core.errors import LogError
from rovid.readers.cleaning import ANGLE, DISTANCE, SPEED_KIND, TURNING, Kind, clean
from rovid.readers.monotonic_time import order
from rovid.readers.raw_log import Channel, RawLog, subsampled_median
from rovid.readers.resampling import TimeBase, TimedSeries, common_base
from rovid.readers.unit_checks import refuse_wrong_heading, told_by_gyro
from rovid.trial.axis import YAW, Axis
from rovid.trial.config import Config
from rovid.trial.signal_names import Signal
from rovid.trial.trial import Remark, Trial

_TILTS = ("roll", "pitch")
_FEWEST = 10
# Positions farther apart than this say nothing of the dynamics; the time is probably in another unit.
_SLOWEST, _FASTEST = 10.0, 2e-4
_LATE_START = 1.0
# A command that is logged regularly and then no more, for this long and this many of its intervals.
_STALE_SECONDS, _STALE_INTERVALS, _REGULAR = 5.0, 10.0, 3.0


@dataclass(kw_only=True, eq=False)
class _Builder:
    raw: RawLog
    config: Config
    name: str
    remarks: list[Remark] = field(default_factory=list)

    def signal(self, name: str) -> Signal:
        for command in self.config.commands:
            if command.name == name:
                return command
        return self.config.signals[name]

    @property
    def measured(self) -> str:
        """What is measured, for messages."""
        return self.config.measured_signal.replace("_", " ")

    @property
    def kind(self) -> Kind:
        """Of what is measured."""
        axis = self.config.axis
        if self.config.measured_signal == axis.rate_signal:
            return TURNING if axis.angular else SPEED_KIND
        return ANGLE if axis.angular else DISTANCE

    def remark(self, kind: str, count: int, text: str) -> None:
        self.remarks.append(Remark(kind=kind, count=count, text=text))


def build(raw: RawLog, config: Config, path: Path, name: str) -> Trial:
    """One trial from the channels of one file.

    Raises
    ------
    LogError
        Time runs backwards, what is measured is missing, frozen or in another unit than declared, or no command
        is ever known meanwhile.
    """
    work = _Builder(raw=raw, config=config, name=name, remarks=list(raw.remarks))
    series, axis = _ordered(work), config.axis
    measured = _measured(work, series[config.measured_signal])
    commands = [_command(work, signal.name, series[signal.name]) for signal in config.commands]
    base = common_base(measured, commands, *_span(work, measured, commands))
    position = base.exactly(measured)
    fixes = axis.fix_signals if config.measured_signal in axis.fix_signals else ()
    names = dict.fromkeys((axis.rate_signal, *_TILTS, *fixes))
    beside = [key for key in names if key in series and key != config.measured_signal]
    continuous = {key: _continuous(work, key, series[key], base) for key in beside}
    rate, integrated = continuous.get(axis.rate_signal), config.measured_signal == axis.rate_signal
    if integrated:
        rate, position = position, _integral(base.time, position)
    elif fixes:
        position = _along(work, position, {key: continuous[key] for key in fixes[1:]})
    if not integrated and rate is not None and _is_dead(base.time, rate, position, work.kind):
        source = raw.channels[axis.rate_signal].source
        work.remark(
            "frozen", len(rate), f"{source} ({axis.rate_signal}) stays the same while the vehicle moves; left out."
        )
        rate = None
    if axis is YAW and not integrated:
        _check_units(work, base.time, position, rate)
    plain = [key for key in series if key in config.signals and key not in (config.measured_signal, *beside)]
    held = np.array([base.held(command) for command in commands])
    trial = Trial(
        name=name,
        path=path,
        time=base.time - base.time[0],
        position=position,
        # Without any command the array would lose its second dimension.
        commands=held.reshape(len(commands), len(base.time)).T,
        extras={key: _extra(work, key, series[key], base) for key in plain},
        remarks=tuple(work.remarks),
        rate=rate,
        roll=continuous.get("roll"),
        pitch=continuous.get("pitch"),
        axis=axis,
        rate_only=integrated,
        start_epoch=None if raw.epoch is None else raw.epoch + float(base.time[0]),
        companion_files=raw.beside,
    )
    if not fixes:
        return trial
    # A place on the map is none along the body before the heading is known too.
    first = int(np.argmax(trial.measured))
    return trial.part(slice(first, None), name)


def _is_dead(time: FloatArray, rate: FloatArray, position: FloatArray, kind: Kind) -> bool:
    """Whether a rate stays the same while the position goes another way."""
    known = rate[np.isfinite(rate)]
    if not known.size or np.ptp(known) > 0.0:
        return False
    away = position - known[0] * time
    return bool(np.nanmax(away) - np.nanmin(away) > kind.jump)


def _along(work: _Builder, north: FloatArray, others: Mapping[str, FloatArray | None]) -> FloatArray:
    """(n,) m gone along a body axis, of places on the map in m and the heading in rad; NaN where one is not known."""
    nowhere = np.full(len(north), np.nan)
    east, heading = (nowhere if values is None else values for values in others.values())
    known = np.flatnonzero(np.isfinite(north) & np.isfinite(east) & np.isfinite(heading))
    if len(known) < _FEWEST:
        empty = [name for name, values in others.items() if values is None or not np.isfinite(values).any()]
        what = " and ".join(empty) or "north, east and heading together"
        raise LogError(
            f"{what} cannot be read at {len(north) - len(known)} "
            f"of {len(north)} places; all three were expected at {_FEWEST} at least.",
            where=work.name,
            mend="Leave this log out, or map the column or topic that holds them.",
        )
    steps = np.column_stack((np.diff(north[known]), np.diff(east[known])))
    along = _directions(heading[known], work.config.axis)
    return _summed(np.sum(steps * along, axis=1), known, len(north))


def _directions(heading: FloatArray, axis: Axis) -> FloatArray:
    """(m-1, 2) unit vectors, north and east, along the body's ``axis`` between (m,) headings in rad."""
    course = 0.5 * (heading[1:] + heading[:-1])
    if axis.name == "sway":
        # A quarter turn to starboard.
        return np.column_stack((-np.sin(course), np.cos(course)))
    return np.column_stack((np.cos(course), np.sin(course)))


def _integral(time: FloatArray, rate: FloatArray) -> FloatArray:
    """(n,) of the rate at the (n,) instants, by the trapezoidal rule; NaN where it was not measured."""
    known = np.flatnonzero(np.isfinite(rate))
    steps = 0.5 * (rate[known][1:] + rate[known][:-1]) * np.diff(time[known])
    return _summed(steps, known, len(time))


def _summed(steps: FloatArray, known: IntArray, count: int) -> FloatArray:
    """(count,) sum of the (m-1,) ``steps`` between the (m,) ``known`` rows; NaN in the others."""
    position = np.full(count, np.nan)
    position[known] = np.concatenate(([0.0], np.cumsum(steps)))
    return position


def _ordered(work: _Builder) -> dict[str, TimedSeries]:
    """Every signal in order of time, in SI; each clock is put in order once."""
    series: dict[str, TimedSeries] = {}
    for channels in _by_clock(work.raw.channels):
        series.update(_one_clock(work, channels))
    return series


def _by_clock(channels: Mapping[str, Channel]) -> Iterable[dict[str, Channel]]:
    clocks: dict[int, dict[str, Channel]] = {}
    for name, channel in channels.items():
        clocks.setdefault(id(channel.time), {})[name] = channel
    return clocks.values()


def _one_clock(work: _Builder, channels: Mapping[str, Channel]) -> dict[str, TimedSeries]:
    first = next(iter(channels))
    ordered = order(
        channels[first].time,
        {name: channel.values for name, channel in channels.items()},
        clock=channels[first].clock,
        place=lambda index: work.raw.place(first, index),
        sortable=work.raw.sortable,
        where=work.name,
    )
    work.remarks.extend(ordered.remarks)
    series = {}
    for name, values in ordered.values.items():
        scaled = _scaled(values, channels[name], work.signal(name))
        series[name] = TimedSeries(time=ordered.time, values=scaled)
    return series


def _scaled(values: FloatArray, channel: Channel, signal: Signal) -> FloatArray:
    factor = float(np.sign(signal.factor)) if channel.radians else signal.factor  # of radians only the sense is left
    if factor == 1.0:
        return values
    with np.errstate(invalid="ignore"):  # a damaged number may be a NaN that signals
        return values * factor


def _measured(work: _Builder, logged: TimedSeries) -> TimedSeries:
    """What is measured along the axis, unwrapped; NaN where it is not."""
    name, known = work.config.measured_signal, logged.known
    _refuse_unmeasured(work, work.raw.channels[name].source, known)
    cleaned = clean(logged.stamps, known, work.kind, work.measured)
    _say_missing(work, name, logged)
    work.remarks.extend(cleaned.remarks)
    _check_interval(work, logged.stamps)
    values = cleaned.position
    if logged.missing:
        values = np.full(len(logged.time), np.nan)
        values[logged.good] = cleaned.position
    return TimedSeries(time=logged.time, values=values)


def _refuse_unmeasured(work: _Builder, source: str, known: FloatArray) -> None:
    if len(known) < _FEWEST:
        raise LogError(
            f"{source} holds {len(known)} {work.measured} readings; at least {_FEWEST} were expected.",
            where=work.name,
            mend=f"Leave this log out, or map the column or topic that holds the {work.measured}.",
        )
    if known.min() == known.max():
        raise LogError(
            f"{source} never changes: the sensor was frozen, or this is not the {work.measured}.",
            where=work.name,
            mend=f"Map the column or topic that holds the {work.measured}, or leave this log out.",
        )


def _say_missing(work: _Builder, name: str, logged: TimedSeries, then: str = "") -> None:
    if logged.missing:
        source = work.raw.channels[name].source
        work.remark("missing", logged.missing, f"{source} ({name}) is missing in {logged.missing} samples{then}.")


def _check_interval(work: _Builder, time: FloatArray) -> None:
    interval = subsampled_median(np.diff(time))
    if _FASTEST <= interval <= _SLOWEST or (interval > _SLOWEST and work.config.time.unit != "auto"):
        return
    raise LogError(
        f"successive {work.measured} readings are {interval:.4g} s apart if the unit of "
        f"{work.raw.channels[work.config.measured_signal].clock} "
        "is taken right; somewhere between a millisecond and some seconds was expected.",
        where=work.name,
        mend='Set unit = "s", "ms", "us" or "ns" in [signals] time.',
    )


def _command(work: _Builder, name: str, logged: TimedSeries) -> TimedSeries:
    """The command, which is known at least once."""
    if not logged.known.size:
        raise LogError(
            f"{work.raw.channels[name].source} ({name}) holds no number.",
            where=work.name,
            mend="Map the column or topic that holds the command, or leave this log out.",
        )
    _say_missing(work, name, logged, "; the value before was held")
    return logged


def _span(work: _Builder, series: TimedSeries, commands: list[TimedSeries]) -> tuple[float, float]:
    """First and last instant: something measured when every command is known, and the last measured."""
    measured = series.stamps
    known = max((float(command.stamps[0]) for command in commands), default=-np.inf)
    first = int(np.searchsorted(measured, known))
    count = len(measured) - first
    if count < _FEWEST:
        raise LogError(
            f"{count} {work.measured} readings come after every command is known (from {known - measured[0]:.1f} s "
            f"behind the first on); at least {_FEWEST} were expected.",
            where=work.name,
            mend="Leave this log out, or check that its topics or columns are mapped right.",
        )
    late = measured[first] - measured[0]
    if late > _LATE_START:
        work.remark("start", first, f"The first {late:.1f} s were left out: a command was not known yet.")
    for signal, command in zip(work.config.commands, commands, strict=True):
        _say_stale(work, signal.name, command.stamps, float(measured[-1]))
    return float(measured[first]), float(measured[-1])


def _say_stale(work: _Builder, name: str, time: FloatArray, end: float) -> None:
    silent = end - time[-1]
    if silent <= _STALE_SECONDS or len(time) < _FEWEST:
        return
    usual, most = np.percentile(np.diff(time), (50, 90))
    if silent > _STALE_INTERVALS * usual and most <= _REGULAR * usual:
        source = work.raw.channels[name].source
        text = f"{source} ({name}) stops {silent:.1f} s before the {work.measured}; its last value was held."
        work.remark("stale", 1, text)


def _continuous(work: _Builder, name: str, logged: TimedSeries, base: TimeBase) -> FloatArray | None:
    """(n,) on the time base; None if it is nowhere known."""
    _say_missing(work, name, logged)
    if not logged.known.size:
        return None
    return base.interpolated(logged, angle=name in (*_TILTS, "heading"))


def _extra(work: _Builder, name: str, logged: TimedSeries, base: TimeBase) -> FloatArray:
    """(n,) held on the time base; a channel may be silent for long, but one without any reading is a mistake."""
    if not logged.known.size:
        work.remark("missing", logged.missing, f"{work.raw.channels[name].source} ({name}) holds no number.")
    return base.held(logged)


def _check_units(work: _Builder, base: FloatArray, psi: FloatArray, yaw_rate: FloatArray | None) -> None:
    heading = work.config.signals["heading"]
    if yaw_rate is not None:
        signals = (heading, work.config.signals["yaw_rate"])
        if told_by_gyro(base, psi, yaw_rate, signals, work.name):
            return
    refuse_wrong_heading(work.raw.channels["heading"], heading, psi, work.name)
