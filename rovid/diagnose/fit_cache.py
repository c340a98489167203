"""What was worked out of models of the same readings, so that it need not be again."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.diagnose.bic import ITERATIONS, climbed_on, fitted_together, is_at_end, quickly_climbed
from rovid.diagnose.score_test import Promise
from rovid.effects import Effect
from rovid.estimate.fit_result import Fitted
from rovid.estimate.objective import Key, Misfit


@dataclass(eq=False)
class Known:
    """What was worked out of models of the same readings, beside which the same forms are tried.

    Parameters
    ----------
    promises, extensions
        By the key of a model, what each further form promises there, and the model with each that was fitted.
    replacements
        By the keys of a model and of one with an effect less, the latter with what may do what that effect does.
    fits
        Every model that was fitted, by its key.
    """

    promises: dict[Key, list[Promise]] = field(default_factory=dict)
    extensions: dict[Key, list[Fitted]] = field(default_factory=dict)
    replacements: dict[tuple[Key, Key], list[Fitted]] = field(default_factory=dict)
    fits: dict[Key, Fitted] = field(default_factory=dict)
    _ends_of: dict[Fitted, Fitted] = field(default_factory=dict)

    def ended(self, fit: Fitted) -> Fitted:
        """``fit`` to the end, once: one that had no chance beside what may not be taken up was not followed so far."""
        if fit not in self._ends_of:
            ended = climbed_on(fit, ITERATIONS)
            self._ends_of[fit] = self._ends_of[ended] = ended
        return self._ends_of[fit]

    def ends_beside(self, current: Fitted) -> dict[str, Fitted]:
        """Models with one effect more that were followed to their end, by the key of that effect."""
        limit, here = current.key
        ends: dict[str, Fitted] = {}
        for (allowed, keys), fit in self.fits.items():
            if allowed == limit and here < keys and len(keys) == len(here) + 1 and is_at_end(fit):
                (last,) = (effect for effect in fit.effects if effect.key not in here)
                ends[last.key] = fit.ending_with(last)
        return ends

    def without(self, current: Fitted, *dropped: Effect) -> Fitted:
        """``current`` without some of its effects, all else fitted again."""
        if not dropped:
            return current
        effects, x = current.without(*dropped)
        self.fit(current.misfit, [(effects, x)])
        key = current.misfit.like(effects).key
        # One that was not followed to its end would make the effects look as if they gained more.
        self.fits[key] = ended = self.ended(self.fits[key])
        return ended

    def fit(self, misfit: Misfit, models: Sequence[tuple[tuple[Effect, ...], FloatArray]]) -> None:
        """Those of the ``models`` that are not known, by their effects and (p,) where to climb from, all at once."""
        pairs = [(misfit.like(effects), x) for effects, x in models]
        left = [pair for pair in pairs if pair[0].key not in self.fits]
        for fit in fitted_together([one for one, _ in left], lambda at: quickly_climbed(*left[at], ITERATIONS)):
            self.fits[fit.key] = self._restored(fit)

    def _restored(self, fitted: Fitted) -> Fitted:
        """``fitted``, or if a model with one effect less was fitted better, that with the effect put in anew."""
        for effect in fitted.effects:
            effects, _ = fitted.without(effect)
            less = self.fits.get(fitted.misfit.like(effects).key)
            if less is not None and less.cost < fitted.cost:
                misfit = fitted.misfit.like((*effects, effect))
                return climbed_from_best(misfit, less.x, misfit.coordinates.starts())
        return fitted


def climbed_from_best(misfit: Misfit, x: FloatArray, starts: Sequence[FloatArray]) -> Fitted:
    """``x`` with that one of ``starts`` for the last effect that is best as it stands, fitted from there."""
    begins = [np.concatenate((x, start)) for start in starts]
    (best,) = misfit.likeliest(begins, 1)
    return quickly_climbed(misfit, best, ITERATIONS)
