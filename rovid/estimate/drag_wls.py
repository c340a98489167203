"""Weighted least squares of torque against drag at steady states."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple, Self

import numpy as np

from rovid.core.array_types import BoolArray, FloatArray
from rovid.effects import restoring_effect
from rovid.effects.restoring import regressors
from rovid.estimate.steady_points import SteadyPoint
from rovid.trial.axis import Axis

# Least ratio of the singular values of the normalised design matrix, below which unknowns are not distinguishable.
_LEAST_RATIO = 1e-10


class WlsSolution(NamedTuple):
    """(p,) values, their (p, p) covariance, and the degrees of freedom behind its scale."""

    values: FloatArray
    covariance: FloatArray
    degrees_of_freedom: float


@dataclass(frozen=True, kw_only=True, eq=False)
class TorqueBalance:
    """Linear model of the torque at k steady states; docs/method.md, (6).

    Attributes
    ----------
    design
        (k, p) regressors: |r| r, r, and those of the restoring torque.
    torque
        (k,) N m.
    error
        (k,) standard errors of the torque balance in N m; ones where unknown.
    error_known
        Whether the errors are known.
    free
        (p,) which unknowns are free; the others are zero.
    """

    design: FloatArray
    torque: FloatArray
    error: FloatArray
    error_known: bool
    free: BoolArray

    @classmethod
    def of(cls, points: Sequence[SteadyPoint], axis: Axis, free: BoolArray) -> Self:
        """Torque balance of steady states, with unknown errors."""
        # Position does not matter: an axis with a righting moment has no steady turns.
        restoring = regressors(restoring_effect(axis), np.zeros(len(points)))
        squares, rates = [point.square_rate for point in points], [point.rate for point in points]
        return cls(
            design=np.column_stack((squares, rates, restoring)),
            torque=np.array([point.torque for point in points]),
            error=np.ones(len(points)),
            error_known=False,
            free=free,
        )

    @property
    def is_determined(self) -> bool:
        """Whether the steady states determine every free unknown."""
        design = self.design[:, self.free]
        values = np.linalg.svd(design / np.linalg.norm(design, axis=0), compute_uv=False)
        return len(values) == design.shape[1] and bool(values[-1] > _LEAST_RATIO * values[0])

    def with_error(self, error: FloatArray) -> Self:
        """The same balance with known errors."""
        return replace(self, error=error, error_known=True)

    def with_free(self, free: BoolArray) -> Self:
        """The same balance with other free unknowns."""
        return replace(self, free=free)

    def subset(self, rows: BoolArray) -> Self:
        """The balance of some of the steady states."""
        return replace(self, design=self.design[rows], torque=self.torque[rows], error=self.error[rows])

    def residuals(self, values: FloatArray) -> FloatArray:
        """(k,) measured torque minus that of (p,) ``values``, N m."""
        return np.asarray(self.torque - self.design @ values)

    def chi2(self, values: FloatArray) -> float:
        """Sum of squared residuals over their errors."""
        return float(np.sum((self.residuals(values) / self.error) ** 2))

    @property
    def degrees_of_freedom(self) -> int:
        """Number of steady states beyond that of the free unknowns."""
        return len(self.torque) - int(self.free.sum())

    def solve(self) -> WlsSolution:
        """Weighted least squares; unknowns that are not free stay zero.

        Known errors set the scale of the covariance unless the scatter about the line is larger (Birge 1932).
        """
        count = len(self.free)
        values, covariance = np.zeros(count), np.zeros((count, count))
        weighted = self.design[:, self.free] / self.error[:, None]
        # Normalised columns make the cut-off of the pseudo-inverse independent of units.
        scale = np.linalg.norm(weighted, axis=0)
        inverse = np.linalg.pinv(weighted / scale) / scale[:, None]
        values[self.free] = inverse @ (self.torque / self.error)
        variance, freedom = self._residual_variance(values)
        covariance[np.ix_(self.free, self.free)] = inverse @ inverse.T * variance
        return WlsSolution(values, covariance, freedom)

    def _residual_variance(self, values: FloatArray) -> tuple[float, float]:
        """Variance of the normalised residuals and its degrees of freedom; 1 and infinity by known errors."""
        if self.degrees_of_freedom <= 0:
            return (1.0 if self.error_known else math.nan), math.inf
        scatter = self.chi2(values) / self.degrees_of_freedom
        if self.error_known and scatter <= 1.0:
            return 1.0, math.inf
        return scatter, float(self.degrees_of_freedom)

    def leave_one_out(self) -> FloatArray:
        """(k, 3) quadratic and linear drag without each steady state, and the residual of its torque in N m.

        NaN where the other steady states do not determine both.
        """
        count = len(self.torque)
        rows = np.full((count, 3), np.nan)
        for k in range(count):
            others = self.subset(np.arange(count) != k)
            if not others.is_determined:
                continue
            values = others.solve().values
            rows[k] = (*values[:2], self.torque[k] - self.design[k] @ values)
        return rows


def with_pooled_errors(balance: TorqueBalance, points: Sequence[SteadyPoint]) -> TorqueBalance:
    """The balance with errors sigma_k^2 = q/t_k + tau^2 of holds of lengths t_k; docs/method.md, (7).

    q is the density of the torque's variance by the errors of the rate, pooled over all holds. tau^2 is the variance
    from hold to hold, such as by a current or trim, which no length averages out.
    """
    duration = np.array([point.duration for point in points])
    rate_error = np.array([point.rate_error for point in points])
    values = balance.with_error(1.0 / np.sqrt(duration)).solve().values
    slope = 2.0 * values[0] * np.abs(balance.design[:, 1]) + values[1]
    density = float(np.mean((slope * rate_error) ** 2 * duration))
    within = density / duration
    return balance.with_error(np.sqrt(within + _variance_between(balance, within)))


def _variance_between(balance: TorqueBalance, within: FloatArray) -> float:
    """Variance tau^2 of the torque balance from hold to hold, N^2 m^2 (Paule and Mandel 1982).

    As large as makes chi-squared, with the (k,) variances ``within`` holds, equal to its degrees of freedom.
    """

    def excess(variance: float) -> float:
        tried = balance.with_error(np.sqrt(within + variance))
        return tried.chi2(tried.solve().values) - balance.degrees_of_freedom

    if balance.degrees_of_freedom < 1 or excess(0.0) <= 0.0:
        return 0.0
    most = float(np.mean(balance.torque**2))
    if not excess(most) < 0.0:
        return most
    from scipy import optimize

    return float(optimize.brentq(excess, 0.0, most))
