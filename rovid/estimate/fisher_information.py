"""What innovations cost, and the slopes of that cost, which Fisher scoring asks for."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple, Self

import numpy as np

from rovid.core.array_types import FloatArray, IntArray

# Innovations beyond so many standard deviations count in proportion, not squared (Huber 1964).
OUTLIER = 5.0
_FARTHEST = 1e100
# Innovations that are taken at once where sums are all that is asked for: a core's cache holds them.
_AT_ONCE = 8192
_WORST = 1e12


class Innovations(NamedTuple):
    """(N,) errors of predictions, in the unit of what is predicted, and the variances that they are taken to have."""

    error: FloatArray
    variance: FloatArray

    def select(self, rows: slice) -> Self:
        """Those of some ``rows``."""
        return type(self)(self.error[rows], self.variance[rows])

    @classmethod
    def empty(cls, count: int) -> Self:
        """Room for so many."""
        return cls(np.empty(count), np.empty(count))


@dataclass(frozen=True, eq=False)
class Jacobian:
    """The cost of some innovations about a point.

    Attributes
    ----------
    rows
        Which n of the N innovations they are.
    residual
        (2n,) normalised innovations above, and what their squares are short of one below.
    matrix
        (2n, p) slopes of the same.
    """

    rows: slice
    residual: FloatArray
    matrix: FloatArray

    @property
    def gradient(self) -> FloatArray:
        """(p,) of the cost."""
        with np.errstate(over="ignore", invalid="ignore"):
            return np.asarray(self.matrix.T @ self.residual)

    @property
    def information(self) -> FloatArray:
        """(p, p) curvature that the cost is expected to have (Fisher scoring)."""
        # A model that runs away has none, which whoever asks can see.
        with np.errstate(over="ignore", invalid="ignore"):
            return np.asarray(self.matrix.T @ self.matrix)

    def cross_information(self, others: Jacobian) -> FloatArray:
        """(p, s) what the information has between these p coordinates and s others of the same innovations."""
        with np.errstate(over="ignore", invalid="ignore"):
            return np.asarray(self.matrix.T @ others.matrix)

    @property
    def scores(self) -> FloatArray:
        """(n, p) gradient of what each innovation adds to the cost."""
        above, below = np.split(self.matrix * self.residual[:, None], 2)
        return np.asarray(above + below)


class NormalEquations(NamedTuple):
    """(p,) gradient and (p, p) information of the cost of all innovations about a point."""

    gradient: FloatArray
    information: FloatArray

    @classmethod
    def from_jacobians(cls, pieces: Iterable[Jacobian]) -> Self:
        """The sums over all ``pieces``."""
        return cls.sum_of(cls(piece.gradient, piece.information) for piece in pieces)

    @classmethod
    def sum_of(cls, each: Iterable[Self]) -> Self:
        """Of all innovations, of some of them each."""
        gradient, information = (sum(every) for every in zip(*each, strict=True))
        return cls(np.asarray(gradient), np.asarray(information))


def negative_log_likelihoods(error: FloatArray, variance: FloatArray) -> FloatArray:
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


def total_negative_log_likelihood(here: Innovations, weight: float | FloatArray) -> float:
    """Negative log-likelihood of innovations that count with this ``weight`` each; large, but finite, of a runaway."""
    weights = np.broadcast_to(weight, here.error.shape)
    total = sum(
        float(np.sum(weights[rows] * negative_log_likelihoods(*here.select(rows))))
        for rows in _pieces(len(weights), _AT_ONCE)
    )
    return total if math.isfinite(total) else _WORST


def _pieces(count: int, at_once: int) -> list[slice]:
    """So many innovations, some after the other; one piece if there is none."""
    return [slice(begin, min(begin + at_once, count)) for begin in range(0, max(count, 1), at_once)]


@dataclass(frozen=True, eq=False)
class GroupedScores:
    """The information about a point, and how the gradient scatters, which may be more.

    Attributes
    ----------
    information
        (p, p) of all innovations.
    scores
        Of each grouping of the innovations the (m, p) gradients of the cost over each of m groups.
    """

    information: FloatArray
    scores: list[FloatArray]

    @classmethod
    def of(cls, pieces: Iterable[Jacobian], groupings: Sequence[IntArray]) -> Self:
        """By (N,) numbers of groups, of which there may be several ways to group them."""
        numbered = [np.unique(groups, return_inverse=True) for groups in groupings]
        information, scores = np.zeros(()), [np.zeros(()) for _ in groupings]
        for piece in pieces:
            information = information + piece.information
            columns = piece.scores.T
            for at, (used, number) in enumerate(numbered):
                sums = [np.bincount(number[piece.rows], weights=column, minlength=len(used)) for column in columns]
                scores[at] = scores[at] + np.column_stack(sums)
        return cls(information, scores)


def jacobian_chunks(
    centre: Innovations,
    sides: Sequence[Innovations],
    step: FloatArray,
    weight: float | FloatArray,
    at_once: int = _AT_ONCE,
    first: int = 0,
) -> Iterator[Jacobian]:
    """Slopes from the innovations at a point and one ``step`` aside along each coordinate, some after the other.

    These are those of all from the ``first`` on.
    """
    weights = np.broadcast_to(weight, centre.error.shape)
    for rows in _pieces(len(weights), at_once):
        here, *there = (one.select(rows) for one in (centre, *sides))
        yield _slopes(slice(first + rows.start, first + rows.stop), here, there, step, weights[rows])


def _slopes(
    rows: slice, centre: Innovations, sides: Sequence[Innovations], step: FloatArray, weight: FloatArray
) -> Jacobian:
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
    return Jacobian(rows, np.concatenate((robust * z, short)), matrix)
