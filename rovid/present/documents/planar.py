"""Fit, check, diagnosis and export of the coupled model as JSON."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

from rovid.diagnose.result import first_experiment
from rovid.estimate.estimate import Estimate
from rovid.export.run_export import VELOCITIES, PlanarMismatch, VerifiedPlanarExport
from rovid.model.parameter_names import effect_ids, unit_of, without_form
from rovid.planar.coordinates import Undetermined
from rovid.planar.diagnosis import PlanarAssessment, PlanarDiagnosis
from rovid.planar.experiment import PlanarPlan
from rovid.planar.fit import PlanarFit
from rovid.planar.manoeuvres import Measures
from rovid.planar.model import SNAME
from rovid.planar.standard_manoeuvres import RunManoeuvre, model_manoeuvres
from rovid.planar.trial_simulation import SENSOR_UNITS, PlanarTrialSimulation, pooled_measures
from rovid.preflight.check import remark_document
from rovid.preflight.planar_check import PlanarCheck
from rovid.present.documents.diagnosis import conclusion_document
from rovid.present.documents.fits import (
    Document,
    all_warnings,
    fault_documents,
    fields,
    guess_document,
    marked_value,
    parameter_document,
    value_document,
)
from rovid.present.documents.results import plan_document, stability_document
from rovid.store.parameter_file import OpenCombination, Parameters
from rovid.store.planar_study import PlanarStudy, open_combinations
from rovid.trial.assumptions import Assumptions
from rovid.trial.axis import PLANAR
from rovid.trial.fault import fault_texts
from rovid.trial.vehicle import Vehicle

AXES_DOCUMENT = {"axes": "planar"}
# Parameters of effects that are SNAME (1950) derivatives: the parameter is the negative of the derivative.
_EFFECT_SNAMES = {
    "sway_yaw_damping.yaw_by_sway": "N_v",
    "sway_yaw_damping.sway_by_yaw": "Y_r",
    "sway_yaw_damping:lift.yaw_by_sway": "N_uv",
    "sway_yaw_damping:lift.sway_by_yaw": "Y_ur",
}


def derivative_name(name: str) -> str:
    """The SNAME derivative of a parameter; empty where it has none."""
    return SNAME.get(name) or _EFFECT_SNAMES.get(name, "")


def planar_parameters(estimate: Estimate) -> Document:
    """Each determined parameter with value, standard error, unit, 95 % interval and SNAME derivative."""
    document = parameter_document(estimate)
    return {name: entry | _sname(name) for name, entry in document.items()}


def _sname(name: str) -> Document:
    derivative = derivative_name(name)
    return {"sname": derivative} if derivative else {}


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
    estimate = fit.estimate
    guess = estimate.assumptions
    faults = study.logs.faults
    return {
        "schema": "rovid-fit/1",
        **AXES_DOCUMENT,
        "parameters": planar_parameters(estimate),
        "undetermined": undetermined_document(open_combinations(fit)),
        **_prior_document(fit),
        "effects": effect_ids(estimate.names),
        "log_likelihood": fit.log_likelihood,
        "samples": estimate.samples,
        "method": estimate.method,
        "not_identifiable": ["thrust_scale", *estimate.refused],
        "noise": {sensor: value_document(size, SENSOR_UNITS[sensor]) for sensor, size in fit.noise.items()},
        "disturbance": {axis: _disturbance(fit, axis) for axis in fit.disturbance},
        "latency": {sensor: value_document(late, "s", error) for sensor, (late, error) in fit.latency.items()},
        "innovations_white": fit.white,
        "criterion": "multi_step" if fit.multi_step else "innovations",
        "free_run_r2": dict(fit.free_run_r2),
        "standard_manoeuvres": measures_document(model_manoeuvres(fit, study.data)),
        **guess_document(guess),
        "faults": fault_documents(faults),
        "warnings": all_warnings(guess, [*fault_texts(faults), *study.remarks(), *fit.warnings]),
    }


def _disturbance(fit: PlanarFit, axis: str) -> Document:
    size, time = fit.disturbance[axis]
    unit = "N m" if axis == "yaw" else "N"
    return value_document(size, unit) | {
        "correlation_time": value_document(time, "s"),
        "at_limit": axis in fit.at_limit,
    }


def planar_simulation_document(
    parameters: Parameters,
    simulations: Sequence[PlanarTrialSimulation],
    warnings: Sequence[str],
    guess: Assumptions,
    manoeuvres: Sequence[RunManoeuvre] = (),
) -> Document:
    """The document of `rovid simulate --axes planar --json`; angles in rad, distances in m."""
    entries = {
        name: marked_value(guess, entry.value, entry.unit, entry.standard_error) | _sname(name)
        for name, entry in parameters.entries.items()
    }
    units = {f"{sensor}_rmse": unit for sensor, unit in SENSOR_UNITS.items()}
    return {
        "schema": "rovid-simulation/1",
        **AXES_DOCUMENT,
        "parameters": entries,
        "undetermined": undetermined_document(parameters.undetermined),
        "effects": parameters.effects,
        "trials": list(map(_trial_document, simulations)),
        "overall": _measures(pooled_measures(simulations)),
        "manoeuvres": list(map(manoeuvre_document, manoeuvres)),
        "units": (units | {"heading_error": "rad", "track_error": "m"}),
        **guess_document(guess),
        "warnings": all_warnings(guess, warnings),
    }


def _trial_document(item: PlanarTrialSimulation) -> Document:
    return {
        "name": item.name,
        "samples": item.samples,
        **_measures(item.fits),
        **{f"heading_error_{seconds:.0f}s": error for seconds, error in item.heading_errors.items()},
        **{f"track_error_{seconds:.0f}s": error for seconds, error in item.track_errors.items()},
        "track_error": item.track_rms,
    }


def _measures(fits: Mapping[str, object]) -> Document:
    return {
        f"{sensor}_{measure}": getattr(fit, measure)
        for sensor, fit in fits.items()
        for measure in ("r2", "fit_percent", "rmse")
    }


def manoeuvre_document(one: RunManoeuvre) -> Document:
    """A manoeuvre that was recognised in a run; angles in rad."""
    return {
        **fields(one, "run", "kind", "begin", "end", "steering"),
        "measured": measures_document(one.measured),
        "simulated": measures_document(one.simulated),
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
    guess, faults = study.vehicle.assumptions, study.logs.faults
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
        "faults": fault_documents(faults),
        "warnings": all_warnings(guess, [*fault_texts(faults), *study.remarks(), *diagnosis.warnings]),
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
            **{f"heading_error_{horizon:.0f}s": error for horizon, error in scores.heading_errors.items()},
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


def planar_check_document(checked: PlanarCheck, vehicle: Vehicle) -> dict[str, Any]:
    """The document; SI and radians, null where unknown."""
    return {
        "schema": "rovid-check/1",
        "axes": PLANAR.name,
        **guess_document(vehicle.assumptions),
        "verdict": checked.verdict,
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
        "unreadable": [{"name": name, "problem": problem} for name, problem in checked.problems.items()],
        "faults": fault_documents(checked.faults),
        "remarks": list(map(remark_document, checked.remarks)),
        "advice": list(map(vars, checked.advice)),
    }


def _known(values: dict[str, Any]) -> dict[str, Any]:
    return {key: None if isinstance(value, float) and math.isnan(value) else value for key, value in values.items()}


def planar_export_document(name: str, file: str, made: VerifiedPlanarExport, guess: Assumptions) -> Document:
    """The document of `rovid export --axes planar --json`; percentages are of each velocity's range."""
    return {
        "schema": "rovid-export/1",
        "axes": "planar",
        "format": name,
        "file": file,
        "mismatch": _mismatch(made.mismatch),
        "mismatch_of_what_is_held": _mismatch(made.kept_mismatch),
        "not_held": [
            {
                **fields(loss, "what", "why"),
                **{f"{key}_percent_of_range": value for key, value in loss.percent_of_range.items()},
            }
            for loss in made.losses
        ],
        "stability": stability_document(made.stability, VELOCITIES),
        **guess_document(guess),
        "warnings": all_warnings(guess, made.warnings),
    }


def _mismatch(mismatch: PlanarMismatch) -> Document:
    percents = {f"{name}_percent_of_range": value for name, value in mismatch.percent_of_range.items()}
    return {**percents, "rms": dict(mismatch.rms), "unit": dict(VELOCITIES)}
