"""What an instrument shows of the position: the true one, or what effects on the heading make of it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rovid.campaign.trial import Trial
from rovid.effects.base import OnHeading, Values
from rovid.ground.arrays import FloatArray, IntArray
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

    def true_angle(self, trial: Trial, angle: FloatArray, at: IntArray) -> tuple[FloatArray, FloatArray]:
        """What the (n,) ``angle`` in rad, measured at the instants ``at``, is without the deviation of the heading.

        Returns
        -------
        angle, gain
            (n,) rad and d(measured)/d(true).
        """
        gain = np.ones(len(angle))
        for act, values in that_act(self.acting, OnHeading):
            measured = trial.position[at]
            true = measured
            # Contracts by the deviation's slope, some percent, at each turn.
            for _ in range(_FIXED_POINT_TURNS):
                true = measured - act.deviation(true, values)
            angle = angle - (measured - true)
            gain = gain + _slope(act, true, values)
        return angle, gain

    def as_measured(self, heading: FloatArray, rate: FloatArray) -> tuple[FloatArray, FloatArray]:
        """(n,) heading and rate as the instrument would give the true ones."""
        gain = np.ones(len(heading))
        for act, values in that_act(self.acting, OnHeading):
            gain += _slope(act, heading, values)
        return heading + self.deviation(heading), rate * gain


def _slope(act: OnHeading, heading: FloatArray, values: Values) -> FloatArray:
    """(n,) change of the deviation with the true heading."""
    ahead, behind = (act.deviation(heading + side, values) for side in (_NUDGE, -_NUDGE))
    return np.asarray((ahead - behind) / (2.0 * _NUDGE))
