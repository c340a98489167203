"""Comparison of two campaigns: changed parameters, changed causes, and cross-prediction of runs."""

import itertools
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

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
from rovid.core.threads import thread_map
from rovid.effects import Effect
from rovid.effects.thruster_imbalance import EFFECT as IMBALANCE
from rovid.model.model import Model
from rovid.model.simulation import TrialSimulation, simulate_runs, simulation_errors
from rovid.trial.fault import fault_texts

_SAME_LOGS = "both campaigns have the same logs, so all differences are those of the models"
# Parameters of the whole vehicle: the verdict is "cannot tell" if a relevant change of them is not detectable.
_REQUIRED = ("inertia", DRAG)
# Standard errors from neutral above which a cause acts in a campaign; a decision.
_ACTS = 3.0
# p-value below which the difference that stays unexplained leaves the question open; a decision.
_SIGNIFICANT = 1e-3
Report = Callable[[str], None]


@dataclass(frozen=True, kw_only=True, eq=False)
class CrossPrediction:
    """Free-running simulations of a campaign's runs by a model."""

    simulations: tuple[TrialSimulation, ...]
    # rate_r2, rate_rmse: pooled over all runs
    rate_r2: float
    rate_rmse: float
    # Horizon in s -> RMS position error at that time after a restart; None if no run is long enough
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
    report: Report = lambda _: None,
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
    both_logs = bool(a.runs and b.runs)
    late = [one.name for one in (a, b) if one.diagnosis is not None and one.diagnosis.is_cut_short]
    questions = list(_open_questions(changes, relevant_change, only_in_one, both_logs=both_logs))
    if changes.changes and {log.sha256 for log in a.sources} == {log.sha256 for log in b.sources} != set():
        # No vehicle changes between two fits of the same logs.
        changes = replace(find_changes(pair, []), detectable_changes=changes.detectable_changes)
        questions = [_SAME_LOGS]
    open_questions = (*map(cut_short, late), *questions)
    if changes.established:
        verdict = "changed"
    elif open_questions or changes.changes:
        verdict = "cannot_tell"
    else:
        verdict = "same"
    environmental = [{effect.id for effect in one.found_effects if effect.environmental} for one in (a, b)]
    # Simulations of each campaign's runs by each model, if the logs hold the signals of its effects.
    tasks: dict[tuple[str, str], tuple[Model, CampaignFit]] = {}
    for (name, campaign), (other_name, other) in itertools.product({"a": a, "b": b}.items(), repeat=2):
        model = campaign.model
        if model is None or not other.runs:
            continue
        if campaign is other or all(map(other.has_signals_for, model.effects)):
            tasks[name, other_name] = model, other
    predictions = dict(zip(tasks, thread_map(lambda task: _predict(*task), list(tasks.values())), strict=True))
    # Each warning once, with the names of its campaigns.
    campaigns: dict[str, list[str]] = {}
    for campaign, estimate in {a: in_a, b: in_b}.items():
        study = campaign.study
        remarks = [] if study is None else [*fault_texts(study.faults), *study.remarks()]
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
    if not campaign.runs:
        return ""
    with_gain = {effect.form for effect in effects if effect.id == IMBALANCE.id}
    names = [thruster.name for thruster in campaign.vehicle.thrusters if thruster.curve is not None]
    remaining = [name for name in names if name not in with_gain]
    return f"{IMBALANCE.id}:{remaining[0]}" if with_gain and len(remaining) == 1 else ""


def cut_short(name: str) -> str:
    """Clause on a diagnosis that ended before every cause was tried."""
    return (
        f"the diagnosis of {name} ended at the limit of its time, before every cause was tried: give a larger --budget"
    )


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
