"""From the models that a search ended with to what is said of them: estimates, findings, suspects."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.core.errors import DataError
from rovid.core.spmd import shared
from rovid.design.candidate_runs import Limits
from rovid.design.expected_information import Belief
from rovid.design.experiment_design import Plan, plan
from rovid.diagnose.bic import Cause, is_plausible, price_of_one, worth
from rovid.diagnose.cross_validation import errors_ahead, log_likelihood, simulate_folds
from rovid.diagnose.nested_models import models_between
from rovid.diagnose.noise_floor import position_floor, rate_floor
from rovid.diagnose.posterior import ESTABLISHED, POSSIBLE, calibrated
from rovid.diagnose.result import Ahead, Diagnosis, Finding, Side
from rovid.diagnose.score_test import Promise
from rovid.diagnose.signal_regressors import is_signal
from rovid.diagnose.validation import Suspected, Work, undecided
from rovid.diagnose.wave_test import Waves
from rovid.effects import CATALOGUE, Effect, EffectParameter
from rovid.estimate.estimate import Estimate
from rovid.estimate.fit_result import Fitted
from rovid.estimate.instrumental_variables import require_inertia
from rovid.estimate.maximum_likelihood import TRUSTED_R2
from rovid.estimate.misspecification import form_doubt
from rovid.estimate.multi_step_data import time_constant
from rovid.estimate.output_error import CERTAINTY
from rovid.estimate.restart_grid import HORIZONS
from rovid.model.parameter_names import without_form
from rovid.model.simulation import HORIZONS as SECONDS

# A model of another form that explains so much of what one explains is as good, where neither explains all.
_NEARLY = 0.9


def concluded(work: Work, causes: Sequence[Cause], warnings: list[str]) -> Diagnosis:
    """What is said of ``work``, whose final model has these ``causes``."""
    base, final, suspected = work.refined(work.base), work.refined(work.final), work.suspects()
    estimate = _across_forms(work, _estimate(final, white=final.is_white))
    base_estimate = _estimate(base, white=base.is_white)
    # What is missing makes one of them uncertain; where both are, the vehicle was not excited.
    require_inertia(min(base_estimate, estimate, key=_uncertainty), CERTAINTY)
    estimate = across_suspects(estimate.with_scale_doubt(final.scale_doubt), suspected)
    if not final.effects:
        base_estimate = estimate
    warnings.extend(estimate.warnings)
    named = [cause for cause in causes if not is_signal(cause.effect)]
    findings = [_planned(work, _finding(work, cause, estimate)) for cause in named]
    signals = tuple((cause.effect, cause.worth) for cause in causes if is_signal(cause.effect))
    at_limit = final.at_limit
    if at_limit:
        warnings.append(
            f"What is left would be a disturbance above {100 * final.misfit.limit:.2g} % of the torque in use: "
            "something is still missing, and it follows no other logged signal."
        )
    suspects = tuple(_suspect(work, one) for one in suspected)
    extended = _side(work, work.final, final, estimate, work.final)
    waves = _possible_waves(work)
    if waves is not None and waves.confidence >= ESTABLISHED:
        findings.append(waves)
        extended = _with_waves(extended, waves)
    elif waves is not None:
        suspects = tuple(sorted((*suspects, waves), key=lambda one: -one.confidence))
    unexplained = bool(signals) or at_limit or final.simulated_r2 < TRUSTED_R2
    disturbance, _ = final.disturbance
    return Diagnosis(
        verdict=_verdict(found=bool(findings), suspected=bool(suspects), unexplained=unexplained),
        base=_side(work, work.base, base, base_estimate, work.search.without_any(work.final)),
        extended=extended,
        findings=tuple(sorted(findings, key=lambda finding: -finding.gain)),
        suspects=suspects,
        horizons=_ahead_of(work),
        signals=signals,
        unexplained_share=disturbance**2 / (disturbance**2 + work.full.torque**2),
        noise_floor=rate_floor(final),
        position_floors={seconds: position_floor(final, seconds) for seconds in SECONDS},
        between=models_between(work, _simulated(causes)),
        detectable=_detectable(work),
        warnings=tuple(warnings),
    )


def _simulated(causes: Sequence[Cause]) -> list[Effect]:
    """What of ``causes`` a free-running simulation shows, the strongest first: a wave's phase nobody knows."""
    strongest = sorted(causes, key=lambda cause: -cause.gain)
    return [cause.effect for cause in strongest if not cause.effect.wave]


def _verdict(*, found: bool, suspected: bool, unexplained: bool) -> str:
    """The strongest of what can be said."""
    if found:
        return "found"
    if suspected:
        return "suspected"
    if unexplained:
        return "unexplained"
    return "nothing_found"


def _side(work: Work, quick: Fitted, fitted: Fitted, estimate: Estimate, fair: Fitted) -> Side:
    """``fair`` is the same model with as much disturbance as the other side has, for only such likelihoods compare."""
    simulated = simulate_folds(quick, work.folds(quick))
    held = replace(simulated, log_likelihood=log_likelihood(work.folds(fair)))
    return Side(model=fitted.model, estimate=estimate, held_out=held)


def _estimate(fitted: Fitted, *, white: bool) -> Estimate:
    fitted = fitted.canonical()
    names = fitted.model.names
    doubt, said = form_doubt(fitted)
    at = _of_vehicle(fitted)
    scatter = fitted.covariance(sandwich=not white) + doubt
    estimate = Estimate(
        names=tuple(names[k] for k in at),
        values=fitted.model.values[at],
        covariance=scatter[np.ix_(at, at)],
        axis=fitted.records.axis,
        method=fitted.misfit.method,
        samples=len(fitted.records.trial),
        warnings=tuple(said),
    )
    if not fitted.records.driven:
        return estimate.undriven()
    return estimate


def _of_vehicle(fitted: Fitted) -> list[int]:
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
        earned = worth(final) - worth(rest)
        for fit in search.in_place_of(final, effect):
            if not is_plausible(fit) or is_signal(fit.effects[-1]) or fit.key == final.key:
                continue
            alike = not white and worth(fit) - worth(rest) >= _NEARLY * earned
            likelier = min(worth(fit) - worth(final), 0.0)
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


def _moved(estimate: Estimate, fit: Fitted) -> FloatArray:
    """(p,) how far each parameter of ``estimate`` is elsewhere in ``fit``; zero where that has none like it."""
    model = fit.canonical().model
    there = dict(zip(_alike(model.names, fit.effects), model.values.tolist(), strict=True))
    here = zip(_alike(estimate.names, fit.effects), estimate.values.tolist(), strict=True)
    return np.array([there.get(name, value) - value for name, value in here])


def _alike(names: Sequence[str], effects: Sequence[Effect]) -> list[str]:
    """``names`` of parameters, those of forms that share an effect's parameters without the form."""
    apart = {effect.key for effect in effects if effect.each_thruster}
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
        worth=cause.worth,
        held_out_gain=held_out_gain,
        confidence=calibrated(work.confidence(cause, held_out_gain), white=work.final.is_white),
        rivals=cause.rivals,
        undecided=(*undecided(cause, work.margin(cause.worth)), *_untried(work, effect)),
    )


def _planned(work: Work, finding: Finding) -> Finding:
    """``finding`` with the runs that would tell it from its rivals, where it is not decided."""
    if not finding.undecided:
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
        gain=work.final.cost - rival.fitted.cost,
        worth=rival.worth,
        held_out_gain=suspected.held_out_gain,
        confidence=suspected.confidence,
        rivals=tuple(one for one in beside if one.effect is not rival.effect),
        undecided=(*others, *_untried(work, rival.effect)),
    )


def _possible_waves(work: Work) -> Finding | None:
    """What is said of waves; None where there is hardly a chance of any."""
    waves = work.waves
    if waves is None or waves.fitted is None or waves.confidence < POSSIBLE:
        return None
    return _waves(waves, waves.fitted)


def _waves(waves: Waves, fitted: Fitted) -> Finding:
    effect, estimate = fitted.effects[-1], _estimate(fitted, white=False)
    return Finding(
        effect=effect,
        estimate=_own(estimate, effect),
        gain=waves.gain,
        worth=waves.worth,
        held_out_gain=waves.held_out_gain,
        confidence=waves.confidence,
        rivals=(),
        undecided=(),
    )


def _own(estimate: Estimate, effect: Effect) -> Estimate:
    """Of the parameters of ``effect`` alone."""
    at = [estimate.names.index(f"{effect.key}.{parameter.name}") for parameter in effect.parameters]
    names, scatter = tuple(estimate.names[k] for k in at), estimate.covariance[np.ix_(at, at)]
    return replace(estimate, names=names, values=estimate.values[at], covariance=scatter)


def _with_waves(side: Side, waves: Finding) -> Side:
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


def _ahead_of(work: Work) -> tuple[Ahead, ...]:
    models = [(fitted, work.folds(fitted)) for fitted in (work.base, work.final)]
    base, extended = shared(lambda model: errors_ahead(*model, work.pieces), models)
    constant = time_constant(work.full.start, work.full.rate)
    ahead = []
    for horizon, one, other in zip(HORIZONS, base, extended, strict=True):
        if math.isfinite(one) and math.isfinite(other):
            ahead.append(Ahead(seconds=horizon * constant, base=float(one), extended=float(other)))
    return tuple(ahead)


def _telling(work: Work, finding: Finding) -> Plan | None:
    """Runs that would tell ``finding`` from its nearest rival; None where there is no such run."""
    nearest = finding.undecided[0]
    rival = next((one for one in finding.rivals if one.effect is nearest), None)
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
        beliefs.append(Belief.of(name, full, full.covariance(sandwich=False)))
    try:
        return plan(beliefs, vehicle, [run.trial for run in work.full.runs], Limits())
    except DataError:
        return None


def _detectable(work: Work) -> tuple[tuple[Effect, float], ...]:
    """Size of each effect not found that would have been seen, to first order."""
    plain: dict[str, Promise] = {}
    for promise in work.search.promised(work.final):
        if not is_signal(promise.effect):
            plain.setdefault(promise.effect.id, promise)
    sizes = []
    for promise in plain.values():
        size = promise.effect.parameters[0]
        if promise.power > 0.0 and not size.endless:
            sizes.append((promise.effect, _seen(work, promise, size)))
    return tuple(sizes)


def _seen(work: Work, promise: Promise, size: EffectParameter) -> float:
    """The least ``size`` that pays, in its unit; infinite where there is none so large."""
    price = price_of_one(work.final.misfit) * len(promise.effect.parameters)
    # What is gained grows with the square of the size.
    share = math.sqrt((work.search.threshold + price) / promise.power)
    seen = abs(share * (size.starts[0] - size.null))
    if seen > max(size.high - size.null, size.null - size.low):
        return math.inf
    return seen * work.full.scales.of(size)
