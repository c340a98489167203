"""Diagnosis of the coupled model on a terminal."""

from __future__ import annotations

import math

from rich.console import Console

from rovid.planar.diagnosis import PlanarAssessment, PlanarDiagnosis
from rovid.planar.trial_simulation import SENSOR_UNITS
from rovid.present.console import print_labelled, print_text
from rovid.present.documents.planar_diagnosis import next_planar_experiment
from rovid.present.number_format import format_number, unit_symbol
from rovid.present.sentences import evidence_definitions, improvement_words, verdict_sentence
from rovid.present.tables.planar import planar_estimate_table, sensor_words
from rovid.present.tables.table import ResultTable, mixed_number_column, text_column
from rovid.present.terminal.diagnosis import show_finding
from rovid.present.terminal.planar import undetermined_sentences
from rovid.trial.assumptions import Assumptions


def show_planar_diagnosis(console: Console, diagnosis: PlanarDiagnosis, guess: Assumptions) -> None:
    """Print the verdict, the causes with their evidence, the improvement, and the next run."""
    print_labelled(console, verdict_sentence(diagnosis, guess))
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
        planar_held_out_table(diagnosis, base, extended).print(console, guess)
        console.print(planar_estimate_table(extended.fit.estimate))
        for text in undetermined_sentences(extended.fit):
            print_labelled(console, "Not determined:", text, "bold yellow")
    if diagnosis.unexplained_shares:
        shares = [f"{axis} {100.0 * share:.2g} %" for axis, share in diagnosis.unexplained_shares.items()]
        print_text(console, f"left unexplained, in percent of the variance of all forces: {', '.join(shares)}")
    print_text(console, "cannot be found from these data: a common factor on all thrust")
    run = next_planar_experiment(diagnosis)
    print_labelled(console, "Next:", f"{run['run']} ({run['reason']})")


def gain_words(base: PlanarAssessment, extended: PlanarAssessment) -> str:
    """By how much each error on held-out trials changes with the causes."""
    one, other = base.held_out, extended.held_out
    errors = {f"{sensor_words(name)} error": (size, other.rmse[name]) for name, size in one.rmse.items()}
    for horizon, size in one.heading_errors.items():
        if horizon in other.heading_errors:
            errors[f"heading error after {horizon:.0f} s"] = size, other.heading_errors[horizon]
    return improvement_words(errors)


def planar_held_out_table(
    diagnosis: PlanarDiagnosis, base: PlanarAssessment, extended: PlanarAssessment
) -> ResultTable:
    """Errors of free-running simulations of held-out trials; one column where both models are the same."""
    models = ("plain model", "extended model")[: 1 + bool(extended.fit.model.effects)]
    columns = map(mixed_number_column, (*models, "noise floor"))
    table = ResultTable("Error on trials that were not fitted", text_column("quantity"), *columns)
    sides = (base.held_out, extended.held_out)[: len(models)]
    for name in base.held_out.rmse:
        cells = [format_number(side.rmse.get(name)) for side in sides]
        floor = format_number(diagnosis.noise_floors.get(name), 2)
        table.add_row(f"{sensor_words(name)} RMSE, {unit_symbol(SENSOR_UNITS[name])}", *cells, floor)
    for horizon in base.held_out.heading_errors:
        cells = [format_number(_degrees(side.heading_errors.get(horizon))) for side in sides]
        floor = format_number(_degrees(diagnosis.heading_floors.get(horizon)), 2)
        table.add_row(f"heading after {horizon:.0f} s, deg", *cells, floor)
    table.add_row("log-likelihood", *(format_number(side.log_likelihood, ".0f") for side in sides), "")
    return table


def _degrees(angle: float | None) -> float | None:
    return None if angle is None else math.degrees(angle)
