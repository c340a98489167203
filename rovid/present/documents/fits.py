"""Estimates as JSON: drag, inertia, likelihood fits, the coupled model and thrust curves."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from rovid.estimate.estimate import PER_INERTIA, Estimate
from rovid.estimate.inertia import METHODS, InertiaFit
from rovid.estimate.maximum_likelihood import LikelihoodFit
from rovid.estimate.oscillation_tests import analyse_free_decay
from rovid.estimate.steady_drag import DragFit
from rovid.estimate.steady_points import SteadyPoint
from rovid.estimate.thrust_curve import ThrustCurveFit, ThrustScale
from rovid.model.parameter_names import effect_ids, unit_of
from rovid.model.simulation import HORIZONS, FitMeasures
from rovid.planar.fit import PlanarFit
from rovid.planar.manoeuvres import Measures
from rovid.planar.model import SNAME
from rovid.planar.standard_manoeuvres import model_manoeuvres
from rovid.planar.trial_simulation import SENSOR_UNITS
from rovid.planar.uncertainty import Undetermined
from rovid.store.parameter_file import OpenCombination
from rovid.store.planar_study import PlanarStudy, open_combinations
from rovid.store.study import Study
from rovid.trial.assumptions import Assumptions
from rovid.trial.axis import YAW, Axis
from rovid.trial.fault import Fault, fault_texts
from rovid.trial.preprocessing import PreparedRuns

Document = dict[str, Any]
# Parameter -> SNAME (1950) derivative, of which it is the negative.
SNAMES = SNAME | {
    "sway_yaw_damping.yaw_by_sway": "N_v",
    "sway_yaw_damping.sway_by_yaw": "Y_r",
    "sway_yaw_damping:lift.yaw_by_sway": "N_uv",
    "sway_yaw_damping:lift.sway_by_yaw": "Y_ur",
}


def value_document(value: float | None, unit: str, error: float | None = None) -> Document:
    """A value with its unit, and with its standard error where that is given."""
    if error is None:
        return {"value": value, "unit": unit}
    return {"value": value, "standard_error": error, "unit": unit}


def estimate_document(estimate: Estimate, name: str, unit: str | None = None) -> Document:
    """A parameter of an estimate with its standard error."""
    return value_document(estimate.value(name), unit or estimate.unit(name), estimate.standard_error(name))


def without_nan(values: Mapping[str, Any]) -> Document:
    """The values, with None in place of NaN, which JSON does not have."""
    return {key: None if isinstance(value, float) and math.isnan(value) else value for key, value in values.items()}


def fields(source: object, *names: str, **renamed: str) -> Document:
    """Fields of a record by their own names, and by other keys."""
    return {key: getattr(source, name) for key, name in (*zip(names, names, strict=True), *renamed.items())}


def parameter_document(estimate: Estimate) -> Document:
    """Each determined parameter with value, standard error, unit and 95 % interval."""
    document = {}
    for name in estimate.names:
        if name in estimate.refused:
            continue
        document[name] = estimate_document(estimate, name) | {"interval_95": list(estimate.interval(name))}
        if estimate.is_placeholder(name):
            document[name]["placeholder"] = True
        if name in estimate.from_prior:
            document[name]["from_prior"] = True
    return document


def sname_document(name: str) -> Document:
    """The SNAME derivative of a parameter; empty where it has none."""
    return {"sname": SNAMES[name]} if name in SNAMES else {}


def guess_document(guess: Assumptions) -> Document:
    """Properties of the vehicle that are guesses, by name."""
    return {"guessed": list(guess.items)}


def all_warnings(guess: Assumptions, warnings: Sequence[str]) -> list[str]:
    """The caution about assumptions, and the warnings."""
    return [*filter(None, [guess.caution]), *warnings]


def closing_document(guess: Assumptions, warnings: Sequence[str]) -> Document:
    """Guesses and warnings, with which most documents end."""
    return guess_document(guess) | {"warnings": all_warnings(guess, warnings)}


def axis_document(axis: Axis) -> Document:
    """The axis; empty for yaw."""
    return {} if axis is YAW else {"axis": axis.name}


def position_errors(errors: Mapping[float, Any], axis: Axis) -> Document:
    """Position errors with their horizons as keys."""
    return by_horizon(f"{axis.position_signal}_error", errors)


def by_horizon(name: str, errors: Mapping[float, Any]) -> Document:
    """Errors with the horizons in their keys."""
    return {f"{name}_{seconds:.0f}s": error for seconds, error in errors.items()}


def simulation_units(axis: Axis) -> Document:
    """Units of the errors in a simulation's document."""
    return {
        f"{axis.rate_signal}_rmse": axis.rate_unit,
        **position_errors(dict.fromkeys(HORIZONS, axis.unit("rad")), axis),
    }


def fit_document(fit: DragFit | InertiaFit | LikelihoodFit, study: Study) -> Document:
    """The document of `rovid fit-drag`, `rovid fit-inertia` or `rovid fit` with --json."""
    estimate = fit.estimate
    ratios = estimate.ratios if estimate.assumptions.ratios_hold else ()
    document = shared_fit_document(estimate, study) | {
        "log_likelihood": None,
        **axis_document(estimate.axis),
        "filter": _filter_document(study.runs),
        "ratios": {ratio.name: value_document(ratio.value, ratio.unit, ratio.standard_error) for ratio in ratios},
    }
    if isinstance(fit, DragFit):
        return document | _drag(fit)
    return document | (_inertia(fit) if isinstance(fit, InertiaFit) else _likelihood(fit, study))


def shared_fit_document(estimate: Estimate, logs: Study) -> Document:
    """The part that the documents of all fits share."""
    return {
        "schema": "rovid-fit/1",
        "parameters": parameter_document(estimate),
        "effects": effect_ids(estimate.names),
        "samples": estimate.samples,
        "method": estimate.method,
        "not_identifiable": [*["thrust_scale"] * (not logs.vehicle.thrust_scale_error), *estimate.refused],
        **guess_document(estimate.assumptions),
        **notes_document(estimate.assumptions, logs.faults, [*logs.remarks(), *estimate.warnings]),
    }


def notes_document(guess: Assumptions, faults: Sequence[Fault], warnings: Sequence[str]) -> Document:
    """Faults of the logs, and all warnings."""
    return {"faults": fault_documents(faults), "warnings": all_warnings(guess, [*fault_texts(faults), *warnings])}


def fault_documents(faults: Sequence[Fault]) -> list[Document]:
    """One document for each fault of the logs, those that stop a fit first."""
    documents = []
    for fault in sorted(faults, key=lambda fault: not fault.stops):
        document = dict(vars(fault))
        del document["excerpt"], document["may_be_explained"]
        documents.append(document)
    return documents


def _filter_document(runs: PreparedRuns | None) -> Document | None:
    """Cut-off frequency, and standard deviations of the filtered sensor noise; None without logs."""
    if runs is None:
        return None
    measured, rate, acceleration = runs.noise()
    axis = runs.axis
    document: Document = {"cutoff_hz": runs.cutoff, "cutoff_chosen_from_data": runs.chosen}
    # A position that was integrated from the rate has no noise of its own.
    if not runs.rate_only:
        document[f"{axis.position_signal}_noise"] = value_document(measured, axis.unit("rad"))
    document[f"{axis.rate_signal}_noise"] = value_document(rate, axis.rate_unit)
    document["acceleration_noise"] = value_document(acceleration, f"{axis.rate_unit}^2")
    return document


def _drag(fit: DragFit) -> Document:
    estimate, axis = fit.estimate, fit.estimate.axis
    states = []
    for point, error, residual, left_out in zip(fit.points, fit.torque_error, fit.residuals, fit.left_out, strict=True):
        names = ("quadratic_drag", "linear_drag", "torque_prediction_error")
        without = dict(zip(names, left_out, strict=True))
        states.append(_steady_point(point, axis) | {"torque_error": error, "residual": residual, "left_out": without})
    return {
        "r_squared": fit.r_squared,
        "correlation": estimate.correlation("quadratic_drag", "linear_drag"),
        "degrees_of_freedom": estimate.degrees_of_freedom,
        "different_from_zero": {name: estimate.differs_from_zero(name) for name in estimate.names},
        "steady_states": states,
        "unsteady": [_steady_point(point, axis) for point in fit.unsteady],
        "directions": {name: parameter_document(each) for name, each in fit.directions.items()},
    }


def _steady_point(point: SteadyPoint, axis: Axis) -> Document:
    """A steady state: times in s, torque in N m and rate in rad/s, or force in N and rate in m/s."""
    names = {axis.force_name: "torque", axis.rate_signal: "rate", f"{axis.rate_signal}_error": "rate_error"}
    return fields(point, "source", "start", "stop", "command", **names, drift="drift", drift_error="drift_error")


def _inertia(fit: InertiaFit) -> Document:
    estimate, added = fit.estimate, None
    if fit.added_inertia is not None:
        added = value_document(fit.added_inertia, estimate.unit("inertia"), estimate.standard_error("inertia"))
    return {
        "chosen": fit.chosen,
        "methods": {name: _method_document(fit, name) for name in fit.methods},
        "refused": fit.refused,
        "added_inertia": added,
    }


def _method_document(fit: InertiaFit, name: str) -> Document:
    reading = fit.methods[name]
    document = value_document(reading.value, fit.estimate.unit("inertia"), reading.standard_error) | {
        "description": METHODS[name],
        "runs": [{"source": s, "value": v, "standard_error": e} for s, v, e in reading.runs],
        "single_inertia_fits_all": reading.consistent,
    }
    if name == "peak":
        document |= {"biased": True, "expected_ratio_to_truth": fit.peak_bias}
    if name == "regression" and fit.regression is not None:
        regression = fit.regression
        names = regression.estimate.names
        document |= {
            "parameters": parameter_document(regression.estimate),
            "least_squares": dict(zip(names, regression.least_squares, strict=True)),
            "r_squared": regression.r_squared,
        }
    return document


def _likelihood(fit: LikelihoodFit, study: Study) -> Document:
    axis = fit.estimate.axis
    measured, unit = axis.position_signal, axis.unit("rad")
    if fit.rate_only:
        measured, unit = axis.rate_signal, axis.rate_unit
    force_unit = axis.force_unit + (PER_INERTIA if fit.estimate.per_inertia else "")
    document: Document = {
        "log_likelihood": fit.log_likelihood,
        "disturbance": {
            "value": fit.disturbance,
            "unit": force_unit,
            "correlation_time": value_document(fit.correlation_time, "s"),
            "limit_share_of_torque": fit.limit,
            "at_limit": fit.at_limit,
        },
        f"{measured}_noise_fitted": value_document(fit.position_noise, unit),
        "innovations_white": fit.white,
        "free_run_r2": {"this_fit": fit.free_run_r2, "simulation_fit": fit.simulation_r2},
    }
    if study.runs is not None and fit.estimate.per_inertia:
        # Results of a free-decay test.
        decay = analyse_free_decay(fit.model, fit.estimate, study.runs.items, study.vehicle)
        document["decay"] = {
            "amplitude": value_document(decay.rms_swing.amplitude, "rad"),
            "natural_frequency": asdict(decay.natural_frequency),
            "natural_period": asdict(decay.rms_swing.natural_period),
            "damping_ratio": asdict(decay.rms_swing.damping_ratio),
            "damping_terms": {name: asdict(quantity) for name, quantity in decay.terms.items()},
            "over_inertia": {name: asdict(quantity) for name, quantity in decay.over_inertia.items()},
            "swings": list(map(asdict, decay.swings)),
        }
    return document


def thrust_scale_document(scale: ThrustScale, given: float) -> Document:
    """The document of `rovid fit-thrust-scale --json`; ``given`` is the scale that rovid.toml has already."""
    value = value_document(given * scale.value, "1", given * scale.standard_error)
    return {
        "schema": "rovid-thrust-scale/1",
        "thrust_scale": value | {"interval_95": [given * edge for edge in scale.interval()]},
        "thrust_scale_error": given * scale.error_for_fits,
        "scatter": scale.scatter,
        "reference_error": scale.reference_error,
        "readings": scale.readings,
        "method": scale.method,
    }


def bench_document(fit: ThrustCurveFit, output: str) -> Document:
    """The document of `rovid fit-thruster --json`."""
    thrust = fit.curve.thrust
    readings = zip(fit.command, fit.thrust, fit.residuals, strict=True)
    return {
        "schema": "rovid-thruster/1",
        "curve": output,
        "points": len(fit.curve.command),
        "dead_zone": None if fit.dead_zone is None else list(fit.dead_zone),
        "thrust_range": [float(thrust.min()), float(thrust.max())],
        "residual_rms": fit.rms,
        "residual_max": float(np.max(np.abs(fit.residuals))),
        "unit": "N",
        "readings": [{"command": c, "thrust": t, "residual": r} for c, t, r in readings],
    }


AXES_DOCUMENT = {"axes": "planar"}


def planar_parameters(estimate: Estimate) -> Document:
    """Each determined parameter with value, standard error, unit, 95 % interval and SNAME derivative."""
    document = parameter_document(estimate)
    return {name: entry | sname_document(name) for name, entry in document.items()}


def undetermined_document(combinations: Sequence[OpenCombination | Undetermined]) -> list[Document]:
    """Combinations of parameters that the logs do not determine."""
    return [{"combination": dict(one.combination), "text": one.text} for one in combinations]


def prior_document(fit: PlanarFit) -> Document:
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
        **prior_document(fit),
        "log_likelihood": fit.log_likelihood,
        "noise": {sensor: value_document(size, SENSOR_UNITS[sensor]) for sensor, size in fit.noise.items()},
        "disturbance": disturbance,
        "latency": {sensor: value_document(late, "s", error) for sensor, (late, error) in fit.latency.items()},
        "innovations_white": fit.white,
        "criterion": "multi_step" if fit.multi_step else "innovations",
        "free_run_r2": dict(fit.free_run_r2),
        "standard_manoeuvres": measures_document(model_manoeuvres(fit, study.data)),
    }


def planar_measures(fits: Mapping[str, FitMeasures], *names: str) -> Document:
    """Measures of a simulation by sensor and name."""
    return {f"{sensor}_{name}": getattr(fit, name) for sensor, fit in fits.items() for name in names}


def measures_document(measures: Measures) -> Document:
    """Measures of manoeuvres by name, each with value, unit and standard error; null where that is not known."""
    return {name: asdict(measure) for name, measure in measures.items()}
