"""A run with optimised levels and switching times: a pattern of held commands that repeats."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.estimate.candidate_runs import LEAD_SECONDS, CandidateRun, RunScales, sampled_shares

# Levels of a pattern, and the shortest and longest hold of a level in time constants of the vehicle: as in the list of
# candidate runs.
_LEVELS, _HOLDS = 6, (0.15, 10.0)
# Random patterns and regular ones among which the search starts, searches, and evaluations of each. About 350 in all.
_RANDOM, _REGULAR, _SEARCHES, _EVALUATIONS = 40, 6, 2, 150
# Seed of the random patterns: a plan is the same whenever it is made.
_SEED = 20130401


def design_run(worth: Callable[[CandidateRun], float], scales: RunScales, seconds: float) -> CandidateRun:
    """The run of about ``seconds`` with the largest ``worth``, which is negative for a run beyond the limits.

    Powell's method over levels and logarithms of holds, from the best of random and of regular patterns.
    """
    from scipy import optimize  # The import takes long.

    low, high = np.log(_HOLDS)
    bounds = np.array([(-1.0, 1.0)] * _LEVELS + [(low, high)] * _LEVELS)
    rng = np.random.default_rng(_SEED)
    alternating = np.where(np.arange(_LEVELS) % 2, -1.0, 1.0)
    starts = [np.append(alternating, np.full(_LEVELS, hold)) for hold in np.linspace(low, high, _REGULAR)]
    for _ in range(_RANDOM):
        levels = rng.uniform(0.3, 1.0, _LEVELS) * rng.choice((-1.0, 1.0), _LEVELS)
        starts.append(np.append(levels, rng.uniform(low, 0.6 * high) + rng.normal(0.0, 0.5, _LEVELS)))
    duration = seconds - LEAD_SECONDS

    def cost(pattern: FloatArray) -> float:
        return -worth(pattern_run(pattern, scales, duration))

    def search(start: FloatArray) -> FloatArray:
        found = optimize.minimize(
            cost,
            start,
            method="Powell",
            bounds=optimize.Bounds(*bounds.T),
            options={"maxfev": _EVALUATIONS, "xtol": 0.05, "ftol": 0.01},
        )
        return np.asarray(np.clip(found.x, *bounds.T))

    ranked = sorted((np.clip(start, *bounds.T) for start in starts), key=cost)
    best = min([ranked[0], *map(search, ranked[:_SEARCHES])], key=cost)
    return pattern_run(best, scales, duration)


def pattern_run(pattern: FloatArray, scales: RunScales, seconds: float) -> CandidateRun:
    """The run that repeats a pattern for ``seconds``: levels, and logarithms of holds in time constants."""
    levels, holds = np.split(pattern, 2)
    holds = np.maximum(scales.constant * np.exp(holds), scales.period)
    count = math.ceil(seconds / holds.sum())
    pieces = []
    for hold, level in zip(np.tile(holds, count).tolist(), np.tile(levels, count).tolist(), strict=True):
        pieces.append((min(hold, seconds), round(level, 2)))
        seconds -= hold
        if seconds <= 0.0:
            break
    time, shares = sampled_shares(pieces, scales)
    words = ", ".join(f"{100.0 * level:.0f} % for {hold:.2g} s" for level, hold in zip(levels, holds, strict=True))
    return CandidateRun(name=f"designed: {words}, repeated", time=time, commands=scales.commands(shares))
