"""Fits of candidate models: BIC, plausibility, the cache of all fits, and staged fits of shortlisted forms."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Self

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.core.budget import Budget
from rovid.core.spmd import parallel_map
from rovid.diagnose.cross_validation import Fold, HeldOutScores
from rovid.diagnose.screening import ScoreTest, bic_penalty, extended, first_of_each, further_forms
from rovid.diagnose.thresholds import THRESHOLDS
from rovid.effects import Effect, EffectParameter
from rovid.effects.clock_offset import CLOCKS_APART
from rovid.effects.thruster_lag import EFFECT as LAG
from rovid.estimate.fit_result import FitResult, fit
from rovid.estimate.nested_fits import at_best_instant, exchanged_or_same, neutral_start, scaled_start
from rovid.estimate.objective import ModelKey, NegativeLogLikelihood
from rovid.trial.vehicle import PLAUSIBLE_INERTIA_RATIO


@dataclass(frozen=True, eq=False)
class Alternative:
    """Another effect in the place of a selected one, with the BIC gain of its best form there."""

    effect: Effect
    bic_gain: float
    fitted: FitResult


@dataclass(frozen=True, eq=False)
class Cause:
    """One effect of the selected model, with the best form of each other effect in its place, best first."""

    effect: Effect
    gain: float  # log-likelihood (nats) that the removal loses, all other parameters refitted
    bic_gain: float  # the same less the BIC penalty
    alternatives: tuple[Alternative, ...] = ()


def model_words(fitted: FitResult) -> str:
    """The effects of a model in words."""
    return ", ".join(effect.title for effect in fitted.effects) or "no effect"


@dataclass(frozen=True, eq=False)
class Challenger:
    """Another set of causes, and by how much it loses against the selected set; negative differences lose."""

    effects: tuple[Effect, ...]
    log_likelihood_difference: float  # nats
    price_difference: float  # BIC penalty of all its parameters less that of the selected set, nats

    @classmethod
    def of(cls, fitted: FitResult, selected: FitResult) -> Self:
        """The challenger ``fitted`` to the same data as ``selected``."""
        gain = selected.value - fitted.value
        return cls(fitted.effects, gain, gain - (bic_score(fitted) - bic_score(selected)))

    @property
    def score_difference(self) -> float:
        """Difference of the log-likelihood less the difference of the price."""
        return self.log_likelihood_difference - self.price_difference

    @property
    def faults(self) -> tuple[str, ...]:
        """Ids of those effects that are faults of the logs."""
        return tuple(effect.id for effect in self.effects if effect is CLOCKS_APART)

    @property
    def causes(self) -> tuple[str, ...]:
        """Ids of the other effects."""
        return tuple(effect.id for effect in self.effects if effect is not CLOCKS_APART)


def bic_score(fitted: FitResult) -> float:
    """Log-likelihood less the BIC penalty of all effect parameters, in nats (Schwarz 1978).

    An instant has the penalty of two, because the best of many instants gains by chance (Zhang and Siegmund 2007).
    """
    return value_at_score(fitted.value, fitted.objective)


def value_at_score(score: float, objective: NegativeLogLikelihood) -> float:
    """Negative log-likelihood at which a model has the BIC score ``score``; the inverse of `bic_score`."""
    instants = sum(len(effect.instants) for effect in objective.effects)
    return -score - bic_penalty(objective) * (len(objective.parametrization.parameters) + instants)


def fit_coarse(objective: NegativeLogLikelihood, x: FloatArray, iterations: int, goal: float = math.inf) -> FitResult:
    """Fit from ``x`` with the tolerance of the search; stop early where the value ``goal`` is out of reach."""
    return fit(objective, x, iterations=iterations, tolerance=THRESHOLDS.search_tolerance, goal=goal)


def is_converged(fitted: FitResult) -> bool:
    """Whether the remaining gain is within the tolerance of the search."""
    return fitted.remaining_gain <= THRESHOLDS.search_tolerance


def refine_fit(fitted: FitResult, iterations: int, goal: float = math.inf) -> FitResult:
    """Continue a fit, unless it has converged or the value ``goal`` is out of reach."""
    if is_converged(fitted) or fitted.remaining_gain < fitted.value - goal:
        return fitted
    return fit_coarse(fitted.objective, fitted.x, iterations, goal)


def fit_from_best_start(
    objective: NegativeLogLikelihood,
    nested: FitResult,
    starts: Sequence[FloatArray],
    iterations: int,
    goal: float = math.inf,
) -> FitResult:
    """Fit from the ``nested`` model with the most likely of the ``starts`` of the last effect; never less likely."""
    (best,) = objective.most_likely([np.concatenate((nested.x, start)) for start in starts], 1)
    fitted = fit_coarse(objective, best, iterations, goal)
    if fitted.value <= nested.value:
        return fitted
    return fit_coarse(objective, neutral_start(objective, nested), iterations, goal)


def fit_in_parallel(
    objectives: Sequence[NegativeLogLikelihood],
    fit_one: Callable[[int], FitResult],
    budget: Budget | None = None,
    words: str = "",
) -> list[FitResult]:
    """Results of ``fit_one`` for each index of ``objectives``, computed by all workers, the longest fits first.

    Fits that have not begun at the end of the ``budget`` are left out. ``words`` are the message on the progress.
    """
    budget = budget or Budget()
    since = budget.clock()

    def duration(at: int) -> tuple[bool, int]:
        # An oscillator adds two states to the filter, and each parameter a column to the Jacobian.
        objective = objectives[at]
        return any(effect.oscillatory for effect in objective.effects), len(objective.parametrization.parameters)

    order = sorted(range(len(objectives)), key=duration, reverse=True)
    place = {at: number for number, at in enumerate(order)}

    is_over, is_shared = budget.is_over, len(order) > 1

    def numbers(at: int) -> tuple[FloatArray, float, float] | None:
        # A single fit is not shared: each process does it, and none may find alone that the time is up.
        if is_over or (is_shared and budget.is_late):
            return None
        budget.tell(words, place[at], len(order), since)
        fitted = fit_one(at)
        return fitted.x, fitted.value, fitted.remaining_gain

    # Each fit holds two sets of innovations: with many samples, threads share one fit after the other.
    is_small = all(len(one.data.run_index) < THRESHOLDS.parallel_fit_samples for one in objectives)
    found = dict(zip(order, parallel_map(numbers, order, use_threads=is_small), strict=True))
    fits = []
    for at, objective in enumerate(objectives):
        if (own := found[at]) is None:
            budget.leave_out(objective.effects[-1].id)
        else:
            fits.append(FitResult(objective, *own))
    return fits


def is_plausible(fitted: FitResult) -> bool:
    """Whether the last effect has no parameter at a bound and enough cycles, and the inertia is physical."""
    effect = fitted.effects[-1]
    if has_parameter_at_bound(fitted, effect):
        return False
    values = fitted.effect_coordinates(effect)
    if effect.oscillatory:
        # The lowest frequency is one cycle of the longest run: any drift has that.
        at = [parameter.name for parameter in effect.parameters].index("frequency")
        lowest = fitted.objective.parametrization.low[-len(effect.parameters) :][at]
        if values[at] <= lowest:
            return False
    return fitted.is_physical


def why_implausible(fitted: FitResult) -> str:
    """The parameter that makes a model with one more effect implausible, and what to do; empty for another reason."""
    if has_parameter_at_bound(fitted, fitted.effects[-1]):
        limit = "a size or time at the limit of its range. It is not claimed"
        return f"{limit}: look for a fault, or for a cause that the catalogue lacks"
    vehicle = fitted.data.vehicle
    rigid = None if vehicle is None else vehicle.reference_inertia
    if rigid is None or fitted.is_physical:
        return ""
    low, high = PLAUSIBLE_INERTIA_RATIO
    ratio = f"an inertia of {fitted.model.inertia / rigid:.3g} times the rigid body's by mass and size"
    return f"{ratio}, outside {low} to {high}. It is not claimed: check mass, size, arms and thrust curves"


def is_at_bound(fitted: FitResult, effect: Effect) -> bool:
    """Whether the size of ``effect`` is at the largest value that its definition allows."""
    return _at_bound(float(fitted.effect_coordinates(effect)[0]), effect.parameters[0])


def has_parameter_at_bound(fitted: FitResult, effect: Effect) -> bool:
    """Whether any parameter of ``effect`` is at a bound other than its value without the effect."""
    return any(map(_at_bound, fitted.effect_coordinates(effect).tolist(), effect.parameters))


def _at_bound(value: float, parameter: EffectParameter) -> bool:
    """Whether ``value`` is at a bound other than the neutral value."""
    above = value >= parameter.high and parameter.high != parameter.neutral
    below = value <= parameter.low and parameter.low != parameter.neutral
    return above or below


def simplest_form(better: FitResult, others: Sequence[FitResult], current: FitResult) -> FitResult:
    """The form of the same effect with the fewest parameters, among ``others`` with nearly the BIC gain of ``better``.

    With white innovations ``better`` itself. Otherwise the further gain may belong to a cause that is still missing.
    """
    if better.is_white:
        return better
    enough = bic_score(better) - THRESHOLDS.misspecification_share * (bic_score(better) - bic_score(current))
    same = [one for one in others if one.effects[-1].id == better.effects[-1].id and bic_score(one) >= enough]
    return min(same, key=lambda one: (len(one.effects[-1].parameters), -bic_score(one)), default=better)


@dataclass(frozen=True, eq=False)
class FitCache:
    """Everything computed for models of the same data with the same candidates, by the key of a model."""

    score_tests: dict[ModelKey, list[ScoreTest]] = field(default_factory=dict)
    # Fitted models with one effect more.
    extensions: dict[ModelKey, list[FitResult]] = field(default_factory=dict)
    # By a model and the same model without one effect: fits of the latter with possible substitutes.
    replacements: dict[tuple[ModelKey, ModelKey], list[FitResult]] = field(default_factory=dict)
    fits: dict[ModelKey, FitResult] = field(default_factory=dict)
    # Fits of other sets of causes that may come close to a model.
    challengers: dict[ModelKey, list[FitResult]] = field(default_factory=dict)
    # These belong to one selection: cross-validation with its scores, simulated rates, and fits to all data.
    folds: dict[ModelKey, list[Fold]] = field(default_factory=dict)
    held_out: dict[ModelKey, HeldOutScores] = field(default_factory=dict)
    horizons: dict[ModelKey, FloatArray] = field(default_factory=dict)
    rates: dict[FitResult, list[FloatArray]] = field(default_factory=dict)
    full_data: dict[ModelKey, FitResult] = field(default_factory=dict)
    _converged: dict[FitResult, FitResult] = field(default_factory=dict)

    def for_another_selection(self) -> Self:
        """The same fits, without what belongs to one selection."""
        return replace(self, folds={}, held_out={}, horizons={}, rates={}, full_data={})

    def converged(self, fitted: FitResult) -> FitResult:
        """``fitted`` continued to convergence, once: the search leaves fits that cannot win."""
        if fitted not in self._converged:
            converged = refine_fit(fitted, THRESHOLDS.search_iterations)
            self._converged[fitted] = self._converged[converged] = converged
        return self._converged[fitted]

    def converged_extensions(self, current: FitResult) -> dict[str, FitResult]:
        """Converged models with one effect more than ``current``, by the key of that effect."""
        limit, here = current.key
        found: dict[str, FitResult] = {}
        for (other_limit, keys), fitted in self.fits.items():
            if other_limit == limit and here < keys and len(keys) == len(here) + 1 and is_converged(fitted):
                (last,) = (effect for effect in fitted.effects if effect.key not in here)
                found[last.key] = fitted.with_last(last)
        return found

    def without(self, current: FitResult, *dropped: Effect) -> FitResult:
        """``current`` without some effects, all other parameters refitted to convergence."""
        if not dropped:
            return current
        effects, x = current.without(*dropped)
        self.fit_all(current.objective, [(effects, x)])
        key = current.objective.with_effects(effects).key
        # A fit that has not converged would overstate the gain of the dropped effects.
        self.fits[key] = converged = self.converged(self.fits[key])
        return converged

    def fit_all(
        self, objective: NegativeLogLikelihood, models: Sequence[tuple[tuple[Effect, ...], FloatArray]]
    ) -> None:
        """Fit in parallel all ``models``, given by effects and (p,) start, that are not in the cache."""
        pairs = [(objective.with_effects(effects), x) for effects, x in models]
        left = [pair for pair in pairs if pair[0].key not in self.fits]
        for fitted in fit_in_parallel(
            [one for one, _ in left], lambda at: fit_coarse(*left[at], THRESHOLDS.search_iterations)
        ):
            self.fits[fitted.key] = self._at_least_nested(fitted)

    def _at_least_nested(self, fitted: FitResult) -> FitResult:
        """``fitted``, or a new fit from a cached model with one effect less where that one is more likely."""
        for effect in fitted.effects:
            effects, _ = fitted.without(effect)
            nested = self.fits.get(fitted.objective.with_effects(effects).key)
            if nested is not None and nested.value < fitted.value:
                objective = fitted.objective.with_effects((*effects, effect))
                starts = objective.parametrization.initial_values()
                return fit_from_best_start(objective, nested, starts, THRESHOLDS.search_iterations)
        return fitted


def fit_candidates(
    current: FitResult,
    tests: Sequence[ScoreTest],
    may_lead: Callable[[FitResult], bool],
    known: Mapping[str, FitResult],
    others: Sequence[ScoreTest] = (),
    budget: Budget | None = None,
) -> tuple[list[FitResult], list[FitResult]]:
    """Fit the shortlisted forms in stages, all parameters together; return those fitted to the end, and those left.

    ``may_lead``: Whether a model may be selected. A fit stops where it cannot reach the best of those.
    ``known``: Converged models by the key of the added effect; they are not fitted again.
    ``others``: Forms outside of the shortlist. They are fitted where their cause leads, because score tests do not
        order the forms of a large effect.
    ``budget``: At its end no fit is begun, and no fit is refined.
    """
    words = f"Model with {model_words(current)}"

    def gain(fitted: FitResult) -> float:
        return bic_score(fitted) - bic_score(current)

    def least_gain(share: float, fits: Sequence[FitResult]) -> float:
        return max(share * max(map(gain, fits), default=0.0), 0.0)

    def goals(objectives: Sequence[NegativeLogLikelihood], fits: Sequence[FitResult]) -> list[float]:
        score = max(map(bic_score, filter(may_lead, fits)), default=-math.inf) - THRESHOLDS.goal_distance
        return [value_at_score(score, objective) for objective in objectives]

    def begin(few: Sequence[ScoreTest]) -> list[FitResult]:
        objectives = [extended(current, one) for one in few]
        values = goals(objectives, converged)
        return fit_in_parallel(
            objectives, lambda at: _begin(current, objectives[at], few[at], values[at]), budget, words
        )

    def refine(fits: Sequence[FitResult], iterations: int) -> list[FitResult]:
        objectives = [fitted.objective for fitted in fits]
        values = goals(objectives, fits)
        refined = fit_in_parallel(objectives, lambda at: refine_fit(fits[at], iterations, values[at]), budget, words)
        done = {fitted.key for fitted in refined}
        return [*refined, *(fitted for fitted in fits if fitted.key not in done)]

    stages = (THRESHOLDS.second_stage, THRESHOLDS.final_stage)
    converged = [known[one.effect.key] for one in tests if one.effect.key in known]
    unknown = [one for one in tests if one.effect.key not in known]
    first = first_of_each(unknown)
    ahead, behind = [*converged, *begin(first)], list[FitResult]()
    # Further forms of an effect are fitted where its first form is good, or where their own score test is.
    least = least_gain(stages[0][0], ahead)
    good = {fitted.effects[-1].id for fitted in ahead if gain(fitted) >= least}
    more = [one for one in unknown if one.effect.id in good or one.gain >= least]
    ahead += begin([one for one in more if one not in first])
    ahead += begin(further_forms(tests, others, [one for one in ahead if gain(one) >= least_gain(stages[1][0], ahead)]))
    for share, iterations in stages:
        least = least_gain(share, ahead)
        behind += [fitted for fitted in ahead if gain(fitted) < least]
        ahead = refine([fitted for fitted in ahead if gain(fitted) >= least], iterations)
    lags = [one for one in ahead if one.effects[-1].id == LAG.id]
    for lag in sorted(lags, key=gain)[-1:]:
        # The time constants of the best lag and of the vehicle may have changed places.
        ahead[ahead.index(lag)] = exchanged_or_same(lag)
    # The best is known once none of the others is within reach of it.
    for _ in range(THRESHOLDS.reach_rounds):
        best = max(map(gain, ahead), default=0.0)
        within = [one for one in ahead if not is_converged(one) and gain(one) + one.remaining_gain >= best]
        if not within:
            break
        ahead = [*(one for one in ahead if one not in within), *refine(within, stages[1][1])]
    return ahead, behind


def _begin(current: FitResult, objective: NegativeLogLikelihood, test: ScoreTest, goal: float) -> FitResult:
    """First steps of the fit of ``current`` with the tested form, from the most likely of several sizes.

    The predicted start, and the best start as it stands where it differs in other parameters than the size.
    """
    scaled = [scaled_start(test.effect, test.start, share) for share in THRESHOLDS.start_shares]
    others = slice(test.effect.size_count, None)
    if np.array_equal(test.best_start[others], test.start[others]):
        starts = [[test.best_start, *scaled]]
    else:
        starts = [[test.best_start], scaled]
    fits = [fit_from_best_start(objective, current, few, THRESHOLDS.first_iterations, goal) for few in starts]
    return at_best_instant(min(fits, key=lambda one: one.value), THRESHOLDS.first_iterations, goal)
