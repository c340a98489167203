"""The measured heading as a function of the true one."""

from __future__ import annotations

import math
from collections.abc import Hashable
from dataclasses import dataclass

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.effects.base import OnHeading
from rovid.model.bound_effects import BoundEffect, actions_at, effects_at

# Arcs of the circle; interpolation between their ends has an error of 1e-8 rad for the largest deviation.
_TURN, _ARCS = 2.0 * math.pi, 512
_NUDGE = 1e-4  # rad, for a difference quotient


@dataclass(frozen=True, eq=False)
class HeadingSensor:
    """The sensor of a model's positions, with the effects of the model that act on the heading."""

    effects: tuple[BoundEffect, ...]

    @property
    def deviates(self) -> bool:
        """Whether the measured heading differs from the true one."""
        return any(isinstance(one.effect.acts, OnHeading) for one in self.effects)

    @property
    def cache_key(self) -> tuple[Hashable, ...]:
        """Effects on the heading, with their parameters."""
        return tuple((one.effect, *one.parameters.tolist()) for one, _ in effects_at(self.effects, OnHeading))

    def deviation(self, heading: FloatArray) -> FloatArray:
        """(n,) deviation of the measured heading in rad at the (n,) true headings in rad."""
        total = np.zeros(len(heading))
        for act, values in actions_at(self.effects, OnHeading):
            total += act.deviation(heading, values)
        return total

    def to_true(self, position: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The true position for a measured one.

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
        # The inverse function as a cubic Hermite spline over one turn.
        true = np.linspace(0.0, _TURN, _ARCS + 1)
        measured, gain = self.to_measured(true, np.ones(_ARCS + 1))
        within = measured[0] + np.mod(position - measured[0], _TURN)
        place = np.interp(within, measured, np.arange(_ARCS + 1.0))
        arc = np.minimum(np.nan_to_num(place).astype(int), _ARCS - 1)
        wide, rise = np.diff(measured), _TURN / _ARCS
        begins, ends = wide / gain[:-1], wide / gain[1:]
        a, b, c = (each[arc] for each in (begins, 3.0 * rise - 2.0 * begins - ends, begins + ends - 2.0 * rise))
        u = place - arc
        turned = true[arc] + u * (a + u * (b + u * c))
        return position + (turned - within), wide[arc] / (a + u * (2.0 * b + 3.0 * u * c))

    def to_measured(self, heading: FloatArray, rate: FloatArray) -> tuple[FloatArray, FloatArray]:
        """(n,) measured heading and rate for the true ones."""
        above, below = (self.deviation(heading + side) for side in (_NUDGE, -_NUDGE))
        return heading + self.deviation(heading), rate * (1.0 + (above - below) / (2.0 * _NUDGE))
