"""From the models that a search ended with to what is said of them: estimates, findings, suspects."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.core.errors import DataError
from rovid.core.spmd import parallel_map
from rovid.design.candidate_runs import RunLimits
from rovid.design.expected_information import CandidateModel
from rovid.design.experiment_design import ExperimentPlan, plan_experiment
from rovid.diagnose.bic import Cause, bic_penalty, bic_score, is_plausible
from rovid.diagnose.cross_validation import held_out_log_likelihood, horizon_errors, simulate_folds
from rovid.diagnose.nested_models import nested_models
from rovid.diagnose.noise_floor import position_floor, rate_floor
from rovid.diagnose.posterior import ESTABLISHED, POSSIBLE, recalibrated
from rovid.diagnose.result import Diagnosis, Finding, HorizonErrors, ModelAssessment
from rovid.diagnose.score_test import ScoreTest
from rovid.diagnose.signal_regressors import is_signal
from rovid.diagnose.validation import Suspected, Work, undecided
from rovid.diagnose.wave_test import WaveTest
from rovid.effects import CATALOGUE, Effect, EffectParameter
from rovid.estimate.estimate import Estimate
from rovid.estimate.fit_result import FitResult
from rovid.estimate.instrumental_variables import require_inertia
from rovid.estimate.maximum_likelihood import INNOVATIONS_R2
from rovid.estimate.maximum_likelihood import misspecification_covariance
from rovid.estimate.multi_step_data import time_constant
from rovid.estimate.output_error import MIN_INERTIA_SIGMAS
from rovid.estimate.restart_grid import HORIZONS
from rovid.model.parameter_names import without_form
from rovid.model.simulation import HORIZONS as SECONDS

# A model of another form that explains so much of what one explains is as good, where neither explains all.
_NEARLY = 0.9


def build_diagnosis(work: Work, causes: Sequence[Cause], warnings: list[str]) -> Diagnosis:
    """What is said of ``work``, whose final model has these ``causes``."""
    base, final, suspected = work.refined(work.base), work.refined(work.final), work.suspects()
    estimate = _across_forms(work, _estimate(final, white=final.is_white))
    base_estimate = _estimate(base, white=base.is_white)
    # What is missing makes one of them uncertain; where both are, the vehicle was not excited.
    require_inertia(min(base_estimate, estimate, key=_uncertainty), MIN_INERTIA_SIGMAS)
    estimate = across_suspects(estimate.with_thrust_scale_uncertainty(final.thrust_scale_uncertainty), suspected)
    if not final.effects:
        base_estimate = estimate
    warnings.extend(estimate.warnings)
    named = [cause for cause in causes if not is_signal(cause.effect)]
    findings = [_planned(work, _finding(work, cause, estimate)) for cause in named]
    signals = tuple((cause.effect, cause.bic_gain) for cause in causes if is_signal(cause.effect))
    at_limit = final.at_limit
    if at_limit:
        warnings.append(
            f"What is left would be a disturbance above {100 * final.objective.limit:.2g} % of the torque in use: "
            "something is still missing, and it follows no other logged signal."
        )
    suspects = tuple(_suspect(work, one) for one in suspected)
    extended = _side(work, work.final, final, estimate, work.final)
    waves = _possible_waves(work)
    if waves is not None and waves.probability >= ESTABLISHED:
        findings.append(waves)
        extended = _with_waves(extended, waves)
    elif waves is not None:
        suspects = tuple(sorted((*suspects, waves), key=lambda one: -one.probability))
    unexplained = bool(signals) or at_limit or final.simulated_r2 < INNOVATIONS_R2
    disturbance, _ = final.disturbance
    return Diagnosis(
        verdict=_verdict(found=bool(findings), suspected=bool(suspects), unexplained=unexplained),
        base=_side(work, work.base, base, base_estimate, work.search.without_any(work.final)),
        extended=extended,
        findings=tuple(sorted(findings, key=lambda finding: -finding.gain)),
        suspects=suspects,
        horizons=_ahead_of(work),
        signals=signals,
        unexplained_share=disturbance**2 / (disturbance**2 + work.full.rms_torque**2),
        noise_floor=rate_floor(final),
        position_floors={seconds: position_floor(final, seconds) for seconds in SECONDS},
        nested_models=nested_models(work, _simulated(causes)),
        detectable=_detectable(work),
        warnings=tuple(warnings),
    )


def _simulated(causes: Sequence[Cause]) -> list[Effect]:
    """What of ``causes`` a free-running simulation shows, the strongest first: a wave's phase nobody knows."""
    strongest = sorted(causes, key=lambda cause: -cause.gain)
    return [cause.effect for cause in strongest if not cause.effect.is_wave]


def _verdict(*, found: bool, suspected: bool, unexplained: bool) -> str:
    """The strongest of what can be said."""
    if found:
        return "found"
    if suspected:
        return "suspected"
    if unexplained:
        return "unexplained"
    return "nothing_found"


def _side(work: Work, quick: FitResult, fitted: FitResult, estimate: Estimate, fair: FitResult) -> ModelAssessment:
    """``fair`` is the same model with as much disturbance as the other side has, for only such likelihoods compare."""
    simulated = simulate_folds(quick, work.folds(quick))
    held = replace(simulated, log_likelihood=held_out_log_likelihood(work.folds(fair)))
    return ModelAssessment(model=fitted.model, estimate=estimate, held_out=held)


def _estimate(fitted: FitResult, *, white: bool) -> Estimate:
    fitted = fitted.canonical()
    names = fitted.model.names
    doubt, said = misspecification_covariance(fitted)
    at = _of_vehicle(fitted)
    scatter = fitted.covariance(sandwich=not white) + doubt
    estimate = Estimate(
        names=tuple(names[k] for k in at),
        values=fitted.model.values[at],
        covariance=scatter[np.ix_(at, at)],
        axis=fitted.data.axis,
        method=fitted.objective.method,
        samples=len(fitted.data.run_index),
        warnings=tuple(said),
    )
    if not fitted.data.has_actuators:
        return estimate.undriven()
    return estimate


def _of_vehicle(fitted: FitResult) -> list[int]:
    """Places of the vehicle's parameters; what follows a signal is a dependence, and none of them."""
    signals = {effect.key for effect in fitted.effects if is_signal(effect)}
    return [k for k, name in enumerate(fitted.model.names) if _key_of(name) not in signals]


def _across_forms(work: Work, estimate: Estimate) -> Estimate:
    """``estimate`` with what models nearly as good, of another form or cause each, say of its parameters besides.

    To the variance comes that between the models (Hoeting et al. 1999). Each has its weight by the likelihood where the
    innovations are white; else none is nature's form, and all that explain nearly as much have the same weight.
    """
    final, search = work.final, work.search
    white = final.is_white
    moved, weights = [], []
    for effect in final.effects:
        rest = search.without(final, effect)
        earned = bic_score(final) - bic_score(rest)
        for fit in search.in_place_of(final, effect):
            if not is_plausible(fit) or is_signal(fit.effects[-1]) or fit.key == final.key:
                continue
            alike = not white and bic_score(fit) - bic_score(rest) >= _NEARLY * earned
            likelier = min(bic_score(fit) - bic_score(final), 0.0)
            weights.append(1.0 if alike else math.exp(likelier))
            moved.append(_moved(estimate, fit))
    off, share = np.array(moved).reshape(-1, len(estimate.names)), np.array(weights) / (1.0 + sum(weights))
    return replace(estimate, covariance=estimate.covariance + _between(off, share))


def across_suspects(estimate: Estimate, suspected: Sequence[Suspected]) -> Estimate:
    """``estimate`` with what it would be, were a suspect established: by its odds that comes to the variance too.

    As in `_across_forms`, about the model that is kept (Hoeting et al. 1999).
    """
    if not suspected:
        return estimate
    odds = np.array([one.confidence for one in suspected])
    off = np.array([_moved(estimate, one.rival.fitted) for one in suspected])
    share = odds / max(1.0, float(odds.sum()))
    names = " or ".join(dict.fromkeys(one.rival.effect.title for one in suspected))
    return replace(
        estimate,
        covariance=estimate.covariance + _between(off, share),
        warnings=(*estimate.warnings, f"The standard errors include what {names} would change, if it acts."),
    )


def _between(off: FloatArray, share: FloatArray) -> FloatArray:
    """(p, p) covariance about a model of others that are (m, p) ``off`` it and have such (m,) shares in the odds."""
    return np.asarray(off.T @ (off * share[:, np.newaxis]))


def _moved(estimate: Estimate, fit: FitResult) -> FloatArray:
    """(p,) how far each parameter of ``estimate`` is elsewhere in ``fit``; zero where that has none like it."""
    model = fit.canonical().model
    there = dict(zip(_alike(model.names, fit.effects), model.values.tolist(), strict=True))
    here = zip(_alike(estimate.names, fit.effects), estimate.values.tolist(), strict=True)
    return np.array([there.get(name, value) - value for name, value in here])


def _alike(names: Sequence[str], effects: Sequence[Effect]) -> list[str]:
    """``names`` of parameters, those of forms that share an effect's parameters without the form."""
    apart = {effect.key for effect in effects if effect.per_thruster}
    return [name if _key_of(name) in apart else without_form(name) for name in names]


def _key_of(name: str) -> str:
    """Of the effect whose parameter has this ``name``; empty of one that every model has."""
    key, _, _ = name.rpartition(".")
    return key


def _uncertainty(estimate: Estimate) -> float:
    """Relative standard error of the inertia."""
    return estimate.standard_error("inertia") / estimate.value("inertia")


def _untried(work: Work, effect: Effect) -> tuple[Effect, ...]:
    """Causes that pass for ``effect`` and that no log tells of, where not all is explained."""
    if not work.by_horizons:
        return ()
    tried = {candidate.id for candidate in work.search.candidates}
    axis = work.full.axis.name
    untried = []
    for other in CATALOGUE:
        passes = effect.id in other.rivals and other.needs and other.id not in tried
        if passes and (not other.axes or axis in other.axes):
            untried.append(other)
    return tuple(untried)


def _finding(work: Work, cause: Cause, estimate: Estimate) -> Finding:
    effect, held_out_gain = cause.effect, work.held_out_gain(cause.effect)
    return Finding(
        effect=effect,
        estimate=_own(estimate, effect),
        gain=cause.gain,
        bic_gain=cause.bic_gain,
        held_out_gain=held_out_gain,
        probability=recalibrated(work.confidence(cause, held_out_gain), white=work.final.is_white),
        alternatives=cause.alternatives,
        indistinguishable=(*undecided(cause, work.margin(cause.bic_gain)), *_untried(work, effect)),
    )


def _planned(work: Work, finding: Finding) -> Finding:
    """``finding`` with the runs that would tell it from its rivals, where it is not decided."""
    if not finding.indistinguishable:
        return finding
    return replace(finding, plan=_telling(work, finding))


def _suspect(work: Work, suspected: Suspected) -> Finding:
    """What is said of a cause that is not established: its size where it is put in beside the final model."""
    rival, fitted = suspected.rival, work.refined(suspected.rival.fitted)
    estimate = _estimate(fitted, white=False)
    beside = work.search.candidates_beside(work.final)
    others = [other.effect for other in suspected.others]
    return Finding(
        effect=rival.effect,
        estimate=_own(estimate, rival.effect),
        gain=work.final.value - rival.fitted.value,
        bic_gain=rival.bic_gain,
        held_out_gain=suspected.held_out_gain,
        probability=suspected.confidence,
        alternatives=tuple(one for one in beside if one.effect is not rival.effect),
        indistinguishable=(*others, *_untried(work, rival.effect)),
    )


def _possible_waves(work: Work) -> Finding | None:
    """What is said of waves; None where there is hardly a chance of any."""
    waves = work.waves
    if waves is None or waves.fitted is None or waves.confidence < POSSIBLE:
        return None
    return _waves(waves, waves.fitted)


def _waves(waves: WaveTest, fitted: FitResult) -> Finding:
    effect, estimate = fitted.effects[-1], _estimate(fitted, white=False)
    return Finding(
        effect=effect,
        estimate=_own(estimate, effect),
        gain=waves.gain,
        bic_gain=waves.worth,
        held_out_gain=waves.held_out_gain,
        probability=waves.confidence,
        alternatives=(),
        indistinguishable=(),
    )


def _own(estimate: Estimate, effect: Effect) -> Estimate:
    """Of the parameters of ``effect`` alone."""
    at = [estimate.names.index(f"{effect.key}.{parameter.name}") for parameter in effect.parameters]
    names, scatter = tuple(estimate.names[k] for k in at), estimate.covariance[np.ix_(at, at)]
    return replace(estimate, names=names, values=estimate.values[at], covariance=scatter)


def _with_waves(side: ModelAssessment, waves: Finding) -> ModelAssessment:
    """``side`` with waves, which no free-running simulation shows, beside all else."""
    from scipy import linalg

    model, estimate, own = side.model, side.estimate, waves.estimate
    effects = (*model.effects, waves.effect)
    values = (*model.effect_values, *own.values.tolist())
    return replace(
        side,
        model=replace(model, effects=effects, effect_values=values),
        estimate=replace(
            estimate,
            names=(*estimate.names, *own.names),
            values=np.concatenate((estimate.values, own.values)),
            covariance=linalg.block_diag(estimate.covariance, own.covariance),
        ),
    )


def _ahead_of(work: Work) -> tuple[HorizonErrors, ...]:
    models = [(fitted, work.folds(fitted)) for fitted in (work.base, work.final)]
    base, extended = parallel_map(lambda model: horizon_errors(*model, work.pieces), models)
    constant = time_constant(work.full.initial_model, work.full.rms_rate)
    ahead = []
    for horizon, one, other in zip(HORIZONS, base, extended, strict=True):
        if math.isfinite(one) and math.isfinite(other):
            ahead.append(HorizonErrors(seconds=horizon * constant, base=float(one), extended=float(other)))
    return tuple(ahead)


def _telling(work: Work, finding: Finding) -> ExperimentPlan | None:
    """Runs that would tell ``finding`` from its nearest rival; None where there is no such run."""
    nearest = finding.indistinguishable[0]
    rival = next((one for one in finding.alternatives if one.effect is nearest), None)
    if rival is None:
        return None  # it could not be tried: no run tells without its signal
    models = {finding.effect.title: work.final, rival.effect.title: rival.fitted}
    if any(is_signal(effect) for fitted in models.values() for effect in fitted.effects):
        return None  # nobody knows what the signal will be
    vehicle = work.full.vehicle
    assert vehicle is not None  # noqa: S101 - a diagnosis has one
    beliefs = []
    for name, fitted in models.items():
        full = work.refined(fitted)
        beliefs.append(CandidateModel.from_fit(name, full, full.covariance(sandwich=False)))
    try:
        return plan_experiment(beliefs, vehicle, [run.trial for run in work.full.runs], RunLimits())
    except DataError:
        return None


def _detectable(work: Work) -> tuple[tuple[Effect, float], ...]:
    """Size of each effect not found that would have been seen, to first order."""
    plain: dict[str, ScoreTest] = {}
    for promise in work.search.score_tests(work.final):
        if not is_signal(promise.effect):
            plain.setdefault(promise.effect.id, promise)
    sizes = []
    for promise in plain.values():
        size = promise.effect.parameters[0]
        if promise.power > 0.0 and not size.neutral_at_infinity:
            sizes.append((promise.effect, _seen(work, promise, size)))
    return tuple(sizes)


def _seen(work: Work, promise: ScoreTest, size: EffectParameter) -> float:
    """The least ``size`` that pays, in its unit; infinite where there is none so large."""
    price = bic_penalty(work.final.objective) * len(promise.effect.parameters)
    # What is gained grows with the square of the size.
    share = math.sqrt((work.search.threshold + price) / promise.power)
    seen = abs(share * (size.initial_values[0] - size.neutral))
    if seen > max(size.high - size.neutral, size.neutral - size.low):
        return math.inf
    return seen * work.full.scales.unit_size(size)
