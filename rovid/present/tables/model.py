"""The page's tables, as text: each function takes evidence and returns a captioned grid."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.core.formatting import plus_minus
from rovid.estimate.estimate import Estimate
from rovid.estimate.inertia import METHODS, InertiaFit
from rovid.model.parameter_names import base_names
from rovid.model.simulation import HORIZONS
from rovid.present.number_text import (
    NOTHING,
    arm_words,
    equal_decimals,
    format_number,
    number_with_unit,
    parameter_title,
    same_decimals,
    steady_state_words,
    unit_symbol,
)
from rovid.present.page.report_data import ReportData
from rovid.present.plots.inertia import method_interval, method_title
from rovid.present.tables.diagnosis import valid_ratios
from rovid.present.tables.table import (
    Column,
    ResultTable,
    TableBuilder,
    mixed_number_column,
    number_column,
    numbers,
    text_column,
    words,
)
from rovid.store.agreement import effect_titles, relative_deviation
from rovid.store.parameter_file import Entry, sha256
from rovid.trial.trial import Campaign, Trial
from rovid.trial.vehicle import Vehicle

_NORMAL = 1.959964  # two-sided 95 % of the normal distribution


def parameters_table(evidence: ReportData) -> ResultTable:
    """Every parameter of the file, and those that it lacks."""
    axis, entries, guess = evidence.axis, evidence.parameters.entries, evidence.vehicle.assumptions
    # Parameters of different units share no decimal point.
    headings = (
        text_column("parameter"),
        mixed_number_column("value ± standard error"),
        text_column("95 % interval"),
        text_column("found by"),
    )
    table = TableBuilder("Parameters", *headings)
    for ratio in valid_ratios(evidence.parameters.base_estimate()):
        value = plus_minus(ratio.value, ratio.standard_error)
        reach = _NORMAL * ratio.standard_error
        interval = _from_to(value, (ratio.value - reach, ratio.value + reach))
        table.add(parameter_title(ratio.name), number_with_unit(value, ratio.unit), interval, "")
    # A dict for a set that keeps the order.
    for name in dict.fromkeys((*base_names(axis), *entries)):
        parameter = axis.reword(parameter_title(name))
        entry = entries.get(name)
        if entry is None:
            table.add(parameter, "not determined", NOTHING, NOTHING)
            continue
        value = plus_minus(entry.value, entry.standard_error)
        shown = guess.mark_number(number_with_unit(value, entry.unit), entry.unit)
        interval = NOTHING if guess.is_placeholder(entry.unit) else _interval(evidence, name, value)
        table.add(parameter, shown, interval, method_words(entry))
    return table.grid()


def method_words(entry: Entry) -> str:
    """The method, with its options where there were any."""
    return f"{entry.method} ({entry.options})" if entry.options else entry.method


def _interval(evidence: ReportData, name: str, text: str) -> str:
    entry = evidence.parameters.entries[name]
    if not math.isfinite(entry.standard_error):
        return NOTHING
    estimate = source_estimate(evidence, name)
    if estimate is not None:
        return _from_to(text, estimate.interval(name))
    reach = _NORMAL * entry.standard_error
    return _from_to(text, (entry.value - reach, entry.value + reach))


def _from_to(text: str, interval: tuple[float, float]) -> str:
    """The interval, with the decimals of ``text``."""
    low, high = interval
    return f"{same_decimals(text, low)} … {same_decimals(text, high)}"


def source_estimate(evidence: ReportData, name: str) -> Estimate | None:
    """The estimate of this report that the file's parameter ``name`` is, if any."""
    value = evidence.parameters.entries[name].value
    for fit in (evidence.drag, evidence.inertia):
        if fit is not None and name in fit.estimate.names and math.isclose(fit.estimate.value(name), value):
            return fit.estimate
    return None


def is_source_of_model(evidence: ReportData, estimate: Estimate) -> bool:
    """Whether any parameter of the model is that of ``estimate``."""
    return any(source_estimate(evidence, name) is estimate for name in evidence.parameters.entries)


def differences_from_model(evidence: ReportData, estimate: Estimate) -> list[str]:
    """What ``estimate`` says beside the model's parameters, where these come of another method, a paragraph each."""
    axis, entries = evidence.axis, evidence.parameters.entries
    known = [name for name in estimate.names if name in entries and name not in estimate.refused]
    apart = [_apart(evidence, estimate, name) for name in known if source_estimate(evidence, name) is None]
    causes = axis.reword(effect_titles(entries))
    why = f" It knows nothing of {causes}." if causes else ""
    said = [f"By {estimate.method}: {', '.join(apart)}.{why}"] if apart else []
    # Of what the method noticed the model knows more.
    return said if is_source_of_model(evidence, estimate) else [*said, *estimate.warnings]


def _apart(evidence: ReportData, estimate: Estimate, name: str) -> str:
    """One parameter by another method, and how far it is from the model's."""
    entry = evidence.parameters.entries[name]
    value, error = estimate.value(name), estimate.standard_error(name)
    size = evidence.vehicle.assumptions.mark_number(number_with_unit(plus_minus(value, error), entry.unit), entry.unit)
    shown = f"{evidence.axis.reword(parameter_title(name))} {size}"
    if abs(value - entry.value) <= _NORMAL * math.hypot(error, entry.standard_error) or entry.value == 0.0:
        return f"{shown} (as the model, within their errors)"
    return f"{shown} ({relative_deviation(value, entry.value)})"


def thrusters_table(vehicle: Vehicle) -> ResultTable:
    """What turns the vehicle, or drives it."""
    axis = vehicle.axis
    does = "turns" if axis.angular else "drives"
    headings = (
        text_column("actuator"),
        number_column(*arm_words(axis)),
        text_column("commands on the bench"),
        text_column("thrust"),
    )
    table = TableBuilder(f"What {does} the vehicle", *headings)
    for thruster in vehicle.thrusters:
        curve = thruster.curve
        if curve is None:
            table.add(thruster.name, NOTHING, NOTHING, f"{axis.force_name} logged")
            continue
        commands = f"{curve.command[0]:g} … {curve.command[-1]:g}"
        least, most = equal_decimals([curve.thrust.min(), curve.thrust.max()])
        reach = f"{'guessed ' * thruster.arm_guessed}{thruster.arm:.4g}"
        table.add(thruster.name, reach, commands, f"{'guessed ' * thruster.curve_guessed}{least} … {most} N")
    return table.grid()


def trials_table(evidence: ReportData, campaign: Campaign) -> ResultTable:
    """What was measured, what it gave, and how well each trial is simulated without and with what was found."""
    trials = campaign.trials
    remarks = [" ".join(remark.text for remark in trial.remarks) or NOTHING for trial in trials]
    measured = [
        numbers("rate", "Hz", [format_number(1.0 / trial.sampling_interval, ".3g") for trial in trials]),
        numbers("longest gap", "s", [format_number(_longest_gap(trial), ".2f") for trial in trials]),
        words("noticed", remarks),
    ]
    # What is the same of all trials is said once.
    shared = [column for column in measured if len(set(column.cells)) == 1]
    said = [f"{column.title} {column.cells[0].strip()} {column.unit}" for column in shared if column.unit]
    columns = [
        words("trial", [trial.name for trial in trials]),
        numbers("length", "s", [format_number(trial.duration, ".0f") for trial in trials]),
        words("what it gave", [_gave(evidence, trial.name) for trial in trials]),
        *(_simulated(evidence, trials) if evidence.simulations else ()),
        *(column for column in measured if column not in shared or (not column.unit and remarks[0] != NOTHING)),
    ]
    return ResultTable(caption=", ".join(["Trials", *said]), columns=tuple(columns))


def _simulated(evidence: ReportData, trials: Sequence[Trial]) -> Iterator[Column]:
    """R² of the rate and the position's error after a minute, once or without and with what was found."""
    axis, sides = evidence.axis, {"": evidence.simulations_with}
    names = {item.run.trial.name for item in evidence.simulations_with}
    if any(trial.name not in names for trial in trials):
        # What was diagnosed in parts is simulated as a whole by the parameter file's model alone.
        sides = {"": evidence.simulations}
    elif len(evidence.nested) > 1:
        sides = {"without: ": evidence.simulations_without, "with: ": evidence.simulations_with}
    for side, items in sides.items():
        by_name = {item.run.trial.name: item for item in items}
        chosen = [by_name.get(trial.name) for trial in trials]
        shares = [NOTHING if item is None else format_number(item.fit.r2, ".4f") for item in chosen]
        ahead = [None if item is None else axis.to_display(item.position_errors.get(HORIZONS[-1])) for item in chosen]
        yield numbers(f"{side}R²", "", shares)
        yield numbers(
            f"{side}{axis.position_words} off after {HORIZONS[-1]:.0f} s",
            axis.display_unit[0],
            equal_decimals(ahead, 2),
        )


def _longest_gap(trial: Trial) -> float:
    """The longest time between two readings, s."""
    return float(np.max(np.diff(trial.time[trial.measured]), initial=0.0))


def _gave(evidence: ReportData, name: str) -> str:
    """What the trial called ``name`` served for."""
    if evidence.runs is not None and all(run.trial.name != name for run in evidence.runs.items):
        return "left out"
    texts = [*_gave_drag(evidence, name), *_gave_inertia(evidence, name)]
    if texts:
        return ", ".join(texts)
    return "regression, simulation" if evidence.simulations else "regression"


def _gave_drag(evidence: ReportData, name: str) -> Iterator[str]:
    if evidence.drag is None:
        return
    count = sum(point.source == name for point in evidence.drag.points)
    if count:
        yield _counted(count, steady_state_words(evidence.axis))


def _gave_inertia(evidence: ReportData, name: str) -> Iterator[str]:
    if evidence.inertia is None:
        return
    for trial in evidence.inertia.trials:
        if trial.source == name:
            yield f"{trial.cycles} periods of {trial.period:.3g} s"


def _counted(count: int, noun: str) -> str:
    return f"{count} {noun}" if count == 1 else f"{count} {noun}s"


def methods_table(fit: InertiaFit, rigid_body: float | None, *, used: bool) -> ResultTable:
    """Inertia by every method."""
    its_unit = unit_symbol(fit.estimate.unit("inertia"))
    headings = [text_column("method"), number_column("inertia", its_unit), text_column(f"95 % interval, {its_unit}")]
    if rigid_body is not None:
        headings.append(number_column("over rigid body"))
    table = TableBuilder("Inertia by each method", *headings, text_column(""))
    for name, method in METHODS.items():
        reading = fit.methods.get(name)
        if reading is None:
            continue
        value = plus_minus(reading.value, reading.standard_error)
        cells = [method, value, _reach(fit, name, value)]
        if rigid_body is not None:
            cells.append(f"{reading.value / rigid_body:.3f}")
        table.add(*cells, _remark(fit, name, used=used))
    return table.grid()


def _reach(fit: InertiaFit, name: str, text: str) -> str:
    """From and to, with as many figures as ``text`` has; nothing where no error is known."""
    interval = method_interval(fit, name)
    if interval is None:
        return NOTHING
    return _from_to(text, interval)


def _remark(fit: InertiaFit, name: str, *, used: bool) -> str:
    if name == fit.chosen:
        return "used" if used else "the best of these"
    if name != "peak":
        return "for comparison"
    if fit.peak_bias is None:
        return "biased"
    return f"biased: {100.0 * fit.peak_bias:.0f} % of the true inertia on the model's own motion"


def sine_table(fit: InertiaFit) -> ResultTable:
    """Each sine run, and what each method reads from it."""
    readings = {}
    # A dict for a set that keeps the order.
    keys: dict[tuple[str, int], None] = {}
    for name in METHODS:
        if name in fit.methods and fit.methods[name].runs:
            readings[name] = _runs(fit, name)
            keys |= dict.fromkeys(readings[name])
    columns = [words("sine run", [source for source, _ in keys])]
    if len(fit.trials) == len(keys):
        columns += _sine_columns(fit)
    its_unit = unit_symbol(fit.estimate.unit("inertia"))
    for name, runs in readings.items():
        cells = [runs.get(key, NOTHING) for key in keys]
        columns.append(numbers(method_title(name), its_unit, cells))
    return ResultTable(caption="Inertia from each sine run", columns=tuple(columns))


def _sine_columns(fit: InertiaFit) -> list[Column]:
    """Period, cycles and peaks of each sine run."""
    axis = fit.estimate.axis
    periods, cycles, torques, rates = [], [], [], []
    for trial in fit.trials:
        wave = trial.motion
        periods.append(f"{trial.period:.4g}")
        cycles.append(str(trial.cycles))
        torques.append(_peak(wave.over_one_period(wave.torque)))
        rates.append(_peak(wave.over_one_period(wave.rate)))
    return [
        numbers("period", "s", periods),
        numbers("periods used", "", cycles),
        numbers(f"peak {axis.force_name}", axis.force_unit, equal_decimals(torques, 4)),
        numbers("peak rate", axis.rate_unit, equal_decimals(rates, 3)),
    ]


def _peak(values: FloatArray) -> float:
    return float(np.max(np.abs(values)))


def _runs(fit: InertiaFit, name: str) -> dict[tuple[str, int], str]:
    """(source, how often it came before) -> reading: a log may hold more than one sine run."""
    before = Counter[str]()
    readings = {}
    for source, value, error in fit.methods[name].runs:
        readings[source, before[source]] = plus_minus(value, error)
        before[source] += 1
    return readings


def sources_table(evidence: ReportData) -> ResultTable | None:
    """Every log that the parameters or this page rest on, with its hash."""
    fitted = {source.name: source for source in evidence.parameters.sources}
    trials = _trials_by_name(evidence)
    if not fitted and not trials:
        return None
    table = TableBuilder("Logs and their SHA-256", text_column("log"), text_column("used for"), text_column("SHA-256"))
    for name, source in fitted.items():
        use = "parameters, this page" if name in trials else "parameters"
        table.add(name, use, source.sha256)
    for name, trial in trials.items():
        if name not in fitted:
            table.add(name, "this page only", _hash(trial))
    grid = table.grid()
    log, uses, digest = grid.columns
    # Mostly all are used for the same, which the page need not say of each.
    return grid if len(set(uses.cells)) > 1 else replace(grid, columns=(log, digest))


def _trials_by_name(evidence: ReportData) -> dict[str, Trial]:
    """Every trial of the logs; none where these are not there."""
    if evidence.campaign is None:
        return {}
    return {trial.name: trial for trial in evidence.campaign.trials}


def _hash(trial: Trial) -> str:
    """SHA-256 of the log, where it is a file."""
    if trial.path.is_file():
        return sha256(trial.path)
    return NOTHING
