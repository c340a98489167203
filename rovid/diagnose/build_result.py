"""Result of the diagnosis from a validated selection: estimates, findings, suspects, scores, detectable sizes."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.core.errors import DataError
from rovid.core.spmd import parallel_map
from rovid.diagnose.candidate_fits import Cause, bic_score, is_plausible
from rovid.diagnose.challenge import closest_challengers
from rovid.diagnose.cross_validation import (
    held_out_log_likelihood,
    horizon_errors,
    position_floor,
    rate_floor,
    simulate_folds,
)
from rovid.diagnose.posterior import recalibrated
from rovid.diagnose.result import Diagnosis, Finding, HorizonErrors, ModelAssessment
from rovid.diagnose.score_test import ScoreTest, bic_penalty
from rovid.diagnose.selection import Selection
from rovid.diagnose.signal_regressors import is_signal
from rovid.diagnose.thresholds import THRESHOLDS
from rovid.diagnose.validation import Suspected, suspects
from rovid.effects import CATALOGUE, Effect, EffectParameter
from rovid.estimate.candidate_runs import RunLimits
from rovid.estimate.dataset import time_constant
from rovid.estimate.estimate import Estimate
from rovid.estimate.experiment_design import CandidateModel, ExperimentPlan, plan_experiment
from rovid.estimate.fit_result import FitResult
from rovid.estimate.instrumental_variables import require_inertia
from rovid.estimate.maximum_likelihood import INNOVATIONS_R2, misspecification_covariance
from rovid.estimate.missing_torque import include_missing_torque
from rovid.estimate.output_error import MIN_INERTIA_SIGMAS
from rovid.estimate.restart_grid import HORIZONS
from rovid.model.model import Model
from rovid.model.parameter_names import without_form
from rovid.model.simulation import HORIZONS as HORIZON_SECONDS


def build_diagnosis(selection: Selection, warnings: list[str]) -> Diagnosis:
    """Result from a validated ``selection``; ``warnings`` grow.

    Raises
    ------
    DataError
        The inertia is not determined.
    """
    causes = [selection.cause(effect) for effect in selection.model.effects]
    base, model, suspected = (
        selection.full_data(selection.base),
        selection.full_data(selection.model),
        suspects(selection),
    )
    estimate = _average_over_forms(selection, _estimate(model, white=model.is_white))
    base_estimate = _estimate(base, white=base.is_white)
    # Missing effects make one of the estimates uncertain; where both are, the vehicle was not excited.
    surer = min(base_estimate, estimate, key=lambda one: one.standard_error("inertia") / one.value("inertia"))
    require_inertia(surer, MIN_INERTIA_SIGMAS)
    estimate = include_missing_torque(estimate, model.canonical())
    base_estimate = include_missing_torque(base_estimate, base.canonical()) if model.effects else estimate
    estimate = average_over_suspects(estimate.with_thrust_scale_uncertainty(model.thrust_scale_uncertainty), suspected)
    if not model.effects:
        base_estimate = estimate
    warnings.extend(estimate.warnings)
    findings = [_finding(selection, cause, estimate) for cause in causes if not is_signal(cause.effect)]
    signals = tuple((cause.effect, cause.bic_gain) for cause in causes if is_signal(cause.effect))
    if model.at_limit:
        warnings.append(
            f"The remaining error asks for a disturbance above {100 * model.objective.limit:.2g} % of the torque in "
            "use: something is still missing, and it follows no other logged signal."
        )
    possible = [_suspect_finding(selection, one) for one in suspected]
    extended = _assess(selection, selection.model, model, estimate, selection.model)
    waves = _wave_finding(selection)
    if waves is not None and waves.probability >= THRESHOLDS.established:
        findings.append(waves)
        extended = _with_waves(extended, waves)
    elif waves is not None:
        possible = sorted((*possible, waves), key=lambda one: -one.probability)
    verdict = "nothing_found"
    if findings:
        verdict = "found"
    elif possible:
        verdict = "suspected"
    elif signals or model.at_limit or model.simulated_r2 < INNOVATIONS_R2:
        verdict = "unexplained"
    disturbance, _ = model.disturbance
    # The limit of the disturbance is that of the selected model: only then the held-out likelihoods are comparable.
    same_limit = selection.search.without_all(selection.model)
    return Diagnosis(
        verdict=verdict,
        base=_assess(selection, selection.base, base, base_estimate, same_limit),
        extended=extended,
        findings=tuple(sorted(findings, key=lambda finding: -finding.gain)),
        suspects=tuple(possible),
        challengers=closest_challengers(selection),
        horizons=_horizon_errors(selection),
        signals=signals,
        unexplained_share=disturbance**2 / (disturbance**2 + selection.data.rms_torque**2),
        noise_floor=rate_floor(model),
        position_floors={seconds: position_floor(model, seconds) for seconds in HORIZON_SECONDS},
        nested_models=_nested_models(selection, causes),
        detectable=_detectable(selection),
        warnings=tuple(warnings),
    )


def _assess(
    selection: Selection, searched: FitResult, full: FitResult, estimate: Estimate, comparable: FitResult
) -> ModelAssessment:
    """Held-out scores of a model: simulations of the model ``searched``, log-likelihood of the model ``comparable``."""
    simulated = simulate_folds(searched, selection.folds(searched))
    held_out = replace(simulated, log_likelihood=held_out_log_likelihood(selection.folds(comparable)))
    return ModelAssessment(model=full.model, estimate=estimate, held_out=held_out)


def _estimate(fitted: FitResult, *, white: bool) -> Estimate:
    """Parameters of the vehicle with their covariance; coefficients of signal regressors are left out."""
    fitted = fitted.canonical()
    names = fitted.model.names
    added, warnings = misspecification_covariance(fitted)
    signals = {effect.key for effect in fitted.effects if is_signal(effect)}
    at = [k for k, name in enumerate(names) if _effect_key(name) not in signals]
    covariance = fitted.covariance(sandwich=not white) + added
    estimate = Estimate(
        names=tuple(names[k] for k in at),
        values=fitted.model.values[at],
        covariance=covariance[np.ix_(at, at)],
        axis=fitted.data.axis,
        method=fitted.objective.method,
        samples=len(fitted.data.run_index),
        warnings=tuple(warnings),
    )
    return estimate if fitted.data.has_actuators else estimate.normalised_by_inertia()


def _average_over_forms(selection: Selection, estimate: Estimate) -> Estimate:
    """Add to the covariance that between models with another form or effect (Hoeting et al. 1999).

    The weights follow from the likelihoods where the innovations are white. Otherwise no form is exact, and all models
    that gain nearly as much have equal weight.
    """
    model, search = selection.model, selection.search
    deviations, weights = [], []
    for effect in model.effects:
        rest = search.without(model, effect)
        gain = bic_score(model) - bic_score(rest)
        for fitted in search.replacements(model, effect):
            if not is_plausible(fitted) or is_signal(fitted.effects[-1]) or fitted.key == model.key:
                continue
            weight = math.exp(min(bic_score(fitted) - bic_score(model), 0.0))
            if not model.is_white and bic_score(fitted) - bic_score(rest) >= THRESHOLDS.equivalent_form_share * gain:
                weight = 1.0
            weights.append(weight)
            deviations.append(_deviation(estimate, fitted))
    away = np.array(deviations).reshape(-1, len(estimate.names))
    share = np.array(weights) / (1.0 + sum(weights))
    return replace(estimate, covariance=estimate.covariance + _between(away, share))


def average_over_suspects(estimate: Estimate, suspected: Sequence[Suspected]) -> Estimate:
    """Add to the covariance that between the model and models with a suspect, by their probabilities."""
    if not suspected:
        return estimate
    probabilities = np.array([one.probability for one in suspected])
    away = np.array([_deviation(estimate, one.alternative.fitted) for one in suspected])
    share = probabilities / max(1.0, float(probabilities.sum()))
    names = " or ".join(dict.fromkeys(one.alternative.effect.title for one in suspected))
    return replace(
        estimate,
        covariance=estimate.covariance + _between(away, share),
        warnings=(*estimate.warnings, f"The standard errors include what {names} would change, if it acts."),
    )


def _between(away: FloatArray, share: FloatArray) -> FloatArray:
    """(p, p) covariance between models with (m, p) deviations and (m,) probabilities."""
    return np.asarray(away.T @ (away * share[:, np.newaxis]))


def _deviation(estimate: Estimate, fitted: FitResult) -> FloatArray:
    """(p,) difference of each parameter between ``fitted`` and ``estimate``; zero without a common parameter."""
    model = fitted.canonical().model
    there = dict(zip(_common_names(model.names, fitted.effects), model.values.tolist(), strict=True))
    here = zip(_common_names(estimate.names, fitted.effects), estimate.values.tolist(), strict=True)
    return np.array([there.get(name, value) - value for name, value in here])


def _common_names(names: Sequence[str], effects: Sequence[Effect]) -> list[str]:
    """Parameter names without the form where all forms of an effect share the parameter."""
    specific = {effect.key for effect in effects if effect.per_thruster}
    return [name if _effect_key(name) in specific else without_form(name) for name in names]


def _effect_key(name: str) -> str:
    """Key of the effect in a parameter name; empty for a parameter of the base model."""
    key, _, _ = name.rpartition(".")
    return key


def _finding(selection: Selection, cause: Cause, estimate: Estimate) -> Finding:
    """Established cause, with the runs that distinguish it from others where that is open."""
    effect, held_out_gain = cause.effect, selection.held_out_gain(cause.effect)
    probability, own = selection.probability(cause, held_out_gain), _of_effect(estimate, effect)
    finding = Finding(
        effect=effect,
        estimate=own,
        gain=cause.gain,
        bic_gain=cause.bic_gain,
        held_out_gain=held_out_gain,
        standard_errors=_size_in_errors(selection, effect, own),
        probability=recalibrated(probability, white=selection.model.is_white),
        alternatives=cause.alternatives,
        indistinguishable=(*selection.indistinguishable(cause), *_without_signal(selection, effect)),
        white=selection.model.is_white,
        is_complete=selection.is_complete,
    )
    return replace(finding, plan=_discriminating_plan(selection, finding)) if finding.indistinguishable else finding


def _suspect_finding(selection: Selection, suspected: Suspected) -> Finding:
    """Suspect with its size in the model that it extends."""
    one, fitted = suspected.alternative, selection.full_data(suspected.alternative.fitted)
    own = _of_effect(_estimate(fitted, white=False), one.effect)
    further = selection.search.further_causes(selection.model)
    others = [other.effect for other in suspected.others]
    excluded = {one.effect.id, *(effect.id for effect in selection.inconsistent)}
    return Finding(
        effect=one.effect,
        estimate=own,
        gain=selection.model.value - one.fitted.value,
        bic_gain=one.bic_gain,
        held_out_gain=suspected.held_out_gain,
        standard_errors=_size_in_errors(selection, one.effect, own),
        probability=suspected.probability,
        alternatives=tuple(other for other in further if other.effect.id not in excluded),
        indistinguishable=(*others, *_without_signal(selection, one.effect)),
        white=selection.model.is_white,
        is_complete=selection.is_complete,
    )


def _wave_finding(selection: Selection) -> Finding | None:
    """Waves as a finding or suspect; None where they are improbable."""
    waves = selection.waves
    if waves is None or waves.fitted is None or waves.probability < THRESHOLDS.possible:
        return None
    effect = waves.fitted.effects[-1]
    own = _of_effect(_estimate(waves.fitted, white=False), effect)
    return Finding(
        effect=effect,
        estimate=own,
        gain=waves.gain,
        bic_gain=waves.bic_gain,
        held_out_gain=waves.held_out_gain,
        standard_errors=_size_in_errors(selection, effect, own),
        probability=waves.probability,
        alternatives=(),
        indistinguishable=(),
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


def _of_effect(estimate: Estimate, effect: Effect) -> Estimate:
    """The parameters of ``effect`` alone."""
    at = [estimate.names.index(f"{effect.key}.{parameter.name}") for parameter in effect.parameters]
    names, covariance = tuple(estimate.names[k] for k in at), estimate.covariance[np.ix_(at, at)]
    return replace(estimate, names=names, values=estimate.values[at], covariance=covariance)


def _size_in_errors(selection: Selection, effect: Effect, own: Estimate) -> float:
    """Mahalanobis distance of the sizes of ``effect``, with the estimate ``own``, from their neutral values."""
    sizes, scales = effect.parameters[: effect.size_count], selection.data.scales
    # A size whose neutral value is infinite is as far from it, in errors, as from zero.
    neutral = [0.0 if size.neutral_at_infinity else size.neutral * scales.unit_size(size) for size in sizes]
    away = own.values[: len(sizes)] - neutral
    covariance = own.covariance[: len(sizes), : len(sizes)]
    return math.sqrt(max(float(away @ np.linalg.lstsq(covariance, away, rcond=None)[0]), 0.0))


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
    if alternative is None:
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


def _detectable(selection: Selection) -> tuple[tuple[Effect, float], ...]:
    """Smallest detectable size of each effect that was not found, to first order."""
    first: dict[str, ScoreTest] = {}
    for test in selection.search.screen(selection.model):
        if not is_signal(test.effect):
            first.setdefault(test.effect.id, test)
    sizes = []
    for test in first.values():
        size = test.effect.parameters[0]
        if test.power > 0.0 and not size.neutral_at_infinity:
            sizes.append((test.effect, _detectable_size(selection, test, size)))
    return tuple(sizes)


def _detectable_size(selection: Selection, test: ScoreTest, size: EffectParameter) -> float:
    """Smallest size that would be added, in its unit; infinite where no size would be."""
    penalty = bic_penalty(selection.model.objective) * len(test.effect.parameters)
    # The gain grows with the square of the size.
    share = math.sqrt((selection.search.threshold + penalty) / test.power)
    least = abs(share * (size.initial_values[0] - size.neutral))
    if least > max(size.high - size.neutral, size.neutral - size.low):
        return math.inf
    return least * selection.data.scales.unit_size(size)
