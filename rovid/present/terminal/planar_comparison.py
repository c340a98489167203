"""Comparison of two campaigns by the coupled model: sentences, table, and JSON."""

import math
from collections.abc import Sequence

from rich.console import Console

from rovid.compare.planar import PlanarChange, PlanarComparison
from rovid.core.formatting import plus_minus, significant
from rovid.present.console import print_labelled, print_text, show_caution, show_warnings
from rovid.present.documents.fits import Document, all_warnings, guess_document, value_document
from rovid.present.documents.planar import AXES_DOCUMENT, derivative_name
from rovid.present.number_format import DASH, format_number, unit_symbol
from rovid.present.sentences import join_words
from rovid.present.tables.planar import sensor_words
from rovid.present.tables.table import ResultTable, mixed_number_column, text_column

_SCALE = (
    "These data never show a common factor on all thrust. If all inertias and drags change by one factor, less thrust "
    "and a larger vehicle look the same."
)


def planar_comparison_document(comparison: PlanarComparison, warnings: Sequence[str]) -> Document:
    """The document of `rovid compare --axes planar --json`."""
    guess = comparison.assumptions
    return {
        "schema": "rovid-comparison/1",
        **AXES_DOCUMENT,
        "verdict": comparison.verdict,
        "campaigns": {"a": comparison.a.name, "b": comparison.b.name},
        "parameters": {change.name: _change_document(change) for change in comparison.changes},
        "changed": comparison.changed,
        "causes": {"a": comparison.a.parameters.effects, "b": comparison.b.parameters.effects},
        "prediction": {
            f"{model}_on_{runs}": {
                f"{speed}_{measure}": getattr(fit, measure) for speed, fit in fits.items() for measure in ("r2", "rmse")
            }
            for (model, runs), fits in comparison.predictions.items()
        },
        "smallest_seen": dict(comparison.detectable),
        "not_identifiable": ["thrust_scale"],
        **guess_document(guess),
        "warnings": all_warnings(guess, warnings),
    }


def _change_document(change: PlanarChange) -> Document:
    entries = {"a": change.a, "b": change.b}
    sides = {side: value_document(one.value, one.unit, one.standard_error) for side, one in entries.items()}
    document = {**sides, "ratio": change.ratio, "standard_error": change.standard_error}
    derivative = derivative_name(change.name)
    return document | {"confidence": change.confidence} | ({"sname": derivative} if derivative else {})


def show_planar_comparison(console: Console, comparison: PlanarComparison, warnings: Sequence[str]) -> None:
    """Print the result of a comparison, the parameters of both campaigns, and the predictions."""
    guess = comparison.assumptions
    show_caution(console, guess)
    print_labelled(console, planar_comparison_sentence(comparison))
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
        table.add_row(change.name, a, b, unit_symbol(change.a.unit), ratio, format_number(change.confidence, ".3f"))
    changes_table = table
    changes_table.print(console, guess)
    if comparison.predictions:
        _predictions_table(comparison).print(console, guess)
    show_warnings(console, warnings)


def planar_comparison_sentence(comparison: PlanarComparison) -> str:
    """The result of a comparison in one sentence."""
    a, b = comparison.a.name, comparison.b.name
    if comparison.verdict == "changed":
        found = [change for change in comparison.changes if change.changed]
        words = [f"{one.name}, {plus_minus(one.ratio, one.standard_error)} times" for one in found]
        return f"From {a} to {b} changed: {join_words(words)}."
    if comparison.verdict == "same":
        return f"Nothing changed from {a} to {b} that these data show."
    return f"These data cannot tell whether the vehicle changed from {a} to {b}."


def _predictions_table(comparison: PlanarComparison) -> ResultTable:
    speeds = list(dict.fromkeys(speed for fits in comparison.predictions.values() for speed in fits))
    columns = [mixed_number_column(f"R² {sensor_words(speed)}") for speed in speeds]
    table = ResultTable("Free-running simulation of each campaign's runs", text_column("model"), *columns)
    for (model, runs), fits in comparison.predictions.items():
        cells = [format_number(fits[speed].r2, ".4f") if speed in fits else DASH for speed in speeds]
        table.add_row(f"{model.upper()} on the runs of {runs.upper()}", *cells)
    return table
