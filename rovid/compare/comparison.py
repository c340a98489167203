"""Comparison of two campaigns, along one axis or by the coupled model: changed parameters and causes, predictions."""

import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from rovid.compare.campaign_fit import (
    CampaignFit,
    SharedEstimate,
    input_warnings,
    shared_effects,
    shared_estimate,
    with_diagnosis,
)
from rovid.compare.difference_tests import (
    DRAG,
    RELEVANT_CHANGE,
    DifferenceTest,
    EstimatePair,
    change_candidates,
    find_changes,
)
from rovid.core.budget import ProgressCallback
from rovid.core.errors import ConfigError
from rovid.core.threads import thread_map
from rovid.diagnose.result import Finding
from rovid.diagnose.thresholds import THRESHOLDS
from rovid.effects import Effect
from rovid.effects.thruster_imbalance import EFFECT as IMBALANCE
from rovid.model.model import Model
from rovid.model.parameter_names import PLANAR_UNITS
from rovid.model.simulation import FitMeasures, TrialSimulation, simulate_runs, simulation_errors
from rovid.planar.diagnosis import PlanarDiagnosis
from rovid.planar.trial_simulation import pooled_measures
from rovid.store.load import read_parameters
from rovid.store.parameter_file import Entry, Parameters
from rovid.store.planar_study import PlanarStudy, open_planar_study, planar_effect, with_fit
from rovid.trial.assumptions import Assumptions
from rovid.trial.axis import PLANAR
from rovid.trial.fault import fault_texts

_SAME_LOGS = "both campaigns have the same logs, so all differences are those of the models"
# Parameters of the whole vehicle: the verdict is "cannot tell" if a relevant change of them is not detectable.
_REQUIRED = ("inertia", DRAG)
# Standard errors from neutral above which a cause acts in a campaign; a decision.
_ACTS = 3.0
# p-value below which the difference that stays unexplained leaves the question open; a decision.
_SIGNIFICANT = 1e-3
# Probability of a false change among all parameters of a comparison by the coupled model without one; a decision.
_FALSE_CHANGE = 0.01
# Joint standard errors of a change that is detected in nearly all comparisons; a decision.
_DETECTABLE = 4.0
_INERTIAS = ("surge.inertia", "sway.inertia", "yaw.inertia")


@dataclass(frozen=True, kw_only=True, eq=False)
class CrossPrediction:
    """Free-running simulations of a campaign's runs by a model."""

    simulations: tuple[TrialSimulation, ...]
    rate_r2: float  #: Pooled over all runs, as is ``rate_rmse``.
    rate_rmse: float
    #: Horizon in s -> RMS position error at that time after a restart; None if no run is long enough.
    position_errors: Mapping[float, float | None]


@dataclass(frozen=True, kw_only=True, eq=False)
class Comparison:
    """Result of `rovid compare`."""

    verdict: str  #: "same", "changed" or "cannot_tell".
    a: CampaignFit
    b: CampaignFit
    effects: tuple[Effect, ...]
    changes: DifferenceTest
    causes: tuple[tuple[str, ...], tuple[str, ...]]  #: Ids of the causes that act in A, and in B.
    transient_causes: tuple[str, ...]  #: Ids of environmental causes that acted in only one of the campaigns.
    #: (model of, runs of), as ("a", "b") -> prediction; empty for parameter files.
    predictions: Mapping[tuple[str, str], CrossPrediction]
    relevant_change: float  #: Relative change that has to be detectable.
    open_questions: tuple[str, ...]  #: Clauses on what leaves the question open.
    warnings: tuple[str, ...]

    @property
    def changed(self) -> tuple[str, ...]:
        """Established changes: names of parameters, or thrust_scale."""
        names: list[str] = []
        for change in self.changes.established:
            candidate = change.candidate
            names += [candidate.name] if candidate.inverse else candidate.parameters
        return tuple(dict.fromkeys(names))


def compare(
    a: CampaignFit,
    b: CampaignFit,
    *,
    relevant_change: float = RELEVANT_CHANGE,
    report: ProgressCallback = lambda _: None,
    budget: float | None = None,
) -> Comparison:
    """Compare two campaigns; logs are diagnosed if they are not yet, each within a ``budget`` in s.

    Both campaigns are fitted with the causes of either, because otherwise the models would differ. Raises ConfigError
    if the campaigns are of different vehicles. Raises DataError if a campaign holds too few data.
    """
    warnings = list(input_warnings(a, b))
    a, b = (with_diagnosis(campaign, report, budget) for campaign in (a, b))
    effects = shared_effects(a, b)
    report("Fitting both with the causes of either …")
    in_a, in_b = thread_map(lambda campaign: shared_estimate(campaign, effects), [a, b])
    pair, only_in_one = _pair(in_a, in_b, [effect for effect in effects if effect.environmental])
    weak = [effect.key for effect in effects if effect.id == IMBALANCE.id]
    changes = find_changes(pair, change_candidates(pair, weak, _remaining_thruster(a, effects)))
    report("Simulating the runs of each by the model of the other …")
    late = [(one.name, one.diagnosis) for one in (a, b) if one.diagnosis is not None and one.diagnosis.is_cut_short]
    questions = list(_open_questions(changes, relevant_change, only_in_one, both_logs=bool(a.runs and b.runs)))
    if changes.changes and {log.sha256 for log in a.sources} == {log.sha256 for log in b.sources} != set():
        # No vehicle changes between two fits of the same logs.
        changes = replace(find_changes(pair, []), detectable_changes=changes.detectable_changes)
        questions = [_SAME_LOGS]
    open_questions = (*(_cut_short(name, endless=one.is_endless) for name, one in late), *questions)
    verdict = "cannot_tell" if open_questions or changes.changes else "same"
    if changes.established:
        verdict = "changed"
    environmental = [{effect.id for effect in one.found_effects if effect.environmental} for one in (a, b)]
    # Simulations of each campaign's runs by each model, if the logs hold the signals of its effects.
    tasks: dict[tuple[str, str], tuple[Model, CampaignFit]] = {}
    for (name, campaign), (other_name, other) in itertools.product({"a": a, "b": b}.items(), repeat=2):
        if (model := campaign.model) is None or not other.runs:
            continue
        if campaign is other or all(map(other.has_signals_for, model.effects)):
            tasks[name, other_name] = model, other
    predictions = dict(zip(tasks, thread_map(lambda task: _predict(*task), list(tasks.values())), strict=True))
    # Each warning once, with the names of its campaigns.
    campaigns: dict[str, list[str]] = {}
    for campaign, estimate in {a: in_a, b: in_b}.items():
        remarks = [] if (study := campaign.study) is None else [*fault_texts(study.faults), *study.remarks()]
        for text in dict.fromkeys((*remarks, *estimate.warnings)):
            campaigns.setdefault(text, []).append(campaign.name)
    return Comparison(
        verdict=verdict,
        a=a,
        b=b,
        effects=tuple(effects),
        changes=changes,
        causes=(_causes(a, b, effects, in_a, changes), _causes(b, a, effects, in_b, changes)),
        transient_causes=tuple(sorted(environmental[0] ^ environmental[1])),
        predictions=predictions,
        relevant_change=relevant_change,
        open_questions=open_questions,
        warnings=(*warnings, *(f"{' and '.join(names)}: {text}" for text, names in campaigns.items())),
    )


def _pair(a: SharedEstimate, b: SharedEstimate, environmental: Sequence[Effect]) -> tuple[EstimatePair, list[str]]:
    """Estimates of the parameters known in both campaigns, and the names known in only one, without environment."""
    excluded = tuple(f"{effect.key}." for effect in environmental)
    names = [name for name in dict.fromkeys((*a.names, *b.names)) if not name.startswith(excluded)]
    shared = [name for name in names if all(0.0 < side.moments(name)[1] < math.inf for side in (a, b))]
    at_a, at_b = (list(map(side.names.index, shared)) for side in (a, b))
    pair = EstimatePair(
        names=tuple(shared),
        units=tuple(a.units[index] for index in at_a),
        a=a.values[at_a],
        b=b.values[at_b],
        covariance_a=a.covariance[np.ix_(at_a, at_a)],
        covariance_b=b.covariance[np.ix_(at_b, at_b)],
        white=a.white and b.white,
        samples=a.samples + b.samples,
    )
    return pair, [name for name in names if name not in shared]


def _remaining_thruster(campaign: CampaignFit, effects: Sequence[Effect]) -> str:
    """Key of the only thruster without a gain among the ``effects``; empty if there is not exactly one."""
    with_gain = {effect.form for effect in effects if effect.id == IMBALANCE.id}
    if not with_gain or not campaign.runs:
        return ""
    thrusters = [one for one in campaign.vehicle.thrusters if one.curve is not None and one.name not in with_gain]
    return f"{IMBALANCE.id}:{thrusters[0].name}" if len(thrusters) == 1 else ""


def _cut_short(name: str, *, endless: bool = False) -> str:
    """Clause on a diagnosis that ended before every cause was tried: for lack of time, or ``endless``."""
    why = "as each addition asked for another" if endless else "at the limit of its time (give a larger --budget)"
    return f"the diagnosis of {name} ended {why}, before every cause was tried"


def _open_questions(
    changes: DifferenceTest, relevant_change: float, only_in_one: Sequence[str], *, both_logs: bool
) -> Iterator[str]:
    """Clauses on what prevents a clear verdict."""
    for name in _REQUIRED:
        detectable = changes.detectable_changes.get(name, 0.0)
        if detectable > relevant_change:
            yield f"the smallest detectable change of {name.replace('_', ' ')} is {100.0 * detectable:.0f} %"
    if changes.p_value < _SIGNIFICANT:
        yield (
            "parameters without an established change differ by more than their errors: the errors are too small, or "
            "several parameters changed slightly"
        )
    for name in only_in_one:
        reason = ", and a parameter file does not show whether the other logs contain it: give the logs"
        yield f"{name} is known in only one campaign{reason * (not both_logs)}"


def _causes(
    campaign: CampaignFit,
    other: CampaignFit,
    effects: Sequence[Effect],
    estimate: SharedEstimate,
    changes: DifferenceTest,
) -> tuple[str, ...]:
    """Ids of the causes found in ``campaign``, and of unchanged ones of the ``other`` that are significant here."""
    found = {effect.key: effect.id for effect in campaign.found_effects}
    found_in_other = {effect.id for effect in other.found_effects}
    changed = {change.candidate.name for change in changes.established}
    for effect in effects:
        parameter = effect.parameters[0]
        value, variance = estimate.moments(f"{effect.key}.{parameter.name}")
        acts = abs(value - parameter.neutral) > _ACTS * math.sqrt(variance)
        if effect.key in changed and effect.id in found.values() and not acts:
            found = {key: name for key, name in found.items() if name != effect.id}
        elif acts and effect.id in found_in_other and not effect.environmental:
            found[effect.key] = effect.id
    return tuple(dict.fromkeys(found.values()))


def _predict(model: Model, campaign: CampaignFit) -> CrossPrediction:
    simulations = tuple(simulate_runs(campaign.runs, model, campaign.vehicle))
    errors = simulation_errors(simulations)
    return CrossPrediction(
        simulations=simulations, rate_r2=errors.r2, rate_rmse=errors.rate, position_errors=errors.position
    )


# ---- coupled model


@dataclass(frozen=True, eq=False)
class PlanarCampaign:
    """The parameters of one campaign, and its logs where there are any."""

    name: str
    parameters: Parameters
    study: PlanarStudy | None = None
    is_cut_short: bool = False  #: Whether its diagnosis ended before every cause was tried.
    suspects: tuple[Finding, ...] = ()  #: Of its diagnosis.

    @property
    def doubts(self) -> Iterator[str]:
        """Clauses on what may explain a difference of parameters without a change of the vehicle."""
        if self.is_cut_short:
            yield _cut_short(self.name)
        if self.parameters.missing:
            yield f"{self.name}: {self.parameters.missing}, so its parameters may stand for something else"
        for one in self.suspects:
            if one.probability >= THRESHOLDS.likely:
                words = f"{one.effect.title} (confidence {one.probability:.2f})"
                yield f"the diagnosis of {self.name} suspects {words}, which may explain differences"


@dataclass(frozen=True, kw_only=True)
class PlanarChange:
    """One parameter in both campaigns."""

    name: str
    a: Entry
    b: Entry
    ratio: float  #: B over A; NaN where A is zero, and of directions.
    standard_error: float  #: Of the ratio, or of the difference of directions.
    confidence: float  #: Probability that the difference is no chance, allowing for the number of parameters.
    changed: bool
    difference: float = math.nan  #: B less A in rad, of directions.


@dataclass(frozen=True, kw_only=True, eq=False)
class PlanarComparison:
    """Result of `rovid compare --axes planar`."""

    verdict: str  #: "same", "changed" or "cannot_tell".
    a: PlanarCampaign
    b: PlanarCampaign
    changes: tuple[PlanarChange, ...]
    #: (model of, runs of), as ("a", "b") -> speed -> agreement; without logs absent.
    predictions: Mapping[tuple[str, str], Mapping[str, FitMeasures]]
    #: Inertia -> smallest relative change that nearly always would be found.
    detectable: Mapping[str, float]

    @property
    def open_questions(self) -> list[str]:
        """Clauses on what else may explain a difference, or was not tried."""
        return [clause for side in (self.a, self.b) for clause in side.doubts]

    @property
    def changed(self) -> list[str]:
        """Names of the changed parameters."""
        return [change.name for change in self.changes if change.changed]

    @property
    def assumptions(self) -> Assumptions:
        """Guesses that either campaign depends on."""
        guesses = Assumptions()
        for settings in (self.a.parameters.settings, self.b.parameters.settings):
            guesses |= Assumptions() if settings is None else settings.assumptions
        return guesses


def planar_campaigns(
    paths: tuple[Path, Path], report: ProgressCallback, budget: float | None = None
) -> tuple[PlanarCampaign, PlanarCampaign]:
    """The campaigns of two parameter files or folders of logs.

    Folders are diagnosed, and fitted with the causes of either campaign; causes of one day stay with their own. Raises
    ConfigError if a parameter file holds the parameters of one axis.
    """
    sides = [_opened(path, report, budget) for path in paths]
    shared = [effect for _, _, effects, _ in sides for effect in effects if not effect.environmental]
    found = []
    for path, (stored, study, effects, diagnosis) in zip(paths, sides, strict=True):
        parameters = stored or Parameters(path=path, axis=PLANAR)
        if study is not None and stored is None:
            report(f"Fitting {path.name} …")
            fit = study.fit(tuple(dict.fromkeys((*shared, *effects))))
            parameters = with_fit(parameters, fit, study.provenance)
        late, suspects = (False, ()) if diagnosis is None else (diagnosis.is_cut_short, diagnosis.suspects)
        found.append(PlanarCampaign(str(path), parameters, study, late, suspects))
    return found[0], found[1]


def _opened(
    path: Path, report: ProgressCallback, budget: float | None
) -> tuple[Parameters | None, PlanarStudy | None, list[Effect], PlanarDiagnosis | None]:
    """A parameter file and its logs as far as they exist, or None and a folder's logs; causes; the diagnosis."""
    if path.is_file():
        stored = read_parameters(path)
        if stored.axis is not PLANAR:
            text = f"holds the parameters of {stored.axis.name}, but --axes is planar."
            raise ConfigError(text, where=path, mend="Give the file of another fit.")
        has_logs = stored.logs and all(log.exists() for log in stored.logs)
        study = open_planar_study(stored.logs) if has_logs else None
        return stored, study, list(map(planar_effect, stored.effects)), None
    study = open_planar_study([path])
    report(f"Diagnosing {path.name} …")
    found = study.diagnosis(report, budget=budget)
    effects = [] if found.extended is None else [one.effect for one in found.extended.fit.model.effects]
    return None, study, effects, found


def compare_planar(a: PlanarCampaign, b: PlanarCampaign, *, relevant_change: float) -> PlanarComparison:
    """Compare two campaigns; a change of an inertia by ``relevant_change`` has to be detectable for "same"."""
    ours, others = a.parameters.entries, b.parameters.entries
    # A prior of both sides makes them alike.
    names = [name for name in ours if name in others and not (ours[name].from_prior or others[name].from_prior)]
    doubts = [*a.doubts, *b.doubts]
    changes = tuple(_change(name, ours[name], others[name], len(names)) for name in names)
    detectable = {one.name: _DETECTABLE * one.standard_error for one in changes if one.name in _INERTIAS}
    if doubts:
        # What a model misses changes its parameters, too.
        changes = tuple(replace(change, changed=False) for change in changes)
    undecided = doubts or not detectable or not all(limit <= relevant_change for limit in detectable.values())
    verdict = "cannot_tell" if undecided else "same"
    if any(change.changed for change in changes):
        verdict = "changed"
    predictions, sides = {}, {"a": a, "b": b}
    for one, other in (("a", "b"), ("a", "a"), ("b", "b"), ("b", "a")):
        if (study := sides[other].study) is not None:
            predictions[one, other] = pooled_measures(study.simulate(study.model(sides[one].parameters)))
    return PlanarComparison(verdict=verdict, a=a, b=b, changes=changes, predictions=predictions, detectable=detectable)


def _change(name: str, a: Entry, b: Entry, count: int) -> PlanarChange:
    joint, difference = math.hypot(a.standard_error, b.standard_error), b.value - a.value
    is_direction, chance, ratio, error = name.endswith(".direction"), 1.0, math.nan, math.nan
    if is_direction:
        difference, error = math.remainder(difference, 2.0 * math.pi), joint
    elif a.value:
        ratio = b.value / a.value
        error = math.hypot(b.standard_error / a.value, ratio * a.standard_error / a.value)
    if 0.0 < joint < math.inf:
        chance = min(1.0, count * math.erfc(abs(difference) / joint / math.sqrt(2.0)))
    # Only the base parameters belong to the vehicle: a current or a constant force may differ from day to day.
    key = "" if name in PLANAR_UNITS else name.rpartition(".")[0]
    environmental = bool(key) and not key.startswith("rudder") and planar_effect(key).environmental
    return PlanarChange(
        name=name,
        a=a,
        b=b,
        ratio=ratio,
        standard_error=error,
        confidence=1.0 - chance,
        changed=chance < _FALSE_CHANGE and not environmental,
        difference=difference if is_direction else math.nan,
    )
