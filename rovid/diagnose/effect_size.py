"""How large a cause is, and whether it is as large to each next reading as it is to predictions."""

from __future__ import annotations

import math

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.diagnose.bic import fit_coarse
from rovid.effects import Effect
from rovid.estimate.fit_result import FitResult

_ITERATIONS = 20
# What shrinks to less than this share, by more than so many standard errors, is no longer the same cause.
_SHRUNK, _APART = 0.7, 2.0


def effect_size(
    fitted: FitResult, effect: Effect, *, sandwich: bool, along: FloatArray | None = None
) -> tuple[float, float]:
    """How far the first parameter of ``effect`` is from nothing, and its standard error.

    Of several sizes together it is how far they are ``along`` a direction in them, their own if none is given; by
    chance as many are farther off than one.

    ``sandwich`` is whether that is to hold where the model is not right.
    """
    if effect.size_count > 1:
        away, scatter = effect_sizes(fitted, effect, sandwich=sandwich)
        along = unit_direction(away) if along is None else along
        return float(along @ away), math.sqrt(effect.size_count * max(float(along @ scatter @ along), 0.0))
    size = effect.parameters[0]
    names = fitted.model.names
    at = names.index(f"{effect.key}.{size.name}")
    variance = fitted.covariance(sandwich=sandwich)[at, at]
    # Where rounding leaves no variance that there can be nothing is known.
    error = math.sqrt(variance) if variance >= 0.0 else math.inf
    value = float(fitted.model.values[at])
    # The inverse of an endless null is the quantity that is nothing at nothing.
    if size.neutral_at_infinity:
        return 1.0 / value, error / value**2
    null = size.neutral * fitted.data.scales.unit_size(size)
    return value - null, error


def effect_sizes(fitted: FitResult, effect: Effect, *, sandwich: bool) -> tuple[FloatArray, FloatArray]:
    """(s,) how far each size of ``effect`` is from nothing, and their (s, s) covariance; see `size_of`."""
    sizes = effect.parameters[: effect.size_count]
    at = [fitted.model.names.index(f"{effect.key}.{size.name}") for size in sizes]
    away = fitted.model.values[at] - [size.neutral for size in sizes]
    return away, fitted.covariance(sandwich=sandwich)[np.ix_(at, at)]


def unit_direction(away: FloatArray) -> FloatArray:
    """(s,) of the length one; alike in all where there is nothing."""
    length = float(np.linalg.norm(away))
    return away / length if length > 0.0 else np.full(len(away), 1.0 / math.sqrt(len(away)))


def has_consistent_size(ahead: FitResult, near: FitResult, effect: Effect) -> bool:
    """Whether ``effect`` of ``ahead``, by predictions, is as large in ``near``, by each next reading beside waves.

    A cause that acts has one size. Under feedback a model may predict better some time ahead with what does not act:
    commands that answer waves go against what the waves do. The next reading is free of that (Ljung 1999, section 13.4)
    and finds less. It also finds less of what follows a logged signal, whose noise dilutes it: that is not judged.
    """
    if effect.needs:
        return True
    if effect not in near.effects:
        near = _extended(near, effect, ahead.effect_coordinates(effect))
    along = None
    if effect.size_count > 1:
        along = unit_direction(effect_sizes(ahead, effect, sandwich=True)[0])
    predicted, error = effect_size(ahead, effect, sandwich=True, along=along)
    here, other = effect_size(near, effect, sandwich=True, along=along)
    if effect.canonical is not None:
        # Turned by half a cycle a negative amplitude is a positive one.
        predicted, here = abs(predicted), abs(here)
    here = math.copysign(1.0, predicted) * here
    missing = abs(predicted) - here
    return here >= _SHRUNK * abs(predicted) or missing <= _APART * math.hypot(error, other)


def _extended(near: FitResult, effect: Effect, own: FloatArray) -> FitResult:
    """``near`` fitted with ``effect`` besides, from its ``own`` parameters on."""
    misfit = near.objective.with_effects((*near.effects, effect))
    begin = np.concatenate((near.x, own))
    return fit_coarse(misfit, begin, _ITERATIONS)
