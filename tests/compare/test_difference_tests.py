"""What changed is named, what did not is not, and the numbers mean what they say."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from rovid.compare.candidates import DRAG, THRUST_SCALE, EstimatePair, change_candidates
from rovid.compare.difference_tests import DifferenceTest, find_changes
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
def test_what_changed_is_named_and_nothing_else(case: str) -> None:
    b, wanted = CASES[case]
    for seed in range(20):
        changes = found(pair(b, seed=seed))
        named = {name for change in changes.established for name in change.candidate.parameters}
        assert named <= wanted
        assert named
        if case != "all drag":  # which may be told by the quadratic drag alone
            assert named == wanted


def test_nothing_is_named_where_nothing_changed() -> None:
    for seed in range(300):
        changes = found(pair(VALUES, seed=seed))
        assert not changes.established
        assert all(sure < 0.5 for sure in changes.probabilities.values())


def test_less_thrust_is_one_change_and_goes_the_other_way() -> None:
    (change,) = found(pair(CASES["thrust"][0])).established
    assert change.candidate.name == THRUST_SCALE
    assert math.isclose(change.ratio, 0.925, abs_tol=1e-6)
    assert 0.0 < change.standard_error < 0.005


def test_a_ratio_is_as_sure_as_it_says() -> None:
    b, off, shared = moved("quadratic_drag", by=1.1), [], []
    for seed in range(400):
        changes = found(pair(b, seed=seed))
        ratio, error = changes.ratio("inertia") or (math.nan, math.nan)
        off.append((ratio - 1.0) / error)
        (value, spread), _ = changes.joint_values("inertia")
        shared.append((value - VALUES[0]) / spread)
    for z in (off, shared):
        # Of 400 draws of a standard normal the spread is off by 0.035: three of those.
        assert abs(np.std(z) - 1.0) < 0.11
        assert abs(np.mean(z)) < 0.15


def test_both_together_are_sharper_where_nothing_changed() -> None:
    given = pair(VALUES, seed=1)
    changes = found(given)
    for at, name in enumerate(NAMES):
        (value, error), other = changes.joint_values(name)
        assert (value, error) == other
        alone = math.sqrt(given.covariance_a[at, at])
        assert math.isclose(error, alone / math.sqrt(2.0), rel_tol=1e-6)


def test_what_changed_is_not_shared() -> None:
    changes = found(pair(moved("quadratic_drag", by=1.1), seed=2))
    (before, _), (after, _) = changes.joint_values("quadratic_drag")
    assert abs(after / before - 1.1) < 0.01


def test_a_small_change_is_not_claimed_and_it_is_said_what_would_be() -> None:
    changes = found(pair(moved("inertia", by=1.005)))
    assert not changes.established
    assert 0.005 < changes.detectable_changes["inertia"] < 0.05
    beyond = 1.0 + 1.05 * changes.detectable_changes["inertia"]
    assert [one.candidate.name for one in found(pair(moved("inertia", by=beyond))).established] == ["inertia"]


def test_where_innovations_are_not_white_more_is_asked() -> None:
    asked = [found(pair(VALUES, white=white)).detectable_changes[DRAG] for white in (True, False)]
    assert asked[1] > 1.1 * asked[0]


def test_what_cannot_be_told_apart_is_said() -> None:
    # So little is known of the linear drag that nobody can tell which of the two grew.
    changes = found(pair(moved("quadratic_drag", by=1.1), errors=1.0))
    (change,) = changes.established
    assert DRAG in {other.name for other in change.indistinguishable}


def test_a_thruster_that_has_no_gain_of_its_own_is_a_candidate() -> None:
    names, units = (*NAMES[:3], "thruster_imbalance:fore.gain"), ("kg m^2", "N m s^2/rad^2", "N m s/rad", "1")
    a, b = np.array([5000.0, 3500.0, 130.0, 0.8]), np.array([5000.0, 3500.0, 130.0, 0.8])
    b = b / 0.9  # the other thruster lost a tenth, by which all is measured
    covariance = np.diag([100.0, 400.0, 16.0, 1e-4])
    given = EstimatePair(
        names=names, units=units, a=a, b=b, covariance_a=covariance, covariance_b=covariance, white=True, samples=10_000
    )
    (change,) = found(given, ("thruster_imbalance:fore",), "thruster_imbalance:aft").established
    assert change.candidate.name == "thruster_imbalance:aft"
    assert math.isclose(change.ratio, 0.9, abs_tol=1e-6)


def test_quotients_do_not_hang_on_thrust() -> None:
    sides, over = found(pair(CASES["thrust"][0])).parameter_ratio("inertia", "quadratic_drag") or pytest.fail("known")
    assert math.isclose(over[0], 1.0, abs_tol=1e-9)
    assert math.isclose(sides[0][0], 5000.0 / 3500.0)


def test_nothing_is_divided_by_what_may_be_zero() -> None:
    assert found(pair(VALUES)).ratio("thruster_lag.time_constant") is None


def test_what_would_have_been_seen_does_not_hang_on_what_was() -> None:
    alone, beside = (found(pair(b)).detectable_changes for b in (VALUES, moved("quadratic_drag", by=1.1)))
    assert math.isclose(beside[DRAG], alone[DRAG], rel_tol=0.2)


def test_more_difference_than_errors_have_is_told() -> None:
    given = pair(VALUES, seed=5)
    assert found(given).p_value > 0.001
    # Errors a third of what they are, all of it spread over all parameters.
    small = replace(given, covariance_a=given.covariance_a / 9.0, covariance_b=given.covariance_b / 9.0)
    assert found(small).p_value < found(given).p_value
