"""The page's tables, as text: each function takes evidence and returns a captioned grid."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from rovid.campaign.axis import Axis
from rovid.campaign.trial import Campaign, Trial
from rovid.campaign.vehicle import Vehicle
from rovid.ground.numbers import plus_minus
from rovid.identify.estimate import Estimate
from rovid.identify.inertia import METHODS, InertiaFit
from rovid.identify.steady import DragFit
from rovid.identify.steady_points import SteadyPoint
from rovid.model.names import base_names, unit_of
from rovid.model.simulation import HORIZONS, TrialSimulation, overall
from rovid.parameters.parameters import sha256
from rovid.report.evidence import Evidence
from rovid.report.plots.inertia import method_interval, method_title
from rovid.report.text import NOTHING, aligned, arm, column, like, number, positions, steady_state, title, unit

_NORMAL = 1.959964  # two-sided 95 % of the normal distribution
_DIRECTIONS = {"up": "growing", "down": "falling"}


@dataclass(frozen=True, kw_only=True)
class Column:
    """A heading, the unit under it, and whether numbers stand below, which are aligned at their points."""

    title: str
    unit: str = ""
    cells: tuple[str, ...]
    numeric: bool = True


@dataclass(frozen=True, kw_only=True)
class Grid:
    """A captioned table; the last row is a total where ``total``."""

    caption: str
    columns: tuple[Column, ...]
    total: bool = False

    @property
    def rows(self) -> list[tuple[tuple[Column, str], ...]]:
        """Row by row, each cell with its column."""
        return [
            tuple(zip(self.columns, row, strict=True)) for row in zip(*(c.cells for c in self.columns), strict=True)
        ]


def words(heading: str, cells: Iterable[str]) -> Column:
    """A column of text."""
    return Column(title=heading, cells=tuple(cells), numeric=False)


def numbers(heading: str, unit_text: str, cells: Sequence[str]) -> Column:
    """A column of numbers that are already rounded."""
    return Column(title=heading, unit=unit_text, cells=tuple(aligned(cells)))


def parameters_grid(evidence: Evidence) -> Grid:
    """Every parameter of the file, and those that it lacks."""
    entries = evidence.parameters.entries
    base = base_names(evidence.axis)
    names = [*base, *(name for name in entries if name not in base)]
    values = {name: plus_minus(entries[name].value, entries[name].standard_error) for name in entries}
    return Grid(
        caption="Parameters: value ± standard error",
        columns=(
            words("parameter", [evidence.axis.words(title(name)) for name in names]),
            # Parameters of different units share no decimal point.
            Column(title="value", cells=tuple(values.get(name, "not determined") for name in names)),
            words(
                "unit",
                [unit(entries[name].unit if name in entries else unit_of(name, evidence.axis)) for name in names],
            ),
            words("95 % interval", [_interval(evidence, name, values.get(name, "")) for name in names]),
            words("found by", [entries[name].method if name in entries else NOTHING for name in names]),
        ),
    )


def _interval(evidence: Evidence, name: str, text: str) -> str:
    entry = evidence.parameters.entries.get(name)
    if entry is None or not math.isfinite(entry.standard_error):
        return NOTHING
    estimate = estimate_behind(evidence, name)
    reach = _NORMAL * entry.standard_error
    low, high = (entry.value - reach, entry.value + reach) if estimate is None else estimate.interval(name)
    return f"{like(text, low)} … {like(text, high)}"


def estimate_behind(evidence: Evidence, name: str) -> Estimate | None:
    """The estimate of this report that the file's parameter ``name`` is, if any."""
    value = evidence.parameters.entries[name].value
    for fit in (evidence.drag, evidence.inertia):
        if fit is not None and name in fit.estimate.names and math.isclose(fit.estimate.value(name), value):
            return fit.estimate
    return None


def thrusters_grid(vehicle: Vehicle) -> Grid:
    """What turns the vehicle, or drives it."""
    curves = [thruster.curve for thruster in vehicle.thrusters]
    name, its_unit = arm(vehicle.axis)
    return Grid(
        caption=f"What {'turns' if vehicle.axis.angular else 'drives'} the vehicle",
        columns=(
            words("actuator", [thruster.name for thruster in vehicle.thrusters]),
            numbers(name, its_unit, [f"{t.arm:.4g}" if t.curve else NOTHING for t in vehicle.thrusters]),
            words("commands on the bench", [f"{c.command[0]:g} … {c.command[-1]:g}" if c else NOTHING for c in curves]),
            words(
                "thrust",
                [
                    " … ".join(column([c.thrust.min(), c.thrust.max()])) + " N" if c else f"{vehicle.axis.push} logged"
                    for c in curves
                ],
            ),
        ),
    )


def trials_grid(evidence: Evidence, campaign: Campaign) -> Grid:
    """What was measured."""
    trials = campaign.trials
    return Grid(
        caption="Trials",
        columns=(
            words("trial", [trial.name for trial in trials]),
            numbers("length", "s", [number(trial.duration, ".0f") for trial in trials]),
            numbers(positions(evidence.axis), "", [str(int(trial.measured.sum())) for trial in trials]),
            numbers("rate", "Hz", [number(1.0 / trial.period, ".3g") for trial in trials]),
            numbers("longest gap", "s", [number(_longest_gap(trial), ".2f") for trial in trials]),
            words("what it gave", [_gave(evidence, trial.name) for trial in trials]),
            words("noticed by the reader", [" ".join(r.text for r in trial.remarks) or NOTHING for trial in trials]),
        ),
    )


def _longest_gap(trial: Trial) -> float:
    return float(np.max(np.diff(trial.time[trial.measured]), initial=0.0))


def _gave(evidence: Evidence, name: str) -> str:
    texts = []
    if evidence.drag is not None:
        points = sum(point.source == name for point in evidence.drag.points)
        texts += [_counted(points, steady_state(evidence.axis))] if points else []
    if evidence.inertia is not None:
        sines = [trial for trial in evidence.inertia.trials if trial.source == name]
        texts += [f"{trial.cycles} periods of {trial.period:.3g} s" for trial in sines]
    if evidence.runs is not None and all(run.trial.name != name for run in evidence.runs.items):
        return "left out"
    return ", ".join(texts) or ("regression, simulation" if evidence.simulations else "regression")


def _counted(count: int, noun: str) -> str:
    return f"{count} {noun}" if count == 1 else f"{count} {noun}s"


def steady_grid(fit: DragFit) -> Grid:
    """Steady states with residuals and leave-one-out."""
    points, known, axis = fit.points, bool(np.any(fit.torque_error != 1.0)), fit.estimate.axis
    quadratic, linear = _drag_units(axis)
    columns = [
        *_point_columns(points),
        numbers(axis.push, axis.push_unit, [number(point.torque, ".2f") for point in points]),
        numbers(axis.rate_words, axis.rate_unit, [_rate(point) for point in points]),
        numbers("residual", axis.push_unit, _with_errors(fit.residuals, fit.torque_error if known else None)),
        numbers("without it: DQ", quadratic, column([*fit.left_out[:, 0]], 4)),
        numbers("DL", linear, column([*fit.left_out[:, 1]], 4)),
        numbers("predicted off by", axis.push_unit, [number(value, ".2f") for value in fit.left_out[:, 2]]),
    ]
    return Grid(caption=f"{steady_state(axis).capitalize()}s that were fitted", columns=tuple(columns))


def _drag_units(axis: Axis) -> tuple[str, str]:
    quadratic, linear = (unit(unit_of(name, axis)) for name in ("quadratic_drag", "linear_drag"))
    return quadratic, linear


def _with_errors(values: Sequence[float] | np.ndarray[tuple[int], np.dtype[np.float64]], errors: object) -> list[str]:
    if errors is None:
        return [number(value, ".2f") for value in values]
    return [f"{value:.2f} ± {error:.2f}" for value, error in zip(values, np.asarray(errors), strict=True)]


def _rate(point: SteadyPoint) -> str:
    if math.isfinite(point.rate_error):
        return plus_minus(point.rate, point.rate_error)
    return f"{point.rate:.4g}"


def _point_columns(points: Sequence[SteadyPoint]) -> list[Column]:
    columns = [words("source", [point.source for point in points])]
    if any(math.isfinite(point.start) for point in points):
        columns.append(words("from … to, s", [f"{point.start:.0f} … {point.stop:.0f}" for point in points]))
    if any(np.isfinite(point.command).any() for point in points):
        columns.append(words("command", ["; ".join(f"{value:.4g}" for value in point.command) for point in points]))
    return columns


def unsteady_grid(fit: DragFit) -> Grid:
    """Held commands that were not fitted."""
    points, axis = fit.unsteady, fit.estimate.axis
    return Grid(
        caption="Held commands left out, because the rate was still changing",
        columns=(
            *_point_columns(points),
            numbers(axis.push, axis.push_unit, [number(point.torque, ".2f") for point in points]),
            numbers("mean rate", axis.rate_unit, [number(point.rate, ".4f") for point in points]),
            numbers(
                "change over it",
                axis.rate_unit,
                [plus_minus(point.drift, point.drift_error) for point in points],
            ),
        ),
    )


def directions_grid(fit: DragFit) -> Grid:
    """Drag of each direction alone beside that of both."""
    axis = fit.estimate.axis
    quadratic, linear = _drag_units(axis)
    rows = {"both": fit.estimate} | {
        f"{axis.position_words} {_DIRECTIONS.get(name, name)}": each for name, each in fit.directions.items()
    }
    return Grid(
        caption="Drag from each direction alone",
        columns=(
            words("turns" if axis.angular else "direction", rows),
            numbers(f"{steady_state(axis)}s", "", [str(each.samples) for each in rows.values()]),
            numbers("DQ", quadratic, [_of(each, "quadratic_drag") for each in rows.values()]),
            numbers("DL", linear, [_of(each, "linear_drag") for each in rows.values()]),
        ),
    )


def _of(estimate: Estimate, name: str) -> str:
    return NOTHING if name in estimate.refused else plus_minus(estimate.value(name), estimate.standard_error(name))


def methods_grid(fit: InertiaFit, rigid_body: float | None) -> Grid:
    """Inertia by every method."""
    readings = {name: fit.methods[name] for name in METHODS if name in fit.methods}
    texts = [plus_minus(each.value, each.standard_error) for each in readings.values()]
    intervals = [method_interval(fit, name) for name in readings]
    its_unit = unit(fit.estimate.unit("inertia"))
    columns = [
        words("method", [METHODS[name] for name in readings]),
        numbers("inertia", its_unit, texts),
        words(
            f"95 % interval, {its_unit}",
            [
                NOTHING if ends is None else f"{like(text, ends[0])} … {like(text, ends[1])}"
                for text, ends in zip(texts, intervals, strict=True)
            ],
        ),
    ]
    if rigid_body is not None:
        columns.append(numbers("over rigid body", "", [f"{r.value / rigid_body:.3f}" for r in readings.values()]))
    columns.append(words("", [_remark(fit, name) for name in readings]))
    return Grid(caption="Inertia by each method", columns=tuple(columns))


def _remark(fit: InertiaFit, name: str) -> str:
    if name == fit.chosen:
        return "used"
    if name == "peak" and fit.peak_bias is not None:
        return f"biased: {100.0 * fit.peak_bias:.0f} % of the true inertia on the model's own motion"
    return "biased" if name == "peak" else "for comparison"


def sine_grid(fit: InertiaFit) -> Grid:
    """Each sine run, and what each method reads from it."""
    axis = fit.estimate.axis
    names = [name for name in METHODS if name in fit.methods and fit.methods[name].runs]
    keys = list(dict.fromkeys(key for name in names for key in _runs(fit, name)))
    columns = [words("sine run", [source for source, _ in keys])]
    if len(fit.trials) == len(keys):
        waves = [trial.wave for trial in fit.trials]
        peaks = [[float(np.max(np.abs(w.over_one_period(a)))) for a in (w.torque, w.rate)] for w in waves]
        columns += [
            numbers("period", "s", [f"{trial.period:.4g}" for trial in fit.trials]),
            numbers("periods used", "", [str(trial.cycles) for trial in fit.trials]),
            numbers(f"peak {axis.push}", axis.push_unit, column([torque for torque, _ in peaks], 4)),
            numbers("peak rate", axis.rate_unit, column([rate for _, rate in peaks], 3)),
        ]
    its_unit = unit(fit.estimate.unit("inertia"))
    columns += [numbers(method_title(n), its_unit, [_runs(fit, n).get(key, NOTHING) for key in keys]) for n in names]
    return Grid(caption="Inertia from each sine run", columns=tuple(columns))


def _runs(fit: InertiaFit, name: str) -> dict[tuple[str, int], str]:
    """(source, how often it came before) -> reading: a log may hold more than one sine run."""
    found: dict[tuple[str, int], str] = {}
    for source, value, error in fit.methods[name].runs:
        repeat = sum(source == other for other, _ in found)
        found[source, repeat] = plus_minus(value, error)
    return found


def simulation_grid(simulations: Sequence[TrialSimulation]) -> Grid:
    """How well each trial is simulated, and all together."""
    total, axis = overall(simulations), simulations[0].run.trial.axis
    fits = [*(item.fit for item in simulations), total]
    columns = [
        words("trial", [*(item.run.trial.name for item in simulations), "all together"]),
        numbers("samples", "", [str(fit.samples) for fit in fits]),
        numbers("R²", "", [number(fit.r2, ".4f") for fit in fits]),
        numbers("fit", "%", [number(fit.fit_percent, ".1f") for fit in fits]),
        numbers("rate RMSE", axis.rate_unit, column([fit.rmse for fit in fits], 2)),
    ]
    for horizon in HORIZONS:
        errors = [axis.in_shown(item.position_errors.get(horizon)) for item in simulations]
        cells = column([*errors, typical_position_error(simulations, horizon)], 2)
        columns.append(numbers(f"{axis.position_words} after {horizon:.0f} s", axis.shown[0], cells))
    return Grid(caption="Free-running simulation against measurement", columns=tuple(columns), total=True)


def typical_position_error(simulations: Sequence[TrialSimulation], horizon: float) -> float | None:
    """Median over the trials in deg or m; None where no trial is long enough."""
    known = [error for item in simulations if (error := item.position_errors.get(horizon)) is not None]
    return simulations[0].run.trial.axis.in_shown(float(np.median(known))) if known else None


def sources_grid(evidence: Evidence) -> Grid | None:
    """Every log that the parameters or this page rest on, with its hash."""
    fitted = {source.name: source for source in evidence.parameters.sources}
    trials = {} if evidence.campaign is None else {trial.name: trial for trial in evidence.campaign.trials}
    names = [*fitted, *(name for name in trials if name not in fitted)]
    if not names:
        return None
    uses = {(True, True): "parameters, this page", (True, False): "parameters", (False, True): "this page only"}
    return Grid(
        caption="Logs and their SHA-256",
        columns=(
            words("log", names),
            numbers(
                positions(evidence.axis), "", [_count(fitted[n].samples if n in fitted else trials[n]) for n in names]
            ),
            words("used for", [uses[n in fitted, n in trials] for n in names]),
            words("SHA-256", [fitted[n].sha256 if n in fitted else _hash(trials[n]) for n in names]),
        ),
    )


def _count(samples: int | Trial) -> str:
    return str(samples if isinstance(samples, int) else int(samples.measured.sum()))


def _hash(trial: Trial) -> str:
    return sha256(trial.path) if trial.path.is_file() else NOTHING
