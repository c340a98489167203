"""The first screen of the page: the error, its causes, the improvement, and the next run."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from rovid.core.errors import join_words
from rovid.diagnose.result import Diagnosis, delays_of_the_sensor, next_experiment
from rovid.model.parameter_names import unit_of
from rovid.model.simulation import HORIZONS, simulation_errors
from rovid.present import sentences
from rovid.present.number_format import equal_decimals, number_with_unit, rounded_errors
from rovid.present.report_data import ReportData

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
    removed: str  #: Share of the removable error that the causes remove; empty where it is not known.
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
        step = sentences.next_step(diagnosis, next_experiment(diagnosis), report.vehicle, plan)
        warned = list(sentences.cautions(diagnosis, report.trials, report.vehicle))
    return PageSummary(
        headline=headline,
        error=_error_sentence(report, errors),
        reasons=() if diagnosis is None else tuple(_reasons(diagnosis, report)),
        no_cause=_no_cause_sentence(report),
        gains=errors,
        improvement=f"On trials that were not fitted: {sentences.improvement_words(changes)}." if found else "",
        removed="" if diagnosis is None else sentences.removed_sentence(diagnosis),
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
        of_sensor = "; thrust or sensor may be late" if delays_of_the_sensor(trials, (finding,)) else ""
        names = [sentences.effect_title(effect, axis) for effect in (finding.effect, *finding.indistinguishable)]
        yield Reason(
            title=join_words(names, "or"),
            size=sentences.size_words(finding),
            sure=f"{sentences.evidence_words(finding)}{of_sensor}",
            may_be_guess=bool(finding.estimate.assumptions.effect_caveat(finding.effect.id)),
        )
    for signal, _ in diagnosis.signals:
        yield Reason(title=axis.reword(signal.title), size="", sure="a dependence without a known cause")


def _no_cause_sentence(report: ReportData) -> str:
    """Why no cause is named; empty where one is."""
    diagnosis = report.diagnosis
    if diagnosis is None:
        return report.diagnosis_refusal or "No diagnosis was made (--no-diagnosis)."
    if diagnosis.missing:
        return diagnosis.missing
    if diagnosis.is_cut_short and not diagnosis.causes:
        return sentences.cut_short_sentence(diagnosis)
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
        sentence += f" These would have shown: {join_words(limits[:_LIMITS_SHOWN])}."
    return sentence
