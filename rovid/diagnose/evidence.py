"""Evidence for one effect: size in standard errors, posterior probability that it acts, and the word for both."""

import math
from collections.abc import Collection, Mapping
from enum import StrEnum

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.core.stats import f_sf, logistic, logit, t_cdf
from rovid.diagnose.candidate_fits import fit_coarse
from rovid.diagnose.thresholds import ESTABLISHED, THRESHOLDS
from rovid.effects import Effect, supply_sag
from rovid.effects.base import Instant, Scales, Term
from rovid.effects.coulomb_resistance import EFFECT as FRICTION
from rovid.effects.further_terms import trials_in_form
from rovid.estimate.estimate import Estimate
from rovid.estimate.fit_result import FitResult

# What people read where the logs do not decide between causes, or decide nothing.
CANNOT_TELL = "cannot tell"


def posterior_probability(
    bic_gains: Mapping[str, float],
    equivalent: Collection[str],
    causes_tried: int,
    *,
    cap: float = THRESHOLDS.max_probability,
) -> float:
    """Probability that one of the causes ``equivalent`` acts, rather than another one or none.

    ``bic_gains``: Cause -> BIC gain of its best form (nats); its exponential is the Bayes factor (Schwarz 1978).
    ``causes_tried``: Number of causes tested, including those that were not fitted. They share the prior odds that any
        acts.
    ``cap``: Largest probability; see `probability_not_a_stand_in`.
    """
    # Relative to the largest, because its exponential may overflow.
    top = max([0.0, *bic_gains.values()])
    prior = THRESHOLDS.prior_odds / max(causes_tried, 1)
    weights = {name: prior * math.exp(gain - top) for name, gain in bic_gains.items()}
    total = math.exp(-top) + sum(weights.values())
    own = sum(weights.get(name, 0.0) for name in equivalent)
    return min(own / total, cap)


def probability_not_a_stand_in(held_out_gain: float, expected_gain: float, *, white: bool) -> float:
    """Probability that a cause with these gains (nats) acts itself.

    A stand-in is an effect that does not act, but resembles physics that the catalogue lacks. The odds are those of
    hard-water campaigns: even at a held-out gain of `THRESHOLDS.stand_in_gain`, and e times as high for each further
    `THRESHOLDS.stand_in_scale`. With ``white`` innovations the gain that the fit lets expect is exact too, and the
    smaller one counts, because the best of many causes gains on a few trials by chance.
    """
    gain = min(held_out_gain, expected_gain) if white else held_out_gain
    return min(logistic((gain - THRESHOLDS.stand_in_gain) / _stand_in_scale(white)), THRESHOLDS.max_probability)


def _stand_in_scale(white: bool) -> float:
    return THRESHOLDS.stand_in_scale_white if white else THRESHOLDS.stand_in_scale


def recalibrated(probability: float, *, white: bool) -> float:
    """Stated probability of a cause with the posterior ``probability``.

    With coloured innovations the samples are less independent than the likelihood assumes, and several causes act. In
    three hard-water campaigns (seeds 404, 505, 606), posterior probabilities of 0.04, 0.25, 0.5, 0.7 and 0.9 were right
    in 0.24, 0.55, 0.71, 0.85 and 0.92 of the cases. With ``white`` innovations the probability is stated as it is.
    """
    if white:
        return probability
    return logistic(THRESHOLDS.recalibration_offset + THRESHOLDS.recalibration_slope * logit(probability))


def effect_size(
    fitted: FitResult, effect: Effect, *, sandwich: bool, along: FloatArray | None = None
) -> tuple[float, float]:
    """Distance of the first parameter of ``effect`` from its neutral value, and the standard error.

    With several sizes, their projection on the unit vector ``along``, by default their own direction. The standard
    error then includes that a direction was chosen. ``sandwich`` allows for coloured innovations.
    """
    away, covariance = effect_sizes(fitted, effect, sandwich=sandwich)
    if effect.size_count > 1:
        along = unit_direction(away) if along is None else along
        return float(along @ away), math.sqrt(effect.size_count * max(float(along @ covariance @ along), 0.0))
    distance, variance = float(away[0]), float(covariance[0, 0])
    # Rounding may leave a negative variance: then nothing is known.
    error = math.sqrt(variance) if variance >= 0.0 else math.inf
    if effect.parameters[0].neutral_at_infinity:
        return 1.0 / distance, error / distance**2
    return distance, error


def effect_sizes(fitted: FitResult, effect: Effect, *, sandwich: bool) -> tuple[FloatArray, FloatArray]:
    """(s,) distances of all sizes of ``effect`` from their neutral values, and their (s, s) covariance.

    Where the neutral value is infinite, the distance is counted from zero.
    """
    at = list(map(fitted.model.names.index, effect.parameter_names[: effect.size_count]))
    away = fitted.model.values[at] - fitted.data.scales.neutral_sizes(effect)
    return away, fitted.covariance(sandwich=sandwich)[np.ix_(at, at)]


def size_in_errors(effect: Effect, estimate: Estimate, scales: Scales) -> float:
    """Mahalanobis distance of the determined sizes of ``effect`` from their neutral values; 0 where there are none."""
    own = estimate.only(effect.parameter_names[: effect.size_count])
    known = np.array([name not in own.refused for name in own.names])
    away, covariance = (own.values - scales.neutral_sizes(effect))[known], own.covariance[np.ix_(known, known)]
    if not known.any() or not np.isfinite(covariance).all():
        return 0.0
    return math.sqrt(max(float(away @ np.linalg.lstsq(covariance, away, rcond=None)[0]), 0.0))


def unit_direction(away: FloatArray) -> FloatArray:
    """(s,) unit vector along ``away``; equal components where that is zero."""
    length = float(np.linalg.norm(away))
    if length > 0.0:
        return away / length
    return np.full(len(away), 1.0 / math.sqrt(len(away)))


def significance(fitted: FitResult, effect: Effect) -> float:
    """Size of ``effect`` in standard errors."""
    away, error = effect_size(fitted, effect, sandwich=not fitted.is_white)
    return abs(away) / error if error > 0.0 else math.inf


def has_consistent_size(multi_step: FitResult, one_step: FitResult, effect: Effect) -> bool:
    """Whether ``effect`` of a multi-step fit is about as large in a one-step fit next to waves.

    Under feedback, multi-step predictions improve with effects that do not act, because commands counteract the waves.
    One-step predictions are free of that (Ljung 1999, section 13.4). Effects of logged signals always pass: sensor
    noise dilutes them in one-step predictions.
    """
    if effect.needs:
        return True
    if effect not in one_step.effects:
        objective = one_step.objective.with_effects((*one_step.effects, effect))
        begin = np.concatenate((one_step.x, multi_step.effect_coordinates(effect)))
        one_step = fit_coarse(objective, begin, THRESHOLDS.close_iterations)
    along = None
    if effect.size_count > 1:
        along = unit_direction(effect_sizes(multi_step, effect, sandwich=True)[0])
    expected, error = effect_size(multi_step, effect, sandwich=True, along=along)
    found, one_step_error = effect_size(one_step, effect, sandwich=True, along=along)
    # A size of the other sign is a negative share of the expected one. A negative amplitude is a positive one with the
    # phase turned by half a cycle.
    same_sense = abs(found) if effect.canonical is not None else math.copysign(1.0, expected) * found
    if same_sense >= THRESHOLDS.consistent_share * abs(expected):
        return True
    return abs(expected) - same_sense <= THRESHOLDS.consistent_errors * math.hypot(error, one_step_error)


def outlier_probability(fitted: FitResult, effect: Effect) -> float:
    """Probability that the thrust of the trials of ``effect`` differs by more than trials usually do; 1 for others."""
    count = len(trials_in_form(effect.form))
    if count == 0 or effect.id != supply_sag.EFFECT.id:
        return 1.0
    if count == 1:
        return _single_outlier(fitted, effect)
    # Fisher's F test of the scatter of thrust between trials against its usual value and its standard errors.
    away, covariance = effect_sizes(fitted, effect, sandwich=True)
    # The thrusts of all trials have the mean zero: the last one follows.
    contrast = np.vstack((np.eye(len(away)), np.full(len(away), -1.0)))
    thrusts, variances = contrast @ away, np.diag(contrast @ covariance @ contrast.T)
    freedom = len(away)
    ratio = float(np.sum(thrusts**2)) / freedom / (THRESHOLDS.thrust_scatter**2 + float(np.mean(variances)))
    return 1.0 - f_sf(freedom, THRESHOLDS.thrust_scatter_trials, ratio)


def _single_outlier(fitted: FitResult, effect: Effect) -> float:
    """Student's t test of an outlier, corrected for the number of trials.

    Each trial has a thrust of its own, because kinds of runs differ where the form of the model is approximate.
    """
    trials = dict.fromkeys(run.trial.parent or run.trial.name for run in fitted.data.runs)
    others = [other for other in (supply_sag.for_trials([name]) for name in trials) if other.key != effect.key]
    kept_effects, kept_x = fitted.without(effect)
    # The first of the other trials is the reference.
    objective = fitted.objective.with_effects((*kept_effects, effect, *others[1:]))
    start = np.concatenate((kept_x, fitted.effect_coordinates(effect), np.ones(len(others) - 1)))
    refitted = fit_coarse(objective, start, THRESHOLDS.close_iterations)
    # The thrust of the trial itself stands first, that of the reference last.
    thrust_slice = slice(-len(others), None)
    thrusts = np.concatenate((refitted.model.values[thrust_slice], [1.0]))
    # Thrust of the trial less the mean of the others.
    contrast = np.full(len(thrusts), -1.0 / len(others))
    contrast[0] = 1.0
    covariance = refitted.covariance(sandwich=True)[thrust_slice, thrust_slice]
    fit_variance = float(contrast[:-1] @ covariance @ contrast[:-1])
    deviations = thrusts[1:] - thrusts[1:].mean()
    prior_trials = THRESHOLDS.thrust_scatter_trials
    squares = float(np.sum(deviations**2)) + prior_trials * THRESHOLDS.thrust_scatter**2
    freedom = len(others) - 1 + prior_trials
    # Scatter between trials, error of their mean, and errors of the fitted thrusts.
    variance = squares / freedom * (1.0 + 1.0 / len(others)) + fit_variance
    t_statistic = abs(float(thrusts @ contrast)) / math.sqrt(variance)
    # Two-sided, and Bonferroni's correction for the choice of the trial.
    return max(0.0, 1.0 - 2.0 * len(thrusts) * t_cdf(freedom, -t_statistic))


def is_held_by_friction(fitted: FitResult, effect: Effect) -> bool:
    """Whether ``effect`` changes thrust almost only where dry friction of the model can hold the vehicle at rest.

    The law of friction changes its sign over a range of rates, and the vehicle creeps there. Real friction sticks, like
    a thrust that begins where the vehicle breaks away.
    """
    friction = next((one for one in fitted.effects if one.id == FRICTION.id), None)
    vehicle, model = fitted.data.vehicle, fitted.model
    if friction is None or vehicle is None or not effect.changes_torque_input:
        return False
    acts, held = friction.acts, 0.0
    assert isinstance(acts, Term)  # noqa: S101 - all forms of friction are
    numbers = tuple(float(model.values[model.names.index(name)]) for name in friction.parameter_names)
    for rate in (fitted.data.scales.rate * np.geomspace(1e-3, 1.0)).tolist():
        at = Instant(rate, rate, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, model.body)
        held = max(held, abs(acts.evaluate(at, numbers, (1.0,) * acts.states)[0]))
    effects, x = fitted.without(effect)
    without = fitted.objective.with_effects(effects).parametrization.model(x)
    every = [[each.torque_input(vehicle, run.trial).torque for run in fitted.data.runs] for each in (model, without)]
    own, plain = map(np.concatenate, every)
    change = np.abs(own - plain)
    return bool(change[np.abs(plain) <= held].sum() > THRESHOLDS.held_share * change.sum())


class Evidence(StrEnum):
    """How well the logs support a cause, the best first."""

    CONFIRMED = "confirmed"
    LIKELY = "likely"
    POSSIBLE = "possible"


def confirming_gain(*, white: bool) -> float:
    """Held-out gain in nats at which a stand-in is `THRESHOLDS.confirmed_odds` times rarer than a true cause."""
    return THRESHOLDS.stand_in_gain + _stand_in_scale(white) * math.log(THRESHOLDS.confirmed_odds)


def grade(
    probability: float, held_out_gain: float, standard_errors: float, *, white: bool, is_conclusive: bool = True
) -> Evidence:
    """Evidence for a cause.

    ``probability``: Probability that the cause acts, or another one that the logs do not distinguish from it.
    ``held_out_gain``: Log-likelihood gain on trials that were not fitted, in nats.
    ``standard_errors``: Distance of the size from its value without the effect.
    ``white``: Whether the one-step prediction errors are white.
    ``is_conclusive``: Whether the search came to its end, and no other cause explains the logs as well.
    """
    established = probability >= ESTABLISHED
    is_far = standard_errors >= THRESHOLDS.confirmed_standard_errors
    if established and is_conclusive and is_far and held_out_gain >= confirming_gain(white=white):
        return Evidence.CONFIRMED
    if probability >= THRESHOLDS.likely and standard_errors >= THRESHOLDS.likely_standard_errors:
        return Evidence.LIKELY
    return Evidence.POSSIBLE


# One sentence for each word that people read.
DEFINITIONS: Mapping[str, str] = {
    Evidence.CONFIRMED.value: (
        f"The cause is established, its size is {THRESHOLDS.confirmed_standard_errors:.0f} standard errors or more "
        f"from nothing, and its gain on trials that were not fitted is {confirming_gain(white=False):.0f} nats or more "
        f"({confirming_gain(white=True):.0f} if the one-step prediction errors are white)."
    ),
    Evidence.LIKELY.value: (
        "The cause is more probable than not, and its size is "
        f"{THRESHOLDS.likely_standard_errors:.0f} standard errors or more from nothing."
    ),
    Evidence.POSSIBLE.value: "The cause may act, but chance or another effect may look the same.",
    CANNOT_TELL: "Several causes explain these logs equally well, or the logs decide nothing.",
}
