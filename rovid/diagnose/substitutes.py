"""Which forms may do what an effect of a model does, by the slopes at that model alone."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rovid.diagnose.score_test import Past, Promise, gain_together, gains_each, sized
from rovid.effects import Effect
from rovid.estimate.fit_result import Fitted

# Who shows less than this share of it by the slopes does not do it: these are good to a factor of a few.
_SHARE = 0.05


def may_replace(current: Fitted, effect: Effect, promises: Sequence[Promise]) -> list[Effect]:
    """Of the forms that ``promises`` tell of beside ``current``, those that may do what its ``effect`` does.

    That is taken away as far as slopes tell, and what each form would gain there is set beside what is lost.
    """
    if any(size.endless for size in effect.parameters[: effect.sizes]) or not promises:
        # How far away nothing is cannot be told.
        return [one.effect for one in promises]
    place, own = dict(current.misfit.coordinates.places())[effect], current.own(effect)
    held, moved = np.zeros(len(current.x), dtype=bool), np.zeros(len(current.x))
    held[place], moved[place] = True, sized(effect, own, 0.0) - own
    past = Past(promises[0].own, held, moved)
    return [one.effect for one in promises if _gain(one, past) >= _SHARE * past.lost]


def _gain(promise: Promise, past: Past) -> float:
    """What a form would gain; endless where no slopes tell."""
    tried, form = promise.tried, promise.effect
    if not len(tried.starts):
        return np.inf
    pull, information = past(tried)
    if form.sizes > 1:
        return gain_together(pull, information)
    gains, _ = gains_each(form, pull, information)
    return float(gains.max())
