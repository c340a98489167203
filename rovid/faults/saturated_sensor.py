"""Readings clipped at a bound: many exactly equal extreme values while the vehicle goes on moving.

A sensor with noise does not repeat a value for long, at rest neither. A bound is the largest or the smallest value of
the log, and is reached again and again. A sensor that was frozen repeats any value.
"""

from collections.abc import Iterator
from dataclasses import replace
from functools import partial

import numpy as np

from rovid.core.array_types import BoolArray
from rovid.faults.base import Detection, Detectors, SignalData
from rovid.trial.fault import Fault

# Readings at the bound, and their share of the log.
_MIN_READINGS, _MIN_SHARE = 10, 0.005
# Length of a run of equal readings that noise does not make: if at most _MAX_REPEATS of all other readings repeat
# the one before, a run of three has a probability of 0.0025 at each place, and seldom lies at an extreme.
_MIN_RUN, _MAX_REPEATS = 4, 0.05
# Steps to and from a bound that the vehicle passes, in resolutions of the log.
_QUANTA = 3.0
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
    steps = np.diff(data.values)
    edges = np.flatnonzero(np.diff(clipped, prepend=False, append=False))
    begins, ends = edges[::2], edges[1::2]
    runs = ends - begins
    outside = ~(clipped[1:] & clipped[:-1])
    extremes = (data.values.max(), data.values.min())
    # The sensor may be clipped on the other side, too, where it repeats the other extreme.
    if len(runs) > 1 or sum(extremes) == 0.0:
        outside &= ~((steps == 0.0) & np.isin(data.values[1:], extremes))
    if np.mean(steps[outside] == 0.0) > _MAX_REPEATS:
        return False  # A coarse sensor, or one without noise, repeats its values at rest.
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


DETECTORS: Detectors = {"signal": (_detect,)}
