"""Result of the diagnosis from a validated selection: estimates, findings, suspects, scores, detectable sizes."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np

from rovid.core.errors import DataError
from rovid.core.spmd import parallel_map
from rovid.diagnose.candidate_fits import Alternative, Cause
from rovid.diagnose.challenge import closest_challengers
from rovid.diagnose.cross_validation import (
    held_out_log_likelihood,
    horizon_errors,
    position_floor,
    rate_floor,
    simulate_folds,
)
from rovid.diagnose.evidence import recalibrated, size_in_errors
from rovid.diagnose.hidden_sway import indistinguishable_sway
from rovid.diagnose.result import Diagnosis, Finding, HorizonErrors, ModelAssessment
from rovid.diagnose.screening import ScoreTest, bic_penalty
from rovid.diagnose.selection import Selection
from rovid.diagnose.signal_regressors import is_signal
from rovid.diagnose.stated_selection import StatedSelection, is_established, model_estimate
from rovid.diagnose.thresholds import THRESHOLDS
from rovid.diagnose.validation import Suspected
from rovid.effects import CATALOGUE, Effect, EffectParameter
from rovid.estimate.candidate_runs import RunLimits
from rovid.estimate.dataset import time_constant
from rovid.estimate.estimate import Estimate
from rovid.estimate.experiment_design import CandidateModel, ExperimentPlan, plan_experiment
from rovid.estimate.fit_result import FitResult
from rovid.estimate.maximum_likelihood import INNOVATIONS_R2
from rovid.estimate.missing_torque import lacks_torque
from rovid.estimate.restart_grid import HORIZONS
from rovid.model.model import Model
from rovid.model.simulation import HORIZONS as HORIZON_SECONDS


def build_diagnosis(stated: StatedSelection, warnings: list[str]) -> Diagnosis:
    """Result from a validated selection as it is ``stated``; ``warnings`` grow."""
    selection, causes, suspected = stated.selection, stated.causes, stated.suspected
    base, model = selection.full_data(selection.base), selection.full_data(selection.model)
    estimate, base_estimate = stated.estimate, stated.base_estimate
    warnings.extend(estimate.warnings)
    findings = [_finding(selection, cause, estimate) for cause in causes if not is_signal(cause.effect)]
    signals = tuple((cause.effect, cause.bic_gain) for cause in causes if is_signal(cause.effect))
    if model.at_limit:
        warnings.append(
            f"The remaining error asks for a disturbance above {100 * model.objective.limit:.2g} % of the torque in "
            "use: something is still missing, and it follows no other logged signal."
        )
    possible = [_suspect_finding(selection, one) for one in suspected]
    plain = base.model if stated.plain is None else stated.plain.model
    shown = model.model if model.effects else plain
    extended = _assess(selection, selection.model, shown, estimate, selection.model)
    waves = _wave_finding(selection)
    if waves is not None and is_established(waves):
        findings.append(waves)
        extended = _with_waves(extended, waves)
    elif waves is not None:
        possible = sorted((*possible, waves), key=lambda one: -one.probability)
    verdict = "nothing_found"
    if findings:
        verdict = "found"
    elif possible:
        verdict = "suspected"
    elif signals or model.at_limit or model.simulated_r2 < INNOVATIONS_R2 or _lacks_torque(selection, model):
        verdict = "unexplained"
    disturbance, _ = model.disturbance
    # The limit of the disturbance is that of the selected model: only then the held-out likelihoods are comparable.
    same_limit = selection.search.without_all(selection.model)
    # Smallest detectable size of each effect that was not found, to first order.
    first: dict[str, ScoreTest] = {}
    for test in selection.search.screen(selection.model):
        if not is_signal(test.effect):
            first.setdefault(test.effect.id, test)
    sizes = []
    for test in first.values():
        size = test.effect.parameters[0]
        if test.power > 0.0 and not size.neutral_at_infinity:
            sizes.append((test.effect, _detectable_size(selection, test, size)))
    detectable = tuple(sizes)
    return Diagnosis(
        verdict=verdict,
        base=_assess(selection, selection.base, plain, base_estimate, same_limit),
        extended=extended,
        findings=tuple(sorted(findings, key=lambda finding: -finding.gain)),
        suspects=tuple(possible),
        challengers=closest_challengers(selection),
        horizons=_horizon_errors(selection),
        signals=signals,
        unexplained_share=disturbance**2 / (disturbance**2 + selection.data.rms_torque**2),
        noise_floor=rate_floor(model),
        position_floors={} if selection.multi_step else {at: position_floor(model, at) for at in HORIZON_SECONDS},
        nested_models=_nested_models(selection, causes),
        detectable=detectable,
        warnings=tuple(warnings),
        fitted=None if model.data.means_only else CandidateModel.from_fit("the model", model, estimate.covariance),
    )


def _lacks_torque(selection: Selection, model: FitResult) -> bool:
    """Whether the one-step predictions of the ``model``, next to any disturbance and waves, still lack a torque."""
    if selection.waves is None:
        return not model.data.means_only and lacks_torque(model.canonical())
    return selection.waves.is_broad or lacks_torque(selection.waves.likelier)


def _assess(
    selection: Selection, searched: FitResult, model: Model, estimate: Estimate, comparable: FitResult
) -> ModelAssessment:
    """A ``model`` with held-out scores: simulations of the fit ``searched``, log-likelihood of ``comparable``."""
    simulated = simulate_folds(searched, selection.folds(searched))
    held_out = replace(simulated, log_likelihood=held_out_log_likelihood(selection.folds(comparable)))
    return ModelAssessment(model=model, estimate=estimate, held_out=held_out)


def _finding(selection: Selection, cause: Cause, estimate: Estimate) -> Finding:
    """Established cause, with the runs that distinguish it from others where that is open."""
    effect, held_out_gain = cause.effect, selection.held_out_gain(cause.effect)
    others = selection.indistinguishable(cause)
    close = [one.fitted.with_last(one.effect) for one in cause.alternatives if one.effect in others]
    sway = indistinguishable_sway(selection.data, [selection.model.with_last(effect), *close])
    probability, own = selection.probability(cause, held_out_gain), estimate.only(effect.parameter_names)
    finding = Finding(
        effect=effect,
        estimate=own,
        gain=cause.gain,
        bic_gain=cause.bic_gain,
        held_out_gain=held_out_gain,
        standard_errors=size_in_errors(effect, own.values, own.covariance, selection.data.scales),
        probability=recalibrated(probability, white=selection.model.is_white),
        alternatives=cause.alternatives,
        indistinguishable=(*others, *sway, *_without_signal(selection, effect)),
        white=selection.model.is_white,
        is_complete=selection.is_complete,
    )
    return replace(finding, plan=_discriminating_plan(selection, finding)) if finding.indistinguishable else finding


def _suspect_finding(selection: Selection, suspected: Suspected) -> Finding:
    """Suspect with its size in the model that it extends."""
    one, fitted = suspected.alternative, selection.full_data(suspected.alternative.fitted)
    own = model_estimate(fitted, white=False).only(one.effect.parameter_names)
    further = selection.search.further_causes(selection.model)
    others = [other.effect for other in suspected.others]
    sway = indistinguishable_sway(selection.data, [other.fitted for other in (one, *suspected.others)])
    excluded = {one.effect.id, *(effect.id for effect in selection.inconsistent)}
    return Finding(
        effect=one.effect,
        estimate=own,
        gain=selection.model.value - one.fitted.value,
        bic_gain=one.bic_gain,
        held_out_gain=suspected.held_out_gain,
        standard_errors=size_in_errors(one.effect, own.values, own.covariance, selection.data.scales),
        probability=suspected.probability,
        alternatives=tuple(other for other in further if other.effect.id not in excluded),
        indistinguishable=(*others, *sway, *_without_signal(selection, one.effect)),
        white=selection.model.is_white,
        is_complete=selection.is_complete,
    )


def _wave_finding(selection: Selection) -> Finding | None:
    """Waves as a finding or suspect; None where they are improbable, or smaller than their standard error."""
    waves = selection.waves
    if waves is None or waves.fitted is None or waves.probability < THRESHOLDS.possible:
        return None
    effect = waves.fitted.effects[-1]
    own = model_estimate(waves.fitted, white=False).only(effect.parameter_names)
    size = size_in_errors(effect, own.values, own.covariance, selection.data.scales)
    if size < THRESHOLDS.min_standard_errors_suspect:
        return None
    return Finding(
        effect=effect,
        estimate=own,
        gain=waves.gain,
        bic_gain=waves.bic_gain,
        held_out_gain=waves.held_out_gain,
        standard_errors=size,
        probability=waves.probability,
        alternatives=(),
        indistinguishable=(),
        is_complete=selection.is_complete,
    )


def _without_signal(selection: Selection, effect: Effect) -> tuple[Effect, ...]:
    """Effects that imitate ``effect`` and could not be tested, because a signal is not logged."""
    if not selection.multi_step:
        return ()
    tried = {candidate.id for candidate in selection.search.candidates}
    axis = selection.data.axis.name
    untested = []
    for other in CATALOGUE:
        imitates = effect.id in other.rivals and other.needs and other.id not in tried
        if imitates and (not other.axes or axis in other.axes):
            untested.append(other)
    return tuple(untested)


def _with_waves(side: ModelAssessment, waves: Finding) -> ModelAssessment:
    """``side`` with waves as a further effect; free-running simulations do not show waves."""
    from scipy import linalg

    model, estimate, own = side.model, side.estimate, waves.estimate
    effects = (*model.effects, waves.effect)
    values = (*model.effect_values, *own.values.tolist())
    extended = replace(
        estimate,
        names=(*estimate.names, *own.names),
        values=np.concatenate((estimate.values, own.values)),
        covariance=linalg.block_diag(estimate.covariance, own.covariance),
    )
    return replace(side, model=replace(model, effects=effects, effect_values=values), estimate=extended)


def _horizon_errors(selection: Selection) -> tuple[HorizonErrors, ...]:
    """RMS position errors of base and selected model after half to eight time constants."""
    models = [(fitted, selection.folds(fitted)) for fitted in (selection.base, selection.model)]
    base, extended = parallel_map(lambda model: horizon_errors(*model, selection.pieces), models)
    constant = time_constant(selection.data.initial_model, selection.data.rms_rate)
    errors = []
    for horizon, one, other in zip(HORIZONS, base, extended, strict=True):
        if math.isfinite(one) and math.isfinite(other):
            errors.append(HorizonErrors(seconds=horizon * constant, base=float(one), extended=float(other)))
    return tuple(errors)


def _discriminating_plan(selection: Selection, finding: Finding) -> ExperimentPlan | None:
    """Runs that distinguish ``finding`` from the nearest alternative; None without such runs."""
    nearest = finding.indistinguishable[0]
    alternative = next((one for one in finding.alternatives if one.effect is nearest), None)
    if not isinstance(alternative, Alternative):
        return None  # it was not tested, because its signal is not logged
    models = {finding.effect.title: selection.model, alternative.effect.title: alternative.fitted}
    if any(is_signal(effect) for fitted in models.values() for effect in fitted.effects):
        return None  # the signal in a future run is unknown
    vehicle = selection.data.vehicle
    assert vehicle is not None  # noqa: S101 - a diagnosis has one
    candidates = []
    for name, fitted in models.items():
        full = selection.full_data(fitted)
        candidates.append(CandidateModel.from_fit(name, full, full.covariance(sandwich=False)))
    try:
        return plan_experiment(candidates, vehicle, [run.trial for run in selection.data.runs], RunLimits())
    except DataError:
        return None


def subsets(effects: Sequence[Effect]) -> Iterator[tuple[Effect, ...]]:
    """All proper subsets of up to three effects; of more effects, the first one, the first two, and so on."""
    for count in range(1, len(effects)):
        if len(effects) <= THRESHOLDS.nested_model_causes:
            yield from combinations(effects, count)
        else:
            yield tuple(effects[:count])


def _nested_models(selection: Selection, causes: Sequence[Cause]) -> tuple[Model, ...]:
    """The selected model with subsets of its causes, refitted to all data; waves have no phase to simulate."""
    strongest = sorted(causes, key=lambda cause: -cause.gain)
    effects = [cause.effect for cause in strongest if not cause.effect.is_wave]
    nested = []
    for kept in subsets(effects):
        fitted = selection.model
        for effect in effects:
            if effect not in kept:
                fitted = selection.search.without(fitted, effect)
        nested.append(fitted)
    selection.fit_full_data(nested)
    return tuple(selection.full_data(fitted).model for fitted in nested)


def _detectable_size(selection: Selection, test: ScoreTest, size: EffectParameter) -> float:
    """Smallest size that would be added, in its unit; infinite where no size would be."""
    penalty = bic_penalty(selection.model.objective) * len(test.effect.parameters)
    # The gain grows with the square of the size.
    share = math.sqrt((selection.search.threshold + penalty) / test.power)
    least = abs(share * (size.initial_values[0] - size.neutral))
    if least > max(size.high - size.neutral, size.neutral - size.low):
        return math.inf
    return least * selection.data.scales.unit_size(size)
