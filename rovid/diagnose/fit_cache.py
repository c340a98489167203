"""What was worked out of models of the same readings, so that it need not be again."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.diagnose.bic import ITERATIONS, fit_coarse, fit_in_parallel, is_converged, refine_fit
from rovid.diagnose.score_test import ScoreTest
from rovid.effects import Effect
from rovid.estimate.fit_result import FitResult
from rovid.estimate.objective import Key, NegativeLogLikelihood


@dataclass(eq=False)
class FitCache:
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

    promises: dict[Key, list[ScoreTest]] = field(default_factory=dict)
    extensions: dict[Key, list[FitResult]] = field(default_factory=dict)
    replacements: dict[tuple[Key, Key], list[FitResult]] = field(default_factory=dict)
    fits: dict[Key, FitResult] = field(default_factory=dict)
    _ends_of: dict[FitResult, FitResult] = field(default_factory=dict)

    def converged(self, fit: FitResult) -> FitResult:
        """``fit`` to the end, once: one that had no chance beside what may not be taken up was not followed so far."""
        if fit not in self._ends_of:
            ended = refine_fit(fit, ITERATIONS)
            self._ends_of[fit] = self._ends_of[ended] = ended
        return self._ends_of[fit]

    def converged_extensions(self, current: FitResult) -> dict[str, FitResult]:
        """Models with one effect more that were followed to their end, by the key of that effect."""
        limit, here = current.key
        ends: dict[str, FitResult] = {}
        for (allowed, keys), fit in self.fits.items():
            if allowed == limit and here < keys and len(keys) == len(here) + 1 and is_converged(fit):
                (last,) = (effect for effect in fit.effects if effect.key not in here)
                ends[last.key] = fit.with_last(last)
        return ends

    def without(self, current: FitResult, *dropped: Effect) -> FitResult:
        """``current`` without some of its effects, all else fitted again."""
        if not dropped:
            return current
        effects, x = current.without(*dropped)
        self.fit(current.objective, [(effects, x)])
        key = current.objective.with_effects(effects).key
        # One that was not followed to its end would make the effects look as if they gained more.
        self.fits[key] = ended = self.converged(self.fits[key])
        return ended

    def fit(self, misfit: NegativeLogLikelihood, models: Sequence[tuple[tuple[Effect, ...], FloatArray]]) -> None:
        """Those of the ``models`` that are not known, by their effects and (p,) where to climb from, all at once."""
        pairs = [(misfit.with_effects(effects), x) for effects, x in models]
        left = [pair for pair in pairs if pair[0].key not in self.fits]
        for fit in fit_in_parallel([one for one, _ in left], lambda at: fit_coarse(*left[at], ITERATIONS)):
            self.fits[fit.key] = self._restored(fit)

    def _restored(self, fitted: FitResult) -> FitResult:
        """``fitted``, or if a model with one effect less was fitted better, that with the effect put in anew."""
        for effect in fitted.effects:
            effects, _ = fitted.without(effect)
            less = self.fits.get(fitted.objective.with_effects(effects).key)
            if less is not None and less.value < fitted.value:
                misfit = fitted.objective.with_effects((*effects, effect))
                return climbed_from_best(misfit, less.x, misfit.parametrization.initial_values())
        return fitted


def climbed_from_best(misfit: NegativeLogLikelihood, x: FloatArray, starts: Sequence[FloatArray]) -> FitResult:
    """``x`` with that one of ``starts`` for the last effect that is best as it stands, fitted from there."""
    begins = [np.concatenate((x, start)) for start in starts]
    (best,) = misfit.most_likely(begins, 1)
    return fit_coarse(misfit, best, ITERATIONS)
