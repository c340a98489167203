"""Values that mean "no command": 0 us or 65535 of a pulse width while disarmed, NaN of a motor that is stopped.

Such a number lies far outside the thrust curve, and no other command lies between it and the curve. Held to the end of
the curve, it would pass for full thrust. NaN is a missing cell as well. It means no thrust if the log has no neutral
command, and the vehicle slows down or rests wherever all commands are NaN. Where the vehicle gains speed without any
pulse, something drives it: the command is unknown.
"""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from rovid.core.array_types import BoolArray, FloatArray
from rovid.faults.base import CommandData, Detection, Detectors
from rovid.trial.fault import Fault
from rovid.trial.segments import subsampled_median
from rovid.trial.vehicle import FAR_OUTSIDE, ThrustCurve

# Values that autopilots and bridges write for "no pulse": zero, minus one, the ends of 16-bit integers.
_NO_PULSE = (0.0, -1.0, 65535.0, 32767.0, -32768.0)
# PX4 topics whose message definitions say: "NaN maps to disarmed".
_NAN_STOPS = ("actuator_motors.", "actuator_motors#", "actuator_servos.", "actuator_servos#")
# Share of the curve's half width within which a command is neutral.
_NEUTRAL = 0.02
# Usual intervals of the known commands, from which a stretch of NaN is longer than a loss or a slower topic.
_STRETCH = 3.0
# Share of the readings that may be NaN outside of such stretches, as where a sine passes through zero.
_MAX_SINGLE = 0.05
# Number of mean speeds in a stretch; span of a mean speed: least in readings, and most as a share of the log.
_MOST_SPEEDS, _LEAST_READINGS, _LEAST_SHARE = 20, 5, 0.02
# Shares of the log's usual largest speed: the gain of a driven vehicle, in moving water too; the speed at rest.
_GAINED, _SLOW = 1.0 / 3.0, 0.25
# Share of its speed at the beginning of a stretch, below which a vehicle has slowed down.
_SLOWED = 0.5


def _detect(data: CommandData) -> Iterator[Detection[CommandData]]:
    curve = data.thruster.curve if data.thruster else None
    marked = _no_pulse(data.values, curve)
    if not marked.any():
        marked = _stopped(data, curve)
    if not marked.any():
        return
    driven = _within(marked, [rows for rows in _stretches(marked) if _motion(data, rows) == "driven"])
    at = max(0.0, float(data.time[int(np.argmax(marked))] - data.measured[0]))
    neutral = curve.neutral if curve else 0.0
    found = ", ".join(f"{value:g}" for value in np.unique(data.values[marked]).tolist())
    count = int(np.count_nonzero(marked))
    text = f"{data.log}: the commands of {data.name} are {found} in {count} samples, first at {at:.2f} s. "
    if curve and found != "nan":
        low, high = curve.command[[0, -1]].tolist()
        text += f"The curve ends at {low:g} and {high:g}: the value means no command."
    else:
        text += "NaN means no command."
    done = f"It was taken as no thrust (command {neutral:g})."
    if driven.any():
        text += f" In {np.count_nonzero(driven)} of these samples the vehicle gains speed, so it was driven."
        done = f"{'' if driven[marked].all() else done} Where the vehicle was driven, the command is unknown.".strip()
    fault = Fault(
        fault="sentinel_command",
        logs=(data.log,),
        at=(at,),
        size=float(count),
        unit="samples",
        text=text,
        remedy="unknown" if driven[marked].all() else "zero",
    )
    values = np.where(marked, np.where(driven, np.nan, neutral), data.values)
    edges = np.append(data.time, np.inf)
    unknown = tuple((float(edges[max(rows.start - 1, 0)]), float(edges[rows.stop])) for rows in _stretches(driven))
    yield Detection(
        fault=fault, done=done, repair=lambda data: replace(data, values=values, unknown=(*data.unknown, *unknown))
    )


def _no_pulse(values: FloatArray, curve: ThrustCurve | None) -> BoolArray:
    """(n,) whether the value is a number that means "no command"."""
    marked = np.zeros(len(values), dtype=bool)
    if curve is None:
        return marked
    largest = np.abs(curve.command).max()
    for value in _NO_PULSE:
        # A value of the curve's own size may be full thrust, in the direction that a one-sided curve lacks.
        if curve.reach(np.array(value)) > FAR_OUTSIDE and not 0.5 * largest <= abs(value) <= 2.0 * largest:
            marked |= values == value
    others = values[~marked & np.isfinite(values)]
    # Commands of another unit than the curve pass through zero, too.
    is_alone = np.all(curve.reach(others) <= FAR_OUTSIDE)
    return marked if is_alone else np.zeros_like(marked)


def _stopped(data: CommandData, curve: ThrustCurve | None) -> BoolArray:
    """(n,) whether NaN means that the motor is stopped."""
    absent = np.isnan(data.values)
    none = np.zeros_like(absent)
    if data.source.startswith(_NAN_STOPS):
        return absent
    if curve is None:
        return none
    known = data.values[~absent]
    half = 0.5 * float(np.ptp(curve.command))
    if not absent.any() or len(known) < 2 or np.any(curve.reach(known) > FAR_OUTSIDE):
        return none
    pushed = _others_push(data, _NEUTRAL * half)
    if np.any((data.values == curve.neutral) & ~pushed):
        return none
    usual = subsampled_median(np.diff(data.time[~absent]))
    edges = np.append(data.time, data.measured[-1])
    long = [rows for rows in _stretches(absent) if edges[rows.stop] - edges[rows.start] > _STRETCH * usual]
    motions = [_motion(data, rows) for rows in long if not pushed[rows].any()]
    # The first cells of a table are empty until the first command is known.
    evidence = "freed" in motions or (data.alone and "rests" in motions)
    if not evidence or "driven" in motions:
        return none
    stretches = _within(absent, long)
    return absent if np.mean(absent & ~stretches) <= _MAX_SINGLE else stretches


def _others_push(data: CommandData, width: float) -> BoolArray:
    """(n,) whether another command is known and more than ``width`` from neutral."""
    pushed = np.zeros(len(data.time), dtype=bool)
    for other in data.others:
        rows = np.searchsorted(other.time, data.time, side="right") - 1
        curve = other.thruster.curve if other.thruster else None
        values = np.where(rows >= 0, other.values[rows], np.nan)
        values[_no_pulse(values, curve)] = np.nan
        pushed |= np.abs(values - (curve.neutral if curve else 0.0)) > width
    return pushed


def _motion(data: CommandData, rows: slice) -> str:
    """Motion in the stretch of ``rows``: "driven", "freed", "rests", or unknown ("")."""
    time, position = data.measured, data.position
    if len(position) < 2 * _LEAST_READINGS:
        return ""
    begin = max(float(data.time[rows.start]), float(time[0]))
    end = min(float(np.append(data.time, np.inf)[rows.stop]), float(time[-1]))
    window = min(_LEAST_SHARE * float(time[-1] - time[0]), 0.25 * (end - begin))
    window = max(window, _LEAST_READINGS * subsampled_median(np.diff(time)))
    count = min(int((end - begin) / window), _MOST_SPEEDS)
    if count < 2:
        return ""
    usual = float(np.quantile(_speeds(time, position, np.arange(time[0], time[-1], window)), 0.9))
    speeds = _speeds(time, position, np.linspace(begin, end, count + 1))
    before = _speeds(time, position, np.array([begin - window, begin])) if begin - window > time[0] else speeds[:1]
    first = max(float(speeds[0]), float(before[0]))
    if speeds.max() - first > _GAINED * usual:
        return "driven"
    if speeds.max() <= _SLOW * usual:
        return "rests"
    return "freed" if first > _SLOW * usual and speeds[-1] < _SLOWED * first else ""


def _speeds(time: FloatArray, position: FloatArray, edges: FloatArray) -> FloatArray:
    """(k-1,) absolute mean speeds between the (k,) ``edges`` in s."""
    return np.asarray(np.abs(np.diff(np.interp(edges, time, position))) / np.diff(edges))


def _stretches(marked: BoolArray) -> list[slice]:
    """Rows of each unbroken stretch of ``marked``."""
    edges = np.flatnonzero(np.diff(marked, prepend=False, append=False))
    return [slice(*pair) for pair in edges.reshape(-1, 2).tolist()]


def _within(marked: BoolArray, stretches: list[slice]) -> BoolArray:
    """(n,) the ``marked`` rows within the ``stretches``."""
    within = np.zeros_like(marked)
    for rows in stretches:
        within[rows] = True
    return within & marked


DETECTORS: Detectors = {"command": (_detect,)}
