"""The first screen: what is wrong, why, what the model gains by it, and what to run next."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

from rovid.core.formatting import plus_minus
from rovid.diagnose.result import Diagnosis, Finding, next_experiment
from rovid.model.parameter_names import unit_of
from rovid.model.simulation import HORIZONS
from rovid.present.number_text import equal_decimals, number_with_unit, same_decimals
from rovid.present.page.nested_simulations import simulation_errors
from rovid.present.page.report_data import ReportData
from rovid.present.tables.diagnosis import effect_name, effect_title, with_spaces
from rovid.present.verdict import confidence_words, improvement_sentence, join_words, verdict_sentence
from rovid.trial.axis import Axis
from rovid.trial.vehicle import Vehicle

# Of what would have been seen so many are named.
_NAMED = 3
# Units that say little of how large something is.
_BARE = ("1", "command")


@dataclass(frozen=True, kw_only=True)
class Reason:
    """A cause: its name, the size of it, how sure it is, in words, and whether it may be a guess's doing."""

    title: str
    size: str
    sure: str
    blamed: bool = False


@dataclass(frozen=True, kw_only=True)
class Bar:
    """A labelled value, and its share of the longest bar beside it."""

    label: str
    value: str
    share: float


@dataclass(frozen=True, kw_only=True)
class GainBars:
    """What a simulation is off by, without and with what was found.

    ``floor`` is what a perfect model would be off by, and ``tick`` its share of the longest bar; empty and NaN where
    that is not known.
    """

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
    next_run: str
    next_reason: str


@dataclass(frozen=True, kw_only=True)
class _Off:
    """One quantity in the unit in which it is shown: without, with, and at best."""

    title: str
    unit: str
    without: float
    with_it: float
    floor: float


def summarize(evidence: ReportData) -> PageSummary:
    """What the first screen says."""
    diagnosis, axis = evidence.diagnosis, evidence.axis
    off = list(_off(evidence))
    found = diagnosis is not None and bool(diagnosis.findings or diagnosis.signals)
    run, because = _next(diagnosis)
    return PageSummary(
        headline=_headline(evidence),
        error=_wrong(evidence, off, found=found),
        reasons=tuple(_reasons(diagnosis, axis)),
        no_cause=_why(evidence),
        gains=tuple(_gain(one, found=found) for one in off),
        improvement=_gained(off) if found else "",
        next_run=run,
        next_reason=because,
    )


def _headline(evidence: ReportData) -> str:
    if evidence.diagnosis is not None:
        return verdict_sentence(evidence.diagnosis, evidence.vehicle.assumptions)
    if evidence.simulations:
        return f"The model explains R² = {simulation_errors(evidence.simulations).r2:.4f} of the {evidence.axis.rate_words}."
    return "There is no simulation to judge the model by."


def _off(evidence: ReportData) -> Iterator[_Off]:
    """What the simulation is off by: of trials that were not fitted, or of all where there is no diagnosis."""
    axis, diagnosis = evidence.axis, evidence.diagnosis
    if diagnosis is not None and diagnosis.base is not None and diagnosis.extended is not None:
        one, other = diagnosis.base.held_out, diagnosis.extended.held_out
        ahead, rates = (one.position_errors, other.position_errors), (one.rate_rmse, other.rate_rmse)
        floors, floor = diagnosis.position_floors, diagnosis.noise_floor
    elif evidence.simulations:
        plain = simulation_errors(evidence.simulations)
        ahead, rates, floors, floor = (plain.position, plain.position), (plain.rate, plain.rate), {}, math.nan
    else:
        return
    shown, factor = axis.display_unit
    for horizon in reversed(HORIZONS):
        without, with_it = (errors.get(horizon) for errors in ahead)
        if without is not None and with_it is not None:
            title = f"{axis.position_words} error after {horizon:.0f} s"
            best = factor * floors.get(horizon, math.nan)
            yield _Off(title=title, unit=shown, without=factor * without, with_it=factor * with_it, floor=best)
            break  # the longest says it best
    yield _Off(title=f"{axis.rate_words} error", unit=axis.rate_unit, without=rates[0], with_it=rates[1], floor=floor)


def _wrong(evidence: ReportData, off: list[_Off], *, found: bool) -> str:
    if not off:
        missing = "there are tables, no logs" if evidence.campaign is None else "inertia or drag is missing"
        return f"Nothing was simulated: {missing}."
    first = off[0]
    size, _, floor = _rounded(first)
    what, _, when = first.title.partition(" error")
    best = "" if found or not math.isfinite(first.floor) else f" A perfect model's would be {floor} {first.unit} off."
    return f"The simulated {what} is {size} {first.unit} off{when or ', root mean square'}.{best}"


def _rounded(off: _Off) -> list[str]:
    """Without, with and at best, all with the decimals that the smallest wants for two digits."""
    values = (off.without, off.with_it, off.floor)
    sizes = [abs(value) for value in values if math.isfinite(value) and value]
    (least,) = equal_decimals([min(sizes, default=1.0)], 2)
    return [same_decimals(least, value) for value in values]


def _reasons(diagnosis: Diagnosis | None, axis: Axis) -> Iterator[Reason]:
    if diagnosis is None:
        return
    for finding in (*diagnosis.findings, *diagnosis.suspects):
        names = [effect_name(effect, axis) for effect in (finding.effect, *finding.indistinguishable)]
        blamed = bool(finding.estimate.assumptions.effect_caveat(finding.effect.id))
        yield Reason(
            title=join_words(names, "or"), size=size_words(finding), sure=confidence_words(finding), blamed=blamed
        )
    for signal, _ in diagnosis.signals:
        yield Reason(title=axis.reword(signal.title), size="", sure="a dependence; its cause has no name yet")


def size_words(finding: Finding) -> str:
    """The parameters, each with its error and unit."""
    effect, estimate = finding.effect, finding.estimate
    sizes = []
    for parameter in effect.parameters:
        name = f"{effect.key}.{parameter.name}"
        value = plus_minus(estimate.value(name), estimate.standard_error(name))
        words = estimate.axis.reword(with_spaces(parameter.name))
        its_unit = estimate.unit(name)
        sizes.append(f"{words} {estimate.assumptions.mark_number(number_with_unit(value, its_unit), its_unit)}")
    return ", ".join(sizes)


def _why(evidence: ReportData) -> str:
    """Where there is no cause, why not."""
    diagnosis = evidence.diagnosis
    if diagnosis is None:
        return evidence.diagnosis_refusal or "No cause was looked for (--no-diagnosis)."
    if diagnosis.missing:
        return diagnosis.missing
    if diagnosis.verdict == "unexplained":
        return "No effect of the catalogue explains what is left, and it follows no logged signal."
    if diagnosis.verdict != "nothing_found":
        return ""
    seen = list(_seen(diagnosis, evidence.vehicle))[:_NAMED]
    if not seen:
        return "Every cause was tried and none was needed."
    return f"Every cause was tried and none was needed. These would have shown: {join_words(seen)}."


def _seen(diagnosis: Diagnosis, vehicle: Vehicle) -> Iterator[str]:
    """Causes in units that need no explanation, each with the smallest size that would have been seen."""
    for effect, size in diagnosis.detectable:
        plain = unit_of(f"{effect.key}.{effect.parameters[0].name}", vehicle.axis)
        if math.isfinite(size) and plain not in _BARE:
            (text,) = equal_decimals([size], 2)
            size_of_it = vehicle.assumptions.mark_number(number_with_unit(text, plain), plain)
            yield f"{effect_title(effect, vehicle.axis)} from {size_of_it}"


def _gain(off: _Off, *, found: bool) -> GainBars:
    without, with_it, floor = _rounded(off)
    most = max(value for value in (off.without, off.with_it, off.floor, 1e-30) if math.isfinite(value))

    def bar(label: str, value: float, text: str) -> Bar:
        return Bar(label=label, value=f"{text} {off.unit}", share=value / most if math.isfinite(value) else 0.0)

    bars = [bar("without", off.without, without), bar("with", off.with_it, with_it)]
    known = math.isfinite(off.floor)
    return GainBars(
        title=off.title,
        bars=tuple(bars) if found else (bar("simulated", off.without, without),),
        floor=f"{floor} {off.unit}" if known else "",
        tick=off.floor / most if known else math.nan,
    )


def _gained(off: list[_Off]) -> str:
    return improvement_sentence({one.title.partition(" after")[0]: (one.without, one.with_it) for one in off})


def _next(diagnosis: Diagnosis | None) -> tuple[str, str]:
    """The run to make next, and why."""
    if diagnosis is None:
        return "diagnosis, by rovid diagnose", "it says what the simulation misses, and why"
    following = next_experiment(diagnosis)
    return str(following["run"]), "" if diagnosis.missing else str(following["reason"])
