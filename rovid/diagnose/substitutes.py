"""Which forms may do what an effect of a model does, by the slopes at that model alone."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rovid.diagnose.score_test import NuisanceProjection, ScoreTest, gain_together, gains_each, sized
from rovid.effects import Effect
from rovid.estimate.fit_result import FitResult

# Who shows less than this share of it by the slopes does not do it: these are good to a factor of a few.
_SHARE = 0.05


def possible_substitutes(current: FitResult, effect: Effect, promises: Sequence[ScoreTest]) -> list[Effect]:
    """Of the forms that ``promises`` tell of beside ``current``, those that may do what its ``effect`` does.

    That is taken away as far as slopes tell, and what each form would gain there is set beside what is lost.
    """
    if any(size.neutral_at_infinity for size in effect.parameters[: effect.size_count]) or not promises:
        # How far away nothing is cannot be told.
        return [one.effect for one in promises]
    place, own = dict(current.objective.parametrization.effect_slices())[effect], current.effect_coordinates(effect)
    held, moved = np.zeros(len(current.x), dtype=bool), np.zeros(len(current.x))
    held[place], moved[place] = True, sized(effect, own, 0.0) - own
    past = NuisanceProjection(promises[0].equations, held, moved)
    return [one.effect for one in promises if _gain(one, past) >= _SHARE * past.lost]


def _gain(promise: ScoreTest, past: NuisanceProjection) -> float:
    """What a form would gain; endless where no slopes tell."""
    tried, form = promise.directions, promise.effect
    if not len(tried.starts):
        return np.inf
    pull, information = past(tried)
    if form.size_count > 1:
        return gain_together(pull, information)
    gains, _ = gains_each(form, pull, information)
    return float(gains.max())
