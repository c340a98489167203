"""A selected model with everything that its validation needs: data, search, cross-validation, probabilities."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Self

from rovid.core.array_types import FloatArray
from rovid.diagnose.candidate_fits import Alternative, Cause, bic_score, fit_in_parallel
from rovid.diagnose.cross_validation import (
    CvPiece,
    Fold,
    HeldOutScores,
    cross_validate,
    held_out_log_likelihood,
    horizon_squares,
    simulate_folds,
    simulated_rates,
)
from rovid.diagnose.evidence import outlier_probability, posterior_probability, probability_not_a_stand_in
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
    data: FitData  # all data, of whole logs; the search may use fewer, or parts of the logs
    base: FitResult  # without effects
    model: FitResult  # as selected
    pieces: Sequence[CvPiece]  # of the runs, for cross-validation
    multi_step: bool = False  # objective: likelihood of multi-step predictions, else of innovations
    wave_test: Callable[[FitResult], WaveTest] | None = None  # next to a multi-step model
    waves: WaveTest | None = None  # last result of the test
    inconsistent: tuple[Effect, ...] = ()  # dropped because one-step predictions show less of them
    messages: tuple[str, ...] = ()  # on effects that are not claimed
    is_beaten: bool = False  # whether a formula predicts better than the causes that were found
    dropped: FitResult | None = None  # model with effects that show only together, and are not established

    @property
    def is_adequate(self) -> bool:
        """Whether the model leaves white innovations and a disturbance within its limit."""
        return self.model.is_white and not self.model.at_limit

    @property
    def is_complete(self) -> bool:
        """Whether the search came to its end."""
        return not self.search.progress.stops & {SearchStop.CUT_SHORT, SearchStop.OUT_OF_TIME}

    @property
    def max_suspect_probability(self) -> float:
        """Largest probability of a suspect: only what passes every test is established.

        If a formula predicts better, or there was no time to fit each promising cause, no suspect is likely.
        """
        left_out = self.search.budget.not_tried
        if self.is_beaten or any(candidate.id in left_out for candidate in self.search.candidates):
            return math.nextafter(THRESHOLDS.likely, 0.0)
        return THRESHOLDS.max_suspect_probability

    @property
    def is_out_of_time(self) -> bool:
        """Whether something was left out at the end of the budget."""
        return bool(self.search.budget.not_tried)

    def ban(self, *effects: Effect) -> Self:
        """The selection with a search that never selects ``effects`` again."""
        return replace(self, search=self.search.ban(*effects))

    def reinstate(self, fitted: FitResult) -> Self:
        """The selection with the model ``fitted``, none of whose effects counts as dropped or banned any more."""
        ids = {effect.id for effect in fitted.effects}
        search = replace(self.search, banned=self.search.banned - ids)
        inconsistent = tuple(effect for effect in self.inconsistent if effect.id not in ids)
        return replace(self, search=search, model=fitted, inconsistent=inconsistent)

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

    def held_out_scores(self, fitted: FitResult) -> HeldOutScores:
        """Scores of a model by simulations of trials that were not fitted, computed once."""
        known = self.search.cache.held_out
        if fitted.key not in known:
            known[fitted.key] = simulate_folds(fitted, self.folds(fitted))
        return known[fitted.key]

    def horizon_squares(self, fitted: FitResult) -> FloatArray:
        """(p, q) mean square position errors of a model on trials that were not fitted, computed once."""
        known = self.search.cache.horizons
        if fitted.key not in known:
            known[fitted.key] = horizon_squares(fitted, self.folds(fitted), self.pieces)
        return known[fitted.key]

    def rates(self, fitted: FitResult) -> list[FloatArray]:
        """(m,) free-running rate of each piece by a model, computed once."""
        known = self.search.cache.rates
        if fitted not in known:
            known[fitted] = simulated_rates(fitted, self.pieces)
        return known[fitted]

    def held_out_gain(self, effect: Effect) -> float:
        """Log-likelihood gain of ``effect`` on trials that were not fitted, in nats."""
        without = self.search.without(self.model, effect)
        return held_out_log_likelihood(self.folds(self.model)) - held_out_log_likelihood(self.folds(without))

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

    def indistinguishable(self, cause: Cause) -> tuple[Effect, ...]:
        """Named alternatives of ``cause`` within the tie margin, and the causes of other sets that are as close."""
        margin, model = THRESHOLDS.tie(cause.bic_gain), self.model
        close = [one.effect for one in cause.alternatives if abs(one.bic_gain - cause.bic_gain) < margin]
        own = {effect.id for effect in model.effects}
        others = [
            {effect.id: effect for effect in fitted.effects}
            for fitted in self.search.cache.challengers.get(model.key, [])
            if abs(bic_score(fitted) - self.search.required_score(model, fitted)) < margin
        ]
        others = [causes for causes in others if cause.effect.id not in causes]
        for causes in others:
            added, missing = causes.keys() - own, own - causes.keys()
            # Sets that differ by one effect are among the alternatives, compared on all data. What a set has more than
            # another one that is as close takes no cause's place.
            if len(added) + len(missing) > 2 and not any(fewer.keys() < causes.keys() for fewer in others):
                close += [effect for name, effect in causes.items() if name in added]
        return tuple({effect.id: effect for effect in close if not is_signal(effect)}.values())

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
        cap = self.stand_in_cap(cause.effect, cause.gain, held_out_gain, allowance)
        probability = posterior_probability(gains, equivalent, self.search.causes_tried, cap=cap)
        return probability if white else min(probability, outlier_probability(self.model, cause.effect))

    def stand_in_cap(self, effect: Effect, gain: float, held_out_gain: float, allowance: float) -> float:
        """Largest probability of ``effect`` with a log-likelihood ``gain``; see `probability_not_a_stand_in`.

        The posterior probability counts the BIC penalty. A gain that compares with the held-out gain is that expected
        on other trials: less one nat for each parameter (Akaike 1974), and less the gain by chance of several forms.
        """
        expected = gain - len(effect.parameters) - self._chance_gain(effect)
        return probability_not_a_stand_in(held_out_gain - allowance, expected - allowance, white=self.model.is_white)

    def _chance_gain(self, effect: Effect) -> float:
        """Gain in nats by chance of the best of the forms of ``effect``."""
        return math.log(max(sum(candidate.id == effect.id for candidate in self.search.candidates), 1))

    def chance_corrected_gain(self, one: Cause | Alternative) -> float:
        """BIC gain less the gain by chance of the best of several forms.

        With coloured innovations that is part of the recalibration, which used campaigns without this correction.
        """
        if not self.model.is_white:
            return one.bic_gain
        return one.bic_gain - self._chance_gain(one.effect)
