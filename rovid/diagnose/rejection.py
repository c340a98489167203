"""What is never established: the rules that each effect of a selected model must pass.

`first_rejection` applies the rules in their order. Each rule is a function of the selection and the effect. It returns
why the effect fails, or an empty text.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection
from dataclasses import dataclass

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.core.stats import t_quantile
from rovid.diagnose.candidate_fits import bic_score, has_parameter_at_bound, is_at_bound
from rovid.diagnose.cross_validation import horizon_squares, simulate_folds
from rovid.diagnose.posterior import significance
from rovid.diagnose.selection import Selection
from rovid.diagnose.signal_regressors import is_signal
from rovid.diagnose.thresholds import THRESHOLDS
from rovid.effects import Effect
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
        if effect.key not in passed and (rejection := rejection_of(selection, effect)) is not None:
            return rejection
    return None


def rejection_of(selection: Selection, effect: Effect) -> Rejection | None:
    """The first of the `RULES` that ``effect`` fails; None where it passes all."""
    for rule in RULES:
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
    least = cause.bic_gain + selection.tie_margin(cause.bic_gain)
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
    folds = [selection.folds(one) for one in models]
    positions = [horizon_squares(one, own, selection.pieces) for one, own in zip(models, folds, strict=True)]
    rates = [simulate_folds(one, own).rate_squares[:, np.newaxis] for one, own in zip(models, folds, strict=True)]
    for name, (own, without) in {"position": positions, "rate": rates}.items():
        growth = certain_growth(own, without)
        if growth > THRESHOLDS.held_out_growth:
            return f"makes the {name} errors on held-out trials {100.0 * growth:.0f} % larger"
    return ""


def raises_disturbance(selection: Selection, effect: Effect) -> str:
    """The effect leaves a larger disturbance than the model without it, by more than the estimate scatters.

    The variance of a Gauss-Markov process with the memory tau has T/(2 tau) independent values in T seconds. The
    relative standard error of its standard deviation is therefore sqrt(tau/T). A larger but slower disturbance, of the
    same power at high frequencies, does not count: size and memory are then badly determined.
    """
    seconds = sum(float(np.ptp(run.trial.time)) for run in selection.data.runs)
    without = selection.search.without(selection.model, effect)
    (size, memory), (size_without, memory_without) = selection.model.disturbance, without.disturbance
    error = math.sqrt(max(memory, memory_without) / seconds)
    growth = size / size_without - 1.0 if size_without > 0.0 else 0.0
    is_slower = size**2 * memory_without <= size_without**2 * memory
    if growth <= THRESHOLDS.disturbance_growth * error or is_slower:
        return ""
    return f"leaves a disturbance that is {100.0 * growth:.0f} % larger"


def likely(selection: Selection, effect: Effect) -> str:
    """The posterior probability is below `THRESHOLDS.established`, or the budget ended before every test."""
    is_open = _probability(selection, effect) < THRESHOLDS.established or selection.is_out_of_time
    return "is likely, but not established" * is_open


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
    likely,
)


def _probability(selection: Selection, effect: Effect) -> float:
    return selection.probability(selection.cause(effect), selection.held_out_gain(effect))


def _too_small(selection: Selection, fitted: FitResult, effect: Effect) -> str:
    least = THRESHOLDS.min_standard_errors
    if selection.multi_step:
        least = THRESHOLDS.min_standard_errors_multi_step
    size = significance(fitted, effect)
    return f"differs from zero by only {size:.1f} standard errors" if size < least else ""


def certain_growth(own: FloatArray, without: FloatArray) -> float:
    """Mean relative growth of the RMS errors; 0 where it may be chance.

    ``own`` and ``without``: (p, q) mean square errors of p pieces over q horizons, which count alike. The mean of the
    logarithm of the ratio is tested by Student's t, one-sided, over the pieces with a known error.
    """
    known = np.isfinite(own) & np.isfinite(without) & (own > 0.0) & (without > 0.0)
    count = known.sum(axis=1)
    logs = 0.5 * np.log(np.where(known, own, 1.0) / np.where(known, without, 1.0))
    growths = logs.sum(axis=1)[count > 0] / count[count > 0]
    if len(growths) < 2:
        return 0.0
    mean, error = float(growths.mean()), float(growths.std(ddof=1)) / math.sqrt(len(growths))
    least = t_quantile(1.0 - THRESHOLDS.held_out_growth_level, len(growths) - 1) * error
    return math.expm1(mean) if mean > least else 0.0
