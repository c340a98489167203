"""Tables of trials, simulations, manoeuvres, thrusters, log files, the heading controller and exports."""

import contextlib
import math
from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from rovid.control.control_law import ControlLaw
from rovid.control.design import ControllerDesign
from rovid.core.errors import ConfigError
from rovid.core.formatting import plus_minus
from rovid.effects import effect_named
from rovid.export import FORMATS
from rovid.export.verification import VerifiedExport
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
    number_with_unit,
    parameter_title,
    sensor_words,
    steady_state_words,
    unit_symbol,
)
from rovid.present.report_data import ReportData
from rovid.present.sentences import effect_title
from rovid.store.parameter_file import sha256
from rovid.trial.assumptions import Assumptions
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
    columns = [text_column("trial"), mixed_number_column("R²")]
    columns += [mixed_number_column(f"{axis.position_words} after {horizon:.0f} s,", unit) for horizon in horizons]
    columns += map(mixed_number_column, ("RMSE", "fit %", "samples"), (axis.rate_unit, "", ""))
    table = ResultTable(f"Free-running simulation against measurement, {axis.rate_words}", *columns)
    for item in simulations:
        errors = [format_number(axis.to_display(item.position_errors[horizon]), 2) for horizon in horizons]
        r2, *measures = _fit_cells(item.fit)
        table.add_row(item.run.trial.name, r2, *errors, *measures)
    r2, *measures = _fit_cells(pooled_fit(simulations))
    table.add_row("all", r2, *[""] * len(horizons), *measures, begins_section=True)
    return table


def _fit_cells(fit: FitMeasures) -> tuple[str, str, str, str]:
    percent = format_number(fit.fit_percent, ".1f")
    return format_number(fit.r2, ".4f"), format_number(fit.rmse, 2), percent, str(fit.samples)


def trials_table(report: ReportData, campaign: Campaign) -> ResultTable:
    """What each trial measured, what it served for, and how well it is simulated without and with the causes."""
    rates, gaps, remarks = [], [], []
    for trial in campaign.trials:
        rates.append(format_number(1.0 / trial.sampling_interval, ".3g"))
        # The longest time between two readings, s.
        gaps.append(format_number(float(np.max(np.diff(trial.time[trial.measured]), initial=0.0)), ".2f"))
        remarks.append(" ".join(remark.text for remark in trial.remarks) or DASH)
    measured = [number_column("rate", "Hz", rates), number_column("longest gap", "s", gaps)]
    # The caption has what is equal in all trials.
    shared = [column for column in measured if len(set(column.cells)) == 1]
    caption = ["Trials", *(f"{column.title} {column.cells[0]} {column.unit}" for column in shared)]
    columns = [
        text_column("trial", [trial.name for trial in campaign.trials]),
        number_column("length", "s", [format_number(trial.duration, ".0f") for trial in campaign.trials]),
        text_column("what it gave", [_use(report, trial.name) for trial in campaign.trials]),
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
        cells = [_measure(item.fits, name, "r2", ".4f") for name in sensors]
        cells += [format_number(None if error is None else math.degrees(error), 2) for error in headings]
        if has_track:
            cells += [format_number(item.track_errors.get(minute), 2), format_number(item.track_rms, 2)]
        table.add_row(item.name, *cells, *(_measure(item.fits, name, "rmse", 2) for name in sensors))
    pooled, blanks = pooled_measures(simulations), [""] * (2 + 2 * has_track)
    r2 = [_measure(pooled, name, "r2", ".4f") for name in sensors]
    rmse = [_measure(pooled, name, "rmse", 2) for name in sensors]
    table.add_row("all", *r2, *blanks, *rmse, begins_section=True)
    return table


def _measure(fits: Mapping[str, FitMeasures], name: str, measure: str, digits: int | str) -> str:
    return format_number(getattr(fits[name], measure), digits) if name in fits else DASH


def run_manoeuvre_tables(found: Sequence[RunManoeuvre]) -> list[ResultTable]:
    """Turning circles and zigzags of the runs, as measured and as simulated; a table of each kind."""
    tables = []
    for kind, title in _TITLES.items():
        rows = [one for one in found if one.kind == kind]
        if not rows:
            continue
        columns = *map(text_column, ("run", "measure")), *map(mixed_number_column, ("measured", "simulated"))
        table = ResultTable(title, *columns)
        for one in rows:
            for number, words in enumerate(_measure_rows((one.measured, one.simulated))):
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
        rows = {name.partition("_")[2]: side for name, side in sides.items() if name.startswith(kind)}
        if not rows:
            continue
        titles = [f"to {detail}" if kind == "circle" else f"{detail}/{detail} deg" for detail in rows]
        table = ResultTable(title, text_column("measure"), *map(mixed_number_column, titles))
        for words in _measure_rows(tuple(rows.values())):
            table.add_row(*words)
        tables.append(table)
    return tables


def _measure_rows(sides: Sequence[Measures]) -> Iterator[list[str]]:
    """A row for each measure: its name with its unit, and its value in each of the ``sides``."""
    units = {name: one.unit for side in sides for name, one in side.items()}
    for name, unit in units.items():
        title, shown = name.replace("_", " "), unit_symbol(unit)
        if unit in _ANGLES:
            shown = shown.replace("rad", "deg")
        if shown:
            title += f", {shown}"
        yield [title, *(_cell(side.get(name)) for side in sides)]


def _cell(one: ManoeuvreMeasure | None) -> str:
    if one is None:
        return DASH
    factor = 180.0 / math.pi if one.unit in _ANGLES else 1.0
    if one.standard_error is None:
        return format_number(factor * one.value)
    return plus_minus(factor * one.value, factor * one.standard_error)


def gains_table(design: ControllerDesign, guess: Assumptions | None = None) -> ResultTable:
    """Gains, delays, torque limits and margins; with bounds over the parameter uncertainty where known."""
    guess = guess or Assumptions()
    columns = [text_column("quantity"), mixed_number_column("value")]
    if design.spread is not None and design.margins.stable:
        columns.append(mixed_number_column(f"95 % of {design.spread.draws} draws"))
    table = ResultTable("The controller and its margins", *columns)
    for quantity, value, unit, bound in _gain_rows(design):
        row = quantity, guess.mark_number(number_with_unit(value, unit), unit), bound
        table.add_row(*row[: len(columns)])
    return table


def _gain_rows(design: ControllerDesign) -> Iterator[tuple[str, str, str, str]]:
    """Quantity, value, unit, and the bound that 95 % of the draws from the parameter covariance keep."""
    law, margins, spread = design.law, design.margins, design.spread
    for name, value in design.autopilot_parameters.items():
        yield name, format_number(value, ".4g"), "", DASH
    yield "gain on heading kp", format_number(law.kp, ".5g"), "N m/rad", DASH
    yield "gain on yaw rate kd", format_number(law.kd, ".5g"), "N m s/rad", DASH
    yield "damping ratio", format_number(design.damping, ".3f"), "", DASH
    yield "bandwidth", format_number(design.bandwidth, ".3g"), "rad/s", DASH
    yield "sampling period", format_number(law.period, "g"), "s", DASH
    if isinstance(law, ControlLaw):
        yield "time constant of the rate filter", format_number(law.rate_filter, ".2g"), "s", DASH
    else:
        yield "torque of full output", format_number(law.full, ".4g"), "N m", DASH
    yield "total delay of the loop", format_number(design.lag, ".2g"), "s", DASH
    for title, torque in zip(("least torque", "largest torque"), torque_limits(design), strict=False):
        yield title, torque, "N m", DASH
    if not margins.stable:
        return
    bounds = (math.nan,) * 4
    if spread is not None:
        bounds = spread.gain_db, spread.phase_deg, spread.delay_s, spread.sensitivity_peak
    yield "gain margin", _bounded(margins.gain_db, ".1f"), "dB", f"≥ {_bounded(bounds[0], '.1f')}"
    yield "phase margin", format_number(margins.phase_deg, ".0f"), "deg", f"≥ {format_number(bounds[1], '.0f')}"
    yield "delay margin", format_number(margins.delay_s, ".2f"), "s", f"≥ {format_number(bounds[2], '.2f')}"
    yield "lag margin", _bounded(margins.lag_s, ".2f"), "s", DASH
    peak = format_number(margins.sensitivity_peak, ".2f")
    yield "peak of the sensitivity", peak, "", f"≤ {format_number(bounds[3], '.2f')}"


def torque_limits(design: ControllerDesign) -> list[str]:
    """The least and the largest torque of the thrusters in N m; empty where they are not known."""
    return equal_decimals((design.allocation.lowest, design.allocation.highest)) if design.allocation.limited else []


def _bounded(value: float, form: str) -> str:
    return "without limit" if math.isinf(value) else format_number(value, form)


def runs_table(design: ControllerDesign) -> ResultTable:
    """Step metrics of every closed-loop run, in the order of the design."""
    table = ResultTable(
        "Closed-loop runs, with 2 % of the torque in use as disturbance",
        *map(text_column, ("run", "effects", "model aid")),
        *map(number_column, ("settled after", "overshoot", "steady error"), ("s", "deg", "deg")),
        mixed_number_column("limit cycle"),
        *map(number_column, ("63 % after", "10 to 90 % in", "torque rms"), ("s", "s", "N m")),
    )
    before = ""
    for run in design.runs:
        metrics, cycle, aid = run.metrics, run.metrics.limit_cycle, "none"
        if run.model_aid:
            aid = "drag and effects" if run.effects_known else "drag"
        cells = [run.name, "all" if run.effects else "none", aid]
        cells += [format_number(one, ".1f") for one in (metrics.settling_time, metrics.overshoot_deg)]
        cells.append(format_number(metrics.steady_error_deg, ".2f"))
        cells.append("none" if cycle is None else f"±{cycle.amplitude_deg:.2f} deg, {cycle.period_s:.3g} s")
        cells += [format_number(one, ".1f") for one in (metrics.time_constant, metrics.rise_time, metrics.effort)]
        table.add_row(*cells, begins_section=run.name != before)
        before = run.name
    # Without effects in the model the column has no information.
    return table if design.model.effects else table.without("effects")


def formats_table(exports: Mapping[str, VerifiedExport]) -> ResultTable:
    """Difference between each format's equation and the model, and the parts that the format lacks."""
    table = ResultTable(
        "Yaw rate of each format's own equation against the model's",
        *map(text_column, ("format", "file")),
        number_column("off by", "% of range"),
        mixed_number_column("rms", "rad/s"),
        number_column("of what it holds", "% of range"),
        text_column("not held, % of range"),
    )
    for name, made in exports.items():
        sizes = [(loss_title(loss.what), loss.percent_of_range["yaw_rate"]) for loss in made.losses]
        lost = [f"{title} {format_number(size, 2)}" for title, size in sizes]
        errors = made.mismatch.percent_of_range, made.mismatch.rms, made.kept_mismatch.percent_of_range
        cells = [format_number(one["yaw_rate"], 2) for one in errors]
        table.add_row(name, FORMATS[name].file, *cells, "; ".join(lost) or DASH)
    return table


def loss_title(what: str) -> str:
    """The title of an effect or parameter that a format lacks."""
    with contextlib.suppress(ConfigError):
        return effect_title(effect_named(what))
    return parameter_title(what)


def loss_reasons(exports: Mapping[str, VerifiedExport]) -> list[tuple[str, str, str]]:
    """Formats, the part that they lack, and why; each reason once."""
    formats: dict[tuple[str, str], list[str]] = {}
    for name, made in exports.items():
        for loss in made.losses:
            formats.setdefault((loss_title(loss.what), loss.why), []).append(name)
    return [(", ".join(names), title, why) for (title, why), names in formats.items()]
