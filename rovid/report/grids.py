"""The page's tables, as text: each function takes evidence and returns a captioned grid."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Sequence

import numpy as np

from rovid.campaign.trial import Campaign, Trial
from rovid.campaign.vehicle import Vehicle
from rovid.ground.arrays import FloatArray
from rovid.ground.numbers import plus_minus
from rovid.identify.estimate import Estimate, Ratio
from rovid.identify.inertia import METHODS, InertiaFit
from rovid.model.names import base_names, unit_of
from rovid.model.simulation import HORIZONS, TrialSimulation, overall
from rovid.parameters.agreement import causes_in, off_by
from rovid.parameters.parameters import Entry, sha256
from rovid.report.evidence import Evidence
from rovid.report.plots.inertia import method_interval, method_title
from rovid.report.table import Column, Grid, Table, numbers, of_numbers, of_text, of_unlike, words
from rovid.report.text import NOTHING, arm, column, like, number, positions, steady_state, title, unit

_RATIOS = {
    "inertia/quadratic_drag": "inertia over quadratic drag I/DQ",
    "inertia/linear_drag": "time constant at rest I/DL",
    "linear_drag/quadratic_drag": "linear over quadratic drag DL/DQ",
}
_NORMAL = 1.959964  # two-sided 95 % of the normal distribution


def parameters_grid(evidence: Evidence) -> Grid:
    """Every parameter of the file, and those that it lacks."""
    axis, entries = evidence.axis, evidence.parameters.entries
    # Parameters of different units share no decimal point.
    headings = of_text("parameter"), of_unlike("value"), of_text("unit"), of_text("95 % interval"), of_text("found by")
    table = Table("Parameters: value ± standard error", *headings)
    for ratio in _ratios(evidence):
        value = plus_minus(ratio.value, ratio.standard_error)
        reach = _NORMAL * ratio.standard_error
        table.add(
            _RATIOS[ratio.name], value, ratio.unit, _from_to(value, (ratio.value - reach, ratio.value + reach)), ""
        )
    # A dict for a set that keeps the order.
    for name in dict.fromkeys((*base_names(axis), *entries)):
        parameter = axis.words(title(name))
        entry = entries.get(name)
        if entry is None:
            its_unit = unit(unit_of(name, axis))
            table.add(parameter, "not determined", its_unit, NOTHING, NOTHING)
            continue
        value = plus_minus(entry.value, entry.standard_error)
        if evidence.vehicle.guess.marks(entry.unit):
            table.add(parameter, f"guessed {value}", unit(entry.unit), NOTHING, _found_by(entry))
        else:
            table.add(parameter, value, unit(entry.unit), _interval(evidence, name, value), _found_by(entry))
    return table.grid()


def _found_by(entry: Entry) -> str:
    return f"{entry.method} ({entry.options})" if entry.options else entry.method


def _ratios(evidence: Evidence) -> tuple[Ratio, ...]:
    """What stands in the place of placeholders: what does not hang on what is guessed."""
    guess = evidence.vehicle.guess
    return evidence.parameters.together().ratios if guess and guess.ratios_hold else ()


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
    shown = f"{evidence.axis.words(title(name))} {plus_minus(value, error)} {unit(entry.unit)}"
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
    """What was measured."""
    table = Table(
        "Trials",
        of_text("trial"),
        of_numbers("length", "s"),
        of_numbers(positions(evidence.axis)),
        of_numbers("rate", "Hz"),
        of_numbers("longest gap", "s"),
        of_text("what it gave"),
        of_text("noticed by the reader"),
    )
    for trial in campaign.trials:
        length = number(trial.duration, ".0f")
        rate = number(1.0 / trial.period, ".3g")
        gap = number(_longest_gap(trial), ".2f")
        noticed = " ".join(remark.text for remark in trial.remarks) or NOTHING
        table.add(trial.name, length, _readings(trial), rate, gap, _gave(evidence, trial.name), noticed)
    return table.grid()


def _readings(trial: Trial) -> str:
    """How many readings there are."""
    return str(int(trial.measured.sum()))


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


def simulation_grid(simulations: Sequence[TrialSimulation]) -> Grid:
    """How well each trial is simulated, and all together."""
    axis = simulations[0].run.trial.axis
    names, fits = [item.run.trial.name for item in simulations], [item.fit for item in simulations]
    names.append("all together")
    fits.append(overall(simulations))
    samples, shares, percents, errors = [], [], [], []
    for fit in fits:
        samples.append(str(fit.samples))
        shares.append(number(fit.r2, ".4f"))
        percents.append(number(fit.fit_percent, ".1f"))
        errors.append(fit.rmse)
    columns = [
        words("trial", names),
        numbers("samples", "", samples),
        numbers("R²", "", shares),
        numbers("fit", "%", percents),
        numbers("rate RMSE", axis.rate_unit, column(errors, 2)),
    ]
    for horizon in HORIZONS:
        ahead = [axis.in_shown(item.position_errors.get(horizon)) for item in simulations]
        cells = column([*ahead, typical_position_error(simulations, horizon)], 2)
        columns.append(numbers(f"{axis.position_words} after {horizon:.0f} s", axis.shown[0], cells))
    return Grid(caption="Free-running simulation against measurement", columns=tuple(columns), total=True)


def typical_position_error(simulations: Sequence[TrialSimulation], horizon: float) -> float | None:
    """Median over the trials in deg or m; None where no trial is long enough."""
    errors = [item.position_errors.get(horizon) for item in simulations]
    known = [error for error in errors if error is not None]
    if not known:
        return None
    return simulations[0].run.trial.axis.in_shown(float(np.median(known)))


def sources_grid(evidence: Evidence) -> Grid | None:
    """Every log that the parameters or this page rest on, with its hash."""
    fitted = {source.name: source for source in evidence.parameters.sources}
    trials = _trials_by_name(evidence)
    if not fitted and not trials:
        return None
    headings = of_text("log"), of_numbers(positions(evidence.axis)), of_text("used for"), of_text("SHA-256")
    table = Table("Logs and their SHA-256", *headings)
    for name, source in fitted.items():
        use = "parameters, this page" if name in trials else "parameters"
        table.add(name, str(source.samples), use, source.sha256)
    for name, trial in trials.items():
        if name not in fitted:
            table.add(name, _readings(trial), "this page only", _hash(trial))
    return table.grid()


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
