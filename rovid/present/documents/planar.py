"""Results of the coupled model of surge, sway and yaw as JSON."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict

from rovid.estimate.estimate import Estimate
from rovid.model.parameter_names import effect_ids
from rovid.planar.experiment import PlanarPlan
from rovid.planar.fit import PlanarFit
from rovid.planar.model import SNAME
from rovid.planar.standard_manoeuvres import RunManoeuvre
from rovid.planar.trial_simulation import SENSOR_UNITS, PlanarTrialSimulation, pooled_measures
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
from rovid.present.documents.results import plan_document
from rovid.store.parameter_file import OpenCombination, Parameters
from rovid.store.planar_study import PlanarStudy, open_combinations
from rovid.trial.assumptions import Assumptions
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


def undetermined_document(combinations: Sequence[OpenCombination]) -> list[Document]:
    """Combinations of parameters that the logs do not determine."""
    return [{"combination": dict(one.combination), "text": one.text} for one in combinations]


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
    return {
        "schema": "rovid-simulation/1",
        **AXES_DOCUMENT,
        "parameters": entries,
        "undetermined": undetermined_document(parameters.undetermined),
        "effects": parameters.effects,
        "trials": [_trial_document(item) for item in simulations],
        "overall": _measures(pooled_measures(simulations)),
        "manoeuvres": list(map(manoeuvre_document, manoeuvres)),
        "units": _units(),
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


def _units() -> Document:
    units = {f"{sensor}_rmse": unit for sensor, unit in SENSOR_UNITS.items()}
    return units | {"heading_error": "rad", "track_error": "m"}


def manoeuvre_document(one: RunManoeuvre) -> Document:
    """A manoeuvre that was recognised in a run; angles in rad."""
    return {
        **fields(one, "run", "kind", "begin", "end", "steering"),
        "measured": {name: asdict(measure) for name, measure in one.measured.items()},
        "simulated": {name: asdict(measure) for name, measure in one.simulated.items()},
    }


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
