"""The final challenge: a better set of causes takes the place of the selected one, and the closest sets are listed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rovid.diagnose.candidate_fits import bic_score, value_at_score
from rovid.diagnose.challenge import challenge, challenging_fits, closest_challengers
from rovid.diagnose.cross_validation import cv_pieces
from rovid.diagnose.selection import Selection
from rovid.diagnose.stepwise import StepwiseSearch
from rovid.diagnose.thresholds import THRESHOLDS
from rovid.effects import Effect, bias_torque, effect_named
from rovid.estimate.fit_result import FitResult, fit
from rovid.estimate.multi_step import MultiStepLikelihood
from tests import synthetic
from tests.predictions import BIAS, biased

EACH = bias_torque.for_trials(("run", "walk"))
BEND, UNEQUAL, DRAG = map(effect_named, ("drag_curvature", "thrust_asymmetry", "drag_asymmetry"))


@pytest.fixture(scope="module")
def base() -> FitResult:
    """The plain model of logs in which a constant torque acts."""
    objective = MultiStepLikelihood(biased())
    return fit(objective, objective.parametrization.initial())


def selected(base: FitResult, *effects: Effect, candidates: tuple[Effect, ...] = (BIAS, BEND, UNEQUAL)) -> Selection:
    """A selection of these effects, by a search that ended there."""
    objective = base.objective.with_effects(effects)
    starts = [effect.initial_values[0] for effect in effects]
    model = fit(objective, np.concatenate((base.x, *starts)), tolerance=THRESHOLDS.search_tolerance)
    search = StepwiseSearch(candidates)
    search.cache.fits.update({base.key: base, model.key: model})
    pieces = cv_pieces(base.data.runs, synthetic.LOGGED, 1.0)
    return Selection(search=search, data=base.data, base=base, model=model, pieces=pieces, multi_step=True)


@pytest.mark.parametrize("stand_ins", [(UNEQUAL,), (UNEQUAL, BEND), (BEND, DRAG)], ids=len)
def test_one_cause_that_explains_more_takes_the_place_of_its_stand_ins(
    base: FitResult, stand_ins: tuple[Effect, ...]
) -> None:
    selection = selected(base, *stand_ins, candidates=(BIAS, BEND, UNEQUAL, DRAG))
    found = challenge(selection)
    assert found.model.effects == (BIAS,)
    assert bic_score(found.model) > bic_score(selection.model)


def test_the_closest_other_sets_are_listed_with_what_they_lose(base: FitResult) -> None:
    found = challenge(selected(base, BIAS))
    assert found.model.effects == (BIAS,)
    closest = closest_challengers(found)
    assert closest
    scores = [one.score_difference for one in closest]
    assert scores == sorted(scores, reverse=True)
    assert max(scores) < 0.0
    for one in closest:
        fitted = next(each for each in challenging_fits(found.search, found.model) if each.effects == one.effects)
        assert one.log_likelihood_difference == found.model.value - fitted.value
        assert one.score_difference == pytest.approx(bic_score(fitted) - bic_score(found.model))
        assert BIAS not in one.effects


@pytest.mark.parametrize(("gain", "effects"), [(3.0, (BIAS,)), (60.0, (EACH,))])
def test_one_common_size_takes_the_place_of_equal_sizes_in_each_trial(
    base: FitResult, gain: float, effects: tuple[Effect, ...]
) -> None:
    selection = selected(base, EACH)
    common = selected(base, BIAS).model
    # As if the sizes by trial were better by so much, at their higher price.
    value = value_at_score(bic_score(common) + gain, selection.model.objective)
    model = replace(selection.model, value=value, remaining_gain=0.0)
    selection.search.cache.fits[model.key] = model
    assert challenge(replace(selection, model=model)).model.effects == effects


def test_a_set_within_the_margin_is_a_rival(base: FitResult) -> None:
    """One cause explains the logs nearly as well as the selected two."""
    selection = selected(base, UNEQUAL, BEND)
    single = selected(base, DRAG).model
    near = replace(single, value=value_at_score(bic_score(selection.model) - 1.0, single.objective))
    selection.search.cache.challengers[selection.model.key] = [near]
    cause = selection.search.cause(selection.model, UNEQUAL)
    assert DRAG in selection.indistinguishable(cause)
    # What is added to a set that is as close without it takes nothing's place.
    both = selected(base, DRAG, BIAS).model
    least = selection.search.required_score(selection.model, both)
    more = replace(both, value=value_at_score(least - 1.0, both.objective))
    selection.search.cache.challengers[selection.model.key] = [near, more]
    assert BIAS not in selection.indistinguishable(cause)
    selection.search.cache.challengers[selection.model.key] = [more]
    assert {DRAG, BIAS} <= {*selection.indistinguishable(cause)}
    far = replace(near, value=near.value + 60.0)
    selection.search.cache.challengers[selection.model.key] = [far]
    assert DRAG not in selection.indistinguishable(cause)


def test_a_cause_that_failed_a_test_takes_no_place(base: FitResult) -> None:
    selection = selected(base, UNEQUAL)
    assert challenge(selection.ban(BIAS)).model.effects == (UNEQUAL,)


def test_no_cause_has_no_challengers(base: FitResult) -> None:
    selection = replace(selected(base, BIAS), model=base)
    assert closest_challengers(challenge(selection)) == ()
