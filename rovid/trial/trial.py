"""Trials and campaigns as measured, in SI units and radians."""

import re
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cached_property, partial
from pathlib import Path
from types import MappingProxyType
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike

from rovid.core.array_types import BoolArray, FloatArray
from rovid.core.errors import shortened_list
from rovid.trial.axis import YAW, Axis
from rovid.trial.fault import Fault

# Largest number of changes of commands that are remembered before a part of a log; bounds the time and the memory.
_PAST_CHANGES = 4000
# Path of a trial whose data come from memory.
NO_FILE = Path()


def read_only(values: ArrayLike) -> FloatArray:
    """``values`` as a read-only float64 array; a writeable array is copied."""
    array = np.asarray(values, dtype=np.float64)
    if array.flags.writeable:
        array = array.copy()
        array.setflags(write=False)
    return array


@dataclass(frozen=True, kw_only=True)
class Remark:
    """A fault that a reader found in a log, and its treatment.

    ``kind`` is a stable word for programs, such as duplicate, backward, missing, outlier, frozen, gap, truncated,
    extrapolated, repeated, start, skipped, chosen, clock, joined, gyro, released, level, "left out".
    """

    kind: str
    count: int  #: Affected samples, intervals, files or bytes, as the text says.
    text: str  #: A sentence for people.


@dataclass(frozen=True, kw_only=True, eq=False)
class Past:
    """Commands before the first instant of a trial. The first of them was held for long."""

    time: FloatArray  #: (m,) s, increasing, all below 0.
    commands: FloatArray  #: (m, k), each held until the next instant.
    #: Whether no log has these commands, and they are estimated from the motion; see `rovid.model.ode`.
    estimated: bool = False


@dataclass(frozen=True, kw_only=True, eq=False)
class Readings:
    """What one sensor measured, at its own instants: neither held nor interpolated."""

    time: FloatArray  #: (m,) s from the trial's start, strictly increasing.
    values: FloatArray  #: (m,) SI, rad.

    def __post_init__(self) -> None:
        object.__setattr__(self, "time", read_only(self.time))
        object.__setattr__(self, "values", read_only(self.values))

    def between(self, begin: float, end: float) -> Self:
        """Readings from ``begin`` to ``end`` in s, with time from ``begin``."""
        rows = slice(*np.searchsorted(self.time, (begin, np.nextafter(end, np.inf))).tolist())
        return type(self)(time=self.time[rows] - begin, values=self.values[rows])


@dataclass(frozen=True, kw_only=True, eq=False)
class Trial:
    """One run of the vehicle.

    All arrays have one row for each instant of ``time``: the union of the instants at which the position was measured
    and those at which a command changed. The position is NaN where it was not measured. A command holds its value until
    the next instant.
    """

    name: str  #: Path of the log, relative to the campaign.
    path: Path  #: The log file; `NO_FILE` for data that were never in a file.
    time: FloatArray  #: (n,) s, strictly increasing from 0.
    #: (n,) along ``axis``: rad, unwrapped, or m; positive in the sense of the logged signal. In yaw the heading. NaN
    #: where not measured.
    position: FloatArray
    #: (n, k) command of each actuator in the unit of its thrust curve (N m for a logged torque), held.
    commands: FloatArray
    #: (n, k) command at an angle of 1 rad, of a rudder at the logged speed; 1 for others. None without a rudder.
    angle_gains: FloatArray | None = None
    #: ``rate``, ``roll``, ``pitch``: (n,) rad/s or m/s, rad, rad; None where not logged. Interpolated linearly, NaN in
    #: gaps.
    rate: FloatArray | None = None
    roll: FloatArray | None = None
    pitch: FloatArray | None = None
    #: Further mapped channels, (n,), held, in the unit of the log.
    extras: Mapping[str, FloatArray] = field(default_factory=dict)
    #: Of the coupled model: yaw_rate, surge_velocity, sway_velocity, north and east, as far as they are logged. Empty
    #: where one axis is read.
    readings: Mapping[str, Readings] = field(default_factory=dict)
    #: Median of each further channel over the whole campaign.
    reference: Mapping[str, float] = field(default_factory=dict)
    remarks: tuple[Remark, ...] = ()  #: Remarks of the reader.
    faults: tuple[Fault, ...] = ()  #: Faults of the log, with their remedies.
    cuts: tuple[float, ...] = ()  #: s, instants at which the log is still to be cut.
    #: s, intervals within which the commands are unknown, still to be treated.
    unknown: tuple[tuple[float, float], ...] = ()
    past: Past | None = None  #: Commands before the first instant; None where they are unknown.
    axis: Axis = YAW
    rate_only: bool = False  #: Only the rate was measured; ``position`` is its integral.
    start_epoch: float | None = None  #: s since 1970 at time 0; None where the log has no absolute time.
    campaign_time: float = 0.0  #: s from the beginning of the campaign's first trial to the beginning of this one.
    log_time: float = 0.0  #: s from the beginning of its log to the beginning of this trial.
    parent: str = ""  #: Name of the trial that this one is a part of; else empty.
    companion_files: tuple[Path, ...] = ()  #: Further files of the trial.
    separate_clocks: bool = False  #: Whether commands and motion have stamps of their own, as topics do.

    def __post_init__(self) -> None:
        for name, values in self.arrays().items():
            object.__setattr__(self, name, read_only(values))
        extras = {name: read_only(values) for name, values in self.extras.items()}
        object.__setattr__(self, "extras", MappingProxyType(extras))
        object.__setattr__(self, "readings", MappingProxyType(dict(self.readings)))
        if self.commands.ndim != 2 or not len(self.commands) == len(self.time) == len(self.position):
            msg = f"{self.name}: time {self.time.shape}, position {self.position.shape}, {self.commands.shape}"
            raise ValueError(msg)

    @property
    def channels(self) -> Mapping[str, FloatArray]:
        """Further channels by name, (n,) each: ``extras``, and the tilts other than the position, in rad."""
        tilts = {"roll": self.roll, "pitch": self.pitch}
        return {**self.extras, **{name: v for name, v in tilts.items() if v is not None and name != self.axis.name}}

    def __reduce__(self) -> tuple[Callable[[], Self], tuple[()]]:
        # The constructor makes the arrays read-only again: unpickled arrays are writeable.
        given = {item.name: getattr(self, item.name) for item in fields(self)}
        return partial(type(self), **given | {"extras": dict(self.extras), "readings": dict(self.readings)}), ()

    @classmethod
    def from_commands(
        cls, time: FloatArray, commands: FloatArray, *, name: str = "", reference: Mapping[str, float] | None = None
    ) -> Self:
        """Trial that was not run, at rest at zero; (n,) instants in s, (n, k) commands, channels at ``reference``."""
        channels = reference or {}
        return cls(
            name=name,
            path=Path(name),
            time=time,
            position=np.zeros(len(time)),
            commands=commands,
            rate=np.zeros(len(time)),
            extras={channel: np.full(len(time), value) for channel, value in channels.items()},
            reference=channels,
        )

    def arrays(self) -> dict[str, Any]:
        """The arrays by field, without the further channels."""
        values = {item.name: getattr(self, item.name) for item in fields(self)}
        return {name: value for name, value in values.items() if isinstance(value, np.ndarray)}

    def part(self, rows: slice, name: str, known_from: int = 0) -> Self:
        """The ``rows`` as a trial of its own, with time from 0. Commands before the row ``known_from`` are lost."""
        start = float(self.time[rows][0])
        cut = {field_name: values[rows] for field_name, values in self.arrays().items()}
        cut["time"] = cut["time"] - start
        return replace(
            self,
            **cut,
            name=name,
            parent=self.parent or self.name,
            extras={channel: values[rows] for channel, values in self.extras.items()},
            readings={name: one.between(start, float(self.time[rows][-1])) for name, one in self.readings.items()},
            start_epoch=None if self.start_epoch is None else self.start_epoch + start,
            campaign_time=self.campaign_time + start,
            log_time=self.log_time + start,
            past=self._past_of(rows.indices(len(self.time))[0], known_from),
            cuts=tuple(cut - start for cut in self.cuts),
            unknown=tuple((begin - start, end - start) for begin, end in self.unknown),
        )

    def _past_of(self, first: int, known_from: int) -> Past | None:
        """Commands before the row ``first``, as far as they may matter."""
        time, commands = self.time[known_from:first], self.orders[known_from:first]
        if known_from == 0 and self.past is not None:
            before = self.past.commands if self.angle_gains is None else self.past.commands / self.angle_gains[0]
            time, commands = np.append(self.past.time, time), np.concatenate((before, commands))
        if not len(time):
            return None
        # Rows without a change of command change nothing.
        changed = np.concatenate(([True], np.any(np.diff(commands, axis=0) != 0.0, axis=1)))
        rows = np.flatnonzero(changed)[-_PAST_CHANGES:]
        # The angles of rudders before, at the speed of the first row.
        gain = 1.0 if self.angle_gains is None else self.angle_gains[first]
        return Past(time=time[rows] - self.time[first], commands=gain * commands[rows])

    @cached_property
    def orders(self) -> FloatArray:
        """(n, k) commands as given: in rad where a rudder turns, whatever the speed."""
        return self.commands if self.angle_gains is None else np.asarray(self.commands / self.angle_gains)

    @property
    def has_actuators(self) -> bool:
        """Whether an actuator drives the vehicle along the axis; otherwise it was released from a tilt."""
        return bool(self.commands.shape[1])

    @property
    def duration(self) -> float:
        """Length of the record in s."""
        return float(self.time[-1] - self.time[0])

    @cached_property
    def measured(self) -> BoolArray:
        """(n,) where the position was measured."""
        measured = np.isfinite(self.position)
        measured.setflags(write=False)
        return measured

    @cached_property
    def first_position(self) -> float:
        """First measured position, rad or m."""
        return float(self.position[int(np.argmax(self.measured))])

    @cached_property
    def body_position(self) -> FloatArray:
        """(n,) integral of the body rate along the axis; NaN where not measured.

        Equal to the position, except in yaw where the tilt is logged. There
        d(angle) = cos(phi) cos(theta) dpsi - sin(phi) dtheta (Fossen 2011, eq. 2.28 solved for r).
        """
        if self.axis is not YAW or self.roll is None or self.pitch is None:
            return self.position
        known = self.measured
        roll, pitch = self._filled(self.roll)[known], self._filled(self.pitch)[known]
        level = np.cos(roll) * np.cos(pitch)
        position = self.position[known]
        steps = 0.5 * (level[1:] + level[:-1]) * np.diff(position)
        steps -= 0.5 * (np.sin(roll[1:]) + np.sin(roll[:-1])) * np.diff(pitch)
        angle = np.full(len(self.time), np.nan)
        angle[known] = position[0] + np.concatenate(([0.0], np.cumsum(steps)))
        angle.flags.writeable = False
        return angle

    def _filled(self, values: FloatArray) -> FloatArray:
        """(n,) ``values`` with gaps interpolated linearly; zeros where no value is known."""
        finite = np.isfinite(values)
        return np.interp(self.time, self.time[finite], values[finite]) if finite.any() else np.zeros(len(values))

    @cached_property
    def sampling_interval(self) -> float:
        """Median interval between measured positions in s."""
        return float(np.median(np.diff(self.time[self.measured])))


@dataclass(frozen=True, kw_only=True)
class Campaign:
    """The trials of one vehicle, ordered by name, and the remarks on the whole campaign."""

    trials: tuple[Trial, ...]
    sources: tuple[Path, ...]
    remarks: tuple[Remark, ...] = ()
    faults: tuple[Fault, ...] = ()  #: All faults of the logs, in the order of the logs.

    @property
    def samples(self) -> int:
        """Number of measured positions."""
        return int(sum(trial.measured.sum() for trial in self.trials))


# A number on its own: the only difference that two remarks on the same fault may have.
_NUMBER = re.compile(r"(?<![\w.])\d+(?:[.,:]\d+)*(?!\w)")


def merged_remarks(trials: Sequence[Trial], kinds: Collection[str] = ()) -> list[str]:
    """Remarks on ``trials``, of these ``kinds`` if any are given.

    Equal remarks are merged, led by the log with the largest count, with five others.
    """
    groups: dict[tuple[str, str], list[tuple[Remark, str]]] = {}
    for trial in trials:
        for remark in trial.remarks:
            if kinds and remark.kind not in kinds:
                continue
            groups.setdefault((remark.kind, _NUMBER.sub("", remark.text)), []).append((remark, trial.name))
    texts = []
    for group in groups.values():
        (first, name), *others = sorted(group, key=lambda pair: -pair[0].count)
        text = f"{name}: {first.text}"
        if others:
            text += f" Likewise in {shortened_list(f'{log} ({remark.count})' for remark, log in others)}."
        texts.append(text)
    return texts
