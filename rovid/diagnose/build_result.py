"""Result of the diagnosis from a validated selection: estimates, findings, suspects, scores, detectable sizes.

Sway that follows the turn and is not logged looks like water that remembers the turn. The sway v of a hull with its
centre of mass ahead or astern of the centre of its lateral drag obeys m22*dv/dt + d22*v = -m23*dr/dt, and its torque on
the turn is -m23*dv/dt (Fossen 2011, section 6.5). With w = r + v*m22/m23 both are the equations of `added_mass_memory`,
with Im = m23^2/m22 and τ = m22/d22; a quadratic drag gives those of its porous form. Without a logged sway no data
along the axis distinguish the two. Entrained swirl with a short memory is close to them.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import combinations
from types import MappingProxyType

import numpy as np

from rovid.core.errors import RovidError
from rovid.core.spmd import parallel_map
from rovid.diagnose.candidate_fits import Alternative, Cause
from rovid.diagnose.challenge import closest_challengers
from rovid.diagnose.cross_validation import held_out_log_likelihood, horizon_errors, position_floor, rate_floor
from rovid.diagnose.evidence import recalibrated, size_in_errors
from rovid.diagnose.result import Diagnosis, Finding, HorizonErrors, ModelAssessment
from rovid.diagnose.screening import ScoreTest, bic_penalty
from rovid.diagnose.selection import Selection
from rovid.diagnose.signal_regressors import is_signal
from rovid.diagnose.stated_selection import StatedSelection, is_established, model_estimate
from rovid.diagnose.stepwise import SearchStop
from rovid.diagnose.thresholds import THRESHOLDS
from rovid.diagnose.validation import Suspected
from rovid.effects import CATALOGUE, Effect, EffectParameter, effect_named
from rovid.effects.actuator_inputs import SPEEDS
from rovid.estimate.candidate_runs import RunLimits
from rovid.estimate.dataset import FitData, time_constant
from rovid.estimate.estimate import Estimate
from rovid.estimate.experiment_design import CandidateModel, ExperimentPlan, plan_experiment
from rovid.estimate.fit_result import FitResult
from rovid.estimate.maximum_likelihood import INNOVATIONS_R2, LikelihoodFit
from rovid.estimate.missing_torque import lacks_torque
from rovid.estimate.restart_grid import HORIZONS
from rovid.model.model import Model
from rovid.model.simulation import HORIZONS as HORIZON_SECONDS

_SWAY = effect_named("sideslip_moment:turning")
# Longest memory in time constants of the vehicle: sway and yaw of a hull decay within a factor of a few.
_LONGEST = _SWAY.parameters[1].high
# Id -> largest size, of the inertia or of the drag: a centre of mass 0.15 lengths from that of the lateral drag. On a
# slender hull of length L inertia and drag in yaw about that centre are L^2/12 of those in sway, and 0.15^2 is 0.27 of
# 1/12. Of drag, which does not vanish at rest, the share is 0.27/1.27.
_LARGEST = MappingProxyType({"added_mass_memory": 0.27, "entrained_swirl": 0.21})
_MULTI_STEP = (
    "The innovations are not white, or the disturbance is at its limit: one-step predictions are too noisy to find "
    "causes. So the diagnosis used predictions from half to eight time constants ahead. Gains are of their "
    "log-likelihood, with correlated errors counted once."
)
_CUT_SHORT = (
    "The search ended before it was complete, because each addition asked for another one. The effects found may stand "
    "in for other causes. More time does not help; further runs may."
)
OUT_OF_TIME = (
    "The budget of {:.0f} s was used up before the search came to its end. What was found is likely at most. Give a "
    "larger --budget, to `rovid open` as well."
)
_INCONSISTENT = (
    "{} improves multi-step predictions, but one-step predictions show less of it, as where commands respond to waves: "
    "it is not claimed."
)


def build_diagnosis(stated: StatedSelection, warnings: list[str]) -> Diagnosis:
    """Result from a validated selection as it is ``stated``; ``warnings`` grow."""
    selection, estimate = stated.selection, stated.estimate
    base, model = selection.full_data(selection.base), selection.full_data(selection.model)
    waves = _wave_finding(selection, stated.waves)
    with_waves = stated.waves if waves is not None and is_established(waves) else None
    warnings.extend((with_waves or stated).estimate.warnings)
    findings = [_finding(stated, cause) for cause in stated.causes if not is_signal(cause.effect)]
    signals = tuple((cause.effect, cause.bic_gain) for cause in stated.causes if is_signal(cause.effect))
    if model.at_limit:
        warnings.append(
            f"The remaining error asks for a disturbance above {100 * model.objective.limit:.2g} % of the torque in "
            "use: something is still missing, and it follows no other logged signal."
        )
    warnings.extend(dict.fromkeys(text for one in stated.suspected for text in one.failed.values()))
    possible = [_suspect_finding(selection, one) for one in stated.suspected]
    plain = base.model if stated.plain is None else stated.plain.model
    # The limit of the disturbance is that of the selected model: only then the held-out likelihoods are comparable.
    same_limit = selection.search.without_all(selection.model)
    # Without effects both models are one, as in `StatedSelection`.
    extended = assessed = _assess(selection, selection.base, plain, stated.base_estimate, same_limit)
    if model.effects:
        extended = _assess(selection, selection.model, model.model, estimate, selection.model)
    if waves is not None and is_established(waves):
        findings.append(waves)
        extended = _with_waves(extended, waves, with_waves)
    elif waves is not None:
        possible = sorted((*possible, waves), key=lambda one: -one.probability)
    poor = bool(signals) or model.at_limit or model.simulated_r2 < INNOVATIONS_R2
    leaves_unexplained, verdict = poor or _lacks_torque(selection, model), "nothing_found"
    if findings:
        verdict = "found"
    elif possible:
        verdict = "suspected"
    elif leaves_unexplained:
        verdict = "unexplained"
    disturbance, _ = model.disturbance
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
    return Diagnosis(
        verdict=verdict,
        base=assessed,
        extended=extended,
        findings=tuple(sorted(findings, key=lambda finding: -finding.gain)),
        suspects=tuple(possible),
        challengers=closest_challengers(selection),
        horizons=_horizon_errors(selection),
        signals=signals,
        unexplained_share=disturbance**2 / (disturbance**2 + selection.data.rms_torque**2),
        # Longer predictions were used because one-step ones do not determine the disturbance.
        noise_floor=math.nan if selection.multi_step else rate_floor(model),
        leaves_unexplained=leaves_unexplained,
        position_floors={} if selection.multi_step else {at: position_floor(model, at) for at in HORIZON_SECONDS},
        nested_models=_nested_models(selection, stated.causes),
        detectable=tuple(sizes),
        warnings=tuple(warnings),
        is_endless=SearchStop.CUT_SHORT in selection.search.progress.stops,
        fitted=None if model.data.means_only else CandidateModel.from_fit("the model", model, estimate.covariance),
    )


def search_warnings(selection: Selection, notes: Sequence[str]) -> list[str]:
    """Warnings about the search that selected the model; ``notes`` are those of one-step predictions."""
    # Drop the notes on trials cut into parts: multi-step predictions are of whole trials.
    warnings = [_MULTI_STEP] if selection.multi_step else list(notes)
    if SearchStop.CUT_SHORT in selection.search.progress.stops:
        warnings.append(_CUT_SHORT)
    elif selection.is_out_of_time:
        warnings.append(OUT_OF_TIME.format(selection.search.budget.seconds))
    warnings += [_INCONSISTENT.format(effect.title) for effect in selection.inconsistent]
    warnings += selection.messages
    return warnings


def _lacks_torque(selection: Selection, model: FitResult) -> bool:
    """Whether the one-step predictions of the ``model``, next to any disturbance and waves, still lack a torque."""
    if selection.waves is None:
        return not model.data.means_only and lacks_torque(model.canonical())
    return selection.waves.is_broad or lacks_torque(selection.waves.likelier)


def _assess(
    selection: Selection, searched: FitResult, model: Model, estimate: Estimate, comparable: FitResult
) -> ModelAssessment:
    """A ``model`` with held-out scores: simulations of the fit ``searched``, log-likelihood of ``comparable``."""
    simulated = selection.held_out_scores(searched)
    held_out = replace(simulated, log_likelihood=held_out_log_likelihood(selection.folds(comparable)))
    return ModelAssessment(model=model, estimate=estimate, held_out=held_out)


def _finding(stated: StatedSelection, cause: Cause) -> Finding:
    """Established cause, with the runs that distinguish it from others where that is open."""
    selection, effect = stated.selection, cause.effect
    held_out_gain = selection.held_out_gain(effect)
    others, white = selection.indistinguishable(cause), selection.model.is_white
    close = [one.fitted.with_last(one.effect) for one in cause.alternatives if one.effect in others]
    sway = indistinguishable_sway(selection.data, [selection.model.with_last(effect), *close])
    finding = replace(
        _unrivalled(selection, effect, stated.estimate, (cause.gain, cause.bic_gain, held_out_gain)),
        standard_errors=stated.size_in_errors(effect),
        probability=recalibrated(selection.probability(cause, held_out_gain), white=white),
        alternatives=cause.alternatives,
        indistinguishable=(*others, *sway, *_without_signal(selection, effect)),
        white=white,
    )
    return replace(finding, plan=_discriminating_plan(selection, finding)) if finding.indistinguishable else finding


def _unrivalled(
    selection: Selection,
    effect: Effect,
    estimate: Estimate,
    gains: tuple[float, float, float],
    probability: float = 0.0,
) -> Finding:
    """Finding of ``effect`` without alternatives, from the log-likelihood, BIC and held-out ``gains``."""
    own = estimate.only(effect.parameter_names)
    gain, bic_gain, held_out_gain = gains
    return Finding(
        effect=effect,
        estimate=own,
        gain=gain,
        bic_gain=bic_gain,
        held_out_gain=held_out_gain,
        standard_errors=size_in_errors(effect, own, selection.data.scales),
        probability=probability,
        alternatives=(),
        indistinguishable=(),
        is_complete=selection.is_complete,
    )


def _suspect_finding(selection: Selection, suspected: Suspected) -> Finding:
    """Suspect with its size in the model that it extends."""
    one, model = suspected.alternative, selection.model
    estimate = model_estimate(selection.full_data(one.fitted), white=False)
    others = [other.effect for other in suspected.others]
    sway = indistinguishable_sway(selection.data, [other.fitted for other in (one, *suspected.others)])
    excluded = {one.effect.id, *suspected.failed, *(effect.id for effect in selection.inconsistent)}
    gains = model.value - one.fitted.value, one.bic_gain, suspected.held_out_gain
    return replace(
        _unrivalled(selection, one.effect, estimate, gains, suspected.probability),
        alternatives=tuple(
            other for other in selection.search.further_causes(model) if other.effect.id not in excluded
        ),
        indistinguishable=(*others, *sway, *_without_signal(selection, one.effect)),
        white=model.is_white,
    )


def indistinguishable_sway(data: FitData, fits: Sequence[FitResult]) -> tuple[Effect, ...]:
    """Sway as a cause, if the last effect of one of ``fits`` is a memory that sway may be; else nothing."""
    vehicle = data.vehicle
    # A motor on a bench does not move sideways.
    turns_alone = vehicle is None or all(one.scale_key == "torque_constant" for one in vehicle.thrusters)
    is_logged = all(SPEEDS[1] in run.trial.extras for run in data.runs)
    is_tried = any(fitted.effects[-1].id == _SWAY.id for fitted in fits)
    if data.axis.name != "yaw" or turns_alone or is_logged or is_tried:
        return ()
    for fitted in fits:
        effect = fitted.effects[-1]
        if effect.id not in _LARGEST:
            continue
        size, time = fitted.effect_coordinates(effect)[:2]
        if effect.parameters[0].scale == "inertia":
            size *= fitted.data.scales.unit_size(effect.parameters[0]) / fitted.model.inertia
        if 0.0 < size <= _LARGEST[effect.id] and time <= _LONGEST:
            return (_SWAY,)
    return ()


def _wave_finding(selection: Selection, stated: LikelihoodFit | None = None) -> Finding | None:
    """Waves as a finding or suspect; None where they are improbable, or smaller than their standard error.

    Their size is that of the ``stated`` fit, or else that of the test.
    """
    waves = selection.waves
    if waves is None or waves.fitted is None or waves.probability < THRESHOLDS.possible:
        return None
    effect = waves.fitted.effects[-1]
    estimate = model_estimate(waves.fitted, white=False) if stated is None else stated.estimate
    gains = waves.gain, waves.bic_gain, waves.held_out_gain
    finding = _unrivalled(selection, effect, estimate, gains, waves.probability)
    return finding if finding.standard_errors >= THRESHOLDS.min_standard_errors_suspect else None


def _without_signal(selection: Selection, effect: Effect) -> tuple[Effect, ...]:
    """Effects that imitate ``effect`` and could not be tested, because a signal is not logged."""
    if not selection.multi_step:
        return ()
    tried, axis = {candidate.id for candidate in selection.search.candidates}, selection.data.axis.name
    untested = (other for other in CATALOGUE if other.needs and other.id not in tried and effect.id in other.rivals)
    return tuple(other for other in untested if not other.axes or axis in other.axes)


def _with_waves(side: ModelAssessment, waves: Finding, stated: LikelihoodFit | None) -> ModelAssessment:
    """``side`` with waves as a further effect, or as ``stated``; free-running simulations do not show waves."""
    from scipy import linalg

    if stated is not None:
        return replace(side, model=stated.model, estimate=stated.estimate)

    old, estimate, own = side.model, side.estimate, waves.estimate
    values = (*old.effect_values, *own.values.tolist())
    model = replace(old, effects=(*old.effects, waves.effect), effect_values=values)
    extended = replace(
        estimate,
        names=(*estimate.names, *own.names),
        values=np.concatenate((estimate.values, own.values)),
        covariance=linalg.block_diag(estimate.covariance, own.covariance),
    )
    return replace(side, model=model, estimate=extended)


def _horizon_errors(selection: Selection) -> tuple[HorizonErrors, ...]:
    """RMS position errors of base and selected model after half to eight time constants."""
    models = [(fitted, selection.folds(fitted)) for fitted in (selection.base, selection.model)]
    base, extended = parallel_map(lambda model: horizon_errors(*model, selection.pieces), models)
    constant = time_constant(selection.data.initial_model, selection.data.rms_rate)
    known = [at for at in range(len(HORIZONS)) if math.isfinite(base[at]) and math.isfinite(extended[at])]
    return tuple(
        HorizonErrors(seconds=HORIZONS[at] * constant, base=float(base[at]), extended=float(extended[at]))
        for at in known
    )


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
    except RovidError:
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
