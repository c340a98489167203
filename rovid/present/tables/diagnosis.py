"""The diagnosis as the page words it, and its tables."""

from __future__ import annotations

import math
from collections.abc import Iterator

from rovid.core.formatting import plus_minus, significant
from rovid.diagnose.candidate_fits import Alternative
from rovid.diagnose.result import (
    NEVER_IDENTIFIABLE,
    UNIDENTIFIABLE,
    Diagnosis,
    Finding,
    ModelAssessment,
    unidentifiable_parameters,
)
from rovid.diagnose.signal_regressors import is_signal
from rovid.diagnose.tables import Explanation, TableDiagnosis
from rovid.effects import Effect
from rovid.estimate.estimate import Estimate, Ratio
from rovid.estimate.inertia import METHODS
from rovid.model.parameter_names import unit_of
from rovid.present.number_text import (
    NOTHING,
    equal_decimals,
    format_number,
    number_with_unit,
    parameter_title,
    unit_symbol,
)
from rovid.present.tables.table import (
    Column,
    ResultTable,
    TableBuilder,
    mixed_number_column,
    number_column,
    text_column,
    words,
)
from rovid.present.verdict import join_words
from rovid.trial.axis import YAW, Axis
from rovid.trial.vehicle import Vehicle

RIVALS = 8  # that are shown


def invisible_words(vehicle: Vehicle) -> list[str]:
    """What data of the vehicle's axis cannot show, beside a scale of all thrust and one of the rate."""
    return [UNIDENTIFIABLE[name] for name in unidentifiable_parameters(vehicle) if name not in NEVER_IDENTIFIABLE]


def undecided_names(finding: Finding) -> str:
    """What ``finding`` cannot be told from; empty where it is decided."""
    axis = finding.estimate.axis
    return join_words([axis.reword(effect.title) for effect in finding.indistinguishable], "or")


def effect_title(effect: Effect, axis: Axis = YAW) -> str:
    """An effect's name along ``axis``."""
    return axis.reword(effect.title)


def effect_name(effect: Effect, axis: Axis = YAW) -> str:
    """An effect's title, with its form where it has one."""
    name = effect_title(effect, axis)
    return f"{name} ({with_spaces(effect.form)})" if effect.form else name


def with_spaces(name: str) -> str:
    """A form's name in words; a thruster's stays as it is."""
    return name.replace("_", " ")


def rival_status(finding: Finding, rival: Alternative) -> str:
    """What the data say of a rival."""
    if is_signal(rival.effect):
        return "depends on a signal"
    if any(rival.effect.id == effect.id for effect in finding.indistinguishable):
        return "not ruled out"
    return "ruled out"


def models_table(base: Estimate, extended: Estimate, findings: tuple[Finding, ...]) -> ResultTable:
    """Parameters without and with what was found."""
    table = TableBuilder(
        "Parameters ± standard error, without and with what was found",
        text_column("parameter"),
        mixed_number_column("without"),
        mixed_number_column("with what was found"),
        number_column("change", "%"),
    )
    without, with_it = ({ratio.name: ratio for ratio in valid_ratios(side)} for side in (base, extended))
    for name in dict.fromkeys((*without, *with_it)):
        sides = [side.get(name) for side in (without, with_it)]
        values = [plus_minus(ratio.value, ratio.standard_error) if ratio else NOTHING for ratio in sides]
        its_unit = next(ratio.unit for ratio in sides if ratio)
        table.add(f"{parameter_title(name)}, {its_unit}", *values, NOTHING)
    titles = _titles(findings, base.axis)
    # A dict for a set that keeps the order.
    for name in dict.fromkeys((*base.names, *extended.names)):
        shown = titles.get(name, parameter_title(name))
        change = _change(base, extended, name)
        # The first column stays in sight on a narrow page.
        its_unit = unit_symbol((base if name in base.names else extended).unit(name)).replace(" ", "\u00a0")
        table.add(f"{shown}, {its_unit}" if its_unit else shown, _value(base, name), _value(extended, name), change)
    return table.grid()


def valid_ratios(estimate: Estimate) -> tuple[Ratio, ...]:
    """What stands in the place of placeholders, as it does not hang on what is guessed; none where nothing is."""
    return estimate.ratios if estimate.assumptions and estimate.assumptions.ratios_hold else ()


def _titles(findings: tuple[Finding, ...], axis: Axis) -> dict[str, str]:
    """Name of each parameter of what was found -> the effect and the parameter in words."""
    titles: dict[str, str] = {}
    for finding in findings:
        titles |= _titles_of(finding.effect, axis)
    return titles


def _titles_of(effect: Effect, axis: Axis) -> dict[str, str]:
    titles = {}
    for parameter in effect.parameters:
        in_words = axis.reword(f"{effect.title}: {with_spaces(parameter.name)}")
        titles[f"{effect.key}.{parameter.name}"] = in_words
    return titles


def held_out_table(base: ModelAssessment, extended: ModelAssessment, floor: float) -> ResultTable:
    """How well trials that were not fitted are simulated; one column where the two sides are the same."""
    quantities, without, with_it, least = zip(*_gains(base, extended, floor), strict=True)
    columns = [words("quantity", quantities)]
    if extended.model.effects:
        columns.append(Column(title="without", cells=without))
        columns.append(Column(title="with what was found", cells=with_it))
    else:
        columns.append(Column(title="the model", cells=without))
    columns.append(Column(title="noise floor", cells=least))
    return ResultTable(caption="Trials that were not fitted, simulated freely", columns=tuple(columns))


def _gains(base: ModelAssessment, extended: ModelAssessment, floor: float) -> Iterator[tuple[str, ...]]:
    """Quantity, its value without and with what was found, and the noise floor."""
    one, other, axis = base.held_out, extended.held_out, base.estimate.axis
    yield f"{axis.rate_words} R²", format_number(one.rate_r2, ".4f"), format_number(other.rate_r2, ".4f"), NOTHING
    yield f"{axis.rate_words} RMSE, {axis.rate_unit}", *equal_decimals([one.rate_rmse, other.rate_rmse, floor], 3)
    for horizon, error in one.position_errors.items():
        before, after = axis.to_display(error), axis.to_display(other.position_errors.get(horizon))
        yield (
            f"{axis.position_words} after {horizon:.0f} s, {axis.display_unit[0]}",
            *equal_decimals([before, after], 3),
            NOTHING,
        )
    yield (
        "log-likelihood",
        format_number(one.log_likelihood, ".0f"),
        format_number(other.log_likelihood, ".0f"),
        NOTHING,
    )


def signals_table(diagnosis: Diagnosis, axis: Axis) -> ResultTable:
    """Logged signals that drive what no effect explains."""
    headings = text_column("dependence"), number_column("log-likelihood gain")
    table = TableBuilder("Signals that what is left depends on", *headings)
    for signal, gain in diagnosis.signals:
        table.add(axis.reword(signal.title), format_number(gain, ".0f"))
    return table.grid()


def detectable_table(diagnosis: Diagnosis, vehicle: Vehicle) -> ResultTable:
    """The size of each effect that these data would have shown, in the catalogue's order."""
    # Sizes of different units share no decimal point.
    axis, headings = (
        vehicle.axis,
        (text_column("cause"), text_column("parameter"), mixed_number_column("departure from none")),
    )
    table = TableBuilder("The smallest that would have been seen", *headings)
    for effect, size in diagnosis.detectable:
        name = effect.parameters[0].name
        its_unit = unit_of(f"{effect.key}.{name}", axis)
        seen = number_with_unit(_seen(size), its_unit)
        if math.isfinite(size):
            seen = vehicle.assumptions.mark_number(seen, its_unit)
        table.add(axis.reword(effect.title), axis.reword(with_spaces(name)), seen)
    return table.grid()


def predictions_table(amplitudes: TableDiagnosis) -> ResultTable:
    """The sine trials of a table as measured, and as simulated with the inertia of each method."""
    table = TableBuilder(
        "Peak yaw rate of the sine trials",
        text_column("trial"),
        text_column("inertia by"),
        number_column("inertia", unit_symbol("kg m^2")),
        number_column("measured", "rad/s"),
        number_column("simulated", "rad/s"),
        number_column("too high by", "%"),
    )
    for row in amplitudes.predictions:
        inertia = format_number(row.inertia, ".0f")
        measured = format_number(row.measured, ".3g")
        simulated = format_number(row.predicted, ".3f")
        too_high = f"{100.0 * (row.predicted / row.measured - 1.0):+.0f}"
        table.add(row.trial, METHODS[row.method], inertia, measured, simulated, too_high)
    return table.grid()


def explanations_table(amplitudes: TableDiagnosis) -> ResultTable:
    """What would make one model agree with the tables, and the run that would tell."""
    table = TableBuilder(
        "Each of these, alone, would explain the tables",
        text_column("effect"),
        text_column("with"),
        number_column("inertia then", unit_symbol("kg m^2")),
        text_column("run that would tell"),
    )
    for cause in amplitudes.causes:
        effect = cause.model.effects[0]
        sizes = ", ".join(_sizes(cause))
        table.add(effect_name(effect), sizes, format_number(cause.model.inertia, ".0f"), effect.experiment)
    return table.grid()


def ruled_out_names(amplitudes: TableDiagnosis) -> str:
    """What would not."""
    return join_words([effect.title for effect in amplitudes.ruled_out], "or")


def _sizes(cause: Explanation) -> Iterator[str]:
    for name, (value, its_unit) in cause.sizes.items():
        yield f"{with_spaces(name)} {significant(value, 3)} {unit_symbol(its_unit)}".strip()


def _seen(size: float) -> str:
    if not math.isfinite(size):
        return "not visible"
    (text,) = equal_decimals([size], 2)
    return text


def _value(estimate: Estimate, name: str) -> str:
    if name not in estimate.names:
        return NOTHING
    value = plus_minus(estimate.value(name), estimate.standard_error(name))
    return estimate.assumptions.mark_number(value, estimate.unit(name))


def _change(base: Estimate, extended: Estimate, name: str) -> str:
    """In percent; nothing of what the base model lacks or cannot tell from zero."""
    if name not in base.names or name not in extended.names:
        return NOTHING
    before, after = base.value(name), extended.value(name)
    if abs(before) <= base.standard_error(name):
        return NOTHING
    return f"{100.0 * (after / before - 1.0):+.1f}"
