"""Whether the thrust of one trial, or of each, stands out from what trials differ by anyway."""

from __future__ import annotations

import math

import numpy as np

from rovid.core.stats import f_sf, t_cdf
from rovid.diagnose.bic import fit_coarse
from rovid.diagnose.effect_size import effect_sizes
from rovid.effects import Effect, supply_sag
from rovid.effects.per_trial import trials_in_form
from rovid.estimate.fit_result import FitResult

# By so much, as a share, a supply, a propeller and a temperature differ from trial to trial, before the logs are looked
# at; so many trials more would tell as much.
_USUAL, _AS_TRIALS = 0.05, 2
_ITERATIONS = 20


def outlier_probability(fitted: FitResult, effect: Effect) -> float:
    """Probability that what ``effect`` says of the thrust of trials is more than they differ by anyway; 1 of others."""
    count = len(trials_in_form(effect.form))
    if count == 0 or effect.id != supply_sag.EFFECT.id:
        return 1.0
    return _odd_one(fitted, effect) if count == 1 else _scattered(fitted, effect)


def _scattered(fitted: FitResult, effect: Effect) -> float:
    """Probability that trials differ by more than is usual and than their thrusts are known.

    The test of Fisher's F, as for `_odd_one`.
    """
    away, covariance = effect_sizes(fitted, effect, sandwich=True)
    # The last of them is what is left of their mean.
    last = np.vstack((np.eye(len(away)), np.full(len(away), -1.0)))
    thrusts, variances = last @ away, np.diag(last @ covariance @ last.T)
    freedom = len(away)
    ratio = float(np.sum(thrusts**2)) / freedom / (_USUAL**2 + float(np.mean(variances)))
    return 1.0 - f_sf(freedom, _AS_TRIALS, ratio)


def _odd_one(fitted: FitResult, effect: Effect) -> float:
    """Probability that the trial of ``effect`` differs from the others by more than they do from one another.

    The outlier's test of Student's t, for as many trials as were looked at: where the model's form is not nature's,
    each kind of run asks for a thrust of its own, and one of them is always the oddest.
    """
    trials = dict.fromkeys(run.trial.parent or run.trial.name for run in fitted.data.runs)
    others = [one for one in (supply_sag.for_trials([name]) for name in trials) if one.key != effect.key]
    rest, x = fitted.without(effect)
    # The first of the others is what all are measured by.
    free = fitted.objective.with_effects((*rest, effect, *others[1:]))
    start = np.concatenate((x, fitted.effect_coordinates(effect), np.ones(len(others) - 1)))
    best = fit_coarse(free, start, _ITERATIONS)
    # The thrust of the trial itself first, and last that of the one by which all are measured.
    last = slice(-len(others), None)
    thrusts = np.concatenate((best.model.values[last], [1.0]))
    beside = np.full(len(thrusts), -1.0 / len(others))
    beside[0] = 1.0
    covariance = best.covariance(sandwich=True)[last, last]
    known = beside[:-1] @ covariance @ beside[:-1]
    deviations = thrusts[1:] - thrusts[1:].mean()
    scatter = float(np.sum(deviations**2)) + _AS_TRIALS * _USUAL**2
    freedom = len(others) - 1 + _AS_TRIALS
    # Of a new trial: what trials differ by, how well their mean is known, and how well each thrust is.
    variance = scatter / freedom * (1.0 + 1.0 / len(others)) + float(known)
    odd = abs(float(thrusts @ beside)) / math.sqrt(variance)
    beyond = t_cdf(freedom, -odd)
    return max(0.0, 1.0 - 2.0 * len(thrusts) * beyond)
