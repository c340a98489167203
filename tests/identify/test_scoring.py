"""What an innovation costs, and the steps that lower the sum."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import norm

from rovid.identify.scoring import OUTLIER, bounded_step, costs, damped, with_curvature

FREE = (np.full(2, -np.inf), np.full(2, np.inf))


def test_costs_are_those_of_a_normal_distribution_but_for_outliers() -> None:
    error, variance = np.array([0.0, 0.5, -1.0]), np.array([1.0, 4.0, 0.25])
    assert costs(error, variance) == pytest.approx(-norm.logpdf(error, scale=np.sqrt(variance)))
    # Beyond the limit in proportion, and without a jump in value or slope.
    near, far, farther = costs(OUTLIER + np.array([0.0, 1.0, 2.0]), np.ones(3))
    assert far - near == pytest.approx(OUTLIER)
    assert farther - far == pytest.approx(OUTLIER)


def test_an_innovation_that_ran_away_costs_no_infinity() -> None:
    assert np.isfinite(costs(np.array([1e200]), np.ones(1))).all()


def test_a_step_without_bounds_is_newtons() -> None:
    information = np.array([[4.0, 1.0], [1.0, 3.0]])
    gradient = np.array([1.0, 2.0])
    step = bounded_step(np.zeros(2), gradient, information, 0.0, FREE)
    assert step == pytest.approx(-np.linalg.solve(information, gradient))


def test_a_coordinate_at_its_bound_stays_and_the_other_takes_its_own_step() -> None:
    information = np.array([[4.0, 1.0], [1.0, 3.0]])
    bounds = np.array([0.0, -np.inf]), np.full(2, np.inf)
    step = bounded_step(np.zeros(2), np.array([1.0, 2.0]), information, 0.0, bounds)
    assert step == pytest.approx([0.0, -2.0 / 3.0])


def test_damping_falls_where_steps_keep_their_promise() -> None:
    assert damped(1.0, 0.9) < 1.0 < damped(1.0, 0.1)
    assert damped(1.0, 0.5) == 1.0


def test_differences_of_gradients_tell_the_curvature_that_was_not_promised() -> None:
    true = np.diag((10.0, 2.0))
    points = [np.array([1.0, 0.0]), np.array([0.0, 0.0]), np.array([0.0, 1.0])]
    been = [(x, true @ x) for x in points]
    assert with_curvature(np.eye(2), been) == pytest.approx(true)
    # Where it was right it stays.
    assert with_curvature(true, been) == pytest.approx(true)
