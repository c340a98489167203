"""What an instrument shows of the position: the true one, or what effects on the heading make of it."""

from __future__ import annotations

import math
from collections.abc import Hashable
from dataclasses import dataclass

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.effects.base import OnHeading
from rovid.model.bound_effects import BoundEffect, actions_at, effects_at

# Into how many arcs the way round is cut: between their ends the largest deviation there is is known to 1e-8 rad.
_ROUND, _ARCS = 2.0 * math.pi, 512
_NUDGE = 1e-4  # rad


@dataclass(frozen=True, eq=False)
class HeadingSensor:
    """That by which a model's positions are measured, with those of its effects that act there."""

    acting: tuple[BoundEffect, ...]

    @property
    def deviates(self) -> bool:
        """Whether the measured heading is not the true one."""
        return any(isinstance(one.effect.acts, OnHeading) for one in self.acting)

    @property
    def cache_key(self) -> tuple[Hashable, ...]:
        """What tells how the heading deviates: the effects on it, with their parameters."""
        return tuple((one.effect, *one.parameters.tolist()) for one, _ in effects_at(self.acting, OnHeading))

    def deviation(self, heading: FloatArray) -> FloatArray:
        """(n,) rad by which the instrument's heading is off at the (n,) true headings in rad."""
        off = np.zeros(len(heading))
        for act, values in actions_at(self.acting, OnHeading):
            off += act.deviation(heading, values)
        return off

    def to_true(self, position: FloatArray) -> tuple[FloatArray, FloatArray]:
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
        # What is shown all round, and between by cubics that have its slope too (Hermite's).
        true = np.linspace(0.0, _ROUND, _ARCS + 1)
        shown, gain = self.to_measured(true, np.ones(_ARCS + 1))
        within = shown[0] + np.mod(position - shown[0], _ROUND)
        place = np.interp(within, shown, np.arange(_ARCS + 1.0))
        arc = np.minimum(np.nan_to_num(place).astype(int), _ARCS - 1)
        wide, rise = np.diff(shown), _ROUND / _ARCS
        begins, ends = wide / gain[:-1], wide / gain[1:]
        a, b, c = (each[arc] for each in (begins, 3.0 * rise - 2.0 * begins - ends, begins + ends - 2.0 * rise))
        u = place - arc
        turned = true[arc] + u * (a + u * (b + u * c))
        return position + (turned - within), wide[arc] / (a + u * (2.0 * b + 3.0 * u * c))

    def to_measured(self, heading: FloatArray, rate: FloatArray) -> tuple[FloatArray, FloatArray]:
        """(n,) heading and rate as the instrument would give the true ones."""
        ahead, behind = (self.deviation(heading + side) for side in (_NUDGE, -_NUDGE))
        return heading + self.deviation(heading), rate * (1.0 + (ahead - behind) / (2.0 * _NUDGE))
