"""A comparison of two campaigns, as JSON and as an account in words: one text for terminal and page."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

from rich.console import Console

from rovid.compare.comparison import Comparison, CrossPrediction
from rovid.compare.difference_tests import DRAG, THRUST_SCALE, ChangeCandidate, DifferenceTest, ParameterChange
from rovid.core.console import labelled_text
from rovid.core.formatting import plus_minus, significant
from rovid.diagnose.thresholds import ESTABLISHED
from rovid.diagnose.result import NEVER_IDENTIFIABLE, UNIDENTIFIABLE
from rovid.effects import CATALOGUE, effect_named
from rovid.model.parameter_names import without_form
from rovid.present.documents.fits import Document, all_warnings, axis_document, guess_document, position_errors
from rovid.present.terminal.result_tables import print_text, show_caution, show_warnings, table_number
from rovid.present.terminal.table import Columns, table
from rovid.present.verdict import join_words, odds_words
from rovid.trial.assumptions import Assumptions
from rovid.trial.axis import Axis

_THRUST = "all thrust"
# Odds beyond that are no more than a word.
_SURELY_NOT = 0.01


def comparison_headline(comparison: Comparison) -> str:
    """The answer in one plain sentence."""
    a, b = comparison.a.name, comparison.b.name
    if comparison.verdict == "changed":
        changes = "; ".join(change_sentence(comparison, change) for change in comparison.changes.established)
        return f"From {a} to {b} changed: {changes}."
    if comparison.verdict == "same":
        return f"Nothing changed from {a} to {b} that these data show."
    return f"These data cannot tell whether the vehicle changed from {a} to {b}."


def comparison_sentences(comparison: Comparison) -> Iterator[str]:
    """Sentences on what leaves the question open, what is of a day alone, and what no yaw data show."""
    for clause in comparison.open_questions:
        yield f"Open: {clause}."
    for change in comparison.changes.changes:
        if not change.established:
            yield f"Perhaps, not established: {change_sentence(comparison, change)} ({odds_words(change.confidence)})."
    if comparison.verdict == "same":
        yield f"It would have been seen from: {_seen(comparison)}."
    if comparison.transient_causes:
        names = join_words([effect_named(name).title for name in comparison.transient_causes])
        yield f"In one of the two alone, and of the day rather than of the vehicle: {names}."
    yield (
        f"Never visible in {comparison.a.axis.name} data: {UNIDENTIFIABLE[THRUST_SCALE]}. Where inertia and drag change by "
        "one factor, less thrust and a larger vehicle are the same; their ratios do not hang on it."
    )


def _seen(comparison: Comparison) -> str:
    """The least change of each part of the vehicle that would have been established."""
    shares = comparison.changes.detectable_changes
    wanted = [name for name in ("inertia", DRAG, THRUST_SCALE) if math.isfinite(shares.get(name, math.inf))]
    return ", ".join(f"{_title(name)} {significant(100.0 * shares[name], 2)} %" for name in wanted)


def change_sentence(comparison: Comparison, change: ParameterChange) -> str:
    """One change with its size, and what it cannot be told from."""
    said = _sized(comparison, change)
    if change.indistinguishable:
        others = join_words([_what(other) for other in change.indistinguishable], "or")
        said += f" (these data do not tell it from {others})"
    return said


def _sized(comparison: Comparison, change: ParameterChange) -> str:
    one = change.candidate
    if one.is_factor:
        size = f", {plus_minus(change.ratio, change.standard_error)} times" if math.isfinite(change.ratio) else ""
        return f"{_what(one)}{size}"
    there = [effect_named(one.name).id in causes for causes in comparison.causes]
    sizes = ["; ".join(_size(comparison, name, side) for name in one.parameters) for side in (0, 1)]
    if there == [False, True]:
        return f"{_what(one)}, which came ({sizes[1]})"
    if there == [True, False]:
        return f"{_what(one)}, which went (it had {sizes[0]})"
    return f"{_what(one)} ({sizes[0]} before, {sizes[1]} after)"


def _size(comparison: Comparison, name: str, side: int) -> str:
    """A cause's parameter in A or in B."""
    value = plus_minus(*comparison.changes.joint_values(name)[side])
    unit = comparison.changes.pair.units[comparison.changes.pair.names.index(name)]
    return f"{name.rpartition('.')[2].replace('_', ' ')} {value} {unit}".removesuffix(" 1")


def _what(candidate: ChangeCandidate) -> str:
    """What may have changed, in a word."""
    if candidate.name == THRUST_SCALE:
        return f"{_THRUST} (or inertia and drag together, the other way)"
    if candidate.is_factor and not candidate.inverse:
        return _title(candidate.name)
    effect = effect_named(candidate.name)
    return f"{effect.title} ({effect.form})" if effect.per_thruster else effect.title


def _title(name: str) -> str:
    return _THRUST if name == THRUST_SCALE else name.replace("_", " ")


def document_key(name: str) -> str:
    """A parameter's name for a program: forms go by their effect, but one thruster is not another."""
    key, dot, _ = name.rpartition(".")
    return name if dot and effect_named(key).per_thruster else without_form(name)


def show_comparison(console: Console, comparison: Comparison, guess: Assumptions, warnings: Sequence[str]) -> None:
    """Print the account."""
    show_caution(console, guess)
    print_text(console, labelled_text(comparison_headline(comparison)))
    for sentence in comparison_sentences(comparison):
        print_text(console, sentence)
    console.print()
    console.print(parameter_rows(comparison, guess))
    if quotients := list(_quotients(comparison)):
        rows = table("Ratios, whatever the size of thrust", "ratio", "B over A", "A", "B", "unit")
        for name, sides, over, unit in quotients:
            rows.add_row(name, plus_minus(*over), plus_minus(*sides[0]), plus_minus(*sides[1]), unit)
        console.print(rows)
    if comparison.predictions:
        console.print(prediction_rows(comparison))
    for side, day, causes in zip("AB", (comparison.a, comparison.b), comparison.causes, strict=True):
        titles = join_words([effect_title(name) for name in causes]) if causes else "none"
        print_text(console, f"{side} is {day.name}; causes: {titles}")
    show_warnings(console, [*comparison.warnings, *warnings])


def effect_title(name: str) -> str:
    """The title of the effect with this id."""
    return next((effect.title for effect in CATALOGUE if effect.id == name), name)


def parameter_rows(comparison: Comparison, guess: Assumptions) -> Columns:
    """Each parameter in both, their ratio, and how sure it is that it changed."""
    changes, pair = comparison.changes, comparison.changes.pair
    rows = table(
        "Each by itself; together: both share what did not change",
        "parameter",
        "B over A",
        "changed",
        "A",
        "B",
        "unit",
        "together",
    )
    for at, name in enumerate(pair.names):
        ratio = changes.ratio(name)
        unit = pair.units[at]
        rows.add_row(
            document_key(name),
            "–" if ratio is None else plus_minus(*ratio),
            confidence_cell(changes, name),
            guess.mark_number(plus_minus(float(pair.a[at]), math.sqrt(pair.covariance_a[at, at])), unit),
            guess.mark_number(plus_minus(float(pair.b[at]), math.sqrt(pair.covariance_b[at, at])), unit),
            unit,
            guess.mark_number(joint_value(changes, name), unit),
            style="bold" if changes.probabilities[name] >= ESTABLISHED else "",
        )
    return rows


def joint_value(changes: DifferenceTest, name: str) -> str:
    """What both say of a parameter where they share it."""
    in_a, in_b = changes.joint_values(name)
    return plus_minus(*in_a) if math.isclose(in_a[0], in_b[0], rel_tol=1e-9, abs_tol=1e-6 * in_a[1]) else "apart"


def confidence_cell(changes: DifferenceTest, name: str) -> str:
    """How sure it is that a parameter changed; what only looks so beside less thrust did not."""
    if any(change.candidate.inverse and name in change.candidate.parameters for change in changes.established):
        return "as thrust did"
    sure = changes.probabilities[name]
    return "no" if sure < _SURELY_NOT else f"{100.0 * sure:.0f} %"


def prediction_rows(comparison: Comparison) -> Columns:
    """How well each model foretells each campaign's runs."""
    axis = comparison.a.axis
    rows = table(
        "Runs simulated freely, by the model of the other campaign and by their own",
        "runs of",
        "model of",
        f"{axis.rate_words} R²",
        *(f"{axis.position_words} after {horizon:.0f} s, {axis.display_unit[0]}" for horizon in (10.0, 60.0)),
        left=2,
    )
    for runs in ("a", "b"):
        for model in ("a", "b"):
            made = comparison.predictions.get((model, runs))
            if made is not None:
                errors = [table_number(axis.to_display(made.position_errors[horizon])) for horizon in (10.0, 60.0)]
                rows.add_row(runs.upper(), model.upper(), table_number(made.rate_r2, ".4f"), *errors)
    return rows


Sides = tuple[tuple[float, float], tuple[float, float]]


def _quotients(comparison: Comparison) -> Iterator[tuple[str, Sides, tuple[float, float], str]]:
    """Inertia over each drag, where both sides know it from zero."""
    changes, axis = comparison.changes, comparison.a.axis
    for drag, symbols, unit in (("quadratic_drag", "I/DQ", "rad"), ("linear_drag", "I/DL", "s")):
        found = changes.parameter_ratio("inertia", drag)
        if found is not None:
            sides, over = found
            yield symbols, sides, over, axis.unit(unit)


def comparison_document(comparison: Comparison, guess: Assumptions, warnings: Sequence[str]) -> Document:
    """What `rovid compare --json` prints."""
    axis = comparison.a.axis
    return {
        "schema": "rovid-comparison/1",
        **axis_document(axis),
        "verdict": comparison.verdict,
        "campaigns": {"a": comparison.a.name, "b": comparison.b.name},
        "parameters": _parameters(comparison, guess),
        "changed": [document_key(name) for name in comparison.changed],
        "changes": [_change(comparison, change) for change in comparison.changes.changes],
        "causes": {"a": list(comparison.causes[0]), "b": list(comparison.causes[1])},
        "of_the_day": list(comparison.transient_causes),
        "ratios": {
            symbols: {
                "a": _value(*sides[0], unit),
                "b": _value(*sides[1], unit),
                "ratio": over[0],
                "standard_error": over[1],
            }
            for symbols, sides, over, unit in _quotients(comparison)
        },
        "prediction": {
            f"{model}_on_{runs}": _prediction(comparison.predictions.get((model, runs)), axis)
            for model in ("a", "b")
            for runs in ("b", "a")
        },
        "smallest_seen": dict(comparison.changes.detectable_changes),
        "matters": comparison.relevant_change,
        "open": list(comparison.open_questions),
        "not_identifiable": list(NEVER_IDENTIFIABLE),
        **guess_document(guess),
        "warnings": all_warnings(guess, [*comparison.warnings, *warnings]),
    }


def _parameters(comparison: Comparison, guess: Assumptions) -> Document:
    changes, pair = comparison.changes, comparison.changes.pair
    document: Document = {}
    for at, name in enumerate(pair.names):
        unit, ratio, (gap, gap_error) = pair.units[at], changes.ratio(name), changes.difference(name)
        of_a, of_b = changes.joint_values(name)
        document[document_key(name)] = {
            "a": _value(float(pair.a[at]), math.sqrt(pair.covariance_a[at, at]), unit),
            "b": _value(float(pair.b[at]), math.sqrt(pair.covariance_b[at, at]), unit),
            "ratio": None if ratio is None else ratio[0],
            "standard_error": None if ratio is None else ratio[1],
            "difference": _value(gap, gap_error, unit),
            "confidence": changes.probabilities[name],
            "together": {"a": _value(*of_a, unit), "b": _value(*of_b, unit)},
            **({"placeholder": True} if guess.is_placeholder(unit) else {}),
        }
    for change in changes.changes:
        one = change.candidate
        if one.inverse:
            document[one.name] = {
                "a": _value(1.0, 0.0, "1"),
                "b": _value(change.ratio, change.standard_error, "1"),
                "ratio": change.ratio,
                "standard_error": change.standard_error,
                "confidence": change.confidence,
            }
    return document


def _value(value: float, error: float, unit: str) -> Document:
    return {"value": value, "standard_error": error, "unit": unit}


def _change(comparison: Comparison, change: ParameterChange) -> Document:
    return {
        "what": change.candidate.name,
        "parameters": [document_key(name) for name in change.candidate.parameters],
        "ratio": change.ratio,
        "standard_error": change.standard_error,
        "log_likelihood_gain": change.bic_score,
        "confidence": change.confidence,
        "established": change.established,
        "cannot_be_told_from": [other.name for other in change.indistinguishable],
        "words": change_sentence(comparison, change),
    }


def _prediction(made: CrossPrediction | None, axis: Axis) -> Document:
    """Nothing is known of a parameter file's runs."""
    if made is None:
        return {f"{axis.rate_signal}_r2": None, f"{axis.rate_signal}_rmse": None}
    return {
        f"{axis.rate_signal}_r2": made.rate_r2,
        f"{axis.rate_signal}_rmse": made.rate_rmse,
        **position_errors(made.position_errors, axis),
    }
