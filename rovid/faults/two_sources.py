"""Two sensors or talkers mixed in one signal: the readings alternate between two series with an offset.

Each change of the source is a step by the offset, up and down in turn. Noise and motion step twice in one direction.
"""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from rovid.core.array_types import BoolArray
from rovid.faults.base import Detection, Detectors, SignalData
from rovid.trial.fault import Fault

_MIN_READINGS, _MIN_CHANGES = 60, 20
# Share of the steps that change the source at least, and share of the changes that must alternate in sign.
_MIN_SHARE, _ALTERNATING = 0.1, 0.97
# Number of steps whose mean is the motion; even, so that alternating offsets cancel.
_MEAN = 8
# Largest range between the quartiles of the changes, and largest 90th percentile of the other steps, in offsets.
_SPREAD, _OTHERS = 0.3, 0.35
# Resolutions of the log below which an offset is flicker between adjacent values.
_FLICKER = 2.5
# Steps that define the resolution.
_SMALLEST = 1e-9


def _detect(data: SignalData) -> Iterator[Detection[SignalData]]:
    if len(data.values) < _MIN_READINGS:
        return
    found = _second_source(data)
    if found is None:
        return
    second, offset, error = found
    count = int(np.count_nonzero(second))
    angle = data.unit.startswith("rad")
    size, unit = (np.rad2deg(offset), data.unit.replace("rad", "deg")) if angle else (offset, data.unit)
    fault = Fault(
        fault="two_sources",
        logs=(data.log,),
        size=offset,
        standard_error=error,
        unit=data.unit,
        text=f"{data.log}: the {data.name} alternates between two sources that differ by {size:.3g} {unit}.",
        remedy="left_out",
    )
    yield Detection(
        fault=fault,
        done=f"The source with more readings was taken; {count} readings of the other were left out.",
        repair=lambda data: replace(data, time=data.time[~second], values=data.values[~second]),
    )


def _second_source(data: SignalData) -> tuple[BoolArray, float, float] | None:
    """(n,) whether a reading is of the source with fewer readings, its offset and the standard error; None if one."""
    steps = np.diff(data.values)
    if np.isfinite(data.period):
        steps -= data.period * np.rint(steps / data.period)
    sums = np.concatenate(([0.0], np.cumsum(steps)))
    begins = np.clip(np.arange(len(steps)) - _MEAN // 2, 0, len(steps) - _MEAN)
    departures = steps - (sums[begins + _MEAN] - sums[begins]) / _MEAN
    sizes = np.abs(departures)
    offset = float(np.percentile(sizes, 95.0))
    change = sizes > 0.5 * offset
    changes = int(np.count_nonzero(change))
    if changes < max(_MIN_CHANGES, _MIN_SHARE * len(steps)):
        return None
    signs = np.sign(departures[change])
    if np.mean(signs[1:] != signs[:-1]) < _ALTERNATING:
        return None
    low, middle, high = np.percentile(sizes[change], (25.0, 50.0, 75.0)).tolist()
    others = float(np.percentile(sizes[~change], 90.0)) if changes < len(steps) else 0.0
    differences = np.diff(np.unique(data.values))
    resolution = float(differences[differences > _SMALLEST].min(initial=np.inf))
    if high - low > _SPREAD * middle or others > _OTHERS * middle or middle < _FLICKER * resolution:
        return None
    # The source is the one that the last change led to: the upper after a step up.
    last = np.maximum.accumulate(np.where(change, np.arange(len(steps)), -1))
    upper = np.where(last < 0, -signs[0], np.sign(departures[last])) > 0.0
    upper = np.concatenate(([signs[0] < 0.0], upper))
    second = upper if np.count_nonzero(upper) <= 0.5 * len(upper) else ~upper
    up, down = steps[change][signs > 0.0], steps[change][signs < 0.0]
    size = 0.5 * float(np.median(up) - np.median(down))  # The motion cancels.
    return second, size, float((high - low) / 1.35 / np.sqrt(changes))


DETECTORS: Detectors = {"signal": (_detect,)}
