"""Raw channels -> one Trial on one time base.

The base is the union of the instants at which the heading was measured and those at which a command changed.
It begins at the first heading measured when every command is known, and ends at the last heading measured.

- Heading is never interpolated; an instant without one holds NaN.
- A command holds its value until the next, over empty cells too; so do extra signals.
- Yaw rate, roll and pitch are measured, continuous and mostly on a clock of their own: they alone are
  interpolated, linearly, between neighbours that are no farther apart than a gap.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rovid.config import Config, Signal
from rovid.errors import LogError
from rovid.readers.heading import clean, gap_limit
from rovid.readers.ordering import order
from rovid.readers.raw import Channel, RawLog, typical
from rovid.readers.units import refuse_wrong_gyro, refuse_wrong_heading
from rovid.trial import FloatArray, Remark, Trial

IntArray = NDArray[np.intp]

_CONTINUOUS = ("yaw_rate", "roll", "pitch")
_ANGLES = ("roll", "pitch")
_FEWEST_HEADINGS = 10
# Headings farther apart than this say nothing of yaw dynamics; the time is probably in another unit.
_SLOWEST, _FASTEST = 10.0, 2e-4
_LATE_START = 1.0
# A command that is logged regularly and then no more, for this long and this many of its intervals.
_STALE_SECONDS, _STALE_INTERVALS, _REGULAR = 5.0, 10.0, 3.0


@dataclass(frozen=True, kw_only=True, eq=False)
class _Series:
    """One signal, ordered: (m,) s and (m,) values in SI or the command's unit, NaN where missing."""

    time: FloatArray
    values: FloatArray

    def known(self) -> _Series:
        """Without what is missing."""
        good = np.isfinite(self.values)
        return self if good.all() else _Series(time=self.time[good], values=self.values[good])


@dataclass(kw_only=True, eq=False)
class _Builder:
    raw: RawLog
    config: Config
    name: str
    remarks: list[Remark] = field(default_factory=list)

    def signal(self, name: str) -> Signal:
        return next((s for s in self.config.commands if s.name == name), None) or self.config.signals[name]

    def remark(self, kind: str, count: int, text: str) -> None:
        self.remarks.append(Remark(kind=kind, count=count, text=text))


def build(raw: RawLog, config: Config, path: Path, name: str) -> Trial:
    """One trial from the channels of one file.

    Raises
    ------
    LogError
        Time runs backwards, the heading is missing, frozen or in another unit than declared, or no command
        is ever known while the heading is measured.
    """
    work = _Builder(raw=raw, config=config, name=name, remarks=list(raw.remarks))
    series = _ordered(work)
    heading = _heading(work, series["heading"])
    commands = [_command(work, signal, series[signal.name]) for signal in config.commands]
    base = _base(work, heading, commands)
    start = base[0] if base.size else 0.0
    continuous = {
        key: _interpolated(work, key, series[key], base) for key in _CONTINUOUS if key in series
    }
    extras = {
        key: _held(_filled(value), base)
        for key, value in series.items()
        if key in config.signals and key not in ("heading", *_CONTINUOUS)
    }
    psi = _exactly(heading, base)
    _check_units(work, base, psi, continuous.get("yaw_rate"))
    return Trial(
        name=name,
        path=path,
        time=base - start,
        heading=psi,
        commands=np.column_stack([_held(command, base) for command in commands]),
        extras=extras,
        remarks=tuple(work.remarks),
        **continuous,
    )


def _ordered(work: _Builder) -> dict[str, _Series]:
    """Every signal in order of time, in SI; each clock is put in order once."""
    clocks: dict[int, list[str]] = {}
    for name, channel in work.raw.channels.items():
        clocks.setdefault(id(channel.time), []).append(name)
    series = {}
    for names in clocks.values():
        channels = {name: work.raw.channels[name] for name in names}
        series.update(_one_clock(work, channels))
    return series


def _one_clock(work: _Builder, channels: Mapping[str, Channel]) -> dict[str, _Series]:
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
    return {
        name: _Series(time=ordered.time, values=_scaled(values, channels[name], work.signal(name)))
        for name, values in ordered.values.items()
    }


def _scaled(values: FloatArray, channel: Channel, signal: Signal) -> FloatArray:
    factor = float(np.sign(signal.factor)) if channel.radians else signal.factor
    return values if factor == 1.0 else values * factor
