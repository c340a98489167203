"""The first screen of the page: the error, its causes, the improvement, and the next run."""

import math
from collections.abc import Iterator
from dataclasses import dataclass

from rovid.core.formatting import plus_minus
from rovid.diagnose.result import Diagnosis, Finding, delays_of_the_sensor, next_experiment
from rovid.model.parameter_names import unit_of
from rovid.model.simulation import HORIZONS
from rovid.present.number_format import equal_decimals, number_with_unit, rounded_errors
from rovid.present.report_data import ReportData, simulation_errors
from rovid.present.sentences import (
    CUT_SHORT,
    EXTENDED_MODEL,
    PLAIN_MODEL,
    NextStep,
    cautions,
    effect_title,
    evidence_words,
    improvement_words,
    join_words,
    next_step,
    plan_command,
    verdict_sentence,
)
from rovid.trial.vehicle import Vehicle

# Number of detection limits in the sentence on a diagnosis without causes.
_LIMITS_SHOWN = 3
# Units in which a detection limit means little to a reader.
_OBSCURE_UNITS = ("1", "command")


@dataclass(frozen=True, kw_only=True)
class Reason:
    """A cause: its name, its size, its evidence in words, and whether a guess may explain it."""

    title: str
    size: str
    sure: str
    may_be_guess: bool = False


@dataclass(frozen=True, kw_only=True)
class Bar:
    """A labelled value, and its length relative to the longest bar; ``look`` is its class in the style."""

    label: str
    look: str
    value: str
    share: float


@dataclass(frozen=True, kw_only=True)
class GainBars:
    """An error without and with the causes; its noise floor as text, and relative to the longest bar, where known."""

    title: str
    bars: tuple[Bar, ...]
    floor: str
    tick: float


@dataclass(frozen=True, kw_only=True)
class PageSummary:
    """The first screen, in words and bars."""

    headline: str
    error: str
    reasons: tuple[Reason, ...]
    no_cause: str
    gains: tuple[GainBars, ...]
    improvement: str
    next_step: NextStep
    models: str  #: What the plain and the extended model are; empty where they are not mentioned.
    cautions: tuple[str, ...]


@dataclass(frozen=True, kw_only=True)
class _SimulationError:
    """An error in the unit of display: without the causes, with them, and the noise floor."""

    title: str
    unit: str
    without: float
    with_causes: float
    floor: float

    def rounded(self) -> list[str]:
        """The three values with decimals that show the smallest to two significant digits."""
        return rounded_errors((self.without, self.with_causes, self.floor))


def summarize(report: ReportData) -> PageSummary:
    """The contents of the first screen."""
    diagnosis = report.diagnosis
    errors = list(_errors(report))
    found = diagnosis is not None and bool(diagnosis.findings or diagnosis.signals)
    changes = {error.title.partition(" after")[0]: (error.without, error.with_causes) for error in errors}
    step = NextStep(run="diagnosis, by `rovid diagnose`", reason="it finds what the simulation misses, and why")
    warned: list[str] = []
    if diagnosis is not None:
        plan = plan_command(report.parameters.path, report.axis)
        step = next_step(diagnosis, next_experiment(diagnosis), report.vehicle.assumptions, plan)
        warned = list(cautions(diagnosis, report.campaign.trials if report.campaign else (), report.vehicle))
    return PageSummary(
        headline=_headline(report),
        error=_error_sentence(report, errors, found=found),
        reasons=() if diagnosis is None else tuple(_reasons(diagnosis, report)),
        no_cause=_no_cause_sentence(report),
        gains=tuple(_gain_bars(error, found=found) for error in errors),
        improvement=f"On trials that were not fitted: {improvement_words(changes)}." if found else "",
        next_step=step,
        models="" if diagnosis is None else f"{PLAIN_MODEL} {EXTENDED_MODEL}" if report.extended else PLAIN_MODEL,
        cautions=tuple(warned),
    )


def _headline(report: ReportData) -> str:
    if report.diagnosis is not None:
        return verdict_sentence(report.diagnosis, report.vehicle.assumptions)
    if report.simulations:
        r2 = simulation_errors(report.simulations).r2
        return f"The model explains R² = {r2:.4f} of the {report.axis.rate_words}."
    return "There is no simulation to judge the model by."


def _errors(report: ReportData) -> Iterator[_SimulationError]:
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
            yield _SimulationError(
                title=f"{axis.position_words} error after {horizon:.0f} s",
                unit=unit,
                without=factor * without,
                with_causes=factor * with_causes,
                floor=factor * floors.get(horizon, math.nan),
            )
            break
    title = f"{axis.rate_words} error"
    yield _SimulationError(title=title, unit=axis.rate_unit, without=rates[0], with_causes=rates[1], floor=floor)


def _error_sentence(report: ReportData, errors: list[_SimulationError], *, found: bool) -> str:
    if not errors:
        missing = "there are tables, no logs" if report.campaign is None else "inertia or drag is missing"
        return f"Nothing was simulated: {missing}."
    error = errors[0]
    size, _, floor = error.rounded()
    quantity, _, when = error.title.partition(" error")
    sentence = f"The simulated {quantity} is {size} {error.unit} off{when or ', root mean square'}."
    if found or not math.isfinite(error.floor):
        return sentence
    return f"{sentence} A perfect model's would be {floor} {error.unit} off."


def _reasons(diagnosis: Diagnosis, report: ReportData) -> Iterator[Reason]:
    axis, trials = report.axis, report.campaign.trials if report.campaign else ()
    for finding in diagnosis.causes:
        of_sensor = "; or the sensor lags" if delays_of_the_sensor(trials, (finding,)) else ""
        names = [effect_title(effect, axis) for effect in (finding.effect, *finding.indistinguishable)]
        yield Reason(
            title=join_words(names, "or"),
            size=size_words(finding),
            sure=f"{evidence_words(finding)}{of_sensor}",
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
        return CUT_SHORT
    if diagnosis.verdict == "unexplained":
        return "No effect of the catalogue explains the remaining error, and it follows no logged signal."
    if diagnosis.verdict != "nothing_found":
        return ""
    limits = list(_detection_limits(diagnosis, report.vehicle))[:_LIMITS_SHOWN]
    sentence = "Every cause was tried and none was needed."
    if limits:
        sentence += f" These would have shown: {join_words(limits)}."
    return sentence


def _detection_limits(diagnosis: Diagnosis, vehicle: Vehicle) -> Iterator[str]:
    """Causes with the smallest sizes that would have been found, in units that need no explanation."""
    for effect, size in diagnosis.detectable:
        unit = unit_of(f"{effect.key}.{effect.parameters[0].name}", vehicle.axis)
        if math.isfinite(size) and unit not in _OBSCURE_UNITS:
            (text,) = equal_decimals([size], 2)
            shown = vehicle.assumptions.mark_number(number_with_unit(text, unit), unit)
            yield f"{vehicle.axis.reword(effect.title)} from {shown}"


def _gain_bars(error: _SimulationError, *, found: bool) -> GainBars:
    without, with_causes, floor = error.rounded()
    known = [value for value in (error.without, error.with_causes, error.floor) if math.isfinite(value)]
    longest = max(*known, 1e-30, 0.0)

    def bar(label: str, look: str, value: float, text: str) -> Bar:
        share = value / longest if math.isfinite(value) else 0.0
        return Bar(label=label, look=look, value=f"{text} {error.unit}", share=share)

    bars = [bar("simulated", "simulated", error.without, without)]
    if found:
        bars = [
            bar("plain model", "without", error.without, without),
            bar("extended model", "with", error.with_causes, with_causes),
        ]
    has_floor = math.isfinite(error.floor)
    return GainBars(
        title=error.title,
        bars=tuple(bars),
        floor=f"{floor} {error.unit}" if has_floor else "",
        tick=error.floor / longest if has_floor else math.nan,
    )
