"""Readings of every sensor of the coupled model at their own instants."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.readers.cleaning import DISTANCE, SPEED_KIND, TURNING, Kind, clean
from rovid.readers.time_base import TimedSeries
from rovid.trial.trial import Readings, Remark

# Signal -> limits of its readings. The heading is the position of the trial.
PLANAR_SIGNALS: Mapping[str, Kind] = {
    "yaw_rate": TURNING,
    "surge_velocity": SPEED_KIND,
    "sway_velocity": SPEED_KIND,
    "north": DISTANCE,
    "east": DISTANCE,
}


def planar_readings(
    series: Mapping[str, TimedSeries], time: FloatArray, *, wanted: bool
) -> tuple[dict[str, Readings], list[Remark]]:
    """Readings of each signal of the coupled model in ``series`` between the first and the last of (n,) ``time`` in s.

    Missing values, held repeats, spikes and frozen stretches are left out, the last three with a remark. A signal that
    never changes is left out. Nothing at all unless ``wanted``, by a configuration of the coupled model.
    """
    if not wanted:
        return {}, []
    begin, end = float(time[0]), float(time[-1])
    found, remarks = {}, list[Remark]()
    for name, kind in PLANAR_SIGNALS.items():
        logged = series.get(name)
        if logged is None or logged.known.size == 0:
            continue
        words = name.replace("_", " ")
        values, faults = clean(logged.known_time, logged.known, kind, words)
        measured = np.isfinite(values)
        if np.ptp(values[measured]) == 0.0:
            count = int(measured.sum())
            text = f"The {words} never changes; its {count} readings were left out."
            remarks.append(Remark(kind="frozen", count=count, text=text))
            continue
        remarks += faults
        readings = Readings(time=logged.known_time[measured], values=values[measured])
        found[name] = readings.between(begin, end)
    return found, remarks
