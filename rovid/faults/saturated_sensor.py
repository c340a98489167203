"""Readings clipped at a bound: many exactly equal extreme values while the vehicle goes on moving.

A sensor with noise does not repeat a value for long, at rest neither. A bound is the largest or the smallest value of
the log, and is reached again and again. A sensor that was frozen repeats any value.

A coarse sensor repeats its values at rest, too. At its bound the motion seems to stop within one reading, while it
changes over many readings in the rest of the log.
"""

from collections.abc import Iterator
from dataclasses import replace
from functools import partial

import numpy as np

from rovid.core.array_types import BoolArray, FloatArray, IntArray
from rovid.faults.base import Detection, Detectors, SignalData
from rovid.trial.fault import Fault

# Readings at the bound, and their share of the log.
_MIN_READINGS, _MIN_SHARE = 10, 0.005
# Length of a run of equal readings that noise does not make: if at most _MAX_REPEATS of all other readings repeat
# the one before, a run of three has a probability of 0.0025 at each place, and seldom lies at an extreme.
_MIN_RUN, _MAX_REPEATS = 4, 0.05
# Steps to and from a bound that the vehicle passes, in resolutions of the log.
_QUANTA = 3.0
# Readings over which the motion of a coarse sensor is measured, and least number of resolutions that it takes there:
# to one in ten. Factor by which the motion stops more sharply at the bound than it changes elsewhere. Decision: a bound
# lies between two readings, and the change of the rate there is measured as three quarters of the rate.
_LAGS, _RESOLVED, _SHARPER = (1, 2, 4, 8, 16), 10.0, 1.5
# Change of the rate between two bounds, as a share of the rate at the bound: a vehicle that reaches its rate within a
# reading also stops within one. Decision.
_CHANGES = 0.5
# A step out of a run, in median steps of the log, beyond which a single run is a frozen sensor and no bound.
_JUMP = 20.0


def _detect(data: SignalData) -> Iterator[Detection[SignalData]]:
    for bound, side in ((data.values.max(), "above"), (data.values.min(), "below")):
        clipped = data.values == bound
        if not _is_bound(data, clipped):
            continue
        is_angle = data.unit.startswith("rad")
        value = np.rad2deg(bound) if is_angle else bound
        unit = data.unit.replace("rad", "deg")
        count, at = int(np.count_nonzero(clipped)), float(data.time[int(np.argmax(clipped))] - data.time[0])
        fault = Fault(
            fault="saturated_sensor",
            logs=(data.log,),
            at=(at,),
            size=float(bound),
            unit=data.unit,
            text=f"{data.log}: the {data.name} is exactly {value:.6g} {unit} in {count} readings, first at {at:.1f} s, "
            f"and never {side}: the sensor is clipped there.",
            remedy="left_out",
        )
        yield Detection(fault=fault, done="These readings were left out.", repair=partial(_without, bound=float(bound)))


def _without(data: SignalData, bound: float) -> SignalData:
    kept = data.values != bound
    return replace(data, time=data.time[kept], values=data.values[kept], clipped=True)


def _is_bound(data: SignalData, clipped: BoolArray) -> bool:
    """Whether the readings where ``clipped`` lie at a bound of the sensor, rather than at rest or frozen."""
    count = int(np.count_nonzero(clipped))
    if count < max(_MIN_READINGS, _MIN_SHARE * len(clipped)) or len(clipped) - count < _MIN_READINGS:
        return False
    steps = np.diff(_unwrapped(data))
    edges = np.flatnonzero(np.diff(clipped, prepend=False, append=False))
    begins, ends = edges[::2], edges[1::2]
    runs = ends - begins
    outside = ~(clipped[1:] & clipped[:-1])
    extremes = (data.values.max(), data.values.min())
    # The sensor may be clipped on the other side, too, where it repeats the other extreme.
    if len(runs) > 1 or sum(extremes) == 0.0:
        outside &= ~((steps == 0.0) & np.isin(data.values[1:], extremes))
    if np.mean(steps[outside] == 0.0) > _MAX_REPEATS:
        return runs.max() >= _MIN_RUN and _stops_sharply(data, clipped, begins, ends)
    if runs.max() < _MIN_RUN:
        return False
    sizes = np.abs(steps)
    ways = np.concatenate((sizes[begins[begins > 0] - 1], sizes[ends[ends < len(clipped)] - 1]))
    if not ways.size or np.median(ways) < _QUANTA * sizes[sizes > 0.0].min():
        return False  # Rest at an extreme: the readings flicker by the resolution.
    if len(runs) > 1:
        return True
    typical = float(np.median(np.abs(steps[outside])))
    after = int(ends[0])
    return after < len(clipped) and bool(abs(steps[after - 1]) < _JUMP * typical)


def _stops_sharply(data: SignalData, clipped: BoolArray, begins: IntArray, ends: IntArray) -> bool:
    """Whether the motion stops within a reading where a coarse sensor is ``clipped``, and only there."""
    values, still = _unwrapped(data), np.diff(data.values) == 0.0
    count, least = len(values), _RESOLVED * np.abs(np.diff(values))[~still].min()
    # The sensor may be clipped on the other side, too.
    extremes = np.isin(data.values, (data.values.max(), data.values.min()))
    clipped = clipped | (extremes & (np.append(still, False) | np.append(False, still)))
    # Rest at the beginning and at the end of a log is usual.
    inner = (begins > 0) & (ends < count)
    edges = np.concatenate((begins[inner], ends[inner]))
    for lag in _LAGS:
        # Changes of the position over ``lag`` readings, and their changes, about the readings from ``lag`` on.
        rates = values[lag:] - values[:-lag]
        bends, free = np.abs(rates[lag:] - rates[:-lag]), _none_of(clipped, 2 * lag + 1)
        inside = edges[(edges > lag) & (edges < count - lag)] - lag
        if not inside.size or not free.any():
            break
        sharp = float(np.median(np.maximum(bends[inside - 1], bends[inside])))
        if sharp < max(least, _SHARPER * bends[free].max()):
            continue
        ways = np.flatnonzero(np.diff(_none_of(clipped, lag + 1), prepend=False, append=False)).reshape(-1, 2)
        if max(np.ptp(rates[first:last]) for first, last in ways.tolist()) > _CHANGES * sharp:
            return True
    return False


def _unwrapped(data: SignalData) -> FloatArray:
    return np.unwrap(data.values, period=data.period) if np.isfinite(data.period) else data.values


def _none_of(clipped: BoolArray, count: int) -> BoolArray:
    """(n - count + 1,) whether none of ``count`` successive readings is ``clipped``."""
    return np.asarray(~np.lib.stride_tricks.sliding_window_view(clipped, count).any(axis=1))


DETECTORS: Detectors = {"signal": (_detect,)}
