"""Fisher scoring: what an innovation costs, and steps that make all of them cost less."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np

from rovid.ground.arrays import FloatArray

# Innovations beyond so many standard deviations count in proportion, not squared (Huber 1964).
OUTLIER = 5.0
_FARTHEST = 1e100
# Curvature of less than this share of the promised is noise of the slopes.
_LEAST_CURVATURE = 1e-3


def costs(error: FloatArray, variance: FloatArray) -> FloatArray:
    """(N,) what each innovation costs, its variance included."""
    # No innovation is so far out that its square could not be told from infinity; a filter that runs away has no
    # likelihood, which whoever asks can see.
    with np.errstate(over="ignore", invalid="ignore"):
        z = np.minimum(np.abs(error) / np.sqrt(variance), _FARTHEST)
    square = np.where(z > OUTLIER, OUTLIER * (2.0 * z - OUTLIER), z * z)
    return np.asarray(0.5 * (np.log(2.0 * np.pi * variance) + square))


def bounded_step(
    x: FloatArray,
    gradient: FloatArray,
    information: FloatArray,
    damping: float,
    bounds: tuple[FloatArray, FloatArray],
) -> FloatArray:
    """Levenberg-Marquardt step from ``x``; coordinates that would leave their lower and upper ``bounds`` stay."""
    low, high = bounds
    free = ~(((x <= low) & (gradient > 0.0)) | ((x >= high) & (gradient < 0.0)))
    step = np.zeros(len(x))
    size = np.diag(information)
    for _ in range(len(x)):
        if not free.any():
            break
        part = np.ix_(free, free)
        # Even a coordinate along which nothing changes has to be solved for.
        floor = 1e-12 * float(size.max()) + 1e-12
        matrix = information[part] + np.diag(damping * size[free] + floor)
        step[:] = 0.0
        step[free] = np.linalg.lstsq(matrix, -gradient[free], rcond=None)[0]
        # A coordinate at its bound that the others push outward is held there too.
        out = free & (((x <= low) & (step < 0.0)) | ((x >= high) & (step > 0.0)))
        if not out.any():
            break
        free &= ~out
    return step


def damped(damping: float, ratio: float) -> float:
    """Damping of the next step, by the ``ratio`` of what the last one gained to what was expected of it."""
    if ratio > 0.75:
        return max(damping * 0.1, 1e-7)
    if ratio < 0.4:
        return damping * 10.0
    return damping


def with_curvature(information: FloatArray, been: Sequence[tuple[FloatArray, FloatArray]]) -> FloatArray:
    """``information`` with the curvature between the points and gradients of before, last of all the latest.

    Far from white innovations the information promises too little of it, and scoring alone crawls. It is told by
    differences of gradients (BFGS: Nocedal & Wright 2006, section 6.1), which change nothing where it is right.
    """
    matrix = information.copy()
    for (x, gradient), (following, slope) in itertools.pairwise(been):
        step, change = following - x, slope - gradient
        expected = matrix @ step
        met, promised = float(step @ change), float(step @ expected)
        if met > _LEAST_CURVATURE * promised > 0.0:
            matrix += np.outer(change, change) / met - np.outer(expected, expected) / promised
    return matrix
