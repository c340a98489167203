"""The readable account of a diagnosis: what is wrong, why, how much better, what is left, what to run next."""

from __future__ import annotations

import math
import shlex
from collections.abc import Iterator

from rich.console import Console
from rich.text import Text

from rovid.control.design import ClosedLoopResult, ControllerDesign, MarginSpread
from rovid.control.tuning import Margins
from rovid.core.console import labelled_text
from rovid.core.formatting import plus_minus, significant
from rovid.diagnose.result import (
    UNIDENTIFIABLE,
    Diagnosis,
    Finding,
    ModelAssessment,
    discriminating_experiment,
    next_experiment,
    unidentifiable_parameters,
)
from rovid.diagnose.tables import Explanation, TableDiagnosis
from rovid.effects import Effect
from rovid.estimate.estimate import Estimate
from rovid.estimate.inertia import METHODS
from rovid.model.parameter_names import unit_of
from rovid.present.terminal.result_tables import guessed_title, print_text, show_parameters, table_number
from rovid.present.terminal.table import Columns, table
from rovid.present.verdict import cause_name, confidence_words, improvement_sentence, verdict_sentence
from rovid.trial.assumptions import Assumptions
from rovid.trial.axis import Axis
from rovid.trial.vehicle import Vehicle

_RIVALS_SHOWN = 3


def show_diagnosis(console: Console, diagnosis: Diagnosis, vehicle: Vehicle) -> None:
    """Print the account."""
    axis = vehicle.axis
    print_text(console, labelled_text(verdict_sentence(diagnosis, vehicle.assumptions)))
    if diagnosis.missing:
        print_text(console, diagnosis.missing)
    if diagnosis.from_tables is not None:
        _show_amplitudes(console, diagnosis.from_tables)
    _show_causes(console, diagnosis, axis)
    if diagnosis.base is not None and diagnosis.extended is not None:
        _show_gain(console, diagnosis.base, diagnosis.extended, diagnosis)
        show_parameters(console, diagnosis.extended.estimate)
        share = 100.0 * diagnosis.unexplained_share
        print_text(console, f"left unexplained: {share:.2g} % of the {axis.force_name}'s variance")
    if diagnosis.verdict == "nothing_found":
        _show_detectable(console, diagnosis, vehicle)
    print_text(console, f"never visible in {axis.name} data: {_invisible(vehicle)}")
    run = next_experiment(diagnosis)
    print_text(console, labelled_text("Next:", f"{run['run']} ({run['reason']})"))


def _invisible(vehicle: Vehicle) -> str:
    return " and ".join(UNIDENTIFIABLE[name] for name in unidentifiable_parameters(vehicle))


def _show_causes(console: Console, diagnosis: Diagnosis, axis: Axis) -> None:
    """What was found, what is suspected, and what has no name."""
    for finding in (*diagnosis.findings, *diagnosis.suspects):
        _show_finding(console, finding, axis)
    for signal, gain in diagnosis.signals:
        what = f"{axis.reword(signal.title)} (log-likelihood gain {gain:.0f})"
        console.print()
        print_text(console, f"Unexplained: {what}. It is a dependence, not a cause.")


def _show_amplitudes(console: Console, amplitudes: TableDiagnosis) -> None:
    """What tables of sine trials say by themselves."""
    _show_predictions(console, amplitudes)
    if amplitudes.causes:
        _show_explanations(console, amplitudes)
    if amplitudes.ruled_out:
        ruled_out = ", ".join(effect.title for effect in amplitudes.ruled_out)
        print_text(console, f"would not, alone: {ruled_out}")


def _show_predictions(console: Console, amplitudes: TableDiagnosis) -> None:
    """Peak rates as measured, and as the model without effects has them."""
    title = "Peak yaw rate of the sine trials, rad/s"
    rows = table(title, "trial", "inertia by", "measured", "predicted", "%", "kg m²", left=2)
    for each in amplitudes.predictions:
        change = 100.0 * (each.predicted / each.measured - 1.0)
        rows.add_row(
            each.trial,
            METHODS[each.method],
            table_number(each.measured),
            table_number(each.predicted),
            table_number(change, "+.0f"),
            table_number(each.inertia, 4),
        )
    console.print(rows)


def _show_explanations(console: Console, amplitudes: TableDiagnosis) -> None:
    rows = table(
        "Each would explain it alone", "effect", "with", "inertia kg m²", "run that would tell", left=2, prose=True
    )
    for explanation in amplitudes.causes:
        rows.add_row(*_explanation_cells(explanation))
    console.print(rows)


def _explanation_cells(explanation: Explanation) -> tuple[str, str, str, str]:
    model, sizes = explanation.model, ", ".join(_sizes(explanation))
    return model.effects[0].title, sizes, table_number(model.inertia, 4), model.effects[0].experiment


def _sizes(explanation: Explanation) -> Iterator[str]:
    """Name, value and unit of each parameter."""
    for name, (value, unit) in explanation.sizes.items():
        # A plain number has the unit 1, which is not said.
        yield f"{name} {significant(value, 3)} {unit}".removesuffix(" 1")


def _show_finding(console: Console, finding: Finding, axis: Axis) -> None:
    effect = finding.effect
    console.print()
    name = cause_name(finding)
    print_text(console, labelled_text(f"{name[:1].upper()}{name[1:]}:", _sizes_found(finding)))
    if blamed := finding.estimate.assumptions.effect_caveat(effect.id):
        print_text(console, Text(f"  {blamed}", style="red"), 2)
    print_text(console, f"  {confidence_words(finding)}")
    print_text(console, f"  {effect.key}: {effect.equation}")
    evidence = f"log-likelihood gained: {finding.bic_gain:.0f}, on trials not fitted {finding.held_out_gain:.0f}"
    if finding.alternatives:
        rivals = (
            f"{axis.reword(rival.effect.title)} {rival.bic_gain:.0f}" for rival in finding.alternatives[:_RIVALS_SHOWN]
        )
        evidence += f"; instead of it {', '.join(rivals)}"
    print_text(console, f"  {evidence}", 2)
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
    decides = discriminating_experiment(finding)
    if decides is None:
        return
    planned = "commands" in decides
    which = "would" if planned else "might"
    print_text(console, f"  these data do not tell which; this run {which}: {decides['run']}", 2)
    if planned:
        one, other = (shlex.quote(effect.key) for effect in (finding.effect, finding.indistinguishable[0]))
        command = labelled_text(f"rovid plan --between {one} --between {other}", "writes it")
        console.print(f"  in {decides['minutes']:.1f} min;", command, highlight=False)


def _show_gain(console: Console, base: ModelAssessment, extended: ModelAssessment, diagnosis: Diagnosis) -> None:
    axis, one, other = base.estimate.axis, base.held_out, extended.held_out
    errors = {}
    of_rate = f"{axis.rate_words} RMSE, {axis.rate_unit}"
    cells = [
        (of_rate, table_number(one.rate_rmse), table_number(other.rate_rmse), table_number(diagnosis.noise_floor, 2))
    ]
    for horizon, before in one.position_errors.items():
        after, floor = other.position_errors[horizon], diagnosis.position_floors.get(horizon)
        of_position = f"{axis.position_words} after {horizon:.0f} s, {axis.display_unit[0]}"
        one_shown, other_shown = (table_number(axis.to_display(value)) for value in (before, after))
        cells.append((of_position, one_shown, other_shown, table_number(axis.to_display(floor), 2)))
        if before is not None and after is not None:
            # The longest says it best.
            errors[f"{axis.position_words} error"] = (before, after)
    errors[f"{axis.rate_words} error"] = (one.rate_rmse, other.rate_rmse)
    cells += [
        (f"{axis.rate_words} R²", table_number(one.rate_r2, ".4f"), table_number(other.rate_r2, ".4f"), ""),
        ("log-likelihood", table_number(one.log_likelihood, ".0f"), table_number(other.log_likelihood, ".0f"), ""),
    ]
    console.print()
    models = ("without", "with what was found") if extended.model.effects else ("the model",)
    if extended.model.effects:
        print_text(console, labelled_text("Gain:", improvement_sentence(errors)))
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
    seen = table_number(size, 2) if math.isfinite(size) else "not visible"
    guessed = "guessed " if vehicle.assumptions.is_placeholder(unit) and math.isfinite(size) else ""
    return vehicle.axis.reword(effect.title), name, guessed + seen, unit


def show_control(console: Console, result: ControllerDesign, guess: Assumptions) -> None:
    """Print the controller: gains, margins, and the closed-loop runs."""
    for line in _control_lines(result, guessed_title("", guess, "N m")):
        print_text(console, line)
    console.print(_closed_loop_runs(result, guess))
    if result.model.effects:
        keys = ", ".join(effect.key for effect in result.model.effects)
        print_text(console, f"effects: {keys}; an aid that is extended knows of them")


def _control_lines(result: ControllerDesign, by: str) -> Iterator[str | Text]:
    """Gains, margins and limits, a line each; ``by`` tells what torques are guessed by."""
    law, spread, inertia = result.law, result.spread, result.model.inertia
    yield labelled_text(f"kp {law.kp:.5g} N m/rad, kd {law.kd:.5g} N m s/rad{by}")
    damping = f"damping ratio {result.damping:.3f}, bandwidth {result.bandwidth:.3g} rad/s"
    yield f"{damping}; yaw inertia {inertia:.5g} kg m²{by}"
    yield (
        f"sampled every {law.period:g} s, rate low-passed over {law.rate_filter:.2g} s; in all {result.lag:.2g} s late"
    )
    yield _margins(result.margins)
    if spread is not None:
        yield _spread(spread)
    if result.allocation.limited:
        yield f"torque from {table_number(law.lowest)} to {table_number(law.highest)} N m{by}"
    else:
        yield "no thrusters are known: the torque itself is commanded, without limit"


def _spread(spread: MarginSpread) -> str:
    return (
        f"over the parameters' uncertainty ({spread.draws} draws): {100.0 * spread.stable:.0f} % stable; 95 % have "
        f"gain {_decibels(spread.gain_db)}, phase {spread.phase_deg:.0f} deg, delay {spread.delay_s:.2f} s or more"
    )


def _margins(margins: Margins) -> str | Text:
    if not margins.stable:
        return labelled_text("The loop is unstable about rest with these gains.")
    lag = f"{margins.lag_s:.2f} s" if math.isfinite(margins.lag_s) else "of any length"
    spare = f"delay {table_number(margins.delay_s, '.2f')} s, lag {lag}"
    return (
        f"margins: gain {_decibels(margins.gain_db)}, phase {table_number(margins.phase_deg, '.0f')} deg, {spare}; "
        f"sensitivity peak {margins.sensitivity_peak:.2f}"
    )


def _closed_loop_runs(result: ControllerDesign, guess: Assumptions) -> Columns:
    """A row for each run of the design."""
    rows = table(
        guessed_title("Closed-loop runs, with 2 % of the torque in use as disturbance", guess, "N m"),
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


def _run_cells(run: ClosedLoopResult) -> list[str]:
    found = run.metrics
    return [
        "all" if run.effects else "none",
        _aid(run),
        table_number(found.settling_time, ".1f"),
        table_number(found.overshoot_deg, ".1f"),
        table_number(found.steady_error_deg, 2),
        cycle_words(run, none="–"),
        table_number(found.time_constant, ".1f"),
        table_number(found.rise_time, ".1f"),
        table_number(found.effort),
    ]


def _aid(run: ClosedLoopResult) -> str:
    """What of the model the controller uses."""
    if not run.model_aid:
        return "–"
    return "extended" if run.effects_known else "drag"


def cycle_words(run: ClosedLoopResult, none: str) -> str:
    """Amplitude and period of a limit cycle; ``none`` where there is none."""
    cycle = run.metrics.limit_cycle
    if cycle is None:
        return none
    return f"±{cycle.amplitude_deg:.2f} deg, {cycle.period_s:.3g} s"


def _decibels(value: float) -> str:
    return f"{value:.1f} dB" if math.isfinite(value) else "without limit"
