"""Estimates as JSON: drag, inertia, likelihood, thrust curves."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from rovid.estimate.estimate import PER_INERTIA, Estimate, Ratio
from rovid.estimate.free_decay import Quantity, analyse_free_decay
from rovid.estimate.inertia import METHODS, InertiaFit
from rovid.estimate.maximum_likelihood import LikelihoodFit
from rovid.estimate.sine_inertia import InertiaReading
from rovid.estimate.steady_drag import DragFit
from rovid.estimate.steady_points import SteadyPoint
from rovid.estimate.thrust_curve import ThrustCurveFit
from rovid.model.parameter_names import effect_ids
from rovid.model.simulation import HORIZONS
from rovid.signals.preprocessing import PreparedRuns
from rovid.store.study import Study
from rovid.trial.assumptions import Assumptions
from rovid.trial.axis import YAW, Axis

Document = dict[str, Any]


def parameter_document(estimate: Estimate) -> Document:
    """Each determined parameter with value, standard error, unit and 95 % interval."""
    document = {}
    for name in estimate.names:
        if name in estimate.refused:
            continue
        document[name] = {
            "value": estimate.value(name),
            "standard_error": estimate.standard_error(name),
            "unit": estimate.unit(name),
            "interval_95": list(estimate.interval(name)),
        }
        if estimate.is_placeholder(name):
            document[name]["placeholder"] = True
    return document


def guess_document(guess: Assumptions) -> Document:
    """What of the vehicle is a guess, by name."""
    return {"guessed": list(guess.items)}


def all_warnings(guess: Assumptions, warnings: Sequence[str]) -> list[str]:
    """The warnings, and before them what hangs on a guess."""
    return [*filter(None, [guess.caution]), *warnings]


def fit_document(estimate: Estimate, study: Study) -> Document:
    """What every estimate's document begins with."""
    return {
        "schema": "rovid-fit/1",
        "parameters": parameter_document(estimate),
        "effects": effect_ids(estimate.names),
        "log_likelihood": None,
        "samples": estimate.samples,
        "method": estimate.method,
        "not_identifiable": ["thrust_scale", *estimate.refused],
        **axis_document(estimate.axis),
        "filter": None if study.runs is None else filter_document(study.runs),
        **guess_document(estimate.assumptions),
        "ratios": {ratio.name: _ratio(ratio) for ratio in estimate.ratios if estimate.assumptions.ratios_hold},
        "warnings": all_warnings(estimate.assumptions, [*study.remarks(), *estimate.warnings]),
    }


def _ratio(ratio: Ratio) -> Document:
    return {"value": ratio.value, "standard_error": ratio.standard_error, "unit": ratio.unit}


def filter_document(runs: PreparedRuns) -> Document:
    """The low pass and the standard deviation of the sensor noise behind it."""
    measured, rate, acceleration = runs.noise()
    axis = runs.axis
    document: Document = {"cutoff_hz": runs.cutoff, "cutoff_chosen_from_data": runs.chosen}
    # Where the rate was measured the position was integrated from it, and has no noise of its own.
    if not runs.rate_only:
        document[f"{axis.position_signal}_noise"] = {"value": measured, "unit": axis.unit("rad")}
    document[f"{axis.rate_signal}_noise"] = {"value": rate, "unit": axis.rate_unit}
    document["acceleration_noise"] = {"value": acceleration, "unit": f"{axis.rate_unit}^2"}
    return document


def axis_document(axis: Axis) -> Document:
    """The axis, where it is not yaw."""
    return {} if axis is YAW else {"axis": axis.name}


def drag_document(fit: DragFit, study: Study) -> Document:
    """What `rovid fit-drag --json` prints."""
    estimate = fit.estimate
    return fit_document(estimate, study) | {
        "r_squared": fit.r_squared,
        "correlation": estimate.correlation("quadratic_drag", "linear_drag"),
        "degrees_of_freedom": estimate.degrees_of_freedom,
        "different_from_zero": {name: estimate.differs_from_zero(name) for name in estimate.names},
        "steady_states": _steady_states(fit),
        "unsteady": [_point(point, estimate.axis) for point in fit.unsteady],
        "directions": {name: parameter_document(each) for name, each in fit.directions.items()},
    }


def _steady_states(fit: DragFit) -> list[Document]:
    """Each point that was fitted, with what the fit makes of it."""
    document = []
    rows = zip(fit.points, fit.torque_error, fit.residuals, fit.left_out, strict=True)
    for point, error, residual, left_out in rows:
        of_fit = {"torque_error": error, "residual": residual, "left_out": _left_out(left_out)}
        document.append(_point(point, fit.estimate.axis) | of_fit)
    return document


def _point(point: SteadyPoint, axis: Axis) -> Document:
    """A steady state: times in s, torque in N m, rate in rad/s, or their like along another axis."""
    return {
        "source": point.source,
        "start": point.start,
        "stop": point.stop,
        "command": list(point.command),
        axis.force_name: point.torque,
        axis.rate_signal: point.rate,
        f"{axis.rate_signal}_error": point.rate_error,
        "drift": point.drift,
        "drift_error": point.drift_error,
    }


def _left_out(row: np.ndarray[Any, np.dtype[np.float64]]) -> Document:
    """Both drags as found without the point, and how far off its torque is then foretold."""
    return {"quadratic_drag": row[0], "linear_drag": row[1], "torque_prediction_error": row[2]}


def inertia_document(fit: InertiaFit, study: Study) -> Document:
    """What `rovid fit-inertia --json` prints."""
    return fit_document(fit.estimate, study) | {
        "chosen": fit.chosen,
        "methods": {name: _method(name, inertia, fit) for name, inertia in fit.methods.items()},
        "refused": fit.refused,
        "added_inertia": _added_inertia(fit),
    }


def _added_inertia(fit: InertiaFit) -> Document | None:
    if fit.added_inertia is None:
        return None
    return {
        "value": fit.added_inertia,
        "standard_error": fit.estimate.standard_error("inertia"),
        "unit": fit.estimate.unit("inertia"),
    }


def likelihood_document(fit: LikelihoodFit, study: Study) -> Document:
    """What `rovid fit --json` prints."""
    axis = fit.estimate.axis
    measured, unit = axis.position_signal, axis.unit("rad")
    if fit.rate_only:
        measured, unit = axis.rate_signal, axis.rate_unit
    return fit_document(fit.estimate, study) | {
        "log_likelihood": fit.log_likelihood,
        "disturbance": _disturbance(fit),
        f"{measured}_noise_fitted": {"value": fit.position_noise, "unit": unit},
        "innovations_white": fit.white,
        "free_run_r2": {"this_fit": fit.free_run_r2, "simulation_fit": fit.simulation_r2},
        **_decay_document(fit, study),
    }


def _disturbance(fit: LikelihoodFit) -> Document:
    """Standard deviation of the disturbance and its memory in s."""
    unit = fit.estimate.axis.force_unit
    if fit.estimate.per_inertia:
        unit += PER_INERTIA
    return {
        "value": fit.disturbance,
        "unit": unit,
        "correlation_time": {"value": fit.correlation_time, "unit": "s"},
        "limit_share_of_torque": fit.limit,
        "at_limit": fit.at_limit,
    }


def _decay_document(fit: LikelihoodFit, study: Study) -> Document:
    """What a decay test reports, of logs that nothing drives; nothing of others."""
    if study.runs is None or not fit.estimate.per_inertia:
        return {}
    decay = analyse_free_decay(fit.model, fit.estimate, study.runs.items, study.vehicle)
    document = {
        "amplitude": {"value": decay.rms_swing.amplitude, "unit": "rad"},
        "natural_frequency": asdict(decay.natural_frequency),
        "natural_period": asdict(decay.rms_swing.natural_period),
        "damping_ratio": asdict(decay.rms_swing.damping_ratio),
        "damping_terms": _readings(decay.terms),
        "over_inertia": _readings(decay.over_inertia),
        "swings": [asdict(swing) for swing in decay.swings],
    }
    return {"decay": document}


def _readings(readings: Mapping[str, Quantity]) -> Document:
    return {name: asdict(reading) for name, reading in readings.items()}


def position_errors(errors: Mapping[float, float | None], axis: Axis) -> Document:
    """Error of the position at each horizon in s, by its key."""
    return {f"{axis.position_signal}_error_{horizon:.0f}s": error for horizon, error in errors.items()}


def simulation_units(axis: Axis) -> Document:
    """Units of what a simulation's document holds."""
    angles = {f"{axis.position_signal}_error_{horizon:.0f}s": axis.unit("rad") for horizon in HORIZONS}
    return {f"{axis.rate_signal}_rmse": axis.rate_unit, **angles}


def _method(name: str, inertia: InertiaReading, fit: InertiaFit) -> Document:
    document: Document = {
        "value": inertia.value,
        "standard_error": inertia.standard_error,
        "unit": fit.estimate.unit("inertia"),
        "description": METHODS[name],
        "runs": [{"source": s, "value": v, "standard_error": e} for s, v, e in inertia.runs],
        "single_inertia_fits_all": inertia.consistent,
    }
    if name == "peak":
        document["biased"] = True
        document["expected_ratio_to_truth"] = fit.peak_bias
    if name == "regression" and fit.regression is not None:
        regression = fit.regression
        document["parameters"] = parameter_document(regression.estimate)
        document["least_squares"] = dict(zip(regression.estimate.names, regression.least_squares, strict=True))
        document["r_squared"] = regression.r_squared
    return document


def bench_document(fit: ThrustCurveFit, output: str) -> Document:
    """What `rovid fit-thruster --json` prints."""
    thrust = fit.curve.thrust
    return {
        "schema": "rovid-thruster/1",
        "curve": output,
        "points": len(fit.curve.command),
        "dead_zone": None if fit.dead_zone is None else list(fit.dead_zone),
        "thrust_range": [float(thrust.min()), float(thrust.max())],
        "residual_rms": fit.rms,
        "residual_max": float(np.max(np.abs(fit.residuals))),
        "unit": "N",
        "readings": _bench_readings(fit),
    }


def _bench_readings(fit: ThrustCurveFit) -> list[Document]:
    document = []
    for command, thrust, residual in zip(fit.command, fit.thrust, fit.residuals, strict=True):
        reading = {"command": command, "thrust": thrust, "residual": residual}
        document.append(reading)
    return document
