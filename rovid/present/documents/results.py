"""Results as the JSON documents that other programs rely on."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from rovid.control.design import ClosedLoopResult, ControllerDesign
from rovid.design.experiment_design import ExpectedInformation, ExperimentPlan, commands_by_name
from rovid.export.resimulation import Mismatch
from rovid.export.run_export import ExportLoss, VerifiedExport
from rovid.model.simulation import TrialSimulation, pooled_fit
from rovid.preflight.check import LogCheck, remark_document
from rovid.preflight.clock_alignment import ClockOffset
from rovid.preflight.config_writer import assumptions_in
from rovid.preflight.log_survey import LogSurvey
from rovid.preflight.signal_guess import ColumnMapping
from rovid.preflight.command_effects import ThrusterCheck
from rovid.present.documents.fits import (
    Document,
    all_warnings,
    axis_document,
    guess_document,
    position_errors,
    simulation_units,
)
from rovid.store.parameter_file import Entry, Parameters
from rovid.trial.assumptions import Assumptions
from rovid.trial.vehicle import Vehicle

_CONTROL_UNITS = {"kp": "N m/rad", "kd": "N m s/rad", "bandwidth": "rad/s", "crossover": "rad/s", "effort": "N m"}


def simulation_document(
    parameters: Parameters, simulations: Sequence[TrialSimulation], warnings: Sequence[str], guess: Assumptions
) -> Document:
    """What `rovid simulate --json` prints; position errors in rad or m."""
    total, axis = pooled_fit(simulations), parameters.axis
    return {
        "schema": "rovid-simulation/1",
        **axis_document(axis),
        "parameters": {name: _entry(entry, guess) for name, entry in parameters.entries.items()},
        "effects": parameters.effects,
        "trials": [_trial_simulation(item) for item in simulations],
        "overall": {
            f"{axis.rate_signal}_r2": total.r2,
            f"{axis.rate_signal}_fit_percent": total.fit_percent,
            f"{axis.rate_signal}_rmse": total.rmse,
        },
        "units": simulation_units(axis),
        **guess_document(guess),
        "warnings": all_warnings(guess, warnings),
    }


def _entry(entry: Entry, guess: Assumptions) -> Document:
    placeholder = {"placeholder": True} if guess.is_placeholder(entry.unit) else {}
    return {"value": entry.value, "standard_error": entry.standard_error, "unit": entry.unit, **placeholder}


def _trial_simulation(item: TrialSimulation) -> Document:
    """How well one trial is followed."""
    axis = item.run.trial.axis
    return {
        "name": item.run.trial.name,
        "samples": item.fit.samples,
        f"{axis.rate_signal}_r2": item.fit.r2,
        f"{axis.rate_signal}_fit_percent": item.fit.fit_percent,
        f"{axis.rate_signal}_rmse": item.fit.rmse,
        **position_errors(item.position_errors, axis),
    }


def plan_document(
    plan: ExperimentPlan, vehicle: Vehicle, command_file: str, picture: str, warnings: Sequence[str]
) -> Document:
    """What `rovid plan --json` prints."""
    between, gain = None, "logarithm of the ratio of variances"
    if len(plan.models) > 1:
        between = [belief.name for belief in plan.models]
        gain = "expected log-likelihood ratio"
    return {
        "schema": "rovid-plan/1",
        **axis_document(vehicle.axis),
        "between": between,
        "narrow": plan.parameter or None,
        "decides": plan.is_decisive,
        "runs": [_run(one) for one in plan.runs],
        "gain": gain,
        "command_file": command_file,
        "picture": picture,
        "commands": commands_by_name(plan),
        **guess_document(vehicle.assumptions),
        "warnings": all_warnings(vehicle.assumptions, warnings),
    }


def _run(one: ExpectedInformation) -> Document:
    return {"run": one.run.name, "seconds": one.run.seconds, "gain": one.gain, "gain_per_minute": one.gain_per_minute}


def control_document(result: ControllerDesign, warnings: Sequence[str], guess: Assumptions) -> Document:
    """What `rovid control --json` prints; times in s, angles in deg, torques in N m, frequencies in rad/s."""
    law, margins, spread = result.law, result.margins, result.spread
    lag = {"total": result.lag, "delay": result.conditions.delay, "period": law.period, "rate_filter": law.rate_filter}
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
        "lag": lag,
        "torque_limits": [law.lowest, law.highest],
        "torque_in_use": result.conditions.torque_in_use,
        "monte_carlo": None if spread is None else vars(spread),
        "effects": [effect.key for effect in result.model.effects],
        "runs": [_closed_run(run) for run in result.runs],
        "units": dict(_CONTROL_UNITS),
        **guess_document(guess),
        "warnings": all_warnings(guess, warnings),
    }


def _closed_run(run: ClosedLoopResult) -> Document:
    """A closed-loop run: times in s, angles in deg, effort in N m."""
    measures = run.metrics
    return {
        "name": run.name,
        "effects": list(run.effects),
        "model_aid": run.model_aid,
        "effects_known": run.effects_known,
        "time_constant": measures.time_constant,
        "rise_time": measures.rise_time,
        "settling_time": measures.settling_time,
        "overshoot_deg": measures.overshoot_deg,
        "steady_error_deg": measures.steady_error_deg,
        "effort": measures.effort,
        "effort_change": measures.effort_change,
        "limit_cycle": None if measures.limit_cycle is None else vars(measures.limit_cycle),
    }


def export_document(name: str, file: str, made: VerifiedExport, guess: Assumptions) -> Document:
    """What `rovid export --json` prints; percentages are of the range of the yaw rate on the manoeuvre."""
    return {
        "schema": "rovid-export/1",
        "format": name,
        "file": file,
        "mismatch": _mismatch(made.mismatch),
        "mismatch_of_what_is_held": _mismatch(made.kept_mismatch),
        "not_held": [_loss(loss) for loss in made.losses],
        **guess_document(guess),
        "warnings": all_warnings(guess, made.warnings),
    }


def _loss(loss: ExportLoss) -> Document:
    return {"what": loss.what, "why": loss.why, "yaw_rate_percent_of_range": loss.percent_of_range}


def _mismatch(mismatch: Mismatch) -> Document:
    return {"yaw_rate_percent_of_range": mismatch.percent_of_range, "rms": mismatch.rms, "unit": "rad/s"}


def survey_document(survey: LogSurvey, written: Sequence[Path]) -> Document:
    """What `rovid init --json` prints."""
    return {
        "schema": "rovid-init/1",
        "written": [str(path) for path in written],
        **axis_document(survey.axis),
        "logs": survey.logs,
        "vehicle": None if survey.profile is None else {"type": survey.profile.id, "guessed": survey.profile_guessed},
        "curve": {"file": survey.curve or None, "guessed": survey.curve_guessed},
        "joined": None if survey.join is None else list(survey.join.parts),
        "clocks": [clock_document(clock) for clock in survey.clock_offsets.offsets],
        "signals": {kind: _guessed_signals(guesses) for kind, guesses in survey.mappings.items()},
        "commands": {kind: _guessed_commands(guesses) for kind, guesses in survey.mappings.items()},
        "unused": {kind: list(guesses.unused) for kind, guesses in survey.mappings.items()},
        "open": [*survey.unrecognised, *(f"sense of {source}" for source in survey.unknown_directions)],
        **guess_document(assumptions_in(survey)),
        "warnings": list(survey.warnings),
    }


def _guessed_signals(guesses: ColumnMapping) -> Document:
    document = {}
    for name, one in guesses.signals.items():
        document[name] = {"source": one.source, "unit": one.unit or None, "sign": one.sign, "why": one.reason}
    return document


def _guessed_commands(guesses: ColumnMapping) -> list[Document]:
    document = []
    for one in guesses.commands:
        command = {
            "name": one.name,
            "source": one.source,
            "turns": one.direction,
            "arm": one.arm or None,
            "why": one.reason,
        }
        command |= {"told": one.direction_known, "lowest": one.lowest, "highest": one.highest, "rests_at": one.neutral}
        command |= {"standard_errors": one.observed.t_statistic, "share": one.observed.explained_share}
        document.append(command)
    return document


def check_document(checked: LogCheck, vehicle: Vehicle) -> Document:
    """What `rovid check --json` prints; places in rad or m."""
    return {
        "schema": "rovid-check/1",
        **axis_document(vehicle.axis),
        **guess_document(vehicle.assumptions),
        "verdict": checked.verdict,
        "logs": [{"name": trial.name} | dict(facts) for trial, facts in checked.rows],
        "unreadable": [{"name": name, "problem": problem} for name, problem in checked.problems.items()],
        "remarks": [remark_document(remark) for remark in checked.remarks],
        "advice": [vars(one) for one in checked.advice],
        "feedback": [vars(one) for one in checked.feedback],
        "clocks": [clock_document(clock) for clock in checked.clocks.offsets],
        "thrusters": [_pushing(push) for push in checked.thrusters],
    }


def _pushing(push: ThrusterCheck) -> Document:
    """What the logs tell of a thruster by themselves."""
    sense = push.observed
    return {
        "name": push.name,
        "way": sense.direction,
        "standard_errors": sense.t_statistic,
        "share": sense.explained_share,
        "strength": {"value": push.strength, "standard_error": push.error},
    }


def clock_document(clock: ClockOffset) -> Document:
    """How far the clock of a file is off: s and ppm to be added to it."""
    return {**vars(clock), "given": list(clock.given), "certain": clock.certain}
