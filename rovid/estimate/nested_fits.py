"""Fits of a model with further effects, which never end below the model without them.

A fit ends at the optimum next to its start. So a larger model is fitted from several starts: each smaller model at its
optimum with the missing effect at its initial values, and the best smaller model with the missing effect at its neutral
value. There both models are equal. The optimiser never takes a step upwards, so the larger model cannot end lower.

A lag of the thrust and the vehicle's own time constant act in series. With linear drag they are one second-order
system, and change places without a change of the motion: I/D <-> T. Both orders are tried.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import combinations

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.effects import Effect
from rovid.effects.thruster_lag import EFFECT as THRUSTER_LAG
from rovid.estimate.fit_result import FitResult, fit
from rovid.estimate.multi_step_data import time_constant
from rovid.estimate.objective import NegativeLogLikelihood
from rovid.estimate.parametrization import INERTIA

# Starts that are fitted coarsely, and steps of a coarse fit.
_STARTS, _COARSE_ITERATIONS = 8, 4
# Coarse fits that are continued to convergence.
_CONTINUED = 2
# Smaller models of one size from which larger ones are fitted: all of up to three effects.
_KEPT = 3
# Least ratio of the lag to the vehicle's time constant at an exchange of the two, for a lag of zero.
_LEAST_RATIO = 0.05
# Nats by which equal models may differ, since the filter takes other steps.
_SAME = 0.1


def scaled_start(effect: Effect, start: FloatArray, share: float) -> FloatArray:
    """(k,) ``start`` with ``share`` times the size of the effect, within its bounds; 0 is no effect."""
    scaled = start.copy()
    for k, size in enumerate(effect.parameters[: effect.size_count]):
        if not size.neutral_at_infinity:
            scaled[k] = np.clip(size.neutral + share * (start[k] - size.neutral), size.low, size.high)
        elif share == 0.0:
            scaled[k] = size.neutral
    return scaled


def neutral_start(objective: NegativeLogLikelihood, nested: FitResult) -> FloatArray:
    """(p,) coordinates of the ``nested`` model next to the last effect of ``objective`` at its neutral value.

    The other parameters of the effect have initial values, or their neutral ones where the effect would act with these.
    """
    effect, start = objective.effects[-1], objective.parametrization.initial_values()[0]
    low, high = (bound[-len(start) :] for bound in objective.parametrization.bounds)
    without = np.clip([parameter.neutral for parameter in effect.parameters], low, high)
    begins = [np.concatenate((nested.x, one)) for one in (scaled_start(effect, start, 0.0), without)]
    first, second = objective.values(begins)
    return begins[0] if first <= second + _SAME else begins[1]


def fit_with_effects(base: FitResult, effects: Sequence[Effect]) -> FitResult:
    """The best fit of ``base`` with all ``effects``, no less likely than a fit with fewer of them."""
    fits: dict[tuple[Effect, ...], FitResult] = {(): base}
    for count in range(1, len(effects) + 1):
        larger = {some: _extended(base, some, fits) for some in combinations(effects, count)}
        kept = sorted(larger, key=lambda some: larger[some].value)[:_KEPT]
        fits = {some: larger[some] for some in kept}
    return fits[tuple(effects)]


def _extended(base: FitResult, effects: tuple[Effect, ...], fits: dict[tuple[Effect, ...], FitResult]) -> FitResult:
    """The best fit of ``base`` with ``effects``, from the ``fits`` with one of them less."""
    objective = base.objective.with_effects(effects, base.objective.mask)
    smaller = [(fits[rest], effect) for rest, effect in _one_less(effects) if rest in fits]
    begins = list[FloatArray]()
    neutral = list[tuple[float, FloatArray]]()
    for nested, effect in smaller:
        larger = base.objective.with_effects((*nested.effects, effect), base.objective.mask)
        starts = larger.parametrization.initial_values()
        begins += [_in_order(larger, np.concatenate((nested.x, start)), effects) for start in starts]
        neutral.append((nested.value, _in_order(larger, neutral_start(larger, nested), effects)))
    chosen = [*objective.most_likely(begins, _STARTS), min(neutral, key=lambda pair: pair[0])[1]]
    coarse = sorted((fit(objective, x, iterations=_COARSE_ITERATIONS) for x in chosen), key=lambda one: one.value)
    return exchanged_or_same(min((fit(objective, one.x) for one in coarse[:_CONTINUED]), key=lambda one: one.value))


def _one_less(effects: tuple[Effect, ...]) -> Iterator[tuple[tuple[Effect, ...], Effect]]:
    """Each subset of ``effects`` with one less, and the effect that it lacks."""
    for effect in effects:
        yield tuple(other for other in effects if other is not effect), effect


def _in_order(objective: NegativeLogLikelihood, x: FloatArray, effects: Sequence[Effect]) -> FloatArray:
    """(p,) the coordinates ``x`` of ``objective`` for its effects in another order."""
    places = dict(objective.parametrization.effect_slices())
    common = x[: objective.parametrization.effects_begin]
    return np.concatenate((common, *(x[places[effect]] for effect in effects)))


def exchanged_or_same(fitted: FitResult) -> FitResult:
    """The better of a fit and of the fit from its exchanged time constants."""
    exchanged = with_exchanged_time_constants(fitted)
    if exchanged is None:
        return fitted
    return min(fitted, fit(fitted.objective, exchanged), key=lambda one: one.value)


def with_exchanged_time_constants(fitted: FitResult) -> FloatArray | None:
    """(p,) coordinates with the lag of the thrust and the vehicle's time constant exchanged; None without a lag.

    The drag, and so the steady motion, stays the same.
    """
    parametrization, x = fitted.objective.parametrization, fitted.x.copy()
    for at, effect, parameter in parametrization.effect_parameters():
        if effect.id == THRUSTER_LAG.id and parameter.name == "time_constant":
            own = time_constant(fitted.model, fitted.data.rms_rate)
            ratio = max(float(x[at]) / own, _LEAST_RATIO)
            x[at], x[INERTIA] = own, x[INERTIA] + math.log(ratio)
            return np.asarray(np.clip(x, *parametrization.bounds))
    return None
