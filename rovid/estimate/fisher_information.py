"""Negative log-likelihood of innovations, its gradient and Fisher information, and covariances from them."""

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple, Self

import numpy as np

from rovid.core.array_types import FloatArray, IntArray
from rovid.core.stats import chi2_sf

# Standard deviations beyond which an innovation counts in proportion instead of squared (Huber 1964).
OUTLIER = 5.0
# Largest normalised innovation; its square stays far below infinity.
_MAX_Z = 1e100
# Innovations that are processed at once where only sums are needed: as many as a core's cache holds.
_CHUNK = 8192
# Negative log-likelihood of a model that diverges: finite, and worse than any other.
_DIVERGED = 1e12
# Least eigenvalue of the scaled information, relative to the largest, which is about one. Below it the likelihood is
# flat.
_FLAT = 1e-9
# Ljung-Box test: lags, least p-value of white innovations; and the largest excess kurtosis of light tails.
_LAGS, _MIN_P, _MAX_KURTOSIS = 20, 1e-3, 1.0


class Innovations(NamedTuple):
    """(N,) prediction errors in the unit of the prediction, and the variances that the model expects of them."""

    error: FloatArray
    variance: FloatArray

    def select(self, rows: slice) -> Self:
        """The innovations of some ``rows``."""
        return type(self)(self.error[rows], self.variance[rows])


@dataclass(frozen=True, eq=False)
class Jacobian:
    """Derivatives of normalised residuals by the p coordinates, for n of the N innovations.

    The negative log-likelihood of an innovation is half the sum of squares of two residuals to second order: the
    normalised innovation, and (1 - z^2)/sqrt(2), which carries the derivative by the variance.
    """

    rows: slice  #: Rows of the n among the N innovations.
    residual: FloatArray  #: (2n,) the n normalised innovations, followed by the n variance residuals.
    matrix: FloatArray  #: (2n, p) derivatives of ``residual``.

    @property
    def gradient(self) -> FloatArray:
        """(p,) gradient of the negative log-likelihood."""
        with np.errstate(over="ignore", invalid="ignore"):
            return np.asarray(self.matrix.T @ self.residual)

    @property
    def information(self) -> FloatArray:
        """(p, p) Fisher information; not finite where the model diverges."""
        return self.cross_information(self)

    def cross_information(self, others: "Jacobian") -> FloatArray:
        """(p, s) Fisher information between these p coordinates and s others of the same innovations."""
        with np.errstate(over="ignore", invalid="ignore"):
            return np.asarray(self.matrix.T @ others.matrix)

    @property
    def scores(self) -> FloatArray:
        """(n, p) contribution of each innovation to the gradient."""
        above, below = np.split(self.matrix * self.residual[:, None], 2)
        return np.asarray(above + below)


class NormalEquations(NamedTuple):
    """(p,) gradient and (p, p) Fisher information of the negative log-likelihood of all innovations."""

    gradient: FloatArray
    information: FloatArray

    @classmethod
    def from_jacobians(cls, pieces: Iterable[Jacobian]) -> Self:
        """Sums over all ``pieces``."""
        return cls.sum_of(cls(piece.gradient, piece.information) for piece in pieces)

    @classmethod
    def sum_of(cls, each: Iterable[Self]) -> Self:
        """Sums over the equations of several parts of the innovations."""
        gradient, information = map(sum, zip(*each, strict=True))
        return cls(np.asarray(gradient), np.asarray(information))


def grouped_scores(pieces: Iterable[Jacobian], groupings: Sequence[IntArray]) -> tuple[FloatArray, list[FloatArray]]:
    """(q, p) triangle R of the Jacobian's QR decomposition, and for each grouping the (m, p) gradients of its m groups.

    R'R is the Fisher information. A grouping has (N,) group numbers.
    """
    numbered = [np.unique(groups, return_inverse=True) for groups in groupings]
    triangles: list[FloatArray] = []
    scores = [np.zeros(()) for _ in groupings]
    for piece in pieces:
        with np.errstate(over="ignore", invalid="ignore"):
            triangles = [np.asarray(np.linalg.qr(np.concatenate((*triangles, piece.matrix)), mode="r"))]
        columns = piece.scores.T
        for at, (used, number) in enumerate(numbered):
            sums = [np.bincount(number[piece.rows], weights=column, minlength=len(used)) for column in columns]
            scores[at] = scores[at] + np.column_stack(sums)
    return triangles[0], scores


def negative_log_likelihoods(error: FloatArray, variance: FloatArray) -> FloatArray:
    """(N,) negative log-likelihood of each innovation, with Huber's limit on outliers; docs/method.md, (12)."""
    # A model that diverges gives infinities, which the caller can see.
    with np.errstate(over="ignore", invalid="ignore"):
        size = np.minimum(np.abs(error / np.sqrt(variance)), _MAX_Z)
        square = np.where(size > OUTLIER, OUTLIER * (2.0 * size - OUTLIER), size * size)
        return np.asarray(0.5 * (np.log(2.0 * np.pi * variance) + square))


def total_negative_log_likelihood(here: Innovations, weight: float | FloatArray) -> float:
    """Weighted sum of the negative log-likelihoods; large, but finite, where the model diverges."""
    weights = np.broadcast_to(weight, here.error.shape)
    pieces = _pieces(len(weights))
    total = sum(float(np.sum(weights[rows] * negative_log_likelihoods(*here.select(rows)))) for rows in pieces)
    return total if math.isfinite(total) else _DIVERGED


def _pieces(count: int) -> list[slice]:
    """Slices that cover ``count`` rows; one empty slice for no rows."""
    return [slice(begin, min(begin + _CHUNK, count)) for begin in range(0, max(count, 1), _CHUNK)]


def jacobian_chunks(
    centre: Innovations, sides: Sequence[Innovations], step: FloatArray, weight: float | FloatArray, first: int = 0
) -> Iterator[Jacobian]:
    """Jacobians by finite differences, some innovations at a time.

    ``sides`` are the innovations one (p,) signed ``step`` away from the ``centre`` along each of p coordinates.
    ``weight`` is one or (N,). ``first`` is the row of the first of these innovations among all.
    """
    weights = np.broadcast_to(weight, centre.error.shape)
    for rows in _pieces(len(weights)):
        here, *there = (one.select(rows) for one in (centre, *sides))
        yield _jacobian(slice(first + rows.start, first + rows.stop), here, there, step, weights[rows])


def _jacobian(
    rows: slice, centre: Innovations, sides: Sequence[Innovations], step: FloatArray, weight: FloatArray
) -> Jacobian:
    error, variance = centre
    with np.errstate(invalid="ignore"):  # The variance of a model that diverges may be negative.
        root = np.sqrt(variance)
    z = error / root
    # Residuals carry the square root of the weight.
    share = np.sqrt(weight)
    robust = share * np.sqrt(np.minimum(1.0, OUTLIER / np.maximum(np.abs(z), 1e-300)))
    # Columns are written and read as a whole.
    matrix = np.empty((2 * len(z), len(sides)), order="F")
    # A model that diverges gives infinities, which the caller can see.
    with np.errstate(over="ignore", invalid="ignore"):
        by_error, by_variance = robust / root, share / (math.sqrt(2.0) * variance)
        for k, side in enumerate(sides):
            matrix[: len(z), k] = by_error / step[k] * (side.error - error)
            matrix[len(z) :, k] = by_variance / step[k] * (side.variance - variance)
    variance_residual = (share - (robust * z) ** 2 / share) / math.sqrt(2.0)
    return Jacobian(rows, np.concatenate((robust * z, variance_residual)), matrix)


def inverse_information(information: FloatArray) -> FloatArray:
    """(p, p) inverse of the Fisher information; a flat direction of the likelihood gets a large variance."""
    power = np.diag(information)
    size = np.sqrt(np.where(power > 0.0, power, 1.0))
    # Scaling makes the threshold of flatness independent of units.
    scale = np.outer(size, size)
    values, vectors = np.linalg.eigh(information / scale)
    scaled = (vectors / np.maximum(values, _FLAT)) @ vectors.T
    return np.asarray(scaled / scale)


def inverse_of_triangle(triangle: FloatArray) -> FloatArray:
    """As `inverse_information` of R'R, from the (q, p) ``triangle`` R: the product would lose half of the digits."""
    size = np.linalg.norm(triangle, axis=0)
    size[size == 0.0] = 1.0
    _, values, vectors = np.linalg.svd(triangle / size)
    squares = np.pad(values, (0, len(size) - len(values))) ** 2
    return np.asarray((vectors.T / np.maximum(squares, _FLAT)) @ vectors / np.outer(size, size))


def sandwich_covariance(bread: FloatArray, scores: FloatArray) -> FloatArray:
    """(p, p) sandwich covariance from the inverse information and the (m, p) group scores; docs/method.md, (15).

    Fewer than two groups have no scatter: the inverse information, ``bread``, is then the covariance.
    """
    count = len(scores)
    if count < 2:
        return bread
    scores = scores - scores.mean(axis=0)
    scatter = scores.T @ scores * count / (count - 1)
    return np.asarray(bread @ scatter @ bread)


def whitening_gain(series: Sequence[FloatArray]) -> float:
    """Log-likelihood gain of an autoregression of ``series``, which a model with white innovations gains at least.

    Half the count times the logarithm of the variance ratio (Ljung 1999, section 16.4). 0 where the model diverges: an
    autoregression of such innovations shows nothing.
    """
    from scipy import linalg

    with np.errstate(over="ignore", invalid="ignore"):
        power = np.array([_lagged_product(series, lag) for lag in range(_LAGS + 1)])
    if power[0] <= 0.0 or not np.isfinite(power).all():
        return 0.0
    # A little white noise keeps the equations of an exactly periodic series solvable.
    noise = 1e-9 * power[0] * (np.arange(_LAGS) == 0)
    predictor = linalg.solve_toeplitz(power[:-1] + noise, power[1:])
    left = 1.0 - float(predictor @ power[1:]) / power[0]
    return -0.5 * sum(map(len, series)) * math.log(max(left, 1e-12))


def _lagged_product(series: Sequence[FloatArray], lag: int) -> float:
    """Sum of the products of values ``lag`` places apart."""
    return sum(float(z[lag:] @ z[: len(z) - lag]) for z in series if len(z) > lag)


def is_white(series: Sequence[FloatArray]) -> bool:
    """Whether normalised innovations pass the Ljung-Box test (1978) over all trials and have no heavy tails.

    Isolated spikes leave innovations white, so the kurtosis is tested too. Too few innovations for the test are not
    known to be white.
    """
    count = sum(map(len, series))
    power = sum(float(z @ z) for z in series)
    if count <= _LAGS or not power > 0.0:
        return False
    statistic = 0.0
    for lag in range(1, _LAGS + 1):
        statistic += (_lagged_product(series, lag) / power) ** 2 / (count - lag)
    chi2 = count * (count + 2.0) * statistic
    fourth = sum(float(np.sum(z**4)) for z in series) * count / power**2
    return chi2_sf(_LAGS, chi2) > _MIN_P and fourth - 3.0 < _MAX_KURTOSIS
