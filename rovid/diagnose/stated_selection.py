"""What is stated of a selected model: its parameters with all errors, and which of its causes these errors allow.

Validation tests the size of a cause by the error of its fit. The error that is stated also includes other forms,
suspects, and torques that the model lacks: `state` drops what differs too little from nothing by that error.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.core.errors import DataError
from rovid.diagnose.candidate_fits import Cause, bic_score, is_plausible
from rovid.diagnose.evidence import size_in_errors
from rovid.diagnose.result import Finding
from rovid.diagnose.selection import Selection
from rovid.diagnose.signal_regressors import is_signal
from rovid.diagnose.thresholds import THRESHOLDS
from rovid.diagnose.validation import Suspected, drop_likely, suspects
from rovid.effects import Effect
from rovid.effects.base import canonical_phases
from rovid.estimate.estimate import Estimate
from rovid.estimate.fit_result import FitResult
from rovid.estimate.innovation_likelihood import InnovationLikelihood
from rovid.estimate.maximum_likelihood import LikelihoodFit, fit_likelihood, misspecification_covariance, require_swing
from rovid.estimate.missing_torque import include_missing_torque
from rovid.estimate.output_error import MIN_INERTIA_SIGMAS, require_inertia
from rovid.estimate.unknown_past import water_warning

# Share of a model with effects that show only together, and that are likely, but not established. Convention.
_EVEN = 0.5


@dataclass(frozen=True, eq=False)
class StatedSelection:
    """A validated selection with its estimates, whose errors include everything that is known to be missing."""

    selection: Selection
    causes: list[Cause]  # one for each effect of the model
    suspected: list[Suspected]
    estimate: Estimate  # of the selected model
    base_estimate: Estimate  # of the model without effects
    by_forms: FloatArray  # (p, p) part of the covariance of the estimate by other forms of its causes
    plain: LikelihoodFit | None  # the fit that the latter is of; None where that is the base of the search
    waves: LikelihoodFit | None = None  # the fit with waves where these are the only cause, with the same errors

    def size_in_errors(self, effect: Effect) -> float:
        """Size of an ``effect`` of the model in the standard errors that are stated for its form.

        That another form has another size says nothing against the cause.
        """
        of_form = replace(self.estimate, covariance=self.estimate.covariance - self.by_forms)
        return size_in_errors(effect, of_form, self.selection.data.scales)


def state(selection: Selection, plain: LikelihoodFit | None = None) -> StatedSelection:
    """The ``selection`` as it is stated, without effects whose size the stated errors leave open.

    ``plain`` is the fit without effects of `rovid fit`, stated in place of the base of the search.
    Raises DataError if the inertia is not determined.
    """
    while True:
        require_swing(selection.model)
        stated = _state(selection, plain)
        sizes = [(stated.size_in_errors(one), one) for one in selection.model.effects if not is_signal(one)]
        size, weakest = min(sizes, key=lambda one: one[0], default=(math.inf, None))
        if weakest is None or size >= THRESHOLDS.min_stated_errors:
            return replace(stated, waves=_fit_with_waves(stated))
        reason = f"differs from zero by only {size:.1f} of the standard errors that include what the model lacks"
        selection = selection.with_message(f"{weakest.title} {reason}: it is not claimed.").ban(weakest)
        selection = drop_likely(selection, [weakest.key])
        if not selection.model.effects:
            selection = replace(selection, model=selection.base)


def _fit_with_waves(stated: StatedSelection) -> LikelihoodFit | None:
    """The fit of `rovid fit` with the established waves, where no other cause is; None if predictions are stated.

    Multi-step predictions chose the model and do not contain waves, but inertia and drag fitted without the waves have
    errors several times as large.
    """
    selection, plain = stated.selection, stated.plain
    waves = None if selection.waves is None else selection.waves.established
    if waves is None or selection.model.effects or plain is None:
        return None
    try:
        fitted = fit_likelihood(selection.data.runs, selection.data.vehicle, waves.effects[-1:])
    except DataError:
        return None
    if fitted.estimate.method != InnovationLikelihood.method:
        return None
    covariance, count = fitted.estimate.covariance.copy(), len(plain.estimate.names)
    covariance[:count, :count] += stated.estimate.covariance - plain.estimate.covariance
    further = [text for text in stated.estimate.warnings if text not in plain.estimate.warnings]
    estimate = replace(fitted.estimate, covariance=covariance, warnings=(*fitted.estimate.warnings, *further))
    return replace(fitted, estimate=estimate)


def is_established(finding: Finding) -> bool:
    """Whether a cause is established by its probability and by its size in the errors that are stated."""
    is_large = finding.standard_errors >= THRESHOLDS.min_stated_errors
    return finding.probability >= THRESHOLDS.established and is_large


def _state(selection: Selection, plain: LikelihoodFit | None) -> StatedSelection:
    causes = list(map(selection.cause, selection.model.effects))
    base, model = selection.full_data(selection.base), selection.full_data(selection.model)
    suspected = suspects(selection)
    estimate, of_base = (model_estimate(one, white=one.is_white) for one in (model, base))
    # A model without an effect that acts has a large error. Where both models have one by themselves, the vehicle was
    # not excited. Errors by other laws, and by torques that both models lack, follow below and say nothing of that.
    surer = min(of_base, estimate, key=lambda one: one.standard_error("inertia") / one.value("inertia"))
    require_inertia(surer, MIN_INERTIA_SIGMAS)
    by_forms, by_effects = _between_laws(selection, estimate)
    estimate = replace(estimate, covariance=estimate.covariance + by_forms + by_effects)
    by_dropped = np.zeros_like(estimate.covariance)
    if selection.dropped is not None:
        # Suspects are fitted one by one, and these effects show only together.
        by_dropped = _between(_deviation(estimate, selection.dropped)[np.newaxis], np.array([_EVEN]))
        estimate = replace(estimate, covariance=estimate.covariance + by_dropped)
    base_estimate = include_missing_torque(of_base, base.canonical()) if plain is None else plain.estimate
    if model.effects:
        estimate = include_missing_torque(estimate, model.canonical())
        estimate = estimate.with_thrust_scale_uncertainty(model.thrust_scale_uncertainty)
    else:
        estimate = replace(base_estimate, covariance=base_estimate.covariance + by_dropped)
    estimate = average_over_suspects(estimate, suspected)
    # Without effects both models are one, and it has one estimate.
    stated_base = base_estimate if model.effects else estimate
    return StatedSelection(selection, causes, suspected, estimate, stated_base, by_forms, plain)


def model_estimate(fitted: FitResult, *, white: bool) -> Estimate:
    """Parameters of the vehicle with their covariance; coefficients of signal regressors are left out."""
    fitted = fitted.canonical()
    names = fitted.model.names
    added, warnings = misspecification_covariance(fitted)
    warnings += water_warning(fitted.model, fitted.data)
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


def _between_laws(selection: Selection, estimate: Estimate) -> tuple[FloatArray, FloatArray]:
    """(p, p) covariances between the model and models with another form, or another effect (Hoeting et al. 1999).

    The weights follow from the likelihoods where the innovations are white: those of other forms of an effect by
    Akaike's penalty, because nature rarely follows the simplest law. Otherwise no form is exact, and all models that
    gain nearly as much have equal weight.
    """
    model, search = selection.model, selection.search
    deviations, weights, is_form = [], [], list[bool]()
    for effect in model.effects:
        rest = search.without(model, effect)
        gain = bic_score(model) - bic_score(rest)
        for fitted in search.replacements(model, effect):
            if not is_plausible(fitted) or is_signal(fitted.effects[-1]) or fitted.key == model.key:
                continue
            lead = bic_score(fitted) - bic_score(model)
            is_form.append(fitted.effects[-1].id == effect.id)
            if is_form[-1]:
                lead = model.value - fitted.value - (len(fitted.x) - len(model.x))
            weight = math.exp(min(lead, 0.0))
            if not model.is_white and bic_score(fitted) - bic_score(rest) >= THRESHOLDS.equivalent_form_share * gain:
                weight = 1.0
            weights.append(weight)
            deviations.append(_deviation(estimate, fitted, effect))
    away, share = np.array(deviations).reshape(-1, len(estimate.names)), np.array(weights) / (1.0 + sum(weights))
    forms = np.array(is_form, dtype=bool)
    return _between(away[forms], share[forms]), _between(away[~forms], share[~forms])


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


def _deviation(estimate: Estimate, fitted: FitResult, replaced: Effect | None = None) -> FloatArray:
    """(p,) difference of each parameter between ``fitted`` and ``estimate``; zero without a common parameter.

    The last effect of ``fitted`` may stand in the place of an effect that it ``replaced``.
    """
    model = fitted.canonical().model
    there = dict(zip(model.names, model.values.tolist(), strict=True))
    if replaced is not None:
        other = fitted.effects[-1]
        common = _common_parameters(replaced, other)
        there |= {f"{replaced.key}.{name}": there[f"{other.key}.{name}"] for name in common}
    here = zip(estimate.names, estimate.values.tolist(), strict=True)
    return np.array([there.get(name, value) - value for name, value in here])


def _common_parameters(effect: Effect, other: Effect) -> list[str]:
    """Names of the parameters that are one quantity in two forms of an effect: of one unit, scale and largest value.

    The same name is not enough: the loss of a saturating thrust curve is that at a tenth of the largest thrust, and the
    loss of a parabolic one that at the largest. An amplitude is that of another number of cycles in each form.
    """
    if effect.id != other.id or effect.per_thruster or effect.canonical is canonical_phases:
        return []
    quantities = {(one.name, one.unit, one.scale, one.high) for one in other.parameters}
    return [one.name for one in effect.parameters if (one.name, one.unit, one.scale, one.high) in quantities]


def _effect_key(name: str) -> str:
    """Key of the effect in a parameter name; empty for a parameter of the base model."""
    key, _, _ = name.rpartition(".")
    return key
