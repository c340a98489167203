"""Commands that end before the log, or are silent for many of their usual intervals.

The last command is known for one usual interval. After it the vehicle may have got any command, or none. Commands that
are published only on change are silent while they stay the same; that is no fault. They are recognised by their
intervals, which are irregular, and by their values, which never repeat.
"""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.faults.base import CommandData, Detection, Detectors
from rovid.trial.fault import Fault
from rovid.trial.segments import subsampled_median

_MIN_COMMANDS = 10
# A silence is longer than this many usual intervals, and than this many times the longest of the other intervals but
# one in a hundred: loggers and radio links lose single messages.
_SILENT_INTERVALS, _SILENT_RATIO = 10.0, 3.0
# Commands are logged regularly if the 90th percentile of their intervals is within this many medians.
_REGULAR, _STRICT = 3.0, 1.2
# Smallest share of equal successive commands that shows that commands are published without change, too.
_REPEATED = 0.05
# Share of the commanded range within which a command is neutral.
_NEUTRAL = 0.02
# Share of a silence in which motion must have been measured: in a pause of the whole log, no command is missing.
_MIN_MEASURED = 0.5


def _detect(data: CommandData) -> Iterator[Detection[CommandData]]:
    known = np.isfinite(data.values)
    time, values = data.time[known], data.values[known]
    if len(time) < _MIN_COMMANDS:
        return
    usual, silences = _silences(time, values, data)
    reading = subsampled_median(np.diff(data.measured))
    counts = [int(np.ptp(np.searchsorted(data.measured, pair))) for pair in silences]
    silences = [
        (begin, end)
        for (begin, end), count in zip(silences, counts, strict=True)
        if count * reading >= _MIN_MEASURED * (end - begin)
    ]
    if not silences:
        return
    start, end = data.measured[[0, -1]].tolist()
    unknown = tuple((begin + usual, np.inf if stop >= end else stop) for begin, stop in silences)
    begins = [begin - start for begin, _ in silences]
    size = max(stop - begin for begin, stop in silences)
    if len(silences) == 1 and silences[0][1] >= end:
        what = f"end at {begins[0]:.1f} s, {size:.1f} s before the log"
    else:
        count = len(silences)
        what = f"are silent for {size:.1f} s from {begins[int(np.argmax(np.diff(silences)))]:.1f} s on"
        what += f", and {count - 1} times more" if count > 1 else ""
    fault = Fault(
        fault="stale_commands",
        logs=(data.log,),
        at=tuple(begins),
        size=size,
        unit="s",
        text=f"{data.log}: the commands of {data.name} {what}; their usual interval is {usual:.3g} s.",
        remedy="unknown",
    )
    yield Detection(
        fault=fault,
        done="The command is unknown after one more usual interval, and the log is left out where it matters.",
        repair=lambda data: replace(data, unknown=(*data.unknown, *unknown)),
    )


def _silences(time: FloatArray, values: FloatArray, data: CommandData) -> tuple[float, list[tuple[float, float]]]:
    """Usual interval in s, and (begin, end) in s of each silence of commands that are published regularly."""
    intervals = np.diff(time)
    usual, upper, longest = np.percentile(intervals, (50.0, 90.0, 99.0), method="lower").tolist()
    if upper > _REGULAR * usual:
        return usual, []
    limit = max(_SILENT_INTERVALS * usual, _SILENT_RATIO * longest)
    end = float(data.measured[-1])
    ends = np.append(time[1:], max(end, time[-1]))
    silent = ends - time > limit
    if not np.mean(np.diff(values) == 0.0) >= _REPEATED:
        # Each command differs from the one before: perhaps only changes are published, and a silence is a held value.
        # At a constant rate, a held value that is not neutral is unlikely to be meant.
        silent &= bool(upper <= _STRICT * usual) & (np.abs(values - _neutral(data)) > _NEUTRAL * np.ptp(values))
    return usual, list(zip(time[silent].tolist(), ends[silent].tolist(), strict=True))


def _neutral(data: CommandData) -> float:
    if data.thruster is None or data.thruster.curve is None:
        return 0.0
    return data.thruster.curve.neutral


DETECTORS: Detectors = {"command": (_detect,)}
