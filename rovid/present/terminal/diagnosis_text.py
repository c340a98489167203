"""The readable account of a diagnosis: what is wrong, why, how much better, what is left, what to run next."""

from __future__ import annotations

import math
import shlex
from collections.abc import Iterator

from rich.console import Console
from rich.text import Text

from rovid.control.design import Control, RunResult, Spread
from rovid.control.tuning import Margins
from rovid.core.console import led
from rovid.core.formatting import plus_minus, significant
from rovid.diagnose.next_experiment import deciding_experiment, next_experiment
from rovid.diagnose.result import INVISIBLE, Diagnosis, Finding, Side, not_identifiable
from rovid.diagnose.tables import Amplitudes, Explanation
from rovid.effects import Effect
from rovid.estimate.estimate import Estimate
from rovid.estimate.inertia import METHODS
from rovid.model.parameter_names import unit_of
from rovid.present.terminal.result_tables import by_guess, number, say, show_parameters
from rovid.present.terminal.table import Columns, table
from rovid.present.verdict import cause, gained, sureness, verdict
from rovid.trial.assumptions import Guesswork
from rovid.trial.axis import Axis
from rovid.trial.vehicle import Vehicle

_RIVALS_SHOWN = 3


def show_diagnosis(console: Console, diagnosis: Diagnosis, vehicle: Vehicle) -> None:
    """Print the account."""
    axis = vehicle.axis
    say(console, led(verdict(diagnosis, vehicle.guess)))
    if diagnosis.missing:
        say(console, diagnosis.missing)
    if diagnosis.amplitudes is not None:
        _show_amplitudes(console, diagnosis.amplitudes)
    _show_causes(console, diagnosis, axis)
    if diagnosis.base is not None and diagnosis.extended is not None:
        _show_gain(console, diagnosis.base, diagnosis.extended, diagnosis)
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
    for finding in (*diagnosis.findings, *diagnosis.suspects):
        _show_finding(console, finding, axis)
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
    for explanation in amplitudes.causes:
        rows.add_row(*_explanation_cells(explanation))
    console.print(rows)


def _explanation_cells(explanation: Explanation) -> tuple[str, str, str, str]:
    model, sizes = explanation.model, ", ".join(_sizes(explanation))
    return model.effects[0].title, sizes, number(model.inertia, 4), model.effects[0].experiment


def _sizes(explanation: Explanation) -> Iterator[str]:
    """Name, value and unit of each parameter."""
    for name, (value, unit) in explanation.sizes.items():
        # A plain number has the unit 1, which is not said.
        yield f"{name} {significant(value, 3)} {unit}".removesuffix(" 1")


def _show_finding(console: Console, finding: Finding, axis: Axis) -> None:
    effect = finding.effect
    console.print()
    name = cause(finding)
    say(console, led(f"{name[:1].upper()}{name[1:]}:", _sizes_found(finding)))
    if blamed := finding.estimate.guess.blames(effect.id):
        say(console, Text(f"  {blamed}", style="red"), 2)
    say(console, f"  {sureness(finding)}")
    say(console, f"  {effect.key}: {effect.equation}")
    evidence = f"log-likelihood gained: {finding.worth:.0f}, on trials not fitted {finding.held_out_gain:.0f}"
    if finding.rivals:
        rivals = (f"{axis.words(rival.effect.title)} {rival.worth:.0f}" for rival in finding.rivals[:_RIVALS_SHOWN])
        evidence += f"; instead of it {', '.join(rivals)}"
    say(console, f"  {evidence}", 2)
    _show_deciding(console, finding)


def _sizes_found(finding: Finding) -> str:
    """The parameters of what was found."""
    names = [parameter.name for parameter in finding.effect.parameters]
    return ", ".join(f"{name} {_size(finding.estimate, f'{finding.effect.key}.{name}')}" for name in names)


def _size(estimate: Estimate, name: str) -> str:
    """Value, standard error and unit."""
    value = plus_minus(estimate.value(name), estimate.standard_error(name))
    guessed = "guessed " if estimate.is_placeholder(name) else ""
    # A plain number has the unit 1, which is not said.
    return f"{guessed}{value} {estimate.unit(name)}".removesuffix(" 1")


def _show_deciding(console: Console, finding: Finding) -> None:
    """The run that tells what was found from what it may be confused with, where there is need of one."""
    decides = deciding_experiment(finding)
    if decides is None:
        return
    planned = "commands" in decides
    which = "would" if planned else "might"
    say(console, f"  these data do not tell which; this run {which}: {decides['run']}", 2)
    if planned:
        one, other = (shlex.quote(effect.key) for effect in (finding.effect, finding.undecided[0]))
        command = led(f"rovid plan --between {one} --between {other}", "writes it")
        console.print(f"  in {decides['minutes']:.1f} min;", command, highlight=False)


def _show_gain(console: Console, base: Side, extended: Side, diagnosis: Diagnosis) -> None:
    axis, one, other = base.estimate.axis, base.held_out, extended.held_out
    errors = {}
    of_rate = f"{axis.rate_words} RMSE, {axis.rate_unit}"
    cells = [(of_rate, number(one.rate_rmse), number(other.rate_rmse), number(diagnosis.noise_floor, 2))]
    for horizon, before in one.position_errors.items():
        after, floor = other.position_errors[horizon], diagnosis.position_floors.get(horizon)
        of_position = f"{axis.position_words} after {horizon:.0f} s, {axis.shown[0]}"
        one_shown, other_shown = (number(axis.in_shown(value)) for value in (before, after))
        cells.append((of_position, one_shown, other_shown, number(axis.in_shown(floor), 2)))
        if before is not None and after is not None:
            # The longest says it best.
            errors[f"{axis.position_words} error"] = (before, after)
    errors[f"{axis.rate_words} error"] = (one.rate_rmse, other.rate_rmse)
    cells += [
        (f"{axis.rate_words} R²", number(one.rate_r2, ".4f"), number(other.rate_r2, ".4f"), ""),
        ("log-likelihood", number(one.log_likelihood, ".0f"), number(other.log_likelihood, ".0f"), ""),
    ]
    console.print()
    models = ("without", "with what was found") if extended.model.effects else ("the model",)
    if extended.model.effects:
        say(console, led("Gain:", gained(errors)))
    rows = table("Trials that were not fitted, simulated freely", "", *models, "noise floor")
    for what, without, with_it, best in cells:
        rows.add_row(what, *(without, with_it)[: len(models)], best)
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
        *("run", "effects", "model aid", "settled s", "overshot deg", "steady deg", "limit cycle", "63 % s", "rise s"),
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
