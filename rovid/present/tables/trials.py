"""Tables of trials, simulations, manoeuvres, thrusters and log files."""

import math
from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from rovid.core.formatting import plus_minus
from rovid.model.simulation import HORIZONS, FitMeasures, TrialSimulation, pooled_fit
from rovid.planar.manoeuvres import ManoeuvreMeasure, Measures
from rovid.planar.standard_manoeuvres import RunManoeuvre
from rovid.planar.trial_simulation import SENSOR_UNITS, SPEEDS, PlanarTrialSimulation, pooled_measures
from rovid.present.console import Column, ResultTable, mixed_number_column, number_column, text_column
from rovid.present.number_format import (
    DASH,
    arm_words,
    equal_decimals,
    format_number,
    sensor_words,
    steady_state_words,
    unit_symbol,
)
from rovid.present.report_data import ReportData
from rovid.store.parameter_file import sha256
from rovid.trial.trial import Campaign, Trial
from rovid.trial.vehicle import Vehicle

# Units that are shown in degrees.
_ANGLES = ("rad", "rad/s")
_TITLES = {"turning_circle": "Turning circles in the logs", "zigzag": "Zigzags in the logs"}
_MODEL_TITLES = {"circle": "Predicted turning circles", "zigzag": "Predicted zigzags"}


def thrusters_table(vehicle: Vehicle) -> ResultTable:
    """Thrusters with their lever arms and the ranges of their bench curves."""
    axis = vehicle.axis
    does = "turns" if axis.angular else "drives"
    columns = text_column("actuator"), number_column(*arm_words(axis)), text_column("commands on the bench")
    table = ResultTable(f"What {does} the vehicle", *columns, text_column("thrust"))
    for thruster in vehicle.thrusters:
        curve = thruster.curve
        if curve is None:
            table.add_row(thruster.name, DASH, DASH, f"{axis.force_name} logged")
            continue
        arm = f"{'guessed ' * thruster.arm_guessed}{thruster.arm:.4g}"
        least, most = equal_decimals([curve.thrust.min(), curve.thrust.max()])
        thrust = f"{'guessed ' * thruster.curve_guessed}{least} … {most} N"
        table.add_row(thruster.name, arm, f"{curve.command[0]:g} … {curve.command[-1]:g}", thrust)
    return table


def simulation_table(simulations: Sequence[TrialSimulation]) -> ResultTable:
    """How well the free-running simulation follows each trial, and all trials together."""
    axis = simulations[0].run.trial.axis
    unit, horizons = axis.display_unit[0], tuple(reversed(HORIZONS))
    table = ResultTable(
        f"Free-running simulation against measurement, {axis.rate_words}",
        text_column("trial"),
        mixed_number_column("R²"),
        *(mixed_number_column(f"{axis.position_words} after {horizon:.0f} s,", unit) for horizon in horizons),
        mixed_number_column("RMSE", axis.rate_unit),
        mixed_number_column("fit %"),
        mixed_number_column("samples"),
    )
    for item in simulations:
        errors = [format_number(axis.to_display(item.position_errors[horizon]), 2) for horizon in horizons]
        r2, *measures = _fit_cells(item.fit)
        table.add_row(item.run.trial.name, r2, *errors, *measures)
    r2, *measures = _fit_cells(pooled_fit(simulations))
    table.add_row("all", r2, *[""] * len(horizons), *measures, begins_section=True)
    return table


def _fit_cells(fit: FitMeasures) -> tuple[str, str, str, str]:
    """R², RMSE, fit and number of samples."""
    percent = format_number(fit.fit_percent, ".1f")
    return format_number(fit.r2, ".4f"), format_number(fit.rmse, 2), percent, str(fit.samples)


def trials_table(report: ReportData, campaign: Campaign) -> ResultTable:
    """What each trial measured, what it served for, and how well it is simulated without and with the causes."""
    names, lengths, uses, rates, gaps, remarks = [], [], [], [], [], []
    for trial in campaign.trials:
        names.append(trial.name)
        lengths.append(format_number(trial.duration, ".0f"))
        uses.append(_use(report, trial.name))
        rates.append(format_number(1.0 / trial.sampling_interval, ".3g"))
        # The longest time between two readings, s.
        gap = float(np.max(np.diff(trial.time[trial.measured]), initial=0.0))
        gaps.append(format_number(gap, ".2f"))
        remarks.append(" ".join(remark.text for remark in trial.remarks) or DASH)
    measured = [number_column("rate", "Hz", rates), number_column("longest gap", "s", gaps)]
    # The caption has what is equal in all trials.
    shared = [column for column in measured if len(set(column.cells)) == 1]
    caption = ["Trials", *(f"{column.title} {column.cells[0]} {column.unit}" for column in shared)]
    columns = [
        text_column("trial", names),
        number_column("length", "s", lengths),
        text_column("what it gave", uses),
        *_simulation_columns(report, campaign.trials),
        *(column for column in measured if column not in shared),
    ]
    if set(remarks) != {DASH}:
        columns.append(text_column("noticed", remarks))
    return ResultTable(", ".join(caption), *columns)


def _simulation_columns(report: ReportData, trials: Sequence[Trial]) -> Iterator[Column]:
    """R² of the rate and error of the position after a minute, without and with the causes where there are any."""
    if not report.simulations:
        return
    axis, sides = report.axis, {"": report.simulations_with}
    names = {item.run.trial.name for item in report.simulations_with}
    if any(trial.name not in names for trial in trials):
        # Trials that were diagnosed in parts are simulated as a whole by the stored model alone.
        sides = {"": report.simulations}
    elif len(report.nested) > 1:
        sides = {"without: ": report.simulations_without, "with: ": report.simulations_with}
    for side, items in sides.items():
        by_name = {item.run.trial.name: item for item in items}
        r2 = [DASH] * len(trials)
        positions: list[float | None] = [None] * len(trials)
        for place, trial in enumerate(trials):
            if item := by_name.get(trial.name):
                r2[place] = format_number(item.fit.r2, ".4f")
                positions[place] = axis.to_display(item.position_errors.get(HORIZONS[-1]))
        yield number_column(f"{side}R²", "", r2)
        title = f"{side}{axis.position_words} off after {HORIZONS[-1]:.0f} s"
        yield number_column(title, axis.display_unit[0], equal_decimals(positions, 2))


def _use(report: ReportData, name: str) -> str:
    """What the trial ``name`` served for."""
    if report.runs is not None and all(run.trial.name != name for run in report.runs.items):
        return "left out"
    uses = []
    if report.drag is not None and (count := sum(point.source == name for point in report.drag.points)):
        uses.append(f"{count} {steady_state_words(report.axis)}{'s' * (count > 1)}")
    if report.inertia is not None:
        sines = [trial for trial in report.inertia.trials if trial.source == name]
        uses += [f"{trial.cycles} periods of {trial.period:.3g} s" for trial in sines]
    return ", ".join(uses) or f"regression{', simulation' * bool(report.simulations)}"


def sources_table(report: ReportData) -> ResultTable | None:
    """Every log that the parameters or this page depend on, with its hash; None where there is none."""
    fitted = {source.name: source.sha256 for source in report.parameters.sources}
    trials = {} if report.campaign is None else {trial.name: trial for trial in report.campaign.trials}
    if not fitted and not trials:
        return None
    uses = {name: f"parameters{', this page' * (name in trials)}" for name in fitted}
    table = ResultTable("Logs and their SHA-256", *map(text_column, ("log", "used for", "SHA-256")))
    for name in dict.fromkeys((*fitted, *trials)):
        digest = fitted.get(name, DASH)
        if name not in fitted and trials[name].path.is_file():
            digest = sha256(trials[name].path)
        table.add_row(name, uses.setdefault(name, "this page only"), digest)
    if len(set(uses.values())) == 1:
        return table.without("used for")
    return table


# --- the coupled model -----------------------------------------------------------------------------------------------


def planar_simulation_table(simulations: Sequence[PlanarTrialSimulation]) -> ResultTable:
    """How well the free-running simulation follows each trial, and all trials together."""
    # The yaw rate follows from the heading.
    sensors = [name for name in SPEEDS if any(name in item.fits for item in simulations)]
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
        table = ResultTable(
            title, *map(text_column, ("run", "measure")), *map(mixed_number_column, ("measured", "simulated"))
        )
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
        table = ResultTable(title, text_column("measure"), *map(mixed_number_column, map(_manoeuvre_title, rows)))
        for words in _measure_rows(tuple(rows.values())):
            table.add_row(*words)
        tables.append(table)
    return tables


def _manoeuvre_title(name: str) -> str:
    kind, _, detail = name.partition("_")
    return f"to {detail}" if kind == "circle" else f"{detail}/{detail} deg"


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
