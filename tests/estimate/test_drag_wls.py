"""Torque against drag at steady states."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rovid.core.array_types import FloatArray
from rovid.estimate.drag_wls import TorqueBalance, with_pooled_errors
from rovid.trial.axis import YAW
from tests.estimate.test_steady_drag import point

RATES = (-0.2, -0.1, 0.05, 0.12, 0.2, 0.25)
BOTH = np.array([True, True])


def balance(torque: FloatArray | None = None) -> TorqueBalance:
    made = TorqueBalance.of([point(rate, 0.0) for rate in RATES], YAW, BOTH)
    return made if torque is None else replace(made, torque=torque)


def drag(rates: tuple[float, ...], quadratic: float = 3000.0, linear: float = 100.0) -> FloatArray:
    return np.array([quadratic * abs(rate) * rate + linear * rate for rate in rates])


def test_exact_torques_give_exact_drag_and_each_is_foretold_by_the_others() -> None:
    exact = balance(drag(RATES))
    assert exact.solve().values == pytest.approx([3000.0, 100.0])
    left_out = exact.leave_one_out()
    assert left_out[:, 0] == pytest.approx(3000.0)
    assert left_out[:, 2] == pytest.approx(0.0, abs=1e-9)


def test_an_unknown_that_is_not_free_stays_zero() -> None:
    solution = balance(drag(RATES, linear=0.0)).with_free(np.array([True, False])).solve()
    assert solution.values == pytest.approx([3000.0, 0.0])
    assert solution.covariance[1, 1] == 0.0


def test_one_speed_both_ways_does_not_tell_the_drags_apart() -> None:
    assert balance().is_determined
    assert not TorqueBalance.of([point(rate, 0.0) for rate in (-0.2, 0.2)], YAW, BOTH).is_determined


def test_a_known_error_is_believed_unless_the_scatter_is_larger() -> None:
    off = drag(RATES) + np.array([1.0, -1.0, 1.0, -1.0, 1.0, -1.0])
    large, small = (balance(off).with_error(np.full(len(RATES), size)).solve() for size in (10.0, 0.01))
    assert large.degrees_of_freedom == np.inf
    assert small.degrees_of_freedom == 4.0
    # With an error that is too small the scatter alone counts, as where none is known.
    assert small.covariance == pytest.approx(balance(off).solve().covariance)
    assert np.sqrt(large.covariance[0, 0]) > np.sqrt(small.covariance[0, 0])


def test_what_differs_from_hold_to_hold_is_no_smaller_for_long_ones() -> None:
    points = [point(rate, 0.0, error=1e-3) for rate in RATES]
    points[2] = replace(points[2], stop=points[2].start + 100.0 * points[2].duration)
    off = drag(RATES) + np.array([8.0, -8.0, 8.0, -8.0, 8.0, -8.0])
    errors = with_pooled_errors(balance(off), points).error
    assert errors.min() > 0.5 * errors.max()
    quiet = with_pooled_errors(balance(drag(RATES)), points).error
    assert quiet.min() < 0.2 * quiet.max()
