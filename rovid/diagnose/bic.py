"""What a fitted model is worth, and the causes that it has or might have compared."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from rovid.core.array_types import FloatArray
from rovid.core.spmd import shared
from rovid.effects import Effect, EffectParameter
from rovid.estimate.fit_result import Fitted, climbed
from rovid.estimate.objective import Misfit

# Of log-likelihood: a search looks no closer. So many steps are taken for that at most.
_TOLERANCE = 0.1
ITERATIONS = 25
# Of so many readings no more than one fit is made at a time.
_MANY = 400_000
# Of what is gained so much may be no more than how nature's form of it differs from the equation's.
REMAINDER = 0.04


@dataclass(frozen=True, eq=False)
class Rival:
    """Another cause in the place of one that was found, and what it is worth there; see `worth`."""

    effect: Effect
    worth: float
    fitted: Fitted


@dataclass(frozen=True, eq=False)
class Cause:
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
    """Log-likelihood less the price of the effects' parameters."""
    return cost_of(fitted.cost, fitted.misfit)


def cost_of(worth: float, misfit: Misfit) -> float:
    """Cost at which a model is worth so much, see `worth`."""
    return -worth - price_of_one(misfit) * len(misfit.coordinates.parameters)


def price_of_one(misfit: Misfit) -> float:
    """Of a parameter, in log-likelihood: half the logarithm of the samples (Schwarz 1978)."""
    # Logs too short for any prediction count none.
    return 0.5 * math.log(max(misfit.count, 1.0))


def plainest(better: Fitted, others: Sequence[Fitted], current: Fitted) -> Fitted:
    """That of ``others`` which adds to ``current`` the plainest form of the same cause and gains nearly as much.

    What ``better`` gains beyond that may be of a cause that is still missing; where none is, it is taken as it is.
    """
    if better.is_white:
        return better
    nearly = worth(better) - REMAINDER * (worth(better) - worth(current))
    alike = [fit for fit in others if fit.effects[-1].id == better.effects[-1].id and worth(fit) >= nearly]
    return min(alike, key=lambda fit: (len(fit.effects[-1].parameters), -worth(fit)), default=better)


def quickly_climbed(misfit: Misfit, x: FloatArray, iterations: int, goal: float = math.inf) -> Fitted:
    """The model that so many steps from ``x`` lead to, fewer if the ``goal`` is out of reach; enough for a search."""
    return climbed(misfit, x, iterations=iterations, tolerance=_TOLERANCE, goal=goal)


def is_at_end(fitted: Fitted) -> bool:
    """Whether there is nothing more to be gained that a search would look at."""
    return fitted.left <= _TOLERANCE


def climbed_on(fitted: Fitted, iterations: int, goal: float = math.inf) -> Fitted:
    """``fitted`` after so many steps more, if there is anything to be gained, as long as the ``goal`` is in reach."""
    if is_at_end(fitted) or fitted.left < fitted.cost - goal:
        return fitted
    return quickly_climbed(fitted.misfit, fitted.x, iterations, goal)


def fitted_together(misfits: Sequence[Misfit], fit: Callable[[int], Fitted]) -> list[Fitted]:
    """What ``fit`` makes of each of ``misfits``, told by its place; shared with all that go in step."""

    def numbers(at: int) -> tuple[FloatArray, float, float]:
        fitted = fit(at)
        return fitted.x, fitted.cost, fitted.left

    # Whoever shares them is done about as soon as the others where what takes longest comes first.
    order = sorted(range(len(misfits)), key=lambda at: _length(misfits[at]), reverse=True)
    # Each fit holds innovations at two points, and beside them: where these are many, threads share the passes of one.
    few = all(len(misfit.records.trial) < _MANY for misfit in misfits)
    found = dict(zip(order, shared(numbers, order, among_threads=few), strict=True))
    return [Fitted(misfit, *found[at]) for at, misfit in enumerate(misfits)]


def _length(misfit: Misfit) -> tuple[bool, int]:
    """The more the longer a fit takes: what swings by itself takes two states more, and each parameter slopes."""
    return any(effect.oscillates for effect in misfit.effects), len(misfit.coordinates.parameters)


def is_plausible(fitted: Fitted) -> bool:
    """Whether the last effect is of a size that there is, none of its parameters at the edge, nor the inertia."""
    effect = fitted.effects[-1]
    values = fitted.own(effect).tolist()
    if any(map(_at_edge, values, effect.parameters)) or _is_no_cycle(fitted, effect):
        return False
    return fitted.is_physical


def _is_no_cycle(fitted: Fitted, effect: Effect) -> bool:
    """Whether ``effect`` swings as slowly as runs show at all, which any drift does."""
    if not effect.oscillates:
        return False
    at = [parameter.name for parameter in effect.parameters].index("frequency")
    slowest = fitted.misfit.coordinates.low[-len(effect.parameters) :][at]
    return bool(fitted.own(effect)[at] <= slowest)


def is_beyond(fitted: Fitted, effect: Effect) -> bool:
    """Whether ``effect`` would be larger than there is: its size is at the edge."""
    return _at_edge(float(fitted.own(effect)[0]), effect.parameters[0])


def _at_edge(value: float, parameter: EffectParameter) -> bool:
    """Whether ``value`` is as far from nothing as there is; where a bound is nothing itself it is no edge."""
    above = value >= parameter.high and parameter.high != parameter.null
    below = value <= parameter.low and parameter.low != parameter.null
    return above or below
