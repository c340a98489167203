"""Diagnoses and comparisons as JSON, of one axis and of the coupled model."""

import math
from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

from rovid.compare.comparison import Comparison, CrossPrediction, PlanarCampaign, PlanarComparison
from rovid.diagnose import result
from rovid.diagnose.log_rivals import coupled_causes
from rovid.diagnose.signal_regressors import signal_name
from rovid.diagnose.tables import TableDiagnosis
from rovid.model.parameter_names import unit_of, without_form
from rovid.planar.diagnosis import PlanarAssessment, PlanarDiagnosis
from rovid.planar.trial_simulation import SENSOR_UNITS
from rovid.present.documents import fits
from rovid.present.sentences import change_sentence, document_key, other_causes
from rovid.present.tables.diagnosis import inertia_ratios
from rovid.store.planar_study import PlanarStudy, open_combinations
from rovid.store.study import Study
from rovid.trial.assumptions import Assumptions
from rovid.trial.axis import YAW, Axis
from rovid.trial.fault import Fault


def diagnosis_document(diagnosis: result.Diagnosis, study: Study) -> fits.Document:
    """The document of `rovid diagnose --json`."""
    axis = study.vehicle.axis
    shown, horizons, signals = "deg" if axis.angular else "m", [], []
    for errors in diagnosis.horizons:
        sides = {f"base_{shown}": errors.base, f"extended_{shown}": errors.extended}
        shown_sides: fits.Document = {side: axis.to_display(error) for side, error in sides.items()}
        horizons.append({"seconds": errors.seconds} | shown_sides)
    for signal, gain in diagnosis.signals:
        signals.append({"signal": signal_name(signal), "acts_as": signal.form, "log_likelihood_gain": gain})
    document = {
        "schema": "rovid-diagnosis/1",
        **fits.axis_document(axis),
        **conclusion_document(diagnosis, axis),
        "base": _assessment(diagnosis.base, axis),
        "horizons": horizons,
        "extended": _assessment(diagnosis.extended, axis),
        "held_out_gain": _held_out_gain(diagnosis, axis),
        "removed_share": {"value": diagnosis.removed_share, "upper_bound": diagnosis.leaves_unexplained},
        "unexplained": {
            "share_of_torque_variance": diagnosis.unexplained_share,
            "depends_on": list(dict.fromkeys(signal["signal"] for signal in signals)),
            "signals": signals,
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
    challengers = []
    for one in diagnosis.challengers:
        differences = fits.fields(one, "log_likelihood_difference", "price_difference")
        challengers.append({"effects": list(one.causes), "faults": list(one.faults)} | differences)
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
    predictions, explanations = [], []
    for row in diagnosis.predictions:
        rates = fits.fields(row, "measured", "predicted") | {"unit": "rad/s"}
        predictions.append(fits.fields(row, "trial", "inertia", inertia_method="method") | {"peak_yaw_rate": rates})
    for cause in diagnosis.causes:
        effect = cause.model.effects[0]
        document = {
            "effect": effect.id,
            "form": effect.form or None,
            "parameters": {name: fits.value_document(value, unit) for name, (value, unit) in cause.sizes.items()},
            "inertia": cause.model.inertia,
            "chance_of_the_misfit": None if math.isnan(cause.p_value) else cause.p_value,
            "deciding_experiment": effect.experiment,
        }
        explanations.append(document)
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
        "parameters": _without_forms(fits.parameter_document(side.estimate)),
        "held_out": {
            "log_likelihood": held_out.log_likelihood,
            f"{axis.rate_signal}_r2": held_out.rate_r2,
            f"{axis.rate_signal}_rmse": held_out.rate_rmse,
            **fits.position_errors(held_out.position_errors, axis),
            "units": fits.simulation_units(axis),
        },
    }


def _without_forms(parameters: fits.Document) -> fits.Document:
    """The parameters, named by effects without their forms."""
    return {without_form(name): value for name, value in parameters.items()}


def finding_document(finding: result.Finding) -> fits.Document:
    """A cause with its parameters, its evidence and its rivals."""
    effect = finding.effect
    others, parameters = other_causes(finding), fits.parameter_document(finding.estimate)
    return {
        "effect": effect.id,
        "form": effect.form or None,
        "parameters": {name.rpartition(".")[2]: value for name, value in parameters.items()},
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
    axis, changes, ratios, changed = comparison.a.axis, comparison.changes, {}, []
    for symbols, sides, (over, error), unit in inertia_ratios(comparison):
        ratios[symbols] = _sides(sides, unit) | {"ratio": over, "standard_error": error}
    for change in changes.changes:
        parameters = list(map(document_key, change.candidate.parameters))
        document = {"what": change.candidate.name, "parameters": parameters}
        document |= fits.fields(change, "ratio", "standard_error", "confidence", log_likelihood_gain="bic_score")
        document |= fits.fields(change, "established", "standard_errors", "evidence")
        document["cannot_be_told_from"] = [other.name for other in change.indistinguishable]
        changed.append(document | {"words": change_sentence(comparison, change)})
    return {
        "schema": "rovid-comparison/1",
        **fits.axis_document(axis),
        "verdict": comparison.verdict,
        "campaigns": {"a": comparison.a.name, "b": comparison.b.name},
        "parameters": _compared_parameters(comparison, guess),
        "changed": list(map(document_key, comparison.changed)),
        "changes": changed,
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
        **fits.closing_document(guess, [*comparison.warnings, *warnings]),
    }


def _compared_parameters(comparison: Comparison, guess: Assumptions) -> fits.Document:
    """Each parameter in both campaigns, with its ratio, its difference, and the probability of a change."""
    changes, pair = comparison.changes, comparison.changes.pair
    document: fits.Document = {}
    for place, name in enumerate(pair.names):
        unit = pair.units[place]
        ratio, ratio_error = changes.ratio(name) or (None, None)
        difference, difference_error = changes.difference(name)
        document[document_key(name)] = {
            **_sides(changes.separate_values(name), unit),
            "ratio": ratio,
            "standard_error": ratio_error,
            "difference": fits.value_document(difference, unit, difference_error),
            "confidence": changes.probabilities[name],
            "together": _sides(changes.joint_values(name), unit),
        }
        if guess.is_placeholder(unit):
            document[document_key(name)]["placeholder"] = True
    for change in changes.changes:
        if change.candidate.inverse:
            sides = _sides(((1.0, 0.0), (change.ratio, change.standard_error)), "1")
            document[change.candidate.name] = sides | fits.fields(change, "ratio", "standard_error", "confidence")
    return document


def _sides(values: Sequence[tuple[float, float]], unit: str) -> fits.Document:
    return {side: fits.value_document(value, unit, error) for side, (value, error) in zip("ab", values, strict=True)}


def _cross_prediction(prediction: CrossPrediction | None, axis: Axis) -> fits.Document:
    """How well a model predicts a campaign's runs; None values where there are no logs."""
    names = {f"{axis.rate_signal}_{name}": f"rate_{name}" for name in ("r2", "rmse")}
    if prediction is None:
        return dict.fromkeys(names)
    return fits.fields(prediction, **names) | fits.position_errors(prediction.position_errors, axis)


def planar_diagnosis_document(diagnosis: PlanarDiagnosis, study: PlanarStudy) -> fits.Document:
    """The document of `rovid diagnose --axes planar --json`; angles in rad."""
    guess, horizons = study.vehicle.assumptions, []
    final = diagnosis.extended or diagnosis.base
    if diagnosis.base is not None and diagnosis.extended is not None:
        extended = diagnosis.extended.held_out.heading_errors
        for seconds, error in diagnosis.base.held_out.heading_errors.items():
            if seconds in extended:
                sides = {"base_deg": math.degrees(error), "extended_deg": math.degrees(extended[seconds])}
                horizons.append({"seconds": seconds} | sides)
    return {
        "schema": "rovid-diagnosis/1",
        **fits.AXES_DOCUMENT,
        **conclusion_document(diagnosis),
        "base": _planar_assessment(diagnosis.base),
        "horizons": horizons,
        "extended": _planar_assessment(diagnosis.extended),
        "held_out_gain": _planar_held_out_gain(diagnosis),
        "unexplained": {"share_of_variance": dict(diagnosis.unexplained_shares), "depends_on": []},
        "undetermined": [] if final is None else fits.undetermined_document(open_combinations(final.fit)),
        "not_identifiable": [
            *["thrust_scale"] * (not study.vehicle.thrust_scale_error),
            *(() if final is None else final.fit.estimate.refused),
        ],
        "next_experiment": next_planar_experiment(diagnosis) | {"needed": not diagnosis.is_settled},
        **fits.guess_document(guess),
        **fits.notes_document(guess, study.logs.faults, [*study.remarks(), *diagnosis.warnings]),
    }


def next_planar_experiment(diagnosis: PlanarDiagnosis) -> dict[str, Any]:
    """The next run: one that separates causes, else one that shows an open combination, a cause or nothing new."""
    first = result.first_experiment(diagnosis)
    if first is not None:
        return first
    final = diagnosis.extended or diagnosis.base
    if final is None:
        run = "steps and sines of surge, sway and yaw, turning circles both ways, and coast-downs to rest"
        return {"run": run, "reason": "they excite all parameters and effects of the model"}
    if undetermined := final.fit.undetermined:
        run = "the same commands with thrust along the axis that these logs do not excite, on four headings"
        return {"run": run, "reason": undetermined[0].text}
    for finding in (*diagnosis.suspects, *diagnosis.findings):
        return {"run": finding.effect.experiment, "reason": f"it shows {finding.effect.title} by itself"}
    run = "turning circles and zigzags at several speeds, on four headings"
    return {"run": run, "reason": "nothing is missing; turns at speed show couplings and currents first"}


def _planar_assessment(side: PlanarAssessment | None) -> fits.Document | None:
    """A model's parameters, and its errors on held-out trials."""
    if side is None:
        return None
    scores = side.held_out
    units = {f"{speed}_rmse": SENSOR_UNITS[speed] for speed in scores.rmse} | {"heading_error": "rad"}
    return {
        "parameters": _without_forms(fits.planar_parameters(side.fit.estimate)),
        "undetermined": fits.undetermined_document(open_combinations(side.fit)),
        **fits.prior_document(side.fit),
        "held_out": {
            "log_likelihood": scores.log_likelihood,
            **{f"{speed}_rmse": error for speed, error in scores.rmse.items()},
            **fits.by_horizon("heading_error", scores.heading_errors),
            "units": units,
        },
    }


def _planar_held_out_gain(diagnosis: PlanarDiagnosis) -> fits.Document | None:
    """Errors of both models on held-out trials; None where one of the models is missing."""
    if diagnosis.base is None or diagnosis.extended is None:
        return None
    one, other = diagnosis.base.held_out, diagnosis.extended.held_out
    document: fits.Document = {}
    for speed, error in one.rmse.items():
        floor = diagnosis.noise_floors.get(speed)
        document[f"{speed}_rmse"] = _pair(error, other.rmse.get(speed), SENSOR_UNITS[speed], floor)
    for horizon, error in one.heading_errors.items():
        floor = diagnosis.heading_floors.get(horizon)
        document[f"heading_error_{horizon:.0f}s"] = _pair(error, other.heading_errors.get(horizon), "rad", floor)
    document["log_likelihood"] = _pair(one.log_likelihood, other.log_likelihood, "1", None)
    return document


def _pair(before: float, after: float | None, unit: str, floor: float | None) -> fits.Document:
    return {"base": before, "extended": after, "noise_floor": floor, "unit": unit}


def _suspects(campaign: PlanarCampaign) -> list[fits.Document]:
    return [{"effect": one.effect.id, "confidence": one.probability} for one in campaign.suspects]


def planar_comparison_document(comparison: PlanarComparison, warnings: Sequence[str]) -> fits.Document:
    """The document of `rovid compare --axes planar --json`."""
    guess = comparison.assumptions
    parameters = {}
    for change in comparison.changes:
        document = _sides([(one.value, one.standard_error) for one in (change.a, change.b)], change.a.unit)
        document |= fits.without_nan(fits.fields(change, "ratio", "standard_error"))
        if math.isfinite(change.difference):
            document["difference"] = change.difference
        parameters[change.name] = document | {"confidence": change.confidence} | fits.sname_document(change.name)
    predictions = {}
    for (model, runs), measures in comparison.predictions.items():
        predictions[f"{model}_on_{runs}"] = fits.planar_measures(measures, "r2", "rmse")
    return {
        "schema": "rovid-comparison/1",
        **fits.AXES_DOCUMENT,
        "verdict": comparison.verdict,
        "campaigns": {"a": comparison.a.name, "b": comparison.b.name},
        "parameters": parameters,
        "changed": comparison.changed,
        "causes": {"a": comparison.a.parameters.effects, "b": comparison.b.parameters.effects},
        "open": comparison.open_questions,
        "suspects": {"a": _suspects(comparison.a), "b": _suspects(comparison.b)},
        "prediction": predictions,
        "smallest_seen": dict(comparison.detectable),
        "not_identifiable": ["thrust_scale"],
        **fits.closing_document(guess, warnings),
    }
