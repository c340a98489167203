"""What an instrument shows of the position: the true one, or what effects on the heading make of it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rovid.effects.base import OnHeading
from rovid.ground.arrays import FloatArray
from rovid.model.acting import Acting, that_act

_FIXED_POINT_TURNS = 6
_NUDGE = 1e-4  # rad


@dataclass(frozen=True, eq=False)
class Instrument:
    """That by which a model's positions are measured, with those of its effects that act there."""

    acting: tuple[Acting, ...]

    @property
    def deviates(self) -> bool:
        """Whether the measured heading is not the true one."""
        return any(isinstance(one.effect.acts, OnHeading) for one in self.acting)

    def deviation(self, heading: FloatArray) -> FloatArray:
        """(n,) rad by which the instrument's heading is off at the (n,) true headings in rad."""
        off = np.zeros(len(heading))
        for act, values in that_act(self.acting, OnHeading):
            off += act.deviation(heading, values)
        return off

    def as_true(self, position: FloatArray) -> tuple[FloatArray, FloatArray]:
        """What a measured position is without the deviation of the heading.

        Parameters
        ----------
        position
            (n,) rad or m.

        Returns
        -------
        true, gain
            (n,) rad or m, and d(measured)/d(true).
        """
        if not self.deviates:
            return position, np.ones(len(position))
        true = position
        # Contracts by the deviation's slope, some percent, at each turn.
        for _ in range(_FIXED_POINT_TURNS):
            true = position - self.deviation(true)
        return true, self._gain(true)

    def as_measured(self, heading: FloatArray, rate: FloatArray) -> tuple[FloatArray, FloatArray]:
        """(n,) heading and rate as the instrument would give the true ones."""
        return heading + self.deviation(heading), rate * self._gain(heading)

    def _gain(self, heading: FloatArray) -> FloatArray:
        """(n,) change of the measured heading with the true one."""
        ahead, behind = (self.deviation(heading + side) for side in (_NUDGE, -_NUDGE))
        return np.asarray(1.0 + (ahead - behind) / (2.0 * _NUDGE))
