"""Validation of a selected model: ties, tests of each effect, consistency of sizes, and posterior probabilities.

All functions take a `Selection` and return a new one; `rovid.diagnose.algorithm` calls them in order.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Self

import numpy as np

from rovid.diagnose.candidate_fits import Alternative, Cause, bic_score, fit_in_parallel, is_at_bound
from rovid.diagnose.cross_validation import (
    CvPiece,
    Fold,
    cross_validate,
    held_out_log_likelihood,
    horizon_errors,
)
from rovid.diagnose.posterior import (
    has_consistent_size,
    outlier_probability,
    posterior_probability,
    probability_not_a_stand_in,
    recalibrated,
    significance,
)
from rovid.diagnose.signal_regressors import is_signal
from rovid.diagnose.stepwise import SearchStop, StepwiseSearch
from rovid.diagnose.thresholds import THRESHOLDS
from rovid.diagnose.wave_test import WaveTest
from rovid.effects import Effect
from rovid.estimate.dataset import FitData
from rovid.estimate.fit_result import FitResult, fit


@dataclass(frozen=True, kw_only=True, eq=False)
class Selection:
    """State of the diagnosis: a selected model and everything needed to validate it."""

    search: StepwiseSearch  # with the effects banned so far and the cache of fits
    data: FitData  # all data; the search may use fewer
    base: FitResult  # without effects
    model: FitResult  # as selected
    pieces: Sequence[CvPiece]  # of the runs, for cross-validation
    multi_step: bool = False  # objective: likelihood of multi-step predictions, else of innovations
    wave_test: Callable[[FitResult], WaveTest] | None = None  # next to a multi-step model
    waves: WaveTest | None = None  # last result of the test
    inconsistent: tuple[Effect, ...] = ()  # dropped because one-step predictions show less of them
    messages: tuple[str, ...] = ()  # on effects that are not claimed

    @property
    def is_adequate(self) -> bool:
        """Whether the model leaves white innovations and a disturbance within its limit."""
        return self.model.is_white and not self.model.at_limit

    @property
    def is_complete(self) -> bool:
        """Whether the search came to its end."""
        return not self.search.progress.stops & {SearchStop.CUT_SHORT, SearchStop.OUT_OF_TIME}

    @property
    def is_out_of_time(self) -> bool:
        """Whether something was left out at the end of the budget."""
        return bool(self.search.budget.not_tried)

    def ban(self, *effects: Effect) -> Self:
        """The selection with a search that never selects ``effects`` again."""
        return replace(self, search=self.search.ban(*effects))

    def drop(self, effect: Effect) -> Self:
        """The selection without ``effect`` in the model, all other parameters refitted."""
        return replace(self, model=self.search.without(self.model, effect))

    def search_on(self) -> Self:
        """The selection with the model that the search reaches from the present one."""
        return replace(self, model=self.search.run(self.model))

    def with_message(self, message: str) -> Self:
        """The selection with a further message."""
        return replace(self, messages=(*self.messages, message))

    def folds(self, fitted: FitResult) -> list[Fold]:
        """Cross-validation of a model, computed once."""
        folds = self.search.cache.folds
        if fitted.key not in folds:
            folds[fitted.key] = cross_validate(fitted, self.pieces)
        return folds[fitted.key]

    def held_out_gain(self, effect: Effect) -> float:
        """Log-likelihood gain of ``effect`` on trials that were not fitted, in nats."""
        without = self.search.without(self.model, effect)
        return held_out_log_likelihood(self.folds(self.model)) - held_out_log_likelihood(self.folds(without))

    def held_out_growth(self, effect: Effect) -> float:
        """Relative growth by ``effect`` of the RMS position error on held-out trials; the least of all horizons."""
        models = [self.model, self.search.without(self.model, effect)]
        own, without = [horizon_errors(one, self.folds(one), self.pieces) for one in models]
        known = np.isfinite(own) & np.isfinite(without) & (without > 0.0)
        return float(np.min(own[known] / without[known])) - 1.0 if known.any() else 0.0

    def fit_full_data(self, models: Sequence[FitResult]) -> None:
        """Fit ``models`` to all data in parallel, unless the cache has them."""
        known = self.search.cache.full_data
        left = [fitted for fitted in models if fitted.key not in known]
        objectives = [replace(fitted.objective, data=self.data, mask=None) for fitted in left]
        tolerance = THRESHOLDS.full_data_tolerance
        fits = fit_in_parallel(objectives, lambda at: fit(objectives[at], left[at].x, tolerance=tolerance))
        known.update((fitted.key, full) for fitted, full in zip(left, fits, strict=True))

    def full_data(self, fitted: FitResult) -> FitResult:
        """The model of ``fitted``, fitted to all data once."""
        self.fit_full_data((fitted,))
        return self.search.cache.full_data[fitted.key]

    def cause(self, effect: Effect) -> Cause:
        """Gain of ``effect``, with close alternatives compared on all data."""
        cause = self.search.cause(self.model, effect)
        least = THRESHOLDS.tie_full_data_share * cause.bic_gain
        count = THRESHOLDS.tie_full_data_alternatives
        close = [one for one in cause.alternatives[:count] if one.bic_gain > least and not is_signal(one.effect)]
        if not close or self.model.data is self.data:
            return cause
        # The base model is needed later, and keeps a further core busy.
        self.fit_full_data((self.model, *(one.fitted for one in close), self.base))
        score = bic_score(self.full_data(self.model))
        alternatives = []
        for one in cause.alternatives:
            gain = one.bic_gain
            if one in close:
                gain = cause.bic_gain + bic_score(self.full_data(one.fitted)) - score
            alternatives.append(replace(one, bic_gain=gain))
        return replace(cause, alternatives=tuple(sorted(alternatives, key=lambda one: -one.bic_gain)))

    def tie_margin(self, bic_gain: float) -> float:
        """Difference of BIC gain in nats from which a cause with ``bic_gain`` is distinguishable from another."""
        if self.model.is_white:
            return THRESHOLDS.tie_margin
        # Part of any gain belongs to the form of the equation.
        return THRESHOLDS.tie_margin + min(THRESHOLDS.tie_share * bic_gain, THRESHOLDS.tie_cap)

    def indistinguishable(self, cause: Cause) -> tuple[Effect, ...]:
        """Named alternatives of ``cause`` within the tie margin."""
        margin = self.tie_margin(cause.bic_gain)
        close = [one.effect for one in cause.alternatives if abs(one.bic_gain - cause.bic_gain) < margin]
        return tuple(effect for effect in close if not is_signal(effect))

    def probability(self, cause: Cause, held_out_gain: float) -> float:
        """Posterior probability that ``cause``, or an indistinguishable one, acts."""
        # A signal that follows the cause is no other cause.
        named = [one for one in cause.alternatives if not is_signal(one.effect)]
        gains = {one.effect.id: self.chance_corrected_gain(one) for one in named}
        gains[cause.effect.id] = own = self.chance_corrected_gain(cause)
        equivalent = [cause.effect.id, *[effect.id for effect in self.indistinguishable(cause)]]
        rest = self.search.without(self.model, cause.effect)
        white = self.model.is_white
        # The approximate equations of the other effects may account for part of the gain.
        allowance = self.search.misspecification_allowance(rest, white=white)
        excess = max(own - held_out_gain, 0.0) + allowance
        gains = {name: gain - excess for name, gain in gains.items()}
        cap = probability_not_a_stand_in(held_out_gain - allowance, own - allowance, white=white)
        probability = posterior_probability(gains, equivalent, self.search.causes_tried, cap=cap)
        return probability if white else min(probability, outlier_probability(self.model, cause.effect))

    def chance_corrected_gain(self, one: Cause | Alternative) -> float:
        """BIC gain less the gain by chance of the best of several forms.

        With coloured innovations that is part of the recalibration, which used campaigns without this correction.
        """
        if not self.model.is_white:
            return one.bic_gain
        forms = sum(candidate.id == one.effect.id for candidate in self.search.candidates)
        return one.bic_gain - math.log(max(forms, 1))


@dataclass(frozen=True, kw_only=True)
class Rejection:
    """An effect that fails validation, and the reason; a likely effect stays in the model until validation ends."""

    effect: Effect
    reason: str
    is_likely: bool = False


def resolve_ties(selection: Selection) -> Selection:
    """Replace effects by alternatives that gain more on all data; the search compares thinned data."""
    for _ in range(THRESHOLDS.max_tie_decisions):
        better = _better_alternative(selection)
        if better is None:
            break
        selection = replace(selection, model=better.fitted)
    return selection


def _better_alternative(selection: Selection) -> Alternative | None:
    for effect in selection.model.effects:
        cause = selection.cause(effect)
        for one in cause.alternatives:
            signal_for_name = is_signal(one.effect) and not is_signal(effect)
            if one.bic_gain > cause.bic_gain and not signal_for_name and selection.search.is_allowed(one.effect):
                return one
    return None


def first_rejection(selection: Selection, passed: Collection[str] = ()) -> Rejection | None:
    """The first effect of the model that fails a test, except those with keys in ``passed``; None where all pass."""
    for effect in selection.model.effects:
        if effect.key not in passed and (rejection := _test(selection, effect)) is not None:
            return rejection
    return None


def _test(selection: Selection, effect: Effect) -> Rejection | None:
    """Tests of held-out gain, bound, significance, posterior probability, and of the fit to all data."""
    gain, size = selection.held_out_gain(effect), significance(selection.model, effect)
    least = THRESHOLDS.min_standard_errors
    if selection.multi_step:
        least = THRESHOLDS.min_standard_errors_multi_step
    if gain <= THRESHOLDS.min_held_out_gain:
        reason = f"fits these trials but predicts held-out trials worse (log-likelihood {gain:.1f})"
        return Rejection(effect=effect, reason=reason)
    if is_at_bound(selection.model, effect):
        return Rejection(effect=effect, reason="would be larger than is physically plausible")
    if size < least:
        return Rejection(effect=effect, reason=f"differs from zero by only {size:.1f} standard errors")
    probability = selection.probability(selection.cause(effect), gain)
    if probability < THRESHOLDS.likely:
        return Rejection(effect=effect, reason="is possible, but not established")
    if reason := _fault_on_full_data(selection, effect, least):
        return Rejection(effect=effect, reason=reason)
    likely = Rejection(effect=effect, reason="is likely, but not established", is_likely=True)
    return likely if probability < THRESHOLDS.established or selection.is_out_of_time else None


def _fault_on_full_data(selection: Selection, effect: Effect, least: float) -> str:
    """Why ``effect`` is nothing by the fit to all data, or makes held-out errors grow; empty where neither holds.

    The search uses thinned data, and a gain there may vanish on all data.
    """
    full = selection.full_data(selection.model)
    size = significance(full, effect)
    if size < least:
        return f"differs from zero by only {size:.1f} standard errors on all data"
    if is_at_bound(full, effect):
        return "would be larger on all data than is physically plausible"
    growth = selection.held_out_growth(effect)
    if growth > THRESHOLDS.held_out_growth:
        return f"makes the position errors on held-out trials {100.0 * growth:.0f} % larger"
    return ""


def drop_likely(selection: Selection, likely: Collection[str]) -> Selection:
    """Drop the effects with keys in ``likely``, and then the effects that fail a test without them."""
    if not likely:
        return selection
    for effect in selection.model.effects:
        if effect.key in likely:
            selection = selection.drop(effect)
    while (rejection := first_rejection(selection)) is not None:
        message = f"{rejection.effect.title} shows only next to an effect that is not established: it is not claimed."
        selection = selection.with_message(message).drop(rejection.effect)
    return selection


def drop_inconsistent(selection: Selection) -> Selection:
    """Test for waves, and drop effects with a smaller size in one-step predictions; search again without them."""
    wave_test = selection.wave_test
    if wave_test is None:
        return selection
    for _ in range(THRESHOLDS.max_rejections):
        waves = wave_test(selection.model)
        selection, model = replace(selection, waves=waves), selection.model
        dropped = [effect for effect in model.effects if not has_consistent_size(model, waves.likelier, effect)]
        if not dropped:
            return selection
        for effect in dropped:
            selection = selection.drop(effect)
        selection = replace(selection, inconsistent=(*selection.inconsistent, *dropped))
        selection = selection.ban(*dropped).search_on()
    return replace(selection, model=selection.base, waves=wave_test(selection.base))


def report_remainder(selection: Selection) -> Selection:
    """Add a message on the next effect, where its gain is notable but may come from approximate equations."""
    following = selection.search.best_extension(selection.model)
    if following is None or bic_score(following) - bic_score(selection.model) < selection.search.threshold:
        return selection
    effect, gain = following.effects[-1], selection.model.value - following.value
    if any(effect is one for one in selection.inconsistent):
        return selection
    if selection.search.is_worth_adding(following, selection.model):
        why = "The gain is large enough for a cause, but the search ended before it was added."
    else:
        why = "The gain is small and may only reflect that the equations of the other effects are approximate."
    return selection.with_message(f"{effect.title} would gain a log-likelihood of {gain:.0f}. {why} It is not claimed.")


@dataclass(frozen=True, eq=False)
class Suspected:
    """A cause that is likely or possible next to the selected model, and the ``others`` indistinguishable from it."""

    alternative: Alternative
    probability: float
    held_out_gain: float
    others: tuple[Alternative, ...]


def suspects(selection: Selection) -> list[Suspected]:
    """Likely or possible causes next to the selected model, the most probable first.

    The first suspect stands for all causes indistinguishable from it. Each other suspect stands for itself.
    """
    model, search, white = selection.model, selection.search, selection.model.is_white
    excluded = {effect.id for effect in selection.inconsistent}
    further = search.further_causes(model)
    if selection.waves is not None:
        excluded.update(selection.waves.imitated)
    left = [one for one in further if not is_signal(one.effect)]
    left = [one for one in left if one.bic_gain > 0.0 and one.effect.id not in excluded]
    allowance = search.misspecification_allowance(model, white=white)

    def posterior(equivalent: Collection[Alternative], excess: float = 0.0, cap: float = 1.0) -> float:
        gains = {one.effect.id: selection.chance_corrected_gain(one) - allowance - excess for one in left}
        return posterior_probability(gains, [one.effect.id for one in equivalent], search.causes_tried, cap=cap)

    # The test of a size takes a fit: only causes that are otherwise possible are tested.
    @cache
    def has_size(one: Alternative) -> bool:
        if significance(one.fitted, one.effect) < THRESHOLDS.min_standard_errors_suspect:
            return False
        return selection.waves is None or has_consistent_size(one.fitted, selection.waves.likelier, one.effect)

    found: list[Suspected] = []
    for one in left.copy():
        least = max(one.bic_gain - THRESHOLDS.suspect_margin, 0.0)
        near = [] if found else [other for other in left if other is not one and other.bic_gain > least]
        if recalibrated(posterior([one, *near]), white=white) < THRESHOLDS.possible:
            break
        if not has_size(one):
            left.remove(one)
            continue
        others = [other for other in near if has_size(other)]
        gain = held_out_log_likelihood(selection.folds(one.fitted)) - held_out_log_likelihood(selection.folds(model))
        own = selection.chance_corrected_gain(one)
        cap = probability_not_a_stand_in(gain - allowance, own - allowance, white=white)
        probability = posterior([one, *others], max(own - gain, 0.0), cap)
        if not white:
            probability = min(probability, outlier_probability(one.fitted, one.effect))
        # Only what passes every test is established.
        stated = min(recalibrated(probability, white=white), THRESHOLDS.max_suspect_probability)
        if stated >= THRESHOLDS.possible:
            found.append(Suspected(one, stated, gain, tuple(others)))
    return sorted(found, key=lambda one: -one.probability)
