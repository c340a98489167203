"""Results as aligned tables for a person at a terminal."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TypeVar

import numpy as np
from rich.console import Console
from rich.text import Text

from rovid.core.console import led
from rovid.core.errors import LINE_LENGTH, shown
from rovid.core.formatting import plus_minus, rounded, significant, to_error
from rovid.design.expected_information import DECIDES
from rovid.design.experiment_design import Plan
from rovid.estimate.estimate import PER_INERTIA, Estimate
from rovid.estimate.free_decay import Decay, Reading, read_decay
from rovid.estimate.inertia import METHODS, InertiaFit
from rovid.estimate.maximum_likelihood import LikelihoodFit
from rovid.estimate.steady_drag import DragFit
from rovid.estimate.thrust_curve import BenchFit
from rovid.export.run_export import Exported
from rovid.model.simulation import Fit, TrialSimulation, overall
from rovid.preflight.config_writer import guess_of, logs_in_words
from rovid.preflight.log_survey import Survey
from rovid.present.terminal.table import Columns, table
from rovid.present.terminal.wrapping import folded
from rovid.signals.preprocessing import Runs
from rovid.store.parameter_file import Parameters
from rovid.store.study import Study
from rovid.trial.assumptions import Guesswork
from rovid.trial.axis import YAW

_RUNS_SHOWN = 8
_Fit = TypeVar("_Fit", DragFit, InertiaFit, LikelihoodFit)


def number(value: float | None, form: str | int = 3) -> str:
    """A number as text, in a format or in so many digits that count; a dash where there is none."""
    if value is None or not math.isfinite(value):
        return "–"
    return significant(value, form) if isinstance(form, int) else format(value, form)


def say(console: Console, text: str | Text, hang: int = 0) -> None:
    """Print a text, with its numbers in no colour of their own, and further lines ``hang`` blanks in."""
    text = text if isinstance(text, Text) else Text(shown(text, LINE_LENGTH))
    console.print(folded(text, console.width, hang), highlight=False)


def show_warnings(console: Console, warnings: Sequence[str]) -> None:
    """Print each warning as a paragraph of its own."""
    for text in warnings:
        say(console, led("Note:", text, "yellow"))


def show_caution(console: Console, guess: Guesswork) -> None:
    """Print first of all what is guessed, and what hangs on it."""
    if guess:
        first, _, rest = guess.caution.partition(". ")
        say(console, led(f"{first}.", rest, "bold red"))


def by_guess(title: str, guess: Guesswork, unit: str) -> str:
    """The title of a table in ``unit``, with what is guessed of it."""
    return f"{title}, by guessed {guess.kinds}" if guess.marks(unit) else title


def show_export(console: Console, path: Path, made: Exported) -> None:
    """Print how far the target's own equation is from rovid's, and what it does not hold."""
    console.print(str(path), highlight=False, soft_wrap=True)
    say(
        console,
        f"re-simulated in the target's equation: yaw rate off by {number(made.mismatch.percent_of_range, 2)} % of its "
        f"range, {number(made.mismatch.rms, 2)} rad/s rms",
    )
    if made.losses:
        say(
            console,
            f"of what it holds: {number(made.held.percent_of_range, 2)} %, {number(made.held.rms, 2)} rad/s rms",
        )
    for loss in made.losses:
        size = number(loss.percent_of_range, 2)
        say(console, led("Not held:", f"{loss.what}, {size} % of range: {loss.why}.", "red"))
    show_warnings(console, made.warnings)


def show_filter(console: Console, runs: Runs) -> None:
    """Print the low pass and the noise that it leaves."""
    noise, rate, acceleration = runs.noise()
    name, shown, factor = runs.axis.measured(integrated=runs.integrated)
    unit = runs.axis.rate_unit
    origin = "chosen from the data" if runs.chosen else "as given"
    say(
        console,
        f"low pass {runs.cutoff:.3g} Hz, {origin}; noise: "
        f"{name} {number(noise * factor, 2)} {shown}, rate {number(rate, 2)} {unit}, acceleration "
        f"{number(acceleration, 2)} {unit}²",
    )


def show_parameters(console: Console, estimate: Estimate) -> None:
    """Print value ± standard error with the 95 % interval."""
    rows = table("", "parameter", "value ± standard error", "unit", "95 % interval")
    for name in estimate.names:
        if name in estimate.refused:
            rows.add_row(name, "not determined", estimate.unit(name), "–")
            continue
        error = estimate.standard_error(name)
        low, high = (to_error(end, error) for end in estimate.interval(name))
        interval = f"{low} … {high}" if math.isfinite(error) else "–"
        value = plus_minus(estimate.value(name), error)
        if estimate.is_placeholder(name):
            rows.add_row(name, value, estimate.unit(name), "guessed", style="red")
        else:
            rows.add_row(name, value, estimate.unit(name), interval)
    if estimate.guess.ratios_hold and estimate.guess:
        for ratio in estimate.ratios:
            rows.add_row(ratio.symbols, plus_minus(ratio.value, ratio.standard_error), ratio.unit, "")
    console.print(rows)


def show_drag(console: Console, fit: DragFit) -> None:
    """Print what `rovid fit-drag` found."""
    console.print(_steady_states(fit))
    if fit.unsteady:
        logs = ", ".join(dict.fromkeys(point.source for point in fit.unsteady))
        say(console, f"{len(fit.unsteady)} holds left out because the rate was still changing, in {logs}")
    estimate, axis, correlation = fit.estimate, fit.estimate.axis, math.nan
    show_parameters(console, estimate)
    if not estimate.refused:
        correlation = estimate.correlation("quadratic_drag", "linear_drag")
    say(
        console,
        f"{estimate.method}; R² {number(fit.r_squared, '.4f')}; correlation of DQ and DL {number(correlation, '.2f')}; "
        f"{estimate.samples} steady states",
    )
    for name, each in fit.directions.items():
        quadratic, linear = (plus_minus(each.value(key), each.standard_error(key)) for key in each.names)
        way = by_guess(f"{estimate.axis.position_words} {name} alone", estimate.guess, axis.push_unit)
        say(console, f"{way}: DQ {quadratic}, DL {linear}")


def _steady_states(fit: DragFit) -> Columns:
    axis = fit.estimate.axis
    rows = table(
        by_guess("Steady states", fit.estimate.guess, axis.push_unit),
        "log",
        "command",
        f"{axis.push} {axis.push_unit}",
        f"rate {axis.rate_unit}",
        f"± {axis.rate_unit}",
        f"residual {axis.push_unit}",
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
            number(point.rate_error, 2),
            _known(residual, error),
            number(point.start, ".0f"),
            number(point.stop, ".0f"),
            number(quadratic, 5),
            number(linear),
        )
    return rows


def _known(value: float, error: float) -> str:
    return to_error(value, error) if math.isfinite(value) else "–"


def show_inertia(console: Console, fit: InertiaFit) -> None:
    """Print what `rovid fit-inertia` found."""
    unit = fit.estimate.unit("inertia").replace("^2", "²")
    title = by_guess(f"Inertia, {unit}", fit.estimate.guess, unit)
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
        say(console, f"added inertia (inertia less the rigid body's): {added} {unit}")


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
    say(
        console,
        f"{fit.estimate.method}: log-likelihood {fit.log_likelihood:.1f} over {fit.estimate.samples} readings; "
        f"innovations {innovations}",
    )
    say(console, _noises(fit))
    say(
        console,
        f"free-running {fit.estimate.axis.rate_words} R² {fit.free_run_r2:.4f}; "
        f"the fit that looks at nothing else reaches {fit.simulation_r2:.4f}",
    )


def _noises(fit: LikelihoodFit) -> str:
    """Of the process and of the measurement."""
    axis = fit.estimate.axis
    name, unit, factor = axis.measured(integrated=fit.integrated)
    per_inertia = PER_INERTIA if fit.estimate.per_inertia else ""
    guessed = "guessed " if fit.estimate.guess.marks(axis.push_unit) else ""
    return (
        f"disturbance {axis.push} {guessed}{number(fit.disturbance)} {axis.push_unit}{per_inertia} with a memory of "
        f"{number(fit.correlation_time, 2)} s; {name} noise {number(factor * fit.position_noise, 2)} {unit}"
    )


def show_decay(console: Console, decay: Decay) -> None:
    """Print period and damping of the swings, and the ratios to the inertia."""
    rows = table("Free decay", "swing from", "deg", "natural period s", "damping ratio")
    for swing in (*decay.swings, decay.usual):
        name = f"the largest of {swing.name}" if swing.name else "the root mean square of all"
        amplitude = number(math.degrees(swing.amplitude), ".1f")
        rows.add_row(name, amplitude, _reading(swing.natural_period), _reading(swing.damping_ratio))
    console.print(rows)
    linear, quadratic = map(_reading, decay.terms.values())
    frequency, over_inertia = decay.natural_frequency, decay.over_inertia.items()
    ratios = ", ".join(f"{name.replace('_', ' ')} {_reading(each)} {each.unit}" for name, each in over_inertia)
    say(
        console,
        f"natural frequency {_reading(frequency)} {frequency.unit}; damping ratio "
        f"{linear} of the linear drag, and {quadratic} for each rad of amplitude of the quadratic",
    )
    say(console, f"over the inertia: {ratios}")


def _reading(reading: Reading) -> str:
    return plus_minus(reading.value, reading.standard_error)


def show_simulation(console: Console, simulations: Sequence[TrialSimulation], guess: Guesswork) -> None:
    """Print how well the free-running simulation follows each trial."""
    axis = simulations[0].run.trial.axis
    rows = table(
        by_guess(f"Free-running simulation against measurement, {axis.rate_words}", guess, axis.rate_unit),
        "trial",
        "R²",
        f"{axis.position_words} after 60 s, {axis.shown[0]}",
        f"after 10 s, {axis.shown[0]}",
        f"RMSE {axis.rate_unit}",
        "fit %",
        "samples",
    )
    for item in simulations:
        ahead = [number(axis.in_shown(item.position_errors[seconds]), 2) for seconds in (60.0, 10.0)]
        rows.add_row(item.run.trial.name, *_quality_cells(item.fit, *ahead))
    rows.add_section()
    rows.add_row("all", *_quality_cells(overall(simulations), "", ""))
    console.print(rows)


def _quality_cells(fit: Fit, *ahead: str) -> list[str]:
    return [
        number(fit.r2, ".4f"),
        *ahead,
        number(fit.rmse, 2),
        number(fit.fit_percent, ".1f"),
        str(fit.samples),
    ]


def show_bench(console: Console, fit: BenchFit, output: Path) -> None:
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
        say(console, f"every {step}th of {len(fit.command)} readings shown")
    say(
        console,
        f"dead zone {_dead_zone(fit)}; thrust {rounded(fit.curve.thrust.min(), decimals)} to "
        f"{rounded(fit.curve.thrust.max(), decimals)} N; residual {number(fit.rms, 2)} N rms, "
        f"{number(float(np.max(np.abs(fit.residuals))), 2)} N at most",
    )
    say(console, f"written to {output}")


def _dead_zone(fit: BenchFit) -> str:
    if fit.dead_zone is None:
        return "none"
    low, high = fit.dead_zone
    return f"{low:.5g} to {high:.5g}"


def show_plan(console: Console, plan: Plan, written: Sequence[Path]) -> None:
    """Print the best runs, and where the first of them went."""
    console.print(_planned_runs(plan))
    if not plan.decides:
        undecided = (
            f"none is expected to decide: that takes a gain of {DECIDES:.0f}. Allow longer runs or more command, or "
            "play the best several times."
        )
        show_warnings(console, [undecided])
    for path in written:
        console.print(f"written: {path}", highlight=False, soft_wrap=True)


def _planned_runs(plan: Plan) -> Columns:
    """The runs, the best first, and what each would tell."""
    rivals = len(plan.beliefs) > 1
    if rivals:
        gain = "log-likelihood"
        purpose = f"Runs that tell {plan.beliefs[0].name} from {plan.beliefs[1].name}"
    else:
        gain = "variance over"
        purpose = f"Runs that make {plan.narrow.replace('_', ' ')} surer"
    rows = table(purpose, "run", "minutes", f"{gain} a minute", gain)
    for one in plan.runs[:_RUNS_SHOWN]:
        whole, a_minute = one.gain, one.per_minute
        if not rivals:
            # The gain is the logarithm of what the variance is divided by.
            whole, a_minute = math.exp(whole), math.exp(a_minute)
        rows.add_row(one.run.name, number(one.run.seconds / 60.0, ".1f"), number(a_minute), number(whole))
    return rows


def show_survey(console: Console, survey: Survey, written: Sequence[Path]) -> None:
    """Print what each signal was taken for, and what to do next."""
    guess = guess_of(survey)
    for what in survey.open:
        option = "command" if what == "command" else "heading"
        say(console, led("Open:", f"no column was recognised as {what}; name it in {written[0]}, or with --{option}."))
    if survey.untold:
        verb = survey.axis.moves.removesuffix("s")
        say(console, led("Open:", f"which way {', '.join(survey.untold)} {verb} the vehicle, if at all: no log tells."))
    show_caution(console, guess)
    if survey.profile is not None:
        how = "a guess, from the outputs that turn it" if survey.recognised else "as published"
        say(console, led("Vehicle:", f"{survey.profile.name} ({survey.profile.id}), {how}."))
    if survey.join is not None:
        parts = " and ".join(survey.join.parts)
        say(console, led("Joined:", f"files that differ in {parts} are one trial."))
    for alike in survey.apart.alike:
        say(console, led("Clocks:", survey.apart.words(alike)))
    rows = table(f"Guessed from {logs_in_words(survey)}", "signal", "taken from", "unit", "why", left=4)
    for guesses in survey.guesses.values():
        for name, one in guesses.signals.items():
            rows.add_row(name, one.source, one.unit, one.why)
        for command in guesses.commands:
            rows.add_row(f"command of {command.name}", command.source, "", command.why)
    console.print(rows)
    show_warnings(console, survey.lacking)
    for path in written:
        console.print(f"written: {path}", highlight=False, soft_wrap=True)
    first = f"measure {guess.words}, put that into {written[0]}; then" if guess else f"read {written[0]}; then"
    say(console, led("Next:", first))
    axis = "" if survey.axis is YAW else f" --axis {survey.axis.name}"
    for name in ("check", "report"):
        console.print(f"  rovid {name} {survey.folder}{axis}", highlight=False, soft_wrap=True)


def show_fit(
    console: Console, fit: _Fit, show: Callable[[Console, _Fit], None], study: Study, parameters: Parameters
) -> None:
    """Print a fit, how the signals were filtered, what was noticed, and where the parameters went."""
    show_caution(console, study.vehicle.guess)
    show(console, fit)
    if study.runs is not None and isinstance(fit, LikelihoodFit) and fit.estimate.per_inertia:
        show_decay(console, read_decay(fit.model, fit.estimate, study.runs.items, study.vehicle))
    if study.runs is not None:
        show_filter(console, study.runs)
    show_warnings(console, [*study.remarks(), *fit.estimate.warnings])
    say(console, f"written to {parameters.path}")
