"""The readable account of a diagnosis: what is wrong, why, how much better, what is left, what to run next."""

from __future__ import annotations

import math
import shlex
from collections.abc import Iterator

from rich.console import Console
from rich.text import Text

from rovid.campaign.axis import Axis
from rovid.campaign.guesswork import Guesswork
from rovid.campaign.vehicle import Vehicle
from rovid.control.loop_design import Control, RunResult, Spread
from rovid.control.tuning import Margins
from rovid.diagnose.amplitudes import Amplitudes, Explanation
from rovid.diagnose.experiments import deciding_experiment, next_experiment
from rovid.diagnose.record import INVISIBLE, Diagnosis, Finding, Side, not_identifiable
from rovid.effects import Effect
from rovid.ground.numbers import plus_minus
from rovid.ground.screen import led
from rovid.identify.estimate import Estimate
from rovid.identify.inertia import METHODS
from rovid.model.names import unit_of
from rovid.show.table import Columns, table
from rovid.show.terminal import by_guess, number, say, show_parameters

_VERDICTS = {
    "found": "The simulation misses something, and it has a name.",
    "suspected": "The simulation misses something. What it may be is likely or possible, not established.",
    "nothing_found": "Nothing was found: the model explains these data.",
    "unexplained": "The simulation misses something that no effect of the catalogue explains.",
    "too_little_data": "There is too little data for a diagnosis.",
}


def show_diagnosis(console: Console, diagnosis: Diagnosis, vehicle: Vehicle) -> None:
    """Print the account."""
    axis = vehicle.axis
    verdict = _VERDICTS[diagnosis.verdict].replace("The simulation", f"The simulation{vehicle.guess.with_curve}")
    say(console, led(verdict))
    if diagnosis.missing:
        say(console, diagnosis.missing)
    if diagnosis.amplitudes is not None:
        _show_amplitudes(console, diagnosis.amplitudes)
    _show_causes(console, diagnosis, axis)
    if diagnosis.base is not None and diagnosis.extended is not None:
        _show_gain(console, diagnosis.base, diagnosis.extended, diagnosis.noise_floor, axis)
        show_parameters(console, diagnosis.extended.estimate)
        share = 100.0 * diagnosis.unexplained_share
        say(console, f"left unexplained: {share:.2g} % of the {axis.push}'s variance")
    if diagnosis.verdict == "nothing_found":
        _show_detectable(console, diagnosis, vehicle)
    say(console, f"never visible in {axis.name} data: {_invisible(vehicle)}")
    run = next_experiment(diagnosis)
    say(console, led("Next:", f"{run['run']} ({run['reason']})"))


def _invisible(vehicle: Vehicle) -> str:
    return " and ".join(INVISIBLE[name] for name in not_identifiable(vehicle))


def _show_causes(console: Console, diagnosis: Diagnosis, axis: Axis) -> None:
    """What was found, what is suspected, and what has no name."""
    for finding in diagnosis.findings:
        _show_finding(console, finding, axis)
    for suspect in diagnosis.suspects:
        console.print()
        console.print(f"Suspected, {100.0 * suspect.confidence:.0f} % sure:", highlight=False, end="")
        _show_finding(console, suspect, axis)
    for signal, gain in diagnosis.signals:
        what = f"{axis.words(signal.title)} (log-likelihood gain {gain:.0f})"
        console.print()
        say(console, f"Unexplained: {what}. It is a dependence, not a cause.")


def _show_amplitudes(console: Console, amplitudes: Amplitudes) -> None:
    """What tables of sine trials say by themselves."""
    _show_predictions(console, amplitudes)
    if amplitudes.causes:
        _show_explanations(console, amplitudes)
    if amplitudes.ruled_out:
        ruled_out = ", ".join(effect.title for effect in amplitudes.ruled_out)
        say(console, f"would not, alone: {ruled_out}")


def _show_predictions(console: Console, amplitudes: Amplitudes) -> None:
    """Peak rates as measured, and as the model without effects has them."""
    title = "Peak yaw rate of the sine trials, rad/s"
    rows = table(title, "trial", "inertia by", "measured", "predicted", "%", "kg m²", left=2)
    for each in amplitudes.predictions:
        change = 100.0 * (each.predicted / each.measured - 1.0)
        rows.add_row(
            each.trial,
            METHODS[each.method],
            number(each.measured),
            number(each.predicted),
            number(change, "+.0f"),
            number(each.inertia, 4),
        )
    console.print(rows)


def _show_explanations(console: Console, amplitudes: Amplitudes) -> None:
    rows = table(
        "Each would explain it alone", "effect", "with", "inertia kg m²", "run that would tell", left=2, prose=True
    )
    for cause in amplitudes.causes:
        rows.add_row(*_explanation_cells(cause))
    console.print(rows)


def _explanation_cells(cause: Explanation) -> tuple[str, str, str, str]:
    effect = cause.model.effects[0]
    return effect.title, ", ".join(_sizes(cause)), number(cause.model.inertia, 4), effect.experiment


def _sizes(cause: Explanation) -> Iterator[str]:
    """Name, value and unit of each parameter."""
    for name, (value, unit) in cause.sizes.items():
        # A plain number has the unit 1, which is not said.
        yield f"{name} {value:.3g} {unit}".removesuffix(" 1")


def _show_finding(console: Console, finding: Finding, axis: Axis) -> None:
    effect = finding.effect
    names = [axis.words(each.title) for each in (effect, *finding.undecided)]
    form = f", form {effect.form}" if effect.form else ""
    console.print()
    say(console, led(" or ".join(names), f"({effect.id}{form}): {effect.equation}"))
    if blamed := finding.estimate.guess.blames(effect.id):
        say(console, Text(f"  {blamed}", style="red"))
    _show_sizes(console, finding)
    gains = f"  log-likelihood gain {finding.gain:.0f}, on trials not fitted {finding.held_out_gain:.0f}"
    say(console, gains)
    if finding.rivals:
        rivals = ", ".join(f"{axis.words(rival.effect.title)} {rival.worth:.0f}" for rival in finding.rivals[:3])
        say(console, f"  parameters paid for, {finding.worth:.0f}; in its place {rivals}")
    _show_deciding(console, finding)


def _show_sizes(console: Console, finding: Finding) -> None:
    """The parameters of what was found, a line each."""
    for parameter in finding.effect.parameters:
        size = _size(finding.estimate, f"{finding.effect.key}.{parameter.name}")
        say(console, f"  {parameter.name} {size}")


def _size(estimate: Estimate, name: str) -> str:
    """Value, standard error and unit."""
    value = plus_minus(estimate.value(name), estimate.standard_error(name))
    unit = estimate.unit(name)
    guessed = "guessed " if estimate.is_placeholder(name) else ""
    return f"{guessed}{value} {unit if unit != '1' else ''}"


def _show_deciding(console: Console, finding: Finding) -> None:
    """The run that tells what was found from what it may be confused with, where there is need of one."""
    decides = deciding_experiment(finding)
    if decides is None:
        return
    planned = "commands" in decides
    which = "would" if planned else "might"
    say(console, f"  these data do not tell which; this run {which}: {decides['run']}")
    if planned:
        one, other = (shlex.quote(effect.key) for effect in (finding.effect, finding.undecided[0]))
        command = led(f"rovid plan --between {one} --between {other}", "writes it")
        console.print(f"  in {decides['minutes']:.1f} min;", command, highlight=False)


def _show_gain(console: Console, base: Side, extended: Side, floor: float, axis: Axis) -> None:
    rows = table("Trials that were not fitted, simulated freely", "", "without", "with what was found", "noise floor")
    one, other = base.held_out, extended.held_out
    rows.add_row(f"{axis.rate_words} R²", number(one.rate_r2, ".4f"), number(other.rate_r2, ".4f"), "")
    rmse = f"{axis.rate_words} RMSE, {axis.rate_unit}"
    rows.add_row(rmse, number(one.rate_rmse), number(other.rate_rmse), number(floor, 2))
    for horizon in one.position_errors:
        before = axis.in_shown(one.position_errors[horizon])
        after = axis.in_shown(other.position_errors[horizon])
        name = f"{axis.position_words} after {horizon:.0f} s, {axis.shown[0]}"
        rows.add_row(name, number(before), number(after), "")
    rows.add_row("log-likelihood", number(one.log_likelihood, ".0f"), number(other.log_likelihood, ".0f"), "")
    console.print(rows)


def _show_detectable(console: Console, diagnosis: Diagnosis, vehicle: Vehicle) -> None:
    rows = table("The smallest that would have been seen", "effect", "parameter", "size", "unit", left=2)
    for effect, size in diagnosis.detectable:
        rows.add_row(*_detectable_cells(effect, size, vehicle))
    console.print(rows)


def _detectable_cells(effect: Effect, size: float, vehicle: Vehicle) -> tuple[str, str, str, str]:
    name = effect.parameters[0].name
    unit = unit_of(f"{effect.key}.{name}", vehicle.axis)
    seen = number(size, 2) if math.isfinite(size) else "not visible"
    guessed = "guessed " if vehicle.guess.marks(unit) and math.isfinite(size) else ""
    return vehicle.axis.words(effect.title), name, guessed + seen, unit


def show_control(console: Console, result: Control, guess: Guesswork) -> None:
    """Print the controller: gains, margins, and the closed-loop runs."""
    for line in _control_lines(result, by_guess("", guess, "N m")):
        say(console, line)
    console.print(_closed_loop_runs(result, guess))
    if result.model.effects:
        keys = ", ".join(effect.key for effect in result.model.effects)
        say(console, f"effects: {keys}; an aid that is extended knows of them")


def _control_lines(result: Control, by: str) -> Iterator[str | Text]:
    """Gains, margins and limits, a line each; ``by`` tells what torques are guessed by."""
    law, spread, inertia = result.law, result.spread, result.model.inertia
    yield led(f"kp {law.kp:.5g} N m/rad, kd {law.kd:.5g} N m s/rad{by}")
    damping = f"damping ratio {result.damping:.3f}, bandwidth {result.bandwidth:.3g} rad/s"
    yield f"{damping}; yaw inertia {inertia:.5g} kg m²{by}"
    yield (
        f"sampled every {law.period:g} s, rate low-passed over {law.rate_filter:.2g} s; in all {result.lag:.2g} s late"
    )
    yield _margins(result.margins)
    if spread is not None:
        yield _spread(spread)
    if result.allocation.limited:
        yield f"torque from {number(law.lowest)} to {number(law.highest)} N m{by}"
    else:
        yield "no thrusters are known: the torque itself is commanded, without limit"


def _spread(spread: Spread) -> str:
    return (
        f"over the parameters' uncertainty ({spread.draws} draws): {100.0 * spread.stable:.0f} % stable; 95 % have "
        f"gain {_decibels(spread.gain_db)}, phase {spread.phase_deg:.0f} deg, delay {spread.delay_s:.2f} s or more"
    )


def _margins(margins: Margins) -> str | Text:
    if not margins.stable:
        return led("The loop is unstable about rest with these gains.")
    lag = f"{margins.lag_s:.2f} s" if math.isfinite(margins.lag_s) else "of any length"
    spare = f"delay {number(margins.delay_s, '.2f')} s, lag {lag}"
    return (
        f"margins: gain {_decibels(margins.gain_db)}, phase {number(margins.phase_deg, '.0f')} deg, {spare}; "
        f"sensitivity peak {margins.sensitivity_peak:.2f}"
    )


def _closed_loop_runs(result: Control, guess: Guesswork) -> Columns:
    """A row for each run of the design."""
    rows = table(
        by_guess("Closed-loop runs, with 2 % of the torque in use as disturbance", guess, "N m"),
        *("run", "effects", "model aid", "settled s", "overshoot deg", "steady deg", "limit cycle", "63 % s", "rise s"),
        "effort N m",
        left=3,
    )
    # Runs of one name follow one another; it is said with the first of them.
    before = ""
    for run in result.runs:
        name = ""
        if run.name != before:
            rows.add_section()
            name = run.name
        rows.add_row(name, *_run_cells(run))
        before = run.name
    return rows


def _run_cells(run: RunResult) -> list[str]:
    found = run.measures
    return [
        "all" if run.effects else "none",
        _aid(run),
        number(found.settling_time, ".1f"),
        number(found.overshoot_deg, ".1f"),
        number(found.steady_error_deg, 2),
        cycle_words(run, none="–"),
        number(found.time_constant, ".1f"),
        number(found.rise_time, ".1f"),
        number(found.effort),
    ]


def _aid(run: RunResult) -> str:
    """What of the model the controller uses."""
    if not run.model_aid:
        return "–"
    return "extended" if run.effects_known else "drag"


def cycle_words(run: RunResult, none: str) -> str:
    """Amplitude and period of a limit cycle; ``none`` where there is none."""
    cycle = run.measures.limit_cycle
    if cycle is None:
        return none
    return f"±{cycle.amplitude_deg:.2f} deg, {cycle.period_s:.3g} s"


def _decibels(value: float) -> str:
    return f"{value:.1f} dB" if math.isfinite(value) else "without limit"
