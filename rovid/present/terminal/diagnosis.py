"""Terminal output of diagnoses, comparisons, controllers, trials of effects and discovered formulas."""

import math
from collections.abc import Iterable, Sequence
from pathlib import Path

from rich.console import Console
from rich.text import Text

from rovid.compare.comparison import Comparison, PlanarComparison
from rovid.control.design import ControllerDesign
from rovid.core.errors import join_words
from rovid.core.formatting import labelled_text, plus_minus, significant
from rovid.diagnose import result
from rovid.diagnose.effect_trial import EffectTrial
from rovid.diagnose.formulas.search import Discovery, units_of
from rovid.planar.diagnosis import PlanarAssessment, PlanarDiagnosis
from rovid.planar.trial_simulation import SENSOR_UNITS
from rovid.present import sentences
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
from rovid.present.documents.diagnosis import all_faults, next_planar_experiment
from rovid.present.number_format import DASH, format_number, rounded_errors, sensor_words, unit_symbol
from rovid.present.tables import diagnosis as tables
from rovid.present.tables.fits import estimate_table
from rovid.present.tables.trials import gains_table, runs_table
from rovid.present.terminal.results import show_planar_parameters
from rovid.store.planar_study import PlanarStudy
from rovid.store.study import Study
from rovid.trial.assumptions import Assumptions
from rovid.trial.axis import YAW
from rovid.trial.fault import Fault
from rovid.trial.vehicle import Vehicle

_ALTERNATIVES_SHOWN = 3
_KINDS = {"nothing_found": "pass", "found": "pass", "bad_logs": "fail"}
# Largest share of the variance that is called small: a tenth of the RMS torque. Convention.
_SMALL_SHARE = 0.01


def show_study_diagnosis(console: Console, diagnosis: result.Diagnosis, study: Study) -> None:
    """Print a diagnosis with the guesses, faults and remarks of the ``study``."""
    show_caution(console, study.vehicle.assumptions)
    show_other_faults(console, diagnosis, all_faults(diagnosis, study))
    show_diagnosis(console, diagnosis, study.vehicle)
    show_warnings(console, [*study.remarks(), *diagnosis.warnings])


def show_other_faults(console: Console, diagnosis: result.Conclusion, faults: Sequence[Fault]) -> None:
    """Print the faults without those that stop, which the verdict on bad logs repeats."""
    show_faults(console, [fault for fault in faults if diagnosis.verdict != "bad_logs" or not fault.stops])


def show_verdict(console: Console, diagnosis: result.Conclusion, guess: Assumptions) -> None:
    """Print the verdict, coloured."""
    style = VERDICT_STYLES[_KINDS.get(diagnosis.verdict, "warn")]
    print_labelled(console, sentences.verdict_sentence(diagnosis, guess), style=style)


def show_diagnosis(console: Console, diagnosis: result.Diagnosis, vehicle: Vehicle) -> None:
    """Print the verdict, the causes with their evidence, the improvement, and the next run."""
    axis, guess = vehicle.axis, vehicle.assumptions
    step = sentences.next_step(diagnosis, result.next_experiment(diagnosis), vehicle)
    show_verdict(console, diagnosis, guess)
    if diagnosis.extended is not None:
        extended_words = f" {sentences.EXTENDED_MODEL}" if diagnosis.extended.model.effects else ""
        print_text(console, f"{sentences.PLAIN_MODEL}{extended_words}")
    if diagnosis.missing:
        print_text(console, diagnosis.missing)
    if diagnosis.verdict == "bad_logs":
        print_labelled(console, "Next:", str(step))
        return
    if diagnosis.from_tables is not None:
        tables.predictions_table(diagnosis.from_tables).print(console, guess)
        if diagnosis.from_tables.causes:
            tables.explanations_table(diagnosis.from_tables).print(console, guess)
        if diagnosis.from_tables.ruled_out:
            names = join_words([effect.title for effect in diagnosis.from_tables.ruled_out], "or")
            print_text(console, f"would not explain the tables alone: {names}")
    _show_causes(console, diagnosis)
    if diagnosis.challengers:
        console.print()
        tables.challengers_table(diagnosis, axis).print(console, guess)
    for signal, gain in diagnosis.signals:
        console.print()
        dependence = f"{axis.reword(signal.title)} (log-likelihood gain {gain:.0f})"
        print_text(console, f"Unexplained: {dependence}. This is a dependence, not a cause.")
    if diagnosis.signals or diagnosis.verdict == "unexplained":
        print_text(console, "`rovid discover LOGS` searches for a formula of the unexplained torque.")
    if diagnosis.base is not None and diagnosis.extended is not None:
        _show_improvement(console, diagnosis, diagnosis.base, diagnosis.extended)
        console.print(estimate_table(diagnosis.extended.estimate))
        share = 100.0 * diagnosis.unexplained_share
        comparison = "small: below" if diagnosis.unexplained_share < _SMALL_SHARE else "not small: above"
        size = f"{comparison} {100.0 * _SMALL_SHARE:.0f} %"
        print_text(console, f"left unexplained: {share:.2g} % of the {axis.force_name}'s variance ({size})")
    if diagnosis.verdict == "nothing_found":
        tables.detectable_table(diagnosis, vehicle).print(console, guess)
    unidentifiable = result.not_identifiable(vehicle, diagnosis)
    print_text(console, f"cannot be found from these data: {'; '.join(unidentifiable.values())}")
    if "thrust_scale" in unidentifiable and vehicle.thrusters:
        print_text(console, "A pull, a lift or a step of inertia determines the factor on all thrust: fit-thrust-scale")
    print_labelled(console, "Next:", str(step))


def _show_causes(console: Console, diagnosis: result.Conclusion) -> None:
    for finding in diagnosis.causes:
        show_finding(console, finding)
    for sentence in sentences.evidence_definitions(diagnosis.causes):
        print_text(console, sentence)


def show_finding(console: Console, finding: result.Finding) -> None:
    """Print a cause with its parameters, its evidence, and the run that decides between alternatives."""
    effect, estimate = finding.effect, finding.estimate
    console.print()
    name = sentences.cause_name(finding)
    print_labelled(console, f"{name[:1].upper()}{name[1:]}:", sentences.size_words(finding).replace("\u00a0", " "))
    if caveat := estimate.assumptions.effect_caveat(effect.id):
        print_text(console, Text(f"  {caveat}", style="red"), 2)
    print_text(console, f"  {sentences.evidence_words(finding)}", 2)
    print_text(console, f"  equation: {effect.equation}", 2)
    evidence = f"log-likelihood gain: {finding.bic_gain:.0f} after the parameter penalty"
    if others := sentences.other_causes(finding)[:_ALTERNATIVES_SHOWN]:
        gains = [f"{estimate.axis.reword(other.effect.title)} {other.bic_gain:.0f}" for other in others]
        evidence += f"; by alternative causes: {', '.join(gains)}"
    print_text(console, f"  {evidence}", 2)
    decides = result.discriminating_experiment(finding)
    if decides is None:
        return
    verb = "decides" if "commands" in decides else "may decide"
    print_text(console, f"  these data do not distinguish the causes; this run {verb}: {decides['run']}", 2)
    if "commands" in decides:
        command = labelled_text(sentences.between_command(decides), "writes it")
        console.print(f"  in {decides['minutes']:.1f} min;", command, highlight=False)


def _show_improvement(
    console: Console, diagnosis: result.Diagnosis, base: result.ModelAssessment, extended: result.ModelAssessment
) -> None:
    axis, one, other = base.estimate.axis, base.held_out, extended.held_out
    errors = {}
    # Of several horizons the longest remains.
    for horizon, before in one.position_errors.items():
        after = other.position_errors[horizon]
        if before is not None and after is not None:
            errors[f"{axis.position_words} error"] = (before, after)
    errors[f"{axis.rate_words} error"] = (one.rate_rmse, other.rate_rmse)
    console.print()
    if extended.model.effects:
        print_labelled(console, "Gain on trials that were not fitted:", sentences.improvement_words(errors))
    tables.held_out_table(diagnosis, base, extended).print(console, base.estimate.assumptions)
    if removed := sentences.removed_sentence(diagnosis):
        print_text(console, removed)
        console.print()


def show_comparison(
    console: Console, comparison: Comparison, guess: Assumptions, warnings: Sequence[str], page: Path | None = None
) -> None:
    """Print the result of a comparison, its tables, the causes of both campaigns, and the path of its page."""
    show_caution(console, guess)
    print_labelled(console, sentences.comparison_headline(comparison))
    for sentence in sentences.comparison_sentences(comparison):
        print_text(console, sentence)
    console.print()
    further = tables.ratios_table(comparison), tables.cross_prediction_table(comparison)
    for table in (tables.changes_table(comparison, guess), *further):
        if table is not None:
            table.print(console, guess)
    for side, campaign, causes in zip("AB", (comparison.a, comparison.b), comparison.causes, strict=True):
        titles = sentences.cause_titles(causes) or "none"
        print_text(console, f"{side} is {campaign.name}; causes: {titles}")
    show_warnings(console, [*comparison.warnings, *warnings])
    if page is not None:
        print_path(console, str(page))


def show_control(console: Console, design: ControllerDesign, guess: Assumptions, warnings: Sequence[str]) -> None:
    """Print gains, margins and closed-loop runs."""
    show_caution(console, guess)
    for text, kind in sentences.control_verdict(design):
        print_labelled(console, text, style=VERDICT_STYLES[kind])
    gains_table(design, guess).print(console, guess)
    if design.spread is not None:
        stable = f"{100.0 * design.spread.stable:.0f} %"
        print_text(console, f"{stable} of {design.spread.draws} loops drawn from the parameter uncertainty are stable")
    if not design.allocation.limited:
        print_text(console, "no thrusters are known: the torque itself is commanded, without limit")
    if design.runs:
        runs_table(design).print(console, guess)
    if design.model.effects:
        titles = [sentences.effect_title(effect, design.model.axis) for effect in design.model.effects]
        print_text(console, f"effects of the model: {join_words(titles)}")
    show_warnings(console, warnings)


# Effects of the catalogue that are listed.
_SHOWN = 5


def show_effect_trial(console: Console, found: EffectTrial, warnings: list[str]) -> None:
    """Print the gains of the tried effect next to each model, and the largest gains of the catalogue."""
    for one in found.tried:
        beside = sentences.cause_titles(one.beside) or "the plain model"
        print_labelled(console, one.effect.key, f"next to {beside}: {one.effect.equation}")
        values = []
        for parameter in one.effect.parameters:
            name = f"{one.effect.key}.{parameter.name}"
            size = plus_minus(one.estimate.value(name), one.estimate.standard_error(name))
            values.append(f"{parameter.name} {size} {parameter.unit}")
        print_text(console, f"  {', '.join(values)}", 2)
        gains = f"{one.gain:.0f} after the parameter penalty, {one.held_out_gain:.0f} on trials that were not fitted"
        print_text(console, f"  log-likelihood gain: {gains}", 2)
    best = [f"{sentences.cause_title(name)} {gain:.0f}" for name, gain in list(found.others.items())[:_SHOWN]]
    print_text(console, f"Gains of the catalogue next to the plain model: {', '.join(best) or 'none'}.")
    show_warnings(console, warnings)


def show_discovery(
    console: Console, found: Discovery, guess: Assumptions, warnings: Sequence[str], written: Iterable[str]
) -> None:
    """Print each formula with its parameters and its evidence, and the paths of the files that were ``written``."""
    show_caution(console, guess)
    _show_formulas(console, found)
    show_warnings(console, warnings)
    for path in written:
        print_path(console, f"written to {path}")


def _show_formulas(console: Console, found: Discovery) -> None:
    if found.missing:
        print_text(console, f"Too little data: {found.missing}")
        return
    causes = sentences.cause_titles(found.causes)
    print_text(console, f"Causes of the catalogue that the diagnosis selects: {causes or 'none'}.")
    if not found.formulas:
        print_text(console, "No formula of the logged and derived signals predicts the unexplained torque.")
        return
    print_text(console, "A formula does not prove a cause. Only a run that changes its signals alone can decide.")
    for formula in found.formulas:
        console.print()
        units, estimate = units_of(formula, found.grammar.units if found.grammar else {}), formula.estimate
        values = []
        for name in estimate.names:
            value = plus_minus(estimate.value(name), estimate.standard_error(name))
            values.append(f"{name} = {value} {units[name]}")
        print_labelled(console, "Torque in N m:", formula.text)
        print_text(console, f"  {', '.join(values)}", 2)
        beside = sentences.cause_titles(formula.beside)
        held_out = f"{formula.held_out_nats:.0f} on trials that were not fitted"
        gain = f"log-likelihood gain {formula.gain:.0f} next to {beside or 'the plain model'}, {held_out}"
        share = f"{100.0 * formula.held_out_gain:.0f} % of the free-running rate error (mean square)"
        use = f"removes {share} on trials that were not fitted"
        use += f"; selected in {100.0 * formula.inclusion:.0f} % of bootstrap draws"
        nearest = sentences.cause_title(formula.nearest) if formula.nearest else "no named effect"
        for text in (gain, use, f"similar to {nearest}"):
            print_text(console, f"  {text}", 2)


_SCALE = (
    "These data never show a common factor on all thrust. If all inertias and drags change by one factor, less thrust "
    "and a larger vehicle look the same."
)


def show_planar_diagnosis(console: Console, diagnosis: PlanarDiagnosis, study: PlanarStudy) -> None:
    """Print the verdict, the causes with their evidence, the improvement, and the next run."""
    guess = study.vehicle.assumptions
    show_caution(console, guess)
    show_other_faults(console, diagnosis, study.logs.faults)
    show_verdict(console, diagnosis, guess)
    if diagnosis.missing:
        print_text(console, diagnosis.missing)
    _show_causes(console, diagnosis)
    base, extended = diagnosis.base, diagnosis.extended
    if base is not None and extended is not None:
        console.print()
        if extended.fit.model.effects:
            print_labelled(console, "Gain on trials that were not fitted:", gain_words(base, extended))
        if table := planar_held_out_table(diagnosis):
            table.print(console, guess)
        show_planar_parameters(console, extended.fit)
    if diagnosis.unexplained_shares:
        shares = [f"{axis} {100.0 * share:.2g} %" for axis, share in diagnosis.unexplained_shares.items()]
        print_text(console, f"left unexplained, in percent of the variance of all forces: {', '.join(shares)}")
    if diagnosis.verdict != "bad_logs" and not study.vehicle.thrust_scale_error:
        print_text(console, f"cannot be found from these data: {result.UNIDENTIFIABLE['thrust_scale']}")
    plan = "rovid plan --axes planar"
    step = sentences.next_step(diagnosis, next_planar_experiment(diagnosis), study.vehicle, plan)
    print_labelled(console, "Next:", str(step))
    show_warnings(console, [*study.remarks(), *diagnosis.warnings])


def gain_words(base: PlanarAssessment, extended: PlanarAssessment) -> str:
    """By how much each error on held-out trials changes with the causes."""
    one, other = base.held_out, extended.held_out
    errors = {f"{sensor_words(name)} error": (size, other.rmse[name]) for name, size in one.rmse.items()}
    for horizon, size in one.heading_errors.items():
        if horizon in other.heading_errors:
            errors[f"heading error after {horizon:.0f} s"] = size, other.heading_errors[horizon]
    return sentences.improvement_words(errors)


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
    print_labelled(console, sentences.comparison_headline(comparison))
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
