"""What a diagnosis comes to, in words."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from rovid.core.errors import join_words
from rovid.diagnose.cross_validation import HeldOutScores
from rovid.diagnose.result import Diagnosis, Finding, ModelAssessment
from rovid.effects import effect_named
from rovid.estimate.estimate import Estimate
from rovid.model.model import Model
from rovid.present.sentences import (
    cause_name,
    evidence_definitions,
    evidence_words,
    improvement_words,
    removed_sentence,
    verdict_sentence,
)
from rovid.trial.assumptions import Assumptions

LAG = Finding(
    effect=effect_named("thruster_lag"),
    estimate=Estimate(
        names=("thruster_lag.time_constant",),
        values=np.array([0.6]),
        covariance=np.array([[0.01**2]]),
        method="",
        samples=100,
    ),
    gain=4004.0,
    bic_gain=4000.0,
    held_out_gain=4500.0,
    standard_errors=60.0,
    probability=0.97,
    alternatives=(),
    indistinguishable=(),
)
DELAY = effect_named("command_delay")


def test_causes_are_named_in_one_sentence() -> None:
    found = Diagnosis(verdict="found", findings=(LAG, replace(LAG, effect=DELAY)))
    assert verdict_sentence(found, Assumptions()) == "The plain model misses thruster lag and command delay."
    suspected = Diagnosis(verdict="suspected", suspects=(replace(LAG, indistinguishable=(DELAY,)),))
    assert verdict_sentence(suspected, Assumptions()) == "The plain model may miss thruster lag or command delay."
    guess = Assumptions(items=("curve of fore",), thrusters=1)
    assert verdict_sentence(found, guess).startswith("The plain model, with a guessed thrust curve, misses")
    assert cause_name(LAG) == "thruster lag"
    many = tuple(map(effect_named, ("command_delay", "slew_limit", "supply_sag", "tank_seiche", "bias_torque")))
    said = cause_name(replace(LAG, indistinguishable=many))
    assert said == "thruster lag, command delay, slew limit, supply sag or one of 2 others"


def test_where_no_cause_is_named_that_is_said() -> None:
    said = {
        verdict_sentence(Diagnosis(verdict=each), Assumptions())
        for each in ("nothing_found", "unexplained", "too_little_data")
    }
    assert len(said) == 3


WEAK = replace(LAG, held_out_gain=14.0, standard_errors=3.62)


@pytest.mark.parametrize(
    ("finding", "words"),
    [
        (LAG, "confirmed: size 60 standard errors, log-likelihood gain 4500 on trials that were not fitted"),
        (WEAK, "likely: size 3.6 standard errors, log-likelihood gain 14 on trials that were not fitted"),
        (
            replace(LAG, probability=0.3),
            "possible: size 60 standard errors, log-likelihood gain 4500 on trials that were not fitted",
        ),
        (
            replace(LAG, indistinguishable=(DELAY,)),
            "cannot tell which: size 60 standard errors, log-likelihood gain 4500 on trials that were not fitted",
        ),
    ],
)
def test_evidence_is_a_word_with_its_numbers(finding: Finding, words: str) -> None:
    assert evidence_words(finding) == words


def test_each_word_that_is_used_is_defined_once_and_the_best_comes_first() -> None:
    causes = (WEAK, LAG, replace(LAG, indistinguishable=(DELAY,)), LAG)
    heads = [sentence.partition(":")[0] for sentence in evidence_definitions(causes)]
    assert heads == ["Confirmed", "Likely", "Cannot tell"]
    assert evidence_definitions(()) == []


def test_what_is_gained_is_a_share_of_each_error() -> None:
    assert (
        improvement_words({"heading error": (40.0, 4.0), "yaw rate error": (0.02, 0.01)})
        == "heading error 90 % smaller, yaw rate error 50 % smaller"
    )
    grown = improvement_words({"heading error": (4.0, 5.0), "yaw rate error": (0.02, 0.01)})
    assert grown == "heading error 25 % larger, yaw rate error 50 % smaller"


def assessment(rate_rmse: float, *effects: str) -> ModelAssessment:
    model = Model(inertia=1.0, quadratic_drag=1.0, linear_drag=1.0, effects=tuple(map(effect_named, effects)))
    scores = HeldOutScores(
        rate_r2=0.9, rate_rmse=rate_rmse, position_errors={}, log_likelihood=0.0, rate_squares=np.empty(0)
    )
    return ModelAssessment(model=model, estimate=LAG.estimate, held_out=scores)


# (25 - 9) / (25 - 4), (25 - 1) / (25 - 4) and 1 - 4 / 25 in mean squares; and a floor that is too near, or not known.
@pytest.mark.parametrize(
    ("extended", "changes", "said"),
    [
        (3.0, {}, "The causes remove 76 % of the mean square yaw rate error that a perfect model would remove."),
        (1.0, {}, "The causes remove all of the mean square yaw rate error that a perfect model would remove."),
        (
            3.0,
            {"leaves_unexplained": True},
            "The causes remove at most 77 % of the mean square yaw rate error that a perfect model would remove.",
        ),
        (
            3.0,
            {"signals": ((DELAY, 30.0),)},
            "The extended model removes 76 % of the mean square yaw rate error that a perfect model would remove.",
        ),
        (2.0, {"leaves_unexplained": True}, ""),
        (6.0, {}, ""),
        (3.0, {"noise_floor": 2.6}, ""),
        (3.0, {"noise_floor": np.nan}, ""),
    ],
)
def test_the_causes_are_measured_by_a_perfect_model(extended: float, changes: dict[str, Any], said: str) -> None:
    base, other = assessment(5.0), assessment(extended, "thruster_lag")
    diagnosis = Diagnosis(verdict="found", findings=(LAG,), base=base, extended=other, noise_floor=2.0)
    diagnosis = replace(diagnosis, **changes)
    assert removed_sentence(diagnosis) == said


def test_without_causes_the_part_that_a_perfect_model_would_remove_is_said() -> None:
    base = assessment(5.0)
    diagnosis = Diagnosis(verdict="unexplained", base=base, extended=base, noise_floor=1.9, leaves_unexplained=True)
    said = "A perfect model would remove at least 85 % of the mean square yaw rate error; no cause is established."
    assert removed_sentence(diagnosis) == said
    assert removed_sentence(replace(diagnosis, verdict="nothing_found")) == ""
    assert diagnosis.removed_share == 0.0
    assert removed_sentence(Diagnosis(verdict="too_little_data")) == ""


def test_lists_end_in_a_word() -> None:
    assert [join_words(texts) for texts in ([], ["a"], ["a", "b"], ["a", "b", "c"])] == [
        "",
        "a",
        "a and b",
        "a, b and c",
    ]
    assert join_words(["a", "b"], "or") == "a or b"
