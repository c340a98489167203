"""Algorithm of the diagnosis: how a cause of model error becomes established.

The plain model is fitted to the logs by free-running simulation. All forms of all effects of the catalogue, and every
logged signal, become candidates. Six stages follow:

1. *Screen*: score tests predict the log-likelihood gain of each candidate next to one model, without a fit.
2. *Select*: candidates with the largest predicted gains are fitted, and the best one is added. Effects are removed and
   exchanged until the model no longer changes. Each model on the way is screened.
3. *Challenge*: single causes, pairs, subsets, and the model with one effect replaced are fitted where they may come
   close. A better one takes the place of the model, and the search continues from there.
4. *Validate*: an effect that fails one of the rules is banned, and the search continues without it. A likely effect
   keeps its place until the end. After `max_rejections` bans the model is tested only if likely effects are dropped.
5. *Decide*: the search by one-step predictions (innovations) comes first. Multi-step predictions choose a new start for
   it if no model with at most one cause fits, nothing dominates, waves change the result, an effect is rejected, or
   the result is not adequate (white innovations, disturbance within its limit). The first adequate, validated one-step
   model is reported. If there is none, the multi-step model is validated and reported.
6. *Conclude*: the parameters are fitted to all data, and their errors include what the model lacks. An effect that
   differs too little from nothing by these errors is dropped. The effects that are left are established. Further causes
   with enough probability are suspects. So are all causes if the model still lacks a torque, and a formula in their
   place predicts better (`rovid.diagnose.formulas`).

Thresholds such as `max_rejections` stand in `rovid.diagnose.thresholds`.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

from rovid.core.budget import Budget, ProgressCallback
from rovid.core.errors import DataError
from rovid.core.spmd import forked_workers
from rovid.diagnose.build_result import build_diagnosis, search_warnings
from rovid.diagnose.challenge import challenge
from rovid.diagnose.cross_validation import missing_data, split_runs
from rovid.diagnose.formulas.search import doubt_stand_ins
from rovid.diagnose.objectives import (
    InnovationObjective,
    MultiStepObjective,
    SearchObjective,
    SearchProblem,
    cannot_whiten,
    fits_poorly,
    has_no_dominant_cause,
    pose,
    preload,
)
from rovid.diagnose.result import Diagnosis
from rovid.diagnose.selection import Selection
from rovid.diagnose.stated_selection import state
from rovid.diagnose.stepwise import SearchStop, StepwiseSearch, StopRule
from rovid.diagnose.thresholds import THRESHOLDS
from rovid.diagnose.validation import drop_inconsistent, drop_likely, first_rejection, report_remainder
from rovid.estimate.fit_result import FitResult
from rovid.estimate.maximum_likelihood import LikelihoodFit, fit_likelihood
from rovid.trial.preprocessing import PreparedRuns
from rovid.trial.vehicle import Vehicle


def diagnose(
    prepared: PreparedRuns, vehicle: Vehicle, report: ProgressCallback = lambda _: None, budget: Budget | None = None
) -> Diagnosis:
    """Find the causes that the plain model misses, within the ``budget``; ``report`` is called with each step."""
    runs, notes = prepared.items, tuple[str, ...]()
    parts = split_runs(runs, vehicle, prepared.cutoff)
    if parts is not None:
        runs = parts.items
        cut = f"There are too few trials ({len(prepared.items)}) to hold some out: they were cut into {len(runs)} parts"
        notes = (f"{cut}, each simulated from its own start.",)
    if missing := missing_data(runs, prepared.cutoff):
        return Diagnosis(verdict="too_little_data", missing=missing, warnings=notes)
    is_compiled = preload()
    samples = sum(len(run.trial.time) for run in prepared.items)
    with forked_workers(enabled=is_compiled and samples < THRESHOLDS.fork_samples) as is_first:
        own = replace(budget or Budget(), report=report if is_first else lambda _: None)
        try:
            problem = pose(prepared, runs, vehicle, own)
        except DataError as error:
            return Diagnosis(verdict="too_little_data", missing=str(error), warnings=notes)
        selection = doubt_stand_ins(problem, decide(problem))
        try:
            plain = fit_likelihood(prepared.items, vehicle)
        except DataError:
            plain = None  # the selected model may have more to say on the inertia
        return conclude(selection, notes, plain)


def select(problem: SearchProblem, objective: SearchObjective, search: StepwiseSearch, start: FitResult) -> Selection:
    """The model that a stepwise search by one of the objectives reaches from ``start``.

    The search repeats: `StepwiseSearch.screen` the model, fit a shortlist, add the candidate with the best BIC if its
    gain exceeds the threshold and what approximate equations may explain, remove effects that lost their gain, exchange
    effects for better ones. It ends when the model no longer changes, or earlier for a `SearchStop`.
    """
    return Selection(
        search=search,
        data=objective.data,
        base=objective.base,
        model=search.run(start),
        pieces=objective.pieces,
        multi_step=objective.multi_step,
        wave_test=problem.wave_test if objective.multi_step else None,
    )


def validate(selection: Selection) -> Selection:
    """Test each effect of the model. Ban the first one that fails, search on without it, and repeat.

    First, other sets challenge the model. Then each effect must pass the rules of `rovid.diagnose.validation`. A likely
    effect that fails is banned, but keeps its place until the end. After `max_rejections` bans the result of the last
    search is tested only if likely effects are dropped.
    """
    selection = report_remainder(challenge(selection))
    likely: list[str] = []
    for _ in range(THRESHOLDS.max_rejections):
        rejection = first_rejection(selection, likely)
        if rejection is None:
            break
        effect = rejection.effect
        selection = selection.with_message(f"{effect.title} {rejection.reason}: it is not claimed.").ban(effect)
        if rejection.is_likely:
            # A likely effect keeps its place until the end: otherwise a stand-in would take the place.
            likely.append(effect.key)
        else:
            selection = drop_inconsistent(challenge(selection.drop(effect).search_on()))
    selection = drop_likely(selection, likely)
    if not selection.model.effects:
        # The base model has the limit of the disturbance that suits a model without effects.
        selection = replace(selection, model=selection.base)
    return selection


def decide(problem: SearchProblem) -> Selection:
    """Run screening, selection and validation by one objective after the other; return the first adequate result.

    If no one-step result is adequate, return the validated multi-step result.
    """
    selection = select_directly(problem)
    if selection is not None:
        problem.report("Validating on held-out trials …")
        selection = challenge(selection)  # the first step of `validate` also; the tests below need it already
        # A rejection may mean that stand-ins were selected: then multi-step predictions decide where to start.
        if selection.is_out_of_time or (first_rejection(selection) is None and selection.is_adequate):
            return validate(selection)
    for predicted in select_by_predictions(problem):
        if SearchStop.ADEQUATE in predicted.search.progress.stops:
            # One-step predictions with the same effects are adequate, so their sizes need no comparison.
            selection = select_next_to_waves(problem, predicted.model, cannot_whiten)
            if selection is not None and (selection := validate(selection)).is_adequate:
                return selection
        # Effects must be about as large in one-step predictions, next to waves where these are established.
        multi_step = drop_inconsistent(predicted)
        waves = None if multi_step.waves is None else multi_step.waves.established
        # The model with waves has the same effects; multi-step predictions alone cannot show waves.
        selection = select_by_innovations(problem, waves or multi_step.model, multi_step.model, cannot_whiten)
        if selection is not None and selection.is_adequate:
            problem.report("Validating on held-out trials …")
            selection = validate(selection)
            if selection.is_adequate:
                return selection
    problem.report("Validating on held-out trials …")
    return validate(multi_step)


def select_directly(problem: SearchProblem) -> Selection | None:
    """One-step selection from the base model; None where nothing dominates, or the result is not adequate."""
    base = problem.innovations.base
    if fits_poorly(base) and not problem.innovations.fits_with_one_cause:
        return None
    return select_next_to_waves(problem, base, has_no_dominant_cause)


def select_next_to_waves(problem: SearchProblem, start: FitResult, is_hopeless: StopRule) -> Selection | None:
    """One-step selection from ``start``, repeated next to waves where these are established; None as above."""
    selection = select_by_innovations(problem, start, start, is_hopeless)
    model = start if selection is None else selection.model
    # Where no cause dominates, the waves may.
    is_out_of_time = selection is not None and selection.is_out_of_time
    if is_out_of_time or (waves := problem.wave_test(model).established) is None:
        return selection
    # Effects selected without waves may stand in for them. If the second search fails, the first does not count.
    return select_by_innovations(problem, waves, model, cannot_whiten)


def select_by_innovations(
    problem: SearchProblem, effects_from: FitResult, drag_from: FitResult, is_hopeless: StopRule
) -> Selection | None:
    """One-step selection from a start; None where it is hopeless, or the result is not adequate.

    The start has the effects of ``effects_from``, and the inertia and drag of ``drag_from``. These are two models where
    waves act: the model with waves has an unlimited disturbance, which may take the place of inertia and drag.
    """
    problem.report("Searching by one-step predictions …")
    objective = problem.innovations
    if not is_worth_searching(objective, effects_from, drag_from, is_hopeless):
        return None
    start = objective.begin(objective.search_data, effects_from, drag_from)
    selection = select(problem, objective, objective.search(start, is_hopeless), start)
    if selection.is_out_of_time:
        return selection
    if SearchStop.HOPELESS in selection.search.progress.stops or not selection.is_adequate:
        return None
    return selection


def is_worth_searching(
    objective: InnovationObjective, effects_from: FitResult, drag_from: FitResult, is_hopeless: StopRule
) -> bool:
    """Whether a one-step search has a chance, by the stop rule on thinned data; that saves a long search."""
    if objective.screening_data is objective.search_data:
        return True  # the search itself begins with the stop rule
    start = objective.begin(objective.screening_data, effects_from, drag_from)
    return not objective.search(start, is_hopeless).is_given_up(start)


def select_by_predictions(problem: SearchProblem) -> Iterator[Selection]:
    """Multi-step selections: first one whose effects whiten the innovations, if any, and at last the complete one."""
    objective = MultiStepObjective.from_data(problem.data, problem.pieces, problem.candidates, problem.budget)
    start = objective.base
    is_adequate: Callable[[FitResult], bool] | None = problem.innovations.is_adequate
    if not objective.candidates:
        yield select(problem, objective, objective.search(None), start)
        return
    while True:
        search = objective.search(is_adequate)
        selection = select(problem, objective, search, start)
        if SearchStop.ADEQUATE in search.progress.stops:
            yield selection
            # The caller found no valid one-step model from there: search again, to the end.
            is_adequate = None
            continue
        # A missing effect correlates the prediction errors, and correlated errors count once. With the selected effects
        # more predictions may count: then the search continues with their weights.
        reweighted = objective.reweighted(search, selection.model)
        if reweighted.data.effective_count < THRESHOLDS.reweighting_growth * objective.data.effective_count:
            # Searches after a rejection run to their end.
            yield replace(selection, search=replace(search, is_adequate=None))
            return
        objective = replace(reweighted, base=reweighted.refit(objective.base))
        start = objective.refit(selection.model)


def conclude(selection: Selection, notes: Sequence[str], plain: LikelihoodFit | None = None) -> Diagnosis:
    """The result: established causes, suspects (further causes with a probability of `possible`, 0.2), and warnings."""
    try:
        stated = state(selection, plain)
    except DataError as error:
        missing, warnings = str(error), tuple(search_warnings(selection, notes))
        return Diagnosis(verdict="too_little_data", missing=missing, warnings=warnings)
    return build_diagnosis(stated, search_warnings(stated.selection, notes))
