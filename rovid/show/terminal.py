"""Results as aligned tables for a person at a terminal."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from rich import box
from rich.console import Console
from rich.table import Table

from rovid.campaign.axis import YAW
from rovid.campaign.trial import Trial
from rovid.export import Exported
from rovid.ground.numbers import plus_minus
from rovid.ground.screen import led
from rovid.identify.bench import BenchFit
from rovid.identify.decay import Decay, read_decay
from rovid.identify.estimate import PER_INERTIA, Estimate
from rovid.identify.inertia import METHODS, InertiaFit
from rovid.identify.likelihood import LikelihoodFit
from rovid.identify.steady import DragFit
from rovid.identify.steady_points import SteadyPoint
from rovid.inspect.advice import Advice
from rovid.inspect.first_config import Survey, logs_in_words
from rovid.model.simulation import TrialSimulation, overall
from rovid.motion.runs import Runs
from rovid.parameters.parameters import Parameters
from rovid.plan.design import Plan
from rovid.plan.worth import DECIDES
from rovid.study import Study

_RUNS_SHOWN = 8
_Fit = TypeVar("_Fit", DragFit, InertiaFit, LikelihoodFit)


def table(title: str, *columns: str, left: int = 1) -> Table:
    """A table whose first ``left`` columns are text and the rest numbers."""
    made = Table(title=title, title_justify="left", title_style="bold", box=box.SIMPLE_HEAD, pad_edge=False)
    for k, column in enumerate(columns):
        made.add_column(column, justify="left" if k < left else "right", overflow="fold")
    return made


def number(value: float | None, form: str = ".3g") -> str:
    """A number as text, a dash where there is none."""
    return "–" if value is None or not math.isfinite(value) else format(value, form)


def show_warnings(console: Console, warnings: Sequence[str]) -> None:
    """Print each warning as a paragraph of its own."""
    for text in warnings:
        console.print(led("Note:", text, "yellow"), highlight=False)


def show_export(console: Console, path: Path, made: Exported) -> None:
    """Print how far the target's own equation is from rovid's, and what it does not hold."""
    console.print(str(path), highlight=False, soft_wrap=True)
    console.print(
        f"re-simulated in the target's equation: yaw rate off by {made.mismatch.percent_of_range:.2g} % of its range, "
        f"{made.mismatch.rms:.2g} rad/s rms",
        highlight=False,
    )
    if made.losses:
        console.print(
            f"of what it holds: {made.held.percent_of_range:.2g} %, {made.held.rms:.2g} rad/s rms", highlight=False
        )
    for loss in made.losses:
        size = number(loss.percent_of_range, ".2g")
        console.print(led("Not held:", f"{loss.what}, {size} % of range: {loss.why}.", "red"), highlight=False)
    show_warnings(console, made.warnings)


def show_filter(console: Console, runs: Runs) -> None:
    """Print the low pass and the noise that it leaves."""
    noise, rate, acceleration = runs.noise()
    name, shown, factor = runs.axis.measured(integrated=runs.integrated)
    unit = runs.axis.rate_unit
    console.print(
        f"low pass {runs.cutoff:.3g} Hz, {'chosen from the data' if runs.chosen else 'as given'}; noise: "
        f"{name} {noise * factor:.2g} {shown}, rate {rate:.2g} {unit}, acceleration {acceleration:.2g} {unit}²",
        highlight=False,
    )


def show_parameters(console: Console, estimate: Estimate) -> None:
    """Print value ± standard error with the 95 % interval."""
    rows = table("", "parameter", "value ± standard error", "unit", "95 % interval")
    rows.title = None
    for name in estimate.names:
        if name in estimate.refused:
            rows.add_row(name, "not determined", estimate.unit(name), "–")
            continue
        low, high = estimate.interval(name)
        interval = f"{low:.4g} … {high:.4g}" if math.isfinite(low) else "–"
        rows.add_row(
            name, plus_minus(estimate.value(name), estimate.standard_error(name)), estimate.unit(name), interval
        )
    console.print(rows)


def show_drag(console: Console, fit: DragFit) -> None:
    """Print what `rovid fit-drag` found."""
    axis = fit.estimate.axis
    rows = table(
        "Steady states",
        "log",
        "from s",
        "to s",
        "command",
        f"{axis.push} {axis.push_unit}",
        f"rate {axis.rate_unit}",
        f"± {axis.rate_unit}",
        f"residual {axis.push_unit}",
        "without it DQ",
        "DL",
    )
    for point, residual, left_out in zip(fit.points, fit.residuals, fit.left_out, strict=True):
        rows.add_row(*_point_cells(point), number(residual, ".2f"), number(left_out[0], ".5g"), number(left_out[1]))
    console.print(rows)
    if fit.unsteady:
        found = ", ".join(dict.fromkeys(point.source for point in fit.unsteady))
        console.print(
            f"{len(fit.unsteady)} holds left out because the rate was still changing, in {found}",
            highlight=False,
        )
    estimate = fit.estimate
    show_parameters(console, estimate)
    correlation = estimate.correlation("quadratic_drag", "linear_drag") if not estimate.refused else math.nan
    console.print(
        f"{estimate.method}; R² {number(fit.r_squared, '.4f')}; correlation of DQ and DL {number(correlation, '.2f')}; "
        f"{estimate.samples} steady states",
        highlight=False,
    )
    for name, each in fit.directions.items():
        quadratic, linear = (plus_minus(each.value(key), each.standard_error(key)) for key in each.names)
        console.print(f"{axis.position_words} {name} alone: DQ {quadratic}, DL {linear}", highlight=False)


def _point_cells(point: SteadyPoint) -> list[str]:
    return [
        point.source,
        number(point.start, ".0f"),
        number(point.stop, ".0f"),
        " ".join(f"{value:.4g}" for value in point.command),
        number(point.torque, ".1f"),
        number(point.rate, ".4f"),
        number(point.rate_error, ".4f"),
    ]


def show_inertia(console: Console, fit: InertiaFit) -> None:
    """Print what `rovid fit-inertia` found."""
    unit = fit.estimate.unit("inertia").replace("^2", "²")
    rows = table(f"Inertia, {unit}", "method", "value ± standard error", "note")
    for name, inertia in fit.methods.items():
        note = "used" if name == fit.chosen else ""
        if name == "peak" and fit.peak_bias is not None:
            note = f"biased: on the identified model it returns {100 * fit.peak_bias:.0f} % of the truth"
        elif name == "peak":
            note = "biased: torque, rate and acceleration do not peak together"
        rows.add_row(METHODS[name], plus_minus(inertia.value, inertia.standard_error), note)
        if len(inertia.runs) > 1 or name == "peak":
            for source, value, error in inertia.runs:
                rows.add_row(f"  {source}", plus_minus(value, error), "")
    console.print(rows)
    show_parameters(console, fit.estimate)
    if fit.added_inertia is not None:
        error = fit.estimate.standard_error("inertia")
        console.print(
            f"added inertia (inertia less the rigid body's): {plus_minus(fit.added_inertia, error)} {unit}",
            highlight=False,
        )


def show_likelihood(console: Console, fit: LikelihoodFit) -> None:
    """Print what `rovid fit` found."""
    show_parameters(console, fit.estimate)
    axis = fit.estimate.axis
    name, unit, factor = axis.measured(integrated=fit.integrated)
    console.print(
        f"{fit.estimate.method}: log-likelihood {fit.log_likelihood:.1f} over {fit.estimate.samples} readings; "
        f"innovations {'white' if fit.white else 'not white'}",
        highlight=False,
    )
    console.print(
        f"disturbance {axis.push} {fit.disturbance:.3g} {axis.push_unit}"
        f"{PER_INERTIA if fit.estimate.per_inertia else ''} with a memory of "
        f"{fit.correlation_time:.2g} s; {name} noise {factor * fit.position_noise:.2g} {unit}",
        highlight=False,
    )
    console.print(
        f"free-running {axis.rate_words} R² {fit.free_run_r2:.4f}; the fit that looks at nothing else reaches "
        f"{fit.base_r2:.4f}",
        highlight=False,
    )


def show_decay(console: Console, decay: Decay) -> None:
    """Print period and damping of the swings, and the ratios to the inertia."""
    rows = table("Free decay", "swing from", "deg", "natural period s", "damping ratio")
    for swing in (*decay.swings, decay.usual):
        readings = (plus_minus(r.value, r.standard_error) for r in (swing.natural_period, swing.damping_ratio))
        name = f"the largest of {swing.name}" if swing.name else "the root mean square of all"
        rows.add_row(name, number(math.degrees(swing.amplitude), ".1f"), *readings)
    console.print(rows)
    linear, quadratic = (plus_minus(r.value, r.standard_error) for r in decay.terms.values())
    frequency = decay.natural_frequency
    shown = ", ".join(
        f"{name.replace('_', ' ')} {plus_minus(r.value, r.standard_error)} {r.unit}"
        for name, r in decay.over_inertia.items()
    )
    console.print(
        f"natural frequency {plus_minus(frequency.value, frequency.standard_error)} {frequency.unit}; damping ratio "
        f"{linear} of the linear drag, and {quadratic} for each rad of amplitude of the quadratic\n"
        f"over the inertia: {shown}",
        highlight=False,
    )


def show_simulation(console: Console, simulations: Sequence[TrialSimulation]) -> None:
    """Print how well the free-running simulation follows each trial."""
    axis = simulations[0].run.trial.axis
    rows = table(
        f"Free-running simulation against measurement, {axis.rate_words}",
        "trial",
        "samples",
        "R²",
        "fit %",
        f"RMSE {axis.rate_unit}",
        f"{axis.position_words} after 10 s, {axis.shown[0]}",
        f"after 60 s, {axis.shown[0]}",
    )
    for item in simulations:
        errors = [axis.in_shown(item.position_errors[horizon]) for horizon in (10.0, 60.0)]
        rows.add_row(
            item.run.trial.name,
            str(item.fit.samples),
            number(item.fit.r2, ".4f"),
            number(item.fit.fit_percent, ".1f"),
            number(item.fit.rmse, ".2g"),
            *(number(error, ".2g") for error in errors),
        )
    total = overall(simulations)
    rows.add_section()
    rows.add_row(
        "all",
        str(total.samples),
        number(total.r2, ".4f"),
        number(total.fit_percent, ".1f"),
        number(total.rmse, ".2g"),
    )
    console.print(rows)


def show_bench(console: Console, fit: BenchFit, output: Path) -> None:
    """Print the readings beside the curve."""
    rows = table("Bench readings against the curve", "command", "thrust N", "curve N", "residual N", left=0)
    step = max(len(fit.command) // 40, 1)
    for c, t, r in zip(fit.command[::step], fit.thrust[::step], fit.residuals[::step], strict=True):
        rows.add_row(f"{c:.5g}", f"{t:.2f}", f"{t - r:.2f}", f"{r:.2f}")
    console.print(rows)
    if step > 1:
        console.print(f"every {step}th of {len(fit.command)} readings shown", highlight=False)
    zone = "none" if fit.dead_zone is None else f"{fit.dead_zone[0]:.5g} to {fit.dead_zone[1]:.5g}"
    console.print(
        f"dead zone {zone}; thrust {fit.curve.thrust.min():.1f} to {fit.curve.thrust.max():.1f} N; residual "
        f"{fit.rms:.2g} N rms, {np.max(np.abs(fit.residuals)):.2g} N at most",
        highlight=False,
    )
    console.print(f"written to {output}", highlight=False)


def show_plan(console: Console, found: Plan, written: Sequence[Path]) -> None:
    """Print the best runs, and where the first of them went."""
    rivals = len(found.beliefs) > 1
    gain = "log-likelihood" if rivals else "variance over"
    purpose = (
        f"Runs that tell {found.beliefs[0].name} from {found.beliefs[1].name}"
        if rivals
        else f"Runs that make {found.narrow.replace('_', ' ')} surer"
    )
    rows = table(purpose, "run", "minutes", gain, f"{gain} a minute")
    for one in found.runs[:_RUNS_SHOWN]:
        told = (one.gain, one.per_minute) if rivals else (math.exp(one.gain), math.exp(one.per_minute))
        rows.add_row(one.run.name, number(one.run.seconds / 60.0, ".1f"), *(number(x, ".3g") for x in told))
    console.print(rows)
    if not found.decides:
        undecided = (
            f"none is expected to decide: that takes a gain of {DECIDES:.0f}. Allow longer runs or more command, or "
            "play the best several times."
        )
        show_warnings(console, [undecided])
    for path in written:
        console.print(f"written: {path}", highlight=False, soft_wrap=True)


def show_survey(console: Console, found: Survey, written: Sequence[Path]) -> None:
    """Print what each signal was taken for, and what to do next."""
    rows = table(f"Guessed from {logs_in_words(found)}", "signal", "taken from", "unit", "why", left=4)
    for guesses in found.guesses.values():
        for name, one in guesses.signals.items():
            rows.add_row(name, one.source, one.unit, one.why)
        for command in guesses.commands:
            rows.add_row(f"command of {command.name}", command.source, "", command.why)
    console.print(rows)
    show_warnings(console, found.lacking)
    for path in written:
        console.print(f"written: {path}", highlight=False, soft_wrap=True)
    then = f"read {written[0].name}, then rovid check {found.folder} and rovid report {found.folder}"
    console.print(led("Next:", then), highlight=False, soft_wrap=True)


def show_check(console: Console, rows: Sequence[tuple[Trial, Mapping[str, Any]]], problems: Mapping[str, str]) -> None:
    """Print what each log holds and what is wrong with it."""
    axis, integrated = (rows[0][0].axis, rows[0][0].integrated) if rows else (YAW, False)
    _, unit, factor = axis.measured(integrated=integrated)
    way, far = axis.shown
    went = f"{'turned' if axis.angular else 'went'} {way}"
    shown = table("Logs", "log", "s", "samples", "Hz", f"noise {unit}", went, "held", "sines", "remarks")
    for trial, facts in rows:
        shown.add_row(
            trial.name,
            f"{trial.duration:.0f}",
            str(facts["samples"]),
            f"{1.0 / trial.period:.3g}",
            f"{factor * facts['noise']:.2g}",
            f"{far * facts['travel']:.0f}",
            str(facts["held_commands"]),
            str(facts["sine_runs"]),
            ", ".join(f"{remark.count} {remark.kind}" for remark in trial.remarks) or "none",
        )
    for name, problem in problems.items():
        shown.add_row(name, *["–"] * 7, led(problem, style="red"))
    console.print(shown)
    for trial, _ in rows:
        for remark in trial.remarks:
            console.print(f"{trial.name}: {remark.text}", highlight=False)


def show_advice(console: Console, advice: Sequence[Advice]) -> None:
    """Print what to mind before a fit."""
    for one in advice:
        text = one.text[:1].upper() + one.text[1:] if one.text.split(" ")[0].isalpha() else one.text
        console.print(led("Before a fit:", text), highlight=False)
    if not advice:
        console.print("These logs have what a fit wants.", highlight=False)


def show_fit(
    console: Console, fit: _Fit, show: Callable[[Console, _Fit], None], study: Study, parameters: Parameters
) -> None:
    """Print a fit, how the signals were filtered, what was noticed, and where the parameters went."""
    show(console, fit)
    if study.runs is not None and isinstance(fit, LikelihoodFit) and fit.estimate.per_inertia:
        show_decay(console, read_decay(fit.model, fit.estimate, study.runs.items, study.vehicle))
    if study.runs is not None:
        show_filter(console, study.runs)
    show_warnings(console, [*study.remarks(), *fit.estimate.warnings])
    console.print(f"written to {parameters.path}", highlight=False)
