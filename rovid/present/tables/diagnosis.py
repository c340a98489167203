"""Tables of a diagnosis and of a comparison of two campaigns."""

import math
from collections.abc import Iterator, Sequence

from rovid.compare.comparison import Comparison
from rovid.compare.difference_tests import DifferenceTest
from rovid.core.errors import join_words
from rovid.core.formatting import plus_minus, significant
from rovid.diagnose.candidate_fits import Alternative
from rovid.diagnose.result import Diagnosis, Finding, ModelAssessment, OtherCause
from rovid.diagnose.signal_regressors import is_signal
from rovid.diagnose.tables import TableDiagnosis
from rovid.diagnose.thresholds import ESTABLISHED
from rovid.effects import effect_named
from rovid.estimate.estimate import Estimate, Ratio
from rovid.estimate.experiment_design import DECISIVE_LLR
from rovid.estimate.inertia import METHODS
from rovid.estimate.isolability import PairSeparation
from rovid.model.parameter_names import unit_of
from rovid.model.simulation import HORIZONS
from rovid.present.console import ResultTable, mixed_number_column, number_column, text_column
from rovid.present.number_format import DASH, format_number, parameter_title, rounded_errors, unit_symbol
from rovid.present.sentences import document_key, effect_title
from rovid.trial.assumptions import Assumptions
from rovid.trial.axis import Axis
from rovid.trial.vehicle import Vehicle

# Number of alternative causes that tables and plots show.
ALTERNATIVES_SHOWN = 8


def indistinguishable_names(finding: Finding) -> str:
    """Causes that the data do not distinguish from ``finding``; empty where there are none."""
    axis = finding.estimate.axis
    return join_words([axis.reword(effect.title) for effect in finding.indistinguishable], "or")


def alternative_status(finding: Finding, alternative: Alternative | OtherCause) -> str:
    """Whether the data rule out an alternative cause."""
    if is_signal(alternative.effect):
        return "depends on a signal"
    if any(alternative.effect.id == effect.id for effect in finding.indistinguishable):
        return "not ruled out"
    return "ruled out"


def models_table(base: Estimate, extended: Estimate) -> ResultTable:
    """Parameters without and with the causes."""
    columns = *map(mixed_number_column, ("plain model", "extended model")), number_column("change", "%")
    title = "Parameters ± standard error of the plain and of the extended model"
    table = ResultTable(title, text_column("parameter"), *columns)
    ratios: dict[str, list[str]] = {}
    for place, side in enumerate((base, extended)):
        for ratio in valid_ratios(side):
            cells = ratios.setdefault(f"{parameter_title(ratio.name)}, {ratio.unit}", [DASH] * 3)
            cells[place] = plus_minus(ratio.value, ratio.standard_error)
    for title, cells in ratios.items():
        table.add_row(title, *cells)
    for name in dict.fromkeys((*base.names, *extended.names)):
        title = base.axis.reword(parameter_title(name))
        if unit := unit_symbol((base if name in base.names else extended).unit(name)):
            # The first column stays visible on a narrow page: its unit is not broken.
            title += ", " + unit.replace(" ", "\u00a0")
        values = _estimate_cell(base, name), _estimate_cell(extended, name)
        table.add_row(title, *values, _relative_change(base, extended, name))
    return table


def valid_ratios(estimate: Estimate) -> tuple[Ratio, ...]:
    """Ratios of parameters that do not depend on the assumptions; none where nothing is assumed."""
    return estimate.ratios if estimate.assumptions and estimate.assumptions.ratios_hold else ()


def _estimate_cell(estimate: Estimate, name: str) -> str:
    if name not in estimate.names:
        return DASH
    value = plus_minus(estimate.value(name), estimate.standard_error(name))
    return estimate.assumptions.mark_number(value, estimate.unit(name))


def _relative_change(base: Estimate, extended: Estimate, name: str) -> str:
    """Change in percent; a dash where the base model lacks the parameter or does not tell it from zero."""
    if name not in base.names or name not in extended.names:
        return DASH
    before, after = base.value(name), extended.value(name)
    if abs(before) <= base.standard_error(name):
        return DASH
    return f"{100.0 * (after / before - 1.0):+.1f}"


def held_out_table(diagnosis: Diagnosis, base: ModelAssessment, extended: ModelAssessment) -> ResultTable:
    """Errors of free-running simulations of held-out trials; one column where both models are the same."""
    models = ("plain model", "extended model")[: 1 + bool(extended.model.effects)]
    columns = map(mixed_number_column, (*models, "noise floor"))
    table = ResultTable("Error on trials that were not fitted", text_column("quantity"), *columns)
    one, other, axis = base.held_out, extended.held_out, base.estimate.axis
    *rates, floor = rounded_errors((one.rate_rmse, other.rate_rmse, diagnosis.noise_floor))
    rows = [(f"{axis.rate_words} RMSE, {axis.rate_unit}", rates, floor)]
    for horizon, error in one.position_errors.items():
        if error is None:
            continue  # no trial is as long
        known = (error, other.position_errors.get(horizon), diagnosis.position_floors.get(horizon))
        *errors, floor = rounded_errors(list(map(axis.to_display, known)))
        rows.append((f"{axis.position_words} after {horizon:.0f} s, {axis.display_unit[0]}", errors, floor))
    rows.append((f"{axis.rate_words} R²", [format_number(side.rate_r2, ".4f") for side in (one, other)], ""))
    rows.append(("log-likelihood", [format_number(side.log_likelihood, ".0f") for side in (one, other)], ""))
    for quantity, values, floor in rows:
        table.add_row(quantity, *values[: len(models)], floor)
    return table


def challengers_table(diagnosis: Diagnosis, axis: Axis) -> ResultTable:
    """Other sets of causes, and by how much the log-likelihood of each is lower at the same price of a parameter."""
    columns = text_column("explanation"), number_column("worse by"), number_column("part of it for parameters")
    table = ResultTable("Simpler or other explanations that were tried", *columns)
    for one in diagnosis.challengers:
        titles = join_words([axis.reword(effect.title) for effect in one.effects]) or "no cause"
        table.add_row(titles, format_number(-one.score_difference, ".0f"), format_number(one.price_difference, ".0f"))
    return table


def separations_table(pairs: Sequence[PairSeparation], axis: Axis) -> ResultTable:
    """Expected log-likelihood ratio of each cause to its rivals, and minutes of the logs until it decides."""
    columns = map(mixed_number_column, ("log-likelihood", "minutes until it decides"))
    caption = f"Each cause as the true one, its rival fitted in its place; {DECISIVE_LLR:.0f} decides"
    table = ResultTable(caption, text_column("cause"), text_column("rival"), *columns)
    for pair in pairs:
        minutes = format_number(pair.seconds / 60.0, ".1f", "never")
        names = (effect_title(effect_named(name), axis) for name in (pair.first, pair.second))
        table.add_row(*names, format_number(pair.gain), minutes)
    return table


def signals_table(diagnosis: Diagnosis, axis: Axis) -> ResultTable:
    """Logged signals that the remaining error depends on."""
    columns = text_column("dependence"), number_column("log-likelihood gain")
    table = ResultTable("Signals that the remaining error depends on", *columns)
    for signal, gain in diagnosis.signals:
        table.add_row(axis.reword(signal.title), format_number(gain, ".0f"))
    return table


def detectable_table(diagnosis: Diagnosis, vehicle: Vehicle) -> ResultTable:
    """Detection limit of each effect, in the order of the catalogue."""
    axis = vehicle.axis
    columns = text_column("effect"), text_column("parameter"), mixed_number_column("size"), text_column("unit")
    table = ResultTable("The smallest that would have been seen", *columns)
    for effect, size in diagnosis.detectable:
        name = effect.parameters[0].name
        unit = unit_of(f"{effect.key}.{name}", axis)
        seen = "not visible"
        if math.isfinite(size):
            seen = vehicle.assumptions.mark_number(format_number(size, 2), unit)
        table.add_row(axis.reword(effect.title), axis.reword(name.replace("_", " ")), seen, unit_symbol(unit))
    return table


def predictions_table(diagnosis: TableDiagnosis) -> ResultTable:
    """Peak yaw rates of tabulated sine trials, measured and simulated with the inertia of each method."""
    columns = map(number_column, ("measured", "simulated", "too high by"), ("rad/s", "rad/s", "%"))
    table = ResultTable("Peak yaw rate of the sine trials", *map(text_column, ("trial", "inertia by")), *columns)
    for row in diagnosis.predictions:
        excess = 100.0 * (row.predicted / row.measured - 1.0)
        rates = format_number(row.measured, ".3g"), format_number(row.predicted, ".3f")
        table.add_row(row.trial, METHODS[row.method], *rates, f"{excess:+.0f}")
    return table


def explanations_table(diagnosis: TableDiagnosis) -> ResultTable:
    """Single effects with which one model agrees with the tables, and the run that decides between them."""
    columns = *map(text_column, ("effect", "with")), number_column("inertia then", "kg m²")
    table = ResultTable("Each of these, alone, would explain the tables", *columns, text_column("run that decides"))
    for cause in diagnosis.causes:
        sizes = []
        for name, (value, unit) in cause.sizes.items():
            sizes.append(f"{name.replace('_', ' ')} {significant(value, 3)} {unit_symbol(unit)}".strip())
        effect, inertia = cause.model.effects[0], format_number(cause.model.inertia)
        table.add_row(effect_title(effect), ", ".join(sizes), inertia, effect.experiment)
    return table


def changes_table(comparison: Comparison, guess: Assumptions) -> ResultTable:
    """Parameters of both campaigns, their ratios, and the probabilities of a change."""
    changes, pair = comparison.changes, comparison.changes.pair
    title = "Each campaign by itself ± standard error; together, and changed ratios: by both, sharing "
    title += "what did not change"
    columns = *map(mixed_number_column, ("B over A", "changed", "A", "B")), text_column("unit")
    table = ResultTable(title, text_column("parameter"), *columns, mixed_number_column("together"))
    for place, name in enumerate(pair.names):
        ratio, unit = changes.ratio(name), pair.units[place]
        joint_a, joint_b = changes.joint_values(name)
        shared = math.isclose(joint_a[0], joint_b[0], rel_tol=1e-9, abs_tol=1e-6 * joint_a[1])
        values = [*(plus_minus(*side) for side in changes.separate_values(name))]
        values.append(plus_minus(*joint_a) if shared else "apart")
        in_a, in_b, together = (guess.mark_number(value, unit) for value in values)
        cells = parameter_title(document_key(name)), DASH if ratio is None else plus_minus(*ratio)
        style = "bold" * (changes.probabilities[name] >= ESTABLISHED)
        table.add_row(*cells, _change_cell(changes, name), in_a, in_b, unit_symbol(unit), together, style=style)
    return table


def _change_cell(changes: DifferenceTest, name: str) -> str:
    """The evidence for a change; a change of all thrust is not one of each parameter."""
    if any(change.candidate.inverse and name in change.candidate.parameters for change in changes.established):
        return "as thrust did"
    own = [change.evidence.value for change in changes.changes if name in change.candidate.parameters]
    return own[0] if own else "not seen"


Sides = tuple[tuple[float, float], tuple[float, float]]


def inertia_ratios(comparison: Comparison) -> Iterator[tuple[str, Sides, tuple[float, float], str]]:
    """Symbols, values of both campaigns, their quotient, and unit of inertia over each drag that is known."""
    changes, axis = comparison.changes, comparison.a.axis
    for drag, symbols, unit in (("quadratic_drag", "I/DQ", "rad"), ("linear_drag", "I/DL", "s")):
        found = changes.inertia_over(drag)
        if found is not None:
            sides, over = found
            yield symbols, sides, over, axis.unit(unit)


def ratios_table(comparison: Comparison) -> ResultTable | None:
    """Ratios of inertia and drag, which do not depend on the size of thrust; None where none is known."""
    columns = map(mixed_number_column, ("B over A", "A", "B"))
    table = ResultTable("Ratios, whatever the size of thrust", text_column("ratio"), *columns, text_column("unit"))
    for symbols, sides, over, unit in inertia_ratios(comparison):
        table.add_row(symbols, plus_minus(*over), plus_minus(*sides[0]), plus_minus(*sides[1]), unit)
    return table if table.rows else None


def cross_prediction_table(comparison: Comparison) -> ResultTable | None:
    """How well each model predicts the runs of each campaign; None where no run was simulated."""
    if not comparison.predictions:
        return None
    axis = comparison.a.axis
    errors = [f"{axis.position_words} after {horizon:.0f} s" for horizon in HORIZONS]
    columns = number_column(f"{axis.rate_words} R²"), *(number_column(error, axis.display_unit[0]) for error in errors)
    title = "Runs simulated freely, by the model of the other campaign and by their own"
    table = ResultTable(title, *map(text_column, ("runs of", "model of")), *columns)
    for runs, model in (("a", "a"), ("a", "b"), ("b", "a"), ("b", "b")):
        prediction = comparison.predictions.get((model, runs))
        if prediction is not None:
            errors = [format_number(axis.to_display(prediction.position_errors[horizon])) for horizon in HORIZONS]
            table.add_row(runs.upper(), model.upper(), format_number(prediction.rate_r2, ".4f"), *errors)
    return table
