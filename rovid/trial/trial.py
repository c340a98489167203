"""Frozen records of what was measured, in SI units and radians."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cached_property, partial
from pathlib import Path
from types import MappingProxyType
from typing import Self

import numpy as np
from numpy.typing import ArrayLike

from rovid.core.array_types import BoolArray, FloatArray
from rovid.trial.axis import YAW, Axis


def read_only(values: ArrayLike) -> FloatArray:
    """``values`` as float64 that nobody can write to, copied where anybody could."""
    array = np.asarray(values, dtype=np.float64)
    if array.flags.writeable:
        array = array.copy()
        array.setflags(write=False)
    return array


@dataclass(frozen=True, kw_only=True)
class Remark:
    """One thing that a reader noticed in a log and what it did about it.

    ``kind`` is a stable word (duplicate, backward, missing, outlier, frozen, gap, truncated, extrapolated,
    repeated, start, stale, skipped); ``count`` how many samples (or bytes, for truncated) it touches; ``text``
    a full sentence.
    """

    kind: str
    count: int
    text: str


@dataclass(frozen=True, kw_only=True, eq=False)
class Trial:
    """One run of the vehicle.

    All arrays have one row for each instant of ``time``, which is the union of the instants at which the
    position was measured and those at which a command changed. A position that was not measured at an instant
    is NaN; a command holds its value until the next instant.

    Attributes
    ----------
    name
        Path of the log, relative to the campaign.
    path
        The file itself.
    time
        (n,) s, strictly increasing from 0.
    position
        (n,) along ``axis``, in yaw the heading: rad, unwrapped, or m; positive in the sense in which the log's grows.
        NaN where not measured.
    commands
        (n, k) each actuator's command in the unit of its thrust curve (N m for a logged torque), held.
    rate, roll, pitch
        (n,) rad/s or m/s, rad, rad or None where not logged; linear between neighbours where they have a clock of
        their own, NaN where those are farther apart than a gap.
    extras
        Any further mapped channel, (n,), held, in the unit of the log.
    reference
        Median of each further channel over the whole campaign.
    remarks
        What the reader noticed.
    integrated
        Whether the rate alone was measured, of which ``position`` is then the integral.
    began
        s since 1970 at time 0; None where the log does not tell.
    since
        s from the beginning of the campaign's first trial to that of this one.
    whole
        Name of the trial that this one is a part of; empty where it is none.
    beside
        Further files that it was read from.
    """

    name: str
    path: Path
    time: FloatArray
    position: FloatArray
    commands: FloatArray
    rate: FloatArray | None = None
    roll: FloatArray | None = None
    pitch: FloatArray | None = None
    extras: Mapping[str, FloatArray] = field(default_factory=dict)
    reference: Mapping[str, float] = field(default_factory=dict)
    remarks: tuple[Remark, ...] = ()
    axis: Axis = YAW
    rate_only: bool = False
    start_epoch: float | None = None
    campaign_time: float = 0.0
    parent: str = ""
    companion_files: tuple[Path, ...] = ()

    def __post_init__(self) -> None:
        for item in fields(self):
            value = getattr(self, item.name)
            if isinstance(value, np.ndarray):
                object.__setattr__(self, item.name, read_only(value))
        extras = {name: read_only(values) for name, values in self.extras.items()}
        object.__setattr__(self, "extras", MappingProxyType(extras))
        if self.commands.ndim != 2 or not len(self.commands) == len(self.time) == len(self.position):
            msg = f"{self.name}: time {self.time.shape}, position {self.position.shape}, {self.commands.shape}"
            raise ValueError(msg)

    def __reduce__(self) -> tuple[Callable[[], Self], tuple[()]]:
        # Made anew, for arrays come out of a pickle writeable.
        given = {item.name: getattr(self, item.name) for item in fields(self)}
        return partial(type(self), **given | {"extras": dict(self.extras)}), ()

    @classmethod
    def from_commands(
        cls, time: FloatArray, commands: FloatArray, *, name: str = "", reference: Mapping[str, float] | None = None
    ) -> Self:
        """A trial that was never run, at rest at zero, of (n,) instants in s and (n, k) commands.

        Each further channel stands at its ``reference``.
        """
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

    def part(self, where: slice, name: str) -> Self:
        """The stretch ``where`` as a trial by itself, its time from 0."""

        def cut(values: FloatArray | None) -> FloatArray | None:
            return None if values is None else values[where]

        start = float(self.time[where][0])
        return replace(
            self,
            name=name,
            parent=self.parent or self.name,
            time=self.time[where] - self.time[where][0],
            position=self.position[where],
            commands=self.commands[where],
            rate=cut(self.rate),
            roll=cut(self.roll),
            pitch=cut(self.pitch),
            extras={channel: values[where] for channel, values in self.extras.items()},
            start_epoch=None if self.start_epoch is None else self.start_epoch + start,
            campaign_time=self.campaign_time + start,
        )

    @property
    def has_actuators(self) -> bool:
        """Whether anything drives the vehicle along the axis; else it was let go of, tilted."""
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
        """The first position that was measured, rad or m."""
        return float(self.position[int(np.argmax(self.measured))])

    @cached_property
    def body_position(self) -> FloatArray:
        """(n,) the integral of the body's rate along the axis: of the position itself, but in yaw where tilt is logged.

        There d(angle) = cos(phi) cos(theta) dpsi - sin(phi) dtheta (Fossen 2011, eq. 2.28 solved for r). NaN where
        nothing was measured.
        """
        if self.axis is not YAW or self.roll is None or self.pitch is None:
            return self.position
        known = self.measured
        roll, pitch = self._bridged(self.roll)[known], self._bridged(self.pitch)[known]
        level = np.cos(roll) * np.cos(pitch)
        position = self.position[known]
        steps = 0.5 * (level[1:] + level[:-1]) * np.diff(position)
        steps -= 0.5 * (np.sin(roll[1:]) + np.sin(roll[:-1])) * np.diff(pitch)
        angle = np.full(len(self.time), np.nan)
        angle[known] = position[0] + np.concatenate(([0.0], np.cumsum(steps)))
        angle.flags.writeable = False
        return angle

    def _bridged(self, values: FloatArray) -> FloatArray:
        """(n,) ``values`` with straight lines where they are not known; zero where none is."""
        finite = np.isfinite(values)
        if not finite.any():
            return np.zeros(len(values))
        return np.interp(self.time, self.time[finite], values[finite])

    @cached_property
    def sampling_interval(self) -> float:
        """Median interval between measured positions in s."""
        return float(np.median(np.diff(self.time[self.measured])))


@dataclass(frozen=True, kw_only=True)
class Campaign:
    """The trials of one vehicle, in the order of their names, and what was noticed across them."""

    trials: tuple[Trial, ...]
    sources: tuple[Path, ...]
    remarks: tuple[Remark, ...] = ()

    @property
    def samples(self) -> int:
        """Number of measured positions."""
        return int(sum(trial.measured.sum() for trial in self.trials))


# A number by itself, which two remarks on the same thing may differ in.
_NUMBER = re.compile(r"(?<![\w.])\d+(?:[.,:]\d+)*(?!\w)")


def merged_remarks(trials: Sequence[Trial], most: int = 5) -> list[str]:
    """What was noticed in ``trials``, the same in several of them once, with the log where there is most of it."""
    same: dict[tuple[str, str], list[tuple[Remark, str]]] = {}
    for trial in trials:
        for remark in trial.remarks:
            same.setdefault((remark.kind, _NUMBER.sub("", remark.text)), []).append((remark, trial.name))
    return [_with_others(sorted(each, key=lambda one: -one[0].count), most) for each in same.values()]


def _with_others(noticed: Sequence[tuple[Remark, str]], most: int) -> str:
    (first, name), *others = noticed
    text = f"{name}: {first.text}"
    if not others:
        return text
    listed = ", ".join(f"{where} ({remark.count})" for remark, where in others[:most])
    more = f" and {len(others) - most} more" if len(others) > most else ""
    return f"{text} Likewise in {listed}{more}."
