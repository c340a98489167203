"""From slopes to a covariance."""

from __future__ import annotations

import numpy as np
import pytest

from rovid.estimate.covariance import inverse_information, sandwich_covariance

UNITS = np.diag((1e6, 1e-3))
SHAPE = np.array([[2.0, 0.5], [0.5, 1.0]])


def test_units_have_no_say_in_the_inverse() -> None:
    assert inverse_information(UNITS @ SHAPE @ UNITS) == pytest.approx(np.linalg.inv(UNITS @ SHAPE @ UNITS), rel=1e-6)


def test_a_flat_direction_is_uncertain_and_no_infinity() -> None:
    flat = inverse_information(np.array([[1.0, 1.0], [1.0, 1.0]]))
    assert np.isfinite(flat).all()
    # The sum of both is known, their difference is not.
    along, across = np.array([1.0, 1.0]), np.array([1.0, -1.0])
    assert along @ flat @ along == pytest.approx(1.0, rel=1e-6)
    assert across @ flat @ across > 1e6


def test_scores_that_scatter_as_the_information_says_change_nothing() -> None:
    rng = np.random.default_rng(1)
    scores = rng.multivariate_normal([0.0, 0.0], SHAPE, 20_000)
    bread = np.linalg.inv(SHAPE * len(scores))
    # Scatter of so many is known to one percent.
    assert sandwich_covariance(bread, scores) == pytest.approx(bread, rel=0.05)
    assert sandwich_covariance(bread, 2.0 * scores) == pytest.approx(4.0 * sandwich_covariance(bread, scores))
