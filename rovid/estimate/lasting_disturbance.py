"""Errors of steady drag under a disturbance of unknown memory; docs/method.md, (7a)."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rovid.core.array_types import FloatArray, IntArray
from rovid.estimate.steady_points import SteadyPoint, TorqueBalance

# Memories of a disturbance in usual lengths of a hold, from none to one that outlasts a series of holds; convention.
_MEMORIES = (0.02, 0.1, 0.3, 1.0, 3.0, 10.0, 30.0)
# Variance of a torque that each hold has for itself, over that of the disturbance in a part of a hold: none, a quarter
# and three quarters of both; convention.
_OWN = (0.0, 1.0 / 3.0, 3.0)
# Variance of the noise of a part, over that of the disturbance in it; convention. It keeps parts of equal times apart.
_NOISE = 1e-4
# Probabilities of an error beyond two and three standard errors: that of the normal distribution; convention.
_BEYOND = {2.0: 0.0455, 3.0: 0.01}


@dataclass(frozen=True, kw_only=True, eq=False)
class _Parts:
    """The n parts of the holds of one log."""

    hold: IntArray  #: (n,) number of the hold among all.
    start: FloatArray  #: (n,) s.
    length: FloatArray  #: (n,) s.
    torque: FloatArray  #: (n,) N m, less what the rate of the part differs from that of the hold.
    share: FloatArray  #: (n,) of the part in its hold.

    def shapes(self, memory: float, scale: float) -> FloatArray:
        """(m, n, n) covariances of the torque balances for each of `_OWN`, over the disturbance's in a usual part."""
        shared = _mean_covariance(self.start, self.length, memory) / scale
        same_hold = np.equal.outer(self.hold, self.hold)
        own = np.array(_OWN)[:, np.newaxis, np.newaxis]
        return np.asarray(shared + own * same_hold + _NOISE * np.eye(len(self.hold)))


def lasting_covariance(balance: TorqueBalance, points: Sequence[SteadyPoint]) -> FloatArray:
    """(p, p) covariance of `TorqueBalance.solve` under a disturbance of unknown memory.

    Each memory and each share in question has a weight by its restricted likelihood of the torque balances of all
    parts of the holds, and a Student distribution of the errors by its size. The weighted sum of these distributions
    gives the errors: two of them are exceeded as rarely as with a normal distribution, and three in one of a hundred.
    """
    solver, logs = balance.solver(), _parts_by_log(balance, points)
    design = balance.design[:, balance.free]
    usual = float(np.mean([point.duration for point in points]))
    freedom = sum(len(one.hold) for one in logs) - len(solver)
    part = np.array([usual / max(len(points[0].parts), 1)])
    likelihoods, covariances = [], []
    for memory in _MEMORIES:
        scale = float(_mean_covariance(np.zeros(1), part, memory * usual)[0, 0])
        rows, covariance = [], np.zeros((len(_OWN), len(solver), len(solver)))
        log_determinant = np.zeros(len(_OWN))
        for one in logs:
            shapes = one.shapes(memory * usual, scale)
            factors = np.linalg.cholesky(shapes)
            spread = solver[:, one.hold] * one.share
            known = np.column_stack((design[one.hold], one.torque))
            rows.append(np.linalg.solve(factors, known[np.newaxis]))
            covariance += spread @ shapes @ spread.T
            log_determinant += np.log(np.diagonal(factors, axis1=1, axis2=2)).sum(axis=1)
        triangles = np.linalg.qr(np.concatenate(rows, axis=1), mode="r")
        diagonals = np.abs(np.diagonal(triangles, axis1=1, axis2=2))
        log_determinant += np.log(diagonals[:, :-1]).sum(axis=1)
        size = diagonals[:, -1].clip(1e-150)
        likelihoods.append(-log_determinant - freedom * np.log(size))
        covariances.append(covariance * size[:, np.newaxis, np.newaxis] ** 2 / freedom)
    likelihood = np.concatenate(likelihoods)
    weights = np.exp(likelihood - likelihood.max())
    mixed = _mixture(weights / weights.sum(), np.concatenate(covariances), freedom)
    covariance = np.zeros((len(balance.free), len(balance.free)))
    covariance[np.ix_(balance.free, balance.free)] = mixed
    return covariance


def _parts_by_log(balance: TorqueBalance, points: Sequence[SteadyPoint]) -> list[_Parts]:
    """The parts of the holds of each log; a hold without parts is one."""
    values, logs = balance.solve().values[:2], []
    for source in dict.fromkeys(point.source for point in points):
        every = []
        for number, point in enumerate(points):
            if point.source != source:
                continue
            means = np.array(point.parts or ((point.square_rate, point.rate),))
            count, each = len(means), point.duration / len(means)
            torque = balance.torque[number] - (means - balance.design[number, :2]) @ values
            start = point.start + each * np.arange(count)
            every.append((np.full(count, number), start, np.full(count, each), torque, np.full(count, 1.0 / count)))
        hold, begin, length, deviating, share = (np.concatenate(column) for column in zip(*every, strict=True))
        logs.append(_Parts(hold=hold, start=begin, length=length, torque=deviating, share=share))
    return logs


def _mean_covariance(start: FloatArray, length: FloatArray, memory: float) -> FloatArray:
    """(n, n) covariance of the means over n intervals of a Gauss-Markov process of unit variance."""

    def integral(first: FloatArray, second: FloatArray) -> FloatArray:
        """Second antiderivative of the correlation, of all differences."""
        gap = np.abs(np.subtract.outer(first, second)) / memory
        return np.asarray(gap + np.expm1(-gap))

    stop = start + length
    total = integral(stop, start) + integral(start, stop) - integral(stop, stop) - integral(start, start)
    return np.asarray(memory**2 * total / np.outer(length, length))


def _mixture(weights: FloatArray, covariances: FloatArray, freedom: int) -> FloatArray:
    """(p, p) covariance of a weighted sum of Student distributions, with errors that hold as by `_BEYOND`."""
    from scipy import optimize, special

    errors = np.sqrt(np.diagonal(covariances, axis1=1, axis2=2))
    # The widest distributions would decide the correlation of the sum.
    correlation = np.tensordot(weights, covariances / (errors[:, :, np.newaxis] * errors[:, np.newaxis, :]), 1)

    def reach(each: FloatArray, probability: float) -> float:
        def excess(width: float) -> float:
            return 2.0 * float(weights @ special.stdtr(freedom, -width / each)) - probability

        # No Student distribution with two or more degrees of freedom reaches ten times its error.
        return float(optimize.brentq(excess, 0.0, 10.0 * float(each.max())))

    widths = [max(reach(each, beyond) / count for count, beyond in _BEYOND.items()) for each in errors.T]
    return np.asarray(correlation * np.outer(widths, widths))
