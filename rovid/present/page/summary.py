"""The first screen of the page, with the error, its causes, the improvement and the next run; data of its viewer.

The viewer reads every trial as tables of float32 in base64, at several levels of detail, so that any part of it is
drawn quickly. Lowest and highest values of each stretch are kept.
"""

import base64
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rovid.core.array_types import FloatArray
from rovid.core.formatting import plus_minus
from rovid.diagnose.result import Diagnosis, Finding, delays_of_the_sensor, next_experiment
from rovid.model.parameter_names import unit_of
from rovid.model.simulation import HORIZONS, TrialSimulation, simulation_errors
from rovid.present import sentences
from rovid.present.number_format import equal_decimals, number_with_unit, rounded_errors
from rovid.present.plots.canvas import min_max_indices
from rovid.present.report_data import ReportData, effects_of, worst_first
from rovid.trial.assumptions import Assumptions
from rovid.trial.axis import Axis
from rovid.trial.rates import resample

# Detection limits in the sentence on a diagnosis without causes, and units in which a limit means little to a reader.
_LIMITS_SHOWN, _OBSCURE_UNITS = 3, ("1", "command")


@dataclass(frozen=True, kw_only=True)
class Reason:
    """A cause: its name, its size, its evidence in words, and whether a guess may explain it."""

    title: str
    size: str
    sure: str
    may_be_guess: bool = False


class Bar(NamedTuple):
    """A labelled value, and its length relative to the longest bar; ``look`` is its class in the style."""

    label: str
    look: str
    value: str
    share: float


@dataclass(frozen=True, kw_only=True)
class ErrorBars:
    """An error in the unit of display: without the causes, with them, and of a perfect model; NaN where not known."""

    title: str
    unit: str
    without: float
    with_causes: float
    perfect: float
    found: bool  #: Whether the model with the causes has a bar.

    @property
    def texts(self) -> list[str]:
        """The three errors with decimals that show the smallest to two significant digits, and the unit."""
        return [f"{text} {self.unit}" for text in rounded_errors((self.without, self.with_causes, self.perfect))]

    @property
    def bars(self) -> list[Bar]:
        """Bars of the errors."""
        without, with_causes, _ = self.texts
        if not self.found:
            return [Bar("simulated", "simulated", without, self._share(self.without))]
        plain = Bar("plain model", "without", without, self._share(self.without))
        return [plain, Bar("extended model", "with", with_causes, self._share(self.with_causes))]

    @property
    def floor(self) -> str:
        """The noise floor; empty where it is not known."""
        return self.texts[2] if math.isfinite(self.perfect) else ""

    @property
    def tick(self) -> float:
        """The noise floor relative to the longest bar."""
        return self._share(self.perfect)

    def _share(self, value: float) -> float:
        known = filter(math.isfinite, (self.without, self.with_causes, self.perfect))
        return value / max(*known, 1e-30, 0.0) if math.isfinite(value) else 0.0


@dataclass(frozen=True, kw_only=True)
class PageSummary:
    """The first screen, in words and bars."""

    headline: str
    error: str
    reasons: tuple[Reason, ...]
    no_cause: str
    gains: tuple[ErrorBars, ...]
    improvement: str
    next_step: sentences.NextStep
    models: str  #: What the plain and the extended model are; empty where they are not mentioned.
    cautions: tuple[str, ...]


def summarize(report: ReportData) -> PageSummary:
    """The contents of the first screen."""
    diagnosis = report.diagnosis
    found = diagnosis is not None and bool(diagnosis.findings or diagnosis.signals)
    errors = tuple(_errors(report, found=found))
    changes = {error.title.partition(" after")[0]: (error.without, error.with_causes) for error in errors}
    reason = "it finds what the simulation misses, and why"
    step = sentences.NextStep(run="diagnosis, by `rovid diagnose`", reason=reason)
    warned, headline, models = list[str](), "There is no simulation to judge the model by.", ""
    if report.simulations:
        r2 = simulation_errors(report.simulations).r2
        headline = f"The model explains R² = {r2:.4f} of the {report.axis.rate_words}."
    if diagnosis is not None:
        headline = sentences.verdict_sentence(diagnosis, report.vehicle.assumptions)
        models = f"{sentences.PLAIN_MODEL} {sentences.EXTENDED_MODEL}" if report.extended else sentences.PLAIN_MODEL
        plan = sentences.plan_command(report.parameters.path, report.axis)
        step = sentences.next_step(diagnosis, next_experiment(diagnosis), report.vehicle.assumptions, plan)
        warned = list(sentences.cautions(diagnosis, report.trials, report.vehicle))
    return PageSummary(
        headline=headline,
        error=_error_sentence(report, errors),
        reasons=() if diagnosis is None else tuple(_reasons(diagnosis, report)),
        no_cause=_no_cause_sentence(report),
        gains=errors,
        improvement=f"On trials that were not fitted: {sentences.improvement_words(changes)}." if found else "",
        next_step=step,
        models=models,
        cautions=tuple(warned),
    )


def _errors(report: ReportData, *, found: bool) -> Iterator[ErrorBars]:
    """Errors of position and rate: of held-out trials, or of all trials where there is no diagnosis."""
    axis, diagnosis = report.axis, report.diagnosis
    floors, floor = {}, math.nan
    if diagnosis is not None and diagnosis.base is not None and diagnosis.extended is not None:
        one, other = diagnosis.base.held_out, diagnosis.extended.held_out
        positions, rates = (one.position_errors, other.position_errors), (one.rate_rmse, other.rate_rmse)
        floors, floor = dict(diagnosis.position_floors), diagnosis.noise_floor
    elif report.simulations:
        plain = simulation_errors(report.simulations)
        positions, rates = (plain.position, plain.position), (plain.rate, plain.rate)
    else:
        return
    unit, factor = axis.display_unit
    # The longest horizon at which both errors are known.
    for horizon in reversed(HORIZONS):
        without, with_causes = (errors.get(horizon) for errors in positions)
        if without is not None and with_causes is not None:
            yield ErrorBars(
                title=f"{axis.position_words} error after {horizon:.0f} s",
                unit=unit,
                without=factor * without,
                with_causes=factor * with_causes,
                perfect=factor * floors.get(horizon, math.nan),
                found=found,
            )
            break
    title, unit, (without, full) = f"{axis.rate_words} error", axis.rate_unit, rates
    yield ErrorBars(title=title, unit=unit, without=without, with_causes=full, perfect=floor, found=found)


def _error_sentence(report: ReportData, errors: Sequence[ErrorBars]) -> str:
    if not errors:
        missing = "there are tables, no logs" if report.campaign is None else "inertia or drag is missing"
        return f"Nothing was simulated: {missing}."
    error = errors[0]
    size, _, floor = error.texts
    quantity, _, when = error.title.partition(" error")
    sentence = f"The simulated {quantity} is {size} off{when or ', root mean square'}."
    if error.found or not error.floor:
        return sentence
    return f"{sentence} A perfect model's would be {floor} off."


def _reasons(diagnosis: Diagnosis, report: ReportData) -> Iterator[Reason]:
    axis, trials = report.axis, report.trials
    for finding in diagnosis.causes:
        of_sensor = "; or the sensor lags" if delays_of_the_sensor(trials, (finding,)) else ""
        names = [sentences.effect_title(effect, axis) for effect in (finding.effect, *finding.indistinguishable)]
        yield Reason(
            title=sentences.join_words(names, "or"),
            size=size_words(finding),
            sure=f"{sentences.evidence_words(finding)}{of_sensor}",
            may_be_guess=bool(finding.estimate.assumptions.effect_caveat(finding.effect.id)),
        )
    for signal, _ in diagnosis.signals:
        yield Reason(title=axis.reword(signal.title), size="", sure="a dependence without a known cause")


def size_words(finding: Finding) -> str:
    """The parameters of a cause, each with its error and unit."""
    effect, estimate = finding.effect, finding.estimate
    sizes = []
    for parameter in effect.parameters:
        name = f"{effect.key}.{parameter.name}"
        unit, value = estimate.unit(name), plus_minus(estimate.value(name), estimate.standard_error(name))
        words = estimate.axis.reword(parameter.name.replace("_", " "))
        sizes.append(f"{words} {estimate.assumptions.mark_number(number_with_unit(value, unit), unit)}")
    return ", ".join(sizes)


def _no_cause_sentence(report: ReportData) -> str:
    """Why no cause is named; empty where one is."""
    diagnosis = report.diagnosis
    if diagnosis is None:
        return report.diagnosis_refusal or "No diagnosis was made (--no-diagnosis)."
    if diagnosis.missing:
        return diagnosis.missing
    if diagnosis.is_cut_short and not diagnosis.causes:
        return sentences.CUT_SHORT
    if diagnosis.verdict == "unexplained":
        return "No effect of the catalogue explains the remaining error, and it follows no logged signal."
    if diagnosis.verdict != "nothing_found":
        return ""
    # Causes with the smallest sizes that would have been found, in units that need no explanation.
    axis, limits = report.axis, []
    for effect, size in diagnosis.detectable:
        unit = unit_of(f"{effect.key}.{effect.parameters[0].name}", axis)
        if math.isfinite(size) and unit not in _OBSCURE_UNITS:
            (text,) = equal_decimals([size], 2)
            shown = report.vehicle.assumptions.mark_number(number_with_unit(text, unit), unit)
            limits.append(f"{axis.reword(effect.title)} from {shown}")
    sentence = "Every cause was tried and none was needed."
    if limits:
        sentence += f" These would have shown: {sentences.join_words(limits[:_LIMITS_SHOWN])}."
    return sentence


# Numbers of all trials together. In text each takes 5.4 bytes, which leaves 0.8 of 3 MB to the pictures.
VALUES = 400_000
# Rows of the coarsest level, two for each pixel of a wide screen, and ratio of the rows of successive levels.
COARSEST, _STEP = 4_000, 4
# Columns of a table after time; then rate and position error of each simulation.
_TORQUE, _MEASURED, _POSITION, _FIRST_SIMULATION, _COLUMNS_EACH = 1, 2, 3, 4, 2


@dataclass(frozen=True, kw_only=True, eq=False)
class TrialLevels:
    """Tables of one trial, (columns, rows) in float32, the finest first; ``samples`` is the number of samples."""

    name: str
    samples: int
    levels: tuple[NDArray[np.float32], ...]


def viewer_document(report: ReportData) -> dict[str, Any]:
    """The data that the viewer's script reads."""
    axis = report.axis
    simulations = [nested.simulations for nested in report.nested] or [report.simulations]
    order = worst_first(simulations[0])
    sides = [[side[number] for number in order] for side in simulations]
    trials = []
    for trial, items in zip(trial_levels(sides), zip(*sides, strict=True), strict=True):
        missed = [_errors_document(axis, [item]) for item in items]
        # The table's bytes, column after column, in base64.
        tables = [base64.b64encode(level.tobytes()).decode() for level in trial.levels]
        levels = [{"rows": level.shape[1], "data": data} for level, data in zip(trial.levels, tables, strict=True)]
        trials.append({"name": trial.name, "samples": trial.samples, "levels": levels, "missed": missed})
    every = [_errors_document(axis, side) for side in simulations]
    measures = []
    for measure, numbers in zip(_measures(report), zip(*every, strict=True), strict=True):
        texts = rounded_errors((measure["floor"], *numbers))  # as on the first screen
        measures.append(measure | {"decimals": max(len(text.partition(".")[2]) for text in texts)})
    causes = effects_of(report.nested)
    keys = [{effect.key for effect in nested.model.effects} for nested in report.nested]
    return {
        "panels": _panels(axis, report.vehicle.assumptions, is_driven=any(item.run.torque.any() for item in sides[0])),
        "measures": measures,
        "causes": [sentences.effect_title(effect, axis) for effect in causes],
        # Which causes each simulation has.
        "stages": [[effect.key in present for effect in causes] for present in keys] or [[]],
        "missed": every,
        "trials": trials,
    }


def _measures(report: ReportData) -> Iterator[dict[str, Any]]:
    """Title, unit and noise floor of each number of `_errors_document`."""
    axis, floors, floor = report.axis, dict[float, float](), None
    if report.diagnosis:
        floors, floor = dict(report.diagnosis.position_floors), report.diagnosis.noise_floor
    for horizon in HORIZONS:
        title = f"{axis.position_words} error after {horizon:.0f}\u00a0s"
        yield {"title": title, "unit": axis.display_unit[0], "floor": _rounded(axis.to_display(floors.get(horizon)))}
    yield {"title": f"{axis.rate_words} error", "unit": axis.rate_unit, "floor": _rounded(floor)}


def _errors_document(axis: Axis, simulations: Sequence[TrialSimulation]) -> list[float | None]:
    errors = simulation_errors(simulations)
    positions = [axis.to_display(errors.position[horizon]) for horizon in HORIZONS]
    return list(map(_rounded, (*positions, errors.rate)))


def _rounded(value: float | None) -> float | None:
    """``value`` to four significant digits; None where it is not finite, as JSON requires."""
    if value is None or not math.isfinite(value):
        return None
    return float(f"{value:.4g}")


def trial_levels(stages: Sequence[Sequence[TrialSimulation]], *, values: int | None = None) -> list[TrialLevels]:
    """Every trial within a budget of ``values`` numbers, ``VALUES`` if None; short trials keep all rows.

    Each of ``stages`` has all trials in the same order.
    """
    tables = list(map(_table, zip(*stages, strict=True)))
    if not tables:
        return []
    budget = VALUES if values is None else values
    # The coarser levels of a trial take at most a third of the finest.
    rows = budget * (_STEP - 1) // (_STEP * len(tables[0]))
    granted = fair_shares([table.shape[1] for table in tables], rows)
    trials = []
    for item, table, count in zip(stages[0], tables, granted, strict=True):
        levels = [decimate_table(table, count)]
        while levels[-1].shape[1] > COARSEST:
            levels.append(decimate_table(levels[-1], levels[-1].shape[1] // _STEP))
        kept = tuple(level.astype("<f4") for level in levels)
        trials.append(TrialLevels(name=item.run.trial.name, samples=table.shape[1], levels=kept))
    return trials


def fair_shares(wanted: Sequence[int], budget: int) -> list[int]:
    """Shares of ``budget``: at most what each wants, and at least as much as any other that is not satisfied."""
    granted, left = [0] * len(wanted), budget
    smallest_first = sorted(range(len(wanted)), key=wanted.__getitem__)
    for rank, index in enumerate(smallest_first):
        granted[index] = min(wanted[index], left // (len(wanted) - rank))
        left -= granted[index]
    return granted


def decimate_table(table: FloatArray, count: int) -> FloatArray:
    """At most ``count`` rows of (columns, rows) with the lowest and highest of each stretch of every drawn signal.

    First and last row stay. A stretch without values keeps one row, so gaps remain visible.
    """
    total, size = table.shape[1], 1
    # The viewer itself subtracts the measured rate from each simulated one.
    errors = [rate - table[_MEASURED] for rate in table[_FIRST_SIMULATION::_COLUMNS_EACH]]
    rows = np.arange(total)
    while len(rows) > count and size < total:
        size = max(size + 1, size * len(rows) // count)
        picked = [min_max_indices(values, size) for values in (*table[1:], *errors)]
        rows = np.unique(np.concatenate([*picked, [0, total - 1]]))
    return table[:, rows]


def _table(stages: Sequence[TrialSimulation]) -> FloatArray:
    """All signals of one trial at the instants of its commands."""
    first = stages[0]
    trial, factor = first.run.trial, first.run.trial.axis.display_unit[1]

    def at_instants(item: TrialSimulation, rate: FloatArray) -> FloatArray:
        return np.interp(trial.time, item.run.rates.time, rate, left=np.nan, right=np.nan)

    position = factor * resample(trial, trial.position - trial.first_position, trial.time)
    rows = [trial.time, first.run.torque, at_instants(first, first.measured), position]
    for item in stages:
        rows.append(at_instants(item, item.simulated))
        rows.append(factor * resample(trial, item.position - trial.position, trial.time))
    return np.stack(rows)


def _panels(axis: Axis, guess: Assumptions, *, is_driven: bool) -> list[dict[str, Any]]:
    """Each panel from the top: its title, its height in pixels, and its lines; that of the torque if there is one."""
    unit, _ = axis.display_unit
    rate, error = _FIRST_SIMULATION, _FIRST_SIMULATION + 1
    measured_rate, measured_position = _line("measured", _MEASURED), _line("measured", _POSITION)
    text = f"{axis.position_words} from the start"
    panels = [
        (axis.rate_words, axis.rate_unit, 190, [measured_rate, *_simulated_lines(rate)]),
        (f"{axis.rate_words} error", axis.rate_unit, 90, _simulated_lines(rate, less=_MEASURED)),
        (text, unit, 120, [measured_position, *_simulated_lines(error, plus=_POSITION)]),
        (f"{axis.position_words} error", unit, 90, _simulated_lines(error)),
        (axis.force_name, axis.force_unit, 70, [_line("applied", _TORQUE)]),
    ][: 4 + is_driven]
    documents = []
    for title, panel_unit, height, lines in panels:
        guessed = f", by guessed {guess.quantities}" * guess.is_placeholder(panel_unit)
        documents.append({"title": title + guessed, "unit": panel_unit, "height": height, "lines": lines})
    return documents


def _simulated_lines(column: int, plus: int | None = None, less: int | None = None) -> list[dict[str, Any]]:
    """Lines without the causes, and with those that are switched on."""
    return [_line(look, column, plus, less, _COLUMNS_EACH) for look in ("without", "simulated")]


def _line(look: str, column: int, plus: int | None = None, less: int | None = None, staged: int = 0) -> dict[str, Any]:
    """A column, and the columns that are added and subtracted; ``staged`` is the distance between simulations."""
    return {"look": look, "column": column, "plus": plus, "less": less, "staged": staged}
