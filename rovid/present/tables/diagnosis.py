"""The diagnosis as the page words it, and its tables."""

from __future__ import annotations

import math
from collections.abc import Iterator

from rovid.core.formatting import plus_minus, significant
from rovid.diagnose.bic import Rival
from rovid.diagnose.result import INVISIBLE, NEVER_SHOWN, Diagnosis, Finding, Side, not_identifiable
from rovid.diagnose.signal_regressors import is_signal
from rovid.diagnose.tables import Amplitudes, Explanation
from rovid.effects import Effect
from rovid.estimate.estimate import Estimate, Ratio
from rovid.estimate.inertia import METHODS
from rovid.model.parameter_names import unit_of
from rovid.present.number_text import NOTHING, column, number, title, unit, with_unit
from rovid.present.tables.table import Column, Grid, Table, of_numbers, of_text, of_unlike, words
from rovid.present.verdict import listed
from rovid.trial.axis import YAW, Axis
from rovid.trial.vehicle import Vehicle

RIVALS = 8  # that are shown


def invisible(vehicle: Vehicle) -> list[str]:
    """What data of the vehicle's axis cannot show, beside a scale of all thrust and one of the rate."""
    return [INVISIBLE[name] for name in not_identifiable(vehicle) if name not in NEVER_SHOWN]


def others(finding: Finding) -> str:
    """What ``finding`` cannot be told from; empty where it is decided."""
    axis = finding.estimate.axis
    return listed([axis.words(effect.title) for effect in finding.undecided], "or")


def title_of(effect: Effect, axis: Axis = YAW) -> str:
    """An effect's name along ``axis``."""
    return axis.words(effect.title)


def name_of(effect: Effect, axis: Axis = YAW) -> str:
    """An effect's title, with its form where it has one."""
    name = title_of(effect, axis)
    return f"{name} ({spaced(effect.form)})" if effect.form else name


def spaced(name: str) -> str:
    """A form's name in words; a thruster's stays as it is."""
    return name.replace("_", " ")


def standing(finding: Finding, rival: Rival) -> str:
    """What the data say of a rival."""
    if is_signal(rival.effect):
        return "depends on a signal"
    if any(rival.effect.id == effect.id for effect in finding.undecided):
        return "not ruled out"
    return "ruled out"


def sides_grid(base: Estimate, extended: Estimate, findings: tuple[Finding, ...]) -> Grid:
    """Parameters without and with what was found."""
    table = Table(
        "Parameters ± standard error, without and with what was found",
        of_text("parameter"),
        of_unlike("without"),
        of_unlike("with what was found"),
        of_numbers("change", "%"),
    )
    without, with_it = ({ratio.name: ratio for ratio in ratios_of(side)} for side in (base, extended))
    for name in dict.fromkeys((*without, *with_it)):
        sides = [side.get(name) for side in (without, with_it)]
        values = [plus_minus(ratio.value, ratio.standard_error) if ratio else NOTHING for ratio in sides]
        its_unit = next(ratio.unit for ratio in sides if ratio)
        table.add(f"{title(name)}, {its_unit}", *values, NOTHING)
    titles = _titles(findings, base.axis)
    # A dict for a set that keeps the order.
    for name in dict.fromkeys((*base.names, *extended.names)):
        shown = titles.get(name, title(name))
        change = _change(base, extended, name)
        # The first column stays in sight on a narrow page.
        its_unit = unit((base if name in base.names else extended).unit(name)).replace(" ", "\u00a0")
        table.add(f"{shown}, {its_unit}" if its_unit else shown, _value(base, name), _value(extended, name), change)
    return table.grid()


def ratios_of(estimate: Estimate) -> tuple[Ratio, ...]:
    """What stands in the place of placeholders, as it does not hang on what is guessed; none where nothing is."""
    return estimate.ratios if estimate.guess and estimate.guess.ratios_hold else ()


def _titles(findings: tuple[Finding, ...], axis: Axis) -> dict[str, str]:
    """Name of each parameter of what was found -> the effect and the parameter in words."""
    titles: dict[str, str] = {}
    for finding in findings:
        titles |= _titles_of(finding.effect, axis)
    return titles


def _titles_of(effect: Effect, axis: Axis) -> dict[str, str]:
    titles = {}
    for parameter in effect.parameters:
        in_words = axis.words(f"{effect.title}: {spaced(parameter.name)}")
        titles[f"{effect.key}.{parameter.name}"] = in_words
    return titles


def gain_grid(base: Side, extended: Side, floor: float) -> Grid:
    """How well trials that were not fitted are simulated; one column where the two sides are the same."""
    quantities, without, with_it, least = zip(*_gains(base, extended, floor), strict=True)
    columns = [words("quantity", quantities)]
    if extended.model.effects:
        columns.append(Column(title="without", cells=without))
        columns.append(Column(title="with what was found", cells=with_it))
    else:
        columns.append(Column(title="the model", cells=without))
    columns.append(Column(title="noise floor", cells=least))
    return Grid(caption="Trials that were not fitted, simulated freely", columns=tuple(columns))


def _gains(base: Side, extended: Side, floor: float) -> Iterator[tuple[str, ...]]:
    """Quantity, its value without and with what was found, and the noise floor."""
    one, other, axis = base.held_out, extended.held_out, base.estimate.axis
    yield f"{axis.rate_words} R²", number(one.rate_r2, ".4f"), number(other.rate_r2, ".4f"), NOTHING
    yield f"{axis.rate_words} RMSE, {axis.rate_unit}", *column([one.rate_rmse, other.rate_rmse, floor], 3)
    for horizon, error in one.position_errors.items():
        before, after = axis.in_shown(error), axis.in_shown(other.position_errors.get(horizon))
        yield f"{axis.position_words} after {horizon:.0f} s, {axis.shown[0]}", *column([before, after], 3), NOTHING
    yield "log-likelihood", number(one.log_likelihood, ".0f"), number(other.log_likelihood, ".0f"), NOTHING


def signals_grid(diagnosis: Diagnosis, axis: Axis) -> Grid:
    """Logged signals that drive what no effect explains."""
    headings = of_text("dependence"), of_numbers("log-likelihood gain")
    table = Table("Signals that what is left depends on", *headings)
    for signal, gain in diagnosis.signals:
        table.add(axis.words(signal.title), number(gain, ".0f"))
    return table.grid()


def detectable_grid(diagnosis: Diagnosis, vehicle: Vehicle) -> Grid:
    """The size of each effect that these data would have shown, in the catalogue's order."""
    # Sizes of different units share no decimal point.
    axis, headings = vehicle.axis, (of_text("cause"), of_text("parameter"), of_unlike("departure from none"))
    table = Table("The smallest that would have been seen", *headings)
    for effect, size in diagnosis.detectable:
        name = effect.parameters[0].name
        its_unit = unit_of(f"{effect.key}.{name}", axis)
        seen = with_unit(_seen(size), its_unit)
        if math.isfinite(size):
            seen = vehicle.guess.marked(seen, its_unit)
        table.add(axis.words(effect.title), axis.words(spaced(name)), seen)
    return table.grid()


def predictions_grid(amplitudes: Amplitudes) -> Grid:
    """The sine trials of a table as measured, and as simulated with the inertia of each method."""
    table = Table(
        "Peak yaw rate of the sine trials",
        of_text("trial"),
        of_text("inertia by"),
        of_numbers("inertia", unit("kg m^2")),
        of_numbers("measured", "rad/s"),
        of_numbers("simulated", "rad/s"),
        of_numbers("too high by", "%"),
    )
    for row in amplitudes.predictions:
        inertia = number(row.inertia, ".0f")
        measured = number(row.measured, ".3g")
        simulated = number(row.predicted, ".3f")
        too_high = f"{100.0 * (row.predicted / row.measured - 1.0):+.0f}"
        table.add(row.trial, METHODS[row.method], inertia, measured, simulated, too_high)
    return table.grid()


def causes_grid(amplitudes: Amplitudes) -> Grid:
    """What would make one model agree with the tables, and the run that would tell."""
    table = Table(
        "Each of these, alone, would explain the tables",
        of_text("effect"),
        of_text("with"),
        of_numbers("inertia then", unit("kg m^2")),
        of_text("run that would tell"),
    )
    for cause in amplitudes.causes:
        effect = cause.model.effects[0]
        sizes = ", ".join(_sizes(cause))
        table.add(name_of(effect), sizes, number(cause.model.inertia, ".0f"), effect.experiment)
    return table.grid()


def ruled_out(amplitudes: Amplitudes) -> str:
    """What would not."""
    return listed([effect.title for effect in amplitudes.ruled_out], "or")


def _sizes(cause: Explanation) -> Iterator[str]:
    for name, (value, its_unit) in cause.sizes.items():
        yield f"{spaced(name)} {significant(value, 3)} {unit(its_unit)}".strip()


def _seen(size: float) -> str:
    if not math.isfinite(size):
        return "not visible"
    (text,) = column([size], 2)
    return text


def _value(estimate: Estimate, name: str) -> str:
    if name not in estimate.names:
        return NOTHING
    value = plus_minus(estimate.value(name), estimate.standard_error(name))
    return estimate.guess.marked(value, estimate.unit(name))


def _change(base: Estimate, extended: Estimate, name: str) -> str:
    """In percent; nothing of what the base model lacks or cannot tell from zero."""
    if name not in base.names or name not in extended.names:
        return NOTHING
    before, after = base.value(name), extended.value(name)
    if abs(before) <= base.standard_error(name):
        return NOTHING
    return f"{100.0 * (after / before - 1.0):+.1f}"
