"""A long trial cut into parts, where there are too few trials to hold any out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

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


def parts_of(runs: Sequence[Run], vehicle: Vehicle, cutoff: float) -> Runs | None:
    """Runs of about an eighth of all time each, none shorter than half a minute or than the filter wants.

    None where there are runs enough, or too little time.

    Each part starts anew: angles turned and water set in motion before it are forgotten.
    """
    if len(runs) >= FEWEST_TRIALS:
        return None
    total = sum(run.trial.duration for run in runs)
    length = max(total / _PARTS, shortest_part(cutoff))
    trials = [part for run in runs for part in _cut(run.trial, length)]
    if len(trials) < FEWEST_TRIALS:
        return None
    shared = min(cutoff, highest_cutoff(trials))
    return prepare(Campaign(trials=tuple(trials), sources=()), vehicle, cutoff=shared)


def shortest_part(cutoff: float) -> float:
    """Length in s that a part has at least, for a low pass with this ``cutoff`` in Hz."""
    return max(_SHORTEST, _CUTOFF_PERIODS / cutoff)


def _cut(trial: Trial, length: float) -> list[Trial]:
    """Parts that begin and end with a measured position, as logs do; those that fall into a gap are left out."""
    count = max(round(trial.duration / length), 1)
    edges = np.searchsorted(trial.time, np.linspace(0.0, trial.duration, count + 1)[1:-1])
    bounds = [0, *(int(edge) for edge in edges), len(trial.time)]
    pieces = [first + np.flatnonzero(trial.measured[first:last]) for first, last in pairwise(bounds)]
    return [
        _part(trial, slice(int(piece[0]), int(piece[-1]) + 1), number)
        for number, piece in enumerate(pieces, start=1)
        if len(piece) >= _FEWEST
    ]


def _part(trial: Trial, where: slice, number: int) -> Trial:
    def cut(values: FloatArray | None) -> FloatArray | None:
        return None if values is None else values[where]

    return replace(
        trial,
        name=f"{trial.name} part {number}",
        time=trial.time[where] - trial.time[where.start],
        position=trial.position[where],
        commands=trial.commands[where],
        rate=cut(trial.rate),
        roll=cut(trial.roll),
        pitch=cut(trial.pitch),
        extras={name: values[where] for name, values in trial.extras.items()},
    )
