"""Results as the JSON documents that other programs rely on."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from rovid.control.design import Control, RunResult
from rovid.design.expected_information import Worth
from rovid.design.experiment_design import Plan, commands_by_name
from rovid.export.resimulation import Mismatch
from rovid.export.run_export import Exported, Loss
from rovid.model.simulation import TrialSimulation, overall
from rovid.preflight.check import Check, remark_document
from rovid.preflight.clock_report import Clock
from rovid.preflight.config_writer import guess_of
from rovid.preflight.log_survey import Survey
from rovid.preflight.signal_guess import Guesses
from rovid.preflight.thruster_check import Push
from rovid.present.documents.fits import Document, axis_document, cautions, guess_document, position_errors, units_of
from rovid.store.parameter_file import Entry, Parameters
from rovid.trial.assumptions import Guesswork
from rovid.trial.vehicle import Vehicle

_CONTROL_UNITS = {"kp": "N m/rad", "kd": "N m s/rad", "bandwidth": "rad/s", "crossover": "rad/s", "effort": "N m"}


def simulation_document(
    parameters: Parameters, simulations: Sequence[TrialSimulation], warnings: Sequence[str], guess: Guesswork
) -> Document:
    """What `rovid simulate --json` prints; position errors in rad or m."""
    total, axis = overall(simulations), parameters.axis
    return {
        "schema": "rovid-simulation/1",
        **axis_document(axis),
        "parameters": {name: _entry(entry, guess) for name, entry in parameters.entries.items()},
        "effects": parameters.effects,
        "trials": [_trial_simulation(item) for item in simulations],
        "overall": {
            f"{axis.rate}_r2": total.r2,
            f"{axis.rate}_fit_percent": total.fit_percent,
            f"{axis.rate}_rmse": total.rmse,
        },
        "units": units_of(axis),
        **guess_document(guess),
        "warnings": cautions(guess, warnings),
    }


def _entry(entry: Entry, guess: Guesswork) -> Document:
    placeholder = {"placeholder": True} if guess.marks(entry.unit) else {}
    return {"value": entry.value, "standard_error": entry.standard_error, "unit": entry.unit, **placeholder}


def _trial_simulation(item: TrialSimulation) -> Document:
    """How well one trial is followed."""
    axis = item.run.trial.axis
    return {
        "name": item.run.trial.name,
        "samples": item.fit.samples,
        f"{axis.rate}_r2": item.fit.r2,
        f"{axis.rate}_fit_percent": item.fit.fit_percent,
        f"{axis.rate}_rmse": item.fit.rmse,
        **position_errors(item.position_errors, axis),
    }


def plan_document(plan: Plan, vehicle: Vehicle, command_file: str, picture: str, warnings: Sequence[str]) -> Document:
    """What `rovid plan --json` prints."""
    between, gain = None, "logarithm of the ratio of variances"
    if len(plan.beliefs) > 1:
        between = [belief.name for belief in plan.beliefs]
        gain = "expected log-likelihood ratio"
    return {
        "schema": "rovid-plan/1",
        **axis_document(vehicle.axis),
        "between": between,
        "narrow": plan.narrow or None,
        "decides": plan.decides,
        "runs": [_run(one) for one in plan.runs],
        "gain": gain,
        "command_file": command_file,
        "picture": picture,
        "commands": commands_by_name(plan),
        **guess_document(vehicle.guess),
        "warnings": cautions(vehicle.guess, warnings),
    }


def _run(one: Worth) -> Document:
    return {"run": one.run.name, "seconds": one.run.seconds, "gain": one.gain, "gain_per_minute": one.per_minute}


def control_document(result: Control, warnings: Sequence[str], guess: Guesswork) -> Document:
    """What `rovid control --json` prints; times in s, angles in deg, torques in N m, frequencies in rad/s."""
    law, margins, spread = result.law, result.margins, result.spread
    lag = {"total": result.lag, "delay": result.setting.delay, "period": law.period, "rate_filter": law.rate_filter}
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
        "torque_in_use": result.setting.torque_in_use,
        "monte_carlo": None if spread is None else vars(spread),
        "effects": [effect.key for effect in result.model.effects],
        "runs": [_closed_run(run) for run in result.runs],
        "units": dict(_CONTROL_UNITS),
        **guess_document(guess),
        "warnings": cautions(guess, warnings),
    }


def _closed_run(run: RunResult) -> Document:
    """A closed-loop run: times in s, angles in deg, effort in N m."""
    measures = run.measures
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


def export_document(name: str, file: str, made: Exported, guess: Guesswork) -> Document:
    """What `rovid export --json` prints; percentages are of the range of the yaw rate on the manoeuvre."""
    return {
        "schema": "rovid-export/1",
        "format": name,
        "file": file,
        "mismatch": _mismatch(made.mismatch),
        "mismatch_of_what_is_held": _mismatch(made.held),
        "not_held": [_loss(loss) for loss in made.losses],
        **guess_document(guess),
        "warnings": cautions(guess, made.warnings),
    }


def _loss(loss: Loss) -> Document:
    return {"what": loss.what, "why": loss.why, "yaw_rate_percent_of_range": loss.percent_of_range}


def _mismatch(mismatch: Mismatch) -> Document:
    return {"yaw_rate_percent_of_range": mismatch.percent_of_range, "rms": mismatch.rms, "unit": "rad/s"}


def survey_document(survey: Survey, written: Sequence[Path]) -> Document:
    """What `rovid init --json` prints."""
    return {
        "schema": "rovid-init/1",
        "written": [str(path) for path in written],
        **axis_document(survey.axis),
        "logs": survey.logs,
        "vehicle": None if survey.profile is None else {"type": survey.profile.id, "guessed": survey.recognised},
        "curve": {"file": survey.curve or None, "guessed": survey.curve_guessed},
        "joined": None if survey.join is None else list(survey.join.parts),
        "clocks": [clock_document(clock) for clock in survey.apart.every],
        "signals": {kind: _guessed_signals(guesses) for kind, guesses in survey.guesses.items()},
        "commands": {kind: _guessed_commands(guesses) for kind, guesses in survey.guesses.items()},
        "unused": {kind: list(guesses.unused) for kind, guesses in survey.guesses.items()},
        "open": [*survey.open, *(f"sense of {source}" for source in survey.untold)],
        **guess_document(guess_of(survey)),
        "warnings": list(survey.lacking),
    }


def _guessed_signals(guesses: Guesses) -> Document:
    document = {}
    for name, one in guesses.signals.items():
        document[name] = {"source": one.source, "unit": one.unit or None, "sign": one.sign, "why": one.why}
    return document


def _guessed_commands(guesses: Guesses) -> list[Document]:
    document = []
    for one in guesses.commands:
        command = {"name": one.name, "source": one.source, "turns": one.way, "arm": one.arm or None, "why": one.why}
        command |= {"told": one.told, "lowest": one.lowest, "highest": one.highest, "rests_at": one.neutral}
        command |= {"standard_errors": one.sense.sure, "share": one.sense.share}
        document.append(command)
    return document


def check_document(checked: Check, vehicle: Vehicle) -> Document:
    """What `rovid check --json` prints; places in rad or m."""
    return {
        "schema": "rovid-check/1",
        **axis_document(vehicle.axis),
        **guess_document(vehicle.guess),
        "verdict": checked.verdict,
        "logs": [{"name": trial.name} | dict(facts) for trial, facts in checked.rows],
        "unreadable": [{"name": name, "problem": problem} for name, problem in checked.problems.items()],
        "remarks": [remark_document(remark) for remark in checked.remarks],
        "advice": [vars(one) for one in checked.advice],
        "feedback": [vars(one) for one in checked.feedback],
        "clocks": [clock_document(clock) for clock in checked.clocks.every],
        "thrusters": [_pushing(push) for push in checked.pushes],
    }


def _pushing(push: Push) -> Document:
    """What the logs tell of a thruster by themselves."""
    sense = push.sense
    return {
        "name": push.name,
        "way": sense.way,
        "standard_errors": sense.sure,
        "share": sense.share,
        "strength": {"value": push.strength, "standard_error": push.error},
    }


def clock_document(clock: Clock) -> Document:
    """How far the clock of a file is off: s and ppm to be added to it."""
    return {**vars(clock), "given": list(clock.given), "certain": clock.certain}
