"""The runs of a trial day in surge, heave or pitch.

Levels are shares of the middling thrust, positive along the axis: every thruster gets the command whose thrust, by its
bench curve, is that share in the sense of its arm. Ahead and astern therefore push alike, whatever the curve.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import replace

from tools.programme import Hold, Piece, Run, Sine, multilevel, staircase
from tools.truth import Thruster, Truth

_LEVELS = (-1.0, -0.8, -0.6, -0.4, 0.0, 0.4, 0.6, 0.8, 1.0)


def axis_campaign(truth: Truth) -> tuple[Run, ...]:
    """The runs that suit the axis of ``truth``, with shares in place of commands; `commanded` turns them into those.

    The pace of ``truth`` quickens sines and steps, which then go on for as long by being more. Holds, coasts and
    releases are as long on every vehicle.
    """
    pace = truth.pace or 1.0
    runs = _pitch(pace) if truth.axis == "pitch" else _straight(pace, *_REACH[truth.axis])
    alone = (
        Run(name=f"{thruster.name}_only", pieces=(Hold(1.4, 40.0), Hold(-1.4, 40.0)), only=thruster.name)
        for thruster in truth.thrusters
    )
    return (*runs, *alone)


# Axis -> (factor on all levels, s of a hold). Heave goes less far: the sea has a bottom.
_REACH = {"surge": (1.0, 70.0), "heave": (0.8, 45.0)}


def _straight(pace: float, reach: float, held: float) -> tuple[Run, ...]:
    """Of surge and heave: there and back again."""
    runs = (
        Run(name="hold_01", pieces=_both(0.35, held)),
        Run(name="hold_02", pieces=_both(0.65, held)),
        Run(name="hold_03", pieces=_both(1.0, held)),
        Run(name="hold_04", pieces=_both(1.4, held)),
        _sine(60.0, 1.2, 4, pace),
        _sine(30.0, 1.0, 6, pace),
        _sine(15.0, 1.3, 8, pace),
        _sine(8.0, 1.2, 12, pace),
        Run(name="staircase", pieces=staircase(0.3, 0.7, 1.3, 1.0, 0.5, -0.3, -0.7, -1.3, -1.0, -0.5)),
        Run(name="steps", pieces=_steps(pace, 12.0, (1.0, -1.2, 1.3, 0.0, -0.9, 0.5, -1.4, 0.0))),
        Run(name="multilevel", pieces=_multilevel(150.0, pace)),
        Run(name="coast_01", pieces=(Hold(1.4, 30.0), Hold(0.0, 60.0))),
        Run(name="coast_02", pieces=(Hold(-1.4, 30.0), Hold(0.0, 60.0))),
    )
    return tuple(replace(run, pieces=tuple(_times(piece, reach) for piece in run.pieces)) for run in runs)


def _pitch(pace: float) -> tuple[Run, ...]:
    """Of pitch: static tilts, releases, and sines about the resonance, which is at 7.4 s times the pace or near it."""
    return (
        Run(name="hold_01", pieces=(Hold(0.35, 60.0), Hold(1.0, 60.0))),
        Run(name="hold_02", pieces=(Hold(-0.35, 60.0), Hold(-1.0, 60.0))),
        Run(name="hold_03", pieces=(Hold(0.65, 60.0), Hold(1.4, 60.0))),
        Run(name="hold_04", pieces=(Hold(-0.65, 60.0), Hold(-1.4, 60.0))),
        _sine(45.0, 1.2, 4, pace),
        _sine(20.0, 1.0, 8, pace),
        _sine(10.0, 0.5, 12, pace),
        _sine(7.5, 0.35, 16, pace),
        _sine(4.5, 0.9, 20, pace),
        Run(name="staircase", pieces=staircase(0.3, 0.6, 1.2, 0.9, 0.5, -0.3, -0.6, -1.2, -0.9, -0.5)),
        Run(name="steps", pieces=_steps(pace, 12.0, (0.7, -0.5, 0.9, 0.0, -0.6, 0.4, -0.8, 0.0))),
        Run(name="multilevel", pieces=_multilevel(120.0, pace)),
        Run(name="release_01", pieces=(Hold(1.4, 40.0), Hold(0.0, 60.0))),
        Run(name="release_02", pieces=(Hold(-1.4, 40.0), Hold(0.0, 60.0))),
    )


def _both(share: float, seconds: float) -> tuple[Hold, Hold]:
    return Hold(share, seconds), Hold(-share, seconds)


def _sine(period: float, share: float, cycles: int, pace: float) -> Run:
    period *= pace
    return Run(name=f"sine_{period:g}s", pieces=(Sine(share, share, period, round(cycles / pace)),))


def _steps(pace: float, seconds: float, shares: Iterable[float]) -> tuple[Hold, ...]:
    return tuple(Hold(share, seconds * pace) for share in shares) * round(1.0 / pace)


def _multilevel(duration: float, pace: float) -> tuple[Hold, ...]:
    return tuple(replace(hold, duration=hold.duration * pace) for hold in multilevel(duration / pace, _LEVELS))


def _times(piece: Piece, reach: float) -> Piece:
    if isinstance(piece, Hold):
        return replace(piece, volts=piece.volts * reach)
    return replace(piece, positive=piece.positive * reach, negative=piece.negative * reach)


def commanded(run: Run, thruster: Thruster, truth: Truth) -> Run:
    """``run`` of shares as ``thruster`` of ``truth`` is told it: commands, counted from neutral."""
    full = math.copysign(truth.middle_thrust, thruster.arm)
    return replace(run, pieces=tuple(_told(piece, thruster, full) for piece in run.pieces))


def _told(piece: Piece, thruster: Thruster, full: float) -> Piece:
    curve = thruster.curve
    if isinstance(piece, Hold):
        return replace(piece, volts=curve.offset_for(piece.volts * full))
    # The negative half-wave is told by its size: a thruster that pushes against the axis has both of them negative.
    return replace(
        piece, positive=curve.offset_for(piece.positive * full), negative=-curve.offset_for(-piece.negative * full)
    )
