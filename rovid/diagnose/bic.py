"""What a fitted model is worth, and the causes that it has or might have compared."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from rovid.core.array_types import FloatArray
from rovid.core.spmd import parallel_map
from rovid.effects import Effect, EffectParameter
from rovid.estimate.fit_result import FitResult, fit
from rovid.estimate.objective import NegativeLogLikelihood

# Of log-likelihood: a search looks no closer. So many steps are taken for that at most.
_TOLERANCE = 0.1
ITERATIONS = 25
# Of so many readings no more than one fit is made at a time.
_MANY = 400_000
# Of what is gained so much may be no more than how nature's form of it differs from the equation's.
REMAINDER = 0.04


@dataclass(frozen=True, eq=False)
class Alternative:
    """Another cause in the place of one that was found, and what it is worth there; see `worth`."""

    effect: Effect
    bic_gain: float
    fitted: FitResult


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
    bic_gain: float
    alternatives: tuple[Alternative, ...] = ()


def bic_score(fitted: FitResult) -> float:
    """Log-likelihood less the price of the effects' parameters."""
    return cost_at_score(fitted.value, fitted.objective)


def cost_at_score(worth: float, misfit: NegativeLogLikelihood) -> float:
    """Cost at which a model is worth so much, see `worth`."""
    return -worth - bic_penalty(misfit) * len(misfit.parametrization.parameters)


def bic_penalty(misfit: NegativeLogLikelihood) -> float:
    """Of a parameter, in log-likelihood: half the logarithm of the samples (Schwarz 1978)."""
    # Logs too short for any prediction count none.
    return 0.5 * math.log(max(misfit.effective_count, 1.0))


def simplest_form(better: FitResult, others: Sequence[FitResult], current: FitResult) -> FitResult:
    """That of ``others`` which adds to ``current`` the plainest form of the same cause and gains nearly as much.

    What ``better`` gains beyond that may be of a cause that is still missing; where none is, it is taken as it is.
    """
    if better.is_white:
        return better
    nearly = bic_score(better) - REMAINDER * (bic_score(better) - bic_score(current))
    alike = [fit for fit in others if fit.effects[-1].id == better.effects[-1].id and bic_score(fit) >= nearly]
    return min(alike, key=lambda fit: (len(fit.effects[-1].parameters), -bic_score(fit)), default=better)


def fit_coarse(misfit: NegativeLogLikelihood, x: FloatArray, iterations: int, goal: float = math.inf) -> FitResult:
    """The model that so many steps from ``x`` lead to, fewer if the ``goal`` is out of reach; enough for a search."""
    return fit(misfit, x, iterations=iterations, tolerance=_TOLERANCE, goal=goal)


def is_converged(fitted: FitResult) -> bool:
    """Whether there is nothing more to be gained that a search would look at."""
    return fitted.remaining_gain <= _TOLERANCE


def refine_fit(fitted: FitResult, iterations: int, goal: float = math.inf) -> FitResult:
    """``fitted`` after so many steps more, if there is anything to be gained, as long as the ``goal`` is in reach."""
    if is_converged(fitted) or fitted.remaining_gain < fitted.value - goal:
        return fitted
    return fit_coarse(fitted.objective, fitted.x, iterations, goal)


def fit_in_parallel(misfits: Sequence[NegativeLogLikelihood], fit: Callable[[int], FitResult]) -> list[FitResult]:
    """What ``fit`` makes of each of ``misfits``, told by its place; shared with all that go in step."""

    def numbers(at: int) -> tuple[FloatArray, float, float]:
        fitted = fit(at)
        return fitted.x, fitted.value, fitted.remaining_gain

    # Whoever shares them is done about as soon as the others where what takes longest comes first.
    order = sorted(range(len(misfits)), key=lambda at: _length(misfits[at]), reverse=True)
    # Each fit holds innovations at two points, and beside them: where these are many, threads share the passes of one.
    few = all(len(misfit.data.run_index) < _MANY for misfit in misfits)
    found = dict(zip(order, parallel_map(numbers, order, use_threads=few), strict=True))
    return [FitResult(misfit, *found[at]) for at, misfit in enumerate(misfits)]


def _length(misfit: NegativeLogLikelihood) -> tuple[bool, int]:
    """The more the longer a fit takes: what swings by itself takes two states more, and each parameter slopes."""
    return any(effect.oscillatory for effect in misfit.effects), len(misfit.parametrization.parameters)


def is_plausible(fitted: FitResult) -> bool:
    """Whether the last effect is of a size that there is, none of its parameters at the edge, nor the inertia."""
    effect = fitted.effects[-1]
    values = fitted.effect_coordinates(effect).tolist()
    if any(map(_at_edge, values, effect.parameters)) or _is_no_cycle(fitted, effect):
        return False
    return fitted.is_physical


def _is_no_cycle(fitted: FitResult, effect: Effect) -> bool:
    """Whether ``effect`` swings as slowly as runs show at all, which any drift does."""
    if not effect.oscillatory:
        return False
    at = [parameter.name for parameter in effect.parameters].index("frequency")
    slowest = fitted.objective.parametrization.low[-len(effect.parameters) :][at]
    return bool(fitted.effect_coordinates(effect)[at] <= slowest)


def is_at_bound(fitted: FitResult, effect: Effect) -> bool:
    """Whether ``effect`` would be larger than there is: its size is at the edge."""
    return _at_edge(float(fitted.effect_coordinates(effect)[0]), effect.parameters[0])


def _at_edge(value: float, parameter: EffectParameter) -> bool:
    """Whether ``value`` is as far from nothing as there is; where a bound is nothing itself it is no edge."""
    above = value >= parameter.high and parameter.high != parameter.neutral
    below = value <= parameter.low and parameter.low != parameter.neutral
    return above or below
