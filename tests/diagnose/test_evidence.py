"""The scale of evidence: words for a cause by its gain on held-out trials and its size in standard errors."""

from __future__ import annotations

from dataclasses import replace

import pytest

from rovid.core.budget import Budget
from rovid.diagnose.evidence import (
    CANNOT_TELL,
    DEFINITIONS,
    Evidence,
    confirming_gain,
    grade,
    probability_not_a_stand_in,
)
from rovid.diagnose.result import Diagnosis
from rovid.diagnose.selection import Selection
from rovid.diagnose.stepwise import StepwiseSearch
from rovid.diagnose.thresholds import THRESHOLDS
from rovid.effects import effect_named
from tests.present.test_sentences import LAG

MOST = THRESHOLDS.max_probability
FAR, NEAR = THRESHOLDS.confirmed_standard_errors, THRESHOLDS.likely_standard_errors


def test_a_lag_of_175_standard_errors_and_a_friction_of_1_do_not_look_alike() -> None:
    assert grade(MOST, 3200.0, 175.0, white=False) is Evidence.CONFIRMED
    assert grade(MOST, 3200.0, 1.1, white=False) is Evidence.POSSIBLE


@pytest.mark.parametrize("white", [True, False])
def test_a_confirmed_cause_needs_each_of_its_conditions(white: bool) -> None:
    gain = confirming_gain(white=white)
    assert grade(MOST, gain, FAR, white=white) is Evidence.CONFIRMED
    assert grade(MOST, gain - 0.1, FAR, white=white) is Evidence.LIKELY
    assert grade(MOST, gain, FAR - 0.1, white=white) is Evidence.LIKELY
    assert grade(THRESHOLDS.established - 0.01, gain, FAR, white=white) is Evidence.LIKELY
    assert grade(MOST, gain, FAR, white=white, is_conclusive=False) is Evidence.LIKELY


def test_a_likely_cause_is_more_probable_than_not_and_two_errors_from_nothing() -> None:
    assert grade(THRESHOLDS.likely, 0.0, NEAR, white=True) is Evidence.LIKELY
    assert grade(THRESHOLDS.likely - 0.01, 0.0, NEAR, white=True) is Evidence.POSSIBLE
    assert grade(THRESHOLDS.likely, 0.0, NEAR - 0.01, white=True) is Evidence.POSSIBLE


@pytest.mark.parametrize("white", [True, False])
def test_the_gain_of_a_confirmed_cause_is_more_than_establishes_one(white: bool) -> None:
    gain = confirming_gain(white=white)
    assert probability_not_a_stand_in(gain, gain, white=white) == MOST
    uncapped = 1.0 - 1.0 / (1.0 + THRESHOLDS.confirmed_odds)
    assert uncapped > MOST > THRESHOLDS.established


def test_one_of_several_indistinguishable_causes_is_likely_at_most() -> None:
    assert LAG.evidence is Evidence.CONFIRMED
    assert replace(LAG, indistinguishable=(effect_named("command_delay"),)).evidence is Evidence.LIKELY


def test_what_a_search_without_an_end_finds_is_likely_at_most() -> None:
    assert replace(LAG, is_complete=False).evidence is Evidence.LIKELY


def test_causes_stand_in_the_order_of_their_evidence() -> None:
    weak = replace(LAG, standard_errors=3.0, held_out_gain=9000.0)
    possible = replace(LAG, probability=0.3)
    larger, farther = replace(LAG, held_out_gain=5000.0), replace(LAG, standard_errors=61.0)
    diagnosis = Diagnosis(verdict="found", findings=(LAG, weak, larger, farther), suspects=(possible,))
    assert diagnosis.causes == (larger, farther, LAG, weak, possible)


def test_each_word_has_one_sentence() -> None:
    assert list(DEFINITIONS) == [*Evidence, CANNOT_TELL]
    assert all(sentence.endswith(".") and sentence.count(". ") == 0 for sentence in DEFINITIONS.values())


def test_a_suspect_is_possible_at_most_where_a_promising_cause_was_not_fitted() -> None:
    lag, bias = effect_named("thruster_lag"), effect_named("bias_torque")
    search = StepwiseSearch([lag, bias], Budget())
    selection = Selection.__new__(Selection)
    object.__setattr__(selection, "search", search)
    assert selection.max_suspect_probability == THRESHOLDS.max_suspect_probability
    search.budget.leave_out("challengers")
    assert selection.max_suspect_probability == THRESHOLDS.max_suspect_probability
    search.budget.leave_out(lag.id)
    assert grade(selection.max_suspect_probability, 1e3, 1e2, white=True) is Evidence.POSSIBLE
