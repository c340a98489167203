"""Estimates of one fictitious vehicle in two campaigns."""

from __future__ import annotations

import numpy as np

from rovid.compare.difference_tests import EstimatePair
from rovid.core.array_types import FloatArray

NAMES = ("inertia", "quadratic_drag", "linear_drag", "thruster_lag.time_constant")
UNITS = ("kg m^2", "N m s^2/rad^2", "N m s/rad", "s")
VALUES = np.array([5000.0, 3500.0, 130.0, 0.0])
ERRORS = np.array([10.0, 20.0, 4.0, 0.005])
# Quadratic and linear drag are negatively correlated, as in any campaign.
CORRELATION = np.array([[1.0, 0.3, -0.2, 0.1], [0.3, 1.0, -0.9, 0.0], [-0.2, -0.9, 1.0, 0.0], [0.1, 0.0, 0.0, 1.0]])
COVARIANCE = CORRELATION * np.outer(ERRORS, ERRORS)


def pair(
    b: FloatArray, *, seed: int | None = None, errors: float = 1.0, white: bool = True, count: int = len(NAMES)
) -> EstimatePair:
    """The true values as A, and ``b``; with noise if there is a ``seed``."""
    covariance = errors**2 * COVARIANCE[:count, :count]
    noise = np.zeros((2, count))
    if seed is not None:
        noise = np.random.default_rng(seed).multivariate_normal(np.zeros(count), covariance, 2)
    return EstimatePair(
        names=NAMES[:count],
        units=UNITS[:count],
        a=VALUES[:count] + noise[0],
        b=b[:count] + noise[1],
        covariance_a=covariance,
        covariance_b=covariance,
        white=white,
        samples=20_000,
    )
