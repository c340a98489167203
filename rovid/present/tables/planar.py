"""Tables of the coupled model: parameters, simulations, and manoeuvres."""

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence

from rovid.core.formatting import plus_minus, round_to_error
from rovid.estimate.estimate import Estimate
from rovid.model.simulation import HORIZONS, FitMeasures
from rovid.planar.manoeuvres import ManoeuvreMeasure, Measures
from rovid.planar.standard_manoeuvres import RunManoeuvre
from rovid.planar.trial_simulation import SENSOR_UNITS, SPEEDS, PlanarTrialSimulation, pooled_measures
from rovid.present.documents.planar import derivative_name
from rovid.present.number_format import DASH, format_number, parameter_title, unit_symbol
from rovid.present.tables.table import Column, ResultTable, mixed_number_column, number_column, text_column
from rovid.store.parameter_file import Parameters

_NORMAL_95 = 1.959964
# In place of the interval of a parameter that the logs do not decide.
FROM_PRIOR = "from the prior"
# Units that are shown in degrees.
_ANGLES = ("rad", "rad/s")
_TITLES = {"turning_circle": "Turning circles in the logs", "zigzag": "Zigzags in the logs"}
_MODEL_TITLES = {"circle": "Predicted turning circles", "zigzag": "Predicted zigzags"}


def planar_estimate_table(estimate: Estimate) -> ResultTable:
    """Parameters by the names that options and files use, with SNAME symbols and 95 % intervals."""
    table = _parameter_table("parameter")
    for name in estimate.names:
        unit, symbol = unit_symbol(estimate.unit(name)), derivative_name(name) or DASH
        if name in estimate.refused:
            table.add_row(name, "not determined", unit, DASH, symbol)
            continue
        value, error = estimate.value(name), estimate.standard_error(name)
        if estimate.is_placeholder(name):
            table.add_row(name, plus_minus(value, error), unit, "guessed", symbol, style="red")
            continue
        low, high = (round_to_error(end, error) for end in estimate.interval(name))
        interval = f"{low} … {high}" if math.isfinite(error) else DASH
        interval = FROM_PRIOR if name in estimate.from_prior else interval
        table.add_row(name, plus_minus(value, error), unit, interval, symbol)
    return table


def planar_parameters_table(stored: Parameters) -> ResultTable:
    """Parameters of a file, and those that its logs do not determine."""
    table = _parameter_table("Parameters")
    for name, entry in stored.entries.items():
        value, error = entry.value, entry.standard_error
        low, high = (round_to_error(value + side * _NORMAL_95 * error, error) for side in (-1.0, 1.0))
        interval = f"{low} … {high}" if math.isfinite(error) else DASH
        interval = FROM_PRIOR if entry.from_prior else interval
        row = plus_minus(value, error), unit_symbol(entry.unit), interval, derivative_name(name) or DASH
        table.add_row(parameter_title(name), *row)
    for name in stored.assumed:
        table.add_row(parameter_title(name), "not determined", "", DASH, derivative_name(name) or DASH)
    return table


def _parameter_table(caption: str) -> ResultTable:
    return ResultTable(
        "" if caption == "parameter" else caption,
        text_column("parameter"),
        number_column("value ± standard error"),
        mixed_number_column("unit"),
        mixed_number_column("95 % interval"),
        mixed_number_column("SNAME"),
    )


def planar_simulation_table(simulations: Sequence[PlanarTrialSimulation]) -> ResultTable:
    """How well the free-running simulation follows each trial, and all trials together."""
    sensors = measured_speeds(simulations)
    has_track = any(math.isfinite(item.track_rms) for item in simulations)
    minute = HORIZONS[-1]
    columns = [mixed_number_column(f"R² {sensor_words(name)}") for name in sensors]
    columns += [mixed_number_column(f"heading after {seconds:.0f} s,", "deg") for seconds in reversed(HORIZONS)]
    if has_track:
        columns += [mixed_number_column(f"track after {minute:.0f} s,", "m"), mixed_number_column("track RMS", "m")]
    columns += [mixed_number_column(f"RMSE {sensor_words(name)}", SENSOR_UNITS[name]) for name in sensors]
    table = ResultTable("Free-running simulation against measurement", text_column("trial"), *columns)
    for item in simulations:
        headings = list(map(item.heading_errors.get, reversed(HORIZONS)))
        cells = [_r2(item.fits, name) for name in sensors]
        cells += [format_number(None if error is None else math.degrees(error), 2) for error in headings]
        if has_track:
            cells += [format_number(item.track_errors.get(minute), 2), format_number(item.track_rms, 2)]
        table.add_row(item.name, *cells, *(_rmse(item.fits, name) for name in sensors))
    pooled, blanks = pooled_measures(simulations), [""] * (2 + 2 * has_track)
    r2, rmse = [_r2(pooled, name) for name in sensors], [_rmse(pooled, name) for name in sensors]
    table.add_row("all", *r2, *blanks, *rmse, begins_section=True)
    return table


def measured_speeds(simulations: Sequence[PlanarTrialSimulation]) -> list[str]:
    """Speeds that any trial measures; the yaw rate follows from the heading."""
    return [name for name in SPEEDS if any(name in item.fits for item in simulations)]


def sensor_words(sensor: str) -> str:
    """Name of a sensor in text for people."""
    return sensor.replace("_velocity", "").replace("_", " ")


def _r2(fits: Mapping[str, FitMeasures], name: str) -> str:
    return format_number(fits[name].r2, ".4f") if name in fits else DASH


def _rmse(fits: Mapping[str, FitMeasures], name: str) -> str:
    return format_number(fits[name].rmse, 2) if name in fits else DASH


def run_manoeuvre_tables(found: Sequence[RunManoeuvre]) -> list[ResultTable]:
    """Turning circles and zigzags of the runs, as measured and as simulated; a table of each kind."""
    tables = []
    for kind, title in _TITLES.items():
        rows = [one for one in found if one.kind == kind]
        if not rows:
            continue
        table = ResultTable(title, *map(text_column, ("run", "measure")), *_columns(("measured", "simulated")))
        for one in rows:
            sides = (one.measured, one.simulated)
            for number, words in enumerate(_measure_rows(sides)):
                name = "" if number else f"{one.run}, from {one.begin:.0f} s"
                table.add_row(name, *words, begins_section=not number)
        tables.append(table)
    return tables


def model_manoeuvre_tables(measures: Measures) -> list[ResultTable]:
    """Standard manoeuvres of the model, with errors; names of ``measures`` are as "circle_port.advance"."""
    sides: dict[str, dict[str, ManoeuvreMeasure]] = {}
    for name, one in measures.items():
        manoeuvre, _, measure = name.partition(".")
        sides.setdefault(manoeuvre, {})[measure] = one
    tables = []
    for kind, title in _MODEL_TITLES.items():
        rows = {name: side for name, side in sides.items() if name.startswith(kind)}
        if not rows:
            continue
        table = ResultTable(title, text_column("measure"), *_columns(map(_manoeuvre_title, rows)))
        for words in _measure_rows(tuple(rows.values())):
            table.add_row(*words)
        tables.append(table)
    return tables


def _manoeuvre_title(name: str) -> str:
    kind, _, detail = name.partition("_")
    return f"to {detail}" if kind == "circle" else f"{detail}/{detail} deg"


def _columns(titles: Iterable[str]) -> list[Column]:
    return list(map(mixed_number_column, titles))


def _measure_rows(sides: Sequence[Measures]) -> Iterator[list[str]]:
    """A row for each measure: its name with its unit, and its value in each of the ``sides``."""
    units = {name: _unit(one) for side in sides for name, one in side.items()}
    for name, unit in units.items():
        title = name.replace("_", " ") + (f", {unit}" if unit not in {"", "1"} else "")
        yield [title, *(_cell(side[name]) if name in side else DASH for side in sides)]


def _cell(one: ManoeuvreMeasure) -> str:
    factor = 180.0 / math.pi if one.unit in _ANGLES else 1.0
    if one.standard_error is None:
        return format_number(factor * one.value)
    return plus_minus(factor * one.value, factor * one.standard_error)


def _unit(one: ManoeuvreMeasure) -> str:
    return unit_symbol(one.unit.replace("rad", "deg") if one.unit in _ANGLES else one.unit)
