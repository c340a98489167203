"""Tables of trials, thrusters and log files."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from rovid.model.simulation import HORIZONS, TrialSimulation, pooled_fit
from rovid.present.number_format import DASH, arm_words, equal_decimals, format_number, steady_state_words
from rovid.present.report_data import ReportData
from rovid.present.tables.table import Column, ResultTable, mixed_number_column, number_column, text_column
from rovid.store.parameter_file import sha256
from rovid.trial.trial import Campaign, Trial
from rovid.trial.vehicle import Vehicle


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
    rows = [(item.run.trial.name, item.fit, item.position_errors) for item in simulations]
    for name, fit, errors in (*rows, ("all", pooled_fit(simulations), None)):
        ahead = ["" for _ in horizons]
        if errors is not None:
            ahead = [format_number(axis.to_display(errors[horizon]), 2) for horizon in horizons]
        measures = format_number(fit.rmse, 2), format_number(fit.fit_percent, ".1f"), str(fit.samples)
        table.add_row(name, format_number(fit.r2, ".4f"), *ahead, *measures, begins_section=errors is None)
    return table


def trials_table(report: ReportData, campaign: Campaign) -> ResultTable:
    """What each trial measured, what it served for, and how well it is simulated without and with the causes."""
    trials = campaign.trials
    remarks = [" ".join(remark.text for remark in trial.remarks) or DASH for trial in trials]
    rates = [format_number(1.0 / trial.sampling_interval, ".3g") for trial in trials]
    gaps = [format_number(_longest_gap(trial), ".2f") for trial in trials]
    measured = [number_column("rate", "Hz", rates), number_column("longest gap", "s", gaps)]
    # The caption has what is equal in all trials.
    shared = [column for column in measured if len(set(column.cells)) == 1]
    caption = ["Trials", *(f"{column.title} {column.cells[0]} {column.unit}" for column in shared)]
    columns = [
        text_column("trial", [trial.name for trial in trials]),
        number_column("length", "s", [format_number(trial.duration, ".0f") for trial in trials]),
        text_column("what it gave", [_use(report, trial.name) for trial in trials]),
        *(_simulation_columns(report, trials) if report.simulations else ()),
        *(column for column in measured if column not in shared),
    ]
    if set(remarks) != {DASH}:
        columns.append(text_column("noticed", remarks))
    return ResultTable(", ".join(caption), *columns)


def _longest_gap(trial: Trial) -> float:
    """The longest time between two readings, s."""
    return float(np.max(np.diff(trial.time[trial.measured]), initial=0.0))


def _simulation_columns(report: ReportData, trials: Sequence[Trial]) -> Iterator[Column]:
    """R² of the rate and error of the position after a minute, without and with the causes where there are any."""
    axis, sides = report.axis, {"": report.simulations_with}
    names = {item.run.trial.name for item in report.simulations_with}
    if any(trial.name not in names for trial in trials):
        # Trials that were diagnosed in parts are simulated as a whole by the stored model alone.
        sides = {"": report.simulations}
    elif len(report.nested) > 1:
        sides = {"without: ": report.simulations_without, "with: ": report.simulations_with}
    for side, items in sides.items():
        by_name = {item.run.trial.name: item for item in items}
        chosen = [by_name.get(trial.name) for trial in trials]
        r2 = [DASH if item is None else format_number(item.fit.r2, ".4f") for item in chosen]
        positions = [None if item is None else item.position_errors.get(HORIZONS[-1]) for item in chosen]
        yield number_column(f"{side}R²", "", r2)
        title = f"{side}{axis.position_words} off after {HORIZONS[-1]:.0f} s"
        yield number_column(title, axis.display_unit[0], equal_decimals(list(map(axis.to_display, positions)), 2))


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
    if uses:
        return ", ".join(uses)
    return "regression, simulation" if report.simulations else "regression"


def sources_table(report: ReportData) -> ResultTable | None:
    """Every log that the parameters or this page depend on, with its hash; None where there is none."""
    fitted = {source.name: source.sha256 for source in report.parameters.sources}
    trials = {} if report.campaign is None else {trial.name: trial for trial in report.campaign.trials}
    if not fitted and not trials:
        return None
    names = list(dict.fromkeys((*fitted, *trials)))
    hashes = [fitted[name] if name in fitted else _file_hash(trials[name]) for name in names]
    uses = ["parameters, this page" if name in trials else "parameters" for name in fitted]
    uses += ["this page only"] * (len(names) - len(fitted))
    columns = [text_column("log", names), text_column("used for", uses), text_column("SHA-256", hashes)]
    if len(set(uses)) == 1:
        del columns[1]
    return ResultTable("Logs and their SHA-256", *columns)


def _file_hash(trial: Trial) -> str:
    """SHA-256 of the log; a dash where it is not a file."""
    return sha256(trial.path) if trial.path.is_file() else DASH
