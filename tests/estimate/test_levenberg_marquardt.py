"""The steps that lower the sum of what innovations cost."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from rovid.core.array_types import FloatArray
from rovid.estimate.fisher_information import Innovations, Jacobian
from rovid.estimate.levenberg_marquardt import StopReason, bounded_step, minimize, updated_damping, with_bfgs_updates

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
    assert updated_damping(1.0, 0.9) < 1.0 < updated_damping(1.0, 0.1)
    assert updated_damping(1.0, 0.5) == 1.0


def test_differences_of_gradients_tell_the_curvature_that_was_not_promised() -> None:
    true = np.diag((10.0, 2.0))
    points = [np.array([1.0, 0.0]), np.array([0.0, 0.0]), np.array([0.0, 1.0])]
    been = [(x, true @ x) for x in points]
    assert with_bfgs_updates(np.eye(2), been) == pytest.approx(true)
    # Where it was right it stays.
    assert with_bfgs_updates(true, been) == pytest.approx(true)


@dataclass(frozen=True)
class Overpromising:
    """Stands for a misfit of which one coordinate tells, and whose slopes promise too much; four points cost as one."""

    asked: list[int]
    simd_slots_left: int = 3
    bfgs_pairs: int = 0

    @property
    def parametrization(self) -> SimpleNamespace:
        return SimpleNamespace(bounds=(np.full(6, -np.inf), np.full(6, np.inf)))

    def evaluate(self, points: Sequence[FloatArray]) -> list[Innovations]:
        self.asked.append(len(points))
        # Away from nought its slope promises what lies far beyond that.
        return [Innovations(np.arctan(10.0 * x[1:2]), np.ones(1)) for x in points]

    def value_of(self, here: Innovations) -> float:
        return 0.5 * float(here.error @ here.error)

    def evaluate_with_spare(self, x: FloatArray) -> tuple[Innovations, list[Innovations]]:
        (here,) = self.evaluate([x])
        return here, []

    def jacobian(self, x: FloatArray, known: tuple[Innovations, list[Innovations]]) -> Iterator[Jacobian]:
        slope = np.zeros((2, 6))
        slope[0, 1] = 10.0 / (1.0 + (10.0 * x[1]) ** 2)
        yield Jacobian(slice(0, 1), np.array([known[0].error[0], 0.0]), slope)


def test_where_a_step_fails_shorter_ones_are_tried_side_by_side() -> None:
    asked = list[int]()
    misfit: Any = Overpromising(asked)  # stands in for a Misfit
    found = minimize(misfit, np.array([0.0, 0.5, 0.0, 0.0, 0.0, 0.0]))
    assert found.stop_reason is StopReason.CONVERGED
    assert found.x[1] == pytest.approx(0.0, abs=0.02)
    # From there on Newton's step leads far beyond.
    assert asked[:3] == [1, 1, 4]
