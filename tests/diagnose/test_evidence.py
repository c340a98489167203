"""Probabilities of causes, and the words for them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from rovid.core.budget import Budget
from rovid.diagnose.candidate_fits import fit_coarse
from rovid.diagnose.evidence import (
    CANNOT_TELL,
    DEFINITIONS,
    Evidence,
    confirming_gain,
    grade,
    has_consistent_size,
    is_held_by_friction,
    outlier_probability,
    posterior_probability,
    probability_not_a_stand_in,
    recalibrated,
    size_in_errors,
)
from rovid.diagnose.result import Diagnosis
from rovid.diagnose.selection import Selection
from rovid.diagnose.stepwise import StepwiseSearch
from rovid.diagnose.thresholds import ESTABLISHED, POSSIBLE, THRESHOLDS
from rovid.effects import Effect, effect_named
from rovid.effects.base import Scales
from rovid.estimate.estimate import Estimate
from rovid.estimate.filter_data import InnovationData
from rovid.estimate.fit_result import FitResult
from rovid.estimate.innovation_likelihood import InnovationLikelihood
from rovid.estimate.multi_step import MultiStepData, MultiStepLikelihood
from rovid.estimate.objective import UNLIMITED
from rovid.trial.preprocessing import prepare
from rovid.trial.trial import Campaign
from tests import synthetic
from tests.predictions import TIME, fitted, records, weakened
from tests.present.test_sentences import LAG


@pytest.mark.parametrize(
    ("worths", "alike", "least", "most"),
    [
        ({}, (), 0.0, 0.0),
        ({"a": 0.0}, ("a",), 0.49, 0.51),
        ({"a": 10.0, "b": 10.0}, ("a",), 0.49, 0.51),
        ({"a": 10.0, "b": 10.0}, ("a", "b"), 0.95, 0.98),
        ({"a": 3.0} | {f"other {k}": -2.0 for k in range(20)}, ("a",), 0.44, 0.48),
        ({"a": 1e4}, ("a",), 0.95, 0.98),
        ({"a": -1e4}, ("a",), 0.0, 1e-9),
    ],
)
def test_posterior_probability(worths: dict[str, float], alike: tuple[str, ...], least: float, most: float) -> None:
    found = posterior_probability(worths, alike, len(worths))
    assert least <= found <= most
    assert math.isfinite(found)


@pytest.mark.parametrize(("white", "least", "enough"), [(False, 19.0, 21.0), (True, 12.0, 14.0)])
def test_a_small_held_out_gain_caps_the_probability(white: bool, least: float, enough: float) -> None:
    def sure(gain: float) -> float:
        return probability_not_a_stand_in(gain, gain, white=white)

    assert sure(6.0) == pytest.approx(0.5)
    assert sure(least) < ESTABLISHED <= sure(enough)
    assert sure(-1e6) < 1e-6
    assert sure(1e6) == sure(2e6) < 0.98
    assert posterior_probability({"a": least}, ("a",), 1, cap=sure(least)) == sure(least)


def test_with_white_innovations_the_smaller_gain_counts() -> None:
    for gains in ((30.0, 6.0), (6.0, 30.0)):
        assert probability_not_a_stand_in(*gains, white=True) == pytest.approx(0.5)
    assert probability_not_a_stand_in(30.0, 6.0, white=False) > ESTABLISHED


@pytest.mark.parametrize("white", [True, False])
def test_recalibration_is_monotonic_and_keeps_established_causes(white: bool) -> None:
    said = [recalibrated(sure, white=white) for sure in (0.0, 1e-3, 0.05, 0.3, 0.5, 0.8, ESTABLISHED, 0.97, 1.0)]
    assert said == sorted(said)
    assert (said[0], said[-1]) == (0.0, 1.0)
    assert recalibrated(ESTABLISHED, white=white) >= ESTABLISHED
    assert recalibrated(0.93, white=white) < ESTABLISHED
    assert recalibrated(1e-3, white=white) < POSSIBLE


def test_with_white_innovations_there_is_no_recalibration() -> None:
    assert recalibrated(0.15, white=True) == 0.15
    assert recalibrated(0.15, white=False) > 0.3


def test_a_true_cause_has_a_consistent_size() -> None:
    found, near = fitted("bias_torque", records(disturbance=np.full(len(TIME), 8.0)))
    assert has_consistent_size(found, near, found.effects[0])


def test_a_switch_below_the_breakaway_of_friction_looks_like_friction_that_sticks() -> None:
    """Thrust of 100 N/V, a staircase to 200 N, and a friction of 60 N m in motion and 85 N m near rest."""
    time = synthetic.clock(120.0, rate=5.0)
    steps = np.repeat([0.2, 0.5, 0.7, 1.0, 1.5, 2.0, -0.5], 86)[: len(time)]
    stairs = synthetic.trial(time, steps, np.sin(0.1 * time))
    runs = prepare(Campaign(trials=(stairs,), sources=()), synthetic.VEHICLE, cutoff=1.0).items
    data = InnovationData(runs, synthetic.VEHICLE, synthetic.ROSUB)
    friction, switch = effect_named("coulomb_resistance:stiction"), effect_named("command_hysteresis:schmitt")
    drag = effect_named("drag_curvature")

    def is_held(width: float, *others: tuple[Effect, float, float]) -> bool:
        effects = (*(effect for effect, *_ in others), switch)
        values = (*(value for _, *pair in others for value in pair), width)
        model = replace(synthetic.ROSUB, effects=effects, effect_values=values)
        objective = InnovationLikelihood(data, UNLIMITED, effects)
        x = objective.parametrization.coordinates_of(model, 1.0, 1.0, 1e-4)
        return is_held_by_friction(FitResult(objective, x, 0.0), switch)

    rubbing = friction, 60.0, 0.05
    assert is_held(0.8, rubbing)
    assert not is_held(1.2, rubbing)
    assert not is_held(0.8)
    objective = InnovationLikelihood(data, UNLIMITED, (friction, drag))
    x = objective.parametrization.initial()
    assert not is_held_by_friction(FitResult(objective, x, 0.0), drag)


def test_a_size_that_one_step_predictions_do_not_show_is_inconsistent() -> None:
    found, near = fitted("bias_torque", records(disturbance=np.full(len(TIME), 8.0)))
    at = len(found.common_coordinates)
    twice = found.x.copy()
    twice[at] *= 2.0
    assert not has_consistent_size(replace(found, x=twice), near, found.effects[0])
    turned = found.x.copy()
    turned[at] *= -1.0
    assert not has_consistent_size(replace(found, x=turned), near, found.effects[0])


@pytest.mark.parametrize(
    ("shares", "stands"),
    [
        ((0.0, 0.0, 0.4, 0.0), True),
        ((0.0, 0.01, 0.4, -0.01, 0.0), True),
        # Within the scatter of the others, and of any battery.
        ((0.2, -0.2, 0.4, 0.0), False),
        ((0.0, 0.0, 0.05, 0.0), False),
        # Three trials are too few.
        ((0.0, 0.0, 0.15), False),
    ],
)
def test_a_trial_is_an_outlier_relative_to_the_scatter_of_the_others(shares: Sequence[float], stands: bool) -> None:
    ahead = MultiStepData.from_data(
        InnovationData(weakened(shares), synthetic.LOGGED, synthetic.ROSUB), synthetic.ROSUB
    )
    odd = effect_named("supply_sag:trial run_2")
    objective = MultiStepLikelihood(ahead, effects=(odd,))
    begin = objective.parametrization.initial()
    begin[-1] = 0.8
    fitted = fit_coarse(objective, begin, 20)
    assert fitted.x[-1] < 0.99
    assert (outlier_probability(fitted, odd) >= ESTABLISHED) is stands


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
    possible, likelier = replace(LAG, probability=0.3), replace(LAG, probability=0.4, held_out_gain=1.0)
    larger, farther = replace(LAG, held_out_gain=5000.0), replace(LAG, standard_errors=61.0)
    diagnosis = Diagnosis(verdict="found", findings=(LAG, weak, larger, farther), suspects=(likelier, possible))
    assert possible.evidence is likelier.evidence
    assert diagnosis.causes == (larger, farther, LAG, weak, likelier, possible)


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


@pytest.mark.parametrize(("undetermined", "expected"), [((), 5.0), (("yaw",), 4.0), (("yaw", "sway"), 0.0)])
def test_only_determined_sizes_show_a_cause(undetermined: tuple[str, ...], expected: float) -> None:
    effect, scales = effect_named("speed_dependent_damping:planar"), Scales(command=1.0, torque=1.0, rate=1.0, wash=1.0)
    estimate = Estimate(
        names=("inertia", *effect.parameter_names),
        values=np.array([7.0, 3.0, 4.0]),
        covariance=np.eye(3),
        method="",
        samples=9,
        refused={f"{effect.key}.{name}": "these runs do not determine it" for name in undetermined},
    )
    assert size_in_errors(effect, estimate, scales) == pytest.approx(expected)
