"""Changes are found, unchanged parameters are not named, and the errors are valid."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from rovid.compare.difference_tests import (
    DRAG,
    THRUST_SCALE,
    DifferenceTest,
    EstimatePair,
    change_candidates,
    find_changes,
)
from tests.compare.pairs import NAMES, VALUES, pair


def found(given: EstimatePair, weak: tuple[str, ...] = (), other: str = "") -> DifferenceTest:
    return find_changes(given, change_candidates(given, weak, other))


def moved(*names: str, by: float) -> np.ndarray:
    return np.where([name in names for name in NAMES], by * VALUES, VALUES)


CASES = {
    "inertia": (moved("inertia", by=1.06), {"inertia"}),
    "quadratic drag": (moved("quadratic_drag", by=1.1), {"quadratic_drag"}),
    "all drag": (moved("quadratic_drag", "linear_drag", by=1.2), {"quadratic_drag", "linear_drag"}),
    "thrust": (np.append(VALUES[:3] / 0.925, 0.0), {"inertia", "quadratic_drag", "linear_drag"}),
    "a lag": (np.append(VALUES[:3], 0.4), {"thruster_lag.time_constant"}),
    "drag and a lag": (
        np.append(moved("quadratic_drag", by=1.1)[:3], 0.4),
        {"quadratic_drag", "thruster_lag.time_constant"},
    ),
}


@pytest.mark.parametrize("case", CASES)
def test_only_the_change_is_named(case: str) -> None:
    b, wanted = CASES[case]
    for seed in range(20):
        changes = found(pair(b, seed=seed))
        named = {name for change in changes.established for name in change.candidate.parameters}
        assert named <= wanted
        assert named
        if case != "all drag":  # which a change of quadratic drag may explain
            assert named == wanted


@pytest.mark.slow
def test_no_change_is_named_without_a_change() -> None:
    for seed in range(300):
        changes = found(pair(VALUES, seed=seed))
        assert not changes.established
        assert all(sure < 0.5 for sure in changes.probabilities.values())


def test_less_thrust_is_one_inverse_change() -> None:
    (change,) = found(pair(CASES["thrust"][0])).established
    assert change.candidate.name == THRUST_SCALE
    assert math.isclose(change.ratio, 0.925, abs_tol=1e-6)
    assert 0.0 < change.standard_error < 0.005


def test_two_factors_of_the_vehicle_are_not_named_as_thrust_and_one_of_them() -> None:
    both = moved("quadratic_drag", "linear_drag", by=1.15)
    both[NAMES.index("inertia")] *= 1.1
    for seed in range(5):
        changes = found(pair(both, seed=seed)).established
        named = {change.candidate.name for change in changes}
        # The quadratic drag alone may explain the change of all drag.
        assert "inertia" in named, named
        assert named & {DRAG, "quadratic_drag"}, named
        assert THRUST_SCALE not in named


@pytest.mark.slow
def test_the_error_of_a_ratio_is_correct() -> None:
    b, off, shared = moved("quadratic_drag", by=1.1), [], []
    for seed in range(400):
        changes = found(pair(b, seed=seed))
        ratio, error = changes.ratio("inertia") or (math.nan, math.nan)
        off.append((ratio - 1.0) / error)
        (value, spread), _ = changes.joint_values("inertia")
        shared.append((value - VALUES[0]) / spread)
    for z in (off, shared):
        # The standard deviation of 400 standard normal draws has an error of 0.035; 3 sigma.
        assert abs(np.std(z) - 1.0) < 0.11
        assert abs(np.mean(z)) < 0.15


def test_the_joint_estimate_is_more_precise_without_a_change() -> None:
    given = pair(VALUES, seed=1)
    changes = found(given)
    for at, name in enumerate(NAMES):
        (value, error), other = changes.joint_values(name)
        assert (value, error) == other
        alone = math.sqrt(given.covariance_a[at, at])
        assert math.isclose(error, alone / math.sqrt(2.0), rel_tol=1e-6)


def test_changed_parameters_are_not_shared() -> None:
    changes = found(pair(moved("quadratic_drag", by=1.1), seed=2))
    (before, _), (after, _) = changes.joint_values("quadratic_drag")
    assert abs(after / before - 1.1) < 0.01


def test_a_small_change_is_not_claimed_and_the_detectable_change_is_given() -> None:
    changes = found(pair(moved("inertia", by=1.005)))
    assert not changes.established
    assert 0.005 < changes.detectable_changes["inertia"] < 0.05
    beyond = 1.0 + 1.05 * changes.detectable_changes["inertia"]
    assert [one.candidate.name for one in found(pair(moved("inertia", by=beyond))).established] == ["inertia"]


def test_coloured_innovations_need_more_evidence() -> None:
    asked = [found(pair(VALUES, white=white)).detectable_changes[DRAG] for white in (True, False)]
    assert asked[1] > 1.1 * asked[0]


def test_indistinguishable_changes_are_listed() -> None:
    # The linear drag is too imprecise to distinguish the two changes.
    changes = found(pair(moved("quadratic_drag", by=1.1), errors=1.0))
    (change,) = changes.established
    assert DRAG in {other.name for other in change.indistinguishable}


def test_a_thruster_without_a_gain_is_a_candidate() -> None:
    names, units = (*NAMES[:3], "thruster_imbalance:fore.gain"), ("kg m^2", "N m s^2/rad^2", "N m s/rad", "1")
    a, b = np.array([5000.0, 3500.0, 130.0, 0.8]), np.array([5000.0, 3500.0, 130.0, 0.8])
    b = b / 0.9  # the other thruster, the reference of all parameters, lost 10 %
    covariance = np.diag([100.0, 400.0, 16.0, 1e-4])
    given = EstimatePair(
        names=names, units=units, a=a, b=b, covariance_a=covariance, covariance_b=covariance, white=True, samples=10_000
    )
    (change,) = found(given, ("thruster_imbalance:fore",), "thruster_imbalance:aft").established
    assert change.candidate.name == "thruster_imbalance:aft"
    assert math.isclose(change.ratio, 0.9, abs_tol=1e-6)


def test_parameter_ratios_do_not_depend_on_thrust() -> None:
    sides, over = found(pair(CASES["thrust"][0])).inertia_over("quadratic_drag") or pytest.fail("known")
    assert math.isclose(over[0], 1.0, abs_tol=1e-9)
    assert math.isclose(sides[0][0], 5000.0 / 3500.0)


def test_no_division_by_an_insignificant_parameter() -> None:
    assert found(pair(VALUES)).ratio("thruster_lag.time_constant") is None


def test_the_detectable_change_does_not_depend_on_the_data() -> None:
    alone, beside = (found(pair(b)).detectable_changes for b in (VALUES, moved("quadratic_drag", by=1.1)))
    assert math.isclose(beside[DRAG], alone[DRAG], rel_tol=0.2)


def test_an_unexplained_difference_is_reported() -> None:
    given = pair(VALUES, seed=5)
    assert found(given).p_value > 0.001
    # Errors are stated three times too small.
    small = replace(given, covariance_a=given.covariance_a / 9.0, covariance_b=given.covariance_b / 9.0)
    assert found(small).p_value < found(given).p_value
