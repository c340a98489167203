"""The final challenge: the selected set of causes against other sets, in the same likelihood.

A stepwise search ends wrong where its first step is wrong: several causes then stand in for one. Before a cause is
established, the selected set has to beat other sets at the same price for each parameter:

- each cause alone, in every form;
- pairs of the best single causes;
- each proper subset of the set;
- the set with one member replaced by any form of any cause, a common size in place of one for each trial included;
- a fault of the logs in the place of a cause, where `rovid.diagnose.objectives.pose` makes it a candidate.

A linearisation at the selected model predicts what each form recovers of the log-likelihood that is lost without some
members. Forms that recover too little are dropped without a fit. The others are fitted from their starts, and a fit
ends where it cannot come within `THRESHOLDS.goal_distance` of the selected set.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import combinations, product

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.diagnose.candidate_fits import (
    Alternative,
    Challenger,
    bic_score,
    fit_coarse,
    fit_in_parallel,
    is_converged,
    is_plausible,
    refine_fit,
    value_at_score,
)
from rovid.diagnose.screening import possible_substitutes
from rovid.diagnose.selection import Selection
from rovid.diagnose.signal_regressors import is_signal
from rovid.diagnose.stepwise import StepwiseSearch
from rovid.diagnose.thresholds import THRESHOLDS
from rovid.effects import Effect
from rovid.effects.clock_offset import CLOCKS_APART
from rovid.effects.further_terms import trials_in_form
from rovid.estimate.fit_result import FitResult
from rovid.estimate.objective import ModelKey, NegativeLogLikelihood

# The starts of the fit of a set of causes.
_Starts = tuple[NegativeLogLikelihood, list[FloatArray]]


def challenge(selection: Selection) -> Selection:
    """The selection that no other set of causes beats.

    A better set takes the place of the selected one, the search goes on from there, and the challenge starts again.
    At last the closest alternatives of each effect are compared on all data.
    """
    for _ in range(THRESHOLDS.max_challenges):
        better = _better(selection, challenging_fits(selection.search, selection.model))
        if better is None:
            break
        selection.search.progress.exchanged.add(selection.model.key)
        selection = replace(selection, model=better).search_on()
    return resolve_ties(selection)


def resolve_ties(selection: Selection) -> Selection:
    """Replace effects by alternatives that gain more on all data; the search compares thinned data."""
    for _ in range(THRESHOLDS.max_tie_decisions):
        better = next(_better_alternatives(selection), None)
        if better is None:
            break
        selection = replace(selection, model=better.fitted)
    return selection


def _better_alternatives(selection: Selection) -> Iterator[Alternative]:
    for effect in selection.model.effects:
        cause = selection.cause(effect)
        for one in cause.alternatives:
            signal_for_name = is_signal(one.effect) and not is_signal(effect)
            if one.bic_gain > cause.bic_gain and not signal_for_name and selection.search.is_allowed(one.effect):
                yield one


def closest_challengers(selection: Selection) -> tuple[Challenger, ...]:
    """The challengers that came closest to the selected set, best first; one for each set of causes."""
    model, found = selection.model, dict[frozenset[str], Challenger]()
    for fitted in sorted(challenging_fits(selection.search, model), key=bic_score, reverse=True):
        # A set with an effect that failed a test challenges no more.
        causes, is_allowed = _causes(fitted), all(map(selection.search.is_allowed, fitted.effects))
        if is_allowed and causes != _causes(model) and len(found) < THRESHOLDS.challengers_shown:
            found.setdefault(causes, Challenger.of(fitted, model))
    return tuple(found.values())


def challenging_fits(search: StepwiseSearch, model: FitResult) -> list[FitResult]:
    """Fits of all sets that may come close to ``model``, computed once."""
    known = search.cache.challengers
    if model.key not in known:
        if not model.effects or search.is_out_of_time("challengers"):
            return []
        known[model.key] = _fit_challengers(search, model)
    return known[model.key]


def _fit_challengers(search: StepwiseSearch, model: FitResult) -> list[FitResult]:
    search.budget.report("Trying simpler and other explanations …")
    goal = bic_score(model) - THRESHOLDS.goal_distance
    for dropped in _removals(model):
        search.without(model, *dropped)
    _fit_sets(search, dict(_replacements(search, model)), goal)
    _fit_sets(search, dict(_pairs(search, model, goal)), goal)
    limit, own = model.key
    # Larger sets that contain the selected one have been judged by the search.
    every = [one for (other, keys), one in search.cache.fits.items() if other == limit and keys and not own <= keys]
    fits = fit_in_parallel([one.objective for one in every], lambda at: _refined(every[at], goal))
    search.cache.fits.update((fitted.key, fitted) for fitted in fits)
    return [one for one in fits if all(is_plausible(one.with_last(effect)) for effect in one.effects)]


def _removals(model: FitResult) -> Iterator[tuple[Effect, ...]]:
    """Each single effect, each further subset of up to `nested_model_causes` effects, and all effects together."""
    effects = model.effects
    for count in range(1, len(effects) + 1):
        if count in {1, len(effects)} or len(effects) <= THRESHOLDS.nested_model_causes:
            yield from combinations(effects, count)


def _replacements(search: StepwiseSearch, model: FitResult) -> Iterator[tuple[ModelKey, _Starts]]:
    """Sets in which one form takes the place of one member, or of all members, with the starts of their fits."""
    tests = search.screen(model)
    removals = dict.fromkeys([*[(effect,) for effect in model.effects], model.effects])
    for removed in removals:
        ids = {effect.id for effect in removed}
        same = [form for form in search.candidates if form.id in ids and form not in removed]
        faults = [form for form in search.candidates if form is CLOCKS_APART and form not in model.effects]
        kept, own = model.without(*removed)
        without = search.without(model, *removed)
        forms = possible_substitutes(model, tests, *removed, share=THRESHOLDS.challenger_share)
        if len(forms) > THRESHOLDS.challenging_forms and without.key in search.cache.score_tests:
            # A linearisation does not reach an infinite neutral value: the gains are those without the effects.
            gains = {test.effect: test.gain for test in search.cache.score_tests[without.key]}
            forms.sort(key=lambda form: -gains.get(form, 0.0))
        named = [form for form in forms if not is_signal(form)][: THRESHOLDS.challenging_forms]
        for form in dict.fromkeys([*same, *named, *faults]):
            objective = model.objective.with_effects((*kept, form))
            begins = product((own, without.x), objective.parametrization.initial_values())
            yield objective.key, (objective, list(map(np.concatenate, begins)))


def _pairs(search: StepwiseSearch, model: FitResult, goal: float) -> Iterator[tuple[ModelKey, _Starts]]:
    """Pairs of the best single causes with the starts of their fits, the largest sum of both gains first.

    Causes that resemble each other gain less together than the sum: only pairs with a sum that reaches ``goal`` count.
    """
    limit, own = model.key
    plain = bic_score(search.without(model, *model.effects))
    singles: dict[str, FitResult] = {}
    for fitted in sorted(search.cache.fits.values(), key=bic_score, reverse=True):
        if fitted.key[0] == limit and len(fitted.effects) == 1 and not is_signal(fitted.effects[0]):
            singles.setdefault(fitted.effects[0].id, fitted)
    best = [*singles.values()][: THRESHOLDS.challenging_causes]
    pairs = sorted(combinations(best, 2), key=lambda pair: -sum(map(bic_score, pair)))
    for pair in pairs[: THRESHOLDS.challenging_pairs]:
        (one,), (other,) = (fitted.effects for fitted in pair)
        if sum(map(bic_score, pair)) - plain < goal:
            break
        objective = model.objective.with_effects((one, other))
        sizes = np.concatenate((pair[0].effect_coordinates(one), pair[1].effect_coordinates(other)))
        commons = [fitted.common_coordinates for fitted in (*pair, model)]
        if not own <= objective.key[1]:
            yield objective.key, (objective, [np.concatenate((common, sizes)) for common in commons])


def _fit_sets(search: StepwiseSearch, sets: dict[ModelKey, _Starts], goal: float) -> None:
    """Fit each set from the most likely of its starts, as far as it may reach the score ``goal``."""
    cache = search.cache.fits
    left = [starts for key, starts in sets.items() if key not in cache or not is_converged(cache[key])]
    objectives = [objective for objective, _ in left]

    def fit_one(at: int) -> FitResult:
        objective, begins = left[at]
        (best,) = objective.most_likely(begins, 1)
        return _refined(fit_coarse(objective, best, THRESHOLDS.first_iterations, value_at_score(goal, objective)), goal)

    for fitted in fit_in_parallel(objectives, fit_one, search.budget, "Other explanations"):
        if fitted.key not in cache or fitted.value < cache[fitted.key].value:
            cache[fitted.key] = fitted


def _refined(fitted: FitResult, goal: float) -> FitResult:
    """``fitted`` continued to convergence, as far as it may reach the score ``goal``."""
    return refine_fit(fitted, THRESHOLDS.search_iterations, value_at_score(goal, fitted.objective))


def _better(selection: Selection, fits: Sequence[FitResult]) -> FitResult | None:
    """The best set that may take the place of the selected one; None where none is better."""
    model, search = selection.model, selection.search
    for fitted in sorted(fits, key=bic_score, reverse=True):
        least = search.required_score(model, fitted) + THRESHOLDS.exchange_gain
        if _has_sizes_by_trial(model) and not _has_sizes_by_trial(fitted):
            # Sizes that a common cause explains as well are no sizes of their own.
            least -= THRESHOLDS.tie(bic_score(model) - bic_score(search.without_all(model)))
        is_better = bic_score(fitted) >= least
        if len(fitted.effects) > len(model.effects):
            # Unless the innovations are white, more causes gain by what the equations of fewer causes approximate.
            is_better = is_better and fitted.is_white and search.is_worth_adding(fitted, model)
        allowed = all(map(search.is_allowed, fitted.effects)) and fitted.key not in search.progress.exchanged
        if is_better and allowed:
            return search.cache.converged(fitted)
    return None


def _has_sizes_by_trial(fitted: FitResult) -> bool:
    """Whether an effect has another size in each trial."""
    return any(len(trials_in_form(effect.form)) > 1 for effect in fitted.effects)


def _causes(fitted: FitResult) -> frozenset[str]:
    return frozenset(effect.id for effect in fitted.effects)
