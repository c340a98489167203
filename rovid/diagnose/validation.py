"""Validation of a selected model: consistency of sizes, rejection rules, and suspects.

Most functions take a `Selection` and return a new one; `rovid.diagnose.algorithm` calls them in order.
`first_rejection` applies the rules that each effect of a selected model must pass. Each rule is a function of the
selection and the effect. It returns why the effect fails, or an empty text.
"""

import math
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field, replace
from functools import cache

import numpy as np

from rovid.diagnose.candidate_fits import (
    Alternative,
    FitCache,
    bic_score,
    has_parameter_at_bound,
    is_at_bound,
    is_plausible,
    why_implausible,
)
from rovid.diagnose.cross_validation import certain_growth, change_in_samples, held_out_log_likelihood
from rovid.diagnose.evidence import (
    has_consistent_size,
    is_held_by_friction,
    outlier_probability,
    posterior_probability,
    recalibrated,
    significance,
)
from rovid.diagnose.selection import Selection
from rovid.diagnose.signal_regressors import is_signal
from rovid.diagnose.stepwise import StepwiseSearch
from rovid.diagnose.thresholds import THRESHOLDS
from rovid.effects import Effect
from rovid.estimate.dataset import time_constant
from rovid.estimate.fit_result import FitResult


@dataclass(frozen=True, kw_only=True)
class Rejection:
    """An effect that fails validation, and the reason; a likely effect stays in the model until validation ends."""

    effect: Effect
    reason: str
    is_likely: bool = False


def first_rejection(selection: Selection, passed: Collection[str] = ()) -> Rejection | None:
    """The weakest effect of the model that fails a rule, except those with keys in ``passed``; None where all pass."""
    model, search = selection.model, selection.search
    # A weak effect may be what makes a strong one fail.
    for effect in sorted(model.effects, key=lambda one: -bic_score(search.without(model, one))):
        for rule in () if effect.key in passed else RULES:
            if reason := rule(selection, effect):
                return Rejection(effect=effect, reason=reason, is_likely=rule is likely)
    return None


def predicts_worse(selection: Selection, effect: Effect) -> str:
    """The effect does not raise the log-likelihood of held-out trials."""
    gain = selection.held_out_gain(effect)
    if gain > THRESHOLDS.min_held_out_gain:
        return ""
    return f"fits these trials but predicts held-out trials worse (log-likelihood {gain:.1f})"


def too_large(selection: Selection, effect: Effect) -> str:
    """The size is the largest value that its definition allows."""
    return "would be larger than is physically plausible" * is_at_bound(selection.model, effect)


def too_small(selection: Selection, effect: Effect) -> str:
    """The size is too few standard errors from its value without the effect."""
    return _too_small(selection, selection.model, effect)


def improbable(selection: Selection, effect: Effect) -> str:
    """The posterior probability is below `THRESHOLDS.likely`."""
    return "is possible, but not established" * (_probability(selection, effect) < THRESHOLDS.likely)


def outdone(selection: Selection, effect: Effect) -> str:
    """A cause that failed a test before gains more in the place of the effect, which then stands in for it.

    Within the margin of a tie the two are not distinguishable, and the result names both.
    """
    cause, search = selection.cause(effect), selection.search
    least = cause.bic_gain + THRESHOLDS.tie(cause.bic_gain)
    for one in cause.alternatives:
        if one.bic_gain >= least and not is_signal(one.effect) and not search.is_allowed(one.effect):
            return f"gains less than {one.effect.title}, which failed a test"
    return ""


def too_small_on_all_data(selection: Selection, effect: Effect) -> str:
    """As `too_small`, of the fit to all data: the search uses thinned data, and a gain there may vanish."""
    reason = _too_small(selection, selection.full_data(selection.model), effect)
    return f"{reason} on all data" if reason else ""


def at_bound_on_all_data(selection: Selection, effect: Effect) -> str:
    """A parameter of the fit to all data is at a bound other than its value without the effect."""
    full = selection.full_data(selection.model)
    if is_at_bound(full, effect):
        return "would be larger on all data than is physically plausible"
    return "has a parameter at the limit of its range" * has_parameter_at_bound(full, effect)


def simulates_worse(selection: Selection, effect: Effect) -> str:
    """The effect makes the errors of rate or of position larger on held-out trials.

    The pieces of the trials are compared in pairs: one piece that goes wrong has one vote.
    """
    models = selection.model, selection.search.without(selection.model, effect)
    positions = map(selection.horizon_squares, models)
    rates = (selection.held_out_scores(one).rate_squares[:, np.newaxis] for one in models)
    for name, (own, without) in {"position": positions, "rate": rates}.items():
        growth = certain_growth(own, without)
        if growth > THRESHOLDS.held_out_growth:
            return f"makes the {name} errors on held-out trials {100.0 * growth:.0f} % larger"
    return ""


def changes_time_constant(selection: Selection, effect: Effect) -> str:
    """The effect multiplies or divides the inertia, not the drag, and simulations of held-out trials do not improve.

    The time constants of a lag and of a vehicle with linear drag can change places: the commands have the same response
    (Ljung 1999, chapter 4). Then only the spectrum of the disturbance, which is an assumption, decides between them.
    Another thrust changes inertia and drag alike.
    """
    models = selection.model, selection.search.without(selection.model, effect)
    constants = [time_constant(one.model, selection.data.rms_rate) for one in models]
    factor = math.exp(abs(math.log(constants[0] / constants[1])))
    rates = (selection.held_out_scores(one).rate_squares[:, np.newaxis] for one in reversed(models))
    if factor < THRESHOLDS.changed_time_constant or certain_growth(*rates) > 0.0:
        return ""
    return f"changes the time constant by a factor of {factor:.2g}, and does not improve simulations of held-out trials"


def within_sampling(selection: Selection, effect: Effect) -> str:
    """The effect changes the simulated rate by less than a shift by a small part of the sampling interval would."""
    without = selection.search.without(selection.model, effect)
    change = change_in_samples(effect, selection.rates(selection.model), selection.rates(without))
    return "changes the simulation less than the sampling of the logs does" * (change < THRESHOLDS.sampling_share)


def raises_disturbance(selection: Selection, effect: Effect) -> str:
    """The effect leaves a larger disturbance than the model without it, by more than the estimate scatters.

    The variance of a Gauss-Markov process with the memory tau has T/(2 tau) independent values in T seconds. The
    relative standard error of its standard deviation is therefore sqrt(tau/T). A larger disturbance counts only with
    more power at low and at high frequencies: otherwise size and memory are badly determined.
    """
    seconds = sum(float(np.ptp(run.trial.time)) for run in selection.data.runs)
    without = selection.search.without(selection.model, effect)
    (size, memory), (size_without, memory_without) = selection.model.disturbance, without.disturbance
    error = math.sqrt(max(memory, memory_without) / seconds)
    growth = size / size_without - 1.0 if size_without > 0.0 else 0.0
    is_slower = size**2 * memory_without <= size_without**2 * memory
    is_faster = size**2 * memory <= size_without**2 * memory_without
    if growth <= THRESHOLDS.disturbance_growth * error or is_slower or is_faster:
        return ""
    return f"leaves a disturbance that is {100.0 * growth:.0f} % larger"


def held_by_friction(selection: Selection, effect: Effect) -> str:
    """The effect acts only where friction of the model holds the vehicle: friction that sticks looks the same."""
    text = "acts only at thrusts that friction holds, as friction does that sticks at rest"
    return text * is_held_by_friction(selection.model, effect)


def likely(selection: Selection, effect: Effect) -> str:
    """The posterior probability is below `THRESHOLDS.established`, or the budget ended before every test."""
    is_open = _probability(selection, effect) < THRESHOLDS.established or selection.is_out_of_time
    return "is not established" * is_open


# In the order of application: the quick rules first, then those that need a fit to all data, or simulations.
RULES: tuple[Callable[[Selection, Effect], str], ...] = (
    predicts_worse,
    too_large,
    too_small,
    improbable,
    outdone,
    raises_disturbance,
    too_small_on_all_data,
    at_bound_on_all_data,
    simulates_worse,
    changes_time_constant,
    within_sampling,
    held_by_friction,
    likely,
)


def _probability(selection: Selection, effect: Effect) -> float:
    return selection.probability(selection.cause(effect), selection.held_out_gain(effect))


def _too_small(selection: Selection, fitted: FitResult, effect: Effect) -> str:
    least = THRESHOLDS.min_standard_errors_multi_step if selection.multi_step else THRESHOLDS.min_standard_errors
    size = significance(fitted, effect)
    return f"differs from zero by only {size:.1f} standard errors" if size < least else ""


def drop_likely(selection: Selection, likely: Collection[str]) -> Selection:
    """Drop the effects with keys in ``likely``, and then the effects that fail a test without them."""
    if not likely:
        return selection
    together = selection.model
    for effect in together.effects:
        if effect.key in likely:
            selection = selection.drop(effect)
    while (rejection := first_rejection(selection)) is not None:
        message = f"{rejection.effect.title} shows only next to an effect that is not established: it is not claimed."
        selection = replace(selection.with_message(message).drop(rejection.effect), dropped=together)
    return selection


def drop_inconsistent(selection: Selection) -> Selection:
    """Test for waves, and drop effects with a smaller size in one-step predictions; search again without them.

    A dropped effect returns if it gains more than an effect of the last model, and its size is consistent there.
    """
    wave_test = selection.wave_test
    if wave_test is None:
        return selection
    returned: set[str] = set()
    for _ in range(THRESHOLDS.max_rejections):
        waves = wave_test(selection.model)
        selection, model = replace(selection, waves=waves), selection.model
        dropped = [effect for effect in model.effects if not has_consistent_size(model, waves.likelier, effect)]
        if dropped:
            for effect in dropped:
                selection = selection.drop(effect)
            selection = replace(selection, inconsistent=(*selection.inconsistent, *dropped))
            selection = selection.ban(*dropped).search_on()
            continue
        candidates = {effect.id for effect in selection.inconsistent} - returned
        better = _consistent_in_place(selection, waves.likelier, candidates)
        if better is None:
            return selection
        returned |= {effect.id for effect in better.effects}
        selection = selection.reinstate(better)
    return replace(selection, model=selection.base, waves=wave_test(selection.base))


def _consistent_in_place(selection: Selection, one_step: FitResult, dropped: Collection[str]) -> FitResult | None:
    """The model with a dropped effect that gains more in the place of another one, and has a consistent size there.

    A size is inconsistent next to the effects of that time, and one of these may have been a stand-in.
    """
    for effect in selection.model.effects if dropped else ():
        cause, beside = selection.cause(effect), FitCache().without(one_step, effect)
        for one in cause.alternatives:
            gains_more = one.effect.id in dropped and one.bic_gain > cause.bic_gain
            if gains_more and has_consistent_size(one.fitted, beside, one.effect):
                return one.fitted
    return None


def report_remainder(selection: Selection) -> Selection:
    """Add a message on the next effect, where its gain is notable but it is not claimed.

    It may come from approximate equations, or need a parameter at the limit of its range.
    """
    selection = _report_limited(selection)
    model, search = selection.model, selection.search
    following = max(filter(is_plausible, search.extensions(model)), key=bic_score, default=None)
    if following is None or bic_score(following) - bic_score(model) < search.threshold:
        return selection
    effect, gain = following.effects[-1], model.value - following.value
    if any(effect is one for one in selection.inconsistent):
        return selection
    if search.is_worth_adding(following, model):
        why = "The gain is large enough for a cause, but the search ended before it was added."
    else:
        why = "The gain is small and may only reflect that the equations of the other effects are approximate."
    return selection.with_message(f"{effect.title} would gain a log-likelihood of {gain:.0f}. {why} It is not claimed.")


def _report_limited(selection: Selection) -> Selection:
    """Add a message on an implausible effect that gains more than any other further effect."""
    model, search = selection.model, selection.search
    best, text = bic_score(model) + search.threshold, ""
    for fitted in sorted(search.extensions(model), key=bic_score):
        effect, gain = fitted.effects[-1], model.value - fitted.value
        if bic_score(fitted) <= best:
            continue
        if is_plausible(fitted):
            text = ""
        elif (why := why_implausible(fitted)) and search.is_allowed(effect) and not is_signal(effect):
            text = f"{effect.title} would gain a log-likelihood of {gain:.0f} with {why}."
    return selection.with_message(text) if text else selection


@dataclass(frozen=True, eq=False)
class Suspected:
    """A cause that is likely or possible next to the selected model, and the ``others`` indistinguishable from it."""

    alternative: Alternative
    probability: float
    held_out_gain: float
    others: tuple[Alternative, ...]
    #: Effect id -> message on a cause that gains more but fails a test of suspects.
    failed: Mapping[str, str] = field(default_factory=dict)


def _stands_in(one: Alternative, better: Alternative, search: StepwiseSearch) -> bool:
    """Whether most of the gain of ``one`` is lost next to a ``better`` cause that one-step predictions exclude."""
    objective = better.fitted.objective.with_effects((*better.fitted.effects, one.effect))
    start = np.concatenate((better.fitted.x, one.fitted.effect_coordinates(one.effect)))
    search.cache.fit_all(better.fitted.objective, [(objective.effects, start)])
    gain = bic_score(search.cache.fits[objective.key]) - bic_score(better.fitted)
    return gain < THRESHOLDS.stand_in_share * one.bic_gain


def _next_to_waves(selection: Selection) -> FitResult | None:
    """One-step fit of the wave test, without effects that the model has lost since; None without a test."""
    if selection.waves is None:
        return None
    fitted, kept = selection.waves.likelier, {effect.key for effect in selection.model.effects}
    lost = [effect for effect in fitted.effects if not (effect.is_wave or effect.key in kept)]
    return FitCache().without(fitted, *lost)


def suspects(selection: Selection) -> list[Suspected]:
    """Likely or possible causes next to the selected model, the most probable first.

    The first suspect stands for all causes indistinguishable from it. Each other suspect stands for itself.
    """
    model, search, white = selection.model, selection.search, selection.model.is_white
    ids = {effect.id for effect in selection.inconsistent}
    imitated = set() if selection.waves is None else set(selection.waves.imitated)
    left = [one for one in search.further_causes(model) if not is_signal(one.effect)]
    inconsistent = [one for one in left if one.effect.id in ids]
    left = [one for one in left if one.bic_gain > 0.0 and one.effect.id not in ids | imitated]
    allowance = search.misspecification_allowance(model, white=white)
    next_to_waves = _next_to_waves(selection)

    def posterior(equivalent: Collection[Alternative], excess: float = 0.0, cap: float = 1.0) -> float:
        gains = {one.effect.id: selection.chance_corrected_gain(one) - allowance - excess for one in left}
        return posterior_probability(gains, [one.effect.id for one in equivalent], search.causes_tried, cap=cap)

    # The test of a size takes a fit: only causes that are otherwise possible are tested.
    @cache
    def failed_test(one: Alternative) -> str:
        size = significance(one.fitted, one.effect)
        if size < THRESHOLDS.min_standard_errors_suspect:
            return f"its size is only {size:.1f} standard errors"
        rates = selection.rates(one.fitted), selection.rates(model)
        if change_in_samples(one.effect, *rates) < THRESHOLDS.sampling_share:
            return "it changes the simulation less than the sampling of the logs does"
        if is_held_by_friction(one.fitted, one.effect):
            return "it acts only at thrusts that friction holds"
        if any(_stands_in(one, better, search) for better in inconsistent if better.bic_gain > one.bic_gain):
            return "it loses most of its gain next to a cause that one-step predictions exclude"
        if next_to_waves is None or has_consistent_size(one.fitted, next_to_waves, one.effect):
            return ""
        return "one-step predictions show less of it"

    found, failed = list[Suspected](), dict[str, str]()

    def leave_out(one: Alternative, why: str) -> None:
        gain = f"{one.effect.title} gains {one.bic_gain:.0f} after the parameter penalty"
        failed[one.effect.id] = f"{gain}, but {why}: it is not suspected."

    for one in left.copy():
        least = max(one.bic_gain - THRESHOLDS.suspect_margin, 0.0)
        near = [] if found else [other for other in left if other is not one and other.bic_gain > least]
        if recalibrated(posterior([one, *near]), white=white) < THRESHOLDS.possible:
            break
        if why := failed_test(one):
            left.remove(one)
            leave_out(one, why)
            continue
        others = [other for other in near if not failed_test(other)]
        gain = held_out_log_likelihood(selection.folds(one.fitted)) - held_out_log_likelihood(selection.folds(model))
        own = selection.chance_corrected_gain(one)
        cap = selection.stand_in_cap(one.effect, model.value - one.fitted.value, gain, allowance)
        probability = posterior([one, *others], max(own - gain, 0.0), cap)
        if not white:
            probability = min(probability, outlier_probability(one.fitted, one.effect))
        stated = min(recalibrated(probability, white=white), selection.max_suspect_probability)
        if stated >= THRESHOLDS.possible:
            found.append(Suspected(one, stated, gain, tuple(others), failed.copy()))
        else:
            leave_out(one, "held-out trials or outliers leave it improbable")
    return sorted(found, key=lambda one: -one.probability)
