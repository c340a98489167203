"""Torque against drag at steady states: weighted least squares, and what its weights are."""

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

# Unknowns cannot be told apart whose columns, each of length one, differ by no more than this.
_ALIKE = 1e-10


class WlsSolution(NamedTuple):
    """(p,) values, their (p, p) covariance, and the degrees of freedom behind its scale."""

    values: FloatArray
    covariance: FloatArray
    degrees_of_freedom: float


@dataclass(frozen=True, kw_only=True, eq=False)
class TorqueBalance:
    """The torque of k steady states, and what holds it.

    Attributes
    ----------
    design
        (k, p) what each unknown is multiplied by.
    torque
        (k,) N m.
    error
        (k,) its standard errors in N m; ones where they are not known.
    error_known
        Whether they are.
    free
        (p,) which unknowns are not held at zero.
    """

    design: FloatArray
    torque: FloatArray
    error: FloatArray
    error_known: bool
    free: BoolArray

    @classmethod
    def of(cls, points: Sequence[SteadyPoint], axis: Axis, free: BoolArray) -> Self:
        """Of steady states; their errors are those of the table, of which none is known."""
        return cls(
            design=_design(points, axis),
            torque=np.array([point.torque for point in points]),
            error=np.ones(len(points)),
            error_known=False,
            free=free,
        )

    @property
    def is_determined(self) -> bool:
        """Whether every one of the free unknowns is determined."""
        design = self.design[:, self.free]
        values = np.linalg.svd(design / np.linalg.norm(design, axis=0), compute_uv=False)
        return len(values) == design.shape[1] and bool(values[-1] > _ALIKE * values[0])

    def with_error(self, error: FloatArray) -> Self:
        """The same with known errors."""
        return replace(self, error=error, error_known=True)

    def with_free(self, free: BoolArray) -> Self:
        """The same with other unknowns free."""
        return replace(self, free=free)

    def subset(self, rows: BoolArray) -> Self:
        """That of some of the steady states."""
        return replace(self, design=self.design[rows], torque=self.torque[rows], error=self.error[rows])

    def residuals(self, values: FloatArray) -> FloatArray:
        """(k,) N m, measured less what (p,) ``values`` give."""
        return np.asarray(self.torque - self.design @ values)

    def chi2(self, values: FloatArray) -> float:
        """Sum of squared residuals over their errors."""
        return float(np.sum((self.residuals(values) / self.error) ** 2))

    @property
    def degrees_of_freedom(self) -> int:
        """Steady states beyond what the free unknowns take."""
        return len(self.torque) - int(self.free.sum())

    def solve(self) -> WlsSolution:
        """Weighted least squares; unknowns that are not free stay zero.

        A known error is believed unless the scatter about the line is larger (Birge ratio); else the scatter sets the
        scale.
        """
        count = len(self.free)
        values, covariance = np.zeros(count), np.zeros((count, count))
        weighted = self.design[:, self.free] / self.error[:, None]
        # Columns of one length: the pseudo-inverse's cut-off then has no say in units.
        scale = np.linalg.norm(weighted, axis=0)
        inverse = np.linalg.pinv(weighted / scale) / scale[:, None]
        values[self.free] = inverse @ (self.torque / self.error)
        variance, freedom = self._variance(values)
        covariance[np.ix_(self.free, self.free)] = inverse @ inverse.T * variance
        return WlsSolution(values, covariance, freedom)

    def _variance(self, values: FloatArray) -> tuple[float, float]:
        """Of errors taken to be one, and its degrees of freedom: those of the scatter where that sets it."""
        if self.degrees_of_freedom <= 0:
            return (1.0 if self.error_known else math.nan), math.inf
        scatter = self.chi2(values) / self.degrees_of_freedom
        if self.error_known and scatter <= 1.0:
            return 1.0, math.inf
        return scatter, float(self.degrees_of_freedom)

    def leave_one_out(self) -> FloatArray:
        """(k, 3) quadratic and linear drag without each steady state, and what its torque is then off by in N m.

        NaN where the others do not determine both.
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
    """With the standard errors of the torque at ``points`` of logs, which go as the root of their length."""
    duration = np.array([point.duration for point in points])
    rate_error = np.array([point.rate_error for point in points])
    within = _density(balance, rate_error, duration) / duration
    return balance.with_error(np.sqrt(within + _between(balance, within)))


def _density(balance: TorqueBalance, rate_error: FloatArray, duration: FloatArray) -> float:
    """Variance of the torque, of a second of a log, that (k,) errors of the rate make."""
    values = balance.with_error(1.0 / np.sqrt(duration)).solve().values
    slope = 2.0 * values[0] * np.abs(balance.design[:, 1]) + values[1]
    return float(np.mean((slope * rate_error) ** 2 * duration))


def _between(balance: TorqueBalance, within: FloatArray) -> float:
    """Variance of the torque balance from hold to hold, N^2 m^2, that the (k,) variances ``within`` holds leave open.

    What a current or a trim does to a hold averages out over no length of it: without this a long rest would outweigh
    all turns. It is as large as the scatter about the line asks for (Paule & Mandel 1982).
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


def _design(points: Sequence[SteadyPoint], axis: Axis) -> FloatArray:
    """(k, p) what each unknown is multiplied by at each point."""
    # Along an axis that turns the vehicle back there are no steady turns: position does not matter here.
    restoring = regressors(restoring_effect(axis), np.zeros(len(points)))
    squares = [point.square_rate for point in points]
    rates = [point.rate for point in points]
    return np.column_stack((squares, rates, restoring))
