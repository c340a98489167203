"""Results as aligned tables for a person at a terminal."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TypeVar

import numpy as np
from rich.console import Console
from rich.text import Text

from rovid.core.console import labelled_text
from rovid.core.errors import LINE_LENGTH, display_text
from rovid.core.formatting import plus_minus, round_to_error, rounded, significant
from rovid.design.experiment_design import DECISIVE_LLR, ExperimentPlan
from rovid.estimate.estimate import PER_INERTIA, Estimate
from rovid.estimate.free_decay import FreeDecay, Quantity, analyse_free_decay
from rovid.estimate.inertia import METHODS, InertiaFit
from rovid.estimate.maximum_likelihood import LikelihoodFit
from rovid.estimate.steady_drag import DragFit
from rovid.estimate.thrust_curve import ThrustCurveFit
from rovid.export.run_export import VerifiedExport
from rovid.model.simulation import FitMeasures, TrialSimulation, pooled_fit
from rovid.preflight.config_writer import assumptions_in, log_count_text
from rovid.preflight.log_survey import LogSurvey
from rovid.present.terminal.table import Columns, table
from rovid.present.terminal.wrapping import wrap_text
from rovid.signals.preprocessing import PreparedRuns
from rovid.store.parameter_file import Parameters
from rovid.store.study import Study
from rovid.trial.assumptions import Assumptions
from rovid.trial.axis import YAW

_RUNS_SHOWN = 8
_Fit = TypeVar("_Fit", DragFit, InertiaFit, LikelihoodFit)


def table_number(value: float | None, form: str | int = 3) -> str:
    """A number as text, in a format or in so many digits that count; a dash where there is none."""
    if value is None or not math.isfinite(value):
        return "–"
    return significant(value, form) if isinstance(form, int) else format(value, form)


def print_text(console: Console, text: str | Text, hang: int = 0) -> None:
    """Print a text, with its numbers in no colour of their own, and further lines ``hang`` blanks in."""
    text = text if isinstance(text, Text) else Text(display_text(text, LINE_LENGTH))
    console.print(wrap_text(text, console.width, hang), highlight=False)


def show_warnings(console: Console, warnings: Sequence[str]) -> None:
    """Print each warning as a paragraph of its own."""
    for text in warnings:
        print_text(console, labelled_text("Note:", text, "yellow"))


def show_caution(console: Console, guess: Assumptions) -> None:
    """Print first of all what is guessed, and what hangs on it."""
    if guess:
        first, _, rest = guess.caution.partition(". ")
        print_text(console, labelled_text(f"{first}.", rest, "bold red"))


def guessed_title(title: str, guess: Assumptions, unit: str) -> str:
    """The title of a table in ``unit``, with what is guessed of it."""
    return f"{title}, by guessed {guess.quantities}" if guess.is_placeholder(unit) else title


def show_export(console: Console, path: Path, made: VerifiedExport) -> None:
    """Print how far the target's own equation is from rovid's, and what it does not hold."""
    console.print(str(path), highlight=False, soft_wrap=True)
    print_text(
        console,
        f"re-simulated in the target's equation: yaw rate off by {table_number(made.mismatch.percent_of_range, 2)} % of its "
        f"range, {table_number(made.mismatch.rms, 2)} rad/s rms",
    )
    if made.losses:
        print_text(
            console,
            f"of what it holds: {table_number(made.kept_mismatch.percent_of_range, 2)} %, {table_number(made.kept_mismatch.rms, 2)} rad/s rms",
        )
    for loss in made.losses:
        size = table_number(loss.percent_of_range, 2)
        print_text(console, labelled_text("Not held:", f"{loss.what}, {size} % of range: {loss.why}.", "red"))
    show_warnings(console, made.warnings)


def show_filter(console: Console, runs: PreparedRuns) -> None:
    """Print the low pass and the noise that it leaves."""
    noise, rate, acceleration = runs.noise()
    name, shown, factor = runs.axis.measured_quantity(integrated=runs.rate_only)
    unit = runs.axis.rate_unit
    origin = "chosen from the data" if runs.chosen else "as given"
    print_text(
        console,
        f"low pass {runs.cutoff:.3g} Hz, {origin}; noise: "
        f"{name} {table_number(noise * factor, 2)} {shown}, rate {table_number(rate, 2)} {unit}, acceleration "
        f"{table_number(acceleration, 2)} {unit}²",
    )


def show_parameters(console: Console, estimate: Estimate) -> None:
    """Print value ± standard error with the 95 % interval."""
    rows = table("", "parameter", "value ± standard error", "unit", "95 % interval")
    for name in estimate.names:
        if name in estimate.refused:
            rows.add_row(name, "not determined", estimate.unit(name), "–")
            continue
        error = estimate.standard_error(name)
        low, high = (round_to_error(end, error) for end in estimate.interval(name))
        interval = f"{low} … {high}" if math.isfinite(error) else "–"
        value = plus_minus(estimate.value(name), error)
        if estimate.is_placeholder(name):
            rows.add_row(name, value, estimate.unit(name), "guessed", style="red")
        else:
            rows.add_row(name, value, estimate.unit(name), interval)
    if estimate.assumptions.ratios_hold and estimate.assumptions:
        for ratio in estimate.ratios:
            rows.add_row(ratio.symbols, plus_minus(ratio.value, ratio.standard_error), ratio.unit, "")
    console.print(rows)


def show_drag(console: Console, fit: DragFit) -> None:
    """Print what `rovid fit-drag` found."""
    console.print(_steady_states(fit))
    if fit.unsteady:
        logs = ", ".join(dict.fromkeys(point.source for point in fit.unsteady))
        print_text(console, f"{len(fit.unsteady)} holds left out because the rate was still changing, in {logs}")
    estimate, axis, correlation = fit.estimate, fit.estimate.axis, math.nan
    show_parameters(console, estimate)
    if not estimate.refused:
        correlation = estimate.correlation("quadratic_drag", "linear_drag")
    print_text(
        console,
        f"{estimate.method}; R² {table_number(fit.r_squared, '.4f')}; correlation of DQ and DL {table_number(correlation, '.2f')}; "
        f"{estimate.samples} steady states",
    )
    for name, each in fit.directions.items():
        quadratic, linear = (plus_minus(each.value(key), each.standard_error(key)) for key in each.names)
        way = guessed_title(f"{estimate.axis.position_words} {name} alone", estimate.assumptions, axis.force_unit)
        print_text(console, f"{way}: DQ {quadratic}, DL {linear}")


def _steady_states(fit: DragFit) -> Columns:
    axis = fit.estimate.axis
    rows = table(
        guessed_title("Steady states", fit.estimate.assumptions, axis.force_unit),
        "log",
        "command",
        f"{axis.force_name} {axis.force_unit}",
        f"rate {axis.rate_unit}",
        f"± {axis.rate_unit}",
        f"residual {axis.force_unit}",
        "from s",
        "to s",
        "without it DQ",
        "DL",
    )
    errors = fit.torque_error if fit.torque_error_known else np.full(len(fit.points), math.nan)
    each = zip(fit.points, errors.tolist(), fit.residuals.tolist(), fit.left_out.tolist(), strict=True)
    for point, error, residual, (quadratic, linear, _) in each:
        rows.add_row(
            point.source,
            " ".join(f"{value:.4g}" for value in point.command),
            _known(point.torque, error),
            _known(point.rate, point.rate_error),
            table_number(point.rate_error, 2),
            _known(residual, error),
            table_number(point.start, ".0f"),
            table_number(point.stop, ".0f"),
            table_number(quadratic, 5),
            table_number(linear),
        )
    return rows


def _known(value: float, error: float) -> str:
    return round_to_error(value, error) if math.isfinite(value) else "–"


def show_inertia(console: Console, fit: InertiaFit) -> None:
    """Print what `rovid fit-inertia` found."""
    unit = fit.estimate.unit("inertia").replace("^2", "²")
    title = guessed_title(f"Inertia, {unit}", fit.estimate.assumptions, unit)
    rows = table(title, "method", "value ± standard error", "note", prose=True)
    for name, inertia in fit.methods.items():
        rows.add_row(METHODS[name], plus_minus(inertia.value, inertia.standard_error), _note(fit, name))
        if len(inertia.runs) > 1 or name == "peak":
            for source, value, error in inertia.runs:
                rows.add_row(f"  {source}", plus_minus(value, error), "")
    console.print(rows)
    show_parameters(console, fit.estimate)
    if fit.added_inertia is not None:
        added = plus_minus(fit.added_inertia, fit.estimate.standard_error("inertia"))
        print_text(console, f"added inertia (inertia less the rigid body's): {added} {unit}")


def _note(fit: InertiaFit, name: str) -> str:
    """What to know of the method ``name``."""
    if name != "peak":
        return "used" if name == fit.chosen else ""
    if fit.peak_bias is None:
        return "biased: torque, rate and acceleration do not peak together"
    return f"biased: on the identified model it returns {100 * fit.peak_bias:.0f} % of the truth"


def show_likelihood(console: Console, fit: LikelihoodFit) -> None:
    """Print what `rovid fit` found."""
    show_parameters(console, fit.estimate)
    innovations = "white" if fit.white else "not white"
    print_text(
        console,
        f"{fit.estimate.method}: log-likelihood {fit.log_likelihood:.1f} over {fit.estimate.samples} readings; "
        f"innovations {innovations}",
    )
    print_text(console, _noises(fit))
    print_text(
        console,
        f"free-running {fit.estimate.axis.rate_words} R² {fit.free_run_r2:.4f}; "
        f"the fit that looks at nothing else reaches {fit.simulation_r2:.4f}",
    )


def _noises(fit: LikelihoodFit) -> str:
    """Of the process and of the measurement."""
    axis = fit.estimate.axis
    name, unit, factor = axis.measured_quantity(integrated=fit.rate_only)
    per_inertia = PER_INERTIA if fit.estimate.per_inertia else ""
    guessed = "guessed " if fit.estimate.assumptions.is_placeholder(axis.force_unit) else ""
    return (
        f"disturbance {axis.force_name} {guessed}{table_number(fit.disturbance)} {axis.force_unit}{per_inertia} with a memory of "
        f"{table_number(fit.correlation_time, 2)} s; {name} noise {table_number(factor * fit.position_noise, 2)} {unit}"
    )


def show_decay(console: Console, decay: FreeDecay) -> None:
    """Print period and damping of the swings, and the ratios to the inertia."""
    rows = table("Free decay", "swing from", "deg", "natural period s", "damping ratio")
    for swing in (*decay.swings, decay.rms_swing):
        name = f"the largest of {swing.name}" if swing.name else "the root mean square of all"
        amplitude = table_number(math.degrees(swing.amplitude), ".1f")
        rows.add_row(name, amplitude, _reading(swing.natural_period), _reading(swing.damping_ratio))
    console.print(rows)
    linear, quadratic = map(_reading, decay.terms.values())
    frequency, over_inertia = decay.natural_frequency, decay.over_inertia.items()
    ratios = ", ".join(f"{name.replace('_', ' ')} {_reading(each)} {each.unit}" for name, each in over_inertia)
    print_text(
        console,
        f"natural frequency {_reading(frequency)} {frequency.unit}; damping ratio "
        f"{linear} of the linear drag, and {quadratic} for each rad of amplitude of the quadratic",
    )
    print_text(console, f"over the inertia: {ratios}")


def _reading(reading: Quantity) -> str:
    return plus_minus(reading.value, reading.standard_error)


def show_simulation(console: Console, simulations: Sequence[TrialSimulation], guess: Assumptions) -> None:
    """Print how well the free-running simulation follows each trial."""
    axis = simulations[0].run.trial.axis
    rows = table(
        guessed_title(f"Free-running simulation against measurement, {axis.rate_words}", guess, axis.rate_unit),
        "trial",
        "R²",
        f"{axis.position_words} after 60 s, {axis.display_unit[0]}",
        f"after 10 s, {axis.display_unit[0]}",
        f"RMSE {axis.rate_unit}",
        "fit %",
        "samples",
    )
    for item in simulations:
        ahead = [table_number(axis.to_display(item.position_errors[seconds]), 2) for seconds in (60.0, 10.0)]
        rows.add_row(item.run.trial.name, *_quality_cells(item.fit, *ahead))
    rows.add_section()
    rows.add_row("all", *_quality_cells(pooled_fit(simulations), "", ""))
    console.print(rows)


def _quality_cells(fit: FitMeasures, *ahead: str) -> list[str]:
    return [
        table_number(fit.r2, ".4f"),
        *ahead,
        table_number(fit.rmse, 2),
        table_number(fit.fit_percent, ".1f"),
        str(fit.samples),
    ]


def show_bench(console: Console, fit: ThrustCurveFit, output: Path) -> None:
    """Print the readings beside the curve."""
    rows = table("Bench readings against the curve", "command", "thrust N", "curve N", "residual N", left=0)
    step = max(len(fit.command) // 40, 1)
    shown = zip(fit.command[::step], fit.thrust[::step], fit.residuals[::step], strict=True)
    # What a bench reads is good to a thousandth of its largest reading at best.
    decimals = 3 - math.ceil(math.log10(float(np.max(np.abs(fit.thrust)))))
    for command, thrust, residual in shown:
        rows.add_row(f"{command:.5g}", *(rounded(each, decimals) for each in (thrust, thrust - residual, residual)))
    console.print(rows)
    if step > 1:
        print_text(console, f"every {step}th of {len(fit.command)} readings shown")
    print_text(
        console,
        f"dead zone {_dead_zone(fit)}; thrust {rounded(fit.curve.thrust.min(), decimals)} to "
        f"{rounded(fit.curve.thrust.max(), decimals)} N; residual {table_number(fit.rms, 2)} N rms, "
        f"{table_number(float(np.max(np.abs(fit.residuals))), 2)} N at most",
    )
    print_text(console, f"written to {output}")


def _dead_zone(fit: ThrustCurveFit) -> str:
    if fit.dead_zone is None:
        return "none"
    low, high = fit.dead_zone
    return f"{low:.5g} to {high:.5g}"


def show_plan(console: Console, plan: ExperimentPlan, written: Sequence[Path]) -> None:
    """Print the best runs, and where the first of them went."""
    console.print(_planned_runs(plan))
    if not plan.is_decisive:
        undecided = (
            f"none is expected to decide: that takes a gain of {DECISIVE_LLR:.0f}. Allow longer runs or more command, or "
            "play the best several times."
        )
        show_warnings(console, [undecided])
    for path in written:
        console.print(f"written: {path}", highlight=False, soft_wrap=True)


def _planned_runs(plan: ExperimentPlan) -> Columns:
    """The runs, the best first, and what each would tell."""
    rivals = len(plan.models) > 1
    if rivals:
        gain = "log-likelihood"
        purpose = f"Runs that tell {plan.models[0].name} from {plan.models[1].name}"
    else:
        gain = "variance over"
        purpose = f"Runs that make {plan.parameter.replace('_', ' ')} surer"
    rows = table(purpose, "run", "minutes", f"{gain} a minute", gain)
    for one in plan.runs[:_RUNS_SHOWN]:
        whole, a_minute = one.gain, one.gain_per_minute
        if not rivals:
            # The gain is the logarithm of what the variance is divided by.
            whole, a_minute = math.exp(whole), math.exp(a_minute)
        rows.add_row(
            one.run.name, table_number(one.run.seconds / 60.0, ".1f"), table_number(a_minute), table_number(whole)
        )
    return rows


def show_survey(console: Console, survey: LogSurvey, written: Sequence[Path]) -> None:
    """Print what each signal was taken for, and what to do next."""
    guess = assumptions_in(survey)
    for what in survey.unrecognised:
        option = "command" if what == "command" else "heading"
        print_text(
            console,
            labelled_text("Open:", f"no column was recognised as {what}; name it in {written[0]}, or with --{option}."),
        )
    if survey.unknown_directions:
        verb = survey.axis.motion_verb.removesuffix("s")
        print_text(
            console,
            labelled_text(
                "Open:",
                f"which way {', '.join(survey.unknown_directions)} {verb} the vehicle, if at all: no log tells.",
            ),
        )
    show_caution(console, guess)
    if survey.profile is not None:
        how = "a guess, from the outputs that turn it" if survey.profile_guessed else "as published"
        print_text(console, labelled_text("Vehicle:", f"{survey.profile.name} ({survey.profile.id}), {how}."))
    if survey.join is not None:
        parts = " and ".join(survey.join.parts)
        print_text(console, labelled_text("Joined:", f"files that differ in {parts} are one trial."))
    for alike in survey.clock_offsets.groups:
        print_text(console, labelled_text("Clocks:", survey.clock_offsets.text(alike)))
    rows = table(f"Guessed from {log_count_text(survey)}", "signal", "taken from", "unit", "why", left=4)
    for guesses in survey.mappings.values():
        for name, one in guesses.signals.items():
            rows.add_row(name, one.source, one.unit, one.reason)
        for command in guesses.commands:
            rows.add_row(f"command of {command.name}", command.source, "", command.reason)
    console.print(rows)
    show_warnings(console, survey.warnings)
    for path in written:
        console.print(f"written: {path}", highlight=False, soft_wrap=True)
    first = f"measure {guess.listing}, put that into {written[0]}; then" if guess else f"read {written[0]}; then"
    print_text(console, labelled_text("Next:", first))
    axis = "" if survey.axis is YAW else f" --axis {survey.axis.name}"
    for name in ("check", "report"):
        console.print(f"  rovid {name} {survey.folder}{axis}", highlight=False, soft_wrap=True)


def show_fit(
    console: Console, fit: _Fit, show: Callable[[Console, _Fit], None], study: Study, parameters: Parameters
) -> None:
    """Print a fit, how the signals were filtered, what was noticed, and where the parameters went."""
    show_caution(console, study.vehicle.assumptions)
    show(console, fit)
    if study.runs is not None and isinstance(fit, LikelihoodFit) and fit.estimate.per_inertia:
        show_decay(console, analyse_free_decay(fit.model, fit.estimate, study.runs.items, study.vehicle))
    if study.runs is not None:
        show_filter(console, study.runs)
    show_warnings(console, [*study.remarks(), *fit.estimate.warnings])
    print_text(console, f"written to {parameters.path}")
