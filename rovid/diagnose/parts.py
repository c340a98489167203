"""A long trial cut into parts, where there are too few trials to hold any out."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rovid.rates import highest_cutoff
from rovid.runs import Run, Runs, prepare
from rovid.trial import Campaign, FloatArray, Trial
from rovid.vehicle import Vehicle

FEWEST_TRIALS = 4
_PARTS = 8
_SHORTEST = 30.0  # s; a part
_CUTOFF_PERIODS = 8.0  # the filter takes two and a half of them
_FEWEST = 10  # in a part, as in a log
_PAUSE = 10.0  # usual intervals between readings; of a longer one no more counts


def parts_of(runs: Sequence[Run], vehicle: Vehicle, cutoff: float) -> Runs | None:
    """Runs of about an eighth of all time each, none shorter than half a minute or than the filter wants.

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
    return float(_clock(trial)[-1])


def _clock(trial: Trial) -> FloatArray:
    """(m,) s at each measured position on a clock that stands still in a pause."""
    steps = np.diff(trial.time[trial.measured])
    return np.concatenate(([0.0], np.cumsum(np.minimum(steps, _PAUSE * trial.period))))


def _cut(trial: Trial, length: float) -> list[Trial]:
    """Parts that begin and end with a measured position, as logs do."""
    measured, clock = np.flatnonzero(trial.measured), _clock(trial)
    count = max(round(float(clock[-1]) / length), 1)
    pieces = np.split(measured, np.searchsorted(clock, np.linspace(0.0, clock[-1], count + 1)[1:-1]))
    return [
        trial.part(slice(int(piece[0]), int(piece[-1]) + 1), f"{trial.name} part {number}")
        for number, piece in enumerate(pieces, start=1)
        if len(piece) >= _FEWEST
    ]
