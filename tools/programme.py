"""The runs of a trial day: what was commanded, and on which clock and in which format it was logged.

Commands are counted from neutral; what is said of V holds for any unit of command.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from tools.truth import ROSUB, FloatArray, Truth

Format = Literal["csv", "json", "ros2"]

LEAD = 4.0  # s of zero command before each run
_MULTILEVEL_SEED = 20130401  # the programme is the same on every day, whatever the day's own seed
_LEVELS = (-2.4, -2.1, -1.8, -1.5, -1.1, 0.0, 0.9, 1.2, 1.4, 1.6, 1.8, 2.0)  # V


@dataclass(frozen=True)
class Hold:
    """``volts`` held for ``duration`` s."""

    volts: float
    duration: float

    def command(self, time: FloatArray) -> FloatArray:
        """Command in V at ``time`` in s since the piece began."""
        return np.full(len(time), self.volts)


@dataclass(frozen=True)
class Sine:
    """Whole ``cycles`` of ``period`` s; half-waves reach ``positive`` V and -``negative`` V."""

    positive: float
    negative: float
    period: float
    cycles: int

    @property
    def duration(self) -> float:
        """Length in s."""
        return self.period * self.cycles

    def command(self, time: FloatArray) -> FloatArray:
        """Command in V at ``time`` in s since the piece began."""
        wave = np.sin(2.0 * np.pi * time / self.period)
        return wave * np.where(wave > 0.0, self.positive, self.negative)


Piece = Hold | Sine


@dataclass(frozen=True, kw_only=True)
class Run:
    """One log.

    Attributes
    ----------
    name
        Of the file, without suffix.
    pieces
        Commanded one after the other, after LEAD s of zero.
    only
        Name of the driven thruster; None: all thrusters.
    format
        Of the log.
    command_rate
        Hz at which commands are given and logged in MCAP; None: logged only where they change.
    """

    name: str
    pieces: tuple[Piece, ...]
    only: str | None = None
    format: Format = "csv"
    command_rate: float | None = 20.0

    @property
    def duration(self) -> float:
        """Length in s, lead included."""
        return LEAD + sum(piece.duration for piece in self.pieces)

    def command(self, time: FloatArray) -> FloatArray:
        """Command in V at ``time`` in s since the log began."""
        pieces: Sequence[Piece] = (Hold(0.0, LEAD), *self.pieces)
        ends = np.cumsum([piece.duration for piece in pieces])
        volts = np.zeros(len(time))
        index = np.searchsorted(ends, time, side="right")
        for k, piece in enumerate(pieces):
            inside = index == k
            volts[inside] = piece.command(time[inside] - (ends[k] - piece.duration))
        return volts


def multilevel(duration: float, levels: Sequence[float] = _LEVELS) -> tuple[Hold, ...]:
    """Random ``levels`` in both directions, each held for 3 to 10 s, ``duration`` s in all."""
    rng = np.random.default_rng(_MULTILEVEL_SEED)
    holds: list[Hold] = []
    left = duration
    while left > 0.0:
        seconds = min(left, float(rng.integers(3, 11)))
        holds.append(Hold(float(rng.choice(levels)), seconds))
        left -= seconds
    return tuple(holds)


def staircase(*levels: float) -> tuple[Hold, ...]:
    """Each of ``levels`` in V for 15 s."""
    return tuple(Hold(volts, 15.0) for volts in levels)


# Reverse levels are those that give the torque of a forward level of the paper's Table III.
CAMPAIGN: tuple[Run, ...] = (
    Run(name="hold_01", pieces=(Hold(1.55, 120.0),)),
    Run(name="hold_02", pieces=(Hold(1.04, 120.0), Hold(1.33, 120.0))),
    Run(name="hold_03", pieces=(Hold(1.68, 120.0), Hold(0.0, 20.0), Hold(1.94, 120.0))),
    Run(name="hold_04", pieces=(Hold(0.80, 120.0), Hold(-0.97, 120.0))),
    Run(name="hold_05", pieces=(Hold(-1.29, 120.0), Hold(-1.67, 120.0))),
    Run(name="hold_06", pieces=(Hold(-1.97, 120.0),), format="json", command_rate=10.0),
    Run(name="hold_07", pieces=(Hold(-2.48, 120.0),), format="ros2", command_rate=10.0),
    Run(name="sine_20s", pieces=(Sine(2.0, 2.51, 20.0, 8),), format="ros2", command_rate=50.0),
    Run(name="sine_40s_a", pieces=(Sine(1.55, 2.2, 40.0, 6),)),
    Run(name="sine_40s_b", pieces=(Sine(2.0, 2.51, 40.0, 6),)),
    Run(name="sine_80s", pieces=(Sine(1.68, 2.14, 80.0, 6),)),
    Run(name="staircase", pieces=staircase(0.8, 1.33, 1.94, 1.55, 1.04, -0.97, -1.67, -2.48, -1.97, -1.29)),
    Run(name="coast_01", pieces=(Hold(1.94, 35.0), Hold(0.0, 75.0)), format="json", command_rate=None),
    Run(name="coast_02", pieces=(Hold(-2.48, 35.0), Hold(0.0, 75.0))),
    Run(
        name="steps",
        pieces=tuple(Hold(volts, 12.0) for volts in (1.55, -1.97, 1.94, 0.0, -1.67, 1.04, -2.48, 0.0)),
        format="json",
        command_rate=50.0,
    ),
    Run(name="multilevel", pieces=multilevel(150.0), format="ros2", command_rate=None),
    Run(name="fore_only", pieces=(Hold(2.2, 40.0), Hold(-2.8, 40.0)), only="fore"),
    Run(name="aft_only", pieces=(Hold(2.2, 40.0), Hold(-2.8, 40.0)), only="aft"),
)


def campaign_for(truth: Truth) -> tuple[Run, ...]:
    """The campaign at the pace of ``truth``, with the same shares of its middling torque as ROSUB has of its own."""
    if truth.pace is None:
        return CAMPAIGN
    return tuple(_scaled(run, truth, truth.pace) for run in CAMPAIGN)


def _scaled(run: Run, truth: Truth, pace: float) -> Run:
    pieces = tuple(_scaled_piece(piece, truth, pace) for piece in run.pieces)
    name = run.name
    for old, new in zip(run.pieces, pieces, strict=True):
        if isinstance(old, Sine) and isinstance(new, Sine):
            name = name.replace(f"{old.period:g}s", f"{new.period:g}s")
    return replace(run, name=name, pieces=pieces)


def _scaled_piece(piece: Piece, truth: Truth, pace: float) -> Piece:
    if isinstance(piece, Hold):
        return Hold(_like_rosub(piece.volts, truth), piece.duration * pace)
    positive, negative = _like_rosub(piece.positive, truth), -_like_rosub(-piece.negative, truth)
    return Sine(positive, negative, piece.period * pace, piece.cycles)


def _like_rosub(volts: float, truth: Truth) -> float:
    """Command whose thrust is to the middling one as that of ``volts`` is on ROSUB."""
    thrust = float(ROSUB.thrusters[0].curve.thrust(np.array([volts]))[0])
    curve = truth.thrusters[0].curve
    return curve.offset_for(thrust / ROSUB.middle_thrust * truth.middle_thrust)
