"""Optimiser steps and the parametrization."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from rovid.core.array_types import FloatArray
from rovid.effects import effect_named
from rovid.estimate.filter_data import InnovationData
from rovid.estimate.fisher_information import Innovations, Jacobian
from rovid.estimate.innovation_likelihood import InnovationLikelihood
from rovid.estimate.levenberg_marquardt import StopReason, bounded_step, minimize, updated_damping, with_bfgs_updates
from tests import synthetic
from tests.predictions import TIME, TORQUE

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


def test_damping_falls_after_a_step_with_the_expected_gain() -> None:
    assert updated_damping(1.0, 0.9) < 1.0 < updated_damping(1.0, 0.1)
    assert updated_damping(1.0, 0.5) == 1.0


def test_bfgs_updates_recover_the_curvature() -> None:
    true = np.diag((10.0, 2.0))
    points = [np.array([1.0, 0.0]), np.array([0.0, 0.0]), np.array([0.0, 1.0])]
    been = [(x, true @ x) for x in points]
    assert with_bfgs_updates(np.eye(2), been) == pytest.approx(true)
    # A correct curvature does not change.
    assert with_bfgs_updates(true, been) == pytest.approx(true)


@dataclass(frozen=True)
class Overpromising:
    """Stand-in for an objective of one coordinate with misleading derivatives; SIMD takes four points at once."""

    asked: list[int]
    simd_slots_left: int = 3
    bfgs_pairs: int = 0

    @property
    def parametrization(self) -> SimpleNamespace:
        return SimpleNamespace(bounds=(np.full(6, -np.inf), np.full(6, np.inf)))

    def evaluate(self, points: Sequence[FloatArray]) -> list[Innovations]:
        self.asked.append(len(points))
        # Far from zero, Newton steps overshoot.
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


def test_after_a_failed_step_several_dampings_are_tried_at_once() -> None:
    asked = list[int]()
    objective: Any = Overpromising(asked)  # stands in for an objective
    found = minimize(objective, np.array([0.0, 0.5, 0.0, 0.0, 0.0, 0.0]))
    assert found.stop_reason is StopReason.CONVERGED
    assert found.x[1] == pytest.approx(0.0, abs=0.02)
    # From there on Newton's step leads far beyond.
    assert asked[:3] == [1, 1, 4]


def test_frequencies_lie_between_one_cycle_per_run_and_nyquist() -> None:
    data = InnovationData([synthetic.run(TIME[:500], TORQUE[:500])], synthetic.LOGGED, synthetic.ROSUB, interval=1.0)
    coordinates = InnovationLikelihood(data, 0.05, (effect_named("wave_torque"),)).parametrization
    highest, unit = coordinates.high[coordinates.effects_begin + 1], coordinates.units[1]
    assert highest * unit == pytest.approx(math.pi)
    lowest = coordinates.low[coordinates.effects_begin + 1]
    assert lowest * unit == pytest.approx(2.0 * math.pi / float(np.ptp(TIME[:500])))
    starts = coordinates.initial_values()
    assert all(lowest <= start[1] <= highest for start in starts)
    assert len({tuple(start) for start in starts}) == len(starts) < len(effect_named("wave_torque").initial_values)
