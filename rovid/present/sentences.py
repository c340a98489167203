"""Results in words: the same sentences for terminal, page and JSON."""

import math
import shlex
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rovid.compare.comparison import Comparison, PlanarComparison
from rovid.compare.difference_tests import DRAG, THRUST_SCALE, ChangeCandidate, ParameterChange
from rovid.control.control_law import paper_runs
from rovid.control.design import ClosedLoopResult, ControllerDesign
from rovid.control.tuning import PHASE_MARGIN, SENSITIVITY_PEAK
from rovid.core.errors import join_words
from rovid.core.formatting import plus_minus, significant
from rovid.diagnose.candidate_fits import Alternative
from rovid.diagnose.evidence import CANNOT_TELL, DEFINITIONS
from rovid.diagnose.result import UNIDENTIFIABLE, Conclusion, Diagnosis, Finding, OtherCause
from rovid.diagnose.signal_regressors import is_signal
from rovid.effects import PLANAR_FORMS, Effect, effect_named, every_form
from rovid.effects.clock_offset import CLOCKS_APART
from rovid.effects.further_terms import trials_in_form
from rovid.estimate.maximum_likelihood import LikelihoodFit
from rovid.model.parameter_names import without_form
from rovid.planar.fit import PlanarFit
from rovid.preflight.feedback_detection import detect_feedback
from rovid.present.number_format import format_number, number_with_unit
from rovid.trial.assumptions import Assumptions
from rovid.trial.axis import PLANAR, YAW, Axis, parameter_file_name
from rovid.trial.trial import Trial
from rovid.trial.vehicle import Vehicle

_CUT_SHORT = (
    "The search ended at the limit of its time, before every cause was tried: repeat it with a larger --budget, to "
    "`rovid open` as well."
)
_ENDLESS = (
    "The search ended before every cause was tried, because each addition asked for another one: more time does not "
    "help, further runs may."
)
_ALL_THRUST = "all thrust"
# Causes of one class that a sentence names; JSON lists all. Convention.
_CAUSES_NAMED = 4
# Change of settling time or overshoot, in shares, and of overshoot in deg, that a user notices. Convention.
_RELEVANT, _LEAST_OVERSHOOT = 0.05, 2.0


def effect_title(effect: Effect, axis: Axis = YAW) -> str:
    """An effect's title along ``axis``, with its form or thruster where it has one."""
    title = axis.reword(effect.title)
    if trials := trials_in_form(effect.form):
        title += f" ({effect.form.partition(' ')[0]} {', '.join(trials)})"
    elif effect.form:
        title += f" ({effect.form.replace('_', ' ')})"
    return title


def cause_title(effect_id: str) -> str:
    """The title of the effect with this id; the id itself where the catalogue has none."""
    titles = {effect.id: effect.title for effect in reversed((*every_form(), *PLANAR_FORMS, CLOCKS_APART))}
    return titles.get(effect_id, effect_id)


def cause_titles(effect_ids: Sequence[str]) -> str:
    """The titles of several effects in words."""
    return join_words(list(map(cause_title, effect_ids)))


def cause_name(finding: Finding) -> str:
    """A cause by name, with the causes that the data do not distinguish from it; the best ones of many."""
    effects = (finding.effect, *finding.indistinguishable)
    count = len(effects) - _CAUSES_NAMED
    names = [finding.estimate.axis.reword(effect.title) for effect in effects[: _CAUSES_NAMED if count > 1 else None]]
    return join_words([*names, *([f"one of {count} others"] if count > 1 else [])], "or")


def other_causes(finding: Finding) -> list[Alternative | OtherCause]:
    """Effects in the place of a cause, best first; a dependence on a logged signal is not a cause."""
    return [other for other in finding.alternatives if not is_signal(other.effect)]


def cut_short_sentence(diagnosis: Conclusion) -> str:
    """Why the search of a ``diagnosis`` was cut short, and what helps."""
    return _ENDLESS if diagnosis.is_endless else _CUT_SHORT


def verdict_sentence(diagnosis: Conclusion, guess: Assumptions) -> str:
    """The result of a diagnosis in one sentence."""
    model = f"The plain model{guess.curve_clause}"
    if diagnosis.verdict == "found":
        return f"{model} misses {join_words(list(map(cause_name, diagnosis.findings)))}."
    if diagnosis.verdict == "suspected":
        return f"{model} may miss {cause_name(diagnosis.suspects[0])}."
    if diagnosis.is_cut_short and diagnosis.verdict in ("nothing_found", "unexplained"):
        return f"Cannot tell yet. {cut_short_sentence(diagnosis)}"
    sentences = {
        "nothing_found": "Nothing was found: the model explains these data.",
        "unexplained": f"{model} misses something that no effect of the catalogue explains.",
        "bad_logs": "No go: no fit of these logs is valid before their fault is corrected.",
        "too_little_data": "Cannot tell. There is too little data for a diagnosis.",
    }
    return sentences[diagnosis.verdict]


def size_words(finding: Finding) -> str:
    """The parameters of a cause, each with its error and unit; no-break spaces join numbers and units."""
    effect, estimate = finding.effect, finding.estimate
    sizes = []
    for parameter in effect.parameters:
        name = f"{effect.key}.{parameter.name}"
        unit, value = estimate.unit(name), plus_minus(estimate.value(name), estimate.standard_error(name))
        words = estimate.axis.reword(parameter.name.replace("_", " "))
        sizes.append(f"{words} {estimate.assumptions.mark_number(number_with_unit(value, unit), unit)}")
    return ", ".join(sizes)


def evidence_words(finding: Finding) -> str:
    """Evidence for a cause: its word, its size in standard errors, and its gain."""
    word = f"{CANNOT_TELL} which" if finding.indistinguishable else finding.evidence
    errors = f"{finding.standard_errors:.0f}" if finding.standard_errors >= 10.0 else f"{finding.standard_errors:.1f}"
    gain = f"log-likelihood gain {finding.held_out_gain:.0f}"
    return f"{word}: size {errors} standard errors, {gain} on trials that were not fitted"


def evidence_definitions(causes: Sequence[Finding]) -> list[str]:
    """The meaning of each word of evidence that is used for ``causes``, a sentence each."""
    used = {CANNOT_TELL if cause.indistinguishable else cause.evidence.value for cause in causes}
    return [f"{word.capitalize()}: {text[:1].lower()}{text[1:]}" for word, text in DEFINITIONS.items() if word in used]


def improvement_words(errors: Mapping[str, tuple[float, float]]) -> str:
    """By how much each error, by the plain model and with the causes, changes."""
    parts = []
    for title, (without, with_causes) in errors.items():
        share = 100.0 * (1.0 - with_causes / without) if without else 0.0
        parts.append(f"{title} {abs(share):.0f} % {'smaller' if share >= 0.0 else 'larger'}")
    return ", ".join(parts)


def removed_sentence(diagnosis: Diagnosis) -> str:
    """Share of the removable rate error that the causes remove, or without causes the part that is removable."""
    if diagnosis.base is None or diagnosis.extended is None or (share := diagnosis.removed_share) is None:
        return ""
    plain, error = diagnosis.base, f"of the mean square {diagnosis.base.estimate.axis.rate_words} error"
    if not diagnosis.extended.model.effects:
        removable = math.floor(100.0 * (1.0 - (diagnosis.noise_floor / plain.held_out.rate_rmse) ** 2))
        text = f"A perfect model would remove at least {removable} % {error}; no cause is established."
        return text if diagnosis.verdict in ("suspected", "unexplained") else ""
    at_most, percent = "", round(100.0 * share)
    if diagnosis.leaves_unexplained:  # The noise floor contains the torque. A bound of 100 % is no bound.
        at_most, percent = "at most ", math.ceil(100.0 * share)
    if percent < 1 or (at_most and percent >= 100):
        return ""
    size = f"{at_most}{percent} %" if percent < 100 else "all"
    subject = "extended model removes" if diagnosis.signals else "causes remove"
    return f"The {subject} {size} {error} that a perfect model would remove."


def comparison_headline(comparison: Comparison | PlanarComparison) -> str:
    """The result of a comparison in one sentence."""
    a, b = comparison.a.name, comparison.b.name
    if isinstance(comparison, PlanarComparison) and comparison.changed:
        found = [change for change in comparison.changes if change.changed]
        words = [f"{one.name}, {plus_minus(one.ratio, one.standard_error)} times" for one in found]
        return f"From {a} to {b} changed: {join_words(words)}."
    if isinstance(comparison, Comparison) and comparison.verdict == "changed":
        changes = "; ".join(change_sentence(comparison, change) for change in comparison.changes.established)
        return f"From {a} to {b} changed: {changes}."
    if comparison.verdict == "same":
        return f"Nothing changed from {a} to {b} that these data show."
    return f"These data cannot tell whether the vehicle changed from {a} to {b}."


def comparison_sentences(comparison: Comparison) -> Iterator[str]:
    """Open questions, possible changes, detection limits, and what the data cannot determine, a sentence each."""
    for clause in comparison.open_questions:
        yield f"Open: {clause}."
    for change in comparison.changes.changes:
        if not change.established:
            yield f"{change.evidence.capitalize()}: {change_sentence(comparison, change)}."
    if comparison.verdict == "same":
        limits = comparison.changes.detectable_changes
        known = [name for name in ("inertia", DRAG, THRUST_SCALE) if math.isfinite(limits.get(name, math.inf))]
        shares = [f"{_part_title(name)} {significant(100.0 * limits[name], 2)} %" for name in known]
        yield f"Smallest changes that these data would establish: {', '.join(shares)}."
    if comparison.transient_causes:
        causes = join_words([effect_named(name).title for name in comparison.transient_causes])
        yield f"Causes of a single campaign, which vary from day to day: {causes}."
    if "inertia" not in comparison.changes.pair.names:
        return  # Free decays have no thrust.
    yield (
        f"{comparison.a.axis.name.capitalize()} data never show {UNIDENTIFIABLE[THRUST_SCALE]}. If inertia and drag "
        "change by one factor, less thrust and a larger vehicle look the same. Their ratios do not depend on thrust."
    )


def change_sentence(comparison: Comparison, change: ParameterChange) -> str:
    """A change with its size, and the changes that the data do not distinguish from it."""
    said = _change_with_size(comparison, change)
    if change.indistinguishable:
        titles = [_ALL_THRUST if one.name == THRUST_SCALE else _change_title(one) for one in change.indistinguishable]
        said += f" (these data do not distinguish it from {join_words(titles, 'or')})"
    return said


def _change_with_size(comparison: Comparison, change: ParameterChange) -> str:
    candidate = change.candidate
    title = _change_title(candidate)
    if candidate.is_factor:
        if not math.isfinite(change.ratio):
            return title
        return f"{title}, {plus_minus(change.ratio, change.standard_error)} times"
    in_a, in_b = (effect_named(candidate.name).id in causes for causes in comparison.causes)
    before, after = ("; ".join(_joint_size(comparison, name, side) for name in candidate.parameters) for side in (0, 1))
    if in_b and not in_a:
        return f"{title}, which is new ({after})"
    if in_a and not in_b:
        return f"{title}, which is gone (it had {before})"
    return f"{title} ({before} before, {after} after)"


def _joint_size(comparison: Comparison, name: str, side: int) -> str:
    """A parameter of a cause in campaign A (``side`` 0) or B (1)."""
    pair = comparison.changes.pair
    value = plus_minus(*comparison.changes.separate_values(name)[side])
    title = name.rpartition(".")[2].replace("_", " ")
    return f"{title} {value} {pair.units[pair.names.index(name)]}".removesuffix(" 1")


def _change_title(candidate: ChangeCandidate) -> str:
    if candidate.name == THRUST_SCALE:
        return f"{_ALL_THRUST} (or inertia and drag together, in the opposite sense)"
    if candidate.is_factor and not candidate.inverse:
        return _part_title(candidate.name)
    effect = effect_named(candidate.name)
    return f"{effect.title} ({effect.form})" if effect.per_thruster else effect.title


def _part_title(name: str) -> str:
    return _ALL_THRUST if name == THRUST_SCALE else name.replace("_", " ")


def document_key(name: str) -> str:
    """A parameter's name in JSON: without the form of its effect, but with its thruster."""
    key, dot, _ = name.rpartition(".")
    return name if dot and effect_named(key).per_thruster else without_form(name)


PLAIN_MODEL = "The plain model has inertia and drag alone."
EXTENDED_MODEL = "The extended model also has the causes that were found."
# s, total length of a single trial below which it is called short; a decision.
_SHORT = 600.0


@dataclass(frozen=True, kw_only=True)
class NextStep:
    """What to do next, its reason, and the command that writes the run; empty texts where there is none."""

    run: str
    reason: str = ""
    command: str = ""

    def __str__(self) -> str:
        sentence = f"{self.run} ({self.reason})" if self.reason else self.run
        return f"{sentence}; `{self.command}` writes its commands" if self.command else sentence


def plan_command(file: Path, axis: Axis) -> str:
    """`rovid plan` with the parameter ``file`` of ``axis``, unless it finds this file by itself."""
    axes = ["--axes", "planar"] if axis is PLANAR else []
    option = [] if str(file) == parameter_file_name(axis.name) else ["-p", str(file)]
    return shlex.join(["rovid", "plan", *axes, *option])


def between_command(run: Mapping[str, Any], plan: str = "rovid plan") -> str:
    """The command that writes a ``run`` that separates two causes, for each cause in the form of the diagnosis."""
    return " ".join([plan, *(f"--between {shlex.quote(cause)}" for cause in run["between"])])


def next_step(diagnosis: Conclusion, run: Mapping[str, Any], vehicle: Vehicle, plan: str = "rovid plan") -> NextStep:
    """The next ``run`` of a diagnosis, or that none is needed; ``plan`` is the command that designs a run.

    Where nothing is left but a guess, measuring it comes next.
    """
    if diagnosis.is_settled and vehicle.assumptions:
        reason = "guesses of rovid init decide the values, and an error of a guess may stand for a cause"
        return NextStep(run=f"measure {vehicle.assumptions.listing}", reason=reason)
    if diagnosis.is_settled:
        text = "each is confirmed" if diagnosis.findings else "none was found"
        if not vehicle.is_steered:
            text += f"; `{plan}` designs a run for the least certain parameter"
        return NextStep(run="nothing more to run for the causes", reason=text)
    command = between_command(run, plan) if "commands" in run else ""
    return NextStep(run=run["run"], reason=run["reason"], command=command)


def cautions(diagnosis: Diagnosis, trials: Sequence[Trial], vehicle: Vehicle) -> Iterator[str]:
    """Reasons to distrust a diagnosis that its causes do not show, a sentence each."""
    if diagnosis.is_cut_short and diagnosis.causes:
        yield f"{cut_short_sentence(diagnosis)} Other causes may act in place of those that were found."
    if len(trials) == 1 and trials[0].duration < _SHORT:
        minutes = format_number(trials[0].duration / 60.0, 2)
        yield f"The data are one run of {minutes} min. A second run may give other causes and values."
    if trials and trials[0].has_actuators:
        closed = list(dict.fromkeys(one.name for one in detect_feedback(trials, vehicle) if one.seen_in != "reversals"))
        if closed:
            logs = closed[0] if len(closed) == 1 else f"{len(closed)} of {len(trials)} trials"
            text = f"The commands follow the motion in {logs}, by an autopilot or a pilot. Drag from steady states and "
            yield f"{text}inertia from sines are biased by this feedback."
    if diagnosis.base is None or diagnosis.extended is None or not diagnosis.extended.model.effects:
        return
    one, other = diagnosis.base.held_out, diagnosis.extended.held_out
    pairs = {f"{vehicle.axis.rate_words} error": (one.rate_rmse, other.rate_rmse)}
    for horizon, before in one.position_errors.items():
        name = f"{vehicle.axis.position_words} error after {horizon:.0f} s"
        pairs[name] = (before or math.nan, other.position_errors.get(horizon) or math.nan)
    grown = [name for name, (before, after) in pairs.items() if after > before]
    if grown:
        yield f"With the causes the {' and the '.join(grown)} of trials that were not fitted is larger than without."


def fit_verdict(fit: LikelihoodFit) -> tuple[str, str]:
    """Verdict on a fit in one sentence, and its kind: pass or warn."""
    if fit.white and not fit.at_limit and not fit.estimate.lacks_torque:
        return "The model explains these logs: its one-step prediction errors are white.", "pass"
    return "The model misses something: run `rovid diagnose`.", "warn"


def criterion_sentence(fit: LikelihoodFit | PlanarFit) -> str:
    """Criterion of the fit, its value, and whether the innovations are white."""
    white = "white" if fit.white else "not white"
    text = f"{fit.estimate.method}: log-likelihood {fit.log_likelihood:.1f} over {fit.estimate.samples} readings; "
    return f"{text}innovations {white}"


def control_verdict(design: ControllerDesign) -> Iterator[tuple[str, str]]:
    """Sentences on stability and on the benefit of the model aid, each with its kind: pass, warn or fail."""
    margins = design.margins
    if not margins.stable:
        yield "The loop is unstable about rest with these gains.", "fail"
        return
    margin = f"{margins.gain_db:.1f} dB" if math.isfinite(margins.gain_db) else "without limit"
    stability = f"phase margin {margins.phase_deg:.0f} deg, gain margin {margin}"
    # The printed values decide, for the words to agree with them.
    if round(margins.phase_deg) < PHASE_MARGIN or round(margins.sensitivity_peak, 2) > SENSITIVITY_PEAK:
        peak = f"peak of the sensitivity {margins.sensitivity_peak:.2f}"
        wanted = f"{PHASE_MARGIN:.0f} deg or more, and a peak of {SENSITIVITY_PEAK:g} or less, are usual"
        advice = "Lower the bandwidth or the gains."
        yield f"Stable, but with small margins: {stability}, {peak} ({wanted}). {advice}", "warn"
    else:
        yield f"Stable: {stability}.", "pass"
    effects = bool(design.model.effects)
    aided, plain = (_steps(design, effects=effects, aided=each) for each in (True, False))
    if not aided or not plain:
        return
    measures = []
    for name, least, words, shown in (
        ("settling_time", 0.0, "slowest step settled after", _settled),
        ("overshoot_deg", _LEAST_OVERSHOOT, "largest overshoot", "{:.1f} deg".format),
    ):
        helped, alone = _largest(aided, name), _largest(plain, name)
        text = f"{words} {shown(helped)} with the aid and {shown(alone)} without the aid"
        measures.append((_relevant_change(helped, alone, least), text))
    changes = {change for change, _ in measures}
    # A measure that is the same with and without the aid is no reason for a verdict.
    sizes = ", ".join(text for change, text in measures if change or changes == {0})
    if changes == {1, -1}:
        yield f"The model aid improves one measure of the steps and worsens the other: {sizes}.", "warn"
    elif 1 in changes:
        yield f"Use the controller without the model aid. With it the steps are worse: {sizes}.", "warn"
    elif -1 in changes:
        yield f"The model aid is of use: {sizes}.", "pass"
    else:
        yield f"The model aid makes little difference: {sizes}.", "pass"


def _relevant_change(aided: float, plain: float, least: float) -> int:
    """1 where a measure with the model aid is larger by a relevant amount, -1 where it is smaller, else 0."""
    if aided == plain or abs(aided - plain) <= max(least, _RELEVANT * min(plain, aided)):
        return 0
    return 1 if aided > plain else -1


def _steps(design: ControllerDesign, *, effects: bool, aided: bool) -> list[ClosedLoopResult]:
    """Runs of the paper on the full model, with the best or without any aid."""
    names = {step.name for step in paper_runs()}
    runs = [run for run in design.runs if run.name in names and run.metrics.overshoot_deg is not None]
    wanted = effects, aided, effects and aided
    return [run for run in runs if (bool(run.effects), run.model_aid, run.effects_known) == wanted]


def _largest(runs: Sequence[ClosedLoopResult], name: str) -> float:
    """The largest value of a metric; infinite where one is not known."""
    values = [getattr(run.metrics, name) for run in runs]
    return math.inf if None in values else max(values, default=math.inf)


def _settled(seconds: float) -> str:
    return f"{seconds:.1f} s" if math.isfinite(seconds) else "the end of the run"
