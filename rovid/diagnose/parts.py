"""A long trial cut into parts, where there are too few trials to hold any out."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from rovid.rates import highest_cutoff
from rovid.runs import Run, Runs, prepare
from rovid.trial import Campaign, Trial
from rovid.vehicle import Vehicle

FEWEST_TRIALS = 4
_PARTS = 8
_SHORTEST = 30.0  # s; a part
_CUTOFF_PERIODS = 8.0  # the filter takes two and a half of them
_FEWEST = 10  # in a part, as in a log
_PAUSE, _PAUSE_PERIODS = 10.0, 10.0  # s, and usual intervals between readings


def parts_of(runs: Sequence[Run], vehicle: Vehicle, cutoff: float) -> Runs | None:
    """Runs of about an eighth of all time each, or of half a minute or what the filter wants where that is longer.

    None where there are runs enough, or too little time.

    Each part starts anew: angles turned and water set in motion before it are forgotten.
    """
    if len(runs) >= FEWEST_TRIALS:
        return None
    total = sum(recorded(run.trial) for run in runs)
    length = max(total / _PARTS, shortest_part(cutoff))
    trials = [part for run in runs for part in _cut(run.trial, length)]
    if len(trials) < FEWEST_TRIALS:
        return None
    shared = min(cutoff, highest_cutoff(trials))
    return prepare(Campaign(trials=tuple(trials), sources=()), vehicle, cutoff=shared)


def shortest_part(cutoff: float) -> float:
    """Length in s that a part has at least, for a low pass with this ``cutoff`` in Hz."""
    return max(_SHORTEST, _CUTOFF_PERIODS / cutoff)


def recorded(trial: Trial) -> float:
    """Time in s over which positions were measured, pauses left out."""
    return sum(float(np.ptp(trial.time[session])) for session in _sessions(trial))


def _sessions(trial: Trial) -> list[NDArray[np.intp]]:
    """Indices of the measured positions between pauses."""
    measured = np.flatnonzero(trial.measured)
    pauses = np.diff(trial.time[measured]) > max(_PAUSE_PERIODS * trial.period, _PAUSE)
    return np.split(measured, 1 + np.flatnonzero(pauses))


def _cut(trial: Trial, length: float) -> list[Trial]:
    """Parts that begin and end with a measured position, as logs do, none across a pause."""
    pieces: list[NDArray[np.intp]] = []
    for session in _sessions(trial):
        time = trial.time[session]
        ends = np.linspace(time[0], time[-1], max(round(float(np.ptp(time)) / length), 1) + 1)
        pieces += np.split(session, np.searchsorted(time, ends[1:-1]))
    return [
        trial.part(slice(int(piece[0]), int(piece[-1]) + 1), f"{trial.name} part {number}")
        for number, piece in enumerate(pieces, start=1)
        if len(piece) >= _FEWEST
    ]
