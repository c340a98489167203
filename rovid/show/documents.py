"""Results as the JSON documents that other programs rely on."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from rovid.campaign.axis import YAW, Axis
from rovid.campaign.trial import Remark, Trial
from rovid.control.design import Control, RunResult
from rovid.diagnose.amplitudes import Amplitudes
from rovid.diagnose.experiments import deciding_experiment, next_experiment
from rovid.diagnose.record import Ahead, Diagnosis, Finding, Side, not_identifiable
from rovid.diagnose.signals import is_driver, signal_of
from rovid.export import Exported
from rovid.export.manoeuvre import Mismatch
from rovid.identify.bench import BenchFit
from rovid.identify.decay import Reading, read_decay
from rovid.identify.estimate import PER_INERTIA, Estimate
from rovid.identify.inertia import METHODS, InertiaFit
from rovid.identify.likelihood import LikelihoodFit
from rovid.identify.sine import Inertia
from rovid.identify.steady import DragFit, SteadyPoint
from rovid.inspect.advice import Advice
from rovid.inspect.check import remark_document
from rovid.inspect.first_config import Survey
from rovid.model.model import effect_ids, unit_of, without_form
from rovid.model.simulation import HORIZONS, TrialSimulation, overall
from rovid.motion.runs import Runs
from rovid.parameters.parameters import Parameters
from rovid.plan.design import Plan, command_rows
from rovid.study import Study

Document = dict[str, Any]


def parameter_document(estimate: Estimate) -> Document:
    """Each determined parameter with value, standard error, unit and 95 % interval."""
    return {
        name: {
            "value": estimate.value(name),
            "standard_error": estimate.standard_error(name),
            "unit": estimate.unit(name),
            "interval_95": list(estimate.interval(name)),
        }
        for name in estimate.names
        if name not in estimate.refused
    }


def _fit_document(estimate: Estimate, study: Study) -> Document:
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
        "warnings": [*study.remarks(), *estimate.warnings],
    }


def filter_document(runs: Runs) -> Document:
    """The low pass and the standard deviation of the sensor noise behind it."""
    measured, rate, acceleration = runs.noise()
    axis = runs.axis
    noise = {f"{axis.rate}_noise": {"value": rate, "unit": axis.rate_unit}}
    if not runs.integrated:
        noise = {f"{axis.position}_noise": {"value": measured, "unit": axis.unit("rad")}} | noise
    return {
        "cutoff_hz": runs.cutoff,
        "cutoff_chosen_from_data": runs.chosen,
        **noise,
        "acceleration_noise": {"value": acceleration, "unit": f"{axis.rate_unit}^2"},
    }


def axis_document(axis: Axis) -> Document:
    """The axis, where it is not yaw."""
    return {} if axis is YAW else {"axis": axis.name}


def drag_document(fit: DragFit, study: Study) -> Document:
    """What `rovid fit-drag --json` prints."""
    estimate = fit.estimate
    return _fit_document(estimate, study) | {
        "r_squared": fit.r_squared,
        "correlation": estimate.correlation("quadratic_drag", "linear_drag"),
        "degrees_of_freedom": estimate.degrees_of_freedom,
        "different_from_zero": {name: estimate.differs_from_zero(name) for name in estimate.names},
        "steady_states": [
            _point(point, estimate.axis) | {"torque_error": error, "residual": residual, "left_out": _left_out(row)}
            for point, error, residual, row in zip(
                fit.points, fit.torque_error, fit.residuals, fit.left_out, strict=True
            )
        ],
        "unsteady": [_point(point, estimate.axis) for point in fit.unsteady],
        "directions": {name: parameter_document(each) for name, each in fit.directions.items()},
    }


def _point(point: SteadyPoint, axis: Axis) -> Document:
    return {
        "source": point.source,
        "start": point.start,
        "stop": point.stop,
        "command": list(point.command),
        axis.push: point.torque,
        axis.rate: point.rate,
        f"{axis.rate}_error": point.rate_error,
        "drift": point.drift,
        "drift_error": point.drift_error,
    }


def _left_out(row: np.ndarray[Any, np.dtype[np.float64]]) -> Document:
    return {"quadratic_drag": row[0], "linear_drag": row[1], "torque_prediction_error": row[2]}


def inertia_document(fit: InertiaFit, study: Study) -> Document:
    """What `rovid fit-inertia --json` prints."""
    return _fit_document(fit.estimate, study) | {
        "chosen": fit.chosen,
        "methods": {name: _method(name, inertia, fit) for name, inertia in fit.methods.items()},
        "refused": fit.refused,
        "added_inertia": None
        if fit.added_inertia is None
        else {
            "value": fit.added_inertia,
            "standard_error": fit.estimate.standard_error("inertia"),
            "unit": fit.estimate.unit("inertia"),
        },
    }


def likelihood_document(fit: LikelihoodFit, study: Study) -> Document:
    """What `rovid fit --json` prints."""
    axis = fit.estimate.axis
    measured, unit = (axis.rate, axis.rate_unit) if fit.integrated else (axis.position, axis.unit("rad"))
    return _fit_document(fit.estimate, study) | {
        "log_likelihood": fit.log_likelihood,
        "disturbance": {
            "value": fit.disturbance,
            "unit": axis.push_unit + (PER_INERTIA if fit.estimate.per_inertia else ""),
            "correlation_time": {"value": fit.correlation_time, "unit": "s"},
            "limit_share_of_torque": fit.limit,
            "at_limit": fit.at_limit,
        },
        f"{measured}_noise_fitted": {"value": fit.position_noise, "unit": unit},
        "innovations_white": fit.white,
        "free_run_r2": {"this_fit": fit.free_run_r2, "simulation_fit": fit.base_r2},
        **_decay_document(fit, study),
    }


def _decay_document(fit: LikelihoodFit, study: Study) -> Document:
    """What a decay test reports, of logs that nothing drives; nothing of others."""
    if study.runs is None or not fit.estimate.per_inertia:
        return {}
    decay = read_decay(fit.model, fit.estimate, study.runs.items, study.vehicle)

    def shown(readings: Mapping[str, Reading]) -> Document:
        return {name: asdict(reading) for name, reading in readings.items()}

    return {
        "decay": {
            "amplitude": {"value": decay.usual.amplitude, "unit": "rad"},
            "natural_frequency": asdict(decay.natural_frequency),
            "natural_period": asdict(decay.usual.natural_period),
            "damping_ratio": asdict(decay.usual.damping_ratio),
            "damping_terms": shown(decay.terms),
            "over_inertia": shown(decay.over_inertia),
            "swings": [asdict(swing) for swing in decay.swings],
        }
    }


def diagnosis_document(diagnosis: Diagnosis, study: Study) -> Document:
    """What `rovid diagnose --json` prints."""
    base, extended, axis = diagnosis.base, diagnosis.extended, study.vehicle.axis
    return {
        "schema": "rovid-diagnosis/1",
        **axis_document(axis),
        "verdict": diagnosis.verdict,
        "base": _side(base, axis),
        "findings": [_finding(finding) for finding in diagnosis.findings],
        "suspects": [_finding(suspect) for suspect in diagnosis.suspects],
        "horizons": [_ahead(ahead, axis) for ahead in diagnosis.horizons],
        "extended": _side(extended, axis),
        "held_out_gain": None
        if base is None or extended is None
        else _gain(base, extended, diagnosis.noise_floor, axis),
        "unexplained": {
            "share_of_torque_variance": diagnosis.unexplained_share,
            "depends_on": list(dict.fromkeys(signal_of(signal) for signal, _ in diagnosis.signals)),
            "signals": [
                {"signal": signal_of(signal), "acts_as": signal.form, "log_likelihood_gain": gain}
                for signal, gain in diagnosis.signals
            ],
        },
        "not_identifiable": list(not_identifiable(study.vehicle)),
        "detectable": {
            f"{effect.id}.{effect.parameters[0].name}": {
                "value": size if math.isfinite(size) else None,
                "unit": unit_of(f"{effect.key}.{effect.parameters[0].name}", axis),
            }
            for effect, size in diagnosis.detectable
        },
        "next_experiment": next_experiment(diagnosis),
        "missing": diagnosis.missing or None,
        **({} if diagnosis.amplitudes is None else {"tables": _tables(diagnosis.amplitudes)}),
        "warnings": [*study.remarks(), *diagnosis.warnings],
    }


def _tables(amplitudes: Amplitudes) -> Document:
    return {
        "predictions": [
            {
                "trial": each.trial,
                "inertia": each.inertia,
                "inertia_method": each.method,
                "peak_yaw_rate": {"measured": each.measured, "predicted": each.predicted, "unit": "rad/s"},
            }
            for each in amplitudes.predictions
        ],
        "plain_model_explains": amplitudes.plain.explains,
        "would_explain": [
            {
                "effect": (effect := cause.model.effects[0]).id,
                "form": effect.form or None,
                "parameters": {name: {"value": value, "unit": unit} for name, (value, unit) in cause.sizes.items()},
                "inertia": cause.model.inertia,
                "chance_of_the_misfit": None if math.isnan(cause.chance) else cause.chance,
                "deciding_experiment": effect.experiment,
            }
            for cause in amplitudes.causes
        ],
        "would_not_explain": [effect.id for effect in amplitudes.ruled_out],
    }


def _side(side: Side | None, axis: Axis) -> Document | None:
    if side is None:
        return None
    held = side.held_out
    return {
        "parameters": {
            # A form of an effect goes by the effect's name: which form fits best is said with the finding.
            without_form(name): value
            for name, value in parameter_document(side.estimate).items()
        },
        "held_out": {
            "log_likelihood": held.log_likelihood,
            f"{axis.rate}_r2": held.rate_r2,
            f"{axis.rate}_rmse": held.rate_rmse,
            **_position_errors(held.position_errors, axis),
            "units": _units(axis),
        },
    }


def _ahead(ahead: Ahead, axis: Axis) -> Document:
    unit = "deg" if axis.angular else "m"
    errors = {f"base_{unit}": ahead.base, f"extended_{unit}": ahead.extended}
    return {"seconds": ahead.seconds, **{name: axis.in_shown(error) for name, error in errors.items()}}


def _position_errors(errors: Mapping[float, float | None], axis: Axis) -> Document:
    return {f"{axis.position}_error_{horizon:.0f}s": error for horizon, error in errors.items()}


def _units(axis: Axis) -> Document:
    angles = {f"{axis.position}_error_{horizon:.0f}s": axis.unit("rad") for horizon in HORIZONS}
    return {f"{axis.rate}_rmse": axis.rate_unit, **angles}


def _finding(finding: Finding) -> Document:
    effect, rivals = finding.effect, [rival for rival in finding.rivals if not is_driver(rival.effect)]
    return {
        "effect": effect.id,
        "form": effect.form or None,
        "parameters": {without_form(n).rpartition(".")[2]: v for n, v in parameter_document(finding.estimate).items()},
        "log_likelihood_gain": finding.gain,
        "held_out_log_likelihood_gain": finding.held_out_gain,
        "runner_up": {"effect": rivals[0].effect.id, "gain": rivals[0].gain} if rivals else None,
        "confidence": finding.confidence,
        "cannot_be_told_from": [other.id for other in finding.undecided],
        "deciding_experiment": deciding_experiment(finding),
    }


def _gain(base: Side, extended: Side, floor: float, axis: Axis) -> Document:
    def pair(before: float | None, after: float | None, unit: str) -> Document:
        return {"base": before, "extended": after, "unit": unit}

    one, other = base.held_out, extended.held_out
    return {
        f"{axis.rate}_rmse": pair(one.rate_rmse, other.rate_rmse, axis.rate_unit) | {"noise_floor": floor},
        f"{axis.rate}_r2": pair(one.rate_r2, other.rate_r2, "1"),
        **{
            f"{axis.position}_error_{horizon:.0f}s": pair(error, other.position_errors[horizon], axis.unit("rad"))
            for horizon, error in one.position_errors.items()
        },
        "log_likelihood": pair(one.log_likelihood, other.log_likelihood, "1"),
    }


def _method(name: str, inertia: Inertia, fit: InertiaFit) -> Document:
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
        document["parameters"] = parameter_document(fit.regression.estimate)
        document["least_squares"] = dict(zip(fit.regression.estimate.names, fit.regression.least_squares, strict=True))
        document["r_squared"] = fit.regression.r_squared
    return document


def simulation_document(
    parameters: Parameters, simulations: Sequence[TrialSimulation], warnings: Sequence[str]
) -> Document:
    """What `rovid simulate --json` prints; position errors in rad or m."""
    total, axis = overall(simulations), parameters.axis
    return {
        "schema": "rovid-simulation/1",
        **axis_document(axis),
        "parameters": {
            name: {"value": entry.value, "standard_error": entry.standard_error, "unit": entry.unit}
            for name, entry in parameters.entries.items()
        },
        "effects": parameters.effects,
        "trials": [_trial_simulation(item) for item in simulations],
        "overall": {
            f"{axis.rate}_r2": total.r2,
            f"{axis.rate}_fit_percent": total.fit_percent,
            f"{axis.rate}_rmse": total.rmse,
        },
        "units": _units(axis),
        "warnings": list(warnings),
    }


def _trial_simulation(item: TrialSimulation) -> Document:
    axis = item.run.trial.axis
    return {
        "name": item.run.trial.name,
        "samples": item.fit.samples,
        f"{axis.rate}_r2": item.fit.r2,
        f"{axis.rate}_fit_percent": item.fit.fit_percent,
        f"{axis.rate}_rmse": item.fit.rmse,
        **_position_errors(item.position_errors, axis),
    }


def plan_document(found: Plan, axis: Axis, command_file: str, picture: str) -> Document:
    """What `rovid plan --json` prints."""
    times, rows = command_rows(found.best)
    return {
        "schema": "rovid-plan/1",
        **axis_document(axis),
        "between": [belief.name for belief in found.beliefs] if len(found.beliefs) > 1 else None,
        "narrow": found.narrow or None,
        "decides": found.decides,
        "runs": [
            {"run": one.run.name, "seconds": one.run.seconds, "gain": one.gain, "gain_per_minute": one.per_minute}
            for one in found.runs
        ],
        "gain": "expected log-likelihood ratio" if len(found.beliefs) > 1 else "logarithm of the ratio of variances",
        "command_file": command_file,
        "picture": picture,
        "commands": {"time_s": times} | {name: [row[k] for row in rows] for k, name in enumerate(found.thrusters)},
    }


def control_document(result: Control, warnings: Sequence[str]) -> Document:
    """What `rovid control --json` prints; times in s, angles in deg, torques in N m, frequencies in rad/s."""
    law, margins, spread = result.law, result.margins, result.spread
    return {
        "schema": "rovid-control/1",
        "gains": {"kp": law.kp, "kd": law.kd},
        "damping_ratio": result.damping,
        "bandwidth": result.bandwidth,
        "margins": {"gain_db": margins.gain_db, "phase_deg": margins.phase_deg, "delay_s": margins.delay_s},
        "stable": margins.stable,
        "gain_down_db": margins.gain_down_db,
        "lag_margin_s": margins.lag_s,
        "crossover": margins.crossover,
        "sensitivity_peak": margins.sensitivity_peak,
        "lag": {
            "total": result.lag,
            "delay": result.setting.delay,
            "period": law.period,
            "rate_filter": law.rate_filter,
        },
        "torque_limits": [law.lowest, law.highest],
        "torque_in_use": result.setting.torque_in_use,
        "monte_carlo": None if spread is None else vars(spread),
        "effects": [effect.key for effect in result.model.effects],
        "runs": [_closed_run(run) for run in result.runs],
        "units": {"kp": "N m/rad", "kd": "N m s/rad", "bandwidth": "rad/s", "crossover": "rad/s", "effort": "N m"},
        "warnings": list(warnings),
    }


def _closed_run(run: RunResult) -> Document:
    found = run.measures
    return {
        "name": run.name,
        "effects": list(run.effects),
        "model_aid": run.model_aid,
        "effects_known": run.effects_known,
        "time_constant": found.time_constant,
        "rise_time": found.rise_time,
        "settling_time": found.settling_time,
        "overshoot_deg": found.overshoot_deg,
        "steady_error_deg": found.steady_error_deg,
        "effort": found.effort,
        "effort_change": found.effort_change,
        "limit_cycle": None if found.limit_cycle is None else vars(found.limit_cycle),
    }


def bench_document(fit: BenchFit, output: str) -> Document:
    """What `rovid fit-thruster --json` prints."""
    return {
        "schema": "rovid-thruster/1",
        "curve": output,
        "points": len(fit.curve.command),
        "dead_zone": None if fit.dead_zone is None else list(fit.dead_zone),
        "thrust_range": [float(fit.curve.thrust.min()), float(fit.curve.thrust.max())],
        "residual_rms": fit.rms,
        "residual_max": float(np.max(np.abs(fit.residuals))),
        "unit": "N",
        "readings": [
            {"command": c, "thrust": t, "residual": r}
            for c, t, r in zip(fit.command, fit.thrust, fit.residuals, strict=True)
        ],
    }


def export_document(name: str, file: str, made: Exported) -> Document:
    """What `rovid export --json` prints; percentages are of the range of the yaw rate on the manoeuvre."""
    return {
        "schema": "rovid-export/1",
        "format": name,
        "file": file,
        "mismatch": _mismatch(made.mismatch),
        "mismatch_of_what_is_held": _mismatch(made.held),
        "not_held": [
            {"what": loss.what, "why": loss.why, "yaw_rate_percent_of_range": loss.percent_of_range}
            for loss in made.losses
        ],
        "warnings": list(made.warnings),
    }


def _mismatch(mismatch: Mismatch) -> Document:
    return {"yaw_rate_percent_of_range": mismatch.percent_of_range, "rms": mismatch.rms, "unit": "rad/s"}


def survey_document(found: Survey, written: Sequence[Path]) -> Document:
    """What `rovid init --json` prints."""
    return {
        "schema": "rovid-init/1",
        "written": [str(path) for path in written],
        "logs": found.logs,
        "curve": {"file": found.curve, "guessed": found.curve_guessed is not None},
        "signals": {
            kind: {
                name: {"source": one.source, "unit": one.unit or None, "sign": one.sign, "why": one.why}
                for name, one in guesses.signals.items()
            }
            for kind, guesses in found.guesses.items()
        },
        "commands": {
            kind: [{"name": o.name, "source": o.source, "turns": o.way, "why": o.why} for o in guesses.commands]
            for kind, guesses in found.guesses.items()
        },
        "warnings": list(found.lacking),
    }


def check_document(
    axis: Axis,
    trials: Sequence[tuple[Trial, Mapping[str, Any]]],
    problems: Mapping[str, str],
    remarks: Sequence[Remark],
    advice: Sequence[Advice],
) -> Document:
    """What `rovid check --json` prints."""
    return {
        "schema": "rovid-check/1",
        **axis_document(axis),
        "logs": [{"name": trial.name} | dict(facts) for trial, facts in trials],
        "unreadable": [{"name": name, "problem": problem} for name, problem in problems.items()],
        "remarks": [remark_document(remark) for remark in remarks],
        "advice": [{"kind": one.kind, "text": one.text} for one in advice],
    }
