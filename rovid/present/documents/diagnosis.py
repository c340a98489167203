"""Diagnosis and comparison as JSON."""

import math
from collections.abc import Sequence
from dataclasses import asdict

from rovid.compare.comparison import Comparison, CrossPrediction
from rovid.diagnose import result
from rovid.diagnose.log_rivals import coupled_causes
from rovid.diagnose.signal_regressors import signal_name
from rovid.diagnose.tables import TableDiagnosis
from rovid.estimate.estimate import Estimate
from rovid.model.parameter_names import unit_of, without_form
from rovid.present.documents import fits
from rovid.present.sentences import change_sentence, document_key, other_causes
from rovid.present.tables.diagnosis import inertia_ratios
from rovid.store.study import Study
from rovid.trial.assumptions import Assumptions
from rovid.trial.axis import YAW, Axis
from rovid.trial.fault import Fault


def diagnosis_document(diagnosis: result.Diagnosis, study: Study) -> fits.Document:
    """The document of `rovid diagnose --json`."""
    axis = study.vehicle.axis
    shown = "deg" if axis.angular else "m"
    names = [signal_name(signal) for signal, _ in diagnosis.signals]
    document = {
        "schema": "rovid-diagnosis/1",
        **fits.axis_document(axis),
        **conclusion_document(diagnosis, axis),
        "base": _assessment(diagnosis.base, axis),
        "horizons": [
            {
                "seconds": errors.seconds,
                f"base_{shown}": axis.to_display(errors.base),
                f"extended_{shown}": axis.to_display(errors.extended),
            }
            for errors in diagnosis.horizons
        ],
        "extended": _assessment(diagnosis.extended, axis),
        "held_out_gain": _held_out_gain(diagnosis, axis),
        "unexplained": {
            "share_of_torque_variance": diagnosis.unexplained_share,
            "depends_on": list(dict.fromkeys(names)),
            "signals": [
                {"signal": name, "acts_as": signal.form, "log_likelihood_gain": gain}
                for name, (signal, gain) in zip(names, diagnosis.signals, strict=True)
            ],
        },
        "not_identifiable": list(result.not_identifiable(study.vehicle, diagnosis)),
        "next_experiment": result.next_experiment(diagnosis) | {"needed": not diagnosis.is_settled},
        **fits.guess_document(study.vehicle.assumptions),
    }
    if diagnosis.from_tables is not None:
        document["tables"] = _table_diagnosis(diagnosis.from_tables)
    if coupled := coupled_causes(diagnosis, study.campaign.trials if study.campaign else ()):
        document["coupled_causes"] = list(coupled)
    warnings = [*study.remarks(), *diagnosis.warnings]
    return document | fits.notes_document(study.vehicle.assumptions, all_faults(diagnosis, study), warnings)


def all_faults(diagnosis: result.Diagnosis, study: Study) -> list[Fault]:
    """Faults that the logs alone show, and those that the diagnosis found, which comes second and knows more."""
    later = {(fault.fault, fault.logs if fault.fault == "foreign_log" else ()) for fault in diagnosis.faults}
    logs = (fault for fault in study.faults if later.isdisjoint({(fault.fault, ()), (fault.fault, fault.logs)}))
    return [*logs, *diagnosis.faults]


def conclusion_document(diagnosis: result.Conclusion, axis: Axis = YAW) -> fits.Document:
    """What the diagnosis of any model concludes: causes, other sets of causes, and what it could not see."""
    detectable = {}
    for effect, size in diagnosis.detectable:
        unit = unit_of(effect.parameter_names[0], axis)
        # Effect and parameter -> the smallest size that would have been found; None where no size would.
        key = f"{effect.id}.{effect.parameters[0].name}"
        detectable[key] = fits.value_document(size if math.isfinite(size) else None, unit)
    challengers = [
        {"effects": list(one.causes), "faults": list(one.faults)}
        | fits.fields(one, "log_likelihood_difference", "price_difference")
        for one in diagnosis.challengers
    ]
    return {
        "verdict": diagnosis.verdict,
        "findings": list(map(finding_document, diagnosis.findings)),
        "suspects": list(map(finding_document, diagnosis.suspects)),
        "challengers": challengers,
        "detectable": detectable,
        "missing": diagnosis.missing or None,
        "budget": None if diagnosis.budget is None else asdict(diagnosis.budget),
    }


def _table_diagnosis(diagnosis: TableDiagnosis) -> fits.Document:
    """Predictions of the plain model, and the effects that would or would not explain the tables alone."""
    predictions = [
        fits.fields(row, "trial", "inertia", inertia_method="method")
        | {"peak_yaw_rate": fits.fields(row, "measured", "predicted") | {"unit": "rad/s"}}
        for row in diagnosis.predictions
    ]
    explanations = []
    for cause in diagnosis.causes:
        effect = cause.model.effects[0]
        explanation = {
            "effect": effect.id,
            "form": effect.form or None,
            "parameters": {name: fits.value_document(value, unit) for name, (value, unit) in cause.sizes.items()},
            "inertia": cause.model.inertia,
            "chance_of_the_misfit": None if math.isnan(cause.p_value) else cause.p_value,
            "deciding_experiment": effect.experiment,
        }
        explanations.append(explanation)
    return {
        "predictions": predictions,
        "plain_model_explains": diagnosis.without_effect.explains,
        "would_explain": explanations,
        "would_not_explain": [effect.id for effect in diagnosis.ruled_out],
    }


def _assessment(side: result.ModelAssessment | None, axis: Axis) -> fits.Document | None:
    """A model's parameters, and its errors on held-out trials."""
    if side is None:
        return None
    held_out = side.held_out
    return {
        "parameters": _without_forms(side.estimate),
        "held_out": {
            "log_likelihood": held_out.log_likelihood,
            f"{axis.rate_signal}_r2": held_out.rate_r2,
            f"{axis.rate_signal}_rmse": held_out.rate_rmse,
            **fits.position_errors(held_out.position_errors, axis),
            "units": fits.simulation_units(axis),
        },
    }


def _without_forms(estimate: Estimate) -> fits.Document:
    """The parameters, named by effects without their forms."""
    return {without_form(name): value for name, value in fits.parameter_document(estimate).items()}


def finding_document(finding: result.Finding) -> fits.Document:
    """A cause with its parameters, its evidence and its rivals."""
    effect = finding.effect
    # Without the effect's name before that of the parameter.
    parameters = {name.rpartition(".")[2]: value for name, value in _without_forms(finding.estimate).items()}
    others = other_causes(finding)
    return {
        "effect": effect.id,
        "form": effect.form or None,
        "parameters": parameters,
        **fits.fields(finding, "held_out_gain", "standard_errors", "evidence", log_likelihood_gain="bic_gain"),
        "held_out_log_likelihood_gain": finding.held_out_gain,
        "runner_up": {"effect": others[0].effect.id, "gain": others[0].bic_gain} if others else None,
        "confidence": finding.probability,
        "cannot_be_told_from": [other.id for other in finding.indistinguishable],
        "deciding_experiment": result.discriminating_experiment(finding),
    }


def _held_out_gain(diagnosis: result.Diagnosis, axis: Axis) -> fits.Document | None:
    """Errors of both models on held-out trials; None where one of the models is missing."""
    if diagnosis.base is None or diagnosis.extended is None:
        return None
    one, other = diagnosis.base.held_out, diagnosis.extended.held_out

    def pair(before: float | None, after: float | None, unit: str) -> fits.Document:
        return {"base": before, "extended": after, "unit": unit}

    rate_rmse = pair(one.rate_rmse, other.rate_rmse, axis.rate_unit)
    floors = diagnosis.position_floors
    positions = {
        horizon: pair(before, other.position_errors[horizon], axis.unit("rad")) | {"noise_floor": floors.get(horizon)}
        for horizon, before in one.position_errors.items()
    }
    return {
        f"{axis.rate_signal}_rmse": rate_rmse | {"noise_floor": diagnosis.noise_floor},
        f"{axis.rate_signal}_r2": pair(one.rate_r2, other.rate_r2, "1"),
        **fits.position_errors(positions, axis),
        "log_likelihood": pair(one.log_likelihood, other.log_likelihood, "1"),
    }


def comparison_document(comparison: Comparison, guess: Assumptions, warnings: Sequence[str]) -> fits.Document:
    """The document of `rovid compare --json`."""
    axis, changes = comparison.a.axis, comparison.changes
    ratios = {}
    for symbols, (of_a, of_b), (over, error), unit in inertia_ratios(comparison):
        sides = {"a": fits.value_document(of_a[0], unit, of_a[1]), "b": fits.value_document(of_b[0], unit, of_b[1])}
        ratios[symbols] = {**sides, "ratio": over, "standard_error": error}
    return {
        "schema": "rovid-comparison/1",
        **fits.axis_document(axis),
        "verdict": comparison.verdict,
        "campaigns": {"a": comparison.a.name, "b": comparison.b.name},
        "parameters": _compared_parameters(comparison, guess),
        "changed": list(map(document_key, comparison.changed)),
        "changes": [
            {
                "what": change.candidate.name,
                "parameters": list(map(document_key, change.candidate.parameters)),
                **fits.fields(change, "ratio", "standard_error", "confidence", log_likelihood_gain="bic_score"),
                **fits.fields(change, "established", "standard_errors", "evidence"),
                "cannot_be_told_from": [other.name for other in change.indistinguishable],
                "words": change_sentence(comparison, change),
            }
            for change in changes.changes
        ],
        "causes": {"a": list(comparison.causes[0]), "b": list(comparison.causes[1])},
        "of_the_day": list(comparison.transient_causes),
        "ratios": ratios,
        "prediction": {
            f"{model}_on_{runs}": _cross_prediction(comparison.predictions.get((model, runs)), axis)
            for model, runs in (("a", "b"), ("a", "a"), ("b", "b"), ("b", "a"))
        },
        "smallest_seen": dict(changes.detectable_changes),
        "matters": comparison.relevant_change,
        "open": list(comparison.open_questions),
        "not_identifiable": list(result.NEVER_IDENTIFIABLE),
        **fits.guess_document(guess),
        "warnings": fits.all_warnings(guess, [*comparison.warnings, *warnings]),
    }


def _compared_parameters(comparison: Comparison, guess: Assumptions) -> fits.Document:
    """Each parameter in both campaigns, with its ratio, its difference, and the probability of a change."""
    changes, pair = comparison.changes, comparison.changes.pair
    document: fits.Document = {}
    for place, name in enumerate(pair.names):
        unit = pair.units[place]
        ratio, ratio_error = changes.ratio(name) or (None, None)
        difference, difference_error = changes.difference(name)
        separate, joint = (
            {side: fits.value_document(value, unit, error) for side, (value, error) in zip("ab", values, strict=True)}
            for values in (changes.separate_values(name), changes.joint_values(name))
        )
        document[document_key(name)] = {
            **separate,
            "ratio": ratio,
            "standard_error": ratio_error,
            "difference": fits.value_document(difference, unit, difference_error),
            "confidence": changes.probabilities[name],
            "together": joint,
        }
        if guess.is_placeholder(unit):
            document[document_key(name)]["placeholder"] = True
    for change in changes.changes:
        if change.candidate.inverse:
            document[change.candidate.name] = {
                "a": fits.value_document(1.0, "1", 0.0),
                "b": fits.value_document(change.ratio, "1", change.standard_error),
                **fits.fields(change, "ratio", "standard_error", "confidence"),
            }
    return document


def _cross_prediction(prediction: CrossPrediction | None, axis: Axis) -> fits.Document:
    """How well a model predicts a campaign's runs; None values where there are no logs."""
    names = {f"{axis.rate_signal}_{name}": f"rate_{name}" for name in ("r2", "rmse")}
    if prediction is None:
        return dict.fromkeys(names)
    return fits.fields(prediction, **names) | fits.position_errors(prediction.position_errors, axis)
