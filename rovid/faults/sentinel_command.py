"""Values that mean "no command": 0 us or 65535 of a pulse width while disarmed, NaN of a PX4 motor.

Such a value lies far outside the thrust curve, and no other command lies between it and the curve. Held to the end of
the curve, it would pass for full thrust.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from rovid.core.array_types import BoolArray
from rovid.faults.base import CommandData, Detection, FaultKind
from rovid.trial.fault import Fault
from rovid.trial.vehicle import FAR_OUTSIDE, ThrustCurve

# Values that autopilots and bridges write for "no pulse": zero, minus one, the ends of 16-bit integers.
_NO_PULSE = (0.0, -1.0, 65535.0, 32767.0, -32768.0)
# PX4 topic whose message definition says of NaN: "disarmed (stop the motors)".
_NAN_STOPS = "actuator_motors"


def _detect(data: CommandData) -> Iterator[Detection[CommandData]]:
    curve = data.thruster.curve if data.thruster else None
    if curve is None:
        return
    marked = _no_pulse(data, curve)
    if not marked.any():
        return
    at = max(0.0, float(data.time[int(np.argmax(marked))] - data.measured[0]))
    neutral = curve.neutral
    found = ", ".join(f"{value:g}" for value in np.unique(data.values[marked]).tolist())
    low, high = curve.command[[0, -1]].tolist()
    count = int(np.count_nonzero(marked))
    text = (
        f"{data.log}: the command of {data.name} is {found} in {count} samples, first at {at:.2f} s. "
        f"The curve ends at {low:g} and {high:g}: the value means no command."
    )
    fault = Fault(
        fault="sentinel_command",
        logs=(data.log,),
        at=(at,),
        size=float(count),
        unit="samples",
        text=text,
        remedy="zero",
    )
    values = np.where(marked, neutral, data.values)
    yield Detection(
        fault=fault,
        done=f"It was taken as no thrust (command {neutral:g}).",
        repair=lambda data: replace(data, values=values),
    )


def _no_pulse(data: CommandData, curve: ThrustCurve) -> BoolArray:
    """(n,) whether the value means "no command"."""
    if _NAN_STOPS in data.source and np.isnan(data.values).any():
        return np.isnan(data.values)
    marked = np.zeros(len(data.values), dtype=bool)
    largest = np.abs(curve.command).max()
    for value in _NO_PULSE:
        # A value of the curve's own size may be full thrust, in the direction that a one-sided curve lacks.
        if curve.reach(np.array(value)) > FAR_OUTSIDE and not 0.5 * largest <= abs(value) <= 2.0 * largest:
            marked |= data.values == value
    others = data.values[~marked & np.isfinite(data.values)]
    # Commands of another unit than the curve pass through zero, too.
    is_alone = np.all(curve.reach(others) <= FAR_OUTSIDE)
    return marked if is_alone else np.zeros_like(marked)


FAULT = FaultKind(
    id="sentinel_command",
    title="Values that mean no command",
    stage="command",
    detect=_detect,
    false_alarms="none: commands of the curve's unit are not 1.5 half widths away from its middle.",
)
