"""Programmes of demand for yaw torque, as shares of full demand at the instants of the commands."""

from __future__ import annotations

import math

import numpy as np

from tools.wide.motion import Floats

KINDS = ("holds", "steps", "sine", "random", "zigzag", "coast")


def demand(rng: np.random.Generator, kind: str, time: Floats, scale: float, one_way: bool) -> Floats:
    """Demand (m,) at ``time`` (m,) in s; the first level begins at time 0, before it the demand is 0.

    Parameters
    ----------
    scale
        Time in s in which the vehicle, its drives and the water answer.
    one_way
        Whether all levels have the same sign.
    """
    largest = float(rng.uniform(0.75, 1.0))
    end = float(time[-1])
    if kind == "sine":
        wave = np.zeros(time.size)
        begin = 0.0
        while begin < end:
            period = scale * math.exp(rng.uniform(math.log(4.0), math.log(25.0)))
            stretch = period * int(rng.integers(2, 5))
            size = largest * rng.uniform(0.4, 1.0)
            part = (time >= begin) & (time < begin + stretch)
            wave[part] = size * np.sin(2.0 * np.pi * (time[part] - begin) / period)
            begin += stretch
        return np.abs(wave) if one_way else wave
    sign = float(rng.choice([-1.0, 1.0]))
    levels, begins, begin = [], [], 0.0
    number = 0
    while begin < end:
        begins.append(begin)
        size = largest * float(rng.uniform(0.2, 1.0))
        if kind == "holds":
            rests = number % 2 == 1
            levels.append(0.0 if rests else sign * size)
            sign = -sign if rests and not one_way else sign
            begin += scale * float(rng.uniform(3.0, 7.0))
        elif kind == "coast":
            rests = number % 2 == 1
            levels.append(0.0 if rests else sign * largest)
            sign = -sign if rests and not one_way else sign
            begin += scale * float(rng.uniform(4.0, 9.0))
        elif kind == "steps":
            levels.append(sign * size if one_way else size * float(rng.choice([-1.0, 1.0])))
            begin += scale * float(rng.uniform(2.0, 4.0))
        else:
            levels.append(size if one_way else largest * float(rng.uniform(-1.0, 1.0)))
            begin += scale * math.exp(rng.uniform(math.log(0.4), math.log(3.0)))
        number += 1
    if levels[0] == 0.0 or abs(levels[0]) < 0.2:
        levels[0] = 0.5 * largest * (1.0 if levels[0] >= 0.0 else -1.0)
    place = np.searchsorted(begins, time + 1e-9, side="right") - 1
    result: Floats = np.where(place >= 0, np.array(levels)[np.maximum(place, 0)], 0.0)
    return result
