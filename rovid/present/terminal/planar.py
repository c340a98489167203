"""Fit, simulation, plan, diagnosis, comparison and export of the coupled model on a terminal."""

import math
from collections.abc import Sequence
from pathlib import Path

from rich.console import Console

from rovid.compare.comparison import PlanarComparison
from rovid.core.formatting import plus_minus, significant
from rovid.diagnose.result import UNIDENTIFIABLE
from rovid.planar.diagnosis import PlanarAssessment, PlanarDiagnosis
from rovid.planar.experiment import PlanarPlan
from rovid.planar.fit import PlanarFit
from rovid.planar.trial_simulation import SENSOR_UNITS, PlanarTrialSimulation, pooled_measures
from rovid.present.console import (
    ResultTable,
    mixed_number_column,
    print_labelled,
    print_text,
    show_caution,
    show_faults,
    show_warnings,
    text_column,
)
from rovid.present.documents.planar import next_planar_experiment
from rovid.present.number_format import DASH, format_number, rounded_errors, sensor_words, unit_symbol
from rovid.present.sentences import (
    comparison_headline,
    criterion_sentence,
    effect_title,
    evidence_definitions,
    improvement_words,
    join_words,
    next_step,
)
from rovid.present.tables.fits import estimate_table
from rovid.present.tables.trials import planar_simulation_table
from rovid.present.terminal.diagnosis import show_finding, show_other_faults, show_verdict
from rovid.present.terminal.results import show_plan
from rovid.store.planar_study import PlanarStudy
from rovid.trial.assumptions import Assumptions
from rovid.trial.axis import YAW

# Number of undetermined combinations that have a sentence of their own.
_COMBINATIONS = 3
_SCALE = (
    "These data never show a common factor on all thrust. If all inertias and drags change by one factor, less thrust "
    "and a larger vehicle look the same."
)


def show_planar_fit(console: Console, fit: PlanarFit, study: PlanarStudy) -> None:
    """Print the answer, the parameters, and what the logs do not determine."""
    show_caution(console, study.vehicle.assumptions)
    show_faults(console, study.logs.faults)
    r2 = [f"{sensor_words(sensor)} {value:.3f}" for sensor, value in fit.free_run_r2.items() if math.isfinite(value)]
    agreement_words = f"R² of the free-running simulation: {join_words(r2)}." if r2 else ""
    print_labelled(console, fit_sentence(fit), agreement_words)
    console.print()
    _show_parameters(console, fit)
    print_text(console, criterion_sentence(fit))
    print_text(console, f"disturbance: {'; '.join(_disturbance_words(fit, axis) for axis in fit.disturbance)}")
    print_text(console, f"noise: {', '.join(_noise_words(sensor, size) for sensor, size in fit.noise.items())}")
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


def _show_parameters(console: Console, fit: PlanarFit) -> None:
    console.print(estimate_table(fit.estimate, coupled=True))
    for text in undetermined_sentences(fit):
        print_labelled(console, "Not determined:", text, "bold yellow")
    for text in prior_sentences(fit):
        print_labelled(console, "From the prior:", text, "bold yellow")


def _disturbance_words(fit: PlanarFit, axis: str) -> str:
    size, time = fit.disturbance[axis]
    unit = "N m" if axis == "yaw" else "N"
    number = fit.estimate.assumptions.mark_number(format_number(size), unit)
    limit = ", at its limit" if axis in fit.at_limit else ""
    return f"{axis} {number} {unit} with a correlation time of {format_number(time, 2)} s{limit}"


def _noise_words(sensor: str, size: float) -> str:
    if sensor == "heading":
        return f"{sensor_words(sensor)} {format_number(math.degrees(size), 2)} deg"
    return f"{sensor_words(sensor)} {format_number(size, 2)} {SENSOR_UNITS[sensor]}"


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
    run, estimate = plan.ranked.best.run, plan.fit.estimate
    print_labelled(console, "Next:", f"{run.name}, {run.seconds:.0f} s, because {plan.reason}.")
    show_plan(console, plan.ranked, files)
    columns = map(mixed_number_column, ("by the logs", "with the best run"))
    table = ResultTable("Standard errors, as predicted", text_column("parameter"), *columns, text_column("unit"))
    for name, pair in plan.errors.items():
        cells = [format_number(one, 2) if math.isfinite(one) else "not determined" for one in pair]
        table.add_row(name, *cells, unit_symbol(estimate.unit(name)))
    console.print(table)
    for reason in dict.fromkeys(plan.left_out.values()):
        names = [name for name, why in plan.left_out.items() if why == reason]
        print_text(console, f"left out, {reason}: {'; '.join(names)}")
    show_warnings(console, warnings)


def show_planar_diagnosis(console: Console, diagnosis: PlanarDiagnosis, study: PlanarStudy) -> None:
    """Print the verdict, the causes with their evidence, the improvement, and the next run."""
    guess = study.vehicle.assumptions
    show_caution(console, guess)
    show_other_faults(console, diagnosis, study.logs.faults)
    show_verdict(console, diagnosis, guess)
    if diagnosis.missing:
        print_text(console, diagnosis.missing)
    for finding in diagnosis.causes:
        show_finding(console, finding)
    for sentence in evidence_definitions(diagnosis.causes):
        print_text(console, sentence)
    base, extended = diagnosis.base, diagnosis.extended
    if base is not None and extended is not None:
        console.print()
        if extended.fit.model.effects:
            print_labelled(console, "Gain on trials that were not fitted:", gain_words(base, extended))
        if table := planar_held_out_table(diagnosis):
            table.print(console, guess)
        _show_parameters(console, extended.fit)
    if diagnosis.unexplained_shares:
        shares = [f"{axis} {100.0 * share:.2g} %" for axis, share in diagnosis.unexplained_shares.items()]
        print_text(console, f"left unexplained, in percent of the variance of all forces: {', '.join(shares)}")
    if diagnosis.verdict != "bad_logs":
        print_text(console, f"cannot be found from these data: {UNIDENTIFIABLE['thrust_scale']}")
    print_labelled(console, "Next:", str(next_step(diagnosis, next_planar_experiment(diagnosis), guess)))
    show_warnings(console, [*study.remarks(), *diagnosis.warnings])


def gain_words(base: PlanarAssessment, extended: PlanarAssessment) -> str:
    """By how much each error on held-out trials changes with the causes."""
    one, other = base.held_out, extended.held_out
    errors = {f"{sensor_words(name)} error": (size, other.rmse[name]) for name, size in one.rmse.items()}
    for horizon, size in one.heading_errors.items():
        if horizon in other.heading_errors:
            errors[f"heading error after {horizon:.0f} s"] = size, other.heading_errors[horizon]
    return improvement_words(errors)


def planar_held_out_table(diagnosis: PlanarDiagnosis) -> ResultTable | None:
    """Errors of simulations of held-out trials, in one column where both models are the same; None without models."""
    base, extended = diagnosis.base, diagnosis.extended
    if base is None or extended is None:
        return None
    models = ("plain model", "extended model")[: 1 + bool(extended.fit.model.effects)]
    columns = map(mixed_number_column, (*models, "noise floor"))
    table = ResultTable("Error on trials that were not fitted", text_column("quantity"), *columns)
    sides = (base.held_out, extended.held_out)[: len(models)]
    for name in base.held_out.rmse:
        cells = rounded_errors([*(side.rmse.get(name) for side in sides), diagnosis.noise_floors.get(name)])
        table.add_row(f"{sensor_words(name)} RMSE, {unit_symbol(SENSOR_UNITS[name])}", *cells)
    for horizon in base.held_out.heading_errors:
        errors = [*(side.heading_errors for side in sides), diagnosis.heading_floors]
        cells = rounded_errors([YAW.to_display(each.get(horizon)) for each in errors])
        table.add_row(f"heading after {horizon:.0f} s, deg", *cells)
    table.add_row("log-likelihood", *(format_number(side.log_likelihood, ".0f") for side in sides), "")
    return table


def show_planar_comparison(console: Console, comparison: PlanarComparison, warnings: Sequence[str]) -> None:
    """Print the result of a comparison, the parameters of both campaigns, and the predictions."""
    guess = comparison.assumptions
    show_caution(console, guess)
    print_labelled(console, comparison_headline(comparison))
    if comparison.verdict != "changed" and comparison.detectable:
        shares = [f"{name} {significant(100.0 * size, 2)} %" for name, size in comparison.detectable.items()]
        print_text(console, f"Smallest changes that these data would establish: {', '.join(shares)}.")
    print_text(console, _SCALE)
    console.print()
    columns = map(mixed_number_column, ("A", "B", "unit", "B over A", "confidence of a change"))
    table = ResultTable("Parameters of both campaigns", text_column("parameter"), *columns)
    for change in comparison.changes:
        a, b = (plus_minus(one.value, one.standard_error) for one in (change.a, change.b))
        ratio = plus_minus(change.ratio, change.standard_error) if math.isfinite(change.ratio) else DASH
        if math.isfinite(change.difference):
            ratio = f"{plus_minus(*map(math.degrees, (change.difference, change.standard_error)))} deg more"
        table.add_row(change.name, a, b, unit_symbol(change.a.unit), ratio, format_number(change.confidence, ".3f"))
    table.print(console, guess)
    if comparison.predictions:
        speeds = list(dict.fromkeys(speed for fits in comparison.predictions.values() for speed in fits))
        agreements = [mixed_number_column(f"R² {sensor_words(speed)}") for speed in speeds]
        table = ResultTable("Free-running simulation of each campaign's runs", text_column("model"), *agreements)
        for (model, runs), fits in comparison.predictions.items():
            cells = [format_number(fits[speed].r2, ".4f") if speed in fits else DASH for speed in speeds]
            table.add_row(f"{model.upper()} on the runs of {runs.upper()}", *cells)
        table.print(console, guess)
    show_warnings(console, warnings)
