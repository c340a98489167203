"""Trial of one effect on logs: its gains alone and next to the causes of the diagnosis, beside those of the others."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from rovid.core.budget import Budget
from rovid.core.errors import DataError
from rovid.diagnose.algorithm import decide
from rovid.diagnose.candidate_fits import bic_score, fit_from_best_start
from rovid.diagnose.cross_validation import CvPiece, cross_validate, held_out_log_likelihood, missing_data, split_runs
from rovid.diagnose.objectives import pose, preload, without_waves
from rovid.diagnose.signal_regressors import is_signal
from rovid.diagnose.stated_selection import model_estimate
from rovid.diagnose.thresholds import THRESHOLDS
from rovid.effects import Effect
from rovid.estimate.estimate import Estimate
from rovid.estimate.fit_result import FitResult
from rovid.trial.preprocessing import PreparedRuns
from rovid.trial.vehicle import Vehicle


@dataclass(frozen=True, kw_only=True, eq=False)
class EffectGain:
    """Gain of one form of an effect next to a model."""

    effect: Effect
    beside: tuple[str, ...]  #: Ids of the effects in the model.
    gain: float  #: Log-likelihood less the BIC penalty, in nats.
    held_out_gain: float  #: Log-likelihood on trials that were not fitted, in nats.
    estimate: Estimate  #: All parameters of the model with the effect.


@dataclass(frozen=True, kw_only=True, eq=False)
class EffectTrial:
    """Gains of the tried effect, and those of the catalogue's effects next to the plain model."""

    tried: tuple[EffectGain, ...]
    others: Mapping[str, float]  #: Id -> gain of its best form in nats less the BIC penalty, largest first.


def try_effect(prepared: PreparedRuns, vehicle: Vehicle, forms: Sequence[Effect], budget: Budget) -> EffectTrial:
    """Fit all ``forms`` of an effect next to the plain model, and next to the causes that the diagnosis selects.

    Raises DataError if there are too few data.
    """
    runs = prepared.items
    if (parts := split_runs(runs, vehicle, prepared.cutoff)) is not None:
        runs = parts.items
    if missing := missing_data(runs, prepared.cutoff):
        raise DataError(missing, where="LOGS", mend="Record more runs.")
    preload()
    problem = pose(prepared, runs, vehicle, budget)
    own = {form.id for form in forms}
    others = tuple(candidate for candidate in problem.candidates if candidate.id not in own)
    innovations = replace(problem.innovations, candidates=others)
    problem = replace(problem, candidates=others, innovations=innovations)
    base = innovations.base
    gains: dict[str, float] = {}
    for fitted in innovations.search(base).extensions(base):
        last = fitted.effects[-1]
        if not is_signal(last):
            gains[last.id] = max(gains.get(last.id, 0.0), bic_score(fitted) - bic_score(base))
    selected = decide(problem).model
    effects, x = selected.without(*(one for one in selected.effects if is_signal(one) or one.is_wave))
    kept = replace(selected, objective=selected.objective.with_effects(effects), x=x)
    models = [base, *[innovations.begin(innovations.search_data, kept, kept)] * bool(effects)]
    tried = [_gain(model, form, problem.innovations.pieces) for model in models for form in without_waves(forms)]
    return EffectTrial(tried=tuple(tried), others=dict(sorted(gains.items(), key=lambda item: -item[1])))


def _gain(model: FitResult, effect: Effect, pieces: Sequence[CvPiece]) -> EffectGain:
    objective = model.objective.with_effects((*model.effects, effect))
    starts = objective.parametrization.initial_values()
    fitted = fit_from_best_start(objective, model, starts, THRESHOLDS.search_iterations)
    held_out = [held_out_log_likelihood(cross_validate(one, pieces)) for one in (fitted, model)]
    gain, estimate = bic_score(fitted) - bic_score(model), model_estimate(fitted, white=fitted.is_white)
    beside = tuple(one.id for one in model.effects)
    return EffectGain(
        effect=effect, beside=beside, gain=gain, held_out_gain=held_out[0] - held_out[1], estimate=estimate
    )
