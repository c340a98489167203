"""The steps that lower the sum of what innovations cost."""

from __future__ import annotations

import numpy as np
import pytest

from rovid.identify.climb import bounded_step, damped, with_curvature

FREE = (np.full(2, -np.inf), np.full(2, np.inf))


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
