"""Tables of parameters, of drag from steady states, and of inertia by every method."""

import math
from collections import Counter
from dataclasses import dataclass
from itertools import chain, combinations, starmap

import numpy as np

from rovid.core.formatting import plus_minus, round_to_error
from rovid.core.stats import NORMAL_95, t_quantile
from rovid.estimate.estimate import Estimate
from rovid.estimate.inertia import METHODS, InertiaFit
from rovid.estimate.steady_drag import DragFit
from rovid.model.parameter_names import base_names, unit_of
from rovid.present.console import Column, ResultTable, mixed_number_column, number_column, text_column
from rovid.present.documents.fits import SNAMES
from rovid.present.number_format import (
    DASH,
    equal_decimals,
    format_number,
    number_with_unit,
    parameter_title,
    same_decimals,
    steady_state_words,
    unit_symbol,
)
from rovid.present.report_data import ReportData
from rovid.present.tables.diagnosis import valid_ratios
from rovid.store.checks import effect_titles, relative_deviation
from rovid.store.parameter_file import Parameters
from rovid.trial.assumptions import Assumptions

# In place of the interval of a parameter that the logs do not decide.
FROM_PRIOR = "from the prior"
_METHOD_TITLES = {"peak": "peak method", "orbit_integral": "orbit integral", "harmonic_balance": "harmonic balance"}
_DIRECTIONS = {"up": "growing", "down": "falling"}
_TIMES = "from–to, s"
# Absolute correlations from which a cell is shaded, one shade darker at each.
_SHADES = (0.5, 0.8, 0.95)


def estimate_table(estimate: Estimate, *, coupled: bool = False) -> ResultTable:
    """Parameters by the names that options and files use, with 95 % intervals; SNAME symbols in the coupled model."""
    table = _stored_table("", coupled=coupled)
    for name in estimate.names:
        unit, symbol = estimate.unit(name), list[str]()
        if coupled:
            unit, symbol = unit_symbol(unit), [SNAMES.get(name, DASH)]
        if name in estimate.refused:
            table.add_row(name, "not determined", unit, DASH, *symbol)
            continue
        value, error = estimate.value(name), estimate.standard_error(name)
        if estimate.is_placeholder(name):
            table.add_row(name, plus_minus(value, error), unit, "guessed", *symbol, style="red")
            continue
        interval = _rounded_interval(estimate.interval(name), error)
        interval = FROM_PRIOR if name in estimate.from_prior else interval
        table.add_row(name, plus_minus(value, error), unit, interval, *symbol)
    for ratio in valid_ratios(estimate):
        table.add_row(ratio.symbols, plus_minus(ratio.value, ratio.standard_error), ratio.unit)
    return table


def _stored_table(caption: str, *, coupled: bool) -> ResultTable:
    values = number_column("value ± standard error") if coupled else mixed_number_column("value ± standard error")
    columns = [text_column("parameter"), values, *map(mixed_number_column, ("unit", "95 % interval"))]
    if coupled:
        columns.append(mixed_number_column("SNAME"))
    return ResultTable(caption, *columns)


def _rounded_interval(interval: tuple[float, float], error: float) -> str:
    """An interval with the decimals of its standard error; a dash where that is not known."""
    return " … ".join(round_to_error(end, error) for end in interval) if math.isfinite(error) else DASH


def planar_parameters_table(stored: Parameters, guess: Assumptions) -> ResultTable:
    """Parameters of a file of the coupled model, and those that its logs do not determine."""
    table = _stored_table("Parameters", coupled=True)
    for name, entry in stored.entries.items():
        value, error, symbol = entry.value, entry.standard_error, SNAMES.get(name, DASH)
        interval = FROM_PRIOR if entry.from_prior else _rounded_interval(_normal_interval(value, error), error)
        interval = "guessed" if guess.is_placeholder(entry.unit) else interval
        table.add_row(parameter_title(name), plus_minus(value, error), unit_symbol(entry.unit), interval, symbol)
    for name in stored.assumed:
        table.add_row(parameter_title(name), "not determined", "", DASH, SNAMES.get(name, DASH))
    return table


def parameters_table(report: ReportData) -> ResultTable:
    """Every parameter of the file, and those that it lacks."""
    axis, entries, guess = report.axis, report.parameters.entries, report.vehicle.assumptions
    columns = map(mixed_number_column, ("value ± standard error", "95 % interval"))
    table = ResultTable("Parameters", text_column("parameter"), *columns, text_column("found by"))
    for ratio in valid_ratios(report.parameters.base_estimate()):
        value = plus_minus(ratio.value, ratio.standard_error)
        interval = _interval_text(value, _normal_interval(ratio.value, ratio.standard_error))
        table.add_row(parameter_title(ratio.name), number_with_unit(value, ratio.unit), interval)
    for name in dict.fromkeys((*base_names(axis), *entries)):
        title = axis.reword(parameter_title(name))
        entry = entries.get(name)
        if entry is None:
            table.add_row(title, "not determined", DASH, DASH)
            continue
        value = plus_minus(entry.value, entry.standard_error)
        shown = guess.mark_number(number_with_unit(value, entry.unit), entry.unit)
        interval = DASH if guess.is_placeholder(entry.unit) else _entry_interval(report, name, value)
        method = f"{entry.method} ({entry.options})" if entry.options else entry.method
        table.add_row(title, shown, interval, method)
    return table


def _entry_interval(report: ReportData, name: str, text: str) -> str:
    """95 % interval of a stored parameter, by the estimate that it comes from where that is known."""
    entry = report.parameters.entries[name]
    if not math.isfinite(entry.standard_error):
        return DASH
    estimate, interval = source_estimate(report, name), _normal_interval(entry.value, entry.standard_error)
    return _interval_text(text, interval if estimate is None else estimate.interval(name))


def _normal_interval(value: float, error: float) -> tuple[float, float]:
    return value - NORMAL_95 * error, value + NORMAL_95 * error


def _interval_text(text: str, interval: tuple[float, float] | None) -> str:
    """An interval with the decimals of ``text``; a dash for None."""
    return " … ".join(same_decimals(text, end) for end in interval) if interval else DASH


def source_estimate(report: ReportData, name: str) -> Estimate | None:
    """The estimate of this report that the stored parameter ``name`` comes from; None where it comes from elsewhere."""
    value = report.parameters.entries[name].value
    for fit in (report.drag, report.inertia):
        if fit is not None and name in fit.estimate.names and math.isclose(fit.estimate.value(name), value):
            return fit.estimate
    return None


def is_source_of_model(report: ReportData, estimate: Estimate) -> bool:
    """Whether any parameter of the model comes from ``estimate``."""
    return any(source_estimate(report, name) is estimate for name in report.parameters.entries)


def differences_from_model(report: ReportData, estimate: Estimate) -> list[str]:
    """Paragraphs on how an estimate by another method differs from the model's parameters, and its warnings."""
    axis, entries = report.axis, report.parameters.entries
    known = [name for name in estimate.names if name in entries and name not in estimate.refused]
    others = [_difference(report, estimate, name) for name in known if source_estimate(report, name) is None]
    paragraphs = []
    if others:
        paragraphs.append(f"By {estimate.method}: {', '.join(others)}.")
        if causes := axis.reword(effect_titles(entries)):
            paragraphs[0] += f" This method does not model {causes}."
    if not is_source_of_model(report, estimate):
        paragraphs += estimate.warnings
    return paragraphs


def _difference(report: ReportData, estimate: Estimate, name: str) -> str:
    """A parameter by another method, and how far it is from the model's."""
    entry, guess = report.parameters.entries[name], report.vehicle.assumptions
    value, error = estimate.value(name), estimate.standard_error(name)
    size = guess.mark_number(number_with_unit(plus_minus(value, error), entry.unit), entry.unit)
    shown = f"{report.axis.reword(parameter_title(name))} {size}"
    if abs(value - entry.value) <= NORMAL_95 * math.hypot(error, entry.standard_error) or entry.value == 0.0:
        return f"{shown} (as the model, within their errors)"
    return f"{shown} ({relative_deviation(value, entry.value)})"


def steady_table(fit: DragFit) -> ResultTable:
    """Steady states with residuals, and the drag that the fit gives without each of them."""
    axis = fit.estimate.axis
    measured = (axis.force_name, axis.force_unit), (axis.rate_words, axis.rate_unit), ("residual", axis.force_unit)
    units = [unit_symbol(unit_of(name, axis)) for name in ("quadratic_drag", "linear_drag")]
    table = ResultTable(
        f"{steady_state_words(axis).capitalize()}s that were fitted",
        text_column("source"),
        *starmap(number_column, measured),
        *map(text_column, (_TIMES, "command")),
        *map(number_column, ("DQ without it", "DL without it"), units),
    )
    rows = zip(fit.points, fit.residuals, fit.torque_error, fit.left_out.tolist(), strict=True)
    for point, residual, error, (quadratic, linear, *_) in rows:
        rate, difference = f"{point.rate:.4g}", format_number(residual, ".2f")
        if math.isfinite(point.rate_error):
            rate = plus_minus(point.rate, point.rate_error)
        if fit.torque_error_known:
            difference = plus_minus(residual, error)
        measured_cells = point.source, format_number(point.torque, ".2f"), rate, difference
        span, command = f"{point.start:.0f}–{point.stop:.0f}", " ".join(map("{:.4g}".format, point.command))
        table.add_row(*measured_cells, span, command, format_number(quadratic, 5), format_number(linear, 3))
    if any(math.isfinite(point.start) for point in fit.points):
        return table
    return table.without(_TIMES)


def directions_table(fit: DragFit) -> ResultTable:
    """Drag from both directions together, and from each alone."""
    axis = fit.estimate.axis
    units = ["", *(unit_symbol(unit_of(name, axis)) for name in ("quadratic_drag", "linear_drag"))]
    columns = map(number_column, (f"{steady_state_words(axis)}s", "DQ", "DL"), units)
    direction = text_column("turns" if axis.angular else "direction")
    table = ResultTable("Drag from each direction alone", direction, *columns)
    rows = {"both": fit.estimate}
    for name, estimate in fit.directions.items():
        rows[f"{axis.position_words} {_DIRECTIONS.get(name, name)}"] = estimate
    for title, estimate in rows.items():
        drags = _drag_cell(estimate, "quadratic_drag"), _drag_cell(estimate, "linear_drag")
        table.add_row(title, str(estimate.samples), *drags)
    return table


def _drag_cell(estimate: Estimate, name: str) -> str:
    if name in estimate.refused:
        return DASH
    return plus_minus(estimate.value(name), estimate.standard_error(name))


def method_title(name: str) -> str:
    """Short title of an inertia method."""
    return _METHOD_TITLES.get(name, name)


def method_interval(fit: InertiaFit, name: str) -> tuple[float, float] | None:
    """95 % interval of the inertia by a method's own error; None where that is not known, or the method is biased."""
    reading = fit.methods[name]
    if name == "peak" or not math.isfinite(reading.standard_error):
        return None
    if name == "regression" and fit.regression is not None:
        return fit.regression.estimate.interval("inertia")
    degrees_of_freedom = fit.estimate.degrees_of_freedom
    if name != fit.chosen:
        degrees_of_freedom = sum(trial.cycles for trial in fit.trials) - 1.0 or math.inf
    reach = t_quantile(0.975, degrees_of_freedom) * reading.standard_error
    return reading.value - reach, reading.value + reach


def methods_table(fit: InertiaFit, rigid_body: float | None, *, used: bool = True) -> ResultTable:
    """Inertia by every method."""
    unit = unit_symbol(fit.estimate.unit("inertia"))
    columns = [text_column("method"), number_column("inertia", unit), text_column("note")]
    columns.append(mixed_number_column("95 % interval", unit))
    if rigid_body is not None:
        columns.append(number_column("over rigid body"))
    table = ResultTable("Inertia by each method", *columns)
    for name in filter(fit.methods.__contains__, METHODS):
        reading = fit.methods[name]
        value = plus_minus(reading.value, reading.standard_error)
        cells = [METHODS[name], value, _method_note(fit, name, used=used)]
        cells.append(_interval_text(value, method_interval(fit, name)))
        if rigid_body is not None:
            cells.append(f"{reading.value / rigid_body:.3f}")
        table.add_row(*cells)
    return table


def _method_note(fit: InertiaFit, name: str, *, used: bool) -> str:
    if name == fit.chosen:
        return "used" if used else "the best of these"
    if name != "peak":
        return "for comparison"
    if fit.peak_bias is None:
        return "biased"
    return f"biased: {100.0 * fit.peak_bias:.0f} % of the true inertia on the model's own motion"


def sine_table(fit: InertiaFit) -> ResultTable:
    """Each sine run, and the inertia that each method reads from it."""
    unit, axis = unit_symbol(fit.estimate.unit("inertia")), fit.estimate.axis
    # Method -> log and number of the sine run in that log -> inertia.
    readings: dict[str, dict[tuple[str, int], str]] = {}
    for name in filter(fit.methods.__contains__, METHODS):
        count: Counter[str] = Counter()
        for source, value, error in fit.methods[name].runs:
            readings.setdefault(name, {})[source, count[source]] = plus_minus(value, error)
            count[source] += 1
    keys = list(dict.fromkeys(chain(*readings.values())))
    columns: list[Column] = [text_column("sine run", [source for source, _ in keys])]
    if len(fit.trials) == len(keys):
        torques, rates = [], []
        for wave in (trial.motion for trial in fit.trials):
            torques.append(float(np.max(np.abs(wave.over_one_period(wave.torque)))))
            rates.append(float(np.max(np.abs(wave.over_one_period(wave.rate)))))
        columns += [
            number_column("period", "s", [f"{trial.period:.4g}" for trial in fit.trials]),
            number_column("periods used", "", [str(trial.cycles) for trial in fit.trials]),
            number_column(f"peak {axis.force_name}", axis.force_unit, equal_decimals(torques, 4)),
            number_column("peak rate", axis.rate_unit, equal_decimals(rates, 3)),
        ]
    for name, runs in readings.items():
        columns.append(number_column(method_title(name), unit, [runs.get(key, DASH) for key in keys]))
    return ResultTable("Inertia from each sine run", *columns)


@dataclass(frozen=True, kw_only=True)
class CorrelationTable:
    """Correlations of parameters as text, each with its shade, 0 for none."""

    caption: str
    names: tuple[str, ...]
    cells: tuple[tuple[tuple[str, int], ...], ...]

    @property
    def rows(self) -> list[tuple[str, tuple[tuple[str, int], ...]]]:
        """Each parameter with its cells."""
        return list(zip(self.names, self.cells, strict=True))


def correlation_table(stored: Parameters) -> CorrelationTable | None:
    """Correlations of stored parameters; None where no two of them were estimated together."""
    known, axis = stored.covariance, stored.axis
    names = [name for name in dict.fromkeys((*base_names(axis), *stored.entries)) if name in stored.entries]

    def correlation(first: str, second: str) -> float:
        covariance = known.get((first, second), known.get((second, first), 0.0))
        variances = known.get((first, first), 0.0) * known.get((second, second), 0.0)
        # The file holds zero for parameters that were not estimated together.
        return covariance / math.sqrt(variances) if variances > 0.0 and covariance != 0.0 else math.nan

    if not any(math.isfinite(correlation(*pair)) for pair in combinations(names, 2)):
        return None

    def cell(first: str, second: str) -> tuple[str, int]:
        if first == second:
            return "1", 0
        value = correlation(first, second)
        shade = sum(abs(value) >= least for least in _SHADES)
        return format_number(value, "+.2f").replace("-", "−"), shade

    return CorrelationTable(
        caption="Correlation of parameters",
        names=tuple(axis.reword(parameter_title(name)) for name in names),
        cells=tuple(tuple(cell(first, second) for second in names) for first in names),
    )
