"""Whether the thrust of one trial stands out from what trials differ by."""

from __future__ import annotations

import math

import numpy as np
from scipy import special

from rovid.diagnose.rivals import quickly_climbed
from rovid.effects import Effect, supply_sag
from rovid.identify.fitted import Fitted

# By so much, as a share, a supply, a propeller and a temperature differ from trial to trial, before the logs are looked
# at; so many trials more would tell as much.
_USUAL, _AS_TRIALS = 0.05, 2
_ITERATIONS = 20


def of_one_trial(effect: Effect) -> bool:
    """Whether ``effect`` is the thrust of one trial."""
    return effect.id == supply_sag.EFFECT.id and effect.form.startswith(supply_sag.TRIAL)


def stands_out(fitted: Fitted, effect: Effect) -> float:
    """Probability that the trial of ``effect`` differs from the others by more than they do from one another.

    The outlier's test of Student's t, for as many trials as were looked at: where the model's form is not nature's,
    each kind of run asks for a thrust of its own, and one of them is always the oddest.
    """
    trials = dict.fromkeys(run.trial.whole or run.trial.name for run in fitted.records.runs)
    others = [one for one in map(supply_sag.of_trial, trials) if one.key != effect.key]
    rest, x = fitted.without(effect)
    # The first of the others is what all are measured by.
    free = fitted.misfit.like((*rest, effect, *others[1:]))
    start = np.concatenate((x, fitted.own(effect), np.ones(len(others) - 1)))
    best = quickly_climbed(free, start, _ITERATIONS)
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
    beyond = float(special.stdtr(freedom, -odd))
    return max(0.0, 1.0 - 2.0 * len(thrusts) * beyond)
