"""What drives a vehicle in a trial, with the effects between command and torque."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Self

import numpy as np

from rovid.effects.actuation import SPEEDS
from rovid.ground.arrays import FloatArray, IntArray

# Into how many the interval between two samples is cut for an effect that acts within it.
MOST_PARTS = 8


@dataclass(frozen=True, eq=False)
class Drive:
    """What drives one trial, from each instant to the next.

    Attributes
    ----------
    torque
        (n,) N m, its mean.
    moment
        (n,) N m s^2; integral of torque less mean times the time left. A torque that comes late in the interval gives
        the same rate at its end, but less angle, by ``moment / inertia``.
    beside
        (n, 3) what else the terms of effects are told: the thrusters' race in N^0.5 m^2, which is the sum over them of
        the root of their thrust times their arm squared, and the speeds `SPEEDS` in m/s. Zeros where no effect asks.
    scatter
        (n,) N^2 m^2 s^2; variance of the impulse, where an effect leaves open when a torque acts. Zeros elsewhere.
    """

    torque: FloatArray
    moment: FloatArray
    beside: FloatArray
    scatter: FloatArray

    @classmethod
    def held(cls, torque: FloatArray, beside: FloatArray | None = None, scatter: FloatArray | None = None) -> Self:
        """Of a torque that is held from each instant to the next."""
        nothing = np.zeros(len(torque))
        beside = np.zeros((len(torque), 1 + len(SPEEDS))) if beside is None else beside
        return cls(torque, nothing, beside, nothing if scatter is None else scatter)

    def mapped(self, function: Callable[[FloatArray], FloatArray]) -> Self:
        """With ``function`` of each series."""
        beside = np.column_stack([function(column) for column in self.beside.T])
        return type(self)(function(self.torque), function(self.moment), beside, function(self.scatter))

    def between(self, time: FloatArray, at: IntArray) -> Self:
        """From each of the instants ``time[at]`` to the next; ``time`` in s are those of the series."""
        length, ends = np.diff(time), time[at]
        middle = 0.5 * (time[1:] + time[:-1])

        def total(values: FloatArray) -> FloatArray:
            shape = (len(at) - 1, *values.shape[1:])
            return np.asarray(np.add.reduceat(values[: at[-1]], at[:-1])) if values.any() else np.zeros(shape)

        impulse = self.torque[:-1] * length
        area, beside = total(impulse), total(self.beside[:-1] * length[:, None])
        leverage = total(self.moment[:-1] - impulse * middle) + area * ends[1:]
        span = np.diff(ends)
        return type(self)(
            np.append(area / span, self.torque[at[-1]]),
            np.append(leverage - 0.5 * area * span, 0.0),
            np.vstack((beside / span[:, None], self.beside[at[-1]])),
            np.append(total(self.scatter[:-1]), 0.0),
        )
