"""North and east in m from a latitude and a longitude."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from rovid.readers.time_base import TimedSeries
from rovid.trial.signal_names import EARTH_RADIUS

# WGS 84: semi-major axis, m, and squared eccentricity.
_SEMI_MAJOR, _ECCENTRICITY2 = 6_378_137.0, 6.694379990141e-3


def local_position(north: TimedSeries, east: TimedSeries) -> tuple[TimedSeries, TimedSeries]:
    """North and east, m, from the median fix, of a latitude and a longitude as arcs of `EARTH_RADIUS`, m.

    To first order on the ellipsoid WGS 84, by its radii of curvature in the meridian and in the prime vertical (Torge
    and Mueller 2012, section 4.1). At a distance d it errs by d^2 tan(latitude) / radius: 0.16 m at 1 km and 45 deg.
    """
    if not (north.known.size and east.known.size):
        return north, east
    latitude, longitude = float(np.median(north.known)) / EARTH_RADIUS, float(np.median(east.known)) / EARTH_RADIUS
    flattening = 1.0 - _ECCENTRICITY2 * math.sin(latitude) ** 2
    meridian = _SEMI_MAJOR * (1.0 - _ECCENTRICITY2) / flattening**1.5
    parallel = _SEMI_MAJOR / math.sqrt(flattening) * math.cos(latitude)
    turned = np.remainder(east.values / EARTH_RADIUS - longitude + math.pi, 2.0 * math.pi) - math.pi
    return (
        replace(north, values=meridian * (north.values / EARTH_RADIUS - latitude)),
        replace(east, values=parallel * turned),
    )
