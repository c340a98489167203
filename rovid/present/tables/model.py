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
from rovid.present.number_text import NOTHING, arm, column, like, number, steady_state, title, unit, with_unit
from rovid.present.page.report_data import Evidence
from rovid.present.plots.inertia import method_interval, method_title
from rovid.present.tables.diagnosis import ratios_of
from rovid.present.tables.table import Column, Grid, Table, numbers, of_numbers, of_text, of_unlike, words
from rovid.store.agreement import causes_in, off_by
from rovid.store.parameter_file import Entry, sha256
from rovid.trial.trial import Campaign, Trial
from rovid.trial.vehicle import Vehicle

_NORMAL = 1.959964  # two-sided 95 % of the normal distribution


def parameters_grid(evidence: Evidence) -> Grid:
    """Every parameter of the file, and those that it lacks."""
    axis, entries, guess = evidence.axis, evidence.parameters.entries, evidence.vehicle.guess
    # Parameters of different units share no decimal point.
    headings = of_text("parameter"), of_unlike("value ± standard error"), of_text("95 % interval"), of_text("found by")
    table = Table("Parameters", *headings)
    for ratio in ratios_of(evidence.parameters.together()):
        value = plus_minus(ratio.value, ratio.standard_error)
        reach = _NORMAL * ratio.standard_error
        interval = _from_to(value, (ratio.value - reach, ratio.value + reach))
        table.add(title(ratio.name), with_unit(value, ratio.unit), interval, "")
    # A dict for a set that keeps the order.
    for name in dict.fromkeys((*base_names(axis), *entries)):
        parameter = axis.words(title(name))
        entry = entries.get(name)
        if entry is None:
            table.add(parameter, "not determined", NOTHING, NOTHING)
            continue
        value = plus_minus(entry.value, entry.standard_error)
        shown = guess.marked(with_unit(value, entry.unit), entry.unit)
        interval = NOTHING if guess.marks(entry.unit) else _interval(evidence, name, value)
        table.add(parameter, shown, interval, found_by(entry))
    return table.grid()


def found_by(entry: Entry) -> str:
    """The method, with its options where there were any."""
    return f"{entry.method} ({entry.options})" if entry.options else entry.method


def _interval(evidence: Evidence, name: str, text: str) -> str:
    entry = evidence.parameters.entries[name]
    if not math.isfinite(entry.standard_error):
        return NOTHING
    estimate = estimate_behind(evidence, name)
    if estimate is not None:
        return _from_to(text, estimate.interval(name))
    reach = _NORMAL * entry.standard_error
    return _from_to(text, (entry.value - reach, entry.value + reach))


def _from_to(text: str, interval: tuple[float, float]) -> str:
    """The interval, with the decimals of ``text``."""
    low, high = interval
    return f"{like(text, low)} … {like(text, high)}"


def estimate_behind(evidence: Evidence, name: str) -> Estimate | None:
    """The estimate of this report that the file's parameter ``name`` is, if any."""
    value = evidence.parameters.entries[name].value
    for fit in (evidence.drag, evidence.inertia):
        if fit is not None and name in fit.estimate.names and math.isclose(fit.estimate.value(name), value):
            return fit.estimate
    return None


def is_behind(evidence: Evidence, estimate: Estimate) -> bool:
    """Whether any parameter of the model is that of ``estimate``."""
    return any(estimate_behind(evidence, name) is estimate for name in evidence.parameters.entries)


def beside(evidence: Evidence, estimate: Estimate) -> list[str]:
    """What ``estimate`` says beside the model's parameters, where these come of another method, a paragraph each."""
    axis, entries = evidence.axis, evidence.parameters.entries
    known = [name for name in estimate.names if name in entries and name not in estimate.refused]
    apart = [_apart(evidence, estimate, name) for name in known if estimate_behind(evidence, name) is None]
    causes = axis.words(causes_in(entries))
    why = f" It knows nothing of {causes}." if causes else ""
    said = [f"By {estimate.method}: {', '.join(apart)}.{why}"] if apart else []
    # Of what the method noticed the model knows more.
    return said if is_behind(evidence, estimate) else [*said, *estimate.warnings]


def _apart(evidence: Evidence, estimate: Estimate, name: str) -> str:
    """One parameter by another method, and how far it is from the model's."""
    entry = evidence.parameters.entries[name]
    value, error = estimate.value(name), estimate.standard_error(name)
    size = evidence.vehicle.guess.marked(with_unit(plus_minus(value, error), entry.unit), entry.unit)
    shown = f"{evidence.axis.words(title(name))} {size}"
    if abs(value - entry.value) <= _NORMAL * math.hypot(error, entry.standard_error) or entry.value == 0.0:
        return f"{shown} (as the model, within their errors)"
    return f"{shown} ({off_by(value, entry.value)})"


def thrusters_grid(vehicle: Vehicle) -> Grid:
    """What turns the vehicle, or drives it."""
    axis = vehicle.axis
    does = "turns" if axis.angular else "drives"
    headings = of_text("actuator"), of_numbers(*arm(axis)), of_text("commands on the bench"), of_text("thrust")
    table = Table(f"What {does} the vehicle", *headings)
    for thruster in vehicle.thrusters:
        curve = thruster.curve
        if curve is None:
            table.add(thruster.name, NOTHING, NOTHING, f"{axis.push} logged")
            continue
        commands = f"{curve.command[0]:g} … {curve.command[-1]:g}"
        least, most = column([curve.thrust.min(), curve.thrust.max()])
        reach = f"{'guessed ' * thruster.arm_guessed}{thruster.arm:.4g}"
        table.add(thruster.name, reach, commands, f"{'guessed ' * thruster.curve_guessed}{least} … {most} N")
    return table.grid()


def trials_grid(evidence: Evidence, campaign: Campaign) -> Grid:
    """What was measured, what it gave, and how well each trial is simulated without and with what was found."""
    trials = campaign.trials
    remarks = [" ".join(remark.text for remark in trial.remarks) or NOTHING for trial in trials]
    measured = [
        numbers("rate", "Hz", [number(1.0 / trial.period, ".3g") for trial in trials]),
        numbers("longest gap", "s", [number(_longest_gap(trial), ".2f") for trial in trials]),
        words("noticed", remarks),
    ]
    # What is the same of all trials is said once.
    shared = [column for column in measured if len(set(column.cells)) == 1]
    said = [f"{column.title} {column.cells[0].strip()} {column.unit}" for column in shared if column.unit]
    columns = [
        words("trial", [trial.name for trial in trials]),
        numbers("length", "s", [number(trial.duration, ".0f") for trial in trials]),
        words("what it gave", [_gave(evidence, trial.name) for trial in trials]),
        *(_simulated(evidence, trials) if evidence.simulations else ()),
        *(column for column in measured if column not in shared or (not column.unit and remarks[0] != NOTHING)),
    ]
    return Grid(caption=", ".join(["Trials", *said]), columns=tuple(columns))


def _simulated(evidence: Evidence, trials: Sequence[Trial]) -> Iterator[Column]:
    """R² of the rate and the position's error after a minute, once or without and with what was found."""
    axis, sides = evidence.axis, {"": evidence.after}
    names = {item.run.trial.name for item in evidence.after}
    if any(trial.name not in names for trial in trials):
        # What was diagnosed in parts is simulated as a whole by the parameter file's model alone.
        sides = {"": evidence.simulations}
    elif len(evidence.stages) > 1:
        sides = {"without: ": evidence.before, "with: ": evidence.after}
    for side, items in sides.items():
        by_name = {item.run.trial.name: item for item in items}
        chosen = [by_name.get(trial.name) for trial in trials]
        shares = [NOTHING if item is None else number(item.fit.r2, ".4f") for item in chosen]
        ahead = [None if item is None else axis.in_shown(item.position_errors.get(HORIZONS[-1])) for item in chosen]
        yield numbers(f"{side}R²", "", shares)
        yield numbers(f"{side}{axis.position_words} off after {HORIZONS[-1]:.0f} s", axis.shown[0], column(ahead, 2))


def _longest_gap(trial: Trial) -> float:
    """The longest time between two readings, s."""
    return float(np.max(np.diff(trial.time[trial.measured]), initial=0.0))


def _gave(evidence: Evidence, name: str) -> str:
    """What the trial called ``name`` served for."""
    if evidence.runs is not None and all(run.trial.name != name for run in evidence.runs.items):
        return "left out"
    texts = [*_gave_drag(evidence, name), *_gave_inertia(evidence, name)]
    if texts:
        return ", ".join(texts)
    return "regression, simulation" if evidence.simulations else "regression"


def _gave_drag(evidence: Evidence, name: str) -> Iterator[str]:
    if evidence.drag is None:
        return
    count = sum(point.source == name for point in evidence.drag.points)
    if count:
        yield _counted(count, steady_state(evidence.axis))


def _gave_inertia(evidence: Evidence, name: str) -> Iterator[str]:
    if evidence.inertia is None:
        return
    for trial in evidence.inertia.trials:
        if trial.source == name:
            yield f"{trial.cycles} periods of {trial.period:.3g} s"


def _counted(count: int, noun: str) -> str:
    return f"{count} {noun}" if count == 1 else f"{count} {noun}s"


def methods_grid(fit: InertiaFit, rigid_body: float | None, *, used: bool) -> Grid:
    """Inertia by every method."""
    its_unit = unit(fit.estimate.unit("inertia"))
    headings = [of_text("method"), of_numbers("inertia", its_unit), of_text(f"95 % interval, {its_unit}")]
    if rigid_body is not None:
        headings.append(of_numbers("over rigid body"))
    table = Table("Inertia by each method", *headings, of_text(""))
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


def sine_grid(fit: InertiaFit) -> Grid:
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
    its_unit = unit(fit.estimate.unit("inertia"))
    for name, runs in readings.items():
        cells = [runs.get(key, NOTHING) for key in keys]
        columns.append(numbers(method_title(name), its_unit, cells))
    return Grid(caption="Inertia from each sine run", columns=tuple(columns))


def _sine_columns(fit: InertiaFit) -> list[Column]:
    """Period, cycles and peaks of each sine run."""
    axis = fit.estimate.axis
    periods, cycles, torques, rates = [], [], [], []
    for trial in fit.trials:
        wave = trial.wave
        periods.append(f"{trial.period:.4g}")
        cycles.append(str(trial.cycles))
        torques.append(_peak(wave.over_one_period(wave.torque)))
        rates.append(_peak(wave.over_one_period(wave.rate)))
    return [
        numbers("period", "s", periods),
        numbers("periods used", "", cycles),
        numbers(f"peak {axis.push}", axis.push_unit, column(torques, 4)),
        numbers("peak rate", axis.rate_unit, column(rates, 3)),
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


def sources_grid(evidence: Evidence) -> Grid | None:
    """Every log that the parameters or this page rest on, with its hash."""
    fitted = {source.name: source for source in evidence.parameters.sources}
    trials = _trials_by_name(evidence)
    if not fitted and not trials:
        return None
    table = Table("Logs and their SHA-256", of_text("log"), of_text("used for"), of_text("SHA-256"))
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


def _trials_by_name(evidence: Evidence) -> dict[str, Trial]:
    """Every trial of the logs; none where these are not there."""
    if evidence.campaign is None:
        return {}
    return {trial.name: trial for trial in evidence.campaign.trials}


def _hash(trial: Trial) -> str:
    """SHA-256 of the log, where it is a file."""
    if trial.path.is_file():
        return sha256(trial.path)
    return NOTHING
