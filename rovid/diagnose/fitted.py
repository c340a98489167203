"""A model with some effects, fitted, and what it is worth; causes compared."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from rovid.effects import Effect, EffectParameter
from rovid.ground.arrays import FloatArray
from rovid.identify.innovations import Likelihood

_TOLERANCE = 0.1
# What tells one model from another: how much disturbance it is allowed, and its effects.
Key = tuple[float, frozenset[str]]


@dataclass(frozen=True, eq=False)
class Fitted:
    """A model with some effects, fitted.

    Attributes
    ----------
    cost
        Negative log-likelihood.
    """

    likelihood: Likelihood
    x: FloatArray
    cost: float

    @property
    def effects(self) -> tuple[Effect, ...]:
        """In the order in which their parameters stand in ``x``."""
        return self.likelihood.effects

    @property
    def key(self) -> Key:
        """What tells it from other models of the same records."""
        return key_of(self.likelihood)

    def own(self, effect: Effect) -> FloatArray:
        """Coordinates of ``effect``."""
        at = self.likelihood.base
        for other in self.effects:
            width = len(other.parameters)
            if other is effect:
                return self.x[at : at + width]
            at += width
        raise KeyError(effect.key)

    @property
    def plausible(self) -> bool:
        """Whether the last effect is of a size that there is, none of its parameters at the edge, nor the inertia."""
        effect = self.effects[-1]
        if not self.likelihood.is_physical(self.x):
            return False
        values = self.own(effect)
        return not any(map(_at_edge, values.tolist(), effect.parameters))

    def beyond(self, effect: Effect) -> bool:
        """Whether ``effect`` would be larger than there is: its size is at the edge."""
        return _at_edge(float(self.own(effect)[0]), effect.parameters[0])

    def without(self, effect: Effect) -> tuple[tuple[Effect, ...], FloatArray]:
        """The other effects, and the coordinates that are left."""
        rest = tuple(other for other in self.effects if other is not effect)
        shared = self.x[: self.likelihood.base]
        return rest, np.concatenate((shared, *map(self.own, rest)))


@dataclass(frozen=True, eq=False)
class Rival:
    """Another cause in the place of one that was found: its gain of log-likelihood, less the price of parameters."""

    effect: Effect
    gain: float
    fitted: Fitted


@dataclass(frozen=True, eq=False)
class Found:
    """One effect of the final model.

    Attributes
    ----------
    gain
        Log-likelihood that its removal would lose, all else fitted again.
    worth
        The same less the price of its parameters.
    rivals
        The best form of each other cause in its place, best first.
    """

    effect: Effect
    gain: float
    worth: float
    rivals: tuple[Rival, ...] = ()


def worth(fitted: Fitted) -> float:
    """Log-likelihood less the price of the effects' parameters: half the logarithm of the samples (Schwarz 1978)."""
    # Logs too short for any prediction count none.
    count = max(fitted.likelihood.count, 1.0)
    price = 0.5 * math.log(count) * len(fitted.likelihood.parameters)
    return -fitted.cost - price


def climbed(likelihood: Likelihood, x: FloatArray, iterations: int) -> Fitted:
    """The model that so many steps from ``x`` lead to, near enough for a search."""
    return Fitted(likelihood, *likelihood.climb(x, iterations=iterations, tolerance=_TOLERANCE))


def _at_edge(value: float, parameter: EffectParameter) -> bool:
    """Whether ``value`` is as far from nothing as there is; where a bound is nothing itself it is no edge."""
    above = value >= parameter.high and parameter.high != parameter.null
    below = value <= parameter.low and parameter.low != parameter.null
    return above or below


def key_of(likelihood: Likelihood) -> Key:
    """What tells ``likelihood`` from others of the same records."""
    return likelihood.limit, frozenset(effect.key for effect in likelihood.effects)
