"""A diagnosis at the end of its budget, by a clock that moves with each look at it."""

from __future__ import annotations

import pytest

from rovid.core.budget import Budget
from rovid.diagnose.algorithm import diagnose
from rovid.diagnose.evidence import Evidence
from rovid.diagnose.result import Diagnosis
from rovid.diagnose.thresholds import THRESHOLDS
from tests import synthetic
from tests.core.test_budget import Clock
from tests.diagnose.test_algorithm import prepared


def diagnosed_until(looks: float) -> tuple[Diagnosis, Budget]:
    """Diagnosis of a lag of 1.5 s that may look ``looks`` times at the clock."""
    budget = Budget(looks, share=1.0, clock=Clock(tick=1.0))
    return diagnose(prepared(), synthetic.LOGGED, budget=budget), budget


@pytest.fixture(scope="module")
def looks_in_all() -> int:
    """Looks of a diagnosis that comes to its end."""
    diagnosis, budget = diagnosed_until(1e9)
    assert [finding.effect.id for finding in diagnosis.findings] == ["thruster_lag"]
    assert not budget.not_tried
    assert not any("budget" in warning for warning in diagnosis.warnings)
    return int(budget.used)


@pytest.mark.parametrize("share", [0.0, 0.1, 0.3, 0.6])
def test_what_is_found_in_part_of_the_time_is_likely_at_most(looks_in_all: int, share: float) -> None:
    diagnosis, budget = diagnosed_until(1.0 + share * looks_in_all)
    assert budget.not_tried
    assert diagnosis.findings == ()
    for suspect in diagnosis.suspects:
        assert suspect.evidence is not Evidence.CONFIRMED
        assert suspect.probability < THRESHOLDS.established
    if diagnosis.verdict != "too_little_data":
        assert any("budget" in warning for warning in diagnosis.warnings)
    # After the end the clock is looked at a few times more, not by each of many fits.
    assert budget.used < 1.0 + share * looks_in_all + 0.6 * looks_in_all


def test_a_cause_that_was_fitted_before_the_end_is_a_suspect(looks_in_all: int) -> None:
    diagnosis, _ = diagnosed_until(0.6 * looks_in_all)
    assert [suspect.effect.id for suspect in diagnosis.suspects][:1] == ["thruster_lag"]
    assert diagnosis.verdict == "suspected"
