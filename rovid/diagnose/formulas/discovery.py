"""Discovery of formulas: causes of the catalogue come first, then formulas next to them and next to the plain model."""

from dataclasses import replace

from rovid.core.budget import Budget, ProgressCallback
from rovid.core.errors import DataError
from rovid.core.spmd import forked_workers
from rovid.diagnose.algorithm import decide
from rovid.diagnose.cross_validation import missing_data, split_runs
from rovid.diagnose.formulas.search import Discovery, FormulaSearch
from rovid.diagnose.objectives import pose, preload
from rovid.diagnose.thresholds import THRESHOLDS
from rovid.trial.preprocessing import PreparedRuns
from rovid.trial.vehicle import Vehicle


def discover(
    prepared: PreparedRuns, vehicle: Vehicle, report: ProgressCallback = lambda _: None, budget: Budget | None = None
) -> Discovery:
    """Formulas for what the effects of the catalogue do not explain."""
    runs = prepared.items
    if (parts := split_runs(runs, vehicle, prepared.cutoff)) is not None:
        runs = parts.items
    if missing := missing_data(runs, prepared.cutoff):
        return Discovery(missing=missing)
    is_compiled = preload()
    samples = sum(len(run.trial.time) for run in prepared.items)
    with forked_workers(enabled=is_compiled and samples < THRESHOLDS.fork_samples) as is_first:
        own = replace(budget or Budget(), report=report if is_first else lambda _: None)
        try:
            problem = pose(prepared, runs, vehicle, own)
        except DataError as error:
            return Discovery(missing=str(error))
        selected = decide(problem).model
    return FormulaSearch(problem, selected, report).run()
