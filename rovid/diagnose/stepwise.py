"""Stepwise selection of effects by BIC: forward selection by score tests and fits, elimination, and exchange."""

import enum
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations
from typing import Self

from rovid.core.budget import Budget
from rovid.diagnose.candidate_fits import (
    Alternative,
    Cause,
    FitCache,
    bic_score,
    fit_candidates,
    fit_from_best_start,
    fit_in_parallel,
    is_plausible,
    model_words,
    simplest_form,
)
from rovid.diagnose.screening import ScoreTest, best_forms, group_by_cause, possible_substitutes, score_tests, shortlist
from rovid.diagnose.signal_regressors import is_signal
from rovid.diagnose.thresholds import THRESHOLDS
from rovid.effects import Effect
from rovid.estimate.fit_result import FitResult
from rovid.estimate.maximum_likelihood import loosen_limit
from rovid.estimate.objective import ModelKey

# Gain of the best form of each further effect, largest first; computed on demand.
Gains = Callable[[], Sequence[float]]
# Whether a search cannot succeed from a model with these further gains.
StopRule = Callable[[FitResult, Gains], bool]


class SearchStop(enum.Enum):
    """Why a search ended before its model no longer changed."""

    ADEQUATE = enum.auto()  # `StepwiseSearch.is_adequate`; of the last run alone
    HOPELESS = enum.auto()  # `StepwiseSearch.is_hopeless`
    CUT_SHORT = enum.auto()  # `THRESHOLDS.max_screenings`, or `THRESHOLDS.max_effects` rounds without an end
    OUT_OF_TIME = enum.auto()  # `StepwiseSearch.budget`


@dataclass(eq=False)
class SearchProgress:
    """Models that a search has seen, and why it ended early."""

    exchanged: set[ModelKey] = field(default_factory=set)  # models that an exchange replaced
    screened: set[ModelKey] = field(default_factory=set)  # models with fitted extensions
    stops: set[SearchStop] = field(default_factory=set)


@dataclass(frozen=True, eq=False)
class StepwiseSearch:
    """Stepwise selection of effects among all forms of the ``candidates``."""

    candidates: Sequence[Effect]
    budget: Budget = field(default_factory=Budget)
    # Whether a model is adequate; then the search ends.
    is_adequate: Callable[[FitResult], bool] | None = None
    # Whether no further effects can make a model adequate; then the search is given up.
    is_hopeless: StopRule | None = None
    # Whether a model is so wrong that score tests mislead; then every cause is fitted, and pairs of causes.
    fits_poorly: Callable[[FitResult], bool] = field(default=lambda _: False)
    # BIC gain in nats that an addition needs, besides the logarithm of the number of causes.
    margin: float = THRESHOLDS.bic_margin
    # A form is fitted if its predicted gain is at least this share of the gain that an addition needs.
    screening_share: float = THRESHOLDS.screening_share
    cache: FitCache = field(default_factory=FitCache)
    # Ids of effects that validation has rejected.
    banned: frozenset[str] = frozenset()
    progress: SearchProgress = field(default_factory=SearchProgress)

    def ban(self, *effects: Effect) -> Self:
        """The same search, which selects no form of ``effects`` any more."""
        return replace(self, banned=self.banned.union(effect.id for effect in effects))

    def is_allowed(self, effect: Effect) -> bool:
        """Whether ``effect`` is not banned."""
        return effect.id not in self.banned

    @property
    def causes_tried(self) -> int:
        """Number of different effects among the candidates."""
        return len({effect.id for effect in self.candidates})

    @property
    def threshold(self) -> float:
        """BIC gain in nats that an addition needs; it grows with the number of causes (multiple testing)."""
        return self.margin + math.log(max(self.causes_tried, 1))

    def required_score(self, current: FitResult, other: FitResult) -> float:
        """BIC score that another set of causes needs to equal ``current``; each further cause costs the threshold."""
        return bic_score(current) + self.threshold * max(len(other.effects) - len(current.effects), 0)

    def is_worth_adding(self, better: FitResult, current: FitResult) -> bool:
        """Whether the BIC gain of one more effect exceeds the threshold and the misspecification allowance."""
        gain = bic_score(better) - bic_score(current)
        if gain < max(self.threshold, self.misspecification_allowance(current, white=True)):
            return False
        return gain >= self.misspecification_allowance(current, white=better.is_white)

    def misspecification_allowance(self, current: FitResult, *, white: bool) -> float:
        """Gain in nats that a further effect may owe to the approximate equations of the effects in ``current``.

        Waves do not count where the innovations are ``white``: as a kind of disturbance, their form is then right.
        """
        gain = bic_score(current) - bic_score(self.without_all(current, except_waves=white))
        if any(map(is_signal, current.effects)):
            # How the vehicle depends on a bare signal is known even less.
            return THRESHOLDS.misspecification_share_signal * gain
        cap = THRESHOLDS.misspecification_cap_white if white else THRESHOLDS.misspecification_cap
        return min(THRESHOLDS.misspecification_share * gain, cap)

    def run(self, base: FitResult) -> FitResult:
        """Exchange, add and eliminate effects from ``base`` on, until the model no longer changes."""
        self.cache.fits[base.key] = base
        stops = self.progress.stops
        stops.discard(SearchStop.ADEQUATE)
        current = self._eliminate(base)
        for _ in range(THRESHOLDS.max_effects):
            self._apply_stop_rules(current)
            changed = self._grow(self._exchange(current))
            if changed is current or stops - {SearchStop.CUT_SHORT}:
                return changed
            current = changed
        stops.add(SearchStop.CUT_SHORT)
        return current

    def _ends(self) -> bool:
        if len(self.progress.screened) >= THRESHOLDS.max_screenings:
            self.progress.stops.add(SearchStop.CUT_SHORT)
        self.is_out_of_time("more effects")
        return bool(self.progress.stops)

    def is_out_of_time(self, step: str) -> bool:
        """Whether the ``step`` is left out because the budget is used up."""
        if self.budget.skips(step):
            self.progress.stops.add(SearchStop.OUT_OF_TIME)
        return SearchStop.OUT_OF_TIME in self.progress.stops

    def _apply_stop_rules(self, current: FitResult) -> None:
        stops, is_adequate = self.progress.stops, self.is_adequate
        may_be_adequate = SearchStop.ADEQUATE not in stops and not self.fits_poorly(current)
        if is_adequate is not None and may_be_adequate and is_adequate(current):
            stops.add(SearchStop.ADEQUATE)
        if SearchStop.HOPELESS not in stops and self.is_given_up(current):
            stops.add(SearchStop.HOPELESS)

    def is_given_up(self, current: FitResult) -> bool:
        """Whether no further effects can make ``current`` adequate, by fits where score tests leave a doubt."""
        is_hopeless = self.is_hopeless
        if is_hopeless is None or not is_hopeless(current, lambda: self._gains(current)):
            return False
        if current.key in self.cache.extensions:
            return True
        if is_hopeless(current, lambda: [THRESHOLDS.score_test_factor * gain for gain in self._gains(current)]):
            return True
        return is_hopeless(current, lambda: self._fitted_gains(current))

    def _gains(self, current: FitResult) -> list[float]:
        """Gain of each further effect, largest first: of the fits where there are any, else of the score tests."""
        if current.key not in self.cache.extensions:
            return [forms[0].gain for forms in group_by_cause(self.screen(current))]
        return _largest_gains(current, self.cache.extensions[current.key])

    def _fitted_gains(self, current: FitResult) -> list[float]:
        """As `_gains`, by fits of the few causes with the largest predicted gains."""
        tests = self.screen(current)
        leading = [forms[0] for forms in group_by_cause(tests)[: THRESHOLDS.whitening_causes]]
        ahead, behind = fit_candidates(current, leading, self._may_lead, {}, tests)
        for fitted in ahead:
            self.cache.fits.setdefault(fitted.key, fitted)
        return _largest_gains(current, [*ahead, *behind])

    def _grow(self, current: FitResult) -> FitResult:
        """Add effects one by one, until none is worth adding or the disturbance gets a wider limit."""
        while len(current.effects) < THRESHOLDS.max_effects and not self._ends():
            better = self._best(self.extensions(current, growing=True), current)
            if better is not current:
                better = self.cache.converged(simplest_form(better, self._plausible_extensions(current), current))
            if not self.is_worth_adding(better, current):
                better = self._best_pair(current)
            if not self.is_worth_adding(better, current):
                break
            added = self._eliminate(better)
            if bic_score(added) <= bic_score(current):
                # The elimination removed more than the addition gained: the search would go round in a circle.
                break
            current = self._loosen(added)
            self._apply_stop_rules(current)
            if current is not added:
                break
        return current

    def _best_pair(self, current: FitResult) -> FitResult:
        """``current`` with the best two further effects, which may gain much together and little alone."""
        if not self.fits_poorly(current) or len(current.effects) + 2 > THRESHOLDS.max_effects:
            return current
        best: dict[str, FitResult] = {}
        for fitted in sorted(self._plausible_extensions(current), key=bic_score, reverse=True):
            best.setdefault(fitted.effects[-1].id, fitted)
        singles = list(best.values())[: THRESHOLDS.paired_causes]
        pairs = list(combinations(singles, 2))
        objectives = [one.objective.with_effects((*one.effects, other.effects[-1])) for one, other in pairs]

        def fit_pair(at: int) -> FitResult:
            one, other = pairs[at]
            starts = (other.effect_coordinates(other.effects[-1]), *objectives[at].parametrization.initial_values())
            return fit_from_best_start(objectives[at], one, starts, THRESHOLDS.search_iterations)

        fits = fit_in_parallel(objectives, fit_pair, self.budget, "Pairs of effects")
        for fitted in fits:
            self.cache.fits.setdefault(fitted.key, fitted)
        chosen = max(fits, key=bic_score, default=current)
        # There are more pairs than single effects (multiple testing).
        penalty = math.log(max(len(singles), 1))
        return chosen if bic_score(chosen) - penalty > bic_score(current) else current

    def _plausible_extensions(self, current: FitResult) -> list[FitResult]:
        return [one for one in self.extensions(current) if self.is_allowed(one.effects[-1]) and is_plausible(one)]

    def _loosen(self, current: FitResult) -> FitResult:
        """``current`` with the widest admissible limit of the disturbance, less the effects not needed then.

        The limit is tight while an effect is missing, and must widen afterwards: other effects would explain the rest.
        """
        loosened = loosen_limit(current)
        if loosened is current:
            return current
        self.cache.fits[loosened.key] = loosened
        needed = self._eliminate(loosened)
        return needed if needed.effects else current

    def _eliminate(self, current: FitResult) -> FitResult:
        """Remove effects that are no longer worth their place."""
        self.cache.fit_all(current.objective, list(map(current.without, current.effects)))
        for effect in current.effects:
            rest = self.without(current, effect)
            if not self.is_worth_adding(current, rest):
                return self._eliminate(rest)
        return current

    def _exchange(self, current: FitResult) -> FitResult:
        """Replace one effect or two by another form or another effect with a better BIC score."""
        if self._ends():
            return current
        for dropped in (*((effect,) for effect in current.effects), *combinations(current.effects, 2)):
            rest = self.without(current, *dropped)
            other = self._best(self._substitutes(current, dropped), rest)
            is_better = bic_score(other) > bic_score(current) + THRESHOLDS.exchange_gain
            if is_better and other.key not in self.progress.exchanged:
                self.progress.exchanged.add(current.key)
                return self._loosen(self._eliminate(other))
        return current

    def _substitutes(self, current: FitResult, dropped: Sequence[Effect]) -> list[FitResult]:
        """Fits with one form in the place of ``dropped`` effects; two effects may become another form of either."""
        rest = self.without(current, *dropped)
        if len(dropped) == 1:
            return self.replacements(current, dropped[0])
        if rest.key in self.cache.extensions:
            return self.extensions(rest)
        forms = [form for form in self.candidates if form.id in {effect.id for effect in dropped}]
        return self._fit_extensions(rest, score_tests(rest, forms))

    def _best(self, fits: Sequence[FitResult], default: FitResult) -> FitResult:
        """The best named effect, or a signal regressor that gains clearly more."""
        allowed = [fitted for fitted in fits if self.is_allowed(fitted.effects[-1])]
        signals = [fitted for fitted in allowed if is_signal(fitted.effects[-1])]
        chosen = max(filter(self._may_lead, allowed), key=bic_score, default=default)
        signal = max(signals, key=bic_score, default=default)
        gain = max(bic_score(chosen) - bic_score(default), 0.0)
        handicap = THRESHOLDS.signal_handicap + THRESHOLDS.signal_handicap_share * gain
        if bic_score(signal) > bic_score(chosen) + handicap:
            chosen = signal
        return chosen if chosen is default else self.cache.converged(chosen)

    def extensions(self, current: FitResult, *, growing: bool = False) -> list[FitResult]:
        """Fits of ``current`` with each shortlisted form as an addition."""
        self.progress.screened.add(current.key)
        if current.key not in self.cache.extensions:
            if self.is_out_of_time("other causes"):
                return []
            every = growing and self.fits_poorly(current)
            self.cache.extensions[current.key] = self._fit_extensions(current, self.screen(current), every=every)
        return self.cache.extensions[current.key]

    def replacements(self, current: FitResult, effect: Effect) -> list[FitResult]:
        """Fits of ``current`` with each form that may take the place of ``effect``, its own forms included."""
        rest = self.without(current, effect)
        small = THRESHOLDS.shortlist_share * (rest.value - current.value) < self.threshold
        if rest.key in self.cache.extensions or small:
            # A small gain may come from any form by chance.
            return self.extensions(rest)
        self.progress.screened.add(rest.key)
        keys = current.key, rest.key
        if keys not in self.cache.replacements:
            if self.is_out_of_time("other causes"):
                return []
            same = [form for form in self.candidates if form.id == effect.id]
            forms = [*same, *possible_substitutes(current, self.screen(current), effect)]
            self.cache.replacements[keys] = self._fit_extensions(rest, score_tests(rest, forms))
        return self.cache.replacements[keys]

    def _fit_extensions(
        self, current: FitResult, tests: Sequence[ScoreTest], *, every: bool = False
    ) -> list[FitResult]:
        """Fits with each shortlisted form, or with the best form of ``every`` effect."""
        known = self.cache.converged_extensions(current)
        if every:
            listed = best_forms(tests)
        else:
            leading = filter(self._may_lead, known.values())
            known_gain = max((current.value - fitted.value for fitted in leading), default=0.0)
            listed = shortlist(current, tests, self.threshold, self.screening_share, known_gain)
        ahead, behind = fit_candidates(current, listed, self._may_lead, known, tests, self.budget)
        for fitted in ahead:
            self.cache.fits.setdefault(fitted.key, fitted)
        return [*ahead, *behind]

    def _may_lead(self, fitted: FitResult) -> bool:
        """Whether a model may be selected as it is: its last effect has a name and is allowed and plausible."""
        effect = fitted.effects[-1]
        return self.is_allowed(effect) and is_plausible(fitted) and not is_signal(effect)

    def screen(self, current: FitResult) -> list[ScoreTest]:
        """Score test of each form of the effects that ``current`` lacks, computed once."""
        if current.key not in self.cache.score_tests:
            if self.is_out_of_time("score tests"):
                return []
            self.budget.report(f"Model with {model_words(current)}: score tests of {len(self.candidates)} forms …")
            selected = {effect.id for effect in current.effects}
            forms = [effect for effect in self.candidates if effect.id not in selected]
            self.cache.score_tests[current.key] = score_tests(current, forms)
        return self.cache.score_tests[current.key]

    def cause(self, current: FitResult, effect: Effect) -> Cause:
        """Gain of ``effect`` in ``current``, and the BIC gain of each other effect in its place."""
        rest = self.without(current, effect)
        kept = {other.key for other in rest.effects}
        challengers = [
            fitted.with_last(last)
            for fitted in self.cache.challengers.get(current.key, [])
            for last in fitted.effects
            if {other.key for other in fitted.effects if other is not last} == kept
        ]
        alternatives = self._rank(rest, [*challengers, *self.replacements(current, effect)], current)
        return Cause(effect, rest.value - current.value, bic_score(current) - bic_score(rest), alternatives)

    def further_causes(self, current: FitResult) -> tuple[Alternative, ...]:
        """BIC gain of each further effect in its best form, largest first."""
        return self._rank(current, self.extensions(current), current)

    def _rank(self, rest: FitResult, extensions: Sequence[FitResult], current: FitResult) -> tuple[Alternative, ...]:
        """The best of the ``extensions`` of ``rest`` by each effect that ``current`` lacks, best first."""
        selected = {effect.id for effect in current.effects}
        best: dict[str, Alternative] = {}
        for fitted in extensions:
            last, gain = fitted.effects[-1], bic_score(fitted) - bic_score(rest)
            if last.id in selected or not is_plausible(fitted):
                continue
            if last.id not in best or gain > best[last.id].bic_gain:
                best[last.id] = Alternative(last, gain, fitted)
        return tuple(sorted(best.values(), key=lambda one: -one.bic_gain))

    def without_all(self, current: FitResult, *, except_waves: bool = False) -> FitResult:
        """``current`` without effects, or with its waves alone."""
        return self.without(current, *(one for one in current.effects if not (one.is_wave and except_waves)))

    def without(self, current: FitResult, *dropped: Effect) -> FitResult:
        """``current`` without some effects, all other parameters refitted."""
        return self.cache.without(current, *dropped)


def _largest_gains(current: FitResult, fits: Sequence[FitResult]) -> list[float]:
    """Log-likelihood that the best form of each cause gains over ``current``, largest first."""
    best: dict[str, float] = {}
    for fitted in fits:
        cause = fitted.effects[-1].id
        best[cause] = max(best.get(cause, 0.0), current.value - fitted.value)
    return sorted(best.values(), reverse=True)
