"""A comparison of two campaigns, as JSON and as an account in words: one text for terminal and page."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

from rich.console import Console

from rovid.compare.comparison import Comparison, Prediction
from rovid.compare.difference_tests import DRAG, THRUST_SCALE, Candidate, Change, Changes
from rovid.core.console import led
from rovid.core.formatting import plus_minus, significant
from rovid.diagnose.posterior import ESTABLISHED
from rovid.diagnose.result import INVISIBLE, NEVER_SHOWN
from rovid.effects import CATALOGUE, effect_named
from rovid.model.parameter_names import without_form
from rovid.present.documents.fits import Document, axis_document, cautions, guess_document, position_errors
from rovid.present.terminal.result_tables import number, say, show_caution, show_warnings
from rovid.present.terminal.table import Columns, table
from rovid.present.verdict import listed, odds_of
from rovid.trial.assumptions import Guesswork
from rovid.trial.axis import Axis

_THRUST = "all thrust"
# Odds beyond that are no more than a word.
_SURELY_NOT = 0.01


def headline(comparison: Comparison) -> str:
    """The answer in one plain sentence."""
    a, b = comparison.a.name, comparison.b.name
    if comparison.verdict == "changed":
        changes = "; ".join(in_words(comparison, change) for change in comparison.changes.established)
        return f"From {a} to {b} changed: {changes}."
    if comparison.verdict == "same":
        return f"Nothing changed from {a} to {b} that these data show."
    return f"These data cannot tell whether the vehicle changed from {a} to {b}."


def reasons(comparison: Comparison) -> Iterator[str]:
    """Sentences on what leaves the question open, what is of a day alone, and what no yaw data show."""
    for clause in comparison.why:
        yield f"Open: {clause}."
    for change in comparison.changes.found:
        if not change.established:
            yield f"Perhaps, not established: {in_words(comparison, change)} ({odds_of(change.confidence)})."
    if comparison.verdict == "same":
        yield f"It would have been seen from: {_seen(comparison)}."
    if comparison.passing:
        names = listed([effect_named(name).title for name in comparison.passing])
        yield f"In one of the two alone, and of the day rather than of the vehicle: {names}."
    yield (
        f"Never visible in {comparison.a.axis.name} data: {INVISIBLE[THRUST_SCALE]}. Where inertia and drag change by "
        "one factor, less thrust and a larger vehicle are the same; their ratios do not hang on it."
    )


def _seen(comparison: Comparison) -> str:
    """The least change of each part of the vehicle that would have been established."""
    shares = comparison.changes.seen
    wanted = [name for name in ("inertia", DRAG, THRUST_SCALE) if math.isfinite(shares.get(name, math.inf))]
    return ", ".join(f"{_title(name)} {significant(100.0 * shares[name], 2)} %" for name in wanted)


def in_words(comparison: Comparison, change: Change) -> str:
    """One change with its size, and what it cannot be told from."""
    said = _sized(comparison, change)
    if change.undecided:
        others = listed([_what(other) for other in change.undecided], "or")
        said += f" (these data do not tell it from {others})"
    return said


def _sized(comparison: Comparison, change: Change) -> str:
    one = change.candidate
    if one.factor:
        size = f", {plus_minus(change.ratio, change.standard_error)} times" if math.isfinite(change.ratio) else ""
        return f"{_what(one)}{size}"
    there = [effect_named(one.name).id in causes for causes in comparison.causes]
    sizes = ["; ".join(_size(comparison, name, side) for name in one.changes) for side in (0, 1)]
    if there == [False, True]:
        return f"{_what(one)}, which came ({sizes[1]})"
    if there == [True, False]:
        return f"{_what(one)}, which went (it had {sizes[0]})"
    return f"{_what(one)} ({sizes[0]} before, {sizes[1]} after)"


def _size(comparison: Comparison, name: str, side: int) -> str:
    """A cause's parameter in A or in B."""
    value = plus_minus(*comparison.changes.together(name)[side])
    unit = comparison.changes.pair.units[comparison.changes.pair.names.index(name)]
    return f"{name.rpartition('.')[2].replace('_', ' ')} {value} {unit}".removesuffix(" 1")


def _what(candidate: Candidate) -> str:
    """What may have changed, in a word."""
    if candidate.name == THRUST_SCALE:
        return f"{_THRUST} (or inertia and drag together, the other way)"
    if candidate.factor and not candidate.inverse:
        return _title(candidate.name)
    effect = effect_named(candidate.name)
    return f"{effect.title} ({effect.form})" if effect.each_thruster else effect.title


def _title(name: str) -> str:
    return _THRUST if name == THRUST_SCALE else name.replace("_", " ")


def named(name: str) -> str:
    """A parameter's name for a program: forms go by their effect, but one thruster is not another."""
    key, dot, _ = name.rpartition(".")
    return name if dot and effect_named(key).each_thruster else without_form(name)


def show_comparison(console: Console, comparison: Comparison, guess: Guesswork, warnings: Sequence[str]) -> None:
    """Print the account."""
    show_caution(console, guess)
    say(console, led(headline(comparison)))
    for sentence in reasons(comparison):
        say(console, sentence)
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
        titles = listed([title_of_cause(name) for name in causes]) if causes else "none"
        say(console, f"{side} is {day.name}; causes: {titles}")
    show_warnings(console, [*comparison.warnings, *warnings])


def title_of_cause(name: str) -> str:
    """The title of the effect with this id."""
    return next((effect.title for effect in CATALOGUE if effect.id == name), name)


def parameter_rows(comparison: Comparison, guess: Guesswork) -> Columns:
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
            named(name),
            "–" if ratio is None else plus_minus(*ratio),
            sure_in_words(changes, name),
            guess.marked(plus_minus(float(pair.a[at]), math.sqrt(pair.covariance_a[at, at])), unit),
            guess.marked(plus_minus(float(pair.b[at]), math.sqrt(pair.covariance_b[at, at])), unit),
            unit,
            guess.marked(shared_in_words(changes, name), unit),
            style="bold" if changes.sure[name] >= ESTABLISHED else "",
        )
    return rows


def shared_in_words(changes: Changes, name: str) -> str:
    """What both say of a parameter where they share it."""
    in_a, in_b = changes.together(name)
    return plus_minus(*in_a) if math.isclose(in_a[0], in_b[0], rel_tol=1e-9, abs_tol=1e-6 * in_a[1]) else "apart"


def sure_in_words(changes: Changes, name: str) -> str:
    """How sure it is that a parameter changed; what only looks so beside less thrust did not."""
    if any(change.candidate.inverse and name in change.candidate.changes for change in changes.established):
        return "as thrust did"
    sure = changes.sure[name]
    return "no" if sure < _SURELY_NOT else f"{100.0 * sure:.0f} %"


def prediction_rows(comparison: Comparison) -> Columns:
    """How well each model foretells each campaign's runs."""
    axis = comparison.a.axis
    rows = table(
        "Runs simulated freely, by the model of the other campaign and by their own",
        "runs of",
        "model of",
        f"{axis.rate_words} R²",
        *(f"{axis.position_words} after {horizon:.0f} s, {axis.shown[0]}" for horizon in (10.0, 60.0)),
        left=2,
    )
    for runs in ("a", "b"):
        for model in ("a", "b"):
            made = comparison.predictions.get((model, runs))
            if made is not None:
                errors = [number(axis.in_shown(made.position_errors[horizon])) for horizon in (10.0, 60.0)]
                rows.add_row(runs.upper(), model.upper(), number(made.rate_r2, ".4f"), *errors)
    return rows


Sides = tuple[tuple[float, float], tuple[float, float]]


def _quotients(comparison: Comparison) -> Iterator[tuple[str, Sides, tuple[float, float], str]]:
    """Inertia over each drag, where both sides know it from zero."""
    changes, axis = comparison.changes, comparison.a.axis
    for drag, symbols, unit in (("quadratic_drag", "I/DQ", "rad"), ("linear_drag", "I/DL", "s")):
        found = changes.quotient("inertia", drag)
        if found is not None:
            sides, over = found
            yield symbols, sides, over, axis.unit(unit)


def comparison_document(comparison: Comparison, guess: Guesswork, warnings: Sequence[str]) -> Document:
    """What `rovid compare --json` prints."""
    axis = comparison.a.axis
    return {
        "schema": "rovid-comparison/1",
        **axis_document(axis),
        "verdict": comparison.verdict,
        "campaigns": {"a": comparison.a.name, "b": comparison.b.name},
        "parameters": _parameters(comparison, guess),
        "changed": [named(name) for name in comparison.changed],
        "changes": [_change(comparison, change) for change in comparison.changes.found],
        "causes": {"a": list(comparison.causes[0]), "b": list(comparison.causes[1])},
        "of_the_day": list(comparison.passing),
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
        "smallest_seen": dict(comparison.changes.seen),
        "matters": comparison.matters,
        "open": list(comparison.why),
        "not_identifiable": list(NEVER_SHOWN),
        **guess_document(guess),
        "warnings": cautions(guess, [*comparison.warnings, *warnings]),
    }


def _parameters(comparison: Comparison, guess: Guesswork) -> Document:
    changes, pair = comparison.changes, comparison.changes.pair
    document: Document = {}
    for at, name in enumerate(pair.names):
        unit, ratio, (gap, gap_error) = pair.units[at], changes.ratio(name), changes.gap(name)
        of_a, of_b = changes.together(name)
        document[named(name)] = {
            "a": _value(float(pair.a[at]), math.sqrt(pair.covariance_a[at, at]), unit),
            "b": _value(float(pair.b[at]), math.sqrt(pair.covariance_b[at, at]), unit),
            "ratio": None if ratio is None else ratio[0],
            "standard_error": None if ratio is None else ratio[1],
            "difference": _value(gap, gap_error, unit),
            "confidence": changes.sure[name],
            "together": {"a": _value(*of_a, unit), "b": _value(*of_b, unit)},
            **({"placeholder": True} if guess.marks(unit) else {}),
        }
    for change in changes.found:
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


def _change(comparison: Comparison, change: Change) -> Document:
    return {
        "what": change.candidate.name,
        "parameters": [named(name) for name in change.candidate.changes],
        "ratio": change.ratio,
        "standard_error": change.standard_error,
        "log_likelihood_gain": change.worth,
        "confidence": change.confidence,
        "established": change.established,
        "cannot_be_told_from": [other.name for other in change.undecided],
        "words": in_words(comparison, change),
    }


def _prediction(made: Prediction | None, axis: Axis) -> Document:
    """Nothing is known of a parameter file's runs."""
    if made is None:
        return {f"{axis.rate}_r2": None, f"{axis.rate}_rmse": None}
    return {
        f"{axis.rate}_r2": made.rate_r2,
        f"{axis.rate}_rmse": made.rate_rmse,
        **position_errors(made.position_errors, axis),
    }
