"""A diagnosis as JSON."""

from __future__ import annotations

import math

from rovid.diagnose.result import (
    Diagnosis,
    Finding,
    HorizonErrors,
    ModelAssessment,
    discriminating_experiment,
    next_experiment,
    unidentifiable_parameters,
)
from rovid.diagnose.signal_regressors import is_signal, signal_name
from rovid.diagnose.tables import Explanation, SinePrediction, TableDiagnosis
from rovid.estimate.estimate import Estimate
from rovid.model.parameter_names import unit_of, without_form
from rovid.present.documents.fits import (
    Document,
    all_warnings,
    axis_document,
    guess_document,
    parameter_document,
    position_errors,
    simulation_units,
)
from rovid.store.study import Study
from rovid.trial.axis import Axis


def diagnosis_document(diagnosis: Diagnosis, study: Study) -> Document:
    """What `rovid diagnose --json` prints."""
    base, extended, axis = diagnosis.base, diagnosis.extended, study.vehicle.axis
    document = {
        "schema": "rovid-diagnosis/1",
        **axis_document(axis),
        "verdict": diagnosis.verdict,
        "base": _side(base, axis),
        "findings": [_finding(finding) for finding in diagnosis.findings],
        "suspects": [_finding(suspect) for suspect in diagnosis.suspects],
        "horizons": [_ahead(ahead, axis) for ahead in diagnosis.horizons],
        "extended": _side(extended, axis),
        "held_out_gain": _gain(base, extended, diagnosis.noise_floor, axis),
        "unexplained": _unexplained(diagnosis),
        "not_identifiable": list(unidentifiable_parameters(study.vehicle)),
        "detectable": _detectable(diagnosis, axis),
        "next_experiment": next_experiment(diagnosis),
        "missing": diagnosis.missing or None,
        **guess_document(study.vehicle.assumptions),
    }
    if diagnosis.from_tables is not None:
        document["tables"] = _tables(diagnosis.from_tables)
    document["warnings"] = all_warnings(study.vehicle.assumptions, [*study.remarks(), *diagnosis.warnings])
    return document


def _unexplained(diagnosis: Diagnosis) -> Document:
    """What of the motion no effect explains, and the signals that it follows."""
    depends_on, signals = [], []
    for signal, worth in diagnosis.signals:
        name = signal_name(signal)
        depends_on.append(name)
        signals.append({"signal": name, "acts_as": signal.form, "log_likelihood_gain": worth})
    return {
        "share_of_torque_variance": diagnosis.unexplained_share,
        # A signal may act in several ways: it is named once.
        "depends_on": list(dict.fromkeys(depends_on)),
        "signals": signals,
    }


def _detectable(diagnosis: Diagnosis, axis: Axis) -> Document:
    """The smallest size of each effect that would have been seen, by its name."""
    document = {}
    for effect, size in diagnosis.detectable:
        name = effect.parameters[0].name
        value = size if math.isfinite(size) else None
        unit = unit_of(f"{effect.key}.{name}", axis)
        document[f"{effect.id}.{name}"] = {"value": value, "unit": unit}
    return document


def _tables(amplitudes: TableDiagnosis) -> Document:
    return {
        "predictions": [_prediction(each) for each in amplitudes.predictions],
        "plain_model_explains": amplitudes.without_effect.explains,
        "would_explain": [_cause(cause) for cause in amplitudes.causes],
        "would_not_explain": [effect.id for effect in amplitudes.ruled_out],
    }


def _prediction(each: SinePrediction) -> Document:
    return {
        "trial": each.trial,
        "inertia": each.inertia,
        "inertia_method": each.method,
        "peak_yaw_rate": {"measured": each.measured, "predicted": each.predicted, "unit": "rad/s"},
    }


def _cause(cause: Explanation) -> Document:
    """What would explain the tables alone, with its size."""
    effect = cause.model.effects[0]
    parameters = {name: {"value": value, "unit": unit} for name, (value, unit) in cause.sizes.items()}
    return {
        "effect": effect.id,
        "form": effect.form or None,
        "parameters": parameters,
        "inertia": cause.model.inertia,
        "chance_of_the_misfit": None if math.isnan(cause.p_value) else cause.p_value,
        "deciding_experiment": effect.experiment,
    }


def _side(side: ModelAssessment | None, axis: Axis) -> Document | None:
    """A model's parameters and what it makes of trials that were not fitted; None where there is no model."""
    if side is None:
        return None
    held = side.held_out
    return {
        "parameters": _without_forms(side.estimate),
        "held_out": {
            "log_likelihood": held.log_likelihood,
            f"{axis.rate_signal}_r2": held.rate_r2,
            f"{axis.rate_signal}_rmse": held.rate_rmse,
            **position_errors(held.position_errors, axis),
            "units": simulation_units(axis),
        },
    }


def _without_forms(estimate: Estimate) -> Document:
    """The parameters; a form of an effect goes by the effect's name: which fits best is said with the finding."""
    return {without_form(name): value for name, value in parameter_document(estimate).items()}


def _ahead(ahead: HorizonErrors, axis: Axis) -> Document:
    unit = "deg" if axis.angular else "m"
    return {
        "seconds": ahead.seconds,
        f"base_{unit}": axis.to_display(ahead.base),
        f"extended_{unit}": axis.to_display(ahead.extended),
    }


def _finding(finding: Finding) -> Document:
    effect = finding.effect
    return {
        "effect": effect.id,
        "form": effect.form or None,
        "parameters": _own_names(_without_forms(finding.estimate)),
        "log_likelihood_gain": finding.gain,
        "held_out_log_likelihood_gain": finding.held_out_gain,
        "runner_up": _runner_up(finding),
        "confidence": finding.probability,
        "cannot_be_told_from": [other.id for other in finding.indistinguishable],
        "deciding_experiment": discriminating_experiment(finding),
    }


def _own_names(parameters: Document) -> Document:
    """The parameters by their names alone, without that of the effect before it."""
    return {name.rpartition(".")[2]: value for name, value in parameters.items()}


def _runner_up(finding: Finding) -> Document | None:
    """The best other cause; a dependence on a signal is none."""
    for rival in finding.alternatives:
        if not is_signal(rival.effect):
            return {"effect": rival.effect.id, "gain": rival.bic_gain}
    return None


def _gain(base: ModelAssessment | None, extended: ModelAssessment | None, floor: float, axis: Axis) -> Document | None:
    """What the simulation of trials that were not fitted gains; None where one of the two is missing."""
    if base is None or extended is None:
        return None
    one, other = base.held_out, extended.held_out
    document = {
        f"{axis.rate_signal}_rmse": _pair(one.rate_rmse, other.rate_rmse, axis.rate_unit) | {"noise_floor": floor},
        f"{axis.rate_signal}_r2": _pair(one.rate_r2, other.rate_r2, "1"),
    }
    for horizon, before in one.position_errors.items():
        after = other.position_errors[horizon]
        document[f"{axis.position_signal}_error_{horizon:.0f}s"] = _pair(before, after, axis.unit("rad"))
    document["log_likelihood"] = _pair(one.log_likelihood, other.log_likelihood, "1")
    return document


def _pair(before: float | None, after: float | None, unit: str) -> Document:
    return {"base": before, "extended": after, "unit": unit}
