"""What innovations cost, and the slopes of that cost, which Fisher scoring asks for."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from rovid.ground.arrays import FloatArray

# Innovations beyond so many standard deviations count in proportion, not squared (Huber 1964).
OUTLIER = 5.0
_FARTHEST = 1e100
_WORST = 1e12


class Innovations(NamedTuple):
    """(N,) errors of predictions, in the unit of what is predicted, and the variances that they are taken to have."""

    error: FloatArray
    variance: FloatArray


@dataclass(frozen=True, eq=False)
class Slopes:
    """The cost about a point.

    Attributes
    ----------
    cost
        Negative log-likelihood.
    residual
        (2N,) normalised innovations above, and what their squares are short of one below.
    matrix
        (2N, p) slopes of the same.
    """

    cost: float
    residual: FloatArray
    matrix: FloatArray

    @property
    def gradient(self) -> FloatArray:
        """(p,) of the cost."""
        return np.asarray(self.matrix.T @ self.residual)

    @property
    def information(self) -> FloatArray:
        """(p, p) curvature that the cost is expected to have (Fisher scoring)."""
        return np.asarray(self.matrix.T @ self.matrix)


def costs(error: FloatArray, variance: FloatArray) -> FloatArray:
    """(N,) what each innovation costs, its variance included."""
    # A filter that runs away has no likelihood, which whoever asks can see.
    with np.errstate(over="ignore", invalid="ignore"):
        square = _robust_square(error / np.sqrt(variance))
        return np.asarray(0.5 * (np.log(2.0 * np.pi * variance) + square))


def _robust_square(z: FloatArray) -> FloatArray:
    """(N,) squares of normalised innovations, beyond the outliers' limit in proportion."""
    # No innovation is so far out that its square could not be told from infinity.
    size = np.minimum(np.abs(z), _FARTHEST)
    return np.where(size > OUTLIER, OUTLIER * (2.0 * size - OUTLIER), size * size)


def total_cost(here: Innovations, weight: float | FloatArray) -> float:
    """Negative log-likelihood of innovations that count with this ``weight`` each; large, but finite, of a runaway."""
    total = float(np.sum(weight * costs(*here)))
    return total if math.isfinite(total) else _WORST


def slopes_between(
    centre: Innovations,
    sides: Sequence[Innovations],
    step: FloatArray,
    weight: float | FloatArray,
) -> Slopes:
    """Slopes from the innovations at a point and one ``step`` aside along each coordinate."""
    error, variance = centre
    root = np.sqrt(variance)
    z = error / root
    # So that squares have the weights.
    share = np.sqrt(weight)
    robust = share * np.sqrt(np.minimum(1.0, OUTLIER / np.maximum(np.abs(z), 1e-300)))
    # A column is written and read as a whole.
    matrix = np.empty((2 * len(z), len(sides)), order="F")
    # A model that runs away has no slopes, which whoever asks can see.
    with np.errstate(over="ignore", invalid="ignore"):
        of_error, of_variance = robust / root, share / (math.sqrt(2.0) * variance)
        for k, (side, scatter) in enumerate(sides):
            matrix[: len(z), k] = of_error / step[k] * (side - error)
            matrix[len(z) :, k] = of_variance / step[k] * (scatter - variance)
    short = (share - (robust * z) ** 2 / share) / math.sqrt(2.0)
    return Slopes(total_cost(centre, weight), np.concatenate((robust * z, short)), matrix)
