"""Algorithm of the diagnosis: how a cause of model error becomes established.

1. The base model is fitted to the free-running simulation, and all forms of all effects of the catalogue become
   candidates, together with every logged signal.
2. *Screen*: a score test predicts the log-likelihood gain of each candidate without a fit.
3. *Select*: the candidates with the largest predicted gain are fitted together with all other parameters. The one with
   the best BIC is added if its gain exceeds a threshold and what approximate equations may explain. Effects that lose
   their gain are removed, and effects are exchanged where another one is better, until the model no longer changes.
4. The objective of the search is the likelihood of one-step innovations, if one cause dominates what is missing.
5. Otherwise it is that of multi-step predictions. Their effects must then be as large in one-step predictions next to
   waves, and the one-step search continues from there.
6. *Validate*: alternatives that gain nearly as much are compared on all data, and the better one replaces an effect.
7. Each effect must gain log-likelihood on held-out trials, lie within its bounds, differ significantly from zero, and
   have a posterior probability of 0.95.
8. An effect that fails is banned, and the search continues without it; its place may go to the true cause.
9. *Decide*: the one-step model is reported if it is adequate after validation (white innovations, disturbance within
   its limit); otherwise the multi-step model.
10. *Conclude*: the effects that are left are established. Their parameters are fitted to all data. Further causes
    with a probability of 0.2 or more are suspects.

All numbers stand in `rovid.diagnose.thresholds`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

from rovid.core.errors import DataError
from rovid.core.spmd import forked_workers
from rovid.diagnose.build_result import build_diagnosis
from rovid.diagnose.candidate_fits import gains_by_cause
from rovid.diagnose.cross_validation import missing_data, split_runs
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
from rovid.diagnose.stepwise import ProgressCallback, StepwiseSearch, StopRule
from rovid.diagnose.thresholds import THRESHOLDS
from rovid.diagnose.validation import (
    Selection,
    drop_inconsistent,
    drop_likely,
    first_rejection,
    report_remainder,
    resolve_ties,
)
from rovid.estimate.fit_result import FitResult
from rovid.estimate.output_error import fit_output_error
from rovid.signals.preprocessing import PreparedRuns
from rovid.trial.vehicle import Vehicle

_MULTI_STEP = (
    "The innovations are not white, or the disturbance is at its limit: one-step predictions are too noisy to find "
    "causes. So the diagnosis used predictions from half to eight time constants ahead. Gains are of their "
    "log-likelihood, with correlated errors counted once."
)
_CUT_SHORT = (
    "The search ended before it was complete, because each addition asked for another one. The effects found may stand "
    "in for other causes."
)
_INCONSISTENT = (
    "{} improves multi-step predictions, but one-step predictions show less of it, as where commands respond to waves: "
    "it is not claimed."
)


def diagnose(prepared: PreparedRuns, vehicle: Vehicle, report: ProgressCallback = lambda _: None) -> Diagnosis:
    """Find the causes that the plain model misses. ``report`` is called with a line of text for each step."""
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
        try:
            start = fit_output_error(runs, min_sigmas=0.0)
        except DataError as error:
            return Diagnosis(verdict="too_little_data", missing=str(error), warnings=notes)
        problem = pose(prepared, runs, vehicle, start, report if is_first else lambda _: None)
        return conclude(decide(problem), notes)


def screen(objective: InnovationObjective, found: FitResult, shape: FitResult, is_hopeless: StopRule) -> bool:
    """Whether score tests on thinned data leave hope for a one-step search from ``found``; it saves a long search."""
    if objective.screening_data is objective.search_data:
        return True
    start = objective.begin(objective.screening_data, found, shape)
    search = objective.search(start)
    return not is_hopeless(start, lambda: gains_by_cause(search.score_tests(start)))


def select(problem: SearchProblem, objective: SearchObjective, search: StepwiseSearch, start: FitResult) -> Selection:
    """The model that a stepwise search by one of the objectives reaches from ``start``.

    Each step of the search: score tests of all candidates, staged fits of a shortlist, addition of the best one by BIC,
    elimination, exchange; see `StepwiseSearch`.
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
    """Test each effect of the model. Ban the first one that fails, search on without it, and repeat."""
    selection = report_remainder(resolve_ties(selection))
    likely: list[str] = []
    for _ in range(THRESHOLDS.max_rejections):
        rejection = first_rejection(selection, likely)
        if rejection is None:
            break
        effect = rejection.effect
        selection = selection.reject(f"{effect.title} {rejection.reason}: it is not claimed.").ban(effect)
        if rejection.is_likely:
            # A likely effect keeps its place until the end: otherwise a stand-in would take the place.
            likely.append(effect.key)
        else:
            selection = drop_inconsistent(resolve_ties(selection.drop(effect).search_on()))
    selection = drop_likely(selection, likely)
    if not selection.model.effects:
        # The base model has the limit of the disturbance that suits a model without effects.
        selection = replace(selection, model=selection.base)
    return selection


def decide(problem: SearchProblem) -> Selection:
    """Choose the objective: innovations where these become white, else multi-step predictions; return a valid model."""
    selection = select_directly(problem)
    if selection is not None:
        problem.report("Validating on held-out trials …")
        selection = resolve_ties(selection)
        # A rejection means that stand-ins were selected: then multi-step predictions decide where to start.
        if first_rejection(selection) is None and selection.is_adequate:
            return validate(selection)
    for predicted in select_by_predictions(problem):
        multi_step = drop_inconsistent(predicted)
        waves = None if multi_step.waves is None else multi_step.waves.established
        selection = select_by_innovations(problem, waves or multi_step.model, multi_step.model, cannot_whiten)
        if selection is not None:
            problem.report("Validating on held-out trials …")
            selection = validate(selection)
            if selection.is_adequate:
                return selection
    problem.report("Validating on held-out trials …")
    return validate(multi_step)


def select_directly(problem: SearchProblem) -> Selection | None:
    """One-step selection from the base model; None where no cause dominates, or the result is not adequate."""
    base = problem.innovations.base
    if fits_poorly(base):
        return None
    selection = select_by_innovations(problem, base, base, has_no_dominant_cause)
    if selection is None:
        return None
    waves = problem.wave_test(selection.model).established
    if waves is None:
        return selection
    return select_by_innovations(problem, waves, selection.model, cannot_whiten)


def select_by_innovations(
    problem: SearchProblem, found: FitResult, shape: FitResult, is_hopeless: StopRule
) -> Selection | None:
    """One-step selection from the effects of ``found``; None where it is hopeless, or the result is not adequate."""
    problem.report("Searching by one-step predictions …")
    objective = problem.innovations
    if not screen(objective, found, shape, is_hopeless):
        return None
    start = objective.begin(objective.search_data, found, shape)
    selection = select(problem, objective, objective.search(start, is_hopeless), start)
    if selection.search.progress.given_up or not selection.is_adequate:
        return None
    return selection


def select_by_predictions(problem: SearchProblem) -> Iterator[Selection]:
    """Multi-step selections: first one whose effects whiten the innovations, if any, and at last the complete one."""
    objective = MultiStepObjective.from_data(problem.data, problem.pieces, problem.candidates, problem.report)
    start = objective.base
    is_enough: Callable[[FitResult], bool] | None = problem.innovations.is_adequate
    if not objective.candidates:
        yield select(problem, objective, objective.search(None), start)
        return
    while True:
        search = objective.search(is_enough)
        selection = select(problem, objective, search, start)
        if search.progress.has_enough:
            yield selection
            # If that fails, the search is repeated to its end.
            is_enough = None
            continue
        reweighted = objective.reweighted(search, selection.model)
        if reweighted.data.effective_count < THRESHOLDS.reweighting_growth * objective.data.effective_count:
            yield replace(selection, search=replace(search, is_enough=None))
            return
        # The selected effects make the errors less correlated: more predictions count, and the search goes on.
        objective = replace(reweighted, base=reweighted.refit(objective.base))
        start = objective.refit(selection.model)


def conclude(selection: Selection, notes: Sequence[str]) -> Diagnosis:
    """The result: established causes with estimates and alternatives, suspects, held-out scores, and warnings."""
    warnings = [_MULTI_STEP] if selection.multi_step else list(notes)
    if selection.search.progress.cut_short:
        warnings.append(_CUT_SHORT)
    warnings += [_INCONSISTENT.format(effect.title) for effect in selection.inconsistent]
    warnings += selection.rejections
    try:
        return build_diagnosis(selection, warnings)
    except DataError as error:
        return Diagnosis(verdict="too_little_data", missing=str(error), warnings=tuple(warnings))
