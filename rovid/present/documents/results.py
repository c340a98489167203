"""Simulations, plans, controllers, exports, surveys, checks and trials of effects as JSON."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path

from rovid.control.actuators import AutopilotLaw
from rovid.control.design import ControllerDesign
from rovid.diagnose.effect_trial import EffectTrial
from rovid.diagnose.formulas.search import Discovery, units_of
from rovid.estimate.experiment_design import ExperimentPlan, commands_by_name
from rovid.estimate.isolability import IsolabilityMatrix
from rovid.export.verification import Mismatch, VerifiedExport
from rovid.model.model import Model
from rovid.model.simulation import FitMeasures, TrialSimulation, pooled_fit
from rovid.planar.experiment import PlanarPlan
from rovid.planar.standard_manoeuvres import RunManoeuvre
from rovid.planar.trial_simulation import SENSOR_UNITS, PlanarTrialSimulation, pooled_measures
from rovid.preflight.check import CheckedLogs, LogCheck, remark_document
from rovid.preflight.clock_alignment import ClockOffset
from rovid.preflight.config_writer import assumptions_in
from rovid.preflight.log_survey import LogSurvey
from rovid.preflight.planar_check import PlanarCheck
from rovid.present.documents import fits
from rovid.store.parameter_file import Parameters
from rovid.trial.assumptions import Assumptions
from rovid.trial.axis import PLANAR, Axis
from rovid.trial.vehicle import Vehicle

_MEASURES = ("r2", "fit_percent", "rmse")
_CONTROL_UNITS = {"kp": "N m/rad", "kd": "N m s/rad", "bandwidth": "rad/s", "crossover": "rad/s", "effort": "N m"}


def simulation_document(
    parameters: Parameters, simulations: Sequence[TrialSimulation], warnings: Sequence[str], guess: Assumptions
) -> fits.Document:
    """The document of `rovid simulate --json`; position errors in rad or m."""
    axis = parameters.axis
    trials = []
    for item in simulations:
        measures = _fit_measures(item.fit, axis) | fits.position_errors(item.position_errors, axis)
        trials.append({"name": item.run.trial.name, "samples": item.fit.samples, **measures})
    return shared_simulation_document(parameters, warnings, guess) | {
        **fits.axis_document(axis),
        "trials": trials,
        "overall": _fit_measures(pooled_fit(simulations), axis),
        "units": fits.simulation_units(axis),
    }


def shared_simulation_document(parameters: Parameters, warnings: Sequence[str], guess: Assumptions) -> fits.Document:
    """The part that the documents of all simulations share."""
    entries = {}
    for name, entry in parameters.entries.items():
        entries[name] = fits.value_document(entry.value, entry.unit, entry.standard_error)
        if guess.is_placeholder(entry.unit):
            entries[name]["placeholder"] = True
        entries[name] |= fits.sname_document(name)
    return {
        "schema": "rovid-simulation/1",
        "parameters": entries,
        "effects": parameters.effects,
        **fits.closing_document(guess, warnings),
    }


def _fit_measures(fit: FitMeasures, axis: Axis) -> fits.Document:
    return {f"{axis.rate_signal}_{name}": getattr(fit, name) for name in _MEASURES}


def plan_document(
    plan: ExperimentPlan, vehicle: Vehicle, command_file: str, picture: str, warnings: Sequence[str]
) -> fits.Document:
    """The document of `rovid plan --json`."""
    runs = [
        fits.fields(one.run, "seconds", run="name") | fits.fields(one, "gain", "gain_per_minute") for one in plan.runs
    ]
    between, gain = None, "logarithm of the ratio of variances"
    if len(plan.models) > 1:
        between = [model.name for model in plan.models]
        gain = "expected log-likelihood ratio"
    return {
        "schema": "rovid-plan/1",
        **fits.axis_document(vehicle.axis),
        "between": between,
        "narrow": plan.parameter or None,
        "reason": plan.reason,
        "decides": plan.is_decisive,
        "runs": runs,
        "gain": gain,
        "command_file": command_file,
        "picture": picture,
        "commands": commands_by_name(plan),
        **fits.closing_document(vehicle.assumptions, warnings),
    }


def estimated_model_sentence(model: Model) -> str:
    """A sentence on a ``model`` that was estimated without a log, with its parameters."""
    units = (model.axis.unit(unit) for unit in ("kg m^2", "N m s^2/rad^2", "N m s/rad"))
    values = (model.inertia, model.quadratic_drag, model.linear_drag)
    names = ("inertia", "quadratic drag", "linear drag")
    listed = ", ".join(f"{name} {value:.2g} {unit}" for name, value, unit in zip(names, values, units, strict=True))
    text = "There is no log yet: the model is estimated from mass and size, and may be wrong by a factor of three"
    return f"{text} ({listed}). Repeat this with the first logs."


def matrix_document(matrix: IsolabilityMatrix, vehicle: Vehicle, warnings: Sequence[str]) -> fits.Document:
    """The document of `rovid plan --matrix --json`; null for a pair that is never separated."""
    pairs = []
    for pair in matrix.pairs:
        document = {"between": [pair.first, pair.second], "separated": pair.seconds <= matrix.seconds}
        document |= {"expected_log_likelihood_ratio": pair.gain, "seconds": _finite(pair.seconds)}
        pairs.append(document | {"with_sensor": {name: _finite(time) for name, time in pair.with_sensor.items()}})
    sensors = []
    for name, causes in matrix.sensor_causes.items():
        separates = [[pair.first, pair.second] for pair in matrix.separated_by(name)]
        sensors.append({"sensor": name, "separates": separates, "causes": list(causes)})
    return {
        "schema": "rovid-matrix/1",
        **fits.axis_document(vehicle.axis),
        "programme": {"runs": list(matrix.runs), "seconds": matrix.seconds},
        "causes": [{"effect": cause.name, "parameters": cause.effect.values(cause.values)} for cause in matrix.causes],
        "not_visible": list(matrix.invisible),
        "separated": len(matrix.pairs) - len(matrix.open_pairs),
        "pairs": pairs,
        "sensors": sensors,
        **fits.closing_document(vehicle.assumptions, warnings),
    }


def _finite(seconds: float) -> float | None:
    return seconds if math.isfinite(seconds) else None


def control_document(design: ControllerDesign, warnings: Sequence[str], guess: Assumptions) -> fits.Document:
    """The document of `rovid control --json`; times in s, angles in deg, torques in N m, frequencies in rad/s."""
    law, margins, spread = design.law, design.margins, design.spread
    lag = {"total": design.lag, "delay": design.conditions.delay, "period": law.period}
    own: fits.Document = {"law": design.autopilot or "model"}
    if isinstance(law, AutopilotLaw):
        own |= {"autopilot_parameters": design.autopilot_parameters, "torque_of_full_output": law.full}
    else:
        lag["rate_filter"] = law.rate_filter
    names = ("name", "effects", "model_aid", "effects_known")
    runs = [fits.fields(run, *names) | asdict(run.metrics) for run in design.runs]
    return {
        "schema": "rovid-control/1",
        **own,
        "gains": fits.fields(law, "kp", "kd"),
        "damping_ratio": design.damping,
        "bandwidth": design.bandwidth,
        "margins": fits.fields(margins, "gain_db", "phase_deg", "delay_s"),
        **fits.fields(margins, "stable", "gain_down_db", "crossover", "sensitivity_peak", lag_margin_s="lag_s"),
        "lag": lag,
        "torque_limits": [design.allocation.lowest, design.allocation.highest],
        "torque_in_use": design.conditions.torque_in_use,
        "monte_carlo": None if spread is None else vars(spread),
        "effects": [effect.key for effect in design.model.effects],
        "runs": runs,
        "units": dict(_CONTROL_UNITS),
        **fits.closing_document(guess, warnings),
    }


def export_document(name: str, file: str, made: VerifiedExport, guess: Assumptions) -> fits.Document:
    """The document of `rovid export --json`; percentages are of the range of a velocity in the manoeuvre."""
    verdict = made.stability
    document: fits.Document = {
        "schema": "rovid-export/1",
        "format": name,
        "file": file,
        "mismatch": _mismatch(made, made.mismatch),
        "mismatch_of_what_is_held": _mismatch(made, made.kept_mismatch),
        "not_held": [fits.fields(loss, "what", "why") | _percentages(loss.percent_of_range) for loss in made.losses],
        "stability": {
            **fits.fields(verdict, "stable", "step", "largest_stable_step", time_to_rest="rest_time"),
            "from": dict(zip(made.velocities, verdict.envelope[-len(made.velocities) :], strict=True)),
            "text": verdict.text,
        },
        **fits.closing_document(guess, made.warnings),
    }
    if made.is_planar:
        return document | {"axes": PLANAR.name}
    return document | {"trim": [one._asdict() for one in made.trim]}


def _mismatch(made: VerifiedExport, mismatch: Mismatch) -> fits.Document:
    percent = _percentages(mismatch.percent_of_range)
    if made.is_planar:
        return {**percent, "rms": dict(mismatch.rms), "unit": dict(made.velocities)}
    return {"rms": mismatch.rms["yaw_rate"], **percent, "unit": made.velocities["yaw_rate"]}


def _percentages(percent: Mapping[str, float]) -> fits.Document:
    return {f"{name}_percent_of_range": value for name, value in percent.items()}


def survey_document(survey: LogSurvey, written: Sequence[Path]) -> fits.Document:
    """The document of `rovid init --json`."""
    signals, commands, rudders, unused = fits.Document(), fits.Document(), fits.Document(), fits.Document()
    for kind, mapping in survey.mappings.items():
        signals[kind], commands[kind], rudders[kind], unused[kind] = {}, [], [], list(mapping.unused)
        for name, guess in mapping.signals.items():
            unit = guess.unit or None
            signals[kind][name] = {"source": guess.source, "unit": unit, "sign": guess.sign, "why": guess.reason}
        for command in mapping.commands:
            document = fits.fields(command, "name", "source", "lowest", "highest", why="reason", rests_at="neutral")
            document |= {"turns": command.direction, "told": command.direction_known, "arm": command.arm or None}
            observed = fits.fields(command.observed, standard_errors="t_statistic", share="explained_share")
            commands[kind].append(document | observed)
        for one in mapping.rudders:
            document = {"name": one.name, **fits.fields(one.angle, "source", "unit", why="reason")}
            document["size"] = "coefficient" if one.wheelbase is None else "wheelbase"
            document["value"] = one.wheelbase if one.given is None else one.given
            rudders[kind].append(document | {"given": one.given is not None})
    return {
        "schema": "rovid-init/1",
        "written": list(map(str, written)),
        **fits.axis_document(survey.axis),
        "logs": survey.logs,
        "vehicle": None if survey.profile is None else {"type": survey.profile.id, "guessed": survey.profile_guessed},
        "curve": {"file": survey.curve or None, "guessed": survey.curve_guessed},
        "time": {"unit": survey.time_unit, "why": survey.unit_reason} if any(survey.clock_sources.values()) else None,
        "joined": None if survey.join is None else list(survey.join.parts),
        "clocks": list(map(_clock_document, survey.clock_offsets.offsets)),
        "signals": signals,
        "commands": commands,
        "rudders": rudders,
        "unused": unused,
        "open": [*survey.unrecognised, *(f"sense of {source}" for source in survey.unknown_directions)],
        **fits.guess_document(assumptions_in(survey)),
        "warnings": list(survey.warnings),
    }


def check_document(checked: LogCheck, vehicle: Vehicle) -> fits.Document:
    """The document of `rovid check --json`; positions in rad or m."""
    thrusters, names = [], {"way": "direction", "standard_errors": "t_statistic", "share": "explained_share"}
    for one in checked.thrusters:
        strength = fits.fields(one, value="strength", standard_error="error")
        thrusters.append({"name": one.name, **fits.fields(one.observed, **names), "strength": strength})
    return shared_check_document(checked, vehicle) | {
        **fits.axis_document(vehicle.axis),
        "logs": [{"name": trial.name} | facts for trial, facts in zip(checked.trials, checked.facts, strict=True)],
        "feedback": list(map(vars, checked.feedback)),
        "clocks": list(map(_clock_document, checked.clocks.offsets)),
        "thrusters": thrusters,
    }


def shared_check_document(checked: CheckedLogs, vehicle: Vehicle) -> fits.Document:
    """The part that the documents of all checks share."""
    return {
        "schema": "rovid-check/1",
        **fits.guess_document(vehicle.assumptions),
        "verdict": checked.verdict,
        "unreadable": [{"name": name, "problem": problem} for name, problem in checked.problems.items()],
        "faults": fits.fault_documents(checked.faults),
        "remarks": list(map(remark_document, checked.remarks)),
        "advice": list(map(vars, checked.advice)),
    }


def _clock_document(clock: ClockOffset) -> fits.Document:
    """Offset in s and drift in ppm of a file's clock, to be added to its times."""
    return {**vars(clock), "given": list(clock.given), "certain": clock.certain}


def effect_trial_document(found: EffectTrial, warnings: list[str]) -> fits.Document:
    """Gains of the tried effect and of the catalogue's."""
    others = [{"effect": name, "log_likelihood_gain": gain} for name, gain in found.others.items()]
    tried = []
    for one in found.tried:
        key, parameters = one.effect.key, {}
        for parameter in one.effect.parameters:
            name = f"{key}.{parameter.name}"
            parameters[parameter.name] = fits.estimate_document(one.estimate, name, parameter.unit)
        gains = fits.fields(one, log_likelihood_gain="gain", held_out_gain="held_out_gain")
        tried.append({"effect": key, "beside": list(one.beside), **gains, "parameters": parameters})
    return {"schema": "rovid-effect/1", "tried": tried, "catalogue": others, "warnings": warnings}


def discovery_document(found: Discovery, warnings: list[str]) -> fits.Document:
    """Formulas, best first, and the causes of the catalogue next to which they predict."""
    formulas = []
    for formula in found.formulas:
        estimate, units = formula.estimate, units_of(formula, found.grammar.units if found.grammar else {})
        parameters = {name: fits.estimate_document(estimate, name, units[name]) for name in estimate.names}
        document = {"formula": formula.text, "signals": list(formula.signals), "parameters": parameters}
        document |= fits.fields(formula, log_likelihood_gain="gain", held_out_gain="held_out_gain")
        names = {"held_out_log_likelihood_gain": "held_out_nats", "inclusion": "inclusion", "nearest": "nearest"}
        document |= fits.fields(formula, **names, code_length="price") | {"beside": list(formula.beside)}
        formulas.append(document)
    return {
        "schema": "rovid-discovery/1",
        "formulas": formulas,
        "causes": list(found.causes),
        "missing": found.missing or None,
        "warnings": warnings,
    }


def planar_simulation_document(
    parameters: Parameters,
    simulations: Sequence[PlanarTrialSimulation],
    warnings: Sequence[str],
    guess: Assumptions,
    manoeuvres: Sequence[RunManoeuvre] = (),
) -> fits.Document:
    """The document of `rovid simulate --axes planar --json`; angles in rad, distances in m."""
    trials, found = [], []
    for item in simulations:
        document = {"name": item.name, "samples": item.samples, **fits.planar_measures(item.fits, *_MEASURES)}
        document |= fits.by_horizon("heading_error", item.heading_errors)
        trials.append(document | fits.by_horizon("track_error", item.track_errors) | {"track_error": item.track_rms})
    for one in manoeuvres:
        document = fits.fields(one, "run", "kind", "begin", "end", "steering")
        document["measured"] = fits.measures_document(one.measured)
        found.append(document | {"simulated": fits.measures_document(one.simulated)})
    return shared_simulation_document(parameters, warnings, guess) | {
        **fits.AXES_DOCUMENT,
        "undetermined": fits.undetermined_document(parameters.undetermined),
        "trials": trials,
        "overall": fits.planar_measures(pooled_measures(simulations), *_MEASURES),
        "manoeuvres": found,
        "units": {f"{sensor}_rmse": unit for sensor, unit in SENSOR_UNITS.items()}
        | {"heading_error": "rad", "track_error": "m"},
    }


def planar_plan_document(
    plan: PlanarPlan, vehicle: Vehicle, command_file: str, warnings: Sequence[str]
) -> fits.Document:
    """The document of `rovid plan --axes planar --json`; standard errors in SI, None where not determined."""
    estimate = plan.fit.estimate
    errors = {
        name: {"before": before, "after": after, "unit": estimate.unit(name)}
        for name, (before, after) in plan.errors.items()
    }
    left_out = [{"run": run, "reason": reason} for run, reason in plan.left_out.items()]
    document = plan_document(plan.ranked, vehicle, command_file, "", warnings)
    added = {"standard_errors": errors, "left_out": left_out, "picture": None}
    return {"schema": document["schema"], **fits.AXES_DOCUMENT} | document | added


def planar_check_document(checked: PlanarCheck, vehicle: Vehicle) -> fits.Document:
    """The document of `rovid check --axes planar --json`; SI and radians, null where unknown."""
    logs = []
    for trial in checked.trials:
        readings = {name: len(one.time) for name, one in trial.readings.items()}
        remarks = list(map(remark_document, trial.remarks))
        logs.append({"name": trial.name, "duration": trial.duration, "readings": readings, "remarks": remarks})
    return shared_check_document(checked, vehicle) | {
        **fits.AXES_DOCUMENT,
        "logs": logs,
        "sensors": [fits.without_nan(vars(sensor)) for sensor in checked.sensors],
        "degrees_of_freedom": [fits.without_nan(vars(axis)) for axis in checked.axes],
        "latencies": [fits.without_nan(vars(lag)) for lag in checked.lags],
    }
