"""What is wrong with the model, why, how much better it gets, what is left, and what to run next."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from importlib import import_module

from rovid.core.errors import DataError
from rovid.core.spmd import forked_workers
from rovid.diagnose.build_result import build_diagnosis
from rovid.diagnose.data_requirements import missing_data
from rovid.diagnose.result import Diagnosis
from rovid.diagnose.signal_regressors import signal_regressors
from rovid.diagnose.splitting import cv_pieces, split_runs
from rovid.diagnose.stepwise import ProgressCallback
from rovid.diagnose.strategies import ByInnovations, by_horizons, few_of, wave_search
from rovid.diagnose.validation import Work
from rovid.effects import forms_for
from rovid.estimate.filter_data import InnovationData
from rovid.estimate.output_error import fit_output_error
from rovid.signals.preprocessing import PreparedRuns, Run, shared_channels
from rovid.trial.vehicle import Vehicle

_BY_HORIZONS = (
    "The innovations are not white, or the disturbance is at its limit: each next reading would not tell what is "
    "missing. So causes were judged by predictions from half to eight time constants ahead; gains are of their "
    "log-likelihood, with errors that correlate counted as one."
)
# Instants; of longer logs compiled loops are most of the work, which threads share, and copies would take memory.
_LONG = 300_000
# What a diagnosis takes of large libraries.
_IMPORTED = ("scipy.linalg", "scipy.optimize")
_TESTING = "Testing what was found on trials that were not fitted …"
_SHRUNK = (
    "With {} predictions would be better, but each next reading shows less of it than that asks for, as where commands "
    "answer what waves do: it is not claimed."
)
_CUT_SHORT = (
    "The search was ended before nothing more could be found: each addition asked for another. What was found is "
    "likely to stand for something else."
)


def _said(work: Work, notes: list[str]) -> list[str]:
    """How the search went; ``notes`` are of the parts that runs were cut into, which predictions do not look at."""
    said = [_BY_HORIZONS] if work.by_horizons else notes.copy()
    if work.search.cut_short:
        said.append(_CUT_SHORT)
    said += [_SHRUNK.format(effect.title) for effect in work.shrunk]
    return said


def preload() -> None:
    """Import and load what a diagnosis takes: best while the logs are read, and before each copy does so for itself."""
    from rovid.model.kernels import compile_all, is_compiled

    for name in _IMPORTED:
        import_module(name)
    if is_compiled():
        compile_all()


def diagnose(prepared: PreparedRuns, vehicle: Vehicle, report: ProgressCallback = lambda _: None) -> Diagnosis:
    """Name what the simulation misses.

    Parameters
    ----------
    report
        Called with a line of text as the work goes on.
    """
    runs, notes = prepared.items, []
    parts = split_runs(runs, vehicle, prepared.cutoff)
    if parts is not None:
        runs = parts.items
        notes.append(
            f"There are too few trials ({len(prepared.items)}) to hold any out: they were cut into {len(runs)} parts, "
            "each simulated from its own start."
        )
    if lack := missing_data(runs, prepared.cutoff):
        return Diagnosis(verdict="too_little_data", missing=lack, warnings=tuple(notes))
    preload()
    with forked_workers(enabled=_is_shared_by_copies(prepared.items)) as is_first:
        report = report if is_first else _unsaid
        try:
            start = fit_output_error(runs, min_sigmas=0.0)
        except DataError as error:
            return Diagnosis(verdict="too_little_data", missing=str(error), warnings=tuple(notes))
        report("Fitting the model without effects …")
        pieces = cv_pieces(prepared.items, vehicle, prepared.cutoff)
        counted = Counter(piece.run_index for piece in pieces)
        trials = [run.trial.name for run in prepared.items]
        repeated = [name for number, name in enumerate(trials) if counted[number] > 1]
        forms = forms_for(vehicle, shared_channels(runs), trials, repeated)
        cut = [piece.run for piece in pieces]
        candidates = (*forms, *signal_regressors((*prepared.items, *runs, *cut)))
        whole = InnovationData(prepared.items, vehicle, start)
        few = few_of(whole)
        near = ByInnovations(replace(whole, runs=runs), few, candidates, report)
        waves = wave_search(few, forms, pieces, report)
        at_once = near.at_once(waves)
        if at_once is not None:
            report(_TESTING)
            # Where some of it would have to be refused the way was not as straight as it seemed.
            if at_once.holds():
                return _told(at_once, at_once.decided(), notes)
        for ahead in by_horizons(whole, pieces, candidates, report, near.explains):
            ahead.look_for_waves = waves
            found = _by_next_readings(near, ahead, report)
            if found is not None:
                return _told(*found, notes)
        report(_TESTING)
        return _told(ahead, ahead.decided(), notes)


def _is_shared_by_copies(runs: Sequence[Run]) -> bool:
    """Unless each copy would compile what is not yet, or logs are long."""
    from rovid.model.kernels import is_compiled

    return is_compiled() and sum(len(run.trial.time) for run in runs) < _LONG


def _unsaid(_: str) -> None:
    """As the first process says it."""


def _by_next_readings(near: ByInnovations, ahead: Work, report: ProgressCallback) -> tuple[Work, list[str]] | None:
    """What each next reading finds from ``ahead`` on, and what was refused of it; None if it does not explain all."""
    ahead.settle()
    work = near.search(ahead)
    if work is None:
        return None
    report(_TESTING)
    refused = work.decided()
    # What made it explain all may be refused: then predictions tell.
    return (work, refused) if work.explains else None


def _told(work: Work, refused: list[str], notes: list[str]) -> Diagnosis:
    """What is said of ``work``, with what was ``refused`` in it."""
    warnings = [*_said(work, notes), *refused]
    try:
        return build_diagnosis(work, [work.cause(effect) for effect in work.final.effects], warnings)
    except DataError as error:
        return Diagnosis(verdict="too_little_data", missing=str(error), warnings=tuple(warnings))
