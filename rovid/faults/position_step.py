"""A position that jumps between two readings and stays there: another set of satellites, or a new reference.

Steps of north and of east, or of the position along a linear axis such as a depth, are examined as those of a heading;
see `rovid.faults.heading_step`.
"""

import math
from collections.abc import Iterator
from operator import methodcaller

import numpy as np

from rovid.core.formatting import significant
from rovid.faults.base import Detection, Detectors, TrialData
from rovid.faults.heading_step import Steps, jump_size, jumps
from rovid.trial.fault import Fault

_SENSORS = ("north", "east")
# Readings that a log needs, and readings for each jump: more jumps are noise, or motion.
_FEWEST, _PER_JUMP = 16, 30
# Least size of a jump in the smallest change between two readings, their resolution, and in standard deviations of the
# difference of two readings. Departures are mostly zero, so their own scatter does not measure the noise.
_RESOLVED, _SIGMAS = 3.0, 8.0


def _detect(data: TrialData) -> Iterator[Detection[TrialData]]:
    trial, what = data.trial, "position"
    if all(name in trial.readings and len(trial.readings[name].time) >= _FEWEST for name in _SENSORS):
        every = [Steps.of_readings(trial, name) for name in _SENSORS]
    elif not (trial.axis.angular or trial.rate_only) and trial.measured.sum() >= _FEWEST:
        every, what = [Steps.of(trial)], trial.axis.position_words
    else:
        return
    found = dict[float, float]()
    for steps in every:
        changes = np.abs(np.diff(steps.angle))
        resolved = _RESOLVED * float(changes[changes > 0.0].min(initial=math.inf))
        own = jumps(steps, max(resolved, _SIGMAS * math.sqrt(2.0) * _noise(steps)))
        if len(own) <= len(steps.time) / _PER_JUMP:
            found |= {float(steps.time[at + 1]): float(steps.time[at + 1] - steps.time[at]) for at in own}
    last = -math.inf
    for at in sorted(found):
        if at - last <= 1.5 * found[at]:
            continue
        last, parts = at, []
        for steps in every:
            number = int(np.searchsorted(steps.time, at - 1e-9)) - 1
            parts.append(jump_size(steps, number, _noise(steps)))
        size, error = (math.hypot(*pair) for pair in zip(*parts, strict=True))
        yield Detection(
            fault=Fault(
                fault="position_step",
                logs=(trial.name,),
                at=(at,),
                size=size,
                standard_error=error / math.sqrt(len(every)),
                unit="m",
                text=f"{trial.name}: the {what} jumps and stays at {at:.2f} s, by {significant(size, 3)} m.",
                remedy="cut",
            ),
            done="The log was cut there.",
            repair=methodcaller("cut_at", at),
        )


def _noise(steps: Steps) -> float:
    """Standard deviation of the noise of a reading in m, by second differences, which have 6 times its variance."""
    return 1.4826 * float(np.median(np.abs(np.diff(steps.angle, 2)))) / math.sqrt(6.0)


DETECTORS: Detectors = {"trial": (_detect,)}
