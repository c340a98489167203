"""What is known of models need not be worked out again."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from rovid.diagnose import bic, fit_cache
from rovid.diagnose.fit_cache import FitCache
from rovid.effects import Effect, effect_named
from rovid.estimate.fit_result import FitResult, fit
from rovid.estimate.multi_step_likelihood import MultiStepLikelihood
from tests.predictions import BIAS, biased

BEND, UNEQUAL = effect_named("drag_curvature"), effect_named("thrust_asymmetry")


@pytest.fixture(scope="module")
def base() -> FitResult:
    plain = MultiStepLikelihood(biased())
    return fit(plain, plain.parametrization.initial())


def with_effects(base: FitResult, *effects: Effect) -> FitResult:
    """As they start, as if that were the end of a climb."""
    x = np.concatenate((base.x, *(effect.initial_values[0] for effect in effects)))
    return replace(FitResult.at(base.objective.with_effects(effects), x), remaining_gain=0.0)


def test_a_model_without_several_of_its_effects_is_fitted_once(
    base: FitResult, monkeypatch: pytest.MonkeyPatch
) -> None:
    models, whole = FitCache(), with_effects(base, BIAS, BEND, UNEQUAL)
    rest = models.without(whole, BEND, UNEQUAL)
    assert rest.effects == (BIAS,)
    assert rest.value < with_effects(base, BIAS).value
    # Nothing is fitted on the way, and it is known from then on.
    assert [*models.fits] == [rest.key]
    monkeypatch.setattr(fit_cache, "quickly_climbed", None)
    assert models.without(whole, UNEQUAL, BEND) is rest
    assert models.without(whole) is whole


def test_what_was_left_behind_is_followed_to_its_end_before_it_stands_for_a_model_without_an_effect(
    base: FitResult,
) -> None:
    models, left = FitCache(), replace(with_effects(base, BIAS), remaining_gain=math.inf)
    models.fits[left.key] = left
    ended = models.without(with_effects(base, BIAS, BEND), BEND)
    assert ended.value < left.value
    assert models.fits[left.key] is ended
    assert models.converged(ended) is ended


def test_ends_beside_a_model_have_one_effect_more_which_stands_last(base: FitResult) -> None:
    models, here = FitCache(), with_effects(base, BIAS)
    ended, unfinished = (
        with_effects(base, BEND, BIAS),
        replace(with_effects(base, BIAS, UNEQUAL), remaining_gain=math.inf),
    )
    every = with_effects(base, BIAS, BEND, UNEQUAL)
    looser = replace(ended, objective=replace(ended.objective, limit=0.5))
    models.fits.update({fit.key: fit for fit in (here, ended, unfinished, every, looser)})
    ((key, found),) = models.converged_extensions(here).items()
    assert key == BEND.key
    assert found.effects == (BIAS, BEND)
    assert found.value == ended.value
    assert found.model.values == pytest.approx(with_effects(base, BIAS, BEND).model.values)


def test_a_fit_worse_than_one_with_an_effect_less_is_begun_anew_from_there(
    base: FitResult, monkeypatch: pytest.MonkeyPatch
) -> None:
    models, plain = FitCache(), replace(base, remaining_gain=0.0)
    models.fits[plain.key] = plain
    astray = replace(with_effects(base, BEND), value=plain.value + 5.0)
    climb, climbs = bic.fit_coarse, [astray]
    monkeypatch.setattr(fit_cache, "quickly_climbed", lambda *told: climbs.pop() if climbs else climb(*told))
    models.fit(base.objective, [((BEND,), astray.x)])
    assert models.fits[astray.key].value <= plain.value
    assert climbs == []
