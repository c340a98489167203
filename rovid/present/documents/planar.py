"""Fit, check, simulation, diagnosis and comparison by the coupled model as JSON."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

from rovid.compare.comparison import PlanarComparison
from rovid.diagnose.result import first_experiment
from rovid.estimate.estimate import Estimate
from rovid.model.parameter_names import unit_of, without_form
from rovid.planar.diagnosis import PlanarAssessment, PlanarDiagnosis
from rovid.planar.experiment import PlanarPlan
from rovid.planar.fit import PlanarFit
from rovid.planar.manoeuvres import Measures
from rovid.planar.standard_manoeuvres import RunManoeuvre, model_manoeuvres
from rovid.planar.trial_simulation import SENSOR_UNITS, PlanarTrialSimulation, pooled_measures
from rovid.planar.uncertainty import Undetermined
from rovid.preflight.check import remark_document
from rovid.preflight.planar_check import PlanarCheck
from rovid.present.documents.diagnosis import conclusion_document
from rovid.present.documents.fits import (
    Document,
    all_warnings,
    fields,
    guess_document,
    notes_document,
    parameter_document,
    shared_fit_document,
    sname_document,
    value_document,
)
from rovid.present.documents.results import plan_document, shared_check_document, shared_simulation_document
from rovid.store.parameter_file import OpenCombination, Parameters
from rovid.store.planar_study import PlanarStudy, open_combinations
from rovid.trial.assumptions import Assumptions
from rovid.trial.vehicle import Vehicle

AXES_DOCUMENT = {"axes": "planar"}


def planar_parameters(estimate: Estimate) -> Document:
    """Each determined parameter with value, standard error, unit, 95 % interval and SNAME derivative."""
    document = parameter_document(estimate)
    return {name: entry | sname_document(name) for name, entry in document.items()}


def undetermined_document(combinations: Sequence[OpenCombination | Undetermined]) -> list[Document]:
    """Combinations of parameters that the logs do not determine."""
    return [{"combination": dict(one.combination), "text": one.text} for one in combinations]


def _prior_document(fit: PlanarFit) -> Document:
    """The prior, and the combinations that it determines and the logs do not; empty without a prior."""
    if not fit.prior.values:
        return {}
    values = {
        name: value_document(one.value, unit_of(name), one.standard_error) | {"source": one.source}
        for name, one in fit.prior.values.items()
    }
    return {"prior": values, "only_by_prior": undetermined_document(fit.prior.only_by_prior)}


def planar_fit_document(fit: PlanarFit, study: PlanarStudy) -> Document:
    """The document of `rovid fit --axes planar --json`."""
    estimate, disturbance = fit.estimate, {}
    for axis, (size, time) in fit.disturbance.items():
        times = {"correlation_time": value_document(time, "s"), "at_limit": axis in fit.at_limit}
        disturbance[axis] = value_document(size, "N m" if axis == "yaw" else "N") | times
    return shared_fit_document(estimate, study.logs) | {
        **AXES_DOCUMENT,
        "parameters": planar_parameters(estimate),
        "undetermined": undetermined_document(open_combinations(fit)),
        **_prior_document(fit),
        "log_likelihood": fit.log_likelihood,
        "not_identifiable": ["thrust_scale", *estimate.refused],
        "noise": {sensor: value_document(size, SENSOR_UNITS[sensor]) for sensor, size in fit.noise.items()},
        "disturbance": disturbance,
        "latency": {sensor: value_document(late, "s", error) for sensor, (late, error) in fit.latency.items()},
        "innovations_white": fit.white,
        "criterion": "multi_step" if fit.multi_step else "innovations",
        "free_run_r2": dict(fit.free_run_r2),
        "standard_manoeuvres": measures_document(model_manoeuvres(fit, study.data)),
    }


def planar_simulation_document(
    parameters: Parameters,
    simulations: Sequence[PlanarTrialSimulation],
    warnings: Sequence[str],
    guess: Assumptions,
    manoeuvres: Sequence[RunManoeuvre] = (),
) -> Document:
    """The document of `rovid simulate --axes planar --json`; angles in rad, distances in m."""
    return shared_simulation_document(parameters, warnings, guess) | {
        **AXES_DOCUMENT,
        "undetermined": undetermined_document(parameters.undetermined),
        "trials": [
            {
                "name": item.name,
                "samples": item.samples,
                **_measures(item.fits),
                **_by_horizon("heading_error", item.heading_errors),
                **_by_horizon("track_error", item.track_errors),
                "track_error": item.track_rms,
            }
            for item in simulations
        ],
        "overall": _measures(pooled_measures(simulations)),
        "manoeuvres": [
            fields(one, "run", "kind", "begin", "end", "steering")
            | {"measured": measures_document(one.measured), "simulated": measures_document(one.simulated)}
            for one in manoeuvres
        ],
        "units": {
            **{f"{sensor}_rmse": unit for sensor, unit in SENSOR_UNITS.items()},
            "heading_error": "rad",
            "track_error": "m",
        },
    }


def _by_horizon(name: str, errors: Mapping[float, float | None]) -> Document:
    return {f"{name}_{seconds:.0f}s": error for seconds, error in errors.items()}


def _measures(fits: Mapping[str, object]) -> Document:
    return {
        f"{sensor}_{measure}": getattr(fit, measure)
        for sensor, fit in fits.items()
        for measure in ("r2", "fit_percent", "rmse")
    }


def measures_document(measures: Measures) -> Document:
    """Measures of manoeuvres by name, each with value, unit and standard error; null where that is not known."""
    return {name: asdict(measure) for name, measure in measures.items()}


def planar_plan_document(plan: PlanarPlan, vehicle: Vehicle, command_file: str, warnings: Sequence[str]) -> Document:
    """The document of `rovid plan --axes planar --json`; standard errors in SI, None where not determined."""
    estimate = plan.fit.estimate
    errors = {
        name: {"before": before, "after": after, "unit": estimate.unit(name)}
        for name, (before, after) in plan.errors.items()
    }
    left_out = [{"run": run, "reason": reason} for run, reason in plan.left_out.items()]
    document = plan_document(plan.ranked, vehicle, command_file, "", warnings)
    added = {"reason": plan.reason, "standard_errors": errors, "left_out": left_out, "picture": None}
    return {"schema": document["schema"], **AXES_DOCUMENT} | document | added


def planar_diagnosis_document(diagnosis: PlanarDiagnosis, study: PlanarStudy) -> Document:
    """The document of `rovid diagnose --axes planar --json`; angles in rad."""
    guess = study.vehicle.assumptions
    final = diagnosis.extended or diagnosis.base
    return {
        "schema": "rovid-diagnosis/1",
        **AXES_DOCUMENT,
        **conclusion_document(diagnosis),
        "base": _assessment(diagnosis.base),
        "horizons": _horizons(diagnosis),
        "extended": _assessment(diagnosis.extended),
        "held_out_gain": _held_out_gain(diagnosis),
        "unexplained": {"share_of_variance": dict(diagnosis.unexplained_shares), "depends_on": []},
        "undetermined": [] if final is None else undetermined_document(open_combinations(final.fit)),
        "not_identifiable": ["thrust_scale", *(() if final is None else final.fit.estimate.refused)],
        "next_experiment": next_planar_experiment(diagnosis) | {"needed": not diagnosis.is_settled},
        **guess_document(guess),
        **notes_document(guess, study.logs.faults, [*study.remarks(), *diagnosis.warnings]),
    }


def next_planar_experiment(diagnosis: PlanarDiagnosis) -> dict[str, Any]:
    """The next run: one that separates causes, else one that shows an open combination, a cause or nothing new."""
    first = first_experiment(diagnosis)
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


def _assessment(side: PlanarAssessment | None) -> Document | None:
    """A model's parameters, and its errors on held-out trials."""
    if side is None:
        return None
    scores = side.held_out
    units = {f"{speed}_rmse": SENSOR_UNITS[speed] for speed in scores.rmse} | {"heading_error": "rad"}
    parameters = {without_form(name): value for name, value in planar_parameters(side.fit.estimate).items()}
    return {
        "parameters": parameters,
        "undetermined": undetermined_document(open_combinations(side.fit)),
        **_prior_document(side.fit),
        "held_out": {
            "log_likelihood": scores.log_likelihood,
            **{f"{speed}_rmse": error for speed, error in scores.rmse.items()},
            **_by_horizon("heading_error", scores.heading_errors),
            "units": units,
        },
    }


def _horizons(diagnosis: PlanarDiagnosis) -> list[Document]:
    if diagnosis.base is None or diagnosis.extended is None:
        return []
    base, extended = diagnosis.base.held_out.heading_errors, diagnosis.extended.held_out.heading_errors
    return [
        {"seconds": seconds, "base_deg": math.degrees(error), "extended_deg": math.degrees(extended[seconds])}
        for seconds, error in base.items()
        if seconds in extended
    ]


def _held_out_gain(diagnosis: PlanarDiagnosis) -> Document | None:
    """Errors of both models on held-out trials; None where one of the models is missing."""
    if diagnosis.base is None or diagnosis.extended is None:
        return None
    one, other = diagnosis.base.held_out, diagnosis.extended.held_out
    document: Document = {}
    for speed, error in one.rmse.items():
        floor = diagnosis.noise_floors.get(speed)
        document[f"{speed}_rmse"] = _pair(error, other.rmse.get(speed), SENSOR_UNITS[speed], floor)
    for horizon, error in one.heading_errors.items():
        floor = diagnosis.heading_floors.get(horizon)
        document[f"heading_error_{horizon:.0f}s"] = _pair(error, other.heading_errors.get(horizon), "rad", floor)
    document["log_likelihood"] = _pair(one.log_likelihood, other.log_likelihood, "1", None)
    return document


def _pair(before: float, after: float | None, unit: str, floor: float | None) -> Document:
    return {"base": before, "extended": after, "noise_floor": floor, "unit": unit}


def planar_check_document(checked: PlanarCheck, vehicle: Vehicle) -> Document:
    """The document of `rovid check --axes planar --json`; SI and radians, null where unknown."""
    return shared_check_document(checked, vehicle) | {
        **AXES_DOCUMENT,
        "logs": [
            {
                "name": trial.name,
                "duration": trial.duration,
                "readings": {name: len(one.time) for name, one in trial.readings.items()},
                "remarks": list(map(remark_document, trial.remarks)),
            }
            for trial in checked.trials
        ],
        "sensors": [_known(vars(sensor)) for sensor in checked.sensors],
        "degrees_of_freedom": [_known(vars(axis)) for axis in checked.axes],
        "latencies": [_known(vars(lag)) for lag in checked.lags],
    }


def _known(values: dict[str, Any]) -> dict[str, Any]:
    return {key: None if isinstance(value, float) and math.isnan(value) else value for key, value in values.items()}


def planar_comparison_document(comparison: PlanarComparison, warnings: Sequence[str]) -> Document:
    """The document of `rovid compare --axes planar --json`."""
    guess = comparison.assumptions
    parameters = {}
    for change in comparison.changes:
        entries = {"a": change.a, "b": change.b}
        sides = {side: value_document(one.value, one.unit, one.standard_error) for side, one in entries.items()}
        document = {**sides, **_known({"ratio": change.ratio, "standard_error": change.standard_error})}
        if math.isfinite(change.difference):
            document["difference"] = change.difference
        parameters[change.name] = document | {"confidence": change.confidence} | sname_document(change.name)
    return {
        "schema": "rovid-comparison/1",
        **AXES_DOCUMENT,
        "verdict": comparison.verdict,
        "campaigns": {"a": comparison.a.name, "b": comparison.b.name},
        "parameters": parameters,
        "changed": comparison.changed,
        "causes": {"a": comparison.a.parameters.effects, "b": comparison.b.parameters.effects},
        "open": comparison.open_questions,
        "suspects": {
            side: [{"effect": one.effect.id, "confidence": one.probability} for one in campaign.suspects]
            for side, campaign in (("a", comparison.a), ("b", comparison.b))
        },
        "prediction": {
            f"{model}_on_{runs}": {
                f"{speed}_{measure}": getattr(fit, measure) for speed, fit in fits.items() for measure in ("r2", "rmse")
            }
            for (model, runs), fits in comparison.predictions.items()
        },
        "smallest_seen": dict(comparison.detectable),
        "not_identifiable": ["thrust_scale"],
        **guess_document(guess),
        "warnings": all_warnings(guess, warnings),
    }
