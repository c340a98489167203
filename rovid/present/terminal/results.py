"""Results of fits, simulations, plans, exports and surveys on a terminal."""

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from rich.console import Console

from rovid.core.errors import join_words
from rovid.core.formatting import plus_minus, rounded
from rovid.estimate.assumed_models import SIZE_SHARES
from rovid.estimate.estimate import PER_INERTIA
from rovid.estimate.experiment_design import DECISIVE_LLR, ExperimentPlan
from rovid.estimate.inertia import InertiaFit
from rovid.estimate.isolability import IsolabilityMatrix, PairSeparation
from rovid.estimate.maximum_likelihood import LikelihoodFit
from rovid.estimate.oscillation_tests import FreeDecay, Quantity, analyse_free_decay
from rovid.estimate.steady_drag import DragFit
from rovid.estimate.thrust_curve import ThrustCurveFit, ThrustScale
from rovid.export.verification import Mismatch, VerifiedExport
from rovid.planar.experiment import PlanarPlan
from rovid.planar.fit import PlanarFit
from rovid.planar.trial_simulation import SENSOR_UNITS, PlanarTrialSimulation, pooled_measures
from rovid.present.console import (
    VERDICT_STYLES,
    ResultTable,
    mixed_number_column,
    print_labelled,
    print_path,
    print_text,
    show_caution,
    show_faults,
    show_warnings,
    text_column,
)
from rovid.present.number_format import format_number, sensor_words, unit_symbol
from rovid.present.sentences import criterion_sentence, effect_title, fit_verdict
from rovid.present.tables.fits import directions_table, estimate_table, methods_table, sine_table, steady_table
from rovid.present.tables.trials import loss_title, planar_simulation_table
from rovid.store.planar_study import PlanarStudy
from rovid.store.study import Study
from rovid.trial.assumptions import Assumptions

_RUNS_SHOWN = 8
# Largest number of bench readings in the table.
_READINGS_SHOWN = 40
# Ratio of two errors above which they are said to differ.
_FEW = 1.05
# Share by which a planned run has to reduce a standard error, or its use is in doubt; a decision.
_LEAST_NARROWED = 0.1


def show_fit(console: Console, fit: DragFit | InertiaFit | LikelihoodFit, study: Study) -> None:
    """Print a fit, the low-pass filter, and the warnings."""
    show_caution(console, study.vehicle.assumptions)
    show_faults(console, study.faults)
    estimate, guess = fit.estimate, fit.estimate.assumptions
    if isinstance(fit, DragFit):
        steady_table(fit).print(console, guess)
        if fit.unsteady:
            logs = ", ".join(dict.fromkeys(point.source for point in fit.unsteady))
            print_text(console, f"{len(fit.unsteady)} holds left out because the rate was still changing, in {logs}")
        console.print(estimate_table(estimate))
        correlation = math.nan if estimate.refused else estimate.correlation("quadratic_drag", "linear_drag")
        words = f"{estimate.method}; R² {format_number(fit.r_squared, '.4f')}; correlation of DQ and DL "
        print_text(console, f"{words}{format_number(correlation, '.2f')}; {estimate.samples} steady states")
        if fit.directions:
            directions_table(fit).print(console, guess)
    elif isinstance(fit, InertiaFit):
        methods_table(fit, None).print(console, guess)
        if any(reading.runs for reading in fit.methods.values()):
            sine_table(fit).print(console, guess)
        console.print(estimate_table(estimate))
        if fit.added_inertia is not None:
            added = plus_minus(fit.added_inertia, estimate.standard_error("inertia"))
            unit = unit_symbol(estimate.unit("inertia"))
            print_text(console, f"added inertia (inertia less that of the rigid body): {added} {unit}")
    else:
        _show_likelihood(console, fit)
        if study.runs is not None and estimate.per_inertia:
            _show_decay(console, analyse_free_decay(fit.model, estimate, study.runs.items, study.vehicle))
    if study.runs is not None:
        runs = study.runs
        noise, rate, acceleration = runs.noise()
        name, shown, factor = runs.axis.measured_quantity(integrated=runs.rate_only)
        unit = runs.axis.rate_unit
        origin = "chosen from the data" if runs.chosen else "as given"
        note = f"low pass {runs.cutoff:.3g} Hz, {origin}; noise: {name} {format_number(noise * factor, 2)} {shown}, "
        note += f"rate {format_number(rate, 2)} {unit}, acceleration {format_number(acceleration, 2)} {unit}²"
        print_text(console, note)
    show_warnings(console, [*study.remarks(), *estimate.warnings])


def _show_likelihood(console: Console, fit: LikelihoodFit) -> None:
    estimate, axis = fit.estimate, fit.estimate.axis
    text, kind = fit_verdict(fit)
    print_labelled(console, text, style=VERDICT_STYLES[kind])
    console.print(estimate_table(estimate))
    print_text(console, criterion_sentence(fit))
    name, unit, factor = axis.measured_quantity(integrated=fit.rate_only)
    force_unit = axis.force_unit + (PER_INERTIA if estimate.per_inertia else "")
    noise = format_number(factor * fit.position_noise, 2)
    disturbance = estimate.assumptions.mark_number(format_number(fit.disturbance), axis.force_unit)
    size = f"disturbance {axis.force_name} {disturbance} {force_unit} with a correlation time of "
    print_text(console, f"{size}{format_number(fit.correlation_time, 2)} s; {name} noise {noise} {unit}")
    text = f"free-running {axis.rate_words} R² {fit.free_run_r2:.4f}; the plain model, fitted to that rate alone, "
    print_text(console, f"{text}reaches {fit.simulation_r2:.4f}")


def _show_decay(console: Console, decay: FreeDecay) -> None:
    """Print period and damping of the swings, and the ratios to the inertia."""

    def shown(quantity: Quantity) -> str:
        return plus_minus(quantity.value, quantity.standard_error)

    columns = map(mixed_number_column, ("deg", "natural period", "damping ratio"), ("", "s", ""))
    table = ResultTable("Free decay", text_column("swing from"), *columns)
    for swing in (*decay.swings, decay.rms_swing):
        name = f"the largest of {swing.name}" if swing.name else "the root mean square of all"
        amplitude = format_number(math.degrees(swing.amplitude), ".1f")
        table.add_row(name, amplitude, shown(swing.natural_period), shown(swing.damping_ratio))
    console.print(table)
    linear, quadratic = map(shown, decay.terms.values())
    frequency = decay.natural_frequency
    ratios = [f"{name.replace('_', ' ')} {shown(each)} {each.unit}" for name, each in decay.over_inertia.items()]
    text = f"natural frequency {shown(frequency)} {frequency.unit}; damping ratio {linear} from the linear drag, and "
    print_text(console, f"{text}{quadratic} for each rad of amplitude from the quadratic drag")
    print_text(console, f"over the inertia: {', '.join(ratios)}")


def show_bench(console: Console, fit: ThrustCurveFit, output: Path) -> None:
    """Print bench readings next to the fitted thrust curve."""
    columns = map(mixed_number_column, ("command", "thrust", "curve", "residual"), ("", "N", "N", "N"))
    table = ResultTable("Bench readings against the curve", *columns)
    step = max(len(fit.command) // _READINGS_SHOWN, 1)
    # Decimals of a thousandth of the largest reading, the accuracy of a good bench.
    decimals = 3 - math.ceil(math.log10(float(np.max(np.abs(fit.thrust)))))
    readings = zip(fit.command[::step], fit.thrust[::step], fit.residuals[::step], strict=True)
    for command, thrust, residual in readings:
        cells = [rounded(value, decimals) for value in (thrust, thrust - residual, residual)]
        table.add_row(f"{command:.5g}", *cells)
    console.print(table)
    if step > 1:
        print_text(console, f"every {step}th of {len(fit.command)} readings shown")
    dead_zone = " to ".join(map("{:.5g}".format, fit.dead_zone or ())) or "none"
    if fit.dead_zone and fit.noise > 0.0:
        dead_zone += f" (thrust up to {format_number(fit.noise, 2)} N, which the readings do not resolve)"
    least, most = (rounded(value, decimals) for value in (fit.curve.thrust.min(), fit.curve.thrust.max()))
    largest = format_number(float(np.max(np.abs(fit.residuals))), 2)
    text = f"dead zone {dead_zone}; thrust {least} to {most} N; residual {format_number(fit.rms, 2)} N rms, "
    print_text(console, f"{text}{largest} N at most")
    print_text(console, f"written to {output}")


def show_thrust_scale(console: Console, scale: ThrustScale, given: float) -> None:
    """Print the scale of all thrust, and the lines for rovid.toml."""
    low, high = (format_number(given * edge) for edge in scale.interval())
    value, error = given * scale.value, given * scale.standard_error
    text = f"{plus_minus(value, error)}, 95 % interval {low} to {high}; {scale.method}"
    print_labelled(console, "Scale of all thrust:", text)
    few = " Fits take a larger one, because the readings are few." * (
        scale.error_for_fits > _FEW * scale.standard_error
    )
    print_text(console, f"The error includes {100.0 * scale.reference_error:.2g} % for the reference.{few}")
    print_labelled(console, "Next:", "enter in [vehicle] of rovid.toml, and fit again:")
    print_path(console, f"  thrust_scale = {value:.6g}")
    print_path(console, f"  thrust_scale_error = {given * scale.error_for_fits:.3g}")


def show_plan(
    console: Console, plan: ExperimentPlan, written: Sequence[Path], guess: Assumptions, warnings: Sequence[str]
) -> None:
    """Print the best runs and the paths of the files that were written."""
    show_caution(console, guess)
    discriminates = len(plan.models) > 1
    gain = "factor"
    caption = f"Runs by the factor that divides the variance of the {plan.parameter.replace('_', ' ')}"
    if discriminates:
        gain, caption = "log-likelihood", f"Runs that distinguish {plan.models[0].name} from {plan.models[1].name}"
    columns = map(mixed_number_column, ("minutes", f"{gain} a minute", gain))
    table = ResultTable(caption, text_column("run"), *columns)
    for best in plan.runs[:_RUNS_SHOWN]:
        gains = [best.gain_per_minute, best.gain]
        if not discriminates:
            # The gain is the logarithm of the factor by which the variance falls.
            gains = list(map(math.exp, gains))
        table.add_row(best.run.name, format_number(best.run.seconds / 60.0, ".1f"), *map(format_number, gains))
    run = plan.best.run
    where = f", in {written[0]}" if written else ""
    print_labelled(console, "Next:", f"{run.name}, {format_number(run.seconds / 60.0, '.1f')} min{where}")
    print_labelled(console, "Reason:", f"{plan.reason}.")
    console.print()
    console.print(table)
    if not plan.is_decisive:
        undecided = (
            f"No run is expected to decide: this takes a log-likelihood gain of {DECISIVE_LLR:.0f}. Allow longer runs "
            "or larger commands, or repeat the best run several times."
        )
        show_warnings(console, [undecided])
    narrowed = 1.0 - math.exp(-0.5 * plan.best.gain)
    if not discriminates and narrowed < _LEAST_NARROWED:
        hardly = (
            f"This run hardly helps: it makes the standard error {100.0 * narrowed:.1f} % smaller. Allow a longer run."
        )
        show_warnings(console, [hardly])
    for path in written:
        print_path(console, f"written: {path}")
    show_warnings(console, warnings)


def show_matrix(console: Console, matrix: IsolabilityMatrix, guess: Assumptions, warnings: Sequence[str]) -> None:
    """Print how many pairs of causes a programme separates, the hardest pairs, and the use of further sensors."""
    show_caution(console, guess)
    still_open = matrix.open_pairs
    separated, minutes = len(matrix.pairs) - len(still_open), format_number(matrix.seconds / 60.0, ".0f")
    answer = f"{separated} of {len(matrix.pairs)} pairs of causes are told apart in {minutes} minutes of this programme"
    print_labelled(console, f"{answer}.")
    if still_open:
        print_labelled(console, "Not:", _pair_words(still_open))
    if not matrix.pairs:
        print_text(console, "Fewer than two causes are visible. Plan longer runs or larger commands.")
    if matrix.invisible:
        most = f"Not visible, at {100.0 * SIZE_SHARES[-1]:.0f} % of the rate either:"
        print_labelled(console, most, ", ".join(matrix.invisible))
    sensors = list(matrix.sensor_causes)
    columns = map(mixed_number_column, ("minutes", "log-likelihood", *map("+ {}".format, sensors)))
    table = ResultTable("Hardest pairs: minutes until they are told apart", text_column("causes"), *columns)
    for pair in matrix.pairs[: max(_RUNS_SHOWN, len(still_open))]:
        times = [pair.seconds, *map(pair.with_sensor.__getitem__, sensors)]
        minutes, *with_sensor = (format_number(time / 60.0, ".1f", "never") for time in times)
        table.add_row(f"{pair.first} or {pair.second}", minutes, format_number(pair.gain), *with_sensor)
    console.print()
    console.print(table)
    for name, causes in matrix.sensor_causes.items():
        pairs = matrix.separated_by(name)
        words = [f"tells apart {_pair_words(pairs)}"] if pairs else []
        words += [f"allows tests of {', '.join(causes)}"] if causes else []
        print_labelled(console, f"With {name}:", "; ".join(words) or "nothing more")
    text = (
        f"A pair counts as told apart from an expected log-likelihood ratio of {DECISIVE_LLR:.0f}. Minutes beyond the "
        "programme are those of its repetition. Causes without a fitted size change the simulated rate by "
    )
    least, *larger = SIZE_SHARES
    text += f"{100.0 * least:.0f} %"
    for share in larger:
        if names := [cause.name for cause in matrix.causes if cause.share == share]:
            text += f"; {', '.join(names)} by {100.0 * share:.0f} %"
    print_text(console, f"{text}.")
    show_warnings(console, warnings)


def _pair_words(pairs: Sequence[PairSeparation]) -> str:
    words = [f"{pair.first} or {pair.second}" for pair in pairs[:_RUNS_SHOWN]]
    if len(pairs) > _RUNS_SHOWN:
        words.append(f"{len(pairs) - _RUNS_SHOWN} more")
    return "; ".join(words)


def show_export(console: Console, path: Path, made: VerifiedExport, guess: Assumptions) -> None:
    """Print how the target's equation differs from the model, what the target lacks, and its stability."""

    def differences(mismatch: Mismatch) -> str:
        parts = []
        for name, unit in made.velocities.items():
            percent, rms = (format_number(each[name], 2) for each in (mismatch.percent_of_range, mismatch.rms))
            parts.append(f"{name.replace('_', ' ')} off by {percent} % of its range, {rms} {unit} rms")
        return "; ".join(parts)

    show_caution(console, guess)
    holds_model = not math.isnan(made.mismatch.rms["yaw_rate"])
    print_path(console, str(path))
    if holds_model:
        print_text(console, f"Written, and re-simulated with the target's equation: {differences(made.mismatch)}")
    else:
        print_text(console, "Written. The file holds no model of the vehicle to re-simulate.")
    if made.losses and holds_model:
        print_text(console, f"without the parts that the target lacks: {differences(made.kept_mismatch)}")
    for loss in made.losses:
        name, largest = max(loss.percent_of_range.items(), key=lambda item: item[1])
        share = f", {format_number(largest, 2)} % of the range of the {name.replace('_', ' ')}" if holds_model else ""
        print_labelled(console, "Not held:", f"{loss_title(loss.what)}{share}: {loss.why}.", "red")
    label, verdict = "Stability:" if holds_model else "Vehicle without control:", made.stability
    print_labelled(console, label, verdict.text, "green" if verdict.stable else "red")
    show_warnings(console, made.warnings)


# Number of undetermined combinations that have a sentence of their own.
_COMBINATIONS = 3


def show_planar_fit(console: Console, fit: PlanarFit, study: PlanarStudy) -> None:
    """Print the answer, the parameters, and what the logs do not determine."""
    show_caution(console, study.vehicle.assumptions)
    show_faults(console, study.logs.faults)
    r2 = [f"{sensor_words(sensor)} {value:.3f}" for sensor, value in fit.free_run_r2.items() if math.isfinite(value)]
    agreement_words = f"R² of the free-running simulation: {join_words(r2)}." if r2 else ""
    print_labelled(console, fit_sentence(fit), agreement_words)
    console.print()
    show_planar_parameters(console, fit)
    print_text(console, criterion_sentence(fit))
    disturbances, noise = [], []
    for axis, (size, time) in fit.disturbance.items():
        unit = "N m" if axis == "yaw" else "N"
        number = fit.estimate.assumptions.mark_number(format_number(size), unit)
        limit = ", at its limit" * (axis in fit.at_limit)
        disturbances.append(f"{axis} {number} {unit} with a correlation time of {format_number(time, 2)} s{limit}")
    for sensor, size in fit.noise.items():
        shown, unit = (math.degrees(size), "deg") if sensor == "heading" else (size, SENSOR_UNITS[sensor])
        noise.append(f"{sensor_words(sensor)} {format_number(shown, 2)} {unit}")
    print_text(console, f"disturbance: {'; '.join(disturbances)}")
    print_text(console, f"noise: {', '.join(noise)}")
    if fit.latency:
        late = [f"{sensor_words(sensor)} {plus_minus(*pair)} s" for sensor, pair in fit.latency.items()]
        print_text(console, f"latency: {', '.join(late)}")
    show_warnings(console, [*study.remarks(), *fit.warnings])


def fit_sentence(fit: PlanarFit) -> str:
    """The result of a fit in one sentence."""
    estimate, effects = fit.estimate, [effect_title(one.effect) for one in fit.model.effects]
    determined = len(estimate.names) - len(set(estimate.refused) & set(estimate.names))
    model = "Surge, sway and yaw in one model"
    if effects:
        model += f", with {join_words(effects)}"
    return f"{model}: the logs determine {determined} of {len(estimate.names)} parameters."


def undetermined_sentences(fit: PlanarFit) -> list[str]:
    """What the logs do not determine, with the reason; parameters with one reason in one sentence."""
    estimate, sentences = fit.estimate, [one.text for one in fit.undetermined[:_COMBINATIONS]]
    if more := len(fit.undetermined) - len(sentences):
        sentences.append(f"So it is with {more} more combinations, which --json lists in full.")
    listed = {name for one in fit.undetermined for name in one.combination}
    reasons: dict[str, list[str]] = {}
    for name, reason in estimate.refused.items():
        if name not in listed and name in estimate.names:
            reasons.setdefault(reason, []).append(name)
    return [*sentences, *(f"{join_words(names)}: {reason}." for reason, names in reasons.items())]


def prior_sentences(fit: PlanarFit) -> list[str]:
    """What the prior decides, and not the logs."""
    names = fit.prior.decided
    sentences = [f"{join_words(names)}: the logs hold less than half of what is known."] if names else []
    combinations = fit.prior.only_by_prior[:_COMBINATIONS]
    return sentences + [f"The logs alone do not determine a combination. {one.text}" for one in combinations]


def show_planar_parameters(console: Console, fit: PlanarFit) -> None:
    """Print the parameters of the coupled model, and those that the logs do not determine."""
    console.print(estimate_table(fit.estimate, coupled=True))
    for text in undetermined_sentences(fit):
        print_labelled(console, "Not determined:", text, "bold yellow")
    for text in prior_sentences(fit):
        print_labelled(console, "From the prior:", text, "bold yellow")


def show_planar_simulation(
    console: Console, simulations: Sequence[PlanarTrialSimulation], guess: Assumptions, warnings: Sequence[str]
) -> None:
    """Print how well the free-running simulation follows each run."""
    show_caution(console, guess)
    print_labelled(console, simulation_sentence(simulations))
    console.print()
    planar_simulation_table(simulations).print(console, guess)
    show_warnings(console, warnings)


def simulation_sentence(simulations: Sequence[PlanarTrialSimulation]) -> str:
    """Agreement of the free-running simulation with all runs, in one sentence."""
    fits = pooled_measures(simulations)
    words = [f"{sensor_words(sensor)} {format_number(fit.r2, '.3f')}" for sensor, fit in fits.items()]
    return f"R² of the free-running simulation over all runs: {join_words(words)}."


def show_planar_plan(
    console: Console, plan: PlanarPlan, study: PlanarStudy, files: Sequence[Path], warnings: Sequence[str]
) -> None:
    """Print the best run, the candidates, the standard errors before and after, and the runs that were left out."""
    show_caution(console, study.vehicle.assumptions)
    estimate = plan.fit.estimate
    show_plan(console, plan.ranked, files, Assumptions(), ())
    columns = map(mixed_number_column, ("by the logs", "with the best run"))
    table = ResultTable("Standard errors, as predicted", text_column("parameter"), *columns, text_column("unit"))
    for name, pair in plan.errors.items():
        cells = [format_number(one, 2, "not determined") for one in pair]
        table.add_row(name, *cells, unit_symbol(estimate.unit(name)))
    console.print(table)
    for reason in dict.fromkeys(plan.left_out.values()):
        names = [name for name, why in plan.left_out.items() if why == reason]
        print_text(console, f"left out, {reason}: {'; '.join(names)}")
    show_warnings(console, warnings)
