"""A long trial cut into parts, where there are too few trials to hold any out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rovid.core.array_types import IntArray
from rovid.core.errors import DataError
from rovid.estimate.dataset import rms_rate
from rovid.estimate.multi_step_data import time_constant
from rovid.estimate.output_error import fit_output_error
from rovid.signals.preprocessing import PreparedRuns, Run, prepare
from rovid.signals.rates import highest_cutoff
from rovid.trial.trial import Campaign, Trial
from rovid.trial.vehicle import Vehicle

MIN_TRIALS = 4
_PARTS = 8
# Time constants of the vehicle that a part lasts at least: what was before it is then forgotten in most of it.
_SHORTEST = 4.0
# Or so many, where there would be too few parts: what is missing makes the plain model's time constant too long, too.
_SHORTEST_OF_ALL = 2.0
_UNKNOWN = 30.0  # s, where the time constant is not known
_CUTOFF_PERIODS = 8.0  # the filter takes two and a half of them
_FEWEST = 10  # in a part, as in a log
_PAUSE, _PAUSE_PERIODS = 10.0, 10.0  # s, and usual intervals between readings


@dataclass(frozen=True, eq=False)
class CvPiece:
    """From ``begin`` to ``end`` in s of the run number ``whole``, as a run by itself."""

    run_index: int
    begin: float
    end: float
    run: Run


def split_runs(runs: Sequence[Run], vehicle: Vehicle, cutoff: float) -> PreparedRuns | None:
    """Runs of about an eighth of all time each, or of `shortest_part` where that is longer.

    None where there are runs enough, or too little time.

    Each part starts anew: angles turned and water set in motion before it are forgotten.
    """
    if len(runs) >= MIN_TRIALS:
        return None
    trials = [cut.trial for _, cut in _all_cuts(runs, cutoff)]
    if len(trials) < MIN_TRIALS:
        return None
    shared = min(cutoff, highest_cutoff(trials))
    return prepare(Campaign(trials=tuple(trials), sources=()), vehicle, cutoff=shared)


def cv_pieces(runs: Sequence[Run], vehicle: Vehicle, cutoff: float) -> list[CvPiece]:
    """All ``runs`` in pieces: each by itself where there are enough, cut where that leaves pieces long enough."""
    cuts = _all_cuts(runs, cutoff)
    trials = [cut.trial for _, cut in cuts]
    shared = min(cutoff, highest_cutoff(trials))
    made = prepare(Campaign(trials=tuple(trials), sources=()), vehicle, cutoff=shared).items
    pieces = []
    for (whole, cut), run in zip(cuts, made, strict=True):
        pieces.append(CvPiece(whole, cut.begin, cut.end, run))
    return pieces


def min_part_length(runs: Sequence[Run], cutoff: float) -> float:
    """Length in s that a part has at least: some time constants, and what a low pass of ``cutoff`` in Hz wants."""
    try:
        start = fit_output_error(runs, min_sigmas=0.0)
        constant = time_constant(start, rms_rate(runs))
        quarter = sum(recorded_seconds(run.trial) for run in runs) / MIN_TRIALS
        shortest = min(max(quarter, _SHORTEST_OF_ALL * constant), _SHORTEST * constant)
    except DataError:
        shortest = _UNKNOWN
    return max(shortest, _CUTOFF_PERIODS / cutoff)


def recorded_seconds(trial: Trial) -> float:
    """Time in s over which positions were measured, pauses left out."""
    return sum(float(np.ptp(trial.time[session])) for session in _sessions(trial))


def _sessions(trial: Trial) -> list[IntArray]:
    """Indices of the measured positions between pauses."""
    measured = np.flatnonzero(trial.measured)
    pauses = np.diff(trial.time[measured]) > max(_PAUSE_PERIODS * trial.sampling_interval, _PAUSE)
    return np.split(measured, 1 + np.flatnonzero(pauses))


@dataclass(frozen=True, eq=False)
class _Cut:
    """A stretch of a trial, from ``begin`` to ``end`` in s of it."""

    begin: float
    end: float
    trial: Trial


def _all_cuts(runs: Sequence[Run], cutoff: float) -> list[tuple[int, _Cut]]:
    """Of every run, by its number.

    Two at least of a run that is long enough: what is of one trial alone is told by one part and tried on the other.
    """
    shortest = min_part_length(runs, cutoff)
    usual = max(sum(recorded_seconds(run.trial) for run in runs) / _PARTS, shortest)
    cuts = []
    for whole, run in enumerate(runs):
        half = recorded_seconds(run.trial) / 2.0
        length = min(usual, max(half, shortest))
        cuts += [(whole, cut) for cut in _cuts(run.trial, length)]
    return cuts


def _cuts(trial: Trial, length: float) -> list[_Cut]:
    """Parts that begin and end with a measured position, as logs do, none across a pause."""
    pieces: list[IntArray] = []
    for session in _sessions(trial):
        time = trial.time[session]
        count = max(round(float(np.ptp(time)) / length), 1)
        ends = np.linspace(time[0], time[-1], count + 1)
        pieces += np.split(session, np.searchsorted(time, ends[1:-1]))
    cuts = []
    for number, piece in enumerate(pieces, start=1):
        if len(piece) < _FEWEST:
            continue
        first, last = int(piece[0]), int(piece[-1])
        part = trial.part(slice(first, last + 1), f"{trial.name} part {number}")
        cuts.append(_Cut(float(trial.time[first]), float(trial.time[last]), part))
    return cuts
